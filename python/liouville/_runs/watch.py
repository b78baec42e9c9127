"""Events and given times, which are looked at between the steps of a run."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from itertools import repeat
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics import job as _job
from liouville._basics.errors import hinted
from liouville._solution.points import Points, with_ends
from liouville._systems import Field, Mechanics, SemiExplicit
from liouville._systems.events import AFTER, DIRECTIONS, Event, Impact, Touch, named
from liouville._systems.mechanics.traced import INVARIANT

#: The watch as it crosses the border: the order of the method, the times, and the events.
CoreEvents = tuple[int, np.ndarray | None, list[_job.Event]]

#: Hits accumulate where so many intervals in turn shrink, to this part of the longest.
SHRINKING, SHORT = 4, 1e-2


class Watch:
    """The events and the times asked for.

    Attributes
    ----------
    events : dict of str to Event
        The events by name.
    times : ndarray or None
        The times of the records, where they are given.
    ended_by : dict of int to str
        Of members whose runs an event has ended its name; one run alone is member 0.
    """

    def __init__(self, events: Any, times: Any, span: tuple[float, float], every: int) -> None:
        self.events: Mapping[str, Event] = named(events)
        self._resets = frozenset(
            name for name, event in self.events.items() if event.reset is not None
        )
        if span[1] < span[0]:
            _check_invertible(self.events)
        self.times = given(times, span, every)
        self._hits: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.ended_by: dict[int, str] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Leave the functions behind: the core has them as tapes."""
        events = dict.fromkeys(self.events)
        own = {"events": events, "times": self.times, "_resets": self._resets}
        return {**own, "_hits": {}, "ended_by": {}}

    def to_core(
        self,
        system: Mechanics | SemiExplicit | Field,
        order: int,
        switches: Mapping[str, _core.Tape],
        is_differentiated: bool = False,
    ) -> CoreEvents | None:
        """Return the watch for the core, if anything is looked at; switches come last."""
        if not self.events and not switches and self.times is None:
            return None
        events: list[_job.Event] = []
        if is_differentiated:
            # imported here: few runs are differentiated
            from liouville._systems.derivatives.event_slopes import event_slopes, switch_slopes
        for name, event in self.events.items():
            tape, needs_lam, reset = system.event(name, event)
            way, terminal = DIRECTIONS[event.direction], int(event.terminal)
            slopes = None
            if is_differentiated and isinstance(system, Mechanics | SemiExplicit):
                slopes = event_slopes(system, name, event)
            touch = event.size if isinstance(event, Touch) else 0.0
            events.append((tape, way, terminal, touch, needs_lam, reset, False, slopes))
        for name, tape in switches.items():
            slopes = None
            if is_differentiated and isinstance(system, Mechanics):
                slopes = switch_slopes(system, name)
            events.append((tape, 0, 0, 0.0, False, None, True, slopes))
        return order, self.times, events

    def events_of(
        self,
        run: _core.Run,
        system: Mechanics | SemiExplicit | Field,
        params: np.ndarray,
        more: int = 0,
    ) -> tuple[dict[str, Points], dict[int, str], dict[str, tuple[np.ndarray, np.ndarray | None]]]:
        """Return the events by name, and which of them ended the run of which member.

        Of an ensemble, `params` has a row for each member, or one for all. Behind each state there
        may be `more` numbers, which come last: at all events of a name, before and after, with the
        members of an ensemble that met them.
        """
        found, ends = run.events()
        points: dict[str, Points] = {}
        rest: dict[str, tuple[np.ndarray, np.ndarray | None]] = {}
        width = sum(len(names) for names in system.places.values())
        none = np.empty(0), np.empty(0), np.empty(0, dtype=np.int64)
        unmet: dict[int, tuple[Any, Any]] = {}  # of events that were not met, by their sides
        # where no member could begin, the core has seen no event
        for name, (times, rows, members) in zip(self.events, found or repeat(none), strict=False):
            count = 1 + (name in self._resets)
            if not times.size and count in unmet:
                points[name], rest[name] = unmet[count]
                continue
            sides = rows.reshape(times.size, count, width + more)
            rest[name] = sides[..., width:], members if params.ndim > 1 else None
            sides = sides[..., :width]
            states = {"member": members} if params.ndim > 1 else {}
            for side, end in enumerate(("", AFTER)[:count]):
                at = _states_at(system, times, sides[:, side], params, members)
                states = {f"{state}{end}": x for state, x in at.items()} | states
            points[name] = Points(times, states)
            self._hits[name] = times, members
            if not times.size:
                unmet[count] = points[name], rest[name]
        names = [*self.events]
        said = {member: sentence_of_end(names[which], t, limit) for which, t, limit, member in ends}
        self.ended_by = {member: names[which] for which, _, _, member in ends}
        return points, said, rest

    def accumulated(self, name: str, t: float, member: int) -> float | None:
        """Return where the hits of an event until t accumulate, None if they do not."""
        times, members = self._hits.get(name, (np.empty(0), np.empty(0)))
        hits = times[members == member] if members.size else times  # of one run alone
        intervals = np.abs(np.diff(hits[np.abs(hits - hits[:1]) <= np.abs(t - hits[:1])]))
        last = intervals[-SHRINKING:]
        if len(last) < SHRINKING or (np.diff(last) >= 0).any() or last[-1] > SHORT * max(intervals):
            return None
        ratio = last[-1] / last[-2]
        return float(t + np.copysign(ratio / (1 - ratio) * last[-1], t - hits[0]))


def initial_of(
    rows: np.ndarray, widths: Mapping[str, int], invariants: Collection[str], is_ensemble: bool
) -> dict[str, Any]:
    """Name the invariants at a start, of an ensemble those of all members, in rows of records."""
    parts = np.split(rows, np.cumsum([*widths.values()])[:-1], axis=1)
    found = dict(zip(widths, parts, strict=True))
    each = {name: found[INVARIANT + name][:, 0] for name in invariants}
    return each if is_ensemble else {name: float(x[0]) for name, x in each.items()}


def _states_at(
    system: Mechanics | SemiExplicit | Field,
    times: np.ndarray,
    rows: np.ndarray,
    params: np.ndarray,
    members: np.ndarray,
) -> dict[str, np.ndarray]:
    """Name all states at points of one member after another."""
    rows = np.ascontiguousarray(rows)
    if params.ndim == 1 or len(params) == 1:
        return system.states_at(times, rows, params.reshape(-1))
    cuts = np.flatnonzero(np.diff(members)) + 1
    parts = [
        system.states_at(t, np.ascontiguousarray(x), params[own[0]] if own.size else params[0])
        for t, x, own in zip(
            np.split(times, cuts), np.split(rows, cuts), np.split(members, cuts), strict=True
        )
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def sentence_of_end(name: str, t: float, limit: float | None = None) -> str:
    """Say which event ended a run."""
    if limit is None:
        return f"event '{name}' at t = {t:.6g}"
    if math.isnan(limit):
        return (
            f"the hits of '{name}' follow one another so fast at t = {t:.6g} that they can hardly "
            "be told apart, and the run ends with the last of them"
        )
    return (
        f"the hits of '{name}' accumulate at t = {limit:.6g}, and the run ends with the last that "
        "can be told apart: from there on the motion stays on it, which another model describes"
    )


def _check_invertible(events: Mapping[str, Event]) -> None:
    """Refuse resets that a run back in time would have to undo."""
    for name, event in events.items():
        reset = event.reset
        if reset is not None and not (isinstance(reset, Impact) and reset.is_elastic):
            sentence = f"event '{name}' has a reset, and the run goes back in time"
            hint = "only reset=lv.Impact(1.0), without loss, undoes itself: run forwards"
            raise ValueError(hinted(sentence, hint))


def given(times: Any, span: tuple[float, float], every: int) -> np.ndarray | None:
    """Return the times of the records of a run, None where they are not given."""
    if times is None:
        return None
    if every != 1:
        raise ValueError("give either every= or t_eval=: both say which states to keep")
    return within(times, *span)


def within(times: Any, t0: float, t1: float) -> np.ndarray:
    """Return times of a run as an array: in its order, from its start to its end at most."""
    try:
        array = np.asarray(times)
    except ValueError:  # ragged
        array = np.array(None)
    if array.dtype.kind not in "iuf" or array.ndim != 1:
        raise TypeError(f"t_eval must be a sequence of numbers, not {times!r}")
    if not array.size:
        raise ValueError("t_eval must have one time at least")
    array = with_ends(array.astype(float), t0, t1)
    way = np.sign(t1 - t0)
    if not np.isfinite(array).all() or (way * np.diff(array) <= 0).any():
        hint = "np.unique(t_eval) sorts times" + ("" if way > 0 else "; [::-1] turns them around")
        raise ValueError(hinted("t_eval must be finite times in the order of the run", hint))
    outside = array[(way * (array - t0) < 0) | (way * (array - t1) > 0)]
    if outside.size:
        raise ValueError(f"t_eval must be within t = ({t0:g}, {t1:g}), not {outside[0]:.16g}")
    return array
