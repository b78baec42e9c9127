"""Derivatives of a semi-explicit system by time and parameters, and of its consistent starts.

They are recorded when tangents are first wanted, and stay with the system.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.derivatives.sensitivity import Corrections, Moving
from liouville._systems.mechanics.form import record_blocks
from liouville._systems.mechanics.motion import kept
from liouville._systems.tracing.linear import Block
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._systems.mechanics.semi_explicit import SemiExplicit


def sensitivity(system: SemiExplicit) -> _core.SemiExplicitSensitivity:
    """Record the tapes of `SemiExplicitSensitivity` in the core, by time and parameters."""
    return kept(system, "sensitivity", lambda: _sensitivity(system))


def _sensitivity(system: SemiExplicit) -> _core.SemiExplicitSensitivity:
    s, columns = system.symbols, system.expressions.columns
    tau, point = ca.vertcat(s.t, s.params.vector), s.inputs(z=s.z)
    field = {"f_tau": Block(jacobian(columns["field"], tau))}
    constraint = {"k_tau": Block(jacobian(columns["constraint"], tau))}
    by = {"w_y": s.y, "w_tau": tau}
    hidden = {name: Block(jacobian(columns["hidden"], x)) for name, x in by.items()}
    tapes = {
        "field": record_blocks("field", point, [*field.values()]),
        "constraint": record_blocks("constraint", s.inputs(), [*constraint.values()]),
        "hidden": record_blocks("hidden", point, [*hidden.values()]),
    }
    patterns = {name: block.pattern for name, block in (field | constraint | hidden).items()}
    return _core.SemiExplicitSensitivity(system.problem, tapes, patterns)


def moved_start(
    system: SemiExplicit,
    t: float,
    y: np.ndarray,
    params: np.ndarray,
    moves: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Return the tangents of the y of :meth:`SemiExplicit.consistent`, from changes of y and tau.

    Raises
    ------
    ValueError
        Constraints are dependent at the start.
    """
    dy, dtau = moves
    return _corrections(system, t, y, params).pushed(dy, np.empty((len(dy), 0)), dtau)


def pulled_start(
    system: SemiExplicit,
    t: float,
    y: np.ndarray,
    params: np.ndarray,
    found: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Return cotangents of y and tau at a start, from those of what `consistent` makes of it."""
    of_y, of_tau = found
    of_y, _, of_tau = _corrections(system, t, y, params).pulled(of_y, np.empty(0), of_tau)
    return of_y, of_tau


def gradients(system: SemiExplicit, t: float, y: np.ndarray, params: np.ndarray) -> np.ndarray:
    """Return the gradients of the constraints at a point, k_y, shape (l, n)."""
    rows, columns, row, column = system.patterns["k_y"]
    found = np.zeros((rows, columns))
    args = [np.array([[t]]), y[None, :]]
    found[row, column] = system.tapes["constraint_jacobian"].map(params, args)[0]
    return found


def _corrections(system: SemiExplicit, t: float, y: np.ndarray, params: np.ndarray) -> Corrections:
    s, k = system.symbols, system.expressions.columns["constraint"]

    def equations() -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        return s.y, ca.SX(0, 1), k, ca.SX.eye(s.y.numel())

    recorded = (*system._projection, system.constraints)
    moving = Moving(system, "coordinates", recorded, equations)
    return Corrections(moving, t, (y, np.empty(0)), params)
