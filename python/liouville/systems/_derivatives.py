"""Sparse derivatives, whatever their pattern."""

from __future__ import annotations

import casadi as ca
import numpy as np


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
