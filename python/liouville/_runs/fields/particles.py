"""Runs of charged particles, or of an ensemble of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville._methods import VolumeSplitting
from liouville._methods.planner import FieldPlan
from liouville._methods.planner.fields.particles import plan_particles, split_of
from liouville._runs.fields.field import FieldRunner
from liouville._systems import Field
from liouville._systems.fields.particles import ChargedParticles


class ParticleRunner(FieldRunner):
    """Runs charged particles, or an ensemble of them; see :class:`FieldRunner`."""

    def _planned(self, method: VolumeSplitting | FieldPlan, h: float) -> Any:
        """Return the plan for steps h, and the field split by it."""
        return plan_particles(_particles(self.system), method, h, self.x)

    def _own_plan(self, system: Field, h: float) -> Any:
        """Return the plan of all, and the field of a member split by it."""
        del h
        return self.choice, split_of(_particles(system), self.choice.method.turn)

    def _planned_once(
        self, method: VolumeSplitting | FieldPlan, h: float, x: np.ndarray, t: float
    ) -> tuple[VolumeSplitting | FieldPlan, int, float]:
        """Return the plan for trial runs, its order, and the step that they begin with."""
        plan, _ = plan_particles(_particles(self.system), method, h, self.system.extended(x, t))
        assert plan.method.order is not None, "a plan leaves nothing open"
        return plan, plan.method.order, h


def _particles(system: Field) -> ChargedParticles:
    assert isinstance(system, ChargedParticles)
    return system
