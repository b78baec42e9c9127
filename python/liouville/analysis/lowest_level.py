"""The lowest level of a Hermitian matrix with all its states, by block Lanczos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.arguments import check_memory

Vectors = NDArray[Any]

#: The seed of random vectors.
SEED = 1

#: Up to this size all eigenvalues are found.
DENSE = 256

#: Vectors of the first block and of the largest one.
BLOCK, LARGEST = 3, 96

#: Vectors of the basis for each one of a block, and at least.
KEPT, LEAST = 6, 30

#: States of a level are apart by less than this part of the width, and some residuals.
ONE_LEVEL, RESIDUALS = 1e-9, 10.0

#: How often the method may begin again from the best vectors, and once the lowest of them has
#: converged: twice as often as before, and so many times more for each digit of the tolerance.
RESTARTS, MORE = 1000, 6

#: States are told to be one level by residuals below this part of the width.
TOLD = 1e-8

#: A vector that becomes shorter than this part of itself is made orthogonal again.
SHORTER = 0.5

#: What is left of a vector, relative to what is taken away: nothing.
NOTHING = 1e-14


@dataclass(frozen=True)
class Scale:
    """The width of a spectrum, and the roundoff of its largest eigenvalue."""

    width: float
    roundoff: float

    @classmethod
    def of(cls, low: float, high: float, roundoff: float) -> Scale:
        """Return that between two bounds, with a relative roundoff."""
        return cls(high - low, roundoff * max(abs(low), abs(high)))

    def together(self, values: NDArray[np.float64], residuals: NDArray[np.float64]) -> int:
        """Return how many of the lowest eigenvalues are one level."""
        apart = ONE_LEVEL * self.width + RESIDUALS * (residuals[1:] + residuals[:-1])
        steps = np.flatnonzero(np.diff(values) > apart + RESIDUALS * self.roundoff)
        return int(steps[0]) + 1 if steps.size else values.size


@dataclass(frozen=True)
class Level:
    """The lowest level.

    Attributes
    ----------
    values, vectors : ndarray, shape (m,), (n, m)
        Eigenvalues in order, which roundoff tells apart at most, and orthonormal vectors.
    gap : float
        The distance to the next level; infinite without one, 0 where none was told apart.
    """

    values: NDArray[np.float64]
    vectors: Vectors
    gap: float

    @classmethod
    def among(cls, values: NDArray[np.float64], vectors: Vectors, many: int) -> Level:
        """Return that of the first of some states in order."""
        gap = float(values[many] - values[0]) if many < values.size else np.inf
        return cls(values[:many], vectors[:, :many], gap)


def lowest_level(
    product: Callable[[Vectors], Vectors], size: int, scale: Scale, tol: float, *, is_real: bool
) -> Level | None:
    r"""Find the lowest level of a Hermitian matrix by its products; None if it does not converge.

    A Krylov space of b vectors has at most b states of a level. A level of m < b states is complete
    but for a probability of about (tol sqrt N)^(b - m + 1); one with b is sought again by 2 b.

    Residuals are to fall to `tol` times the width of the spectrum.
    """
    block = min(BLOCK, size)
    wanted = max(tol * scale.width, 2 * scale.roundoff)
    while size > DENSE:
        rows, kind = max(LEAST, KEPT * block), 8.0 if is_real else 16.0
        check_memory("the lowest level", kind * (rows + 3 * block) * size, "find it in a sector")
        found = _Krylov(product, size, scale, block, rows, is_real).level(wanted)
        if found is None or found.values.size < block:
            return found
        if block == LARGEST:
            return Level(found.values, found.vectors, 0.0)
        block *= 2
        if 2 * KEPT * block > size:
            break
    unit = np.eye(size, dtype=float if is_real else complex)
    values, vectors = np.linalg.eigh(np.stack([product(row) for row in unit], axis=1))
    return Level.among(values, vectors, scale.together(values, np.zeros_like(values)))


class _Krylov:
    """Block Lanczos with thick restarts and full reorthogonalisation."""

    def __init__(
        self, product: Callable[[Vectors], Vectors], size: int, scale: Scale, block: int,
        rows: int, is_real: bool,
    ) -> None:  # fmt: skip
        self.product, self.scale, self.block = product, scale, block
        kind = float if is_real else complex
        self.basis = np.zeros((rows, size), kind)
        self.small = np.zeros((rows, rows), kind)
        self.rng = np.random.default_rng(SEED)

    def level(self, wanted: float) -> Level | None:
        """Return the lowest level, or as many of its states as a block has; None if none is seen.

        A single state without a gap where the next level is not told apart.
        """
        kept, block = 0, self._orthonormal(self._random(self.block), 0)[0]
        most, rows = RESTARTS, len(self.basis)
        for restart in range(RESTARTS):
            block, coupling = self._filled(kept, block)
            values, ways = np.linalg.eigh(self.small)
            residuals = np.linalg.norm(coupling @ ways[-self.block :], axis=0)
            many = self.scale.together(values, residuals)
            is_full = many >= self.block
            seen = self.block if is_full else many + 1
            told = TOLD * self.scale.width + self.scale.roundoff if is_full else np.inf
            if (residuals[:seen] <= min(wanted, told)).all():
                return Level.among(values, self.basis.T @ ways, min(many, self.block))
            if residuals[0] <= wanted:
                digits = np.log10(max(self.scale.width / wanted, 1.0))
                most = min(most, 3 * restart + int(MORE * digits))
            if restart >= most:
                return Level(values[:1], self.basis.T @ ways[:, :1], 0.0)
            # whole blocks are added, as all of a residual is in the next one
            kept = rows - self.block * max(1, (rows - min(many, rows // 2)) // (2 * self.block))
            self._restart(kept, values, ways)
        return None

    def _filled(self, known: int, block: Vectors) -> tuple[Vectors, Vectors]:
        """Fill the basis block by block; return the next block, and how it is coupled."""
        coupling = block
        for first in range(known, len(self.basis), self.block):
            last = first + self.block
            self.basis[first:last] = block
            moved = np.stack([self.product(row) for row in block])
            block, parts, coupling = self._orthonormal(moved, last)
            own = parts[first:]
            own[:] = 0.5 * (own + own.conj().T)
            self.small[:last, first:last] = parts
            self.small[first:last, :last] = parts.conj().T
        return block, coupling

    def _restart(self, kept: int, values: Vectors, ways: Vectors) -> None:
        """Keep the lowest states only."""
        self.basis[:kept] = ways[:, :kept].T @ self.basis
        self.small[:] = 0.0
        self.small[range(kept), range(kept)] = values[:kept]

    def _orthonormal(self, rows: Vectors, known: int) -> tuple[Vectors, Vectors, Vectors]:
        """Return an orthonormal block for rows, their parts along the basis and along the block.

        A direction that is nothing but roundoff is replaced by a random one.
        """
        basis, count = self.basis[:known], len(rows)
        parts = np.zeros((known, count), rows.dtype)
        for _ in range(2):
            lengths = np.linalg.norm(rows, axis=1)
            along = basis.conj() @ rows.T
            parts += along
            rows = rows - along.T @ basis
        block, coupling = np.zeros_like(rows), np.zeros((count, count), rows.dtype)
        nothing = NOTHING * float(np.abs(parts).max(initial=0.0)) + self.scale.roundoff
        done = 0
        for k, row in enumerate(rows):
            row, coupling[:done, k] = _beside(row, block[:done])
            before, length = float(lengths[k]), float(np.linalg.norm(row))
            # the rest of a vector that nearly vanishes is not orthogonal to the others yet
            while nothing < length < SHORTER * before:
                before = length
                for vectors, own in ((basis, parts), (block[:done], coupling[:done])):
                    row, along = _beside(row, vectors)
                    own[:, k] += along
                length = float(np.linalg.norm(row))
            if length > nothing:
                coupling[done, k], block[done] = length, row / length
                done += 1
        for k in range(done, count):
            row = self._random(1)[0]
            for _ in range(2):
                row = _beside(_beside(row, basis)[0], block[:k])[0]
            block[k] = row / np.linalg.norm(row)
        return block, parts, coupling

    def _random(self, count: int) -> Vectors:
        """Return random vectors."""
        shape = count, self.basis.shape[1]
        found: Vectors = self.rng.normal(size=shape)
        if self.basis.dtype.kind == "c":
            found = found + 1j * self.rng.normal(size=shape)
        return found


def _beside(row: Vectors, basis: Vectors) -> tuple[Vectors, Vectors]:
    """Return the part of a vector across orthonormal ones, and its parts along them."""
    parts = np.zeros(len(basis), row.dtype)
    for _ in range(2):
        along = basis.conj() @ row
        parts += along
        row = row - along @ basis
    return row, parts
