"""
The energy of a pendulum
========================

A spherical pendulum with one to four stages, two thousand steps each. The energy error depends on
the order and not on the time: it oscillates and does not grow.
"""

import matplotlib.pyplot as plt

import liouville as lv
from liouville.problems import spherical_pendulum as problem

fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for stages in (1, 2, 3, 4):
    solution = lv.integrate(
        problem.system, lv.Spark(stages=stages), t=(0.0, 100.0), h=0.05, **problem.start
    )
    drift = solution.invariant_drift("energy")
    ax.semilogy(solution.t[1:], drift[1:], ".", ms=2, label=f"s = {stages}, order {2 * stages}")
ax.set(xlabel="time", ylabel="relative energy error", ylim=(1e-18, 1), title=f"h = {solution.h:g}")
ax.legend(markerscale=5, ncols=4, loc="lower center", fontsize=8)
plt.show()
