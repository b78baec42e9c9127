"""Derivatives of events and of what they do to a motion, for tangents and pullbacks.

They are by everything that an event may depend on, x = (t, y, z, lam, params).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.job import Pair, Slopes
from liouville._systems.events import Event, Impact
from liouville._systems.mechanics.form import total_derivative
from liouville._systems.mechanics.general import Mechanics
from liouville._systems.mechanics.traced import SWITCH
from liouville._systems.tape import record

if TYPE_CHECKING:
    from liouville._systems.mechanics.semi_explicit import SemiExplicit


def event_slopes(system: Mechanics | SemiExplicit, name: str, event: Event) -> Slopes:
    """Record the derivatives of an event and of its reset."""
    value, law = system.event_expressions(name, event)
    return _slopes(system, f"event '{name}'", value, law, isinstance(event.reset, Impact))


def switch_slopes(system: Mechanics, name: str) -> Slopes:
    """Record the derivatives of a switch."""
    value = system.expressions.columns[SWITCH + name]
    return _slopes(system, f"switch '{name}'", value, [], False)


def _slopes(
    system: Mechanics | SemiExplicit, what: str, value: ca.SX, law: list[ca.SX], is_impact: bool
) -> Slopes:
    """Record the tapes of `events::EventSlopes` in the core, of an event and its reset, if any.

    Raises
    ------
    TypeError
        The mass matrix of what an impact moves is not among the expressions.
    """
    s = system.symbols
    x = ca.vertcat(s.t, s.y, s.z, _multipliers(system), s.params.vector)
    gradient = record(f"slopes of {what}", _inputs(system), ca.densify(ca.gradient(value, x)))
    reset = moves = impulse = None
    if law and not is_impact:
        reset = _pair(f"the reset of {what}", system, x, ca.vertcat(*law), {})
        if not ca.is_equal(law[0], s.y):
            moves = _moves(system, what, x)
    # of a semi-explicit system z follows from y, behind a reset too
    if law and isinstance(system, Mechanics):
        impulse = _impulses(system, what, value, x, law[:1] if is_impact else [])
    return gradient, reset, moves, impulse


def _moves(system: Mechanics | SemiExplicit, what: str, x: ca.SX) -> Pair | None:
    """Record the derivatives of a correction that moves coordinates to the constraints, if any."""
    s = system.symbols
    if not isinstance(system, Mechanics):
        field, k = (system.expressions.columns[name] for name in ("field", "constraint"))
        held = ca.SX.sym("held", k.numel())
        change = -ca.jtimes(field, s.z, held)
        found = ca.vertcat(-ca.jtimes(k, s.y, change) - k, change)
        return _pair(f"moves of {what}", system, x, found, {"move": ca.SX(0, 1), "held": held})
    model, own = system.model, system.model.nonholonomic
    if not model.g.numel():
        return None
    move, held = ca.SX.sym("move", s.z.numel()), ca.SX.sym("held", model.g.numel() + own.k.numel())
    hidden = ca.vertcat(total_derivative(model.g, s, model.v), own.k)
    missed = ca.vertcat(model.g, ca.SX.zeros(own.k.numel(), 1))
    balance = ca.jtimes(model.p, s.z, move) - _reactions(system, held)
    found = ca.vertcat(
        balance, ca.jtimes(hidden, s.z, move) + missed, ca.jtimes(model.v, s.z, move)
    )
    return _pair(f"moves of {what}", system, x, found, {"move": move, "held": held})


def _impulses(
    system: Mechanics, what: str, value: ca.SX, x: ca.SX, restitution: list[ca.SX]
) -> Pair | None:
    """Record the derivatives of what changes momenta at a reset, if anything does."""
    s, model = system.symbols, system.model
    own, held = model.nonholonomic, model.lam.numel() + model.nonholonomic.nu.numel()
    is_impact = bool(restitution)
    if not (is_impact or held):
        return None
    if own.nu.numel() and ca.depends_on(ca.jacobian(own.rn, own.nu), s.z):
        sentence = f"the impulses of {what} have no derivatives: they turn with the velocity"
        hint = "nonholonomic constraints that are linear in the velocity have them"
        raise TypeError(hinted(sentence, hint))
    if model.linear.mass is not None:
        sentence = f"the impulses of {what} have no derivatives yet: its masses are a matrix"
        raise TypeError(hinted(sentence, "write the kinetic energy as an expression"))
    after = ca.SX.sym("after", s.z.numel())
    impulses = ca.SX.sym("impulses", held + is_impact)
    balance = _balance(system, (after, impulses), value, restitution)
    return _pair(f"impulses of {what}", system, x, balance, {"after": after, "held": impulses})


def _balance(
    system: Mechanics, unknowns: tuple[ca.SX, ca.SX], value: ca.SX, restitution: list[ca.SX]
) -> ca.SX:
    """Return the equations of impulses: momenta, constraints on z, the rate of an impact."""
    s, model = system.symbols, system.model
    (after, held), own = unknowns, model.nonholonomic
    hidden = ca.vertcat(total_derivative(model.g, s, model.v), own.k)
    ends = ca.vertcat(model.p, hidden, model.v)
    ends = ca.substitute(ends, s.z, after)
    n, m = model.p.numel(), hidden.numel()
    p, w, v = ca.vertsplit(ends, [0, n, n + m, 2 * n + m])
    momentum = p - model.p
    if m:
        momentum -= _reactions(system, held[:m])
    if not restitution:
        return ca.vertcat(momentum, w)
    gradient = ca.gradient(value, s.y)
    before = total_derivative(value, s, model.v)
    rate = ca.dot(gradient, v - model.v) + (1 + restitution[0]) * before
    return ca.vertcat(momentum - gradient * held[m], w, rate)


def _reactions(system: Mechanics, held: ca.SX) -> ca.SX:
    """Return the reactions to small multipliers, in which they are linear."""
    model, own = system.model, system.model.nonholonomic
    lam = ca.vertcat(model.lam, own.nu)
    reactions = model.r + own.rn if own.nu.numel() else model.r
    return ca.substitute(ca.jtimes(reactions, lam, held), lam, ca.SX.zeros(held.numel(), 1))


def _multipliers(system: Mechanics | SemiExplicit) -> ca.SX:
    """Return the multipliers, of which a semi-explicit system has none."""
    return ca.SX(0, 1) if system._multipliers is None else system._multipliers


def _inputs(system: Mechanics | SemiExplicit, **more: ca.SX) -> dict[str, ca.SX]:
    """Return the inputs of an event, and more before the parameters."""
    s = system.symbols
    inputs = s.inputs(z=s.z, lam=_multipliers(system))
    params = inputs.pop("params")
    return {**inputs, **more, "params": params}


def _pair(
    what: str,
    system: Mechanics | SemiExplicit,
    x: ca.SX,
    found: ca.SX,
    more: dict[str, ca.SX],
) -> Pair:
    """Record the derivative of expressions along a direction, and its transpose."""

    def tape(kind: str, vector: ca.SX, is_transposed: bool) -> _core.Tape:
        along = ca.jtimes(found, x, vector, is_transposed)
        return record(f"{kind} {what}", _inputs(system, **more, along=vector), ca.densify(along))

    direction, cotangent = (ca.SX.sym("along", y.numel()) for y in (x, found))
    return tape("tangents of", direction, False), tape("cotangents of", cotangent, True)
