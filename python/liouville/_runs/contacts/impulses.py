r"""Impulses of an impact whose contacts keep their roles, as smooth functions of the state.

In the laws of impact each contact that takes part presses or not, and sticks or slips in each
phase. Near an impact roles are the same, so impulses solve equations: those of rates that are zero,
with friction along the slip. In the plane its direction is known and they are linear; in space it
is against the slip at the end of the phase, which Newton's method finds. Where a contact is at the
edge of its role the impulses have no derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.law import Forces
from liouville._runs.contacts.matrices import of_contacts

#: An impulse is none below this part of the largest, friction at its bound within it, and a rate
#: none below this part of the largest before.
EDGE = 1e-6
#: Directions of slips are found to this angle, by so many steps at most.
TURNED, MOST_STEPS = 1e-15, 30


@dataclass(frozen=True)
class Roles:
    """The roles of contacts in a phase of an impact.

    Attributes
    ----------
    presses, sticks : ndarray of bool, shape (c,)
        Those with an impulse of the phase itself, and those whose slip it brings to rest.
    ways : ndarray, shape (s,)
        The directions of the friction of those that slip, signs in the plane, else 0.
    """

    presses: Array
    sticks: Array
    ways: Array


def roles(
    found: Forces, rates: Array, mu: Array, restitution: Array, owner: Array
) -> tuple[Roles, ...] | None:
    """Return the roles in each phase; None where one is at an edge, and so without derivative."""
    each, borne = [], 0 * mu
    fast = EDGE * np.abs(rates).max()
    for phase in found.phases:
        strong = EDGE * phase.normal.max(initial=0.0)
        presses = phase.normal - borne > strong
        size, speed = (of_contacts(x, owner) for x in (phase.friction, phase.along))
        most = mu * phase.normal
        bears = most > EDGE * most.max(initial=0.0)
        slides = bears & (size >= (1 - EDGE) * most)
        if (slides & (speed <= fast)).any():
            return None
        sizes = np.where(slides, size, np.inf)[owner]
        each.append(Roles(presses, bears & ~slides, phase.friction / sizes))
        borne = restitution * phase.normal
    return tuple(each)


def impulses(
    A: Array,
    before: Array,
    each: Sequence[Roles],
    laws: tuple[Array, Array],
    owner: Array,
    law: str,
) -> Array:
    """Return impulses (N, T) of an impact in these roles; `laws` are friction and restitution."""
    mu, restitution = laws
    c = len(mu)
    if law == "newton":
        before = before.copy()
        before[:c] += restitution * np.minimum(before[:c], 0.0)
    total, borne = np.zeros(len(before)), np.zeros(c)
    for own in each:
        phase = _phase(A, before + A @ total, own, (mu, borne), owner)
        total, borne = total + phase, restitution * phase[:c]
    return total


def _phase(A: Array, b: Array, own: Roles, laws: tuple[Array, Array], owner: Array) -> Array:
    """Return the impulses of a phase, from rates b before it."""
    (mu, borne), c, ways = laws, len(laws[0]), own.ways.copy()
    spatial = np.bincount(owner, ways**2, c) * (np.bincount(owner, minlength=c) > 1) > 0
    turning = [np.flatnonzero(owner == k) for k in np.flatnonzero(spatial)]
    free = np.flatnonzero(np.concatenate([own.presses, own.sticks[owner]]))
    x = np.zeros(len(b))
    for count in range(MOST_STEPS):
        acts = np.eye(len(b))
        acts[c + np.arange(len(owner)), owner] = ways * mu[owner]
        held = acts[:, :c] @ borne
        columns, rows = acts[:, free], np.eye(len(b))[free]
        if not count or not turning:
            x = held + columns @ _solved(rows @ A @ columns, rows @ (A @ held + b))
            if not turning:
                break
            continue
        # friction turns with the slip across it
        across = np.zeros((len(turning), len(b)))
        for row, (first, second) in zip(across, turning, strict=True):
            row[[c + first, c + second]] = -ways[second], ways[first]
        normal = np.array([mu[owner[i]] * x[owner[i]] for i, _ in turning])
        columns = np.hstack([columns, across.T * normal])
        rows, rates = np.vstack([rows, across]), A @ x + b
        matrix = rows @ A @ columns
        last = np.arange(len(free), len(matrix))
        matrix[last, last] -= [rates[c + i] @ ways[i] for i in turning]
        solved = _solved(matrix, rows @ (A @ held + b))
        x = held + columns @ solved
        for angle, i in zip(solved[last], turning, strict=True):
            turned = ways[i] + angle * np.array([-ways[i[1]], ways[i[0]]])
            ways[i] = turned / np.linalg.norm(turned)
        if np.abs(solved[last]).max() <= TURNED:
            break
    return x


def _solved(matrix: Array, rest: Array) -> Array:
    found: Array = np.linalg.lstsq(matrix, -rest, rcond=None)[0]
    return found
