"""Stored runs with contacts: one stretch after another, and the state between two of them."""

from __future__ import annotations

import json
import math
import pickle
import time
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError
from liouville._basics.progress import Progress, reported
from liouville._runs.contacts.single import prepared
from liouville._runs.stored import arrays
from liouville._runs.stored.folder import CHECKPOINT, Folder
from liouville._runs.stored.running import (
    CUT_OFF,
    alone,
    deferring,
    ends_of,
    made,
    opened_again,
    pickled,
    taken_back,
)
from liouville._runs.stored.store import Interval
from liouville._runs.stored.stream import BYTES, EVENTS, PAUSE, STATE, TIME, Columns, Rows
from liouville._solution.solution import Solution
from liouville._systems.events import named
from liouville._systems.tracing.expressions import Recorded

if TYPE_CHECKING:
    from liouville._methods import Method
    from liouville._methods.planner import Plan
    from liouville._runs.contacts.run import Course
    from liouville._runs.runner import Request
    from liouville._systems import Mechanics

#: So many stretches are joined at a time.
MANY = 256


@dataclass(frozen=True)
class Job:
    """Arguments of a run, and how many rows a chunk has along each axis that grows."""

    system: Mechanics
    method: Method | Plan | str
    request: Request
    chunks: dict[str, int]

    def course(self) -> Course:
        """Return the run before its start."""
        return prepared(self.system, self.method, self.request, lambda t: None)

    def restored(
        self, path: Path, interval: Interval, state: Mapping[str, Any], clock: float
    ) -> StoredCourse:
        """Return a run as its last checkpoint has it."""
        del clock  # seconds are those of the stretches
        course, folder = self.course(), opened_again(path, self.chunks)
        stream = Columns(folder, self.chunks)

        def take() -> Rows:
            stream.take_back(state)
            last: Rows
            saved, last = pickle.loads(state["memory"].tobytes())
            course.restore(saved)
            stream.show_anew({"status": "interrupted", "message": CUT_OFF, **described(course)})
            return last

        last = taken_back(folder, take)
        return StoredCourse(course, interval, (folder, stream), lambda: last)


def begin_touching(
    system: Mechanics,
    method: Method | Plan | str,
    request: Request,
    place: tuple[Path, Interval],
    progress: Progress,
) -> Solution:
    """Run to the end, and store the records on the way."""
    path, interval = place
    job = Job(system, method, portable(system, request), {})
    course, failure = job.course(), None
    pickled((job, interval))
    course.begin()
    start = state_of(course, {})
    try:
        course.go_on()
        while not (course.is_over or course.may_part):
            course.go_on()
    except IntegrationError as error:
        if not course.stretches:
            raise
        course.status, course.ending, failure = "failed", str(error), error
    is_over = course.is_over
    piece, last = (course.solution(), dict) if is_over else taken(course)
    rows = arrays.rows_of(piece)
    row = sum(x.itemsize * math.prod(x.shape[1:]) for x in rows[TIME].values())
    chunks = dict.fromkeys(rows, EVENTS) | {TIME: max(1, BYTES // row)}

    def fill(folder: Folder) -> Columns:
        stream = Columns(folder, chunks)
        # a run that fails or is interrupted before its next state goes on from its start
        for axis, own in rows.items():
            stream.append(axis, {name: x[:0] for name, x in own.items()})
        stream.commit(start, {})
        for axis, own in rows.items():
            stream.append(axis, own)
        if not is_over:
            stream.finish(described(course))
            stream.commit(state_of(course, last()), {})
        return stream

    empty = replace(piece, status="interrupted", message=CUT_OFF)
    whole = pickled((replace(job, chunks=chunks), interval))
    folder, stream = made(path, whole, (empty, chunks), fill)
    with alone(path):
        return StoredCourse(course, interval, (folder, stream), last).go(progress, failure)


def portable(system: Mechanics, request: Request) -> Request:
    """Return a request with its functions written down, so that any program goes on with it."""
    control = request.control
    if (monitor := getattr(control, "monitor", None)) is not None:
        control = replace(control, **system.portable({"monitor": monitor}))
    args = system._args_of_events
    events = {
        name: replace(event, function=Recorded(f"event '{name}'", event.function, args))
        for name, event in named(request.events).items()
    }
    observe = system.portable(request.observe)
    return replace(request, control=control, observe=observe, events=events)


def described(course: Course) -> dict[str, Any]:
    """Return the numbers of a run so far, as attributes."""
    records, now = course.records, course.now
    return {"stats": json.dumps(records.stats), "h": records.mean(now.h, now.t)}


def taken(course: Course) -> tuple[Solution, Callable[[], Rows]]:
    """Take records, and return them and what returns the last, which is left to what follows."""
    before = copy(course)
    before.records = copy(course.records)
    piece = course.taken()

    @cache
    def last() -> Rows:
        rows = arrays.rows_of(before.solution())[TIME]
        return {name: x[len(piece.t) :].copy() for name, x in rows.items()}

    return piece, last


def state_of(course: Course, last: Rows) -> np.ndarray:
    """Return the state of a run whose stretches were taken, and its last record."""
    return np.frombuffer(pickle.dumps((course.saved(), last)), dtype=np.uint8)


class StoredCourse:
    """A stored run with contacts on its way; `last` returns the record that is left to it."""

    def __init__(
        self,
        course: Course,
        interval: Interval,
        place: tuple[Folder, Columns],
        last: Callable[[], Rows],
    ) -> None:
        self._course, self._interval, self._last = course, interval, last
        self._folder, self._stream = place
        self._saved, self._since, self._shown = self._steps, time.monotonic(), -np.inf

    def go(self, progress: Progress, failure: IntegrationError | None = None) -> Solution:
        """Run to the end, and return the first and the last record."""
        course, path = self._course, self._folder.path
        with deferring() as is_interrupted:
            if not course.is_over:
                failure = self._advance(progress, is_interrupted)
                self._end()
            message = "; ".join(filter(None, [course.ending, *dict.fromkeys(course.now.messages)]))
            if course.status == "interrupted":
                message += f"; liouville.resume({str(path)!r}) goes on"
            self._stream.finish({"status": course.status, "message": message, **described(course)})
            self._folder.sync()
            if course.status == "done":
                (path / CHECKPOINT / STATE).unlink(missing_ok=True)
        solution = ends_of(path, course.contacts.system)
        if failure is not None:
            failure.solution = solution
            raise failure
        return solution

    def _advance(
        self, progress: Progress, is_interrupted: Callable[[], bool]
    ) -> IntegrationError | None:
        course = self._course
        start, whole = course.steps.t0, course.steps.t1 - course.steps.t0
        with reported(progress, "of time") as report:
            is_stopped = False
            while not course.is_over:
                try:
                    course.go_on()
                except IntegrationError as error:
                    course.status, course.ending = "failed", str(error)
                    return error
                try:
                    if report is not None:
                        report(course.now.t - start, whole)
                except KeyboardInterrupt:
                    is_stopped = True
                is_stopped |= is_interrupted()
                if course.may_part:
                    self._take(is_stopped)
                    if is_stopped:
                        course.status = "interrupted"
                        course.ending = f"interrupted at t = {course.now.t:g}"
        return None

    @property
    def _steps(self) -> int:
        """How many steps were made."""
        pending = sum(int(x.whole.run.stats.get("steps", 0)) for x in self._course.stretches)
        return int(self._course.records.stats.get("steps", 0)) + pending

    def _take(self, is_stopped: bool) -> None:
        """Take records between two stretches, where there are many, and the state if it is due."""
        course, interval = self._course, self._interval
        steps, many = self._steps, sum(len(x.whole.run.t) for x in course.stretches)
        is_due = is_stopped or (
            time.monotonic() - self._since >= interval.seconds
            if interval.steps is None
            else steps - self._saved >= interval.steps
        )
        if not (is_due or len(course.stretches) >= MANY or many >= self._stream.rows):
            return
        piece, self._last = taken(course)
        self._add(piece)
        if not is_due:
            return
        if time.monotonic() - self._shown >= PAUSE:
            self._stream.finish(described(course))
            self._shown = time.monotonic()
        self._stream.commit(state_of(course, self._last()), {})
        self._saved, self._since = steps, time.monotonic()

    def _end(self) -> None:
        """Take the last records."""
        course = self._course
        if course.stretches:
            self._add(course.solution())
        elif last := self._last():
            self._stream.append(TIME, last)

    def _add(self, piece: Solution) -> None:
        for axis, rows in arrays.rows_of(piece).items():
            self._stream.append(axis, rows)
