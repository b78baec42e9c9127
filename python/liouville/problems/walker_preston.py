r"""The molecule HF as a Morse oscillator in the field of a laser; atomic units.

.. math::

    H = \frac{p^2}{2 \mu} + D (1 - e^{-\alpha x})^2 + A \cos(\omega t)\, x

with :math:`\mu = 1745`, D = 0.2251, :math:`\alpha = 1.1741`, A = 0.011025 and
:math:`\omega = 0.01787`, on 64 points from -0.8 to 4.32, from the ground state without the laser,

.. math::

    \psi \propto e^{-(\gamma - 1/2) \alpha x}\, e^{-\gamma e^{-\alpha x}}, \qquad
    \gamma = \sqrt{2 \mu D} / \alpha

through two periods of the laser. Only the norm is conserved.

R. B. Walker, R. K. Preston, J. Chem. Phys. 67 (1977) 2017-2028; J. M. Sanz-Serna, A. Portillo, J.
Chem. Phys. 104 (1996) 2349-2355. The reference, of the equation on the grid, is by Taylor series in
extended precision (``tools/quantum_references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np

from liouville._systems import Grid, Schrodinger
from liouville.problems import Parameters

MASS = 1745.0
PARAMS = {"D": 0.2251, "alpha": 1.1741, "A": 0.011025, "omega": 0.01787}


def potential(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the oscillator's potential and the laser's."""
    morse = params.D * (1 - ca.exp(-params.alpha * x)) ** 2
    return morse + params.A * ca.cos(params.omega * t) * x


def build(points: int) -> Schrodinger:
    """Make the system with so many points."""
    return Schrodinger(Grid(-0.8, 4.32, points, potential=potential, mass=MASS), params=PARAMS)


def start_for(points: int) -> dict[str, Any]:
    """Start in the ground state without the laser."""
    x = Grid(-0.8, 4.32, points).points[:, 0]
    alpha = PARAMS["alpha"]
    gamma = np.sqrt(2 * MASS * PARAMS["D"]) / alpha
    psi = np.exp(-(gamma - 0.5) * alpha * x - gamma * (np.exp(-alpha * x) - 1))
    return {"psi": psi / np.linalg.norm(psi)}


system = build(64)
start: dict[str, Any] = start_for(64)
interval = (0.0, 4 * np.pi / PARAMS["omega"])
h = interval[1] / 144
tol = 1e-8
conserved = ("norm",)
reference = {
    interval[1]: {
        "psi": {
            8: complex(0.2655246083358548895, 0.095394748024503429885),
            9: complex(0.41205881369900077829, 0.049413842324821924888),
            10: complex(0.48411020251567727548, -0.065954538753409797635),
            11: complex(0.43015261163053763045, -0.19411178467545956003),
            12: complex(0.28025933793912088848, -0.26168253154146032293),
            13: complex(0.11675381075801149185, -0.24236634784749758325),
        }
    }
}
source = "constants of Walker and Preston (1977); Taylor series in extended precision"
