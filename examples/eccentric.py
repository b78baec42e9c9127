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
from liouville.problems import kepler_on_sphere as problem

REVOLUTIONS = 100
t = (0.0, REVOLUTIONS * problem.period)


def monitor(t, q, v, params):
    return (q[0] ** 2 + q[1] ** 2) ** 0.75  # Kepler's third law, for the distance from the pole


ways = {
    "reversible": {"h": problem.period / 60, "control": lv.Reversible(monitor)},
    "controlled by the error": {"rtol": 3e-8},
}

fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for name, how in ways.items():
    solution = lv.integrate(problem.system, lv.Spark(stages=2), t=t, **how, **problem.start)
    drift = np.abs(solution.invariants["energy"] - solution.invariants["energy"][0])
    steps = solution.stats["steps"] / REVOLUTIONS
    once = solution.t < problem.period
    left.semilogy(solution.t[once][:-1], np.diff(solution.t[once]), ".-", ms=3, label=name)
    right.loglog(solution.t[1:] / problem.period, drift[1:], ".", ms=1,
                 label=f"{name}: {steps:.0f} steps a revolution")  # fmt: skip

left.set(title="length of the steps", xlabel="time, one revolution")
right.set(title="error of the energy", xlabel="revolutions")
right.legend(markerscale=6, fontsize=8)
plt.show()
