"""Tables of several variables: cubic splines on a grid, whose numbers tapes gather.

In a cell the spline is Hermite's polynomial of its values and slopes at the corners, and of mixed
slopes. So a tape finds the cell once along each axis, and gathers these numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.scipy import scipy
from liouville._systems.tape.lookups import LookedUp, gathered, lookups
from liouville._systems.tracing.trace import numbers

Array = NDArray[np.float64]

#: No place of a column: what is looked up there is no number.
NOWHERE = 1e15

#: No number of a model is below it.
LEAST = float(np.finfo(float).min)

#: Values at the ends of a period are the same but for this part of the largest one.
SAME = 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class GridTable:
    """A cubic spline through values on a grid, by :func:`~liouville.table`.

    Attributes
    ----------
    axes : tuple of ndarray
        The nodes along each axis, shapes (n1,), (n2,) and so on.
    values : ndarray, shape (n1, n2, ...)
        The values at the nodes.
    ends : tuple of str
        What holds at the ends of each axis.
    """

    axes: tuple[Array, ...]
    values: Array
    ends: tuple[str, ...]

    def __repr__(self) -> str:
        """Give the numbers of nodes and what holds at the ends."""
        sizes = " x ".join(str(x.size) for x in self.axes)
        return f"<Table of {sizes} points, {', '.join(self.ends)}>"

    def __getstate__(self) -> dict[str, Any]:
        """Leave CasADi's functions out."""
        return {"axes": self.axes, "values": self.values, "ends": self.ends}

    def __call__(self, *x: Any) -> Any:
        """Return the value at x, y and so on: of expressions an expression, else of arrays.

        Raises
        ------
        TypeError
            There are too few or too many, or they are neither.
        """
        if len(x) != len(self.axes):
            raise TypeError(f"a table of {len(self.axes)} variables takes as many, not {len(x)}")
        if any(isinstance(each, ca.SX) for each in x):
            return self._of_expressions([ca.SX(each) for each in x])
        at: list[Array] = []
        for given in x:
            found = numbers(given)
            if found is None:
                raise TypeError(f"a table takes numbers or CasADi's SX, not {given!r}")
            at.append(found)
        return self._of_numbers(np.broadcast_arrays(*at))

    @cached_property
    def _corners(self) -> list[Array]:
        """Values and slopes at nodes, the slopes along some axes: along the last one first."""
        spline = scipy("interpolate", "a table").CubicSpline
        found = []
        for along in product((False, True), repeat=len(self.axes)):
            values = self.values
            for k, is_slope in enumerate(along):
                if is_slope:
                    made = spline(self.axes[k], values, axis=k, bc_type=self.ends[k])
                    values = made(self.axes[k], 1)
            found.append(np.ascontiguousarray(values))
        return found

    @cached_property
    def _cells(self) -> list[list[LookedUp]]:
        """Look-ups of number, begin and width of the cell along each axis."""
        found = []
        for x in self.axes:
            starts = np.append(x[:-1], np.nextafter(x[-1], np.inf))
            inside = np.arange(x.size - 1.0)
            number = np.r_[NOWHERE, inside, NOWHERE]
            first = np.r_[x[0], x[:-1], x[-1]]
            width = np.r_[1.0, np.diff(x), 1.0]
            found.append(lookups("grid", starts, number, first, width))
        return found

    @cached_property
    def _gathered(self) -> list[LookedUp]:
        return [gathered(x.ravel()) for x in self._corners]

    def _wrapped(self, k: int, x: Any, floor: Any) -> Any:
        """Return x, along a periodic axis moved into its interval."""
        if self.ends[k] != "periodic":
            return x
        first, period = self.axes[k][0], self.axes[k][-1] - self.axes[k][0]
        return x - period * floor((x - first) / period)

    def _of_expressions(self, x: Sequence[ca.SX]) -> ca.SX:
        place, weights = ca.SX(0), []
        for k, (each, cells) in enumerate(zip(x, self._cells, strict=True)):
            inside = self._wrapped(k, each, ca.floor)
            number, first, width = (look_up(inside) for look_up in cells)
            place = place * self.axes[k].size + number
            s = (inside - first) / width
            # the comparison is never true: with it the third derivative is seen to depend on x
            weights.append(_hermite(s, width, (inside < LEAST)))
        found: ca.SX = self._contracted(
            lambda kind, offset: self._gathered[kind](place + offset), weights
        )
        return found

    def _of_numbers(self, x: Sequence[Array]) -> Any:
        place, weights = np.zeros(x[0].shape, dtype=np.int64), []
        is_in = np.ones(x[0].shape, dtype=bool)
        for k, (each, nodes) in enumerate(zip(x, self.axes, strict=True)):
            inside = np.asarray(self._wrapped(k, each, np.floor), dtype=float)
            is_in &= (inside >= nodes[0]) & (inside <= nodes[-1])
            number = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, nodes.size - 2)
            width = np.diff(nodes)[number]
            place = place * nodes.size + number
            weights.append(_hermite((inside - nodes[number]) / width, width, 0.0))
        flat = [each.ravel() for each in self._corners]
        found = self._contracted(lambda kind, offset: flat[kind][place + offset], weights)
        found = np.where(is_in, found, np.nan)
        return found if found.ndim else float(found)

    def _contracted(self, number: Any, weights: Sequence[Any]) -> Any:
        """Return the sum over corners and slopes, the last axis first."""
        n = len(self.axes)
        strides = [int(np.prod([x.size for x in self.axes[k + 1 :]])) for k in range(n)]

        def part(k: int, kind: int, offset: int) -> Any:
            if k == n:
                return number(kind, offset)
            ends = ((0, 0), (1, 0), (0, 1), (1, 1))  # slope or value, at the first or last end
            return sum(
                weight * part(k + 1, 2 * kind + slope, offset + end * strides[k])
                for weight, (slope, end) in zip(weights[k], ends, strict=True)
            )

        return part(0, 0, 0)


def _hermite(s: Any, width: Any, more: Any) -> tuple[Any, ...]:
    """Return the weights of value and slope at the begin of a cell, and of those at its end."""
    value, slope = s * s * (3 - 2 * s) + more, s * (1 - s) * width
    return 1 - value, slope * (1 - s), value, -slope * s


def grid_table(x: Sequence[Any], y: Any, ends: Any) -> GridTable:
    """Make a table of several variables; see :func:`~liouville.table`."""
    axes = []
    for k, given in enumerate(x):
        nodes = numbers(given)
        if nodes is None or nodes.ndim != 1 or not np.isfinite(nodes).all():
            raise TypeError(f"x[{k}] of a table must be a 1-D array of numbers, not {given!r}")
        if nodes.size < 4 or not (np.diff(nodes) > 0).all():
            raise ValueError(f"x[{k}] of a table must have four nodes at least, which increase")
        axes.append(np.array(nodes, dtype=float))
    values, shape = numbers(y), tuple(nodes.size for nodes in axes)
    if values is None or values.shape != shape or not np.isfinite(values).all():
        what = f"of shape {values.shape}" if values is not None else repr(y)
        if values is not None and values.shape == shape:
            what = "with some that are not"
        raise ValueError(f"y of a table must be finite numbers of shape {shape}, not {what}")
    each = (ends,) * len(axes) if isinstance(ends, str) else tuple(ends)
    if len(each) != len(axes):
        raise ValueError(f"ends must be {len(axes)} words, one for each axis, not {ends!r}")
    values = np.array(values, dtype=float)
    for k, end in enumerate(each):
        first, last = (np.take(values, at, k) for at in (0, -1))
        if end == "periodic" and np.abs(first - last).max() > SAME * np.abs(values).max():
            sentence = f"a periodic table must end as it begins, along x[{k}] it does not"
            raise ValueError(hinted(sentence, "its last node is the first one, a period later"))
        if end == "periodic":
            np.moveaxis(values, k, 0)[-1] = first
    return GridTable(tuple(axes), values, each)
