"""How a stored run begins, goes on, and ends."""

from __future__ import annotations

import json
import os
import pickle
import re
import shutil
import signal
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from liouville import _core, export
from liouville._arguments import count
from liouville.errors import hinted
from liouville.integrate import advanced, failure, reporting, run, solution_of, verdict
from liouville.routes import Route
from liouville.solution import Solution
from liouville.stored import arrays
from liouville.stored.folder import CHECKPOINT, META, Folder, attributes_of
from liouville.stored.stream import JOB, STATE, Stream, chunks_of

#: The layout of a checkpoint.
LAYOUT = 1

Progress = Callable[[float, float], None] | None

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}

#: What a folder says of a run that is going on, or was cut off.
CUT_OFF = "not finished: liouville.resume goes on with it"


@dataclass(frozen=True)
class Place:
    """Where a run is stored, and after how many steps or seconds its state is."""

    path: Path
    steps: int | None = None
    seconds: float = 30.0

    def due(self, done: int, last: float) -> bool:
        """Say whether it is time for the state, given steps and when it was stored last."""
        if self.steps is not None:
            return done % self.steps == 0
        return time.monotonic() - last >= self.seconds

    def limit(self, done: int, most: int) -> int:
        """Return how many steps in all are enough for now, if `most` further ones are."""
        if self.steps is None:
            return done + most
        return min(done + most, (done // self.steps + 1) * self.steps)


def place(store: Any, checkpoint: Any) -> Place:
    """Check where a run is to be stored, and how often its state.

    Raises
    ------
    TypeError, ValueError, ImportError, FileNotFoundError
        `store` is no path that a run could be stored at, or `checkpoint` says no number of steps
        and no time.
    FileExistsError
        There is something already.
    """
    if not isinstance(store, str | os.PathLike):
        raise TypeError(f"store is a path, not {store!r}")
    path = Path(store)
    if path.suffix != ".zarr":
        raise ValueError(f"a run is stored in a .zarr folder, not in {str(path)!r}")
    export.check(path)
    if path.exists():
        hint = f"liouville.resume({str(path)!r}) goes on with a run that is there"
        raise FileExistsError(hinted(f"there is something at {str(path)!r} already", hint))
    return Place(path, *_often(checkpoint))


def _often(checkpoint: Any) -> tuple[int | None, float]:
    """Return steps, if they are given, and seconds between two states."""
    if checkpoint is None:
        return None, Place.seconds
    if not isinstance(checkpoint, str):
        return int(count("checkpoint", checkpoint)), Place.seconds
    found = re.fullmatch(r"\s*(\d+\.?\d*)\s*(s|min|h)\s*", checkpoint)
    if found is None or not float(found[1]):
        hint = "give checkpoint=10_000, or '30s', '10min' or '2h'"
        raise ValueError(hinted(f"checkpoint={checkpoint!r} says neither steps nor a time", hint))
    return None, float(found[1]) * UNITS[found[2]]


def begin(path: Route, where: Place, progress: Progress) -> Solution:
    """Go the route of a system and a method to its end, storing what it leaves on the way."""
    clock = time.perf_counter()
    started = path.start()
    if isinstance(started, dict):
        return run(path, progress)  # which says why
    job = _pickled((path, where.steps, where.seconds))
    records, (events, _) = started.collect(), path.seen(started)
    chunks = chunks_of(path, events)
    none = np.empty((0, sum(path.columns.values())))
    told = ("interrupted", CUT_OFF)
    empty = solution_of(path, np.empty(0), none, {"steps": 0}, path.pace.t0, told, events)
    # the folder appears with all that is needed to go on
    temporary = where.path.with_name(f".{where.path.name}.{os.getpid()}.tmp")
    try:
        arrays.prepare(empty, temporary, chunks)
        folder = Folder(temporary, chunks)
        version = {"liouville": _core.VERSION, "layout": LAYOUT}
        group = {"attributes": version, "zarr_format": 3, "node_type": "group"}
        (temporary / CHECKPOINT).mkdir()
        folder.commit(META, json.dumps(group).encode())
        folder.commit(JOB, job)
        stream = Stream(path, folder, chunks)
        stream.add(started, records)
        stream.save(started, {"seconds": 0.0})
        temporary.rename(where.path)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    folder.path = where.path
    return _Journey(path, where, started, stream, folder, clock).go(progress)


def resume(
    store: str | os.PathLike[str],
    *,
    checkpoint: int | str | None = None,
    progress: Progress = None,
) -> Solution:
    """Go on with a stored run that was cut off, interrupted, or failed.

    The result is that of a run that was never cut off, bit for bit: what was recorded after the
    last checkpoint is made again. What to do is read from the folder by unpickling, which can run
    any code: resume only what you stored yourself. Nobody else may go on with the run meanwhile.

    Parameters
    ----------
    store : path
        The ``.zarr`` folder that :func:`integrate` was given as ``store=``.
    checkpoint : int or str, optional
        Steps or time between two checkpoints, if not those of before.
    progress : callable, optional
        As for :func:`integrate`.

    Returns
    -------
    Solution
        As of :func:`integrate` with ``store=``; of a run that is done what it left.

    Raises
    ------
    FileNotFoundError
        There is nothing at this path.
    ValueError
        What is there is no stored run, or one of another version of liouville.
    IntegrationError
        A step failed; ``error.solution`` is what was computed before it.
    """
    clock = time.perf_counter()
    path = Path(store)
    if _status(path) == "done":
        return _light(path, None)
    route, steps, seconds = pickle.loads((path / CHECKPOINT / JOB).read_bytes())
    state = _state(path)
    where = Place(path, *((steps, seconds) if checkpoint is None else _often(checkpoint)))
    started = route.start()
    if isinstance(started, dict):
        raise ValueError(_foreign(path, "whose start cannot be taken any more"))
    events, _ = route.seen(started)
    chunks = chunks_of(route, events)
    folder = Folder(path, chunks)
    folder.clear()
    stream = Stream(route, folder, chunks)
    try:
        stats = stream.restore(started, state)
    except ValueError as error:
        raise ValueError(_foreign(path, "whose state is of another run")) from error
    folder.describe({**attributes_of(path), "status": "interrupted", "message": CUT_OFF})
    before = clock - stats["seconds"]
    return _Journey(route, where, started, stream, folder, before).go(progress)


class _Journey:
    """A stored run on its way; `clock` is when it would have begun if it had never been cut off."""

    def __init__(
        self,
        path: Route,
        where: Place,
        run: _core.Run,
        stream: Stream,
        folder: Folder,
        clock: float,
    ) -> None:
        self._path, self._where, self._run = path, where, run
        self._stream, self._folder, self._clock = stream, folder, clock

    def go(self, progress: Progress) -> Solution:
        """Go to the end, and say what is there."""
        with _deferring() as is_interrupted:
            outcome = self._drive(progress, is_interrupted)
            if outcome == "interrupted":
                self._save()
            self._stream.add(self._run, self._run.take())
            self._stream.finish()
            quantity = self._tell(outcome)
        solution = _light(self._where.path, self._path)
        if isinstance(outcome, dict):
            raise failure(outcome, self._path, quantity, solution) from outcome.get("cause")
        return solution

    def _drive(
        self, progress: Progress, is_interrupted: Callable[[], bool]
    ) -> str | dict[str, Any]:
        run, where, stream = self._run, self._where, self._stream
        report = reporting(run, self._path, progress)
        most = stream.rows * self._path.every
        last = time.monotonic()
        while True:
            outcome = advanced(run, where.limit(run.done, most))
            stream.add(run, run.collect())
            if outcome == "paused" and where.due(run.done, last):
                self._save()
                last = time.monotonic()
            try:
                report()
            except KeyboardInterrupt:
                return "interrupted"
            if outcome != "paused":
                return outcome
            if is_interrupted():
                return "interrupted"

    def _save(self) -> None:
        self._stream.save(self._run, {"seconds": time.perf_counter() - self._clock})

    def _tell(self, outcome: str | dict[str, Any]) -> str:
        """Write how the run went; returns which quantity is to blame if it failed."""
        stats = self._path.stats(self._run)
        stats["seconds"] = time.perf_counter() - self._clock
        status, message, quantity = verdict(outcome, self._path, stats, self._stream.end)
        if status == "interrupted":
            message += f"; liouville.resume({str(self._where.path)!r}) goes on"
        h = self._path.pace.mean(np.array([self._run.t]), stats["steps"])
        told = {"status": status, "message": message, "h": h, "stats": json.dumps(stats)}
        self._folder.describe({**attributes_of(self._where.path), **told})
        self._folder.sync()
        if status == "done":
            (self._where.path / CHECKPOINT / STATE).unlink()
        return quantity


@contextmanager
def _deferring() -> Iterator[Callable[[], bool]]:
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


def _pickled(job: tuple[Any, ...]) -> bytes:
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
    status: str = attributes_of(path)["status"]
    told = attributes_of(path / CHECKPOINT)
    if status != "done" and (told["liouville"], told["layout"]) != (_core.VERSION, LAYOUT):
        hint = f"go on with liouville {told['liouville']}; liouville.load reads what is there"
        sentence = _foreign(path, f"of liouville {told['liouville']}, and this is {_core.VERSION}")
        raise ValueError(hinted(sentence, hint))
    return status


def _state(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path / CHECKPOINT / STATE, allow_pickle=False) as state:
            return dict(state)
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(_foreign(path, f"whose state cannot be read: {error}")) from error


def _foreign(path: Path, why: str) -> str:
    return f"{str(path)!r} holds a run {why}"


def _light(path: Path, route: Route | None) -> Solution:
    """Return the first and the last record, and where the others are."""
    system = None if route is None else route.system
    return replace(export.ends(path), dense_order=0, path=str(path), system=system)
