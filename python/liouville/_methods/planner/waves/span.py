"""The times and the spectrum of a plan, and the tolerances within their reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted
from liouville._methods.planner.waves.ladder import ROUNDOFF
from liouville._methods.schrodinger import LEAST_TOLERANCE
from liouville._systems.waves.bounds import Spectrum

#: Roundings of an energy count so many times in the phase.
PHASE = 4.0

#: The longest time that double precision has room for.
LONGEST = 1e200

#: Times of a run at which the core looks at functions of time before it, at least.
LOOKS = 1 << 14

#: Where energies are so many times as large as half their width, a constant may be taken off them.
SHIFTED = 10.0

#: What bounds of the spectrum are where H absorbs.
LEFT_OUT = "psi is absorbed, and the spectrum is that of H without absorber"


@dataclass(frozen=True)
class Span:
    """The start of a plan, the times of the states that are kept, and the spectrum.

    `energy` says how large energies of the state are at most, where that is known.
    """

    t0: float
    times: tuple[float, ...]
    spectrum: Spectrum
    energy: float = math.inf

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the spectrum."""
        return self.spectrum.bounds

    @property
    def beta(self) -> float:
        """Half the width of the spectrum."""
        return 0.5 * (self.bounds[1] - self.bounds[0])

    @property
    def sigma(self) -> float:
        """The middle of the spectrum."""
        return 0.5 * (self.bounds[1] + self.bounds[0])

    @property
    def largest(self) -> float:
        """The size of the largest energy."""
        low, high = self.bounds
        return min(max(abs(low), abs(high)), self.energy)

    @cached_property
    def roundoff(self) -> float:
        """The error of the phase by roundoff of the energies, for any method."""
        return PHASE * ROUNDOFF * self.largest * float(self.intervals.sum())

    @property
    def least(self) -> float:
        """The least tolerance that the roundoff leaves within reach."""
        return max(LEAST_TOLERANCE, 2 * self.roundoff)

    @cached_property
    def intervals(self) -> NDArray[np.float64]:
        """Lengths of the intervals between the states that are kept."""
        lengths: NDArray[np.float64] = np.abs(np.diff([self.t0, *self.times]))
        return lengths

    @cached_property
    def thetas(self) -> NDArray[np.float64]:
        """The same in units of 1/beta."""
        thetas: NDArray[np.float64] = self.beta * self.intervals
        return thetas

    @property
    def looks(self) -> str:
        """A sentence on the times at which the core looks at functions of time before a run."""
        apart = abs(self.times[-1] - self.t0) / LOOKS
        return (
            f"functions of time are looked at before the run, in distances of {apart:.2g}: a pulse "
            "shorter than these is seen by its time in points="
        )

    def stops(self, steps: Sequence[float] | NDArray[np.float64]) -> tuple[tuple[float, int], ...]:
        """Return the times with the steps to each."""
        return tuple((t, int(n)) for t, n in zip(self.times, steps, strict=True))

    def check_reach(self, tol: float) -> None:
        """Refuse a tolerance below what roundings of the spectrum leave, and times without end."""
        if self.intervals.max() > LONGEST:
            hint = "choose units in which H / hbar is of order 1"
            raise ValueError(hinted(f"t spans {self.intervals.max():.1e}, out of range", hint))
        if tol < 2 * self.roundoff:
            turns = self.roundoff / (PHASE * ROUNDOFF)
            least = 10 ** np.ceil(np.log10(2 * self.roundoff))
            hint = "give a shorter interval"
            if least < 1:
                hint = f"give tol of {least:g} or more, or a shorter interval"
            if abs(self.sigma) > SHIFTED * self.beta:
                hint += (
                    f"; energies are about {self.sigma:.6g} hbar and differ by at most "
                    f"{2 * self.beta:.3g}: a constant taken off H changes the phase of psi alone"
                )
            raise ValueError(
                hinted(
                    f"tol = {tol:g} is out of reach: a phase of {turns:.3g} has an error of "
                    f"{self.roundoff:.1e} in double precision",
                    hint,
                )
            )


def check_forwards(span: float) -> None:
    """Refuse a run back in time of an H that absorbs."""
    if span < 0:
        hint = "run forwards in time"
        raise ValueError(hinted("an absorber cannot be undone: psi would grow back in time", hint))
