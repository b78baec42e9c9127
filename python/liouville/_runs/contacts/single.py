"""A run with contacts, from the arguments of a call."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from liouville._basics.arguments import count
from liouville._basics.progress import Progress, reported
from liouville._methods.control import CONTROLS, LEAST_TOLERANCE, Takes
from liouville._runs.choice import named as method_of
from liouville._runs.choice import runner_of
from liouville._runs.contacts.run import integrate as stretches
from liouville._runs.execute import checked
from liouville._runs.runner import Request
from liouville._runs.tangents import ALPHA
from liouville._solution.solution import Solution
from liouville._systems.events import named

if TYPE_CHECKING:
    from liouville._methods import Method
    from liouville._methods.planner import Plan
    from liouville._systems import Mechanics

#: Arguments that runs with contacts do not take, with their defaults.
WITHOUT = {"is_stored": False}


def integrate(
    system: Mechanics, method: Method | Plan | str, request: Request, progress: Progress
) -> Solution:
    """Integrate a system with contacts, the stretch of one mode after another."""
    for name, default in WITHOUT.items():
        if getattr(request, name) is not default:
            what = "store" if name == "is_stored" else name
            raise TypeError(f"{what}= is not for systems with contacts")
    for name, event in named(request.events).items():
        if event.reset is not None:
            raise TypeError(f"event '{name}' has a reset, which is not for systems with contacts")
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

    with reported(progress, "of time") as report:

        def stretch(
            own: Any, t: Any, h: float | None, events: Any, start: Any, times: Any = None,
            tangents: Any = None,
        ) -> Solution:  # fmt: skip
            control = request.control
            if control is not None and control.h_min is not None:
                least = min(control.h_min, t[1] - t[0] if h is None else h)
                control = replace(control, h_min=least)
            more = Request(
                t=t, h=h, rtol=request.rtol, atol=request.atol, control=control, events=events,
                observe=request.observe, params=request.params, start=start, t_eval=times,
                tangents=tangents,
            )  # fmt: skip
            found = checked(runner_of(own, method, more), more, None)
            if report is not None and len(found.t):
                report(found.t[-1] - steps.t0, steps.t1 - steps.t0)
            return found

        return stretches(system, request, steps, stretch, without)
