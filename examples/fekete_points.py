"""
Twenty points that keep their distance
======================================

Twenty particles on a sphere repel each other and are slowed down by drag, until they rest as far
apart as possible: at Fekete points. The steps are controlled by their error, short while the
particles move fast and ever longer as they come to rest.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import fekete as problem

plt.style.use(plot.STYLE)

solution = lv.integrate(
    problem.system, lv.Spark(stages=3), t=(0.0, 1000.0), rtol=1e-6, **problem.start
)
solution

# %%
# Paths in grey, and the points where they end.

paths = solution.q.reshape(len(solution.t), -1, 3)

fig, ax = plt.subplots(figsize=(5, 4.6), subplot_kw={"projection": "3d"})
for k in range(paths.shape[1]):
    ax.plot(*paths[:, k].T, color="0.6", lw=0.8)
ax.scatter(*paths[-1].T, s=25)
ax.set(xlabel="x", ylabel="y", zlabel="z")
ax.set_box_aspect((1, 1, 1), zoom=0.9)
ax.locator_params(nbins=5)
plt.show()

# %%
# Velocities fall to what the tolerance allows, and steps grow.

fig, ax = plt.subplots()
ax.loglog(solution.t[1:], np.abs(solution.v[1:]).max(axis=1), label="largest velocity")
ax.loglog(solution.t[1:], np.diff(solution.t), label="length of the step")
ax.set(xlabel="time", ylabel="velocity, length of the step")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
