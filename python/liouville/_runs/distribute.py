"""An ensemble in chunks on any executor of :mod:`concurrent.futures`: cut, sent and joined.

A chunk is sent as a function of this module with its arguments. The system goes with the first
chunks, and with every chunk where it is small; a worker keeps it, and returns None where it has not
got it yet. A chunk whose worker died is sent again.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import time
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import suppress
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any, cast

import numpy as np

from liouville._basics.arguments import count
from liouville._basics.errors import IntegrationError, hinted
from liouville._basics.progress import Progress, Report, reported
from liouville._solution.failure import Failure, ending_of, summary_of
from liouville._solution.parts import AND, GROUPS
from liouville._solution.solution import Solution
from liouville._solution.states import Stats

#: A chunk is sent so many times more if its worker dies.
AGAIN = 3

#: Chunks a worker, results of a chunk in bytes at most, members in lock-step on any machine.
CHUNKS, MOST, LANES = 4, 2**26, 16

#: A larger system is not sent with every chunk, in bytes; a worker keeps so many systems.
LARGE, CACHED = 100_000, 4

#: Seconds between two looks at the signals.
POLL = 0.2

#: Errors of dask.distributed, which is never imported here, where workers die.
DIED = {"KilledWorker", "FutureCancelledError", "FuturesCancelledError", "CommClosedError"}

#: Numbers of which an ensemble has the largest.
LARGEST = ("steps", "pieces", "bound")

_cache: dict[str, Callable[..., Solution]] = {}


@dataclass(frozen=True)
class Task:
    """An ensemble to distribute.

    Attributes
    ----------
    integrate : callable
        Integrates some of the members from their start values; it can be pickled.
    start : mapping of str to array
        Start values; what has two axes or more has the member as its first.
    params : mapping of str to array, or None
        Parameters; one with an axis more than its default in `defaults` has one for each member.
    members : int
        Number of members P.
    size : int
        About how many bytes the result has.
    t0 : float
        Time of the start.
    release : array, shape (members,), or None
        Times of release.
    """

    integrate: Callable[..., Solution]
    start: Mapping[str, Any]
    params: Mapping[str, Any] | None
    defaults: Mapping[str, Any]
    members: int
    size: int
    t0: float
    release: Any = None

    def cut(self, first: int, last: int) -> dict[str, Any]:
        """Return the start values and parameters of some of the members."""
        found = {name: _cut(x, 2, first, last) for name, x in self.start.items()}
        if self.params is not None:
            axes = {name: np.ndim(x) for name, x in self.defaults.items()}
            params = self.params.items()
            found["params"] = {k: _cut(x, axes[k] + 1, first, last) for k, x in params}
        if self.release is not None:
            found["release"] = self.release[first:last]
        return found


@dataclass
class _Chunk:
    first: int
    last: int
    tries: int = 0


def distribute(
    task: Task,
    executor: Executor,
    chunk: int | None = None,
    progress: Progress = None,
) -> Solution:
    """Integrate the members of an ensemble on the workers of an executor.

    What is sent is a pickle, and a worker that loads one runs any code in it: let workers take work
    from your own programs alone.

    Parameters
    ----------
    task : Task
        The ensemble.
    executor : Executor
        Its workers integrate the members.
    chunk : int, optional
        Members a chunk.
    progress : bool or callable, optional
        True shows a bar; or ``progress(done, total)``, called with numbers of members.

    Returns
    -------
    Solution
        Of all members, without a system. Members whose workers died are among its `failures`; an
        interrupt returns what was done.

    Raises
    ------
    TypeError, ValueError
        The executor is none, or chunk is no positive integer.
    IntegrationError
        A step of a member failed.
    BrokenExecutor
        No worker has done anything.
    """
    if not isinstance(executor, Executor):
        hint = "dask: client.get_executor(); MPI: mpi4py.futures.MPIPoolExecutor()"
        raise TypeError(
            hinted(f"executor must be a concurrent.futures.Executor, not {executor!r}", hint)
        )
    workers = _workers(executor)
    size = _size(task, workers) if chunk is None else count("chunk", chunk)
    with reported(progress, "members") as report:
        return _Distribution(task, executor, workers, report).run(size)


def integrate_chunk(
    name: str, work: bytes | None, start: dict[str, Any], attempt: int
) -> Solution | None:
    """Integrate a chunk, in a worker; None if the worker has no system of this name."""
    del attempt  # it makes calls differ: some executors run equal ones once
    integrate = _cache.get(name)
    if integrate is None:
        if work is None:
            return None
        integrate = pickle.loads(work)
        if len(_cache) >= CACHED:
            _cache.clear()
        _cache[name] = integrate
    return replace(integrate(**start), system=None)


class _Distribution:
    """An ensemble under way."""

    def __init__(
        self,
        task: Task,
        executor: Executor,
        workers: int,
        progress: Report | None,
    ) -> None:
        self._task, self._executor, self._progress = task, executor, progress
        self._work = pickle.dumps(task.integrate)
        self._name = hashlib.sha256(self._work).hexdigest()
        self._whole = workers  # so many further chunks have the system with them
        self._pending: dict[Future[Solution | None], _Chunk] = {}
        self._done: SimpleQueue[Future[Solution | None]] = SimpleQueue()
        self._lost: list[tuple[_Chunk, BaseException]] = []
        self._joined = Joined(task)

    def run(self, size: int) -> Solution:
        """Send all chunks, and join their solutions."""
        clock, is_interrupted = time.perf_counter(), False
        try:
            for first in range(0, self._task.members, size):
                self._send(_Chunk(first, min(first + size, self._task.members)))
            while self._pending:
                with suppress(Empty):
                    self._take(self._done.get(timeout=POLL))
        except KeyboardInterrupt:
            is_interrupted, self._progress = True, None
            while not self._done.empty():
                self._take(self._done.get())
            if self._joined.first is None:
                raise
        finally:
            for future in self._pending:
                future.cancel()
        if self._joined.first is None:
            raise self._nothing()
        seconds = time.perf_counter() - clock
        solution = self._joined.solution(self._lost, is_interrupted, seconds)
        if not len(solution.t) and len(solution.failures) == self._task.members:
            raise IntegrationError(solution.message, t=self._task.t0, member=0, solution=solution)
        return solution

    def _send(self, chunk: _Chunk, is_whole: bool = False) -> None:
        is_whole = is_whole or len(self._work) < LARGE or self._whole > 0
        self._whole -= 1
        start = self._task.cut(chunk.first, chunk.last)
        work = self._work if is_whole else None
        try:
            future = self._executor.submit(integrate_chunk, self._name, work, start, chunk.tries)
        except (BrokenExecutor, RuntimeError) as error:  # the latter from one that is shut down
            self._lost.append((chunk, error))
        else:
            self._pending[future] = chunk
            future.add_done_callback(self._done.put)

    def _take(self, future: Future[Solution | None]) -> None:
        chunk = self._pending.pop(future)
        try:
            found = future.result()
        except IntegrationError as error:
            found = error.solution
            if found is None or not found.failures:  # members that fail alone stop no others
                raise self._failed(chunk, error) from error
        except BaseException as error:
            if not _has_died(error):
                raise
            chunk.tries += 1
            if chunk.tries > AGAIN:
                self._lost.append((chunk, error))
            else:
                self._send(chunk, is_whole=True)
            return
        if found is None:
            self._send(chunk, is_whole=True)
            return
        self._joined.add(chunk.first, chunk.last, found)
        if self._progress is not None:
            self._progress(self._joined.done, self._task.members)

    def _failed(self, chunk: _Chunk, error: IntegrationError) -> IntegrationError:
        """Return the error of a member with its number in the whole ensemble."""
        message, member, solution = str(error), error.member, error.solution
        if member is not None:
            member += chunk.first
            message = message.replace(f"member {error.member}:", f"member {member}:", 1)
        if solution is not None:
            self._joined.add(chunk.first, chunk.last, solution)
            whole = self._joined.solution([], False, 0.0)
            solution = replace(whole, status="failed", message=message)
        return IntegrationError(
            message,
            t=error.t,
            step=error.step,
            quantity=error.quantity,
            member=member,
            solution=solution,
        )

    def _nothing(self) -> BaseException:
        """Return the error that kept all chunks from being integrated."""
        error = self._lost[0][1]
        error.add_note(
            "no member of the ensemble was integrated\nhint: processes that are spawned import the "
            'script: keep its calls under `if __name__ == "__main__":`'
        )
        return error


class Joined:
    """The solutions of chunks, member by member.

    Attributes
    ----------
    first : Solution or None
        The first that came.
    done : int
        Number of members that are there.
    """

    def __init__(self, task: Task) -> None:
        self.first: Solution | None = None
        self.done = 0
        self._task = task
        self._t = np.empty(0)
        self._arrays: dict[str, dict[str, np.ndarray]] = {group: {} for group in GROUPS}
        self._initial: dict[str, np.ndarray] = {}
        self._failures: dict[int, Failure] = {}
        self._stats: list[tuple[int, int, dict[str, Any]]] = []
        self._is_cut = False

    def add(self, first: int, last: int, part: Solution) -> None:
        """Put the members from `first` to before `last` into their places."""
        if self.first is None:
            self.first = part
        if len(part.t) > len(self._t):
            self._t = part.t
        for group in GROUPS:
            for name, x in getattr(part, group).items():
                place = self._place(self._arrays[group], name, x)
                place[: len(x), first:last] = x
        for name, x in part.initial.items():
            shape = (self._task.members, *x.shape[1:])
            self._initial.setdefault(name, np.full(shape, np.nan))[first:last] = x
        self._failures |= {first + member: x for member, x in part.failures.items()}
        self._stats.append((first, last - first, dict(part.stats)))
        self._is_cut |= part.status == "interrupted"
        self.done += last - first

    def _place(self, arrays: dict[str, np.ndarray], name: str, part: np.ndarray) -> np.ndarray:
        """Return the array for a quantity of all members, at least as long as this part of it."""
        old = arrays.get(name)
        k = 0 if old is None else len(old)
        if old is None or k < len(part):
            shape = (len(part), self._task.members, *part.shape[2:])
            arrays[name] = np.full(shape, np.nan, part.dtype)
            if old is not None:
                arrays[name][:k] = old
        return arrays[name]

    def solution(
        self, lost: list[tuple[_Chunk, BaseException]], is_interrupted: bool, seconds: float
    ) -> Solution:
        """Return all of it; what was not reached is NaN."""
        assert self.first is not None
        members = self._task.members
        failures = dict(self._failures)
        for chunk, error in lost:
            why = Failure(0, self._task.t0, f"its worker died ({type(error).__name__})")
            failures |= dict.fromkeys(range(chunk.first, chunk.last), why)
        failures = dict(sorted(failures.items()))
        status = ending_of(failures, members)
        message = summary_of(failures, members)
        if is_interrupted or self._is_cut:
            status = "interrupted"
            message = f"interrupted after {self.done} of {members} members"
        more: dict[str, Any] = {"t": self._t.copy(), **self._arrays, "initial": self._initial}
        return replace(
            self.first, **more, stats=cast(Stats, {**self._summed(), "seconds": seconds}),
            failures=failures, members=members, status=status,
            message=message,
        )  # fmt: skip

    def _summed(self) -> dict[str, Any]:
        """Return numbers of all chunks, as an ensemble that is not cut has them.

        Counts are added, what is no count is averaged over the members, and words are put together.
        """
        found: dict[str, Any] = {}
        for name in dict.fromkeys(name for _, _, stats in self._stats for name in stats):
            values = [(stats[name], many) for _, many, stats in self._stats if name in stats]
            first, _ = values[0]
            if isinstance(first, str):
                words = {word for x, _ in values for word in x.split(AND)}
                found[name] = AND.join(sorted(words))
            elif name in LARGEST:
                found[name] = max(x for x, _ in values)
            elif isinstance(first, int):
                found[name] = sum(x for x, _ in values)
            else:
                found[name] = sum(x * many for x, many in values) / self.done
        if not all("bound" in stats for _, _, stats in self._stats):
            found.pop("bound", None)
        return found


def _cut(value: Any, axes: int, first: int, last: int) -> Any:
    """Return the rows of some members, of what has so many axes; anything else as it is."""
    if isinstance(value, Mapping):
        return {name: _cut(x, axes - 1, first, last) for name, x in value.items()}
    return value[first:last] if np.ndim(value) >= axes else value


def _has_died(error: BaseException) -> bool:
    if isinstance(error, (BrokenExecutor, CancelledError)):
        return True
    return any(kind.__name__ in DIED for kind in type(error).__mro__)


def _workers(executor: Executor) -> int:
    """Return how many threads an executor's workers have, as far as it is known."""
    for name in ("num_workers", "_max_workers"):
        found = getattr(executor, name, None)
        if isinstance(found, int) and found > 0:
            return found
    client = getattr(executor, "_client", None)  # of dask
    if client is not None and hasattr(client, "ncores"):
        return max(int(sum(client.ncores().values())), 1)
    return os.cpu_count() or 1


def _size(task: Task, workers: int) -> int:
    """Return how many members make a chunk: whole blocks of lanes, and not too much to send."""
    size = -(-task.members // (CHUNKS * workers))
    size = -(-size // LANES) * LANES
    member = max(task.size // task.members, 1)
    return max(min(size, MOST // member), 1)
