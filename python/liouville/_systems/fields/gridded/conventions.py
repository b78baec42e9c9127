"""Components, axes and units of the variables of a data set, by the conventions of CF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.fields.gridded import names, sphere, units
from liouville._systems.fields.gridded.axis import Array
from liouville._systems.fields.gridded.places import letters_of, place
from liouville._systems.fields.gridded.reading import Variable, Variables


def arguments(
    variables: Variables, components: dict[str, Variable], options: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the arguments of a gridded field for components at the same points."""
    first = components["u"]
    variables = _with_places(variables, first)
    axes = _axes(variables, first)
    if "Z" not in axes:
        components.pop("w", None)
    order = [key for key in "TXYZ" if key in axes]
    arrays = [_ordered(x, axes, order) for x in components.values()]
    space = [axes[key] for key in order if key != "T"]
    made = frame(components, space, axes.get("T"), options)
    is_sphere = made["coordinates"] == "spherical"
    if "Z" in axes and "w" not in components:
        _check_without_w(first, axes["Z"], is_sphere, options)
        arrays.append(np.zeros_like(arrays[0]))
    elif "Z" in axes and names.is_against(axes["Z"], components["w"], arrays[-1]):
        arrays[-1] = -arrays[-1]
    made["velocity"] = arrays
    known = {axis.name: name for axis, name in zip(space, made["names"], strict=True)}
    made |= {key: names.renamed(key, x, known, options) for key, x in options.items()}
    return sphere.closed(made) if is_sphere else made


def frame(
    components: Mapping[str, Variable],
    space: Sequence[Variable],
    time: Variable | None,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the arguments of a gridded field that follow from its axes and units."""
    first, is_sphere = components["u"], _is_sphere(space, components["u"], options)
    _check_units(components, space, is_sphere)
    made: dict[str, Any] = {"coordinates": "spherical" if is_sphere else "cartesian"}
    if time is not None:
        made |= {"t": names.times(time, first), "dates": names.dates(time, first)}
    if not is_sphere:
        made["xyz"] = [np.asarray(axis.values) for axis in space]
        return made | {"names": tuple(axis.name for axis in space)}
    metres = units.needed(first.name, first.units)[0]
    made["radius"] = sphere.EARTH / metres
    made["height"] = names.unit_of_heights(space[2], first) / metres if space[2:] else 1.0
    made["xyz"] = [names.degrees(axis) for axis in space[:2]]
    made["xyz"] += [np.asarray(axis.values) * made["height"] for axis in space[2:]]
    made["level"] = names.said_of(space[2]) if space[2:] else {}
    return made | {"names": ("lon", "lat", *(axis.name for axis in space[2:]))}


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
            raise ValueError(hinted(sentence, "add it: dataset.assign_coords(...)"))
        if size == 1:
            continue
        letter = names.letter(own)
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
            if dim in variables and names.letter(variables[dim]) == missing[0]:  # left out before
                sentence = f"'{component.name}' has one node along '{dim}', and a field is no line"
                raise ValueError(hinted(sentence, "choose several nodes along two axes at least"))
        dims = ", ".join(component.dims)
        sentence = f"'{component.name}' has no {missing[0]} axis among {dims}"
        raise ValueError(hinted(sentence, 'say so by an attribute: axis="X"'))
    return found


def _is_sphere(space: Sequence[Variable], first: Variable, options: Mapping[str, Any]) -> bool:
    """Return whether the axes are longitude and latitude; refuse angles that are none of a sphere.

    Other coordinates that were asked for are not looked at.
    """
    if options.get("coordinates", "spherical") != "spherical":
        return False
    angles = [axis.name for axis in space[:2] if names.is_angle(axis)]
    if not angles:
        return False
    if len(angles) == 1:
        other = next(axis.name for axis in space[:2] if axis.name not in angles)
        sentence = f"'{angles[0]}' is an angle, and '{other}' is none"
        raise ValueError(hinted(sentence, f"say its unit: dataset['{other}'].attrs['units']"))
    return True


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


def _with_places(variables: Variables, u: Variable) -> Variables:
    """Return the variables with longitudes and latitudes of two dimensions along one of them each.

    Raises
    ------
    ValueError
        They depend on both: the grid is curvilinear.
    """
    sizes = zip(u.dims, np.shape(u.values), strict=True)
    dims = {dim for dim, size in sizes if size > 1}
    bare = {dim for dim in dims if dim not in variables or names.is_bare(variables[dim])}
    places = [
        x for x in variables.values()
        if names.is_named(x, names.ANGLES) or "degrees_" in x.units.lower()
    ]  # fmt: skip
    if not any(len(bare & set(x.dims)) > 1 for x in places):
        return variables
    letters = letters_of(variables, u)
    found = dict(variables)
    for letter in "XY":
        if letter in letters and letters[letter] in bare:
            x = place(variables, "w", letters, letter)
            found[letters[letter]] = replace(
                x, name=letters[letter], attrs={**x.attrs, "axis": letter}
            )
    return found


def _ordered(x: Variable, axes: Mapping[str, Variable], order: Sequence[str]) -> Array:
    """Return the values of a component with axes in the order t, x, y, z."""
    wanted = [axes[key].name for key in order]
    values, dims = np.asarray(x.values), list(x.dims)
    for dim in [dim for dim in dims if dim not in wanted]:
        if values.shape[dims.index(dim)] != 1:
            sentence = f"'{x.name}' is on axes {', '.join(x.dims)}, and not on those of the others"
            hint = "interpolate it to the points of the others"
            raise ValueError(hinted(sentence, hint))
        values = values.take(0, axis=dims.index(dim))
        dims.remove(dim)
    if sorted(dims) != sorted(wanted):
        sentence = f"'{x.name}' must be on the axes {', '.join(wanted)}"
        raise ValueError(f"{sentence}, not {', '.join(x.dims)}")
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
