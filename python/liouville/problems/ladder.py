r"""A ladder that slides down a wall and leaves it, both smooth.

.. math::

    L = \tfrac m2 (\dot x^2 + \dot y^2) + \tfrac{m l^2}{24} \dot a^2 - m g y, \qquad
    x - \tfrac l2 \sin a \ge 0, \quad y - \tfrac l2 \cos a \ge 0

with m = 1 kg, l = 1 m, g = 9.81 m/s^2, by the centre of a uniform rod and its angle a to the wall,
released at rest from a = 0.3. On the wall the angle obeys :math:`\ddot a = \tfrac{3 g}{2 l} \sin
a`; the ladder leaves it where its centre has come down to two thirds of the first height, and goes
on with :math:`\dot x = \tfrac13 \sqrt{g l \cos^3 0.3}`.

The reference is the motion of the angle, first on the wall and then beside it, in 45 digits
(``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville._systems.mechanics.contact import Contact
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy of a uniform rod, less the potential of gravity."""
    kinetic = ca.dot(v[:2], v[:2]) + params.l**2 * v[2] ** 2 / 12
    return params.m * (kinetic / 2 - params.g * q[1])


def floor(t: ca.SX, q: ca.SX, params: Parameters) -> ca.SX:
    """Return the height of the foot."""
    return q[1] - params.l / 2 * ca.cos(q[2])


def wall(t: ca.SX, q: ca.SX, params: Parameters) -> ca.SX:
    """Return the distance of the top from the wall."""
    return q[0] - params.l / 2 * ca.sin(q[2])


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the ladder from its foot to its top."""
    reach = params.l / 2 * np.array([np.sin(q[2]), -np.cos(q[2])])
    return [np.array([q[:2] + reach, q[:2] - reach])]


system = Lagrangian(
    lagrangian,
    q=("x", "y", "angle"),
    params={"m": 1.0, "l": 1.0, "g": 9.81},
    contacts={"floor": Contact(floor), "wall": Contact(wall)},
)
start: dict[str, Any] = {
    "q": (np.sin(0.3) / 2, np.cos(0.3) / 2, 0.3),
    "v": (0.0, 0.0, 0.0),
}
interval = (0.0, 0.6)
h = 0.005
conserved = ("energy",)
reference = {
    0.4: {
        "q": (0.3281895760458392820567, 0.3772155911078600617831, 0.7160092388278853115913),
        "v": (0.9172346872561726252923, -0.7980233856746033202417, 2.431592725428734687947),
    },
    0.6: {
        "q": (0.5219423917773029704962, 0.07780648657160356037588, 1.414548371331912214731),
        "v": (0.9748724512539776274718, -2.267002184842610271767, 4.589918286190584072948),
    },
}
source = "the ladder of textbooks; elliptic motions integrated in extended precision"
