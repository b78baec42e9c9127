"""
A qubit and a pulse as an array
===============================

A superconducting qubit has a third level near the other two. A short pulse that flips the qubit
leaks into it, unless a second quadrature, the derivative of the first, is added: this is DRAG of
Motzoi, Gambetta, Rebentrost and Wilhelm (2009). The pulses are arrays, as a generator plays them.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# Operators of three levels, in a frame that turns with the drive. With QuTiP these would be
# ``qutip.destroy(3)``, ``qutip.num(3)`` and so on, and every line below would be the same:
# a ``Qobj`` is taken wherever an array is.

ANHARMONICITY = -2 * np.pi * 0.25  # rad / ns
a = np.diag(np.sqrt([1.0, 2.0]), 1)
n = a.T @ a
H0 = ANHARMONICITY / 2 * (n @ n - n)
Hx, Hy = (a + a.T) / 2, 1j * (a.T - a) / 2
np.linalg.eigvalsh(H0)

# %%
# A pulse of 12 ns in 97 samples, whose area is half a turn.

times = np.linspace(0.0, 12.0, 97)
gauss = np.exp(-((times - 6.0) ** 2) / (2 * 2.2**2))
gauss -= gauss[0]
x = np.pi * gauss / np.trapezoid(gauss, times)
y = -np.gradient(x, times) / ANHARMONICITY

fig, ax = plt.subplots()
ax.plot(times, x, label="first quadrature")
ax.plot(times, y, label="second quadrature")
ax.set(xlabel="time / ns", ylabel="amplitude / (rad/ns)")
ax.legend()
plt.show()

# %%
# The Hamiltonian is a list, as QuTiP has it. Between samples the pulse is their cubic spline, and
# ``"auto"`` keeps to a tolerance. The levels are observed.

plain = lv.Schrodinger([H0, [Hx, x]], times=times)
drag = lv.Schrodinger([H0, [Hx, x], [Hy, y]], times=times)
levels = {f"level {k}": np.eye(3)[k] for k in range(3)}
start = np.array([1.0, 0.0, 0.0])
runs = [
    lv.integrate(system, "auto", t=np.linspace(0, 12, 121), psi=start, observe=levels)
    for system in (plain, drag)
]
runs[1]

# %%
# The third level while the pulse is on, and what is left there: 2e-4, and 7e-7 with both.

fig, ax = plt.subplots()
for run, label in zip(runs, ("one quadrature", "two quadratures"), strict=True):
    ax.semilogy(run.t, np.maximum(run.observed["level 2"], 1e-9), label=label)
ax.set(xlabel="time / ns", ylabel="probability of the third level", ylim=(1e-7, 1))
ax.legend()
plt.show()
