"""A run with contacts, from the arguments of a call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from liouville._basics.arguments import count
from liouville._basics.errors import IntegrationError, hinted
from liouville._basics.progress import Progress, reported
from liouville._methods.control import CONTROLS, LEAST_TOLERANCE, Takes
from liouville._runs.choice import named as method_of
from liouville._runs.choice import runner_of
from liouville._runs.contacts.run import Course
from liouville._runs.execute import checked, execute
from liouville._runs.runner import Request
from liouville._runs.tangents import ALPHA, PARAMS
from liouville._solution.solution import Solution
from liouville._systems.events import named

if TYPE_CHECKING:
    from liouville._methods import Method
    from liouville._methods.planner import Plan
    from liouville._systems import Mechanics


class Maker:
    """A maker of the stretches of a run, each a run of the system of a mode.

    Parameters
    ----------
    method : Method
        The method.
    request : Request
        What is asked of the whole run.
    report : callable, optional
        It is called with how far a stretch has come.

    Attributes
    ----------
    adjoint : Adjoint
        The transposed derivative of the last stretch, of a run with a pullback.
    """

    def __init__(self, method: Any, request: Request, report: Callable[[float], None]) -> None:
        self._method, self._request, self._report = method, request, report
        self.adjoint: Any = None

    def __call__(
        self,
        own: Mechanics,
        t: tuple[float, float],
        h: float | None,
        events: Any,
        start: Any,
        *more: Any,
    ) -> Solution:
        """Make a stretch of a system from a time to another, with a step, events and a start.

        The step is the first of controlled ones, None where the method chooses it. `more` are the
        times of its records, and directions, where they are given.
        """
        request, (times, tangents) = self._request, (*more, None, None)[:2]
        control = request.control
        if control is not None and control.h_min is not None:
            least = min(control.h_min, t[1] - t[0] if h is None else h)
            control = replace(control, h_min=least)
        asked = Request(
            t=t, h=h, rtol=request.rtol, atol=request.atol, control=control, events=events,
            observe=request.observe, params=request.params, start=start, t_eval=times,
            tangents=tangents, has_pullback=request.has_pullback,
        )  # fmt: skip
        runner = runner_of(own, self._method, asked)
        if request.has_pullback:
            names = [f"{PARAMS}{name}" for name in own.params]
            self.adjoint = runner.adjoint(asked, [*own.states, "t0", *names])
            found = execute(self.adjoint.runner, None, self.adjoint.checkpoints)
        else:
            found = checked(runner, asked, None)
        if len(found.t):
            self._report(float(found.t[-1]))
        return found


def integrate(
    system: Mechanics, method: Method | Plan | str, request: Request, progress: Progress
) -> Solution:
    """Integrate a system with contacts, the stretch of one mode after another."""
    return course(system, method, request, progress).solution()


def course(
    system: Mechanics, method: Method | Plan | str, request: Request, progress: Progress
) -> Course:
    """Run a system with contacts, the stretch of one mode after another."""
    with reported(progress, "of time") as report:

        def come(t: float) -> None:
            if report is not None:
                report(t - own.steps.t0, own.steps.t1 - own.steps.t0)

        own = prepared(system, method, request, come)
        try:
            own.begin()
            while not own.is_over:
                own.go_on()
        except IntegrationError as error:
            own.status, own.ending = "failed", str(error)
            error.solution = own.solution() if own.stretches else None
            raise
        except KeyboardInterrupt:  # between stretches, which answer it themselves
            if not own.stretches:
                raise
            own.status, own.ending = "interrupted", f"interrupted at t = {own.now.t:g}"
        return own


def prepared(
    system: Mechanics,
    method: Method | Plan | str,
    request: Request,
    report: Callable[[float], None],
) -> Course:
    """Return a run before its start; how far each stretch has come is reported."""
    for name, event in named(request.events).items():
        if event.reset is not None:
            raise TypeError(f"event '{name}' has a reset, which is not for systems with contacts")
    if request.is_stored and request.tangents is not None:
        sentence = "tangents= of runs with contacts go without store="
        raise TypeError(hinted(sentence, "leave out one of them"))
    # the runner of the first stretch refuses a control that the method does not take
    steps = request.steps_of(system, Takes(repr(method), CONTROLS, LEAST_TOLERANCE / 100))
    if steps.t1 <= steps.t0:
        raise ValueError("a run with contacts goes forwards in time: what has hit is not undone")
    request.every = count("every", request.every)
    if not isinstance(request.states, bool):
        raise TypeError(f"states must be True or False, not {request.states!r}")
    # the alpha family counts work from each start, and holds nothing that sticks
    used = method_of(system, method, request.rtol)
    without = type(used).__name__ if isinstance(used, ALPHA) else None
    assert system.contacts is not None
    return Course(system.contacts, Maker(method, request, report), request, steps, without)
