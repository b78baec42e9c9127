"""Plans with steps of a given size: Magnus methods for H(t), and shears."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._methods import (
    GrayManolopoulos,
    Magnus,
    SplitOperator,
    StabilitySplitting,
    Stepped,
    shears_of,
)
from liouville._methods.planner.waves.driven import NODES, check_terms, driving
from liouville._methods.planner.waves.ladder import ROUNDOFF, cheapest
from liouville._methods.planner.waves.plan import WavePlan, planned
from liouville._methods.planner.waves.propagators import (
    Exponentials,
    Processed,
    Propagator,
    SeriesExponentials,
    Shears,
)
from liouville._methods.planner.waves.span import Span
from liouville._methods.planner.waves.split import NORM, plan_split
from liouville._systems import Schrodinger
from liouville._systems.waves.bounds import Spectrum
from liouville._systems.waves.foreign import check_sampled

#: The phase of all exponentials of a step, in that of H: negative weights cost phase.
PHASES = {(2, 1): 1.0, (4, 2): 1.0, (4, 3): 1.0, (6, 5): 1.19, (8, 8): 2.75}

#: Beyond so many exponentials stable splittings make them, so that the norm does not drift.
MANY = 10_000

#: The norm may be off by so many tolerances of exponentials, ...
TIMES = 10.0
#: ... and by so many times it where a step is not close to unitary but only its powers are bounded.
LOOSE = 10.0

#: The longest step taken, in units of the longest stable one.
LONGEST = 0.99

Stops = Sequence[tuple[float, int]]


def plan_steps(system: Schrodinger, method: Stepped, t0: float, stops: Stops) -> WavePlan:
    """Plan a run from t0 with steps between `stops`: times with the steps to each."""
    check_sampled(system.drives, t0, stops[-1][0])
    if isinstance(method, SplitOperator):
        return plan_split(system, method, t0, stops)
    system.check_plain(type(method).__name__)
    if isinstance(method, Magnus):
        return _magnus(system, method, t0, stops)
    return _shears(system, method, t0, stops)


def _magnus(system: Schrodinger, method: Magnus, t0: float, stops: Stops) -> WavePlan:
    steps, h = _sizes(t0, stops)
    found = driving(system, (t0, stops[-1][0]))
    low, high = found.spectrum.bounds
    order, exponentials = method.scheme
    count = exponentials * steps
    # the phase of H over a step, shared by its exponentials
    theta = 0.5 * (high - low) * h * PHASES[method.scheme] / exponentials
    check_terms(theta, "give a smaller h")
    degree = _core.chebyshev_degree(theta, method.tol / count)
    shears = None
    if system.is_real:
        shears = cheapest(np.array([theta]), method.tol / count, stable=count > MANY)
    core: Propagator
    norm = max(TIMES * method.tol, NORM)
    if method.tol < count * ROUNDOFF:
        sentence = f"{method!r}: {count} exponentials have roundoff above a tol of {method.tol:g}"
        least = 10 ** np.ceil(np.log10(count * ROUNDOFF))
        raise ValueError(hinted(sentence, f"give a tol of {least:g} or more, or a larger h"))
    if shears is not None and (count > MANY or shears.shears / 2 < degree):
        rung = shears.rung
        core = Exponentials(method.scheme, rung.coefficients, shears.x, norm, found.parts)
        by, products = rung.name, count * shears.shears / 2
    else:
        rate = method.tol / abs(stops[-1][0] - t0)
        core = SeriesExponentials(method.scheme, rate, norm, found.parts)
        sums = NODES[method.scheme] if system.moving_product is not None else 1
        by, products = "Chebyshev series", float(count * degree * sums)
    times, each = zip(*stops, strict=True)
    why = "asked for, with steps of this size; the products are those of the widest spectrum"
    return planned(
        system, method, Span(t0, times, found.spectrum),
        scheme=f"Magnus of order {order}, {exponentials} exponentials by {by}",
        steps=each,
        theta=theta,
        products=products,
        reasons=(why,),
        core=core,
    )  # fmt: skip


def _shears(
    system: Schrodinger, method: StabilitySplitting | GrayManolopoulos, t0: float, stops: Stops
) -> WavePlan:
    name = type(method).__name__
    if system.is_driven:
        raise TypeError(hinted(f"{name} is for an H without time", "take Magnus for H(t)"))
    kind = "stability" if isinstance(method, StabilitySplitting) else "gray-manolopoulos"
    stages = getattr(method, "stages", method.order)
    table = shears_of(kind, method.order, stages)
    steps, h = _sizes(t0, stops)
    low, high = system.bounds
    theta, sigma = 0.5 * (high - low) * h, 0.5 * (high + low)
    if theta >= LONGEST * table["limit"]:
        longest = 2 * LONGEST * table["limit"] / (high - low)
        raise ValueError(
            hinted(
                f"steps of {h:g} are not stable: {theta:.4g} / beta, of {table['limit']:.4g}",
                f"give h of {longest:.6g} or less",
            )
        )
    core: Propagator = Shears(table["coefficients"], sigma, LOOSE)
    # a shear by a complex H is a product with all of a state
    halves = 1 if system.is_real else 2
    products = float(halves * steps * stages)
    if isinstance(method, StabilitySplitting) and method.processed:
        degree = _core.processor_degree(method.order, stages, theta)
        if degree is None:
            sentence = f"{method!r} has no processor for steps of {theta:.4g} / beta"
            raise ValueError(hinted(sentence, "give a smaller h, order 2 or 6, or processed=False"))
        core = Processed(method.order, stages, sigma, theta, NORM)
        products += halves * 2 * degree * len(stops)
    times, each = zip(*stops, strict=True)
    return planned(
        system, method, Span(t0, times, Spectrum((low, high), system.guarantee)),
        scheme=f"{name} of order {method.order}, {2 * stages} shears",
        steps=each,
        theta=theta,
        products=products,
        reasons=("asked for, with steps of this size",),
        core=core,
    )  # fmt: skip


def _sizes(t0: float, stops: Stops) -> tuple[int, float]:
    """Return the number of steps and the size of the longest."""
    times, steps = zip(*stops, strict=True)
    lengths = np.abs(np.diff([t0, *times])) / steps
    return sum(steps), float(lengths.max())
