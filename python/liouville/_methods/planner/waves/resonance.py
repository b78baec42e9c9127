"""Resonances of the split operator where a potential depends on the density."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from liouville import _core
from liouville._methods.planner.waves.plan import WavePlan
from liouville._methods.planner.waves.propagators import Split, SplitSteps
from liouville._systems import Schrodinger

#: Noise that grows by less than this, in powers of e, is no matter: roundoff becomes 1e-7.
GROWTH = 20.0

#: The size of F_m below which a resonance is weak, and no m beyond this is looked at.
WEAK, LAST = 0.1, 64

#: Noise of waves at first, and the part of a tolerance that it may grow to.
NOISE, PART = 1e-15, 1e-2


def resonance(system: Schrodinger, plan: WavePlan, psi: np.ndarray) -> str:
    r"""Return a sentence on waves that the steps of a plan may be in resonance with, or "".

    A density :math:`\rho` and waves of kinetic energy T are near one where

    .. math::

        |h (T + \rho W') - m \pi| < h \rho W' |F_m|, \qquad
        F_m = \sum_j b_j e^{-2 \pi i m c_j}

    with kicks :math:`b_j` at the parts :math:`c_j` of a step; there noise grows at the rate
    :math:`\rho W' |F_m|` :cite:p:`weideman1986`.

    Raises
    ------
    ValueError
        The nonlinearity is not finite at a density of the start.
    """
    assert isinstance(plan.core, Split | SplitSteps), "the methods for a nonlinearity"
    largest, strength = _energies(system, plan.t0, psi)
    times = np.array(plan.times)
    if isinstance(plan.core, SplitSteps):
        h = plan.core.longest
    else:
        h = float(np.abs(np.diff(times) / [count for _, count in plan.stops]).max())
    found = (0.0, 0)
    for m in range(1, math.floor(h * (largest + 2 * strength) / math.pi) + 1):
        factor = _factor(plan.core.scheme, m)
        if h * (largest + strength * (1 + factor)) > m * math.pi:
            found = max(found, (strength * factor * float(np.abs(times[-1] - times[0])), m))
    if found[0] < GROWTH:
        return ""
    return (
        f"steps of {h:.4g} may be in resonance with waves of kinetic energy "
        f"{system.hbar * found[1] * math.pi / h:.4g}, so that noise may grow by up to "
        f"e^{found[0]:.0f}: below h = {math.pi / (largest + 2 * strength):.3g} none are"
    )


def free_step(
    system: Schrodinger,
    scheme: str,
    run: tuple[float, float],
    tol: float,
    psi: np.ndarray,
    parts: Sequence[float],
) -> list[float]:
    """Return the longest steps in no resonance at which noise grows much; see :func:`resonance`.

    They are those with parts of the wave numbers. Over a run noise may grow to a part of the
    tolerance.
    """
    largest, strength = _energies(system, run[0], psi)
    grown = strength * abs(run[1] - run[0])
    growth = min(math.log(PART * tol / NOISE), GROWTH)
    weak = max(WEAK, growth / max(grown, 1e-300))
    first = next(m for m in itertools.count(1) if m > LAST or _factor(scheme, m) > weak)
    return [first * math.pi / (part**2 * largest + 2 * strength) for part in parts]


def _energies(system: Schrodinger, t: float, psi: np.ndarray) -> tuple[float, float]:
    """Return the largest kinetic energy of waves and that of a change of the density, over hbar."""
    assert system.grid is not None, "a nonlinearity is one on a grid"
    assert system.nonlinearity is not None, "waves of a linear equation have no resonances"
    rho = system.density(psi)
    system.nonlinearity.at(t, rho)
    root = np.sqrt(rho)
    slopes = root[:, :, None] * system.nonlinearity.slope(t, rho) * root[:, None, :]
    sizes = np.sqrt((slopes**2).sum(axis=(1, 2)))  # eigenvalues are no larger
    strength = float(sizes[np.isfinite(sizes)].max(initial=0.0)) / system.hbar
    largest = sum(float(each.max()) for each in system.grid.kinetic(system.hbar)) / system.hbar
    return largest + system.coupled / system.hbar, strength


def _factor(scheme: str, m: int) -> float:
    """Return the size of F_m."""
    kicks = [(b, c) for is_kick, b, c in _core.split_program(scheme) if is_kick]
    weights, places = np.array(kicks).T
    return float(abs(weights @ np.exp(-2j * np.pi * m * places)))
