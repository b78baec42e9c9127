"""The result of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.arguments import amount
from liouville._basics.errors import Suggesting, hinted
from liouville._solution.solution import Solution
from liouville._studies.fitting.freedoms import values_of
from liouville._studies.fitting.profile import Profile, interval
from liouville.analysis.point import Array

#: So many values are shown.
SHOWN = 12

#: Residuals beyond so many deviations are counted as outliers.
OUTLYING = 5.0


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
    t : ndarray, shape (w,)
        The time of each of them.
    quantities : tuple of str
        What each of them is of: a coordinate, ``v[x]`` of another state, or a function's name.
    solution : Solution
        Its run, at the times of its measurements.
    """

    params: dict[str, Any]
    start: dict[str, Any]
    residuals: Array
    t: Array
    quantities: tuple[str, ...]
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
        values, each = self.values, [*self.errors.items()]
        shown = ", ".join(f"{x} = {values[x]:.6g} ± {size:.1g}" for x, size in each[:SHOWN])
        if len(each) > SHOWN:
            shown += f" and {len(each) - SHOWN} more"
        good = f"chi2/dof = {self.chi2 / self.dof:.3g}" if self.dof else "chi2 of no freedom"
        if self.sigma is not None:
            good = f"sigma = {self.sigma:.3g}"
        elif outliers := int((np.abs(self.residuals) > OUTLYING).sum()):
            good += f", {outliers} beyond {OUTLYING:g} sigma"
        counts = f"{amount(self.residuals.size, 'value')}, {amount(self.evaluations, 'run')}"
        return f"<Fit: {shown}; {good}; {counts}{self.message and chr(10) + ' '}{self.message}>"


@dataclass(frozen=True)
class Least:
    """Where squares are least: residuals in units of the weights, and derivatives by the unknowns.

    Attributes
    ----------
    residuals, jacobian, covariance : ndarray
        Shapes (N,), (N, K) and (K, K), the last for measurements of deviation one.
    loss : float
        The sum of losses, that is least.
    """

    residuals: Array
    jacobian: Array
    covariance: Array
    loss: float

    @property
    def size(self) -> float:
        """The sum of squares."""
        return float(self.residuals @ self.residuals)
