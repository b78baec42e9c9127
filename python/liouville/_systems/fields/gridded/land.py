"""Land in three dimensions: nothing flows in its cells or on their rim.

First the velocity loses every function that meets land, and the divergence that this leaves is
taken off by the smallest change of the others. Its potential then has no curl on land and is a
gradient there, which is taken off everywhere. What is left on land are constants of the third
component, one for each piece of land at each level: differences of them are what flows between
coasts. So each plane of a step stands still on land by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.scipy import scipy
from liouville._systems.fields.gridded import islands
from liouville._systems.fields.gridded.axis import WHAT, Array, Axis
from liouville._systems.fields.gridded.islands import Mask
from liouville._systems.fields.gridded.potential import Potential, curl, kinds_of, solved

#: Equations are solved to this part of their right sides, in at most so many steps.
SOLVED, STEPS = 1e-11, 2000

#: Right sides of this part of the numbers whose differences they are have rounding errors alone.
ROUNDED = 1e-14

#: A mean flow of this part of the velocity is roundoff.
ROUNDOFF = 1e-9

#: A potential on land is a gradient and its constants to this part of the largest one.
CLOSED = 1e-6


def with_land(found: Potential, land: Mask, axes: Sequence[Axis], lead: int) -> Potential:
    """Return the potential of the nearest velocity that is zero on land.

    The third axis has walls, and land goes down to one of them everywhere.

    Raises
    ------
    ValueError
        A mean flow goes by land that goes all round.
    RuntimeError
        The equations are not solved.
    """
    shore = _Shore(land, axes)
    faces = curl(found.a, axes, lead)
    for k, face in enumerate(faces):
        spans = [np.ones(_widths(x).size) if j == k else x.spans for j, x in enumerate(axes)]
        face += found.mean[..., k, None, None, None] * _outer(spans)
    count = int(np.prod(faces[0].shape[:lead]))
    rows = [x.reshape(count, *x.shape[lead:]) for x in faces]
    for time in range(count):
        for x, closed in zip(rows, shore.closed([x[time] for x in rows]), strict=True):
            x[time] = closed
    again = solved(faces, axes, lead)
    # a mean flow by land that goes all round is refused, and one of roundoff is none
    mean = np.where(np.abs(again.mean) > ROUNDOFF * _speed(again, axes), again.mean, 0.0)
    means = mean.reshape(count, 3)
    parts = [x.reshape(count, *x.shape[lead:]) for x in again.a]
    for time in range(count):
        still = shore.still([x[time] for x in parts], means[time])
        for x, part in zip(parts, still, strict=True):
            x[time] = part
    a = tuple(x.reshape(y.shape) for x, y in zip(parts, again.a, strict=True))
    return replace(found, a=a, mean=mean, islands=shore.islands)


def _speed(found: Potential, axes: Sequence[Axis]) -> float:
    """Return the root of the mean square of a velocity, over all times."""
    count = int(np.prod(found.mean.shape[:-1]))
    return float(np.sqrt(found.square / (count * np.prod([axis.length for axis in axes]))))


@dataclass(frozen=True, eq=False)
class _Shore:
    """The functions that meet land, and those at walls."""

    land: Mask
    axes: Sequence[Axis]

    @cached_property
    def _weights(self) -> list[Array]:
        """One over the weights of fluxes in the mean square, 0 on land and at walls."""
        found = []
        for k, axis in enumerate(self.axes):
            weight = _outer(1 / _widths(x) if j == k else x.spans for j, x in enumerate(self.axes))
            weight[islands.touched(self.land, self.axes, kinds_of(k, 3, True))] = 0
            if axis.bounds == "wall":
                np.moveaxis(weight, k, 0)[[0, -1]] = 0
            found.append(weight)
        return found

    @cached_property
    def _of_cells(self) -> _Separable:
        """The equations of :meth:`closed` without land."""
        parts = []
        for axis in self.axes:
            d, weight = axis.difference(np.eye(_widths(axis).size), 0), 1 / _widths(axis)
            weight[_ends(axis)] = 0
            parts.append(((d * weight) @ d.T, axis.spans))
        return _Separable(parts)

    def closed(self, c: Sequence[Array]) -> list[Array]:
        """Return the nearest fluxes without a divergence that are zero on land."""
        weights, axes = self._weights, self.axes
        wet = [np.where(weight > 0, x, 0.0) for weight, x in zip(weights, c, strict=True)]

        def flux(phi: Array) -> list[Array]:
            return [weight * _adjoint(axes[k], phi, k) for k, weight in enumerate(weights)]

        def divergence(faces: Sequence[Array]) -> Array:
            return reduce(np.add, (axes[k].difference(x, k) for k, x in enumerate(faces)))

        is_free = reduce(
            np.logical_or,
            (w > 0 for k, weight in enumerate(weights) for w in _sides(axes[k], weight, k)),
        )
        phi = _solution(
            lambda x: divergence(flux(x)), self._of_cells, divergence(wet), is_free, _norm(wet)
        )
        return [x - change for x, change in zip(wet, flux(phi), strict=True)]

    # a potential of which each plane is still on land

    @cached_property
    def _walls(self) -> list[Mask]:
        """The functions of a level that are not zero at each of its walls."""
        level, walls = self.axes[:2], []
        for k, axis in enumerate(level):
            for end in _ends(axis):
                wall = np.zeros([_widths(x).size for x in level], dtype=bool)
                np.moveaxis(wall, k, 0)[end] = True
                walls.append(wall)
        return walls

    @cached_property
    def _level(self) -> list[NDArray[np.int64]]:
        """Numbers of the pieces of land and walls at each level of the third component, from 1."""
        *level, up = self.axes
        found: list[NDArray[np.int64]] = []
        before = None
        for k in range(up.spans.size):
            land = np.asarray(self.land[..., max(0, k - up.p + 1) : k + 1].any(-1))
            if before is None or (land != before).any():
                masks = [functions for _, functions in islands.pieces(land, level)]
                masks += self._walls
                numbers = _joined(masks, [_widths(x).size for x in level])
            before = land
            found.append(numbers)
        return found

    @cached_property
    def _bottom(self) -> int:
        """The end of the third axis that land goes down to."""
        return -1 if (self.land[..., :-1] <= self.land[..., 1:]).all() else 0

    @property
    def _top(self) -> NDArray[np.int64]:
        """Numbers of the pieces that reach the surface."""
        return self._level[-1 - self._bottom]

    @property
    def islands(self) -> int:
        """How many pieces of land reach the surface and meet no wall."""
        at_walls: set[int] = set()
        for k, axis in enumerate(self.axes[:2]):
            for end in _ends(axis):
                at_walls |= set(np.unique(np.take(self._top, end, k)))
        return len(set(np.unique(self._top)) - at_walls - {0})

    def _constants(self, up: Array, mean: Array) -> tuple[Array, Array]:
        """Return the constants of the third component, and the part of a mean flow in it.

        Both are zero in the water. At each level a piece has one, and those of a piece that reaches
        the surface sum up to what flows between it and others. The difference of both is exactly
        zero at a wall, so that a trajectory on it stays there; of two walls that land joins, at the
        first.
        """
        spans, axes = self.axes[2].spans, self.axes[:2]
        is_wall = reduce(np.logical_or, self._walls, np.zeros(up.shape[:2], dtype=bool))
        flow, constants = np.zeros_like(up), np.zeros_like(up)
        usual: list[Array] = []
        for k, numbers in enumerate(self._level):
            own = np.zeros(numbers.max(initial=0) + 1)
            for number in range(1, own.size):
                x, y = islands.coordinates(numbers == number, mean, axes)
                part = (mean[0] * y - mean[1] * x) * spans[k]
                flow[numbers == number, k] = part
                at_wall = part[is_wall[numbers == number]]
                own[number] = at_wall[0] if at_wall.size else (part.min() + part.max()) / 2
            usual.append(own)
            constants[..., k] = own[numbers]
        rest = (up + flow - constants).sum(-1)
        for number in set(np.unique(self._top)) - {0}:
            piece = self._top == number
            alone = [k for k, numbers in enumerate(self._level) if self._is_alone(numbers, piece)]
            at_wall = rest[piece & is_wall]
            whole = at_wall[0] if at_wall.size else rest[piece].mean()
            share = whole * spans[alone] / spans[alone].sum()
            for k, more in zip(alone, share, strict=True):
                constants[self._level[k] == self._level[k][piece][0], k] += more
        return constants, flow

    def _is_alone(self, numbers: NDArray[np.int64], piece: Mask) -> bool:
        """Return whether a piece at the surface meets no other one at a level."""
        return set(np.unique(self._top[numbers == numbers[piece][0]])) <= {0, self._top[piece][0]}

    @cached_property
    def _fixed(self) -> Mask:
        """The places where a gradient is given: land and walls."""
        found = islands.touched(self.land, self.axes)
        for k, axis in enumerate(self.axes):
            np.moveaxis(found, k, 0)[_ends(axis)] = True
        return found

    @cached_property
    def _of_nodes(self) -> _Separable:
        """The equations of :meth:`still` without land."""
        parts = []
        for axis in self.axes:
            d = axis.difference(np.eye(_widths(axis).size), 0)
            d[:, _ends(axis)] = 0
            parts.append(((d.T / axis.spans) @ d, _widths(axis)))
        return _Separable(parts)

    def still(self, a: Sequence[Array], mean: Array) -> list[Array]:
        """Return a potential with the same curl each of whose components is still on land."""
        axes = self.axes
        constants, flow = self._constants(a[2], mean)
        is_coast = np.stack(self._level, axis=-1) > 0
        sums = np.zeros(self._fixed.shape)
        sums[..., 1:] = np.cumsum(np.where(is_coast, a[2] + flow - constants, 0.0), axis=-1)
        chi = np.where(self._fixed, sums - sums[..., [self._bottom]], 0.0)
        chi[..., _ends(axes[2])] = 0
        weights = [
            _outer(1 / x.spans if j == k else _widths(x) for j, x in enumerate(axes))
            for k in range(3)
        ]

        def without(chi: Array) -> list[Array]:
            return [x - axes[k].difference(chi, k) for k, x in enumerate(a)]

        def weighed(edges: Sequence[Array]) -> list[Array]:
            return [weight * x for weight, x in zip(weights, edges, strict=True)]

        def back(edges: Sequence[Array]) -> Array:
            return reduce(np.add, (_adjoint(axes[k], x, k) for k, x in enumerate(edges)))

        def equations(x: Array) -> Array:
            return back(weighed([axes[k].difference(x, k) for k in range(3)]))

        given = weighed(without(chi))
        chi += _solution(equations, self._of_nodes, back(given), ~self._fixed, _norm(given))
        return self._exact(without(chi), constants - flow)

    def _exact(self, a: list[Array], constants: Array) -> list[Array]:
        """Put what a potential is on land and along walls but for roundoff."""
        largest = max(float(np.abs(x).max()) for x in a)
        for k, (x, given) in enumerate(zip(a, (0 * a[0], 0 * a[1], constants), strict=True)):
            is_known = islands.touched(self.land, self.axes, kinds_of(k, 3, False))
            for j, axis in enumerate(self.axes):
                if j != k:
                    np.moveaxis(is_known, j, 0)[_ends(axis)] = True
            if np.abs(x - given)[is_known].max(initial=0.0) > CLOSED * largest:
                raise RuntimeError("the potential on land is not the gradient that it should be")
            x[is_known] = given[is_known]
        return a


class _Separable:
    """The inverse of a sum over axes of K x M x M, each K and diagonal M of one axis.

    Parameters
    ----------
    parts : sequence of (ndarray, ndarray)
        K and the diagonal of M of each axis.
    """

    def __init__(self, parts: Sequence[tuple[Array, Array]]) -> None:
        values = []
        self._vectors = []
        for stiffness, mass in parts:
            root = 1 / np.sqrt(mass)
            own, vectors = scipy("linalg", WHAT).eigh(root[:, None] * stiffness * root)
            values.append(np.where(own > own.max() * own.size * np.finfo(float).eps, own, 0.0))
            self._vectors.append(root[:, None] * vectors)
        total = reduce(np.add.outer, values)
        self._inverse = np.divide(1.0, total, out=np.zeros(total.shape), where=total > 0)

    def __call__(self, x: Array) -> Array:
        for k, vectors in enumerate(self._vectors):
            x = np.moveaxis(np.tensordot(vectors, x, axes=(0, k)), 0, k)
        x = x * self._inverse
        for k, vectors in enumerate(self._vectors):
            x = np.moveaxis(np.tensordot(vectors, x, axes=(1, k)), 0, k)
        return x


def _solution(
    equations: Callable[[Array], Array],
    inverse: _Separable,
    right: Array,
    is_free: Mask,
    size: float,
) -> Array:
    """Solve equations for the free unknowns by conjugate gradients, others being zero.

    The right side is made of differences of numbers of this size, and is zero but for roundoff
    where nothing flows on land.
    """
    right = np.where(is_free, right, 0.0)
    if np.linalg.norm(right) <= ROUNDED * size:
        return np.zeros(right.shape)
    linalg, shape, size = scipy("sparse.linalg", WHAT), right.shape, right.size

    def restricted(function: Callable[[Array], Array]) -> Any:
        def act(x: Array) -> Array:
            found = function(np.where(is_free, x.reshape(shape), 0.0))
            return np.where(is_free, found, 0.0).ravel()

        return linalg.LinearOperator((size, size), matvec=act, dtype=float)

    found, is_over = linalg.cg(
        restricted(equations), right.ravel(), rtol=SOLVED, atol=0.0,
        maxiter=STEPS, M=restricted(inverse),
    )  # fmt: skip
    if is_over:
        raise RuntimeError(f"the equations of land are not solved in {STEPS} steps")
    return np.asarray(found.reshape(shape))


def _norm(parts: Sequence[Array]) -> float:
    return float(np.sqrt(sum(np.sum(np.square(x)) for x in parts)))


def _widths(axis: Axis) -> Array:
    """Return the integrals of the functions B."""
    t, width = axis.knots, axis.p + 1
    found = (t[width:] - t[:-width]) / width
    return found[: axis.n] if axis.is_periodic else found


def _ends(axis: Axis) -> list[int]:
    """Return the functions B that are not zero at walls."""
    return [0, -1] if axis.bounds == "wall" else []


def _outer(parts: Any) -> Array:
    return np.ascontiguousarray(reduce(np.multiply.outer, parts))


def _adjoint(axis: Axis, values: Array, k: int) -> Array:
    """Return the transposed difference, of coefficients D."""
    if axis.is_periodic:
        return np.roll(values, 1, axis=k) - values
    padding = [(0, 0)] * values.ndim
    padding[k] = (1, 1)
    return -np.diff(np.pad(values, padding), axis=k)


def _sides(axis: Axis, faces: Array, k: int) -> tuple[Array, Array]:
    """Return the values at both sides of each cell."""
    if axis.is_periodic:
        return faces, np.roll(faces, -1, axis=k)
    first = np.moveaxis(faces, k, 0)
    return np.moveaxis(first[:-1], 0, k), np.moveaxis(first[1:], 0, k)


def _joined(masks: Sequence[Mask], shape: Sequence[int]) -> NDArray[np.int64]:
    """Return numbers of what the masks cover, one where they overlap, from 1 on without a gap."""
    found = np.zeros(shape, dtype=np.int64)
    for number, mask in enumerate(masks, 1):
        for other in set(np.unique(found[mask])) - {0}:
            found[found == other] = number
        found[mask] = number
    return np.unique(np.append(found.ravel(), 0), return_inverse=True)[1][:-1].reshape(found.shape)
