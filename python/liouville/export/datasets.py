"""Solutions as labelled datasets, and back."""

from __future__ import annotations

import importlib
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville.failure import Failure
from liouville.points import STATES, Points
from liouville.solution import Array, Solution

if TYPE_CHECKING:
    import xarray

# The attribute that tells our files from others, and the version of their layout.
MARK, VERSION = "liouville_solution", 3

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
        See :mod:`liouville.export`.

    Raises
    ------
    ImportError
        xarray is not installed.
    """
    xr = needed("xarray")
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
            rows[..., place, place_of(name, values, known)] = values
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
            # Zarr forgets the order of variables, and that one was there.
            "order": json.dumps([*variables, "time", *labels]),
            "stats": json.dumps(solution.stats, default=_plain),
            "params": json.dumps(solution.params, default=_plain),
        },
    )
    return dataset


def from_xarray(dataset: xarray.Dataset) -> Solution:
    """Return the solution of a dataset that :func:`to_xarray` made."""

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


def unpaired(dataset: xarray.Dataset) -> xarray.Dataset:
    """Give pairs as complex numbers."""
    return dataset.assign(
        {
            name: (x.dims[:-1], np.ascontiguousarray(x.values).view(complex)[..., 0], x.attrs)
            for name, x in dataset.items()
            if PART in x.dims
        }
    )


def place_of(residual: str, values: Array, constraints: tuple[str, ...]) -> slice:
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


def _plain(value: Any) -> Any:
    """Give NumPy's numbers and arrays as Python's, which JSON writes with all their digits."""
    return np.asarray(value).tolist()


def needed(package: str) -> Any:
    """Import a package; ImportError names the extra that installs it."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(
            f'files and datasets need {package}\nhint: pip install "liouville[io]"'
        ) from error
