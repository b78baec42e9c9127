"""Equal steps that meet a tolerance, found by trial runs of the whole interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from liouville.control import Steps
from liouville.errors import IntegrationError, hinted

#: Records that runs are compared at, and the steps of the first run.
RECORDS, FIRST = 4, 16
#: All trial runs together take so many steps at most.
MOST = 4_000_000
#: The number of steps is as many times that of the estimate, to the order's root.
SAFETY = 1.5
#: Errors that fall by this part of what the order promises show it; from there so much more is
#: believed of them.
SHOWN, BELIEVED = 0.5, 4.0
#: Differences of two runs below this part of the states are roundoff.
ROUNDOFF = 1e-13

#: States at equal times of a run of so many steps, shape (RECORDS, ..., n).
Run = Callable[[int], np.ndarray]


def trial_steps(run: Run, asked: Steps, order: int) -> Steps:
    """Return equal steps for the tolerances of controlled ones.

    Runs of n and 2 n steps differ by the error of the first; that of 2 n steps is
    :math:`1/(2^p - 1)` of the difference. n is doubled until errors fall with the order p.

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
        size = np.abs(after)
        with np.errstate(invalid="ignore", over="ignore"):
            off = np.abs(after - before)
            error = np.sqrt(np.mean((off / (atol + rtol * size)) ** 2, axis=-1)).max()
            error = error / (2**order - 1) if np.isfinite(error) else math.inf
            if error > 1 and off.max() <= ROUNDOFF * size.max():
                break
        is_shown = last / error >= SHOWN * 2**order if error > 0 else True
        if error <= 1 or (is_shown and error <= BELIEVED**order):
            factor = (SAFETY * error) ** (1 / order)
            # without the order shown, no fewer steps than these are believed to do
            least = 0.0 if is_shown else 1.0
            count = max(RECORDS, math.ceil(n * max(factor, least)))
            return replace(asked, count=count, control=None, trial=(asked.control, made))
        before, last = after, error
    sentence = f"no equal steps that were tried, up to {n}, meet rtol = {rtol:g}"
    hint = "neighbouring trajectories part too fast, or digits end: give h, or a shorter time"
    raise ValueError(hinted(sentence, hint))


def _states(run: Run, steps: int) -> np.ndarray:
    """Return the states of a run, which are not finite where it failed."""
    try:
        return run(steps)
    except IntegrationError:
        return np.full((RECORDS, 1), np.inf)
