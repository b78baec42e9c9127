r"""A homogeneous ball that rolls on a turntable, without units.

The ball's centre is at (x, y), its attitude a unit quaternion p, its angular velocity in space
:math:`w = 2\, \dot p\, \bar p`; its lowest point moves with the table, which turns at
:math:`\Omega`:

.. math::

    L = \tfrac m2 (\dot x^2 + \dot y^2) + 2 J |\dot p|^2, \qquad 0 = \tfrac12 (|p|^2 - 1), \\
    0 = \dot x - r w_y + \Omega y, \qquad 0 = \dot y + r w_x - \Omega x

with m = 1, r = 1/2, J = 2/5 m r^2, :math:`\Omega = 2`: a holonomic constraint and two nonholonomic
ones, which are not homogeneous in the velocity, so that the table does work. On unit quaternions
:math:`2 J |\dot p|^2 = \tfrac J2 |w|^2`.

The centre goes round a circle at the rate :math:`\kappa = \Omega J / (J + m r^2)`, which is two
sevenths of the table's, wherever it starts; it does not fly off. Constant are w_z and the middle of
the circle, (x, y) + (-y', x') / kappa; the energy is not. The reference is the circle, and for the
attitude extrapolation in 45 digits, two tolerances 2e-35 apart (``tools/references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def angular_velocity(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return w, in space."""
    p, u = q[2], q[3:]
    return 2 * (p * v[3:] - v[2] * u + ca.cross(u, v[3:]))


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy of the centre, and about it."""
    return params.m / 2 * ca.dot(v[:2], v[:2]) + 2 * params.J * ca.dot(v[2:], v[2:])


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the quaternion a unit."""
    return {"unit": (ca.dot(q[2:], q[2:]) - 1) / 2}


def nonholonomic(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Let the lowest point move with the table."""
    w = angular_velocity(q, v)
    return {
        "along x": v[0] - params.r * w[1] + params.Omega * q[1],
        "along y": v[1] + params.r * w[0] - params.Omega * q[0],
    }


def spin(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the angular momentum about the vertical."""
    return params.J * angular_velocity(q, v)[2]


def middle(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the middle of the circle that the centre goes round."""
    kappa = params.Omega * params.J / (params.J + params.m * params.r**2)
    return ca.vertcat(q[0] - v[1] / kappa, q[1] + v[0] / kappa)


system = Lagrangian(
    lagrangian,
    constraint,
    nonholonomic=nonholonomic,
    q=("x", "y", "p0", "p1", "p2", "p3"),
    params={"m": 1.0, "J": 0.1, "r": 0.5, "Omega": 2.0},
    invariants={
        "spin": spin,
        "middle_x": lambda *args: middle(*args)[0],
        "middle_y": lambda *args: middle(*args)[1],
    },
)
start: dict[str, Any] = {"q": (0.5, 0.0, 1.0, 0.0, 0.0, 0.0), "v": (0.3, 0.5, 0.0, 0.5, 0.3, 0.5)}
interval = (0.0, 10.0)
h = 0.1
conserved = ("spin", "middle_x", "middle_y")
reference = {
    5.0: {
        "q": (
            -1.06750874132420381448,
            1.27445423021660700218,
            -0.341761316950705092857,
            -0.0663428583304740765206,
            -0.669614320457679482733,
            -0.656059821375049967914,
        ),
        "v": (
            -0.428259560123775429815,
            -0.395719280756687893991,
            1.63265676879500431556,
            -0.462040534458859191808,
            -1.89901085777608252793,
            1.13446823461953990526,
        ),
    },
    10.0: {
        "q": (
            0.0793622188216379620967,
            -0.388676624472508862938,
            -0.396189636070793734757,
            -0.312691918826321892388,
            0.320873466586815339351,
            0.801434809957344463516,
        ),
        "v": (
            0.522100928270005064536,
            0.25963555361236454977,
            -0.350367798472631297697,
            -0.325024890093466704391,
            0.0256560456705679502066,
            -0.310289855570283818695,
        ),
    },
}
source = "ball on a turntable; closed form, and extrapolation in 45-digit arithmetic"
