"""Refusal of derivatives where a model bends or jumps, of runs with all their steps."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville.methods import Spark
from liouville.parts import pieces
from liouville.runners.edges import Kink, Motion, kink_of
from liouville.runners.execute import execute, finished
from liouville.runners.runner import Request
from liouville.runners.traced import TracedRunner
from liouville.systems._branches import branches

if TYPE_CHECKING:
    from liouville.runners.field import FieldRunner
    from liouville.solution import Solution
    from liouville.tangents import Tangent

#: Numbers that the states of a repeated run may take in memory.
MOST_NUMBERS = 2**25

#: Of the random directions of a pullback; any serves.
SEED = 0


def check_tangents(
    runner: TracedRunner | FieldRunner, request: Request, solution: Solution
) -> None:
    """Refuse tangents of a run, or of its members, that a kink makes wrong.

    Raises
    ------
    IntegrationError
        There is one; the message says where.
    """
    found = branches(runner.system)
    if found is None:
        return
    own, seen = runner, solution
    if runner.every > 1 or runner.times is not None:
        own = _again(runner, request, request.tangents)
        seen = finished(execute(own))
    for member in range(solution.members or 1):
        kink = kink_of(found, _motion(own, seen, member))
        if kink is not None:
            of_member = None if solution.members is None else member
            raise kink.error(runner, member=of_member, solution=solution)


class Kinks:
    """Where a run that is pulled back has no derivative, found when it is first asked.

    What runs for that is made at once: CasADi does not trace in several threads.

    Parameters
    ----------
    runner, request
        The run.
    shapes : mapping of str to tuple of int
        What it is differentiated by, with its shapes.
    """

    def __init__(
        self,
        runner: TracedRunner | FieldRunner,
        request: Request,
        shapes: Mapping[str, tuple[int, ...]],
    ) -> None:
        self._found = branches(runner.system)
        if self._found is not None:
            rng = np.random.default_rng(SEED)
            directions = {name: rng.uniform(0.5, 1.0, shape) for name, shape in shapes.items()}
            self._own = _again(runner, request, directions)

    @cached_property
    def first(self) -> Kink | None:
        """The first of them, None where there is none."""
        if self._found is None:
            return None
        return kink_of(self._found, _motion(self._own, finished(execute(self._own)), 0))


def _again(
    runner: TracedRunner | FieldRunner, request: Request, directions: Mapping[str, Any]
) -> TracedRunner | FieldRunner:
    """Return the run with tangents once more, and with the state after each step."""
    watched = request.watched  # of a member, whose events are not traced again
    if watched is not None:
        watched = (watched[0], None, watched[2]) if watched[2] else None
    own = replace(
        request, tangents=dict(directions), has_pullback=False, every=1, t_eval=None,
        watched=watched, observe=None,
    )  # fmt: skip
    if runner.steps.control is None:
        steps = runner.steps.count  # also where these are equal ones for a tolerance
        row = runner.row * (1 if request.tangents else 1 + len(directions))
        every = max(1, row * steps // (8 * MOST_NUMBERS))
        own = replace(own, steps=steps, every=every, h=None, rtol=None, atol=None, control=None)
    kind: Any = type(runner)
    found: TracedRunner | FieldRunner = kind(runner.system, runner.choice, own)
    return found


def _motion(runner: TracedRunner | FieldRunner, solution: Solution, member: int) -> Motion:
    """Return the states of a run, or of a member of it."""
    seen, each = solution, np.atleast_2d(runner._each_values)
    if solution.members is not None:
        seen = solution.member(member)
    names = tuple(name for name in (*runner.system.states, "lam") if name in seen.states)
    runs = pieces(seen, names)
    ends = np.cumsum([len(piece[0]) for piece in runs])[:-1]
    t, *states = (np.concatenate(x) for x in zip(*runs, strict=True))
    w = np.column_stack([t, *states, np.tile(each[member % len(each)], (len(t), 1))])
    is_reset = np.isin(np.arange(len(t)), [ends - 1, ends])
    # states at resets have the tangents of the record before
    way = 1 if runner.steps.t1 >= runner.steps.t0 else -1
    before = (np.searchsorted(way * seen.t, way * t, side) - 1 for side in ("left", "right"))
    row = np.maximum(np.where(is_reset, *before), 0)
    is_inside = isinstance(runner.choice, Spark) and runner.choice.points == "gauss"
    sees = isinstance(runner, TracedRunner) and runner._sees_switches
    return Motion(
        w,
        _along(runner, (t, *states), seen.tangents.values(), row, names),
        np.minimum(row * runner.every, int(solution.stats["steps"])),
        np.delete(np.arange(len(t) - 1), ends - 1),
        is_reset,
        is_inside,
        is_inside and sees,
    )


def _along(
    runner: TracedRunner | FieldRunner,
    states: tuple[np.ndarray, ...],
    tangents: Collection[Tangent],
    row: np.ndarray,
    names: tuple[str, ...],
) -> np.ndarray:
    """Return the tangents of time, states and parameters at states, each of a row of records."""
    own = runner._directions
    assert own is not None, "a run with tangents"
    (t, *others), count = states, own.count
    found = [(own.tau[:, 0] + np.outer(t - runner.steps.t0, own.stretch))[..., None]]
    for name, part in zip(names, others, strict=True):
        width = part.shape[1]
        moves = [x.states[name][row] for x in tangents if width and name in x.states]
        # of multipliers there are none by some methods
        each = [x.reshape(len(t), -1, width) for x in moves] or [np.zeros((len(t), count, width))]
        found.append(np.concatenate(each, axis=1))
    return np.concatenate([*found, np.tile(own.tau[:, 1:], (len(t), 1, 1))], axis=2)
