"""
Tunnelling that a drive destroys
================================

A particle tunnels between two wells, which a drive raises and lowers in turn. The states of a
period have quasi-energies, and where two of these cross, tunnelling ends. Grossmann, Dittrich,
Jung and Hänggi (1991) found this *coherent destruction of tunnelling*.
"""

# %%
# Two levels with the splitting :math:`\Delta`, and a drive of strength a and frequency 1.

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from scipy.special import j0, jn_zeros

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

X, Z = np.array([[0, 1], [1, 0]]), np.diag([1, -1])


def wells(splitting):
    drive = [(lambda t, params: params.a / 2 * ca.cos(t), Z)]
    return lv.Schrodinger(-splitting / 2 * X, drive=drive, params={"a": 1.0})


wells(0.3)

# %%
# Shirley (1965) wrote a period as a matrix without time: copies of the levels, n frequencies apart,
# which the drive couples to their neighbours. Cut off where it no longer matters, it is exact.


def shirley(splitting, a, copies=30):
    n = np.arange(-copies, copies + 1)
    one, next_to = np.eye(len(n)), np.eye(len(n), k=1) + np.eye(len(n), k=-1)
    levels = np.kron(np.diag(n), np.eye(2)) - splitting / 2 * np.kron(one, X)
    found = np.linalg.eigvalsh(levels + a / 4 * np.kron(next_to, Z))
    return found[np.abs(found) < 0.5]


strengths = np.linspace(0, 9, 91)
energies, exact = {}, {}
for splitting in (0.3, 0.9):
    system = wells(splitting)
    energies[splitting] = np.array(
        [
            lv.analysis.floquet(system, 2 * np.pi, params={"a": a}).quasienergies
            for a in strengths
        ]
    )
    exact[splitting] = np.array([shirley(splitting, a) for a in strengths])
    error = np.abs(energies[splitting] - exact[splitting]).max()
    print(f"splitting {splitting}: within {error:.0e} of Shirley's matrix")

# %%
# Where the drive is fast against the splitting, they are :math:`\pm \frac{\Delta}{2} J_0(a)` with a
# Bessel function. Where it is not, they cross at weaker drives.

fig, ax = plt.subplots()
for colour, splitting in enumerate(energies):
    ax.plot(strengths, energies[splitting], f"C{colour}")
    ax.plot([], [], f"C{colour}", label=f"splitting {splitting}")
    bessel = splitting / 2 * np.outer(j0(strengths), [-1, 1])
    ax.plot(strengths, bessel, "k:", lw=0.9)
ax.plot([], [], "k:", label="Bessel function")
ax.set(xlabel="strength of the drive / its frequency", ylabel="quasi-energy / frequency")
fig.legend(ncols=3, loc="outside upper left")
plt.show()

# %%
# A particle starts in the first well. At the first zero of :math:`J_0`, 2.4048, it stays there.

system, periods = wells(0.1), np.arange(101)
zero = float(jn_zeros(0, 1)[0])
fig, ax = plt.subplots()
for a in (0.0, 1.5, zero):
    modes = lv.analysis.floquet(system, 2 * np.pi, params={"a": a})
    psi = modes.after([1, 0], periods)
    ax.plot(periods, np.abs(psi[:, 0]) ** 2, label=f"strength {a:.5g}")
ax.set(xlabel="periods of the drive", ylabel="probability of the first well")
fig.legend(ncols=3, loc="outside upper left")
plt.show()
