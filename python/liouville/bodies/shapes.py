"""Shapes of bodies that touch one another, and how far a point is from each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tracing import trace as _trace
from liouville.bodies import rotations as rot
from liouville.bodies.body import Body, Value, check_size, given, numbers, unit

#: Squares of lengths below this are taken for it, so that their roots have a slope.
TINY = 1e-200
#: The corner of a polygon turns by more than this sine.
TURNS = 1e-9


@dataclass(frozen=True, eq=False)
class Shape(ABC):
    """A shape that touches: all points within a radius of a core, the hull of some points.

    Attributes
    ----------
    body : Body or str
        The body that it is fixed to, or its name.
    """

    body: Body | str
    #: Whether its places have two numbers: its bodies move in a plane.
    is_flat = False

    @property
    def rounding(self) -> Value:
        """The radius around its core."""
        return getattr(self, "radius", np.zeros(()))

    @abstractmethod
    def points(self, body: Body) -> Sequence[Value]:
        """Return the points of its core in the world as drawn; of a plane, one of them."""

    @abstractmethod
    def distance(self, point: ca.SX, core: ca.SX, body: Body, axes: ca.SX) -> ca.SX:
        """Return how far a point is from the core, negative inside.

        `core` has its points in columns, and `axes` are those of the body, in the world.
        """

    def seen(self, body: Body) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the quaternion of its own axes in those of the body, and lengths along them."""
        del body
        return (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Plane(Shape):
    """A plane that others are on one side of; between bodies that move in a plane, a line.

    Attributes
    ----------
    body : Body or str
        The body that it is fixed to, or its name.
    at : array_like, shape (3,), in the plane (2,), or callable, default (0, 0, 0)
        A point of it in the world as drawn.
    normal : array_like, shape (3,), in the plane (2,), default (0, 0, 1)
        Its direction to the side that is free, of any length, in the world as drawn.
    """

    at: Value = (0.0, 0.0, 0.0)
    normal: ArrayLike = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Refuse what is no plane."""
        object.__setattr__(self, "at", given("at= of a plane", _in_space(self, self.at), (3,)))
        object.__setattr__(self, "normal", unit("normal= of a plane", _in_space(self, self.normal)))

    def points(self, body: Body) -> Sequence[Value]:
        """Return its point."""
        return [self.at]

    def distance(self, point: ca.SX, core: ca.SX, body: Body, axes: ca.SX) -> ca.SX:
        """Return the height of a point."""
        return ca.dot(ca.mtimes(axes, ca.SX(ca.DM(self._normal(body)))), point - core)

    def seen(self, body: Body) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the quaternion of its normal from z."""
        turn = rot.between(np.array([0.0, 0.0, 1.0]), np.array(self._normal(body)))
        return tuple(float(x) for x in turn), super().seen(body)[1]

    def _normal(self, body: Body) -> list[float]:
        own = rot.rotate(rot.conjugate(body.rotation), np.asarray(self.normal))
        return [float(x) for x in own]


@dataclass(frozen=True, eq=False)
class Sphere(Shape):
    """A sphere; between bodies that move in a plane, a disc; with a radius of zero, a point.

    Attributes
    ----------
    body : Body or str
        The body that it is fixed to, or its name.
    radius : float or callable, default 0
        Its radius.
    at : array_like, shape (3,), in the plane (2,), or callable, optional
        Its centre in the world as drawn, by default that of the body.
    """

    radius: Value = 0.0
    at: Value | None = None

    def __post_init__(self) -> None:
        """Refuse what is no sphere."""
        _keep_radius(self, self.radius, "sphere")
        if self.at is not None:
            object.__setattr__(self, "at", given("at= of a sphere", _in_space(self, self.at), (3,)))

    def points(self, body: Body) -> Sequence[Value]:
        """Return its centre."""
        return [body.at if self.at is None else self.at]

    def distance(self, point: ca.SX, core: ca.SX, body: Body, axes: ca.SX) -> ca.SX:
        """Return the distance from its centre."""
        return _length(point - core)


@dataclass(frozen=True, eq=False)
class Capsule(Shape):
    """All points within a radius of a straight line between two points.

    Attributes
    ----------
    body : Body or str
        The body that it is fixed to, or its name.
    ends : array_like, shape (2, 3), in the plane (2, 2)
        Both ends of that line in the world as drawn.
    radius : float or callable
        The radius.
    """

    ends: ArrayLike
    radius: Value

    def __post_init__(self) -> None:
        """Refuse what is no capsule."""
        _keep_radius(self, self.radius, "capsule")
        object.__setattr__(
            self, "ends", numbers("ends= of a capsule", _in_space(self, self.ends), (2, 3))
        )

    def points(self, body: Body) -> Sequence[Value]:
        """Return its ends."""
        return [*np.asarray(self.ends)]

    def distance(self, point: ca.SX, core: ca.SX, body: Body, axes: ca.SX) -> ca.SX:
        """Return the distance from the line."""
        return _off(point, core[:, 0], core[:, 1])


@dataclass(frozen=True, eq=False)
class Box(Shape):
    """A box; its corners touch planes, and all of it touches spheres.

    Attributes
    ----------
    body : Body or str
        The body that it is fixed to, or its name.
    edges : array_like, shape (3,)
        The lengths of its edges, positive.
    at : array_like, shape (3,), optional
        Its centre in the world as drawn, by default that of the body.
    rotation : array_like, shape (4,), optional
        Quaternion from the axes along its edges to the world's as drawn, of any length; by default
        they are those of its body.
    """

    edges: ArrayLike
    at: ArrayLike | None = None
    rotation: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Refuse what is no box."""
        edges = numbers("edges= of a box", self.edges, (3,))
        for edge in edges:
            check_size("an edge of a box", "length", edge)
        object.__setattr__(self, "edges", edges)
        if self.at is not None:
            object.__setattr__(self, "at", numbers("at= of a box", self.at, (3,)))
        if self.rotation is not None:
            own = unit("rotation= of a box", self.rotation, 4)
            object.__setattr__(self, "rotation", own)

    def points(self, body: Body) -> Sequence[Value]:
        """Return its corners."""
        at = numbers("the centre of a box", body.at if self.at is None else self.at, (3,))
        corners = np.array([*product((-0.5, 0.5), repeat=3)]) * self.edges
        turned = np.stack(rot.rotate(self._drawn(body), corners.T), axis=1)
        return [*(at + turned)]

    def distance(self, point: ca.SX, core: ca.SX, body: Body, axes: ca.SX) -> ca.SX:
        """Return the distance from its surface, negative inside."""
        edges = ca.mtimes(axes, ca.SX(ca.DM(np.array(rot.columns(self._turn(body))).T)))
        own = ca.mtimes(edges.T, point - ca.sum2(core) / core.shape[1])
        beyond = ca.fabs(own) - ca.SX(ca.DM(np.asarray(self.edges) / 2))
        deepest = ca.mmax(beyond)
        return ca.if_else(deepest > 0, _length(ca.fmax(beyond, 0)), deepest)

    def seen(self, body: Body) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the quaternion of its edges, and their lengths."""
        edges = np.asarray(self.edges)
        return tuple(float(x) for x in self._turn(body)), tuple(edges.tolist())

    def _turn(self, body: Body) -> Any:
        return rot.product(rot.conjugate(body.rotation), self._drawn(body))

    def _drawn(self, body: Body) -> Any:
        return body.rotation if self.rotation is None else np.asarray(self.rotation)


@dataclass(frozen=True, eq=False)
class Polygon(Shape):
    """A convex polygon of a body that moves in a plane.

    Attributes
    ----------
    body : Body or str
        The body that it is fixed to, or its name.
    corners : array_like, shape (k, 2)
        Three or more in the world as drawn, one after another.
    radius : float or callable, default 0
        That of what is rolled around it, which rounds its corners off.
    """

    corners: ArrayLike
    radius: Value = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no convex polygon, and keep its corners counter-clockwise."""
        _keep_radius(self, self.radius, "polygon")
        found = _trace.numbers(self.corners)
        shape = (len(found) if found is not None and found.ndim else 0, 2)
        corners = numbers("corners= of a polygon", self.corners, shape)
        edges = np.roll(corners, -1, axis=0) - corners
        following = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
        sizes = np.hypot(*edges.T) * np.hypot(*following.T)
        angles = np.arctan2(turns, (edges * following).sum(axis=1))
        is_convex = (turns > TURNS * sizes).all() or (turns < -TURNS * sizes).all()
        if len(corners) < 3 or not is_convex or abs(abs(angles.sum()) - 2 * np.pi) > 1e-6:
            hint = "give three corners or more, one after another, and several polygons for others"
            raise ValueError(hinted("corners= of a polygon are those of no convex one", hint))
        object.__setattr__(self, "corners", corners[:: int(np.sign(turns[0]))])

    def points(self, body: Body) -> Sequence[Value]:
        """Return its corners."""
        return [np.append(corner, 0.0) for corner in np.asarray(self.corners)]

    def distance(self, point: ca.SX, core: ca.SX, body: Body, axes: ca.SX) -> ca.SX:
        """Return the distance from its outline, negative inside."""
        corners = ca.horzsplit(core)
        edges = [*pairwise([*corners, corners[0]])]
        beyond = []
        for a, b in edges:
            along = b - a
            across = ca.vertcat(along[1], -along[0], 0) / ca.norm_2(along)
            beyond.append(ca.dot(across, point - a))
        deepest = ca.mmax(ca.vertcat(*beyond))
        outside = ca.mmin(ca.vertcat(*(_off(point, a, b) for a, b in edges)))
        return ca.if_else(deepest > 0, outside, deepest)


def _in_space(shape: Shape, value: Any) -> Any:
    """Return places and directions, with heights of zero where they are those of a plane."""
    own = _trace.numbers(value)
    if own is None or own.shape[-1:] != (2,):
        return value
    object.__setattr__(shape, "is_flat", True)
    return np.concatenate([own, np.zeros((*own.shape[:-1], 1))], axis=-1)


def _keep_radius(shape: Any, radius: Value, kind: str) -> None:
    what = f"radius= of a {kind}"
    own = given(what, radius, ())
    if not callable(own) and own < 0:
        raise ValueError(f"{what} must be zero or positive, not {own:g}")
    object.__setattr__(shape, "radius", own)


def _length(d: ca.SX) -> ca.SX:
    return ca.sqrt(ca.fmax(ca.sumsqr(d), TINY))


def _off(point: ca.SX, a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the distance of a point from a line between two others."""
    along = b - a
    part = ca.dot(point - a, along) / ca.sumsqr(along)
    return _length(point - a - ca.fmin(ca.fmax(part, 0), 1) * along)
