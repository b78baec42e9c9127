r"""A bead of varying mass on a moving wire, with friction, without units.

.. math::

    L = m(t) (\tfrac12 |v|^2 - g y), \quad m(t) = m + a \sin t, \qquad
    Q = -d\, v, \qquad 0 = y - \tfrac12 x^2 - \tfrac12 \sin 2t

with m = g = 1, a = 1/5, d = 1/10: the wire is a parabola that moves up and down. Mass, constraint
and so the energy depend on time; nothing is conserved.

The reference is a motion computed in 69 digits, error below 1e-29.
"""

from typing import Any

import casadi as ca

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potential of gravity, with m(t)."""
    return (params.m + params.a * ca.sin(t)) * (ca.dot(v, v) / 2 - params.g * q[1])


def friction(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Drag against the bead's velocity."""
    return -params.d * v


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the bead on the wire."""
    return {"wire": q[1] - q[0] ** 2 / 2 - ca.sin(2 * t) / 2}


system = Lagrangian(
    lagrangian,
    constraint,
    q=("x", "y"),
    params={"m": 1.0, "a": 0.2, "g": 1.0, "d": 0.1},
    force=friction,
)
start: dict[str, Any] = {"q": (1.0, 0.5), "v": (0.0, 1.0)}
interval = (0.0, 5.0)
h = 0.05
conserved: tuple[str, ...] = ()
reference = {
    1.0: {
        "q": (0.979391571734482761730, 0.934252638805111094350),
        "v": (0.148077942190998214030, -0.271120548005492768170),
        "lam": (0.519253759998592942320,),
    },
    5.0: {
        "q": (-2.57047987643895100690, 3.03167284214411751110),
        "v": (-0.696748070686743363140, 0.951905365571485129830),
        "lam": (-0.256124369976907761190,),
    },
}
source = "index-reduced equations integrated in 69-digit arithmetic"
