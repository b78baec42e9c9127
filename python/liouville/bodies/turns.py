"""Turns of joints: angles that count them, where a law or a coupling depends on the angle.

A quaternion knows an angle up to two turns only, so the spring of a hinge would jump there. Planar
bodies have their angles as coordinates, whose difference counts. Else the angle w of such a hinge
is a coordinate of its own, which a constraint keeps at what the attitudes say: with the angle
theta of the quaternion that is sin(theta / 2 - w / 2) = 0, of a universal joint sin(theta - w) = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._systems.tracing.trace import Parameters
from liouville.bodies import rotations as rot
from liouville.bodies.body import Body, called, inertia_matrix

#: The beginning of the names of rows that keep counted angles, after the joint's.
TURNS = ".turns"
#: An angle is continued if it is where its rate says up to this part of its period.
NEAR = 0.25


def counted(
    joints: Sequence[Any], couplings: Sequence[Any], params: Mapping[str, Any]
) -> list[tuple[str, str]]:
    """Return joints and coordinates whose angles are coordinates of their own."""
    coupled = {pair for x in couplings for pair in getattr(x, "joints", ())}
    return [
        (joint.name, name)
        for joint in joints
        if not joint.axes and not is_planar(joint)
        for name in joint.angles
        if name in joint.springs
        or (joint.name, name) in coupled
        or (name in joint.limits and not joint.limits[name].are_within(name))
        or (name in joint.efforts and _is_read(joint, name, params))
    ]


def is_planar(joint: Any) -> bool:
    """Return whether a joint is between planar bodies, or one and the ground."""
    return all(body.kind in ("planar", "ground") for body in (joint.a, joint.b))


def _is_read(joint: Any, name: str, params: Mapping[str, Any]) -> bool:
    """Return whether an effort depends on the angle, for any values of the parameters."""
    t, angle, rate = (ca.SX.sym(x) for x in ("t", "angle", "rate"))
    args = {"t": t, "angle": angle, "rate": rate}
    what = f"torque of joint '{joint.name}'"
    found = called(what, joint.efforts[name], args, Parameters(params).namespace)
    return bool(ca.depends_on(found, angle))


def own_turn(body: Body) -> float:
    """Return the angle of a body as drawn in its plane."""
    return 2 * float(np.arctan2(body.rotation[3], body.rotation[0]))


def angles(group: Any, name: str, found: ca.SX) -> ca.SX:
    """Return angles of joints by their quaternions as those that count turns, where they can."""
    layout, columns = group.poses.layout, ca.horzsplit(found)
    for k, joint in enumerate(group.items):
        if (joint.name, name) in layout.counted:
            columns[k] = group.poses.q[layout.counted[joint.name, name]]
        elif name == "angle" and is_planar(joint):
            ways = [
                group.poses.angles[side[k]] - own_turn(body)
                for side, body in zip(group.sides, (joint.a, joint.b), strict=True)
            ]
            attitudes = [
                rot.product(body.rotation, frame)
                for body, frame in zip((joint.a, joint.b), joint.frames, strict=True)
            ]
            drawn = rot.product(rot.conjugate(attitudes[0]), attitudes[1])
            sense = float(np.sign(rot.columns(attitudes[0])[2][2]))
            columns[k] = sense * (ways[1] - ways[0]) + 2 * float(np.arctan2(drawn[3], drawn[0]))
    return ca.horzcat(*columns)


def sine_and_cosine(p: Any, name: str, is_universal: bool) -> tuple[Any, Any]:
    """Return sine and cosine of half an angle by p, of a universal joint of the whole angle."""
    if not is_universal:
        return p[3], p[0]
    if name == "second angle":
        return 2 * (p[0] * p[1] + p[2] * p[3]), p[0] ** 2 + p[3] ** 2 - p[1] ** 2 - p[2] ** 2
    return 2 * (p[0] * p[3] + p[1] * p[2]), p[0] ** 2 + p[1] ** 2 - p[2] ** 2 - p[3] ** 2


def rows(groups: Sequence[Any]) -> dict[str, ca.SX]:
    """Return the constraints of counted angles, by name."""
    found = {}
    for group in groups:
        for k, name, at in _own(group):
            joint = group.items[k]
            is_universal = joint.kind == "universal"
            sine, cosine = sine_and_cosine([x[k] for x in group.p], name, is_universal)
            w = group.poses.q[at] / (1 if is_universal else 2)
            row = (sine * ca.cos(w) - cosine * ca.sin(w)) * (1 if is_universal else 2)
            found[row_name(joint.name, name)] = row
    return found


def row_name(joint: str, coordinate: str) -> str:
    """Return the name of the row that keeps a counted angle."""
    return f"{joint}{TURNS}" + ("" if coordinate == "angle" else f" {coordinate}")


def completion(group: Any) -> ca.SX:
    """Return a kinetic energy that gives counted angles a mass and vanishes along every motion."""
    found = ca.SX(0)
    for k, name, at in _own(group):
        joint = group.items[k]
        moving = joint.b if joint.b.kind == "spatial" else joint.a
        moment = ca.trace(inertia_matrix(moving, group.params)) / 3
        beyond = group.poses.v[at] - group.coordinate(name)[1][k]
        found += moment * beyond**2 / 2
    return found


def _own(group: Any) -> list[tuple[int, str, int]]:
    """Return the counted angles of a group: the joint, the coordinate and its place in q."""
    layout = group.poses.layout
    return [
        (k, name, layout.counted[joint.name, name])
        for k, joint in enumerate(group.items)
        for name in joint.coordinates
        if (joint.name, name) in layout.counted
    ]


class Counter:
    """Angles that count turns along the moves of a tree of joints.

    Attributes
    ----------
    values : ndarray
        The angles, in the order of their coordinates.
    """

    def __init__(self, layout: Any, joints: Sequence[Any]) -> None:
        places = {joint.name: joint for joint in joints}
        self.own = [(places[joint], name) for joint, name in layout.counted]
        self.values = np.zeros(len(self.own))

    def follow(self, e: NDArray[np.float64]) -> None:
        """Count on to the attitudes e, shape (4, bodies), which are less than a turn away."""
        for k, (joint, name) in enumerate(self.own):
            sides = [
                rot.product(e[:, body], frame)
                for body, frame in zip(joint.bodies, joint.frames, strict=True)
            ]
            p = rot.product(rot.conjugate(sides[0]), sides[1])
            part = 1 if joint.kind == "universal" else 2
            found = part * np.arctan2(*sine_and_cosine(p, name, part == 1))
            self.values[k] = nearest(found, self.values[k], part * 2 * np.pi)

    def rates(self, e: NDArray[np.float64], omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rates of the angles at angular velocities, shape (3, bodies, moves)."""
        moves = omega.shape[2]
        turning = np.concatenate([omega, np.zeros((3, 1, moves))], axis=1)
        found = np.zeros((len(self.own), moves))
        for k, (joint, name) in enumerate(self.own):
            side = int(name == "second angle")
            attitude = rot.product(e[:, joint.bodies[side]], joint.frames[side])
            axis = np.array(rot.columns(attitude)[0 if side else 2])
            first, second = joint.bodies
            found[k] = axis @ (turning[:, second] - turning[:, first])
        return found


def periods(kinds: Sequence[str]) -> NDArray[np.float64]:
    """Return the periods of angles of joints of these kinds by their quaternions."""
    # both angles of a universal joint jump together, by a turn each: the attitude is the same
    return 2 * np.pi * np.array([1 if kind == "universal" else 2 for kind in kinds], dtype=float)


def continued(
    t: NDArray[np.float64],
    found: NDArray[np.float64],
    period: NDArray[np.float64],
    first: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return angles continued along times, from rows of them and of their rates.

    Those of the first row are known where they are given. As in a run of the core they are no
    numbers from where rates do not say how they turned.
    """
    angles, rates = np.split(found, 2, axis=1)
    h = np.diff(t)[:, None]
    gaps = h * (rates[1:] + rates[:-1]) / 2 - np.diff(angles, axis=0)
    turns = np.round(gaps / period)
    # a rate between those at both ends predicts within the first, and misses by the second
    is_known = np.abs(h * np.diff(rates, axis=0)) < period
    is_known &= np.abs(gaps - period * turns) <= NEAR * period
    begun = 0 * period if first is None else np.round((first - angles[0]) / period)
    angles += period * np.cumsum([begun, *np.where(is_known, turns, np.nan)], axis=0)
    return angles


def nearest(angle: Any, to: Any, period: float) -> Any:
    """Return an angle, known up to periods, as near to another as it can be."""
    return angle + period * np.round((to - angle) / period)
