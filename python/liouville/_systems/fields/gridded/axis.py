"""One axis of a grid: its spline functions, and the way from data to their coefficients.

The functions B of degree p have the potential across the axis, and D = p N / (t_{i+p} - t_i) of
degree p - 1 the flux through it: the derivative of sum a_i B_i is sum (a_{i+1} - a_i) D_i, so that
fluxes follow from potentials by differences of coefficients alone. The integral of each D is 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from liouville._basics.scipy import scipy
from liouville._systems.fields.gridded.interpolation import WHAT as WHAT
from liouville._systems.fields.gridded.interpolation import Array as Array
from liouville._systems.fields.gridded.interpolation import Interpolation

Waves = NDArray[np.complex128]
Bounds = Literal["periodic", "wall", "open"]
Kind = Literal["B", "D"]


@dataclass(frozen=True, eq=False)
class Axis:
    """The cells between `edges`, and splines on them of degree `p`.

    Attributes
    ----------
    name : str
        The name of the coordinate.
    edges : ndarray, shape (n + 1,)
        Ends of the cells; the last of a periodic axis is the first, a period later.
    p : int
        Degree of the functions B.
    bounds : {"periodic", "wall", "open"}
        What is at the ends. Functions B that are not zero at a wall are left out of potentials.
    """

    name: str
    edges: Array
    p: int
    bounds: Bounds

    @property
    def n(self) -> int:
        """The number of cells."""
        return self.edges.size - 1

    @property
    def is_periodic(self) -> bool:
        """Whether the last edge is the first."""
        return self.bounds == "periodic"

    @property
    def length(self) -> float:
        """The length of the axis."""
        return float(self.edges[-1] - self.edges[0])

    @property
    def nodes(self) -> int:
        """How many nodes the data have."""
        return self.n + (not self.is_periodic)

    @cached_property
    def knots(self) -> Array:
        """The knots of the functions B, p more than edges on both sides."""
        if self.is_periodic:
            places: Array = np.arange(-self.p, self.n + self.p + 1.0)
            found: Array = self.edges[0] + self.length / self.n * places
            return found
        ends = np.full(self.p, self.edges[0]), np.full(self.p, self.edges[-1])
        return np.concatenate([ends[0], self.edges, ends[1]])

    @cached_property
    def greville(self) -> Array:
        """The coefficients of the coordinate itself, of all functions that a cell touches."""
        found = np.convolve(self.knots[1:-1], np.full(self.p, 1 / self.p), "valid")
        if not self.is_periodic:
            found[0], found[-1] = self.edges[0], self.edges[-1]
        return np.asarray(found, dtype=float)

    @cached_property
    def spans(self) -> Array:
        """(t_{i+p} - t_i) / p of the functions D: the coefficients of the constant 1."""
        t = self.knots[1:-1]
        found: Array = (t[self.p :] - t[: -self.p]) / self.p
        return found[: self.n] if self.is_periodic else found

    # tables

    def basis(self, kind: Kind) -> tuple[Any, ...]:
        """Return the functions as the core reads them."""
        return self._bases[kind]

    @cached_property
    def _bases(self) -> dict[Kind, tuple[Any, ...]]:
        return {"B": self._basis("B"), "D": self._basis("D")}

    def _basis(self, kind: Kind) -> tuple[Any, ...]:
        q = self.p if kind == "B" else self.p - 1
        origin = self.edges[:-1].copy()
        if not self.is_periodic:
            origin[-1] = self.edges[-1]
        table_of = np.arange(self.n)
        if self._is_uniform:
            # the ends have tables of their own, the inner cells one
            last = self.n - 1 - self.p
            table_of = np.minimum(table_of, self.p) + np.maximum(table_of - last, 0)
            table_of[:] = np.unique(table_of, return_inverse=True)[1]
            if self.is_periodic:
                table_of[:] = 0
        cells = np.unique(table_of, return_index=True)[1]
        tables = np.stack([self._table(int(cell), q, float(origin[cell]), kind) for cell in cells])
        return (
            np.ascontiguousarray(self.edges), q, np.ascontiguousarray(tables.ravel()),
            table_of.astype(np.int64), origin, self.bounds,
        )  # fmt: skip

    @cached_property
    def _is_uniform(self) -> bool:
        widths = np.diff(self.edges)
        return bool(np.ptp(widths) <= 1e-9 * widths.mean())

    def _table(self, cell: int, q: int, origin: float, kind: str) -> Array:
        """Return coefficients of s^k in s = (x - origin) / width, shape (q + 1, q + 1), k first."""
        width = self.edges[cell + 1] - self.edges[cell]
        t = self.knots if kind == "B" else self.knots[1:-1]
        if self._is_uniform:
            # whole numbers, so that every machine and every cell has the same ones
            width, shift = 1.0, round((origin - self.edges[0]) / self.length * self.n)
            p = self.p if kind == "B" else self.p - 1
            tau = np.arange(-p, self.n + p + 1.0)
            tau = (tau if self.is_periodic else np.clip(tau, 0, self.n)) - shift
            scale = self.n / self.length
        else:
            tau, scale = t - origin, 1.0
        local = tau[cell : cell + 2 * q + 2]  # those of the q + 1 functions
        functions = np.zeros((q + 1, q + 1))
        functions[q, 0] = 1.0  # function q - j of degree 0 begins at local[q - j]
        for degree in range(1, q + 1):
            raised = np.zeros_like(functions)
            for i in range(q - degree, q + 1):
                if (rise := local[i + degree] - local[i]) > 0:
                    raised[i] += _times(functions[i], -local[i] / rise, width / rise)
                if i < q and (fall := local[i + degree + 1] - local[i + 1]) > 0:
                    raised[i] += _times(
                        functions[i + 1], local[i + degree + 1] / fall, -width / fall
                    )
            functions = raised
        if kind == "D":
            spans = (local[self.p : self.p + q + 1] - local[: q + 1]) / self.p
            functions = functions * (scale / spans)[:, None]
        return np.ascontiguousarray(functions.T)

    # data to coefficients; the axis of the array is `k`

    def interpolated(self, values: Array, k: int) -> Array:
        """Return coefficients B of values at the nodes."""
        if self.is_periodic:
            return self._filtered(values, k, 1.0 / self._symbol)
        inner = self._through_nodes.spline(np.moveaxis(values, k, 0))
        # the knots left out by "not a knot" are put in
        full = self._with_all_knots.coefficients(inner(self.greville))
        return np.moveaxis(full, 0, k)

    @cached_property
    def _through_nodes(self) -> Interpolation:
        return Interpolation(self.edges, self.p)

    @cached_property
    def _with_all_knots(self) -> Interpolation:
        return Interpolation(self.greville, self.p, self.knots)

    def histopolated(self, integrals: Array, k: int) -> Array:
        """Return coefficients D of integrals over cells."""
        if self.is_periodic:
            return self._filtered(integrals, k, 1.0 / self._symbol)
        sums = np.cumsum(integrals, axis=k)
        padding = [(0, 0)] * sums.ndim
        padding[k] = (1, 0)
        return np.diff(self.interpolated(np.pad(sums, padding), k), axis=k)

    def averaged(self, values: Array, k: int) -> Array:
        """Return coefficients D of values at the nodes, whose interpolant is integrated."""
        if self.is_periodic:
            powers = 1.0 / np.arange(1, self.p + 2)
            cell = self.length / self.n * (powers @ self._periodic)
            return self._filtered(values, k, self._transfer(cell) / self._symbol**2)
        spline = self._through_nodes.spline(np.moveaxis(values, k, 0))
        sums = np.moveaxis(spline.antiderivative()(self.edges), 0, k)
        return np.diff(self.interpolated(sums, k), axis=k)

    def difference(self, coefficients: Array, k: int) -> Array:
        """Return coefficients D of the derivative of a spline with coefficients B."""
        if self.is_periodic:
            return np.roll(coefficients, -1, axis=k) - coefficients
        return np.diff(coefficients, axis=k)

    def padded(self, coefficients: Array, k: int, kind: Kind) -> Array:
        """Repeat the first coefficients of a periodic axis behind the last."""
        if not self.is_periodic:
            return coefficients
        more = self.p if kind == "B" else self.p - 1
        places = np.arange(self.n + more) % self.n
        return np.take(coefficients, places, axis=k)

    @cached_property
    def _periodic(self) -> Array:
        return self._table(0, self.p, float(self.edges[0]), "B")

    @cached_property
    def _symbol(self) -> Waves:
        return self._transfer(self._periodic[0])

    def _transfer(self, weights: Array) -> Waves:
        angles = 2j * np.pi * np.arange(self.n // 2 + 1) / self.n
        found: Waves = np.exp(angles[:, None] * np.arange(weights.size)) @ weights
        return found

    def _filtered(self, values: Array, k: int, factor: Waves) -> Array:
        shape = [1] * values.ndim
        shape[k] = factor.size
        spectrum = np.fft.rfft(values, axis=k) * factor.reshape(shape)
        found: Array = np.fft.irfft(spectrum, self.n, axis=k)
        return found

    # modes

    @cached_property
    def modes(self) -> Modes:
        """The functions in which differences are products."""
        return Modes(self)


def _times(polynomial: Array, constant: float, slope: float) -> Array:
    """Return a polynomial times (constant + slope s); its highest power is not filled yet."""
    found = constant * polynomial
    found[1:] += slope * polynomial[:-1]
    return found


class Modes:
    """The modes of an axis: coefficients in them are multiplied by `s` where B becomes D.

    They are pairs (V, U = d V / s) with d^H M_D d V = |s|^2 M_B V and the mass matrices M, so that
    sums of squares of modes are integrals of squares; waves on a periodic axis. One number stands
    for what V or U lack.

    Attributes
    ----------
    s : ndarray, shape (m,)
        The factors: 0 for the constant.
    """

    def __init__(self, axis: Axis) -> None:
        self._axis = axis
        if axis.is_periodic:
            angles = np.arange(axis.n) * (2j * np.pi / axis.n)
            self._mass = {kind: _symbol(axis, kind, angles) for kind in ("B", "D")}
            self.s = (np.exp(angles) - 1) * np.sqrt(self._mass["D"] / self._mass["B"])
            self.s[0] = 0
            return
        mass_b, mass_d = _mass(axis, "B"), _mass(axis, "D")
        d = np.diff(np.eye(axis.n + axis.p), axis=0)
        is_wall = axis.bounds == "wall"
        inner = slice(1, -1) if is_wall else slice(None)
        d, mass_b = d[:, inner], mass_b[inner, inner]
        squares, v = scipy("linalg", WHAT).eigh(d.T @ mass_d @ d, mass_b)
        # without walls the constant comes first, whose difference is zero; with them it is a D
        first = 0 if is_wall else 1
        s = np.sqrt(squares[first:])
        u, none = d @ v[:, first:] / s, np.zeros((1, 1))
        if is_wall:
            v = np.column_stack([np.broadcast_to(none, (len(v), 1)), v])
            u = np.column_stack([axis.spans / np.sqrt(axis.length), u])
        else:
            u = np.column_stack([np.broadcast_to(none, (len(u), 1)), u])
            v[:, 0] = 1 / np.sqrt(axis.length)
        self.s = np.concatenate([[0.0], s])
        self._out = {"B": v, "D": u}
        self._in = {"B": v.T @ mass_b, "D": u.T @ mass_d}

    def inward(self, c: Any, k: int, kind: Kind) -> Any:
        """Return the modes of an array of coefficients."""
        if self._axis.is_periodic:
            return np.fft.fft(c, axis=k, norm="ortho") * self._root(kind, k, np.ndim(c))
        return _along(self._in[kind], c, k)

    def outward(self, c: Any, k: int, kind: Kind) -> Any:
        """Return the coefficients of modes."""
        if self._axis.is_periodic:
            return np.fft.ifft(c / self._root(kind, k, np.ndim(c)), axis=k, norm="ortho")
        return _along(self._out[kind], c, k)

    def _root(self, kind: Kind, k: int, ndim: int) -> Array:
        shape = [1] * ndim
        shape[k] = self._axis.n
        root: Array = np.sqrt(self._mass[kind]).reshape(shape)
        return root


def _along(matrix: Array, c: Any, k: int) -> Any:
    return np.moveaxis(np.tensordot(matrix, c, axes=(1, k)), 0, k)


def _symbol(axis: Axis, kind: Kind, angles: NDArray[Any]) -> Array:
    """Return the mass matrix of a periodic axis in waves."""
    own = _integrals(axis, kind, 0)
    found: Array = sum(
        np.trace(own, offset) * np.exp(angles * offset) for offset in range(1 - len(own), len(own))
    ).real
    return found


def _mass(axis: Axis, kind: Kind) -> Array:
    """Return the integrals of products of two functions."""
    q = axis.p if kind == "B" else axis.p - 1
    mass = np.zeros((axis.n + q, axis.n + q))
    for cell in range(axis.n):
        own = slice(cell, cell + q + 1)
        mass[own, own] += _integrals(axis, kind, cell)
    return mass


def _integrals(axis: Axis, kind: Kind, cell: int) -> Array:
    """Return the integrals over a cell of products of the functions that it touches."""
    edges, q, tables, table_of, origin, _ = axis.basis(kind)
    table = tables.reshape(-1, q + 1, q + 1)[table_of[cell]]
    points, weights = np.polynomial.legendre.leggauss(q + 1)
    width = edges[cell + 1] - edges[cell]
    s = (edges[cell] - origin[cell]) / width + (points + 1) / 2
    values = np.vander(s, q + 1, increasing=True) @ table
    found: Array = width / 2 * (values.T * weights) @ values
    return found
