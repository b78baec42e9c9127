"""In which form the core multiplies with a matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liouville import _core
from liouville.systems.schrodinger.entries import Bounds, Entries, check_size

#: A matrix with more than this part of its places taken is a dense one.
FULL = 0.25

#: Diagonals are stored whole if there are no more of them than this, ...
MOST_DIAGONALS = 24

#: ... and more than this part of the places of all is taken.
FILLED = 0.25


@dataclass(frozen=True)
class Term:
    """A constant part of H: its operators in the core, and bounds of its eigenvalues if known."""

    operators: list[_core.Operator]
    bounds: Bounds | None

    def __post_init__(self) -> None:
        """Refuse energies that are too large."""
        check_size("H / hbar", self.bounds or ())


def operators(matrix: Entries) -> list[_core.Operator]:
    """Return a real symmetric matrix as terms: dense, by diagonals, and the rest by rows."""
    n = matrix.n
    if matrix.values.size > FULL * n * n and n > 1:
        return [_core.Operator.dense(matrix.dense())]
    offset = matrix.col - matrix.row
    offsets, counts = np.unique(offset[offset >= 0], return_counts=True)
    whole = offsets
    if whole.size > MOST_DIAGONALS or counts.sum() <= FILLED * (n - offsets).sum():
        whole = offsets[counts > FILLED * (n - offsets)]
    if not 0 < whole.size <= MOST_DIAGONALS:
        return [by_rows(matrix)]
    values = []
    for k in whole.tolist():
        at = offset == k
        diagonal = np.zeros(n - k)
        diagonal[matrix.row[at]] = matrix.values[at]
        values.append(diagonal)
    terms = [_core.Operator.diagonals(n, whole.tolist(), values)]
    left = ~np.isin(np.abs(offset), whole)
    if left.any():
        rest = Entries(n, matrix.row[left], matrix.col[left], matrix.values[left])
        terms.append(by_rows(rest))
    return terms


def twice(operator: _core.Operator, is_doubled: bool) -> _core.Operator:
    """Return a real operator as the core has it beside complex ones."""
    return operator.twice() if is_doubled else operator


def by_rows(matrix: Entries) -> _core.Operator:
    """Return a matrix by its rows."""
    n = matrix.n
    return _core.Operator.rows(_core.Rows(n, n, matrix.row, matrix.col, matrix.values))
