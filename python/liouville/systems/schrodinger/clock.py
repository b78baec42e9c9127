"""What depends on time: the functions of a drive, and potentials on a grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from liouville import _core
from liouville.errors import hinted
from liouville.systems import _trace
from liouville.systems._travel import opened, packed
from liouville.systems.schrodinger.grid import Grid
from liouville.tape import record


class Traced:
    """A function of the time, of a point if there are points, and of parameters.

    Parameters
    ----------
    what : str
        What it is called in messages.
    function : callable
        ``function(t, params)``, or ``function(t, x, params)`` if there are points.
    params : Parameters
        The parameters it sees.
    axes : int
        Number of coordinates of a point, 0 if there are none.

    Attributes
    ----------
    is_driven : bool
        Whether it depends on time.
    """

    def __init__(
        self, what: str, function: Callable[..., Any], params: _trace.Parameters, axes: int = 0
    ) -> None:
        self._t, self._x, self._params = ca.SX.sym("t"), ca.SX.sym("x", axes), params
        points = (self._x,) if axes else ()
        self.what = what
        self.expression = _trace.scalar(what, function, (self._t, *points, params))
        self.is_driven = ca.depends_on(self.expression, self._t)

    @cached_property
    def expression(self) -> ca.SX:
        """What the function returned; where it has travelled, it is read when it is wanted."""
        return opened(self._packed, self._symbols)[0]

    @cached_property
    def _packed(self) -> str:
        return packed(self._symbols, [self.expression])

    @property
    def _symbols(self) -> list[ca.SX]:
        return [self._t, self._x, self._params.vector]

    def __call__(self, t: ca.SX, *args: Any) -> ca.SX:
        """Apply the function to other symbols: t, those of a point if there are points, params."""
        *x, params = args
        return opened(self._packed, [t, *(x or [self._x]), _trace.vector_of(params)])[0]

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel without symbols."""
        own = (self.what, self._params, self._x.numel(), self.is_driven, self._packed)
        return _arrived, own

    def tape(self, factor: float) -> _core.Tape:
        """Record it, times a number: t, x if there are points, and parameters in."""
        inputs = {"t": self._t, **({"x": self._x} if self._x.numel() else {})}
        expression = self.expression if factor == 1.0 else factor * self.expression
        return record(self.what, {**inputs, "params": self._params.vector}, expression)

    def at(self, t: float, points: np.ndarray | None = None) -> np.ndarray:
        """Return values at a time, one for each point; ValueError names one that is not finite."""
        times = np.full((1 if points is None else len(points), 1), float(t))
        args = [times] if points is None else [times, np.ascontiguousarray(points)]
        values = self.tape(1.0).map(self._params.values(None), args)[:, 0]
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            place = "" if points is None else f" at x = {points[bad[0]].tolist()}"
            raise ValueError(
                hinted(
                    f"{self.what} is {values[bad[0]]} at t = {t:g}{place}",
                    "look for a division by zero, a root or a logarithm there",
                )
            )
        return np.array(values)


def _arrived(
    what: str, params: _trace.Parameters, axes: int, is_driven: bool, packed: str
) -> Traced:
    found = object.__new__(Traced)
    found._t, found._x, found._params = ca.SX.sym("t"), ca.SX.sym("x", axes), params
    found.what, found.is_driven, found._packed = what, is_driven, packed
    return found


def potential(grid: Grid, params: _trace.Parameters) -> Traced | np.ndarray:
    """Return a grid's potential: a function, or flat values at all points."""
    if grid.potential is None:
        return np.zeros(grid.size)
    if not callable(grid.potential):
        return grid.potential.ravel()
    return Traced("potential", grid.potential, params, len(grid.shape))


def weights(
    functions: Sequence[Traced], repeats: Sequence[int], params: _trace.Parameters
) -> _core.Tape:
    """Record the weight of each term: 1 for `repeats[0]` of them, then those of each function."""
    t = ca.SX.sym("t")
    parts = [ca.SX.ones(repeats[0], 1)]
    for traced, times in zip(functions, repeats[1:], strict=True):
        value = ca.substitute(traced.expression, traced._t, t)
        parts.append(ca.repmat(value, times, 1))
    return record("drive", {"t": t, "params": params.vector}, ca.vertcat(*parts))
