"""Where a run is stored, and how often its state."""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from liouville._basics.arguments import count
from liouville._basics.errors import hinted
from liouville._solution import export

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}

#: How often by default.
CHECKPOINT = "30s"


@dataclass(frozen=True)
class Store:
    """A folder that the records of a run go to on the way, and how often its state.

    :func:`integrate` and :func:`resume` take it as ``store``; a path alone is ``Store(path)``. A
    run that was cut off loses at most what came after its last state.

    Parameters
    ----------
    path : path
        The ``.zarr`` folder.
    checkpoint : int or str, optional
        The state is written after so many steps, or so much time, as in ``"30s"``, ``"10min"`` or
        ``"2h"``; by default ``"30s"``, and as before in a run that goes on.

    Raises
    ------
    TypeError, ValueError
        `path` is no path of a ``.zarr`` folder, or `checkpoint` neither a number of steps nor a
        time.

    Notes
    -----
    The state is all that the next step reads, so that a run that goes on has the same bits as one
    that was never cut off.

    Examples
    --------
    >>> import liouville as lv
    >>> lv.Store("run.zarr", checkpoint="10min")
    Store(path='run.zarr', checkpoint='10min')
    """

    path: str | os.PathLike[str]
    checkpoint: int | str | None = None

    def __post_init__(self) -> None:
        """Refuse a path or an interval that is none."""
        if not isinstance(self.path, str | os.PathLike):
            raise TypeError(f"store must be a path, not {self.path!r}")
        if Path(self.path).suffix != ".zarr":
            raise ValueError(f"a run must be stored in a .zarr folder, not in {str(self.path)!r}")
        if self.checkpoint is not None:
            interval_of(self.checkpoint)


@dataclass(frozen=True)
class Interval:
    """Steps between two states, or seconds where there is no number of steps."""

    steps: int | None
    seconds: float

    def is_due(self, done: int, last: float) -> bool:
        """Return whether to write the state, given steps and the time of the last one."""
        if self.steps is not None:
            return done % self.steps == 0
        return time.monotonic() - last >= self.seconds

    def limit(self, done: int, most: int) -> int:
        """Return how many steps in all are enough for now, if `most` further ones are."""
        if self.steps is None:
            return done + most
        return min(done + most, (done // self.steps + 1) * self.steps)


def store_of(store: Any) -> Store:
    """Return a store as it is, and a path as one."""
    return store if isinstance(store, Store) else Store(store)


def place_of(store: Any) -> tuple[Path, Interval]:
    """Check where a run is to be stored, and return it with the interval of its states.

    Raises
    ------
    TypeError, ValueError, ImportError, FileNotFoundError
        `store` is no path that a run could be stored at.
    FileExistsError
        There is something already.
    """
    store = store_of(store)
    path = Path(store.path)
    export.check(path)
    if path.exists():
        raise is_there(path)
    path = path.absolute()  # the run may change the working directory
    return path, interval_of(CHECKPOINT if store.checkpoint is None else store.checkpoint)


def is_there(path: Path) -> FileExistsError:
    """Return the error of a store where there is something already."""
    hint = f"liouville.resume({str(path)!r}) goes on with a run that is there"
    return FileExistsError(hinted(f"there is something at {str(path)!r} already", hint))


def interval_of(checkpoint: Any) -> Interval:
    """Read the interval between two states."""
    if not isinstance(checkpoint, str):
        return Interval(count("checkpoint", checkpoint), 0.0)
    found = re.fullmatch(r"\s*(\d+\.?\d*)\s*(s|min|h)\s*", checkpoint)
    if found is None or not float(found[1]):
        hint = "give checkpoint=10_000, or '30s', '10min' or '2h'"
        raise ValueError(hinted(f"checkpoint={checkpoint!r} says neither steps nor a time", hint))
    return Interval(None, float(found[1]) * UNITS[found[2]])
