"""
A ring without friction, and RK4
================================

Without forcing and friction Lorenz's ring of 1996 is chaotic and conserves its energy, half the sum
of squares. Neither method conserves it exactly. The splitting preserves volume and is reversible:
its energy error is a random walk. The classical Runge-Kutta method, with a third of the step and as
many evaluations, dissipates energy.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import lorenz96 as problem

plt.style.use(plot.STYLE)

H, STEPS, EVERY = 0.2, 30_000, 100

solution = lv.integrate(
    problem.system,
    lv.VolumeSplitting(composition="BM4"),
    t=(0.0, STEPS * H),
    steps=STEPS,
    every=EVERY,
    **problem.start,
)
solution

# %%
# Twelve evaluations a step: three steps of the Runge-Kutta method.


def field(x):
    return (np.roll(x, -1) - np.roll(x, 2)) * np.roll(x, 1)


def runge_kutta(x, h):
    a = field(x)
    b = field(x + h / 2 * a)
    c = field(x + h / 2 * b)
    return x + h / 6 * (a + 2 * b + 2 * c + field(x + h * c))


x = np.array(problem.start["x"])
energies = [x @ x / 2]
for _ in range(STEPS // EVERY):
    for _ in range(3 * EVERY):
        x = runge_kutta(x, H / 3)
    energies.append(x @ x / 2)

# %%
# The splitting gains and loses by turns, the Runge-Kutta method only loses.

fig, ax = plt.subplots()
for name, energy in (("BM4", solution.invariants["energy"]), ("RK4", np.array(energies))):
    ax.plot(solution.t, 1e3 * (energy / energy[0] - 1), lw=1, label=name)
ax.set(xlabel="time", ylabel="relative error of the energy / 10⁻³")
fig.legend(ncols=2, loc="outside upper left")
plt.show()
