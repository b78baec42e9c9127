"""Stored runs: their start, their way on after a cut, and their end."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from liouville import _core
from liouville._basics import checksum, schema
from liouville._basics.checksum import FREE, META
from liouville._basics.errors import hinted
from liouville._basics.locks import lock_of, locked
from liouville._basics.options import check_options
from liouville._basics.progress import Progress, Report, reported
from liouville._runs.execute import (
    Outcome,
    advance_slice,
    error_of,
    execute,
    report_progress,
    solution_of,
    status_of,
)
from liouville._runs.runner import Runner
from liouville._runs.stored import arrays
from liouville._runs.stored.folder import CHECKPOINT, Folder, attributes_of
from liouville._runs.stored.store import Interval, Store, interval_of, is_there, store_of
from liouville._runs.stored.stream import JOB, STATE, Stream, chunks_of
from liouville._solution import export
from liouville._solution.solution import Solution
from liouville._systems import System

T = TypeVar("T")

#: The layout of a checkpoint.
LAYOUT = 10

#: What made a checkpoint.
VERSION = {"liouville": schema.TEXT, "layout": schema.integers(0)}

#: The message in a folder of a run that is going on, or was cut off.
CUT_OFF = "not finished: liouville.resume goes on with it"


def begin(runner: Runner, place: tuple[Path, Interval], progress: Progress) -> Solution:
    """Run to the end, and store the records on the way."""
    path, interval = place
    clock = time.perf_counter()
    run = runner.start()
    if isinstance(run, dict):
        return execute(runner, progress)  # raises the error of the start
    job = pickled((runner, interval))
    records, (events, _) = run.collect(), runner.events(run)
    chunks = chunks_of(runner, events)
    none = np.empty((0, sum(runner.columns.values())))
    ended = ("interrupted", CUT_OFF)
    empty = solution_of(runner, np.empty(0), none, {"steps": 0}, runner.steps.t0, ended, events)

    def fill(folder: Folder) -> Stream:
        stream = Stream(runner, folder, chunks)
        stream.add(run, records)
        stream.save(run, {"seconds": 0.0})
        return stream

    folder, stream = made(path, job, (empty, chunks), fill)
    with alone(path):
        return _StoredRun(runner, interval, run, stream, folder, clock).go(progress)


def made(
    path: Path, job: bytes, layout: tuple[Solution, dict[str, int]], fill: Callable[[Folder], T]
) -> tuple[Folder, T]:
    """Let a folder appear with all that is needed to go on; `fill` writes the first state."""
    empty, chunks = layout
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.tmp")
    try:
        arrays.prepare(empty, temporary, chunks)
        folder = Folder(temporary, chunks)
        version = {"liouville": _core.VERSION, "layout": LAYOUT}
        group = checksum.group_of(version, {})
        (temporary / CHECKPOINT).mkdir()
        (temporary / CHECKPOINT / META).write_text(checksum.signed(group, FREE), encoding="utf-8")
        folder.commit(JOB, job)
        filled = fill(folder)
        folder.sync()
        _rename(temporary, path)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    folder.path = path
    return folder, filled


def resume(
    store: Store | str | os.PathLike[str],
    *,
    progress: Progress = None,
    **options: object,
) -> Solution:
    """Go on with a stored run that was cut off, interrupted, or failed.

    The result is that of a run that was never cut off, bit for bit: what was recorded after the
    last checkpoint is made again. What to do is read from the folder by unpickling, which can run
    any code: resume only what you stored yourself. One process goes on with a run: the folder is
    locked until it ends, however it does.

    Parameters
    ----------
    store : Store or path
        The ``.zarr`` folder that :func:`integrate` was given as ``store=``. The ``checkpoint`` of a
        :class:`Store` replaces that of before.
    progress : bool or callable, optional
        As for :func:`integrate`.

    Returns
    -------
    Solution
        As of :func:`integrate` with ``store=``; of a run that is done what it left.

    Raises
    ------
    TypeError
        There is another argument than these.
    FileNotFoundError
        There is nothing at this path.
    ValueError
        What is there is no stored run, one of another version of liouville, or damaged.
    BlockingIOError
        Another process goes on with it.
    IntegrationError
        A step failed; ``error.solution`` is what was computed before it.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> call = {"t": (0, 1), "h": 0.1, **pendulum.start}
    >>> run = lv.integrate(pendulum.system, lv.Spark(3), store="pendulum.zarr", **call)
    >>> lv.resume("pendulum.zarr").status  # it was not cut off
    'done'
    """
    clock = time.perf_counter()
    check_options(options, "resume")
    store = store_of(store)
    path = Path(store.path)
    is_done = _status(path) == "done"
    path = path.absolute()  # the run may change the working directory
    if is_done:
        return ends_of(path, None)
    with alone(path):
        if _status(path) == "done":  # by now
            return ends_of(path, None)
        job, state = _loaded(path)
        runner, interval = job
        interval = interval if store.checkpoint is None else interval_of(store.checkpoint)
        if isinstance(runner, Runner):
            run = _restored(path, (runner, interval), state, clock)
        else:
            run = runner.restored(path, interval, state, clock)
        return run.go(progress)


def _loaded(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return the job of a folder, and its last state."""
    for file in (JOB, STATE):
        _check(path, file)
    with np.load(path / CHECKPOINT / STATE, allow_pickle=False) as opened:
        state = dict(opened)
    return pickle.loads((path / CHECKPOINT / JOB).read_bytes()), state


def _restored(
    path: Path, job: tuple[Runner, Interval], state: Mapping[str, Any], clock: float
) -> _StoredRun:
    """Return a run as its last checkpoint has it."""
    runner, interval = job
    run = runner.start()
    if isinstance(run, dict):
        raise ValueError(_foreign(path, "whose start cannot be taken any more"))
    events, _ = runner.events(run)
    chunks = chunks_of(runner, events)
    folder = opened_again(path, chunks)
    stream = Stream(runner, folder, chunks)
    stats = taken_back(
        folder, lambda: stream.restore(run, state, {"status": "interrupted", "message": CUT_OFF})
    )
    return _StoredRun(runner, interval, run, stream, folder, clock - stats["seconds"])


def opened_again(path: Path, chunks: Mapping[str, int]) -> Folder:
    """Return the folder of a run that was cut off."""
    folder = Folder(path, chunks)
    folder.clear()
    return folder


def taken_back(folder: Folder, take: Callable[[], T]) -> T:
    """Go back to a state, and see that all records up to it are there."""
    try:
        found = take()
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(_foreign(folder.path, "whose state is of another run")) from error
    # no earlier: what is after the state may be lost
    order = export.order_of(folder.attributes, repr(str(folder.path)))
    checksum.check_arrays(folder.path, order, folder.arrays)
    return found


class _StoredRun:
    """A stored run on its way; `clock` is its start as if it had never been cut off."""

    def __init__(
        self,
        runner: Runner,
        interval: Interval,
        run: _core.Run,
        stream: Stream,
        folder: Folder,
        clock: float,
    ) -> None:
        self._runner, self._interval, self._run = runner, interval, run
        self._stream, self._folder, self._clock = stream, folder, clock

    def go(self, progress: Progress) -> Solution:
        """Run to the end, and return the first and the last record."""
        with deferring() as is_interrupted:
            outcome = self._advance(progress, is_interrupted)
            if outcome == "interrupted":
                self._save()
            if not _is_cut(outcome):
                self._stream.add(self._run, self._run.take())
            if isinstance(outcome, dict):
                self._runner.add_cause(outcome, self._run)
            quantity = self._describe(outcome)
        solution = ends_of(self._folder.path, self._runner.system)
        if isinstance(outcome, dict):
            raise error_of(outcome, self._runner, quantity, solution) from outcome.get("cause")
        return solution

    def _advance(self, progress: Progress, is_interrupted: Callable[[], bool]) -> Outcome:
        with reported(progress, self._runner.steps.unit) as report:
            return self._advance_reporting(report, is_interrupted)

    def _advance_reporting(
        self, report: Report | None, is_interrupted: Callable[[], bool]
    ) -> Outcome:
        run, interval, stream = self._run, self._interval, self._stream
        most = stream.rows * self._runner.every
        last = time.monotonic()
        while True:
            outcome = advance_slice(run, interval.limit(run.done, most))
            try:
                stream.add(run, run.collect())
                if outcome == "paused" and interval.is_due(run.done, last):
                    self._save()
                    last = time.monotonic()
            except MemoryError:
                return {"kind": "no memory", "step": run.done, "start": run.t}
            try:
                report_progress(report, run, self._runner.steps)
            except KeyboardInterrupt:
                return "interrupted"
            if outcome != "paused":
                return outcome
            if is_interrupted():
                return "interrupted"

    def _save(self) -> None:
        self._stream.save(self._run, self._stats())

    def _stats(self) -> dict[str, Any]:
        """Return the numbers of the run so far."""
        found = self._runner.stats(self._run) | self._stream.totals
        return {**found, "seconds": time.perf_counter() - self._clock}

    def _describe(self, outcome: Outcome) -> str:
        """Write all records and how the run went; returns which quantity is to blame for it."""
        path = self._folder.path
        stats = self._stats()
        status, message, quantity = status_of(outcome, self._runner, stats, self._stream.end)
        if status != "failed":
            message = "; ".join(filter(None, [message, self._stream.remark(self._run)]))
        if status == "interrupted":
            message += f"; liouville.resume({str(path)!r}) goes on"
        h = self._runner.steps.mean(self._run.t, stats["steps"])
        ended = {"status": status, "message": message, "h": h, "stats": json.dumps(stats)}
        self._stream.finish(ended)
        self._folder.sync()
        if status == "done":
            (path / CHECKPOINT / STATE).unlink()
        return quantity


def _is_cut(outcome: Outcome) -> bool:
    """Return whether records end before the present state, as they do not fit."""
    return isinstance(outcome, dict) and outcome["kind"] == "no memory"


@contextmanager
def deferring() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C wait until it is asked for, so that nothing is cut off in the middle."""
    seen: list[int] = []
    is_ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if is_ours:
        signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    try:
        yield lambda: bool(seen)
    finally:
        if is_ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def pickled(job: tuple[Any, ...]) -> bytes:
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        hint = "define its functions in a module, at the top level, and not as lambdas"
        why = str(error).partition("\n")[0]
        sentence = f"the run cannot be stored, for what it does cannot be pickled: {why}"
        raise TypeError(hinted(sentence, hint)) from error


def _status(path: Path) -> str:
    """Return how the run in a folder stands, once it is seen to be one."""
    if not path.exists():
        raise FileNotFoundError(f"there is no folder {str(path)!r}")
    if not (path / META).is_file() or export.MARK not in attributes_of(path):
        raise ValueError(f"{str(path)!r} holds no run of liouville")
    if not (path / CHECKPOINT / JOB).is_file():
        hint = "only integrate(..., store=) leaves what is needed for that; liouville.load reads it"
        raise ValueError(hinted(f"{str(path)!r} holds a solution, and no run to go on with", hint))
    where, attributes = repr(str(path)), attributes_of(path / CHECKPOINT)
    status: str = schema.entry(attributes_of(path), "status", schema.TEXT, where)
    made = {key: schema.entry(attributes, key, kind, where) for key, kind in VERSION.items()}
    if status != "done" and (made["liouville"], made["layout"]) != (_core.VERSION, LAYOUT):
        hint = f"go on with liouville {made['liouville']}; liouville.load reads what is there"
        sentence = _foreign(path, f"of liouville {made['liouville']}, and this is {_core.VERSION}")
        raise ValueError(hinted(sentence, hint))
    return status


def _check(path: Path, file: str) -> None:
    """Refuse a file of the checkpoint that is damaged or lost."""
    try:
        is_whole = checksum.is_intact(path / CHECKPOINT / file)
    except OSError as error:
        raise ValueError(_foreign(path, f"whose state cannot be read: {error}")) from error
    if not is_whole:
        raise ValueError(checksum.damaged(path / CHECKPOINT / file))


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Hold the lock of a store."""
    with locked(lock_of(path), f"another process goes on with the run in {str(path)!r}"):
        yield


def _rename(temporary: Path, path: Path) -> None:
    """Let a folder appear, unless another did meanwhile."""
    try:
        temporary.rename(path)
    except OSError as error:
        if path.exists():
            raise is_there(path) from error
        raise


def _foreign(path: Path, why: str) -> str:
    return f"{str(path)!r} holds a run {why}"


def ends_of(path: Path, system: System | None) -> Solution:
    """Return the first and the last record, and where the others are."""
    return replace(export.ends(path), dense_order=0, path=str(path), system=system)
