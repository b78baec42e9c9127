"""
A polymer on rigid bonds
========================

A thousand beads on rigid bonds, folded at random, with stiff angles between bonds. Mass is constant
and forces depend on positions alone, so ``LobattoPair()`` is RATTLE: forces are evaluated once a
step, and the tensions of the bonds come from a sparse matrix. All bonds keep their length.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot
from liouville.problems import polymer as problem

plt.style.use(plot.STYLE)

BEADS, STEPS = 1000, 2000

system = problem.build(BEADS)
start = problem.start_for(BEADS)
solution = lv.integrate(
    system, lv.LobattoPair(), t=(0.0, STEPS * 0.02), steps=STEPS, every=20, **start
)
microseconds = 1e6 * solution.stats["seconds"] / STEPS
print(f"{solution.stats['solver']}: {microseconds:.0f} microseconds a step")

solution

# %%
# The polymer at the start and at the end, in lengths of a bond.

fig, ax = plt.subplots(figsize=(5.4, 4.6), subplot_kw={"projection": "3d"})
for q, color, label in ((solution.q[0], "0.7", "start"), (solution.q[-1], "C0", "end")):
    ax.plot(*q.reshape(-1, 3).T, color=color, lw=0.8, label=label)
ax.set(xlabel="x", ylabel="y", zlabel="z")
ax.set_box_aspect(None, zoom=0.9)
ax.locator_params(nbins=5)
fig.legend(ncols=2, loc="outside upper left")
plt.show()

# %%
# The error of the energy, of order 2 in the step, and how long the bonds are.

energy = solution.invariants["energy"]
lengths = np.linalg.norm(np.diff(solution.q.reshape(-1, BEADS, 3), axis=1), axis=2)
print(f"bonds are within {np.abs(lengths - 1).max():.0e} of their length")

fig, ax = plt.subplots()
ax.plot(solution.t, 1e4 * (energy / energy[0] - 1))
ax.set(xlabel="time", ylabel="relative error of the energy / 10⁻⁴")
plt.show()
