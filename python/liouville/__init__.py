"""Structure-preserving time integrators: a Rust core with a Python front."""

import typing as _typing
from importlib import import_module as _import_module

from liouville._basics.errors import IntegrationError, OptimizationError
from liouville._basics.errors import no_attribute as _no_attribute
from liouville._core import VERSION as _VERSION
from liouville._methods import (
    HHT,
    ArnoldBruls,
    Chebyshev,
    Composition,
    GeneralizedAlpha,
    GrayManolopoulos,
    Lanczos,
    LobattoPair,
    Magnus,
    SchrodingerSplitting,
    Spark,
    SplitOperator,
    StabilitySplitting,
    VolumeSplitting,
)
from liouville._methods.control import Adaptive, Reversible
from liouville._runs.ensemble import ensemble
from liouville._runs.integrate import integrate
from liouville._solution.failure import Failure
from liouville._solution.points import Points
from liouville._solution.solution import Solution
from liouville._solution.tangents import Tangent
from liouville._studies.section import Section, section
from liouville._systems import (
    BosonSystem,
    FermionSystem,
    Grid,
    Hamiltonian,
    Lagrangian,
    Lattice,
    Mechanical,
    PolynomialField,
    Schrodinger,
    SemiExplicit,
    SpinChain,
    SpinSystem,
    Structure,
)
from liouville._systems.events import Event, Impact

__version__ = _VERSION

if _typing.TYPE_CHECKING:
    from liouville import analysis as analysis
    from liouville import bodies as bodies
    from liouville import plot as plot
    from liouville import problems as problems
    from liouville import results as results
    from liouville._bridges import casadi as casadi
    from liouville._bridges import fem as fem
    from liouville._bridges import jax as jax
    from liouville._bridges import torch as torch
    from liouville._methods.planner import FieldPlan, Plan, WavePlan
    from liouville._methods.planner.choice import plan
    from liouville._runs.gradients import Pullback, vjp
    from liouville._runs.stored import Store, resume
    from liouville._solution.export import load
    from liouville._studies.fitting import Trial, fit
    from liouville._studies.optimal import OptimalControl, optimal_control
    from liouville._systems.fields.gridded import GriddedField
    from liouville._systems.fields.particles import ChargedParticles
    from liouville._systems.fields.vector_potential import PotentialField
    from liouville._systems.mechanics.contact import Contact
    from liouville._systems.sympy.mechanics import from_sympy
    from liouville._systems.tracing.table import table

__all__ = [
    "HHT",
    "Adaptive",
    "ArnoldBruls",
    "BosonSystem",
    "ChargedParticles",
    "Chebyshev",
    "Composition",
    "Contact",
    "Event",
    "Failure",
    "FermionSystem",
    "FieldPlan",
    "GeneralizedAlpha",
    "GrayManolopoulos",
    "Grid",
    "GriddedField",
    "Hamiltonian",
    "Impact",
    "IntegrationError",
    "Lagrangian",
    "Lanczos",
    "Lattice",
    "LobattoPair",
    "Magnus",
    "Mechanical",
    "OptimalControl",
    "OptimizationError",
    "Plan",
    "Points",
    "PolynomialField",
    "PotentialField",
    "Pullback",
    "Reversible",
    "Schrodinger",
    "SchrodingerSplitting",
    "Section",
    "SemiExplicit",
    "Solution",
    "Spark",
    "SpinChain",
    "SpinSystem",
    "SplitOperator",
    "StabilitySplitting",
    "Store",
    "Structure",
    "Tangent",
    "Trial",
    "VolumeSplitting",
    "WavePlan",
    "ensemble",
    "fit",
    "from_sympy",
    "integrate",
    "load",
    "optimal_control",
    "plan",
    "resume",
    "section",
    "table",
    "vjp",
]

#: Names that few runs need, by the modules that are imported when they are first used.
_LATER = {
    "ChargedParticles": "_systems.fields.particles",
    "Contact": "_systems.mechanics.contact",
    "FieldPlan": "_methods.planner",
    "GriddedField": "_systems.fields.gridded",
    "OptimalControl": "_studies.optimal",
    "Plan": "_methods.planner",
    "PotentialField": "_systems.fields.vector_potential",
    "Pullback": "_runs.gradients",
    "Store": "_runs.stored",
    "Trial": "_studies.fitting",
    "WavePlan": "_methods.planner",
    "fit": "_studies.fitting",
    "from_sympy": "_systems.sympy.mechanics",
    "load": "_solution.export",
    "optimal_control": "_studies.optimal",
    "plan": "_methods.planner",
    "resume": "_runs.stored",
    "table": "_systems.tracing.table",
    "vjp": "_runs.gradients",
}

#: Public modules, by where they are; each is imported when it is first used.
_ROOMS = {
    "analysis": "analysis",
    "bodies": "bodies",
    "casadi": "_bridges.casadi",
    "fem": "_bridges.fem",
    "jax": "_bridges.jax",
    "plot": "plot",
    "problems": "problems",
    "results": "results",
    "torch": "_bridges.torch",
}


def __getattr__(name: str) -> _typing.Any:
    """Import a name that few runs need."""
    if name in _ROOMS:
        return _import_module(f"liouville.{_ROOMS[name]}")
    if name not in _LATER:
        raise _no_attribute("module 'liouville'", name, __dir__())
    globals()[name] = found = getattr(_import_module(f"liouville.{_LATER[name]}"), name)
    return found


def __dir__() -> list[str]:
    """List the public names and modules."""
    return sorted([*__all__, *_ROOMS, "__version__"])
