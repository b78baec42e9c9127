"""Plans for an H that depends on time: series in time, and Magnus methods to a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from liouville import _core
from liouville._methods import Magnus
from liouville._methods.planner.waves.driven import Planned, driving, exponentials, magnus_cost
from liouville._methods.planner.waves.plan import LEAST_NORM, NORM_TIMES, WavePlan, planned
from liouville._methods.planner.waves.propagators import Driven, MagnusSteps
from liouville._methods.planner.waves.span import Span
from liouville._systems import Schrodinger


def plan_driven(system: Schrodinger, method: Planned, times: Sequence[float]) -> WavePlan:
    """Series in time, or exponentials where each term of a series would add up many vectors."""
    without = exponentials(system, method, times)
    if without is not None:
        return replace(plan_magnus(system, without[0], times, without[1]), method=method)
    found = driving(system, times, method.tol)
    span = Span(times[0], tuple(times[1:]), found.spectrum)
    span.check_reach(method.tol)
    rate = (method.tol - span.roundoff) / float(span.intervals.sum())
    points = system.points_between(times[0], times[-1])
    core = Driven(found.parts, rate, max(NORM_TIMES * method.tol, LEAST_NORM), 0, points)
    hamiltonian, why = system.hamiltonian, []
    if found.separated is not None:
        core, hamiltonian = replace(core, by_differences=True), found.separated.hamiltonian
        why += [found.separated.reason, found.separated.unseen]
    else:
        why.append(span.looks)
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


def plan_magnus(system: Schrodinger, method: Magnus, times: Sequence[float], why: str) -> WavePlan:
    """Exponentials with steps chosen while running; the plan estimates how many there may be."""
    found = driving(system, times)
    span = Span(times[0], tuple(times[1:]), found.spectrum)
    span.check_reach(method.tol)
    rate = (method.tol - span.roundoff) / float(span.intervals.sum())
    norm = max(NORM_TIMES * method.tol, LEAST_NORM)
    points = system.points_between(times[0], times[-1])
    core = MagnusSteps(method.scheme, rate, method.tol, norm, found.parts, points)
    products, theta, by_estimates = magnus_cost(system, core, times, span.bounds)
    order, exponentials = method.scheme
    return planned(
        system, method, span,
        scheme=f"Magnus of order {order}, {exponentials} exponentials by Chebyshev series",
        theta=theta,
        products=products,
        reasons=(why, by_estimates, *([] if system.moving_product else [span.looks])),
        core=core,
    )  # fmt: skip
