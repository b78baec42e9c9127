"""Remarks on a fit: on its residuals, its bounds and its steps, and on one that is not found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from liouville._basics.errors import hinted
from liouville._studies.fitting.result import Fit
from liouville.analysis.point import Array

#: Sums of squares so many standard deviations from what is expected are not by chance.
UNLIKELY = 5.0
#: Half of normal residuals are below 0.67 deviations; so many are not by chance.
MOST = 2.0
#: Residuals that spread by more than this part of the measurements may not be noise alone.
POOR = 0.3
#: A value is at a bound within this part of its standard deviation.
AT_BOUND = 1e-3
#: A step that moves a value by more than this part of its standard deviation decides it.
DECIDES = 0.5
#: Data without noise are taken to tell a value to this part of it.
DIGITS = 1e-9


def of_size(residuals: Array, dof: int) -> str:
    """Say where residuals are not of the size of the deviation given."""
    if not dof:
        return ""
    chi2 = float(residuals @ residuals)
    if abs(chi2 - dof) <= UNLIKELY * np.sqrt(2 * dof):
        return ""
    times = np.sqrt(chi2 / dof)
    why = (
        "the model, the minimum found or sigma is not right" if times > 1 else "sigma is too large"
    )
    return f"residuals are {times:.2g} times as large as sigma: {why}"


def of_most(residuals: Array) -> str:
    """Say where residuals are not of the size of the deviation given, but for outliers."""
    half = float(np.median(np.abs(residuals)))
    if half <= MOST:
        return ""
    why = "the model, the minimum found or sigma is not right"
    return f"half of the residuals are beyond {half:.2g} sigma: {why}"


def of_spread(residuals: float, measured: float) -> str:
    """Say where residuals of no known deviation are as large as what was measured."""
    if residuals <= POOR * measured:
        return ""
    times = f"{residuals / measured:.2g}" if measured else "far more than 1"
    why = "where that is no noise, the model or the minimum found is not right"
    return f"residuals spread by {times} of what measurements do: {why}"


def of_bounds(names: Sequence[str], theta: Array, bounds: Array, deviations: Array) -> str:
    """Say which values have come to a bound."""
    near = AT_BOUND * deviations[: len(theta), None]
    is_at = np.abs(bounds - theta[:, None]) <= near
    there = [f"{names[k]} = {theta[k]:.6g}" for k in np.flatnonzero(is_at.max(axis=1)).tolist()]
    if not there:
        return ""
    return f"at a bound, of which deviations know nothing: {', '.join(there)}"


def of_none(runs: int, met: Sequence[tuple[str, float] | None]) -> str:
    """Return the fault of a fit that comes to no minimum."""
    sentence = f"no fit is found in {runs} runs"
    hint = "begin nearer, fit to a shorter time first, and see that data have the model's units"
    for each in filter(None, met):
        sentence += f": at the best values '{each[0]}' is met at t = {each[1]:.6g}, where a "
        sentence += "measurement lies, and the sum of squares bends there"
        hint = "leave out the measurement at that time"
    return hinted(sentence, hint)


def of_step(fit: Fit, moved: Array) -> str:
    """Say where the step decides, and not the data: where half of it moves what was fitted."""
    if not np.isfinite(moved).all():
        return "the run with half the step fails, so that nothing is known of the step"
    values = fit.values
    known = [max(size, DIGITS * abs(values[x])) for x, size in fit.errors.items()]
    parts = [abs(d) / of if of else 0.0 for d, of in zip(moved, known, strict=True)]
    k = int(np.argmax(parts))
    if not parts[k] > DECIDES:
        return ""
    return (
        f"the step decides more than the data: half of it moves {fit.names[k]} by {moved[k]:.2g}, "
        f"and its deviation is {[*fit.errors.values()][k]:.2g}; "
        "take a smaller h or a method of higher order"
    )
