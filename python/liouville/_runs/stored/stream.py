"""The records of a run on their way to its folder."""

from __future__ import annotations

import io
import json
import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville import _core
from liouville._runs.energy import sentence_of
from liouville._runs.execute import solution_of
from liouville._runs.runner import Runner
from liouville._runs.stored import arrays
from liouville._runs.stored.folder import Folder
from liouville._solution.points import Points
from liouville._solution.solution import Solution

#: Bytes of the records in a chunk, and events in one.
BYTES, EVENTS = 1 << 23, 4096

#: Seconds from which on readers see more: many small files take longer than a state.
PAUSE = 1.0

JOB, STATE = "job.pickle", "state.npz"

#: The axis of records.
TIME = "time"

Columns = dict[str, np.ndarray]


def chunks_of(runner: Runner, events: Mapping[str, Points]) -> dict[str, int]:
    """Return how many rows a chunk has along each axis that grows."""
    steps = runner.steps
    most = math.inf if steps.control else steps.records(runner.every)
    rows = int(max(1, min(BYTES // runner.row, most)))
    return {TIME: rows, **{arrays.event_axis(name): EVENTS for name in events}}


class Stream:
    """The records and events of a run: whole chunks in the folder, the rest here.

    At a checkpoint readers of the folder see the rest too, in a chunk that is written again later.

    Attributes
    ----------
    rows : int
        Records in a chunk.
    end : str
        What ended the run, if an event did.
    """

    def __init__(self, runner: Runner, folder: Folder, chunks: Mapping[str, int]) -> None:
        self._runner, self._folder, self._chunks = runner, folder, chunks
        self._rest: dict[str, list[Columns]] = {axis: [] for axis in chunks}
        self._written = dict.fromkeys(chunks, 0)
        self._first: Columns = {}
        self._last = 0, runner.steps.t0
        self._shown = -math.inf
        self._largest = 0.0
        self.rows = chunks[TIME]
        self.end = ""

    def add(self, run: _core.Run, records: tuple[np.ndarray, np.ndarray]) -> None:
        """Take records, and the events met until then."""
        times, rows = records
        if times.size:
            self._replace(times[0])
            self._last = self._last[0] + times.size, float(times[-1])
        self._largest = max(self._largest, self._runner.largest(rows))
        events, endings = self._runner.events(run)
        self.end = endings.get(0, "")
        if not self._first and times.size:
            self._first = {"t": times[:1].copy(), "rows": rows[:1].copy()}
        self._append(TIME, {"t": times, "rows": rows})
        for name, points in events.items():
            self._append(arrays.event_axis(name), {"t": points.t, **points.states})

    def remark(self, run: _core.Run) -> str:
        """Return a sentence on a run that cannot be right; empty where there is none."""
        said = sentence_of(run.found(), is_ensemble=False)
        return "; ".join(filter(None, [said, self._runner.outweighed(self._largest)]))

    def recent(self) -> Columns:
        """Return the records that do not fill a chunk yet."""
        return _joined(self._rest[TIME])

    def _replace(self, t: float) -> None:
        """Drop the last record where the next is of the state after a reset at its time."""
        if self._last[0] and self._last[1] == t:
            self._last = self._last[0] - 1, t
            rest = self._rest[TIME] = [_joined(self._rest[TIME])]
            rest[0] = {name: x[:-1] for name, x in rest[0].items()}

    def _append(self, axis: str, columns: Columns) -> None:
        rest, size = self._rest[axis], self._chunks[axis]
        if columns["t"].size or not rest:
            rest.append(columns)
        if sum(each["t"].size for each in rest) <= size:
            return
        columns = _joined(rest)
        # the last may still be replaced
        while columns["t"].size > size:
            self._put(axis, {name: x[:size] for name, x in columns.items()})
            self._written[axis] += 1
            columns = {name: x[size:] for name, x in columns.items()}
        # a view would keep the whole array
        rest[:] = [{name: x.copy() for name, x in columns.items()}]

    def _put(self, axis: str, columns: Columns) -> None:
        """Write the next chunk along an axis."""
        place = self._written[axis]
        if axis != TIME:
            for name, values in columns.items():
                self._folder.put(arrays.event_variable(axis, name), place, values)
            return
        # what is measured from the start needs it
        times = np.concatenate((self._first["t"], columns["t"]))
        rows = np.concatenate((self._first["rows"], columns["rows"]))
        found = arrays.along_time(self._solution(times, rows))
        for name in self._folder.arrays.keys() & found.keys():
            self._folder.put(name, place, found[name][1:])

    def _solution(self, times: np.ndarray, rows: np.ndarray) -> Solution:
        t0 = self._runner.steps.t0
        return solution_of(self._runner, times, rows, {"steps": 0}, t0, ("", ""), {})

    def save(self, run: _core.Run, stats: Mapping[str, Any]) -> None:
        """Write the records for readers of the folder, and then the state to go on from."""
        if time.monotonic() - self._shown >= PAUSE:
            self.finish(self._described(run, stats))
            self._shown = time.monotonic()
        memory = run.save()
        assert memory is not None, "ensembles are not stored"
        rest = {
            f"{axis}/{name}": x
            for axis, each in self._rest.items()
            for name, x in _joined(each).items()
        }
        first = {f"first/{name}": x for name, x in self._first.items()}
        own = {"end": self.end, "largest": self._largest}
        counts = {"written": self._written, "last": self._last, "stats": dict(stats)}
        state = json.dumps({**counts, **own})
        buffer = io.BytesIO()
        whole: dict[str, Any] = {"memory": memory, "counts": np.array(state), **rest, **first}
        np.savez(buffer, **whole)
        self._folder.commit(STATE, buffer.getvalue())

    def _described(self, run: _core.Run, stats: Mapping[str, Any]) -> dict[str, Any]:
        """Return the numbers of the run so far, as attributes."""
        if not (steps := stats.get("steps", 0)):
            return {}
        return {"stats": json.dumps(dict(stats)), "h": self._runner.steps.mean(run.t, steps)}

    def restore(
        self, run: _core.Run, state: Mapping[str, Any], attributes: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Go back to a state, and describe it; returns the statistics it was saved with."""
        run.restore(state["memory"])
        counts = json.loads(str(state["counts"]))
        self._written, self.end = counts["written"], counts["end"]
        self._last = tuple(counts["last"])
        self._largest = counts["largest"]
        rest: dict[str, Columns] = {axis: {} for axis in (*self._chunks, "first")}
        for key, values in state.items():
            axis, slash, name = key.rpartition("/")
            if slash:
                rest[axis][name] = values
        self._first = rest.pop("first")
        self._rest = {axis: [columns] for axis, columns in rest.items()}
        stats: dict[str, Any] = counts["stats"]
        # what was written after the state may be lost, and no reader may count on it
        self._folder.show(self._lengths(), {**attributes, **self._described(run, stats)})
        self.finish({})
        return stats

    def finish(self, attributes: Mapping[str, Any]) -> None:
        """Write what does not fill a chunk too, for readers of the folder, and attributes."""
        for axis, rest in self._rest.items():
            columns = _joined(rest)
            if columns["t"].size:
                self._put(axis, columns)
        self._folder.show(self._lengths(), attributes)

    def _lengths(self) -> dict[str, int]:
        """Return how many records and events there are."""
        return {
            axis: self._chunks[axis] * self._written[axis] + _joined(rest)["t"].size
            for axis, rest in self._rest.items()
        }


def _joined(rest: list[Columns]) -> Columns:
    """Return columns one after another, as one."""
    if len(rest) > 1:
        whole = {name: np.concatenate([each[name] for each in rest]) for name in rest[0]}
        rest[:] = [whole]
    return rest[0]
