"""Runs whose controlled steps are those of another, whatever their start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liouville._runs.edges import MET
from liouville._runs.execute import Checkpoints, execute, finished
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request
from liouville._solution.chain_rule import ended
from liouville._solution.solution import Solution


class HeldSteps:
    """The steps of a controlled run, which other starts and parameters may take.

    Where a step ends at a switch, or an event begins it anew, it does so wherever that is met in
    the other run; the next end is held again.

    Attributes
    ----------
    ends : ndarray
        The times between the steps, without those at switches.
    """

    def __init__(self, runner: TracedRunner, request: Request) -> None:
        # with the pullback, whose errors the steps follow too
        whole = replace(request, every=1, t_eval=None, tangents=None, has_pullback=True)
        self._kind, self._of = type(runner), (runner.system, runner.choice)
        own = self._kind(*self._of, whole)
        made = finished(execute(own, checkpoints=Checkpoints(None)))
        values = np.abs(at_switches(own, made, own._values))
        is_zero = values <= MET * values.max(axis=0, initial=0.0)
        is_met = (is_zero[1:-1] & ~is_zero[:-2]).any(axis=1)
        self.ends = made.t[np.concatenate([[True], ~is_met, [True]])]
        if ended(made):  # the event may be met later, in a step of which a part was made
            self.ends[-1] += self.ends[-1] - self.ends[-2]

    def runner(self, request: Request) -> TracedRunner:
        """Return the runner of a request with another start and parameters."""
        own = self._kind(*self._of, request)
        own.hold(self.ends)
        return own


def at_switches(runner: TracedRunner, run: Solution, values: np.ndarray) -> np.ndarray:
    """Return the functions at whose zeros steps end, at records, shape (k, s)."""
    points = [run.t[:, None], *(run.states[name] for name in runner.system.states)]
    args = [np.ascontiguousarray(x) for x in points]
    found = [np.empty((len(run.t), 0))]
    for tape in runner.switches.values():  # which do not see multipliers
        found.append(tape.map(values, [*args, np.zeros((len(run.t), tape.inputs[3]))]))
    return np.concatenate(found, axis=1)
