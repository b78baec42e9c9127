"""Runs whose controlled steps are those of another: steps one by one, whatever their start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from liouville._runs.execute import Checkpoints, execute, finished
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request

#: A step of a given length has no control, and no more than itself.
ALONE: dict[str, Any] = {
    "steps": 1, "h": None, "rtol": None, "atol": None, "control": None, "every": 1,
    "tangents": None, "has_pullback": True,
}  # fmt: skip


class HeldSteps:
    """The steps of a controlled run, which other starts and parameters may take.

    Attributes
    ----------
    ends : ndarray
        The times between the steps.
    """

    def __init__(self, runner: TracedRunner, request: Request) -> None:
        self._runner = runner
        # with the pullback, whose errors the steps follow too
        whole = replace(request, every=1, t_eval=None, tangents=None, has_pullback=True)
        own = type(runner)(runner.system, runner.choice, whole)
        self.ends = finished(execute(own, checkpoints=Checkpoints(None))).t

    def states(self, request: Request) -> Mapping[str, np.ndarray]:
        """Return the states at the records of a request with another start and parameters."""
        runner, start, records = self._runner, dict(request.start), list[Mapping[str, np.ndarray]]()
        times = None if request.t_eval is None else np.asarray(request.t_eval, dtype=float)
        way = np.sign(self.ends[-1] - self.ends[0])
        for first, last in pairwise(self.ends.tolist()):
            own = np.array([first])  # without given times a record of the start of each step
            if times is not None:
                after = way * times > way * first
                own = times[(after | (first == self.ends[0])) & (way * times <= way * last)]
            seen = np.unique(np.append(own, last))[:: int(way)]
            step = replace(
                request, **ALONE, t=(first, last), start=start, t_eval=seen, is_ensemble=False
            )
            found = finished(execute(type(runner)(runner.system, runner.choice, step))).states
            records.append({name: x[: own.size] for name, x in found.items()})
            start = {name: found[name][-1] for name in self._carried(found)}
        if times is None:
            records.append({name: x[-1:] for name, x in found.items()})
        rows = {name: np.concatenate([each[name] for each in records]) for name in records[0]}
        if times is not None:
            return rows
        kept = np.unique([*range(0, self.ends.size, runner.every), self.ends.size - 1])
        return {name: x[kept] for name, x in rows.items()}

    def _carried(self, found: Mapping[str, np.ndarray]) -> tuple[str, ...]:
        """Return the states that a step begins with, those of the alpha family among them."""
        return tuple(name for name in (*self._runner.system.states, "a") if name in found)
