"""Trial runs, which compare candidates by their cost at equal error."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from liouville import _core
from liouville._job import Job
from liouville.methods import VolumeSplitting
from liouville.methods.composition import SCHEMES
from liouville.planner.fields.plan import ROUNDOFF, Trial, ordered, parted
from liouville.splitting import Piece, Split, to_core
from liouville.terms import Terms

#: The composition of the reference, whose steps are this much shorter.
REFERENCE, FINER = "SS8s21", 4

#: States of a trial run, and its steps.
STATES, STEPS = 32, 4

#: The cost of a root, an exponential or a logarithm, in multiplications, as ensembles take them.
FUNCTION = 50


def _of_piece(piece: Piece) -> float:
    """Count the operations of a flow of a piece."""
    return float(piece.operations + FUNCTION * piece.functions)


def operations_of(parts: Split, scheme: str) -> float:
    """Count the operations of a step in a long run, where neighbouring exact flows are one."""
    costs = [_of_piece(piece) for piece in parts.pieces]
    halves = len(SCHEMES[scheme]["flows"])
    if halves == 1 or len(costs) < 2:
        return sum(costs)
    ends = [costs[k] for k in (0, -1) if parts.pieces[k].is_exact]
    return halves * (sum(costs) - sum(ends) / 2)


def costly_outside(parts: Split) -> tuple[int, ...]:
    """Put the two costliest pieces first and last, where they are made half as often."""
    costs = [_of_piece(piece) for piece in parts.pieces]
    inner = np.argsort(costs, kind="stable").tolist()
    if len(inner) < 3:
        return tuple(range(len(inner)))
    first, last = sorted(inner[-2:])
    return (first, *sorted(inner[:-2]), last)


class TrialRun:
    """Short runs from some states, compared with a much better one.

    Of a single state, those that it passes through are taken.
    """

    def __init__(self, splits: Iterable[Split], x: np.ndarray, h: float) -> None:
        self.h = h
        self.x, self.reference = x, None
        for parts in splits:
            if len(x) == 1:
                path = _path(parts, REFERENCE, x, h, (STATES - 1) * STEPS, every=STEPS)
                if path is None:
                    continue
                self.x = np.ascontiguousarray(path[:, 0])
            self.reference = self._end(parts, REFERENCE, FINER)
            if self.reference is not None:
                break

    def _end(self, parts: Split, scheme: str, finer: int) -> np.ndarray | None:
        steps = STEPS * finer
        path = _path(parts, scheme, self.x, self.h / finer, steps, every=steps)
        return None if path is None else path[-1]

    def trial(self, method: VolumeSplitting, parts: Split) -> Trial:
        """Try a split field with the step asked for and half of it."""
        scheme = method.composition
        errors = []
        for halves in (1, 2):
            end = self._end(parts, scheme, halves)
            if end is None or self.reference is None:
                errors.append(np.inf)
            else:
                error = float(np.sqrt(np.mean((end - self.reference) ** 2)))
                errors.append(max(error, ROUNDOFF) * halves ** (method.order or 1))
        return Trial(
            method,
            len(parts.pieces),
            operations_of(parts, scheme),
            float(np.sqrt(errors[0] * errors[1])),
        )


def _path(
    parts: Split, scheme: str, x: np.ndarray, h: float, steps: int, every: int
) -> np.ndarray | None:
    """Return where states x of shape (P, n) go, shape (k, P, n), None if a step fails."""
    n = parts.n
    tape = _core.Tape([1, n, 0], 0, np.empty((0, 4), dtype=np.int64), np.empty(0))
    job = Job(
        start=(parts.inward(x),), span=(0.0, h * steps, steps, every), observer=tape,
        seen=(n, parts.outward), is_ensemble=True,
    )  # fmt: skip
    run = _core.run(to_core(parts), VolumeSplitting(composition=scheme), job)
    if isinstance(run, dict) or run.advance(1e6) != "done" or run.failures():
        return None
    return run.take()[1]


def search(
    terms: Terms,
    runs: TrialRun,
    method: VolumeSplitting,
    parts: Split,
    rng: np.random.Generator,
    trials: int,
) -> tuple[tuple[int, ...], tuple[int, ...], Trial]:
    """Try orders of the pieces and, where shears have directions, which variable takes which."""
    m = len(parts.pieces)
    has_directions = method.diagonal in ("shears", "n+d") and len(terms) <= 500
    best_order: tuple[int, ...] = tuple(range(m))
    best_directions: tuple[int, ...] = ()
    best = runs.trial(method, parts)
    for k in range(trials if m > 1 else 0):
        directions: tuple[int, ...] = ()
        if has_directions and k % 2:
            directions = tuple(rng.permutation(terms.n).tolist())
        base = parted(terms, method, directions) if directions else parts
        order = costly_outside(base) if k == 0 else tuple(rng.permutation(m).tolist())
        trial = runs.trial(method, ordered(base, order))
        if trial.score < best.score:
            best, best_order, best_directions = trial, order, directions
    return best_order, best_directions, best
