r"""A charged particle in a cubic electric field and a magnetic bottle, without units.

.. math::

    x' &= v, \qquad v' = -k\, (x_1^3, x_2^3, x_3^3) + v \times B(x) \\
    B &= b\, \bigl(-\eta x_1 x_3,\ -\eta x_2 x_3,\
        1 + \eta (x_3^2 - \tfrac12 (x_1^2 + x_2^2))\bigr)

with k = 1, b = 2, :math:`\eta = \tfrac12`. Constant is the "energy",
:math:`\tfrac12 |v|^2 + \tfrac k4 \sum x_i^4`. B has neither curl nor divergence. In phase space the
field is sparse, 18 terms of 504, and each variable's velocity is free of it.

Volume preservation for charged particles: Y. He, Y. Sun, J. Liu, H. Qin, J. Comput. Phys. 281
(2015) 135-147. The references are by extrapolation in 45 digits, two tolerances 6e-34 apart
(``tools/field_references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def magnetic(x: ca.SX, params: Parameters) -> ca.SX:
    """Return B."""
    x, y, z = ca.vertsplit(x)
    along = 1 + params.eta * (z**2 - (x**2 + y**2) / 2)
    return params.b * ca.vertcat(-params.eta * x * z, -params.eta * y * z, along)


def field(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the velocity and the acceleration."""
    q, v = x[:3], x[3:]
    return ca.vertcat(v, -params.k * q**3 + ca.cross(v, magnetic(q, params)))


def energy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the kinetic energy and the potential."""
    q, v = x[:3], x[3:]
    return ca.dot(v, v) / 2 + params.k / 4 * ca.sum1(q**4)


system = PolynomialField(
    field,
    x=("x", "y", "z", "vx", "vy", "vz"),
    params={"k": 1.0, "b": 2.0, "eta": 0.5},
    invariants={"energy": energy},
)
start: dict[str, Any] = {"x": (0.9, 0.0, 0.4, 0.1, 0.5, 0.3)}
interval = (0.0, 10.0)
h = 0.1
conserved = ("energy",)
reference = {
    1.0: {
        "x": (
            0.9569718317880080842304,
            0.3399986418054519577449,
            0.7175161237065468160841,
            -0.08437096639406411099059,
            0.2176969467585066287655,
            0.2789140304278200793588,
        ),
    },
    10.0: {
        "x": (
            -0.8863078625413996982852,
            -0.1569342927079486403966,
            -0.5532240378444455412144,
            0.07878493184556586719410,
            -0.4575444587957601048659,
            0.3458605309945302139186,
        ),
    },
}
source = "extrapolation in 45-digit arithmetic"
