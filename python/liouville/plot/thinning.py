"""Thinning: the members, curves and points that are drawn where there are too many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from liouville._solution.solution import Array, Solution

#: More points than this do not show; a curve keeps the extremes of what it leaves out.
POINTS = 4000

#: An overview shows no more curves than this in a panel, evenly chosen.
CURVES = 40

#: No figure is made of more members of an ensemble, nor of more curves of them in all.
MEMBERS, MOST = 50, 300


def few(
    solution: Solution, columns: Mapping[str, Array], shared: int = 0
) -> tuple[dict[str, Array], str]:
    """Return columns of few enough members of an ensemble, and in words how many they are."""
    if solution.members is None:
        return dict(columns), ""
    most = min(MEMBERS, max(1, MOST // max(1, shared or len(columns))), solution.members)
    chosen = np.arange(most) * solution.members // most
    some = f"{most} of " if most < solution.members else ""
    note = f", {some}{solution.members} members"
    return {name: values[:, chosen] for name, values in columns.items()}, note


def varied(solution: Solution) -> tuple[str, Array] | None:
    """Return the one parameter that members differ in, and its values of those that are drawn."""
    if solution.members is None or len(solution.varied) != 1:
        return None
    name = solution.varied[0]
    values = np.asarray(solution.params[name], dtype=float)
    if values.ndim != 1 or not np.ptp(values) > 0:
        return None
    columns, _ = few(solution, {name: values[None]}, 1)
    return name, columns[name][0]


def some(names: Sequence[str]) -> Sequence[str]:
    """Return few enough names, evenly chosen."""
    return names[:: max(1, -(-len(names) // CURVES))]


def extremes(values: Array) -> Any:
    """Give the indices of the points worth drawing: all, or the extremes of equal blocks."""
    if len(values) <= POINTS:
        return np.arange(len(values))
    blocks = np.array_split(np.arange(len(values)), POINTS // 2)
    lowest, highest = (np.where(np.isnan(values), x, values) for x in (np.inf, -np.inf))
    ends = [(block[lowest[block].argmin()], block[highest[block].argmax()]) for block in blocks]
    return np.unique([0, *np.ravel(ends), len(values) - 1])


def thinned(count: int, most: int = POINTS) -> Any:
    """Give the indices of at most so many rows, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
