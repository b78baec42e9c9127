r"""
Energies from a wave packet
===========================

A packet released in a well returns in part, again and again. Its autocorrelation
:math:`C(t) = \langle \psi(0) | \psi(t) \rangle` is a sum of waves, one for each energy. So its
Fourier transform has a peak at every energy, as high as the weight of that state in the packet. In
Pöschl and Teller's well the energies are known: marks below the peaks. Only the autocorrelation is
kept, and no state.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import poschl_teller as problem

plt.style.use(plot.STYLE)

x = problem.grid.points[:, 0]
psi = np.exp(-((x - 0.5) ** 2) / 0.15)
psi /= np.linalg.norm(psi)
times = np.linspace(0.0, 10.0, 3001)
solution = lv.integrate(
    problem.system, lv.SchrodingerSplitting(tol=1e-6), t=times, psi=psi, states=False
)
solution

# %%
# The first returns of the packet.

fig, ax = plt.subplots()
plot.autocorrelation(solution, ax=ax)
ax.set_xlim(0.0, 3.0)
plt.show()

# %%
# The spectrum. The width of a peak is inverse to the length of the run: here :math:`2 \pi / 10`.

fig, ax = plt.subplots()
energies = [problem.energy(n) for n in range(problem.LAMBDA)]
plot.spectrum(solution, energies=energies, ax=ax)
ax.set_xlim(-136.0, 4.0)
plt.show()
