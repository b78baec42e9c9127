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
from liouville.problems import polymer as problem

BEADS, STEPS = 1000, 2000

system = problem.build(BEADS)
start = problem.start_for(BEADS)
solution = lv.integrate(
    system, lv.LobattoPair(), t=(0.0, STEPS * 0.02), steps=STEPS, every=20, **start
)
microseconds = 1e6 * solution.stats["seconds"] / STEPS
print(f"{solution.stats['solver']}: {microseconds:.0f} microseconds a step")

fig = plt.figure(figsize=(10, 4), layout="constrained")
left, right = fig.add_subplot(121, projection="3d"), fig.add_subplot(122)
for q, style, label in ((solution.q[0], "0.7", "start"), (solution.q[-1], "C0", "end")):
    left.plot(*q.reshape(-1, 3).T, color=style, lw=0.8, label=label)
left.legend()
energy = solution.invariants["energy"]
right.plot(solution.t, energy / energy[0] - 1, label="energy, relative error")
lengths = np.linalg.norm(np.diff(solution.q.reshape(-1, BEADS, 3), axis=1), axis=2)
right.set(xlabel="time", title=f"bonds are within {np.abs(lengths - 1).max():.0e} of their length")
right.legend()
plt.show()
