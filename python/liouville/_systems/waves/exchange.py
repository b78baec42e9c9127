"""Spins one half with exchange along z and across it, whose products the core makes by itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from liouville import _core
from liouville._systems.waves.entries import SMALL, Bounds, Entries
from liouville._systems.waves.sites.basis import Basis, Charge

#: Bonds of so many spins are diagonalised together to bound the energies.
BLOCK = 8

#: The core takes no more spins.
MOST = 32

#: Bytes that are taken for each basis state while the bounds of the energies are found.
BUILDING = 44.0


def states_of(length: int, up: int | None) -> Basis:
    """Return the states of spins, bit i set where spin i is down, or those with so many up."""
    name, asked = "the number of spins up", f"up={up}"
    fixed = () if up is None else (Charge(name, asked, 0, length, length - up),)
    return Basis(length, 2, fixed)


@dataclass(frozen=True)
class Exchange:
    r"""Bonds between spins one half, and a field.

    .. math::

        H = \sum_{ij} J_{ij} (S^x_i S^x_j + S^y_i S^y_j) + \Delta_{ij} S^z_i S^z_j
            + \sum_i h_i S^z_i

    Attributes
    ----------
    bonds : list of tuple of int
        The pairs i, j.
    xy, z : ndarray
        J and :math:`\Delta` of each bond.
    field : ndarray
        h of each spin.
    up : int or None
        Number of spins that are up, None for all states.
    """

    bonds: list[tuple[int, int]]
    xy: np.ndarray
    z: np.ndarray
    field: np.ndarray
    up: int | None

    @cached_property
    def states(self) -> Basis:
        """The basis states."""
        return states_of(self.field.size, self.up)

    @property
    def size(self) -> int:
        """Number of basis states."""
        return self.states.size

    def operator(self, factor: float) -> _core.Operator:
        """Return H times a number, without a matrix."""
        bonds = [
            (i, j, factor * float(xy), factor * float(z))
            for (i, j), xy, z in zip(self.bonds, self.xy, self.z, strict=True)
        ]
        return _core.Operator.spins(bonds, (factor * self.field).tolist(), self.up)

    def entries(self) -> Entries:
        """Return the matrix H in the basis."""
        basis, n = self.states.states, self.size
        row, col, values = [np.arange(n)], [np.arange(n)], [self._discs()[0]]
        for (i, j), xy in zip(self.bonds, self.xy, strict=True):
            if xy:
                at = np.flatnonzero(self._differ(i, j))
                row.append(at)
                col.append(self.states.rank(basis[at] ^ (1 << i | 1 << j)))
                values.append(np.full(at.size, xy / 2))
        return Entries.of(n, np.concatenate(row), np.concatenate(col), np.concatenate(values))

    def bounds(self) -> Bounds:
        """Bound the energies in the sector, by those of blocks of bonds, and as Gershgorin does."""
        if self.size <= SMALL:
            return self.entries().bounds
        diagonal, radius = self._discs()
        low, high = self._of_blocks()
        return max(low, float((diagonal - radius).min())), min(
            high, float((diagonal + radius).max())
        )

    def _discs(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the diagonal, and the sum of what is beside it in each row."""
        diagonal = np.zeros(self.size)
        for i, h in enumerate(self.field):
            if h:
                diagonal += h * (0.5 - (self.states.states >> i & 1))
        radius = np.zeros(self.size)
        for (i, j), xy, z in zip(self.bonds, self.xy, self.z, strict=True):
            differ = self._differ(i, j)
            diagonal += np.where(differ, -z / 4, z / 4)
            radius += np.where(differ, abs(xy) / 2, 0.0)
        return diagonal, radius

    def _differ(self, i: int, j: int) -> np.ndarray:
        states = self.states.states
        differ: np.ndarray = ((states >> i ^ states >> j) & 1).astype(bool)
        return differ

    def _of_blocks(self) -> Bounds:
        """Add the energies of blocks of bonds; a spin's field is shared by the blocks it is in."""
        blocks = self._blocks()
        spins = [list(dict.fromkeys(i for k in block for i in self.bonds[k])) for block in blocks]
        shares = np.zeros(self.field.size, dtype=int)
        for inside in spins:
            shares[inside] += 1
        alone = float(np.abs(self.field[shares == 0]).sum()) / 2
        low, high = -alone, alone
        seen: dict[bytes, Bounds] = {}
        for block, inside in zip(blocks, spins, strict=True):
            place = {i: k for k, i in enumerate(inside)}
            bonds = [(place[i], place[j]) for i, j in (self.bonds[k] for k in block)]
            own = self.field[inside] / shares[inside]
            found = Exchange(bonds, self.xy[block], self.z[block], own, None)._ends(seen)
            low, high = low + found[0], high + found[1]
        return low, high

    def _blocks(self) -> list[list[int]]:
        """Return bonds that follow one another, upwards, and join few spins."""
        blocks: list[list[int]] = []
        inside: set[int] = set()
        for k, (i, j) in enumerate(self.bonds):
            if not blocks or i > j or len(inside | {i, j}) > BLOCK:
                blocks.append([])
                inside = set()
            blocks[-1].append(k)
            inside |= {i, j}
        return blocks

    def _ends(self, seen: dict[bytes, Bounds]) -> Bounds:
        """Return the eigenvalues at the ends, which blocks that are alike share."""
        parts = (np.array(self.bonds), self.xy, self.z, self.field)
        key = b"".join(part.tobytes() for part in parts)
        if key not in seen:
            eigenvalues = np.linalg.eigvalsh(self.entries().dense())
            slack = 1e-12 * max(abs(eigenvalues[0]), abs(eigenvalues[-1]))
            seen[key] = float(eigenvalues[0] - slack), float(eigenvalues[-1] + slack)
        return seen[key]
