"""What engineers ask of a mechanism besides its motion."""

from liouville.analysis.equilibrium import Equilibrium, equilibrium
from liouville.analysis.inverse_dynamics import InverseDynamics, inverse_dynamics
from liouville.analysis.linearization import Linearization, linearize
from liouville.analysis.modes import Modes, modes
from liouville.analysis.power import PowerBalance, power_balance

__all__ = [
    "Equilibrium",
    "InverseDynamics",
    "Linearization",
    "Modes",
    "PowerBalance",
    "equilibrium",
    "inverse_dynamics",
    "linearize",
    "modes",
    "power_balance",
]
