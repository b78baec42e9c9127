"""Fans: the median of the members of an ensemble, and the bands that most of them are in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings

import numpy as np

from liouville._basics.errors import hinted
from liouville._solution.solution import Array, Solution
from liouville.plot.canvas import colours
from liouville.plot.thinning import few, thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Quantiles at the edges of each band, the widest first, and how dark it is.
BANDS = ((0.05, 0.95, 0.15), (0.25, 0.75, 0.3))

#: A fan has so many points at most.
POINTS = 1000


def chosen(
    solution: Solution, columns: Mapping[str, Array], fan: bool
) -> tuple[dict[str, Array], str]:
    """Return columns of all members for a fan, or of few enough for curves, and what they are."""
    if not fan:
        return few(solution, columns)
    if solution.members is None:
        hint = "solution.members is the number of an ensemble's members, None of a single run"
        raise ValueError(hinted("a fan is of an ensemble, and this is a single run", hint))
    return dict(columns), f", median, 50 % and 90 % of {solution.members} members"


def draw_fans(axes: Axes, t: Array, columns: Mapping[str, Array]) -> list[Any]:
    """Draw the fan of each column of shape (k, P), of the members there are at each time."""
    at, lines = thinned(len(t), POINTS), []
    shares = [0.5, *(share for low, high, _ in BANDS for share in (low, high))]
    for values, colour in zip(columns.values(), colours(len(columns)), strict=True):
        with catch_warnings(action="ignore", category=RuntimeWarning):  # all members have failed
            middle, *edges = np.nanquantile(values[at], shares, axis=1)
        pairs = zip(edges[::2], edges[1::2], BANDS, strict=True)
        for low, high, (_, _, alpha) in pairs:
            axes.fill_between(t[at], low, high, color=colour, alpha=alpha, lw=0)
        lines += axes.plot(t[at], middle, color=colour, lw=1.3)
    return lines
