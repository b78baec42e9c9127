"""Longitudes and latitudes of data sets: their turn, and where they end."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.fields.gridded.axis import Array
from liouville._systems.fields.gridded.coordinates import POLE, TURNS

#: The earth's mean radius, in metres.
EARTH = 6.371e6

#: Longitudes go round where their ends meet to this part of their distances.
MEETS = 1e-3

#: Values at the first and the last longitude, which are one, agree to this part of the largest.
SAME = 1e-6

#: Grids with nodes at the poles are cut at this latitude.
LAST = 89.0

#: The whole turn.
ROUND = TURNS["spherical"].length


def closed(made: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a field whose longitudes are in order and close, if they go round.

    Longitudes that fall by a turn on their way go on beyond it, and of two that are one the last
    is left out, with its data. Latitudes end before the poles.
    """
    made = dict(made)
    lon, lat, *levels = made["xyz"]
    lon, keep = in_order(lon), [slice(None)] * len(made["xyz"])
    step, whole = _steps(lon)
    has_walls = "lon" in names(made.get("walls", ()))
    if abs(whole - ROUND) < MEETS * step and not has_walls:
        _check_one(made["velocity"], lon, -len(keep))
        keep[0], whole = slice(-1), whole - step
    if abs(whole + step - ROUND) < MEETS * step and not has_walls:
        made.setdefault("periodic", ("lon",))
    keep[1] = inner(lat, 6)
    made["xyz"] = [lon[keep[0]], lat[keep[1]], *levels]
    made["velocity"] = [x[(..., *keep)] for x in made["velocity"]]
    if made.get("mask") is not None and np.shape(made["mask"])[:2] == (lon.size, lat.size):
        made["mask"] = np.asarray(made["mask"])[tuple(keep)]
    return made


def inner(lat: Array, depth: int) -> slice:
    """Return the latitudes before the poles, all of them but for data that reach a pole.

    A warning is about a call so many frames above.
    """
    if float(np.abs(lat).max()) <= 90 * (1 - POLE):  # single precision does not tell them apart
        return slice(None)
    kept = np.flatnonzero(np.abs(lat) <= LAST)
    part = slice(int(kept[0]), int(kept[-1]) + 1) if kept.size else slice(0)
    ends = np.sort(lat[part])[[0, -1]] if kept.size else lat[:2]
    warnings.warn(
        f"latitudes were cut at {ends[0]:g} and {ends[1]:g}: coordinates are singular at the poles",
        stacklevel=depth,
    )
    return part


def in_order(longitudes: Array) -> Array:
    """Return longitudes that go on by a turn where they fall by one, or the same ones."""
    rises = np.sign(np.diff(longitudes))
    if abs(rises.sum()) == rises.size:
        return longitudes
    found: Array = np.unwrap(
        longitudes.astype(np.result_type(longitudes, np.float32)), period=ROUND
    )
    return found


def _steps(longitudes: Array) -> tuple[float, float]:
    """Return the mean distance of longitudes, and that of the last from the first."""
    whole = abs(float(longitudes[-1]) - float(longitudes[0]))
    return whole / (longitudes.size - 1), whole


def _check_one(arrays: list[Array], longitudes: Array, axis: int) -> None:
    """Refuse other values at the last longitude, which is the first one."""
    for values in arrays:
        first, last = (np.nan_to_num(np.take(values, end, axis)) for end in (0, -1))
        if np.abs(first - last).max() > SAME * np.abs(np.nan_to_num(values)).max():
            sentence = (
                f"longitudes {longitudes[0]:g} and {longitudes[-1]:g} are one, and the velocities "
                "there are not"
            )
            raise ValueError(hinted(sentence, "leave one of them out"))


def names(given: Any) -> tuple[str, ...]:
    """Return names, of which one may be given by itself."""
    return (given,) if isinstance(given, str) else tuple(given)
