"""Windows: the outputs that one Chebyshev series makes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics.arguments import check_memory, memory

Array = NDArray[np.float64]

#: Many outputs may take so many times the products of one series for all of them.
MORE = 1.2

#: Time of a term that is added to one of several outputs, in products of a series with a lattice.
TERM = 0.1

#: No window is longer than this, in units of 1/beta, but an interval that is: a longer one saves
#: less than 1 % of the products.
LONGEST = 1e5

#: Bytes of a series for each 1 / beta.
SERIES = 24.0

#: The part of the memory that the outputs of a window may take, and bytes that need no look at it.
PART, LITTLE = 0.25, 2.0**24


@dataclass(frozen=True)
class Windows:
    """Outputs in windows, one series for each.

    Attributes
    ----------
    counts : ndarray
        How many outputs each window has.
    lengths : ndarray
        Lengths of the windows, in time.
    beta, rate : float
        Half the width of the spectrum, and the error in a unit of time.
    is_real : bool
        Whether the first series is one of real vectors.
    """

    counts: NDArray[np.intp]
    lengths: Array
    beta: float
    rate: float
    is_real: bool

    def bytes(self, size: int) -> float:
        """Return the memory of the window that takes the most, of states of `size` components."""
        theta = self.beta * self.lengths
        several = np.where(self.counts > 1, self.counts * (16.0 * size + 4.0 * theta), 0.0)
        return float((several + SERIES * theta).max())

    @cached_property
    def degrees(self) -> NDArray[np.intp]:
        """The degree of each series."""
        lengths, place = np.unique(self.lengths, return_inverse=True)
        each = [_core.chebyshev_degree(self.beta * w, self.rate * w) for w in lengths]
        return np.array(each)[place]

    @cached_property
    def products(self) -> float:
        """Products H psi in all."""
        return float(self.degrees.sum()) - (self.degrees[0] / 2 if self.is_real else 0.0)

    @property
    def terms(self) -> float:
        """Terms that are added to the outputs of windows of several: half of all, on average."""
        several = self.counts > 1
        return float((self.counts[several] * self.degrees[several]).sum()) / 2


def windows_of(
    intervals: Array, beta: float, rate: float, size: int, is_real: bool = False
) -> Windows:
    """Choose windows for outputs with these intervals between them.

    The least predicted time of those that take at most 1.2 times the fewest products and fit the
    memory.
    """
    ends = intervals.cumsum()
    found: list[Windows] = []
    fewest = np.inf
    for count in _counts(beta * float(ends[-1]), ends.size):
        windows = Windows(*_grouped(ends, count), beta, rate, is_real)
        fits = windows.bytes(size) <= LITTLE or windows.bytes(size) <= PART * memory()
        if not fits and windows.counts.max() > 1:
            continue
        if windows.counts.max() == 1:
            check_memory(
                f"a Chebyshev series over {beta * windows.lengths.max():.3g} / beta",
                windows.bytes(size),
                "give more times to keep states at, so that each series is shorter",
            )
        if windows.products > MORE * fewest:
            break
        fewest = min(fewest, windows.products)
        found.append(windows)
        if windows.counts.max() == 1:
            break
    kept = [windows for windows in found if windows.products <= MORE * fewest]
    return min(kept, key=lambda windows: windows.products + TERM * windows.terms)


def _counts(theta: float, outputs: int) -> Iterator[float]:
    """Give numbers of windows to try, and infinity for one an output."""
    count = max(1.0, np.ceil(theta / LONGEST))
    while count < outputs:
        yield count
        count = np.ceil(1.3 * count)
    yield np.inf


def _grouped(ends: Array, count: float) -> tuple[NDArray[np.intp], Array]:
    """Return how many outputs are in each of about so many windows of equal length, and lengths."""
    if np.isinf(count):
        last = np.arange(ends.size)
    else:
        window = np.ceil(ends * (count / ends[-1]) * (1 - 1e-12))
        last = np.append(np.flatnonzero(np.diff(window)), ends.size - 1)
    return np.diff(last, prepend=-1), np.diff(ends[last], prepend=0.0)
