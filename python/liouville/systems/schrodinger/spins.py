"""Chains of spins one half."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import check_memory, count
from liouville.systems._trace import numbers
from liouville.systems.schrodinger.entries import SMALL, Bounds, Entries, check_size

#: Blocks of so many bonds are diagonalised to bound the energies.
BLOCK = 7

#: The core takes no longer chains.
LONGEST = 32

#: Bytes that are taken for each basis state while the bounds of the energies are found.
BUILDING = 44.0


@dataclass(frozen=True, init=False, eq=False, repr=False)
class SpinChain:
    r"""A chain of L spins one half with exchange between neighbours, and a field.

    .. math::

        H = \sum_i J_i (S^x_i S^x_{i+1} + S^y_i S^y_{i+1}) + \Delta_i S^z_i S^z_{i+1}
            + \sum_i h_i S^z_i

    It is real, and keeps the number of spins that are up, so that a state lives in the sector of
    one such number.

    Parameters
    ----------
    length : int
        Number of spins L, at least 2.
    xy, z : float or array_like, default 1.0
        J and :math:`\Delta`: of all bonds, or of each: L - 1 of them, L if periodic.
    field : float or array_like, default 0.0
        h, of all spins or of each.
    periodic : bool, default False
        Whether the last spin is a neighbour of the first; L is then at least 3.
    up : int, optional
        Number of spins that are up, for states of this sector; all states by default.

    Attributes
    ----------
    length, xy, z, field, periodic, up
        As given, with xy, z and field as arrays.
    basis : ndarray
        The basis states in order: bit i is set where spin i is down, so state 0 is all up.
    size : int
        Number of basis states N.

    Raises
    ------
    TypeError, ValueError
        A number is of the wrong kind or not finite, or there is not one for each bond or spin.

    Examples
    --------
    >>> import liouville as lv
    >>> lv.SpinChain(4, up=2).basis
    array([ 3,  5,  6,  9, 10, 12])
    """

    length: int
    xy: np.ndarray
    z: np.ndarray
    field: np.ndarray
    periodic: bool
    up: int | None

    def __init__(
        self,
        length: int,
        xy: ArrayLike = 1.0,
        z: ArrayLike = 1.0,
        field: ArrayLike = 0.0,
        periodic: bool = False,
        up: int | None = None,
    ) -> None:
        n = count("length", length)
        if n < 2 + bool(periodic):
            raise ValueError(f"length = {n}: a chain has at least 2 spins, 3 if it is periodic")
        if up is not None:
            if isinstance(up, bool) or not isinstance(up, (int, np.integer)):
                raise TypeError(f"up is a number of spins, not {up!r}")
            if not 0 <= up <= n:
                raise ValueError(f"up = {up}: a chain of {n} has 0 to {n} spins up")
        bonds = n if periodic else n - 1
        found = {
            "length": n, "xy": _along("xy", xy, bonds, "bond"), "z": _along("z", z, bonds, "bond"),
            "field": _along("field", field, n, "spin"), "periodic": bool(periodic),
            "up": None if up is None else int(up),
        }  # fmt: skip
        for name, value in found.items():
            object.__setattr__(self, name, value)
        hint = "give up=, the number of spins that are up, or fewer spins"
        if n > LONGEST:
            raise ValueError(f"length = {n}: chains have at most {LONGEST} spins")
        check_memory(f"a chain of {n} spins, with a state", (16.0 + BUILDING) * self.size, hint)

    def __repr__(self) -> str:
        """Name the length and the sector."""
        sector = "" if self.up is None else f", {self.up} up"
        return f"SpinChain({self.length} spins{sector}{', periodic' if self.periodic else ''})"

    @property
    def size(self) -> int:
        """Number of basis states."""
        return 2**self.length if self.up is None else comb(self.length, self.up)

    @cached_property
    def basis(self) -> np.ndarray:
        """The basis states in order."""
        if self.up is None:
            return np.arange(2**self.length)
        low = self.length // 2
        down = self.length - self.up
        states = np.arange(2**low)
        by_count = [states[np.bitwise_count(states) == k] for k in range(low + 1)]
        high = np.arange(2 ** (self.length - low))
        rest = down - np.bitwise_count(high).astype(int)
        fits = np.flatnonzero((rest >= 0) & (rest <= low))
        return np.concatenate([(high[k] << low) + by_count[rest[k]] for k in fits])

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what can be computed again."""
        return {name: x for name, x in self.__dict__.items() if name != "basis"}

    def index(self, state: int) -> int:
        """Return the place of a basis state; ValueError if it is in another sector."""
        place = int(np.searchsorted(self.basis, state))
        if place == self.size or self.basis[place] != state:
            raise ValueError(f"state {state} is not among the {self.size} of this sector")
        return place

    def sz(self, i: int) -> np.ndarray:
        """Return the diagonal of the z component of spin i."""
        return 0.5 - (self.basis >> i & 1)

    @property
    def bonds(self) -> list[tuple[int, int]]:
        """The pairs of neighbours."""
        pairs = [(i, i + 1) for i in range(self.length - 1)]
        return [*pairs, (self.length - 1, 0)] if self.periodic else pairs

    def entries(self) -> Entries:
        """Return the matrix H in the basis."""
        basis, n = self.basis, self.size
        row, col, values = [np.arange(n)], [np.arange(n)], [self._discs()[0]]
        for (i, j), xy in zip(self.bonds, self.xy, strict=True):
            if xy:
                at = np.flatnonzero(self._differ(i, j))
                row.append(at)
                col.append(np.searchsorted(basis, basis[at] ^ (1 << i | 1 << j)))
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
        diagonal = sum((h * self.sz(i) for i, h in enumerate(self.field) if h), np.zeros(self.size))
        radius = np.zeros(self.size)
        for (i, j), xy, z in zip(self.bonds, self.xy, self.z, strict=True):
            differ = self._differ(i, j)
            diagonal += np.where(differ, -z / 4, z / 4)
            radius += np.where(differ, abs(xy) / 2, 0.0)
        return diagonal, radius

    def _differ(self, i: int, j: int) -> np.ndarray:
        differ: np.ndarray = ((self.basis >> i ^ self.basis >> j) & 1).astype(bool)
        return differ

    def operator(self, factor: float) -> _core.Operator:
        """Return H times a number, without a matrix."""
        bonds = [
            (i, j, factor * float(xy), factor * float(z))
            for (i, j), xy, z in zip(self.bonds, self.xy, self.z, strict=True)
        ]
        return _core.Operator.spins(bonds, (factor * self.field).tolist(), self.up)

    def _of_blocks(self) -> Bounds:
        """Add the energies of blocks of bonds; a spin's field is shared by the blocks it is in."""
        low, high, bonds = 0.0, 0.0, self.length - 1
        seen: dict[bytes, Bounds] = {}
        blocks = [(np.arange(k, min(k + BLOCK, bonds))) for k in range(0, bonds, BLOCK)]
        spins = [np.append(block, block[-1] + 1) for block in blocks]
        if self.periodic:
            blocks.append(np.array([bonds]))
            spins.append(np.array([bonds, 0]))
        shares = np.bincount(np.concatenate(spins), minlength=self.length)
        for block, inside in zip(blocks, spins, strict=True):
            own = self.field[inside] / shares[inside]
            found = self._of_block(self.xy[block], self.z[block], own, seen)
            low, high = low + found[0], high + found[1]
        return low, high

    @staticmethod
    def _of_block(
        xy: np.ndarray, z: np.ndarray, own: np.ndarray, seen: dict[bytes, Bounds]
    ) -> Bounds:
        key = b"".join(x.tobytes() for x in (xy, z, own))
        if key not in seen:
            block = SpinChain(own.size, xy, z, own).entries()
            eigenvalues = np.linalg.eigvalsh(block.dense())
            slack = 1e-12 * max(abs(eigenvalues[0]), abs(eigenvalues[-1]))
            seen[key] = float(eigenvalues[0] - slack), float(eigenvalues[-1] + slack)
        return seen[key]


def _along(name: str, value: Any, size: int, what: str) -> np.ndarray:
    found = numbers(value)
    if found is None:
        raise TypeError(f"{name} is a number, or an array of one for each {what}, not {value!r}")
    if found.shape not in ((), (size,)):
        raise ValueError(
            f"{name} has shape {found.shape}, wanted one number for each {what}: {size}"
        )
    if not np.isfinite(found).all():
        raise ValueError(f"{name} is finite, not {value!r}")
    check_size(name, found)
    found = np.broadcast_to(found, size).copy()
    found.setflags(write=False)
    return found
