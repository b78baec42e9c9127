r"""The planar pendulum with its rod given twice, in two ways: a redundant constraint.

.. math::

    L = \tfrac m2 |v|^2 - m g y, \qquad 0 = \tfrac12 (x^2 + y^2 - l^2), \qquad
    0 = \sqrt{x^2 + y^2} - l

The gradients (x, y) and (x, y)/r are dependent everywhere. The motion is that of
:mod:`~liouville.problems.pendulum`; multipliers are known up to their sum as a force, and those of
least norm share it: each constraint takes half of the tension.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters, pendulum


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the bob at distance l from the pivot, by the square of the distance and by itself."""
    squared = (ca.dot(q, q) - params.l**2) / 2
    return {"rod": squared, "again": ca.sqrt(ca.dot(q, q)) - params.l}


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the rod from the pivot to the bob."""
    return pendulum.outline(q, params)


system = Lagrangian(
    pendulum.lagrangian, constraint, q=("x", "y"), params={"m": 1.0, "l": 1.0, "g": 9.81}
)
start: dict[str, Any] = pendulum.start
interval = (0.0, 10.0)
h = 0.01
conserved = ("energy",)
reference = {
    time: {**states, "lam": (states["lam"][0] / 2,) * 2}  # l = 1: both gradients are the same
    for time, states in pendulum.reference.items()
}
source = "the pendulum's closed form by Jacobi's functions"
