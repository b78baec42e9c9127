"""
A molecule that falls apart
===========================

A state behind a barrier leaks out by tunnelling, and what leaks never comes back. On a grid it
would, as the end of the grid is its beginning; an absorber takes it away. What remains decays with
the rate of a resonance, and this one is known to many digits: the s-wave of the potential
7.5 r^2 exp(-r) has the energy 3.4264 and the width 0.025549.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# The radius becomes a whole line of odd states. The absorber rises beyond 15, as a power of the
# distance, over many wave lengths.


def well(t, r, params):
    """Return the potential, with its barrier at r = 2."""
    return 7.5 * r**2 * ca.exp(-ca.fabs(r))


def ramp(t, r, params):
    """Return what absorbs."""
    return 4 * (ca.fmax(ca.fabs(r) - 15, 0) / 15) ** 3


grid = lv.Grid(-30, 30, 512, potential=well)
molecule = lv.Schrodinger(grid, absorber=ramp)
r = grid.points[:, 0]
psi = r * np.exp(-1.9 * r**2)
psi /= np.linalg.norm(psi)
solution = lv.integrate(
    molecule,
    lv.SplitOperator("RKN6s11"),
    t=(0.0, 80.0),
    h=0.04,
    every=25,
    psi=psi,
    observe={"inside": (np.abs(r) < 5).astype(float)},
)
solution

# %%
# How much is left inside the barrier. At first the parts of higher energy leave; then the
# logarithm falls on a line, whose slope is the width.

inside = solution.observed["inside"]
late = solution.t > 30
width = -np.polyfit(solution.t[late], np.log(inside[late]), 1)[0]
print(f"width {width:.6f}, published 0.025549")
print(f"absorbed: {solution.stats['absorbed']:.4f}")

fig, ax = plt.subplots()
ax.semilogy(solution.t, inside, label="inside")
ax.semilogy(solution.t, solution.observed["norm"] ** 2, label="on the grid")
ax.set(xlabel="time", ylabel="probability")
ax.legend()
plt.show()

# %%
# The density: a well that empties, and waves that leave to both sides and do not come back.

fig, ax = plt.subplots()
plot.density(solution, ax=ax)
ax.set(xlabel="r", ylabel="time")
plt.show()
