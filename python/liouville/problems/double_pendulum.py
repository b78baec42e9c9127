r"""The planar double pendulum, in Cartesian coordinates, without units.

.. math::

    L = \tfrac{m_1}2 |v_1|^2 + \tfrac{m_2}2 |v_2|^2 - g (m_1 y_1 + m_2 y_2), \qquad
    0 = \tfrac12 (|r_1|^2 - l_1^2), \quad 0 = \tfrac12 (|r_2 - r_1|^2 - l_2^2)

with r_i = (x_i, y_i) and all parameters 1. It starts at rest, the upper rod horizontal and the
lower one hanging; the multipliers are zero at that moment. The motion is chaotic for longer times.

The reference is a motion computed in 69 digits, error below 1e-22.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potential of gravity."""
    kinetic = params.m1 * ca.dot(v[:2], v[:2]) / 2 + params.m2 * ca.dot(v[2:], v[2:]) / 2
    return kinetic - params.g * (params.m1 * q[1] + params.m2 * q[3])


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the first mass l1 from the pivot and the second l2 from the first."""
    upper, lower = q[:2], q[2:] - q[:2]
    return {
        "upper_rod": (ca.dot(upper, upper) - params.l1**2) / 2,
        "lower_rod": (ca.dot(lower, lower) - params.l2**2) / 2,
    }


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw both rods as one line from the pivot."""
    return [np.array([(0.0, 0.0), q[:2], q[2:]])]


system = Lagrangian(
    lagrangian,
    constraint,
    q=("x1", "y1", "x2", "y2"),
    params={"m1": 1.0, "m2": 1.0, "l1": 1.0, "l2": 1.0, "g": 1.0},
)
start: dict[str, Any] = {"q": (1.0, 0.0, 1.0, -1.0), "v": (0.0, 0.0, 0.0, 0.0)}
interval = (0.0, 5.0)
h = 0.02
conserved = ("energy",)
reference = {
    1.0: {
        "q": (
            0.87152107081751934494,
            -0.49035805603771253921,
            0.99916701370137920175,
            -1.4821778548244126967,
        ),
        "v": (
            -0.53153226343738528111,
            -0.94470063599685766402,
            -0.0093440702735882492304,
            -0.87749568166871078233,
        ),
        "lam": (2.1281731581636645000, 0.77448915310015364692),
    },
    5.0: {
        "q": (
            0.18635443023917094022,
            -0.98248258321979121559,
            -0.59098367942910299929,
            -0.35339954954509854093,
        ),
        "v": (
            0.63641321571550246043,
            0.12071300218134186798,
            0.49986541453456615488,
            -0.048014819056063698210,
        ),
        "lam": (1.9522633495071094310, -0.72115662786015959536),
    },
}
source = "index-reduced equations integrated in 69-digit arithmetic"
