"""Linear systems over the rationals, and in floating point, by the same calls."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

#: What roundoff makes of a coefficient that is zero is below this, relative to what it is made of.
#: Matrices of high degrees have conditions of some thousands.
NOISE = 1e-12


class SingularError(ValueError):
    """The columns of a matrix are dependent."""


def solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve consistent systems of full column rank.

    Parameters
    ----------
    matrix : ndarray, shape (count, rows, columns)
        One matrix for each system, rows >= columns; of fractions, or floating point.
    right : ndarray, shape (count, rows)
        Their right-hand sides.

    Returns
    -------
    ndarray, shape (count, columns)
        By Gaussian elimination, or by least squares with rows scaled to equal size.

    Raises
    ------
    SingularError
        A matrix has dependent columns.
    """
    if matrix.dtype == object:
        pairs = zip(matrix, right, strict=True)
        rows = [_eliminated(m, r[:, None])[:, 0] for m, r in pairs]
        return np.array(rows, dtype=object).reshape(len(matrix), matrix.shape[2])
    scale = np.abs(matrix).max(axis=2, initial=0.0)
    scale[scale == 0] = 1.0
    q, r = np.linalg.qr(matrix / scale[:, :, None])
    pivots = np.abs(np.diagonal(r, axis1=1, axis2=2))
    if pivots.size and (pivots.min(axis=1) <= 1e-13 * pivots.max(axis=1)).any():
        raise SingularError("the columns are dependent")
    projected = np.einsum("krc,kr->kc", q, right / scale)
    return np.asarray(np.linalg.solve(r, projected[:, :, None])[:, :, 0])


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a square matrix."""
    n = len(matrix)
    if matrix.dtype != object:
        if np.linalg.cond(matrix) > 1e13:
            raise SingularError("the matrix is singular")
        return np.linalg.inv(matrix)
    identity = np.array([[Fraction(int(i == k)) for k in range(n)] for i in range(n)], dtype=object)
    return _eliminated(matrix, identity.reshape(n, n))


def _eliminated(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Gauss and Jordan: bring [matrix, right] to [identity, solution], zero rows last."""
    both = np.concatenate([matrix, right], axis=1)
    columns = matrix.shape[1]
    for k in range(columns):
        pivots = np.flatnonzero(both[k:, k])
        if not pivots.size:
            raise SingularError("the columns are dependent")
        both[[k, k + pivots[0]]] = both[[k + pivots[0], k]]
        both[k] = both[k] / both[k, k]
        for row in np.flatnonzero(both[:, k]):
            if row != k:
                both[row] = both[row] - both[row, k] * both[k]
    return np.asarray(both[:columns, columns:])
