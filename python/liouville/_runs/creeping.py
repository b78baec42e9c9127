"""Runs whose steps creep along a jump of the equations, where the motion sticks.

The force of a `sign(v)` has no value at which a body stays at rest. Steps by errors then shrink
until each passes the jump there and back within the tolerance: millions of them lead nowhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core

if TYPE_CHECKING:
    from liouville._runs.runner import Runner

#: Steps that creep are at most this part of the longest one of the run, and ...
SHORT = 1e-3
#: ... at least so many more of them lead to its end.
MANY = 1e4
#: So many steps are looked at one by one, ...
LOOKED = 16
#: ... and all of them are at the same jump as often as this, slices of time apart.
TIMES = 2


class Creep:
    """Looks between the slices of a run by controlled steps whether it creeps.

    Attributes
    ----------
    stop : int or None
        Where the next slice ends at the latest.
    """

    def __init__(self, run: _core.Run, runner: Runner) -> None:
        self.stop: int | None = None
        self._runner, self._at = runner, (run.done, run.t)
        self._places: list[tuple[float, np.ndarray]] = []
        self._seen: list[str] = []

    def failure(self, run: _core.Run) -> dict[str, Any] | None:
        """Return the error of a run that creeps; None as long as it may get on."""
        if self.stop is None:
            if self._is_slow(run):
                self._look(run)
            return None
        self._look(run)
        if len(self._places) <= LOOKED:
            return None
        name, self.stop = self._runner.jump_along(self._places), None
        h = abs(self._places[-1][0] - self._places[0][0]) / LOOKED
        self._places, self._at = [], (run.done, run.t)
        self._seen = [*self._seen, name] if name and {*self._seen} <= {name} else []
        if len(self._seen) < TIMES:
            return None
        return {"kind": "creeps", "step": run.done, "start": run.t, "h": h, "jump": name}

    def _is_slow(self, run: _core.Run) -> bool:
        """Whether the last slice was of steps too short to reach the end by."""
        (done, t), self._at = self._at, (run.done, run.t)
        steps, way, left = run.done - done, abs(run.t - t), abs(self._runner.steps.t1 - run.t)
        is_short = way <= SHORT * steps * run.stats.get("h_largest", 0.0)
        return steps >= LOOKED and is_short and left * steps >= MANY * way

    def _look(self, run: _core.Run) -> None:
        place = run.place()
        if place is None:
            self._places, self.stop = [], None
            return
        self._places.append((run.t, place))
        self.stop = run.done + 1
