"""
A quench of an Ising chain
==========================

Fourteen spins point up, which is a ground state without a transverse field. Then the field is on.
The magnetisation decays, and pairs of quasiparticles carry correlations along the chain, no faster
than twice their largest group velocity: the light cone of Lieb and Robinson.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# Terms have letters, a coefficient and sites; without sites they are on all neighbours.

LENGTH, FIELD = 14, 0.5
chain = lv.SpinSystem(LENGTH, [("zz", -1.0), ("x", -FIELD)], pauli=True)
system = lv.Schrodinger(chain)
system

# %%
# The start is a product of states of single spins. Observed are the magnetisation of each spin and
# the correlations of one in the middle with the others; states are not kept.

MIDDLE = LENGTH // 2
up = chain.product_state([1.0, 0.0])
times = np.linspace(0.0, 6.0, 121)
observe = {f"z{i}": chain.operator("z", 1.0, [i]) for i in range(LENGTH)}
observe |= {
    f"zz{i}": chain.operator("zz", 1.0, (MIDDLE, i)) for i in range(LENGTH) if i != MIDDLE
}
solution = lv.integrate(
    system, lv.Chebyshev(tol=1e-6), t=times, psi=up, states=False, observe=observe
)
solution

# %%
# The magnetisation in the middle, until the ends of the chain are felt.

fig, ax = plt.subplots()
ax.plot(times, solution.observed[f"z{MIDDLE}"])
ax.set(xlabel="time", ylabel=r"$\langle \sigma^z \rangle$")
plt.show()

# %%
# Connected correlations spread along the lines of twice the group velocity, :math:`2 \cdot 2 h`
# for a field below the exchange.

z = np.stack([solution.observed[f"z{i}"] for i in range(LENGTH)], axis=1)
connected = np.full(z.shape, np.nan)
for i in range(LENGTH):
    if i != MIDDLE:
        connected[:, i] = solution.observed[f"zz{i}"] - z[:, i] * z[:, MIDDLE]

fig, ax = plt.subplots()
shown = ax.pcolormesh(
    np.arange(LENGTH), times, connected, cmap="magma", shading="nearest"
)
for side in (-1, 1):
    ax.plot(MIDDLE + side * 4 * FIELD * times, times, color="white", linestyle=":")
ax.set(xlabel="spin", ylabel="time", xlim=(-0.5, LENGTH - 0.5))
ax.grid(visible=False)
fig.colorbar(shown, label="connected correlation")
plt.show()
