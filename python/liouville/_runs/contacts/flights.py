"""Flights that are short, or so low that roundoff of the gap hides them.

These are closed at once. The force of the mode that begins is then that of the hits which are left
out, as far as a gap is known: what a contact bears less, as it flies, its rate takes.
"""

from __future__ import annotations

from collections.abc import MutableMapping
from typing import TYPE_CHECKING

import numpy as np

from liouville._basics.errors import IntegrationError
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.matrices import CLOSED, EPS, Matrices, of_contacts
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._runs.contacts.switching import Switching

#: A contact that bounces closes where its next flight is as low as so many roundings of the gap.
LOW = 64
#: Rates of accelerations are those over this part of a step ahead.
NEAR = 1e-3
#: Friction holds that is below its bound by more than this part.
HOLDS = 1e-9

#: When bounces that have died down end, by contact.
Closing = MutableMapping[int, float | None]


def restitution(now: Switching, at: Matrices, touching: Array, closing: Closing) -> Array:
    """Return the restitutions of an impact: none where the flight after it would be low."""
    found = at.laws.restitution.copy()
    rates = -found * at.rate
    near = touching & (rates > 0) & (rates**2 < _low_square(at, np.abs(at.b[: now.c])))
    if not near.any():
        return found
    held = touching & (np.abs(at.rate) <= at.still)
    falls = -now.forces(at, held, 0 * at.slip).across
    for k in np.flatnonzero(near):
        if falls[k] > 0 and found[k] < 1:
            closing[int(k)] = float(now.t + 2 * rates[k] / falls[k] / (1 - found[k]))
        found[k] = 0.0
    return found


def _low_square(at: Matrices, falls: Array) -> Array:
    """Return the squares of the rates whose flights are low."""
    return 2 * falls * LOW * EPS * at.size


def closed(
    now: Switching, at: Matrices, rising: Array, stopped: set[int], closing: Closing
) -> Array | None:
    """Return the rows that hold when a contact is closed that rises and would fly low, if one is.

    The forces of the others were found last, and `stopped` are the contacts whose slip has stopped.
    """
    forces, others, _ = now.found
    for k in np.flatnonzero(rising):
        fall = forces.across[k]
        if fall >= 0 or at.rate[k] ** 2 >= _low_square(at, -fall)[k]:
            continue
        closing.setdefault(int(k), None)
        has_hit = bool(now.changes[k]) and now.changes[k][-1].t == now.t
        restitution = at.laws.restitution[k]
        if has_hit and closing[int(k)] is None and 0 < restitution < 1:
            closing[int(k)] = float(now.t - 2 * at.rate[k] / fall / (1 - restitution))
        own = others | (np.arange(now.c) == k)
        slip = now.ways(at, own, stopped)
        try:
            found = now.forces(at, own, slip)
        except IntegrationError:  # friction jams with it: it flies, and a hit may stop the slips
            continue
        most = (1 - HOLDS) * at.laws.static * found.normal
        sticks = own & (of_contacts(slip, at.owner) == 0)
        sticks &= of_contacts(found.friction, at.owner) < most
        bears = (found.normal > 0) & ~at.is_pressed
        bears[k] = True
        rows: Array = np.flatnonzero(np.concatenate([bears, sticks[at.owner]]))
        return rows
    return None


def held(at: Matrices, z: Array, rows: Array) -> Array:
    """Return z with rates of gaps and slips brought to zero, by the least change."""
    rates = np.concatenate([at.rate, at.slip])[rows]
    x = np.linalg.lstsq(at.A[np.ix_(rows, rows)], rates, rcond=None)[0]
    after: Array = z - at.moves[:, rows] @ x
    return after


def shortest(now: Switching, y: Array, z: Array) -> float:
    """Return how long the contacts that open now stay open at least, as far as can be said.

    What leaves with a rate falls back by its acceleration, what leaves by an acceleration by the
    rate of this.
    """
    at = now.at(now.t, y, z)
    is_open = np.array([mode is Mode.OPEN for mode in now.modes])
    low = is_open & (at.gap <= CLOSED * at.size)
    thrown, lifted = low & (at.rate > 0) & (now.lifts < 0), low & (now.lifts > 0)
    lifted &= np.abs(at.rate) <= at.still
    times = [2 * at.rate[k] / -now.lifts[k] for k in np.flatnonzero(thrown)]
    if lifted.any():
        try:
            _, later = now.ahead(at, y, z, NEAR)
        except IntegrationError:  # of a place that is never come to
            return min(times, default=np.inf)
        jerks = (later.across - now.lifts) / (NEAR * now.h)
        times += [3 * now.lifts[k] / -jerks[k] for k in np.flatnonzero(lifted & (jerks < 0))]
    return min(times, default=np.inf)
