"""Derivatives of the invariants that a run records, by the point that they are of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.mechanics.motion import kept
from liouville._systems.mechanics.traced import INVARIANT
from liouville._systems.tape import record

if TYPE_CHECKING:
    from liouville._systems.mechanics.general import Mechanics
    from liouville._systems.mechanics.semi_explicit import SemiExplicit
    from liouville._systems.tracing.linear import Linear


def pulled_invariants(
    system: Mechanics | SemiExplicit,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    params: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """Return cotangents of time, y, z and parameters at some points, a row for each.

    `points` are times, y and z; `weights` have the cotangents of all invariants in their order.
    """
    t, y, z = (np.ascontiguousarray(x) for x in points)
    tape = kept(system, "transposed invariants", lambda: _transposed(system))
    found: np.ndarray = tape.map(params, [t[:, None], y, z, np.ascontiguousarray(weights)])
    linear: Linear | None = getattr(system, "_linear", None)
    if linear is not None and "energy" in system.invariants:
        # of (z^T M z + y^T K y) / 2, which no tape has
        weight, n = weights[:, [system.invariants.index("energy")]], y.shape[1]
        for matrix, x, first in ((linear.stiffness, y, 1), (linear.mass, z, 1 + n)):
            if matrix is not None:
                found[:, first : first + n] += weight * matrix.symmetric_times(x)
    return found


def _transposed(system: Mechanics | SemiExplicit) -> _core.Tape:
    """Record the transposed derivative of the invariants."""
    s, columns = system.symbols, system.expressions.columns
    all_of_them = ca.vertcat(*(columns[INVARIANT + name] for name in system.invariants))
    inputs, back = s.inputs(z=s.z), ca.SX.sym("back", all_of_them.numel())
    params, point = inputs.pop("params"), ca.vertcat(s.t, s.y, s.z, s.params.vector)
    found = ca.densify(ca.jtimes(all_of_them, point, back, True))
    return record("transposed invariants", {**inputs, "back": back, "params": params}, found)
