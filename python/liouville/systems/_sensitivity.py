"""Derivatives of a mechanical system by time and parameters, and of its accelerations.

They are recorded when tangents are first wanted, and stay with the system.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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

#: Cotangents of a start: of positions, of their partner, and of time and parameters.
Cotangents = tuple[np.ndarray, np.ndarray, np.ndarray]

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


def pulled_start(
    system: Mechanics,
    t: float,
    y: np.ndarray,
    z: np.ndarray,
    params: np.ndarray,
    found: Cotangents,
) -> Cotangents:
    """Return cotangents of a start, from those of the one that `consistent` makes of it.

    It is the transpose of :func:`moved_start`.
    """
    of_y, of_z, of_tau = found
    of_z, more, of_tau = _pulled(system, "partner", t, (z, y), params, (of_z, of_y, of_tau))
    of_y, of_z, of_tau = _pulled(system, "positions", t, (y, z), params, (more, of_z, of_tau))
    return of_y, of_z, of_tau


def _pulled(
    system: Mechanics,
    what: str,
    t: float,
    at: tuple[np.ndarray, np.ndarray],
    params: np.ndarray,
    found: Cotangents,
) -> Cotangents:
    """Return cotangents of x, of what is held and of tau, from those of the x moved."""
    tapes, patterns, names = _consistent.recorded(system, what)
    (x, other), (of_x, of_other, of_tau) = at, found
    if not names:
        return found
    held = np.append(other, t)
    mu = _core.project_cotangents(tapes, patterns, x, held, params, of_x)
    if isinstance(mu, dict):
        raise _undifferentiable(system, t, mu, names)
    tape = kept(system, f"transposed rates of {what}", lambda: _transposed(system, what))
    row = tape.map(params, [part[None] for part in (x, held, mu)])[0]
    n = len(x)
    return of_x - row[:n], of_other - row[n : 2 * n], of_tau - row[2 * n :]


def _undifferentiable(
    system: Mechanics, t: float, error: dict[str, Any], names: tuple[str, ...]
) -> ValueError:
    if error["kind"] == "not finite":
        error["t"] = t
    sentence, _, _ = describe(error, system.coordinates, names)
    hint = "constraints are to be independent at the start: move away from this position"
    return ValueError(hinted(f"the start cannot be differentiated: {sentence}", hint))


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
        raise _undifferentiable(system, t, found, names)
    return dx + found


def _rates(system: Mechanics, what: str) -> _core.Tape:
    """Record c_x dx + c_held dheld + c_tau dtau of a projection's equations c."""
    s = system._symbols
    x, held, c = _consistent.equations(what, s, system._model)
    along = ca.vertcat(x, held, s.t, s.params.vector)
    d = ca.SX.sym("d", along.numel())
    inputs = {"x": x, "held": ca.vertcat(held, s.t), "d": d, "params": s.params.vector}
    return record(f"rates of {what}", inputs, ca.jtimes(c, along, d))


def _transposed(system: Mechanics, what: str) -> _core.Tape:
    """Record the transpose of that at (x, held, mu): by x, by what is held, and by tau."""
    s = system._symbols
    x, held, c = _consistent.equations(what, s, system._model)
    along = ca.vertcat(x, held, s.t, s.params.vector)
    mu = ca.SX.sym("mu", c.numel())
    inputs = {"x": x, "held": ca.vertcat(held, s.t), "mu": mu, "params": s.params.vector}
    return record(f"transposed rates of {what}", inputs, ca.jtimes(c, along, mu, True))
