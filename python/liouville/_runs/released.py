"""Members of an ensemble that are released at times of their own: runs of those with one time."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import ceil
from typing import Any, cast

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, misshapen
from liouville._basics.progress import Progress, reported
from liouville._methods import Method
from liouville._runs.choice import check_system, runner_of
from liouville._runs.execute import checked, plain
from liouville._runs.fields.field import FieldRunner
from liouville._runs.runner import Request, Runner
from liouville._solution.failure import Failure, ending_of, summary_of
from liouville._solution.parts import GROUPS
from liouville._solution.points import Points, with_ends
from liouville._solution.solution import Solution
from liouville._solution.states import Stats
from liouville._solution.tangents import Tangent
from liouville._systems import Field, System

#: A release is at the end of a step where it is nearer than this part of it.
NEAR = 1e-9

Array = np.ndarray[Any, Any]


def released(
    system: System, method: Method | Any, request: Request, release: Any, progress: Progress
) -> Solution:
    """Integrate members from times of their own to the end; see :func:`liouville.ensemble`.

    Raises
    ------
    TypeError, ValueError
        The system is no field, there is no such time for each member, or as for the ensemble.
    """
    check_releases(system)
    clock = time.perf_counter()
    runner = cast(FieldRunner, runner_of(system, method, request))
    at = times_of(runner, release)
    joined = _Joined(runner, request, at)
    with reported(progress, "members") as report:
        for members in joined.groups():
            joined.run(members)
            if report is not None:
                report(joined.done, len(at))
            if joined.is_cut:
                break
    return joined.solution(time.perf_counter() - clock)


def check_releases(system: Any) -> None:
    """Refuse what is no field, whose members begin together."""
    check_system(system)
    if not isinstance(system, Field):
        sentence = f"members of {system!r} must begin together, and release= is for fields"
        raise TypeError(hinted(sentence, "integrate them one by one"))


def times_of(runner: Runner, release: Any) -> Array:
    """Return the times of release, one for each member of a field, within the run."""
    assert isinstance(runner, FieldRunner), "a run of a field"
    given = runner.system.in_time(release)
    count, (t0, t1) = runner.members[0], (runner.steps.t0, runner.steps.t1)
    values = np.asarray(given)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"release must be a time for each member, not {release!r}")
    if values.shape not in ((), (count,)):
        raise misshapen("release", values.shape, f"({count},)")
    times = with_ends(np.array(np.broadcast_to(values, count), dtype=float), t0, t1)
    h = runner.steps.mean(t1, runner.steps.count)
    places = (times - t0) / h
    is_on = np.abs(places - np.rint(places)) < NEAR
    times = np.where(is_on, t0 + h * np.rint(places), times)
    outside = np.flatnonzero(~((places >= 0) & (places < runner.steps.count - NEAR)))
    if outside.size:
        first = int(outside[0])
        sentence = f"member {first} is released at t = {times[first]:g}"
        raise ValueError(f"{sentence}, and the run goes from {t0:g} to before {t1:g}")
    return times


class _Joined:
    """The runs of members with one time of release, in their places among all.

    Attributes
    ----------
    done : int
        How many members there are.
    is_cut : bool
        Whether a run was interrupted.
    """

    def __init__(self, runner: FieldRunner, request: Request, at: Array) -> None:
        self._runner, self._request, self._at = runner, request, at
        self.done, self.is_cut = 0, False
        steps, times = runner.steps, runner.record_times
        self._h = steps.mean(steps.t1, steps.count)
        self.t = times
        self._x = runner.x[:, : len(runner.system.coordinates)]
        self._arrays: dict[str, dict[str, Array]] = {group: {} for group in GROUPS}
        self._initial: dict[str, Array] = {}
        self._events: dict[str, list[Points]] = {}
        self._tangents: dict[str, Array] = {}
        self._moved: dict[str, dict[str, list[Points]]] = {}
        self._failures: dict[int, Failure] = {}
        self._endings: dict[int, str] = {}
        self._stats: dict[str, Any] = {"steps": 0, "flows": 0, "pieces": 0}
        self._first: Solution | None = None

    def groups(self) -> Iterator[Array]:
        """Give the members of each time, in the order of the run."""
        order = np.unique(self._at)
        for r in order if self._h > 0 else order[::-1]:
            yield np.flatnonzero(self._at == r)

    def run(self, members: Array) -> None:
        """Run some members, and put them in their places."""
        steps, every, r = self._runner.steps, self._runner.every, float(self._at[members[0]])
        rows = np.flatnonzero((self.t - r) * np.sign(self._h) >= 0)
        place, own = (
            (r - steps.t0) / self._h,
            {name: self._row(name, members) for name in self._params},
        )
        made = replace(
            self._request, t=(r, steps.t1), h=None, start={"x": self._x[members]}, params=own
        )
        if self._request.t_eval is None and place == round(place) and not round(place) % every:
            made = replace(made, steps=steps.count - round(place), every=every)
        else:
            count = max(1, ceil((steps.t1 - r) / self._h - NEAR))
            made = replace(made, steps=count, every=1, t_eval=self.t[rows])
        try:
            runner = runner_of(self._runner.system, self._runner.choice, made)
            found = checked(runner, made, None)
        except IntegrationError as error:
            if error.solution is None or not error.solution.failures:
                raise
            found = error.solution
        self._put(members, rows, found)

    @property
    def _params(self) -> Mapping[str, Any]:
        return self._request.params or {}

    def _row(self, name: str, members: Array) -> Any:
        """Return a parameter of some members."""
        value = self._params[name]
        return np.asarray(value)[members] if name in self._runner.varied else value

    def _put(self, members: Array, rows: Array, found: Solution) -> None:
        self._first = self._first or found
        count = len(self._at)
        for group in GROUPS:
            for name, x in getattr(found, group).items():
                shape = (len(self.t), count, *x.shape[2:])
                all_of = self._arrays[group].setdefault(name, np.full(shape, np.nan))
                all_of[np.ix_(rows[: len(x)], members)] = x
        for name, tangent in found.tangents.items():
            x = tangent.states["x"]
            shape = (len(self.t), count, *x.shape[2:])
            all_of = self._tangents.setdefault(name, np.full(shape, np.nan))
            all_of[np.ix_(rows[: len(x)], members)] = x
            own = self._moved.setdefault(name, {})
            for event, points in tangent.events.items():
                own.setdefault(event, []).append(_numbered(points, members))
        for name, x in found.invariants.items():
            start = self._initial.setdefault(name, np.full((count, *x.shape[2:]), np.nan))
            start[members] = found.initial.get(name, x[0] if len(x) else np.nan)
        for name, points in found.events.items():
            self._events.setdefault(name, []).append(_numbered(points, members))
        self._failures |= {int(members[k]): x for k, x in found.failures.items()}
        self._endings |= {int(members[k]): x for k, x in found.endings.items()}
        for name, value in found.stats.items():
            both = self._stats.get(name, 0), cast(Any, value)
            self._stats[name] = sum(both) if name == "flows" else max(both)
        self.is_cut = found.status == "interrupted"
        self.done += len(members)

    def solution(self, seconds: float) -> Solution:
        """Return all members together; what was not reached is NaN."""
        assert self._first is not None
        runner, count = self._runner, len(self._at)
        failures = dict(sorted(self._failures.items()))
        status, said = ending_of(failures, count), summary_of(failures, count)
        if self.is_cut:
            status, said = "interrupted", f"interrupted when {self.done} of {count} had begun"
        x = self._arrays["states"].get("x", np.empty((0, count, 0)))
        remark = runner.remark_on(self.t[: len(x)], x)
        events = {name: _joined(parts) for name, parts in self._events.items()}
        tangents = {
            name: Tangent(
                {"x": x}, {event: _joined(each) for event, each in self._moved[name].items()}
            )
            for name, x in self._tangents.items()
        }
        return replace(
            self._first, t=self.t, **cast(Any, self._arrays), initial=self._initial,
            events=events, tangents=tangents, failures=failures,
            endings=dict(sorted(self._endings.items())),
            members=count, varied=runner.varied, params=plain(runner.params), h=self._h,
            stats=cast(Stats, {**self._stats, "seconds": seconds}), status=status,
            message="; ".join(filter(None, [said, runner.taken, remark])),
        )  # fmt: skip


def _numbered(points: Points, members: Array) -> Points:
    """Return events of some members with their numbers among all."""
    return Points(points.t, {**points.states, "member": members[points.states["member"]]})


def _joined(parts: list[Points]) -> Points:
    """Return events of one member after another."""
    members = np.concatenate([part.states["member"] for part in parts])
    order = np.argsort(members, kind="stable")
    states = {
        name: np.concatenate([part.states[name] for part in parts])[order]
        for name in parts[0].states
    }
    return Points(np.concatenate([part.t for part in parts])[order], states)
