r"""The spherical pendulum, in Cartesian coordinates, without units.

.. math::

    L = \tfrac m2 |v|^2 - m g z, \qquad 0 = \tfrac12 (x^2 + y^2 + z^2 - l^2)

with m = l = g = 1. The bob swings between two heights while it circles the vertical; besides the
energy the angular momentum m (x v_y - y v_x) about the vertical is constant, 3/4 here.

The reference is a motion computed in 69 digits, error below 1e-45.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potential of gravity."""
    return params.m / 2 * ca.dot(v, v) - params.m * params.g * q[2]


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the bob at distance l from the pivot."""
    return {"rod": (ca.dot(q, q) - params.l**2) / 2}


def angular_momentum(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the component about the vertical."""
    return params.m * (q[0] * v[1] - q[1] * v[0])


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the rod."""
    return [np.array([np.zeros(3), q])]


system = Lagrangian(
    lagrangian,
    constraint,
    q=("x", "y", "z"),
    params={"m": 1.0, "l": 1.0, "g": 1.0},
    invariants={"angular_momentum": angular_momentum},
)
start: dict[str, Any] = {"q": (0.6, 0.0, -0.8), "v": (0.0, 1.25, 0.0)}
interval = (0.0, 5.0)
h = 0.05
conserved = ("energy", "angular_momentum")
reference = {
    1.0: {
        "q": (0.0516600369587251371580, 0.868070512745462551030, -0.493745709331486638320),
        "v": (-0.847618212144311224860, 0.275021560337770946780, 0.394839114644981066770),
        "lam": (1.44373712799445991500,),
    },
    5.0: {
        "q": (0.938523838049300677710, 0.0337405884473449967540, -0.343561607436623981710),
        "v": (0.00867221326123990672120, 0.799439050091727362510, 0.102201823754941707080),
        "lam": (0.993184822309871945120,),
    },
}
source = "index-reduced equations integrated in 69-digit arithmetic"
