r"""Linear complementarity problems, by Lemke's method with lexicographic ratios.

.. math::

    w = Z z + q, \qquad w \ge 0, \quad z \ge 0, \quad w^T z = 0

Source: Cottle, Pang and Stone, *The Linear Complementarity Problem*, 1992, 4.4 and 4.9.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Pivots are larger than this part of their column.
PIVOT = 1e-11

#: Ratios that differ by this part of the largest are ties, which the lexicographic order decides.
TIE = 1e-12

#: A solution misses its equations by at most this part of their terms.
SOLVED = 1e-8

#: The largest number of pivots, for each unknown.
MOST_PIVOTS = 50

#: How often a ray is followed by a try with another covering vector, and how far q is moved then.
TRIES, MOVED = 6, 1e-12


def lemke(Z: Array, q: Array) -> Array | None:
    """Return z, None where every try ends in a ray."""
    size = float(np.abs(q).max(initial=0.0))
    if not size or q.min(initial=0.0) >= 0:
        return np.zeros(len(q))
    rng = np.random.default_rng(0)  # the same tries for the same problem
    cover, moved = np.ones(len(q)), q
    for _ in range(TRIES):
        basis = _pivoted(Z, moved, cover)
        if basis is not None:
            found = _solved(Z, q, basis)
            if found is not None:
                return found
        cover = rng.uniform(0.2, 1.0, len(q))
        moved = q + MOVED * size * rng.uniform(-1, 1, len(q))
    return None


def _pivoted(Z: Array, q: Array, cover: Array) -> list[int] | None:
    """Return the variables of the last basis, w by 0..n-1 and z by n..2n-1; None for a ray."""
    n = len(q)
    table = np.hstack([np.eye(n), -Z, -cover[:, None], q[:, None]])
    basis, artificial = list(range(n)), 2 * n
    # z0 enters in the row that makes all right-hand sides positive
    row = min(range(n), key=lambda i: (q[i] / cover[i], i))
    entering = artificial
    for _ in range(MOST_PIVOTS * n):
        leaving = basis[row]
        basis[row] = entering
        table[row] /= table[row, entering]
        others = np.arange(n) != row
        table[others] -= np.outer(table[others, entering], table[row])
        if leaving == artificial:
            return basis
        entering = leaving + n if leaving < n else leaving - n
        column = table[:, entering]
        rows = np.flatnonzero(column > PIVOT * max(1.0, float(np.abs(column).max())))
        if not rows.size:
            return None
        row = _least(table, rows, column, basis, artificial)
    return None


def _least(table: Array, rows: Array, column: Array, basis: list[int], artificial: int) -> int:
    """Return the row of the lexicographically least ratio; z0 goes first among ties."""
    ratios = np.column_stack([table[:, -1], table[:, : len(basis)]])[rows] / column[rows][:, None]
    left = np.arange(len(rows))
    for k in range(ratios.shape[1]):
        values = ratios[left, k]
        scale = float(np.abs(ratios[:, k]).max())
        left = left[values <= values.min() + TIE * scale]
        if not k:
            for i in left:
                if basis[rows[i]] == artificial:
                    return int(rows[i])
        if left.size == 1:
            break
    return int(rows[left[0]])


def _solved(Z: Array, q: Array, basis: list[int]) -> Array | None:
    """Return z of a basis, solved afresh; None where it is no solution."""
    n = len(q)
    own = sorted(x - n for x in basis if n <= x < 2 * n)
    z = np.zeros(n)
    if own:
        try:
            z[own] = np.linalg.solve(Z[np.ix_(own, own)], -q[own])
        except np.linalg.LinAlgError:
            return None
    w = Z @ z + q
    terms = np.abs(Z) @ np.abs(z) + np.abs(q)
    size = SOLVED * terms.max(initial=0.0)
    if not np.isfinite(z).all() or w.min(initial=0.0) < -size:
        return None
    if z.min(initial=0.0) < -SOLVED * np.abs(z).max(initial=0.0):
        return None
    return np.maximum(z, 0.0)
