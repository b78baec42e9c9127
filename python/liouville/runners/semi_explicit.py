"""Runs of a semi-explicit system of index 2."""

from __future__ import annotations

import numpy as np

from liouville import _core
from liouville.control import Reversible
from liouville.errors import hinted
from liouville.runners.traced import TracedRunner
from liouville.systems import SemiExplicit


class SemiExplicitRunner(TracedRunner):
    """Runs a semi-explicit system; see :class:`Runner`."""

    system: SemiExplicit

    def _foreign(self) -> set[str]:
        return super()._foreign() | {"newton_steps"}

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

    def _point(self) -> tuple[np.ndarray, np.ndarray]:
        """Return y at the start, and the z that follows from it; where none does, the guess."""
        y, z = self._begin
        found = self.system.problem.unknowns(self.steps.t0, y, z, self._values)
        return y, z if isinstance(found, dict) else found
