"""
Anderson localisation
=====================

A particle hops along a chain of 401 sites, from the middle one. On a clean chain it moves away at
twice the hopping rate. If the energies of the sites are random, the scattered waves interfere, and
the particle stays near its start at all times. The method is chosen for the tolerance, and its
error bound holds for every kept state.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import tight_binding

SITES, END = 401, 95.0
times = np.linspace(0.0, END, 191)
place = np.arange(SITES) - SITES // 2
psi = np.zeros(SITES)
psi[SITES // 2] = 1.0
observe = {"square": place.astype(float) ** 2}

runs = {}
for width in (0.0, 1.0, 2.0, 4.0):
    system = tight_binding.build(SITES, width=width)
    runs[width] = lv.integrate(system, "auto", t=times, psi=psi, observe=observe)
print(lv.plan(system, t=times))

# %%
# The clean chain on the left, one with energies spread over an interval of width 2 on the right.

fig, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained", sharey=True)
for ax, width in zip(axes, (0.0, 2.0), strict=True):
    plot.density(runs[width], ax=ax)
    ax.set_title(f"W = {width:g}", loc="left")
plt.show()

# %%
# The mean distance from the start; on a clean chain it is the time times the root of two.

fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for width, solution in runs.items():
    ax.plot(times, np.sqrt(solution.observed["square"]), lw=1.3, label=f"W = {width:g}")
ax.set(xlabel="t", ylabel="root mean square distance", ylim=(0, 40))
ax.legend()
plt.show()
