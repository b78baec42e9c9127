"""The result of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.arguments import amount
from liouville._basics.errors import Suggesting, hinted
from liouville._solution.solution import Solution
from liouville._studies.fitting.freedoms import values_of
from liouville._studies.fitting.profile import Profile, interval
from liouville.analysis.point import Array

#: Sums of squares so many standard deviations from what is expected are not by chance.
UNLIKELY = 5.0
#: Half of normal residuals are below 0.67 deviations; so many are not by chance.
MOST = 2.0
#: Residuals that spread by more than this part of the measurements may not be noise alone.
POOR = 0.3
#: A value is at a bound within this part of its standard deviation.
AT_BOUND = 1e-3
#: Residuals beyond so many deviations are counted as outliers.
OUTLYING = 5.0
#: A step that moves a value by more than this part of its standard deviation decides it.
DECIDES = 0.5
#: Data without noise are taken to tell a value to this part of it.
DIGITS = 1e-9


@dataclass(frozen=True, eq=False)
class Fitted(Suggesting):
    """One trial as it was fitted.

    Attributes
    ----------
    params : dict
        All parameters of the trial.
    start : dict of str to ndarray
        Its start, on its constraints; each of shape (n,).
    residuals : ndarray, shape (w,)
        Its part of the residuals of the fit, in units of their deviations.
    solution : Solution
        Its run, at the times of its measurements.
    """

    params: dict[str, Any]
    start: dict[str, Any]
    residuals: Array
    solution: Solution


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Suggesting):
    """The best fit, and its uncertainty.

    Attributes
    ----------
    params : dict
        All parameters, the fitted ones with the values found.
    trials : tuple of Fitted
        Each motion that was measured: ``params``, ``start``, ``residuals`` and ``solution``.
    solution : Solution
        The run of the one trial that fits best, at the times of the measurements; ``start`` is its
        start, as it was found or given, on its constraints.
    names : tuple of str
        What was fitted: ``params.l``, or ``params.k[0]`` of a vector, then coordinates of the start
        such as ``q.x``, with several trials ``trials[0].q.x``.
    covariance : ndarray, shape (K, K)
        Of the values of `names`, linearised at the fit. Across its constraints a start varies with
        the parameters in them alone.
    residuals : ndarray, shape (N,)
        Measured minus computed values over their standard deviations, or over 1 without `sigma`,
        of one trial after another, then of the priors.
    chi2 : float
        Their sum of squares.
    dof : int
        N - K, the number of measurements less that of unknowns. Where `sigma` is given and the
        model is right, ``chi2`` is about this, with a standard deviation of ``sqrt(2 * dof)``.
    sigma : float or None
        The standard deviation of the measurements found from the residuals, where none was given.
    evaluations : int
        Runs that were made.
    message : str
        Where residuals are not of the size of the `sigma` given, or without it spread by more than
        0.3 of what measurements do, where fits to growing parts of the time led to a lower minimum
        than the guess, and where the step and not the data decides:
        values would move by more than half of their standard deviation with half the step, or a
        hundredth of the tolerance; and which values are at a bound. Empty otherwise.
    """

    params: dict[str, Any]
    trials: tuple[Fitted, ...]
    names: tuple[str, ...]
    covariance: Array
    residuals: Array
    sigma: float | None
    dof: int
    evaluations: int
    message: str = ""
    _profile: Profile | None = None

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        r"""Return the interval of a parameter by profile likelihood.

        At its ends the sum of squares, least over all other unknowns, is above the best by
        :math:`\chi^2_1` of the level, without `sigma` by :math:`F_{1, N - K}` of it and the mean
        square. It is not the symmetric one of `errors` where the model bends, and it ends at a
        bound of the parameter.

        Parameters
        ----------
        name : str
            A number that was fitted, such as ``"params.l"``.
        level : float
            How often it holds the truth.

        Returns
        -------
        tuple of two floats
            Infinite on a side where no value is refuted.

        Raises
        ------
        ValueError
            There is no such parameter, or the loss is a robust one.
        """
        if self._profile is None:
            sentence = "a fit by a robust loss, or one that was pickled, has no interval"
            raise ValueError(hinted(sentence, "errors has standard deviations"))
        return interval(self, self._profile, name, level)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what fits again, whose functions may be the user's."""
        return {**self.__dict__, "_profile": None}

    @property
    def start(self) -> dict[str, Any]:
        """The start of the one trial."""
        return self._one.start

    @property
    def solution(self) -> Solution:
        """The run of the one trial."""
        return self._one.solution

    @property
    def _one(self) -> Fitted:
        if len(self.trials) > 1:
            sentence = f"the fit has {len(self.trials)} trials, each with a start and a solution"
            raise AttributeError(hinted(sentence, "write fit.trials[0].solution"))
        return self.trials[0]

    @property
    def values(self) -> dict[str, float]:
        """All parameters and starts, by the names of :attr:`errors`."""
        values: dict[str, float] = {}
        for k, trial in enumerate(self.trials):
            own = values_of(self.params, trial.start, trial.solution.names)
            prefix = f"trials[{k}]." if len(self.trials) > 1 else ""
            values |= {x if x.startswith("params.") else prefix + x: v for x, v in own.items()}
        return values

    @property
    def correlation(self) -> Array:
        """The correlations of what was fitted, shape (K, K)."""
        sizes = np.sqrt(np.diagonal(self.covariance))
        found: Array = self.covariance / np.outer(sizes, sizes)
        return found

    @property
    def chi2(self) -> float:
        """The sum of squares of the residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations of what was fitted, by name."""
        sizes = np.sqrt(np.diagonal(self.covariance))
        return dict(zip(self.names, sizes.tolist(), strict=True))

    def __repr__(self) -> str:
        """Return the values found with their standard deviations, and how well they fit."""
        values = self.values
        shown = ", ".join(f"{x} = {values[x]:.6g} ± {size:.1g}" for x, size in self.errors.items())
        good = f"chi2/dof = {self.chi2 / self.dof:.3g}" if self.dof else "chi2 of no freedom"
        if self.sigma is not None:
            good = f"sigma = {self.sigma:.3g}"
        elif outliers := int((np.abs(self.residuals) > OUTLYING).sum()):
            good += f", {outliers} beyond {OUTLYING:g} sigma"
        counts = f"{amount(self.residuals.size, 'value')}, {amount(self.evaluations, 'run')}"
        return f"<Fit: {shown}; {good}; {counts}{self.message and chr(10) + ' '}{self.message}>"


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
