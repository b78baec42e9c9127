"""Runs of fields as trajectories by CF: a row for each member, and a column for each record."""

from __future__ import annotations

from collections.abc import Container
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._solution.export.datasets import decoded, needed
from liouville._solution.export.layout import SLASH, time_attributes, unit_attribute
from liouville._solution.solution import Array, Solution
from liouville._solution.states import unit_of
from liouville._systems import Field

if TYPE_CHECKING:
    import xarray

#: The dimensions, as programs for trajectories call them.
DIMS = ("trajectory", "obs")

#: Coordinates of points by those of states.
INSTEAD = {"mu": "lat", "q": "R"}

#: What CF says of such a data set.
CONVENTIONS = {"Conventions": "CF-1.11", "featureType": "trajectory", "feature_type": "trajectory"}


def trajectories(solution: Solution) -> xarray.Dataset:
    """Give the members of a field as trajectories; see :meth:`liouville.Solution.trajectories`."""
    if not isinstance(solution.system, Field):
        sentence = "trajectories must be those of a field"
        hint = "of a file give its field: lv.load(path, system=field)"
        if solution.system is not None:
            sentence, hint = (
                f"{sentence}, not of {solution.system!r}",
                "to_xarray takes any solution",
            )
        raise TypeError(hinted(sentence, hint))
    if "x" not in solution.states:
        raise ValueError("the run stored no states, and trajectories are made of them")
    places = _coordinates(solution, solution.system)
    made: xarray.Dataset = needed("xarray").Dataset(
        _variables(solution, places),
        places,
        CONVENTIONS | {"source": f"liouville, {solution.method}", "comment": solution.message},
    )
    return decoded(made)


def _coordinates(solution: Solution, system: Field) -> dict[str, Any]:
    """Return times and places; a record that a member did not make is missing."""
    x, role = solution.x, {"cf_role": "trajectory_id", "long_name": "the number of the member"}
    rows = _rows(solution, x)
    missing = np.isnan(rows).any(-1)
    times = _rows(
        solution,
        np.broadcast_to(
            solution.t if solution.members is None else solution.t[:, None], x.shape[:-1]
        ),
    )
    times = np.where(missing, np.nan, times)
    found: dict[str, Any] = {
        # with labels, so that trajectories of other lengths can be joined to these
        "trajectory": (DIMS[0], np.arange(len(rows)), role),
        "obs": (DIMS[1], np.arange(rows.shape[1])),
        "time": (DIMS, times, {"standard_name": "time"} | time_attributes(solution)),
    }
    points, names = system.positions(x), solution.names["coordinates"]
    for k, name in enumerate(names):
        unit = unit_of(solution, "x", (name,))
        # mu and q stand for latitudes and radii
        name = INSTEAD.get(name, name) if points else name
        values, said = points.get(name, (x[..., k], {"units": unit} if unit else {}))
        found[name] = (DIMS, _rows(solution, values), said)
    return found


def _variables(solution: Solution, places: Container[str]) -> dict[str, Any]:
    """Return the observables, and parameters that differ."""
    found: dict[str, Any] = {}
    for name, values in solution.observed.items():
        own, label = _rows(solution, values), name.replace("/", SLASH)
        label = f"observed_{label}" if label in places else label
        axes = (*DIMS, f"{label}_axis")[: own.ndim]
        found[label] = (axes, own, unit_attribute(solution, name))
    for name in solution.varied:
        values = np.asarray(solution.params[name])
        label = f"params.{name}" if name in found or name in places else name
        found[label] = ((DIMS[0], f"{label}_axis")[: values.ndim], values)
    return found


def _rows(solution: Solution, values: Array) -> Array:
    """Return values of records as those of members, a row for each, from its release on."""
    records = values[:, None] if solution.members is None else values
    rows = np.ascontiguousarray(np.swapaxes(records, 0, 1))
    for member, first in _late(solution).items():
        rows[member] = np.roll(rows[member], -first, axis=0)  # rows of NaN come last
    return rows


def _late(solution: Solution) -> dict[int, int]:
    """Return the members that are released after the first record, and their own first ones."""
    if solution.members is None or not len(solution.t):
        return {}
    missing = np.isnan(solution.x).any(-1)
    first = np.argmin(missing, axis=0)
    return {int(k): int(first[k]) for k in np.flatnonzero(first)}
