r"""The Volterra lattice of N species on a ring, each of which eats the one before it; no units.

.. math::

    x_i' = x_i (x_{i+1} - x_{i-1}), \qquad i = 1, \dots, N, \text{ modulo } N

Constant are the "sum" of all x, their "product", and the "energy"
:math:`\sum_i \tfrac12 x_i^2 + x_i x_{i+1}`, the next of the lattice's many invariants. All terms
are diagonal. The ring must be closed: the open lattice, :math:`x_0 = x_{N+1} = 0`, has the
divergence :math:`x_N - x_1`.

M. Kac, P. van Moerbeke, Adv. Math. 16 (1975) 160-169. The references, for twelve species, are by
extrapolation in 45 digits, two tolerances 1e-34 apart (``tools/field_references.py``).
"""

from typing import Any

import casadi as ca
import numpy as np

from liouville._systems import PolynomialField
from liouville.problems import Parameters


def following(x: ca.SX, by: int = 1) -> ca.SX:
    """Return the x_(i + by) of a ring."""
    return ca.vertcat(x[by:], x[:by])


def field(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the growth of each species."""
    return x * (following(x) - following(x, -1))


def total(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the sum of all."""
    return ca.sum1(x)


def product(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the product of all."""
    found = ca.SX(1)
    for factor in ca.vertsplit(x):
        found *= factor
    return found


def energy(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the quadratic invariant."""
    return ca.dot(x, x / 2 + following(x))


def build(species: int) -> PolynomialField:
    """Make the system of a ring.

    Parameters
    ----------
    species : int
        Number of species N, at least 3.

    Returns
    -------
    PolynomialField
        With coordinates x0, ..., x(N-1).
    """
    if species < 3:
        raise ValueError(f"a ring has at least 3 species, not {species}")
    invariants = {"sum": total, "product": product, "energy": energy}
    return PolynomialField(field, x=species, invariants=invariants)


def start_for(species: int) -> dict[str, Any]:
    """Start near the equilibrium x = 1, with period 7 along the ring."""
    return {"x": 1 + (5 * np.arange(species) % 7 - 2) / 8}


system = build(12)
start: dict[str, Any] = start_for(12)
interval = (0.0, 10.0)
h = 0.1
conserved = ("sum", "product", "energy")
reference = {
    1.0: {
        "x": (
            0.9132221317649518639809,
            1.553615619078379370196,
            0.7985186725242442315232,
            1.542539196188507736567,
            1.171800069624921675058,
            0.7275083181611896295451,
            1.047763552765475106725,
            1.221933905251053348222,
            1.283092456270019520398,
            0.8059115194261225425320,
            1.325499394752397184569,
            1.108595164192737790684,
        ),
    },
    10.0: {
        "x": (
            0.7900378232337771903104,
            0.7402607701668952787184,
            1.542677044872623178408,
            0.8757831403501098306597,
            1.319184590557217004659,
            1.209651166413757002673,
            0.9196179718908168342719,
            1.444805375202115423242,
            0.9569837884846454025353,
            1.106067680806828030147,
            1.076156156759352781230,
            1.518774491261862043147,
        ),
    },
}
source = "field of Kac and van Moerbeke (1975); extrapolation in 45-digit arithmetic"
