"""Constant matrices of a model: they go to the core as they are, and never through CasADi."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import misshapen
from liouville._systems.tape import Part
from liouville._systems.tracing.sparse import entries

#: Rows, columns, and the row and column of each entry.
Pattern = tuple[int, int, np.ndarray, np.ndarray]

#: A matrix is symmetric where its skew part is below this part of its largest entry.
SYMMETRIC = 1e-12

#: A term of a tape: first output, input group, factor and matrix.
Term = tuple[int, int, float, _core.Rows]


@dataclass(frozen=True)
class Matrix:
    """A constant sparse matrix of order n.

    Attributes
    ----------
    n : int
        The order.
    places : ndarray
        ``column * n + row`` of each entry, increasing: the order of CasADi's entries.
    values : ndarray
        The entries.
    """

    n: int
    places: np.ndarray
    values: np.ndarray

    @classmethod
    def read(cls, name: str, given: Any) -> Matrix:
        """Read a sparse matrix of SciPy's, a square array, or the array of a diagonal."""
        if hasattr(given, "tocoo"):
            coo = given.tocoo()
            return cls._of(name, coo.shape, coo.row, coo.col, np.asarray(coo.data))
        array = np.asarray(given)
        if array.ndim == 1:
            diagonal = np.arange(array.size)
            return cls._of(name, (array.size, array.size), diagonal, diagonal, array)
        if array.ndim != 2:
            raise misshapen(name, array.shape, "(n, n), or (n,) if diagonal")
        row, col = np.nonzero(array)
        return cls._of(name, array.shape, row, col, array[row, col])

    @classmethod
    def _of(
        cls, name: str, shape: tuple[int, ...], row: np.ndarray, col: np.ndarray, data: np.ndarray
    ) -> Matrix:
        if data.dtype.kind not in "iuf":
            raise TypeError(f"{name} must be a matrix of real numbers, not of {data.dtype}")
        n = shape[0]
        if shape != (n, n) or n == 0:
            raise misshapen(name, shape, "(N, N)")
        bad = np.flatnonzero(~np.isfinite(data))
        if bad.size:
            k = bad[0]
            raise ValueError(f"{name}[{row[k]}, {col[k]}] must be finite, not {data[k]}")
        places, entry = np.unique(col.astype(np.int64) * n + row, return_inverse=True)
        # of no entries bincount returns integers
        values = np.bincount(entry, data.astype(float), places.size).astype(float)
        return cls(n, places[values != 0], values[values != 0])

    @property
    def row(self) -> np.ndarray:
        """The row of each entry."""
        return self.places % self.n

    @property
    def col(self) -> np.ndarray:
        """The column of each entry."""
        return self.places // self.n

    @property
    def skew(self) -> Matrix | None:
        """Half the difference from the transposed; None where that is roundoff."""
        mirrored = self.row.astype(np.int64) * self.n + self.col
        places = np.concatenate([self.places, mirrored])
        halves = np.concatenate([self.values, -self.values]) / 2
        own, entry = np.unique(places, return_inverse=True)
        values = np.bincount(entry, halves, own.size).astype(float)
        if np.abs(values).max(initial=0.0) <= SYMMETRIC * np.abs(self.values).max(initial=0.0):
            return None
        return Matrix(self.n, own[values != 0], values[values != 0])

    def symmetric_times(self, x: np.ndarray) -> np.ndarray:
        """Return the products of the symmetric part with the rows of x."""
        found = np.zeros(x.shape[::-1])
        np.add.at(found, self.row, self.values[:, None] / 2 * x.T[self.col])
        np.add.at(found, self.col, self.values[:, None] / 2 * x.T[self.row])
        return found.T

    def at(self, row: int, col: int) -> float:
        """Return an entry."""
        return float(self.values[self.places == col * self.n + row].sum())

    @cached_property
    def rows(self) -> _core.Rows:
        """The matrix as the core multiplies with it."""
        return _core.Rows(self.n, self.n, self.row, self.col, self.values)


@dataclass(frozen=True)
class Linear:
    """Constant matrices: M z is added to a model's p, -C z - K y to its f; None adds nothing."""

    mass: Matrix | None = None
    damping: Matrix | None = None
    stiffness: Matrix | None = None

    def terms(self, first: int, **groups: tuple[int, float]) -> list[Term]:
        """Return terms from an output on: of each matrix by name, its input group and factor."""
        found = []
        for name, (group, factor) in groups.items():
            matrix: Matrix | None = getattr(self, name)
            if matrix is not None:
                found.append((first, group, factor, matrix.rows))
        return found


class Block:
    """A derivative of a model: traced entries, and a constant matrix times a factor.

    Attributes
    ----------
    pattern : tuple
        Where entries of either are.
    part : Part
        The traced entries on the pattern.
    constant : ndarray
        Those of the constant matrix on the pattern.
    """

    def __init__(self, traced: ca.SX, matrix: Matrix | None = None, factor: float = 1.0) -> None:
        rows, cols = traced.shape
        row, col = (np.array(x, dtype=np.int64) for x in traced.sparsity().get_triplet())
        own = col * rows + row
        places = own
        if matrix is not None:
            both = np.sort(np.concatenate([own, matrix.places]))
            places = both[np.diff(both, prepend=-1) > 0]
        self.pattern: Pattern = (rows, cols, places % max(rows, 1), places // max(rows, 1))
        values = entries(traced)
        self.part = Part(values, np.searchsorted(places, own), places.size)
        self.constant = np.zeros(places.size)
        if matrix is not None:
            self.constant[np.searchsorted(places, matrix.places)] = factor * matrix.values

    def minus_transposed(self) -> Block:
        """Return the negative transposed, which is not traced again."""
        rows, cols, row, col = self.pattern
        order = np.lexsort((col, row))
        found = object.__new__(Block)
        found.pattern = (cols, rows, col[order], row[order])
        found.part = Part(ca.SX(0, 1), np.arange(order.size), order.size, (self.part, order))
        found.constant = np.zeros(order.size)
        return found
