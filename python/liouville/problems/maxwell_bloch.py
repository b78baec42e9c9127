r"""The Maxwell-Bloch equations without losses: light and two-level atoms in a cavity; no units.

The complex field e and polarisation p and the real inversion d, with detuning :math:`\delta`:

.. math::

    e' = p, \qquad p' = i \delta p + e d, \qquad d' = -\operatorname{Re}(e^* p)

with :math:`\delta = \tfrac12`. Constant are the length of Bloch's vector, "bloch",
:math:`|p|^2 + d^2`; the number of excitations, "excitation", :math:`\tfrac12 |e|^2 + d`; and
"hamiltonian", :math:`\operatorname{Im}(e^* p) - \tfrac\delta2 |e|^2`. So the motion is integrable.

D. D. Holm, G. Kovacic, Physica D 56 (1992) 270-300. The references are by extrapolation in 45
digits, two tolerances 1e-32 apart (``tools/field_references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def field(t: ca.SX, x: ca.SX, params: Parameters) -> list[ca.SX]:
    """Return e', p' and d'."""
    e1, e2, p1, p2, d = ca.vertsplit(x)
    delta = params.delta
    return [p1, p2, e1 * d - delta * p2, e2 * d + delta * p1, -e1 * p1 - e2 * p2]


def bloch(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the square of the length of Bloch's vector."""
    return ca.dot(x[2:], x[2:])


def excitation(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the number of excitations."""
    return ca.dot(x[:2], x[:2]) / 2 + x[4]


def hamiltonian(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the function that generates the motion."""
    return x[0] * x[3] - x[1] * x[2] - params.delta / 2 * ca.dot(x[:2], x[:2])


system = PolynomialField(
    field,
    x=("e1", "e2", "p1", "p2", "d"),
    params={"delta": 0.5},
    invariants={"bloch": bloch, "excitation": excitation, "hamiltonian": hamiltonian},
)
start: dict[str, Any] = {"x": (0.6, 0.1, 0.3, -0.2, 0.8)}
interval = (0.0, 20.0)
h = 0.1
conserved = ("bloch", "excitation", "hamiltonian")
reference = {
    1.0: {
        "x": (
            1.181301989418819013329,
            0.04299373251701929868685,
            0.8206931002264757542571,
            0.1203040151568439861098,
            0.2863385743796977046350,
        ),
    },
    20.0: {
        "x": (
            0.4037381585364306122494,
            -0.4751460517060696386056,
            0.01732679651429124813083,
            -0.3802976952476037841376,
            0.7906158644448725093080,
        ),
    },
}
source = "Holm and Kovacic (1992); extrapolation in 45-digit arithmetic"
