"""From data on a grid to a vector potential in splines.

A velocity is given by coefficients c of its components, v_k in functions B along its own axis and D
across it. Its divergence has the coefficients sum d_k c_k; where they are zero, it is zero at every
point. The potential A has functions D along its own axis and B across it, and v = curl A is made of
differences of coefficients alone, so that the velocity does not depend on the gauge.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._systems.fields.gridded.axis import Array, Axis, Kind

#: Numbers of a component at times that are taken together.
TOGETHER = 2**20


@dataclass(frozen=True, eq=False)
class Potential:
    """A vector potential, and what else a velocity has.

    Attributes
    ----------
    a : tuple of ndarray
        Coefficients of its components, the time first where there is one: three, or in the plane
        the stream function alone.
    mean : ndarray, shape (n,) or (T, n)
        The mean flow, which has no periodic potential.
    divergence : float
        Part of the velocity given that had to be taken off: root of the integral of its square over
        that of the velocity's.
    square : float
        The latter, 0 where nothing had to be taken off.
    islands : int
        How many islands there are in three dimensions.
    """

    a: tuple[Array, ...]
    mean: Array
    divergence: float
    square: float
    islands: int = 0


def blocks(values: Array) -> Iterator[slice]:
    """Give slices of the first axis, so small that what is made of them takes little memory."""
    count = len(values)
    each = max(1, TOGETHER * count // max(values.size, 1))
    for first in range(0, count, each):
        yield slice(first, min(first + each, count))


def joined(parts: Sequence[Potential]) -> Potential:
    """Return the potential at times one after another."""
    if len(parts) == 1:
        return parts[0]
    square = sum(part.square for part in parts)
    taken = sum(part.divergence**2 * part.square for part in parts)
    return Potential(
        tuple(np.concatenate(each) for each in zip(*(part.a for part in parts), strict=True)),
        np.concatenate([part.mean for part in parts]),
        float(np.sqrt(taken / square)) if square else 0.0,
        square,
    )


def in_time(time: Axis, values: Array) -> Array:
    """Return the coefficients of values at times, some of the axis behind them together."""
    found = np.empty((time.n + time.p, *values.shape[1:]))
    for part in blocks(values.swapaxes(0, 1)):
        found[:, part] = time.interpolated(values[:, part], 0)
    return found


def fluxes_of_nodes(velocity: Sequence[Array], axes: Sequence[Axis], lead: int) -> list[Array]:
    """Return the coefficients c of components given at the nodes; `lead` axes are before theirs."""
    return [
        _each(axes, lead, values, lambda axis, j, x, k=k: _of_nodes(axis, j == k, x, lead + j))
        for k, values in enumerate(velocity)
    ]


def fluxes_of_faces(faces: Sequence[Array], axes: Sequence[Axis], lead: int) -> list[Array]:
    """Return the coefficients c of fluxes through the faces of cells."""
    return [
        _each(axes, lead, values, lambda axis, j, x, k=k: _of_faces(axis, j == k, x, lead + j))
        for k, values in enumerate(faces)
    ]


def of_potential(potential: Sequence[Array], axes: Sequence[Axis], lead: int) -> tuple[Array, ...]:
    """Return the coefficients of a potential given at the nodes."""
    if len(axes) == 2:
        return tuple(
            _each(axes, lead, values, lambda axis, j, x: axis.interpolated(x, lead + j))
            for values in potential
        )
    return tuple(
        _each(axes, lead, values, lambda axis, j, x, k=k: _of_nodes(axis, j != k, x, lead + j))
        for k, values in enumerate(potential)
    )


def _each(axes: Sequence[Axis], lead: int, values: Array, change: Any) -> Array:
    for j, axis in enumerate(axes):
        values = change(axis, j, values)
    return values


def _of_nodes(axis: Axis, is_along: bool, values: Array, k: int) -> Array:
    return axis.interpolated(values, k) if is_along else axis.averaged(values, k)


def _of_faces(axis: Axis, is_along: bool, values: Array, k: int) -> Array:
    return axis.interpolated(values, k) if is_along else axis.histopolated(values, k)


def curl(a: Sequence[Array], axes: Sequence[Axis], lead: int) -> list[Array]:
    """Return the coefficients c of the curl of a potential."""

    def d(k: int, values: Array) -> Array:
        return axes[k].difference(values, lead + k)

    if len(axes) == 2:
        return [d(1, a[0]), -d(0, a[0])]
    return [d(1, a[2]) - d(2, a[1]), d(2, a[0]) - d(0, a[2]), d(0, a[1]) - d(1, a[0])]


def divergence(c: Sequence[Array], axes: Sequence[Axis], lead: int) -> Array:
    """Return the coefficients of the divergence."""
    total: Array = sum(
        (axis.difference(c[k], lead + k) for k, axis in enumerate(axes)),
        start=np.zeros(()),
    )
    return total


def kinds_of(component: int, n: int, of_velocity: bool) -> tuple[Kind, ...]:
    """Return the functions of a component along each axis."""
    if n == 2 and not of_velocity:
        return ("B", "B")
    own, other = ("B", "D") if of_velocity else ("D", "B")
    return tuple(own if j == component else other for j in range(n))  # type: ignore[misc]


def solved(c: Sequence[Array], axes: Sequence[Axis], lead: int) -> Potential:
    """Take the divergence off, and return the potential whose own divergence is zero.

    In modes, where differences are products with s: c - conj(s) (s . c) / |s|^2 has no divergence,
    and a = -conj(s) x c / |s|^2 its curl, with no divergence of its own. Its coefficients along
    walls are zero, so that each plane by itself keeps them.
    """
    n = len(axes)
    inner = [_without_walls(values, axes[k], lead + k) for k, values in enumerate(c)]
    waves = [_inward(values, axes, lead, kinds_of(k, n, True)) for k, values in enumerate(inner)]
    s = [axis.modes.s.reshape([-1 if j == k else 1 for j in range(n)])
         for k, axis in enumerate(axes)]  # fmt: skip
    square = sum(np.abs(each) ** 2 for each in s)
    inverse = np.divide(1.0, square, out=np.zeros(square.shape), where=square > 0)
    off = sum(factor * wave for factor, wave in zip(s, waves, strict=True)) * inverse
    size = sum(float(np.sum(np.abs(wave) ** 2)) for wave in waves)
    size += sum(_wall_square(values, axes, lead, k) for k, values in enumerate(c))
    taken = sum(float(np.sum(np.abs(np.conj(factor) * off) ** 2)) for factor in s)
    taken += sum(_wall_square(values, axes, lead, k) for k, values in enumerate(c))
    waves = [wave - np.conj(factor) * off for factor, wave in zip(s, waves, strict=True)]
    t = [np.conj(factor) * inverse for factor in s]
    if n == 2:
        hats = [t[1] * waves[0] - t[0] * waves[1]]
    else:
        hats = [
            t[2] * waves[1] - t[1] * waves[2],
            t[0] * waves[2] - t[2] * waves[0],
            t[1] * waves[0] - t[0] * waves[1],
        ]
    a = tuple(
        _with_walls(_outward(hat, axes, lead, kinds_of(k, n, False)), axes, lead,
                    kinds_of(k, n, False))
        for k, hat in enumerate(hats)
    )  # fmt: skip
    mean = np.stack(
        [_mean_of(wave, axes, lead, k) for k, wave in enumerate(waves)], axis=-1
    )  # fmt: skip
    return Potential(a, mean, float(np.sqrt(taken / size)) if size else 0.0, size)


def _mean_of(wave: Any, axes: Sequence[Axis], lead: int, component: int) -> Array:
    """Return the mean of a component, that of the mode without any change in space."""
    place = (..., *(0,) * len(axes))
    factor = 1.0
    for axis in axes:
        factor /= np.sqrt(axis.length)
    found: Array = np.real(wave[place]) * factor
    if axes[component].bounds == "wall" or any(
        axis.bounds == "open" for k, axis in enumerate(axes) if k != component
    ):
        return np.zeros_like(found)
    return found


def _without_walls(values: Array, axis: Axis, k: int) -> Array:
    """Leave out the functions B that are not zero at a wall."""
    return (
        np.take(values, range(1, axis.n + axis.p - 1), axis=k) if axis.bounds == "wall" else values
    )


def _with_walls(values: Array, axes: Sequence[Axis], lead: int, kinds: Sequence[Kind]) -> Array:
    """Put zeros where functions at walls were left out."""
    padding = [(0, 0)] * lead + [
        (1, 1) if axis.bounds == "wall" and kind == "B" else (0, 0)
        for axis, kind in zip(axes, kinds, strict=True)
    ]
    return np.ascontiguousarray(np.pad(values, padding))


def _wall_square(values: Array, axes: Sequence[Axis], lead: int, k: int) -> float:
    """Return about the integral of the square of what flows through walls in the first cells."""
    axis = axes[k]
    if axis.bounds != "wall":
        return 0.0
    square = 0.0
    for end, spans in ((0, axis.spans[0]), (-1, axis.spans[-1])):
        wall = np.take(values, [end], axis=lead + k)
        for j, other in enumerate(axes):
            if j != k:
                shape = [-1 if i == lead + j else 1 for i in range(wall.ndim)]
                wall = wall / np.sqrt(other.spans).reshape(shape)
        square += float(np.sum(wall**2)) * spans
    return square


def _inward(values: Array, axes: Sequence[Axis], lead: int, kinds: Sequence[Kind]) -> Any:
    for j, (axis, kind) in enumerate(zip(axes, kinds, strict=True)):
        values = axis.modes.inward(values, lead + j, kind)
    return values


def _outward(waves: Any, axes: Sequence[Axis], lead: int, kinds: Sequence[Kind]) -> Array:
    for j, (axis, kind) in enumerate(zip(axes, kinds, strict=True)):
        waves = axis.modes.outward(waves, lead + j, kind)
    return np.real(waves)


def steepest(a: Array, axes: Sequence[Axis], lead: int, plane: tuple[int, int]) -> float:
    """Return a bound of the mixed derivative of a component by the two coordinates of its plane."""
    i, j = plane
    for k in (i, j):
        a = axes[k].difference(a, lead + k)
    for k, axis in enumerate(axes):
        # coefficients of D times p / (t_{i+p} - t_i) are those of functions whose sum is 1
        if k in (i, j) or len(axes) == 3:
            shape = [-1 if m == lead + k else 1 for m in range(a.ndim)]
            a = a / axis.spans.reshape(shape)
    return float(np.abs(a).max(initial=0.0))
