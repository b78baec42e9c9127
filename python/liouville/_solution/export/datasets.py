"""Solutions as labelled datasets of xarray, and back."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._solution.export.layout import Layout, laid_out, time_attributes
from liouville._solution.export.reading import read
from liouville._solution.solution import Solution

if TYPE_CHECKING:
    import xarray

# The axis of real and imaginary parts.
PART = "part"

#: The extra that installs a package, where it is not "io".
EXTRAS = {"pyarrow": "parquet"}


def to_xarray(solution: Solution) -> xarray.Dataset:
    """Give a solution as a labelled dataset.

    Parameters
    ----------
    solution : Solution
        What to convert; nothing is copied.

    Returns
    -------
    xarray.Dataset
        See :mod:`liouville._solution.export`. Of an ensemble the members have numbers, and the
        parameters that differ are coordinates along them:
        ``data.swap_dims(member="g").sel(g=9.81)``. Times of a field with dates are dates.

    Raises
    ------
    ImportError
        xarray is not installed.
    """
    return decoded(dataset_of(solution))


def decoded(dataset: xarray.Dataset) -> xarray.Dataset:
    """Return a dataset with dates for times that are counted from one."""
    times = dataset["time"]
    if "calendar" not in times.attrs:
        return dataset
    found = needed("xarray").decode_cf(times.reset_coords(drop=True).to_dataset(name="found"))
    return dataset.assign_coords(time=(times.dims, found["found"].values, found["found"].attrs))


def dataset_of(solution: Solution) -> xarray.Dataset:
    """Give a solution as the dataset that files hold."""
    layout = laid_out(solution)
    names, times = dict(layout.labels), layout.labels["time"]
    del names["time"]
    dataset: xarray.Dataset = needed("xarray").Dataset(
        layout.variables,
        coords={"time": ("time", times, time_attributes(solution))}
        | {dim: np.array(labels, dtype=object) for dim, labels in names.items()},
        attrs=layout.attributes,
    )
    if solution.members is None:
        return dataset
    taken = {*dataset.variables, *dataset.dims}
    coordinates: dict[str, Any] = {"member": np.arange(solution.members)}
    for name in solution.varied:
        values = np.asarray(solution.params[name])
        label = name if name not in taken else f"params.{name}"
        coordinates[label] = (("member", f"{label}_axis")[: values.ndim], values)
    return dataset.assign_coords(coordinates)


def from_xarray(dataset: xarray.Dataset, where: str) -> Solution:
    """Return the solution of a dataset that :func:`to_xarray` made; `where` is its file's name."""
    variables = {
        str(name): (tuple(map(str, x.dims)), x.values, dict(x.attrs))
        for name, x in dataset.data_vars.items()
    }
    labels = {str(dim): x.values for dim, x in dataset.coords.items()}
    return read(Layout(variables, labels, dict(dataset.attrs)), where)


def paired(dataset: xarray.Dataset) -> xarray.Dataset:
    """Give complex numbers as pairs: neither kind of file has them."""
    return dataset.assign(
        {
            name: ((*x.dims, PART), np.ascontiguousarray(x.values)[..., None].view(float), x.attrs)
            for name, x in dataset.items()
            if x.dtype.kind == "c"
        }
    )


def unpaired(dataset: xarray.Dataset, where: str) -> xarray.Dataset:
    """Give pairs as complex numbers; ValueError where some are none."""
    for name, x in dataset.items():
        if PART in x.dims and (x.dims[-1], x.shape[-1], x.dtype.str[1:]) != (PART, 2, "f8"):
            raise ValueError(f"{str(name)!r} of {where} must be pairs of numbers along {PART!r}")
    return dataset.assign(
        {
            name: (x.dims[:-1], np.ascontiguousarray(x.values).view(complex)[..., 0], x.attrs)
            for name, x in dataset.items()
            if PART in x.dims
        }
    )


def needed(package: str) -> Any:
    """Import a package; ImportError names the extra that installs it."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(
            f"files and datasets need {package}\n"
            f'hint: pip install "liouville[{EXTRAS.get(package, "io")}]"'
        ) from error
