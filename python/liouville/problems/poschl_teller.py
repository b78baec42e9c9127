r"""The well of Pöschl and Teller, whose states are known, and a packet of them; no units.

.. math::

    H = \tfrac12 p^2 - \tfrac12 \lambda (\lambda + 1) \operatorname{sech}^2 x, \qquad
    E_n = -\tfrac12 (\lambda - n)^2, \qquad
    \varphi_n \propto \operatorname{sech}^{\lambda - n} x \; C_n^{(\lambda - n + 1/2)}(\tanh x)

with :math:`\lambda = 16` and Gegenbauer's polynomials C, on 320 points from -10 to 10, where what
the grid leaves out is below roundoff. The start has the states up to n = 11 with equal weights:
a packet spread over a deep well. ``exact(t)`` is the state.

G. Pöschl, E. Teller, Z. Phys. 83 (1933) 143-151.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Grid, Schrodinger
from liouville.problems import Parameters

#: Depth of the well, and how many of its states the packet has.
LAMBDA, STATES = 16, 12


def potential(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the well."""
    return -LAMBDA * (LAMBDA + 1) / 2 / ca.cosh(x) ** 2


def energy(n: int) -> float:
    """Return the energy of a bound state, n from 0."""
    return -((LAMBDA - n) ** 2) / 2


def state(n: int) -> NDArray[np.float64]:
    """Return a bound state, n from 0, of norm 1."""
    x = grid.points[:, 0]
    y, a = np.tanh(x), LAMBDA - n + 0.5
    before, polynomial = np.zeros_like(y), np.ones_like(y)
    for k in range(1, n + 1):
        after = (2 * (k + a - 1) * y * polynomial - (k + 2 * a - 2) * before) / k
        before, polynomial = polynomial, after
    psi: NDArray[np.float64] = polynomial / np.cosh(x) ** (LAMBDA - n)
    return psi / np.linalg.norm(psi)


def exact(t: float) -> NDArray[np.complex128]:
    """Return the packet at a time."""
    psi = sum(np.exp(-1j * energy(n) * t) * state(n) for n in range(STATES))
    return np.asarray(psi / np.sqrt(STATES))


grid = Grid(-10.0, 10.0, 320, potential=potential)
system = Schrodinger(grid)
start: dict[str, Any] = {"psi": exact(0.0).real}
interval = (0.0, 1.0)
tol = 1e-8
conserved = ("norm", "energy")
reference = {t: {"psi": exact(t)} for t in (0.1, 1.0)}
source = "closed form"
