"""Runs of a field with the determinant of the Jacobian of its steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from liouville import _core
from liouville._basics.arguments import check_memory
from liouville._basics.faults import Description
from liouville._methods import VolumeSplitting
from liouville._methods.planner import FieldPlan
from liouville._methods.splitting import to_core
from liouville._runs.fields.field import FieldRunner
from liouville._runs.fields.particles import ParticleRunner
from liouville._runs.fields.planes import PlaneRunner
from liouville._runs.runner import Request
from liouville._systems import Field


class Determinants(FieldRunner):
    """Runs a field with tangents; before another runner, which splits it."""

    def __init__(
        self, system: Field, method: VolumeSplitting | FieldPlan, request: Request
    ) -> None:
        super().__init__(system, method, request)
        n = len(system.coordinates)
        self.columns = {"x": n, "observed log_determinant": 1, "observed defect": 1}
        hint = "this is for fields of up to a few hundred variables: take a smaller one of the kind"
        check_memory(f"the Jacobian of {n} variables", 8.0 * n * n, hint)

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""
        job = replace(self.job, observer="determinants")
        return _core.run(to_core(self.split), self.choice.method, job)

    def describe(self, error: dict[str, Any]) -> Description:
        """Describe an error in the user's names: sentence, hint and quantity."""
        if error.get("quantity") == "observable":
            return (
                "the Jacobian of the step is singular to roundoff, its determinant unknown",
                "the step stretches some directions too much over others: try a smaller h",
                "determinant",
            )
        return super().describe(error)


class DeterminantRunner(Determinants):
    """Runs a polynomial field with tangents."""


class PlaneDeterminantRunner(Determinants, PlaneRunner):
    """Runs a field by planes with tangents."""


class ParticleDeterminantRunner(Determinants, ParticleRunner):
    """Runs charged particles with tangents."""
