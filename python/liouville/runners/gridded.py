"""Runs of a gridded field, or of an ensemble of its states."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville.control import Steps
from liouville.errors import hinted
from liouville.methods import VolumeSplitting
from liouville.planner import FieldPlan
from liouville.planner.fields.gridded import USUAL, longest_step, plan_gridded
from liouville.runners.field import TAKES, FieldRunner
from liouville.runners.runner import Request
from liouville.splitting import PlaneSplit
from liouville.systems import Field
from liouville.systems.gridded import GriddedField

#: Trial runs begin with this part of the longest step.
FIRST = 0.5

#: A time may be beyond the samples by this part of the run, from roundoff.
ROUNDOFF = 1e-12


class GriddedRunner(FieldRunner):
    """Runs a gridded field, or an ensemble of its states; see :class:`FieldRunner`."""

    split: PlaneSplit

    def __init__(
        self, system: Field, method: VolumeSplitting | FieldPlan, request: Request
    ) -> None:
        _check_times(_gridded(system), request.steps_of(system, TAKES))
        super().__init__(system, method, request)

    def _planned(self, method: VolumeSplitting | FieldPlan, h: float) -> Any:
        """Return the plan for steps h, and the field split by it."""
        return plan_gridded(_gridded(self.system), method, h)

    def _rates(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the rates of states x, shape (P, n)."""
        return np.nan_to_num(_gridded(self.system).velocity(x, t))

    def _planned_once(
        self, method: VolumeSplitting | FieldPlan, h: float, x: np.ndarray, t: float
    ) -> tuple[VolumeSplitting | FieldPlan, int, float]:
        """Return the plan for trial runs, its order, and the step that they begin with."""
        del x, t
        system = _gridded(self.system)
        own = method.method if isinstance(method, FieldPlan) else method
        name = USUAL[system.degree] if own.composition == "auto" else own.composition
        h = float(np.copysign(min(abs(h), FIRST * longest_step(system, name)), h))
        plan, _ = plan_gridded(system, method, h)
        order = plan.method.order
        assert order is not None, "a plan leaves nothing open"
        return plan, min(order, system.degree), h

    def _described(self, error: dict[str, Any]) -> Any:
        if error["kind"] == "outside" and self.system.variables[error["index"]] == "t":
            return (
                "a stage of the composition is at a time outside the samples",
                "take BM4 or BM6, whose stages are within their step, or a shorter interval",
                "t",
            )
        if error["kind"] == "not converged":
            return (
                "the equation of a plane was not solved",
                "try a smaller h",
                "stages",
            )
        return super()._described(error)


def _gridded(system: Field) -> GriddedField:
    assert isinstance(system, GriddedField)
    return system


def _check_times(system: GriddedField, steps: Steps) -> None:
    """Refuse a run beyond the samples of a field that depends on time."""
    if system.times is None:
        return
    first, last = system.times
    slack = ROUNDOFF * (last - first)
    for t in (steps.t0, steps.t1):
        if not first - slack <= t <= last + slack:
            sentence = f"t = {t:g} is outside the samples, which are from {first:g} to {last:g}"
            raise ValueError(hinted(sentence, "integrate within them, or give samples beyond"))
