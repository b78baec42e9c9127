"""Refusal of derivatives where a model bends or jumps, of runs with all their steps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville.events import AFTER
from liouville.methods import Spark
from liouville.runners.edges import Kink, Motion, kinks_of
from liouville.runners.execute import execute, finished
from liouville.runners.runner import Request
from liouville.systems._branches import branches

if TYPE_CHECKING:
    from liouville.runners.traced import TracedRunner
    from liouville.solution import Solution

#: Numbers that the states of a repeated run may take in memory.
MOST_NUMBERS = 2**25

#: Of the random directions of a pullback; any serves.
SEED = 0


def check_tangents(runner: TracedRunner, request: Request, solution: Solution) -> Solution:
    """Refuse tangents of a run, or of its members, that a kink makes wrong.

    Returns
    -------
    Solution
        The same, its message with a sentence on a switch that a step passes over.

    Raises
    ------
    IntegrationError
        There is one; the message says where.
    """
    found = branches(runner.system)
    if found is None:
        return solution
    own, seen = runner, solution
    if runner.every > 1 or runner.times is not None:
        own, seen = _repeated(runner, request, dict(request.tangents))
    said = ""
    for member in range(solution.members or 1):
        of_member = solution.members is not None
        kink, passed = kinks_of(found, _motion(own, seen, member))
        if kink is not None:
            error = kink.error(runner, member=member if of_member else None, solution=solution)
            if of_member:
                error.args = (f"member {member}: {error}",)
            raise error
        if passed is not None and not said:
            said = f"member {member}: {passed.remark}" if of_member else passed.remark
    return replace(solution, message="; ".join(filter(None, [solution.message, said])))


def kinks(
    runner: TracedRunner, request: Request, wrt: tuple[str, ...]
) -> tuple[Kink | None, Kink | None]:
    """Return where a run first has no derivative by what is named, and passes over a switch."""
    found = branches(runner.system)
    if found is None:
        return None, None
    # imported here, as it has the names of what is differentiated
    from liouville.runners.tangents import shapes_of

    rng = np.random.default_rng(SEED)
    shapes = shapes_of(runner.system, wrt)
    directions = {name: np.asarray(rng.uniform(0.5, 1.0, shape)) for name, shape in shapes.items()}
    again, solution = _repeated(runner, request, directions)
    return kinks_of(found, _motion(again, solution, 0))


def _repeated(
    runner: TracedRunner, request: Request, directions: dict[str, Any]
) -> tuple[TracedRunner, Solution]:
    """Return the run with tangents once more, and with the state after each step."""
    watched = request.watched  # of a member, whose events are not traced again
    if watched is not None:
        watched = (watched[0], None, watched[2]) if watched[2] else None
    own = replace(
        request, tangents=directions, has_pullback=False, every=1, t_eval=None, watched=watched,
        observe=None,
    )  # fmt: skip
    if runner.steps.control is None:
        kept = type(runner)(runner.system, runner.choice, replace(own, every=runner.steps.count))
        own.every = max(1, kept.row * runner.steps.count // (8 * MOST_NUMBERS))
    again = type(runner)(runner.system, runner.choice, own)
    return again, finished(execute(again))


def _motion(runner: TracedRunner, solution: Solution, member: int) -> Motion:
    """Return the states of a run, or of a member of it."""
    is_many, own = solution.members is not None, runner._directions
    assert own is not None, "a run with tangents"
    names = [name for name in (*runner.system.states, "lam") if name in solution.states]

    def of_member(x: np.ndarray) -> np.ndarray:
        return x[:, member] if is_many else x

    parts = [of_member(solution.states[name]) for name in names]
    there = np.isfinite(np.hstack(parts)).all(axis=1)
    count, params = len(solution.t), np.atleast_2d(runner._each_values)
    values = params[member % len(params)]
    w = np.hstack([solution.t[:, None], *parts, np.tile(values, (count, 1))])
    along = np.zeros((count, own.count, w.shape[1]))
    along[..., 0] = own.tau[:, 0] + np.outer(solution.t - runner.steps.t0, own.stretch)
    along[..., w.shape[1] - values.size :] = own.tau[:, 1:]
    first = 1
    for name, part in zip(names, parts, strict=True):
        tangents = [x.states.get(name) for x in solution.tangents.values()]
        if part.size and all(x is not None for x in tangents):
            each = [of_member(x) for x in tangents if x is not None]
            moves = [x.reshape(count, -1, part.shape[1]) for x in each]
            along[..., first : first + part.shape[1]] = np.concatenate(moves, axis=1)
        first += part.shape[1]
    steps = np.minimum(np.arange(count) * runner.every, int(solution.stats["steps"]))
    rows, at_events, pieces = [w], count, list[tuple[int, int, bool, bool]]()
    resets = _resets(solution, names, member if is_many else None)
    for k in range(count - 1):
        last, is_event = k, False
        within = [x for x in resets if min(w[k : k + 2, 0]) <= x[0] <= max(w[k : k + 2, 0])]
        for _, *sides in within:
            for side in sides:
                rows.append(np.concatenate([side, values])[None])
            pieces.append((last, at_events, is_event, True))
            last, is_event, at_events = at_events + 1, True, at_events + 2
        pieces.append((last, k + 1, is_event, False))
    many = at_events - count
    if many:
        w = np.vstack(rows)
        before = np.searchsorted(np.abs(solution.t - solution.t[0]), np.abs(w[count:, 0] - w[0, 0]))
        before = np.clip(before - 1, 0, count - 1)
        along, steps = (np.concatenate([x, x[before]]) for x in (along, steps))
        there = np.append(there, np.isfinite(w[count:]).all(axis=1))
    steps_from_to = np.array(pieces, dtype=np.int64).reshape(-1, 4)
    is_made = there[steps_from_to[:, 0]] & there[steps_from_to[:, 1]]
    is_inside = isinstance(runner.choice, Spark) and runner.choice.points == "gauss"
    sees = runner._sees_switches and bool(runner.system.switch_tapes)
    return Motion(w, along, steps, steps_from_to[is_made], sees, is_inside)


def _resets(
    solution: Solution, names: list[str], member: int | None
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return when resets were made, and (t, y, z, lam) before and after them, in order."""
    found = []
    for points in solution.events.values():
        if f"{names[0]}{AFTER}" not in points.states:
            continue
        own = points if member is None else points.of_member(member)
        for k, t in enumerate(own.t.tolist()):
            sides = [
                np.concatenate([[t], *(own.states[f"{name}{end}"][k] for name in names)])
                for end in ("", AFTER)
            ]
            found.append((t, *sides))
    way = -1 if len(solution.t) and solution.t[-1] < solution.t[0] else 1
    return sorted(found, key=lambda each: way * each[0])
