r"""Hill's spherical vortex with swirl: the motion of fluid inside the unit sphere, without units.

The stream function :math:`\psi = \tfrac12 \rho^2 (1 - r^2)`, with :math:`\rho` the distance from
the z-axis and r that from the centre, gives the flow of Hill's vortex in its own frame. On it turns
the fluid about the axis with the angular velocity :math:`\tfrac\kappa2 (1 - r^2)`, so that every
ring of fluid keeps its circulation, :math:`2 \pi \kappa \psi`:

.. math::

    x' &= x z - \tfrac\kappa2 (1 - r^2) y \\
    y' &= y z + \tfrac\kappa2 (1 - r^2) x \\
    z' &= 1 - 2 (x^2 + y^2) - z^2

with :math:`\kappa = 1`. Constant are :math:`\psi`, "stream", and :math:`x y' - y x' = \kappa \psi`,
"swirl". A streamline winds round a torus :math:`\psi = const`, with two frequencies that differ
from torus to torus.

M. J. M. Hill, Phil. Trans. R. Soc. A 185 (1894) 213-245; with swirl, H. K. Moffatt, J. Fluid Mech.
35 (1969) 117-129, whose swirl is not polynomial. The references are by extrapolation in 45 digits,
two tolerances 2e-33 apart (``tools/field_references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def turn(x: ca.SX, params: Parameters) -> ca.SX:
    """Return the angular velocity about the axis."""
    return params.kappa / 2 * (1 - ca.dot(x, x))


def field(t: ca.SX, x: ca.SX, params: Parameters) -> list[ca.SX]:
    """Return the velocity."""
    omega = turn(x, params)
    x, y, z = ca.vertsplit(x)
    return [x * z - omega * y, y * z + omega * x, 1 - 2 * (x**2 + y**2) - z**2]


def stream(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the stream function psi."""
    return (x[0] ** 2 + x[1] ** 2) * (1 - ca.dot(x, x)) / 2


def swirl(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return x y' - y x', the circulation round the axis over 2 pi."""
    return turn(x, params) * (x[0] ** 2 + x[1] ** 2)


system = PolynomialField(
    field,
    x=("x", "y", "z"),
    params={"kappa": 1.0},
    invariants={"stream": stream, "swirl": swirl},
)
start: dict[str, Any] = {"x": (0.3, 0.2, 0.4)}
interval = (0.0, 10.0)
h = 0.05
conserved = ("stream", "swirl")
reference = {
    1.0: {
        "x": (
            0.4389167053895340919793,
            0.4594358342473930020162,
            0.6063433255403257157987,
        ),
    },
    10.0: {
        "x": (
            -0.2464443705233765538856,
            0.2060155446788631358428,
            -0.04738738689586937248706,
        ),
    },
}
source = "Hill (1894); extrapolation in 45-digit arithmetic"
