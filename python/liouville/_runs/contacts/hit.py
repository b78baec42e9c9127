r"""Hits of single contacts with friction in closed form, for the core.

With :math:`A = \begin{pmatrix} a & b \\ c & d \end{pmatrix}` of a contact that alone touches, and
:math:`a > \mu_s |b|`, the impulses of a hit follow from its rates :math:`(\dot\varphi, s)` without
a choice: what would stop both, with T held within :math:`\mu_s N`, and then by Poisson's law those
of the expansion, with :math:`e N` and another T.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from liouville._basics import casadi as ca
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._runs.contacts.traced import Contacts

TINY = 1e-300
#: Normal force and friction act alike, and leave no choice, where det A is below this part of a d.
ALIKE = 1e-9
#: The largest number of coordinates and multipliers whose equations are solved in symbols.
MOST = 16


def has_closed_form(contacts: Contacts) -> bool:
    """Whether hits of contacts with friction are written down."""
    model, s = contacts.system.model, contacts.system.symbols
    return s.y.numel() + model.lam.numel() + model.nonholonomic.nu.numel() <= MOST


def response(contacts: Contacts, k: int) -> tuple[ca.SX, ca.SX]:
    """Return A of a contact, of shape (2, 2), and how its impulses change z but for constraints."""
    system, columns = contacts.system, contacts.columns
    s, model = system.symbols, system.model
    own = model.nonholonomic
    rates = ca.vertcat(columns["rates"][k], columns["slips"][k])
    forces = ca.horzcat(columns["across"][k, :].T, columns["along"][k, :].T)
    moves = ca.solve(jacobian(model.p, s.z), forces)
    seen = jacobian(rates, s.z)
    reactions = ca.horzcat(jacobian(model.r, model.lam), jacobian(own.rn, own.nu))
    if not reactions.numel():
        return ca.densify(seen @ moves), moves
    bilateral = ca.vertcat(jacobian(jacobian(model.g, s.y) @ model.v, s.z), jacobian(own.k, s.z))
    back = ca.solve(jacobian(model.p, s.z), reactions)
    held = moves - back @ ca.solve(bilateral @ back, bilateral @ moves)
    return ca.densify(seen @ held), moves


def margin(contacts: Contacts, k: int) -> ca.SX:
    """Return a number above zero where a hit has one outcome, which A tells."""
    A, _ = response(contacts, k)
    least = A[0, 0] - contacts.columns["static"][k] * ca.fabs(A[0, 1])
    both = A[0, 0] * A[1, 1]
    return ca.fmin(least, both - A[0, 1] * A[1, 0] - ALIKE * both)


def struck(contacts: Contacts, k: int) -> ca.SX:
    """Return z behind a hit, not yet on the constraints."""
    columns, (A, moves) = contacts.columns, response(contacts, k)
    e, mu = columns["restitution"][k], columns["static"][k]
    rate, slip = columns["rates"][k], columns["slips"][k]
    if contacts.law == "newton":
        rate = (1 + e) * rate
    a, b, c, d = A[0, 0], A[0, 1], A[1, 0], A[1, 1]
    det = ca.fmax(a * d - b * c, TINY)
    stops = (b * slip - d * rate) / det, (c * rate - a * slip) / det
    sign = ca.sign(stops[1])
    sliding = -rate / (a + sign * mu * b)
    sticks = ca.fabs(stops[1]) <= mu * stops[0]
    normal = ca.if_else(sticks, stops[0], sliding)
    friction = ca.if_else(sticks, stops[1], sign * mu * sliding)
    if contacts.law != "newton":
        left, most = slip + c * normal + d * friction, mu * e * normal
        friction += ca.fmax(-most, ca.fmin(most, -(left + c * e * normal) / ca.fmax(d, TINY)))
        normal *= 1 + e
    z: ca.SX = contacts.system.symbols.z
    return z + moves @ ca.vertcat(normal, friction)
