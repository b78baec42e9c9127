"""
Drifters in an ocean with depth and dates
=========================================

Models of the ocean give velocities on longitudes, latitudes and depths, at dates. Here such a data
set is made of a jet that meanders and an overturning, as ``from_xarray`` would read it from a file.
Floats at several depths are followed for two months: the volume of the water
around each is kept, so that they neither gather nor leave holes.
"""

import matplotlib.dates as mdates
import matplotlib.pyplot as plt
import numpy as np
import xarray

import liouville as lv
from liouville import plot

plt.style.use(plot.STYLE)

# %%
# The data set, with the names, units and directions of ocean models; ``wo`` is upward. There is no
# flow through the coasts in the north and in the south, nor through the surface and the bottom.

lon, lat, depth = (
    np.arange(0, 360, 7.5),
    np.linspace(-60, 60, 25),
    np.linspace(0, 4000, 13),
)
time = np.arange("2021-01-01", "2021-03-12", 10, dtype="datetime64[D]")
DAY, LON, LAT, DEPTH = np.meshgrid(
    (time - time[0]).astype(float), np.radians(lon), np.radians(lat), depth, indexing="ij"
)
radius, height, end = 6.371e6, 4000.0, np.sin(np.radians(60))
s, angle, wave = np.sin(LAT) / end, np.pi * DEPTH / height, 2 * LON - 0.05 * DAY
shore, slope = (1 - s**2) ** 2, -4 * s * (1 - s**2) / end
along = 2e-8 * slope * (1 + 0.5 * np.cos(wave) * np.cos(angle))
around = 2e-8 * shore * np.sin(wave) * np.cos(angle)
deeper = 1e-5 * (1 - s**2) * (1 - 5 * s**2) / end * np.sin(angle)
sideways = -1e-5 * shore * s * np.pi / height * np.cos(angle)
dims, units = ("time", "lon", "lat", "depth"), {"units": "m s-1"}
ocean = xarray.Dataset(
    {
        "uo": (dims, along * radius * np.cos(LAT), units),
        "vo": (dims, (around + sideways) * radius / np.cos(LAT), units),
        "wo": (dims, -deeper, units | {"standard_name": "upward_sea_water_velocity"}),
    },
    {
        "time": time.astype("datetime64[ns]"),
        "lon": ("lon", lon, {"units": "degrees_east"}),
        "lat": ("lat", lat, {"units": "degrees_north"}),
        "depth": ("depth", depth, {"units": "m", "positive": "down"}),
    },
)
field = lv.GriddedField.from_xarray(ocean, walls=("lat", "depth"))
field

# %%
# Floats along a meridian, at three depths, from one date to another.

places = [[30.0, y, z] for z in (300.0, 1500.0, 3000.0) for y in (-40, -20, 0, 20, 40)]
run = lv.ensemble(
    field,
    lv.VolumeSplitting(),
    t=(np.datetime64("2021-01-01"), np.datetime64("2021-03-02")),
    h=np.timedelta64(12, "h"),
    x=field.states_of(places),
)
found = run.to_xarray()
print(
    f"{found.time.values[-1]:}, {float(field.divergence):.1e} of the velocity taken off"
)

# %%
# Their ways on the map, and how deep they are.

fig, (ax, below) = plt.subplots(2, 1, figsize=(6.0, 6.0))
for member in range(len(places)):
    colour = f"C{member // 5}"
    ax.plot(found.lon[:, member], found.lat[:, member], color=colour)
    below.plot(found.time, run.x[:, member, 2] - places[member][2], color=colour)
ax.set(xlabel="longitude in degrees", ylabel="latitude in degrees")
below.set(ylabel="deeper by, in metres")
below.xaxis.set_major_formatter(mdates.DateFormatter("%d %b"))
plt.show()
