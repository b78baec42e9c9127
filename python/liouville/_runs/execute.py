"""A run from its start to its end, and its solution."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from threading import Event
from typing import Any, cast

import numpy as np

from liouville import _core
from liouville._basics.arguments import memory
from liouville._basics.errors import IntegrationError, hinted
from liouville._basics.handlers import raise_of_handler
from liouville._basics.progress import Progress, Report, reported
from liouville._methods.control import Steps
from liouville._runs.creeping import Creep
from liouville._runs.runner import Request, Runner
from liouville._solution.failure import Failure, ending_of, summary_of
from liouville._solution.parts import steps_made
from liouville._solution.points import STATES, Points
from liouville._solution.solution import RESIDUALS, Solution
from liouville._solution.states import Stats

#: Seconds between two looks at the signals and the progress bar.
SLICE = 0.05

#: Bytes of recorded steps that a run may leave, and what each takes beside its numbers.
RECORDED, OVERHEAD = 2**26, 512

#: How a run ended: "done", "interrupted", or the error of the core.
Outcome = str | dict[str, Any]


class Checkpoints:
    """States from which a run is repeated: about as many as there are steps between two of them.

    Where a core records the steps there are fewer, as many as keep the steps between two of them
    within memory: those behind the last need not be repeated. Of a run whose number of steps is not
    known every second is dropped as it grows.

    Attributes
    ----------
    stop : threading.Event
        Set, it interrupts run and pullback: Ctrl-C comes to the main thread alone.
    """

    def __init__(self, steps: int | None) -> None:
        self.stop = Event()
        self._steps = steps
        self.stride = 1 if steps is None else math.isqrt(steps - 1) + 1
        self._most = math.inf if steps is not None else 4
        self.next = 0
        self._saved: list[np.ndarray] = []
        #: What records the steps, once; and whether it can be followed back.
        self._recorders: list[_core.Pullback] = []
        self._is_followed = True

    def start(self, runner: Runner) -> _core.Run | dict[str, Any]:
        """Start the run of a runner, or return the error of its start."""
        recorder = runner.recorder()
        if recorder is None or isinstance(recorder, dict):
            return runner.start() if recorder is None else recorder
        self._recorders.append(recorder)
        self._is_followed = not runner.parts_steps
        return recorder.run

    def recorded(self) -> tuple[_core.Pullback | None, int]:
        """Give up what has recorded the steps, if it is there, and from which step on it has."""
        try:
            recorder = self._recorders.pop()
        except IndexError:
            recorder = None
        return recorder if self._is_followed else None, (len(self._saved) - 1) * self.stride

    def take(self, run: _core.Run) -> None:
        """Save a run that has come to where it is to be saved."""
        self._check()
        if run.done != self.next:
            return
        saved = run.save()
        assert saved is not None
        for recorder in self._recorders:
            recorder.forget()
            if not self._saved and self._steps is not None:
                # a record is two states and what solves the equations between
                fit = RECORDED // (2 * saved.nbytes + OVERHEAD) + 1
                pieces = -(-self._steps // fit)
                self.stride = max(self.stride, -(-self._steps // pieces))
        self._saved.append(saved)
        if len(self._saved) > self._most * self.stride:
            self._saved = self._saved[::2]
            self.stride *= 2
        self.next = len(self._saved) * self.stride

    def reversed(self, steps: int) -> Iterator[tuple[int, int, np.ndarray]]:
        """Give the pieces of a run of so many steps, the last first: first and last step, state."""
        for place in range(len(self._saved) - 1, -1, -1):
            self._check()
            first = place * self.stride
            if first < steps:
                yield first, min(first + self.stride, steps), self._saved[place]

    def _check(self) -> None:
        if self.stop.is_set():
            raise KeyboardInterrupt


def execute(
    runner: Runner, progress: Progress = None, checkpoints: Checkpoints | None = None
) -> Solution:
    """Run to the end, and return the solution; IntegrationError if a step fails."""
    clock = time.perf_counter()
    run = runner.start() if checkpoints is None else checkpoints.start(runner)
    outcome: Outcome
    events: dict[str, Points] = {}
    reached, endings = runner.steps.t0, dict[int, str]()
    if isinstance(run, dict):
        outcome = run
        times, rows = np.empty(0), np.empty((0, *runner.members, sum(runner.columns.values())))
        stats: dict[str, Any] = {"steps": 0}
    else:
        outcome = advance(run, runner, progress, checkpoints)
        reached = run.t
        (times, rows), stats = run.take(), runner.stats(run)
        stats |= runner.totals(rows)
        events, endings = runner.events(run)
        if isinstance(outcome, dict):
            runner.add_cause(outcome, run)
    stats["seconds"] = time.perf_counter() - clock

    end = "" if runner.members else endings.get(0, "")
    status, message, quantity = status_of(outcome, runner, stats, end)
    failures: dict[int, Failure] = {}
    if runner.members and not isinstance(run, dict):
        failures = failures_of(run, runner)
        message = _of_members(run, runner, outcome, message, failures)
        if outcome == "done":
            status = ending_of(failures, runner.members[0])
            stats["steps"] = _most_steps(runner, events, endings, failures)
    if status != "failed":
        assert not isinstance(run, dict)
        message = "; ".join(filter(None, [message, runner.remark(run, times, rows)]))
    ended = status, message
    solution = solution_of(runner, times, rows, stats, reached, ended, events, failures)
    if runner.members and endings:
        solution = replace(solution, endings=endings)
    if failures and not solution.t.size:
        member, first = next(iter(failures.items()))
        raise IntegrationError(
            message, t=first.t, step=first.step, member=member, solution=solution
        )
    if isinstance(outcome, dict):
        raise error_of(outcome, runner, quantity, solution) from outcome.get("cause")
    return solution


def checked(runner: Runner, request: Request, progress: Progress) -> Solution:
    """Run to the end; IntegrationError if a step fails, or has not the tangents asked for."""
    solution = execute(runner, progress)
    if request.tangents is not None and solution.status != "interrupted":
        runner.check_tangents(request, solution)
    return solution


def finished(solution: Solution) -> Solution:
    """Return a run that another computation goes on from; KeyboardInterrupt if it was cut short."""
    if solution.status == "interrupted":
        raise KeyboardInterrupt(solution.message)
    return solution


def status_of(
    outcome: Outcome, runner: Runner, stats: dict[str, Any], end: str
) -> tuple[str, str, str]:
    """Return status and message of a run, and which quantity is the cause if it failed."""
    if isinstance(outcome, dict):
        stats["steps"] = outcome.get("step", 0)
        return ("failed", *explain(outcome, runner))
    if outcome == "interrupted":
        return outcome, runner.interrupted(stats["steps"]), ""
    return "done", "; ".join(filter(None, [end, runner.taken, runner.control_taken])), ""


def _of_members(
    run: _core.Run,
    runner: Runner,
    outcome: Outcome,
    message: str,
    failures: Mapping[int, Failure],
) -> str:
    """Return the message of an ensemble: how many of its members are over, how many failed."""
    if isinstance(outcome, dict):
        return message
    if outcome == "interrupted":
        message = f"interrupted when {run.over} of {runner.members[0]} members were over"
    return "; ".join(filter(None, [message, summary_of(failures, runner.members[0])]))


def _most_steps(
    runner: Runner,
    events: Mapping[str, Points],
    endings: Mapping[int, str],
    failures: Mapping[int, Failure],
) -> int:
    """Return how many steps the member made that came farthest."""
    steps = runner.steps
    if len(endings) + len(failures) < runner.members[0]:
        return steps.count
    h = steps.mean(steps.t1, steps.count)
    ended = [steps_made(events, member, steps.t0, h) for member in endings]
    return max([*ended, *(failure.step for failure in failures.values())])


def error_of(
    error: dict[str, Any], runner: Runner, quantity: str, solution: Solution
) -> IntegrationError:
    """Return the error of a run that failed, with what was computed before."""
    return IntegrationError(
        solution.message,
        t=error.get("start", runner.steps.t0),
        step=int(solution.stats["steps"]),
        quantity=quantity,
        member=error.get("member") if runner.members else None,
        solution=solution,
    )


def solution_of(
    runner: Runner,
    times: np.ndarray,
    rows: np.ndarray,
    stats: dict[str, Any],
    reached: float,
    ended: tuple[str, str],
    events: Mapping[str, Points],
    failures: Mapping[int, Failure] | None = None,
) -> Solution:
    """Return records as a solution; `ended` is status and message, `reached` the last time."""
    columns, end = {}, 0
    for name, width in runner.columns.items():
        columns[name] = rows[..., end : end + width]
        end += width
    parts = runner.read(columns)
    named = _named(parts)
    status, message = ended
    return Solution(
        t=times,
        states={name: parts[name] for name in STATES if name in parts},
        invariants=named["invariant"],
        residuals={name: parts[name] for name in RESIDUALS if name in parts},
        observed=named["observed"],
        angles=named["angle"],
        initial=runner.initial,
        balance=runner.balance(parts),
        tangents=runner.tangents(times, parts),
        names=_names(runner),
        events=dict(events),
        dense_order=runner.dense_order,
        choice=runner.choice if runner.dense_order else None,
        h=runner.steps.mean(reached, stats["steps"]),
        tolerances=runner.steps.tolerances,
        method=runner.method,
        stats=cast(Stats, stats),
        params=plain(runner.params),
        status=status,
        message=message,
        members=runner.members[0] if runner.members else None,
        failures=dict(failures or {}),
        varied=runner.varied,
        changing=("energy",) * getattr(runner.system, "gains_energy", False),
        system=runner.system,
    )


def advance(
    run: _core.Run, runner: Runner, progress: Progress, checkpoints: Checkpoints | None = None
) -> Outcome:
    """Advance to the end, or until memory is full; returns how that ended."""
    most, stop = math.inf, None
    with reported(progress, runner.steps.unit) as report:
        try:
            if checkpoints is not None:
                checkpoints.take(run)
                stop = checkpoints.next
            creep = None if runner.steps.control is None else Creep(run, runner)
            while (outcome := advance_slice(run, sooner(stop, creep))) == "paused":
                if creep is not None and (failure := creep.failure(run)):
                    return failure
                if checkpoints is not None:
                    checkpoints.take(run)
                    stop = checkpoints.next
                report_progress(report, run, runner.steps)
                if most == math.inf:  # the limits take longer to read than a short run
                    most = runner.every * memory() / runner.row
                if run.done > most:
                    return {"kind": "no memory", "step": run.done, "start": run.t}
        except KeyboardInterrupt:
            return "interrupted"
        report_progress(report, run, runner.steps)
    return outcome


def sooner(stop: int | None, creep: Creep | None) -> int | None:
    """Return after how many steps a slice ends at the latest."""
    own = None if creep is None else creep.stop
    stops = [x for x in (stop, own) if x is not None]
    return min(stops, default=None)


def report_progress(report: Report | None, run: _core.Run, steps: Steps) -> None:
    """Report how far a run is."""
    if report is None:
        return
    if steps.control is None:
        report(run.done, steps.count)
    else:
        report(abs(run.t - steps.t0), abs(steps.t1 - steps.t0))


def advance_slice(run: _core.Run, steps: int | None = None) -> Outcome:
    """Advance for a slice of time, to so many steps at most; returns how that ended."""
    outcome: Outcome = run.advance(SLICE, steps)
    if isinstance(outcome, dict) and outcome["kind"] == "raised":
        raise_of_handler(outcome["cause"])
    return outcome


def failures_of(run: _core.Run, runner: Runner) -> dict[int, Failure]:
    """Return the members that failed, and why."""
    found = {}
    for error in run.failures():
        member, t = error.pop("member"), error.get("start", runner.steps.t0)
        found[member] = Failure(
            error.get("step", 0), t, explain({**error, "of": member}, runner)[0]
        )
    return found


def explain(error: dict[str, Any], runner: Runner) -> tuple[str, str]:
    """Return where and why a run failed and what to try, and which quantity is the cause."""
    if "step" in error:
        where = f"step {error['step']}{runner.steps.total} at t = {error['start']:.6g} failed"
    else:
        where = f"the start at t = {runner.steps.t0:.6g} cannot be taken"
    sentence, hint, quantity = runner.describe(error)
    return hinted(f"{where}: {sentence}", hint), quantity


def _names(runner: Runner) -> dict[str, tuple[str, ...]]:
    names = {"coordinates": runner.system.coordinates, "constraints": runner.constraints}
    unknowns = getattr(runner.system, "unknowns", None)
    return names if unknowns is None else names | {"unknowns": unknowns}


def _named(parts: Mapping[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Return arrays named "invariant energy" and so on, by both words."""
    found: dict[str, dict[str, np.ndarray]] = {"invariant": {}, "observed": {}, "angle": {}}
    for name, x in parts.items():
        kind, _, own = name.partition(" ")
        if kind in found:
            found[kind][own] = x[..., 0] if x.shape[-1] == 1 else x
    return found


def plain(params: Mapping[str, Any]) -> dict[str, float | list[float]]:
    """Return parameters as numbers and lists of numbers."""
    return {
        name: value if type(value) is float else np.asarray(value, dtype=float).tolist()
        for name, value in params.items()
    }
