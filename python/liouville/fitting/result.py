"""The result of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville.analysis.point import Array
from liouville.fitting.freedoms import values_of
from liouville.solution import Solution


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The best fit, and its uncertainty.

    Attributes
    ----------
    params : dict
        All parameters, the fitted ones with the values found.
    start : dict of str to ndarray
        The start by the system's names, as it was found or given, on its constraints.
    names : tuple of str
        What was fitted: ``params.l``, or ``params.k[0]`` of a vector, then coordinates of the start
        such as ``q.x``.
    covariance : ndarray, shape (K, K)
        Of the values of `names`, linearised at the fit. Across its constraints a start varies with
        the parameters in them alone.
    residuals : ndarray, shape (N,)
        Measured minus computed values over their standard deviations, or over 1 without `sigma`.
    sigma : float or None
        The standard deviation of the measurements found from the residuals, where none was given.
    evaluations : int
        Runs that were made.
    solution : Solution
        The run that fits best, at the times of the measurements.
    """

    params: dict[str, Any]
    start: dict[str, Array]
    names: tuple[str, ...]
    covariance: Array
    residuals: Array
    sigma: float | None
    evaluations: int
    solution: Solution

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations of what was fitted, by name."""
        sizes = np.sqrt(np.diagonal(self.covariance))
        return dict(zip(self.names, sizes.tolist(), strict=True))

    def __repr__(self) -> str:
        """Return the values found with their standard deviations."""
        values = values_of(self.params, self.start, self.solution.names)
        shown = ", ".join(f"{x} = {values[x]:.6g} ± {size:.1g}" for x, size in self.errors.items())
        return f"<Fit: {shown}; {self.residuals.size} values, {self.evaluations} runs>"
