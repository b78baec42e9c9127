r"""A knife edge that slides down an inclined plane, without units: a sleigh without drift sideways.

.. math::

    L = \tfrac m2 (\dot x^2 + \dot y^2) + \tfrac J2 \dot\varphi^2 + m a x, \qquad
    0 = \sin\varphi\, \dot x - \cos\varphi\, \dot y

with m = J = a = 1, a the share of gravity down the slope, which is the direction of x. The blade
points along :math:`\varphi` and does not slip sideways: a constraint on velocities that no
constraint on positions implies. The energy is constant, and so is :math:`\dot\varphi = \omega`.

Instead of gaining speed for ever the blade traces a cycloid across the slope,
:math:`x = a \sin^2(\omega t) / (2 \omega^2)`,
:math:`y = a (\omega t - \sin(\omega t) \cos(\omega t)) / (2 \omega^2)`, with
:math:`\lambda = 2 m a \sin(\omega t)`. The reference is that formula (``tools/references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potential of gravity."""
    kinetic = params.m / 2 * ca.dot(v[:2], v[:2]) + params.J / 2 * v[2] ** 2
    return kinetic + params.m * params.a * q[0]


def nonholonomic(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Let the blade move along itself only."""
    return {"blade": ca.sin(q[2]) * v[0] - ca.cos(q[2]) * v[1]}


def spin(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the angular momentum about the point of contact."""
    return params.J * v[2]


system = Lagrangian(
    lagrangian,
    nonholonomic=nonholonomic,
    q=("x", "y", "phi"),
    params={"m": 1.0, "J": 1.0, "a": 1.0},
    invariants={"spin": spin},
)
start: dict[str, Any] = {"q": (0.0, 0.0, 0.0), "v": (0.0, 0.0, 1.5)}
interval = (0.0, 5.0)
h = 0.05
conserved = ("energy", "spin")
reference = {
    1.0: {
        "q": (0.221110277400049495252, 0.317653332437792530878, 1.5),
        "v": (0.0470400026866224073669, 0.663330832200148485757, 1.5),
        "lam": (1.99498997320810886188,),
    },
    5.0: {
        "q": (0.195520879206535697094, 1.59441246220476479269, 7.5),
        "v": (0.216762613385705621943, 0.586562637619607091283, 1.5),
        "lam": (1.87599995354947771590,),
    },
}
source = "knife edge on an inclined plane; closed form"
