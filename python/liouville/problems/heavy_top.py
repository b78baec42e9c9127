r"""The heavy top of Bruels and Cardona: a disc on a rod about a fixed point, by a unit quaternion.

With the body's angular velocity :math:`\Omega = 2 \bar q \circ v` (its vector part), the inertia J
about the centre of mass (diagonal), which lies at X in the body and at R(q) X in space,

.. math::

    L = \tfrac12 \Omega^T J \Omega + \tfrac m2 |\Omega \times X|^2 + \tfrac\mu2 (q \cdot v)^2
        - m g (R X)_z, \qquad 0 = \tfrac12 (|q|^2 - 1)

in kg, m, s. Only the first two terms are physical. They leave the direction v = q without mass;
mu (q.v)^2, zero along every motion on the sphere, gives it one, and any mu > 0 does. Constant are
the energy, the angular momentum about the vertical, and that about the rod, X, as J_x = J_z.

Data and start: O. Bruels, A. Cardona, J. Comput. Nonlinear Dyn. 5 (2010) 031002; the top spins at
150 rad/s about its horizontal rod. The reference is a Taylor solution in quadruple precision, and
at t = 1 and 2 s the centre of mass R X comes out at
(0.17334396409838604, 0.64008859207056877, -0.74849079113358131) and
(-0.15041682274564176, -0.72416559163689565, -0.67302226956044410).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def angular_velocity(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return Omega = 2 q* v in the body's frame."""
    return 2 * (q[0] * v[1:] - v[0] * q[1:] - ca.cross(q[1:], v[1:]))


def rotate(q: ca.SX, x: ca.SX) -> ca.SX:
    """Return R(q) x, homogeneous of degree 2 in q."""
    w, u = q[0], q[1:]
    return (w**2 - ca.dot(u, u)) * x + 2 * ca.dot(u, x) * u + 2 * w * ca.cross(u, x)


def body_momentum(q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the angular momentum about the fixed point, in the body's frame."""
    omega, arm = angular_velocity(q, v), params.X
    return params.J * omega + params.m * ca.cross(arm, ca.cross(omega, arm))


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy, completed along q, less the potential of gravity."""
    kinetic = ca.dot(angular_velocity(q, v), body_momentum(q, v, params)) / 2
    completion = params.mu / 2 * ca.dot(q, v) ** 2
    return kinetic + completion - params.m * params.g * rotate(q, params.X)[2]


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the quaternion a unit."""
    return {"unit": (ca.dot(q, q) - 1) / 2}


def angular_momentum(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the component about the vertical."""
    return rotate(q, body_momentum(q, v, params))[2]


def spin(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the component of the angular momentum along the rod."""
    return ca.dot(params.X, body_momentum(q, v, params))


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the rod, and the disc's rim with a spoke."""
    w, u, arm = q[0], q[1:], np.asarray(params.X)
    length = np.linalg.norm(arm)
    across = np.roll(arm, 1) / length, np.roll(arm, 2) / length
    angles = np.linspace(0, 2 * np.pi, 25)
    rim = arm + 0.4 * length * (
        np.outer(np.cos(angles), across[0]) + np.outer(np.sin(angles), across[1])
    )
    points = np.array([np.zeros(3), arm, *rim])
    turned = points + 2 * np.cross(u, w * points + np.cross(u, points))
    return [turned[:2], turned[1:]]


system = Lagrangian(
    lagrangian,
    constraint,
    q=("q0", "q1", "q2", "q3"),
    params={
        "m": 15.0,
        "J": (0.234375, 0.46875, 0.234375),
        "X": (0.0, 1.0, 0.0),
        "g": 9.81,
        "mu": 60.0,
    },
    invariants={"angular_momentum": angular_momentum, "spin": spin},
)
start: dict[str, Any] = {"q": (1.0, 0.0, 0.0, 0.0), "v": (0.0, 0.0, 75.0, -2.30769)}
interval = (0.0, 2.0)
h = 1e-3
conserved = ("energy", "angular_momentum", "spin")
reference = {
    1.0: {
        "q": (
            0.732943980679663718147,
            -0.278285719337612678518,
            0.531824611334162617923,
            -0.320176142736249281409,
        ),
        "v": (
            -40.9494804360730349299,
            22.1368660475644895039,
            54.2782197519585868500,
            -22.8235486365713516884,
        ),
    },
    2.0: {
        "q": (
            0.122947135041533467104,
            -0.491079892550027014699,
            0.350430030343620961839,
            -0.787986887550485669324,
        ),
        "v": (
            -28.5593168349792099535,
            58.0805373271204181740,
            7.73508629398134039086,
            -37.2123751702215449470,
        ),
    },
}
source = "data of Bruels and Cardona (2010); quadruple precision"
