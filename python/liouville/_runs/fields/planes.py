"""Runs of a field by planes, or of an ensemble of its states."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._methods import VolumeSplitting
from liouville._methods.control import Steps
from liouville._methods.planner import FieldPlan
from liouville._methods.planner.fields.planes import (
    MOST,
    USUAL,
    longest_stage,
    longest_step,
    order_of,
    plan_planes,
    split_of,
)
from liouville._methods.splitting import Plane, PlaneSplit
from liouville._runs.fields.field import TAKES, FieldRunner
from liouville._runs.runner import Request
from liouville._systems import Field
from liouville._systems.fields.plane_field import PlaneField

#: Trial runs begin with this part of the longest step, and find steps of this part at most.
FIRST, LAST = 0.5, 0.99

#: A time may be beyond the samples by this part of the run, from roundoff.
ROUNDOFF = 1e-12


class PlaneRunner(FieldRunner):
    """Runs a field by planes, or an ensemble of its states; see :class:`FieldRunner`."""

    split: PlaneSplit

    def __init__(
        self, system: Field, method: VolumeSplitting | FieldPlan, request: Request
    ) -> None:
        _check_times(_planar(system), request.steps_of(system, TAKES))
        super().__init__(system, method, request)

    def _planned(self, method: VolumeSplitting | FieldPlan, h: float) -> Any:
        """Return the plan for steps h, and the field split by it."""
        return plan_planes(_planar(self.system), method, h, self.x)

    def _own_plan(self, system: Field, h: float) -> Any:
        """Return the plan of all, and the field of a member split by it."""
        del h
        return self.choice, split_of(_planar(system))

    def _rates(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the rates of states x, shape (P, n)."""
        rates: np.ndarray = np.nan_to_num(_planar(self.system).velocity(x, t))
        return rates

    def _planned_once(
        self, method: VolumeSplitting | FieldPlan, h: float, x: np.ndarray, t: float
    ) -> tuple[VolumeSplitting | FieldPlan, int, float]:
        """Return the plan for trial runs, its order, and the step that they begin with."""
        system = _planar(self.system)
        rows = system.extended(x, t)
        own = method.method if isinstance(method, FieldPlan) else method
        name = USUAL[system.degree] if own.composition == "auto" else own.composition
        longest = FIRST * longest_step(system, name, rows)
        h = float(np.copysign(min(abs(h), longest), h))
        plan, _ = plan_planes(system, method, h, rows)
        order = plan.method.order
        assert order is not None, "a plan leaves nothing open"
        return plan, order_of(system, order), h

    def _longest_step(self, plan: VolumeSplitting | FieldPlan, x: np.ndarray, t: float) -> float:
        """Return the longest step for which the equations of planes have solutions for sure."""
        assert isinstance(plan, FieldPlan), "a plan was made for the trial runs"
        system = _planar(self.system)
        return LAST * longest_step(system, plan.method.composition, system.extended(x, t))

    def remark(self, run: _core.Run, t: np.ndarray, rows: np.ndarray) -> str:
        """Return sentences on starts on land, and on records that cannot be right.

        Those are where steps are longer than any that is taken there.
        """
        said = super().remark(run, t, rows)
        return "; ".join(filter(None, [said, self.remark_on(t, rows)]))

    def remark_on(self, t: np.ndarray, x: np.ndarray) -> str:
        """Return sentences on starts on land, and on steps that are too long."""
        return "; ".join(filter(None, [self._on_land(), self._too_long(t, x)]))

    def _on_land(self) -> str:
        """Say which starts are on land, where nothing moves."""
        system = _planar(self.system)
        found = np.flatnonzero(system.is_land(self.x[:, : len(system.coordinates)]))
        if not found.size:
            return ""
        if not self.members:
            return "the start is on land, where nothing moves"
        which = f"the first of them member {found[0]}"
        return f"{found.size} of {len(self.x)} members start on land, {which}"

    def _too_long(self, t: np.ndarray, rows: np.ndarray) -> str:
        """Say which record is the first where steps are too long, and how long they may be."""
        h, n = self.steps.mean(self.steps.t1, self.steps.count), self.columns.get("x", 0)
        if not n or not len(t):
            return ""
        largest = longest_stage(self.choice.method.composition)
        found = []
        for k, x in enumerate(np.moveaxis(rows.reshape(len(t), -1, rows.shape[-1]), 1, 0)):
            system = _planar(self.systems[k % len(self.systems)])
            states = np.column_stack([x[:, :n], t]) if system.is_driven else x[:, :n]
            steep = system.steepest_at(states)
            if steep is None:  # of all states alike, and looked at before
                return ""
            large = np.flatnonzero(largest * abs(h) * steep > MOST)
            if large.size:
                found.append((t[large[0]], k, MOST / (largest * np.nanmax(steep))))
        if not found:
            return ""
        time, k, _ = min(found, key=lambda each: abs(each[0] - self.steps.t0))
        of, longest = (f" of member {k}" if self.members else ""), min(each[2] for each in found)
        return (
            f"steps{of} are too long for the field at t = {time:.6g}, and states from there on may "
            f"be wrong: give h up to {0.99 * longest:.3g}"
        )

    def _described(self, error: dict[str, Any]) -> Any:
        if error["kind"] == "outside" and self.system.variables[error["index"]] == "t":
            return (
                "a stage of the composition is at a time outside the samples",
                "take BM4 or BM6, whose stages are within their step, or a shorter interval",
                "t",
            )
        if error["kind"] == "not converged":
            return (
                "the velocity changes too much within the step for its equations to be solved",
                "try a smaller h; a path that runs into a singularity has to end before it, by "
                'events={"near": lv.Event(f, terminal=True)}',
                "stages",
            )
        if error["kind"] == "singular function":
            piece = self.split.pieces[error["piece"]]
            assert isinstance(piece, Plane)
            what = piece.described(self.system.variables)
            return (
                f"the potential of the {what} is not finite, or its derivatives are not",
                "keep away from where it is singular, or end there by an Event with terminal=True; "
                "or try a smaller h",
                "potential",
            )
        return super()._described(error)


def _planar(system: Field) -> PlaneField:
    assert isinstance(system, PlaneField)
    return system


def _check_times(system: PlaneField, steps: Steps) -> None:
    """Refuse a run beyond the samples of a field that depends on time."""
    if system.times is None:
        return
    first, last = system.times
    slack = ROUNDOFF * (last - first)
    for t in (steps.t0, steps.t1):
        if not first - slack <= t <= last + slack:
            own, *ends = (system.written(x) for x in (t, first, last))
            sentence = f"t = {own} is outside the samples, which are from {ends[0]} to {ends[1]}"
            raise ValueError(hinted(sentence, "integrate within them, or give samples beyond"))
