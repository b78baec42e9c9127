r"""The flow of Arnold, Beltrami and Childress on the torus, trigonometric and chaotic; no units.

.. math::

    x' = A \sin z + C \cos y, \quad y' = B \sin x + A \cos z, \quad z' = C \sin y + B \cos x

with A = B = C = 1. It is parallel to its own curl, and solves Euler's equations. Each component is
a natural shear; it has no invariant.

T. Dombre, U. Frisch, J. M. Greene, M. Henon, A. Mehr, A. M. Soward, J. Fluid Mech. 167 (1986)
353-391. The references are by extrapolation in 45 digits, two tolerances 2e-31 apart
(``tools/field_references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def field(t: ca.SX, x: ca.SX, params: Parameters) -> list[ca.SX]:
    """Return the velocity."""
    x, y, z = ca.vertsplit(x)
    A, B, C = params.A, params.B, params.C
    return [
        A * ca.sin(z) + C * ca.cos(y),
        B * ca.sin(x) + A * ca.cos(z),
        C * ca.sin(y) + B * ca.cos(x),
    ]


system = PolynomialField(field, x=("x", "y", "z"), params={"A": 1.0, "B": 1.0, "C": 1.0})
start: dict[str, Any] = {"x": (0.1, 0.2, 0.3)}
interval = (0.0, 10.0)
h = 0.1
conserved = ()
reference = {
    1.0: {
        "x": (
            1.512333562893019026706,
            1.392740288263020634389,
            1.602505409261737680819,
        ),
    },
    10.0: {
        "x": (
            8.072293447773914440382,
            -1.280825325416095647769,
            1.377386224879407997373,
        ),
    },
}
source = "Dombre et al. (1986); extrapolation in 45-digit arithmetic"
