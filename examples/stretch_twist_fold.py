"""
Tracers in a stretch-twist-fold flow
====================================

The flow of Bajer and Moffatt stretches, twists and folds a fluid inside a sphere, as a dynamo would
a magnetic field. Dots are passages of thirty tracers through the plane y = 0, with a colour for
each. If the fluid turns slowly about the y-axis, alpha small, a tracer stays near a surface for
long and moves from one to another; at alpha = 1 each of them fills the sphere.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import bajer_moffatt as problem

plt.style.use(plot.STYLE)

# %%
# The components are polynomials of degree 2, and the divergence is zero:
#
# .. math:: x' = \alpha z - 8 x y, \quad y' = 11 x^2 + 3 y^2 + z^2 + x z - 3, \quad
#           z' = -\alpha x + 2 y z - x y
#
# The plan shows the splitting.

rng = np.random.default_rng(1)
directions = rng.standard_normal((30, 3))
directions /= np.linalg.norm(directions, axis=1, keepdims=True)
starts = 0.95 * directions * rng.uniform(size=(30, 1)) ** (1 / 3)  # evenly in the ball
lv.plan(problem.system, h=problem.h, x=starts)

# %%
# Volume is preserved, so the tracers stay evenly distributed in the ball. The sphere itself is
# invariant to the accuracy of the method only: with too large a step some tracers would leave it.

points = {
    alpha: lv.section(
        problem.system,
        lv.VolumeSplitting(composition="BM4"),
        t=(0.0, 1500.0),
        h=problem.h,
        plane="y",
        params={"alpha": alpha},
        x=starts,
    )
    for alpha in (0.1, 1.0)
}
points[0.1]

# %%
# The fluid turns slowly.

fig, ax = plt.subplots(figsize=(5, 5.2))
plot.section(points[0.1], ax=ax)
ax.set(xlabel="x", ylabel="z", title=r"y = 0 for $\alpha$ = 0.1")
plt.show()

# %%
# It turns fast.

fig, ax = plt.subplots(figsize=(5, 5.2))
plot.section(points[1.0], ax=ax)
ax.set(xlabel="x", ylabel="z", title=r"y = 0 for $\alpha$ = 1")
plt.show()
