"""
The forces in a slider-crank
============================

A crank turns a rod, the rod pushes a slider; two constraints close the loop. Their multipliers have
the full order of the method, and give the force on the guide along with the motion.
"""

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import slider_crank as problem

plt.style.use(plot.STYLE)
problem.system

# %%
# Multipliers follow the names of the constraints.

solution = lv.integrate(
    problem.system, lv.Spark(stages=3), t=problem.interval, h=problem.h, **problem.start
)
solution

# %%
# Twelve instants of the motion, dark to light.

params = SimpleNamespace(**solution.params)

fig, ax = plt.subplots(figsize=(6, 3.2))
for i in np.linspace(0, len(solution.t) - 1, 12).round().astype(int):
    for line in problem.outline(solution.q[i], params):
        ax.plot(*line.T, color=plt.cm.viridis(i / len(solution.t)))
ax.set(aspect="equal", xlabel="x / m", ylabel="y / m")
plt.show()

# %%
# The multiplier of the guide is its force.

guide = solution.lam[:, solution.names["constraints"].index("guide")]

fig, ax = plt.subplots()
ax.plot(1e3 * solution.t, guide)
ax.set(xlabel="time / ms", ylabel="force of the guide / N")
plt.show()
