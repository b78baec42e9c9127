"""Impulses of an impact as smooth functions, with what each contact does in it held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.law import Forces

#: An impulse is none below this part of the largest, friction at its bound within it, and a rate
#: none below this part of the largest before.
EDGE = 1e-6


@dataclass(frozen=True)
class Roles:
    """The roles of contacts in a phase of an impact: c flags each.

    Attributes
    ----------
    presses, sticks : ndarray of bool
        Those with an impulse of the phase itself, and those whose slip it brings to rest.
    slips : ndarray
        The signs of the friction of those that slip, else 0.
    """

    presses: Array
    sticks: Array
    slips: Array


def roles(found: Forces, rates: Array, mu: Array, restitution: Array) -> tuple[Roles, ...] | None:
    """Return the roles in each phase; None where one is at an edge, and so without derivative."""
    each, borne = [], 0 * mu
    fast = EDGE * np.abs(rates).max()
    for phase in found.phases:
        strong = EDGE * phase.normal.max(initial=0.0)
        presses = phase.normal - borne > strong
        most, size = mu * phase.normal, np.abs(phase.friction)
        bears = most > EDGE * most.max(initial=0.0)
        slips = np.where(bears & (size >= (1 - EDGE) * most), np.sign(phase.friction), 0)
        if ((slips != 0) & (np.abs(phase.along) <= fast)).any():
            return None
        each.append(Roles(presses, bears & (slips == 0), slips))
        borne = restitution * phase.normal
    return tuple(each)


def impulses(
    A: Array, before: Array, each: Sequence[Roles], mu: Array, restitution: Array, law: str
) -> Array:
    """Return impulses (N, T) of an impact in these roles."""
    c = len(mu)
    if law == "newton":
        before = before + np.append(restitution * np.minimum(before[:c], 0.0), np.zeros(c))
    total, borne = np.zeros(2 * c), np.zeros(c)
    for own in each:
        held = np.concatenate([borne, own.slips * mu * borne])
        ways = np.zeros((2 * c, 2 * c))
        ways[:c, :c] = np.eye(c)
        ways[c:, :c] = np.diag(own.slips * mu)
        ways[c:, c:] = np.eye(c)
        rows = np.flatnonzero(np.concatenate([own.presses, own.sticks]))
        lacks = (A @ (total + held) + before)[rows]
        x = np.linalg.lstsq((A @ ways)[np.ix_(rows, rows)], -lacks, rcond=None)[0]
        phase = held + ways[:, rows] @ x
        total, borne = total + phase, restitution * phase[:c]
    return total
