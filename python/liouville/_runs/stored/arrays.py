"""Names and contents of the arrays of a stored run: those of any saved solution."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from liouville._solution import export
from liouville._solution.solution import Solution


def prepare(solution: Solution, path: Path, chunks: Mapping[str, int]) -> None:
    """Write a solution without records to a folder whose arrays can grow along some axes."""
    export.write_zarr(export.paired(export.dataset_of(solution)), path, chunks)


def along_time(solution: Solution) -> dict[str, np.ndarray]:
    """Return the arrays that have a row for each record."""
    dataset = export.paired(export.dataset_of(solution))
    return {
        str(name): variable.values
        for name, variable in dataset.variables.items()
        if variable.dims[0] == "time"
    }


def event_axis(name: str) -> str:
    """Name the axis of an event."""
    return f"event_axis_{name.replace('/', export.SLASH)}"


def event_variable(axis: str, state: str) -> str:
    """Name what is known where events were met, along their axis."""
    return axis.replace("event_axis_", f"event_{state}_", 1)
