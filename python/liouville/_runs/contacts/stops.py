"""Slips in space that come to rest, and that begin: their direction s / |s| has no limit there.

Near rest steps are as short as half the time in which the slip changes by itself; of what stops the
rest is one impulse, and what begins to slide goes the first bit of a step by its accelerations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.margin import INDEPENDENT
from liouville._runs.watch import sentence_of_end
from liouville._solution.points import Points
from liouville._systems.events import DIRECTIONS
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from liouville._runs.contacts.matrices import Matrices
    from liouville._runs.contacts.mode import ModeSystem
    from liouville._runs.contacts.switching import Switching
    from liouville._runs.contacts.tangent import Map
    from liouville._runs.contacts.traced import Contacts
    from liouville._solution.solution import Solution
    from liouville._systems.events import Event

#: Time and state by the part of a bit.
Path = Callable[[float], tuple[float, Array, Array]]

#: What stops has less than this part of a step left, or so many roundings of the time.
LAST, ROUNDINGS = 1e-9, 1024
#: What begins goes so much of a step by its accelerations, or until the slip is this part of the
#: largest velocity, which takes so much of a step at most.
FIRST, SEEN, LONGEST = 1e-5, 1e-6, 0.05
EPS, TINY = float(np.finfo(float).eps), 1e-300
#: A slip changes within a step by at most this part of itself.
MOST_CHANGE = 0.7


def sliding(now: Switching) -> list[int]:
    """Return the contacts that slide in space."""
    return [k for k, mode in enumerate(now.modes) if mode is Mode.SLIDE]


def slowest(now: Switching, at: Matrices) -> float:
    """Return the least time in which a slip in space changes by itself."""
    each = [_slip(now, at, k) for k in sliding(now)]
    times = [np.linalg.norm(s) / rate for s, ds in each if (rate := np.linalg.norm(ds)) > 0]
    return float(min(times, default=np.inf))


def stopping(now: Switching, at: Matrices) -> dict[int, float]:
    """Return the contacts whose slip comes to rest at once, and when."""
    found = {}
    for k in sliding(now):
        s, ds = _slip(now, at, k)
        left = float(np.linalg.norm(s) / (np.linalg.norm(ds) or 1.0))
        if s @ ds < 0 and left < max(LAST * now.h, ROUNDINGS * EPS * abs(now.t)):
            found[k] = now.t + left
    return found


def stopped(
    now: Switching, which: Iterable[int], d: float, y: Array, z: Array
) -> tuple[Array, Array]:
    """Return the state after a short time, with slips brought to rest."""
    at = now.at(now.t, y, z)
    y, z = y + d * at.v, z + d * _rates(now, at)
    return y, _rested(now, now.at(now.t + d, y, z), which, z)


def _rates(now: Switching, at: Matrices) -> Array:
    """Return z' by the forces found last."""
    found = now.found[0]
    rates: Array = at.free + at.moves @ np.concatenate([found.normal, found.friction])
    return rates


def _rested(now: Switching, at: Matrices, which: Iterable[int], z: Array) -> Array:
    """Return z with slips brought to rest."""
    for k in which:
        rows = [k, *(now.c + row for row in now.contacts.slips_of(k))]
        rates = np.append(0.0, at.slip[now.contacts.slips_of(k)])
        if at.is_pressed[k]:
            rows, rates = rows[1:], rates[1:]
        z = z - at.moves[:, rows] @ np.linalg.solve(at.A[np.ix_(rows, rows)], rates)
    return z


def beginning(now: Switching) -> list[int]:
    """Return the contacts that begin to slide in space, from rest."""
    slip = now.found[2]
    return [k for k in sliding(now) if not slip[now.contacts.slips_of(k)].any()]


def begun(
    now: Switching,
    which: list[int],
    start: tuple[float, Array, Array],
    d: float | None = None,
    params: Array | None = None,
) -> tuple[float, Array, Array]:
    """Return how long a first bit of sliding takes, where it is not given, and the state behind.

    It is a step of the classical method of Runge and Kutta by the accelerations of no slip. Where
    these begin at zero it is so long that the slip is well above roundoff.
    """
    own = now.params if params is None else params

    def at(t: float, y: Array, z: Array) -> Matrices:
        return now.contacts.at(t, y, z, own, now.h)

    rows = np.flatnonzero(np.isin(now.contacts.owner, which))
    (t0, y, z), (_, closed, slip) = start, now.found
    begins = np.isin(np.arange(now.c), which)

    def slope(t: float, y: Array, z: Array) -> tuple[Array, Array, Array]:
        here = at(t, y, z)
        found = now.forces(here, closed, slip, begins)
        dz = here.free + here.moves @ np.concatenate([found.normal, found.friction])
        return here.v, dz, found.along[rows]

    def behind(d: float) -> tuple[Array, Array, Array]:
        total = []
        dy, dz, ds = slope(t0, y, z)
        for part in (0.5, 0.5, 1.0):
            total.append((dy, dz, ds))
            dy, dz, ds = slope(t0 + part * d, y + part * d * dy, z + part * d * dz)
        total.append((dy, dz, ds))
        means = [(a + 2 * b + 2 * c + e) / 6 for a, b, c, e in zip(*total, strict=True)]
        return y + d * means[0], z + d * means[1], d * means[2]

    is_given, d = d is not None, FIRST * now.h if d is None else d
    y_next, z_next, s = behind(d)
    speed = at(t0, y, z).speed
    if np.linalg.norm(s) < SEEN * speed and not is_given:
        growth = float(np.linalg.norm(s)) / d**2
        d = min(float(np.sqrt(SEEN * speed / max(growth, TINY))), LONGEST * now.h)
        y_next, z_next, s = behind(d)
    # the slip itself to the accuracy of its direction; feet of one body may have dependent ones
    there, lines = at(t0 + d, y_next, z_next), now.c + rows
    lacks = np.linalg.lstsq(there.A[np.ix_(lines, lines)], s - there.slip[rows], INDEPENDENT)[0]
    return d, y_next, z_next + there.moves[:, lines] @ lacks


def map_of_start(now: Switching, which: list[int], d: float) -> Map:
    """Return the map of states near by through a first bit of sliding of this length."""

    def behind(t: float, y: Array, z: Array, params: Array) -> tuple[float, Array, Array]:
        _, moved, later = begun(now, which, (t, y, z), d, params)
        return 0.0, moved - y, later

    return behind


def map_of_stop(now: Switching, k: int, y: Array, z: Array) -> Map:
    """Return the map of states near by through the stop of a contact.

    Across its direction a slip is none by then, so it stops when it is none along it.
    """
    here = now.at(now.t, y, z)
    s, ds = _slip(now, here, k)
    own, way, rates = now.contacts.slips_of(k), s / np.linalg.norm(s), _rates(now, here)
    slows = -float(way @ ds)

    def behind(t: float, y: Array, z: Array, params: Array) -> tuple[float, Array, Array]:
        at = now.contacts.at(t, y, z, params, now.h)
        d = float(way @ at.slip[own]) / slows
        moved, later = d * at.v, z + d * rates
        there = now.contacts.at(t + d, y + moved, later, params, now.h)
        return d, moved, _rested(now, there, [k], later)

    return behind


def passed(
    run: Solution, system: ModeSystem, events: Mapping[str, Event], path: Path, params: Array
) -> Solution:
    """Return a run that stands for a bit of a path, with the events of a user that the path passes.

    The run meets what changes with its own motion; of the path slips change too.
    """
    lam, found = run.states["lam"][:1], dict(run.events)
    for name, event in events.items():
        if len(found[name].t):
            continue
        tape = system.event(name, event)[0]

        def value(part: float, tape: Any = tape) -> float:
            t, *states = path(part)
            at = [np.array([[t]]), *(x[None].copy() for x in states), lam][: len(tape.inputs) - 1]
            return float(tape.map(params, at)[0, 0])

        first, last = value(0.0), value(1.0)
        way = DIRECTIONS[event.direction]
        if not first or first * last > 0 or way * (last - first) < 0:
            continue
        low, high = 0.0, 1.0
        while last and low < (middle := (low + high) / 2) < high:
            low, high = (low, middle) if first * value(middle) <= 0 else (middle, high)
        t, y, z = path(high)
        row = np.concatenate([y, z, lam[0]])[None]
        found[name] = Points(np.array([t]), system.states_at(np.array([t]), row, params))
        if event.terminal:
            run = replace(run, message=sentence_of_end(name, t))
    return replace(run, events=found) if found != run.events else run


def turned(run: Solution, system: ModeSystem, contacts: Contacts, params: Array) -> int | None:
    """Return the record behind which a slip in space changes too much within a step, if one is."""
    rows = [row for row, k in enumerate(contacts.owner) if system.modes[k] is Mode.SLIDE]
    if not rows:
        return None
    y, z = (run.states[name] for name in system.states)
    slip = contacts.slips(run.t, y, z, params)[:, rows].reshape(len(run.t), -1, 2)
    changes = np.linalg.norm(np.diff(slip, axis=0), axis=2)
    (bad,) = np.nonzero((changes > MOST_CHANGE * np.linalg.norm(slip[:-1], axis=2)).any(axis=1))
    return int(bad[0]) if bad.size else None


def _slip(now: Switching, at: Matrices, k: int) -> tuple[Array, Array]:
    """Return the slip of a contact and its rate."""
    own = now.contacts.slips_of(k)
    return at.slip[own], now.found[0].along[own]
