"""Wave functions of several components on a grid, such as spins, and what couples them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.arguments import count
from liouville._basics.errors import hinted, misshapen
from liouville._basics.scipy import scipy
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Symbols
from liouville._systems.waves.entries import Entries
from liouville._systems.waves.grid import Grid
from liouville._systems.waves.time_functions import TimeFunction, of_each, point


class OfComponents(TimeFunction):
    """A function of time and place with a value for each component, or one for all of them.

    It is evaluated at places with one more coordinate for each component, 1 of its own and else 0.

    Parameters
    ----------
    what, function, params : str, callable, Parameters
        As of a :class:`TimeFunction`.
    grid : Grid
        The grid.
    components : int
        Their number.
    """

    def __init__(
        self,
        what: str,
        function: Callable[..., Any],
        params: _trace.Parameters,
        grid: Grid,
        components: int,
    ) -> None:
        self._components = components
        super().__init__(what, function, params, len(grid.shape) + components)

    def _traced(self, function: Callable[..., Any], params: _trace.Parameters) -> Expressions:
        s = Symbols(params, {"x": self._axes})
        axes = self._axes - self._components
        found = _trace.column(self.what, function, {**s.args, "x": s.x[:axes]})
        if found.numel() > 1:
            each = ca.vertsplit(of_each(self.what, found, self._components))
            # a product would be NaN at the poles of others
            own = (ca.if_else(s.x[axes + k], value, 0) for k, value in enumerate(each))
            found = sum(own, ca.SX(0))
        return Expressions(s, {self.what: found})

    def __call__(self, t: ca.SX, *args: Any) -> ca.SX:
        """Return the values of all components at a place."""
        x, params = args
        units = np.eye(self._components)
        places = (ca.vertcat(x, ca.DM(unit)) for unit in units)
        return ca.vertcat(*(super(OfComponents, self).__call__(t, y, params) for y in places))

    def _placed(self, x: np.ndarray) -> str:
        axes = self._axes - self._components
        return f"x = {point(x[:axes])} of component {int(np.argmax(x[axes:]))}"


@dataclass(frozen=True)
class OnEach:
    """A product with a state of one component, made of each."""

    components: int
    product: Callable[[np.ndarray], np.ndarray]

    def __call__(self, psi: np.ndarray) -> np.ndarray:
        """Return the product with a state."""
        return np.concatenate([self.product(x) for x in psi.reshape(self.components, -1)])


def read(components: Any, coupling: Any, grid: Grid | None) -> tuple[int, Entries | None]:
    """Return the number of components and the matrix between them, None where it is zero.

    Raises
    ------
    TypeError, ValueError
        There is no grid, or the matrix is not Hermitian or of another order.
    """
    number = count("components", components)
    if number > 1 and grid is None:
        sentence = "components= is for wave functions on a Grid, and H is none"
        raise TypeError(hinted(sentence, "give a matrix of all components"))
    if coupling is None:
        return number, None
    if grid is None:
        raise TypeError("coupling= is a matrix between components= of a wave function on a Grid")
    matrix = Entries.read("coupling", coupling)
    if matrix.n != number:
        sentence = f"coupling must have order {number}, a row for each component, not {matrix.n}"
        raise ValueError(hinted(sentence, f"give components={matrix.n}"))
    return number, matrix if matrix.values.size else None


def operator(
    matrix: np.ndarray, points: int, is_doubled: bool
) -> tuple[_core.Operator, np.ndarray]:
    """Return a matrix between components, and its eigenvalues."""
    a, b = matrix.real, matrix.imag
    levels, vectors = np.linalg.eigh(np.block([[a, -b], [b, a]]) if is_doubled else a)
    return _core.Operator.coupling(points, levels, np.ascontiguousarray(vectors)), levels


def places(grid: Grid, components: int) -> np.ndarray:
    """Return where functions of the place are evaluated, a row for each entry of a state."""
    if components == 1:
        return grid.points
    units = np.repeat(np.eye(components), grid.size, axis=0)
    return np.hstack([np.tile(grid.points, (components, 1)), units])


def on_all(value: Any, grid: Grid, components: int) -> Any:
    """Return values at all points of a grid as those of each component, and others as they are."""
    if components > 1 and np.shape(value) in (grid.shape, (grid.size,)):
        return np.tile(np.ravel(value), components)
    return value


def observed(
    observe: Mapping[str, Any] | None, grid: Grid, components: int
) -> Mapping[str, Any] | None:
    """Return observables of all components for those of one, or of the components alone.

    A diagonal, matrix or operator of the order of the grid is that of each component, and a matrix
    of their number acts between them at each point.
    """
    if components == 1 or not isinstance(observe, Mapping):
        return observe
    found = dict(observe)
    for name, given in observe.items():
        if isinstance(given, tuple) and len(given) == 2 and given[0] == grid.size:
            found[name] = (components * grid.size, OnEach(components, given[1]))
        elif hasattr(given, "tocsr") or np.ndim(given) == 2 or isinstance(given, np.ndarray | list):
            found[name] = of_all(f"observable '{name}'", given, grid, components)
    return found


def drives(drive: list[tuple[Any, Any]], source: Any, components: Any) -> list[tuple[Any, Any]]:
    """Return a drive with matrices of all components of a grid."""
    if not isinstance(source, Grid):
        return drive
    many = count("components", components)
    return [(f, of_all(f"H{k + 1}", h, source, many)) for k, (f, h) in enumerate(drive)]


def of_all(what: str, given: Any, grid: Grid, components: int) -> Any:
    """Return a matrix of all components for that of each, or of components alone, else the same."""
    n, shape = grid.size, np.shape(given)
    if components > 1 and shape in ((components, components), (n, n)):
        sparse = scipy("sparse", f"{what} of several components")
        between = shape == (components, components)
        pair = (given, sparse.eye_array(n)) if between else (sparse.eye_array(components), given)
        return sparse.kron(*pair, format="csr")
    is_real = np.asarray(given).dtype.kind in "iuf"
    return on_all(given, grid, components) if is_real else given


def potential(grid: Grid, params: _trace.Parameters, components: int) -> TimeFunction | np.ndarray:
    """Return a grid's potential: a function, or flat values at all points of all components."""
    given = grid.potential
    if callable(given):
        return of_place("potential", given, params, grid, components)
    if given is None:
        return np.zeros(components * grid.size)
    if given.ndim == len(grid.shape):
        return np.tile(given.ravel(), components)
    if len(given) != components:
        shape = (components, *grid.shape)
        raise misshapen("potential", given.shape, f"{grid.shape} or {shape} as components= says")
    return given.ravel()


def of_place(
    what: str, function: Callable[..., Any], params: _trace.Parameters, grid: Grid, components: int
) -> TimeFunction:
    """Return a function of time and place of a grid."""
    if components > 1:
        return OfComponents(what, function, params, grid, components)
    return TimeFunction(what, function, params, len(grid.shape))
