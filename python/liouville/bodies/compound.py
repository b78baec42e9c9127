"""Compound joints: several axes one after another, each carried by those before.

Turns and slides have coordinates of their own. With them the axes take b, as drawn, to a place and
an attitude against a, and the six rows of the joint hold b there. Rates and angles are coordinates
themselves, so turns are counted and rotors have an inertia of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from liouville import _casadi as ca
from liouville.bodies import rotations as rot
from liouville.bodies.body import Poses, Value, column, inertia_matrix
from liouville.bodies.joints import Group, Joint, constants, local, stacked


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
        self.attitude = attitude
        ahead = rot.plus(self.of(poses.x, 0), rot.combine(self.directors(0), place))
        self.d = rot.minus(self.r[1], ahead)

    def _stacked(self, points: Sequence[Value]) -> list[ca.SX]:
        pairs = zip(self.items, points, strict=True)
        return ca.vertsplit(stacked([local(joint.a, point, self.params) for joint, point in pairs]))

    def _carried(self, j: int, place: Any, attitude: Any) -> tuple[Any, Any]:
        """Return a place and an attitude as axis j takes them."""
        axes = [joint.axes[j] for joint in self.items]
        direction = constants([list(x) for x in zip(*(own.direction for own in axes), strict=True)])
        if not axes[0].turns:
            return rot.plus(place, rot.times(self.values[j], direction)), attitude
        point = self._stacked([own.point for own in axes])
        half = self.values[j] / 2
        turn = (ca.cos(half), *rot.times(ca.sin(half), direction))
        arm = rot.rotate(turn, rot.minus(place, point))
        return rot.plus(point, arm), rot.product(turn, attitude)

    @cached_property
    def off(self) -> tuple[Any, ...]:
        """The turn of b against where the axes take it, by the axes of body b."""
        return rot.product(rot.conjugate(self.attitude), self.turned)

    def coordinate(self, name: str) -> tuple[Any, Any]:
        """Return the value of a coordinate of the first joint's, for all, and its rate."""
        j = self.items[0].coordinates.index(name)
        return self.values[j], self.rates[j]

    def completion(self) -> ca.SX:
        """Return a kinetic energy that gives coordinates without rotors a mass.

        It is a square of the rates of the rows, which vanish along every motion: it changes neither
        motions nor multipliers.
        """
        bare = [k for k, x in enumerate(self.items) if set(x.coordinates) - x.armature.keys()]
        found = ca.SX(0)
        rows = [*self.d, *(2 * x for x in self.off[1:])]
        for k in bare:
            joint = self.items[k]
            body = joint.a if joint.b.kind == "ground" else joint.b
            mass = column(body.mass, self.params, 1)
            moment = ca.trace(inertia_matrix(body, self.params)) / 3
            own = ca.vertcat(*(row[k] for row in rows))
            rates = ca.jtimes(own, self.poses.q, self.poses.v)
            weights = ca.vertcat(ca.repmat(mass, 3, 1), ca.repmat(moment, 3, 1))
            found += ca.dot(weights * rates, rates) / 2
        return found


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
    return found
