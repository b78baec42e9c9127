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


def traced_names(system: Mechanics | SemiExplicit) -> tuple[str, ...]:
    """Return the names of invariants whose expressions are whole.

    The energy of a structure has quadratic forms of sparse matrices besides.
    """
    linear = getattr(system, "_linear", None)
    is_whole = linear is None or (linear.mass is None and linear.stiffness is None)
    return tuple(name for name in system.invariants if is_whole or name != "energy")


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
    return tape.map(params, [t[:, None], y, z, np.ascontiguousarray(weights)])


def _transposed(system: Mechanics | SemiExplicit) -> _core.Tape:
    """Record the transposed derivative of the invariants."""
    s, columns = system._symbols, system._expressions.columns
    all_of_them = ca.vertcat(*(columns[INVARIANT + name] for name in system.invariants))
    inputs, back = s.inputs(z=s.z), ca.SX.sym("back", all_of_them.numel())
    params, point = inputs.pop("params"), ca.vertcat(s.t, s.y, s.z, s.params.vector)
    found = ca.densify(ca.jtimes(all_of_them, point, back, True))
    return record("transposed invariants", {**inputs, "back": back, "params": params}, found)
