"""The ladder of accuracy-optimised splittings, and what is known of their errors beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from liouville import _core

Array = NDArray[np.float64]

#: Half the distance of 1 to the next number.
ROUNDOFF = 2.0**-53

#: How much longer than the longest possible steps are tried to be shorter.
SHORTER = (1.0, 1.06, 1.12, 1.25, 1.5, 2.0)

#: Lengths that differ by less are the same.
SAME = 1e-9

#: Intervals that are compared in one pass.
BLOCK = 1000

#: The exponential of more is no number.
MOST = 700.0


@dataclass(frozen=True)
class Rung:
    r"""A splitting of the ladder.

    Attributes
    ----------
    name : str
        What it is called in the table.
    coefficients : ndarray, shape (n,)
        Those of the shears of q and p in turn.
    stable : bool
        Whether its powers stay bounded for every eigenvalue in range.
    theta : float
        The largest :math:`x = h |\lambda - \sigma|` it is made for.
    fractions, err, dphi, kappa : ndarray
        Up to each of these fractions of theta: the error of a step, the error of its phase, and
        how far the form it keeps is from the norm.
    gain : float
        How much a step makes of roundings.
    """

    name: str
    coefficients: Array
    stable: bool
    theta: float
    fractions: Array
    err: Array
    dphi: Array
    kappa: Array
    gain: float

    @property
    def n(self) -> int:
        """Number of shears of a step."""
        return len(self.coefficients)

    def norm_bound(self, x: float, steps: int, stretches: int) -> float:
        """Bound how far the norm may be off after up to so many steps and stretches, if stable."""
        place = int(np.searchsorted(self.fractions * self.theta, x * (1 - 1e-12)))
        kappa = float(self.kappa[place])
        of_forms = np.expm1(min(stretches * (kappa + kappa**2), MOST))
        return float(of_forms + ROUNDOFF * np.sqrt(steps) * self.gain)


@cache
def ladder() -> tuple[Rung, ...]:
    """Return the ladder, as the core has it."""
    return tuple(
        Rung(
            name=each["id"],
            coefficients=each["coefficients"],
            stable=each["stable"],
            theta=each["theta"],
            fractions=each["fractions"],
            err=each["err"],
            dphi=each["dphi"],
            kappa=each["kappa"],
            gain=each["gain"],
        )
        for each in _core.ladder()
    )


@dataclass(frozen=True)
class Choice:
    """A rung and the steps of each interval, which are of one size within each of the stretches."""

    rung: Rung
    steps: Array
    x: float
    bound: float
    stretches: int

    @property
    def shears(self) -> int:
        """Real products in all."""
        return int(self.steps.sum()) * self.rung.n


def cheapest(thetas: Array, tol: float, stable: bool) -> Choice | None:
    """Find what keeps to a tolerance over intervals of these lengths, in units of 1/beta.

    Returns
    -------
    Choice or None
        That of fewest products, the most accurate of them; None if there is none.
    """
    rungs, columns = _table(stable)
    rung = np.arange(len(rungs)).repeat(len(SHORTER))
    longest = columns.theta[rung] / np.tile(SHORTER, len(rungs))
    lengths, repeats = np.unique(thetas, return_counts=True)
    x, total = np.zeros(rung.size), np.zeros(rung.size)
    for first in range(0, lengths.size, BLOCK):
        part = lengths[first : first + BLOCK]
        steps = _steps(part, longest[:, None])
        x = np.maximum(x, (part / steps).max(axis=1))
        total += steps @ repeats[first : first + BLOCK]
    stretches = 1 + int(np.count_nonzero(np.abs(np.diff(thetas)) > SAME * thetas[1:]))
    bounds = columns.bounds(rung, x, total, stretches)
    keeping = np.flatnonzero(bounds <= tol)
    if not keeping.size:
        return None
    shears = columns.n[rung] * total
    best = keeping[np.lexsort((bounds[keeping], shears[keeping]))[0]]
    steps = _steps(thetas, longest[best])
    return Choice(rungs[rung[best]], steps, float(x[best]), float(bounds[best]), stretches)


def _steps(lengths: Array, longest: Array) -> Array:
    """Return the least numbers of steps that are no longer than the longest."""
    steps: Array = np.maximum(np.ceil(lengths / longest * (1 - 1e-12)), 1.0)
    return steps


@dataclass(frozen=True)
class Columns:
    """Some rungs as arrays, each with one row or number for a rung."""

    theta: Array
    n: Array
    stable: NDArray[np.bool_]
    limits: Array
    err: Array
    dphi: Array
    kappa: Array
    gain: Array

    def bounds(self, rung: NDArray[np.intp], x: Array, steps: Array, stretches: int) -> Array:
        r"""Bound errors after numbers of steps of size :math:`h \beta = x`, relative to the norm.

        :math:`(1 + e)^N - 1` for the error e of a step. For the errors of a stable method over
        stretches of steps of one size, the sum of the logarithms is at most
        :math:`N \delta\phi` and :math:`\kappa + \kappa^2/2` for each stretch. Roundings in the
        shears are in it, those of the energies come on top.
        """
        place = (self.limits[rung] < x[:, None]).sum(axis=1)
        is_in = place < self.limits.shape[1]
        place = np.where(is_in, place, 0)
        kappa = self.kappa[rung, place]
        logs = steps * np.log1p(self.err[rung, place])
        turned = steps * self.dphi[rung, place] + stretches * (kappa + kappa**2 / 2)
        logs = np.where(self.stable[rung], np.minimum(logs, turned), logs)
        bounds = np.expm1(np.minimum(logs, MOST))
        bounds += ROUNDOFF * np.sqrt(steps) * self.gain[rung]
        return np.where(is_in, bounds, np.inf)


@cache
def _table(stable: bool) -> tuple[tuple[Rung, ...], Columns]:
    """Return the rungs, or the stable ones alone, and their columns."""
    rungs = tuple(rung for rung in ladder() if rung.stable or not stable)
    fractions = np.array([rung.fractions for rung in rungs])
    theta = np.array([rung.theta for rung in rungs])
    return rungs, Columns(
        theta=theta,
        n=np.array([rung.n for rung in rungs]),
        stable=np.array([rung.stable for rung in rungs]),
        limits=fractions * theta[:, None] * (1 + 1e-12),
        err=np.array([rung.err for rung in rungs]),
        dphi=np.array([rung.dphi for rung in rungs]),
        kappa=np.array([rung.kappa for rung in rungs]),
        gain=np.array([rung.gain for rung in rungs]),
    )
