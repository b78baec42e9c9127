"""Constraints whose gradients are nearly dependent at a state."""

from __future__ import annotations

import numpy as np

from liouville._systems.tracing.linear import Pattern

#: Gradients of length one are nearly dependent where a singular value is below this.
NEARLY = 1e-2
#: A gradient vanishes that is shorter than this part of the longest.
VANISHING = 1e-6
#: Rows of more constraints are not decomposed.
MOST = 300
#: Coordinates and constraints are measured in units that are powers of this: so large that nothing
#: changes in a system about one long and wide.
UNIT = 1024.0
#: Sizes below this part of the largest are roundoff, and have no unit.
ROUNDOFF = 1e-12


def dense(pattern: Pattern, values: np.ndarray) -> np.ndarray:
    """Return a derivative as a matrix, of values that begin with its entries."""
    rows, columns, row, column = pattern
    matrix = np.zeros((rows, columns))
    matrix[row, column] = values[: len(row)]
    return matrix


def unit(size: np.ndarray) -> np.ndarray:
    """Return the power of `UNIT` that brings each size near one; one where there is roundoff."""
    known = np.where(size > ROUNDOFF * size.max(initial=0.0), size, 1.0)
    factors: np.ndarray = UNIT ** -np.round(np.log2(known) / np.log2(UNIT))
    return factors


def nearly_dependent(
    pattern: Pattern, values: np.ndarray, names: tuple[str, ...]
) -> tuple[str, ...]:
    """Name the constraints that nearly depend on one another, by the entries of their gradients."""
    m, n, _, _ = pattern
    if not 0 < m <= MOST or not np.all(np.isfinite(values)):
        return ()
    gradients = dense(pattern, values)
    lengths = np.linalg.norm(gradients, axis=1)
    largest = lengths.max()
    short = [name for name, x in zip(names, lengths, strict=True) if x <= VANISHING * largest]
    if short:
        return tuple(short)
    left, sizes, _ = np.linalg.svd(gradients / lengths[:, None])
    if m <= n and sizes[-1] > NEARLY:
        return ()
    shares = np.abs(left[:, -1])
    return tuple(name for name, x in zip(names, shares, strict=True) if x > NEARLY * shares.max())
