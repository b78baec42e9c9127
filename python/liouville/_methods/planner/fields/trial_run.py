"""Trial runs, which compare candidates by their cost at equal error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from liouville import _core
from liouville._basics.job import Job
from liouville._methods import VolumeSplitting
from liouville._methods.composition import SCHEMES
from liouville._methods.planner.fields.plan import ROUNDOFF, Trial, ordered, parted
from liouville._methods.splitting import Piece, Split, to_core
from liouville._systems.fields.terms import Terms

#: The composition of the reference, whose steps are this much shorter.
REFERENCE, FINER = "SS8s21", 4

#: States of a trial run, and its steps.
STATES, STEPS = 32, 4

#: Steps from a single state, where no run is said.
PASSED = 128

#: The path that states are taken from has steps longer by this factor where these will do, and so
#: many at most.
LONGER, MOST_STEPS = 8, 2000
#: Its records, after the start, are at the same times for all steps.
RECORDS = STATES - 1

#: Errors of a trial are small below this part of the states.
FINE = 1e-4

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
    """Short runs from states of a run of `count` steps h, compared with much better ones.

    The states are those that the starts x pass through, over all of the run as far as it is tried;
    without a count x themselves, and those that a single x passes through. Trials do not go beyond
    the end of the run. Where errors are small their steps are longer than h, by a power of two, so
    that runs of h and h/2 have one plan, and none is chosen by roundoff.
    """

    h: float
    x: np.ndarray
    reference: np.ndarray | None

    def __init__(
        self,
        candidates: Sequence[tuple[VolumeSplitting, Split]],
        x: np.ndarray,
        h: float,
        count: int | None,
    ) -> None:
        if count is None:
            count = PASSED if len(x) == 1 else STEPS
        self.steps = min(STEPS, count)
        for method, parts in candidates:
            path, covered = _passed(parts, x, h, count)
            self._take(parts, path, h, (count - self.steps) / covered)
            longer = 1
            while (doubled := self._doubled(method, parts)) and 2 * longer * self.steps <= count:
                while 2**doubled * longer * self.steps > count:
                    doubled -= 1
                longer *= 2**doubled
                before = self.h, self.x, self.reference
                self._take(parts, path, h * longer, (count - self.steps * longer) / covered)
                if not self._doubled(method, parts):
                    self.h, self.x, self.reference = before
                    break
            if self.reference is not None:
                break

    def _take(self, parts: Split, path: np.ndarray, h: float, part: float) -> None:
        """Take trials of steps h from states of a part of a path, and make their reference."""
        self.h, self.x = h, _spread(path, min(part, 1.0))
        self.reference = self._end(parts, REFERENCE, FINER)

    def _doubled(self, method: VolumeSplitting, parts: Split) -> int:
        """Return how often the step can be doubled at once; 0 where errors are not small.

        They are measured beside the states, among which a time may be large.
        """
        sizes = np.sort(np.sqrt(np.mean(self.x**2, axis=0)))
        error = self.trial(method, parts).error
        fine = FINE * float(sizes[(sizes.size - 1) // 2])
        if not error <= fine < np.inf:
            return 0
        return max(1, int(np.log2(fine / error) / ((method.order or 1) + 1)) - 1)

    def _end(self, parts: Split, scheme: str, finer: int) -> np.ndarray | None:
        steps = self.steps * finer
        path = _path(parts, scheme, self.x, self.h / finer, steps, every=steps)
        return None if path is None or path.shape[1] < len(self.x) else path[-1]

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


def _passed(parts: Split, x: np.ndarray, h: float, count: int) -> tuple[np.ndarray, float]:
    """Return where x of shape (P, n) go in `count` steps h, and how many steps h that covers.

    The path, of shape (k, P, n), is made by a method of high order, in longer steps where these
    will do. Starts that do not come to its end are left out; where none does, all have no path.
    """
    for longer in (LONGER, 1) if count > STEPS else ():
        every = min(-(-count // (longer * RECORDS)), MOST_STEPS // RECORDS)
        steps = every * RECORDS
        size = min(count / steps, longer)
        path = _path(parts, REFERENCE, x, h * size, steps, every)
        if path is not None and path.shape[1] > 0:
            return path, size * steps
    return x[None], count


def _spread(path: np.ndarray, part: float) -> np.ndarray:
    """Return STATES states of the first part of a path, of many starts each at another time."""
    length, starts = path.shape[:2]
    if length == 1:
        return np.ascontiguousarray(path[0])
    time = np.linspace(0, part * (length - 1), STATES).round().astype(int)
    if starts > 1:
        time = np.random.default_rng(0).permutation(time)
    return np.ascontiguousarray(path[time, np.arange(STATES) % starts])


def _path(
    parts: Split, scheme: str, x: np.ndarray, h: float, steps: int, every: int
) -> np.ndarray | None:
    """Return where states x of shape (P, n) go, shape (k, P, n), None if all steps fail.

    States whose steps fail are left out.
    """
    n = parts.n
    tape = _core.Tape([1, n, 0], 0, np.empty((0, 4), dtype=np.int64), np.empty(0))
    job = Job(
        start=(parts.inward(x),), span=(0.0, h * steps, steps, every), observer=tape,
        seen=(n, parts.outward), is_ensemble=True,
    )  # fmt: skip
    run = _core.run(to_core(parts), VolumeSplitting(composition=scheme), job)
    if isinstance(run, dict) or run.advance(1e6) != "done":
        return None
    failed = [failure["member"] for failure in run.failures()]
    return np.delete(run.take()[1], failed, axis=1)


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
