"""Names and contents of the arrays of a stored run: those of any saved solution."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from liouville._solution import export
from liouville._solution.solution import Solution

#: The axes that grow, beside those of events.
GROWING = ("time", "change")


def prepare(solution: Solution, path: Path, chunks: Mapping[str, int]) -> None:
    """Write a solution without its records to a folder whose arrays can grow along some axes."""
    dataset = export.paired(export.dataset_of(solution))
    none = {axis: slice(0) for axis in chunks if axis in dataset.dims}
    export.write_zarr(dataset.isel(none), path, chunks)


def rows_of(solution: Solution) -> dict[str, dict[str, np.ndarray]]:
    """Return the arrays that have a row for each record, event or change, by their axes."""
    dataset = export.paired(export.dataset_of(solution))
    found: dict[str, dict[str, np.ndarray]] = {}
    for name, variable in dataset.variables.items():
        axis = str(variable.dims[0])
        if axis in GROWING or axis.startswith(event_axis("")):
            found.setdefault(axis, {})[str(name)] = variable.values
    return found


def event_axis(name: str) -> str:
    """Name the axis of an event."""
    return f"event_axis_{name.replace('/', export.SLASH)}"


def event_variable(axis: str, state: str) -> str:
    """Name what is known where events were met, along their axis."""
    return axis.replace("event_axis_", f"event_{state}_", 1)
