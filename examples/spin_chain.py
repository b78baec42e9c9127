"""
A wall between spins
====================

Sixteen spins one half, the left half up and the right half down, with exchange between neighbours.
If exchange along z is weak, the wall dissolves at the speed of the fastest magnon; if it is strong,
the wall stays. The number of spins that are up is conserved, so the sector of eight, with 12870
states, is enough. The magnetisation is observed; states are not kept.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

LENGTH = 16
chain = lv.SpinChain(LENGTH, z=1.0, up=LENGTH // 2)
lv.Schrodinger(chain)

# %%
# Bit i of a state's number is set where spin i is down. The wall is one of these states.

method = lv.SchrodingerSplitting(tol=1e-6)
times = np.linspace(0.0, 12.0, 121)
profiles = {}
for delta in (0.0, 1.0, 2.0):
    chain = lv.SpinChain(LENGTH, z=delta, up=LENGTH // 2)
    wall = np.zeros(chain.size)
    wall[chain.index(0xFF00)] = 1.0
    observe = {f"spin {i}": chain.sz(i) for i in range(LENGTH)}
    solution = lv.integrate(
        lv.Schrodinger(chain), method, t=times, psi=wall, states=False, observe=observe
    )
    profiles[delta] = np.stack([solution.observed[name] for name in observe], axis=1)
solution

# %%
# The magnetisation for three strengths of the exchange along z.

fig, axes = plt.subplots(1, 3, figsize=(6.4, 3.8), sharey=True)
for ax, (delta, profile) in zip(axes, profiles.items(), strict=True):
    shown = ax.pcolormesh(
        np.arange(LENGTH),
        times,
        profile,
        vmin=-0.5,
        vmax=0.5,
        cmap="RdBu_r",
        shading="nearest",
    )
    ax.set(title=rf"$\Delta = {delta:g}$", xlabel="spin")
    ax.grid(visible=False)
axes[0].set_ylabel("time")
fig.colorbar(shown, ax=axes, label=r"magnetisation $\langle S^z \rangle$")
plt.show()
