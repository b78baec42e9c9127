"""Bounds of a Hamiltonian that depends on time, for plans of series in time and Magnus methods."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from liouville.errors import hinted
from liouville.planner.waves.propagators import Interval, Parts
from liouville.systems import Schrodinger
from liouville.systems.schrodinger.bounded import FEW
from liouville.systems.schrodinger.bounds import PROBABLE, RIGOROUS, WORTH, Spectrum

#: Times at which drives are looked at for their range, and bounds are taken without corners.
LOOKS, TIMES = 257, 9

#: Most values of one function of time, of two, and of three, at which H is bounded.
AXIS = (17, 5, 3)

#: Lanczos' method finds one corner for so many units of 1/beta, as it takes 20 products.
EACH = WORTH / 2


@dataclass(frozen=True)
class Driving:
    """What is known of the energies of H(t) over a run: its parts for the core, and bounds."""

    parts: Parts
    spectrum: Spectrum


def driving(system: Schrodinger, t0: float, t1: float) -> Driving:
    """Bound the parts of H(t) and H at corners of the box that its functions of time fill."""
    ends = np.array([system.bounds_at(t) for t in np.linspace(t0, t1, TIMES)])
    if not np.isfinite(ends).all():
        raise ValueError(hinted("H(t) is not finite", "look for a division by zero in a drive"))
    low, high = float(ends[:, 0].min()), float(ends[:, 1].max())
    guarantee = system.guarantee
    axes, corners = _corners(system, (t0, t1), 0.5 * (high - low) * abs(t1 - t0))
    if corners:
        guarantee = RIGOROUS if system.hamiltonian.size <= FEW else PROBABLE
        low = max(low, min(bounds[0] for bounds in corners))
        high = min(high, max(bounds[1] for bounds in corners))
    given = system.given_bounds
    parts = (tuple(system.groups), tuple(system.term_bounds), given, axes, corners)
    return Driving(parts, Spectrum((low, high), guarantee))


def _corners(
    system: Schrodinger, span: Interval, theta: float
) -> tuple[tuple[tuple[float, ...], ...], tuple[Interval, ...]]:
    """Return values of each function of time, and bounds of H where they take these."""
    ranges = system.drive_ranges(np.linspace(*span, LOOKS))
    if ranges is None or system.given_bounds is not None or not 0 < len(ranges) <= len(AXIS):
        return (), ()
    count = AXIS[len(ranges) - 1]
    if system.hamiltonian.size > FEW:
        worth = int((theta / EACH) ** (1 / len(ranges)) + 1e-9)
        count = min(count, worth) if system.takes_lanczos else 0
    if count < 2:
        return (), ()
    axes = tuple(_axis(low, high, count) for low, high in ranges)
    return axes, tuple(system.corner(f) for f in itertools.product(*axes))


def _axis(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return equidistant values, one where a function does not change."""
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        return (0.5 * (low + high),)
    values: NDArray[np.float64] = np.linspace(low, high, count)
    return tuple(values.tolist())
