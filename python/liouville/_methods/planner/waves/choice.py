"""The choice of method and steps by bounds of the error and the number of products."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from liouville import _core
from liouville._basics.arguments import memory
from liouville._basics.errors import hinted
from liouville._methods import Chebyshev, Lanczos, Magnus, SchrodingerSplitting, SplitOperator
from liouville._methods.planner.waves.driven import Planned, driving, exponentials, magnus_cost
from liouville._methods.planner.waves.ladder import Choice, cheapest
from liouville._methods.planner.waves.levels import cheaper_by_levels
from liouville._methods.planner.waves.plan import WavePlan, planned
from liouville._methods.planner.waves.propagators import Driven, Krylov, MagnusSteps, Series, Shears
from liouville._methods.planner.waves.span import Span
from liouville._methods.planner.waves.speed import series_cost
from liouville._methods.planner.waves.split import cheaper_on_grid, plan_tolerance
from liouville._methods.planner.waves.windows import SERIES, Windows, windows_of
from liouville._systems import Schrodinger
from liouville._systems.waves.foreign import check_sampled

#: The method that "auto" stands for; messages use that word.
AUTO = SchrodingerSplitting()


def name_of(method: Planned | SplitOperator) -> str:
    """Return a method's name as a user writes it."""
    return "'auto'" if method is AUTO else type(method).__name__


#: Beyond so many steps a stable method is taken.
MANY = 50

#: The norm may be off by ten times what method and roundoff promise, and by so much in any case.
TIMES, LEAST = 10.0, 1e-10


def plan_run(
    system: Schrodinger,
    method: Planned | SplitOperator,
    times: Sequence[float],
    psi: np.ndarray | None = None,
    is_differentiated: bool = False,
) -> WavePlan:
    """Plan a run from a state, or from some, in the core's components; of a grid by the first.

    A run that is to be differentiated takes methods of which there are derivatives.
    """
    if isinstance(method, SplitOperator):
        if psi is None:
            hint = "the steps that a tolerance leaves a split operator depend on the state"
            raise TypeError(hinted("psi is missing", hint))
        check_sampled(system.drives, times[0], times[-1])
        return plan_tolerance(system, method, times, psi)
    plan = plan_wave(system, method, times, psi is not None and not np.any(psi.imag))
    if method is not AUTO or is_differentiated:
        return plan
    plan = cheaper_by_levels(system, plan, AUTO, times)
    return plan if psi is None else cheaper_on_grid(system, plan, AUTO.tol, times, psi)


def plan_wave(
    system: Schrodinger,
    method: Planned,
    times: Sequence[float],
    is_real: bool = False,
    is_differentiated: bool = False,
) -> WavePlan:
    """Choose the steps of a method, and for ``"auto"`` the method.

    `times` are those of the start and of the states to keep; `is_real` says whether the start is
    known to be real. A drive that does not depend on time is a part of H, unless the run is to be
    differentiated by its parameters.
    """
    if not (is_differentiated or isinstance(method, Magnus)):
        system = system.settled
    _check_system(system, method)
    check_sampled(system.drives, times[0], times[-1])
    if isinstance(method, Magnus):
        return _magnus(system, method, times, "asked for")
    if system.is_driven:
        return _driven(system, method, times)
    spectrum = system.spectrum(float(np.abs(np.diff(times)).sum()))
    span = Span(times[0], tuple(times[1:]), spectrum)
    span.check_reach(method.tol)
    if isinstance(method, Lanczos):
        return _lanczos(span, method, system)
    if isinstance(method, Chebyshev) or (method.mode == "auto" and not system.is_real):
        windows = _windows(span, method.tol, system, is_real)
        asked = isinstance(method, Chebyshev)
        why = "asked for" if asked else "H is complex and no gauge makes it real"
        return _chebyshev(span, method, windows, system, (why,))
    if method.mode != "auto":
        return _split(span, _found(span, method), method, system)
    return _fewest(span, method, system, is_real)


def _found(span: Span, method: SchrodingerSplitting) -> Choice:
    """Return the splitting of a mode; ValueError if none reaches the tolerance."""
    found = _splitting(span, method)
    if found is None:
        raise ValueError(
            hinted(
                f"no {method.mode} splitting reaches tol = {method.tol:g} for a span of "
                f"{span.thetas.sum():.3g} / beta",
                "give a larger tol, or mode='auto', which takes a Chebyshev series then",
            )
        )
    return found


def _fewest(
    span: Span, method: SchrodingerSplitting, system: Schrodinger, is_real: bool
) -> WavePlan:
    """Return the plan for this tolerance or a tighter one, so that none of these takes fewer.

    A splitting may be faster though it takes more products, and stable ones come in where steps
    are many, so that products alone could fall where the tolerance does. Tolerances are compared
    four to a decade.
    """
    best: WavePlan | None = None
    for tol in _tolerances(span, method.tol):
        plan, fewest = _automatic(span, replace(method, tol=tol), system, is_real)
        if best is None or plan.products < best.products:
            best = plan
        if fewest >= best.products:
            break
    assert best is not None
    return replace(best, method=method)


def _tolerances(span: Span, tol: float) -> Iterator[float]:
    """Give powers of ten at steps of a quarter from a tolerance on, as far as is within reach."""
    k = np.floor(4 * np.log10(tol) + 1e-9)
    if 10 ** (k / 4) < span.least:
        yield tol
    while (grid := float(f"{10 ** (k / 4):.12g}")) >= span.least:
        yield min(grid, tol)
        k -= 1


def _automatic(
    span: Span, method: SchrodingerSplitting, system: Schrodinger, is_real: bool
) -> tuple[WavePlan, float]:
    """Return the plan for a tolerance, and the fewest products of any other for it."""
    found = _splitting(span, method)
    least = np.inf if found is None else _fast(span, method, found).shears / 2
    if found is not None and SERIES * float(span.thetas.max()) > memory():
        return _split(span, found, method, system), least
    windows = _windows(span, method.tol, system, is_real)
    series = _chebyshev(span, method, windows, system, ())
    least = min(least, series.products)
    if found is None:
        why = f"no splitting reaches {method.tol:g} over {span.thetas.sum():.3g} / beta"
        return replace(series, reasons=(why, *series.reasons)), least
    return _faster(system, _split(span, found, method, system), series, windows.terms), least


def _check_system(system: Schrodinger, method: Planned) -> None:
    """Refuse an H that depends on time, or on the density, for what takes none."""
    system.check_plain(name_of(method))
    takes_time = isinstance(method, Chebyshev | Magnus) or getattr(method, "mode", "") == "auto"
    if system.is_driven and not takes_time:
        hint = "take 'auto' or Magnus(), or with h or steps SplitOperator() on a grid"
        raise TypeError(hinted(f"{method!r} is for an H without time", hint))


def _faster(system: Schrodinger, splitting: WavePlan, series: WavePlan, terms: float) -> WavePlan:
    """Choose by the time of the products, and of the terms that are added to outputs."""
    why = [f"a Chebyshev series would take {series.products:g} products"]
    if series.products < splitting.products:
        cost, term = series_cost(system, series.products)
        slower = f"a product takes about {cost:g} times as long in a series as in a splitting"
        if terms:
            slower += (
                f", and adding a term to a state takes {term:g} of a product; there are "
                f"{terms:.0f} of them"
            )
        if cost * (series.products + term * terms) < splitting.products:
            other = f"a splitting would take {splitting.products:g} products"
            return replace(series, reasons=(*series.reasons, other, slower))
        why.append(slower)
    return replace(splitting, reasons=(*splitting.reasons, *why))


def _splitting(span: Span, method: SchrodingerSplitting) -> Choice | None:
    tol = method.tol - span.roundoff
    found = cheapest(span.thetas, tol, method.mode == "stable")
    if found is not None and method.mode == "auto" and found.steps.sum() > MANY:
        return cheapest(span.thetas, tol, True) or found
    return found


def _fast(span: Span, method: SchrodingerSplitting, found: Choice) -> Choice:
    """Return the cheapest splitting where a stable one was taken."""
    if not found.rung.stable:
        return found
    return cheapest(span.thetas, method.tol - span.roundoff, False) or found


def _split(
    span: Span, found: Choice, method: SchrodingerSplitting, system: Schrodinger
) -> WavePlan:
    rung, steps = found.rung, int(found.steps.sum())
    kind = "stable" if rung.stable else "fast"
    norm = rung.norm_bound(found.x, steps) if rung.stable else found.bound
    why = "fewest products of the splittings that keep to the tolerance"
    if kind == "stable" and method.mode == "auto" and steps > MANY:
        why += f", stable ones beyond {MANY} steps"
    if not system.is_real:
        why += "; a shear by a complex H is a product"
    return planned(
        system, method, span,
        scheme=f"{rung.name} ({kind} splitting of {rung.n} shears)",
        steps=found.steps,
        theta=found.x,
        products=found.shears / (2 if system.is_real else 1),
        bound=found.bound + span.roundoff,
        reasons=(why,),
        core=Shears(rung.coefficients, span.sigma, max(TIMES * (norm + span.roundoff), LEAST)),
    )  # fmt: skip


def _windows(span: Span, tol: float, system: Schrodinger, is_real: bool) -> Windows:
    """Return the windows of series that share the tolerance."""
    whole = float(span.intervals.sum())
    windows = windows_of(
        span.intervals, span.beta, (span.least - span.roundoff) / whole, system.size,
        is_real and system.is_real,
    )  # fmt: skip
    # the same windows for every tolerance, so that a tighter one never takes fewer products
    return replace(windows, rate=(tol - span.roundoff) / whole)


def _chebyshev(
    span: Span, method: Planned, windows: Windows, system: Schrodinger, why: tuple[str, ...]
) -> WavePlan:
    """One series for the outputs of each window."""
    tol, counts = method.tol, windows.counts
    if windows.is_real:
        why = (*why, "the start is real, which halves the products of the first series")
    if counts.max() > 1:
        why = (*why, "outputs within a window take no products of their own")
    return planned(
        system, method, span,
        scheme=f"Chebyshev (series of degree {windows.degrees.max()})",
        theta=span.beta * float(windows.lengths.max()),
        products=windows.products,
        bound=tol,
        reasons=why,
        core=Series(span.bounds, windows.rate, max(TIMES * tol, LEAST), tuple(counts.tolist())),
    )  # fmt: skip


def _driven(system: Schrodinger, method: Planned, times: Sequence[float]) -> WavePlan:
    """Series in time, or exponentials where each term of a series would add up many vectors."""
    without = exponentials(system, method, times)
    if without is not None:
        return replace(_magnus(system, without[0], times, without[1]), method=method)
    found = driving(system, times, method.tol)
    span = Span(times[0], tuple(times[1:]), found.spectrum)
    span.check_reach(method.tol)
    rate = (method.tol - span.roundoff) / float(span.intervals.sum())
    points = system.points_between(times[0], times[-1])
    core = Driven(found.parts, rate, max(TIMES * method.tol, LEAST), 0, points)
    hamiltonian, why = system.hamiltonian, []
    if found.separated is not None:
        core, hamiltonian = replace(core, by_differences=True), found.separated.hamiltonian
        why += [found.separated.reason, found.separated.unseen]
    powers, bessel, products, theta, beyond = _core.driven_cost(
        hamiltonian, core, times[0], times[-1]
    )
    why.append("H depends on time; a window has one product for each term of its series")
    if len(span.times) > 1:
        why.append("outputs within a window take no products of their own")
    if bessel:
        why.append(
            f"{bessel} of {powers + bessel} windows by Bessel functions, whose terms are watched "
            "and not bounded beforehand; their products are an estimate"
        )
    if beyond:
        why.append(f"rounding errors of t and of terms may add up to {beyond:.1g} beyond tol")
    return planned(
        system, method, span,
        scheme=f"series in time ({powers + bessel} windows)",
        theta=theta,
        products=float(products),
        bound=None if bessel or found.separated else method.tol + beyond,
        reasons=tuple(why),
        core=replace(core, windows=powers + bessel),
    )  # fmt: skip


def _magnus(system: Schrodinger, method: Magnus, times: Sequence[float], why: str) -> WavePlan:
    """Exponentials with steps chosen while running; the plan estimates how many there may be."""
    found = driving(system, times)
    span = Span(times[0], tuple(times[1:]), found.spectrum)
    span.check_reach(method.tol)
    rate = (method.tol - span.roundoff) / float(span.intervals.sum())
    norm = max(TIMES * method.tol, LEAST)
    points = system.points_between(times[0], times[-1])
    core = MagnusSteps(method.scheme, rate, method.tol, norm, found.parts, points)
    products, theta, by_estimates = magnus_cost(system, core, times, span.bounds)
    order, exponentials = method.scheme
    return planned(
        system, method, span,
        scheme=f"Magnus of order {order}, {exponentials} exponentials by Chebyshev series",
        theta=theta,
        products=products,
        reasons=(why, by_estimates),
        core=core,
    )  # fmt: skip


def _lanczos(span: Span, method: Lanczos, system: Schrodinger) -> WavePlan:
    """Estimate the products by steps that keep the bound of a Krylov space's error."""
    step = _krylov_step(method.dimension, method.tol / max(float(span.thetas.sum()), 1e-300))
    products = float(np.maximum(np.ceil(span.thetas / step), 1).sum())
    rate = method.tol / float(span.intervals.sum())
    return planned(
        system, method, span,
        scheme=f"Lanczos (Krylov spaces of dimension {method.dimension})",
        theta=float(span.thetas.max()),
        products=products * method.dimension,
        reasons=("asked for; the number of products is that of a state of all energies",),
        core=Krylov(method.dimension, rate, max(TIMES * method.tol, LEAST)),
    )  # fmt: skip


def _krylov_step(dimension: int, rate: float) -> float:
    r"""Return the longest step, in units of 1/beta, with an error of `rate` times it.

    The off-diagonal elements of Lanczos' matrix are about half a unit each for a state of all
    energies, and the error of a step s of m of them is at most :math:`(s / 2)^m / m!`.
    """
    m = dimension
    return float(np.exp((np.log(rate) + m * np.log(2.0) + math.lgamma(m + 1)) / (m - 1)))
