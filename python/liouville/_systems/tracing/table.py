"""Tables as smooth functions: cubic splines, whose pieces tapes look up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, misshapen
from liouville._basics.scipy import scipy
from liouville._core import Column
from liouville._systems.tape.lookups import LookedUp, lookups
from liouville._systems.tracing.grid_table import GridTable, grid_table
from liouville._systems.tracing.trace import numbers

Array = NDArray[np.float64]

#: The fewest points, by what holds at the ends.
FEWEST = {"natural": 2, "not-a-knot": 4, "periodic": 3}
#: What a table of constant values between its points has for ends.
STEPS = "steps"
#: No number of a model is below it.
LEAST = float(np.finfo(float).min)
#: The ends of a periodic table are the same but for this part of its largest value, roundoff.
SAME = 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class Table:
    """A cubic spline through points, by :func:`~liouville.table`: of numbers and of expressions.

    Attributes
    ----------
    x, y : ndarray, shape (k,)
        The points; of constant values between points y may have one fewer.
    ends : str
        What holds at the ends.
    name : str
        A name that keeps its columns on tapes apart from those of other tables.
    """

    x: Array
    y: Array
    ends: str
    _starts: Array  # of the pieces
    _powers: Array  # coefficients of 1, u, u^2 and u^3 of each, with u from its base
    _bases: Array
    name: str = ""

    def __repr__(self) -> str:
        """Give the number of points and the interval."""
        return f"<Table of {len(self.x)} points from {self.x[0]:g} to {self.x[-1]:g}, {self.ends}>"

    def __call__(self, x: Any) -> Any:
        """Return the value at x: of an expression an expression, of numbers an array of them.

        Raises
        ------
        TypeError
            x is neither.
        """
        if isinstance(x, float | int | np.ndarray | np.floating | np.integer | list | tuple):
            return self._of_numbers(x)
        if not isinstance(x, ca.SX):
            kind = type(x).__name__
            raise TypeError(f"a table takes numbers or CasADi's SX, not a {kind}")
        return ca.vertcat(*(self._of_expression(x[k]) for k in range(x.numel())))

    def __getstate__(self) -> dict[str, Any]:
        """Leave CasADi's functions out."""
        return {name: x for name, x in self.__dict__.items() if name != "_lookups"}

    @cached_property
    def _lookups(self) -> list[LookedUp]:
        return lookups(self.name, self._starts[1:], self._bases, *self._powers)

    def replaced(self, other: Table) -> list[tuple[Column, Column]] | None:
        """Return pairs of columns that make a tape of this table one of another at the same points.

        None where numbers would overflow, or are not as many.
        """
        found = []
        if self._powers.shape != other._powers.shape:
            return None
        for own, powers in zip(self._lookups[1:], other._powers, strict=True):
            new = own.other(powers)
            if new is None:
                return None
            found.append((own.column, new))
        return found

    def _of_numbers(self, x: Any) -> Any:
        at = numbers(x)
        if at is None:
            raise TypeError(f"a table takes numbers or CasADi's SX, not {x!r}")
        inside = self._wrapped(at, np.floor)
        piece = np.searchsorted(self._starts[1:], inside, side="right")
        a, b, c, d = self._powers[:, piece]
        u = inside - self._bases[piece]
        found: Array = a + u * (b + u * (c + u * d))
        return found if found.ndim else float(found)

    def _of_expression(self, x: ca.SX) -> ca.SX:
        """Look base and coefficients up, whose derivatives are zero."""
        inside = self._wrapped(x, ca.floor)
        base, a, b, c, d = (look_up(inside) for look_up in self._lookups)
        u = inside - base
        # the comparison is never true: with it the third derivative is seen to depend on x
        found: ca.SX = a + u * (b + u * (c + u * (d + (inside < LEAST))))
        return found

    def _wrapped(self, x: Any, floor: Any) -> Any:
        """Return x, of a periodic table moved into its interval."""
        if self.ends != "periodic":
            return x
        first, period = self.x[0], self.x[-1] - self.x[0]
        return x - period * floor((x - first) / period)


@overload
def table(
    x: tuple[ArrayLike, ...], y: ArrayLike, ends: str | Sequence[str] = "natural"
) -> GridTable: ...
@overload
def table(x: ArrayLike, y: ArrayLike, ends: str | Sequence[str] = "natural") -> Table: ...
def table(x: Any, y: ArrayLike, ends: str | Sequence[str] = "natural") -> Table | GridTable:
    r"""Make a smooth function of a table: the cubic spline through its points.

    It has two continuous derivatives, between the points and beyond them, where a natural spline
    goes on straight. It may stand in any function of a model: a force by a characteristic, a cam, a
    stiffness measured. Between points a spline may overshoot; ``ca.pw_lin(x, xs, ys)`` and
    ``np.interp(x, xs, ys)`` do not, and have kinks, which cost methods their high order.

    Parameters
    ----------
    x : array_like, shape (k,), or tuple of them
        Where the values are, increasing; of a table of several variables the nodes of each.
    y : array_like, shape (k,), or (k, l, ...)
        The values.
    ends : {"natural", "not-a-knot", "periodic"}, or a sequence of them
        Of several variables one for all or one for each. A natural spline has no curvature at its
        ends, and its error there is of order 2. One with "not-a-knot" has order 4 up to the ends,
        goes on straight beyond them too, and has a jump of its curvature there. A periodic one
        repeats itself; its last value is the first, but for roundoff.

    Returns
    -------
    Table or GridTable
        Called with an expression it gives an expression, with numbers numbers; with as many as it
        has variables. Beyond a grid there is no value: it is NaN, and a step there fails.

    Raises
    ------
    TypeError, ValueError
        There are too few points, x does not increase, a number is not finite, or the values of a
        periodic table do not meet.
    ImportError
        SciPy is not installed.

    References
    ----------
    :cite:t:`deboor1978`.

    Examples
    --------
    >>> import liouville as lv
    >>> spring = lv.table([-1, 0, 1, 2], [-3, 0, 1, 4])
    >>> spring(1.0), spring(3.0)
    (1.0, 7.666666666666667)
    """
    if isinstance(x, tuple | list) and len(x) > 1 and all(np.ndim(each) == 1 for each in x):
        for word in (ends,) if isinstance(ends, str) else ends:
            if word not in FEWEST:
                raise ValueError(f"ends must be of {', '.join(map(repr, FEWEST))}, not {word!r}")
        return grid_table(x, y, ends)
    if not isinstance(ends, str) or ends not in FEWEST:
        raise ValueError(f"ends must be one of {', '.join(map(repr, FEWEST))}, not {ends!r}")
    at, values = _points("x", x), _points("y", y)
    if at.shape != values.shape:
        raise ValueError(f"x and y of a table must be as many, not {at.size} and {values.size}")
    if at.size < FEWEST[ends]:
        sentence = f"a {ends} table must have {FEWEST[ends]} points or more, not {at.size}"
        raise ValueError(sentence)
    if not np.all(np.diff(at) > 0):
        k = int(np.argmin(np.diff(at) > 0))
        sentence = f"x of a table must increase: x[{k}] = {at[k]:g} is followed by {at[k + 1]:g}"
        raise ValueError(hinted(sentence, "sort both by x, and leave repeated points out"))
    if ends == "periodic":
        if abs(values[0] - values[-1]) > SAME * np.abs(values).max():
            sentence = (
                f"a periodic table must end as it begins, with {values[0]:g}, not {values[-1]:g}"
            )
            raise ValueError(hinted(sentence, "its last point is the first one, a period later"))
        values = np.append(values[:-1], values[0])
        values.setflags(write=False)
    return _spline(at, values, ends)


def steps(x: Array, y: Array) -> Table:
    """Make a table of values that hold from one x to the next, the outer ones beyond the ends.

    A value for the last x holds nowhere.
    """
    count = x.size - 1
    powers = np.zeros((4, count))
    powers[0] = y[:count]
    return Table(x, y, STEPS, np.append(-np.inf, x[1:count]), powers, np.array(x[:count]))


def _points(name: str, given: Any) -> Array:
    found = numbers(given)
    if found is None:
        raise TypeError(f"{name} of a table must be a 1-D array of numbers, not {given!r}")
    if found.ndim != 1:
        raise misshapen(f"{name} of a table", found.shape, "(k,)")
    bad = np.flatnonzero(~np.isfinite(found))
    if bad.size:
        raise ValueError(f"{name}[{bad[0]}] of a table must be finite, not {found[bad[0]]}")
    found.setflags(write=False)
    return found


def _spline(x: Array, y: Array, ends: str) -> Table:
    interpolate = scipy("interpolate", "a table")
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            spline = interpolate.CubicSpline(x, y, bc_type=ends)
    except FloatingPointError as error:
        sentence = (
            f"a table with x from {x[0]:g} to {x[-1]:g} and y from {y.min():g} to {y.max():g} has "
            "slopes or bends that are not finite"
        )
        raise ValueError(hinted(sentence, "take other units of x or y")) from error
    powers, starts, bases = spline.c[::-1], x[:-1], x[:-1]
    if ends != "periodic":  # straight beyond the ends
        slopes = spline(x[[0, -1]], 1)
        lines = [[y[0], y[-1]], slopes, [0.0, 0.0], [0.0, 0.0]]
        powers = np.column_stack([*np.array(lines)[:, :1].T, *powers.T, *np.array(lines)[:, 1:].T])
        starts, bases = np.append(-np.inf, x), np.concatenate([x[:1], x])
    return Table(x, y, ends, starts, np.ascontiguousarray(powers), bases)
