"""The general form of mechanical systems: its expressions, and their tapes for the core.

Where a model has constant matrices beside its expressions, they are terms of the tapes and constant
entries of the derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tape import record
from liouville._systems.tracing.expressions import Symbols
from liouville._systems.tracing.linear import Block, Linear, Pattern, Term
from liouville._systems.tracing.sparse import entries, jacobian


def _none() -> ca.SX:
    return ca.SX(0, 1)


@dataclass(frozen=True)
class Nonholonomic:
    """Constraints k(t, y, z) and their reactions rn(t, y, z, nu)."""

    k: ca.SX = field(default_factory=_none)
    rn: ca.SX = field(default_factory=_none)
    nu: ca.SX = field(default_factory=_none)


@dataclass(frozen=True)
class Redundant:
    """Constraints left out, and the reactions of all to a multiplier of one, a column each."""

    reactions: ca.SX
    left_out: tuple[int, ...]


@dataclass(frozen=True)
class Model:
    """The expressions v, p, f, r and g of the general form; r depends on `lam`.

    A linear part, which wants v = z, adds to p and f. Ideal reactions r are -g_y^T lam. The
    derivative g_y is kept where it is known already. Where p is L_z of a Lagrangian L, f is kept in
    two parts, L_y and the rest.
    """

    v: ca.SX
    p: ca.SX
    f: ca.SX
    r: ca.SX
    g: ca.SX
    lam: ca.SX
    nonholonomic: Nonholonomic = field(default_factory=Nonholonomic)
    linear: Linear = field(default_factory=Linear)
    is_ideal: bool = False
    redundant: Redundant | None = None
    g_y: ca.SX | None = None
    force: tuple[ca.SX, ca.SX] | None = None


def compiled(
    s: Symbols, model: Model
) -> tuple[dict[str, _core.Tape], dict[str, Pattern], _core.Mechanical]:
    """Differentiate and record: the tapes and patterns of `problem::mechanical` in the core."""
    v, p, f, r, g, lam = model.v, model.p, model.f, model.r, model.g, model.lam
    n, linear, own = s.y.numel(), model.linear, model.nonholonomic
    w = total_derivative(g, s, v)
    jac = _blocks(s, model)
    k_z, rn_nu = jacobian(own.k, s.z), jacobian(own.rn, own.nu)
    masses = [jac[x].part.values for x in ("p_z", "v_z") if x in jac]
    is_linear = not (
        any(ca.depends_on(x, s.z) for x in (*masses, entries(k_z)))
        or ca.depends_on(jac["r_lam"].part.values, lam)
        or ca.depends_on(entries(rn_nu), own.nu)
    )
    velocity = [v] if "v_z" in jac else []
    at_stage, at_node = s.inputs(z=s.z), s.inputs(lam=lam)
    momentum = linear.terms(0, mass=(2, 1.0))

    def force(first: int) -> list[Term]:
        return linear.terms(first, damping=(2, -1.0), stiffness=(1, -1.0))

    def blocks(name: str, inputs: dict[str, ca.SX], *wanted: str) -> _core.Tape:
        return record_blocks(name, inputs, [jac[key] for key in wanted if key in jac])

    tapes = {
        "stage": _add(record("stage", at_stage, p, f, *velocity), [*momentum, *force(n)]),
        "stage_blocks": blocks("stage_blocks", at_stage, "p_z", "v_z"),
        "stage_jacobian": blocks("stage_jacobian", at_stage, "p_y", "f_y", "f_z", "v_y"),
        "node": record("node", at_node, g, r),
        "node_blocks": blocks("node_blocks", at_node, "g_y", "r_lam"),
        "node_jacobian": blocks("node_jacobian", at_node, "r_y"),
        "end": _add(record("end", at_stage, p, w, *velocity), momentum),
        "acceleration": _add(
            record(
                "acceleration",
                at_stage,
                f - total_derivative(p, s, v),
                *(total_derivative(x, s, v) for x in (w, own.k, *velocity)),
            ),
            force(0),
        ),
    }
    if own.k.numel():
        more_tapes, more = _nonholonomic(s, own, k_z, rn_nu, w)
        tapes, jac = tapes | more_tapes, jac | more
    left_out: list[int] = []
    if model.redundant:
        jac["reactions"] = Block(model.redundant.reactions)
        tapes["reactions"] = blocks("reactions", at_stage, "reactions")
        left_out = [*model.redundant.left_out]
    patterns = {name: block.pattern for name, block in jac.items()}
    problem = _core.Mechanical(n, g.numel(), is_linear, tapes, patterns, left_out)
    return tapes, patterns, problem


def _blocks(s: Symbols, model: Model) -> dict[str, Block]:
    """Differentiate a model without nonholonomic constraints, each function once."""
    linear, r = model.linear, model.r
    p_z, p_y, f_y, f_z = _slopes(s, model)
    slopes = Block(jacobian(model.g, s.y) if model.g_y is None else model.g_y)
    own = {"v_z": Block(jacobian(model.v, s.z))} if differ(model.v, s.z) else {}
    return {
        "p_z": Block(p_z, linear.mass),
        **own,
        "p_y": Block(p_y),
        "f_y": Block(f_y, linear.stiffness, -1.0),
        "f_z": Block(f_z, linear.damping, -1.0),
        "v_y": Block(jacobian(model.v, s.y)),
        "g_y": slopes,
        "r_lam": slopes.minus_transposed() if model.is_ideal else Block(jacobian(r, model.lam)),
        "r_y": Block(jacobian(r, s.y)),
    }


def _slopes(s: Symbols, model: Model) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Differentiate p and f by z and y: p_z, p_y, f_y and f_z.

    Of a Lagrangian L_zz and L_yy are symmetric, and L_yz is the transpose of L_zy.
    """
    p_z, p_y = jacobian(model.p, s.z), jacobian(model.p, s.y)
    if model.force is None:
        return p_z, p_y, jacobian(model.f, s.y), jacobian(model.f, s.z)
    own, rest = model.force
    symmetric = ca.triu2symm(ca.triu(jacobian(own, s.y)))
    f_y, f_z = symmetric + jacobian(rest, s.y), p_y.T + jacobian(rest, s.z)
    return ca.triu2symm(ca.triu(p_z)), p_y, f_y, f_z


def _nonholonomic(
    s: Symbols, own: Nonholonomic, k_z: ca.SX, rn_nu: ca.SX, w: ca.SX
) -> tuple[dict[str, _core.Tape], dict[str, Block]]:
    """Record the tapes of `problem::mechanical::Nonholonomic` in the core."""
    blocks = {
        "k_y": Block(jacobian(own.k, s.y)),
        "k_z": Block(k_z),
        "rn_y": Block(jacobian(own.rn, s.y)),
        "rn_z": Block(jacobian(own.rn, s.z)),
        "rn_nu": Block(rn_nu),
    }
    w_y = Block(jacobian(w, s.y))
    inputs = s.inputs(z=s.z, nu=own.nu)
    tapes = {
        "nonholonomic": record("nonholonomic", inputs, own.k, own.rn),
        "nonholonomic_blocks": record_blocks("nonholonomic_blocks", inputs, list(blocks.values())),
        "nonholonomic_hidden": record_blocks("nonholonomic_hidden", s.inputs(z=s.z), [w_y]),
    }
    return tapes, {**blocks, "w_y": w_y}


def second_order(
    s: Symbols, model: Model, power: ca.SX | None
) -> tuple[dict[str, _core.Tape], dict[str, Pattern], bool]:
    """Record M(t, y) z' = F(t, y, z) + r and 0 = g, 0 = w, with u and a in the place of z'.

    Returns the tapes and patterns of `problem::second_order` in the core, and whether the power of
    forces without potential depends on the multipliers.
    """
    mass = jacobian(model.p, s.z)
    _check_second_order(s, model, mass)
    n, linear = s.y.numel(), model.linear
    u, a = ca.SX.sym("u", n), ca.SX.sym("a", n)
    residual = model.f - total_derivative(model.p, s, s.z) - ca.mtimes(mass, u)
    reaction = ca.mtimes(mass, a) - model.r
    w = total_derivative(model.g, s, s.z)
    jac = {
        "mass": Block(mass, linear.mass),
        "j_y": Block(jacobian(residual, s.y), linear.stiffness, -1.0),
        "j_z": Block(jacobian(residual, s.z), linear.damping, -1.0),
        "w_y": Block(jacobian(w, s.y)),
        "n_y": Block(jacobian(reaction, s.y)),
    }
    at_end, at_node = s.inputs(z=s.z, u=u), s.inputs(a=a, lam=model.lam)
    tapes = {
        "residual": _add(
            record("residual", at_end, residual, model.g, w),
            linear.terms(0, mass=(3, -1.0), damping=(2, -1.0), stiffness=(1, -1.0)),
        ),
        "reaction": _add(record("reaction", at_node, reaction), linear.terms(0, mass=(2, 1.0))),
        "jacobian": record_blocks("jacobian", at_end, [jac[name] for name in jac if name != "n_y"]),
        "reaction_jacobian": record_blocks("reaction_jacobian", at_node, [jac["n_y"]]),
    }
    if power is None or power.is_zero():
        power = ca.SX(0)
    else:
        tapes["power"] = record("power", s.inputs(z=s.z, lam=model.lam), power)
    patterns = {name: block.pattern for name, block in jac.items()}
    return tapes, patterns, ca.depends_on(power, model.lam)


def is_separable(s: Symbols, model: Model) -> bool:
    """Return whether p and v are linear in z with constant factors, f is f(t, y) and r is ideal."""
    p, v, held = model.p, model.v, ca.vertcat(s.t, s.y)
    blocks = ca.vertcat(entries(jacobian(p, s.z)), entries(jacobian(v, s.z)))
    return (
        model.is_ideal
        and not model.nonholonomic.k.numel()
        and model.linear.damping is None
        and not ca.depends_on(ca.vertcat(p, v), held)
        and not ca.depends_on(blocks, s.z)
        and not ca.depends_on(model.f, s.z)
    )


def separable(s: Symbols, model: Model) -> dict[str, _core.Tape]:
    """Record f(t, y), g(t, y) and its derivatives g_y and g_t by themselves."""
    at_y, g_y = s.inputs(), Block(jacobian(model.g, s.y))
    force = record("force", at_y, model.f)
    return {
        "force": _add(force, model.linear.terms(0, stiffness=(1, -1.0))),
        "constraint": record("constraint", at_y, model.g),
        "gradient": record("gradient", at_y, g_y.part, jacobian(model.g, s.t)),
    }


def _check_second_order(s: Symbols, model: Model, mass: ca.SX) -> None:
    """Refuse what is no second order equation for y with a mass M(t, y)."""
    if model.nonholonomic.k.numel():
        raise TypeError(
            hinted(
                "the system has nonholonomic constraints, and the method holds only holonomic ones",
                "take Spark",
            )
        )
    if differ(model.v, s.z):
        raise TypeError(
            hinted(
                "the velocity of this system is not its z itself, and the method steps velocities",
                "write the system as a Lagrangian, or take Spark",
            )
        )
    if ca.depends_on(entries(mass), s.z):
        raise TypeError(
            hinted(
                "the momentum of this system is not linear in its velocity, and the method wants "
                "a mass matrix M(t, q)",
                "take Spark",
            )
        )


def observing(tape: _core.Tape, widths: Mapping[str, int], linear: Linear) -> _core.Tape:
    """Add the linear part to an observer's momentum and energies."""
    starts = dict(zip(widths, np.cumsum([0, *widths.values()]).tolist(), strict=False))
    momentum, energy, kinetic = (starts.get(x) for x in ("p", "invariant energy", "kinetic"))
    forms = [] if kinetic is None else linear.terms(kinetic, mass=(2, 0.5))
    if energy is not None:
        forms += linear.terms(energy, mass=(2, 0.5), stiffness=(1, 0.5))
    return _add(
        tape,
        [] if momentum is None else linear.terms(momentum, mass=(2, 1.0)),
        forms,
    )


def _add(tape: _core.Tape, products: list[Term], forms: list[Term] | None = None) -> _core.Tape:
    if not (products or forms):
        return tape
    return tape.with_terms(np.empty(0), products, forms or [])


def record_blocks(name: str, inputs: dict[str, ca.SX], blocks: list[Block]) -> _core.Tape:
    """Record the entries of derivatives, one after another."""
    tape = record(name, inputs, *(block.part for block in blocks))
    constant = np.concatenate([np.empty(0), *(block.constant for block in blocks)])
    return tape.with_terms(constant, [], []) if constant.any() else tape


def differ(a: ca.SX, b: ca.SX) -> bool:
    """Return whether two expressions are written differently."""
    return not ca.is_equal(a, b, 1)


def kept_or_lost(s: Symbols, model: Model, power: ca.SX | None) -> tuple[bool, bool]:
    """Return whether nothing changes the energy, and if not, whether only forces of the state do.

    Constraints on velocities that are not kept at rest, as on a turntable, drive the motion.
    """
    if power is None:
        return False, False
    k = model.nonholonomic.k
    at_rest = ca.substitute(k, s.z, ca.SX.zeros(s.z.numel(), 1))
    if not at_rest.is_zero() or ca.depends_on(k, s.t):
        return False, False
    if power.is_zero() and model.linear.damping is None:
        return True, False
    return False, not ca.depends_on(power, ca.vertcat(s.t, model.lam))


def total_derivative(x: ca.SX, s: Symbols, v: ca.SX) -> ca.SX:
    """x_t + x_y v."""
    return ca.jtimes(x, ca.vertcat(s.t, s.y), ca.vertcat(1, v))
