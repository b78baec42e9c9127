r"""The stretch-twist-fold flow of Bajer and Moffatt: a steady Stokes flow in the unit ball.

.. math::

    x' &= \alpha z - 8 x y \\
    y' &= 11 x^2 + 3 y^2 + z^2 + \beta x z - 3 \\
    z' &= -\alpha x + 2 y z - \beta x y

with :math:`\alpha = \beta = 1`, without units. It stretches a magnetic flux tube, twists it and
folds it, and its streamlines are chaotic. The unit sphere is invariant, as
:math:`(r^2 - 1)' = 6 y (r^2 - 1)`: what starts inside stays inside, and only on the sphere is
"sphere", :math:`r^2 - 1`, constant.

K. Bajer, H. K. Moffatt, J. Fluid Mech. 212 (1990) 337-363. The references are by extrapolation in
45 digits, two tolerances 1e-30 apart (``tools/field_references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def field(t: ca.SX, x: ca.SX, params: Parameters) -> list[ca.SX]:
    """Return the velocity."""
    x, y, z = ca.vertsplit(x)
    return [
        params.alpha * z - 8 * x * y,
        11 * x**2 + 3 * y**2 + z**2 + params.beta * x * z - 3,
        -params.alpha * x + 2 * y * z - params.beta * x * y,
    ]


def sphere(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return r^2 - 1, which keeps its sign."""
    return ca.dot(x, x) - 1


system = PolynomialField(
    field,
    x=("x", "y", "z"),
    params={"alpha": 1.0, "beta": 1.0},
    invariants={"sphere": sphere},
)
start: dict[str, Any] = {"x": (0.1, 0.2, -0.3)}
interval = (0.0, 10.0)
h = 0.02
conserved = ()
reference = {
    2.0: {
        "x": (
            0.2143915041286978776331,
            -0.1101671138683914160199,
            0.6369970543850713365398,
        ),
    },
    10.0: {
        "x": (
            -0.2080110600858353352147,
            0.1117241766329027644578,
            0.3941271808198274221883,
        ),
    },
}
source = "field of Bajer and Moffatt (1990); extrapolation in 45-digit arithmetic"
