"""Functions of time: those of a drive, and potentials on a grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Symbols
from liouville._systems.waves.entries import Entries
from liouville._systems.waves.parted import Parted, parted


class TimeFunction:
    """A function of the time, of a point if there are points, and of parameters.

    Parameters
    ----------
    what : str
        Its name in messages.
    function : callable
        ``function(t, params)``, or ``function(t, x, params)`` if there are points.
    params : Parameters
        The parameters it takes.
    axes : int
        Number of coordinates of a point, 0 if there are none.
    vector : str
        What a function calls the point.
    values : int
        How many it has at a point: it returns these, or one that stands for all.

    Attributes
    ----------
    is_driven : bool
        Whether it depends on time.
    """

    _untraced: tuple[Callable[..., Any], _trace.Parameters]

    def __init__(
        self,
        what: str,
        function: Callable[..., Any],
        params: _trace.Parameters,
        axes: int = 0,
        vector: str = "x",
        values: int = 1,
    ) -> None:
        self.what, self._axes, self._vector, self._values = what, axes, vector, values
        self.expressions = self._traced(function, params)
        self.is_driven = ca.depends_on(self.expression, self.t)
        self.tapes: dict[float, _core.Tape] = {}  # of all values of the parameters
        self._parted: dict[float, Parted] = {}

    def _traced(self, function: Callable[..., Any], params: _trace.Parameters) -> Expressions:
        s = Symbols(params, {self._vector: self._axes} if self._axes else {})
        if self._values == 1:
            return Expressions(s, {self.what: _trace.scalar(self.what, function, s.args)})
        found = of_each(self.what, _trace.column(self.what, function, s.args), self._values)
        return Expressions(s, {self.what: found})

    @cached_property
    def expressions(self) -> Expressions:
        return self._traced(*self._untraced)

    def replaced(self, samples: Callable[..., Any], params: _trace.Parameters) -> TimeFunction:
        """Return a function of other samples at the same times, which is traced when needed."""
        other = copy(self)
        other._untraced, other.tapes, other._parted = (samples, params), {}, {}
        other.__dict__.pop("expressions", None)
        return other

    @property
    def expression(self) -> ca.SX:
        """The value of the function."""
        return self.expressions.columns[self.what]

    @property
    def sizes(self) -> Mapping[str, int]:
        """The vectors that it takes, the coordinates of a point if there are points."""
        return self.expressions.symbols.sizes

    @property
    def t(self) -> ca.SX:
        """The symbol of the time."""
        return self.expressions.symbols.t

    def with_params(self, params: _trace.Parameters) -> TimeFunction:
        """Return the same function of the same parameters with other values."""
        other, symbols = copy(self), self.expressions.symbols.with_params(params)
        other.expressions = Expressions(symbols, {self.what: self.expression})
        return other

    @property
    def inputs(self) -> dict[str, ca.SX]:
        """The symbols of the time, of a point if there are points, and of the parameters."""
        return self.expressions.symbols.inputs()

    def depends_on(self, name: str) -> bool:
        """Whether it depends on a parameter."""
        symbol = getattr(self.expressions.symbols.params.namespace, name)
        return bool(ca.depends_on(self.expression, symbol))

    def __call__(self, t: ca.SX, *args: Any) -> ca.SX:
        """Apply the function to other symbols: t, those of a point if there are points, params."""
        *x, params = args
        own = [getattr(self.expressions.symbols, name) for name in self.expressions.symbols.sizes]
        return self.expressions.of(t, *(x or own), _trace.vector_of(params))[0]

    def tape(self, factor: float) -> _core.Tape:
        """Return its tape, times a number: t, x if there are points, and parameters in."""
        if factor not in self.tapes:
            expression = self.expression if factor == 1.0 else factor * self.expression
            self.tapes[factor] = record(self.what, self.inputs, expression)
        return self.tapes[factor]

    def parted(self, factor: float) -> Parted:
        """Return it times a number, as a function of such of the time and such of the place."""
        if factor not in self._parted:
            expression = self.expression if factor == 1.0 else factor * self.expression
            self._parted[factor] = parted(self.what, self.inputs, expression)
        return self._parted[factor]

    def at(self, t: float, points: np.ndarray) -> np.ndarray:
        """Return values at a time, one or a row a point; ValueError names one not finite."""
        times = np.full(len(points), float(t))
        args = [times[:, None], np.ascontiguousarray(points)]
        found = self.tape(1.0).map(self.expressions.symbols.params.values(None), args)
        self.check(times, found.sum(axis=1), points)
        return np.array(found[:, 0] if self._values == 1 else found)

    def check(self, t: np.ndarray, values: np.ndarray, points: np.ndarray | None = None) -> None:
        """Refuse values at times that are not finite: ValueError names the first."""
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            k = bad[0]
            place = "" if points is None else f" and {self._placed(points[k])}"
            raise ValueError(
                hinted(
                    f"{self.what} is {values[k]} at t = {t[k]:g}{place}",
                    "look for a division by zero, a root or a logarithm there",
                )
            )

    def _placed(self, x: np.ndarray) -> str:
        """Name a point for a message."""
        return f"{self._vector} = {point(x)}"


def of_each(what: str, found: ca.SX, count: int) -> ca.SX:
    """Return a value for each component of what a function returned, which may be one for all."""
    if found.numel() not in (1, count):
        sentence = f"{what} must return one value, or {count}, one for each component, not "
        raise ValueError(f"{sentence}{found.numel()}")
    return ca.repmat(found, count // found.numel(), 1)


def point(x: np.ndarray) -> str:
    """Write a point for a message."""
    inner = ", ".join(f"{each:g}" for each in x)
    return inner if x.size == 1 else f"({inner})"


def read(
    drive: Sequence[tuple[Callable[..., Any], Any]], params: _trace.Parameters, size: int
) -> tuple[list[TimeFunction], list[Entries]]:
    """Return the functions of a drive and its matrices, each of the order of H."""
    functions, matrices = [], []
    for k, (function, matrix) in enumerate(drive):
        name = f"H{k + 1}"
        functions.append(TimeFunction(f"drive[{k}]", function, params))
        matrices.append(Entries.read(name, matrix))
        if matrices[-1].n != size:
            raise ValueError(f"{name} must have order {size} as H has, not {matrices[-1].n}")
    return functions, matrices


def weights(
    functions: Sequence[TimeFunction], repeats: Sequence[int], params: _trace.Parameters
) -> _core.Tape:
    """Record the weight of each term: 1 for `repeats[0]` of them, then those of each function."""
    t = ca.SX.sym("t")
    parts = [ca.SX.ones(repeats[0], 1)]
    for function, times in zip(functions, repeats[1:], strict=True):
        value = ca.substitute(function.expression, function.t, t)
        parts.append(ca.repmat(value, times, 1))
    return record("drive", {"t": t, "params": params.vector}, ca.vertcat(*parts))
