"""Joints: what each kind holds, what it leaves free, and the equations of both.

With points r on two bodies, d = r_b - r_a, frames x, y, z of each at the joint, z the axis, and the
quaternion p = (e_a f_a)* (e_b f_b) of the frame of b in that of a: p_1 = p_2 = 0 is a turn about
the common axis alone, p_1 = p_2 = p_3 = 0 none at all (written in the axes of body a instead), and
no other attitude satisfies these equations. The angle about the axis is 2 atan2(p_3, p_0).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics import casadi as ca
from liouville.bodies import rotations as rot
from liouville.bodies import turns
from liouville.bodies.body import Body, Value, called, check_rows, row
from liouville.bodies.poses import Poses, constants, drawn
from liouville.bodies.rolling import height

if TYPE_CHECKING:
    from liouville.bodies.dry import Dry
    from liouville.bodies.friction import Coulomb
    from liouville.bodies.limits import Limits


@dataclass(frozen=True)
class Kind:
    """A kind of joint.

    Attributes
    ----------
    rows : tuple of str
        What it holds, by :data:`ROWS`.
    coordinates : tuple of str
        What it leaves free and measures, by :meth:`Group.coordinate`.
    moves : tuple of str
        Motions of b against a that a start is sought by: "turn" or "slide" and the axis.
    keeps : bool
        Whether these moves keep its rows, and no others do.
    """

    rows: tuple[str, ...]
    coordinates: tuple[str, ...] = ()
    moves: tuple[str, ...] = ()
    keeps: bool = True


AT = ("x", "y", "z")
AXIS = ("tilt_x", "tilt_y")
LOCK = ("lock_x", "lock_y", "lock_z")
ALONG = ("off_x", "off_y")
SPINS = ("spin_x", "spin_y", "spin_z")
ANY = tuple(f"{what} world_{axis}" for what in ("slide", "turn") for axis in AT)

KINDS = {
    "fixed": Kind((*AT, *LOCK)),
    "revolute": Kind((*AT, *AXIS), ("angle",), ("turn z",)),
    "prismatic": Kind((*ALONG, *LOCK), ("slide",), ("slide z",)),
    "cylindrical": Kind((*ALONG, *AXIS), ("angle", "slide"), ("turn z", "slide z")),
    "universal": Kind((*AT, "cross"), ("angle", "second angle"), ("turn z", "turn x_b")),
    "spherical": Kind(AT, SPINS, tuple(f"turn world_{axis}" for axis in AT)),
    "planar": Kind(
        ("off_z", *AXIS), ("angle", "slide_x", "slide_y"), ("turn z", "slide x", "slide y")
    ),
    "screw": Kind((*ALONG, *AXIS, "thread"), ("angle", "slide"), ("screw z",)),
    "distance": Kind(("length",), (), ANY, keeps=False),
    "free": Kind((), ("move_x", "move_y", "move_z", *SPINS), ANY),
    "guide": Kind((), ("move_x", "move_y", "move_z"), ANY, keeps=False),
    "rolling ball": Kind(("height",), SPINS, ANY, keeps=False),
    "rolling wheel": Kind(("height",), SPINS, ANY, keeps=False),
    "compound": Kind((*AT, *LOCK)),
}

#: Coordinates that are turned, and others, without a value, that are rates only.
ANGLES = ("angle", "second angle")
RATES = ("move_x", "move_y", "move_z", *SPINS)
#: Below this square of the sine of half of it, the square of an angle is summed as a series.
NEAR = 0.02
#: The beginning of the names of rows that prescribe the motion of a coordinate, after the joint's.
MOTION = ".motion"


@dataclass(frozen=True)
class Axis:
    """An axis of a compound joint, with a coordinate of its own.

    Attributes
    ----------
    name : str
        The name of its coordinate.
    turns : bool
        Whether b turns about it; else b slides along it.
    direction : tuple of float
        Its direction in the axes of body a, as drawn.
    point : array or callable
        A point on it in the world as drawn.
    """

    name: str
    turns: bool
    direction: tuple[float, ...]
    point: Value


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of an assembly, by :meth:`Assembly.revolute` and its relatives.

    Attributes
    ----------
    name, kind : str
        Its name, and its kind: a key of ``KINDS``.
    a, b : Body
        The bodies that it joins.
    points : tuple of two
        A point of each in the world as drawn, numbers or functions of the parameters.
    frames : tuple of two
        The quaternion of the joint's frame in each body.
    damping, springs, efforts, motions : dict
        Of its coordinates by name: coefficients, pairs of stiffness and rest, functions.
    sizes : dict
        Its further measures by name.
    equations : callable or None
        What a guide holds at zero, of the place of b's point in the axes of a as drawn.
    axes : tuple of Axis
        Those of a compound joint, in order from a to b.
    armature : dict
        Inertia of rotors by coordinate.
    friction : dict
        Friction by its own force, by the coordinates that make up its slip.
    dry : dict of str to Dry
        Dry friction of a given size by coordinate.
    limits : dict of str to Limits
        Limits of its coordinates by name.
    """

    name: str
    kind: str
    a: Body
    b: Body
    points: tuple[Value, Value]
    frames: tuple[tuple[float, ...], tuple[float, ...]]
    damping: Mapping[str, Value] = field(default_factory=dict)
    springs: Mapping[str, tuple[Value, Value]] = field(default_factory=dict)
    efforts: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    motions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    sizes: Mapping[str, Value] = field(default_factory=dict)
    equations: Callable[..., Any] | None = None
    axes: tuple[Axis, ...] = ()
    armature: Mapping[str, Value] = field(default_factory=dict)
    friction: Mapping[tuple[str, ...], Coulomb] = field(default_factory=dict)
    dry: Mapping[str, Dry] = field(default_factory=dict)
    limits: Mapping[str, Limits] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Name the joint and its bodies."""
        return f"<{self.kind.capitalize()} {self.name!r} of {self.a.name!r} and {self.b.name!r}>"

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Its free coordinates and measures."""
        return tuple(axis.name for axis in self.axes) or KINDS[self.kind].coordinates

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of the coordinates that are angles."""
        turns = {axis.name: axis.turns for axis in self.axes}
        return tuple(name for name in self.coordinates if turns.get(name, name in ANGLES))

    @property
    def functions(self) -> Iterator[tuple[str, Value, int]]:
        """Its functions of the parameters: name, function and number of values of each."""
        found = [("at", point, 3) for point in self.points]
        found += [("at", axis.point, 3) for axis in self.axes]
        found += [("damping", x, 1) for x in self.damping.values()]
        found += [("armature", x, 1) for x in self.armature.values()]
        found += [("spring", stiffness, 1) for stiffness, _ in self.springs.values()]
        found += [("rest", rest, 1) for _, rest in self.springs.values()]
        found += [("lead" if name == "pitch" else name, x, 1) for name, x in self.sizes.items()]
        laws: list[tuple[str, Any]] = [("friction", x) for x in self.friction.values()]
        laws += [("friction", x) for x in self.dry.values()]
        laws += [("limits", x) for x in self.limits.values()]
        for what, own in laws:
            found += [(f"{name} of {what}", x, 1) for name, x in own.functions().items()]
        yield from (x for x in found if callable(x[1]))

    @property
    def has_like_turns(self) -> bool:
        """Whether turns about its axes do not give all of its rates."""
        turns = [axis.direction for axis in self.axes if axis.turns]
        return len(turns) < len(self.axes) or np.linalg.matrix_rank(turns, 0.1) < len(turns)

    @property
    def pattern(self) -> tuple[Any, ...]:
        """The common part of joints whose equations have the same form."""
        return self.kind, *(axis.turns for axis in self.axes)


class Ends:
    """Points on two bodies each, of many joints or elements, a column each."""

    def __init__(self, items: Sequence[Any], places: Mapping[str, int], poses: Poses, p: Any):
        self.poses, self.params, self.items = poses, p, items
        sides = [[places[getattr(item, side).name] for item in items] for side in "ab"]
        self.sides = sides
        points = [
            drawn([((item.a, item.b)[k], item.points[k]) for item in items], p) for k in range(2)
        ]
        self.arms = [rot.combine(self.directors(k), ca.vertsplit(points[k])) for k in range(2)]
        r = [rot.plus(self.of(poses.x, k), self.arms[k]) for k in range(2)]
        self.r, self.d = r, rot.minus(r[1], r[0])

    def of(self, components: Sequence[ca.SX], side: int) -> tuple[ca.SX, ...]:
        """Return the columns of the bodies on one side."""
        return tuple(x[:, self.sides[side]] for x in components)

    def directors(self, side: int) -> list[tuple[ca.SX, ...]]:
        """Return the directors of the bodies on one side."""
        return [self.of(director, side) for director in self.poses.directors]

    def point_velocity(self, side: int) -> tuple[Any, ...]:
        """Return the velocity of the points on one side."""
        turned = rot.cross(self.of(self.poses.omega, side), self.arms[side])
        return rot.plus(self.of(self.poses.velocity, side), turned)

    @property
    def d_rate(self) -> tuple[Any, ...]:
        """The rate of d, in the world."""
        return rot.minus(self.point_velocity(1), self.point_velocity(0))

    @property
    def moving(self) -> tuple[Any, ...]:
        """The velocity of b's point relative to a, by components in the world."""
        return rot.minus(self.d_rate, rot.cross(self.of(self.poses.omega, 0), self.d))

    @property
    def spin(self) -> tuple[Any, ...]:
        """The angular velocity of b against a, in the world."""
        return rot.minus(self.of(self.poses.omega, 1), self.of(self.poses.omega, 0))


class Group(Ends):
    """Joints with frames, a column each."""

    def __init__(self, items: Sequence[Any], places: Mapping[str, int], poses: Poses, p: Any):
        super().__init__(items, places, poses, p)
        self.frames = [np.array([item.frames[side] for item in items]).T for side in range(2)]
        self.turned = rot.product(rot.conjugate(self.of(poses.e, 0)), self.of(poses.e, 1))

    @cached_property
    def p(self) -> tuple[Any, ...]:
        """The attitude of b's frame in that of a.

        It is linear in the turn of b against a, with numbers that are mostly 0 and 1.
        """
        first, second = rot.conjugate(self.frames[0]), self.frames[1]
        ways = [constants(rot.product(rot.product(first, one), second)) for one in np.eye(4)]
        return tuple(rot.dot(own, self.turned) for own in zip(*ways, strict=True))

    @cached_property
    def off(self) -> tuple[Any, ...]:
        """The turn of b against a from where it is locked, by the axes of body a."""
        locked = rot.product(self.frames[1], rot.conjugate(self.frames[0]))
        return rot.product(self.turned, constants(locked))

    def axis(self, side: int, which: int) -> tuple[Any, ...]:
        """Return axis x, y or z of the frame on one side, in the world."""
        own = constants(rot.columns(self.frames[side])[which])
        return rot.combine(self.directors(side), own)

    def along(self, axis: tuple[Any, ...]) -> Any:
        """Return the part of d along an axis of a."""
        return rot.dot(axis, self.d)

    def along_rate(self, axis: tuple[Any, ...]) -> Any:
        """Return its rate."""
        turning = rot.cross(self.of(self.poses.omega, 0), axis)
        return rot.dot(axis, self.d_rate) + rot.dot(turning, self.d)

    def coordinate(self, name: str) -> tuple[Any, Any]:
        """Return the value of a coordinate, None if it is a rate alone, and its rate."""
        p = self.p
        if name in RATES:
            rates = self.moving if name.startswith("move") else self.spin
            return None, rates["xyz".index(name[-1])]
        if name == "second angle":
            half = ca.atan2(p[1] * p[0] + p[2] * p[3], p[0] * p[0] + p[3] * p[3])
            return turns.angles(self, name, 2 * half), rot.dot(self.spin, self.axis(1, 0))
        if name == "angle":
            angle = turns.angles(self, name, 2 * ca.atan2(p[3], p[0]))
            return angle, rot.dot(self.spin, self.axis(0, 2))
        axis = self.axis(0, {"slide": 2, "slide_x": 0, "slide_y": 1}[name])
        return self.along(axis), self.along_rate(axis)

    def size(self, name: str) -> ca.SX:
        """Return a measure of each joint."""
        return row([item.sizes[name] for item in self.items], self.params)

    def row(self, name: str) -> Any:
        """Return the constraints of the joints by the name of a row."""
        return ROWS[name](self)

    def guide(self, k: int) -> list[ca.SX]:
        """Return the rows of guide k."""
        place = ca.vertcat(*(self.along(self.axis(0, axis))[k] for axis in range(3)))
        return list(ca.vertsplit(self.guiding(k, place)))

    def guiding(self, k: int, place: ca.SX) -> ca.SX:
        """Return the constraints of guide k at a place in the axes of a."""
        joint = self.items[k]
        what = f"equations of joint '{joint.name}'"
        rows = called(what, joint.equations, {"position": place}, self.params, None)
        check_rows(what, rows)
        return rows

    def drive(self, k: int, coordinate: str, t: ca.SX) -> ca.SX:
        """Return the row of joint k that prescribes a coordinate; its multiplier is the effort.

        Of a universal joint that is the effort over the cosine of half the second angle.
        """
        joint = self.items[k]
        what = f"motion of joint '{joint.name}'"
        wanted = called(what, joint.motions[coordinate], {"t": t}, self.params)
        if coordinate in ANGLES and not joint.axes:
            p = [x[k] for x in self.p]
            sine, cosine = p[3], p[0]
            if coordinate == "second angle":
                sine, cosine = p[1] * p[0] + p[2] * p[3], p[0] * p[0] + p[3] * p[3]
            off: ca.SX = 2 * (sine * ca.cos(wanted / 2) - cosine * ca.sin(wanted / 2))
        else:  # the first joint's names stand for those of all
            own = self.items[0].coordinates[joint.coordinates.index(coordinate)]
            off = self.coordinate(own)[0][k] - wanted
        return off

    @property
    def turn_square(self) -> Any:
        """The square of the least angle between the frames: smooth, but at half a turn.

        With x the sine of half of it this is 4 asin(x)^2; near zero by its series.
        """
        square = rot.dot(self.p[1:], self.p[1:])
        series = ca.SX(0)
        for n in range(10, 0, -1):
            series = (series + 2 * 4**n / (n * n * math.comb(2 * n, n))) * square
        half = ca.atan2(ca.sqrt(ca.fmax(square, NEAR)), ca.fabs(self.p[0]))
        return ca.if_else(square > NEAR, 4 * half**2, series)


def _thread(group: Group) -> Any:
    pitch = group.size("pitch")
    half = group.along(group.axis(0, 2)) / (2 * pitch)
    return 2 * pitch * (group.p[3] * ca.cos(half) - group.p[0] * ca.sin(half))


def _length(group: Group) -> Any:
    length = group.size("length")
    return (rot.dot(group.d, group.d) - length**2) / (2 * length)


ROWS: dict[str, Callable[[Group], Any]] = {
    "x": lambda group: group.d[0],
    "y": lambda group: group.d[1],
    "z": lambda group: group.d[2],
    "tilt_x": lambda group: 2 * group.p[1],
    "tilt_y": lambda group: 2 * group.p[2],
    "lock_x": lambda group: 2 * group.off[1],
    "lock_y": lambda group: 2 * group.off[2],
    "lock_z": lambda group: 2 * group.off[3],
    "cross": lambda group: rot.dot(group.axis(0, 2), group.axis(1, 0)),
    "off_x": lambda group: group.along(group.axis(0, 0)),
    "off_y": lambda group: group.along(group.axis(0, 1)),
    "off_z": lambda group: group.along(group.axis(0, 2)),
    "thread": _thread,
    "length": _length,
    "height": height,
}
