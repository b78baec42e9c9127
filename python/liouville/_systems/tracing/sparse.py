"""Sparse derivatives, whatever their pattern."""

from __future__ import annotations

import numpy as np

from liouville._basics import casadi as ca


def jacobian(column: ca.SX, x: ca.SX) -> ca.SX:
    """Return the derivative of a column of expressions, sparse.

    CasADi differentiates by columns or rows that have no place in common, all those together in one
    sweep {cite:p}`andersson2019`. A full row among sparse ones, where all meet in one coordinate or
    in one constraint, leaves no two columns apart: n sweeps over n expressions. Such rows are
    differentiated each by itself, if that makes the sweeps less than half.
    """
    if not column.numel() or not x.numel():
        return ca.jacobian(column, x)
    pattern = ca.jacobian_sparsity(column, x)
    in_row, in_column = (
        np.bincount(places, minlength=1) for places in (pattern.row(), pattern.get_col())
    )
    fullest = np.argsort(-in_row, kind="stable")
    sweeps = np.arange(in_row.size) + in_row[fullest]  # with the first k of them apart
    apart = int(np.argmin(sweeps))
    if 2 * sweeps[apart] >= min(in_row.max(), in_column.max()):
        return ca.jacobian(column, x)
    alone = fullest[:apart]
    together = np.setdiff1d(np.arange(column.numel()), alone)
    found = ca.vertcat(
        ca.jacobian(column[together.tolist()], x),
        *(ca.jacobian(column[k], x) for k in alone.tolist()),
    )
    return found[np.argsort(np.concatenate([together, alone])).tolist(), :]


def entries(matrix: ca.SX) -> ca.SX:
    """Return the entries of a sparse matrix as a dense column."""
    return ca.vec(ca.SX(matrix.nz[:]))


def solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Return the X of matrix X = right, by one group of coupled unknowns after the other.

    A matrix of blocks, a rigid body's each, has an inverse of such blocks; eliminated as a whole it
    takes a search over all columns for each of them.
    """
    pattern = matrix.sparsity()
    if pattern.is_diag():
        diagonal, places = entries(matrix), right.sparsity()
        return ca.SX(places, entries(right) / diagonal[places.row()])
    groups, order, starts = (pattern + pattern.T).scc()
    if groups == 1:
        return ca.solve(matrix, right)
    sizes = np.diff(starts)
    group, place = np.empty((2, len(order)), dtype=np.int64)
    group[order] = np.repeat(np.arange(groups), sizes)
    place[order] = np.arange(len(order)) - np.repeat(starts[:-1], sizes)
    of_matrix, of_right = (_by_group(x, group, groups) for x in (matrix, right))
    found: list[tuple[ca.SX, np.ndarray, np.ndarray]] = []
    for k, size in enumerate(sizes.tolist()):
        (a, row, col), (b, at, side) = of_matrix[k], of_right[k]
        if not side.size:
            continue
        sides, own_side = np.unique(side, return_inverse=True)
        block = ca.solve(
            _sparse((size, size), a, place[row], place[col]),
            _sparse((size, sides.size), b, place[at], own_side),
        )
        own = np.array(order[starts[k] : starts[k + 1]])
        row, col = (np.array(x, dtype=np.int64) for x in block.sparsity().get_triplet())
        found.append((entries(block), own[row], sides[col]))
    if not found:
        return ca.SX(*right.shape)
    values, rows, cols = zip(*found, strict=True)
    column: ca.SX = ca.vertcat(ca.SX(0, 1), *values)
    return _sparse(right.shape, column, np.concatenate(rows), np.concatenate(cols))


def _by_group(
    matrix: ca.SX, group: np.ndarray, groups: int
) -> list[tuple[ca.SX, np.ndarray, np.ndarray]]:
    """Return the entries in each group of rows, with the row and column of each."""
    row, col = (np.array(x, dtype=np.int64) for x in matrix.sparsity().get_triplet())
    order = np.argsort(group[row], kind="stable")
    cuts = np.searchsorted(group[row][order], np.arange(1, groups))
    values = entries(matrix)
    return [(values[k.tolist()], row[k], col[k]) for k in np.split(order, cuts)]


def _sparse(shape: tuple[int, int], values: ca.SX, row: np.ndarray, col: np.ndarray) -> ca.SX:
    """Return the matrix of these entries."""
    order = np.lexsort((row, col))
    pattern = ca.Sparsity.triplet(*shape, row[order].tolist(), col[order].tolist())
    return ca.SX(pattern, values[order.tolist()])
