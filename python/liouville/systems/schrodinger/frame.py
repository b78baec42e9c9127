r"""From the user's components to the core's: their order, their phases, or their doubling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liouville.systems.schrodinger.entries import Entries

#: Imaginary parts up to this much of the largest entry are roundoff of the phases.
FLUX = 1e-13


@dataclass(frozen=True)
class Frame:
    r"""What is done to a state on its way to the core, :math:`\phi_k = \bar g_{o(k)} \psi_{o(k)}`.

    A complex Hermitian H = A + iB without a gauge becomes real in twice as many components: on
    states :math:`\phi = (\psi, -i \psi) / \sqrt 2` the symmetric matrix

    .. math::

        \begin{pmatrix} A & -B \\ B & A \end{pmatrix}

    does what H does to :math:`\psi`, and norms and expectations are those of :math:`\psi`. The two
    halves are interleaved, so that entries stay near the diagonal.

    Attributes
    ----------
    size : int
        Number of components N of the user's states.
    order : ndarray or None
        The component in each place, if they are moved.
    gauge : ndarray or None
        The phases g.
    is_doubled : bool
        Whether there are 2N components in the core.
    """

    size: int
    order: np.ndarray | None = None
    gauge: np.ndarray | None = None
    is_doubled: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether the core has the user's components as they are."""
        return self.order is None and self.gauge is None and not self.is_doubled

    def inward(self, psi: np.ndarray) -> np.ndarray:
        """Return states as the core has them; the components are the last axis."""
        if self.gauge is not None:
            psi = psi * self.gauge.conj()
        if self.order is not None:
            psi = psi[..., self.order]
        if self.is_doubled:
            halves = np.stack([psi, -1j * psi], axis=-1) * np.sqrt(0.5)
            psi = halves.reshape(*psi.shape[:-1], -1)
        return np.ascontiguousarray(psi, dtype=complex)

    def outward(self, phi: np.ndarray) -> np.ndarray:
        """Return the core's states as the user has them."""
        if self.is_doubled:
            phi = (phi[..., ::2] + 1j * phi[..., 1::2]) * np.sqrt(0.5)
        if self.order is not None:
            psi = np.empty_like(phi)
            psi[..., self.order] = phi
            phi = psi
        return phi if self.gauge is None else phi * self.gauge

    def diagonal(self, values: np.ndarray) -> np.ndarray:
        """Return a diagonal as the core has it."""
        values = values if self.order is None else values[self.order]
        return np.ascontiguousarray(np.repeat(values, 2) if self.is_doubled else values)

    def entries(self, matrix: Entries) -> Entries:
        """Return a matrix as the core has it; it is complex where the gauge does not fit it."""
        values = matrix.values
        if self.gauge is not None:
            values = self.gauge.conj()[matrix.row] * values * self.gauge[matrix.col]
            if np.abs(values.imag).max(initial=0.0) <= FLUX * np.abs(values).max(initial=0.0):
                values = values.real.copy()
        found = Entries(matrix.n, matrix.row, matrix.col, values)
        found = found if self.order is None else found.moved(self.order)
        return _doubled(found) if self.is_doubled else found


def _doubled(matrix: Entries) -> Entries:
    a, b = matrix.values.real, matrix.values.imag
    row, col = 2 * matrix.row, 2 * matrix.col
    return Entries.of(
        2 * matrix.n,
        np.concatenate([row, row, row + 1, row + 1]),
        np.concatenate([col, col + 1, col, col + 1]),
        np.concatenate([a, -b, b, a]),
    )
