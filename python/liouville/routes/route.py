"""What a route is, and what a caller asks of one."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import MOST_STEPS, Steps, check_memory, count
from liouville.methods import Method
from liouville.planner import Plan
from liouville.points import Points
from liouville.propagation import Propagation
from liouville.systems import System

KEEP_LESS = "keep fewer with every=, or none with states=False"
STORE = "; store= keeps all of them in a folder"


@dataclass(frozen=True)
class Asked:
    """What a caller asks of a run, unchecked; see :func:`liouville.integrate`."""

    t: Any
    h: Any
    steps: Any
    control: Mapping[str, Any]
    every: Any
    observe: Mapping[str, Callable[..., Any]] | None
    params: Mapping[str, ArrayLike] | None
    states: Any
    start: Mapping[str, Any]
    is_ensemble: bool = False
    threads: Any = None
    tol: Any = None
    t_eval: Any = None
    events: Any = None
    is_stored: bool = False


class Route(Protocol):
    """A system and a method on their way through the core.

    Attributes
    ----------
    system : System
        What is integrated.
    method : str
        The method, as its repr.
    constraints : tuple of str
        Names of the constraints, empty where there are none.
    params : mapping
        Parameters of the run.
    pace : Steps
        The steps it makes, of which one in `every` is kept.
    columns : dict of str to int
        What a record consists of, with widths.
    members : tuple of int
        ``(P,)`` for an ensemble of P members, else ``()``.
    """

    method: str
    constraints: tuple[str, ...]
    params: Mapping[str, Any]
    pace: Steps
    every: int
    columns: dict[str, int]
    members: tuple[int, ...]

    @property
    def system(self) -> System:
        """What is integrated."""

    @property
    def choice(self) -> Method | Plan | Propagation:
        """The method, with nothing left to choose."""

    @property
    def row(self) -> int:
        """Bytes of a record."""

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run."""

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Give the columns of all records as the user has them."""

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Say where the energy went, where that is known."""

    @property
    def dense_order(self) -> int:
        """The order of a method whose steps have a dense output, else 0."""

    def seen(self, run: _core.Run) -> tuple[dict[str, Points], str]:
        """Return the events met, by name, and a sentence on the one that ended the run."""

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""


def kept(pace: Steps, every: Any) -> int:
    """Return how many steps are made for each one that is kept."""
    return min(count("every", every), pace.count if pace.control is None else MOST_STEPS)


def check_records(asked: Asked, records: int, row: int) -> None:
    """Refuse more records than fit in memory, where they are to be kept there."""
    if not asked.is_stored:
        hint = KEEP_LESS if asked.is_ensemble else KEEP_LESS + STORE
        check_memory(f"keeping {records} states", records * row, hint)


def observable(index: int, widths: Mapping[str, int]) -> dict[str, Any]:
    """Say which part of a record an index falls into, and where in that part."""
    models = {"p": "momentum", "v": "velocity", "hidden": "hidden constraint"}
    for part, width in widths.items():
        if index < width:
            return {"quantity": models.get(part, part), "index": index}
        index -= width
    return {}


def threads_of(value: Any) -> int:
    """Return a number of threads, by default as many as there are processors."""
    if value is None:
        return os.cpu_count() or 1
    return int(count("threads", value))
