"""The choice of a method by the kind of H and what is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods import Chebyshev, Lanczos, Magnus, SchrodingerSplitting, SplitOperator
from liouville._methods.planner.waves.driven import Planned
from liouville._methods.planner.waves.levels import cheaper_by_levels
from liouville._methods.planner.waves.moving import plan_driven, plan_magnus
from liouville._methods.planner.waves.plan import WavePlan, usual_split
from liouville._methods.planner.waves.settled import Settled
from liouville._methods.planner.waves.span import Span
from liouville._methods.planner.waves.split import plan_on_grid, plan_tolerance
from liouville._systems import Schrodinger
from liouville._systems.waves.foreign import check_sampled

#: The method that "auto" stands for; messages use that word.
AUTO = SchrodingerSplitting()


def name_of(method: Planned | SplitOperator) -> str:
    """Return a method's name as a user writes it."""
    return "'auto'" if method is AUTO else type(method).__name__


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
    if is_differentiated:
        system.check_plain("a derivative of a run", "leave it out, or take differences of runs")
    is_free = method is AUTO and not is_differentiated
    if is_free and not system.is_plain:
        if not system.is_split:
            return plan_wave(system, Lanczos(AUTO.tol), times)
        plan = plan_run(system, usual_split(system, AUTO.tol), times, psi)
        return replace(plan, method=AUTO)
    said: tuple[str, ...] = ()
    if is_free and psi is not None:
        found, said = plan_on_grid(system, AUTO, times, psi)
        if found is not None:
            return found
    plan = plan_wave(system, method, times, psi is not None and not np.any(psi.imag))
    if is_free:
        plan = cheaper_by_levels(system, plan, AUTO, times)
    return replace(plan, reasons=(*plan.reasons, *said)) if said else plan


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
        return plan_magnus(system, method, times, "asked for")
    if system.is_driven:
        return plan_driven(system, method, times)
    spectrum = system.spectrum(float(np.abs(np.diff(times)).sum()))
    return Settled(system, Span(times[0], tuple(times[1:]), spectrum), is_real).plan(method)


def _check_system(system: Schrodinger, method: Planned) -> None:
    """Refuse an H that depends on time, absorbs, or depends on the density, for what takes none."""
    if system.absorber is not None and system.is_driven:
        sentence = "an H(t) that absorbs is stepped on a Grid alone, with diagonal drives"
        raise TypeError(hinted(sentence, "take SplitOperator(tol=1e-8) there"))
    if isinstance(method, Lanczos):
        system.check_linear(name_of(method))
    else:
        system.check_plain(name_of(method))
    takes_time = isinstance(method, Chebyshev | Magnus) or getattr(method, "mode", "") == "auto"
    if system.is_driven and not takes_time:
        hint = "take 'auto' or Magnus(), or SplitOperator(tol=1e-8) on a grid"
        raise TypeError(hinted(f"{method!r} is for an H without time", hint))
