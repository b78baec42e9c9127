r"""A particle that is driven around a circular track, without units.

.. math::

    x'' = c\, y - x \lambda, \qquad y'' = -c\, x - y \lambda, \qquad 0 = \tfrac12 (x^2 + y^2 - 1)

with c = 2. The force runs along the track and has no potential: nothing is conserved, and the
multiplier grows like :math:`t^2`. The multiplier of the literature has the opposite sign.

From t = 1 the motion is :math:`x = \sin t^2`, :math:`y = \cos t^2`, :math:`\lambda = 4 t^2`. The
reference is that formula (``tools/references.py``).
"""

from math import cos, sin
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy alone."""
    return ca.dot(v, v) / 2


def drive(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Push along the track, clockwise."""
    return params.c * ca.vertcat(q[1], -q[0])


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the particle on the circle."""
    return {"track": (ca.dot(q, q) - 1) / 2}


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the radius to the particle."""
    return [np.array([(0.0, 0.0), q])]


system = Lagrangian(lagrangian, constraint, q=("x", "y"), params={"c": 2.0}, force=drive)
start: dict[str, Any] = {"q": (sin(1.0), cos(1.0)), "v": (2 * cos(1.0), -2 * sin(1.0))}
interval = (1.0, 5.0)
h = 0.004
conserved: tuple[str, ...] = ()
reference = {
    2.0: {
        "q": (-0.756802495307928251373, -0.653643620863611914639),
        "v": (-2.61457448345444765856, 3.02720998123171300549),
        "lam": (16.0,),
    },
    5.0: {
        "q": (-0.132351750097773028902, 0.991202811863473598083),
        "v": (9.91202811863473598083, 1.32351750097773028902),
        "lam": (100.0,),
    },
}
source = "the circular track of C. Arevalo; closed form"
