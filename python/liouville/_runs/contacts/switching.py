"""Changes of contacts: impacts, and which mode goes on after them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._runs.contacts import flights, law
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.impulses import impulses, roles
from liouville._runs.contacts.margin import contradicting
from liouville._runs.contacts.matrices import (
    AT_REST,
    CLOSED,
    EPS,
    ROUNDINGS,
    TINY,
    Matrices,
    of_contacts,
)
from liouville._runs.contacts.streak import Streak, refuse_endless
from liouville._runs.contacts.traced import Contacts
from liouville._solution.contacts import Change
from liouville._systems.mechanics.contact import Mode

#: Rates before an impact are known to this part of the sizes of their terms.
ROUNDED = 1e-14
#: Accelerations and forces are zero within this part of the largest, ahead within the second.
ZERO, ZERO_AHEAD = 1e-9, 1e-12
#: Accelerations are rounded by so many times what friction that holds leaves of them.
NOISE = 4.0
#: A look ahead goes this part of a step.
AHEAD = 1e-6
#: An impact gains energy where it is more than this part of the work of its impulses.
GAINED = 1e-9
#: Impacts at one time, after which contacts are said to hit one another without end.
MOST_AT_ONCE = 200
#: In a sequence of hits, contacts are equally fast whose rates differ by this part, ...
SAME = 1e-9
#: ... and after so many hits at one time those with losses die down.
DIE_DOWN = 100
#: Rates are zero within so many times as much where an impact finds no impulse that changes them.
UNCHANGED = 100


class Switching:
    """Modes of contacts at a time, and their changes so far.

    Attributes
    ----------
    t : float
        The time.
    modes : tuple of Mode
        What each contact does.
    changes : list of list of Change
        The changes of each contact so far.
    lifts : ndarray, shape (c,)
        Accelerations of the gaps in these modes.
    messages : list of str
        What is to be said of impacts.
    """

    def __init__(self, contacts: Contacts, t: float, h: float, params: Array) -> None:
        self.contacts, self.t, self.h, self.params = contacts, t, h, params
        self.c = len(contacts.names)
        self.laws = contacts.laws(params)
        self.laws.check(contacts.names)
        self.modes: tuple[Mode, ...] = (Mode.OPEN,) * self.c
        self.changes: list[list[Change]] = [[] for _ in range(self.c)]
        self._streaks = [Streak() for _ in range(self.c)]
        self.lifts: Array = np.zeros(self.c)
        self.messages: list[str] = []
        #: What the last change did to velocities: which contacts took part, which of them bounced
        #: and what was found; of one brought to rest its number.
        self.impacts: list[tuple[Any, Array, law.Forces | None]] = []
        self._last: tuple[Any, Matrices] | None = None
        #: The forces found last, and of which contacts that are closed, with their directions.
        self.found: tuple[law.Forces, Array, Array]
        #: The contacts whose slip in space has just come to rest.
        self.rests: set[int] = set()
        #: The contacts whose forces have just come to a bound, by a jump too.
        self.gave_way: set[int] = set()

    def at(self, t: float, y: Array, z: Array) -> Matrices:
        """Return the matrices at a state, those of the last one again."""
        state = t, y.tobytes(), z.tobytes(), self.h
        if self._last is None or self._last[0] != state:
            self._last = state, self.contacts.at(t, y, z, self.params, self.h)
        return self._last[1]

    def settle(self, y: Array, z: Array, stopped: set[int]) -> tuple[Array, Array]:
        """Make impacts until nothing approaches, and choose the mode that goes on."""
        before = self.modes
        self.impacts = []
        closing: dict[int, float | None] = {}
        is_unchanged = False
        for count in range(MOST_AT_ONCE):
            at = self.at(self.t, y, z)
            sizes = at.sizes
            still = at.still
            touching = at.gap <= CLOSED * at.size + ROUNDINGS * EPS * np.abs(at.rate) * abs(self.t)
            touching &= ~at.is_pressed
            if (touching & (at.rate < -still * (UNCHANGED if is_unchanged else 1))).any():
                first = self._first(at, touching, count)
                was, z = z, self._hit(at, z, first, sizes, closing)
                is_unchanged = bool((z == was).all())
                stopped = stopped if is_unchanged else set()
                continue
            closed = at.is_pressed | (touching & (at.rate <= still))
            slip = self.ways(at, closed, stopped)
            self.found = self.forces(at, closed, slip), closed, slip
            low = flights.closed(self, at, touching & ~closed, stopped, closing)
            if low is not None:
                self.impacts.append((low, np.zeros(0), None))
                z = flights.held(at, z, low)
                stopped = stopped & {*at.owner[low[low >= self.c] - self.c].tolist()}
                continue
            self.modes = self._modes(at, y, z)
            self._note(before, closing)
            return self._placed(at, y), z
        self._refuse_contradictions(at, at.rate, touching)
        sentence = f"at t = {self.t:g} contacts hit one another without end"
        hit = tuple(self.contacts.names[k] for k in np.flatnonzero(touching))
        raise IntegrationError(f"{sentence}: {quoted(hit)}", t=self.t)

    def _first(self, at: Matrices, touching: Array, count: int) -> tuple[Array, bool]:
        """Return which contacts hit next, after so many hits, and whether they hit without rebound.

        A sequence of hits with losses may have no end. Then all rates between its contacts come to
        zero by impulses that press, which is what one impact of all without restitution does.
        """
        if self.contacts.law != "sequence":
            return touching, False
        if count >= DIE_DOWN and (at.laws.restitution[touching] < 1).any():
            if at.laws.restitution[touching].any():
                names = quoted([self.contacts.names[k] for k in np.flatnonzero(touching)])
                sentence = f"{DIE_DOWN} hits of {names} in turn at t = {self.t:g}"
                self.messages.append(f"{sentence} were ended by one without restitution")
            return touching, True
        return touching & (at.rate <= (1 - SAME) * at.rate[touching].min()), False

    def _hit(
        self,
        at: Matrices,
        z: Array,
        first: tuple[Array, bool],
        sizes: Array,
        closing: dict[int, float | None],
    ) -> Array:
        """Return z after the impact of all contacts that touch, or of those that are first."""
        own = self.contacts
        touching, is_last = first
        restitution = flights.restitution(self, at, touching, closing) * (not is_last)
        before, found = self._struck(at, touching, restitution, sizes)
        if found is None:
            restitution = 0 * at.laws.restitution
            found = law.impact(
                at.A, before, touching, restitution, at.laws.static, at.owner, "poisson"
            )
            names = quoted([own.names[k] for k in np.flatnonzero(touching)])
            if found is None:
                self._refuse_contradictions(at, at.rate, touching)
                sentence = f"at t = {self.t:g} the impact of contacts {names} has no solution"
                raise IntegrationError(sentence, t=self.t)
            self.messages.append(f"the impact of {names} at t = {self.t:g} was made plastic")
        if found.normal.any():
            self.impacts.append((touching, restitution != 0, found))
        impulses = np.concatenate([found.normal, found.friction])
        rates = np.concatenate([found.across, found.along])
        gained = float(impulses @ (before + rates)) / 2
        if gained > GAINED * np.abs(impulses) @ (np.abs(before) + np.abs(rates)):
            self.messages.append(f"the impact at t = {self.t:g} gained energy, {gained:.3g}")
        seen = own.seen(found.friction)
        for k in np.flatnonzero(found.normal > 0):
            change = Change(self.t, "hit", float(found.normal[k]), float(seen[k]))
            self.add_hit(int(k), change)
        after: Array = z + at.moves @ impulses
        return after

    def add_hit(self, k: int, change: Change) -> None:
        """Add a hit to the changes of a contact, unless such hits have no end."""
        self.changes[k].append(change)
        self._streaks[k].hit(change.t, change.normal)
        refuse_endless(self._streaks, k, self.contacts.names)

    def _struck(
        self, at: Matrices, touching: Array, restitution: Array, sizes: Array
    ) -> tuple[Array, law.Forces | None]:
        """Return the rates before an impact of all contacts that touch, and what it does."""
        own, rates = self.contacts, np.concatenate([at.rate, at.slip])
        found = None
        lawful = law.without_contradictions(at.A, rates, touching, at.owner)
        for before in (lawful, rates.copy()):
            before[np.abs(before) <= ROUNDED * sizes] = 0.0
            found = law.impact(
                at.A, before, touching, restitution, at.laws.static, at.owner, own.law
            )
            if found is None or found.normal.any():
                break  # else nearly dependent rows contradict each other by more than roundoff
        return before, found

    def held(self, y: Array, z: Array) -> list[Any]:
        """Return the roles of contacts in the last change, from a state before it.

        Raises
        ------
        IntegrationError
            It has no derivative.
        """
        each: list[Any] = []
        for what, bounces, found in self.impacts:
            if found is None:
                each.append((what, None, None))
                continue
            at = self.contacts.at(self.t, y, z, self.params, self.h)
            rates, laws = np.concatenate([at.rate, at.slip]), at.laws
            own = roles(found, rates, laws.static, bounces * laws.restitution, at.owner)
            if own is None:
                names = quoted([self.contacts.names[k] for k in np.flatnonzero(what)])
                sentence = f"the impact of {names} at t = {self.t:g} has no derivative"
                hint = "a contact just begins to slip or to stick in it"
                raise IntegrationError(hinted(sentence, hint), t=self.t)
            each.append((what, bounces, own))
            z = z + at.moves @ np.concatenate([found.normal, found.friction])
        return each

    def replayed(self, held: list[Any], t: float, y: Array, z: Array, params: Array) -> Array:
        """Return z behind the last change, from another state before it."""
        for what, bounces, own in held:
            at = self.contacts.at(t, y, z, params, self.h)
            if own is None:
                z = flights.held(at, z, what)
                continue
            rates, laws = np.concatenate([at.rate, at.slip]), at.laws
            coefficients = laws.static, bounces * laws.restitution
            law_of = self.contacts.law
            z = z + at.moves @ impulses(at.A, rates, own, coefficients, at.owner, law_of)
        return z

    def _modes(self, at: Matrices, y: Array, z: Array) -> tuple[Mode, ...]:
        """Return the mode of each contact by the forces found."""
        found, closed, slip = self.found
        verdict, self.lifts = self._verdict(at, found, closed, slip, ZERO), found.across
        for k in self.gave_way:  # a force that jumps is none on this side
            verdict[k] = None
        if any(mode is None for mode in verdict):
            ahead, later = self.ahead(at, y, z, AHEAD)
            sure = self._verdict(ahead, later, closed, slip, ZERO_AHEAD)
            verdict = [b if a is None else a for a, b in zip(verdict, sure, strict=True)]
        return tuple(Mode.OPEN if mode is None else mode for mode in verdict)

    def ways(self, at: Matrices, closed: Array, stopped: set[int]) -> Array:
        """Return the directions of slips, 0 of what does not slip."""
        speed, sizes = (of_contacts(x, at.owner) for x in (at.slip, at.sizes[self.c :]))
        slides = np.array([mode is Mode.SLIDE for mode in self.modes])
        # a contact that slides in space slides until an event says that its slip has stopped
        moves = (speed > AT_REST * sizes) | (slides & (speed > 0))
        moves &= closed & (at.laws.static > 0)
        moves[list(stopped)] = False
        found: Array = np.where(moves[at.owner], at.slip / np.maximum(speed, TINY)[at.owner], 0.0)
        return found

    def ahead(self, at: Matrices, y: Array, z: Array, part: float) -> tuple[Matrices, law.Forces]:
        """Return matrices and forces at a part of a step ahead, by the accelerations found."""
        (found, closed, slip), d = self.found, part * self.h
        dz = at.free + at.moves @ np.concatenate([found.normal, found.friction])
        ahead = self.at(self.t + d, y + d * at.v + d**2 / 2 * dz, z + d * dz)
        return ahead, self.forces(ahead, closed, slip)

    def forces(
        self, at: Matrices, closed: Array, slip: Array, begins: Array | bool = False
    ) -> law.Forces:
        """Return the forces; what begins to slip has the friction of what slips."""
        own, laws = self.contacts, at.laws
        moves = (of_contacts(slip, at.owner) > 0) | begins
        mu = np.where(moves, laws.friction, laws.static)
        found = law.solve(at.A, at.b, closed, slip, mu, at.owner, at.load, at.is_pressed)
        if found is not None and (laws.static > laws.friction).any():
            size = ZERO * np.abs(np.concatenate([found.along, at.b])).max()
            torn = ~moves & closed & (of_contacts(found.along, at.owner) > size)
            if torn.any():
                # in the plane its direction is known, in space it turns to that of the acceleration
                turned = np.where((torn & ~own.is_spatial)[at.owner], np.sign(found.along), slip)
                mu = np.where(moves | torn, laws.friction, laws.static)
                found = law.solve(at.A, at.b, closed, turned, mu, at.owner, at.load, at.is_pressed)
        if found is None:
            self._refuse_contradictions(at, at.b, closed)
            names = quoted([own.names[k] for k in np.flatnonzero(closed)])
            sentence = f"at t = {self.t:g} no accelerations obey the laws of contacts {names}"
            hint = "rigid contact with this friction jams there (Painlevé): lower the friction"
            raise IntegrationError(hinted(sentence, hint), t=self.t)
        return found

    def _refuse_contradictions(self, at: Matrices, rates: Array, closed: Array) -> None:
        """Refuse closed contacts that no motion obeys together, by their names."""
        static = at.laws.static
        for mu, how in ((0 * static, ""), (static, ", wedged in by their friction")):
            found = contradicting(at, rates, np.flatnonzero(closed & ~at.is_pressed), mu)
            if found.size:
                names = quoted([self.contacts.names[k] for k in found])
                sentence = f"at t = {self.t:g} contacts {names} contradict one another{how}"
                hint = "no motion keeps all their gaps, so end the run before by an event"
                raise IntegrationError(hinted(sentence, hint), t=self.t)

    def _verdict(
        self, at: Matrices, found: law.Forces, closed: Array, slip: Array, zero: float
    ) -> list[Mode | None]:
        """Return the modes that forces mean, None where they are on an edge."""
        pulls = np.abs(at.b)
        if zero == ZERO:  # where a normal force ends b is roundoff, and its terms are not
            pulls = pulls + np.abs(at.rows[-len(pulls) :]) @ np.abs(at.free)
        fast = zero * max(pulls.max(), np.abs(found.across).max(), np.abs(found.along).max())
        per_force = np.maximum(np.abs(np.diag(at.A)), TINY)[: self.c]
        strong = zero * (np.abs(found.normal).max() + (pulls[: self.c] / per_force).max())
        friction, along = (of_contacts(x, at.owner) for x in (found.friction, found.along))
        moves = of_contacts(slip, at.owner) > 0
        held = closed & ~moves & (friction > 0)
        fast = max(fast, NOISE * law.noise(found, at.laws.friction, held, at.owner))
        modes: list[Mode | None] = []
        for k in range(self.c):
            pressed = found.normal[k] > strong or at.is_pressed[k]
            lifts = found.across[k] > fast and not at.is_pressed[k]
            mode: Mode | None
            if not closed[k] or (lifts and not pressed):
                mode = Mode.OPEN
            elif not pressed and zero == ZERO:
                mode = None
            elif not at.laws.static[k]:
                mode = Mode.CLOSED
            elif moves[k]:
                mode = self.contacts.slipping(k, slip)
            else:
                left = at.laws.static[k] * found.normal[k] - friction[k]
                if along[k] > fast:
                    mode = self.contacts.slipping(k, found.along)
                else:
                    mode = None if left <= strong and zero == ZERO else Mode.STICK
            modes.append(mode)
        return modes

    def _note(self, before: tuple[Mode, ...], closing: Mapping[int, float | None]) -> None:
        """Keep what changed."""
        for k, (old, new) in enumerate(zip(before, self.modes, strict=True)):
            kinds = []
            if old is Mode.OPEN and new is not Mode.OPEN and self.contacts.has_gap(k):
                has_hit = bool(self.changes[k]) and self.changes[k][-1].t == self.t
                if k in closing or not has_hit:
                    kinds.append("close")
            elif new is Mode.OPEN and old is not Mode.OPEN:
                kinds.append("leave")
            if new is Mode.STICK and old is not Mode.STICK:
                kinds.append("stick")
            turns = old is not new or k in self.rests
            if new.slips and turns and old is not Mode.OPEN:
                kinds.append("slip")
            for kind in kinds:
                rest = closing.get(k) if kind == "close" else None
                self.changes[k].append(Change(self.t, kind, rest=rest))
        self.rests = set()

    def _placed(self, at: Matrices, y: Array) -> Array:
        """Return y with closed gaps at zero, and open ones that are zero by roundoff not below it.

        All in one: what closes a gap moves others.
        """
        gap, A = at.gap, at.A[: self.c, : self.c]
        moved = np.array([mode is not Mode.OPEN for mode in self.modes]) & ~at.is_pressed
        near = ~moved & ~at.is_pressed & (gap <= CLOSED * at.size)
        wanted, below = np.where(moved, 0.0, np.abs(gap)) - gap, near
        if not (near & ((gap < 0) | moved.any())).any():
            return y
        while below.any():
            x = np.linalg.lstsq(A[np.ix_(moved, moved)], wanted[moved], rcond=None)[0]
            below = near & ~moved & (gap + A[:, moved] @ x < 0)
            moved = moved | below
        found: Array = y + at.v_z @ (at.moves[:, : self.c][:, moved] @ x)
        return found
