"""Derivatives of a mechanical system by time and parameters, and of its accelerations.

They are recorded when tangents are first wanted, and stay with the system.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville import _casadi as ca
from liouville import _core
from liouville.errors import describe, hinted
from liouville.systems import _consistent
from liouville.systems._derivatives import jacobian
from liouville.systems._form import record_blocks
from liouville.systems._linear import Block
from liouville.systems._motion import equations, kept
from liouville.tape import record

if TYPE_CHECKING:
    from liouville.systems.mechanics import Mechanics

#: Changes of positions, of their partner, and of time and parameters, a row for each direction.
Moves = tuple[np.ndarray, np.ndarray, np.ndarray]


def sensitivity(system: Mechanics) -> _core.Sensitivity:
    r"""Record the tapes of `problem::sensitivity` in the core, with :math:`\tau = (t, params)`."""
    return kept(system, "sensitivity", lambda: _sensitivity(system))


def _sensitivity(system: Mechanics) -> _core.Sensitivity:
    s, model = system._symbols, system._model
    tau, linear = ca.vertcat(s.t, s.params.vector), model.linear
    u, residual, w, rate = equations(system)
    at_stage, at_node = s.inputs(z=s.z), s.inputs(lam=model.lam)
    at_motion = s.inputs(z=s.z, u=u, lam=model.lam)
    stage = {"p_tau": Block(jacobian(model.p, tau)), "f_tau": Block(jacobian(model.f, tau))}
    if "v_z" in system._patterns:
        stage["v_tau"] = Block(jacobian(model.v, tau))
    node = {"g_tau": Block(jacobian(model.g, tau)), "r_tau": Block(jacobian(model.r, tau))}
    hidden = {"w_y": Block(jacobian(w, s.y)), "w_tau": Block(jacobian(w, tau))}
    motion = {
        "motion_y": Block(jacobian(residual, s.y), linear.stiffness),
        "motion_z": Block(jacobian(residual, s.z), linear.damping),
        "motion_tau": Block(jacobian(residual, tau)),
        "rate_y": Block(jacobian(rate, s.y)),
        "rate_z": Block(jacobian(rate, s.z)),
        "rate_tau": Block(jacobian(rate, tau)),
    }
    tapes = {
        "stage": record_blocks("stage", at_stage, [*stage.values()]),
        "node": record_blocks("node", at_node, [*node.values()]),
        "hidden": record_blocks("hidden", at_stage, [*hidden.values()]),
        "motion": record_blocks("motion", at_motion, [*motion.values()]),
    }
    blocks = stage | node | hidden | motion
    patterns = {name: block.pattern for name, block in blocks.items()}
    return _core.Sensitivity(system.problem, tapes, patterns)


def moved_start(
    system: Mechanics,
    t: float,
    y: np.ndarray,
    z: np.ndarray,
    params: np.ndarray,
    moves: Moves,
) -> tuple[np.ndarray, np.ndarray]:
    r"""Return the tangents of :meth:`Mechanics.consistent` at a start that satisfies it.

    .. math::

        dy^* = dy - W^{-1} g_y^T (g_y W^{-1} g_y^T)^{-1} (g_y dy + g_\tau d\tau)

    with the metric W of the mass; then dz alike, with the constraints on z and dy* in its place.

    Raises
    ------
    ValueError
        Constraints are dependent at the start.
    """
    dy, dz, dtau = moves
    dy = _moved(system, "positions", t, (y, z), params, (dy, dz, dtau))
    return dy, _moved(system, "partner", t, (z, y), params, (dz, dy, dtau))


def _moved(
    system: Mechanics,
    what: str,
    t: float,
    at: tuple[np.ndarray, np.ndarray],
    params: np.ndarray,
    moves: Moves,
) -> np.ndarray:
    """Return changes of x, moved by the least that keeps the equations of a projection."""
    tapes, patterns, names = _consistent.recorded(system, what)
    (x, other), (dx, d_other, dtau) = at, moves
    if not names:
        return dx
    held, count = np.append(other, t), len(dx)
    tape = kept(system, f"rates of {what}", lambda: _rates(system, what))
    rows = [np.tile(x, (count, 1)), np.tile(held, (count, 1)), np.hstack([dx, d_other, dtau])]
    rates = tape.map(params, rows)
    found = _core.project_tangents(tapes, patterns, x, held, params, -rates)
    if isinstance(found, dict):
        if found["kind"] == "not finite":
            found["t"] = t
        sentence, _, _ = describe(found, system.coordinates, names)
        hint = "tangents start on constraints that are independent: move away from this position"
        raise ValueError(hinted(f"the start cannot be differentiated: {sentence}", hint))
    return dx + found


def _rates(system: Mechanics, what: str) -> _core.Tape:
    """Record c_x dx + c_held dheld + c_tau dtau of a projection's equations c."""
    s = system._symbols
    x, held, c = _consistent.equations(what, s, system._model)
    along = ca.vertcat(x, held, s.t, s.params.vector)
    d = ca.SX.sym("d", along.numel())
    inputs = {"x": x, "held": ca.vertcat(held, s.t), "d": d, "params": s.params.vector}
    return record(f"rates of {what}", inputs, ca.jtimes(c, along, d))
