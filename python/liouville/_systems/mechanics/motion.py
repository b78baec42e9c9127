"""Tapes of quantities of a motion, recorded at their first use.

They stay with the system: a system that was pickled after that needs no CasADi for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.mechanics.form import record_blocks, total_derivative
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.linear import Block, Pattern
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._systems.fields.field import Field
    from liouville._systems.mechanics.general import Mechanics
    from liouville._systems.mechanics.semi_explicit import SemiExplicit
    from liouville._systems.waves.sensitivity import DriveSensitivity

T = TypeVar("T")

#: A tape of derivatives, and the pattern of each of them.
Slopes = tuple[_core.Tape, dict[str, Pattern]]


def linearized(system: Mechanics) -> Slopes:
    r"""Record the derivatives of the equations of motion at (t, y, z, z', lam, nu).

    With the residual :math:`R = p_z z' + p_y v + p_t - f - r - r_n`, the constraints on z,
    :math:`c = (w, k)`, and their rate :math:`\dot c`: ``r_y``, ``r_z``, ``c_y``, ``m_y`` and
    ``m_z`` are :math:`R_y, R_z, c_y, \dot c_y, \dot c_z`.
    """
    return kept(system, "linearized", lambda: _linearized(system))


def power(system: Mechanics) -> _core.Tape:
    r"""Record powers at (t, y, z, lam, nu): of forces, of constraints and of a damping matrix.

    They are :math:`Q^T v + E_t`, :math:`\lambda^T g_t + r_n^T v + \nu^T k`, which is zero for rows
    k homogeneous in v wherever they are evaluated, and :math:`-v^T C v`.

    Raises
    ------
    TypeError
        The energy of the system is not known.
    """
    return kept(system, "power", lambda: _power(system))


def energies(system: Mechanics) -> _core.Tape:
    """Record the energy and the kinetic energy at (t, y, z), and powers that may be damping.

    Of a system whose forces may take from the energy they are those of its forces and its damping
    matrix, with the velocities there and with opposite ones.
    """
    return kept(system, "energies", lambda: _energies(system))


def rows_of(system: Mechanics, which: tuple[int, ...]) -> _core.Tape:
    """Record some of the constraints, by their numbers, at (t, y, z)."""
    s, model = system.symbols, system.model

    def recorded() -> _core.Tape:
        rows = ca.vertcat(model.g, model.nonholonomic.k)
        return record("left out", s.inputs(z=s.z), rows[list(which)])

    return kept(system, f"rows {which}", recorded)


def rates(system: Mechanics, functions: Mapping[str, Callable[..., Any]]) -> Slopes:
    """Record the derivatives of rates by z at (t, y, z), a row ``rates`` for each function.

    Raises
    ------
    TypeError, ValueError
        A function returns no expression, or one that does not depend on z or not linearly.
    """
    s, found = system.symbols, []
    for name, function in functions.items():
        what = f"actuator '{name}'"
        row = jacobian(_trace.scalar(what, function, s.args), s.z)
        if row.is_zero() or ca.depends_on(row, s.z):
            partner = system.states[1]
            sentence = f"{what} is no rate: it is not linear in {partner}, or does not depend on it"
            hint = f"return the rate that the effort works on, such as {partner}[0]"
            raise ValueError(hinted(sentence, hint))
        found.append(row)
    block = Block(ca.vertcat(ca.SX(0, s.z.numel()), *found))
    return record_blocks("rates", s.inputs(z=s.z), [block]), {"rates": block.pattern}


def kept(
    system: Mechanics | SemiExplicit | Field | DriveSensitivity, name: str, make: Callable[[], T]
) -> T:
    """Return an object that a system keeps by its name, made when it is first wanted."""
    if name not in system._recorded:
        system._recorded[name] = make()
    found: T = system._recorded[name]
    return found


def equations(system: Mechanics) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    r"""Return symbols of z', the residual R, the constraints c on z, and their rate."""
    s, model = system.symbols, system.model
    own, u = model.nonholonomic, ca.SX.sym("u", s.z.numel())

    def along(x: ca.SX) -> ca.SX:
        return total_derivative(x, s, model.v) + ca.jtimes(x, s.z, u)

    residual = along(model.p) - model.f - model.r
    if own.nu.numel():
        residual -= own.rn
    held = ca.vertcat(total_derivative(model.g, s, model.v), own.k)
    return u, residual, held, along(held)


def _linearized(system: Mechanics) -> Slopes:
    s, model = system.symbols, system.model
    u, residual, held, moved = equations(system)
    linear = model.linear
    blocks = {
        "r_y": Block(jacobian(residual, s.y), linear.stiffness),
        "r_z": Block(jacobian(residual, s.z), linear.damping),
        "c_y": Block(jacobian(held, s.y)),
        "m_y": Block(jacobian(moved, s.y)),
        "m_z": Block(jacobian(moved, s.z)),
    }
    own = model.nonholonomic
    tape = record_blocks(
        "linearized", s.inputs(z=s.z, u=u, lam=model.lam, nu=own.nu), [*blocks.values()]
    )
    return tape, {name: block.pattern for name, block in blocks.items()}


def _energies(system: Mechanics) -> _core.Tape:
    s, model, linear = system.symbols, system.model, system.model.linear
    columns = system.expressions.columns
    parts = [columns["invariant energy"], ca.dot(model.p, model.v) / 2]
    forms = linear.terms(0, mass=(2, 0.5), stiffness=(1, 0.5)) + linear.terms(1, mass=(2, 0.5))
    if system.may_only_lose:
        parts += [columns["power"], ca.substitute(columns["power"], s.z, -s.z)]
        forms += linear.terms(2, damping=(2, -1.0)) + linear.terms(3, damping=(2, -1.0))
    tape = record("energies", s.inputs(z=s.z), *parts)
    return tape.with_terms(np.empty(0), [], forms) if forms else tape


def _power(system: Mechanics) -> _core.Tape:
    s, columns = system.symbols, system.expressions.columns
    if "power" not in columns:
        sentence = f"the energy of a {type(system).__name__} system is not known to the library"
        raise TypeError(hinted(sentence, "write it as a Lagrangian, Hamiltonian or Structure"))
    total, model = columns["power"], system.model
    own, moving = model.nonholonomic, ca.jtimes(total, model.lam, model.lam)
    if own.nu.numel():
        moving += ca.dot(own.rn, model.v) + ca.dot(own.nu, own.k)
    forces = ca.substitute(total, model.lam, ca.SX.zeros(model.lam.numel(), 1))
    inputs = s.inputs(z=s.z, lam=model.lam, nu=own.nu)
    forms = system._linear.terms(2, damping=(2, -1.0))
    tape = record("power", inputs, forces, moving, ca.SX(0))
    return tape.with_terms(np.empty(0), [], forms) if forms else tape
