r"""The car axis: an axle on two springs whose right foot follows a bumpy road, without units.

The axle of length L has its ends at (x_l, y_l) and (x_r, y_r), with springs of length L0 and
stiffness 1 to (0, 0) and to the moving foot (x_b, y_b), y_b = r sin(omega t), x_b^2 + y_b^2 = L^2:

.. math::

    \mathcal L = \tfrac k2 |v|^2 - \tfrac12 (L_l - L_0)^2 - \tfrac12 (L_r - L_0)^2
        - k g (y_l + y_r), \qquad k = \tfrac12 M \varepsilon^2, \\
    L_l = |(x_l, y_l)|, \qquad L_r = |(x_r - x_b, y_r - y_b)|, \\
    0 = x_l x_b + y_l y_b, \qquad 0 = (x_l - x_r)^2 + (y_l - y_r)^2 - L^2

The first constraint, which keeps the left spring at right angles to the road, depends on time. Our
multipliers have the opposite sign of the test set's.

Source: F. Mazzia, C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4 (2008).
The reference is a Taylor solution in quadruple precision, with which the test set's own end state
agrees to 4e-12.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def foot(t: ca.SX, params: Parameters) -> tuple[ca.SX, ca.SX]:
    """Return where the right spring stands on the road, x_b and y_b."""
    height = params.r * ca.sin(params.omega * t)
    return ca.sqrt(params.L**2 - height**2), height


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less springs and weight."""
    k = params.M * params.eps**2 / 2
    xb, yb = foot(t, params)
    left, right = ca.hypot(q[0], q[1]), ca.hypot(q[2] - xb, q[3] - yb)
    springs = ((left - params.L0) ** 2 + (right - params.L0) ** 2) / 2
    return k * ca.dot(v, v) / 2 - springs - k * params.g * (q[1] + q[3])


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the left spring at right angles to the road, and the axle's length."""
    xb, yb = foot(t, params)
    return {
        "right_angle": q[0] * xb + q[1] * yb,
        "axle": (q[0] - q[2]) ** 2 + (q[1] - q[3]) ** 2 - params.L**2,
    }


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the axle and both springs; the foot's place follows from the right angle."""
    left, right = q[:2], q[2:]
    foot_now = params.L * np.array([left[1], -left[0]]) / np.hypot(*left)
    return [np.array([left, right]), np.array([(0.0, 0.0), left]), np.array([foot_now, right])]


system = Lagrangian(
    lagrangian,
    constraint,
    q=("xl", "yl", "xr", "yr"),
    params={"M": 10.0, "eps": 0.01, "L": 1.0, "L0": 0.5, "r": 0.1, "omega": 10.0, "g": 1.0},
)
start: dict[str, Any] = {"q": (0.0, 0.5, 1.0, 0.5), "v": (-0.5, 0.0, -0.5, 0.0)}
interval = (0.0, 3.0)
h = 0.005
conserved: tuple[str, ...] = ()
reference = {
    3.0: {
        "q": (
            0.0493455784275240921315,
            0.496989460230008106763,
            1.04174252488542611519,
            0.373911027265365819358,
        ),
        "v": (
            -0.0770583684035920842839,
            0.00744686659206841649140,
            0.0175568157535417366297,
            0.770341043779601063121,
        ),
    },
}
source = "Test Set for IVP Solvers 2.4 (Mazzia, Magherini 2008); quadruple precision"
