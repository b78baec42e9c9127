"""Analyses of a system besides its motion: rest, modes, forces, exponents, checks of a method."""

from liouville.analysis import convergence
from liouville.analysis.condensate import Condensate
from liouville.analysis.determinant import determinant
from liouville.analysis.equilibrium import Equilibrium, equilibrium
from liouville.analysis.exponents import Lyapunov, lyapunov
from liouville.analysis.extrapolation import extrapolate
from liouville.analysis.gradient_check import GradientCheck, check_gradient
from liouville.analysis.ground_state import GroundState, ground_state
from liouville.analysis.imaginary_time import Cooled, imaginary_time
from liouville.analysis.inverse_dynamics import InverseDynamics, inverse_dynamics
from liouville.analysis.linearization import Linearization, linearize
from liouville.analysis.modes import Modes, modes
from liouville.analysis.periods import Floquet, floquet, propagator
from liouville.analysis.power import PowerBalance, power_balance
from liouville.analysis.rotation import rotation_numbers
from liouville.analysis.stretching import Stretching, ftle
from liouville.analysis.thermal_state import ThermalState, thermal_state

__all__ = [
    "Condensate",
    "Cooled",
    "Equilibrium",
    "Floquet",
    "GradientCheck",
    "GroundState",
    "InverseDynamics",
    "Linearization",
    "Lyapunov",
    "Modes",
    "PowerBalance",
    "Stretching",
    "ThermalState",
    "check_gradient",
    "convergence",
    "determinant",
    "equilibrium",
    "extrapolate",
    "floquet",
    "ftle",
    "ground_state",
    "imaginary_time",
    "inverse_dynamics",
    "linearize",
    "lyapunov",
    "modes",
    "power_balance",
    "propagator",
    "rotation_numbers",
    "thermal_state",
]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
