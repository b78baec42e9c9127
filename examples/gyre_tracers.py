"""
Tracers in a sea from a NetCDF file
===================================

The double gyre: two basins of water that turn against each other, with a front between them that
swings to and fro. Its velocities are sampled on a grid and written to a file, as from a model of an
ocean. The field read from it has no divergence at any point, so tracers neither gather nor thin
out, and none crosses a wall.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np
from scipy.io import netcdf_file

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# The file: ten kilometres by five, 65 by 33 nodes, and a sample every quarter of an hour.

day, length = 86400.0, 5000.0
t, x, y = np.linspace(0, 2 * day, 193), np.linspace(0, 2, 65), np.linspace(0, 1, 33)
T, Y, X = np.meshgrid(t, y, x, indexing="ij")
a = 0.25 * np.sin(2 * np.pi * T / (day / 2))
f, slope = a * X**2 + (1 - 2 * a) * X, 2 * a * X + 1 - 2 * a
u = -0.7 * np.sin(np.pi * f) * np.cos(np.pi * Y)
v = 0.7 * np.cos(np.pi * f) * slope * np.sin(np.pi * Y)

path = Path(mkdtemp()) / "gyre.nc"
with netcdf_file(path, "w") as file:
    for name, values, units in (
        ("time", t, "s"),
        ("y", length * y, "m"),
        ("x", length * x, "m"),
    ):
        file.createDimension(name, len(values))
        variable = file.createVariable(name, "d", (name,))
        variable[:], variable.units = values, units
    for name, values in (("u", u), ("v", v)):
        variable = file.createVariable(name, "d", ("time", "y", "x"))
        variable[:], variable.units = values, "m s-1"

# %%
# The field read from it, and the part of the velocities that sampling had given a divergence.

sea = lv.GriddedField.from_netcdf(path, walls=("x", "y"))
print(f"{sea.divergence:.1e} of the velocity was taken off")
sea

# %%
# Two thousand tracers from a small square, for two days by steps of five minutes.

rng = np.random.default_rng(0)
square = rng.uniform([0.9, 0.45], [1.0, 0.55], (2000, 2)) * length
tracers = lv.ensemble(
    sea, lv.VolumeSplitting(composition="BM4"), t=(0, 2 * day), h=300, every=144, x=square
)
tracers

# %%
# They are drawn to threads, which fill the basins, and all of them stay in the water.

print(f"{tracers.x.min(axis=(0, 1))} m to {tracers.x.max(axis=(0, 1))} m")

fig, ax = plt.subplots(figsize=(6.4, 3.4))
for row in (0, 1, 4):
    label = f"{tracers.t[row] / 3600:.0f} h"
    ax.plot(*tracers.x[row].T / 1000, ".", markersize=1.5, label=label)
ax.set(xlabel="x / km", ylabel="y / km", xlim=(0, 10), ylim=(0, 5), aspect="equal")
ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.15), ncols=3, markerscale=6)
plt.show()

# %%
# The determinant of the derivative of its steps, for one of them: it is 1 to roundoff.

one = lv.analysis.determinant(
    sea, lv.VolumeSplitting(composition="BM4"), t=(0, day), h=300, x=square[0]
)
print(f"{one.observed['defect'][-1]:.1e}")
