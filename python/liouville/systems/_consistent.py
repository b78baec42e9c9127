"""Start values on their constraints: how far off they are, and what moves them there."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from liouville.errors import hinted
from liouville.systems._derivatives import jacobian
from liouville.systems._form import Model, Symbols, differ, record_blocks, total_derivative
from liouville.systems._linear import Block
from liouville.tape import record


def projections(
    s: Symbols, model: Model, holonomic: tuple[str, ...], nonholonomic: tuple[str, ...]
) -> dict[str, Any]:
    """Record tapes (x, held and t, params) of c, c_x and the metric, for each kind of projection.

    With them come the patterns of the last two and the names of the rows of c.
    """
    w = total_derivative(model.g, s, model.v)
    p_z, v_z = jacobian(model.p, s.z), jacobian(model.v, s.z)
    compliance = ca.solve(v_z.T, p_z.T).T if differ(model.v, s.z) else p_z
    hidden = tuple(f"hidden {name}" for name in holonomic)
    levels = ca.vertcat(w, model.nonholonomic.k), (*hidden, *nonholonomic)
    moved = sorted(set(ca.sparsify(jacobian(levels[0], s.y)).sparsity().row()))
    rows = ca.vertcat(model.g, levels[0][moved])
    both = rows, (*holonomic, *(levels[1][k] for k in moved))
    cases = {
        "positions": (s.y, s.z, (model.g, holonomic), compliance),
        "both": (s.y, s.z, both, compliance),
        "partner": (s.z, s.y, levels, ca.mtimes(v_z.T, p_z)),
    }
    found: dict[str, Any] = {}
    for what, (x, held, (c, names), metric) in cases.items():
        inputs = {"x": x, "held": ca.vertcat(held, s.t), "params": s.params.vector}
        slope, weight = Block(jacobian(c, x)), Block(metric, model.linear.mass)
        tapes = (
            record(what, inputs, c),
            record_blocks(what, inputs, [slope]),
            record_blocks(what, inputs, [weight]),
        )
        found[what] = (tapes, (slope.pattern, weight.pattern), names)
    return found


def check_residual(
    what: str,
    symbol: str,
    names: tuple[str, ...],
    value: np.ndarray,
    limit: np.ndarray,
    t: float,
    hint: str,
) -> None:
    """Refuse values of constraints at the start that are not finite or over their limits."""
    if not np.isfinite(value).all():
        k = int(np.argmin(np.isfinite(value)))
        raise ValueError(
            hinted(
                f"the {what} '{names[k]}' is {value[k]} at the start, t = {t:g}",
                "look for a division by zero, a root or a logarithm of the model there",
            )
        )
    over = np.abs(value) - limit
    k = int(np.argmax(over))
    if not over[k] <= 0:
        raise ValueError(
            hinted(
                f"start violates the {what} '{names[k]}': |{symbol}| = {abs(value[k]):.1e} "
                f"at t = {t:g}, wanted at most {limit[k]:.1e}",
                hint,
            )
        )
