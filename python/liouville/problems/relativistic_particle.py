r"""A relativistic charged particle on a sphere, in a magnetic and an electric field, without units.

.. math::

    L = -m c^2 \sqrt{1 - |v|^2 / c^2} + e A \cdot v - e \phi, \quad
    A = \tfrac B2 (-y, x, 0), \quad \phi = E z, \qquad 0 = \tfrac12 (|q|^2 - l^2)

with m = c = e = l = E = 1 and B = 2. The momentum L_v = gamma m v + e A is nonlinear in the
velocity: gamma varies between 1.34 and 2.94, with speeds up to 0.94 c. Both fields are symmetric
about the z-axis: besides the energy, gamma m c^2 + e phi, the canonical angular momentum about it,
x p_y - y p_x, is constant.

The reference is from Hamilton's equations in spherical angles, extrapolation in 45 digits, two
tolerances 7e-32 apart (``tools/references.py``).
"""

from typing import Any

import casadi as ca

from liouville._systems import Lagrangian
from liouville.problems import Parameters


def vector_potential(q: ca.SX, params: Parameters) -> ca.SX:
    """Return A of the uniform magnetic field along z."""
    return params.B / 2 * ca.vertcat(-q[1], q[0], 0)


def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Free relativistic particle, coupled to both potentials."""
    rest = params.m * params.c**2
    free = -rest * ca.sqrt(1 - ca.dot(v, v) / params.c**2)
    return free + params.e * (ca.dot(vector_potential(q, params), v) - params.E * q[2])


def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
    """Keep the particle on the sphere."""
    return {"sphere": (ca.dot(q, q) - params.l**2) / 2}


def angular_momentum(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return the canonical angular momentum about the fields' axis."""
    gamma = 1 / ca.sqrt(1 - ca.dot(v, v) / params.c**2)
    p = gamma * params.m * v + params.e * vector_potential(q, params)
    return q[0] * p[1] - q[1] * p[0]


system = Lagrangian(
    lagrangian,
    constraint,
    q=("x", "y", "z"),
    params={"m": 1.0, "c": 1.0, "e": 1.0, "B": 2.0, "E": 1.0, "l": 1.0},
    invariants={"angular_momentum": angular_momentum},
)
start: dict[str, Any] = {"q": (0.8, 0.0, 0.6), "v": (0.3, 0.5, -0.4)}
interval = (0.0, 10.0)
h = 0.1
conserved = ("energy", "angular_momentum")
reference = {
    5.0: {
        "q": (-0.740516534404040578799, 0.192604068386133718480, 0.643846981133979467019),
        "v": (0.0647946507429905716545, -0.628044206750196206764, 0.262399893939074426308),
    },
    10.0: {
        "q": (0.898886147106277461005, -0.279224863314239617180, 0.337693900222636415487),
        "v": (-0.190356750893166865935, 0.271289617271548389833, 0.731016617488494059160),
    },
}
source = "canonical equations in spherical angles, extrapolated in 45-digit arithmetic"
