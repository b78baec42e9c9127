"""Runs with contacts: one smooth stretch after another, each a run of the system of its mode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville.contacts.complementarity import Array
from liouville.contacts.contact import Mode
from liouville.contacts.joined import PENETRATES, Stretch, joined
from liouville.contacts.margin import margin
from liouville.contacts.switching import CLOSED, Switching
from liouville.contacts.traced import Contacts, Matrices, ModeSystem
from liouville.errors import IntegrationError, hinted, quoted
from liouville.events import Event, named

if TYPE_CHECKING:
    from liouville.runners import Request
    from liouville.solution import Solution
    from liouville.systems import Mechanics

    #: Makes a stretch: of a system, from a time to another, with steps, events and a start.
    Make = Callable[
        [ModeSystem, tuple[float, float], float, Mapping[str, Event], Mapping[str, Array]], Solution
    ]

TINY = float(np.finfo(float).tiny)

#: Flights shorter than so many steps are made with a step of this part of them.
SHORT, PARTS = 3.0, 3
#: A start of a stretch is moved onto its constraints by at most this part of its size.
MOVED = 1e-7


def integrate(system: Mechanics, request: Request, h: float, make: Make) -> Solution:
    """Integrate a system with contacts from a checked request, with steps of size h."""
    assert system.contacts is not None
    course = Course(system.contacts, make, request, h)
    y, z = system.start(request.start)
    system.check(course.now.t, y, z, course.now.params)
    course.check(y, z)
    try:
        y, z = course.now.settle(y, z, set())
        while True:
            y, z, stopped = course.advance(y, z)
            if course.is_over:
                return course.solution()
            y, z = course.now.settle(y, z, stopped)
    except IntegrationError as error:
        course.status, course.ending = "failed", str(error)
        error.solution = course.solution() if course.stretches else None
        raise


class Course:
    """A run with contacts as it goes on.

    Parameters
    ----------
    contacts : Contacts
        The contacts of the system.
    make : callable
        ``make(system, t, h, events, start)``, which makes a stretch to the end or to an event.
    request : Request
        What is asked for, its times checked.
    h : float
        The step size.
    """

    def __init__(self, contacts: Contacts, make: Make, request: Request, h: float) -> None:
        self.contacts, self.make, self.request = contacts, make, request
        start, self.end = request.t
        self.now = Switching(contacts, start, h, contacts.system.values(request.params))
        self.events = named(request.events)
        self.stretches: list[Stretch] = []
        self.status, self.ending = "done", ""

    @property
    def is_over(self) -> bool:
        """Whether the run has come to its end."""
        return self.now.t >= self.end or self.status != "done" or bool(self.ending)

    def check(self, y: Array, z: Array) -> None:
        """Refuse a start that penetrates."""
        at = self.now.at(self.now.t, y, z)
        for name, gap, size in zip(self.contacts.names, at.gap, at.size, strict=True):
            if gap < -PENETRATES * size:
                sentence = f"contact '{name}' penetrates by {-gap:.3g} at the start"
                raise ValueError(hinted(sentence, "its gap must not be negative"))

    def advance(self, y: Array, z: Array) -> tuple[Array, Array, set[int]]:
        """Make a stretch; return the state at its end and the contacts whose slip came to zero."""
        now, (first, second) = self.now, self.contacts.system.states
        at = now.at(now.t, y, z)
        system = self.contacts.mode(now.modes, self.contacts.independent(now.modes, at))
        start = self._moved(system, at, y, z)
        events = {name: Event(_recorded, "down", terminal=True) for name in system.own_events}
        until, h = self._limits(at)
        try:
            run = self.make(
                system, (now.t, until), h, {**events, **of_own(self.events, system)}, start
            )
        except IntegrationError as error:
            if error.solution is not None and len(error.solution.t):
                self.stretches.append(Stretch(error.solution, system, len(error.solution.t)))
            raise
        count, now.t = len(run.t), float(run.t[-1])
        y, z = run.states[first][-1].copy(), run.states[second][-1].copy()
        if system.is_shared:
            count, now.t, (y, z) = self._torn(run, (y, z))
        self.stretches.append(Stretch(run, system, count))
        if run.status != "done":
            self.status, self.ending = run.status, run.message
        ends = [name for name, event in self.events.items() if event.terminal]
        if any(now.t in run.events[name].t[-1:] for name in ends):
            self.ending = run.message
        stopped = {
            k
            for name, (k, kind) in system.own_events.items()
            if kind == "stop" and now.t in run.events[name].t
        }
        return y, z, stopped

    def solution(self) -> Solution:
        """Join all stretches."""
        found = joined(self.stretches, self.now, self.request.every)
        message = "; ".join(filter(None, [self.ending, found.message]))
        return replace(found, status=self.status, message=message)

    def _moved(self, system: ModeSystem, at: Matrices, y: Array, z: Array) -> dict[str, Array]:
        """Return the start of a stretch on the constraints of its mode."""
        (first, second), t = system.states, self.now.t
        start = system.consistent(t, self.request.params, None, **{first: y, second: z})
        off = float(np.abs(start[first] - y).max() / max(at.way, TINY))
        if off > MOVED:
            names = quoted(system.constraints)
            sentence = f"at t = {t:g} the state is {off:.1g} of its size off constraints {names}"
            raise IntegrationError(sentence, t=t)
        return start

    def _limits(self, at: Matrices) -> tuple[float, float]:
        """Return where the stretch ends at most, and its step, which short flights shorten."""
        now, shortest = self.now, np.inf
        for k, mode in enumerate(now.modes):
            rate, fall = at.rate[k], now.lifts[k]
            if mode is Mode.OPEN and at.gap[k] <= CLOSED * at.size[k] and rate > 0 > fall:
                shortest = min(shortest, 2 * rate / -fall)
        if shortest < SHORT * now.h:
            return min(self.end, now.t + 2 * shortest), shortest / PARTS
        return self.end, now.h

    def _torn(
        self, run: Solution, end: tuple[Array, Array]
    ) -> tuple[int, float, tuple[Array, Array]]:
        """Return how many records a mode of shared forces lasts, when and where it gives way."""
        first, second = self.contacts.system.states
        modes = self.now.modes

        def left(t: float, y: Array, z: Array) -> float:
            return margin(self.contacts, self.now.at(t, y, z), modes)

        def at(t: float) -> tuple[Array, Array]:
            found = run(t)
            return found.states[first], found.states[second]

        rows = zip(run.t, run.states[first], run.states[second], strict=True)
        below = [k for k, row in enumerate(rows) if k and left(float(row[0]), *row[1:]) < 0]
        if not below:
            return len(run.t), float(run.t[-1]), end
        low, high = float(run.t[below[0] - 1]), float(run.t[below[0]])
        while low < (middle := low + (high - low) / 2) < high:
            if left(middle, *at(middle)) < 0:
                high = middle
            else:
                low = middle
        return below[0], high, at(high)


def _recorded(*args: Any) -> Any:
    """Stand for the function of an event whose tape a mode has."""
    raise AssertionError("the tapes of a mode are recorded")


def of_own(events: Mapping[str, Event], system: ModeSystem) -> dict[str, Event]:
    """Return a user's events for a mode, whose functions see the system's own multipliers."""
    own = system.own.tolist()

    def seen(function: Callable[..., Any]) -> Callable[..., Any]:
        def value(t: Any, y: Any, z: Any, lam: Any, params: Any) -> Any:
            return function(t, y, z, lam[own], params)

        return value

    return {name: replace(event, function=seen(event.function)) for name, event in events.items()}
