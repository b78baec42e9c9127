"""In which form the core multiplies with a matrix."""

from __future__ import annotations

from liouville import _core
from liouville.systems.schrodinger.entries import Entries


def operators(matrix: Entries) -> list[_core.Operator]:
    """Return a real symmetric matrix as terms of the core."""
    n = matrix.n
    return [_core.Operator.rows(_core.Rows(n, n, matrix.row, matrix.col, matrix.values))]
