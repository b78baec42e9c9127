"""Parts: the simple shapes that a drawing of a mechanism is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville.bodies import rotations as rot

Array = NDArray[np.float64]

Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Part:
    """A shape in the axes of a body.

    Attributes
    ----------
    role : str
        ``"line"``, ``"inertia"``, ``"centre"``, ``"joint"``, ``"wheel"``, ``"shape"``, ``"plane"``.
    mesh : str
        ``"bar"``, a cylinder along its third axis, ``"box"`` or ``"ball"``.
    body : int
        The place of the body, that of the ground after all others.
    at, turn : ndarray, shapes (3,) and (4,)
        Its middle and the quaternion of its axes in those of the body.
    size : ndarray, shape (3,)
        Radii of a bar and its length, edges of a box, radii of a ball.
    """

    role: str
    mesh: str
    body: int
    at: Array
    turn: Array
    size: Array

    @property
    def corners(self) -> Array:
        """The ends of a line, the corners of a box, and four points of a rim, shape (m, 3)."""
        if self.role in ("centre", "joint"):
            return self.at[None]
        half = self.size / 2
        if self.role == "line":
            own = [(0, 0, -half[2]), (0, 0, half[2])]
        elif self.role == "wheel":
            angles = np.linspace(0, 2 * np.pi, 49)
            own = [(self.size[0] * np.cos(a), self.size[1] * np.sin(a), 0.0) for a in angles]
        else:
            own = [(i * half[0], j * half[1], k * half[2]) for i, j, k in EDGES]
        turned = rot.rotate(self.turn[:, None], np.array(own, dtype=float).T)
        return np.stack(turned, axis=1) + self.at


#: A way along all edges of a box.
EDGES = (
    *((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, -1), (-1, -1, 1)),
    *((1, -1, 1), (1, -1, -1), (1, -1, 1), (1, 1, 1), (1, 1, -1), (1, 1, 1), (-1, 1, 1)),
    *((-1, 1, -1), (-1, 1, 1), (-1, -1, 1)),
)


def line(body: int, a: Array, b: Array, thick: float) -> Part:
    """Return a line of a body between two points."""
    length = float(np.linalg.norm(b - a))
    direction = (b - a) / length if length else Z
    size = (thick, thick, length)
    return mark("line", "bar", body, (a + b) / 2, rot.between(Z, direction), size)


def mark(role: str, mesh: str, body: int, at: Array, turn: Any, size: ArrayLike) -> Part:
    """Return a shape of a body, turned by a quaternion or None."""
    own = np.array((1.0, 0.0, 0.0, 0.0) if turn is None else turn, dtype=float)
    return Part(role, mesh, body, at, own, np.array(size, dtype=float))
