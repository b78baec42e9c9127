"""Plans of the split operator on a grid, with steps of a given size or to a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._methods import SchrodingerSplitting, SplitOperator
from liouville._methods.planner.waves.levels import products_of_levels
from liouville._methods.planner.waves.plan import WavePlan, order_of, planned, usual_split
from liouville._methods.planner.waves.propagators import Looks, Split, SplitSteps
from liouville._methods.planner.waves.resonance import free_step
from liouville._methods.planner.waves.span import LEFT_OUT, Span, check_forwards
from liouville._systems import Schrodinger
from liouville._systems.waves.bounds import Spectrum
from liouville._systems.waves.foreign import times_of_samples

#: Splittings whose steps damp in all although they have kicks back in time, ...
DAMPED = ("BM4", "M4s5", "RKN4s6", "BM6", "SS6s11", "SS6s13", "RKN6s11")
#: ... up to this step in units of hbar over the absorber, as measured.
MOST_DAMPED = 8.0

#: The norm may be off by so much.
NORM = 1e-6

#: Lists of flows of a step, which is made as one and as two halves.
TWICE = 3
#: The same without time, where every second step alone is made as one.
EACH = 2.5

#: A run over an H(t) has so many steps at least, each of which looks thirty times at all points.
LOOKED = 4

#: Parts of the wave numbers that a nonlinear equation is to make do with.
BANDS = (0.125, 0.1768, 0.25, 0.3536, 0.5, 0.7071)

#: A nonlinearity that depends on time is looked at for such parts of the largest density.
PARTS = (1.0, 0.25, 0.0625)

#: A run is begun with so many steps for its plan. The first has that part of the time in which a
#: state changes, times the root of the tolerance by the order.
BEGUN, FIRST = 4, 6.0

#: A product of another method takes about so many times as long as a pair of transforms: 1.2 to 2.3
#: on lines of 128 to 1024 points.
PAIR = 1.5

#: Other methods take so many products at least for each unit of 1/beta, from a real start and from
#: another one.
LEAST = {True: 0.5, False: 0.75}

#: To compare them a run is begun with that part of their products.
PART = 0.25

#: The error of a pair of transforms: 2e-17 to 7e-17 on lines of 64 to 4096 points, all adding up.
PAIRED = 7e-17

#: Energies of a state are at most so many times the root of their mean square, for roundings.
TAIL = 4.0


def plan_split(
    system: Schrodinger, method: SplitOperator, t0: float, stops: Sequence[tuple[float, int]]
) -> WavePlan:
    """Plan a run from t0 with steps between `stops`: times with the steps to each."""
    if method.tol is not None:
        hint = "give SplitOperator without tol=, or leave h and steps out"
        raise TypeError(hinted(f"{method!r} chooses its steps by its tol", hint))
    _check_grid(system)
    times, counts = zip(*stops, strict=True)
    h = float((np.abs(np.diff([t0, *times])) / counts).max())
    why = ["asked for, with steps of this size; a product is a pair of FFTs"]
    why += _left_out(system, method)
    _check_damped(system, method.scheme, (t0, times[-1]), h)
    span = Span(t0, times, _spectrum(system, t0))
    return planned(
        system, method, span,
        scheme=f"split operator {method.scheme}",
        steps=counts,
        theta=span.beta * h,
        products=float(sum(counts) * _drifts(method.scheme)),
        reasons=tuple(why),
        core=Split(method.scheme, NORM),
    )  # fmt: skip


def plan_tolerance(
    system: Schrodinger, method: SplitOperator, times: Sequence[float], psi: np.ndarray
) -> WavePlan:
    """Plan a run to a tolerance from this state, whose first steps are made for the plan."""
    span, core = _steps(system, method, times, psi)
    core, pairs = _begun(system, core, span, psi, BEGUN * TWICE * _drifts(core.scheme))
    tol = method.tol or 0.0
    if tol < (least := 2 * PAIRED * pairs):
        sentence = f"tol = {tol:g} is out of reach: {pairs:.3g} pairs of FFTs have an error of "
        sentence += f"{PAIRED * pairs:.1e} in double precision"
        least = 10 ** np.ceil(np.log10(least))
        hint = f"give tol of {least:g} or more, or a shorter interval"
        raise ValueError(hinted(sentence, hint))
    return _chosen(system, method, span, core, pairs)


def plan_on_grid(
    system: Schrodinger, method: SchrodingerSplitting, times: Sequence[float], psi: np.ndarray
) -> tuple[WavePlan | None, tuple[str, ...]]:
    """Plan a run by the split operator for the tolerance of a method, if nothing else is cheaper.

    How many steps it takes depends on where the state goes, so the run is begun, with a part
    of the least that a series takes, and goes on from there. The error of a split operator is an
    estimate. Without a plan there may be a reason.
    """
    own = usual_split(system, method.tol)
    if not system.is_split:
        return None, ()
    low, high = system.bounds_at(times[0])
    is_real = not (system.is_driven or np.any(psi.imag))
    least = LEAST[is_real] * 0.5 * (high - low) * float(np.abs(np.diff(times)).sum())
    most = PAIR * min(least, products_of_levels(system, len(times) - 1))
    if most < TWICE * _drifts(own.scheme) * max(BEGUN, len(times) - 1):
        return None, ()
    span, core = _steps(system, own, times, psi)
    core, pairs = _begun(system, core, span, psi, int(PART * most))
    if pairs > most or method.tol < 2 * PAIRED * pairs:
        made = 0 if core.begun is None else core.begun.pairs
        return None, (f"a split operator would take more pairs of FFTs, as {made} of them showed",)
    found = _chosen(system, own, span, core, pairs)
    other = f"a series would take {least:.4g} products or more, with a bound of its error"
    return replace(found, method=method, reasons=(*found.reasons, other)), ()


def _steps(
    system: Schrodinger, method: SplitOperator, times: Sequence[float], psi: np.ndarray
) -> tuple[Span, SplitSteps]:
    """Return the span of a run to a tolerance, and its steps."""
    _check_grid(system)
    assert method.tol is not None, "a split operator to a tolerance"
    energy, width = _energies(system, times[0], psi)
    if system.is_driven or system.nonlinearity is not None:
        energy = math.inf
    span = Span(times[0], tuple(times[1:]), _spectrum(system, times[0]), energy)
    span.check_reach(method.tol)
    rate = (method.tol - span.roundoff) / float(span.intervals.sum())
    longest, bands = longest_steps(system, method, times, psi)
    first, order = bands[0][1] if bands else longest, order_of(system, method)
    if width:
        first = min(first, FIRST * method.tol ** (1 / order) / width)
    points = system.points_between(times[0], times[-1])
    looks = _looks(system, times, points, psi)
    core = SplitSteps(
        method.scheme, order, rate, span.beta, span.largest, first, longest, bands, points, looks,
        NORM,
    )  # fmt: skip
    return span, core


def _energies(system: Schrodinger, t: float, psi: np.ndarray) -> tuple[float, float]:
    """Return how large energies of a state are, over hbar, and the width of their distribution."""
    (start,), product = np.atleast_2d(psi)[:1], system.product_at(t)
    parts = [start.real, start.imag]
    if system.hamiltonian.size > system.size:
        parts = [np.concatenate(parts)]
    moved = np.concatenate([product(np.ascontiguousarray(part)) for part in parts])
    flat = np.concatenate(parts)
    size = float(np.linalg.norm(flat))
    largest, mean = float(np.linalg.norm(moved)) / size, float(flat @ moved) / size**2
    return TAIL * largest, float(np.sqrt(max(largest**2 - mean**2, 0.0)))


def _looks(
    system: Schrodinger, times: Sequence[float], points: tuple[float, ...], psi: np.ndarray
) -> Looks:
    """Return where functions of time are looked at before a run."""
    if not system.is_driven:
        return 0.0, 0.0, (), (), ()
    densities: tuple[float, ...] = ()
    if system.nonlinearity is not None and system.nonlinearity.is_driven:
        largest = system.density(np.atleast_2d(psi)[0]).max(axis=0)
        densities = tuple(np.outer(PARTS, largest).ravel().tolist())
    knots = times_of_samples(system.drives, 3)
    return times[0], times[-1], knots, tuple(sorted(points)), densities


def _begun(
    system: Schrodinger, core: SplitSteps, span: Span, psi: np.ndarray, pairs: int
) -> tuple[SplitSteps, float]:
    """Begin a run with so many pairs of transforms, and estimate how many it takes in all."""
    first = (span.t0, span.times[0])
    start = np.atleast_2d(psi)[:1]
    begun = _core.split_beginning(system.hamiltonian, core, first, pairs, start)
    left = np.array([abs(span.times[0] - begun.reached), *span.intervals[1:]])
    is_steady = not system.is_driven and system.nonlinearity is None
    lists = (EACH if is_steady else TWICE) * _drifts(core.scheme)
    whole = begun.pairs + lists * float(np.ceil(left / begun.next).sum())
    return replace(core, begun=begun), whole


def _chosen(
    system: Schrodinger, method: SplitOperator, span: Span, core: SplitSteps, pairs: float
) -> WavePlan:
    """Make the plan of a run by these steps, which takes about so many pairs."""
    made = 0 if core.begun is None else core.begun.pairs
    why = [
        f"steps are chosen by estimates while running, the first is {core.first:.3g} long; "
        f"products are pairs of FFTs, an estimate by the first {made} of them",
        *_left_out(system, method),
    ]
    if system.is_driven:
        why.append(span.looks)
    return planned(
        system, method, span,
        scheme=f"split operator {core.scheme} with steps by its tolerance",
        theta=span.beta * core.first,
        products=pairs,
        reasons=tuple(why),
        core=core,
    )  # fmt: skip


def longest_steps(
    system: Schrodinger, method: SplitOperator, times: Sequence[float], psi: np.ndarray | None
) -> tuple[float, tuple[tuple[float, float], ...]]:
    """Return the longest step that a run to a tolerance may take, and those with fewer waves.

    It damps in an absorber, is in no resonance of a nonlinearity with waves of the state `psi`,
    and looks at an H(t) often enough. Without a state there is no look at resonances.
    """
    run, scheme = (times[0], times[-1]), method.scheme
    longest = abs(run[1] - run[0]) / (LOOKED if system.is_driven else 1)
    if system.absorber is not None:
        _check_damped(system, scheme, run, 0.0)
        if _is_back(scheme):
            longest = min(longest, MOST_DAMPED * system.hbar / float(system.absorber.max()))
    if system.nonlinearity is None or psi is None:
        return longest, ()
    *free, of_all = free_step(system, scheme, run, method.tol or 0.0, psi, (*BANDS, 1.0))
    if of_all >= longest:
        return longest, ()
    bands = zip(BANDS, (min(each, longest) for each in free), strict=True)
    return of_all, tuple(bands)


def _spectrum(system: Schrodinger, t0: float) -> Spectrum:
    return Spectrum(system.bounds_at(t0), system.guarantee)


def _check_grid(system: Schrodinger) -> None:
    """Refuse an H that is not T + V on a grid."""
    if system.grid is None:
        sentence = f"SplitOperator steps a Grid, whose energy is T + V, not {system!r}"
        raise TypeError(hinted(sentence, "take SchrodingerSplitting, or Magnus for H(t)"))
    if not system.has_diagonal_drive:
        sentence = "SplitOperator takes drives by diagonal matrices alone, which add to V"
        hint = "take Magnus, or give the drive as a potential of t and x"
        raise TypeError(hinted(sentence, hint))
    if not system.is_real:
        sentence = "SplitOperator takes a coupling that phases of the components make real, and "
        raise TypeError(hinted(f"{sentence}none do here", "take 'auto', or Chebyshev"))


def _left_out(system: Schrodinger, method: SplitOperator) -> list[str]:
    """Return sentences on parts of H that its spectrum is without, or that lower the order."""
    why = []
    if (order := order_of(system, method)) < method.order:
        why.append(f"{method.scheme} has order {order} where components are coupled; BM6 has 6")
    if system.nonlinearity is not None:
        why.append("the spectrum is that of T + V, without the nonlinearity")
    if system.absorber is not None:
        why.append(LEFT_OUT)
    return why


def _drifts(scheme: str) -> int:
    """Return the pairs of transforms of a step."""
    return sum(not is_kick for is_kick, _, _ in _core.split_program(scheme))


def _is_back(scheme: str) -> bool:
    """Return whether some kicks go back in time."""
    return any(is_kick and weight < 0 for is_kick, weight, _ in _core.split_program(scheme))


def _check_damped(system: Schrodinger, scheme: str, run: tuple[float, float], h: float) -> None:
    """Refuse kicks back in time that an absorber makes grow by more than others damp."""
    if system.absorber is None:
        return
    check_forwards(run[1] - run[0])
    if not _is_back(scheme):
        return
    if scheme not in DAMPED:
        sentence = f"{scheme} has flows back in time in which an absorber makes psi grow"
        raise ValueError(hinted(sentence, f"take one of S2, {', '.join(DAMPED)}"))
    if h * (largest := float((system.absorber / system.hbar).max())) > MOST_DAMPED:
        sentence = f"steps of {h:g} are too long for an absorber of {largest:g} hbar: {scheme} has "
        sentence += "flows back in time, in which psi would grow"
        raise ValueError(hinted(sentence, f"give h of {MOST_DAMPED / largest:.3g} or less, or S2"))
