"""The ladder of accuracy-optimised splittings, and what is known of their errors beforehand."""

from __future__ import annotations

from collections.abc import Iterator
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

    def bound(self, x: float, steps: int) -> float:
        r"""Bound the error after so many steps of size :math:`h \beta = x`, relative to the norm.

        :math:`(1 + e)^N - 1` for the error e of a step; of a stable method at most
        :math:`N \delta\phi + \kappa + \kappa^2/2`. Roundings in the shears are in it, those of
        the energies come on top.
        """
        place = int(np.searchsorted(self.fractions * self.theta * (1 + 1e-12), x))
        if place == len(self.fractions):
            return np.inf
        with np.errstate(over="ignore"):
            bound = np.expm1(steps * np.log1p(self.err[place]))
        if self.stable:
            kappa = self.kappa[place]
            bound = min(bound, steps * self.dphi[place] + kappa + kappa**2 / 2)
        return float(bound + ROUNDOFF * np.sqrt(steps) * self.gain)

    def norm_bound(self, x: float, steps: int) -> float:
        """Bound how far the norm may be off after any number of steps up to this."""
        if not self.stable:
            return self.bound(x, steps)
        place = int(np.searchsorted(self.fractions * self.theta, x * (1 - 1e-12)))
        kappa = float(self.kappa[place])
        return kappa + kappa**2 + float(ROUNDOFF * np.sqrt(steps) * self.gain)


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
    """A rung and the steps of each interval."""

    rung: Rung
    steps: Array
    x: float
    bound: float

    @property
    def shears(self) -> int:
        """Real products in all."""
        return int(self.steps.sum()) * self.rung.n


def choices(thetas: Array, tol: float, stable: bool) -> Iterator[Choice]:
    """Yield what keeps to a tolerance over intervals of these lengths, in units of 1/beta."""
    for rung in ladder():
        if rung.stable or not stable:
            for shorter in SHORTER:
                steps = np.maximum(np.ceil(thetas / rung.theta * shorter * (1 - 1e-12)), 1.0)
                x = float((thetas / steps).max())
                bound = rung.bound(x, int(steps.sum()))
                if bound <= tol:
                    yield Choice(rung, steps, x, bound)


def cheapest(thetas: Array, tol: float, stable: bool) -> Choice | None:
    """Return the choice of fewest products, the most accurate of them; None if there is none."""
    found = choices(thetas, tol, stable)
    return min(found, key=lambda choice: (choice.shears, choice.bound), default=None)
