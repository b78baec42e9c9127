"""Runs of a semi-explicit system of index 2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._basics.job import Job
from liouville._methods import Method
from liouville._methods.control import Reversible
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request
from liouville._solution.tangents import Tangent
from liouville._systems import SemiExplicit

if TYPE_CHECKING:
    from liouville._systems.derivatives.sensitivity import Cotangents


class SemiExplicitRunner(TracedRunner):
    """Runs a semi-explicit system; see :class:`Runner`."""

    system: SemiExplicit

    def __init__(self, system: SemiExplicit, method: Method, request: Request) -> None:
        super().__init__(system, method, request)
        self._set_directions(request)

    def _job(self) -> Job:
        job = super()._job()
        if self._directions is not None:
            own, (y, z) = self._directions, self._begin
            params = self._rows if self.members else self._values
            start = own.starts(self.system, self.steps.t0, y, z, params)
            parts = map(np.ascontiguousarray, (*start, own.tau))
            job.tangents = (self.sensitivity()[0], *parts, own.stretch, None)
        return job

    def tangents(self, t: np.ndarray, parts: Mapping[str, np.ndarray]) -> dict[str, Tangent]:
        """Return the tangents in records by the names of their directions, if any were wanted."""
        del t
        if self._directions is None:
            return {}
        own, names = self._directions, self.system.states
        sizes = len(self.system.coordinates), len(self.system.unknowns), None
        return own.read(names, parts["tangents"], sizes, self._moved_events)

    def sensitivity(self) -> tuple[_core.SemiExplicitSensitivity, None]:
        """Return derivatives by time and parameters."""
        # imported here: few runs are differentiated
        from liouville._systems.derivatives.semi_explicit import sensitivity

        return sensitivity(self.system), None

    def pulled_start(self, found: Cotangents) -> Cotangents:
        """Return cotangents of a start that is moved onto the constraints, from those there."""
        # imported here: few runs are differentiated
        from liouville._systems.derivatives.semi_explicit import pulled_start

        of_y, of_z, of_tau = found
        at = self.steps.t0, self._begin[0], self._values
        of_y, of_tau = pulled_start(self.system, *at, (of_y, of_tau))
        return of_y, of_z, of_tau

    def _unused_stats(self) -> set[str]:
        return super()._unused_stats() | {"newton_steps"}

    def _form(self) -> _core.SemiExplicit:
        return self.system.problem

    def _monitored(self, control: Reversible) -> tuple[_core.Tape, bool] | None:
        if control.monitor is None:
            raise TypeError(
                hinted(
                    "a semi-explicit system has no accelerations, whose time scale reversible "
                    "steps follow without a monitor",
                    "give control=lv.Reversible(monitor=lambda t, y, z, params: ...), or rtol=",
                )
            )
        return super()._monitored(control)

    def _first_z(self, y: np.ndarray, z: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the z that follows from a start; where none does, the guess."""
        found = self.system.problem.unknowns(self.steps.t0, y, z, values)
        return z if isinstance(found, dict) else found
