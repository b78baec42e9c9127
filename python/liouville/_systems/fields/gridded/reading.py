"""Variables of data sets: xarray's, or those of NetCDF files.

A data set is looked at by its names, dimensions, values and attributes alone, so that neither
xarray nor a library for NetCDF is needed to read a classic file: SciPy reads these.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._basics.scipy import scipy
from liouville._systems.fields.gridded.axis import Array

#: Attributes of numbers that are not what they mean: the first two say which ones are missing.
PACKED = ("_FillValue", "missing_value", "scale_factor", "add_offset")

#: What NetCDF fills an array with that was not written.
UNWRITTEN = 9.969209968386869e36


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
        found = type(dataset).__name__
        raise TypeError(f"dataset must be an xarray.Dataset, not {found}") from None
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
