"""Bounds of a Hamiltonian that depends on time, for plans of series in time and Magnus methods."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics.arguments import check_memory
from liouville._basics.errors import hinted
from liouville._methods import Chebyshev, Lanczos, Magnus, SchrodingerSplitting
from liouville._methods.planner.waves.propagators import Interval, MagnusSteps, Parts
from liouville._systems import Schrodinger
from liouville._systems.waves.bounded import FEW
from liouville._systems.waves.bounds import PROBABLE, RIGOROUS, WORTH, Spectrum
from liouville._systems.waves.foreign import times_of_samples
from liouville._systems.waves.separated import Separated

#: The methods that choose their steps.
Planned = SchrodingerSplitting | Chebyshev | Lanczos | Magnus

#: With more functions of time than these, exponentials take H(t) to a tolerance.
DRIVES = 10

#: The order of the exponentials and their number down to a tolerance, and the same where each time
#: of a sum takes a product of its own.
SCHEMES = ((4, 3, 1e-5), (6, 5, 1e-8), (8, 8, 0.0))
OF_PRODUCTS = ((4, 2, 1e-6), (6, 5, 1e-10), (8, 8, 0.0))

#: Times of the sums of H that make the exponentials of a Magnus method.
NODES = {(2, 1): 1, (4, 2): 2, (4, 3): 3, (6, 5): 3, (8, 8): 4}

#: Times of a step at which the core looks at an H(t) known by its products.
LOOKED = 9

#: Times at which drives are looked at for their range, and bounds are taken without corners.
LOOKS, TIMES = 257, 9

#: Most outputs that are looked at besides.
OUTPUTS = 32768

#: Times at which H(t) is looked at where nothing is known of it but its products.
FEW_TIMES = 5

#: Most values of one function of time, of two, and of three, at which H is bounded.
AXIS = (17, 5, 3)

#: Bytes of the factors of a series for each unit of 1/beta.
BYTES = 16.0

#: Lanczos' method finds one corner for so many units of 1/beta, as it takes 20 products.
EACH = WORTH / 2


def exponentials(
    system: Schrodinger, method: Planned, times: Sequence[float]
) -> tuple[Magnus, str] | None:
    """Return the Magnus method that takes H(t) to a tolerance and why; None where series do.

    Raises
    ------
    TypeError
        A series was asked for, of an H(t) known by its products that is no sum of few.
    """
    if system.moving_product is not None:
        _look(system, times[0], times[-1])
        if system.separated(times[0], times[-1], method.tol) is not None:
            return None
        why = "H(t) is known by its products, and no sum of few operators times functions of time"
        if isinstance(method, Chebyshev):
            raise TypeError(hinted(f"{why}, which {method!r} wants", "take 'auto' or Magnus()"))
        return _scheme(OF_PRODUCTS, method.tol), why
    if len(system.groups) > 1 + DRIVES:
        why = f"H has {len(system.groups) - 1} functions of time, each with a matrix of its own"
        return _scheme(SCHEMES, method.tol), why
    return None


def _scheme(schemes: tuple[tuple[int, int, float], ...], tol: float) -> Magnus:
    order, count = next(scheme[:2] for scheme in schemes if tol >= scheme[2])
    return Magnus(order, tol, count)


def check_terms(theta: float, hint: str) -> None:
    """Refuse exponentials over so many units of 1/beta whose series do not fit in memory."""
    check_memory(f"the series of an exponential over {theta:.3g} / beta", BYTES * theta, hint)


def magnus_cost(
    system: Schrodinger, core: MagnusSteps, times: Sequence[float], bounds: Interval
) -> tuple[float, float, str]:
    """Return products of a Magnus method that chooses its steps, its longest step, and a reason.

    Products are an estimate of as many as there may be; of a long run of parts of it.
    """
    points = system.points_between(times[0], times[-1])
    times = sorted({*times, *points}, reverse=times[-1] < times[0])
    lengths, beta = np.abs(np.diff(times)), 0.5 * (bounds[1] - bounds[0])
    check_terms(beta * float(lengths.max()), "give more times to keep states at")
    if system.moving_product is None:
        steps, products, theta, is_sampled = _core.magnus_cost(system.hamiltonian, core, times)
        why = f"steps are chosen by estimates while running, about {steps:.3g} or fewer"
        if is_sampled:
            why += ", as counted in parts of the run"
        return products, theta, why
    degree = _core.chebyshev_degree(beta * float(lengths.sum()), core.tol)
    why = "steps are chosen by estimates while running; the products are the least there may be"
    why += (
        f"; H(t) is looked at {LOOKED} times a step or more, and a step may be {lengths.max():.2g} "
        "long: a pulse within it is seen by its time in points="
    )
    # every step is made as one and as two halves
    return 2.0 * NODES[core.scheme] * degree, beta * float(lengths.max()), why


@dataclass(frozen=True)
class Driving:
    """The energies of H(t) over a run: its parts for the core, and bounds."""

    parts: Parts
    spectrum: Spectrum
    separated: Separated | None = None


def driving(system: Schrodinger, times: Sequence[float], tol: float | None = None) -> Driving:
    """Bound the parts of H(t) and H at corners of the box that its functions of time fill.

    With a tolerance it is for a series, of an H(t) known by its products as a sum.
    """
    t0, t1 = times[0], times[-1]
    if system.moving_product is not None:
        separated = None if tol is None else system.separated(t0, t1, tol)
        if separated is None:
            return _by_products(system, t0, t1)
        bounds = tuple(separated.bounds)
        parts: Parts = ((1,) * len(bounds), bounds, system.given_bounds, (), (), (t0, t1, (), ()))
        return Driving(parts, separated.spectrum, separated)
    ends = system.bounds_over(np.linspace(t0, t1, TIMES))
    if not np.isfinite(ends).all():
        raise ValueError(hinted("H(t) is not finite", "look for a division by zero in a drive"))
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    guarantee = system.guarantee
    axes, corners = _corners(system, (t0, t1), 0.5 * (high - low) * abs(t1 - t0))
    if corners:
        guarantee = RIGOROUS if system.hamiltonian.size <= FEW else PROBABLE
        low = max(low, min(bounds[0] for bounds in corners))
        high = min(high, max(bounds[1] for bounds in corners))
    given = system.given_bounds
    looked = {*system.points_between(t0, t1), *(times if len(times) <= OUTPUTS else ())}
    outputs = tuple(sorted(looked))
    run = (t0, t1, times_of_samples(system.drives, 3), outputs)
    parts = (tuple(system.groups), tuple(system.term_bounds), given, axes, corners, run)
    return Driving(parts, Spectrum((low, high), guarantee))


def _look(system: Schrodinger, t0: float, t1: float) -> None:
    """Refuse an H(t) that is not Hermitian at some times."""
    for t in np.linspace(t0, t1, FEW_TIMES).tolist():
        system.at(t)


def _by_products(system: Schrodinger, t0: float, t1: float) -> Driving:
    """Look at products at some times, and bound H there by Lanczos' method; it may exceed these."""
    found = [system.spectrum_at(t) for t in np.linspace(t0, t1, FEW_TIMES).tolist()]
    low = min(spectrum.bounds[0] for spectrum in found)
    high = max(spectrum.bounds[1] for spectrum in found)
    parts = (tuple(system.groups), ((low, high),), None, (), (), (t0, t1, (), ()))
    return Driving(parts, Spectrum((low, high), found[0].guarantee))


def _corners(
    system: Schrodinger, span: Interval, theta: float
) -> tuple[tuple[tuple[float, ...], ...], tuple[Interval, ...]]:
    """Return values of each function of time, and bounds of H where they take these."""
    ranges = system.drive_ranges(np.linspace(*span, LOOKS))
    if ranges is None or system.given_bounds is not None or not 0 < len(ranges) <= len(AXIS):
        return (), ()
    count = AXIS[len(ranges) - 1]
    if system.hamiltonian.size > FEW:
        worth = int((theta / EACH) ** (1 / len(ranges)) + 1e-9)
        count = min(count, worth) if system.takes_lanczos else 0
    if count < 2:
        return (), ()
    axes = tuple(_axis(low, high, count) for low, high in ranges)
    return axes, tuple(system.corners([*itertools.product(*axes)]))


def _axis(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return equidistant values, one where a function does not change."""
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        return (0.5 * (low + high),)
    values: NDArray[np.float64] = np.linspace(low, high, count)
    return tuple(values.tolist())
