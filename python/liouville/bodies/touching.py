"""Contacts of an assembly: stops of joints, shapes that touch, and ropes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.mechanics.contact import Contact
from liouville.bodies import rotations as rot
from liouville.bodies.body import Body, Value, column, unit
from liouville.bodies.joints import Joint
from liouville.bodies.poses import drawn
from liouville.bodies.shapes import TINY, Capsule, Plane, Polygon, Shape, Sphere

if TYPE_CHECKING:
    from liouville.bodies.model import Model

#: The normal of the plane that planar bodies move in.
UP = np.array([0.0, 0.0, 1.0])
#: The square of a normal's part out of that plane, beyond which it is no line there.
FLAT = 1e-18


@dataclass(frozen=True, eq=False)
class Touch:
    """A pair of shapes that touch, by :meth:`Assembly.contact`.

    Attributes
    ----------
    name : str
        Its name.
    a, b : Body
        The bodies.
    shapes : tuple of two Shape
        Theirs.
    laws : dict
        Restitution and coefficients of friction, as those of :class:`~liouville.Contact`.
    across : ndarray or None
        The normal of the plane that all of it moves in.
    """

    kind: ClassVar[str] = "contact"

    name: str
    a: Body
    b: Body
    shapes: tuple[Shape, Shape]
    laws: Mapping[str, Any]
    across: NDArray[np.float64] | None

    def __repr__(self) -> str:
        """Name the contact and its bodies."""
        return f"<Contact {self.name!r} of {self.a.name!r} and {self.b.name!r}>"

    @property
    def functions(self) -> Iterator[tuple[str, Value, int]]:
        """Its functions of the parameters: name, function and number of values of each."""
        for body, shape in zip((self.a, self.b), self.shapes, strict=True):
            found = [("at", x, 3) for x in shape.points(body) if x is not body.at]
            yield from (x for x in [*found, ("radius", shape.rounding, 1)] if callable(x[1]))

    @property
    def is_flat(self) -> bool:
        """Whether both bodies move in the plane of planar bodies."""
        return {self.a.kind, self.b.kind} <= {"planar", "ground"}

    def contacts(self, model: Model) -> Iterator[tuple[str, Contact]]:
        """Yield the contacts of single points, each with its name."""
        (a, b), (first, second) = (self.a, self.b), self.shapes
        ways = [(a, first, b, second)]
        if _have_corners(first, second):
            ways.append((b, second, a, first))
        for side, (own, shape, other, its) in zip("ab", ways, strict=False):
            points = len(shape.points(own))
            for k in range(points):
                name = self.name if points == 1 else f"{self.name}.{k}"
                name += f" of {side}" if len(ways) > 1 else ""
                yield name, self._contact(model, _Point(self, own, shape, k, other, its))

    def _contact(self, model: Model, point: _Point) -> Contact:
        def slip(t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> ca.SX:
            del t, q, params
            return ca.substitute(point.slip(model), model.v, v)

        def gap(t: ca.SX, q: ca.SX, params: Any) -> ca.SX:
            del t, q, params
            return point.gap(model)

        is_rough = Contact(gap, slip=slip, **self.laws).is_rough
        has_slip = self.across is not None or (is_rough and _slides_in_space(self.shapes))
        return Contact(gap, slip=slip if has_slip else None, **self.laws)


@dataclass(frozen=True)
class _Point:
    """A point of one shape, with the radius around it, and another shape."""

    touch: Touch
    a: Body
    first: Shape
    k: int
    b: Body
    second: Shape

    def _distance(self, model: Model) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the distance of the point, its gradient there, and where the point is."""
        place = _placed(model, self.a, [self.first.points(self.a)[self.k]], self.touch.is_flat)
        core = _placed(model, self.b, self.second.points(self.b), self.touch.is_flat)
        point = ca.SX.sym("point", 3)
        found = self.second.distance(point, core, self.b, _axes(model, self.b))
        both = ca.substitute([found, ca.gradient(found, point)], [point], [place])
        return both[0], both[1], place

    def gap(self, model: Model) -> ca.SX:
        radii = [column(x.rounding, model.params, 1) for x in (self.first, self.second)]
        return self._distance(model)[0] - radii[0] - radii[1]

    def slip(self, model: Model) -> ca.SX:
        """Return the velocity of a against b along the normal times the plane's.

        In space there are two of them, along directions that turn with the plane that b has.
        """
        _, normal, place = self._distance(model)
        where = place - column(self.first.rounding, model.params, 1) * normal
        off = _velocity(model, self.a, where) - _velocity(model, self.b, where)
        if self.touch.across is not None:
            return ca.dot(ca.cross(normal, ca.SX(ca.DM(self.touch.across))), off)
        assert isinstance(self.second, Plane)
        normal_drawn = np.asarray(self.second.normal, dtype=float)
        beside = np.eye(3)[np.argmin(np.abs(normal_drawn))]
        first = unit("a direction", np.cross(normal_drawn, beside))
        own = rot.rotate(rot.conjugate(self.b.rotation), first)
        along = ca.mtimes(_axes(model, self.b), ca.SX(ca.DM(np.array(own))))
        return ca.vertcat(ca.dot(along, off), ca.dot(ca.cross(normal, along), off))


@dataclass(frozen=True)
class Look:
    """How a shape that touches is drawn; lengths that are functions are outputs of the model.

    Attributes
    ----------
    kind : str
        The name of its class in lower case.
    body, count : int
        The place of its body, and how many points its core has.
    turn, edges : tuple of float
        In the axes of the body the quaternion of a plane's normal from z, or of a box, and the
        edges of this.
    """

    kind: str
    body: int
    count: int
    turn: tuple[float, ...]
    edges: tuple[float, ...]


def looks(model: Model) -> tuple[list[Look], list[tuple[Body, Shape]]]:
    """Return how all shapes look that touch, each once, and these with their bodies."""
    own: dict[int, tuple[Body, Shape]] = {}
    for touch in model.touches:
        if isinstance(touch, Touch):
            pairs = zip((touch.a, touch.b), touch.shapes, strict=True)
            own |= {id(shape): (body, shape) for body, shape in pairs}
    found = []
    for body, shape in own.values():
        kind, place = type(shape).__name__.lower(), model.indices[body.name]
        turn, edges = shape.seen(body)
        found.append(Look(kind, place, len(shape.points(body)), turn, edges))
    return found, [*own.values()]


@dataclass(frozen=True, eq=False)
class Rope:
    """A rope between points of two bodies, by :meth:`Assembly.rope`."""

    kind: ClassVar[str] = "rope"

    name: str
    a: Body
    b: Body
    points: tuple[Value, Value]
    length: Value
    restitution: float

    def __repr__(self) -> str:
        """Name the rope and its bodies."""
        return f"<Rope {self.name!r} of {self.a.name!r} and {self.b.name!r}>"

    @property
    def functions(self) -> Iterator[tuple[str, Value, int]]:
        """Its functions of the parameters, as those of a joint."""
        found = [*(("at", x, 3) for x in self.points), ("length", self.length, 1)]
        yield from (x for x in found if callable(x[1]))

    def contacts(self, model: Model) -> Iterator[tuple[str, Contact]]:
        """Yield the contact, whose gap is how much longer the rope is than the way."""

        def gap(t: ca.SX, q: ca.SX, params: Any) -> ca.SX:
            del t, q, params
            ends = zip((self.a, self.b), self.points, strict=True)
            first, second = (_placed(model, body, [point], False) for body, point in ends)
            way = ca.sqrt(ca.fmax(ca.sumsqr(second - first), TINY))
            return column(self.length, model.params, 1) - way

        yield self.name, Contact(gap, self.restitution)


def touch_of(
    name: str,
    sides: tuple[Body, Body],
    shapes: tuple[Shape, Shape],
    laws: Mapping[str, Any],
    across: NDArray[np.float64] | None,
) -> Touch:
    """Return a contact of two shapes, the one with points first; ValueError if there is none."""
    of, (a, b), (first, second) = f"contact '{name}'", sides, shapes
    if isinstance(first, Plane) or (isinstance(first, Sphere) < isinstance(second, Sphere)):
        (a, b), (first, second) = (b, a), (second, first)
    kinds = type(first).__name__.lower(), type(second).__name__.lower()
    if isinstance(first, Plane):
        raise ValueError(f"{of} is of two planes, which meet in no point")
    has_law = isinstance(first, Sphere) or isinstance(second, Plane)
    is_flat = {a.kind, b.kind} <= {"planar", "ground"}
    if "polygon" in kinds and not is_flat:
        raise ValueError(f"{of} has a polygon, which planar bodies have")
    lies = is_flat or (across is not None and _lie_across((first, second), across))
    if not has_law and not (lies and _have_corners(first, second)):
        sentence = f"{of} is of a {kinds[0]} and a {kinds[1]}, whose edges may touch along a line"
        hint = "spheres touch all shapes, all shapes planes, and capsules others in a plane"
        raise ValueError(hinted(sentence, hint))
    if not is_flat and (first.is_flat or second.is_flat):
        sentence = f"{of} is of bodies in space, and a place of its shapes has two numbers"
        raise ValueError(hinted(sentence, "give three coordinates"))
    if {"polygon", "capsule"} & {*kinds} and has_law < _is_sharp(first, second):
        hint = "give one of them a radius, which rounds its corners off"
        raise ValueError(hinted(f"{of} is of a corner on a corner, which has no direction", hint))
    if _is_sharp(first, second) and kinds == ("sphere", "sphere"):
        raise ValueError(f"{of} is of two points, which do not meet")
    if is_flat and isinstance(second, Plane) and abs(np.asarray(second.normal)[2]) > FLAT**0.5:
        hint = "a line of planar bodies has a normal such as (0, 1, 0)"
        raise ValueError(hinted(f"the plane of {of} is none across theirs", hint))
    touch = Touch(name, a, b, (first, second), laws, UP if is_flat else across)
    is_rough = Contact(max, slip=max, **laws).is_rough
    if touch.across is None and is_rough and not _slides_in_space(touch.shapes):
        sentence = f"friction= of {of}: in space that of spheres and capsules on planes is followed"
        hint = "of what moves in a plane give its normal, across=(0, 1, 0), or take planar bodies"
        raise ValueError(hinted(sentence, hint))
    return touch


def _slides_in_space(shapes: tuple[Shape, Shape]) -> bool:
    """Whether two shapes have friction in space: faces share their load as they slide."""
    return isinstance(shapes[0], Sphere | Capsule) and isinstance(shapes[1], Plane)


def _have_corners(first: Shape, second: Shape) -> bool:
    """Whether the points of two shapes touch both ways: those of each the other's edges."""
    return isinstance(first, Capsule | Polygon) and isinstance(second, Capsule | Polygon)


def _lie_across(shapes: Sequence[Shape], across: NDArray[np.float64]) -> bool:
    """Whether shapes are capsules whose lines are across a normal."""
    lines = [np.diff(x.ends, axis=0)[0] for x in shapes if isinstance(x, Capsule)]
    is_across = [(x @ across) ** 2 <= FLAT * (x @ x) for x in lines]
    return len(lines) == len(shapes) and all(is_across)


def _is_sharp(first: Shape, second: Shape) -> bool:
    return not any(callable(x.rounding) or x.rounding for x in (first, second))


def stops(model: Model, joint: Joint) -> Iterator[tuple[str, Contact]]:
    """Yield the stops of a joint, whose gaps are those of its coordinates."""

    def gap(coordinate: str, side: str, stop: Value) -> Callable[..., ca.SX]:
        def left(t: ca.SX, q: ca.SX, params: Any) -> ca.SX:
            del t, q
            off: ca.SX = model.coordinates[joint.name, coordinate][0] - column(stop, params, 1)
            return off if side == "low" else -off

        return left

    for name, limits in joint.limits.items():
        for side, stop in limits.stops():
            own = gap(name, side, stop)
            yield f"{joint.name}.{name}.{side}", Contact(own, limits.restitution)


def _axes(model: Model, body: Body) -> ca.SX:
    """Return the axes of a body, in the world, in columns."""
    k = model.indices[body.name]
    return ca.horzcat(*(ca.vertcat(*(x[k] for x in own)) for own in model.poses.directors))


def _placed(model: Model, body: Body, points: Sequence[Value], is_flat: bool) -> ca.SX:
    """Return points as drawn where the body has taken them, in columns."""
    k = model.indices[body.name]
    arms = drawn([(body, point) for point in points], model.params)
    at = ca.vertcat(*(x[k] for x in model.poses.x))
    found: ca.SX = ca.mtimes(_axes(model, body), arms) + ca.repmat(at, 1, len(points))
    if is_flat:  # heights of planes do not count
        found[2, :] = 0
    return found


def _velocity(model: Model, body: Body, place: ca.SX) -> ca.SX:
    """Return the velocity of the point of a body that is at a place."""
    k, poses = model.indices[body.name], model.poses
    parts = poses.velocity, poses.omega, poses.x
    velocity, omega, at = (ca.vertcat(*(x[k] for x in own)) for own in parts)
    found: ca.SX = velocity + ca.cross(omega, place - at)
    return found
