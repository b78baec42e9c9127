"""Variables by their names and attributes: components, axes, levels, times."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.fields.dates import Dates
from liouville._systems.fields.gridded import units
from liouville._systems.fields.gridded.axis import Array
from liouville._systems.fields.gridded.reading import Variable, Variables

#: Names of NEMO's vertical velocity, which is upward.
UPWARD_W = ("vovecrtz", "wovecrtz")

#: Names of the components, and what CF's standard names of them contain.
COMPONENTS = {
    "u": (
        ("u", "uo", "U", "UVEL", "uVel", "vozocrtx", "water_u", "u10"),
        r"eastward_.*(velocity|wind)|x_(velocity|wind)",
    ),
    "v": (
        ("v", "vo", "V", "VVEL", "vVel", "vomecrty", "water_v", "v10"),
        r"northward_.*(velocity|wind)|y_(velocity|wind)",
    ),
    "w": (
        ("w", "wo", "W", "WVEL", "wVel", *UPWARD_W),
        r"(up|down)ward_.*(velocity|air)|z_velocity",
    ),
}

#: Names of levels that count downwards where the attribute ``positive`` says nothing.
DOWNWARD = ("depth", "deptht", "depthu", "depthv", "depthw", "gdept_1d", "gdept_0", "gdepw_1d")

#: Names, standard names and units by which an axis is known.
AXES = {
    "X": (("x", "lon", "longitude", "nav_lon"), ("longitude", "projection_x_coordinate")),
    "Y": (("y", "lat", "latitude", "nav_lat"), ("latitude", "projection_y_coordinate")),
    "Z": (
        ("z", "height", "lev", "level", "altitude", *DOWNWARD),
        ("depth", "height", "altitude"),
    ),
    "T": (("t", "time", "time_counter"), ("time",)),
}

#: Longitudes and latitudes by their names.
ANGLES = ("lon", "longitude", "nav_lon", "lat", "latitude", "nav_lat")

#: Names of levels that count upwards where the attribute ``positive`` says nothing.
UPWARD = ("z", "height", "altitude")

#: Units of angles that are no degrees.
RADIANS = ("rad", "radian", "radians")


def components(variables: Variables, given: Mapping[str, str | None]) -> dict[str, Variable]:
    """Return the components of a velocity that a data set has, u and v at least."""
    found = {key: component(variables, key, name) for key, name in given.items()}
    for key in ("u", "v"):
        if found[key] is None:
            known = ", ".join(variables)
            sentence = f"the data set has no component {key} of a velocity; it has {known}"
            raise ValueError(hinted(sentence, f"name it: {key}='...'"))
    return {key: x for key, x in found.items() if x is not None}


def component(variables: Variables, key: str, name: str | None) -> Variable | None:
    """Return the component of this name, or the one that names and attributes say."""
    if name is not None:
        if name not in variables:
            known = ", ".join(variables)
            raise ValueError(f"the data set has no variable {name!r}; it has {known}")
        return variables[name]
    names, pattern = COMPONENTS[key]
    standard = [
        x for x in variables.values() if re.search(pattern, str(x.attrs.get("standard_name", "")))
    ]
    if len(standard) > 1:
        found = ", ".join(x.name for x in standard)
        raise ValueError(hinted(f"{key} may be one of {found}", f"name it: {key}='...'"))
    named = [variables[each] for each in names if each in variables]
    return next(iter(standard or named), None)


def letter(axis: Variable) -> str | None:
    """Return X, Y, Z or T, by CF's attributes or else by the name."""
    said = str(axis.attrs.get("axis", "")).upper()
    if said in AXES:
        return said
    standard = str(axis.attrs.get("standard_name", ""))
    for letter, (names, standards) in AXES.items():
        if standard in standards or axis.name.lower() in names:
            return letter
    if " since " in axis.units or np.asarray(axis.values).dtype.kind in "mM":
        return "T"
    return None


def is_angle(axis: Variable) -> bool:
    """Return whether an axis has angles."""
    unit = axis.units.lower()
    return unit.startswith("degree") or unit in RADIANS or is_named(axis, ANGLES)


def is_named(x: Variable, known: Sequence[str]) -> bool:
    """Return whether a name, or a standard name, is among those known."""
    return x.name.lower() in known or str(x.attrs.get("standard_name", "")) in known


def degrees(axis: Variable) -> Array:
    """Return angles in degrees."""
    values = np.asarray(axis.values)
    return np.degrees(values) if axis.units.lower() in RADIANS else values


def said_of(axis: Variable) -> dict[str, str]:
    """Return the attributes of CF for levels: unit, standard name, and direction."""
    known = ("units", "standard_name", "positive")
    said = {"units": "m"} | {key: str(axis.attrs[key]) for key in known if axis.attrs.get(key)}
    is_down = axis_is_down(axis)
    if is_down is not None:
        way = "down" if is_down else "up"
        is_wrong = said.get("positive", way) != way
        usual = {"positive": way, "standard_name": "depth" if is_down else "height"}
        said = said | usual if is_wrong else usual | said
    return said


def unit_of_heights(axis: Variable, first: Variable) -> float:
    """Return the unit of heights or depths in metres.

    Raises
    ------
    ValueError
        They are no lengths: pressures, densities, or the numbers of levels.
    """
    own = units.length(axis.units)
    if own is None and axis.units.lower() in units.NONE and is_named(axis, (*DOWNWARD, *UPWARD)):
        own = 1.0
    if own is None:
        what = f"in {axis.units!r}" if axis.units else "without a unit"
        sentence = f"'{first.name}' has levels along '{axis.name}' {what}, which are no lengths"
        hint = f"choose one: dataset.isel({axis.name}=0), or interpolate to depths in metres"
        raise ValueError(hinted(sentence, hint))
    return own


def is_against(axis: Variable, w: Variable, values: Array) -> bool:
    """Return whether the component w is against its axis, upward on one of depths or so.

    Raises
    ------
    ValueError
        One of them has a direction, and the other says none.
    """
    levels, velocity = axis_is_down(axis), is_down(w)
    if levels == velocity or not np.any(values):
        return False
    if levels is None:
        way = "downward" if velocity else "upward"
        sentence = f"'{w.name}' is {way}, and '{axis.name}' does not say which way it counts"
        hint = f"say so: dataset['{axis.name}'].attrs['positive'] = 'down', or 'up'"
        raise ValueError(hinted(sentence, hint))
    if velocity is None and levels:
        sentence = f"'{axis.name}' counts downwards, and '{w.name}' does not say which way it is"
        hint = f"say so: dataset['{w.name}'].attrs['standard_name'] = 'upward_sea_water_velocity'"
        raise ValueError(hinted(sentence, hint))
    return velocity is not None


def axis_is_down(axis: Variable) -> bool | None:
    """Return whether an axis of levels counts downwards, None where nothing says it."""
    said = str(axis.attrs.get("positive", "")).lower()
    if said in ("up", "down"):
        # heights below a surface, as MITgcm has them, are called depths
        return said == "down" and not (is_named(axis, DOWNWARD) and _is_below(axis))
    if is_named(axis, DOWNWARD):
        return not np.any(np.asarray(axis.values) < 0)
    return False if is_named(axis, UPWARD) else None


def _is_below(axis: Variable) -> bool:
    """Return whether levels are below zero, or at it."""
    values = np.asarray(axis.values)
    return bool((values < 0).any() and (values <= 0).all())


def is_down(w: Variable) -> bool | None:
    """Return whether a vertical velocity is downward by its names, None where they do not say."""
    for words in (str(w.attrs.get(key, "")).lower() for key in ("standard_name", "long_name")):
        if ("upward" in words) != ("downward" in words):
            return "downward" in words
    return False if w.name in UPWARD_W else None


def is_bare(axis: Variable) -> bool:
    """Return whether an axis has numbers without a unit, and no name that says what they are."""
    is_named = is_angle(axis) or "projection" in str(axis.attrs.get("standard_name", ""))
    return axis.units.lower() in units.NONE and not is_named


def renamed(key: str, value: Any, names: Mapping[str, str], options: Mapping[str, Any]) -> Any:
    """Return names of axes as the field has them, where they may be those of the data set."""
    if key not in ("walls", "periodic") or "names" in options:
        return value
    if isinstance(value, Mapping):
        return {names.get(name, name): period for name, period in value.items()}
    given = (value,) if isinstance(value, str) else value
    return tuple(names.get(name, name) for name in given)


def times(axis: Variable, velocity: Variable) -> Array:
    """Return the times in the velocity's unit of time, dates from the first one on."""
    values = np.asarray(axis.values)
    found = units.seconds(axis.name, axis.units, values)
    if found is None:
        return np.asarray(values, dtype=float)
    return found / units.needed(velocity.name, velocity.units)[1]


def dates(axis: Variable, velocity: Variable) -> Dates | None:
    """Return the date of the first time, None where times are no dates."""
    known = units.velocity(velocity.units)
    calendar = str(axis.attrs.get("calendar", "")).lower()
    return units.dates(np.asarray(axis.values), axis.units, calendar, known[1] if known else 1.0)
