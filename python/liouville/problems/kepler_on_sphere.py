r"""The Kepler problem on the unit sphere, an orbit whose near end is twenty-seven times nearer.

.. math::

    L = \tfrac12 |v|^2 + k \cot\theta, \qquad \cot\theta = \frac{z}{\sqrt{x^2 + y^2}}, \qquad
    0 = \tfrac12 (x^2 + y^2 + z^2 - 1)

with k = 1: the pole attracts a particle as a mass attracts a planet. Seen from the centre of the
sphere on the plane that touches the pole, its orbits are Kepler's ellipses :cite:p:`kozlov1992`,

.. math:: p \cot\theta = 1 + e \cos\varphi, \qquad p = M^2 / k,

M being the angular momentum about the pole. Here M = 0.24 and e = 0.9568; the start is the far end.
Besides energy and angular momentum the axis of the ellipse stands still, so that what a method does
to it shows as a precession.

The references are the closed form: the near end after half a period, and the start after a whole
one, :math:`T = M^{-1} \oint (1 + \cot^2\theta)^{-1} d\varphi`.
"""

from typing import Any

import casadi as ca

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def cotangent(q: ca.SX) -> ca.SX:
    """Return the cotangent of the angle from the pole."""
    return q[2] / ca.sqrt(q[0] ** 2 + q[1] ** 2)


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potential of the pole."""
    return ca.dot(v, v) / 2 + params.k * cotangent(q)


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the particle on the sphere."""
    return {"sphere": (ca.dot(q, q) - 1) / 2}


def angular_momentum(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the component about the pole."""
    return q[0] * v[1] - q[1] * v[0]


def axis(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the angle at which the near end of the ellipse lies."""
    momentum, distance = angular_momentum(t, q, v, params), ca.sqrt(q[0] ** 2 + q[1] ** 2)
    along = momentum**2 / params.k * cotangent(q) - 1
    across = -momentum / params.k * v[2] / distance
    return ca.atan2(along * q[1] - across * q[0], along * q[0] + across * q[1])


system = Lagrangian(
    lagrangian,
    constraint,
    q=("x", "y", "z"),
    params={"k": 1.0},
    invariants={"angular_momentum": angular_momentum, "axis": axis},
)
start: dict[str, Any] = {"q": (-0.8, 0.0, 0.6), "v": (0.0, -0.3, 0.0)}
period = 1.848937270865028639842
interval = (0.0, period)
h = period / 8192
conserved = ("energy", "angular_momentum", "axis")
reference = {
    period / 2: {
        "q": (0.02942306927215499548554, 0.0, 0.9995670477734877633005),
        "v": (0.0, 8.156864866138487429026, 0.0),
        "lam": (66.534444444444444444444,),
    },
    period: {"q": start["q"], "v": start["v"], "lam": (0.09,)},
}
source = "closed form; period by quadrature in 40 digits"
