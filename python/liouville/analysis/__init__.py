"""Analyses of a mechanism, or of a wave function, besides its motion."""

from liouville.analysis.condensate import Condensate
from liouville.analysis.equilibrium import Equilibrium, equilibrium
from liouville.analysis.ground_state import GroundState, ground_state
from liouville.analysis.imaginary_time import Cooled, imaginary_time
from liouville.analysis.inverse_dynamics import InverseDynamics, inverse_dynamics
from liouville.analysis.linearization import Linearization, linearize
from liouville.analysis.modes import Modes, modes
from liouville.analysis.power import PowerBalance, power_balance
from liouville.analysis.thermal_state import ThermalState, thermal_state

__all__ = [
    "Condensate",
    "Cooled",
    "Equilibrium",
    "GroundState",
    "InverseDynamics",
    "Linearization",
    "Modes",
    "PowerBalance",
    "ThermalState",
    "equilibrium",
    "ground_state",
    "imaginary_time",
    "inverse_dynamics",
    "linearize",
    "modes",
    "power_balance",
    "thermal_state",
]
