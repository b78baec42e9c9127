r"""From the user's components to the core's: their order, their phases, or their doubling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liouville._systems.waves.entries import Entries

#: Imaginary parts up to this much of the largest entry are roundoff of the phases.
FLUX = 1e-13


@dataclass(frozen=True)
class Frame:
    r"""The transformation of a state for the core, :math:`\phi_k = \bar g_{o(k)} \psi_{o(k)}`.

    Attributes
    ----------
    size : int
        Number of components N of the user's states.
    order : ndarray or None
        The component in each place, if they are moved.
    gauge : ndarray or None
        The phases g.
    is_doubled : bool
        Whether H stays complex: the core then has it as a real matrix, see :func:`doubled`.
    """

    size: int
    order: np.ndarray | None = None
    gauge: np.ndarray | None = None
    is_doubled: bool = False

    def inward(self, psi: np.ndarray) -> np.ndarray:
        """Return states as the core has them; the components are the last axis."""
        if self.gauge is not None:
            psi = psi * self.gauge.conj()
        if self.order is not None:
            psi = psi[..., self.order]
        return np.ascontiguousarray(psi, dtype=complex)

    def outward(self, phi: np.ndarray) -> np.ndarray:
        """Return the core's states as the user has them."""
        if self.order is not None:
            psi = np.empty_like(phi)
            psi[..., self.order] = phi
            phi = psi
        return phi if self.gauge is None else phi * self.gauge

    def diagonal(self, values: np.ndarray) -> np.ndarray:
        """Return a diagonal as the core has it."""
        values = values if self.order is None else values[self.order]
        return np.ascontiguousarray(values)

    def entries(self, matrix: Entries) -> Entries:
        """Return a matrix as the core has it; it is complex where the gauge does not fit it."""
        values = matrix.values
        if self.gauge is not None:
            values = self.gauge.conj()[matrix.row] * values * self.gauge[matrix.col]
            if np.abs(values.imag).max(initial=0.0) <= FLUX * np.abs(values).max(initial=0.0):
                values = values.real.copy()
        found = Entries(matrix.n, matrix.row, matrix.col, values)
        return found if self.order is None else found.moved(self.order)


def doubled(matrix: Entries) -> Entries:
    r"""Return a complex matrix A + iB as a real one, which acts on real and imaginary parts.

    .. math::

        \begin{pmatrix} A & -B \\ B & A \end{pmatrix}
    """
    a, b = matrix.values.real, matrix.values.imag
    row, col, n = matrix.row, matrix.col, matrix.n
    return Entries.of(
        2 * n,
        np.concatenate([row, row, row + n, row + n]),
        np.concatenate([col, col + n, col, col + n]),
        np.concatenate([a, -b, b, a]),
    )
