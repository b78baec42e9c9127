"""Resonances of the split operator where a potential depends on the density."""

from __future__ import annotations

import math

import numpy as np

from liouville import _core
from liouville._methods.planner.waves.plan import WavePlan
from liouville._methods.planner.waves.propagators import Split
from liouville._systems import Schrodinger

#: Noise that grows by less than this, in powers of e, is no matter: roundoff becomes 1e-7.
GROWTH = 20.0


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
    assert system.grid is not None, "a nonlinearity is one on a grid"
    assert system.nonlinearity is not None, "waves of a linear equation have no resonances"
    assert isinstance(plan.core, Split), "the one method for a nonlinearity"
    rho = system.density(psi).ravel()
    system.nonlinearity.at(plan.t0, rho)
    slopes = rho * system.nonlinearity.slope(plan.t0, rho)
    strength = float(np.abs(slopes[np.isfinite(slopes)]).max(initial=0.0)) / system.hbar
    times = np.array(plan.times)
    steps = np.array([count for _, count in plan.stops])
    h = float(np.abs(np.diff(times) / steps).max())
    largest = sum(float(each.max()) for each in system.grid.kinetic(system.hbar)) / system.hbar
    kicks = [(b, c) for is_kick, b, c in _core.split_program(plan.core.scheme) if is_kick]
    weights, places = np.array(kicks).T
    found = (0.0, 0)
    for m in range(1, math.floor(h * (largest + 2 * strength) / math.pi) + 1):
        factor = abs(weights @ np.exp(-2j * np.pi * m * places))
        if h * (largest + strength * (1 + factor)) > m * math.pi:
            found = max(found, (strength * factor * float(np.abs(times[-1] - times[0])), m))
    if found[0] < GROWTH:
        return ""
    return (
        f"steps of {h:.4g} may be in resonance with waves of kinetic energy "
        f"{system.hbar * found[1] * math.pi / h:.4g}, so that noise may grow by up to "
        f"e^{found[0]:.0f}: below h = {math.pi / (largest + 2 * strength):.3g} none are"
    )
