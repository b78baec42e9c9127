"""
A molecule in a laser
=====================

Hydrogen fluoride as a Morse oscillator in the field of a laser, from its ground state: the model of
Walker and Preston. The potential depends on time, and the split operator evaluates it at the time
of each flow. Each step is unitary, so the norm is constant to roundoff.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import walker_preston as problem

plt.style.use(plot.STYLE)
problem.system

# %%
# Forty periods of the laser, in atomic units; the mean stretch of the bond is observed.

period = 2 * np.pi / problem.PARAMS["omega"]
points = problem.system.grid.points[:, 0]
solution = lv.integrate(
    problem.system,
    lv.SplitOperator("RKN6s11"),
    t=(0.0, 40 * period),
    steps=40 * 24,
    every=2,
    observe={"stretch": points},
    **problem.start,
)
solution

# %%
# The density of the bond's stretch.

fig, ax = plt.subplots()
plot.density(solution, ax=ax)
ax.set(xlim=(-0.6, 1.6), xlabel="stretch / bohr", ylabel="time / atomic units")
plt.show()

# %%
# Its mean: the laser is a little off resonance, so the bond takes energy and gives it back.

fig, ax = plt.subplots()
ax.plot(solution.t / period, solution.observed["stretch"])
ax.set(xlabel="time / periods of the laser", ylabel="mean stretch / bohr")
plt.show()

# %%
# The method has order 6: with half the step the error falls by 64 or so.

exact = problem.reference[problem.interval[1]]["psi"]
for steps in (12, 24, 48, 96):
    found = lv.integrate(
        problem.system,
        lv.SplitOperator("RKN6s11"),
        t=problem.interval,
        steps=steps,
        **problem.start,
    )
    error = max(abs(found.psi[-1][place] - value) for place, value in exact.items())
    print(f"{steps:3} steps, {found.stats['products']:5.0f} pairs of FFTs: {error:.1e}")
