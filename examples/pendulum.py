"""
The energy of a pendulum
========================

A spherical pendulum with one to four stages, two thousand steps each. The energy error depends on
the order and not on the time: it oscillates and does not grow.
"""

import matplotlib.pyplot as plt

import liouville as lv
from liouville import plot
from liouville.problems import spherical_pendulum as problem

plt.style.use(plot.STYLE)
problem.system

# %%
# A run with two stages. In the table, a small curve beside each name is what it does in time.

runs = {
    stages: lv.integrate(
        problem.system, lv.Spark(stages=stages), t=(0.0, 100.0), h=0.05, **problem.start
    )
    for stages in (1, 2, 3, 4)
}
runs[2]

# %%
# Each stage more makes the error of the energy some four digits smaller, down to roundoff.

fig, ax = plt.subplots()
for stages, solution in runs.items():
    drift = solution.invariant_drift("energy")
    ax.semilogy(
        solution.t[1:], drift[1:], ".", ms=2, label=f"s = {stages}, order {2 * stages}"
    )
ax.set(xlabel="time", ylabel="relative error of the energy", ylim=(1e-16, 1))
fig.legend(markerscale=5, ncols=4, loc="outside upper left")
plt.show()
