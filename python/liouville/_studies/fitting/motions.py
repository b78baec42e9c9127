"""Measured motions: what is given of each, and its run with some values of the unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._methods import Method
from liouville._runs.execute import finished
from liouville._runs.integrate import integrate
from liouville._runs.tangents import PARAMS
from liouville._solution.solution import Solution
from liouville._studies.fitting.freedoms import FreeStart, consistent, movable, started
from liouville._studies.fitting.measurements import EVEN, Measurements, System
from liouville._studies.fitting.observed import Observed
from liouville._studies.fitting.unknowns import Unknowns
from liouville.analysis.point import Array

#: A measurement is at the time of an event within this part of the time of all.
MET = 1e-6


@dataclass(frozen=True)
class Trial:
    """One measured motion of several that :func:`liouville.fit` takes together.

    Attributes
    ----------
    data : mapping of str to array_like, DataFrame, or Dataset
        Times and measurements, as the `data` of ``fit``.
    start : mapping of str to array_like
        The start by the system's names, or a guess of what is free of it.
    params : mapping of str to array_like
        Values of parameters in this trial, such as the samples of an input; none that is fitted.
    t0 : float, optional
        Time of the start, before the first measurement or, by default, at it.
    sigma : float or mapping, optional
        Standard deviations in this trial; by default those of the fit.
    """

    data: Any
    start: Mapping[str, Any] = field(default_factory=dict)
    params: Mapping[str, Any] = field(default_factory=dict)
    t0: float | None = None
    sigma: Any = None


@dataclass(frozen=True)
class Model:
    """The system and the settings of its runs, in common to all trials.

    Attributes
    ----------
    system : Mechanics, SemiExplicit or Field
        What moves.
    method : Method
        How it is integrated.
    unknowns : Unknowns
        What is fitted.
    observed : Observed
        What may be measured.
    steps, options : dict
        The largest step or the tolerance, and further arguments of ``integrate``.
    """

    system: System
    method: Method
    unknowns: Unknowns
    observed: Observed
    steps: dict[str, float]
    options: dict[str, Any]

    def run(
        self, params: Mapping[str, Any], times: Mapping[str, Any], start: Mapping[str, Any]
    ) -> Solution:
        """Return a run that is not cut short.

        Raises
        ------
        IntegrationError
            A step fails, or an event ends the run before its last time.
        """
        run = finished(integrate(self.system, self.method, params=params, **times, **start))
        begin, end = times["t"]
        if abs(end - run.t[-1]) > EVEN * (end - begin):
            sentence = f"the motion ends before t = {end:g}, which was measured: {run.message}"
            hint = "leave out later measurements, begin nearer, or take events that end no run"
            raise IntegrationError(hinted(sentence, hint), t=float(run.t[-1]), solution=run)
        return run

    def columns(self, run: Solution, params: Mapping[str, Any]) -> Array:
        """Return all that may be measured of a run, shape (k, w)."""
        return self.observed.of(run, self.system.values(params))


class Motion:
    """One trial: its measurements, its start, and its last run."""

    #: The last run, its parameters, and its tangents.
    solution: Solution
    params: dict[str, Any]
    tangents: dict[str, Any]

    def __init__(self, model: Model, trial: Trial, sigma: Any) -> None:
        self.model, system = model, model.system
        self.data = Measurements(
            model.observed.places, trial.data, sigma, trial.t0, model.steps,
            keeps_more=getattr(system, "contacts", None) is not None,
        )  # fmt: skip
        self.own = dict(trial.params)
        system.values(self.own)  # refuses names and shapes
        for name in self.own:
            if name in model.unknowns.fitted:
                raise ValueError(f"a trial gives '{name}', which is fitted to all trials")
        self.given = started(system, trial.start)
        self.is_there = self.data.is_there
        self.start: dict[str, Array] = {}
        self.guessed: Array | None = None

    def begin(self, params: Mapping[str, Any]) -> None:
        """Move the start that was given onto its constraints."""
        params = {**params, **self.own}
        self.start = consistent(self.model.system, self.data.t0, params, self.given)

    def settle(self, params: Mapping[str, Any]) -> int:
        """Free the start where it is now, and return in how many directions."""
        system, t, free = self.model.system, self.data.t0, self.model.unknowns.free
        params = {**params, **self.own}
        self.place = FreeStart.of(system, t, self.given, self.start, params, free)
        return int(self.place.basis.shape[1])

    def go(self, params: Mapping[str, Any], along: Array) -> None:
        """Run with these parameters, and the start moved so far along each of its directions."""
        fitted, params = self.model.unknowns.fitted, {**params, **self.own}
        start = {**self.place.moved(along, params)}
        tangents: dict[str, Any] = {
            PARAMS + name: 1.0 if np.ndim(params[name]) == 0 else np.eye(np.size(params[name]))
            for name in fitted
        }
        if fitted or along.size:
            tangents |= self.place.tangents(along, params, fitted, start)
        times = {**self.data.run, **self.model.options}
        times |= {"tangents": tangents} if tangents else {}
        run = self.model.run(params, times, start)
        self.solution, self.params, self.start, self.tangents = run, params, start, tangents
        if self.guessed is None:
            self.guessed = np.abs(self.model.columns(run, params)[0])

    @property
    def seen(self) -> Array:
        """All that may be measured at the times of the measurements, shape (k, w)."""
        return self.model.columns(self.solution, self.params)[self.data.first :]

    def values(self) -> Array:
        """Return the measurements in units of the weights."""
        found: Array = self.data.values / self.data.weights
        return found

    def residuals(self) -> Array:
        """Return computed minus measured values of the last run, in units of the weights."""
        found: Array = ((self.seen - self.data.values) / self.data.weights)[self.is_there]
        return found

    def jacobian(self) -> Array:
        """Return derivatives of the residuals by parameters, then by directions of the start."""
        slopes = self.slopes(self.solution)[self.data.first :] / self.data.weights[:, None]
        found: Array = np.moveaxis(slopes, 1, 2)[self.is_there]
        if not np.isfinite(found).all():
            raise ValueError(self._without_slope(slopes))
        return found

    def _without_slope(self, slopes: Array) -> str:
        """Say which quantity has no derivative, and when."""
        is_bad = (~np.isfinite(slopes)).any(axis=1) & self.is_there
        row, column = np.argwhere(is_bad)[0].tolist()
        name = self.model.observed.labels[column]
        if name in self.model.system.places.get("lam", ()):
            return "multipliers of redundant constraints have no derivatives to fit by"
        sentence = f"'{name}' has no derivative at t = {self.data.t[row]:g} to fit by"
        return hinted(sentence, "write a function that is smooth there, or leave that time out")

    def slopes(self, run: Solution) -> Array:
        """Return derivatives of all records of a run, shape (k, K + L, w)."""
        states = self._changes(run)
        values = self.model.system.values(self.params)
        directions = next(iter(states.values())).shape[1]
        return self.model.observed.slopes(
            run, values, states, self.model.unknowns.directions(values.size, directions)
        )

    def _changes(self, run: Solution) -> dict[str, Array]:
        """Return derivatives of all states of a run by name, shape (k, K + L, n)."""
        own = [PARAMS + name for name in self.model.unknowns.fitted]
        states: dict[str, Array] = {}
        for state in next(iter(run.tangents.values())).states:
            each = {x: _stacked(tangent.states[state]) for x, tangent in run.tangents.items()}
            # a direction of both states is the sum of its parts, as is what parameters do to it
            total: Any = sum(each[name] for name in movable(self.model.system))
            if own:
                rows = np.concatenate([each[name] for name in own], axis=1)
                total[:, : rows.shape[1]] += rows
            states[state] = total
        return states

    def slopes_of_start(self) -> Array:
        """Return derivatives of all states of the start by all unknowns, shape (w, K + L).

        Parameters in constraints move it too.
        """
        times = {**self.data.first_step, **self.model.options, "tangents": self.tangents}
        run = self.model.run(self.params, times, self.start)
        width = sum(len(self.given[name]) for name in self.model.system.states)
        found: Array = self.slopes(run)[0, :, :width].T
        return found

    def moved_by_finer_steps(self) -> Array:
        """Return how far the residuals move with half the step; IntegrationError if none is."""
        half = self.model.run(self.params, {**self.data.finer, **self.model.options}, self.start)
        change = self.model.columns(half, self.params)[self.data.first :] - self.seen
        found: Array = (change / self.data.weights)[self.is_there]
        return found

    def met(self) -> tuple[str, float] | None:
        """Return an event or a contact that is met, or changes, at the time of a measurement."""
        run, found = self.solution, list[tuple[str, float]]()
        found += [(name, t) for name, x in run.events.items() for t in x.t.tolist()]
        found += [(name, x.t) for name, own in run.contacts.items() for x in own.changes]
        near = MET * (self.data.t[-1] - self.data.t0)
        times = self.data.t[self.is_there.any(axis=1)]
        return next((x for x in found if (np.abs(times - x[1]) <= near).any()), None)

    def sizes(self) -> Array:
        """Return how large what was measured is, in units of the weights."""
        found: Array = (np.abs(self.seen) / self.data.weights)[self.is_there]
        return found

    def sizes_of_guess(self) -> Array:
        """Return the same with what the start of the guess had."""
        found: Array = ((np.abs(self.seen) + self.guessed) / self.data.weights)[self.is_there]
        return found

    def along(self) -> Array:
        """Return how much each direction changes the motion, as a part of the largest of a state.

        Positions and velocities have units of their own, and one of them may be zero, or roundoff
        of it, all along: the state counts that changes by the smaller part.
        """
        count, parts = self.place.basis.shape[1], []
        for name, change in self._changes(self.solution).items() if count else ():
            largest = np.abs(self.solution.states[name]).max(initial=0.0)
            if name in self.model.system.states and largest > 0:
                sizes = np.linalg.norm(change[:, change.shape[1] - count :], axis=2)
                parts.append(sizes.max(axis=0) / largest)
        found: Array = np.min(parts, axis=0) if parts else np.zeros(count)
        return found

    @property
    def measured(self) -> tuple[Array, tuple[str, ...]]:
        """The time of each residual, and what it is of."""
        rows, columns = np.nonzero(self.is_there)
        names = self.model.observed.labels
        return self.data.t[rows], tuple(names[k] for k in columns.tolist())

    @property
    def until(self) -> Array:
        """The parts of its time at which each measurement was made, from 0 to 1."""
        part = (self.data.t - self.data.t0) / (self.data.t[-1] - self.data.t0)
        found: Array = np.broadcast_to(part[:, None], self.data.values.shape)
        return found


def _stacked(rows: Array) -> Array:
    """Return tangents with an axis of directions, shape (k, d, n)."""
    return rows if rows.ndim == 3 else rows[:, None]
