"""The transposed derivative of a run: the part of a pullback that each family of systems has."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._runs.execute import Checkpoints
from liouville._runs.runner import Runner
from liouville._solution.solution import Solution

if TYPE_CHECKING:
    from liouville._runs.kinks import Kinks

#: The prefixes of cotangents of events, of invariants and of observables, among those of states.
EVENTS, INVARIANTS, OBSERVED = "events.", "invariants.", "observed."

#: Gradients by name, each of the shape of what it is by.
Gradients = dict[str, Any]


class Adjoint(ABC):
    """The transposed derivative of a run, which is made before the run by :meth:`Runner.adjoint`.

    Attributes
    ----------
    runner : Runner
        The run.
    directions : dict of str to tuple
        What gradients are by, each name seen to be one: its shape, and whether it is complex.
    is_complex : bool
        Whether states are complex.
    checkpoints : Checkpoints or None
        What the run is to leave for its repetition, if anything.
    holds_run : bool
        Whether moved runs hold what this run has chosen, which is over by then.
    kinks : Kinks or None
        Where the model bends or jumps, if it is looked at.
    refuses_kinks : bool
        Whether runs are pulled back only where it does not.
    """

    runner: Runner
    directions: Mapping[str, tuple[tuple[int, ...], bool]]
    is_complex: bool = False
    checkpoints: Checkpoints | None = None
    holds_run: bool = False
    kinks: Kinks | None = None
    refuses_kinks: bool = True

    @property
    def wrt(self) -> tuple[str, ...]:
        """The names of what gradients are by."""
        return tuple(self.directions)

    @abstractmethod
    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shapes of what has cotangents, by the names of the states."""

    def check(self, steps: float) -> None:
        """Refuse a pullback of so many steps if one of them has no derivative."""
        kink = self.kinks.first if self.kinks is not None and self.refuses_kinks else None
        if kink is not None and kink.step < steps:
            raise kink.error(self.runner)

    @abstractmethod
    def pulled(self, solution: Solution, cotangents: Mapping[str, np.ndarray]) -> Gradients:
        """Return gradients from cotangents of all these states, checked, zero where not given."""

    @abstractmethod
    def moved(self, directions: Mapping[str, np.ndarray], size: float) -> Mapping[str, np.ndarray]:
        """Return the states of the same discrete run, moved by so much of all directions.

        Records that an event or a switch has passed, in one of the runs alone, are NaN.
        """
