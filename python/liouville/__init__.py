"""Structure-preserving time integrators: a Rust core with a Python front."""

import typing as _typing
from importlib import import_module as _import_module

from liouville._core import VERSION as _VERSION
from liouville.control import Adaptive as Adaptive
from liouville.control import Reversible as Reversible
from liouville.determinant import determinant as determinant
from liouville.ensemble import ensemble as ensemble
from liouville.errors import IntegrationError as IntegrationError
from liouville.errors import OptimizationError as OptimizationError
from liouville.events import Event as Event
from liouville.events import Impact as Impact
from liouville.failure import Failure as Failure
from liouville.integrate import integrate as integrate
from liouville.methods import HHT as HHT
from liouville.methods import METHODS as METHODS
from liouville.methods import ArnoldBruls as ArnoldBruls
from liouville.methods import Chebyshev as Chebyshev
from liouville.methods import Composition as Composition
from liouville.methods import GeneralizedAlpha as GeneralizedAlpha
from liouville.methods import GrayManolopoulos as GrayManolopoulos
from liouville.methods import Lanczos as Lanczos
from liouville.methods import LobattoPair as LobattoPair
from liouville.methods import Magnus as Magnus
from liouville.methods import SchrodingerSplitting as SchrodingerSplitting
from liouville.methods import Spark as Spark
from liouville.methods import SplitOperator as SplitOperator
from liouville.methods import StabilitySplitting as StabilitySplitting
from liouville.methods import VolumeSplitting as VolumeSplitting
from liouville.points import Points as Points
from liouville.section import Section as Section
from liouville.section import section as section
from liouville.solution import Solution as Solution
from liouville.systems import BosonSystem as BosonSystem
from liouville.systems import FermionSystem as FermionSystem
from liouville.systems import Grid as Grid
from liouville.systems import Hamiltonian as Hamiltonian
from liouville.systems import Lagrangian as Lagrangian
from liouville.systems import Lattice as Lattice
from liouville.systems import Mechanical as Mechanical
from liouville.systems import PolynomialField as PolynomialField
from liouville.systems import Schrodinger as Schrodinger
from liouville.systems import SemiExplicit as SemiExplicit
from liouville.systems import SpinChain as SpinChain
from liouville.systems import SpinSystem as SpinSystem
from liouville.systems import Structure as Structure
from liouville.tangents import Tangent as Tangent

__version__ = _VERSION

if _typing.TYPE_CHECKING:
    from liouville import analysis as analysis
    from liouville import bodies as bodies
    from liouville.analysis.equilibrium import equilibrium as equilibrium
    from liouville.analysis.ground_state import ground_state as ground_state
    from liouville.analysis.imaginary_time import imaginary_time as imaginary_time
    from liouville.analysis.inverse_dynamics import inverse_dynamics as inverse_dynamics
    from liouville.analysis.linearization import linearize as linearize
    from liouville.analysis.modes import modes as modes
    from liouville.analysis.power import power_balance as power_balance
    from liouville.analysis.thermal_state import thermal_state as thermal_state
    from liouville.bridges import casadi as casadi
    from liouville.bridges import jax as jax
    from liouville.bridges import torch as torch
    from liouville.contacts import Contact as Contact
    from liouville.exponents import lyapunov as lyapunov
    from liouville.export import load as load
    from liouville.extrapolation import extrapolate as extrapolate
    from liouville.fitting import Trial as Trial
    from liouville.fitting import fit as fit
    from liouville.gradients import GradientCheck as GradientCheck
    from liouville.gradients import Pullback as Pullback
    from liouville.gradients import check_gradient as check_gradient
    from liouville.gradients import vjp as vjp
    from liouville.optimal.control import optimal_control as optimal_control
    from liouville.optimal.result import OptimalControl as OptimalControl
    from liouville.periods import Floquet as Floquet
    from liouville.periods import floquet as floquet
    from liouville.periods import propagator as propagator
    from liouville.planner import FieldPlan as FieldPlan
    from liouville.planner import Plan as Plan
    from liouville.planner import WavePlan as WavePlan
    from liouville.planner import plan as plan
    from liouville.rotation import rotation_numbers as rotation_numbers
    from liouville.stored import Store as Store
    from liouville.stored import resume as resume
    from liouville.stretching import ftle as ftle
    from liouville.systems._sympy_mechanics import from_sympy as from_sympy
    from liouville.systems._table import table as table
    from liouville.systems.gridded import GriddedField as GriddedField
    from liouville.systems.particles import ChargedParticles as ChargedParticles
    from liouville.systems.vector_potential import PotentialField as PotentialField

#: Names that few runs need, by the modules that are imported when they are first used.
_LATER = {
    "equilibrium": "analysis",
    "ground_state": "analysis",
    "imaginary_time": "analysis",
    "inverse_dynamics": "analysis",
    "linearize": "analysis",
    "modes": "analysis",
    "power_balance": "analysis",
    "thermal_state": "analysis",
    "Contact": "contacts",
    "lyapunov": "exponents",
    "load": "export",
    "extrapolate": "extrapolation",
    "Trial": "fitting",
    "fit": "fitting",
    "GradientCheck": "gradients",
    "Pullback": "gradients",
    "check_gradient": "gradients",
    "vjp": "gradients",
    "OptimalControl": "optimal",
    "optimal_control": "optimal",
    "Floquet": "periods",
    "floquet": "periods",
    "propagator": "periods",
    "FieldPlan": "planner",
    "Plan": "planner",
    "WavePlan": "planner",
    "plan": "planner",
    "rotation_numbers": "rotation",
    "Store": "stored",
    "resume": "stored",
    "ftle": "stretching",
    "GriddedField": "systems.gridded",
    "ChargedParticles": "systems.particles",
    "PotentialField": "systems.vector_potential",
    "from_sympy": "systems._sympy_mechanics",
    "table": "systems._table",
}

#: Modules that few runs need, by where they are.
_ROOMS = {
    "analysis": "analysis",
    "bodies": "bodies",
    "casadi": "bridges.casadi",
    "jax": "bridges.jax",
    "plot": "plot",
    "problems": "problems",
    "torch": "bridges.torch",
}


def __getattr__(name: str) -> _typing.Any:
    """Import a name that few runs need."""
    if name in _ROOMS:
        return _import_module(f"liouville.{_ROOMS[name]}")
    if name not in _LATER:
        raise AttributeError(f"module 'liouville' has no attribute {name!r}", name=name)
    globals()[name] = found = getattr(_import_module(f"liouville.{_LATER[name]}"), name)
    return found


def __dir__() -> list[str]:
    """List these names too."""
    return sorted({*globals(), *_LATER, *_ROOMS})
