"""Runs of a semi-explicit system of index 2."""

from __future__ import annotations

from typing import Any

from liouville import _core
from liouville._job import Job
from liouville.control import Takes
from liouville.errors import Description
from liouville.methods import Composition, Spark
from liouville.runners.runner import Request, Runner, kept
from liouville.systems import SemiExplicit

#: The numbers of a run that it has.
STATS = ("iterations", "evaluations", "factorizations", "cold_starts")

#: Errors of such systems are not estimated, and no steps follow their motion.
TAKES = Takes("a semi-explicit system", hint="give h or steps; half of h shows the error")


class SemiExplicitRunner(Runner):
    """Runs a semi-explicit system; see :class:`Runner`."""

    system: SemiExplicit
    choice: Spark | Composition

    def __init__(self, system: SemiExplicit, method: Spark | Composition, request: Request) -> None:
        self.system, self.choice, self.method = system, method, repr(method)
        self.constraints = system.constraints
        self.steps = request.steps_of(system, TAKES)
        self.every = kept(self.steps, request.every)
        self._values = system.values(request.params)
        self.params = {**system.params, **dict(request.params or {})}
        self._begin = system.start(request.start)
        system.check(self.steps.t0, self._begin[0], self._values)
        self._states = request.states
        self._observer, self.widths = system.observer(request.observe)
        own = {"y": len(system.coordinates), "z": len(system.unknowns)} if request.states else {}
        self.columns = {**own, **self.widths}
        self._check_records(request, self.steps.records(self.every))

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""
        steps = self.steps
        job = Job(
            start=self._begin, span=(steps.t0, steps.t1, steps.count, self.every),
            observer=self._observer, params=self._values, states=self._states,
        )  # fmt: skip
        return _core.run(self.system.problem, self.choice, job)

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run."""
        return {"steps": run.done, **{name: run.stats[name] for name in STATS}}

    def _described(self, error: dict[str, Any]) -> Description:
        return self.system.describe(error)
