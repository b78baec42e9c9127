"""The way of a semi-explicit system of index 2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville import _core
from liouville._arguments import steps_of
from liouville.methods import Composition, Spark
from liouville.points import Points
from liouville.routes.route import Asked, check_records, kept, observable
from liouville.systems import SemiExplicit


class SemiExplicitRoute:
    """A semi-explicit system on its way, see :class:`Route`."""

    members: tuple[int, ...] = ()

    def __init__(self, system: SemiExplicit, method: Spark | Composition, asked: Asked) -> None:
        self._system = system
        self._method = method
        self.method = repr(method)
        self.constraints = system.constraints
        self.pace = steps_of(
            asked.t, asked.h, asked.steps, asked.control, system.coordinates, type(method).__name__
        )
        self.every = kept(self.pace, asked.every)
        self._values = system.values(asked.params)
        self.params: Mapping[str, Any] = {**system.params, **dict(asked.params or {})}
        self._begin = system.start(asked.start)
        system.check(self.pace.t0, self._begin[0], self._values)
        self._states = asked.states
        self._observer, self._widths = system.observer(asked.observe)
        own = {"y": len(system.coordinates), "z": len(system.unknowns)} if asked.states else {}
        self.columns = {**own, **self._widths}
        records = -(-self.pace.count // self.every) + 1
        check_records(asked, records, self.row)

    @property
    def system(self) -> SemiExplicit:
        """What is integrated."""
        return self._system

    @property
    def choice(self) -> Spark | Composition:
        """The method."""
        return self._method

    @property
    def row(self) -> int:
        """Bytes of a record."""
        return 8 * (1 + sum(self.columns.values()))

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or say what is the trouble."""
        pace = self.pace
        return _core.semi_explicit_run(
            self.system.problem, self._method, self._observer, self._values, self._begin,
            (pace.t0, pace.t1, pace.count, self.every), self._states,
        )  # fmt: skip

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run."""
        wanted = ("iterations", "evaluations", "factorizations", "cold_starts")
        return {"steps": run.done, **{name: run.stats[name] for name in wanted}}

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Give the columns of all records as they are."""
        return parts

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return nothing: such a system has no energy of its own."""
        del parts
        return {}

    @property
    def dense_order(self) -> int:
        """Say that there is no dense output of such a run."""
        return 0

    def seen(self, run: _core.Run) -> tuple[dict[str, Points], str]:
        """Say that such a run looks for no events."""
        return {}, ""

    def describe(self, trouble: dict[str, Any]) -> tuple[str, str, str]:
        """Say what a trouble means in the user's names: sentence, hint and quantity."""
        if trouble.get("quantity") == "observable":
            trouble |= observable(trouble["index"], self._widths)
        return self.system.describe(trouble)
