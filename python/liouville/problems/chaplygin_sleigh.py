r"""Chaplygin's sleigh: a rigid body on ice, carried by a blade away from its centre of mass.

.. math::

    L = \tfrac m2 |\dot c|^2 + \tfrac J2 \dot\varphi^2, \quad
    c = (x + a \cos\varphi,\ y + a \sin\varphi), \qquad
    0 = \cos\varphi\, \dot y - \sin\varphi\, \dot x

without units, m = a = 1, J = 0.44. The blade touches the ice at (x, y) and the centre of mass lies
a ahead of it. With the speed u along the blade and the rate :math:`w = \dot\varphi` the equations
are :math:`u' = a w^2` and :math:`w' = -(a/k^2)\, u w`, :math:`k^2 = a^2 + J/m`, solved by

.. math::

    u = A \tanh s, \qquad w = (A/k) / \cosh s, \qquad s = s_0 + a A t / k^2

The energy is constant and the motion can be reversed, but it is no Hamiltonian one: whatever its
start, the sleigh ends up on a straight line with its centre of mass ahead, and the rate decays like
:math:`\exp(-a A t / k^2)`. Here it starts backwards, with A = 1, and turns round in a cusp.

The reference is that formula, and for the path its quadrature in 45 digits
(``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy of the centre of mass, and about it."""
    arm = params.a * v[2]
    centre = ca.vertcat(v[0] - arm * ca.sin(q[2]), v[1] + arm * ca.cos(q[2]))
    return params.m / 2 * ca.dot(centre, centre) + params.J / 2 * v[2] ** 2


def nonholonomic(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Let the blade move along itself only."""
    return {"blade": ca.cos(q[2]) * v[1] - ca.sin(q[2]) * v[0]}


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the line from the blade to the centre of mass."""
    ahead = params.a * np.array([np.cos(q[2]), np.sin(q[2])])
    return [np.array([q[:2], q[:2] + ahead])]


system = Lagrangian(
    lagrangian,
    nonholonomic=nonholonomic,
    q=("x", "y", "phi"),
    params={"m": 1.0, "J": 0.44, "a": 1.0},
)
start: dict[str, Any] = {"q": (0.0, 0.0, 0.0), "v": (-0.8, 0.0, 0.5)}
interval = (0.0, 10.0)
h = 0.1
conserved = ("energy",)
reference = {
    5.0: {
        "q": (-2.29110034293455929172, 1.35662915686949307717, 2.77480768493601178368),
        "v": (-0.917427020635904502629, 0.352447077741299447488, 0.153904550142888160171),
        "lam": (-0.0462174273303183543652,),
    },
    10.0: {
        "q": (-7.16530020879539779450, 2.37492158739693715069, 2.99076924787913876511),
        "v": (-0.988631158083278303183, 0.150249728303470274056, 0.00481983831919277505362),
        "lam": (-0.00147270374194496115275,),
    },
}
source = "Chaplygin's sleigh; closed form and quadrature"
