"""The base of runs that have events, given times and controls of their steps."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from liouville import _core
from liouville._basics.arguments import MOST_STEPS
from liouville._basics.faults import Description
from liouville._basics.job import AlphaTransposed, Job, Sensitivity
from liouville._methods import Composition, Method
from liouville._methods.control import CONTROLS, LEAST_TOLERANCE, Reversible, Takes
from liouville._runs.edges import jump_along
from liouville._runs.runner import Request, Runner, kept
from liouville._runs.watch import Watch, initial_of
from liouville._solution.points import Points
from liouville._systems import Mechanics, SemiExplicit
from liouville._systems.mechanics.branches import branches
from liouville._systems.mechanics.traced import HALF_TURN

if TYPE_CHECKING:
    from liouville._runs.adjoint import Adjoint
    from liouville._runs.tangents import ConstrainedDirections
    from liouville._solution.solution import Solution
    from liouville._systems.derivatives.sensitivity import Cotangents


@lru_cache
def method_repr(method: Method) -> str:
    """Return the repr of a method."""
    return repr(method)


@lru_cache
def takes_of(method: Method, estimators: str) -> Takes:
    """Return the controls of the steps that a method of the general form takes."""
    has = {
        "error": not isinstance(method, Composition),
        "reversible": getattr(method, "is_symmetric", True),
    }
    controls = tuple(kind for kind in CONTROLS if has[kind])
    name = type(method).__name__
    return Takes(name, controls, LEAST_TOLERANCE / 100, estimators=estimators)


class TracedRunner(Runner):
    """Runs a system of expressions that move on constraints; see :class:`Runner`."""

    #: Methods for such a system that estimate their errors.
    estimators = "Spark"

    system: Mechanics | SemiExplicit
    choice: Method
    _rows: np.ndarray

    def __init__(self, system: Mechanics | SemiExplicit, method: Method, request: Request) -> None:
        self.system, self.choice, self.method = system, method, method_repr(method)
        self.constraints = system.constraints
        self.steps = request.steps_of(system, self._controls_taken())
        self._is_atol_default = request.atol is None
        self._control = None if self.steps.control is None else self.steps.control[0]
        self._monitor = None
        if isinstance(request.control, Reversible):
            self._monitor = self._monitored(request.control)
        self._is_differentiated = request.tangents is not None or request.has_pullback
        self._problem = self._form()
        self.every = kept(self.steps, request.every)
        self._order = int(getattr(method, "order", 0))
        span = (self.steps.t0, self.steps.t1)
        self._watch = Watch(request.events, request.t_eval, span, self.every)
        self._watched = request.watched or self._watch.to_core(
            system, self._order, self.switches, self._is_differentiated
        )
        self._take(request)
        self.params = {**system.params, **(request.params or {})}
        self._states = request.states
        self._observer, self.widths = system.observer(request.observe, request.states)
        self.columns = {**self._own_columns(), **self.widths}
        if request.states:
            self.columns |= dict.fromkeys((f"angle {name}" for name in system.turned), 1)
        self._check_sizes(request)
        self._directions: ConstrainedDirections | None = None
        self._parts: list[tuple[float, float, int]] = []
        self._held: np.ndarray | None = None
        #: Tangents at events, by their names.
        self._moved_events: dict[str, tuple[np.ndarray, np.ndarray | None]] = {}

    def remark(self, run: _core.Run, t: np.ndarray, rows: np.ndarray) -> str:
        """Return sentences on a run that cannot be right; empty where there is none."""
        said = super().remark(run, t, rows)
        return "; ".join(filter(None, [said, self._half_turns(t, rows)]))

    def _half_turns(self, t: np.ndarray, rows: np.ndarray) -> str:
        """Say where the first spring of a ball joint changes sides, if steps do not end there."""
        tapes, n = self.system.switch_tapes, len(self.system.coordinates)
        springs = [name for name in tapes if name.startswith(HALF_TURN)]
        if not springs or self._sees_switches or not self._states or not np.isfinite(t).all():
            return ""
        found, each = [], np.moveaxis(rows.reshape(len(t), -1, rows.shape[-1])[..., :n], 1, 0)
        for name in springs:
            tape = tapes[name]
            others = [np.zeros((len(t), size)) for size in tape.inputs[2:-1]]
            for k, y in enumerate(each):
                params = np.atleast_2d(self._each_values)
                args = [t[:, None], np.ascontiguousarray(y), *others]
                side = tape.map(params[k % len(params)], args)[:, 0]
                turned = np.flatnonzero(side[1:] * side[:-1] < 0)
                if turned.size:
                    member = f" of member {k}" if self.members else ""
                    joint = f"joint '{name.removeprefix(HALF_TURN)}'{member}"
                    found.append((turned[0], joint))
        if not found:
            return ""
        k, joint = min(found)
        return (
            f"{joint} passes half a turn between t = {t[k]:g} and {t[k + 1]:g}, where its spring "
            "changes sides: steps lose their order there, but for those of Spark with rtol="
        )

    def jump_along(self, places: Sequence[tuple[float, np.ndarray]]) -> str | None:
        """Return the function with which the equations jump at all of these steps."""
        if (found := branches(self.system)) is None:
            return None
        w = np.array([self._point(t, place)[0] for t, place in places])
        control, states = self.steps.control, sum(x.shape[-1] for x in self._begin[:2])
        off = np.zeros(w.shape[1])
        if control is not None and control[0] == "error":
            off[1 : 1 + states] = control[2][0]  # atol
        return jump_along(found, w, off)

    def _point(self, t: float, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return time, states, multipliers and parameters at a place of a run, and their rates."""
        states = sum(x.shape[-1] for x in self._begin[:2])
        own, rates = np.split(place, [len(place) - states])
        w = np.concatenate([[t], own, np.atleast_2d(self._each_values)[0]])
        moved = np.zeros(len(w))
        moved[: 1 + states] = [1.0, *rates]
        return w, moved

    def _controls_taken(self) -> Takes:
        """Return the controls of the steps that the method takes."""
        return takes_of(self.choice, self.estimators)

    @abstractmethod
    def _form(self) -> _core.Mechanical | _core.SecondOrder | _core.Separable | _core.SemiExplicit:
        """Return the system in the form that the method steps."""

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""
        return _core.run(self._problem, self.choice, self._job())

    def _job(self) -> Job:
        """Return the run as the core begins it."""
        steps, control = self.steps, cast("Any", self._held)
        if control is None and steps.control is not None:
            monitor = (self._monitor,) if self._control == "reversible" else ()
            control = (*steps.control[1:], *monitor)
        job = Job(
            start=self._begin, span=(steps.t0, steps.t1, steps.count, self.every),
            observer=self._observer, params=self._values, states=self._states,
            control=control, watch=self._watched, is_differentiated=self._is_differentiated,
        )  # fmt: skip
        if self._states:
            job.turning = self.system.turning
        if self._parts:
            job.parts, job.is_ensemble, job.params = self._parts, True, self._values[None]
        return job

    def hold(self, ends: np.ndarray) -> None:
        """Take the steps from the first of these times to the next ones, whatever their errors."""
        self._held = ends

    def take_parts(
        self, starts: tuple[np.ndarray, ...], parts: list[tuple[float, float, int]], times: Any
    ) -> None:
        """Take parts of steps from other starts, a row for each, in the place of the run.

        Of each part the start is given, the end, and how many of the times are in it.
        """
        self._begin, self._parts = starts, parts
        self._watched = (self._order, np.ascontiguousarray(times), [])

    def _set_directions(self, request: Request) -> None:
        """Take the directions of tangents, if any are wanted, which each record has columns for."""
        if request.tangents is None:
            return
        # imported here: few runs have tangents
        from liouville._runs.tangents import ConstrainedDirections

        has_times = request.t_eval is not None
        found = ConstrainedDirections(
            self.system, request.tangents, self.steps, has_times=has_times
        )
        wide = sum(x.shape[-1] for x in self._begin[:2]) + self.multipliers
        self.columns["tangents"] = found.count * wide
        self._check_sizes(request)
        self._directions = found

    def adjoint(self, request: Request, wrt: Any) -> Adjoint:
        """Return the transposed derivative of the run by what `wrt` names, before it begins."""
        # imported here: few runs are differentiated
        from liouville._runs.mechanics.adjoint import ConstrainedAdjoint

        return ConstrainedAdjoint(self, request, wrt)

    def recorder(self) -> _core.Pullback | dict[str, Any] | None:
        """Return the pullback that records the run, unless events or given times part equal steps.

        Controlled ones follow the errors of tangents, which the run of a pullback alone has.
        """
        is_plain = self.parts_steps and self._control != "error"
        return None if is_plain else self.pullback(self.every)

    @property
    def parts_steps(self) -> bool:
        """Whether events or given times part steps, which a pullback then repeats."""
        return self._watched is not None

    def pullback(self, every: int = MOST_STEPS) -> _core.Pullback | dict[str, Any]:
        """Return the pullback of the run in the core, or the error of its start.

        The run itself keeps one state in `every`, and its start alone by default.
        """
        job, steps = self._job(), self.steps
        job.span = (steps.t0, steps.t1, steps.count, every)
        assert not isinstance(self._problem, _core.Separable)
        return _core.pullback(self._problem, self.choice, job, *self.sensitivity())

    @abstractmethod
    def sensitivity(self) -> tuple[Sensitivity, AlphaTransposed | None]:
        """Return derivatives by time and parameters, and those of a step of the alpha family."""

    def moved_along(self, directions: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the change of the start along the sum of directions, on the constraints."""
        # imported here: few runs are differentiated
        from liouville._runs.tangents import ConstrainedDirections

        own, (y, z) = ConstrainedDirections(self.system, directions, self.steps), self._begin[:2]
        dy, dz = own.starts(self._differentiated_system, self.steps.t0, y, z, self._values)
        return dy.sum(axis=0), dz.sum(axis=0)

    @property
    def _differentiated_system(self) -> Mechanics | SemiExplicit:
        """The system whose constraints the start is on, none of which follows from others."""
        return self.system

    @abstractmethod
    def pulled_start(self, found: Cotangents) -> Cotangents:
        """Return cotangents of a start that is moved onto the constraints, from those there."""

    @property
    def times(self) -> np.ndarray | None:
        """The times of the records, where they are given."""
        return self._watch.times

    @property
    def multipliers(self) -> int:
        """How many multipliers beside y and z the equations of a step have."""
        return 0

    @property
    def shares_multipliers(self) -> bool:
        """Whether multipliers of redundant constraints are differentiated."""
        return False

    def pulled_multipliers(
        self, solution: Solution, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Return cotangents of (y, z, lam) with the multipliers of a step, of tau and of stretch.

        `rows` have all multipliers, where some constraints imply others. The last is that of the
        last time where an event has ended the run.
        """
        del solution
        return rows, np.zeros(0), 0.0, 0.0

    @property
    def dense_order(self) -> int:
        """The order of the method, where the states of all steps are kept, else 0."""
        is_whole = self.every == 1 and self._watch.times is None and self._states
        return self._order if is_whole else 0

    @property
    def initial(self) -> dict[str, Any]:
        """The invariants at the start, where no record is kept of it; see :class:`Solution`."""
        times = self._watch.times
        return {} if times is None or times[0] == self.steps.t0 else self._initial

    @cached_property
    def _initial(self) -> dict[str, Any]:
        t0 = self.steps.t0
        each, rows = np.atleast_2d(self._each_values), []
        tape, widths = self.system.observer(None, self._states)
        starts = zip(*(np.atleast_2d(x) for x in self._begin[:2]), strict=True)
        for k, (y, z) in enumerate(starts):
            values = each[k % len(each)]
            args = [np.array([[t0]]), y[None], self._first_z(y, z, values)[None]]
            rows.append(tape.map(values, args)[0])
        return initial_of(np.array(rows), widths, self.system.invariants, bool(self.members))

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run that this method has."""
        done, foreign = run.done, self._unused_stats()
        if not done:
            foreign |= {"h_smallest", "h_largest"}
        found: dict[str, Any] = {"steps": done, **run.stats}
        for name in foreign:
            found.pop(name, None)
        return found

    def _unused_stats(self) -> set[str]:
        """Return the numbers of a run of the core that mean nothing here."""
        return {"schur_steps"} | (set() if self._control == "error" else {"rejected"})

    def events(self, run: _core.Run) -> tuple[dict[str, Points], dict[int, str]]:
        """Return the events met, by name, and a sentence on each that ended a run, by member."""
        if self._watched is None:
            return {}, {}
        found, said, self._moved_events = self._watch.events_of(
            run, self.system, self._each_values, self._event_width
        )
        return found, said

    @property
    def _each_values(self) -> np.ndarray:
        """The values of all parameters, of an ensemble a row for each member or one for all."""
        return self._values

    @property
    def _event_width(self) -> int:
        """How many numbers of tangents come behind each state of an event."""
        if self._directions is None:
            return 0
        wide: int = 1 + sum(x.shape[-1] for x in self._begin[:2]) + self.multipliers
        return self._directions.count * wide

    def _monitored(self, control: Reversible) -> tuple[_core.Tape, bool] | None:
        """Return the monitor that the steps follow, None for one that the core has."""
        return None if control.monitor is None else self.system.monitor(control.monitor)

    def _take(self, request: Request) -> None:
        """Take parameters and start values, and see that they fit together."""
        self._values = self.system.values(request.params)
        self._begin = self.system.start(request.start, self._extra_states)
        y, z = self._begin[:2]
        self.system.check(self.steps.t0, y, z, self._values, hidden=self._is_hidden_kept)

    @property
    def _sees_switches(self) -> bool:
        """Whether steps end at the switches of the system."""
        return self._control == "error"

    @property
    def switches(self) -> Mapping[str, _core.Tape]:
        """The functions of the system at whose zeros steps end."""
        return self.system.switch_tapes if self._sees_switches else {}

    @property
    def _extra_states(self) -> tuple[str, ...]:
        """Names of start values that the method has besides those of the system."""
        return ()

    @property
    def _is_hidden_kept(self) -> bool:
        """Whether the start satisfies the hidden constraints."""
        return True

    def _first_z(self, y: np.ndarray, z: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return z at a start."""
        del y, values
        return z

    def _own_columns(self) -> dict[str, int]:
        """Return the columns of the states."""
        places = self.system.places.items()
        return {name: len(names) for name, names in places} if self._states else {}

    def _described(self, error: dict[str, Any]) -> Description:
        return self._described_by(self.system, error)

    def _described_by(self, system: Mechanics | SemiExplicit, error: dict[str, Any]) -> Description:
        """Describe an error by the names of this system."""
        names = [*self._watch.events, *self.system.switch_tapes]
        if error.get("quantity") in ("event", "reset") and error["kind"] == "not finite":
            error["quantity"] += f" {names[error['index']]}"
        if error["kind"] in ("reset", "no derivative"):
            error["event"] = name = names[error["event"]]
            which = error.get("member", error.get("of", 0))
            if error["kind"] == "no derivative":
                limit = self._watch.accumulated(name, error["t"], which)
                error |= {} if limit is None else {"limit": limit}
        return system.describe(error)

    def _check_sizes(self, request: Request) -> None:
        times = self._watch.times
        count = self.steps.records(self.every) if times is None else times.size
        self._check_records(request, count)
