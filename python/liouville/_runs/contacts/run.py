"""Runs with contacts: one smooth stretch after another, each a run of the system of its mode."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._runs.contacts import stops
from liouville._runs.contacts.asking import Asking
from liouville._runs.contacts.bouncing import LEAST, Bounced, bounced
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.margin import loads, torn
from liouville._runs.contacts.matrices import AT_REST, EPS
from liouville._runs.contacts.mode import ModeSystem, endings
from liouville._runs.contacts.stretch import Link, Part, Stretch, check, check_start
from liouville._runs.contacts.tangent import DIFFERENCE, Jump, at_end, ended_by
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._solution.solution import Solution

#: Times that differ by so many roundings are the same.
SAME = 4
#: A step in which a slip changes too much is shortened so often.
MOST_CAUTION = 12
#: A step that fails is shortened so often.
MOST_TRIES = 5
#: So many steps a stretch has at most: a stored run that is cut off makes its last one again.
LONGEST = 1 << 14
#: So many stretches in turn that do not move the time are said to be without end.
MOST_AT_ONCE = 100


#: What begins to slide with no acceleration is differentiated by differences of this part of the
#: sizes: of what is moved one side sticks.
BEGINNING = 1e-5

#: What a run goes on from, and what follows from the job and the state.
SAVED = (
    "state", "step", "window", "caution", "accelerated", "met", "_at_once", "records",
)  # fmt: skip
DERIVED = ("contacts", "params", "laws", "_last")


class Course(Asking):
    """A run with contacts as it goes on; see :class:`Asking`."""

    @property
    def has_begun(self) -> bool:
        """Whether there is a stretch."""
        return bool(self.stretches) or self.records.last is not None

    @property
    def is_over(self) -> bool:
        """Whether the run has come to its end."""
        return self.now.t >= self.end or self.status != "done" or bool(self.ending)

    def begin(self) -> None:
        """Take the start, and choose the first mode."""
        system, now = self.contacts.system, self.now
        y, z = system.start(self.request.start)
        system.check(now.t, y, z, now.params)
        check_start(now, y, z)
        self.state = self.settle(y, z, set())
        #: What each contact does at the start.
        self.first_modes = now.modes

    def go_on(self) -> None:
        """Make a stretch, and the change at its end."""
        y, z, stopped = self.advance(*self.state)
        if self.is_over:
            self.finish(y, z, stopped)
        else:
            self.state = self.settle(y, z, stopped)

    def settle(self, y: Array, z: Array, stopped: set[int]) -> tuple[Array, Array]:
        """Make impacts, and choose the mode that goes on; directions go through them too."""
        found = self.now.settle(y, z, stopped)
        if self.has_derivative and self.now.impacts:
            self._jump(Jump.of_impacts(self.now, y, z))
        return found

    def _jump(self, jump: Jump) -> None:
        """Take directions through what happens at once."""
        self.jumps.append(jump)
        if self.moving is not None:
            self.moving = jump.through(self.moving)

    def advance(self, y: Array, z: Array) -> tuple[Array, Array, set[int]]:
        """Make a stretch; return the state at its end and the contacts whose slip came to zero."""
        now = self.now
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
        if h is not None:
            until = min(until, now.t + (self.window if bounces else LONGEST) * h)
        until, self.limit = min(until, self.limit), np.inf
        ending = endings(self.contacts, system, AT_REST * at.sizes[now.c :], now.h)
        asked = self._asked((system, ending), (now.t, until), h, start, bounces=bounces)
        found = self._made(asked, bounces=bounces)
        if found is None:
            return self.advance(y, z)
        last = stops.turned(found.run, system, self.contacts, now.params)
        if last and self.has_derivative:  # which is that at the end of a run
            end = float(found.run.t[last])
            part = system, (begin, end), (end - begin) / last, *asked[3:]
            found = self._made(part, bounces=False)
            assert found is not None
            last = None
        if last == 0 and self.caution < MOST_CAUTION:
            self.caution += 1
            return self.advance(y, z)
        self.caution = 0
        y, z = self._come(found, last or len(found.run.t) - 1, asked)
        if self.has_derivative:
            self._differentiate(found.run, system)
        self._go_on(found.run, begin, h)
        return y, z, self._ended(found.run, system)

    def _made(self, asked: Any, *, bounces: bool) -> Bounced | None:
        """Return a stretch, as far as it counts; None where hits are left to the laws."""
        system, now = asked[0], self.now
        names = None if self.moving is None else self.moving.directions(system)
        try:
            run = self.make(*asked, None, names)
        except IntegrationError as error:
            if bounces:  # of a part that may not count
                self.window = 0
                return None
            if self._is_shortened(error):
                return None
            error = self.failure or error
            if error.solution is not None and len(error.solution.t):
                run = error.solution
                now.t = float(run.t[-1])
                whole = Part(run, system, len(run.t), loads(run, system, self.now), now.t)
                self._keep(whole, asked)
            raise error from None
        found = Bounced(run, len(run.t), None, [])
        if bounces:
            until = asked[1][1], self.request.observe
            found = bounced(run, system, now, self.accelerated, until)
            longer = min(2 * self.window, self.steps.count, LONGEST)
            self.window = longer if found.end is None else max(LEAST, self.window // 2)
        wrong = check(found.run, system, now, self.accelerated, found.count)
        if wrong is not None and not bounces:
            raise wrong
        self.window = 0 if wrong is not None else self.window
        self.failure = None
        return found if wrong is None else None

    def _is_shortened(self, error: IntegrationError) -> bool:
        """Whether a stretch is made again, shorter: behind its end a mode may not go on."""
        if self.is_controlled or self.has_derivative or self.caution >= MOST_TRIES:
            return False
        if error.solution is not None and len(error.solution.t) > 1:
            self.limit = float(error.solution.t[-1])
        else:
            self.failure, self.caution = self.failure or error, self.caution + 1
        return True

    def _come(self, found: Bounced, last: int, asked: Any) -> tuple[Array, Array]:
        """Keep a stretch until its last record that counts; return the state there."""
        now, run, system = self.now, found.run, asked[0]
        now.t, count = float(run.t[last]), min(found.count, last + 1)
        y, z = (run.states[name][last].copy() for name in system.states)
        forces = loads(run, system, now)
        if len(forces) > 1 and forces[-1].gives_way:
            count = len(forces) - 1
            now.t, (y, z) = torn(run, count, now)
            if self.has_derivative:
                sentence = f"contacts that share a load give way at t = {now.t:g}"
                hint = "derivatives do not go through that"
                raise IntegrationError(hinted(sentence, hint), t=now.t)
        if found.end is not None:
            now.t, y, z = found.end
        self._keep(Part(run, system, count, forces, now.t), asked)
        for k, change in found.changes:
            now.add_hit(k, change)
        return y, z

    def _begin(self, y: Array, z: Array, which: list[int]) -> tuple[Array, Array]:
        """Return the state behind the first bit of sliding in space, with a record before it."""
        now, t = self.now, self.now.t
        if self.without is not None:
            names = quoted([self.contacts.names[k] for k in which])
            sentence = f"at t = {t:g} contact {names} slides from rest in space"
            raise IntegrationError(f"{sentence}, which {self.without} does not begin", t=t)
        d = stops.begun(now, which, (t, y, z))[0]

        def path(part: float) -> tuple[float, Array, Array]:
            return t + part * d, *stops.begun(now, which, (t, y, z), part * d)[1:]

        jump = None
        if self.has_derivative:
            part = DIFFERENCE if d <= stops.FIRST * now.h else BEGINNING
            jump = Jump(now, y, z, stops.map_of_start(now, which, d), part)
        self._bridge(path, t + d, which)
        _, y, z = path(min((now.t - t) / d, 1.0))
        if self.is_over:
            return y, z
        if jump is not None:
            self._jump(jump)
        return self.settle(y, z, set())

    def _stop(self, y: Array, z: Array, rests: dict[int, float]) -> tuple[Array, Array]:
        """Return the state where slips in space have come to rest."""
        now, until = self.now, max(rests.values()) if self.has_begun else self.now.t
        t, behind = now.t, stops.stopped(now, rests, until - now.t, y, z)

        def path(part: float) -> tuple[float, Array, Array]:
            first, second = behind
            return t + part * (until - t), y + part * (first - y), z + part * (second - z)

        jump = None
        if self.has_derivative:
            if len(rests) > 1:
                names = quoted([self.contacts.names[k] for k in rests])
                sentence = f"contacts {names} come to rest at one time, t = {now.t:g}"
                hint = "which is first depends on the direction: the run has no derivative there"
                raise IntegrationError(hinted(sentence, hint), t=now.t)
            jump = Jump(now, y, z, stops.map_of_stop(now, next(iter(rests)), y, z))
        if until > now.t and self.without is None:
            self._bridge(path, until, [*rests], is_stop=True)
        if jump is not None:
            self._jump(jump)
        now.rests = {*rests}
        return behind

    def _bridge(
        self, path: stops.Path, until: float, which: Collection[int], *, is_stop: bool = False
    ) -> None:
        """Keep a piece, as short as roundoff of the motion, in which these contacts stick."""
        now, (_, y, z) = self.now, path(0.0)
        modes = tuple(Mode.STICK if k in which else mode for k, mode in enumerate(now.modes))
        at = now.at(now.t, y, z)
        system = self.contacts.mode(modes, at, now.t)
        start, h = self._moved(system, at, y, z), until - now.t
        ending = endings(self.contacts, system, 0 * at.slip, now.h)
        ending = {x: e for x, e in ending.items() if system.own_events[x][0] not in which}
        asked = self._asked((system, ending), (now.t, until), h, start, bounces=False)
        names = None if self.moving is None else self.moving.directions(system)
        run = self.make(*asked, None, names)
        if not self.request.has_pullback:
            run = replace(run, stats={})
        now.t = float(run.t[-1])
        with_more = stops.passed(run, system, self.events, path, now.params)
        if self.request.has_pullback and with_more is not run:
            slow = quoted([self.contacts.names[k] for k in which])
            sentence = f"at t = {now.t:g} an event is met where the slip of contact {slow} is zero"
            raise IntegrationError(hinted(sentence, "it has no derivative there"), t=now.t)
        run = with_more
        self._keep(Part(run, system, len(run.t), (), now.t, which, is_stop), asked)
        if self.request.has_pullback:
            self._link(None, is_bit=True)
        self._ended(run, system)

    def finish(self, y: Array, z: Array, stopped: set[int]) -> None:
        """Let the last record be behind a change that is met at the end of the run."""
        now, last = self.now, self.stretches[-1].whole
        own, met = last.system.own_events.items(), last.run.events
        changes = [name for name, (_, kind) in own if kind != "slow" and name in met]
        is_met = any(now.t in met[name].t[-1:] for name in changes)
        if not is_met or self.status != "done" or self.has_derivative:
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
        now.gave_way = system.ended(run, now.t, ("leave", "tear"))
        return system.ended(run, now.t, ("stop",))

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

    def solution(self, *, goes_on: bool = False) -> Solution:
        """Join the stretches that were not taken yet."""
        found = self.records.joined(self.stretches, self.now, self.request, goes_on=goes_on)
        if self.moving is not None:
            joined_ones: Any = found.tangents  # arrays by state, of all directions
            found = replace(found, tangents=self.moving.named(joined_ones))
        message = "; ".join(filter(None, [self.ending, found.message]))
        tolerances = self.steps.tolerances
        return replace(found, status=self.status, message=message, tolerances=tolerances)

    @property
    def may_part(self) -> bool:
        """Whether records may be taken here, and the run saved: between two stretches."""
        now = self.now
        return not (self.is_over or stops.stopping(now, now.at(now.t, *self.state)))

    def taken(self) -> Solution:
        """Take the records of the stretches so far, where the run goes on."""
        found = self.solution(goes_on=True)
        self.stretches = []
        for own in self.now.changes:
            del own[:-1]
        self.records.told = [len(own) for own in self.now.changes]
        return found

    def saved(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return all that the run goes on from, once its stretches were taken."""
        own = {name: getattr(self, name) for name in SAVED}
        kept = {name: x for name, x in vars(self.now).items() if name not in DERIVED}
        return own, kept

    def restore(self, saved: tuple[dict[str, Any], dict[str, Any]]) -> None:
        """Go back to where the run was saved."""
        for into, own in zip((self, self.now), saved, strict=True):
            vars(into).update(own)

    def _differentiate(self, run: Solution, system: ModeSystem) -> None:
        """Take the directions to the end of a stretch, or keep what its pullback needs."""
        ended = ended_by(run, system, self.now)
        if self.moving is not None:
            self.moving = at_end(run, system, ended, self.moving)
        if self.request.has_pullback:
            self._link(ended)

    def _link(self, ended: str | None, *, is_bit: bool = False) -> None:
        """Keep what the pullback of a stretch needs."""
        self.links.append(Link(self.make.adjoint, ended, self.jumps, is_bit))
        self.jumps = []

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
