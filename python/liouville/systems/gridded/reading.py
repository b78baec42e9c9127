"""Velocities from data sets: xarray's, or NetCDF files, with the conventions of CF.

A data set is looked at by its names, dimensions, values and attributes alone, so that neither
xarray nor a library for NetCDF is needed to read a classic file: SciPy reads these.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from liouville._scipy import scipy
from liouville.errors import hinted
from liouville.systems.gridded import units
from liouville.systems.gridded.axis import Array

#: Names of the components, and what CF's standard names of them contain.
COMPONENTS = {
    "u": (("u", "uo", "U", "vozocrtx"), r"eastward_.*(velocity|wind)|x_(velocity|wind)"),
    "v": (("v", "vo", "V", "vomecrty"), r"northward_.*(velocity|wind)|y_(velocity|wind)"),
    "w": (("w", "wo", "W"), r"upward_.*(velocity|air)|z_velocity"),
}

#: Names, standard names and units by which an axis is known.
AXES = {
    "X": (("x", "lon", "longitude", "nav_lon"), ("longitude", "projection_x_coordinate")),
    "Y": (("y", "lat", "latitude", "nav_lat"), ("latitude", "projection_y_coordinate")),
    "Z": (("z", "depth", "height", "lev", "level", "altitude"), ("depth", "height", "altitude")),
    "T": (("t", "time", "time_counter"), ("time",)),
}

#: Attributes of numbers that are not what they mean: the first two say which ones are missing.
PACKED = ("_FillValue", "missing_value", "scale_factor", "add_offset")

#: What NetCDF fills an array with that was not written.
UNWRITTEN = 9.969209968386869e36

#: The earth's mean radius, in metres.
EARTH = 6.371e6


@dataclass(frozen=True, eq=False)
class Variable:
    """An array with the names of its dimensions."""

    name: str
    dims: tuple[str, ...]
    values: Any
    attrs: Mapping[str, Any] = field(default_factory=dict)

    @property
    def units(self) -> str:
        """Its units, "" where they are not said."""
        return str(self.attrs.get("units", "")).strip()


Variables = Mapping[str, Variable]


def of_xarray(dataset: Any) -> dict[str, Variable]:
    """Return the variables of an xarray.Dataset, or of what has the same attributes."""
    try:
        names = [str(name) for name in dataset.variables]
    except (AttributeError, TypeError):
        wanted = "dataset is an xarray.Dataset"
        raise TypeError(f"{wanted}, not {type(dataset).__name__}") from None
    return {
        name: Variable(name, tuple(map(str, x.dims)), _meant(x.values, x.attrs), dict(x.attrs))
        for name, x in ((name, dataset[name]) for name in names)
    }


def of_file(path: str | os.PathLike[str]) -> dict[str, Variable]:
    """Return the variables of a NetCDF file: a classic one by SciPy, others by xarray."""
    file = Path(path)
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {str(file)!r}")
    with file.open("rb") as opened:
        magic = opened.read(4)
    if magic == b"\x89HDF":
        return _by_xarray(file)
    if magic[:3] != b"CDF":
        raise ValueError(f"{str(file)!r} is no NetCDF file: it begins with {magic!r}")
    netcdf = scipy("io", "a NetCDF file").netcdf_file
    with netcdf(file, mmap=False) as classic:
        given = {name: (x, _texts(x._attributes)) for name, x in classic.variables.items()}
        return {
            name: Variable(name, x.dimensions, _decoded(x[...], attrs), attrs)
            for name, (x, attrs) in given.items()
        }


def _by_xarray(file: Path) -> dict[str, Variable]:
    try:
        import xarray

        opened = xarray.open_dataset(file)
    except ImportError as error:
        sentence = f"{str(file)!r} is no classic NetCDF file, which SciPy reads"
        hint = (
            'pip install "liouville[export]" for NetCDF 4, or write it with format="NETCDF3_64BIT"'
        )
        raise ImportError(hinted(sentence, hint), name="xarray") from error
    with opened as dataset:
        return of_xarray(dataset.load())


def _meant(values: Any, attrs: Mapping[str, Any]) -> Any:
    """Return values as they are meant, which xarray's are unless they were not to be decoded."""
    is_packed = any(name in attrs for name in PACKED) and np.asarray(values).dtype.kind in "iuf"
    return _decoded(values, attrs) if is_packed else values


def _decoded(values: Any, attrs: Mapping[str, Any]) -> Array:
    """Return numbers as they are meant: NaN where they are missing, else scaled and shifted."""
    given = np.asarray(values)
    found = np.array(given, dtype=float)
    for name in PACKED[:2]:
        if name in attrs:
            # in single precision: so the attribute may be written where the values are not
            found[np.isclose(found, float(np.ravel(attrs[name])[0]), rtol=1e-6, atol=0)] = np.nan
    if given.dtype.kind == "f":
        found[given == given.dtype.type(UNWRITTEN)] = np.nan
    factor, offset = (float(attrs.get(k, x)) for k, x in (("scale_factor", 1), ("add_offset", 0)))
    if given.dtype.kind == "f" and (factor, offset) == (1.0, 0.0):
        return found.astype(given.dtype)  # which says how nodes were rounded
    return found * factor + offset


def _texts(attributes: Mapping[str, Any]) -> dict[str, Any]:
    return {name: x.decode() if isinstance(x, bytes) else x for name, x in attributes.items()}


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
    axes = _axes(variables, first)
    if "Z" not in axes:
        components.pop("w", None)
    elif "w" not in components:
        sentence = (
            f"'{first.name}' has levels along '{axes['Z'].name}', and there is no component w"
        )
        raise ValueError(hinted(sentence, f"choose one: dataset.isel({axes['Z'].name}=0)"))
    order = [key for key in "TXYZ" if key in axes]
    arrays = [_ordered(x, axes, order) for x in components.values()]
    space = [axes[key] for key in order if key != "T"]
    is_sphere = all(_is_angle(axis) for axis in space[:2]) and len(space) == 2
    _check_units(components, space, is_sphere)
    made: dict[str, Any] = {
        "xyz": [np.asarray(axis.values) for axis in space],
        "velocity": arrays,
    }
    if "T" in axes:
        made["t"] = _times(axes["T"], first)
    if is_sphere and "coordinates" not in options:
        per_metre = 1 / units.needed(first.name, first.units)[0]
        made |= {"coordinates": "spherical", "radius": EARTH * per_metre}
        made |= _around(made["xyz"][0], options)
        made["names"] = ("lon", "lat")
    else:
        made["names"] = tuple(axis.name for axis in space)
    names = dict(zip((axis.name for axis in space), made["names"], strict=True))
    return made | {key: _renamed(key, x, names, options) for key, x in options.items()}


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
    for dim in component.dims:
        own = variables.get(dim)
        size = component.values.shape[component.dims.index(dim)]
        if own is None or np.ndim(own.values) != 1:
            if size == 1:
                continue
            sentence = f"dimension '{dim}' of '{component.name}' has no coordinate of its own"
            hint = "curvilinear grids are not taken: interpolate to a rectangular one"
            raise ValueError(hinted(sentence, hint))
        letter = _letter(own)
        if size == 1 and letter != "T":
            continue
        if size == 1:
            continue
        if letter is None or letter in found:
            sentence = f"'{dim}' of '{component.name}' is no axis that is known"
            raise ValueError(hinted(sentence, f"choose one of it: dataset.isel({dim}=0)"))
        found[letter] = own
    if missing := [letter for letter in "XY" if letter not in found]:
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
    return axis.units.lower().startswith("degree") or axis.name.lower() in (
        "lon", "longitude", "lat", "latitude",
    )  # fmt: skip


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


def _around(longitudes: Array, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return that longitudes are periodic where they go round."""
    step = (float(longitudes[-1]) - float(longitudes[0])) / (longitudes.size - 1)
    is_round = abs(abs(step) * longitudes.size - 360) < 1e-3 * abs(step)
    return {"periodic": ("lon",)} if is_round and "periodic" not in options else {}
