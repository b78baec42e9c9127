"""The cells along an axis of a C-grid: each has a centre, between two faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted
from liouville._systems.fields.gridded.axis import Array
from liouville._systems.fields.gridded.reading import Variable
from liouville._systems.fields.gridded.sphere import MEETS, ROUND, in_order

Indices = NDArray[np.int64]

#: Centres are farther from faces than this part of the distance of faces.
APART = 1e-2


@dataclass(frozen=True, eq=False)
class Line:
    """The cells along an axis, growing.

    Attributes
    ----------
    edges : ndarray, shape (n + 1,), or (n,) round a circle
        Ends of the cells; that at the end of a circle is the first again.
    faces : ndarray of int
        Where a component has its value for each edge, -1 where it has none.
    cells : ndarray of int, shape (n,)
        Where others have theirs.
    is_round : bool
        Whether the last cell ends where the first begins.
    """

    edges: Array
    faces: Indices
    cells: Indices
    is_round: bool = False

    @property
    def widths(self) -> Array:
        """The widths of the cells."""
        if not self.is_round:
            return np.diff(self.edges)
        return np.full(self.edges.size, np.diff(self.edges).mean())

    def cut(self, part: slice) -> Line:
        """Return a part of the cells, by their edges."""
        edges, faces = self.edges[part], self.faces[part]
        first = part.start or 0
        return Line(edges, faces, self.cells[first : first + edges.size - 1])


def between(faces: Variable, centres: Variable, turn: float | None, closes: bool) -> Line:
    """Return the cells that have two faces, on a line or on a circle of a length.

    It closes where the faces go all round, and may.

    Raises
    ------
    ValueError
        Faces and centres are the same points, or do not alternate.
    """
    f, c = (np.asarray(x.values) for x in (faces, centres))
    if turn == ROUND:
        f, c = in_order(f), in_order(c)
    f, own = _growing(faces.name, np.asarray(f, dtype=float))
    c, is_round = np.asarray(c, dtype=float), False
    if turn is not None:
        c = f[0] + (c - f[0]) % turn
    if turn is not None and closes:
        near = MEETS * float(np.diff(f).mean())
        keep = f < f[0] + turn - near  # a model may repeat its first columns at the end
        f, own = f[keep], own[keep]
        is_round = bool(abs(f[0] + turn - f[-1] - np.diff(f).mean()) < near)
    return _line(faces, centres, f, own, c, is_round)


def levels_between(faces: Variable, centres: Variable) -> Line:
    """Return the cells of levels, the last of which may lack the face at the floor or the surface.

    Centres are in the middle of these.
    """
    f, own = _growing(faces.name, np.asarray(faces.values, dtype=float))
    c = np.asarray(centres.values, dtype=float)
    low, high = float(c.min()), float(c.max())
    if low < f[0]:
        f, own = np.r_[2 * low - f[0], f], np.r_[-1, own]
    if high > f[-1]:
        f, own = np.r_[f, 2 * high - f[-1]], np.r_[own, -1]
    line = _line(faces, centres, f, own, c, False)
    if line.cells.size < c.size:
        raise ValueError(_mixed(faces, centres))
    return line


def _growing(name: str, values: Array) -> tuple[Array, Indices]:
    """Return values that grow, and where they were."""
    own = np.arange(values.size)
    if values.size > 1 and values[0] > values[-1]:
        values, own = values[::-1], own[::-1]
    if not (np.diff(values) > 0).all():
        raise ValueError(f"the nodes of {name} must all rise or all fall")
    return values, own


def _line(
    faces: Variable, centres: Variable, f: Array, own: Indices, c: Array, is_round: bool
) -> Line:
    n = f.size if is_round else f.size - 1
    places = np.searchsorted(f, c) - 1
    ends = np.append(f, f[0] + f.size * np.diff(f).mean()) if is_round else f
    cells = np.full(n, -1)
    for index in range(c.size - 1, -1, -1):  # of columns that are repeated the first
        k = places[index]
        if 0 <= k < n:
            near, other = APART * (ends[k + 1] - ends[k]), cells[k]
            off = min(c[index] - ends[k], ends[k + 1] - c[index])
            if off < near or (other >= 0 and abs(c[other] - c[index]) > near):
                raise ValueError(_mixed(faces, centres))
            cells[k] = index
    inside = np.flatnonzero(cells >= 0)
    if inside.size < 2 or inside[-1] - inside[0] + 1 != inside.size:
        raise ValueError(_mixed(faces, centres))
    if is_round and inside.size == n:
        return Line(f, own, cells, True)
    first, last = int(inside[0]), int(inside[-1])
    return Line(ends[first : last + 2], np.take(own, range(first, last + 2), mode="wrap"),
                cells[first : last + 1])  # fmt: skip


def _mixed(faces: Variable, centres: Variable) -> Any:
    is_one = np.shape(faces.values) == np.shape(centres.values) and np.allclose(
        faces.values, centres.values
    )
    sentence = (
        f"'{faces.name}' of faces and '{centres.name}' of centres of a C-grid do not alternate"
    )
    if is_one:
        sentence = f"'{faces.name}' and '{centres.name}' are the same, and other points of a C-grid"
    return hinted(
        sentence, "add the coordinates of each component's points, such as glamu and gphiv of NEMO"
    )
