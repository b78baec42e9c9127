r"""Friction that slides in space, as a force: N is that of the accelerations.

The reaction of a contact in the plane has the friction of its slip. In space friction turns with
the slip, :math:`T = -\mu N s / |s|`, and N as a function of time and state solves the equations of
the accelerations, linear in the forces of all that is closed, sticks or is held.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from liouville._basics import casadi as ca
from liouville._systems.mechanics.contact import Mode
from liouville._systems.mechanics.form import total_derivative
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from collections.abc import Sequence

    from liouville._runs.contacts.traced import Contacts


#: Friction forces by slip, and the rates of slips in space by contact.
Known = tuple[dict[int, ca.SX], dict[int, ca.SX]]


def frictions(
    contacts: Contacts, modes: Sequence[Mode], gaps: Sequence[int], sticks: Sequence[int]
) -> Known:
    """Return the friction of loads that slip and of what slides in space, and how this slows down.

    `gaps` and `sticks` are the contacts and the slips that the mode holds at zero.
    """
    its, found = contacts.columns, {}
    ways = {}
    for k, mode in enumerate(modes):
        own = contacts.slips_of(k)
        if mode is Mode.SLIDE:
            slip = its["slips"][own]
            ways[k] = -its["friction"][k] * slip / ca.norm_2(slip)
        elif mode.sign:
            ways[k] = -its["friction"][k] * mode.sign
    for k, way in ways.items():
        if not contacts.has_gap(k):
            for place, row in enumerate(contacts.slips_of(k)):
                found[row] = way[place] * its["load"][k]
    sliding = [k for k in ways if modes[k] is Mode.SLIDE]
    if not sliding:
        return found, {}
    normals, z_dot = _accelerated(contacts, ways, (gaps, sticks), found)
    s, v, rates = contacts.system.symbols, contacts.system.model.v, {}
    for k in sliding:
        own = contacts.slips_of(k)
        slip = its["slips"][own]
        rates[k] = jacobian(slip, s.z) @ z_dot + total_derivative(slip, s, v)
        if contacts.has_gap(k):
            for place, row in enumerate(own):
                found[row] = ways[k][place] * normals[gaps.index(k)]
    return found, rates


def _accelerated(
    contacts: Contacts,
    ways: dict[int, ca.SX],
    held: tuple[Sequence[int], Sequence[int]],
    known: dict[int, ca.SX],
) -> tuple[ca.SX, ca.SX]:
    """Return normal forces of the gaps that are held first, and z', by time and state."""
    system, its, (gaps, sticks) = contacts.system, contacts.columns, held
    s, model = system.symbols, system.model
    own = model.nonholonomic
    f = model.f - total_derivative(model.p, s, model.v)
    for row, force in known.items():
        f += its["along"][row, :].T * force
    forces = []
    for k in gaps:
        force = its["across"][k, :].T
        if k in ways:
            for place, row in enumerate(contacts.slips_of(k)):
                force += its["along"][row, :].T * ways[k][place]
        forces.append(force)
    forces += [its["along"][row, :].T for row in sticks]
    forces += [jacobian(model.r, model.lam), jacobian(own.rn, own.nu)]
    held_ones = [its["rates"][k] for k in gaps] + [its["slips"][row] for row in sticks]
    rates = ca.vertcat(ca.SX(0, 1), *held_ones, total_derivative(model.g, s, model.v), own.k)
    moves = ca.solve(jacobian(model.p, s.z), ca.densify(ca.horzcat(*forces, f)))
    seen = jacobian(rates, s.z) @ moves
    rest = seen[:, -1] + total_derivative(rates, s, model.v)
    if not rates.numel():
        return ca.SX(0, 1), moves[:, -1]
    found = ca.solve(ca.densify(seen[:, :-1]), -ca.densify(rest))
    return found, moves[:, :-1] @ found + moves[:, -1]
