"""Events and given times, which are looked at between the steps of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville import _core
from liouville.errors import hinted
from liouville.events import DIRECTIONS, Event, named
from liouville.points import Points
from liouville.systems import Mechanics, SemiExplicit

#: The watch as it crosses the border: the order of the method, the times, and for each event its
#: tape, its direction, how many end the run, and whether it needs multipliers.
Crossed = tuple[int, np.ndarray | None, list[tuple[_core.Tape, int, int, bool]]]


class Watch:
    """The events and the times asked for.

    Attributes
    ----------
    events : dict of str to Event
        The events by name.
    times : ndarray or None
        The times of the records, where they are given.
    """

    def __init__(self, events: Any, times: Any, span: tuple[float, float], every: int) -> None:
        self.events: Mapping[str, Event] = named(events)
        self.times = None if times is None else within(times, *span)
        if times is not None and every != 1:
            raise ValueError("give either every= or t_eval=: both say which states to keep")

    def __getstate__(self) -> dict[str, Any]:
        """Leave the functions behind: the core has them as tapes."""
        return {"events": dict.fromkeys(self.events), "times": self.times}

    def crossed(self, system: Mechanics | SemiExplicit, order: int) -> Crossed | None:
        """Return the watch for the core, if anything is looked at."""
        if not self.events and self.times is None:
            return None
        events = []
        for name, event in self.events.items():
            tape, needs_lam = system.event(name, event.function)
            events.append((tape, DIRECTIONS[event.direction], int(event.terminal), needs_lam))
        return order, self.times, events

    def events_of(
        self, run: _core.Run, system: Mechanics | SemiExplicit, params: np.ndarray
    ) -> tuple[dict[str, Points], str]:
        """Return the events by name, and which of them ended the run."""
        found, end = run.events()
        points = {}
        for name, (times, rows) in zip(self.events, found, strict=False):
            width = sum(len(names) for names in system.places.values())
            states = system.states_at(times, rows.reshape(-1, width), params)
            points[name] = Points(times, states)
        if end is None:
            return points, ""
        which, t = end
        return points, f"event '{[*self.events][which]}' at t = {t:.6g}"


def within(times: Any, t0: float, t1: float) -> np.ndarray:
    """Return times of a run as an array: in its order, from its start to its end at most."""
    try:
        array = np.asarray(times)
    except ValueError:  # ragged
        array = np.array(None)
    if array.dtype.kind not in "iuf" or array.ndim != 1:
        raise TypeError(f"t_eval is a sequence of numbers, not {times!r}")
    if not array.size:
        raise ValueError("t_eval has no times")
    array = array.astype(float)
    way = np.sign(t1 - t0)
    if not np.isfinite(array).all() or (way * np.diff(array) <= 0).any():
        hint = "np.unique(t_eval) sorts times" + ("" if way > 0 else "; [::-1] turns them around")
        raise ValueError(hinted("t_eval is finite, and in the order of the run", hint))
    outside = array[(way * (array - t0) < 0) | (way * (array - t1) > 0)]
    if outside.size:
        raise ValueError(f"t_eval has {outside[0]:g}, which is outside t = ({t0:g}, {t1:g})")
    return array
