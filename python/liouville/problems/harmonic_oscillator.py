r"""The harmonic oscillator and a coherent state, which keeps its shape; no units.

.. math::

    H = \tfrac12 p^2 + \tfrac12 x^2, \qquad
    \psi(t, x) = \pi^{-1/4} \exp\left(-\tfrac12 (x - x_t)^2 + i p_t x - \tfrac{i}{2} x_t p_t
    - \tfrac{i}{2} t\right)

with :math:`x_t = 2 \cos t` and :math:`p_t = -2 \sin t`, on 128 points from -12 to 12, where what
the grid leaves out is below roundoff. ``exact(t)`` is the state.

E. Schrödinger, Naturwissenschaften 14 (1926) 664-666.
"""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville._systems import Grid, Schrodinger
from liouville.problems import Parameters

DISPLACEMENT = 2.0


def potential(t: ca.SX, x: ca.SX, params: Parameters) -> ca.SX:
    """Return the parabola."""
    return x**2 / 2


def exact(t: float) -> NDArray[np.complex128]:
    """Return the state at a time: values at the points times the root of their distance."""
    x = grid.points[:, 0]
    at, p = DISPLACEMENT * np.cos(t), -DISPLACEMENT * np.sin(t)
    phase = p * x - at * p / 2 - t / 2
    psi: NDArray[np.complex128] = np.exp(-((x - at) ** 2) / 2 + 1j * phase)
    psi *= np.pi**-0.25 * np.sqrt(grid.cell)
    return psi


grid = Grid(-12.0, 12.0, 128, potential=potential)
system = Schrodinger(grid)
start: dict[str, Any] = {"psi": exact(0.0)}
interval = (0.0, 10.0)
tol = 1e-10
conserved = ("norm", "energy")
reference = {t: {"psi": exact(t)} for t in (1.0, 10.0)}
source = "closed form"
