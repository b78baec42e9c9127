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
from liouville.problems import fekete as problem

solution = lv.integrate(
    problem.system, lv.Spark(stages=3), t=(0.0, 1000.0), rtol=1e-6, **problem.start
)
paths = solution.q.reshape(len(solution.t), -1, 3)

fig = plt.figure(figsize=(10, 4.2), layout="constrained")
left, right = fig.add_subplot(121, projection="3d"), fig.add_subplot(122)
for k in range(paths.shape[1]):
    left.plot(*paths[:, k].T, color="0.7", lw=0.7)
left.scatter(*paths[-1].T, s=25)
left.set(title="paths, and where they end", box_aspect=(1, 1, 1))
right.loglog(solution.t[1:], np.abs(solution.v[1:]).max(axis=1), label="largest velocity")
right.loglog(solution.t[1:], np.diff(solution.t), label="length of the step")
right.set(xlabel="time", ylim=(1e-9, 1e3))
right.legend()
plt.show()
