r"""A block on a belt, held back by a spring: friction that sticks and slips.

.. math::

    L = \tfrac m2 |v|^2 - \tfrac k2 x^2 - m g y, \qquad y \ge 0

with m = 1 kg, k = 25 N/m, g = 9.81 m/s^2, and a belt at :math:`v_b` = 0.5 m/s. Friction is
:math:`\mu` = 0.2 of the normal force while the block slips, and up to :math:`\mu_s` = 0.3 of it
while it sticks. The block begins with the belt.

The motion is periodic: with :math:`d = (\mu_s - \mu) m g / k` and :math:`\omega^2 = k / m` the
block goes along for :math:`2 d / v_b`, and slips for :math:`2 (\pi - \arctan(d \omega / v_b)) /
\omega`, on a cosine about :math:`\mu m g / k`. The reference is that formula
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
    """Kinetic energy less the potentials of spring and gravity."""
    kinetic = params.m / 2 * ca.dot(v, v)
    return kinetic - params.k / 2 * q[0] ** 2 - params.m * params.g * q[1]


def gap(t: ca.SX, q: ca.SX, params: Parameters) -> ca.SX:
    """Return the height of the block above the belt."""
    return q[1]


def slip(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the block's velocity on the belt."""
    return v[0] - params.speed


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the block, 0.2 m wide."""
    corners = np.array([(-1, 0), (1, 0), (1, 2), (-1, 2), (-1, 0)])
    return [q + corners / 10]


belt = Contact(
    gap,
    friction=lambda params: params.mu,
    static_friction=lambda params: params.mu_static,
    slip=slip,
)
system = Lagrangian(
    lagrangian,
    q=("x", "y"),
    params={"m": 1.0, "k": 25.0, "g": 9.81, "speed": 0.5, "mu": 0.2, "mu_static": 0.3},
    contacts={"belt": belt},
)
start: dict[str, Any] = {"q": (0.0, 0.0), "v": (0.5, 0.0)}
interval = (0.0, 10.0)
h = 0.02
conserved: tuple[str, ...] = ()
reference = {
    5.0: {"q": (-0.01452884003195497004806, 0.0), "v": (0.2687532918826395792399, 0.0)},
    10.0: {"q": (-0.02577238431832285449128, 0.0), "v": (0.1295393727737546764855, 0.0)},
}
source = "closed form"
