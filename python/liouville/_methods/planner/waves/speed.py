"""How long a product takes in a series, beside one in a splitting."""

from __future__ import annotations

import time
from weakref import WeakKeyDictionary

import numpy as np

from liouville import _core
from liouville._basics.job import Job
from liouville._methods.planner.waves.propagators import Propagator, Series, Shears
from liouville._systems import Schrodinger

#: Real products that are timed of either kind, after as many to warm up.
PRODUCTS = 16

#: For runs of fewer products measuring is not worth its time, and this is taken: 1 to 2 were seen.
FEW, USUAL = 500, 1.25

#: Smaller differences are those of the clock.
STEP = 0.25

#: A term added to an output, in products of a series: what is taken then, and what was seen.
TERM, SEEN = 0.05, (0.01, 0.02, 0.05, 0.1, 0.2)

#: Outputs of the window by which a term is timed.
OUTPUTS = 16

_measured: WeakKeyDictionary[Schrodinger, tuple[float, float]] = WeakKeyDictionary()


def series_cost(system: Schrodinger, products: float) -> tuple[float, float]:
    """Return how long a product in a Chebyshev series takes, and a term added to an output.

    The product in those of a splitting, in quarters, the term in products of the series. A series
    adds up its terms, which shows where products are as fast as adding vectors. For a run of many
    `products` both are measured, once for a system.
    """
    if system.is_foreign:
        return 1.0, 0.0
    if products < FEW:
        return USUAL, TERM
    if system not in _measured:
        low, high = system.bounds
        beta, sigma = 0.5 * (high - low), 0.5 * (high + low)
        shears = Shears(np.full(PRODUCTS, 1 / PRODUCTS), sigma, np.inf)
        splitting, made = _seconds(system, shears, 1 / beta)
        splitting /= made
        alone, made = _seconds(system, _series(system, 1), 4 / beta)
        many, _ = _seconds(system, _series(system, OUTPUTS), 4 / beta, OUTPUTS)
        product = alone / made
        term = max(many - alone, 0.0) / (OUTPUTS * made / 2) / product
        _measured[system] = (
            max(1.0, round(product / splitting / STEP) * STEP),
            min(SEEN, key=lambda seen: abs(np.log(seen / max(term, SEEN[0])))),
        )
    return _measured[system]


def _series(system: Schrodinger, outputs: int) -> Series:
    """Return a step by a series, and then a window."""
    low, high = system.bounds
    rate = 1e-3 * 0.5 * (high - low)
    return Series((low, high), rate, np.inf, (1, outputs))


def _seconds(
    system: Schrodinger, propagator: Propagator, t: float, outputs: int = 1
) -> tuple[float, int]:
    """Time what follows a first step, when all memory is there; return its real products, too."""
    psi = np.full((1, system.size), 0.5 + 0.5j)
    ends = t + t * np.arange(1, outputs + 1) / outputs
    span = (0.0, [(t, 1), *((float(end), 1) for end in ends)])
    job = Job(start=(psi,), span=span, observer=[], states=False)
    run = _core.run(system.hamiltonian, propagator, job)
    assert isinstance(run, _core.Run)
    run.advance(0.0)
    before, clock = run.stats["evaluations"], time.perf_counter()
    run.advance(60.0)
    return time.perf_counter() - clock, int(run.stats["evaluations"]) - int(before)
