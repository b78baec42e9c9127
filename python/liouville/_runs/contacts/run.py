"""Runs with contacts: one smooth stretch after another, each a run of the system of its mode."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._runs.contacts import stops
from liouville._runs.contacts.bouncing import LEAST, MOST_HITS, WINDOW, bounced
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.joined import Link, Part, Stretch, check, joined
from liouville._runs.contacts.margin import loads, refuse_space, torn
from liouville._runs.contacts.matrices import Matrices
from liouville._runs.contacts.mode import FEW, ModeSystem, endings
from liouville._runs.contacts.switching import AT_REST, EPS, Switching
from liouville._runs.contacts.tangent import Moving, at_end, ended_by, moving, through
from liouville._runs.contacts.traced import Contacts
from liouville._runs.watch import given
from liouville._systems.events import Event, named
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._methods.control import Steps
    from liouville._runs.contacts.single import Maker
    from liouville._runs.runner import Request
    from liouville._solution.solution import Solution

TINY = float(np.finfo(float).tiny)

#: Flights shorter than so many steps are made with a step of this part of them.
SHORT, PARTS = 3.0, 3
#: A start of a stretch is moved onto its constraints by at most this part of its size.
MOVED = 1e-7
#: Where a method chooses its first step, sizes are those of this part of the whole time.
FIRST = 0.01
#: Times that differ by so many roundings are the same.
SAME = 4
#: A step in which a slip changes too much is shortened so often.
MOST_CAUTION = 12
#: So many stretches in turn that do not move the time are said to be without end.
MOST_AT_ONCE = 100


class Course:
    """A run with contacts as it goes on.

    Parameters
    ----------
    contacts : Contacts
        The contacts of the system.
    make : Maker
        What makes a stretch, to the end or to an event.
    request : Request
        What is asked for.
    steps : Steps
        The steps asked for.
    without : str or None
        The name of a method that holds no nonholonomic constraints, and so nothing that sticks.
    """

    def __init__(
        self, contacts: Contacts, make: Maker, request: Request, steps: Steps, without: str | None
    ) -> None:
        self.contacts, self.make, self.request = contacts, make, request
        #: Whether the run is differentiated, by directions or by a pullback.
        self.has_derivative = request.tangents is not None or request.has_pullback
        if self.has_derivative and contacts.is_spatial.any():
            names = quoted([contacts.names[k] for k in np.flatnonzero(contacts.is_spatial)])
            sentence = f"derivatives do not go through friction in space, of contacts {names}"
            raise TypeError(hinted(sentence, "give a slip of one value to what moves in a plane"))
        self.without, self.may_reset = without, without is None and not self.has_derivative
        #: How each stretch began and ended, of a run with a pullback.
        self.links: list[Link] = []
        #: The directions that the run is differentiated in, as they have come to the present time.
        self.moving: Moving | None = None
        if request.tangents is not None:
            if not request.states:
                raise ValueError("tangents are those of states: leave out states=False")
            self.moving = moving(contacts.system, request.tangents, steps)
        start, self.end = steps.t0, steps.t1
        self.steps, self.is_controlled = steps, steps.control is not None
        #: The longest step that a stretch begins with: a time scale of accelerations knows no rest.
        self.longest = np.inf
        #: The step that the next stretch begins with, None where the method chooses it.
        self.step: float | None = (self.end - start) / steps.count
        if steps.control is not None:
            self.step = steps.control[-2] or None
            if steps.control[0] == "reversible" and request.control.monitor is None:
                self.longest = steps.control[-2]
        h = self.step or FIRST * (self.end - start)
        self.now = Switching(contacts, start, h, contacts.system.values(request.params))
        self._at_once = 0
        #: The largest acceleration without contact forces at the beginning of a stretch.
        self.accelerated = 0.0
        self.events = named(request.events)
        #: How often each was met.
        self.met = dict.fromkeys(self.events, 0)
        #: How often a step was shortened in which a slip in space changed too much.
        self.caution = 0
        #: So many steps the next stretch through hits goes.
        self.window = WINDOW
        #: The times of the records, where they are given.
        self.times = given(request.t_eval, (start, self.end), request.every)
        self.stretches: list[Stretch] = []
        self.status, self.ending = "done", ""

    @property
    def is_over(self) -> bool:
        """Whether the run has come to its end."""
        return self.now.t >= self.end or self.status != "done" or bool(self.ending)

    def settle(self, y: Array, z: Array, stopped: set[int]) -> tuple[Array, Array]:
        """Make impacts, and choose the mode that goes on; directions go through them too."""
        self._before = self.now.t, y, z
        found = self.now.settle(y, z, stopped)
        if self.moving is not None:
            self.moving = through(self.now, self.moving, y, z)
        return found

    def advance(self, y: Array, z: Array) -> tuple[Array, Array, set[int]]:
        """Make a stretch; return the state at its end and the contacts whose slip came to zero."""
        now, (first, second) = self.now, self.contacts.system.states
        if begins := stops.beginning(now):
            y, z = self._begin(y, z, begins)
            if self.is_over:
                return y, z, set()
        at = now.at(now.t, y, z)
        if rests := stops.stopping(now, at):
            return *self._stop(y, z, rests), {*rests}
        self.accelerated = max(self.accelerated, at.pull)
        system = self._system(at)
        start = self._moved(system, at, y, z)
        begin, (until, h) = now.t, self._limits(y, z)
        bounces = self._has_window(system, until)
        if bounces and h is not None:
            until = min(until, now.t + self.window * h)
        ending = endings(self.contacts, system, AT_REST * at.sizes[now.c :], now.h)
        asked = self._asked((system, ending), (now.t, until), h, start, bounces=bounces)
        names = None if self.moving is None else self.moving.directions(system)
        try:
            run = self.make(*asked, None, names)
        except IntegrationError as error:
            if bounces:  # of a part that may not count
                self.window = 0
                return self.advance(y, z)
            if error.solution is not None and len(error.solution.t):
                run = error.solution
                now.t = float(run.t[-1])
                whole = Part(run, system, len(run.t), loads(run, system, self.now), now.t)
                self._keep(whole, asked)
            raise
        end, changes = None, []
        if bounces:
            found = bounced(run, system, now, self.accelerated, (until, self.request.observe))
            run, count, end, changes = found.run, found.count, found.end, found.changes
            longer = min(2 * self.window, self.steps.count)
            self.window = longer if end is None else max(LEAST, self.window // 2)
        else:
            count = len(run.t)
        wrong = check(run, system, now, self.accelerated, count)
        if wrong is not None and bounces:
            self.window = 0
            return self.advance(y, z)
        if wrong is not None:
            raise wrong
        last = stops.turned(run, system, self.contacts, now.params)
        if last == 0 and self.caution < MOST_CAUTION:
            self.caution += 1
            return self.advance(y, z)
        self.caution = 0
        last = last or len(run.t) - 1
        now.t, count = float(run.t[last]), min(count, last + 1)
        y, z = run.states[first][last].copy(), run.states[second][last].copy()
        forces = loads(run, system, self.now)
        if len(forces) > 1 and forces[-1].gives_way:
            count = len(forces) - 1
            now.t, (y, z) = torn(run, count, now)
            if self.has_derivative:
                sentence = f"contacts that share a load give way at t = {now.t:g}"
                hint = "derivatives do not go through that"
                raise IntegrationError(hinted(sentence, hint), t=now.t)
        if end is not None:
            now.t, y, z = end
        self._keep(Part(run, system, count, forces, now.t), asked)
        for k, change in changes:
            now.add_hit(k, change)
        if self.has_derivative:
            self._differentiate(run, system)
        self._go_on(run, begin, h)
        return y, z, self._ended(run, system)

    def _begin(self, y: Array, z: Array, which: list[int]) -> tuple[Array, Array]:
        """Return the state behind the first bit of sliding in space, with a record before it."""
        now = self.now
        if self.without is not None:
            names = quoted([self.contacts.names[k] for k in which])
            sentence = f"at t = {now.t:g} contact {names} slides from rest in space"
            raise IntegrationError(f"{sentence}, which {self.without} does not begin", t=now.t)
        t = now.t
        d, *behind = stops.begun(now, which, (t, y, z))
        self._bridge(y, z, t + d, which)
        if self.is_over or now.t < t + d:  # an event ended it
            _, *behind = stops.begun(now, which, (t, y, z), now.t - t)
        y, z = behind
        return (y, z) if self.is_over else self.settle(y, z, set())

    def _stop(self, y: Array, z: Array, rests: dict[int, float]) -> tuple[Array, Array]:
        """Return the state where slips in space have come to rest."""
        now, until = self.now, max(rests.values()) if self.stretches else self.now.t
        behind = stops.stopped(now, rests, until - now.t, y, z)
        if until > now.t and self.without is None:
            self._bridge(y, z, until, [*rests])
        now.rests = {*rests}
        return behind

    def _bridge(self, y: Array, z: Array, until: float, which: Collection[int]) -> None:
        """Keep a piece, as short as roundoff of the motion, in which these contacts stick."""
        now = self.now
        modes = tuple(Mode.STICK if k in which else mode for k, mode in enumerate(now.modes))
        at = now.at(now.t, y, z)
        system = self.contacts.mode(modes, at)
        start, h = self._moved(system, at, y, z), until - now.t
        ending = endings(self.contacts, system, 0 * at.slip, now.h)
        ending = {x: e for x, e in ending.items() if system.own_events[x][0] not in which}
        asked = self._asked((system, ending), (now.t, until), h, start, bounces=False)
        run = replace(self.make(*asked), stats={})
        now.t = float(run.t[-1])
        self._keep(Part(run, system, len(run.t), (), now.t, which), asked)
        self._ended(run, system)

    def _system(self, at: Matrices) -> ModeSystem:
        """Return the system of the present mode, unless the method holds nothing that sticks."""
        now = self.now
        stuck = [
            name
            for name, mode in zip(self.contacts.names, now.modes, strict=True)
            if mode is Mode.STICK
        ]
        if stuck and self.without is not None:
            which = f"contact {quoted(stuck)} sticks"
            which = which if len(stuck) == 1 else f"contacts {quoted(stuck)} stick"
            sentence = f"at t = {now.t:g} {which}, which {self.without} does not hold"
            hint = "take Spark, LobattoPair or a Composition of one"
            raise IntegrationError(hinted(sentence, hint), t=now.t)
        system = self.contacts.mode(now.modes, at)
        refuse_space(system, self.contacts, now.t)
        return system

    def finish(self, y: Array, z: Array, stopped: set[int]) -> None:
        """Let the last record be behind a hit that is met at the end of the run."""
        now, last = self.now, self.stretches[-1].whole
        own = last.system.own_events.items()
        hits = [name for name, (_, kind) in own if kind == "hit"]
        is_hit = any(now.t in last.run.events[name].t[-1:] for name in hits)
        if not is_hit or self.status != "done" or self.has_derivative:
            return
        y, z = self.settle(y, z, stopped)
        at = now.at(now.t, y, z)
        system = self._system(at)
        start = self._moved(system, at, y, z)
        asked: Any = system, (now.t, now.t + now.h), now.h, {}, start
        run = replace(self.make(*asked), stats={})
        self._keep(Part(run, system, 1, loads(run, system, self.now), now.t), asked)

    def _ended(self, run: Solution, system: ModeSystem) -> set[int]:
        """Take how a stretch ended; return the contacts whose slip came to zero there."""
        now = self.now
        is_whole = now.t == run.t[-1]
        if run.status != "done":
            self.status, self.ending = run.status, run.message
        for name, event in self.events.items():
            met = int(np.sum(run.events[name].t <= now.t))
            self.met[name] += met
            if event.terminal and met and self.met[name] >= event.terminal and is_whole:
                self.ending = run.message
        return {
            k
            for name, (k, kind) in system.own_events.items()
            if kind == "stop" and now.t in run.events[name].t
        }

    def _asked(
        self,
        ended: tuple[ModeSystem, dict[str, Event]],
        span: tuple[float, float],
        h: float | None,
        start: dict[str, Array],
        *,
        bounces: bool,
    ) -> tuple[Any, ...]:
        """Return the arguments of a stretch of a system with what ends its mode."""
        system, events = ended
        if bounces:
            most = self.window * MOST_HITS
            events |= {name: replace(x, terminal=most) for name, x in system.resets().items()}
        left = {
            name: replace(event, terminal=int(event.terminal) - self.met[name])
            if event.terminal
            else event
            for name, event in self.events.items()
        }
        return system, span, h, {**events, **left}, start

    def _has_window(self, system: ModeSystem, until: float) -> bool:
        """Whether the next stretch goes through hits that the core answers."""
        if self.is_controlled or not self.may_reset or until < self.end or not system.bounces:
            return False
        if not all(self.now.laws.restitution[k] for k in system.bounces.values()):
            return False  # what does not bounce stays
        if self.window:
            return True
        self.window = LEAST  # once by the laws of contacts
        return False

    def _keep(self, whole: Part, asked: Any) -> None:
        """Keep a stretch; where times are given, it is made again with records at these."""
        if self.times is None:
            self.stretches.append(Stretch(whole))
            return
        system = whole.system
        names = None if self.moving is None else self.moving.directions(system)
        own = self.times[(asked[1][0] <= self.times) & (self.times <= self.now.t)]
        kept, times = whole.run, own
        if self.request.has_pullback:  # whose next stretch begins at its end
            times = np.union1d(own, [whole.run.t[-1]])
        if own.size:
            try:
                kept = self.make(*asked, times, names)
            except IntegrationError as error:  # as the run itself
                if error.solution is None:
                    raise
                kept = error.solution
        shares = loads(kept, system, self.now, is_whole=False) if own.size else ()
        count = min(len(kept.t), own.size)
        part = Part(kept, system, count, shares, slides=whole.slides)
        self.stretches.append(Stretch(whole, part))

    def solution(self) -> Solution:
        """Join all stretches."""
        found = joined(self.stretches, self.now, self.accelerated, self.request)
        if self.moving is not None:
            joined_ones: Any = found.tangents  # arrays by state, of all directions
            found = replace(found, tangents=self.moving.named(joined_ones))
        message = "; ".join(filter(None, [self.ending, found.message]))
        tolerances = self.steps.tolerances
        return replace(found, status=self.status, message=message, tolerances=tolerances)

    def _moved(self, system: ModeSystem, at: Matrices, y: Array, z: Array) -> dict[str, Array]:
        """Return the start of a stretch on the constraints of its mode."""
        (first, second), t = system.states, self.now.t
        held = system.stepped(t, y, z, self.now.params)
        start = held.consistent(t, self.request.params, None, **{first: y, second: z})
        off = float(np.abs(start[first] - y).max() / max(at.way, TINY))
        if off > MOVED:
            names = quoted(system.constraints)
            sentence = f"at t = {t:g} the state is {off:.1g} of its size off constraints {names}"
            raise IntegrationError(sentence, t=t)
        return start

    def _limits(self, y: Array, z: Array) -> tuple[float, float | None]:
        """Return where the stretch ends at most, and its step, which short flights shorten."""
        now, shortest = self.now, self.now.shortest_flight(y, z)
        left = self.end - now.t
        slow = stops.slowest(now, now.at(now.t, y, z)) / 2
        if slow < (np.inf if self.is_controlled else FEW * now.h) or self.caution:
            # controlled steps, which grow, do not know the way to rest
            until = slow if self.is_controlled else min(slow, now.h)
            until = min(now.t + until / 4**self.caution, self.end)
            return until, min(self.step or np.inf, until - now.t)
        if not shortest < SHORT * now.h:
            return self.end, self.step and min(self.step, left)
        until = self.end if self.is_controlled else min(self.end, now.t + 2 * shortest)
        return until, min(shortest / PARTS, until - now.t)

    def _differentiate(self, run: Solution, system: ModeSystem) -> None:
        """Take the directions to the end of a stretch, or keep what its pullback needs."""
        ended = ended_by(run, system, self.now)
        if self.moving is not None:
            self.moving = at_end(run, system, ended, self.moving)
        if self.request.has_pullback:
            self.links.append(Link(self.make.adjoint, ended, self.now.impacts, self._before))

    def _go_on(self, run: Solution, begin: float, h: float | None) -> None:
        """Take the step to go on with, and end where the time does not go on."""
        now = self.now
        goes_on = now.t - begin > SAME * EPS * max(abs(begin), abs(self.end))
        self._at_once = 0 if goes_on else self._at_once + 1
        if self._at_once > MOST_AT_ONCE:
            sentence = f"at t = {now.t:g} contacts change without end"
            raise IntegrationError(f"{sentence}: {quoted(self.contacts.names)}", t=now.t)
        if self.is_controlled and run.stats["steps"]:
            sizes: Any = run.stats
            was_shortened = self.step is not None and h is not None and h < self.step
            own = max(sizes["h_next"], self.step or 0.0 if was_shortened else 0.0)
            self.step = now.h = min(own, self.longest)
