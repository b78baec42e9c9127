"""Start values on their constraints: the projection that moves them there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.faults import describe
from liouville._systems.mechanics.form import Model, differ, record_blocks, total_derivative
from liouville._systems.tape import record
from liouville._systems.tracing.expressions import Symbols
from liouville._systems.tracing.linear import Block, Pattern
from liouville._systems.tracing.sparse import jacobian, solve

if TYPE_CHECKING:
    from liouville._systems.mechanics.general import Mechanics

#: Tapes, patterns, and names of the rows of c; see :func:`projection`.
Projection = tuple[
    tuple[_core.Tape, _core.Tape, _core.Tape], tuple[Pattern, Pattern], tuple[str, ...]
]


def project(
    system: Mechanics, what: str, t: float, x: np.ndarray, held: np.ndarray, params: np.ndarray
) -> np.ndarray:
    """Move x of "positions", of "both" by positions, or of the "partner", onto its constraints.

    Raises
    ------
    ValueError
        No consistent x is near the one given.
    """
    tapes, patterns, names = recorded(system, what)
    if not names:
        return x
    found = _core.project(tapes, patterns, x, np.append(held, t), params)
    if isinstance(found, dict):
        if found["kind"] == "not finite":
            found["t"] = t
        sentence, _, _ = describe(found, system.coordinates, names)
        sentence = f"no consistent start is near the one given: {sentence}"
        raise ValueError(hinted(sentence, "start nearer to the constraints, or hold less"))
    return found


def recorded(system: Mechanics, what: str) -> Projection:
    """Return the projection of a system, recorded when it is first wanted."""
    if what not in system._recorded:
        named = system.holonomic, system.nonholonomic
        system._recorded[what] = projection(what, system.symbols, system.model, *named)
    found: Projection = system._recorded[what]
    return found


def equations(what: str, s: Symbols, model: Model) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return x, what is held, and c of "positions" or of the "partner"."""
    if what == "partner":
        return s.z, s.y, ca.vertcat(total_derivative(model.g, s, model.v), model.nonholonomic.k)
    return s.y, s.z, model.g


def metric(what: str, s: Symbols, model: Model) -> ca.SX:
    """Return the metric of x in a projection, but for the constants of a structure."""
    p_z, v_z = jacobian(model.p, s.z), jacobian(model.v, s.z)
    if not differ(model.v, s.z):
        return p_z
    return ca.mtimes(v_z.T, p_z) if what == "partner" else solve(v_z.T, p_z.T).T


def projection(
    what: str, s: Symbols, model: Model, holonomic: tuple[str, ...], nonholonomic: tuple[str, ...]
) -> Projection:
    """Record the projection of "positions", of "both" by positions, or of the "partner".

    Returns tapes (x, held and t, params) of c, c_x and the metric, the patterns of the last two and
    the names of the rows of c.
    """
    x, held, c = equations(what, s, model)
    names = holonomic
    if what == "partner":
        names = (*(f"hidden {name}" for name in holonomic), *nonholonomic)
    if what == "both":
        w = total_derivative(model.g, s, model.v)
        moved = sorted(set(ca.sparsify(jacobian(w, s.y)).sparsity().row()))
        c = ca.vertcat(c, w[moved] if moved else ca.SX(0, 1))
        names = (*names, *(f"hidden {holonomic[k]}" for k in moved))
    inputs = {"x": x, "held": ca.vertcat(held, s.t), "params": s.params.vector}
    slope, weight = Block(jacobian(c, x)), Block(metric(what, s, model), model.linear.mass)
    tapes = (
        record(what, inputs, c),
        record_blocks(what, inputs, [slope]),
        record_blocks(what, inputs, [weight]),
    )
    return tapes, (slope.pattern, weight.pattern), names
