"""Spline interpolation along one axis of large arrays, by elimination without pivots.

The collocation matrix of B-splines is totally positive and banded, so that elimination without
pivots is stable :cite:p:`deboor1978`. Each of its operations is one on whole rows of data, by the
same elementary operations on every machine. The banded solver of LAPACK works through such data in
many small products, each on several threads, and takes several times as long.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.scipy import scipy

Array = NDArray[np.float64]

#: The use of SciPy, for messages.
WHAT = "a gridded field"


class Interpolation:
    """Splines of degree p with given knots through values at given sites.

    Parameters
    ----------
    sites : ndarray, shape (n,)
        Ascending.
    p : int
        The degree.
    knots : ndarray, shape (n + p + 1,), optional
        By default those of "not a knot": the sites without (p + 1) / 2 of them at each end, or
        without p / 2 of the midpoints between them where p is even.
    """

    def __init__(self, sites: Array, p: int, knots: Array | None = None) -> None:
        self._splines = scipy("interpolate", WHAT).BSpline
        self.p = p
        self.knots = _not_a_knot(sites, p) if knots is None else knots
        found = self._splines.design_matrix(sites, self.knots, p).tocoo()
        bands = np.zeros((sites.size, 2 * p + 1))
        bands[found.row, found.col - found.row + p] = found.data
        self._lower, self._upper = _eliminated(bands, p)

    def coefficients(self, values: Array) -> Array:
        """Return the coefficients of the splines through values, of shape (n, ...)."""
        c, p = np.array(values, dtype=float, order="C"), self.p
        for i, left in enumerate(self._lower):
            for k, factor in enumerate(left, i - p):
                if factor:
                    c[i] -= factor * c[k]
        for i, (pivot, *right) in reversed([*enumerate(self._upper)]):
            for k, factor in enumerate(right, i + 1):
                if factor:
                    c[i] -= factor * c[k]
            c[i] /= pivot
        return c

    def spline(self, values: Array) -> Any:
        """Return the splines through values, of shape (n, ...)."""
        return self._splines(self.knots, self.coefficients(values), self.p)


def _not_a_knot(sites: Array, p: int) -> Array:
    cut = (p + 1) // 2
    inner = sites[cut:-cut] if p % 2 else ((sites[1:] + sites[:-1]) / 2)[cut:-cut]
    return np.concatenate([np.full(p + 1, sites[0]), inner, np.full(p + 1, sites[-1])])


def _eliminated(bands: Array, p: int) -> tuple[list[list[float]], list[list[float]]]:
    """Return the factors L and U of a banded matrix whose row i is columns i - p to i + p.

    Row i of L has its p numbers left of the diagonal, row i of U the diagonal and p on its right.
    """
    n = len(bands)
    for i, row in enumerate(bands):
        for below in range(1, min(p + 1, n - i)):
            if bands[i + below, p - below]:
                factor = bands[i + below, p - below] / row[p]
                bands[i + below, p - below : 2 * p + 1 - below] -= factor * row[p:]
                bands[i + below, p - below] = factor
    return bands[:, :p].tolist(), bands[:, p:].tolist()
