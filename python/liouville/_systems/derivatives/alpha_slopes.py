"""Derivatives of a step of the alpha family, by the expressions of its equations.

A step goes from (t0, y0, z0, a0, phi0) over h; u are its unknowns phi1, A0, A1 and the multipliers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.job import AlphaSlopes, AlphaTransposed
from liouville._systems.mechanics.form import record_blocks, total_derivative
from liouville._systems.mechanics.motion import kept
from liouville._systems.tape import record
from liouville._systems.tracing.linear import Block, Linear
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._systems.mechanics.general import Mechanics


def alpha_slopes(system: Mechanics, method: Any) -> AlphaSlopes:
    """Record the tapes of `AlphaSlopes` in the core, for a method of the alpha family.

    Raises
    ------
    TypeError
        The system has matrices of its own, which are not among the expressions.
    """
    if system.model.linear != Linear():
        sentence = "tangents by the alpha family must be those of expressions, not of matrices"
        raise TypeError(hinted(sentence, "take Spark"))
    return kept(system, f"slopes of {method!r}", lambda: _alpha_slopes(system, method))


def alpha_transposed(system: Mechanics, method: Any) -> AlphaTransposed:
    """Record the tapes of `AlphaTransposed` in the core beside those of :func:`alpha_slopes`."""
    slopes = alpha_slopes(system, method)
    more = kept(system, f"transposed {method!r}", lambda: _transposed(system, method))
    return slopes, *more


def _transposed(system: Mechanics, method: Any) -> tuple[_core.Tape, _core.Tape, _core.Tape]:
    s, n = system.symbols, system.symbols.y.numel()
    h, scale = ca.SX.sym("h"), ca.SX.sym("scale")
    a, phi = ca.SX.sym("a", n), ca.SX.sym("phi", n)
    unknowns, end, equations = _step(system, method, (h, scale, a, phi))
    inputs = {"t": s.t, "h": h, "y": s.y, "z": s.z, "a": a, "phi": phi, "u": unknowns}
    params = s.params.vector
    x = ca.vertcat(s.t, h, s.y, s.z, a, phi, params)
    v, w = ca.SX.sym("v", equations.numel()), ca.SX.sym("w", end.numel())
    by_unknowns = ca.jtimes(end, unknowns, w, True)
    both = ca.jtimes(end, x, w, True)
    both -= ca.substitute(ca.jtimes(equations, x, v, True), scale, h)
    mass, forces = _second_order(system)
    at, c = ca.vertcat(s.t, s.y, s.z, params), ca.SX.sym("c", n)
    start = ca.jtimes(forces - ca.mtimes(mass, phi), at, c, True)
    point = {"t": s.t, "y": s.y, "z": s.z, "phi": phi, "c": c, "params": params}
    return (
        record("cotangents of unknowns", {**inputs, "w": w, "params": params},
               ca.densify(by_unknowns)),
        record("cotangents of a step", {**inputs, "v": v, "w": w, "params": params},
               ca.densify(both)),
        record("cotangents of its start", point, ca.densify(start)),
    )  # fmt: skip


def _alpha_slopes(system: Mechanics, method: Any) -> AlphaSlopes:
    s, n = system.symbols, system.symbols.y.numel()
    h, scale = ca.SX.sym("h"), ca.SX.sym("scale")
    a, phi = ca.SX.sym("a", n), ca.SX.sym("phi", n)
    unknowns, end, equations = _step(system, method, (h, scale, a, phi))
    inputs = {"t": s.t, "h": h, "y": s.y, "z": s.z, "a": a, "phi": phi, "u": unknowns}
    x = ca.vertcat(s.t, h, s.y, s.z, a, phi, s.params.vector)
    dx, du = ca.SX.sym("dx", x.numel()), ca.SX.sym("du", unknowns.numel())
    params = s.params.vector
    block = Block(ca.substitute(jacobian(equations, unknowns), scale, h))
    # constraints are in the unit of h, which is held
    along = ca.substitute(ca.jtimes(equations, x, dx), scale, h)
    both = ca.jtimes(end, x, dx) + ca.jtimes(end, unknowns, du)
    mass, forces = _second_order(system)
    at = ca.vertcat(s.t, s.y, s.z, params)
    moved = ca.SX.sym("dx", at.numel())
    start = ca.jtimes(forces - ca.mtimes(mass, phi), at, moved)
    point = {"t": s.t, "y": s.y, "z": s.z, "phi": phi, "dx": moved, "params": params}
    return (
        record_blocks("matrix of a step", {**inputs, "params": params}, [block]),
        block.pattern,
        record("tangents of a step", {**inputs, "dx": dx, "params": params}, ca.densify(along)),
        record(
            "tangents of its end", {**inputs, "dx": dx, "du": du, "params": params},
            ca.densify(both),
        ),
        record("tangents of its start", point, ca.densify(start)),
    )  # fmt: skip


def _second_order(system: Mechanics) -> tuple[ca.SX, ca.SX]:
    """Return M and F of M z' = F + r."""
    s, model = system.symbols, system.model
    return jacobian(model.p, s.z), model.f - total_derivative(model.p, s, s.z)


def _step(
    system: Mechanics, method: Any, symbols: tuple[ca.SX, ca.SX, ca.SX, ca.SX]
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the unknowns of a step, its end (y1, z1, a1), and its equations."""
    s, model = system.symbols, system.model
    n, m = s.y.numel(), model.lam.numel()
    alpha_m, alpha_f, gamma, beta = method.coefficients
    h, scale, a0, phi0 = symbols
    has_pair = method.reaction != "position" and m > 0
    phi1, lam1 = ca.SX.sym("phi1", n), ca.SX.sym("lam1", m)
    first, last, lam0 = ca.SX.sym("A0", n), ca.SX.sym("A1", n), ca.SX.sym("lam0", m)
    a1 = ((1 - alpha_f) * phi1 + alpha_f * phi0 - alpha_m * a0) / (1 - alpha_m)
    y1 = s.y + h * s.z + h**2 * ((0.5 - beta) * a0 + beta * a1)
    z1 = s.z + h * ((1 - gamma) * a0 + gamma * a1)
    if has_pair:
        y1 += h**2 / 2 * ((1 - method.b) * first + method.b * last)
        z1 += h / 2 * (first + last)
    here, there = ca.vertcat(s.t, s.y, s.z), ca.vertcat(s.t + h, y1, z1)

    def at(x: ca.SX, point: ca.SX, lam: ca.SX) -> ca.SX:
        return ca.substitute(x, ca.vertcat(here, model.lam), ca.vertcat(point, lam))

    mass, forces = _second_order(system)
    of_end = at(ca.horzcat(mass, forces), there, lam1)
    balance = ca.mtimes(of_end[:, :n], phi1) - of_end[:, n]
    hidden = total_derivative(model.g, s, s.z)
    held = at(model.g, there, lam1) / scale**2
    if not has_pair:
        if m:
            balance -= at(model.r, there, lam1)
        return ca.vertcat(phi1, lam1), ca.vertcat(y1, z1, a1), ca.vertcat(balance, held)
    is_predicted = method.reaction == "predicted"
    where = ca.vertcat(s.t + h, s.y + h * s.z, s.z) if is_predicted else there
    pulls = []
    for point, acceleration, lam in ((here, first, lam0), (where, last, lam1)):
        own = at(ca.horzcat(mass, model.r), point, lam)
        pulls.append(ca.mtimes(own[:, :n], acceleration) - own[:, n])
    unknowns = ca.vertcat(phi1, first, last, lam0, lam1)
    rows = [balance, *pulls, held, at(hidden, there, lam1) / scale]
    return unknowns, ca.vertcat(y1, z1, a1), ca.vertcat(*rows)
