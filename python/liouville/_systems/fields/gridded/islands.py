"""Islands: the stream function is constant on the land of each, so that nothing flows there.

A function of the spline that meets land has a coefficient on which the velocity there depends; with
one constant for all of an island, the stream function is constant on it, and so is its slope on the
rim. The constants are those that change the velocity least.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted
from liouville._basics.scipy import scipy
from liouville._systems.fields.gridded.axis import WHAT, Array, Axis, Kind

Mask = NDArray[np.bool_]


def cells_of_nodes(is_land: Mask, axes: Sequence[Axis]) -> Mask:
    """Return the cells all of whose corners are land."""
    for k, axis in enumerate(axes):
        other = np.roll(is_land, -1, k)
        both = is_land & other
        is_land = both if axis.is_periodic else np.take(both, range(axis.n), k)
    return is_land


def at(x: Array, land: Mask, axes: Sequence[Axis]) -> Mask:
    """Return which of the states x, shape (..., 2), are in cells of land."""
    places = []
    for axis, each in zip(axes, np.moveaxis(x, -1, 0), strict=True):
        first = axis.edges[0]
        inside = first + (each - first) % axis.length if axis.is_periodic else each
        found = np.searchsorted(axis.edges, inside, side="right") - 1
        places.append(np.clip(found, 0, axis.n - 1))
    return np.asarray(land[tuple(places)])


def with_islands(
    psi: Array, mean: Array, land: Mask, axes: Sequence[Axis], lead: int
) -> tuple[Array, int]:
    """Return the stream function with islands, and their number."""
    islands, is_wall, places = [], [], []
    for cells, functions in pieces(land, axes):
        islands.append(functions)
        walls = [np.take(cells, [0, -1], k).any() for k, a in enumerate(axes) if a.bounds == "wall"]
        is_wall.append(any(walls))
        places.append(coordinates(functions, mean, axes))
    flat = psi.reshape(-1, *psi.shape[lead:])
    means = np.broadcast_to(mean, (len(flat), 2))
    found = np.stack(
        [_constant(p, m, islands, is_wall, places, axes) for p, m in zip(flat, means, strict=True)]
    )
    return found.reshape(psi.shape), len(islands)


def coordinates(functions: Mask, mean: Array, axes: Sequence[Axis]) -> list[Array]:
    """Return the coordinates of the functions of a piece of land, going on beyond a seam.

    Raises
    ------
    ValueError
        The piece goes all round an axis, and a mean flow goes by there.
    """
    found = []
    for k, (axis, other) in enumerate(zip(axes, axes[::-1], strict=True)):
        x, taken = axis.greville[: functions.shape[k]], functions.any(1 - k)
        if axis.is_periodic and np.any(mean[..., 1 - k]):
            if taken.all():
                sentence = (
                    f"land goes all round '{axis.name}', and a mean flow along '{other.name}'"
                )
                raise ValueError(
                    hinted(sentence, f"give '{other.name}' walls, or cut that part out")
                )
            x = x + axis.length * (np.arange(x.size) < np.argmin(taken))
        found.append(x[np.nonzero(functions)[k]])
    return found


def _constant(
    psi: Array,
    mean: Array,
    islands: list[Mask],
    is_wall: list[bool],
    places: list[list[Array]],
    axes: Sequence[Axis],
) -> Array:
    """Return one stream function with its constants."""
    rest = psi.copy()
    for island, (x, y) in zip(islands, places, strict=True):
        rest[island] = mean[1] * x - mean[0] * y
    free = [island for island, fixed in zip(islands, is_wall, strict=True) if not fixed]
    for island, fixed in zip(islands, is_wall, strict=True):
        if fixed:
            # the shore goes on along the wall, where psi is zero but for the mean flow
            rest[island] += wall_value(island, mean, axes)
    if not free:
        return rest
    change = _slopes(rest - psi, axes)
    columns = np.stack([_slopes(island.astype(float), axes) for island in free], axis=1)
    constants = np.linalg.lstsq(columns, -change, rcond=None)[0]
    for island, constant in zip(free, constants, strict=True):
        rest[island] += constant
    return rest


def wall_value(functions: Mask, mean: Array, axes: Sequence[Axis]) -> float:
    """Return the stream function of a mean flow at the wall that a piece of land meets."""
    for k, axis in enumerate(axes):
        if axis.bounds == "wall":
            for end in (0, -1):
                if np.take(functions, end, k).any():
                    return float((mean[0] if k else -mean[1]) * axis.edges[end])
    return 0.0


def _slopes(psi: Array, axes: Sequence[Axis]) -> Array:
    parts = [axis.difference(psi, k).ravel() for k, axis in enumerate(axes)]
    return np.concatenate(parts)


def touched(cells: Mask, axes: Sequence[Axis], kinds: Sequence[Kind] | None = None) -> Mask:
    """Return the functions that are not zero on these cells, B along all axes if not said."""
    for k, axis in enumerate(axes):
        width = axis.p + (kinds is None or kinds[k] == "B")  # functions on a cell
        shape = list(cells.shape)
        shape[k] = axis.n if axis.is_periodic else axis.n + width - 1
        found = np.zeros(shape, dtype=bool)
        for m in range(width):
            places = np.arange(axis.n) + m
            index = [slice(None)] * cells.ndim
            index[k] = places % axis.n if axis.is_periodic else places  # type: ignore[call-overload]
            found[tuple(index)] |= cells
        cells = found
    return cells


def pieces(land: Mask, axes: Sequence[Axis]) -> list[tuple[Mask, Mask]]:
    """Return the pieces of land in a plane that share no function: their cells, their functions.

    Pieces that meet are one, and so are those with fewer than p cells between them: a function that
    meets both has one coefficient.
    """
    label = scipy("ndimage", WHAT).label
    numbers, count = label(land, structure=np.ones((3, 3)))
    found: dict[int, tuple[Mask, Mask]] = {}
    owner = np.zeros_like(touched(land, axes), dtype=np.int64)
    for number in range(1, count + 1):
        cells = numbers == number
        functions = touched(cells, axes)
        for other in set(np.unique(owner[functions])) - {0}:
            own = found.pop(other)
            cells, functions = cells | own[0], functions | own[1]
        owner[functions] = number
        found[number] = cells, functions
    return [*found.values()]
