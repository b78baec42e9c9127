"""
Steps that follow an eccentric orbit
====================================

A particle on a sphere is attracted by the pole, and its distance to it varies by a factor of
twenty-seven. Equal steps are too small far from the pole and too large near it. Steps controlled by
their error follow the orbit, but lose energy in every revolution. Reversible steps follow it too,
and keep the energy.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import kepler_on_sphere as problem

plt.style.use(plot.STYLE)
problem.system

# %%
# Reversible steps follow a monitor, a function of the state: here the time that an orbit of that
# size would take, by Kepler's third law.

REVOLUTIONS = 100
t = (0.0, REVOLUTIONS * problem.period)


def monitor(t, q, v, params):
    return (q[0] ** 2 + q[1] ** 2) ** 0.75  # from the distance to the pole


ways = {
    "reversible": {"h": problem.period / 60, "control": lv.Reversible(monitor)},
    "controlled by the error": {"rtol": 3e-8},
}
runs = {
    name: lv.integrate(problem.system, lv.Spark(stages=2), t=t, **how, **problem.start)
    for name, how in ways.items()
}
runs["reversible"]

# %%
# Both take their shortest steps where the particle passes the pole.

fig, ax = plt.subplots()
for name, solution in runs.items():
    once = solution.t[solution.t < problem.period]
    ax.semilogy(once[:-1], np.diff(once), ".-", ms=3, label=name)
ax.set(xlabel="time, of the first revolution", ylabel="length of the step")
fig.legend(ncols=2, loc="outside upper left")
plt.show()

# %%
# The error of reversible steps returns to the same size in each revolution, the other one grows.

fig, ax = plt.subplots()
for name, solution in runs.items():
    drift = np.abs(solution.invariants["energy"] - solution.invariants["energy"][0])
    label = f"{name}: {solution.stats['steps'] / REVOLUTIONS:.0f} steps a revolution"
    ax.loglog(solution.t[1:] / problem.period, drift[1:], ".", ms=1, label=label)
ax.set(
    xlabel="revolutions",
    ylabel="error of the energy",
    xlim=(1e-2, None),
    ylim=(1e-12, None),
)
fig.legend(markerscale=6, loc="outside upper left")
plt.show()
