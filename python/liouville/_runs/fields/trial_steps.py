"""Equal steps that meet a tolerance, found by trial runs of the whole interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._methods.control import Steps

#: A first step changes states by this part of themselves, or the field by this part of itself.
PART, LONGER = 0.1, 4.0
#: Records that runs are compared at, and the steps of the first run, at least and at most: where
#: that is chosen, it may be far too careful.
RECORDS, FIRST, MOST_FIRST = 4, 16, 40_000
#: All trial runs together take so many steps at most.
MOST = 4_000_000
#: The number of steps is as many times that of the estimate, to the order's root.
SAFETY = 1.5
#: Errors that fall by this part of what the order promises show it; from there so much more is
#: believed of them.
SHOWN, BELIEVED = 0.5, 4.0
#: Differences of two runs below this part of the states are roundoff.
ROUNDOFF = 1e-13

#: Rates of states, both shape (P, n).
Rates = Callable[[np.ndarray], np.ndarray]
#: States at equal times of a run of so many steps, shape (RECORDS, ..., n).
Run = Callable[[int], np.ndarray]


def first_step(rates: Rates, x: np.ndarray, length: float) -> float:
    """Return a step of a run of this length in time in which little changes.

    States near zero change by much of themselves in no time. So it grows as far as the field stays
    about the same on the straight way that it leads from there.
    """
    given = rates(x)
    speed, size = np.abs(given).max(), np.abs(x).max()
    if not (size and 0 < speed < np.inf):
        return abs(length)
    h = PART * size / speed
    while h < abs(length):
        off = np.abs(rates(x + np.copysign(LONGER * h, length) * given) - given).max()
        if not off <= PART * speed:
            break
        h *= LONGER
    return float(np.clip(h, abs(length) / MOST_FIRST, abs(length)))


def trial_steps(run: Run, asked: Steps, order: int, fewest: int) -> Steps:
    """Return equal steps for the tolerances of controlled ones, `fewest` or more.

    Runs of n and 2 n steps differ by the error of the first; that of 2 n steps is
    :math:`1/(2^p - 1)` of the difference. n is doubled until errors fall with the order p. Longer
    steps than those of the last run are taken only as far as runs with them agree with it.

    Raises
    ------
    ValueError
        No number of steps that can be tried meets the tolerance.
    """
    assert asked.control is not None, "steps for a tolerance"
    _, rtol, atol, first, _ = asked.control
    n = FIRST
    if first:
        n = max(n, math.ceil(abs(asked.t1 - asked.t0) / first))
    n = RECORDS * math.ceil(n / RECORDS)
    before, last, made = _states(run, n), math.inf, n
    while made < MOST:
        n *= 2
        after, made = _states(run, n), made + n
        off = _distance(before, after, rtol, atol)
        error = off / (2**order - 1)
        if 1 < error < math.inf and _is_roundoff(before, after):
            break
        is_shown = error == 0 or SHOWN * 2**order <= last / error < math.inf
        if off <= 1 or (is_shown and error <= BELIEVED**order):
            factor = (SAFETY * error) ** (1 / order)
            count = RECORDS * math.ceil(max(1, fewest, n * factor) / RECORDS)
            while count < n:
                made += count
                if _distance(_states(run, count), after, rtol, atol) <= 1:
                    break
                count = min(2 * count, n)
            return replace(asked, count=count, control=None, trial=(asked.control, made))
        before, last = after, error
    sentence = f"no equal steps that were tried, up to {n}, meet rtol = {rtol:g}"
    hint = "neighbouring trajectories part too fast, or digits end: give h, or a shorter time"
    raise ValueError(hinted(sentence, hint))


def _distance(states: np.ndarray, others: np.ndarray, rtol: float, atol: np.ndarray) -> float:
    """Return the largest difference in tolerances, a root mean square over the coordinates."""
    with np.errstate(invalid="ignore", over="ignore"):
        parts = (states - others) / (atol + rtol * np.abs(others))
        found = float(np.sqrt(np.mean(parts**2, axis=-1)).max())
    return found if math.isfinite(found) else math.inf


def _is_roundoff(states: np.ndarray, others: np.ndarray) -> bool:
    """Return whether states are the same but for roundoff."""
    return bool(np.abs(states - others).max() <= ROUNDOFF * np.abs(others).max())


def _states(run: Run, steps: int) -> np.ndarray:
    """Return the states of a run, which are not finite where it failed."""
    try:
        return run(steps)
    except IntegrationError:
        return np.full((RECORDS, 1), np.inf)
