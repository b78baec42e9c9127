"""The system that optimal controls drive: their polynomials of time in the place of parameters."""

from __future__ import annotations

from copy import copy
from itertools import pairwise

import numpy as np

from liouville._basics import casadi as ca
from liouville._studies.optimal.arguments import Array, Controls
from liouville._systems import Mechanics
from liouville._systems.mechanics.form import Model, Nonholonomic
from liouville._systems.mechanics.traced import INVARIANT
from liouville._systems.tracing.expressions import Expressions

#: Expressions of a system, made again at their first use.
KEPT = ("model", "second_order", "separable", "_states_tape")


def polynomials(t: ca.SX, start: float, h: float, stages: Array, c: Array) -> ca.SX:
    """Return the polynomials through the values at the stages of N steps, shape (N, s, k).

    Before the start and after the end those of the first and the last step go on.
    """
    steps, s, _ = stages.shape
    powers = np.linalg.solve(np.vander(c, s, increasing=True), stages)
    starts = (start + h * np.arange(1, steps)).tolist()
    beyond = [ca.SX(1), *(t >= x for x in starts), ca.SX(0)]
    # one of these is one and the others are zero: sums have no roundoff
    chosen = ca.vertcat(*(here - further for here, further in pairwise(beyond)))
    tau = (t - start) / h - ca.dot(chosen, ca.SX(ca.DM(np.arange(float(steps)))))
    value = ca.SX(0)
    for j in reversed(range(s)):
        value = value * tau + ca.mtimes(ca.DM(powers[:, j].T), chosen)
    return value


def driven(system: Mechanics, controls: Controls, values: ca.SX) -> Mechanics:
    """Return the system with expressions of time in the place of its controls."""
    s = system.symbols
    old = s.params.vector[controls.places.tolist()]
    other = copy(system)
    for name in KEPT:
        other.__dict__.pop(name, None)
    columns, model = _replaced(system.expressions, old, values), system.model
    own = Nonholonomic(columns["k"], columns["rn"], model.nonholonomic.nu)
    v, p, f, r, g = (columns[name] for name in "vpfrg")
    Mechanics.__init__(
        other,
        s,
        Model(v, p, f, r, g, model.lam, own, model.linear, model.is_ideal),
        states=system.states,
        coordinates=system.coordinates,
        constraints=system.constraints,
        invariants={name: columns[INVARIANT + name] for name in system.invariants},
        power=columns.get("power"),
    )
    other.switch_tapes = system.switch_tapes
    if "_outputs" in vars(system):  # of a mechanism: efforts are of the controls
        outputs: Expressions = vars(system)["_outputs"]
        found = Expressions(s, _replaced(outputs, old, values))
        other.__dict__.update(_outputs=found, _output_tapes={})
    return other


def _replaced(expressions: Expressions, old: ca.SX, new: ca.SX) -> dict[str, ca.SX]:
    columns = expressions.columns
    found = ca.substitute([*columns.values()], [old], [new])
    return dict(zip(columns, found, strict=True))
