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

plt.style.use(plot.STYLE)

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

# %%
# The plan says which method ``"auto"`` takes, and why.

lv.plan(system, t=times)

# %%
# On the clean chain the particle moves away at both sides.

fig, ax = plt.subplots()
plot.density(runs[0.0], ax=ax)
plt.show()

# %%
# With energies spread over an interval of width 2 it stays.

fig, ax = plt.subplots()
plot.density(runs[2.0], ax=ax)
plt.show()

# %%
# The mean distance from the start; on a clean chain it is the time times the root of two.

fig, ax = plt.subplots()
for width, solution in runs.items():
    ax.plot(times, np.sqrt(solution.observed["square"]), label=f"W = {width:g}")
ax.set(xlabel="time", ylabel="root mean square distance / sites", ylim=(0, 40))
fig.legend(ncols=4, loc="outside upper left")
plt.show()
