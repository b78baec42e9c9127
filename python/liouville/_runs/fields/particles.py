"""Runs of charged particles, or of an ensemble of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville import _core
from liouville._methods import VolumeSplitting
from liouville._methods.planner import FieldPlan
from liouville._methods.planner.fields.particles import (
    FEWEST,
    frequencies,
    plan_particles,
    split_of,
)
from liouville._runs.fields.field import FieldRunner
from liouville._systems import Field
from liouville._systems.fields.particles import ChargedParticles

#: So many records are looked at.
LOOKED = 256


class ParticleRunner(FieldRunner):
    """Runs charged particles, or an ensemble of them; see :class:`FieldRunner`."""

    def _planned(self, method: VolumeSplitting | FieldPlan, h: float) -> Any:
        """Return the plan for steps h, and the field split by it."""
        return plan_particles(_particles(self.system), method, h, self.x)

    def _own_plan(self, system: Field, h: float) -> Any:
        """Return the plan of all, and the field of a member split by it."""
        del h
        return self.choice, split_of(_particles(system), self.choice.method.turn)

    def remark(self, run: _core.Run, t: np.ndarray, rows: np.ndarray) -> str:
        """Return sentences on a run that cannot be right, as gyrations have too few steps."""
        return "; ".join(filter(None, [super().remark(run, t, rows), self.remark_on(t, rows)]))

    def remark_on(self, t: np.ndarray, x: np.ndarray) -> str:
        """Return a sentence on gyrations that have too few steps."""
        return self._too_long(t, x)

    def _too_long(self, t: np.ndarray, rows: np.ndarray) -> str:
        """Say where a gyration has the fewest steps, if too few; some of many records are taken."""
        h, width = self.steps.mean(self.steps.t1, self.steps.count), self.columns.get("x", 0)
        if not width or not len(t):
            return ""
        each = rows.reshape(len(t), -1, rows.shape[-1])
        taken = np.unique(np.linspace(0, each[..., 0].size - 1, LOOKED).astype(int))
        records, members = np.unravel_index(taken, each.shape[:2])
        splits, found = self.splits or [self.split], np.zeros(taken.size)
        for k in np.unique(members % len(splits)):
            own = np.flatnonzero(members % len(splits) == k)
            states = [
                self.systems[k].extended(each[i, member, None, :width], t[i])[0]
                for i, member in zip(records[own], members[own], strict=True)
            ]
            found[own] = frequencies(splits[k], np.array(states))
        worst = int(np.argmax(np.nan_to_num(found)))
        angle = found[worst] * abs(h)
        if not 2 * np.pi < FEWEST * angle:
            return ""
        of = f" of member {members[worst]}" if self.members else ""
        longest = 2 * np.pi / (FEWEST * found[worst])
        return (
            f"a gyration{of} has {2 * np.pi / angle:.3g} steps at t = {t[records[worst]]:.6g}, and "
            f"orbits want {FEWEST} at least: give h up to {longest:.3g}"
        )

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
