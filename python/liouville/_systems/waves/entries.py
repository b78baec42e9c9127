"""Hermitian matrices by their entries: read, checked, and bounded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from liouville._basics.arguments import check_memory, counted, large_integers
from liouville._basics.errors import hinted, misshapen

#: Entries that mirror one another may differ by this much of the largest entry: roundoff, ...
ROUNDOFF = 1e-14

#: ... where a matrix is of single precision by so much.
SINGLE = 2e-6

#: Up to this order the eigenvalues at the ends are cheap to find.
SMALL = 256

#: Bytes that are taken for each entry while a matrix is read and turned into the core's form, ...
READING = 100.0

#: ... for each of a complex one, which has four times the entries in the core, ...
COMPLEX = 276.0

#: ... and for each of a lattice, whose entries are known to be symmetric.
MAKING = 72.0

#: Bytes of each row, with a state.
ROW = 40.0

#: The largest number that is taken, of H and of a state: squares and products must be finite.
LARGEST = 1e100

#: What to take for open systems.
MESOLVE = "QuTiP's mesolve takes open systems"
OPEN = f"absorber= takes W of H - iW; collapse operators are not taken: {MESOLVE}"

#: An interval of eigenvalues.
Bounds = tuple[float, float]


def numbers(what: str, value: Any) -> np.ndarray:
    """Return an array of numbers, real or complex; TypeError names what is none."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        array = np.array(None)
    array = large_integers(array)
    if array.dtype.kind not in "iufc":
        raise TypeError(f"{what} must be an array of numbers, not {value!r}")
    return array


def of_size(value: Any) -> str:
    """Return a size for a message, of long types beyond the largest float too."""
    return np.format_float_scientific(value, precision=1, trim="0")


def check_size(what: str, values: Any) -> None:
    """Refuse energies so large that products with them overflow."""
    with np.errstate(over="ignore"):
        largest = np.longdouble(np.max(np.abs(values), initial=0.0))
    if not largest <= LARGEST:
        size = of_size(largest)
        sentence = f"{what} has numbers of size {size}, and their products are not finite"
        raise ValueError(hinted(sentence, "choose units in which H / hbar is of order 1"))


def check_order(what: str, n: int) -> None:
    """Refuse a matrix of so high an order that rows and states do not fit in memory."""
    check_memory(
        f"{what} of order {counted(n)}, with a state,", ROW * n, "leave out rows without entries"
    )


def check_entries(what: str, count: int, each: float = READING) -> None:
    """Refuse a matrix of more entries than there is memory for."""
    hint = "give H by its products, (N, function), or a smaller one"
    check_memory(f"{what} with its {counted(count)} entries", each * count, hint)


@dataclass(frozen=True)
class Entries:
    """A Hermitian matrix of order n, each place once, by rows.

    Attributes
    ----------
    n : int
        The order.
    row, col : ndarray
        The places, by rows.
    values : ndarray
        The entries, real or complex, none of them zero.
    roundoff : float
        How far entries that mirror one another may differ, in units of the largest, when it is
        read.
    """

    n: int
    row: np.ndarray
    col: np.ndarray
    values: np.ndarray
    roundoff: float = ROUNDOFF

    @classmethod
    def of(cls, n: int, row: np.ndarray, col: np.ndarray, values: np.ndarray) -> Entries:
        """Return a matrix from entries in any order; those at the same place are added."""
        places = row.astype(np.int64) * n + col
        by_place = np.argsort(places)
        places, values = places[by_place], values[by_place]
        is_new = np.diff(places, prepend=-1) != 0
        if not is_new.all():
            values = np.add.reduceat(values, np.flatnonzero(is_new))
            places = places[is_new]
        kept = values != 0
        places, values = places[kept], values[kept]
        row = places // n
        return cls(n, row, places - row * n, values)

    @classmethod
    def read(cls, name: str, given: Any) -> Entries:
        """Read a Hermitian matrix: one of SciPy's, a square array, or the array of a diagonal.

        Raises
        ------
        TypeError
            It is no matrix of numbers.
        ValueError
            It is not square, not finite or not Hermitian; the message names the entry.
        """
        return cls.read_any(name, given)._symmetric(name)

    @classmethod
    def read_any(cls, name: str, given: Any) -> Entries:
        """Read a matrix that may not be Hermitian; see :meth:`read`."""
        if hasattr(given, "tocsr"):
            check_order(name, max(given.shape))
            check_entries(name, given.nnz, COMPLEX if given.dtype.kind == "c" else READING)
            csr = given.tocsr(copy=True)
            csr.sum_duplicates()
            row = np.repeat(np.arange(csr.shape[0]), np.diff(csr.indptr))
            found = (csr.shape, row, csr.indices, numbers(name, csr.data))
        else:
            array = numbers(name, given)
            if array.ndim == 1:
                diagonal = np.arange(array.size)
                found = ((array.size, array.size), diagonal, diagonal, array)
            elif array.ndim == 2:
                each = COMPLEX if array.dtype.kind == "c" else READING
                check_entries(name, int(np.count_nonzero(array)), each)
                row, col = np.nonzero(array)
                found = (array.shape, row, col, array[row, col])
            else:
                raise misshapen(name, array.shape, "(N, N)")
        return cls._checked(name, *found)

    @classmethod
    def _checked(
        cls, name: str, shape: tuple[int, ...], row: np.ndarray, col: np.ndarray, data: np.ndarray
    ) -> Entries:
        n = shape[0]
        if shape != (n, n) or n == 0:
            raise misshapen(name, shape, "(N, N)")
        bad = np.flatnonzero(~np.isfinite(data))
        if bad.size:
            k = bad[0]
            raise ValueError(f"{name}[{row[k]}, {col[k]}] must be finite, not {data[k]}")
        check_size(name, data)
        values = data.astype(complex if data.dtype.kind == "c" else float)
        kept = values != 0
        row, col, values = row[kept].astype(np.int64), col[kept].astype(np.int64), values[kept]
        if values.dtype.kind == "c" and not values.imag.any():
            values = values.real.copy()
        roundoff = SINGLE if data.dtype in (np.float32, np.complex64) else ROUNDOFF
        return cls(n, row, col, values, roundoff)

    def _symmetric(self, name: str) -> Entries:
        """Return the matrix with roundoff taken from its symmetry."""
        mirror = np.argsort(self.col, kind="stable")
        places = self.row * self.n + self.col
        mirrored = self.col[mirror] * self.n + self.row[mirror]
        slack = self.roundoff * np.abs(self.values).max(initial=0.0)
        if not np.array_equal(places, mirrored):
            alone = np.setxor1d(places, mirrored)
            small = np.abs(self.values) <= slack
            lonely = np.isin(places, alone)
            if (lonely & ~small).any():
                self._refuse(name)
            kept = ~lonely
            places = self.row[kept], self.col[kept]
            return replace(self, row=places[0], col=places[1], values=self.values[kept])._symmetric(
                name
            )
        other = self.values[mirror].conj()
        if (np.abs(self.values - other) > slack).any():
            self._refuse(name)
        return Entries(self.n, self.row, self.col, (self.values + other) / 2)

    def halves(self) -> list[Entries]:
        r"""Return :math:`(A + A^\dagger)/2` and, if it is not zero, :math:`(A - A^\dagger)/2i`."""
        if not self._skew().values.size:
            return [self._symmetric("A")]
        places = np.concatenate([self.row, self.col]), np.concatenate([self.col, self.row])
        mirrored = self.values.conj()
        halves = (self.values / 2, mirrored / 2), (self.values / 2j, -mirrored / 2j)
        return [
            Entries.of(self.n, *places, np.concatenate(half))._symmetric("A") for half in halves
        ]

    def _skew(self) -> Entries:
        r"""Return :math:`A - A^\dagger` where it is more than roundoff."""
        row, col = np.concatenate([self.row, self.col]), np.concatenate([self.col, self.row])
        values = np.concatenate([self.values, -self.values.conj()])
        found = Entries.of(self.n, row, col, values)
        far = np.abs(found.values) > self.roundoff * np.abs(self.values).max(initial=0.0)
        return Entries(self.n, found.row[far], found.col[far], found.values[far])

    def _refuse(self, name: str) -> None:
        skew = self._skew()
        k = int(np.abs(skew.values).argmax())
        i, j, far = int(skew.row[k]), int(skew.col[k]), float(np.abs(skew.values[k]))
        one, other = self.at(i, j), self.at(j, i)
        if self.is_real:
            one, other = one.real, other.real
        if i == j:
            sentence = f"{name}[{i}, {i}] = {one:.6g} is not real"
        else:
            sentence = f"{name}[{i}, {j}] = {one:.6g}, but {name}[{j}, {i}] = {other:.6g}"
        part = far / float(np.abs(self.values).max())
        sentence += (
            f", where {name} - {name}^+ is largest: {far:.3g}, or {part:.2g} of the largest entry"
        )
        hint = f"only a Hermitian matrix keeps the norm; {OPEN}"
        if name[1:].isdigit():
            hint = f"of a drive f(t) K + h.c. with a real f give K + K^+; {hint}"
        raise ValueError(hinted(f"{name} is not Hermitian: {sentence}", hint))

    def at(self, i: int, j: int) -> complex:
        """Return an entry."""
        found = np.flatnonzero((self.row == i) & (self.col == j))
        return complex(self.values[found[0]]) if found.size else 0j

    @property
    def is_real(self) -> bool:
        """Whether all entries are real."""
        return self.values.dtype.kind == "f"

    @property
    def is_diagonal(self) -> bool:
        """Whether there is nothing beside the diagonal."""
        return bool((self.row == self.col).all())

    @property
    def reach(self) -> int:
        """How far from the diagonal there are entries."""
        return int(np.abs(self.row - self.col).max(initial=0))

    def times(self, factor: float) -> Entries:
        """Return the matrix times a number."""
        return Entries(self.n, self.row, self.col, self.values * factor)

    def moved(self, order: np.ndarray) -> Entries:
        """Return the matrix whose row i is row ``order[i]``."""
        place = np.empty_like(order)
        place[order] = np.arange(self.n)
        row, col = place[self.row], place[self.col]
        by_row = np.argsort(row * self.n + col)
        return Entries(self.n, row[by_row], col[by_row], self.values[by_row])

    def dense(self) -> np.ndarray:
        """Return the matrix as an array."""
        array = np.zeros((self.n, self.n), dtype=self.values.dtype)
        array[self.row, self.col] = self.values
        return array

    @cached_property
    def bounds(self) -> Bounds:
        """Bounds of the eigenvalues: Gershgorin's, or those of a small matrix themselves."""
        (low, high), slack = self._discs
        if self.n <= SMALL and not self.is_diagonal:
            eigenvalues = np.linalg.eigvalsh(self.dense())
            # a computed eigenvalue is off by a small multiple of n units of the norm
            low = max(low, float(eigenvalues[0]) - (self.n + 1) * slack)
            high = min(high, float(eigenvalues[-1]) + (self.n + 1) * slack)
        return low, high

    @property
    def discs(self) -> Bounds:
        """Gershgorin's bounds of the eigenvalues."""
        return self._discs[0]

    @cached_property
    def _discs(self) -> tuple[Bounds, float]:
        """The same, and a rounding of the largest sum."""
        on = self.row == self.col
        diagonal = np.bincount(self.row[on], self.values[on].real, self.n)
        radius = np.bincount(self.row[~on], np.abs(self.values[~on]), self.n)
        low, high = (diagonal - radius).min(), (diagonal + radius).max()
        check_size("H / hbar", (low, high))
        slack = ROUNDOFF * (np.abs(diagonal) + radius).max()
        return (float(low - slack), float(high + slack)), float(slack)
