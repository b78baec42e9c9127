"""Shapes of the bodies and joints of an assembly.

A body shows the box that has its mass and inertia if it is uniform, its centre of mass, and lines
between its joints: one between two, a polygon between more, and one to the centre from a single
one. A uniform bar or plate is its own box. Joints show their kind and axis.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville.bodies import Mechanism
from liouville.bodies import rotations as rot
from liouville.plot.outlines import outlines_of, touching
from liouville.plot.parts import Part, Z, line, mark

Array = NDArray[np.float64]
At = tuple[Array, Array, Array]
Springs = tuple[tuple[int, Array, int, Array], ...]

#: How each kind of joint looks: a mesh, its sizes in radii of a line, and which body carries it.
JOINTS = {
    "fixed": ("box", (2.4, 2.4, 2.4), 1),
    "revolute": ("bar", (1.9, 1.9, 6.0), 1),
    "prismatic": ("box", (3.6, 3.6, 9.0), 0),
    "cylindrical": ("bar", (2.1, 2.1, 9.0), 0),
    "screw": ("bar", (2.1, 2.1, 9.0), 0),
    "universal": ("ball", (2.3, 2.3, 2.3), 1),
    "spherical": ("ball", (2.3, 2.3, 2.3), 1),
    "planar": ("box", (4.0, 4.0, 1.0), 1),
    "distance": ("ball", (1.7, 1.7, 1.7), 1),
    "guide": ("ball", (2.3, 2.3, 2.3), 1),
}
#: A line is as thick as this part of the whole.
LINE = 0.009
#: What travels far is drawn as if it reached over this part of its way, but up to so many times
#: what it does.
TRAVEL, MOST = 0.5, 4.0
#: Nothing is thinner than this part of it, nor nearer to another point.
LEAST = 1e-6


def planar(system: Mechanism) -> bool:
    """Say whether all bodies move in planes across z."""
    return set(system.body_layout.kinds) == {"planar"}


def poses_of(system: Mechanism, q: Array) -> Array:
    """Return places and quaternions of all bodies, shape (k, bodies, 7)."""
    poses = (system.body_layout.pose(q, k) for k in range(len(system.bodies)))
    return np.stack([np.stack([*x, *e], axis=1) for x, e in poses], axis=1)


def springs_of(system: Mechanism, values: Array, at: At) -> Springs:
    """Return the ends of springs, and of rods without mass, in the axes of their bodies."""
    ends = system.output("ends", values, *at)[0].reshape(-1, 2, 3)
    points = system.output("points", values, *at)[0].reshape(-1, 2, 3)
    own = list(zip(system.springs, ends, strict=True))
    for name, pair in zip(system.joints, points, strict=True):
        place = system.place(name)
        if place.kind == "distance":
            own.append((place.bodies, pair))
    return tuple((a, ends_of[0], b, ends_of[1]) for (a, b), ends_of in own)


def parts_of(
    system: Mechanism,
    values: Array,
    at: At,
    poses: Array,
    more: Sequence[tuple[int, Array]] = (),
) -> tuple[Part, ...]:
    """Return all shapes of an assembly, with sizes by how far it reaches.

    Lines go to the joints of a body and to `more` points by body.
    """
    points = system.output("points", values, *at)[0].reshape(-1, 2, 3)
    boxes = dict(_boxes(system, values, at))
    own = _joined(system, values, at, points)
    for body, point in more:
        if point.any():  # the centre is shown anyway
            own[body].append(point)
    outlines = outlines_of(system, values, at)
    reach = _reach(system, poses[0], own, boxes)
    reach = max(reach, *(outline.size for outline in outlines), LEAST)
    travel = float(np.linalg.norm(np.ptp(poses[..., :3].reshape(-1, 3), axis=0)))
    thick = LINE * max(reach, min(TRAVEL * travel, MOST * reach))
    found: list[Part] = []
    for body in range(len(system.bodies)):
        ends = _apart(own[body], 0.5 * thick)
        if body in boxes:
            turn, size = boxes[body]
            size = np.maximum(size, 1.2 * thick)
            found.append(Part("inertia", "box", body, np.zeros(3), turn, size))
        found += [line(body, a, b, thick) for a, b in _between(ends, thick)]
        found.append(mark("centre", "ball", body, np.zeros(3), None, (1.5 * thick,) * 3))
    found += touching(outlines, poses, thick, reach)
    return (*found, *_joints(system, values, at, points, thick))


def _boxes(system: Mechanism, values: Array, at: At) -> Iterable[tuple[int, tuple[Array, Array]]]:
    """Yield the axes and edges of the uniform box with the mass and inertia of each body."""
    masses = system.output("masses", values, *at)[0]
    inertias = system.output("inertias", values, *at)[0].reshape(-1, 3, 3)
    for body, kind in enumerate(system.body_layout.kinds):
        if kind == "spatial":
            moments, axes = np.linalg.eigh(inertias[body])
            squares = 6 * (moments.sum() - 2 * moments) / masses[body]
            yield body, (_quaternion(axes), np.sqrt(np.maximum(squares, 0.0)))


def _quaternion(axes: Array) -> Array:
    """Return the quaternion of three orthonormal columns, of either hand."""
    first, third = axes[:, 0], np.cross(axes[:, 0], axes[:, 1])
    return np.array(rot.of_frame(first, third), dtype=float)


def _joined(system: Mechanism, values: Array, at: At, points: Array) -> list[list[Array]]:
    """Return the points of joints and springs on each body, the ground last."""
    found: list[list[Array]] = [[] for _ in range(len(system.bodies) + 1)]
    for name, pair in zip(system.joints, points, strict=True):
        place = system.place(name)
        if place.kind != "free" and "rolling" not in place.kind:
            for body, point in zip(place.bodies, pair, strict=True):
                found[body].append(point)
    for a, first, b, second in springs_of(system, values, at):
        found[a].append(first)
        found[b].append(second)
    return found


def _reach(
    system: Mechanism, pose: Array, own: list[list[Array]], boxes: dict[int, tuple[Array, Array]]
) -> float:
    """Return how far the mechanism reaches at its start, at least by its largest body."""
    places = [*own[-1], *pose[:, :3]]
    for body, ends in enumerate(own[:-1]):
        places += [pose[body, :3] + np.array(rot.rotate(pose[body, 3:], end)) for end in ends]
    sizes = [np.ptp(np.array(places), axis=0), *(size for _, size in boxes.values())]
    return max(LEAST, *(float(np.linalg.norm(size)) for size in sizes))


def _apart(points: list[Array], least: float) -> list[Array]:
    """Return points that are not at the same place."""
    found: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > least for other in found):
            found.append(point)
    return found


def _between(points: list[Array], least: float) -> list[tuple[Array, Array]]:
    """Return the lines between the joints of a body."""
    if not points:
        return []
    if len(points) == 1:
        return [(np.zeros(3), points[0])] if np.linalg.norm(points[0]) > least else []
    if len(points) == 2:
        first, second = points
        part = float(first @ (first - second)) / float((first - second) @ (first - second))
        beyond = [(first if part < 0 else second, np.zeros(3))]  # the centre is on neither side
        return [(first, second), *(beyond if abs(part - 0.5) > 0.55 else [])]
    ring = np.array(points)
    off = ring - ring.mean(axis=0)
    _, sizes, axes = np.linalg.svd(off, full_matrices=False)
    if sizes[1] < LEAST * sizes[0]:  # all on a line
        order = np.argsort(off @ axes[0])
        return [(points[i], points[j]) for i, j in pairwise(order)]
    order = np.argsort(np.arctan2(off @ axes[1], off @ axes[0]))
    return [(points[i], points[j]) for i, j in zip(order, np.roll(order, -1), strict=True)]


def _joints(
    system: Mechanism, values: Array, at: At, points: Array, thick: float
) -> Iterable[Part]:
    """Yield the shapes of joints."""
    radii = system.output("radii", values, *at)[0]
    anchors = iter(system.output("anchors", values, *at)[0].reshape(-1, 3))
    for k, name in enumerate(system.joints):
        place = system.place(name)
        for turns, direction in place.axes:
            turn = rot.between(Z, np.array(direction))
            mesh, size = ("bar", (1.9, 1.9, 6.0)) if turns else ("box", (3.6, 3.6, 9.0))
            point = next(anchors)
            yield mark("joint", mesh, place.bodies[0], point, turn, np.multiply(thick, size))
        if "rolling" in place.kind:
            yield _wheel(place, points[k, 1], radii[k], thick)
        elif place.kind in JOINTS:
            mesh, size, side = JOINTS[place.kind]
            own = place.bodies[side], points[k, side], place.frames[side]
            yield mark("joint", mesh, *own, np.multiply(thick, size))


def _wheel(place: Any, point: Array, radius: float, thick: float) -> Part:
    """Return the ball or wheel of a joint that rolls."""
    if place.kind == "rolling ball":
        return mark("wheel", "ball", place.bodies[1], point, None, (radius,) * 3)
    return mark("wheel", "bar", place.bodies[1], point, place.frames[1], (radius, radius, thick))
