"""Pullbacks of runs on constraints, mechanical or semi-explicit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics.errors import IntegrationError, hinted
from liouville._runs.adjoint import EVENTS, INVARIANTS, Adjoint, Gradients
from liouville._runs.execute import Checkpoints, execute, finished
from liouville._runs.kinks import Kinks
from liouville._runs.mechanics.held_steps import HeldSteps, at_switches
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request
from liouville._runs.tangents import PARAMS, check_wrt, gradients_of, shapes_of
from liouville._solution.chain_rule import ended
from liouville._solution.solution import Solution
from liouville._systems.events import AFTER

if TYPE_CHECKING:
    from liouville._runs.mechanics.members import MembersRunner

#: Times within this part of a step of its end may be found in the next.
BESIDE = 1e-9

#: Where a motion begins, states within a step wait for so many more by methods of an order beyond
#: that of polynomials on one step.
AHEAD, ONE_STEP = 2, 4


class ConstrainedAdjoint(Adjoint):
    """The transposed derivative of a run on constraints; see :class:`Adjoint`."""

    runner: TracedRunner

    def __init__(self, runner: TracedRunner, request: Request, wrt: Any) -> None:
        self.runner, self._request = runner, request
        shapes = shapes_of(runner.system, check_wrt(runner.system, wrt, runner.steps))
        self.directions = {name: (shape, False) for name, shape in shapes.items()}
        self.checkpoints = Checkpoints(None if runner.steps.control else runner.steps.count)
        self.kinks = Kinks.of(runner, request, shapes)

    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shapes of what has cotangents, by the names of the states."""
        runner = self.runner
        names: tuple[str, ...] = (*runner.system.states, "lam")
        if runner.multipliers != len(runner.constraints) and not runner.shares_multipliers:
            names = names[:2]
        found = {name: solution.states[name].shape for name in names}
        for name in runner.system.invariants:
            found[f"{INVARIANTS}{name}"] = solution.invariants[name].shape
        for event, points in solution.events.items():
            found[f"{EVENTS}{event}.t"] = points.t.shape
            alike = names if runner.multipliers == len(runner.constraints) else names[:2]
            own = {f"{name}{end}" for name in alike for end in ("", AFTER)}
            each = {name: x.shape for name, x in points.states.items() if name in own}
            found |= {f"{EVENTS}{event}.{name}": shape for name, shape in each.items()}
        return found

    def pulled(self, solution: Solution, cotangents: Mapping[str, np.ndarray]) -> Gradients:
        """Return gradients from cotangents of all states; see :class:`Adjoint`."""
        runner, checkpoints = self.runner, self.checkpoints
        assert checkpoints is not None
        rows, steps = _rows(runner, cotangents), int(solution.stats["steps"])
        longer, more, last = 0.0, np.zeros(0), 0.0
        if runner.shares_multipliers:
            rows, more, longer, last = runner.pulled_multipliers(solution, rows)
        by_point, of_ends, stretched, of_last = _of_invariants(
            runner, runner._values, solution, cotangents
        )
        if last or of_last:  # the time of the event that has ended the run
            name = f"{EVENTS}{ended(solution)}.t"
            own = cotangents[name].copy()
            own[-1] += last + of_last
            cotangents = {**cotangents, name: own}
        n = rows.shape[1] - runner.multipliers
        rows[:, :n] += by_point
        more, longer = more + of_ends if more.size else of_ends, longer + stretched
        recorder, recorded = checkpoints.recorded()
        core = recorder or runner.pullback()
        assert not isinstance(core, dict), "a run that has begun"
        core.give_events(self._rows_of_events(solution, cotangents))
        kept = np.minimum(np.arange(len(rows)) * runner.every, steps)
        steps = self._last(solution, cotangents, kept)
        self.check(steps if runner.steps.control is None else self._seen(steps, solution, kept))
        if runner.times is not None:
            # between steps, from where the core takes them to the starts of these
            over = runner.times.size - len(rows)  # behind the end of a run that an event ended
            core.give(np.ascontiguousarray(np.pad(rows, ((0, over), (0, 0)))))
            kept, rows = np.zeros(1, int), np.zeros((1, rows.shape[1]))
        for first, last, saved in checkpoints.reversed(steps):
            # the record at the start may be of the state after an event there
            own = (first <= kept) & (kept <= last)
            is_made = recorder is not None and first == recorded
            state = None if is_made else saved
            error = core.follow(state, last, kept[own], np.ascontiguousarray(rows[own]))
            if error is not None:
                raise self._error(error)
        found = core.end(np.ascontiguousarray(rows[0]))
        if isinstance(found, dict):
            raise self._error(found)
        of_y, of_z, of_tau, stretch = found
        if more.size:
            of_tau = of_tau + more
        moved = runner.pulled_start((of_y, of_z, of_tau))
        return gradients_of(runner.system, runner.steps, moved, stretch + longer, self.wrt)

    def _seen(self, steps: int, solution: Solution, kept: np.ndarray) -> float:
        """Return how many steps are looked at for kinks by a run whose controlled steps differ."""
        kink = None if self.kinks is None else self.kinks.first
        if kink is None or steps == solution.stats["steps"]:
            return math.inf
        t0, t = self.runner.steps.t0, solution.t[np.searchsorted(kept, steps)]
        return math.inf if abs(kink.t - t0) < abs(t - t0) else 0

    def _last(
        self, solution: Solution, cotangents: Mapping[str, np.ndarray], kept: np.ndarray
    ) -> int:
        """Return how many steps cotangents depend on: behind them hits may accumulate."""
        steps, records, far = self.runner.steps, [0], -1.0
        for name, x in cotangents.items():
            given = np.flatnonzero(x.any(axis=tuple(range(1, x.ndim))))
            event = name.removeprefix(EVENTS).rpartition(".")[0]
            if given.size and name.startswith(EVENTS):
                far = max(far, abs(solution.events[event].t[given[-1]] - steps.t0))
            elif given.size:
                records.append(int(given[-1]))
        if self.runner.times is None:
            # an event at the end of a step may be found at the start of the next
            far = max(far, self._far_of_events(solution, max(records)))
            after = np.searchsorted(np.abs(solution.t - steps.t0), far, side="right")
            row = max(*records, int(after))
            return int(kept[row]) if row < len(kept) - 1 else int(solution.stats["steps"])
        done = int(solution.stats["steps"])
        if steps.control is not None:
            return done
        far = max([far, *np.abs(solution.t[np.array(records[1:], dtype=int)] - steps.t0)])
        ahead = AHEAD if self.runner._order > ONE_STEP else 0
        place = float(far / abs(steps.t1 - steps.t0) * steps.count)
        return min(done, math.floor(place + BESIDE) + 1 + ahead) if far >= 0 else 0

    def _far_of_events(self, solution: Solution, record: int) -> float:
        """Return how far from the start a record is that an event may have replaced, else -1."""
        t = solution.t[record]
        is_met = any((points.t == t).any() for points in solution.events.values())
        return float(abs(t - self.runner.steps.t0)) if is_met else -1.0

    def _rows_of_events(
        self, solution: Solution, cotangents: Mapping[str, np.ndarray]
    ) -> list[np.ndarray]:
        """Return cotangents of each kind of event: of t and the states on both sides of a reset."""
        found = []
        for event, points in solution.events.items():
            prefix = f"{EVENTS}{event}."
            each = cotangents.items()
            own = {x.removeprefix(prefix): y for x, y in each if x.startswith(prefix)}
            parts = [own["t"][:, None]]
            missing = np.zeros((len(points), self.runner.multipliers))
            ends = ("", AFTER) if f"{self.runner.system.states[0]}{AFTER}" in own else ("",)
            for end in ends:
                parts += [own[f"{name}{end}"] for name in self.runner.system.states]
                parts.append(own.get(f"lam{end}", missing))
            found.append(np.ascontiguousarray(np.concatenate(parts, axis=1)))
        return found

    def _error(self, error: dict[str, Any]) -> IntegrationError:
        sentence, hint, quantity = self.runner.describe(error)
        return IntegrationError(hinted(sentence, hint), quantity=quantity)

    @cached_property
    def _held(self) -> HeldSteps:
        """The controlled steps of the run."""
        return HeldSteps(self.runner, self._request)

    def moved(self, directions: Mapping[str, np.ndarray], size: float) -> Mapping[str, np.ndarray]:
        """Return the states of the run, moved by so much of all directions; see :class:`Adjoint`.

        The start moves along its constraints.
        """
        run = self._moved(directions, size)
        sides = self._sides(run)
        if sides.shape != self._own_sides.shape:  # as many records as another run
            return run.states
        is_passed = (sides != self._own_sides).any(axis=1)
        return {name: np.where(is_passed[:, None], np.nan, x) for name, x in run.states.items()}

    @cached_property
    def _own_sides(self) -> np.ndarray:
        """The sides of the records of the run itself."""
        return self._sides(self._moved({}, 0.0))

    def _sides(self, run: Solution) -> np.ndarray:
        """Return a row for each record: how many resets were before it, and signs of switches.

        Times of controlled steps are held, but for those at switches.
        """
        system, steps = self.runner.system, self.runner.steps
        way, times = steps.t1 - steps.t0, np.zeros(len(run.t))
        if steps.control is not None:
            times[: -1 if ended(run) else None] = run.t[: -1 if ended(run) else None]
        columns = [
            ((run.t[:, None] - points.t) * way >= 0).sum(axis=1)
            for points in run.events.values()
            if f"{system.states[0]}{AFTER}" in points.states
        ]
        switches = at_switches(self.runner, run, system.values(run.params))
        return np.column_stack([times, *columns, *np.sign(switches).T])

    def _moved(self, directions: Mapping[str, np.ndarray], size: float) -> Solution:
        runner, request = self.runner, self._request
        values: dict[str, Any] = {**runner.system.params, **(request.params or {})}
        for name, x in directions.items():
            if name.startswith(PARAMS):
                which = name.removeprefix(PARAMS)
                values[which] = np.asarray(values[which]) + size * x
        given = zip(runner.system.states, runner.system.start(request.start), strict=True)
        # along the constraints: beside them redundant ones contradict each other
        changes = runner.moved_along(directions) if directions else np.zeros((2, 1))
        own: dict[str, Any] = {  # z that follows from y has no changes
            name: x + size * dx if dx.size else x
            for (name, x), dx in zip(given, changes, strict=True)
        }
        ends = [request.t[k] + size * directions.get(f"t{k}", 0.0) for k in (0, 1)]
        start = {**request.start, **runner.system.consistent(t=ends[0], params=values, **own)}
        request = replace(request, params=values, start=start)
        if runner.steps.control is not None:
            return finished(execute(self._held.runner(request)))
        moved = replace(  # as many steps, whatever the ends
            request, t=tuple(map(float, ends)), steps=runner.steps.count, h=None,
            has_pullback=False,
        )  # fmt: skip
        return finished(execute(type(runner)(runner.system, runner.choice, moved)))


class LockStep:
    """Pullbacks of members that the core takes in lock-step, each with the bits it has alone.

    Attributes
    ----------
    most : int
        At most so many members are pulled back at once.
    """

    most = _core.MembersPullback.most

    def __init__(
        self, runner: MembersRunner, core: _core.MembersPullback, wrt: tuple[str, ...]
    ) -> None:
        self._runner, self._core, self._wrt = runner, core, wrt

    def stop(self) -> None:
        """Let pullbacks on other threads end."""
        self._core.stop()

    def pulled(
        self, members: range, solution: Solution, cotangents: Mapping[str, np.ndarray]
    ) -> list[Gradients] | None:
        """Return gradients of some members, None where they are to be pulled back one by one."""
        runner = self._runner
        own = {name: x[:, members.start : members.stop] for name, x in cotangents.items()}
        rows = np.ascontiguousarray(_rows(runner, own))
        has_invariants = any(x.any() for name, x in own.items() if name.startswith(INVARIANTS))
        others = self._of_invariants(members, solution, own, rows) if has_invariants else None
        kept = np.minimum(np.arange(len(rows)) * runner.every, runner.steps.count)
        last = int(kept[np.flatnonzero(rows.any(axis=(1, 2)))].max(initial=0))
        core = self._core.pull([*members], last, kept, rows)
        if core is None:
            return None
        *parts, stretches = core
        if others is not None:
            parts[2], stretches = parts[2] + others[0], stretches + others[1]
        each = zip(members, *parts, strict=True)
        starts = [runner.pulled_member(member, own) for member, *own in each]
        of_y, of_z, of_tau = (np.array(part) for part in zip(*starts, strict=True))
        moved = of_y, of_z, of_tau
        found = gradients_of(runner.system, runner.steps, moved, stretches, self._wrt)
        return [{name: x[k] for name, x in found.items()} for k in range(len(members))]

    def _of_invariants(
        self,
        members: range,
        solution: Solution,
        cotangents: Mapping[str, np.ndarray],
        rows: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Add cotangents by invariants to `rows`; return those of tau and of the stretch."""
        runner, taus, stretches = self._runner, [], []
        for k, member in enumerate(members):
            own = {name: x[:, k] for name, x in cotangents.items()}
            at = runner, runner.values_of(member), solution.member(member), own
            by_point, tau, stretch, _ = _of_invariants(*at)
            rows[:, k, : by_point.shape[1]] += by_point
            taus.append(tau)
            stretches.append(stretch)
        return np.array(taus), np.array(stretches)


def _rows(runner: TracedRunner, cotangents: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return cotangents of (y, z, lam) as they are beside one another in records."""
    names = (*runner.system.states, "lam")
    missing = np.zeros((*cotangents[names[0]].shape[:-1], runner.multipliers))
    return np.concatenate([cotangents.get(name, missing) for name in names], axis=-1)


def _of_invariants(
    runner: TracedRunner,
    values: np.ndarray,
    solution: Solution,
    cotangents: Mapping[str, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return cotangents of y and z, of time and parameters, and of the stretch of the steps.

    The last is that of the last time where an event has ended the run.
    """
    none = np.zeros(len(solution.t))
    given = [cotangents.get(f"{INVARIANTS}{x}", none) for x in solution.invariants]
    first, second = (solution.states[x] for x in runner.system.states[:2])
    by_point, wide = np.zeros((len(first), first.shape[1] + second.shape[1])), 1
    if not any(x.any() for x in given):
        return by_point, np.zeros(wide + values.size), 0.0, 0.0
    # imported here: few runs are differentiated
    from liouville._systems.derivatives.invariants import pulled_invariants

    points, weights = (solution.t, first, second), np.stack(given, axis=1)
    found = pulled_invariants(runner.system, points, values, weights)
    last = 0.0
    if runner.times is not None:
        found[:, 0] = 0.0  # times that are held
    elif ended(solution):
        last, found[-1, 0] = float(found[-1, 0]), 0.0
    of_t, by_point, of_params = np.split(found, [wide, wide + by_point.shape[1]], axis=1)
    tau = np.concatenate([of_t.sum(axis=0), of_params.sum(axis=0)])
    return by_point, tau, float(of_t[:, 0] @ (solution.t - runner.steps.t0)), last
