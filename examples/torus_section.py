"""
Field lines of a tokamak
========================

Magnetic field lines are trajectories of a field without divergence. Here they lie on nested tubes
around a circle, but for a disturbance of one per cent, which opens islands where lines close on
themselves. The field is known on a grid in cylindrical coordinates. Steps that lose volume let
the lines drift from tube to tube, which would be mistaken for transport.
"""

import matplotlib.pyplot as plt
import numpy as np

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# The vector potential on the grid: the poloidal flux, and a toroidal field that falls as 1 / R.

r, z = np.linspace(0.6, 1.4, 33), np.linspace(-0.4, 0.4, 33)
phi = np.linspace(0, 2 * np.pi, 16, endpoint=False)
R, PHI, Z = np.meshgrid(r, phi, z, indexing="ij")
s = (R - 1) ** 2 + Z**2
flux = s / 2 + 2 * s**2
flux += 0.01 * (((R - 1) ** 2 - Z**2) * np.cos(PHI) + 2 * (R - 1) * Z * np.sin(PHI))
field = lv.GriddedField(
    r,
    phi,
    z,
    potential=(0 * R, flux / R, -2.2 * np.log(R)),
    periodic=("phi",),
    coordinates="cylindrical",
    degree=5,
)
field

# %%
# Passages of fifteen lines through the plane at the angle 0, turn after turn.

across = [[radius, 0.1, 0.0] for radius in np.linspace(1.02, 1.3, 12)]
above = [[1.0, 0.1, height] for height in (0.09, 0.11, 0.13)]
start = field.states_of([*across, *above])
section = lv.section(
    field,
    lv.VolumeSplitting(composition="BM4"),
    t=(0, 2000),
    h=0.2,
    plane="phi",
    period=2 * np.pi,
    x=start,
)
section

# %%
# Curves are tubes that are cut; the islands are where lines close.

points = field.points_of(section.x)
fig, ax = plt.subplots(figsize=(5.0, 5.0))
for member in range(len(start)):
    own = points[section.member == member]
    ax.plot(own[:, 0], own[:, 2], ".", markersize=1.5)
ax.set(xlabel="R", ylabel="Z", aspect="equal")
plt.show()
