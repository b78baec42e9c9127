"""Events: zeros of a function along a trajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville.errors import hinted

#: Which zeros count: the sign of the change.
DIRECTIONS = {"both": 0, "up": 1, "down": -1}


@dataclass(frozen=True)
class Event:
    r"""A function :math:`e(t, q, v, \lambda)` whose changes of sign along a run are wanted.

    Parameters
    ----------
    function : callable
        ``function(t, q, v, lam, params)``, a scalar; called once with CasADi symbols. ``q`` and
        ``v`` are the system's own states: ``q`` and ``p`` of a ``Hamiltonian``, ``y`` and ``z`` of
        a ``Mechanical``. The multipliers are solved for only where it uses them. Of a
        ``SemiExplicit`` system, whose z takes their place, ``function(t, y, z, params)``.
    direction : {"both", "up", "down"}
        Whether :math:`e` must grow or fall where it changes its sign, in the order of the run:
        one that goes backwards in time passes it the other way.
    terminal : bool or int, default False
        Whether the event ends the run, or how many of it do.

    Raises
    ------
    TypeError, ValueError
        One of the three is no such thing.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> lowest = lv.Event(lambda t, q, v, lam, params: q[0], direction="up", terminal=2)
    >>> run = lv.integrate(
    ...     pendulum.system, lv.Spark(4), t=(0, 9), h=0.1, events={"lowest": lowest},
    ...     **pendulum.start
    ... )
    >>> len(run.events["lowest"])
    2
    >>> run.message
    "event 'lowest' at t = 4.14372"
    """

    function: Callable[..., Any]
    direction: str = "both"
    terminal: bool | int = False

    def __post_init__(self) -> None:
        """Refuse what is no event."""
        if not callable(self.function):
            raise TypeError(f"function is a function, not {self.function!r}")
        if self.direction not in DIRECTIONS:
            raise ValueError(f"direction is one of {', '.join(DIRECTIONS)}, not {self.direction!r}")
        if not isinstance(self.terminal, (bool, np.bool_, int, np.integer)):
            raise TypeError(f"terminal is True, False or a number, not {self.terminal!r}")
        if self.terminal < 0:
            raise ValueError(f"terminal is at least 1, or False, not {self.terminal}")


def named(events: Any) -> dict[str, Event]:
    """Return events by name, functions as events of default options."""
    if events is None:
        return {}
    if not isinstance(events, Mapping):
        hint = 'name it: events={"name": function}'
        raise TypeError(hinted(f"events is a mapping of names, not {events!r}", hint))
    for name in events:
        if not isinstance(name, str) or not name:
            raise TypeError(f"events is a mapping of names; {name!r} is not a name")
    return {
        name: event if isinstance(event, Event) else _plain(name, event)
        for name, event in events.items()
    }


def _plain(name: str, function: Any) -> Event:
    if not callable(function):
        raise TypeError(f"event '{name}' is an Event or a function, not {function!r}")
    return Event(function)
