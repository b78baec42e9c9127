"""Derivatives of a mechanical system by time and parameters, and of its accelerations.

They are recorded when tangents are first wanted, and stay with the system.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.faults import describe
from liouville._systems.mechanics import consistent as _consistent
from liouville._systems.mechanics.form import record_blocks
from liouville._systems.mechanics.motion import equations, kept
from liouville._systems.tape import record
from liouville._systems.tracing.linear import Block
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._systems.mechanics.general import Mechanics
    from liouville._systems.mechanics.semi_explicit import SemiExplicit

#: Cotangents of a start: of positions, of their partner, and of time and parameters.
Cotangents = tuple[np.ndarray, np.ndarray, np.ndarray]

#: Changes of positions, of their partner, and of time and parameters, a row for each direction.
Moves = tuple[np.ndarray, np.ndarray, np.ndarray]

#: Corrections of this size relative to x are roundoff, and so are smaller ones than the next
#: number that no longer shrink.
ROUNDOFF, STALLED = 1e-14, 1e-9

#: More corrections than a consistent start takes.
MOST_CORRECTIONS = 100


def sensitivity(system: Mechanics) -> _core.Sensitivity:
    r"""Record the tapes of `problem::sensitivity` in the core, with :math:`\tau = (t, params)`."""
    return kept(system, "sensitivity", lambda: _sensitivity(system))


def _sensitivity(system: Mechanics) -> _core.Sensitivity:
    s, model = system.symbols, system.model
    tau, linear = ca.vertcat(s.t, s.params.vector), model.linear
    u, residual, held, rate = equations(system)
    own, m = model.nonholonomic, model.g.numel()
    at_stage, at_node = s.inputs(z=s.z), s.inputs(lam=model.lam)
    at_motion = s.inputs(z=s.z, u=u, lam=ca.vertcat(model.lam, own.nu))
    stage = {"p_tau": Block(jacobian(model.p, tau)), "f_tau": Block(jacobian(model.f, tau))}
    node = {"g_tau": Block(jacobian(model.g, tau)), "r_tau": Block(jacobian(model.r, tau))}
    w = held[:m]
    hidden = {"w_y": Block(jacobian(w, s.y)), "w_tau": Block(jacobian(w, tau))}
    motion = {
        "motion_y": Block(jacobian(residual, s.y), linear.stiffness),
        "motion_z": Block(jacobian(residual, s.z), linear.damping),
        "motion_tau": Block(jacobian(residual, tau)),
        "rate_y": Block(jacobian(rate, s.y)),
        "rate_z": Block(jacobian(rate, s.z)),
        "rate_tau": Block(jacobian(rate, tau)),
    }
    if "v_z" in system.patterns:
        stage["v_tau"] = Block(jacobian(model.v, tau))
    rolling: dict[str, Block] = {}
    if own.nu.numel():
        rolling = {"k_tau": Block(jacobian(own.k, tau)), "rn_tau": Block(jacobian(own.rn, tau))}
    tapes = {
        "stage": record_blocks("stage", at_stage, [*stage.values()]),
        "node": record_blocks("node", at_node, [*node.values()]),
        "hidden": record_blocks("hidden", at_stage, [*hidden.values()]),
        "motion": record_blocks("motion", at_motion, [*motion.values()]),
    }
    if rolling:
        at_nu = s.inputs(z=s.z, nu=own.nu)
        tapes["nonholonomic"] = record_blocks("nonholonomic", at_nu, [*rolling.values()])
    blocks = stage | node | hidden | motion | rolling
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
    r"""Return the tangents of :meth:`Mechanics.consistent`, on the constraints or beside them.

    They are those of each of its corrections :math:`\delta`, which solve :math:`F = 0` with

    .. math::

        F = (W \delta - c_x^T \mu,\ c_x \delta + c), \qquad
        F_{\delta, \mu}\, (d\delta, d\mu) = -F_x\, dx - F_\tau\, d\tau ,

    where W is the metric of the mass: first of positions, then of z with positions moved. On the
    constraints this is the projection onto them.

    Raises
    ------
    ValueError
        Constraints are dependent at the start.
    """
    dy, dz, dtau = moves
    positions = Corrections(_projection(system, "positions"), t, (y, z), params)
    dy = positions.pushed(dy, dz, dtau)
    partner = Corrections(_projection(system, "partner"), t, (z, positions.end), params)
    return dy, partner.pushed(dz, dy, dtau)


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
    positions = Corrections(_projection(system, "positions"), t, (y, z), params)
    partner = Corrections(_projection(system, "partner"), t, (z, positions.end), params)
    of_z, of_y, of_tau = partner.pulled(of_z, of_y, of_tau)
    of_y, of_z, of_tau = positions.pulled(of_y, of_z, of_tau)
    return of_y, of_z, of_tau


def _projection(system: Mechanics, what: str) -> Moving:
    s, model = system.symbols, system.model

    def equations() -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        # constants in the metric do not move
        return *_consistent.equations(what, s, model), _consistent.metric(what, s, model)

    return Moving(system, what, _consistent.recorded(system, what), equations)


@dataclass(frozen=True)
class Moving:
    """A projection onto constraints that is differentiated.

    Attributes
    ----------
    system : Mechanics or SemiExplicit
        Whose it is.
    what : str
        What it moves.
    recorded : tuple
        Its tapes, their patterns, and names of the rows of c; see
        :func:`_consistent.projection`.
    equations : callable
        What returns x, what is held, c and the metric, as expressions.
    """

    system: Mechanics | SemiExplicit
    what: str
    recorded: _consistent.Projection
    equations: Callable[[], tuple[ca.SX, ca.SX, ca.SX, ca.SX]]


class Corrections:
    """The corrections that move x onto a projection's equations, and their derivative.

    Attributes
    ----------
    end : ndarray, shape (n,)
        The point that they lead to.
    """

    def __init__(
        self,
        moving: Moving,
        t: float,
        at: tuple[np.ndarray, np.ndarray],
        params: np.ndarray,
    ) -> None:
        self._moving, self._t, self._params = moving, t, params
        self.tapes, self.patterns, self._names = moving.recorded
        self.end, other = at
        self._held = np.append(other, t)
        self._steps: list[tuple[np.ndarray, np.ndarray]] = []
        size, last, seen = np.inf, np.inf, list[np.ndarray]()
        while self._names and size > ROUNDOFF and (size < last or size > STALLED):
            x, last = self.end, size
            if len(self._steps) == MOST_CORRECTIONS:
                raise ValueError("no consistent start is near the one given")
            c = self.tapes[0].map(params, [x[None], self._held[None]])[0]
            if any(np.array_equal(c, earlier) for earlier in seen):
                break  # constraints round more coarsely than x does, near 0
            seen.append(c)
            row = self._solved(x, np.concatenate([np.zeros_like(x), -c])[None], False)[0]
            self._steps.append((x, row))
            self.end = x + row[: len(x)]
            scale = max(np.abs(self.end).max(), np.abs(x).max())
            size = np.abs(row[: len(x)]).max() / scale if scale else 0.0

    def pushed(self, dx: np.ndarray, d_held: np.ndarray, dtau: np.ndarray) -> np.ndarray:
        """Return changes of the end, a row for each direction."""
        for x, row in self._steps:
            along = np.hstack([dx, d_held, dtau])
            given = [np.tile(part, (len(dx), 1)) for part in (x, self._held, row)]
            rates = self._tape(_rates).map(self._params, [*given, along])
            dx = dx + self._solved(x, -rates, False)[:, : dx.shape[1]]
        return dx

    def pulled(self, of_x: np.ndarray, of_held: np.ndarray, of_tau: np.ndarray) -> Cotangents:
        """Return cotangents of the point, of what is held and of tau, from those of the end."""
        n, last = len(of_x), len(of_x) + len(of_held)
        for x, row in reversed(self._steps):
            right = np.concatenate([of_x, np.zeros(len(row) - n)])
            back = self._solved(x, right[None], True)[0]
            given = [part[None] for part in (x, self._held, row, back)]
            found = self._tape(_transposed).map(self._params, given)[0]
            of_x, of_held = of_x - found[:n], of_held - found[n:last]
            of_tau = of_tau - found[last:]
        return of_x, of_held, of_tau

    def _tape(self, make: Callable[[Moving], _core.Tape]) -> _core.Tape:
        moving = self._moving
        return kept(moving.system, f"{make.__name__} {moving.what}", lambda: make(moving))

    def _solved(self, x: np.ndarray, rows: np.ndarray, is_transposed: bool) -> np.ndarray:
        """Solve with the matrix of a correction at x, or with its transpose."""
        found = _core.project_linear(
            self.tapes, self.patterns, x, self._held, self._params, rows, is_transposed
        )
        if isinstance(found, dict):
            if found["kind"] == "not finite":
                found["t"] = self._t
            sentence, _, _ = describe(found, self._moving.system.coordinates, self._names)
            hint = "constraints are to be independent at the start: move away from this position"
            raise ValueError(hinted(f"the start cannot be differentiated: {sentence}", hint))
        return found


def _rates(moving: Moving) -> _core.Tape:
    """Record F_x dx + F_held dheld + F_tau dtau at (x, held, (delta, mu))."""
    inputs, along, equations = _correction(moving)
    d = ca.SX.sym("d", along.numel())
    params = inputs.pop("params")
    name = f"rates of {moving.what}"
    return record(name, {**inputs, "d": d, "params": params}, ca.jtimes(equations, along, d))


def _transposed(moving: Moving) -> _core.Tape:
    """Record the transpose of that: by x, by what is held, and by tau."""
    inputs, along, equations = _correction(moving)
    back = ca.SX.sym("back", equations.numel())
    params = inputs.pop("params")
    found = ca.jtimes(equations, along, back, True)
    name = f"transposed rates of {moving.what}"
    return record(name, {**inputs, "back": back, "params": params}, found)


def _correction(moving: Moving) -> tuple[dict[str, ca.SX], ca.SX, ca.SX]:
    """Return inputs, what moves, and F of a projection."""
    s = moving.system.symbols
    x, held, c, metric = moving.equations()
    step = ca.SX.sym("step", x.numel() + c.numel())
    delta, mu = ca.vertsplit(step, [0, x.numel(), step.numel()])
    impulse = ca.mtimes(metric, delta) - ca.jtimes(c, x, mu, True)
    missing = ca.jtimes(c, x, delta) + c
    inputs = {"x": x, "held": ca.vertcat(held, s.t), "step": step, "params": s.params.vector}
    along = ca.vertcat(x, held, s.t, s.params.vector)
    return inputs, along, ca.vertcat(impulse, missing)
