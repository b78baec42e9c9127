r"""An upright disk that rolls on an inclined plane and is steered by a potential, without units.

.. math::

    L = \tfrac m2 (\dot x^2 + \dot y^2) + \tfrac I2 \dot\theta^2 + \tfrac J2 \dot\varphi^2
        - m a x - k \cos\varphi, \qquad
    0 = \dot x - r \cos\varphi\, \dot\theta, \quad 0 = \dot y - r \sin\varphi\, \dot\theta

with m = r = 1, I = 1/2, J = 1/4, a = 1/2, k = 1/3: the disk touches the plane at (x, y), heads for
:math:`\varphi` and rolls by :math:`\theta` without slipping. Two constraints on velocities leave
two of four directions free at each point, and yet the disk gets everywhere. Constant are the
energy and, as nothing else turns the disk, the energy of steering,
:math:`\tfrac J2 \dot\varphi^2 + k \cos\varphi`.

The reference is from the equations of the two angles, extrapolation in 45 digits, two tolerances
2e-32 apart (``tools/references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def steering(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the energy of the heading."""
    return params.J / 2 * v[3] ** 2 + params.k * ca.cos(q[3])


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Kinetic energy less the potentials of gravity and of steering."""
    kinetic = params.m / 2 * ca.dot(v[:2], v[:2])
    kinetic += params.I / 2 * v[2] ** 2 + params.J / 2 * v[3] ** 2
    return kinetic - params.m * params.a * q[0] - params.k * ca.cos(q[3])


def nonholonomic(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Let the point of contact be at rest."""
    rolled = params.r * v[2]
    return {"along x": v[0] - ca.cos(q[3]) * rolled, "along y": v[1] - ca.sin(q[3]) * rolled}


def outline(q: NDArray[np.float64], params: Any) -> list[NDArray[np.float64]]:
    """Draw the rim with a spoke, upright on the plane."""
    angles = np.linspace(0, 2 * np.pi, 33) + q[2]
    along = params.r * np.sin(angles)
    rim = np.stack([np.cos(q[3]) * along, np.sin(q[3]) * along, params.r * np.cos(angles)], axis=1)
    return [np.array([q[0], q[1], params.r]) + np.array([np.zeros(3), *rim])]


system = Lagrangian(
    lagrangian,
    nonholonomic=nonholonomic,
    q=("x", "y", "theta", "phi"),
    params={"m": 1.0, "r": 1.0, "I": 0.5, "J": 0.25, "a": 0.5, "k": 1 / 3},
    invariants={"steering": steering},
)
start: dict[str, Any] = {"q": (0.0, 0.0, 0.0, 0.0), "v": (1.0, 0.0, 1.0, 0.5)}
interval = (0.0, 5.0)
h = 0.05
conserved = ("energy", "steering")
reference = {
    1.0: {
        "q": (
            0.797406282036228471702,
            0.211579622621762246607,
            0.837433119895265669127,
            0.616812393911362046044,
        ),
        "v": (
            0.558278670417674591104,
            0.395879701591937086436,
            0.684394485641028295341,
            0.861043661450278820975,
        ),
        "lam": (0.0626729105669958780705, -0.323419952418112123713),
    },
    5.0: {
        "q": (
            1.23098918666276862908,
            -0.217850433273431613529,
            3.55140389116503347783,
            6.27647805711361204797,
        ),
        "v": (
            0.423476651441784639411,
            -0.00284040639242936970638,
            0.423486177135477367571,
            0.500059979115563999345,
        ),
        "lam": (-0.168102035737556412599, -0.213999408445075186868),
    },
}
source = "rolling disk with a steering potential; its angles extrapolated in 45-digit arithmetic"
