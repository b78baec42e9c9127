"""Components, axes and units of the variables of a data set, by the conventions of CF."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.fields.dates import Dates
from liouville._systems.fields.gridded import sphere, units
from liouville._systems.fields.gridded.axis import Array
from liouville._systems.fields.gridded.reading import Variable, Variables

#: Names of the components, and what CF's standard names of them contain.
COMPONENTS = {
    "u": (("u", "uo", "U", "vozocrtx"), r"eastward_.*(velocity|wind)|x_(velocity|wind)"),
    "v": (("v", "vo", "V", "vomecrty"), r"northward_.*(velocity|wind)|y_(velocity|wind)"),
    "w": (("w", "wo", "W"), r"(up|down)ward_.*(velocity|air)|z_velocity"),
}

#: Names of levels that count downwards where the attribute ``positive`` says nothing.
DOWNWARD = ("depth", "deptht", "depthu", "depthv", "depthw")

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

#: What helps on curvilinear grids.
RECTANGULAR = "curvilinear grids are not taken: interpolate to a rectangular one"

#: Units of angles that are no degrees.
RADIANS = ("rad", "radian", "radians")


def arguments(
    variables: Variables, given: Mapping[str, str | None], options: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a gridded field for a data set."""
    found = {key: _component(variables, key, name) for key, name in given.items()}
    components = {key: x for key, x in found.items() if x is not None}
    for key in ("u", "v"):
        if key not in components:
            known = ", ".join(variables)
            sentence = f"the data set has no component {key} of a velocity; it has {known}"
            raise ValueError(hinted(sentence, f"name it: {key}='...'"))
    first = components["u"]
    _check_places(variables, first, components["v"])
    axes = _axes(variables, first)
    if "Z" not in axes:
        components.pop("w", None)
    order = [key for key in "TXYZ" if key in axes]
    arrays = [_ordered(x, axes, order) for x in components.values()]
    space = [axes[key] for key in order if key != "T"]
    is_sphere = _is_sphere(space, first, options)
    _check_units(components, space, is_sphere)
    if "Z" in axes and "w" not in components:
        _check_without_w(first, axes["Z"], is_sphere, options)
        arrays.append(np.zeros_like(arrays[0]))
    elif "Z" in axes and _is_against(axes["Z"], components["w"], arrays[-1]):
        arrays[-1] = -arrays[-1]
    made: dict[str, Any] = {
        "xyz": [np.asarray(axis.values) for axis in space],
        "velocity": arrays,
    }
    if "T" in axes:
        made["t"] = _times(axes["T"], first)
        made["dates"] = _dates(axes["T"], first)
    if is_sphere:
        metres = units.needed(first.name, first.units)[0]
        made |= {"coordinates": "spherical", "radius": sphere.EARTH / metres}
        made["xyz"] = [_degrees(axis) for axis in space[:2]]
        made["height"] = _unit_of_heights(space[2], first) / metres if space[2:] else 1.0
        made["xyz"] += [np.asarray(axis.values) * made["height"] for axis in space[2:]]
        made["level"] = _said_of(space[2]) if space[2:] else {}
        made["names"] = ("lon", "lat", *(axis.name for axis in space[2:]))
    else:
        made["names"] = tuple(axis.name for axis in space)
    names = dict(zip((axis.name for axis in space), made["names"], strict=True))
    made |= {key: _renamed(key, x, names, options) for key, x in options.items()}
    return sphere.closed(made) if is_sphere else made


def _renamed(key: str, value: Any, names: Mapping[str, str], options: Mapping[str, Any]) -> Any:
    """Return names of axes as the field has them, where they may be those of the data set."""
    if key not in ("walls", "periodic") or "names" in options:
        return value
    if isinstance(value, Mapping):
        return {names.get(name, name): period for name, period in value.items()}
    given = (value,) if isinstance(value, str) else value
    return tuple(names.get(name, name) for name in given)


def _component(variables: Variables, key: str, name: str | None) -> Variable | None:
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


def _axes(variables: Variables, component: Variable) -> dict[str, Variable]:
    """Return the axes of a component by their letters."""
    found: dict[str, Variable] = {}
    unknown: list[Variable] = []
    for dim in component.dims:
        own = variables.get(dim)
        size = component.values.shape[component.dims.index(dim)]
        if not size:
            sentence = f"'{dim}' of '{component.name}' is empty: no node is left"
            hint = f"sel({dim}=slice(a, b)) takes a and b in the order of the axis"
            raise ValueError(hinted(sentence, hint))
        if own is None or np.ndim(own.values) != 1:
            if size == 1:
                continue
            sentence = f"dimension '{dim}' of '{component.name}' has no coordinate of its own"
            raise ValueError(hinted(sentence, RECTANGULAR))
        if size == 1:
            continue
        letter = _letter(own)
        if letter is None or letter in found:
            unknown.append(own)
        else:
            found[letter] = own
    missing = [letter for letter in "XY" if letter not in found]
    if unknown:
        sentence = f"'{unknown[0].name}' of '{component.name}' is no axis that is known"
        hint = f"choose one of it: dataset.isel({unknown[0].name}=0)"
        if missing:
            hint = f"say which it is: dataset['{unknown[0].name}'].attrs['axis'] = '{missing[0]}'"
        raise ValueError(hinted(sentence, hint))
    if missing:
        for dim in component.dims:
            if dim in variables and _letter(variables[dim]) == missing[0]:  # left out before
                sentence = f"'{component.name}' has one node along '{dim}', and a field is no line"
                raise ValueError(hinted(sentence, "choose several nodes along two axes at least"))
        dims = ", ".join(component.dims)
        sentence = f"'{component.name}' has no {missing[0]} axis among {dims}"
        raise ValueError(hinted(sentence, 'say so by an attribute: axis="X"'))
    return found


def _letter(axis: Variable) -> str | None:
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


def _is_angle(axis: Variable) -> bool:
    unit = axis.units.lower()
    return unit.startswith("degree") or unit in RADIANS or _is_named(axis, ANGLES)


def _is_named(x: Variable, known: Sequence[str]) -> bool:
    return x.name.lower() in known or str(x.attrs.get("standard_name", "")) in known


def _degrees(axis: Variable) -> Array:
    values = np.asarray(axis.values)
    return np.degrees(values) if axis.units.lower() in RADIANS else values


def _is_sphere(space: Sequence[Variable], first: Variable, options: Mapping[str, Any]) -> bool:
    """Return whether the axes are longitude and latitude; refuse angles that are none of a sphere.

    Other coordinates that were asked for are not looked at.
    """
    if options.get("coordinates", "spherical") != "spherical":
        return False
    angles = [axis.name for axis in space[:2] if _is_angle(axis)]
    if not angles:
        return False
    if len(angles) == 1:
        other = next(axis.name for axis in space[:2] if axis.name not in angles)
        sentence = f"'{angles[0]}' is an angle, and '{other}' is none"
        raise ValueError(hinted(sentence, f"say its unit: dataset['{other}'].attrs['units']"))
    return True


def _said_of(axis: Variable) -> dict[str, str]:
    """Return the attributes of CF for levels: unit, standard name, and direction."""
    known = ("units", "standard_name", "positive")
    said = {"units": "m"} | {key: str(axis.attrs[key]) for key in known if axis.attrs.get(key)}
    if (is_down := _axis_is_down(axis)) is not None:
        usual = ("down", "depth") if is_down else ("up", "height")
        said = dict(zip(("positive", "standard_name"), usual, strict=True)) | said
    return said


def _unit_of_heights(axis: Variable, first: Variable) -> float:
    """Return the unit of heights or depths in metres.

    Raises
    ------
    ValueError
        They are no lengths: pressures, densities, or the numbers of levels.
    """
    own = units.length(axis.units)
    if own is None and axis.units.lower() in units.NONE and _is_named(axis, (*DOWNWARD, *UPWARD)):
        own = 1.0
    if own is None:
        what = f"in {axis.units!r}" if axis.units else "without a unit"
        sentence = f"'{first.name}' has levels along '{axis.name}' {what}, which are no lengths"
        hint = f"choose one: dataset.isel({axis.name}=0), or interpolate to depths in metres"
        raise ValueError(hinted(sentence, hint))
    return own


def _check_without_w(
    first: Variable, level: Variable, is_sphere: bool, options: Mapping[str, Any]
) -> None:
    """Refuse levels without a vertical velocity, but between walls on a sphere.

    There the divergence of the others, which the field cannot have, is what it follows from.
    """
    walls = options.get("walls", ())
    if is_sphere and level.name in ((walls,) if isinstance(walls, str) else walls):
        return
    sentence = f"'{first.name}' has levels along '{level.name}', and there is no component w"
    hint = f"choose one: dataset.isel({level.name}=0)"
    if is_sphere:
        hint += f"; or give walls=('{level.name}', ...), between which w follows from u and v"
    raise ValueError(hinted(sentence, hint))


def _is_against(axis: Variable, w: Variable, values: Array) -> bool:
    """Return whether the component w is against its axis, upward on one of depths or so.

    Raises
    ------
    ValueError
        One of them has a direction, and the other says none.
    """
    levels, velocity = _axis_is_down(axis), _is_down(w)
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


def _axis_is_down(axis: Variable) -> bool | None:
    """Return whether an axis of levels counts downwards, None where nothing says it."""
    said = str(axis.attrs.get("positive", "")).lower()
    if said in ("up", "down"):
        return said == "down"
    if _is_named(axis, DOWNWARD):
        return not np.any(np.asarray(axis.values) < 0)
    return False if _is_named(axis, UPWARD) else None


def _is_down(w: Variable) -> bool | None:
    """Return whether a vertical velocity is downward by its names, None where they do not say."""
    for words in (str(w.attrs.get(key, "")).lower() for key in ("standard_name", "long_name")):
        if ("upward" in words) != ("downward" in words):
            return "downward" in words
    return None


def _check_places(variables: Variables, u: Variable, v: Variable) -> None:
    """Refuse the points of a C-grid, and curvilinear grids whose axes are mere numbers."""
    dims = [
        {dim for dim, size in zip(x.dims, np.shape(x.values), strict=True) if size > 1}
        for x in (u, v)
    ]
    if dims[0] != dims[1]:
        sentence = (
            f"'{u.name}' is on {', '.join(u.dims)} and '{v.name}' on {', '.join(v.dims)}: other "
            "points of a C-grid"
        )
        hint = (
            "give what flows through the faces of cells, each velocity times the length of its "
            "face: lv.GriddedField(x, y, fluxes=...); or interpolate both to the same points"
        )
        raise ValueError(hinted(sentence, hint))
    for x in variables.values():
        if np.ndim(x.values) < 2 or not (_is_named(x, ANGLES) or "degrees_" in x.units.lower()):
            continue
        bare = [
            dim for dim in x.dims if dim in dims[0] and np.shape(x.values)[x.dims.index(dim)] > 1
            and (dim not in variables or _is_bare(variables[dim]))
        ]  # fmt: skip
        if len(bare) > 1:
            sentence = f"'{x.name}' depends on {' and '.join(bare)}: the grid is curvilinear"
            raise ValueError(hinted(sentence, RECTANGULAR))


def _is_bare(axis: Variable) -> bool:
    """Return whether an axis has numbers without a unit, and no name that says what they are."""
    is_named = _is_angle(axis) or "projection" in str(axis.attrs.get("standard_name", ""))
    return axis.units.lower() in units.NONE and not is_named


def _ordered(x: Variable, axes: Mapping[str, Variable], order: Sequence[str]) -> Array:
    """Return the values of a component with axes in the order t, x, y, z."""
    wanted = [axes[key].name for key in order]
    values, dims = np.asarray(x.values), list(x.dims)
    for dim in [dim for dim in dims if dim not in wanted]:
        if values.shape[dims.index(dim)] != 1:
            sentence = f"'{x.name}' is on axes {', '.join(x.dims)}, and not on those of the others"
            hint = "for faces of a C-grid take lv.GriddedField(..., fluxes=...)"
            raise ValueError(hinted(sentence, hint))
        values = values.take(0, axis=dims.index(dim))
        dims.remove(dim)
    if sorted(dims) != sorted(wanted):
        raise ValueError(f"'{x.name}' is on axes {', '.join(x.dims)}, wanted {', '.join(wanted)}")
    return values.transpose([dims.index(dim) for dim in wanted])


def _check_units(
    components: Mapping[str, Variable], space: Sequence[Variable], is_sphere: bool
) -> None:
    """Refuse units that do not fit one another."""
    first, *others = components.values()
    for other in others:
        is_other = units.velocity(other.units) != units.velocity(first.units)
        if other.units != first.units and (is_other or units.velocity(first.units) is None):
            sentence = f"'{first.name}' is in {first.units!r} and '{other.name}' in {other.units!r}"
            raise ValueError(hinted(sentence, "convert one of them"))
    rate = units.velocity(first.units)
    if is_sphere or rate is None:
        return
    for axis in space:
        own = units.length(axis.units)
        if axis.units.lower() not in units.NONE and own != rate[0]:
            sentence = f"'{axis.name}' is in {axis.units} and '{first.name}' in {first.units}"
            hint = "convert one of them" + (
                f": dataset['{axis.name}'] * {own / rate[0]:g}" if own else ""
            )
            raise ValueError(hinted(sentence, hint))


def _times(axis: Variable, velocity: Variable) -> Array:
    """Return the times in the velocity's unit of time, dates from the first one on."""
    values = np.asarray(axis.values)
    found = units.seconds(axis.name, axis.units, values)
    if found is None:
        return np.asarray(values, dtype=float)
    return found / units.needed(velocity.name, velocity.units)[1]


def _dates(axis: Variable, velocity: Variable) -> Dates | None:
    """Return the date of the first time, None where times are no dates."""
    known = units.velocity(velocity.units)
    calendar = str(axis.attrs.get("calendar", "")).lower()
    return units.dates(np.asarray(axis.values), axis.units, calendar, known[1] if known else 1.0)
