"""The base of all runners, and the request of a caller."""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics.arguments import MOST_STEPS, check_memory, count
from liouville._basics.faults import Description, describe
from liouville._methods import Method
from liouville._methods.control import Steps, Takes, steps_of
from liouville._runs.energy import sentence_of
from liouville._solution.points import Points
from liouville._solution.tangents import Tangent
from liouville._systems import System

if TYPE_CHECKING:
    from liouville._methods.planner import Plan
    from liouville._runs.adjoint import Adjoint
    from liouville._runs.watch import CoreEvents
    from liouville._solution.solution import Solution

KEEP_LESS = "keep fewer with every=, or none with states=False"
STORE = "; store= keeps all of them in a folder"

#: Names of some columns of a record in messages.
QUANTITIES = {
    "p": "momentum",
    "v": "velocity",
    "hidden": "hidden constraint",
    "kinetic": "kinetic energy",
}


@dataclass(kw_only=True, slots=True)
class Request:
    """The arguments of a call, unchecked; see :func:`liouville.integrate`."""

    t: Any
    h: Any = None
    steps: Any = None
    rtol: Any = None
    atol: Any = None
    control: Any = None
    every: Any = 1
    t_eval: Any = None
    events: Any = None
    observe: Mapping[str, Any] | None = None
    params: Mapping[str, ArrayLike] | None = None
    states: Any = True
    tangents: Any = None
    has_pullback: bool = False
    threads: Any = None
    start: Mapping[str, Any] = field(default_factory=dict)
    is_ensemble: bool = False
    is_stored: bool = False
    #: Events and times as the core takes them, of an ensemble for the runs of its members.
    watched: CoreEvents | None = None

    def steps_of(self, system: System, takes: Takes) -> Steps:
        """Return the steps asked for, of a method that takes these controls."""
        return steps_of(
            self.t, self.h, self.steps, takes, rtol=self.rtol, atol=self.atol,
            control=self.control, coordinates=system.coordinates,
        )  # fmt: skip


class Runner(ABC):
    """A system with a method, taken through the core.

    A runner checks the request, starts the run, and reads its records.

    Attributes
    ----------
    system : System
        What is integrated.
    choice : Method or Plan
        The method, with nothing left to choose.
    method : str
        The method in words, as its repr.
    constraints : tuple of str
        Names of the constraints, empty where there are none.
    params : mapping
        Parameters of the run.
    steps : Steps
        The steps it makes, of which one in `every` is kept.
    columns : dict of str to int
        What a record consists of, with widths.
    widths : dict of str to int
        The part of the columns that the recorder evaluates.
    members : tuple of int
        ``(P,)`` for an ensemble of P members, else ``()``.
    varied : tuple of str
        The parameters that have a value for each member.
    """

    #: How a run that would keep too many states keeps fewer.
    keep_less = KEEP_LESS

    constraints: tuple[str, ...] = ()
    #: Which method "auto" took, in words; empty where the method was given.
    taken = ""
    members: tuple[int, ...] = ()
    varied: tuple[str, ...] = ()
    #: Whether the absolute tolerance is the one by default, which knows no unit.
    _is_atol_default = False

    system: System
    choice: Method | Plan
    method: str
    params: Mapping[str, Any]
    steps: Steps
    every: int
    columns: dict[str, int]
    widths: Mapping[str, int]

    @abstractmethod
    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""

    @abstractmethod
    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run."""

    @property
    def row(self) -> int:
        """Bytes of a record."""
        return 8 * (1 + math.prod(self.members) * sum(self.columns.values()))

    @property
    def initial(self) -> dict[str, Any]:
        """The invariants at the start, where no record is kept of it; see :class:`Solution`."""
        return {}

    @property
    def dense_order(self) -> int:
        """The order of a method whose steps have a dense output, else 0."""
        return 0

    @property
    def control_taken(self) -> str:
        """A sentence on the control of the steps, where it is not the one that is expected."""
        return ""

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Give the columns of all records as the user has them: by default as they are."""
        return parts

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return where the energy went; empty where a system has no such balance."""
        del parts
        return {}

    def tangents(self, t: np.ndarray, parts: Mapping[str, np.ndarray]) -> dict[str, Tangent]:
        """Return the tangents in records by the names of their directions, if any were wanted."""
        del parts
        return {}

    def check_tangents(self, request: Request, solution: Solution) -> None:
        """Refuse tangents of a run that a kink of the model makes wrong."""
        # imported here: few runs have tangents
        from liouville._runs.kinks import check_tangents

        own: Any = self  # of a system on constraints or of a field
        check_tangents(own, request, solution)

    @property
    def parts_steps(self) -> bool:
        """Whether events or given times part steps, which a pullback then repeats."""
        return False

    def recorder(self) -> _core.Pullback | dict[str, Any] | None:
        """Return the recorder of the run's steps, or the error of its start.

        None where a pullback repeats all steps.
        """
        return None

    def adjoint(self, request: Request, wrt: Any) -> Adjoint:
        """Return the transposed derivative of the run by what `wrt` names, before it begins.

        Raises
        ------
        TypeError, ValueError
            There is none, or none by one of these.
        """
        del request, wrt
        raise TypeError(f"{self.method} has no pullback for {self.system!r}")

    def interrupted(self, done: int) -> str:
        """Return the message of a run that was interrupted after so many steps."""
        return f"interrupted after {done}{self.steps.total} steps"

    def totals(self, rows: np.ndarray) -> dict[str, Any]:
        """Return statistics that come from the records."""
        return {}

    def remark(self, run: _core.Run, t: np.ndarray, rows: np.ndarray) -> str:
        """Return sentences on a run that cannot be right; empty where there is none."""
        said = sentence_of(run.found(), is_ensemble=bool(self.members))
        return "; ".join(filter(None, [said, self.outweighed(self.largest(rows))]))

    def largest(self, rows: np.ndarray) -> float:
        """Return the largest coordinate of records, 0 where they have none or none is asked for."""
        if self.steps.asked is None or not self._is_atol_default:
            return 0.0
        width = self.columns.get(self.system.states[0], 0)
        return float(np.fmax.reduce(np.abs(rows[..., :width]), axis=None, initial=0.0))

    def outweighed(self, largest: float) -> str:
        """Return a sentence on a tolerance by default that is too large for all coordinates."""
        control = self.steps.asked
        if control is None or control[0] == "reversible" or not largest:
            return ""
        _, rtol, atol, *_ = control
        if not 0 < rtol * largest < atol[0]:
            return ""
        return (
            f"the errors are judged by atol = rtol / 1000 = {atol[0]:.3g}, which is more than rtol "
            f"times the largest coordinate, {largest:.3g}: give atol= in the coordinates' unit"
        )

    def events(self, run: _core.Run) -> tuple[dict[str, Points], dict[int, str]]:
        """Return the events met, by name, and a sentence on each that ended a run, by member."""
        del run
        return {}, {}

    def add_cause(self, error: dict[str, Any], run: _core.Run) -> None:
        """Add to the error of a run its cause, by the place where it ends; by default nothing."""
        del error, run

    def jump_along(self, places: Sequence[tuple[float, np.ndarray]]) -> str | None:
        """Return the function with which the equations jump at all of these steps.

        Of each the time is given, with what the core has of its place.
        """
        del places
        return None

    def describe(self, error: dict[str, Any]) -> Description:
        """Describe an error of the core in the user's names: sentence, hint and quantity."""
        if error.get("quantity") == "observable":
            error |= self._recorded(error["index"])
        sentence, hint, quantity = self._described(error)
        if self.members and "member" in error:
            sentence = f"member {error['member']}: {sentence}"
        return sentence, hint, quantity

    def _described(self, error: dict[str, Any]) -> Description:
        """Describe an error that is known to be of no recorded quantity."""
        return describe(error, self.system.coordinates, self.constraints)

    def _recorded(self, index: int) -> dict[str, Any]:
        """Return which part of a record an index falls into, and where in that part."""
        for part, width in self.widths.items():
            if index < width:
                return {"quantity": QUANTITIES.get(part, part), "index": index, "part": part}
            index -= width
        return {}

    def _check_records(self, request: Request, records: int) -> None:
        """Refuse more records than fit in memory, where they are to be kept there."""
        if not request.is_stored:
            hint = self.keep_less if request.is_ensemble else self.keep_less + STORE
            check_memory(f"keeping {records} states", records * self.row, hint)


def kept(steps: Steps, every: Any) -> int:
    """Return how many steps are made for each one that is kept."""
    return min(count("every", every), steps.count if steps.control is None else MOST_STEPS)


def threads_of(value: Any) -> int:
    """Return a number of threads: as many as there are processors, or fewer."""
    most = processors()
    return most if value is None else min(count("threads", value), most)


def processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
