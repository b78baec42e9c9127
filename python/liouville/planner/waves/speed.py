"""How long a product takes in a series, beside one in a splitting."""

from __future__ import annotations

import time
from weakref import WeakKeyDictionary

import numpy as np

from liouville import _core
from liouville._job import Job
from liouville.planner.waves.propagators import Propagator, Series, Shears
from liouville.systems import Schrodinger

#: Real products that are timed of either kind, after as many to warm up.
PRODUCTS = 16

#: For runs of fewer products measuring is not worth its time, and this is taken: 1 to 2 were seen.
FEW, USUAL = 500, 1.25

#: Smaller differences are those of the clock.
STEP = 0.25

_measured: WeakKeyDictionary[Schrodinger, float] = WeakKeyDictionary()


def series_cost(system: Schrodinger, products: float) -> float:
    """Return the time of a product in a Chebyshev series over that in a splitting, in quarters.

    A series adds up its terms, which shows where products are as fast as adding vectors. For a run
    of many `products` it is measured, once for a system.
    """
    if system.is_foreign:
        return 1.0
    if products < FEW:
        return USUAL
    if system not in _measured:
        low, high = system.bounds
        beta, sigma = 0.5 * (high - low), 0.5 * (high + low)
        shears = Shears(np.full(PRODUCTS, 1 / PRODUCTS), sigma, np.inf)
        series = Series((low, high), 1e-3 * beta, np.inf, False, (1, 1))
        ratio = _seconds(system, series, 4 / beta) / _seconds(system, shears, 1 / beta)
        _measured[system] = max(1.0, round(ratio / STEP) * STEP)
    return _measured[system]


def _seconds(system: Schrodinger, propagator: Propagator, t: float) -> float:
    """Time a real product of a second step, when all memory is there."""
    psi = np.full((1, system.size), 0.5 + 0.5j)
    span = (0.0, [(t, 1), (2 * t, 1)])
    job = Job(start=(psi,), span=span, observer=[], states=False)
    run = _core.run(system.hamiltonian, propagator, job)
    assert isinstance(run, _core.Run)
    run.advance(0.0)
    before, clock = run.stats["evaluations"], time.perf_counter()
    run.advance(60.0)
    return (time.perf_counter() - clock) / (run.stats["evaluations"] - before)
