"""States between the steps of a run that is over: ends of parts of its steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from liouville.methods import Method
from liouville.runners import Request, runner_of
from liouville.runners.execute import execute
from liouville.systems import Mechanics, SemiExplicit

#: Times, and both halves of the state, at the ends of the steps of a piece of a run.
Piece = tuple[np.ndarray, np.ndarray, np.ndarray]

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
    of one step after another are returned.

    Raises
    ------
    IntegrationError
        A part of a step cannot be made.
    """
    run, carried = known
    way = 1 if run[0][0][0] <= run[-1][0][-1] else -1
    ends = np.searchsorted(way * times, [way * piece[0][-1] for piece in run[:-1]])
    found = []
    for (t, y, z), some in zip(run, np.split(times, ends), strict=True):
        knots = np.searchsorted(way * t, way * some, side="right") - 1
        for k in np.unique(knots):
            inside, t0 = some[knots == k], float(t[k])
            end = float(inside[-1])
            if end == t0:
                end += way * SHORT * max(abs(t0), 1.0)
            start = dict(zip(system.states, (y[k], z[k]), strict=True))
            start |= {name: values[t0] for name, values in carried.items() if t0 in values}
            request = Request(t=(t0, end), steps=1, t_eval=inside, params=params, start=start)
            found.append(execute(runner_of(system, method, request)).states)
    return found
