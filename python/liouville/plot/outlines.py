"""Shapes of bodies that touch one another, as parts to be drawn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from liouville.bodies import Mechanism
from liouville.bodies import rotations as rot
from liouville.plot.parts import Part, Z, line, mark

Array = NDArray[np.float64]

#: A plane is drawn as far as this part of the whole motion beyond its middle.
WIDE = 0.6


@dataclass(frozen=True, eq=False)
class Outline:
    """A shape that touches, in the axes of its body.

    Attributes
    ----------
    kind : str
        The name of its class in lower case.
    body : int
        The place of its body, that of the ground after all others.
    points : ndarray, shape (m, 3)
        Those of its core; of a plane, one of them.
    radius : float
        The radius around it.
    turn : ndarray, shape (4,)
        The quaternion of the normal of a plane from z, or of the edges of a box.
    edges : ndarray, shape (3,)
        The lengths of the edges of a box.
    is_flat : bool
        Whether its body moves in a plane.
    """

    kind: str
    body: int
    points: Array
    radius: float
    turn: Array
    edges: Array
    is_flat: bool

    @property
    def size(self) -> float:
        """How large it is; a plane has no size."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) + 2 * self.radius


def outlines_of(system: Mechanism, values: Array, at: tuple[Array, Array, Array]) -> list[Outline]:
    """Return the shapes of all contacts of an assembly, each once."""
    points = system.output("outlines", values, *at)[0].reshape(-1, 3)
    radii = system.output("roundings", values, *at)[0]
    ends = np.cumsum([0, *(look.count for look in system.looks)])
    kinds = [*system.body_layout.kinds, "ground"]
    is_flat = "spatial" not in kinds
    return [
        Outline(
            look.kind,
            look.body,
            points[first:last],
            float(radius),
            np.array(look.turn, dtype=float),
            np.array(look.edges, dtype=float),
            is_flat,
        )
        for look, radius, (first, last) in zip(system.looks, radii, pairwise(ends), strict=True)
    ]


def touching(
    outlines: Iterable[Outline], poses: Array, thick: float, reach: float
) -> Iterator[Part]:
    """Yield the parts of shapes that touch, of a motion with these poses."""
    places = poses[..., :3].reshape(-1, 3)
    wide = WIDE * (reach + float(np.linalg.norm(np.ptp(places, axis=0))))
    for own in outlines:
        if own.kind == "plane":
            middle = places.mean(axis=0) if own.body == poses.shape[1] else own.points[0]
            yield _plane(own, middle, wide, thick)
        elif own.kind == "box":
            size = np.maximum(own.edges, thick)
            yield Part("shape", "box", own.body, own.points.mean(axis=0), own.turn, size)
        else:
            yield from _round(own, thick)


def _plane(own: Outline, middle: Array, wide: float, thick: float) -> Part:
    """Return a plane as a plate below it; in the plane, as a line."""
    normal = np.array(rot.rotate(own.turn, Z))
    at = middle - normal * (normal @ (middle - own.points[0]))
    if own.is_flat:
        along = np.cross(normal, Z) * wide
        return line(own.body, at - along, at + along, 0.7 * thick)
    size = np.array([2 * wide, 2 * wide, 0.1 * thick])
    return Part("plane", "box", own.body, at - 0.05 * thick * normal, own.turn, size)


def _round(own: Outline, thick: float) -> Iterator[Part]:
    """Yield the parts of spheres, discs, capsules and polygons."""
    points, turn = own.points, None
    ring = [*points, points[0]] if own.kind == "polygon" else points
    for a, b in pairwise(ring):
        off = np.cross(b - a, Z) / np.linalg.norm(b - a) * own.radius
        if own.kind == "polygon":
            yield line(own.body, a + off, b + off, 0.6 * thick)
        else:
            part = line(own.body, a, b, own.radius)
            turn = part.turn
            yield Part("wheel", "bar", part.body, part.at, turn, part.size)
    if own.kind == "polygon" and own.radius < 2 * thick:
        return
    radius = max(own.radius, 0.8 * thick)
    for point in points:
        size = (radius, radius, thick if own.is_flat else radius)
        yield mark("wheel", "bar" if own.is_flat else "ball", own.body, point, turn, size)
