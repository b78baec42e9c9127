"""Stored runs with contacts: one stretch after another, and the state between two of them."""

from __future__ import annotations

import json
import pickle
import time
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
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
from liouville._runs.stored.stream import BYTES, EVENTS, PAUSE, STATE, TIME, Columns
from liouville._solution.solution import Solution

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

        def take() -> None:
            stream.take_back(state)
            course.restore(pickle.loads(state["memory"].tobytes()))
            stream.show_anew({"status": "interrupted", "message": CUT_OFF, **described(course)})

        taken_back(folder, take)
        return StoredCourse(course, interval, folder, stream)


def begin_touching(
    system: Mechanics,
    method: Method | Plan | str,
    request: Request,
    place: tuple[Path, Interval],
    progress: Progress,
) -> Solution:
    """Run to the end, and store the records on the way."""
    path, interval = place
    job = Job(system, method, request, {})
    pickled((job, interval))
    course, failure = job.course(), None
    course.begin()
    try:
        course.go_on()
        while not (course.is_over or course.may_part):
            course.go_on()
    except IntegrationError as error:
        if not course.stretches:
            raise
        course.status, course.ending, failure = "failed", str(error), error
    is_over = course.is_over
    piece = course.solution() if is_over else course.taken()
    rows = arrays.rows_of(piece)
    row = sum(x.nbytes for x in rows[TIME].values()) // len(piece.t)
    chunks = dict.fromkeys(rows, EVENTS) | {TIME: max(1, BYTES // row)}

    def fill(folder: Folder) -> Columns:
        stream = Columns(folder, chunks)
        for axis, own in rows.items():
            stream.append(axis, own)
        stream.finish(described(course))
        if not is_over:
            save(course, stream)
        return stream

    empty = replace(piece, status="interrupted", message=CUT_OFF)
    whole = pickled((replace(job, chunks=chunks), interval))
    folder, stream = made(path, whole, (empty, chunks), fill)
    with alone(path):
        return StoredCourse(course, interval, folder, stream).go(progress, failure)


def described(course: Course) -> dict[str, Any]:
    """Return the numbers of a run so far, as attributes."""
    records, now = course.records, course.now
    return {"stats": json.dumps(records.stats), "h": records.mean(now.h, now.t)}


def save(course: Course, stream: Columns) -> None:
    """Write the state of a run whose stretches were taken."""
    memory = np.frombuffer(pickle.dumps(course.saved()), dtype=np.uint8)
    stream.commit(memory, {})


class StoredCourse:
    """A stored run with contacts on its way."""

    def __init__(self, course: Course, interval: Interval, folder: Folder, stream: Columns) -> None:
        self._course, self._interval = course, interval
        self._folder, self._stream = folder, stream
        self._saved, self._last, self._shown = self._steps, time.monotonic(), -np.inf
        #: What was taken last, whose last record is left to what follows.
        self._left: tuple[Any, Any, int] | None = None

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
            time.monotonic() - self._last >= interval.seconds
            if interval.steps is None
            else steps - self._saved >= interval.steps
        )
        if not (is_due or len(course.stretches) >= MANY or many >= self._stream.rows):
            return
        before = copy(course.records), course.stretches
        piece = course.taken()
        self._add(piece)
        self._left = *before, len(piece.t)
        if not is_due:
            return
        if time.monotonic() - self._shown >= PAUSE:
            self._stream.finish(described(course))
            self._shown = time.monotonic()
        save(course, self._stream)
        self._saved, self._last = steps, time.monotonic()

    def _end(self) -> None:
        """Take the last records."""
        course = self._course
        if course.stretches:
            self._add(course.solution())
        elif self._left is not None and course.status == "failed":
            # the last stretch again, with its last record
            course.records, course.stretches, count = self._left
            rows = arrays.rows_of(course.solution())[TIME]
            self._stream.append(TIME, {name: x[count:] for name, x in rows.items()})

    def _add(self, piece: Solution) -> None:
        for axis, rows in arrays.rows_of(piece).items():
            self._stream.append(axis, rows)
