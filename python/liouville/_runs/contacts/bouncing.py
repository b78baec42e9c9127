"""Hits that the core answers by itself: each of one contact, while none is closed.

There a hit is an event with a reset, which the core makes within the run. Afterwards all hits are
looked at, and the run counts up to the first that was not one alone, or whose flight is as short as
a few steps; there the laws of contacts take over.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.flights import LOW
from liouville._runs.contacts.hit import has_closed_form, margin
from liouville._runs.contacts.matrices import AT_REST, CLOSED, EPS, ROUNDINGS
from liouville._runs.contacts.stretch import PENETRATES
from liouville._runs.contacts.switching import Switching
from liouville._solution.contacts import Change
from liouville._systems.events import AFTER
from liouville._systems.mechanics.motion import kept
from liouville._systems.mechanics.traced import INVARIANT
from liouville._systems.tape import record
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._runs.contacts.mode import ModeSystem
    from liouville._runs.contacts.traced import Contacts
    from liouville._solution.solution import Solution

#: The end of a run, and what it observes.
Asked = tuple[float, Any]

#: Flights of less than this part of a step are left to the laws of contacts, ...
SHORT = 0.05
#: ... as are those no higher than so many times the height at which a contact closes.
HIGH = 1e4
#: So many hits of a contact in a step are one at least more than there are flights of this part.
MOST_HITS = round(1 / SHORT) + 1
#: The first window, and the least one, in steps.
WINDOW, LEAST = 16, 4


@dataclass(frozen=True)
class Hits:
    """Hits in the order of time: their contacts, and the states before and after."""

    t: Array
    contact: Array
    before: tuple[Array, Array]
    after: Mapping[str, Array]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.t)

    def first(self, count: int) -> Hits:
        """Return the first hits."""
        y, z = (x[:count] for x in self.before)
        after = {name: x[:count] for name, x in self.after.items()}
        return Hits(self.t[:count], self.contact[:count], (y, z), after)


@dataclass(frozen=True)
class Bounced:
    """A run with hits, as far as it counts.

    Attributes
    ----------
    run : Solution
        The run, with records at its hits.
    count : int
        How many records count.
    end : tuple of (float, ndarray, ndarray), or None
        Time and state before the hit at which it ends to count, None where all counts.
    changes : list of (int, Change)
        The hits that count, by contact.
    """

    run: Solution
    count: int
    end: tuple[float, Array, Array] | None
    changes: list[tuple[int, Change]]


def bounced(
    run: Solution, system: ModeSystem, now: Switching, accelerated: float, asked: Asked
) -> Bounced:
    """Return how far a run with hits counts; asked is until when, and what to observe."""
    until, observe = asked
    hits = _hits(run, system)
    if not len(hits):
        return Bounced(run, len(run.t), None, [])
    impulses, is_bad, least = _judged(hits, now, accelerated)
    is_bad |= _too_short(hits, now.h, least)
    _add_missed(is_bad, hits, run, (now, accelerated))
    if run.status == "done" and run.t[-1] < until and not _is_ended(run, system):
        is_bad[-1] = True  # the hits accumulate
    good, end = len(hits), None
    if is_bad.any():
        good = int(np.argmax(is_bad))
        (y, z), first = hits.before, _first(hits, good)
        end = float(hits.t[good]), y[first].copy(), z[first].copy()
    changes = [
        (int(k), Change(float(t), "hit", *map(float, impulse)))
        for t, k, impulse in zip(hits.t[:good], hits.contact[:good], impulses[:good], strict=True)
    ]
    whole = _recorded(run, system, hits.first(good), now.params, observe)
    count = len(whole.t) if end is None else int(np.searchsorted(whole.t, end[0]))
    return Bounced(whole, count, end, changes)


def _hits(run: Solution, system: ModeSystem) -> Hits:
    """Return the hits of a run in the order of time."""
    met = [(k, run.events[name]) for name, k in system.bounces.items()]
    t = np.concatenate([x.t for _, x in met])
    order = np.argsort(t, kind="stable")
    names = [name for name in met[0][1].states if not name.endswith(AFTER)]
    states = {
        name: np.concatenate([x.states[name] for _, x in met])[order] for name in met[0][1].states
    }
    first, second = system.states
    contact = np.concatenate([np.full(len(x.t), k) for k, x in met])[order]
    after = {name: states[name + AFTER] for name in names}
    return Hits(t[order], contact, (states[first], states[second]), after)


def _first(hits: Hits, which: int) -> int:
    """Return the first hit at the time of one: the state before it is behind none of the others."""
    (same,) = np.nonzero(hits.t == hits.t[which])
    _, z = hits.before
    behind = hits.after[[*hits.after][1]][same]
    return next((int(k) for k in same if not (behind == z[k]).all(axis=1).any()), which)


def _hits_tape(contacts: Contacts) -> tuple[_core.Tape, list[int]]:
    """Record what is asked at hits: gaps, rates, their sizes, momenta and directions of forces."""

    def recorded() -> tuple[_core.Tape, list[int]]:
        system, columns = contacts.system, contacts.columns
        s, model = system.symbols, system.model
        own = model.nonholonomic
        parts = [
            columns["phi"],
            columns["rates"],
            ca.sum2(ca.fabs(columns["across"])),
            ca.sum2(ca.fabs(jacobian(columns["rates"], s.z))),
            ca.mmax(ca.fabs(model.v)),
            model.p,
            ca.vec(columns["across"].T),
            ca.vec(columns["along"].T),
            _margins(contacts),
            ca.vec(ca.horzcat(jacobian(model.r, model.lam), jacobian(own.rn, own.nu))),
        ]
        dense = [ca.densify(x) for x in parts]
        ends = np.cumsum([x.numel() for x in dense])[:-1].tolist()
        return record("hits", s.inputs(z=s.z), *dense), ends

    return kept(contacts.system, "hits", recorded)


def _margins(contacts: Contacts) -> ca.SX:
    """Return how far hits are from having several outcomes, 1 of contacts without friction."""
    has_any = has_closed_form(contacts)
    each = [margin(contacts, k) if x and has_any else 1 for k, x in enumerate(contacts.is_rough)]
    return ca.vertcat(*each)


def _judged(hits: Hits, now: Switching, accelerated: float) -> tuple[Array, Array, Array]:
    """Return impulses (N, T) of hits, and which are not those of one contact that approaches.

    Then come the least times of flights that may be gone through.
    """
    contacts, (y, z) = now.contacts, hits.before
    (tape, ends), n = _hits_tape(contacts), y.shape[1]
    after = [hits.after[name] for name in contacts.system.states]
    both = [
        np.split(tape.map(now.params, [*map(np.ascontiguousarray, own)]), ends, axis=1)
        for own in ((hits.t[:, None], y, z), (hits.t[:, None], *after))
    ]
    gap, rate, slopes, rate_slopes, fast, p, across, along, margins, reactions = both[0]
    speed = fast + now.h * accelerated
    size = slopes * (np.abs(y).max(axis=1, keepdims=True) + now.h * speed) + np.abs(gap)
    near = CLOSED * size + ROUNDINGS * EPS * np.abs(rate * hits.t[:, None])
    own = np.arange(len(hits)), hits.contact
    touching = gap <= near
    touching[own] = False
    is_bad = touching.any(axis=1) | (rate[own] >= -AT_REST * (rate_slopes * speed)[own])
    is_bad |= (both[1][1][own] <= AT_REST * (rate_slopes * speed)[own]) | (margins[own] <= 0)
    least = 4 * HIGH * LOW * EPS * size[own] / np.abs(both[1][1][own])
    jumps, normals = both[1][5] - p, across.reshape(len(hits), -1, n)[own]
    if not reactions.shape[1] and not any(contacts.is_rough):
        found = (jumps * normals).sum(axis=1) / (normals**2).sum(axis=1)
        return np.stack([found, 0 * found], axis=1), is_bad, least
    slides = along.reshape(len(hits), -1, n)[own]
    slides *= np.array(contacts.is_rough)[hits.contact][:, None]
    columns = np.concatenate([np.stack([normals, slides], axis=2), _columns(reactions, n)], axis=2)
    return np.einsum("kij,kj->ki", np.linalg.pinv(columns), jumps)[:, :2], is_bad, least


def _columns(flat: Array, n: int) -> Array:
    """Return matrices with n rows, of which columns stand one after another."""
    return flat.reshape(len(flat), -1, n).swapaxes(1, 2)


def _too_short(hits: Hits, h: float, least: Array) -> Array:
    """Return whether the contact of a hit hits again within a time that is too short."""
    found = np.zeros(len(hits), dtype=bool)
    for k in np.unique(hits.contact):
        (own,) = np.nonzero(hits.contact == k)
        found[own[:-1]] = np.diff(hits.t[own]) < np.maximum(SHORT * h, least[own[:-1]])
    return found


def _add_missed(is_bad: Array, hits: Hits, run: Solution, known: tuple[Switching, float]) -> None:
    """Say which hits were followed by a flight that was jumped over: then a record penetrates."""
    now, accelerated = known
    y, z = (run.states[name] for name in now.contacts.system.states)
    gap, _, size, _ = now.contacts.records(run.t, y, z, now.params, now.h, accelerated)
    for row, k in np.argwhere(gap < -PENETRATES * size):
        (own,) = np.nonzero((hits.contact == k) & (hits.t <= run.t[row]))
        is_bad[own[-1:]] = True


def _is_ended(run: Solution, system: ModeSystem) -> bool:
    """Whether a run was ended by another event than a hit that the core answers."""
    others = [points for name, points in run.events.items() if name not in system.bounces]
    return any(run.t[-1] in points.t[-1:] for points in others)


def _recorded(
    run: Solution, system: ModeSystem, hits: Hits, params: Array, observe: Any
) -> Solution:
    """Return a run with records behind its hits."""
    which = np.flatnonzero(~np.isin(hits.t, run.t))
    if not which.size:
        return run
    t = hits.t[which]
    tape, widths = system.observer(observe, True)
    names = [*system.states, "lam"][: len(tape.inputs) - 2]
    args = [t[:, None], *(hits.after[name][which] for name in names)]
    rows = tape.map(params, [*map(np.ascontiguousarray, args)])
    cuts = np.cumsum([*widths.values()])[:-1]
    parts = dict(zip(widths, np.split(rows, cuts, axis=1), strict=True))
    order = np.argsort(np.concatenate([run.t, t]), kind="stable")

    def joined(values: Array, more: Array) -> Array:
        return np.concatenate([values, more.reshape(len(t), *values.shape[1:])])[order]

    return replace(
        run,
        t=joined(run.t, t),
        states={name: joined(x, hits.after[name][which]) for name, x in run.states.items()},
        invariants={name: joined(x, parts[INVARIANT + name]) for name, x in run.invariants.items()},
        residuals={name: joined(x, parts[name]) for name, x in run.residuals.items()},
        observed={name: joined(x, parts[f"observed {name}"]) for name, x in run.observed.items()},
    )
