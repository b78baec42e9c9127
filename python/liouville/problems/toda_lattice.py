r"""The Toda lattice of N particles on a ring, in Flaschka's variables, without units.

With :math:`a_i = \tfrac12 e^{(q_i - q_{i+1}) / 2}` and :math:`b_i = -\tfrac12 p_i`, modulo N,

.. math::

    a_i' = a_i (b_{i+1} - b_i), \qquad b_i' = 2 (a_i^2 - a_{i-1}^2)

Constant are the "momentum" :math:`\sum b_i`, the "energy" :math:`\sum 2 b_i^2 + 4 a_i^2`, the
"product" of all a, and "cubic", :math:`\sum b_i^3 + 3 a_i^2 (b_i + b_{i+1})`: traces of powers of
Lax's matrix. The ring must be closed: the open lattice, :math:`a_N = 0`, has the divergence
:math:`b_N - b_1`.

H. Flaschka, Phys. Rev. B 9 (1974) 1924-1925. The references, for eight particles, are by
extrapolation in 45 digits, two tolerances 4e-34 apart (``tools/field_references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def following(x: ca.SX, by: int = 1) -> ca.SX:
    """Return the x_(i + by) of a ring."""
    return ca.vertcat(x[by:], x[:by])


def halves(x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return a and b."""
    n = x.numel() // 2
    return x[:n], x[n:]


def field(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return a' and b'."""
    a, b = halves(x)
    return ca.vertcat(a * (following(b) - b), 2 * (a**2 - following(a, -1) ** 2))


def momentum(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the trace of Lax's matrix."""
    return ca.sum1(halves(x)[1])


def energy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return Hamilton's function, twice the trace of the square."""
    a, b = halves(x)
    return 2 * ca.dot(b, b) + 4 * ca.dot(a, a)


def product(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the product of all a."""
    found = ca.SX(1)
    for factor in ca.vertsplit(halves(x)[0]):
        found *= factor
    return found


def cubic(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the trace of the third power."""
    a, b = halves(x)
    return ca.sum1(b**3 + 3 * a**2 * (b + following(b)))


def build(particles: int) -> PolynomialField:
    """Make the system of a ring.

    Parameters
    ----------
    particles : int
        Number of particles N, at least 3.

    Returns
    -------
    PolynomialField
        With coordinates a0, ..., a(N-1), b0, ..., b(N-1).
    """
    if particles < 3:
        raise ValueError(f"a ring has at least 3 particles, not {particles}")
    names = tuple(f"{letter}{i}" for letter in "ab" for i in range(particles))
    invariants = {"momentum": momentum, "energy": energy, "product": product, "cubic": cubic}
    return PolynomialField(field, x=names, invariants=invariants)


def start_for(particles: int) -> dict[str, Any]:
    """Start with equal distances and momenta of period 7 along the ring."""
    b = (3 * np.arange(particles) % 7 - 3) / 8
    return {"x": np.concatenate([np.full(particles, 0.5), b])}


system = build(8)
start: dict[str, Any] = start_for(8)
interval = (0.0, 10.0)
h = 0.1
conserved = ("momentum", "energy", "product", "cubic")
reference = {
    1.0: {
        "x": (
            0.6749414260434143945565,
            0.6453466073310899256951,
            0.3853957978162177609458,
            0.5776524814649441065353,
            0.3819552472057571526205,
            0.5766017101650185315288,
            0.3622418045656240922080,
            0.5049406385340256629615,
            -0.1635844821618343829954,
            -0.02191005957942495767888,
            0.03373102357047744000970,
            0.1715431434732300875212,
            -0.04742771712113543298614,
            0.04697843353819044290785,
            -0.1803178299907472177082,
            -0.2140125117287559790701,
        ),
    },
    10.0: {
        "x": (
            0.5936503530363752269501,
            0.7403860840405669491880,
            0.3908234094394433895280,
            0.4903821722893599670200,
            0.4607043780303473096763,
            0.4767123914625420905821,
            0.3828165413666906222836,
            0.5515518418450173180043,
            0.01347481300436300981535,
            -0.02945998529856481321034,
            -0.1530219923266413981744,
            -0.2139367434869456009381,
            0.2684794699197490772720,
            -0.2597359147883006346683,
            -0.01051019660390342250234,
            0.009710549580243782406019,
        ),
    },
}
source = "field of Flaschka (1974); extrapolation in 45-digit arithmetic"
