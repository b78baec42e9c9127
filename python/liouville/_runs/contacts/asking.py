"""Systems, ends and steps that a run with contacts asks its stretches for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._runs.contacts import flights, stops
from liouville._runs.contacts.bouncing import LEAST, MOST_HITS, WINDOW
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.joined import Records
from liouville._runs.contacts.matrices import Matrices
from liouville._runs.contacts.mode import FEW, ModeSystem
from liouville._runs.contacts.stretch import Link, Stretch
from liouville._runs.contacts.switching import Switching
from liouville._runs.contacts.tangent import Jump, Moving, moving
from liouville._runs.contacts.traced import Contacts
from liouville._runs.watch import given
from liouville._systems.events import Event, named
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._methods.control import Steps
    from liouville._runs.contacts.single import Maker
    from liouville._runs.runner import Request

TINY = float(np.finfo(float).tiny)

#: Flights shorter than so many steps are made with a step of this part of them.
SHORT, PARTS = 3.0, 3
#: A start of a stretch is moved onto its constraints by at most this part of its size.
MOVED = 1e-7
#: Where a method chooses its first step, sizes are those of this part of the whole time.
FIRST = 0.01


class Asking:
    """The state of a run with contacts, and what it asks of the next stretch.

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
        self.without, self.may_reset = without, without is None and not self.has_derivative
        #: How each stretch began and ended, of a run with a pullback.
        self.links: list[Link] = []
        #: What happened at once since the last stretch, of a run that is differentiated.
        self.jumps: list[Jump] = []
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
        #: The first failure of a step that is shortened, and the end of the steps before it.
        self.failure: IntegrationError | None = None
        self.limit = np.inf
        #: So many steps the next stretch through hits goes.
        self.window = WINDOW
        #: The times of the records, where they are given.
        self.times = given(request.t_eval, (start, self.end), request.every)
        self.stretches: list[Stretch] = []
        #: What was taken of the stretches before.
        self.records = Records()
        self.status, self.ending = "done", ""

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
        return self.contacts.mode(now.modes, at, now.t)

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
            return False  # a contact that does not bounce stays closed
        if self.window:
            return True
        self.window = LEAST  # once by the laws of contacts
        return False

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
        now, shortest = self.now, flights.shortest(self.now, y, z)
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
