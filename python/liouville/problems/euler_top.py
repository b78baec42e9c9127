r"""Euler's top: the angular momentum of a free rigid body, in its own frame, without units.

.. math::

    m' = m \times a m, \qquad
    m_1' = (a_3 - a_2) m_2 m_3, \quad m_2' = (a_1 - a_3) m_3 m_1, \quad m_3' = (a_2 - a_1) m_1 m_2

where a are the inverse principal moments of inertia, (1/2, 1, 3/2). Constant are the energy
:math:`\tfrac12 m \cdot a m` and :math:`|m|^2`, "momentum". Every component is a natural shear.

The references are by extrapolation in 45 digits, two tolerances 3e-33 apart
(``tools/field_references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def field(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return m x (a m)."""
    return ca.cross(x, params.a * x)


def energy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the kinetic energy."""
    return ca.dot(x, params.a * x) / 2


def momentum(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the square of the angular momentum."""
    return ca.dot(x, x)


system = PolynomialField(
    field,
    x=("m1", "m2", "m3"),
    params={"a": (0.5, 1.0, 1.5)},
    invariants={"energy": energy, "momentum": momentum},
)
start: dict[str, Any] = {"x": (0.6, -0.3, 0.7)}
interval = (0.0, 10.0)
h = 0.2
conserved = ("energy", "momentum")
reference = {
    4.0: {
        "x": (
            -0.07706362007037728575028,
            -0.8933769623867055406662,
            0.3686987951409001510250,
        ),
    },
    10.0: {
        "x": (
            -0.3314704791148773240206,
            0.7682803153476648535342,
            0.4897679843810192584033,
        ),
    },
}
source = "Euler's equations; extrapolation in 45-digit arithmetic"
