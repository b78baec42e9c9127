"""
Islands in the ABC flow
=======================

The flow of Arnold, Beltrami and Childress is a sum of waves, that is, of three shears: a step of
the splitting is three assignments, and preserves volume to roundoff. Dots are passages through the
planes z = 0, 2π, 4π, ..., with a colour for each of eighty trajectories. Trajectories in a vortex
stay on a surface around it, here a closed curve; the others are chaotic and fill the rest.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import abc_flow as problem

plt.style.use(plot.STYLE)
problem.system

# %%
# Eighty trajectories from places on the plane z = 0.

rng = np.random.default_rng(0)
starts = np.column_stack([rng.uniform(0.0, 2 * np.pi, (80, 2)), np.zeros(80)])
points = lv.section(
    problem.system,
    lv.VolumeSplitting(composition="BM4"),
    t=(0.0, 6000.0),
    h=0.1,
    plane="z",
    period=2 * np.pi,
    params={"A": 1.0, "B": np.sqrt(2 / 3), "C": np.sqrt(1 / 3)},
    x=starts,
)
points

# %%
# Coordinates are angles. Where z' is zero trajectories touch the plane, and there are no dots.

fig, ax = plt.subplots(figsize=(5.4, 5.6))
plot.section(points, period=2 * np.pi, ax=ax)
ax.set(xlabel="x / rad", ylabel="y / rad")
plt.show()
