"""The tree of joints that a start is sought along, and the places of all bodies on it.

Each body but the ground hangs on one joint of the tree. A joint moves all that hangs on it as one
rigid body, in ways that keep its own equations where it is of such a kind: what is left to solve
are the equations of joints outside the tree, which close loops.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from liouville.bodies import rotations as rot
from liouville.bodies.body import Layout
from liouville.bodies.joints import ANY, KINDS
from liouville.bodies.model import Place
from liouville.bodies.turns import Counter, nearest

Array = NDArray[np.float64]

#: Moves that a body has which cannot turn, or only in its plane.
POSSIBLE = {
    "spatial": ANY,
    "point": ANY[:3],
    "planar": ("slide world_x", "slide world_y", "turn world_z"),
}


@dataclass(frozen=True)
class Branch:
    """A joint of the tree, or none for a body that hangs on springs alone.

    Attributes
    ----------
    joint : Place or None
        The joint.
    parent, child : int
        The body that it hangs on, and the body that it moves.
    sign : float
        1 where the joint's b is moved, -1 where a is.
    carried : ndarray of int
        All bodies that it moves.
    moves : tuple of str
        Its moves, of :data:`joints.KINDS`.
    """

    joint: Place | None
    parent: int
    child: int
    sign: float
    carried: NDArray[np.int64]
    moves: tuple[str, ...]

    @property
    def is_kept(self) -> bool:
        """Whether its moves keep its equations and are all that does."""
        return self.joint is not None and KINDS[self.joint.kind].keeps


class Tree:
    """A tree of joints with the poses of all bodies, the ground last.

    Attributes
    ----------
    x, e : ndarray, shape (3, bodies + 1) and (4, bodies + 1)
        Positions and quaternions.
    loops : list of Place
        Joints that are not in the tree.
    own : ndarray
        The coordinates that joints have of their own.
    """

    def __init__(
        self,
        layout: Layout,
        joints: Sequence[Place],
        first: Collection[str],
        drawn: Array,
        points: Array,
        pitches: Array,
        anchors: Array,
    ) -> None:
        self.layout = layout
        self.points = {joint.name: own for joint, own in zip(joints, points, strict=True)}
        self.pitches = {joint.name: own for joint, own in zip(joints, pitches, strict=True)}
        self.branches = self._grown(sorted(joints, key=lambda joint: joint.name not in first))
        inside = {branch.joint.name for branch in self.branches if branch.joint}
        self.loops = [joint for joint in joints if joint.name not in inside]
        counts = np.cumsum([0, *(len(joint.axes) for joint in joints)])
        starts = dict(zip((joint.name for joint in joints), counts[:-1].tolist(), strict=True))
        self.starts, self.anchors, self.own = starts, anchors, np.zeros(len(anchors))
        self.counter = Counter(layout, joints)
        self.planar = layout.of_kind("planar")
        # coordinates of compound joints outside the tree move alone
        self.lone = [starts[x.name] + k for x in self.loops for k in range(len(x.axes))]
        self.x = np.append(drawn, np.zeros((3, 1)), axis=1)
        self.e = np.array([*layout.rotations, (1.0, 0.0, 0.0, 0.0)]).T
        self.angles = 2 * np.arctan2(self.e[3], self.e[0])[self.planar]
        self._place()
        self._count()

    def _grown(self, joints: Sequence[Place]) -> list[Branch]:
        """Grow the tree from the ground, by the nearest joints first."""
        ground = len(self.layout.kinds)
        parents: dict[int, tuple[Place | None, int]] = {}
        reached, level = {ground}, {ground}
        while len(reached) <= ground:
            grown: set[int] = set()
            for joint in joints:
                for parent, child in (joint.bodies, joint.bodies[::-1]):
                    if parent in level and child not in reached | grown:
                        parents[child] = joint, parent
                        grown.add(child)
            if not grown:
                grown = {min(set(range(ground)) - reached)}
                parents |= {child: (None, ground) for child in grown}
            reached |= grown
            # a body that hangs on springs may have joints to those reached before
            level = grown
        carried: dict[int, list[int]] = {}
        for child in parents:
            body = child
            while body != ground:
                carried.setdefault(body, []).append(child)
                body = parents[body][1]
        return [
            self._branch(joint, parent, child, np.array(carried[child]))
            for child, (joint, parent) in parents.items()
        ]

    def _branch(
        self, joint: Place | None, parent: int, child: int, carried: NDArray[np.int64]
    ) -> Branch:
        moves = ANY if joint is None else KINDS[joint.kind].moves
        if joint is not None and joint.axes:
            moves = tuple(
                f"{'turn' if turns else 'slide'} {k}" for k, (turns, _) in enumerate(joint.axes)
            )
        possible = POSSIBLE[self.layout.kinds[child]]
        moves = tuple(x for x in moves if x in possible or "world" not in x)
        if self.layout.kinds[child] == "point":
            moves = tuple(x for x in moves if "x_b" not in x)
        sign = 1.0 if joint is None or joint.bodies[1] == child else -1.0
        return Branch(joint, parent, child, sign, carried, moves)

    def _place(self) -> None:
        """Place all bodies as drawn, with joints of the tree closed."""
        x, e = self.x.copy(), self.e.copy()
        for branch in self.branches:
            child, parent = branch.child, branch.parent
            if branch.joint is not None and branch.is_kept and branch.joint.kind != "free":
                side = branch.joint.bodies.index(child)
                frames = branch.joint.frames
                points = self.points[branch.joint.name]
                if self.layout.kinds[child] == "spatial":
                    own = rot.product(self.e[:, parent], frames[1 - side])
                    self.e[:, child] = rot.product(own, rot.conjugate(frames[side]))
                there = rot.rotate(self.e[:, parent], points[1 - side])
                back = rot.rotate(self.e[:, child], points[side])
                self.x[:, child] = self.x[:, parent] + there - np.array(back)
            else:
                turned = rot.product(self.e[:, parent], rot.conjugate(e[:, parent]))
                if self.layout.kinds[child] == "spatial":
                    self.e[:, child] = rot.product(turned, e[:, child])
                way = rot.rotate(turned, x[:, child] - x[:, parent])
                self.x[:, child] = self.x[:, parent] + way
        self.e /= np.linalg.norm(self.e, axis=0)

    def _axis(self, branch: Branch, move: str) -> tuple[Array, Array]:
        """Return the direction of a move, and the point that it turns about."""
        which, joint, child = move.split()[1], branch.joint, branch.child
        if joint is None:
            return np.eye(3)["xyz".index(which[-1])], self.x[:, child]
        if joint.axes:
            axis, point = self._carried(joint, int(which))
            return branch.sign * axis, point
        side = joint.bodies.index(child)
        arm = rot.rotate(self.e[:, child], self.points[joint.name][side])
        point = self.x[:, child] + np.array(arm)
        if which.startswith("world"):
            return branch.sign * np.eye(3)["xyz".index(which[-1])], point
        own = int(which.endswith("_b"))
        attitude = rot.product(self.e[:, joint.bodies[own]], joint.frames[own])
        axis = np.array(rot.columns(attitude)["xyz".index(which[0])])
        return branch.sign * axis, point

    def _carried(self, joint: Place, which: int) -> tuple[Array, Array]:
        """Return the direction of an axis of a compound joint and a point on it, as carried."""
        start, body = self.starts[joint.name], joint.bodies[0]
        direction, point = np.array(joint.axes[which][1]), self.anchors[start + which]
        for k in reversed(range(which)):
            turns, own = joint.axes[k]
            value, anchor = self.own[start + k], self.anchors[start + k]
            if turns:
                turn = rot.turn(own, value)
                direction = np.array(rot.rotate(turn, direction))
                point = anchor + np.array(rot.rotate(turn, point - anchor))
            else:
                point = point + value * np.array(own)
        e = self.e[:, body]
        return np.array(rot.rotate(e, direction)), self.x[:, body] + np.array(rot.rotate(e, point))

    def twists(self) -> tuple[Array, Array]:
        """Return velocities and angular velocities of all bodies, a column each move."""
        count = len(self.layout.kinds)
        moves = [(branch, move) for branch in self.branches for move in branch.moves]
        velocity = np.zeros((3, count, len(moves)))
        omega = np.zeros_like(velocity)
        for j, (branch, move) in enumerate(moves):
            axis, point = self._axis(branch, move)
            bodies = branch.carried
            if not move.startswith("slide"):
                omega[:, bodies, j] = axis[:, None]
                arms = self.x[:, bodies] - point[:, None]
                velocity[:, bodies, j] = rot.cross(axis, arms)
            if slide := self._slide(branch, move):
                velocity[:, bodies, j] += slide * axis[:, None]
        return velocity, omega

    def units(self, length: float) -> Array:
        """Return the units of all moves, lengths of slides."""
        moves = [move for branch in self.branches for move in branch.moves]
        own = [length if move.startswith("slide") else 1.0 for move in moves]
        lone = [x for joint in self.loops for x in joint.axes]
        return np.array(own + [1.0 if turns else length for turns, _ in lone])

    def _slide(self, branch: Branch, move: str) -> float:
        """Return how far a move of one slides."""
        if move.startswith("screw"):
            assert branch.joint is not None
            return float(self.pitches[branch.joint.name])
        return float(move.startswith("slide"))

    def move(self, sizes: Array) -> None:
        """Make moves of finite sizes, one after another from the ground on."""
        at = 0
        self.own[self.lone] += sizes[len(sizes) - len(self.lone) :]
        for branch in self.branches:
            for j, move in enumerate(branch.moves):
                size, at = sizes[at], at + 1
                axis, point = self._axis(branch, move)
                bodies = branch.carried
                if not move.startswith("slide"):
                    turned = rot.turn(axis, size)
                    arms = rot.rotate(turned, self.x[:, bodies] - point[:, None])
                    self.x[:, bodies] = np.array(arms) + point[:, None]
                    self.e[:, bodies] = rot.product(turned, self.e[:, bodies])
                self.x[:, bodies] += self._slide(branch, move) * size * axis[:, None]
                if branch.joint is not None and branch.joint.axes:
                    self.own[self.starts[branch.joint.name] + j] += size
        points = [k for k, kind in enumerate(self.layout.kinds) if kind == "point"]
        self.e[:, points] = np.array([[1.0], [0.0], [0.0], [0.0]])
        self.e /= np.linalg.norm(self.e, axis=0)
        self._count()

    def _count(self) -> None:
        """Follow angles of planar bodies and of joints that count turns."""
        angles = 2 * np.arctan2(self.e[3], self.e[0])[self.planar]
        self.angles = nearest(angles, self.angles, 4 * np.pi)
        self.counter.follow(self.e)

    def q(self) -> Array:
        """Return the coordinates."""
        bodies = self.layout.gathered((self.x, self.e))
        bodies[[self.layout.starts[k] + 2 for k in self.planar]] = self.angles
        return np.concatenate([bodies, self.own, self.counter.values])

    @property
    def state(self) -> tuple[Array, ...]:
        """Places, attitudes, coordinates of joints and angles, to return to."""
        own = self.x, self.e, self.own, self.angles, self.counter.values
        return tuple(part.copy() for part in own)

    @state.setter
    def state(self, state: tuple[Array, ...]) -> None:
        own = (part.copy() for part in state)
        self.x, self.e, self.own, self.angles, self.counter.values = own

    def rates(self) -> Array:
        """Return the rates of the coordinates in all moves, shape (n, moves)."""
        velocity, omega = self.twists()
        rates = self.layout.rates((self.x, self.e), velocity, omega)
        count = rates.shape[1]
        own = np.zeros((len(self.own), count + len(self.lone)))
        at = 0
        for branch in self.branches:
            if branch.joint is not None and branch.joint.axes:
                start = self.starts[branch.joint.name]
                for j in range(len(branch.moves)):
                    own[start + j, at + j] = 1.0
            at += len(branch.moves)
        own[self.lone, count + np.arange(len(self.lone))] = 1.0
        turning = self.counter.rates(self.e, omega)
        first, last = (np.hstack([x, np.zeros((len(x), len(self.lone)))]) for x in (rates, turning))
        return np.vstack([first, own, last])

    def loop(self, joint: Place) -> list[str]:
        """Return the joints of the loop that a joint closes, in order."""
        above = {branch.child: branch for branch in self.branches}

        def path(body: int) -> list[Branch]:
            found = []
            while body in above:
                found.append(above[body])
                body = above[body].parent
            return found

        first, second = (path(body) for body in joint.bodies)
        while first and second and first[-1] is second[-1]:
            first.pop()
            second.pop()
        way: list[Branch | Place] = [*reversed(first), joint, *second]
        places = [x.joint if isinstance(x, Branch) else x for x in way]
        return [place.name for place in places if place is not None]
