"""Derivatives of runs of fields: by their start, by parameters, and by the ends of the time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics.errors import IntegrationError, hinted
from liouville._methods.control import Steps
from liouville._methods.splitting import PlaneSplit, to_core
from liouville._methods.splitting.coefficients import (
    coefficients,
    derivative,
    is_like,
    moved_by,
    of_parameter,
)
from liouville._runs.adjoint import EVENTS, Adjoint, Gradients
from liouville._runs.execute import Checkpoints, execute, finished
from liouville._runs.kinks import Kinks
from liouville._runs.runner import Request
from liouville._runs.tangents import PARAMS, Directions, check_names, places_of
from liouville._solution.points import Points
from liouville._solution.solution import Solution
from liouville._solution.tangents import Moves, Tangent
from liouville._systems import Field, PolynomialField

if TYPE_CHECKING:
    from liouville._runs.fields.field import FieldRunner


#: The coefficient of a term that is absent.
ABSENT = 1e-200

#: A time that exceeds the end of a step by this part of it, from roundoff, is of that step.
ROUNDOFF = 1e-9


class FieldDirections(Directions):
    """Directions of a run of a field.

    Attributes
    ----------
    tau : ndarray, shape (count, 1 + P)
        Changes of the start time and of the P parameters.
    stretch : ndarray, shape (count,)
        By which part of themselves the steps become longer.
    """

    def __init__(self, system: Field, tangents: Any, steps: Steps, *, has_times: bool) -> None:
        hint = 'write tangents={"x": direction} or {"params.name": 1.0}'
        super().__init__(tangents, places_of(system), {"x": system.coordinates}, hint)
        self.x, self.tau, end = np.split(self.rows, (len(system.coordinates), -1), axis=1)
        self._longer = end - self.tau[:, :1]
        self.stretch = self._longer[:, 0] / (steps.t1 - steps.t0)
        self.moves = Moves(
            self.tau[:, 1:], self.tau[:, 0], self.stretch, steps.t0, holds_times=has_times
        )

    def to_core(self, runner: FieldRunner) -> np.ndarray:
        """Return the changes of what is stepped, and of coefficients, the step and t0, if any are.

        The variables, of which the time may be one, come first, as the core wants them. Where
        there are events, the last direction is that of the time in parts of steps alone: along it
        the start of a part moves back.
        """
        t0, params = self.tau[:, :1], self.tau[:, 1:].copy()
        held = [*runner.system.held]
        start = np.hstack([self.x, t0[:, : runner.system.is_driven], params[:, held]])
        params[:, held] = 0.0
        rows = np.ascontiguousarray(runner.split.inward(start))
        has_events = runner.has_events
        if not (self.tau.any() or self._longer.any() or has_events):
            return rows
        changes = np.zeros((self.count, coefficients(runner.split).size))
        for number in np.flatnonzero(params.any(axis=0)).tolist():
            changes += np.outer(params[:, number], by_parameter(runner, number))
        found = np.hstack([rows, changes, self._longer / runner.steps.count, t0])
        if has_events:
            found = np.vstack([found, np.zeros_like(found[:1])])
            found[-1, -1] = -1.0
        return found

    def read(self, t: np.ndarray, rows: np.ndarray, runner: FieldRunner) -> dict[str, Tangent]:
        """Name the columns of tangents in records at times t, and derivatives of events.

        A last record where an event has ended a run moves with that.
        """
        n = self.x.shape[1]
        rows = np.array(rows[..., : self.count * n])
        params = np.ascontiguousarray(self.tau[:, 1:])
        moved = {name: hits.moved(name, params) for name, hits in runner.hits.items()}
        for member, name in runner.endings.items() if runner.given_times is None else ():
            points, own = moved[name], slice(None)
            if "member" in points.states:
                own = points.member == member
            at = runner.hits[name].points.t[own]
            place = (np.flatnonzero(t == at[-1]), *((member,) if rows.ndim > 2 else ()))
            rows[place] = points.x[own][-1].ravel()
        found = self.named(rows, {"x": slice(None)})
        first = 0
        for name, tangent in found.items():
            shape = self._shapes[name]
            last = first + int(np.prod(shape))
            for event, points in moved.items():
                of_t, of_x = points.t[:, first:last], points.x[:, first:last]
                if not shape:
                    of_t, of_x = of_t[:, 0], of_x[:, 0]
                tangent.events[event] = Points(of_t, {**points.states, "x": of_x})
            first = last
        return found


def differentiable(system: Field, names: Iterable[str]) -> Field:
    """Return a field that has derivatives by the parameters among these directions.

    A term whose factor is 0 is in no piece, which then has no derivative by it. It gets a
    coefficient far below the roundoff of any sum, if other values of the parameter make just it.
    A parameter that is in more than coefficients becomes a variable, which is at rest. With the
    pieces of either, states differ from those without by the error of the method.
    """
    if not isinstance(system, PolynomialField):
        return system
    first = len(system.coordinates) + 1
    places, held = places_of(system), [*system.held]
    for name in [name for name in names if name.startswith(PARAMS) and name in places]:
        place, shape = places[name]
        for number in range(place - first, place - first + int(np.prod(shape))):
            values = system.values(None)
            if number in held:
                continue
            if values[number] == 0:
                system = _with_terms_of_zero(system, values, number)
            if not _is_of_coefficients(system, number):
                held.append(number)
    try:
        return system.holding(held) if len(held) > len(system.held) else system
    except ValueError:  # which is refused where derivatives by it are looked for
        return system


def _is_of_coefficients(system: PolynomialField, number: int) -> bool:
    """Return whether a parameter changes coefficients of a field's terms, and nothing else."""
    try:
        change = system.by_parameter(number)
    except ValueError:
        return False
    if not len(change):  # its square may be a coefficient
        return not system.depends_on(number)
    return moved_by(system.terms, change) is not None


def _with_terms_of_zero(
    system: PolynomialField, values: np.ndarray, number: int
) -> PolynomialField:
    """Return a field with the terms that one parameter's number, which is 0, takes from it."""
    values[number] = 1.0
    try:
        change = system.by_parameter(number).to_float()
        other = system.with_params(values).terms
    except ValueError:  # there is no such derivative, or no such field
        return system
    added = change.scaled(ABSENT)
    found = copy(system)
    found.terms, found._kept = system.terms.to_float().joined(added).merged(), {}
    is_term = len(found.terms) > len(system.terms) and is_like(other, found.terms)
    return found if is_term else system


def by_parameter(runner: FieldRunner, number: int) -> np.ndarray:
    """Return the derivatives of all coefficients of the pieces by one of the parameters' numbers.

    Raises
    ------
    ValueError
        The parameter is in more than the coefficients of the field's terms, and is none of its
        variables.
    """
    system, plan, parts = runner.system, runner.choice, runner.split
    if isinstance(parts, PlaneSplit):
        return of_parameter(parts, number)
    assert isinstance(system, PolynomialField)
    # a run with tangents that is made beside a pullback has the same
    known: dict[int, np.ndarray] = system.kept(("by parameter", plan), dict)
    if number in known:
        return known[number]
    try:
        change = system.by_parameter(number)
    except ValueError:
        change = None
    found = None
    if change is not None:
        found = derivative(
            parts, lambda terms: plan.split(terms, system.variables), system.terms, change
        )
    if found is not None:
        known[number] = found
        return found
    first = np.cumsum([np.size(value) for value in system.params.values()])
    name = [*system.params][int(np.searchsorted(first, number, side="right"))]
    sentence = (
        f"'{PARAMS}{name}' changes the form of the field's pieces, and a splitting has no "
        "derivatives by it"
    )
    hint = "so does the wave number of a wave of a component's own coordinate"
    raise ValueError(hinted(sentence, hint))


class FieldAdjoint(Adjoint):
    """The transposed derivative of a run of a field; see :class:`Adjoint`."""

    runner: FieldRunner
    checkpoints: Checkpoints

    def __init__(self, runner: FieldRunner, request: Request, wrt: Any) -> None:
        self.runner, self._request = runner, request
        self._places = places_of(runner.system)
        names = check_names(wrt, self._places, "x")
        self.directions = {name: (self._places[name][1], False) for name in names}
        self.checkpoints = Checkpoints(runner.steps.count)
        self._timed: FieldRunner | None = None
        # before the run: what has no derivative is refused
        n = len(runner.system.coordinates)
        self._by_number = {
            place: by_parameter(runner, place - n - 1)
            for name in names
            if name.startswith(PARAMS)
            for place in self._range(name)
            if place - n - 1 not in runner.system.held
        }
        self._look()

    def of(self, runner: FieldRunner) -> FieldAdjoint:
        """Return that of another run of the same field, split in the same way."""
        own = copy(self)
        own.runner, own.checkpoints = runner, Checkpoints(runner.steps.count)
        own._look()
        return own

    def _look(self) -> None:
        runner = self.runner
        if runner.has_events:  # a run with tangents tells how states move at events
            still = {"x": np.zeros(len(runner.system.coordinates))}
            alone = replace(self._alone, tangents=still, every=runner.steps.count, t_eval=None)
            self._timed = type(runner)(runner.system, runner.choice, alone)
        shapes = {name: shape for name, (shape, _) in self.directions.items()}
        self.kinks = Kinks.of(self.runner, self._alone, shapes)

    @property
    def _alone(self) -> Request:
        """The request of this run alone, which may be that of a member, with its equal steps."""
        runner = self.runner
        return replace(
            self._request, params=runner.system.params, steps=runner.steps.count, h=None,
            start={"x": runner.x[0, : len(runner.system.coordinates)]}, rtol=None, atol=None,
            control=None, has_pullback=False, is_ensemble=False,
        )  # fmt: skip

    def _range(self, name: str) -> range:
        first, shape = self._places[name]
        return range(first, first + int(np.prod(shape)))

    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shapes of what has cotangents: records, and times and states of events."""
        found: dict[str, tuple[int, ...]] = {"x": solution.states["x"].shape}
        for name, points in solution.events.items():
            found |= {f"{EVENTS}{name}.t": points.t.shape, f"{EVENTS}{name}.x": points.x.shape}
        return found

    def _held(
        self, solution: Solution, cotangents: Mapping[str, np.ndarray]
    ) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
        """Return times with cotangents of the states there, which are held, and of parameters.

        The state that an event has ended the run with is that of its last hit.
        """
        runner, rows = self.runner, cotangents["x"]
        times, held = [], []
        params = np.zeros(runner.system.values(None).size)
        given = runner.given_times
        if given is not None:
            times, held = [solution.t], [rows]
        if self._timed is None:
            return times, held, params
        last = runner.ending if given is None else None
        if last is None and not any(cotangents[x].any() for x in cotangents if x != "x"):
            return times, held, params
        finished(execute(self._timed))
        for name, hits in self._timed.hits.items():
            t, x = (np.array(cotangents[f"{EVENTS}{name}.{x}"]) for x in "tx")
            if name == last:
                x[-1] += rows[-1]
            x, of_params = hits.pulled(name, t, x)
            times, held, params = [*times, hits.points.t], [*held, x], params + of_params
        return times, held, params

    def pulled(self, solution: Solution, cotangents: Mapping[str, np.ndarray]) -> Gradients:
        """Return gradients from cotangents of x; see :class:`Adjoint`."""
        runner, rows = self.runner, cotangents["x"]
        steps, split = runner.steps.count, runner.split
        h = runner.steps.mean(runner.steps.t1, steps)
        core = _core.FieldPullback(to_core(split), runner.choice.method, runner.job)
        parts, of_parts, of_params = self._held(solution, cotangents)
        times, held = np.concatenate([np.empty(0), *parts]), np.vstack([rows[:0], *of_parts])
        order = np.argsort(times / h, kind="stable")
        times, held = times[order], held[order]
        # the step that each time is in, as the core looks at them
        within = np.ceil((times - runner.steps.t0) / h - ROUNDOFF).astype(int).clip(1, steps)
        # a last record where an event has ended the run is none of a step's end
        many = 0 if runner.given_times is not None else len(rows) - (runner.ending is not None)
        kept, at_ends = np.minimum(np.arange(many) * runner.every, steps), rows[:many]
        seen = kept[at_ends.any(axis=1)], within[held.any(axis=1)]
        last_seen = int(np.max(np.concatenate(seen), initial=0))
        self.check(last_seen)
        for first, last, saved in self.checkpoints.reversed(max(last_seen, 1)):
            own, inside = ((first < x) & (x <= last) for x in (kept, within))
            error = core.follow(
                saved, last, (kept[own], np.ascontiguousarray(at_ends[own])),
                (times[inside], np.ascontiguousarray(held[inside])),
            )  # fmt: skip
            if error is not None:
                sentence, hint, quantity = runner.describe(error)
                raise IntegrationError(hinted(sentence, hint), quantity=quantity)
        found = core.end(np.ascontiguousarray(at_ends[0]) if many else np.zeros(rows.shape[1]))
        start, changes, end = found[: split.n], found[split.n : -2], found[-2] / steps
        inverse = getattr(split, "inverse", None)
        if inverse is not None:
            start = np.asarray(inverse, dtype=float).T @ start
        system, n = runner.system, len(runner.system.coordinates)
        whole = np.zeros(max(first + int(np.prod(s)) for first, s in self._places.values()))
        moving = n + system.is_driven
        whole[:moving] = start[:moving]
        whole[[n + 1 + number for number in system.held]] = start[moving:]
        whole[n] += found[-1] - end
        whole[-1] = end
        for place, by in self._by_number.items():
            whole[place] = by @ changes
        whole[n + 1 : -1] += of_params
        gradients: Gradients = {}
        for name, (shape, _) in self.directions.items():
            part = whole[self._range(name)].reshape(shape)
            gradients[name] = part if shape else float(part)
        return gradients

    def moved(self, directions: Mapping[str, np.ndarray], size: float) -> Mapping[str, np.ndarray]:
        """Return the states of the run, moved by so much of all directions, as planned before."""
        runner, alone = self.runner, self._alone
        values: dict[str, Any] = dict(runner.system.params)
        for name, x in directions.items():
            if name.startswith(PARAMS):
                which = name.removeprefix(PARAMS)
                values[which] = np.asarray(values[which]) + size * x
        x = alone.start["x"] + size * directions.get("x", np.zeros(()))
        ends = [
            float(end + size * directions.get(name, np.zeros(())))
            for name, end in (("t0", runner.steps.t0), ("t1", runner.steps.t1))
        ]
        moved = replace(alone, t=tuple(ends), params=values, start={"x": x})
        return finished(execute(type(runner)(runner.system, runner.choice, moved))).states
