"""
Banana and passing orbits
=========================

In a tokamak the field lines wind around nested tori, and the field is strongest near the axis of
the machine. A charged particle follows a line, turning about it: where it is fast enough it goes
all the way round, and where it is slow the stronger field turns it back, so that its orbit in
(R, Z) looks like a banana. Ten steps of a fourth-order splitting a gyration show both for as long
as one likes.
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# The flux is that of circles about R = 1, and R B_phi = 1. The field is the curl of this potential,
# and the momentum about the axis is constant, as nothing depends on the angle.


def potential(t, x, params):
    r = ca.sqrt(x[0] ** 2 + x[1] ** 2)
    flux = ((r - 1) ** 2 + x[2] ** 2) / 4
    return [-flux * x[1] / r**2, flux * x[0] / r**2, -ca.log(r)]


def momentum(t, x, params):
    r = ca.sqrt(x[0] ** 2 + x[1] ** 2)
    flux = ((r - 1) ** 2 + x[2] ** 2) / 4
    return x[0] * x[4] - x[1] * x[3] + flux


tokamak = lv.ChargedParticles(A=potential, invariants={"momentum": momentum})
tokamak

# %%
# Two particles start at the same place with gyroradii of 0.002: the first one mostly across the
# field, the second one mostly along it.

start = [[1.05, 0, 0, 0, 4.816e-4, -2.059e-3], [1.05, 0, 0, 0, 2.0e-3, -6e-4]]
run = lv.ensemble(tokamak, lv.VolumeSplitting(), t=(0, 6e4), h=0.6, every=5, x=start)
radius, height = np.hypot(run.x[..., 0], run.x[..., 1]), run.x[..., 2]

# %%
# Their energies are constant to roundoff, and the momentum about the axis to this part of it:

for member, name in enumerate(("banana", "passing")):
    own = run.invariants["momentum"][:, member]
    print(name, f"{np.abs(own / own[0] - 1).max():.1e}")

# %%
# The orbits in the plane of R and Z, with the gyration.

fig, ax = plt.subplots(figsize=(5.0, 4.5))
for member, name in enumerate(("banana", "passing")):
    ax.plot(radius[:, member], height[:, member], ".", markersize=0.5, label=name)
ax.plot(1, 0, "k+")
ax.set(xlabel="R", ylabel="Z", aspect="equal")
ax.legend(loc="upper left", markerscale=12)
plt.show()
