"""Solutions as xarray datasets and as files: NetCDF and Zarr both ways, CSV for reading elsewhere.

A dataset has the dimensions ``time``, ``coordinate``, ``constraint``, ``invariant``, ``residual``
and ``term``, ``unknown`` where the system has algebraic unknowns, and ``member`` where it is of an
ensemble, labelled by the names of the solution. Its
variables are the states under their own letters, ``invariants``, ``residuals``, ``balance``, and
``observed_NAME`` for each observed quantity, ``event_t_NAME`` for the times of events and
``event_q_NAME`` and so on for the states there; how the run went is in its attributes. What is
saved comes back bit for bit. A wave function has the dimension ``place``, without labels; in a
file, complex numbers are pairs along ``part``.
"""

from __future__ import annotations

import importlib
import json
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville.failure import Failure
from liouville.points import STATES, Points
from liouville.solution import Array, Solution

if TYPE_CHECKING:
    import xarray

SUFFIXES = (".nc", ".zarr", ".csv")

# The attribute that tells our files from others, and the version of their layout.
MARK, VERSION = "liouville_solution", 2

# The axis of real and imaginary parts.
PART = "part"

# The axis of a state, where it is not "coordinate".
AXES = {"lam": "constraint", "psi": "place"}

# Neither NetCDF nor Zarr takes a slash in a variable's name; this one only looks like it.
SLASH = "\u2215"


def to_xarray(solution: Solution) -> xarray.Dataset:
    """Give a solution as a labelled dataset.

    Parameters
    ----------
    solution : Solution
        What to convert; nothing is copied.

    Returns
    -------
    xarray.Dataset
        See the head of this module.

    Raises
    ------
    ImportError
        xarray is not installed.
    """
    xr = _needed("xarray")
    names, failures = solution.names, solution.failures
    variables: dict[str, Any] = {}
    lead = ("time",) if solution.members is None else ("time", "member")
    axis_of = AXES | ({"z": "unknown"} if "unknowns" in names else {})
    for name, values in solution.states.items():
        variables[name] = ((*lead, axis_of.get(name, "coordinate")), values)
    if solution.invariants:
        columns = np.stack(list(solution.invariants.values()), axis=-1)
        variables["invariants"] = ((*lead, "invariant"), columns)
    if solution.residuals:
        known = names["constraints"]
        shape = next(iter(solution.residuals.values())).shape[:-1]
        rows = np.full((*shape, len(solution.residuals), len(known)), np.nan)
        for place, (name, values) in enumerate(solution.residuals.items()):
            rows[..., place, _place(name, values, known)] = values
        variables["residuals"] = ((*lead, "residual", "constraint"), rows)
    if solution.balance:
        columns = np.stack(list(solution.balance.values()), axis=-1)
        variables["balance"] = ((*lead, "term"), columns)
    for name, values in solution.observed.items():
        label = "observed_" + name.replace("/", SLASH)
        variables[label] = ((*lead, f"{label}_axis")[: values.ndim], values, {"name": name})
    for name, points in solution.events.items():
        label = name.replace("/", SLASH)
        axis = f"event_axis_{label}"
        variables[f"event_t_{label}"] = ((axis,), points.t, {"name": name})
        for state, values in points.states.items():
            dims = (axis, axis_of.get(state, "coordinate"))
            variables[f"event_{state}_{label}"] = (dims, values, {"name": name, "state": state})
    labels = {
        "coordinate": names["coordinates"],
        "constraint": names["constraints"],
        **({"unknown": names["unknowns"]} if "unknowns" in names else {}),
        "invariant": solution.invariants,
        "residual": solution.residuals,
        "term": solution.balance,
    }
    dataset: xarray.Dataset = xr.Dataset(
        variables,
        coords={"time": solution.t}
        | {dim: np.array(list(values), dtype=object) for dim, values in labels.items()},
        attrs={
            MARK: VERSION,
            "status": solution.status,
            "message": solution.message,
            "method": solution.method,
            "h": solution.h,
            "dense_order": solution.dense_order,
            "initial": json.dumps(solution.initial, default=_plain),
            "members": -1 if solution.members is None else solution.members,
            "failures": json.dumps({k: [x.step, x.t, x.message] for k, x in failures.items()}),
            "tolerances": json.dumps(solution.tolerances, default=_plain),
            # Zarr forgets the order of variables.
            "order": json.dumps(list(variables)),
            "stats": json.dumps(solution.stats, default=_plain),
            "params": json.dumps(solution.params, default=_plain),
        },
    )
    return dataset


def check(path: str | os.PathLike[str]) -> None:
    """Refuse a path that a solution could not be saved to, before a long run and not after it.

    Raises
    ------
    ValueError
        The suffix is none of ``SUFFIXES``.
    FileNotFoundError
        The folder does not exist.
    ImportError
        A package that this kind of file needs is not installed.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise ValueError(
            f"cannot tell the kind of file from the suffix of {str(path)!r}\n"
            f"hint: use one of {', '.join(SUFFIXES)}"
        )
    if not path.absolute().parent.is_dir():
        raise FileNotFoundError(f"the folder of {str(path)!r} does not exist\nhint: create it")
    for package in {".nc": ("xarray", "h5py", "h5netcdf"), ".zarr": ("xarray", "zarr")}.get(
        path.suffix, ()
    ):
        _needed(package)


def save(solution: Solution, path: str | os.PathLike[str]) -> None:
    """Write a solution to a file, replacing what was there.

    Parameters
    ----------
    solution : Solution
        What to write.
    path : path
        Where: ``.nc`` writes NetCDF 4, ``.zarr`` a Zarr 3 folder; ``.csv`` one row a kept step
        with all digits, but without names, statistics or status, so it cannot be loaded back.

    Raises
    ------
    ValueError, FileNotFoundError, ImportError
        As :func:`check` does; or an ensemble is to go to a ``.csv``.
    """
    path = Path(path)
    check(path)
    if path.suffix == ".csv":
        _save_csv(solution, path)
        return
    dataset = paired(to_xarray(solution))
    # No fill value: a stored NaN is the run's own NaN.
    encoding = {
        name: {"_FillValue": None}
        for name, variable in dataset.variables.items()
        if variable.dtype.kind == "f"
    }
    if path.suffix == ".nc":
        dataset.to_netcdf(path, engine="h5netcdf", encoding=encoding)
    else:
        dataset.to_zarr(path, mode="w", encoding=encoding, zarr_format=3, consolidated=False)


def load(path: str | os.PathLike[str]) -> Solution:
    """Read a solution that :func:`save` wrote to a NetCDF file or a Zarr folder.

    Parameters
    ----------
    path : path
        A ``.nc`` file or a ``.zarr`` folder.

    Returns
    -------
    Solution
        Equal to the saved one bit for bit; its ``system`` is None, for a file holds no functions.

    Raises
    ------
    FileNotFoundError
        There is nothing at this path.
    ValueError
        The suffix is unknown, or what is there is no saved solution.
    ImportError
        xarray or the package for this kind of file is not installed.
    """
    return _read(Path(path))


def ends(path: Path) -> Solution:
    """Read the same with its first and its last record only."""
    return _read(path, are_all=False)


def _read(path: Path, are_all: bool = True) -> Solution:
    check(path)
    if path.suffix == ".csv":
        raise ValueError(
            f"{str(path)!r} cannot be loaded: a CSV file holds only columns of numbers\n"
            "hint: save to .nc or .zarr what you want to load again"
        )
    if not path.exists():
        raise FileNotFoundError(f"there is no file {str(path)!r}")
    options: dict[str, Any] = (
        {"engine": "h5netcdf"}
        if path.suffix == ".nc"
        else {"engine": "zarr", "consolidated": False}
    )
    # an index of all times would be made in memory
    options["create_default_indexes"] = False
    try:
        with _needed("xarray").open_dataset(
            path, decode_times=False, mask_and_scale=False, **options
        ) as opened:
            if not are_all:
                step = max(1, opened.sizes["time"] - 1)
                opened = opened.isel(time=slice(None, None, step))
            dataset = _complex(opened.load())
    except (OSError, KeyError, ValueError) as error:
        raise ValueError(f"{str(path)!r} cannot be read as {path.suffix}: {error}") from error
    found = dataset.attrs.get(MARK)
    if found != VERSION:
        raise ValueError(
            f"{str(path)!r} holds no liouville solution\n"
            "hint: liouville.load reads what solution.save wrote"
            if found is None
            else f"{str(path)!r} has layout {found} of a solution, this liouville reads {VERSION}\n"
            "hint: a newer liouville wrote it"
        )
    return _from_xarray(dataset)


def _from_xarray(dataset: xarray.Dataset) -> Solution:
    def names(dim: str) -> tuple[str, ...]:
        return tuple(str(label) for label in dataset[dim].values)

    def columns(variable: str, dim: str) -> dict[str, Array]:
        if variable not in dataset:
            return {}
        values = dataset[variable].values
        axis = dataset[variable].dims.index(dim)
        return {name: values.take(i, axis) for i, name in enumerate(names(dim))}

    attributes = dataset.attrs
    variables = {name: dataset[name] for name in json.loads(attributes["order"])}
    return Solution(
        t=dataset["time"].values,
        states={name: variable.values for name, variable in variables.items() if name in STATES},
        invariants=columns("invariants", "invariant"),
        residuals={
            name: values[..., _filled(values)]
            for name, values in columns("residuals", "residual").items()
        },
        observed={
            variable.attrs["name"]: variable.values
            for name, variable in variables.items()
            if name.startswith("observed_")
        },
        balance=columns("balance", "term"),
        events=_events(variables),
        dense_order=int(attributes.get("dense_order", 0)),
        names={
            "coordinates": names("coordinate"),
            "constraints": names("constraint"),
            **({"unknowns": names("unknown")} if "unknown" in dataset.coords else {}),
        },
        h=float(attributes["h"]),
        members=_members(attributes.get("members", -1)),
        failures=_failures(json.loads(attributes.get("failures", "{}"))),
        initial=json.loads(attributes.get("initial", "{}")),
        tolerances=json.loads(attributes["tolerances"]),
        method=attributes["method"],
        stats=json.loads(attributes["stats"]),
        params=json.loads(attributes["params"]),
        status=attributes["status"],
        message=attributes["message"],
    )


def _events(variables: dict[str, Any]) -> dict[str, Points]:
    found = [x for name, x in variables.items() if name.startswith("event_")]
    points = {}
    for times in found:
        if "state" not in times.attrs:
            name = times.attrs["name"]
            of = [x for x in found if "state" in x.attrs and x.attrs["name"] == name]
            points[name] = Points(times.values, {x.attrs["state"]: x.values for x in of})
    return points


def paired(dataset: xarray.Dataset) -> xarray.Dataset:
    """Give complex numbers as pairs: neither kind of file has them."""
    return dataset.assign(
        {
            name: ((*x.dims, PART), np.ascontiguousarray(x.values)[..., None].view(float), x.attrs)
            for name, x in dataset.items()
            if x.dtype.kind == "c"
        }
    )


def _complex(dataset: xarray.Dataset) -> xarray.Dataset:
    """Give pairs as complex numbers."""
    return dataset.assign(
        {
            name: (x.dims[:-1], np.ascontiguousarray(x.values).view(complex)[..., 0], x.attrs)
            for name, x in dataset.items()
            if PART in x.dims
        }
    )


def _place(residual: str, values: Array, constraints: tuple[str, ...]) -> slice:
    """Return to which constraints a residual belongs."""
    first = len(constraints) - values.shape[-1] if residual == "nonholonomic" else 0
    return slice(first, first + values.shape[-1])


def _filled(values: Array) -> Array:
    """Return which columns are there: the others are NaN throughout."""
    flat = values.reshape(math.prod(values.shape[:-1]), values.shape[-1])
    is_missing = np.isnan(flat).all(axis=0) & bool(len(flat))
    return np.logical_not(is_missing)


def _failures(given: dict[str, list[Any]]) -> dict[int, Failure]:
    return {int(member): Failure(*failure) for member, failure in given.items()}


def _members(count: int) -> int | None:
    return None if count < 0 else int(count)


def _save_csv(solution: Solution, path: Path) -> None:
    if solution.members is not None:
        raise ValueError("a table has no room for an ensemble\nhint: save it as .nc or .zarr")
    names = solution.names
    columns = {"t": solution.t}
    for name, values in solution.states.items():
        kind = "unknowns" if name == "z" and "unknowns" in names else "coordinates"
        labels = names["constraints" if name == "lam" else kind]
        labels = labels or tuple(str(i) for i in range(values.shape[1]))
        columns |= {f"{name}[{label}]": values[:, i] for i, label in enumerate(labels)}
    columns |= solution.invariants | solution.balance
    for name, values in solution.residuals.items():
        labels = names["constraints"][_place(name, values, names["constraints"])]
        columns |= {f"{name}[{label}]": values[:, i] for i, label in enumerate(labels)}
    for name, values in solution.observed.items():
        if values.ndim == 1:
            columns[name] = values
        else:
            columns |= {f"{name}[{i}]": values[:, i] for i in range(values.shape[1])}
    columns = {label: part for name, x in columns.items() for label, part in _real(name, x)}
    header = ",".join(f'"{name}"' if "," in name else name for name in columns)
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.17g")


def _real(name: str, values: Array) -> list[tuple[str, Array]]:
    """Give a column as it is, or real and imaginary parts of a complex one."""
    if not np.iscomplexobj(values):
        return [(name, values)]
    return [(f"re {name}", values.real), (f"im {name}", values.imag)]


def _plain(value: Any) -> Any:
    """Give NumPy's numbers and arrays as Python's, which JSON writes with all their digits."""
    return np.asarray(value).tolist()


def _needed(package: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(
            f'files and datasets need {package}\nhint: pip install "liouville[io]"'
        ) from error
