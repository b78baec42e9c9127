"""Constraints on velocities, and the reactions that keep them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.mechanics.form import Nonholonomic, differ
from liouville._systems.mechanics.traced import check_moved
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Symbols
from liouville._systems.tracing.sparse import jacobian, solve


def rolling(
    constraint: Callable[..., Any] | None, s: Symbols, v: ca.SX, holonomic: tuple[str, ...]
) -> tuple[tuple[str, ...], Nonholonomic]:
    """Trace k(t, q, v) with ideal reactions -k_v^T nu, where v may be an expression of z."""
    if constraint is None:
        return (), Nonholonomic()
    u = ca.SX.sym("v", v.numel())
    names, k = _named(constraint, s, "v", u, holonomic)
    nu = ca.SX.sym("nu", len(names))
    rn = -ca.jtimes(k, u, nu, True)
    return names, Nonholonomic(ca.substitute(k, u, v), ca.substitute(rn, u, v), nu)


def rolling_of_z(
    constraint: Callable[..., Any] | None,
    reaction: Callable[..., Any] | None,
    s: Symbols,
    v: ca.SX,
    holonomic: tuple[str, ...],
) -> tuple[tuple[str, ...], Nonholonomic]:
    """Trace k(t, y, z) and its reactions, ideal ones unless given."""
    if constraint is None:
        if reaction is not None:
            raise TypeError("nonholonomic_reaction is given without nonholonomic constraints")
        return (), Nonholonomic()
    names, k = _named(constraint, s, "z", s.z, holonomic)
    nu = ca.SX.sym("nu", len(names))
    if reaction is None:
        rn = -ca.jtimes(k, s.z, nu, True)
        if differ(v, s.z):
            rn = solve(jacobian(v, s.z).T, rn)
    else:
        *point, params = s.args.items()
        args = dict([*point, ("lam", nu), params])
        rn = _trace.column("nonholonomic_reaction", reaction, args, s.y.numel())
        check_felt("nonholonomic_reaction", rn, nu, names)
    return names, Nonholonomic(k, rn, nu)


def check_felt(what: str, reaction: ca.SX, multipliers: ca.SX, names: tuple[str, ...]) -> None:
    """Refuse a reaction that leaves a multiplier out."""
    felt = set(ca.sparsify(jacobian(reaction, multipliers)).sparsity().get_col())
    for k, name in enumerate(names):
        if k not in felt:
            raise ValueError(f"{what} does not depend on the multiplier of '{name}'")


def _named(
    constraint: Callable[..., Any],
    s: Symbols,
    speed: str,
    velocity: ca.SX,
    holonomic: tuple[str, ...],
) -> tuple[tuple[str, ...], ca.SX]:
    t, y, _, params = s.args.items()
    args = dict([t, y, (speed, velocity), params])
    names, k = _trace.named("nonholonomic", constraint, args)
    twice = set(names) & set(holonomic)
    if twice:
        raise ValueError(f"'{min(twice)}' names a holonomic and a nonholonomic constraint")
    for row, name in enumerate(names):
        if ca.depends_on(k[row], s.y) and not ca.depends_on(k[row], velocity):
            raise ValueError(
                hinted(
                    f"nonholonomic constraint '{name}' does not depend on the velocity",
                    "it is holonomic then: give it to constraint=",
                )
            )
    check_moved(names, k, velocity, ("nonholonomic constraint", "velocities"))
    return names, k
