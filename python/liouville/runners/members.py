"""Runs of an ensemble of mechanical trajectories."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._job import Job
from liouville.control import Takes
from liouville.errors import hinted
from liouville.methods import Method
from liouville.points import Points
from liouville.runners.mechanical import MechanicalRunner
from liouville.runners.runner import Request, threads_of
from liouville.systems import Mechanics, members
from liouville.systems._trace import mapping, numbers


class MembersRunner(MechanicalRunner):
    """Runs many trajectories of a mechanical system; see :class:`Runner`."""

    def __init__(self, system: Mechanics, method: Method, request: Request) -> None:
        self.threads = threads_of(request.threads)
        super().__init__(system, method, request)

    def _job(self) -> Job:
        return replace(super()._job(), params=self._rows, threads=self.threads, is_ensemble=True)

    @property
    def dense_order(self) -> int:
        """Zero: an ensemble has no dense output."""
        return 0

    def events(self, run: _core.Run) -> tuple[dict[str, Points], str]:
        """Return no events: an ensemble has none."""
        del run
        return {}, ""

    def _takes(self) -> Takes:
        return Takes(type(self.choice).__name__)

    def _take(self, request: Request) -> None:
        system = self.system
        given = members.starts(system, request.start, self._also)
        params, of_params = _params(system, request.params)
        counts = {name: len(x) for name, x in given.items() if x.ndim == 2} | of_params
        if not counts:
            raise ValueError(
                hinted(
                    f"no start value and no parameter has a row for each member: {', '.join(given)}"
                    f" have shape ({len(system.coordinates)},)",
                    "give arrays of shape (P, n) for P members; lv.integrate takes one start",
                )
            )
        first, many = next(iter(counts.items()))
        for name, count in counts.items():
            if count != many:
                raise ValueError(
                    f"{name} has {count} members along its first axis, {first} has {many}"
                )
        if not many:
            raise ValueError(f"{first} has no members along its first axis")
        self.members = (many,)
        n = len(system.coordinates)
        rows = (np.broadcast_to(x, (many, n)) for x in given.values())
        self._begin = tuple(np.ascontiguousarray(x) for x in rows)
        self._rows = np.ascontiguousarray(params)
        self._values = self._rows[0]
        y, z = self._begin[:2]
        kept = self._is_hidden_kept
        members.check(system, self.steps.t0, y, z, self._rows, hidden=kept)


def _params(
    system: Mechanics, changes: Mapping[str, ArrayLike] | None
) -> tuple[np.ndarray, dict[str, int]]:
    """Return rows of parameters, one or one for each member, and the members of each parameter."""
    defaults = system.params
    given = mapping("params", changes)
    own: dict[str, np.ndarray] = {}
    for name, value in given.items():
        array = numbers(value)
        ndim = np.ndim(defaults[name]) if name in defaults else 0
        if array is not None and name in defaults and array.ndim == ndim + 1:
            own[name] = array
    shared = {name: value for name, value in given.items() if name not in own}
    if not own:
        return system.values(shared)[None], {}
    rows = []
    for member in range(min(len(x) for x in own.values())):
        rows.append(system.values({**shared, **{name: x[member] for name, x in own.items()}}))
    width = system.values(shared).size
    counts = {f"parameter '{name}'": len(x) for name, x in own.items()}
    return np.array(rows).reshape(-1, width), counts
