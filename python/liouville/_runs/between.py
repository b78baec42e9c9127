"""States between the steps of a run that is over: ends of parts of its steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from liouville._methods import Method
from liouville._runs.choice import runner_of
from liouville._runs.execute import execute, finished
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request
from liouville._systems import Mechanics, SemiExplicit

#: Times, and both halves of the state, at the ends of the steps of a piece of a run.
Piece = tuple[np.ndarray, ...]

#: A run of which the start alone is wanted has this length, or this part of its time.
SHORT = 1e-9


def between(
    system: Mechanics | SemiExplicit,
    method: Method,
    known: tuple[Sequence[Piece], Mapping[str, Mapping[float, np.ndarray]]],
    times: np.ndarray,
    params: Mapping[str, Any],
) -> list[dict[str, np.ndarray]]:
    """Return the states at times within a run, of which the ends of all steps are known.

    They are those of one piece of the run after another, the times in the order of the run, none of
    them twice; at the end of a piece the next one counts. Each is made by a step of the method from
    the last end of a step before it, with what the method carries there, by name and time. Those
    of one run of parts after another are returned.

    Raises
    ------
    IntegrationError
        A part of a step cannot be made.
    KeyboardInterrupt
        It was cut short.
    """
    run, carried = known
    way = 1 if run[0][0][0] <= run[-1][0][-1] else -1
    ends = np.searchsorted(way * times, [way * piece[0][-1] for piece in run[:-1]])
    starts: list[tuple[Any, ...]] = []
    parts: list[tuple[float, float, int]] = []
    for (t, y, z), some in zip(run, np.split(times, ends), strict=True):
        knots = np.searchsorted(way * t, way * some, side="right") - 1
        for k, first, count in zip(
            *np.unique(knots, return_index=True, return_counts=True), strict=True
        ):
            t0, end = float(t[k]), float(some[first + count - 1])
            if end == t0:
                end += way * SHORT * max(abs(t0), 1.0)
            elif way * (t0 + (end - t0)) < way * end:  # the sum of start and length is rounded
                end = float(np.nextafter(end, way * np.inf))
            more = [values[t0] for values in carried.values() if t0 in values]
            starts.append((y[k], z[k], *more))
            parts.append((t0, end, int(count)))
    # what the method carries is known at the ends of steps, and not behind resets
    found, place = [], 0
    for _, group in groupby(range(len(parts)), key=lambda k: len(starts[k])):
        own = list(group)
        rows = [np.stack(x) for x in zip(*(starts[k] for k in own), strict=True)]
        (t0, end, _), inside = parts[own[0]], sum(parts[k][2] for k in own)
        some = times[place : place + inside]
        start = dict(zip((*system.states, *carried), (x[0] for x in rows), strict=False))
        request = Request(t=(t0, end), steps=1, params=params, start=start)
        runner = runner_of(system, method, request)
        assert isinstance(runner, TracedRunner), "of a mechanical or semi-explicit system"
        runner.take_parts(tuple(rows), [parts[k] for k in own], some)
        found.append(finished(execute(runner)).states)
        place += inside
    return found
