"""Tangents of a run with contacts: of its stretches, joined by the derivatives of its changes.

The time of a change moves with everything before it, and the next stretch starts there: its start
has the derivatives of the state at the change, along the time that moves, and that time as
direction ``"t0"``. What an impact does is differentiated by central differences of fourth order of
the laws, along each direction and with the contacts that take part held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.matrices import CLOSED
from liouville._runs.tangents import PARAMS, ConstrainedDirections, places_of
from liouville._solution.tangents import Tangent
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._methods.control import Steps
    from liouville._runs.contacts.mode import ModeSystem
    from liouville._runs.contacts.switching import Switching
    from liouville._runs.contacts.traced import Contacts
    from liouville._solution.solution import Solution
    from liouville._systems import Mechanics

#: The step of differences, as a part of the sizes of what changes.
DIFFERENCE = 1e-3
TINY = 1e-300
#: A contact is grazed by a rate below this part of the sizes of its terms, ...
GRAZED = 1e-6
#: ... and where its gap turns within this part of them, found by so many secants at most.
NEAR, SECANTS = 1e-9, 40
#: Points and weights of a first derivative of fourth order.
STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))


@dataclass(frozen=True)
class Moving:
    """Directions of a run, as they have come to a time.

    Attributes
    ----------
    asked : ConstrainedDirections
        The directions by name.
    t, y, z : ndarray, shapes (d,), (d, n), (d, n)
        Derivatives of the start of a stretch: of its time, and of the state along it.
    params : ndarray, shape (d, P)
        Those of the parameters.
    """

    asked: ConstrainedDirections
    t: Array
    y: Array
    z: Array
    params: Array

    def directions(self, system: Mechanics) -> dict[str, Array]:
        """Return the directions of a stretch by name."""
        first, second = system.states
        found = {first: self.y, second: self.z}
        if self.t.any():
            found["t0"] = self.t
        places = places_of(system)
        begin = places["t0"][0] + 1
        for name, (place, shape) in places.items():
            own = self.params[:, place - begin : place - begin + int(np.prod(shape))]
            if name.startswith(PARAMS) and own.any():
                found[name] = own.reshape(len(own), *shape)
        return found

    def named(self, states: Mapping[str, Array]) -> dict[str, Tangent]:
        """Return derivatives at records, of shape (k, d, n) each, by the names asked for."""
        ends = np.cumsum([x.shape[-1] for x in states.values()])
        cuts = {
            name: slice(end - x.shape[-1], end)
            for end, (name, x) in zip(ends.tolist(), states.items(), strict=True)
        }
        rows = np.concatenate(list(states.values()), axis=-1)
        return self.asked.named(rows.reshape(len(rows), -1), cuts)


def moving(system: Mechanics, tangents: Any, steps: Steps) -> Moving:
    """Return the directions of a run at its start."""
    if steps.control is not None:
        raise TypeError("tangents of runs with contacts want equal steps: give h or steps")
    asked = ConstrainedDirections(system, tangents, steps)
    if asked.tau[:, 0].any() or asked.stretch.any():
        raise TypeError("tangents of runs with contacts go without directions 't0' and 't1'")
    return Moving(asked, np.zeros(asked.count), asked.y, asked.z, asked.tau[:, 1:])


def summed(run: Solution, system: ModeSystem) -> dict[str, Array]:
    """Return the derivatives at the records of a stretch, without multipliers of the mode."""
    parts = [tangent.states for tangent in run.tangents.values()]
    if not parts:
        return {}
    found: dict[str, Array] = {
        state: np.sum([part[state] for part in parts], axis=0) for state in parts[0]
    }
    if "lam" in found:
        found["lam"] = found["lam"][..., system.own]
    return found


def ended_by(run: Solution, system: ModeSystem, now: Switching) -> str | None:
    """Return the event of the mode that ended a stretch, if one did and has a derivative."""
    _check_passed(run, system, now)
    ended = [name for name in system.own_events if run.t[-1] in run.events[name].t]
    changes = [name for name in ended if system.own_events[name][1] != "slow"]
    ended = changes or ended[:1]  # where a slip slows down only steps change
    if len(ended) > 1:
        sentence = f"events {quoted(ended)} are at one time, t = {run.t[-1]:g}"
        hint = "which is first depends on the direction: the run has no derivative there"
        raise IntegrationError(hinted(sentence, hint), t=float(run.t[-1]))
    if not ended:
        return None
    k, kind = system.own_events[ended[0]]
    if kind == "hit" and _is_grazed(run, now, k):
        raise _grazed(now.contacts.names[k], now.t)
    return ended[0]


def at_end(run: Solution, system: ModeSystem, ended: str | None, before: Moving) -> Moving:
    """Return the directions at the end of a stretch, of the event that ended it, if one did."""
    first, second = system.states
    if ended is None:
        states = summed(run, system)
        return replace(before, t=0 * before.t, y=states[first][-1], z=states[second][-1])
    points = [tangent.events[ended] for tangent in run.tangents.values()]
    t, y, z = (
        np.asarray(sum(part[-1] for part in own))
        for own in (
            [x.t for x in points],
            [x.states[first] for x in points],
            [x.states[second] for x in points],
        )
    )
    return replace(before, t=t, y=y, z=z)


def _grazed(name: str, t: float) -> IntegrationError:
    sentence = f"contact '{name}' is grazed at t = {t:g}"
    return IntegrationError(hinted(sentence, "the run has no derivative there"), t=t)


def _check_passed(run: Solution, system: ModeSystem, now: Switching) -> None:
    """Refuse a stretch in which the gap of an open contact turns where it is zero."""
    contacts = now.contacts
    y, z = (run.states[name] for name in contacts.system.states)
    gap, rate = contacts.approach(run.t, y, z, now.params)
    turns = (rate[:-1] < 0) & (rate[1:] >= 0)
    # what falls as fast as it does at first and rises as at last comes no lower than this
    way = np.diff(run.t)[:, None] * np.maximum(np.abs(rate[:-1]), np.abs(rate[1:]))
    turns &= np.minimum(gap[:-1], gap[1:]) < way
    for row, k in np.argwhere(turns):
        if system.modes[k] is not Mode.OPEN:
            continue
        t = _turn(run, contacts, now.params, (int(row), int(k)))
        there = run(t)
        own = (there.states[x] for x in system.states)
        at = now.at(t, *own)
        if at.gap[k] <= NEAR * at.size[k]:
            raise _grazed(contacts.names[k], t)


def _turn(run: Solution, contacts: Contacts, params: Array, place: tuple[int, int]) -> float:
    """Return when the gap of a contact turns within a step, by regula falsi of Illinois."""
    (row, k), first = place, run.t[place[0]]

    def rate(t: float) -> float:
        there = run(t)
        y, z = (there.states[name][None] for name in contacts.system.states)
        return float(contacts.approach(np.array([t]), y, z, params)[1][0, k])

    low, high = float(first), float(run.t[row + 1])
    below, above = rate(low), rate(high)
    for _ in range(SECANTS):
        t = high - above * (high - low) / (above - below) if above > below else high
        value = rate(t)
        if not low < t < high or not value:
            return t
        if value > 0:
            high, above, below = t, value, below / 2
        else:
            low, below, above = t, value, above / 2
    return high


def _is_grazed(run: Solution, now: Switching, k: int) -> bool:
    """Whether a contact is hit with a rate of none at the end of a stretch that began open."""
    y, z = (run.states[name] for name in now.contacts.system.states)
    at = now.at(now.t, y[-1], z[-1])
    if abs(at.rate[k]) > GRAZED * at.sizes[k]:
        return False
    start = now.contacts.at(float(run.t[0]), y[0], z[0], now.params, now.h)
    return bool(start.gap[k] > CLOSED * start.size[k])  # else it bounces


#: A map of time, state and parameters: what it adds to the time, and to the first state, and the
#: second behind it.
Map = Callable[[float, Array, Array, Array], tuple[float, Array, Array]]


class Jump:
    """A map between two stretches, which happens at once, differentiated by central differences.

    Parameters
    ----------
    now : Switching
        The time, and the sizes of what there is.
    y, z : ndarray
        The state before.
    behind : callable
        The map, smooth around this state: roles of contacts are held.
    part : float
        The step of differences, as a part of the sizes of what changes.
    """

    def __init__(
        self, now: Switching, y: Array, z: Array, behind: Map, part: float = DIFFERENCE
    ) -> None:
        self._behind, self._part = behind, part
        at = now.at(now.t, y, z)
        self._at = np.concatenate([[now.t], y, z, now.params])
        self._cuts = np.cumsum([1, len(y), len(z)])
        sizes = max(at.way, TINY), max(np.abs(z).max(), now.h * np.abs(at.free).max(), TINY)
        own = np.where(now.params == 0, 1.0, np.abs(now.params))
        #: The sizes of time, state and parameters.
        self.sizes = np.concatenate(
            [[now.h], np.full(len(y), sizes[0]), np.full(len(z), sizes[1]), own]
        )

    @classmethod
    def of_impacts(cls, now: Switching, y: Array, z: Array) -> Jump:
        """Return the map of the last impacts from a state before them."""
        held = now.held(y, z)

        def behind(t: float, y: Array, z: Array, params: Array) -> tuple[float, Array, Array]:
            return 0.0, 0 * y, now.replayed(held, t, y, z, params)

        return cls(now, y, z, behind)

    def along(self, row: Array) -> Array:
        """Return how time and state behind change along a row of (t, y, z, params)."""
        first = np.split(row, self._cuts)
        size = float(np.abs(row / self.sizes).max())
        change = np.zeros(self._cuts[-1])
        if size:
            step = self._part / size
            moved = ((weight, self._at + place * step * row) for place, weight in STENCIL)
            parts = [weight * self._added(own) for weight, own in moved]
            change = np.sum(parts, axis=0) / step
        found: Array = change + np.concatenate([*first[:2], 0 * first[2]])
        return found

    def through(self, before: Moving) -> Moving:
        """Return the directions behind it."""
        rows = np.column_stack([before.t, before.y, before.z, before.params])
        found = np.stack([self.along(row) for row in rows])
        t, y, z, _ = np.split(found, self._cuts, axis=1)
        return replace(before, t=t[:, 0], y=y, z=z)

    def pulled(self, of_t: float, of_y: Array, of_z: Array) -> list[Array]:
        """Return cotangents of (t, y, z, params) before from those of (t, y, z) behind."""
        behind = np.concatenate([[of_t], of_y, of_z])
        rows = np.diag(self.sizes)
        found = np.array([behind @ self.along(row) for row in rows]) / self.sizes
        return np.split(found, self._cuts)

    def _added(self, at: Array) -> Array:
        t, y, z, params = np.split(at, self._cuts)
        later, moved, behind = self._behind(float(t[0]), y, z, params)
        return np.concatenate([[later], moved, behind])
