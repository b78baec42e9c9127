"""Refusal of derivatives where a model bends or jumps, of runs with all their steps."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._methods import Spark
from liouville._runs.edges import Kink, Motion, kink_of
from liouville._runs.execute import execute, finished
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request
from liouville._solution.parts import pieces
from liouville._systems.mechanics.branches import branches

if TYPE_CHECKING:
    from liouville._runs.fields.field import FieldRunner
    from liouville._runs.waves.wave import WaveRunner
    from liouville._solution.solution import Solution
    from liouville._solution.tangents import Tangent
    from liouville._systems import Grid

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
    if runner.every > 1 or runner._watch.times is not None:
        own = _again(runner, request, request.tangents)
        seen = finished(execute(own))
    for member in range(solution.members or 1):
        kink = kink_of(found, _motion(own, seen, member))
        if kink is not None:
            of_member = None if solution.members is None else member
            raise kink.error(runner, member=of_member, solution=solution)


def check_drives(runners: Sequence[WaveRunner], solution: Solution) -> None:
    """Refuse tangents of wave functions, each of a runner, that a kink of H(t) makes wrong."""
    for member, runner in enumerate(runners):
        own = runner._directions
        assert own is not None, "a run with tangents"
        kink = kink_of_drive(runner, own.rows)
        if kink is not None:
            raise kink.error(runner, member if len(runners) > 1 else None, solution)


class Kinks:
    """Where a run that is pulled back has no derivative, found when it is first asked.

    Parameters
    ----------
    look : callable
        Looks for the first of them.
    """

    def __init__(self, look: Callable[[], Kink | None]) -> None:
        self._look = look

    @cached_property
    def first(self) -> Kink | None:
        """The first of them, None where there is none."""
        return self._look()

    @classmethod
    def of(
        cls,
        runner: TracedRunner | FieldRunner,
        request: Request,
        shapes: Mapping[str, tuple[int, ...]],
    ) -> Kinks | None:
        """Return the kinks of a run by named inputs with shapes, None for a model without cases.

        What runs for that is made at once: CasADi does not trace in several threads.
        """
        found = branches(runner.system)
        if found is None:
            return None
        own = _again(runner, request, directions(shapes))
        return cls(lambda: kink_of(found, _motion(own, finished(execute(own)), 0)))


def directions(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """Return random directions by name, none of which is zero anywhere."""
    rng = np.random.default_rng(SEED)
    return {name: np.asarray(rng.uniform(0.5, 1.0, shape)) for name, shape in shapes.items()}


def kink_of_drive(runner: WaveRunner, rows: np.ndarray) -> Kink | None:
    """Return the first kink of H(t) in a run that was differentiated, in directions as rows.

    The functions of a drive, and a potential at each point, move along the time alone. Along the
    axes of a grid a potential is looked at where the run begins.
    """
    system, plan = runner.system, runner.plan
    values = system.parameters.values(None)
    moves = rows[:, system.size : system.size + values.size].real
    found = branches(system.sensitivity) if moves.any() else None
    if found is None:
        return None
    stops = [(plan.t0, 1), *plan.stops]
    ends = [np.linspace(a, b, k + 1)[1:] for (a, _), (b, k) in pairwise(stops)]
    t = np.unique([plan.t0, stops[-1][0], *runner.nodes])
    t = t if stops[-1][0] >= plan.t0 else t[::-1]
    points, potential = np.zeros((1, 0)), system.potential_sensitivity
    if potential is not None and system.grid is not None:
        for length, line in _lines(system.grid):
            start = np.full(len(line), plan.t0), line, np.zeros(len(line), dtype=int)
            if kink := kink_of(found, _still(*start, length, values, moves)):
                return replace(kink, moves="place")
        points = potential.looked[: max(1, MOST_NUMBERS // (8 * len(t)))]
    many, way = len(points), np.sign(t[-1] - t[0])
    done = np.searchsorted(way * np.concatenate(ends), way * t, side="right")
    each = np.tile(t, many), np.repeat(points, len(t), axis=0), np.tile(done, many)
    return kink_of(found, _still(*each, len(t), values, moves))


def _lines(grid: Grid) -> Iterator[tuple[int, np.ndarray]]:
    """Give the points of a grid along each axis, line after line of a length, or some lines."""
    whole = grid.points.reshape(*grid.shape, -1)
    for axis, length in enumerate(grid.shape):
        lines = np.moveaxis(whole, axis, -2).reshape(-1, length, len(grid.shape))
        yield length, lines[:: 1 + 64 * grid.size // MOST_NUMBERS].reshape(-1, len(grid.shape))


def _still(
    t: np.ndarray,
    points: np.ndarray,
    steps: np.ndarray,
    length: int,
    values: np.ndarray,
    moves: np.ndarray,
) -> Motion:
    """Return times and points, lines of a length, as a motion that parameters alone move."""
    count = len(t)
    held = np.zeros((count, len(moves), 1 + points.shape[1]))
    return Motion(
        np.hstack([t[:, None], points, np.tile(values, (count, 1))]),
        np.concatenate([held, np.broadcast_to(moves, (count, *moves.shape))], axis=2),
        steps,
        np.delete(np.arange(count), np.s_[length - 1 :: length]),
        np.zeros(count, dtype=bool),
    )


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
