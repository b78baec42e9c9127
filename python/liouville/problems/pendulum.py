r"""The planar pendulum, in Cartesian coordinates.

.. math::

    L = \tfrac m2 |v|^2 - m g y, \qquad 0 = \tfrac12 (x^2 + y^2 - l^2)

with m = 1 kg, l = 1 m, g = 9.81 m/s^2, released from the horizontal at rest. By that symmetry
three of four Taylor coefficients of the motion vanish at the start, which misleads step and order
control. Uniform gravity and a constant mass matrix: Gauss-Lobatto SPARK and Lobatto IIIA-IIIB
coincide here.

The motion is known: x = sin a, y = -cos a, sin(a/2) = k sn(K - w t, k) with k^2 = 1/2 and
w^2 = g/l. The reference is that formula in 45 digits (``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potential of gravity."""
    return params.m / 2 * ca.dot(v, v) - params.m * params.g * q[1]


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the bob at distance l from the pivot."""
    return {"rod": (ca.dot(q, q) - params.l**2) / 2}


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the rod from the pivot to the bob."""
    return [np.array([(0.0, 0.0), q])]


system = Lagrangian(lagrangian, constraint, q=("x", "y"), params={"m": 1.0, "l": 1.0, "g": 9.81})
start: dict[str, Any] = {"q": (1.0, 0.0), "v": (0.0, 0.0)}
interval = (0.0, 10.0)
h = 0.01
conserved = ("energy",)
reference = {
    10.0: {
        "q": (0.275087462576116860054, -0.961419205099125064265),
        "v": (-4.17559810095172883646, -1.19474905456047527165),
        "lam": (28.2945672060672506413,),
    },
    100.0: {
        "q": (0.181513351427031384542, -0.983388480334057504683),
        "v": (-4.31953678053466245627, -0.797297927855360446968),
        "lam": (28.9411229762313123628,),
    },
    2000.0: {
        "q": (-0.814603068589032152122, -0.580018827836935461592),
        "v": (1.95664770788265787019, -2.74799911743039228202),
        "lam": (17.0699541032410106347,),
    },
}
source = "IFToMM multibody benchmark A01 (simple pendulum); closed form by Jacobi's functions"
