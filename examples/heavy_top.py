"""
A heavy top for a long time
===========================

A disc on a rod spins about a fixed point at 150 rad/s and precesses under its weight. Its attitude
is a unit quaternion, whose length is the one constraint; energy, the angular momentum about the
vertical and the spin about the rod are constant, and stay so for a thousand revolutions.
"""

import matplotlib.pyplot as plt

import liouville as lv
from liouville import plot
from liouville.problems import heavy_top as problem


def disc(t, q, v, params):
    return problem.rotate(q, params.X)


solution = lv.integrate(
    problem.system,
    lv.Spark(stages=4),
    t=(0.0, 60.0),
    h=1e-3,
    every=10,
    observe={"disc": disc},
    **problem.start,
)

fig = plt.figure(figsize=(10, 4), layout="constrained")
left, right = fig.add_subplot(121, projection="3d"), fig.add_subplot(122)
shown = solution.t <= 4.0
left.plot(*solution.observed["disc"][shown].T, lw=1)
left.set(title="path of the disc's centre, 4 s", box_aspect=(1, 1, 1))
plot.invariants(solution, ax=right)
plt.show()
