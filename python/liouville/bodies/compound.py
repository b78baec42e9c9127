"""Compound joints: several axes one after another, each carried by those before.

Turns and slides have coordinates of their own. With them the axes take b, as drawn, to a place and
an attitude against a, and the six rows of the joint hold b there. Rates and angles are coordinates
themselves, so turns are counted and rotors have an inertia of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from liouville._basics import casadi as ca
from liouville.bodies import rotations as rot
from liouville.bodies import turns
from liouville.bodies.body import Value, column, inertia_matrix
from liouville.bodies.joints import Group, Joint
from liouville.bodies.poses import Poses, constants, drawn


class Compound(Group):
    """Compound joints with the same pattern of axes, a column each."""

    def __init__(self, items: Sequence[Joint], places: Mapping[str, int], poses: Poses, p: Any):
        super().__init__(items, places, poses, p)
        first = [poses.layout.own[joint.name] for joint in items]
        rows = [[k + j for k in first] for j in range(len(items[0].axes))]
        self.values = [poses.q[row].T for row in rows]
        self.rates = [poses.v[row].T for row in rows]
        # the place of b's point and the attitude of b in the axes of a, from the last axis on
        place: Any = self._stacked([joint.points[1] for joint in items])
        attitude: Any = constants(rot.product(self.frames[0], rot.conjugate(self.frames[1])))
        for j in reversed(range(len(rows))):
            place, attitude = self._carried(j, place, attitude)
        self.place, self.attitude = place, attitude
        ahead = rot.plus(self.of(poses.x, 0), rot.combine(self.directors(0), place))
        self.d = rot.minus(self.r[1], ahead)

    def _stacked(self, points: Sequence[Value]) -> list[ca.SX]:
        sides = [joint.a for joint in self.items]
        return ca.vertsplit(drawn([*zip(sides, points, strict=True)], self.params))

    def _carried(self, j: int, place: Any, attitude: Any) -> tuple[Any, Any]:
        """Return a place and an attitude as axis j takes them."""
        direction, turn = self._turn(j)
        if not self.items[0].axes[j].turns:
            return rot.plus(place, rot.times(self.values[j], direction)), attitude
        point = self._stacked([joint.axes[j].point for joint in self.items])
        arm = rot.rotate(turn, rot.minus(place, point))
        return rot.plus(point, arm), rot.product(turn, attitude)

    def _turn(self, j: int) -> tuple[Any, Any]:
        """Return the direction of axis j as drawn and the turn about it, by the axes of a."""
        axes = [joint.axes[j].direction for joint in self.items]
        direction = constants([list(x) for x in zip(*axes, strict=True)])
        half = self.values[j] / 2
        return direction, (ca.cos(half), *rot.times(ca.sin(half), direction))

    @cached_property
    def carried(self) -> list[Any]:
        """The directions of all axes, each as those before carry it, by the axes of a."""
        found: list[Any] = []
        before: Any = None
        for j, axis in enumerate(self.items[0].axes):
            direction, turn = self._turn(j)
            found.append(direction if before is None else rot.rotate(before, direction))
            if axis.turns:
                before = turn if before is None else rot.product(before, turn)
        return found

    @cached_property
    def off(self) -> tuple[Any, ...]:
        """The turn of b against where the axes take it, by the axes of body b."""
        return rot.product(rot.conjugate(self.attitude), self.turned)

    def along_of(self, j: int) -> Any:
        """Return the direction of axis j, in the world."""
        return rot.combine(self.directors(0), self.carried[j])

    def coordinate(self, name: str) -> tuple[Any, Any]:
        """Return the value of a coordinate of the first joint's, for all, and its rate."""
        j = self.items[0].coordinates.index(name)
        return self.values[j], self.rates[j]

    def completion(self) -> ca.SX:
        """Return a kinetic energy that gives coordinates without rotors a mass.

        It is a square of what b moves and turns beyond the rates of the axes. That vanishes along
        every motion, so it changes neither motions nor multipliers.
        """
        bare = [bool(set(x.coordinates) - x.armature.keys()) for x in self.items]
        if not any(bare):
            return ca.SX(0)
        moving = [x.a if x.b.kind == "ground" else x.b for x in self.items]
        moments = [ca.trace(inertia_matrix(body, self.params)) / 3 for body in moving]
        found = self._square(moments, bare, self._spin_beyond())
        parallel = [own and x.has_like_turns for own, x in zip(bare, self.items, strict=True)]
        if any(parallel):
            masses = [column(body.mass, self.params, 1) for body in moving]
            found += self._square(masses, parallel, self._velocity_beyond())
        return found

    def _square(self, weights: Sequence[ca.SX], which: Sequence[bool], rows: Any) -> ca.SX:
        own = zip(weights, which, strict=True)
        weight = ca.horzcat(*(x if is_meant else ca.SX(0) for x, is_meant in own))
        found: ca.SX = ca.sum2(weight * rot.dot(rows, rows)) / 2
        return found

    def _spin_beyond(self) -> Any:
        """Return the angular velocity of b against a beyond that of the axes."""
        turned: Any = [ca.SX.zeros(1, len(self.items))] * 3
        for axis, rate, direction in zip(self.items[0].axes, self.rates, self.carried, strict=True):
            if axis.turns:
                turned = rot.plus(turned, rot.times(rate, direction))
        return rot.minus(self.spin, rot.combine(self.directors(0), turned))

    def _velocity_beyond(self) -> Any:
        """Return the velocity of b's point beyond that of where the axes take it."""
        place = ca.vertcat(*self.place)
        values, rates = ca.vertcat(*self.values), ca.vertcat(*self.rates)
        slid = ca.vertsplit(ca.reshape(ca.jtimes(place, values, rates), *place.shape))
        directors = self.directors(0)
        arm = rot.combine(directors, self.place)
        velocity = rot.plus(self.of(self.poses.velocity, 0), rot.combine(directors, slid))
        turned = rot.cross(self.of(self.poses.omega, 0), arm)
        return rot.minus(self.point_velocity(1), rot.plus(velocity, turned))


def grouped(
    joints: Sequence[Joint], places: Mapping[str, int], poses: Poses, params: Any
) -> list[Group]:
    """Return groups of joints whose equations have the same form."""
    patterns: dict[Any, list[Joint]] = {}
    for joint in joints:
        patterns.setdefault(joint.pattern, []).append(joint)
    kinds = {True: Compound, False: Group}
    return [kinds[bool(x[0].axes)](x, places, poses, params) for x in patterns.values()]


def rotors(
    groups: Sequence[Group], coordinates: Mapping[tuple[str, str], Any], params: Any
) -> ca.SX:
    """Return the kinetic energy of rotors, and what gives their coordinates a mass."""
    found = ca.SX(0)
    for group in groups:
        for joint in group.items:
            for name, inertia in joint.armature.items():
                found += column(inertia, params, 1) * coordinates[joint.name, name][1] ** 2 / 2
        if isinstance(group, Compound):
            found += group.completion()
        else:
            found += turns.completion(group)
    return found
