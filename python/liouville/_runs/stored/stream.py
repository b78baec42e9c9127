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

#: The axis of records, and what the first one is kept by.
TIME, FIRST = "time", "first"

#: Rows by the names of their columns.
Rows = dict[str, np.ndarray]


def chunks_of(runner: Runner, events: Mapping[str, Points]) -> dict[str, int]:
    """Return how many rows a chunk has along each axis that grows."""
    steps = runner.steps
    most = math.inf if steps.control else steps.records(runner.every)
    rows = int(max(1, min(BYTES // runner.row, most)))
    return {TIME: rows, **{arrays.event_axis(name): EVENTS for name in events}}


class Columns:
    """Rows along axes that grow: whole chunks in the folder, the rest here.

    At a checkpoint readers of the folder see the rest too, in a chunk that is written again later.

    Attributes
    ----------
    rows : int
        Records in a chunk.
    """

    def __init__(self, folder: Folder, chunks: Mapping[str, int]) -> None:
        self._folder, self._chunks = folder, chunks
        self.rows = chunks[TIME]
        self._rest: dict[str, list[Rows]] = {axis: [] for axis in chunks}
        self._written = dict.fromkeys(chunks, 0)
        self._first: Rows = {}

    def named(self, axis: str, rows: Rows) -> Rows:
        """Return rows by the names of arrays."""
        del axis
        return rows

    def append(self, axis: str, rows: Rows) -> None:
        """Take rows along an axis."""
        rest, size = self._rest[axis], self._chunks[axis]
        if count_of(rows) or not rest:
            rest.append(rows)
        if sum(map(count_of, rest)) <= size:
            return
        rows = _joined(rest)
        # the last may still be replaced
        while count_of(rows) > size:
            self._put(axis, {name: x[:size] for name, x in rows.items()})
            self._written[axis] += 1
            rows = {name: x[size:] for name, x in rows.items()}
        # a view would keep the whole array
        rest[:] = [{name: x.copy() for name, x in rows.items()}]

    def _put(self, axis: str, rows: Rows) -> None:
        """Write the next chunk along an axis."""
        for name, values in self.named(axis, rows).items():
            self._folder.put(name, self._written[axis], values)

    def finish(self, attributes: Mapping[str, Any]) -> None:
        """Write what does not fill a chunk too, for readers of the folder, and attributes."""
        for axis, rest in self._rest.items():
            if count_of(rows := _joined(rest)):
                self._put(axis, rows)
        self._folder.show(self._lengths(), attributes)

    def commit(self, memory: np.ndarray, counts: Mapping[str, Any]) -> None:
        """Write the state to go on from."""
        rest = {
            f"{axis}/{name}": x
            for axis, each in self._rest.items()
            for name, x in _joined(each).items()
        }
        state = np.array(json.dumps({"written": self._written, **counts}))
        buffer = io.BytesIO()
        first = {f"{FIRST}/{name}": x for name, x in self._first.items()}
        whole: dict[str, Any] = {"memory": memory, "counts": state, **rest, **first}
        np.savez(buffer, **whole)
        self._folder.commit(STATE, buffer.getvalue())

    def take_back(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Go back to a state; returns the numbers that were written with it."""
        counts: dict[str, Any] = json.loads(str(state["counts"]))
        self._written = counts["written"]
        rest: dict[str, Rows] = {axis: {} for axis in (*self._rest, FIRST)}
        for key, values in state.items():
            axis, slash, name = key.rpartition("/")
            if slash:
                rest[axis][name] = values
        self._first = rest.pop(FIRST)
        self._rest = {axis: [rows] for axis, rows in rest.items()}
        return counts

    def show_anew(self, attributes: Mapping[str, Any]) -> None:
        """Show what there is after a state was taken back."""
        # records behind the state may be lost, and no reader may count on them
        self._folder.show(self._lengths(), attributes)
        self.finish({})

    def _lengths(self) -> dict[str, int]:
        """Return how many rows there are along each axis."""
        return {
            axis: self._chunks[axis] * self._written[axis] + count_of(_joined(rest))
            for axis, rest in self._rest.items()
        }


class Stream(Columns):
    """The records and events of a run.

    Attributes
    ----------
    end : str
        What ended the run, if an event did.
    totals : dict
        Statistics that come from the records.
    """

    def __init__(self, runner: Runner, folder: Folder, chunks: Mapping[str, int]) -> None:
        super().__init__(folder, chunks)
        self._runner = runner
        self._last = 0, runner.steps.t0
        self._shown = -math.inf
        self._largest = 0.0
        self.end = ""
        self.totals: dict[str, Any] = {}

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
        if times.size:
            self.totals = self._runner.totals(np.concatenate((self._first["rows"], rows[-1:])))
        self.append(TIME, {"t": times, "rows": rows})
        for name, points in events.items():
            self.append(arrays.event_axis(name), {"t": points.t, **points.states})

    def remark(self, run: _core.Run) -> str:
        """Return a sentence on a run that cannot be right; empty where there is none."""
        said = sentence_of(run.found(), is_ensemble=False)
        return "; ".join(filter(None, [said, self._runner.outweighed(self._largest)]))

    def _replace(self, t: float) -> None:
        """Drop the last record where the next is of the state after a reset at its time."""
        if self._last[0] and self._last[1] == t:
            self._last = self._last[0] - 1, t
            rest = self._rest[TIME] = [_joined(self._rest[TIME])]
            rest[0] = {name: x[:-1] for name, x in rest[0].items()}

    def named(self, axis: str, rows: Rows) -> Rows:
        """Return records and events by the names of arrays."""
        if axis != TIME:
            return {arrays.event_variable(axis, name): x for name, x in rows.items()}
        # what is measured from the start needs it
        times = np.concatenate((self._first["t"], rows["t"]))
        found = arrays.rows_of(
            self._solution(times, np.concatenate((self._first["rows"], rows["rows"])))
        )[TIME]
        return {name: x[1:] for name, x in found.items() if name in self._folder.arrays}

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
        own = {"end": self.end, "largest": self._largest, "last": self._last}
        own["totals"] = self.totals
        self.commit(memory, {"stats": dict(stats), **own})

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
        counts = self.take_back(state)
        self.end, self._largest = counts["end"], counts["largest"]
        self._last, self.totals = tuple(counts["last"]), counts["totals"]
        stats: dict[str, Any] = counts["stats"]
        self.show_anew({**attributes, **self._described(run, stats)})
        return stats


def count_of(rows: Rows) -> int:
    """Return how many rows there are."""
    return len(next(iter(rows.values())))


def _joined(rest: list[Rows]) -> Rows:
    """Return rows one after another, as one."""
    if len(rest) > 1:
        whole = {name: np.concatenate([each[name] for each in rest]) for name in rest[0]}
        rest[:] = [whole]
    return rest[0]
