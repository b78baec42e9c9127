r"""A block that rocks on its corners, and loses energy as it lands on the other one.

.. math::

    L = \tfrac m2 (\dot x^2 + \dot y^2) + \tfrac{m (b^2 + h^2)}{6} \dot a^2 - m g y

with m = 1 kg, half the width b = 0.5 m, half the height h = 2 m and g = 9.81 m/s^2, by the centre
and the angle a, on two corners that do not slip, with :math:`\mu` = 1. It is released at rest from
a tilt of 0.1 and rocks ever faster, as earthquakes make monuments do.

On a corner, with :math:`R^2 = b^2 + h^2` and :math:`\tan \alpha = b / h`,

.. math::

    \ddot a = -\frac{3 g}{4 R} \sin(\alpha - |a|) \operatorname{sign} a, \qquad
    \dot a^+ = \left(1 - \tfrac32 \sin^2 \alpha\right) \dot a^-

where it lands (G. W. Housner, Bull. Seism. Soc. Am. 53 (1963) 403-417). The reference is that
motion in 45 digits (``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville._systems.mechanics.contact import Contact
from liouville.problems import Parameters

TILT = -0.1


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy of a uniform block, less the potential of gravity."""
    kinetic = ca.dot(v[:2], v[:2]) + (params.b**2 + params.h**2) / 3 * v[2] ** 2
    return params.m * (kinetic / 2 - params.g * q[1])


def corner(side: int) -> Contact:
    """Make the contact of a lower corner, on the left (-1) or right (1)."""

    def place(q: ca.SX, params: Parameters) -> ca.SX:
        c, s = ca.cos(q[2]), ca.sin(q[2])
        along, up = side * params.b, -params.h
        return q[:2] + ca.vertcat(c * along - s * up, s * along + c * up)

    def gap(t: ca.SX, q: ca.SX, params: Parameters) -> ca.SX:
        return place(q, params)[1]

    def slip(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
        return ca.jtimes(place(q, params)[0], q, v)

    return Contact(gap, friction=lambda params: params.mu, slip=slip)


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the block."""
    c, s = np.cos(q[2]), np.sin(q[2])
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * (params.b, params.h)
    return [q[:2] + corners @ np.array([(c, s), (-s, c)])]


system = Lagrangian(
    lagrangian,
    q=("x", "y", "angle"),
    params={"m": 1.0, "b": 0.5, "h": 2.0, "g": 9.81, "mu": 1.0},
    contacts={"left": corner(-1), "right": corner(1)},
)
start: dict[str, Any] = {
    "q": (
        -0.5 * np.cos(TILT) - 2 * np.sin(TILT),
        2 * np.cos(TILT) - 0.5 * np.sin(TILT),
        TILT,
    ),
    "v": (0.0, 0.0, 0.0),
}
interval = (0.0, 4.0)
h = 0.01
conserved: tuple[str, ...] = ()
reference = {
    2.0: {
        "q": (-0.3729319274242859091892, 2.027540820182816232366, -0.06307865900021630947768),
        "v": (0.02687718999198604125761, 0.004943605656509697572983, -0.01325605370034553457921),
    },
    4.0: {
        "q": (-0.5454812683419894479629, 2.010823891486271702830, 0.02267829268279009585408),
        "v": (-0.2653045923042644250901, 0.05996840763019306792499, 0.1319382534828389831880),
    },
}
source = "Housner (1963); integrated in extended precision"
