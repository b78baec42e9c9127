"""Expressions of where bodies are and how they move, and their kinetic energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville.bodies import rotations as rot
from liouville.bodies.body import (
    Body,
    Layout,
    Value,
    column,
    inertia_matrix,
    resolved,
    row,
    stacked,
)

#: Parts of unit vectors below this are roundoff.
NONE = 1e-15


class Poses:
    """Expressions of places, attitudes and velocities of all bodies, a column each, ground last.

    Attributes
    ----------
    q, v : SX
        Coordinates and velocities.
    x, e : tuple of SX, each of shape (1, bodies + 1)
        Positions of the centres and quaternions, by component.
    directors : tuple of tuple of SX
        Columns of the rotation, by component.
    angles : dict of int to SX
        Angles of planar bodies and of the ground.
    velocity, omega : tuple of SX
        Velocities and angular velocities in the world, by component.
    """

    def __init__(self, layout: Layout, q: ca.SX, v: ca.SX) -> None:
        self.layout, self.q, self.v = layout, q, v
        self.x = self._x(q, layout.planes)
        self.velocity = self._x(v, (0.0,) * len(layout.kinds))
        self._turning()

    def _x(self, q: ca.SX, planes: Sequence[float]) -> tuple[Any, ...]:
        n, kinds, starts = q.numel(), self.layout.kinds, self.layout.starts
        wide = ca.vertcat(q, ca.SX(0.0), *(ca.SX(z) for z in planes))
        found = []
        for axis in range(3):
            places = [
                n + 1 + k if kinds[k] == "planar" and axis == 2 else starts[k] + axis
                for k in range(len(kinds))
            ]
            found.append(wide[[*places, n]].T)
        return tuple(found)

    def _turning(self) -> None:
        layout, q, v = self.layout, self.q, self.v
        spatial, planar = layout.of_kind("spatial"), layout.of_kind("planar")
        rows = [[layout.starts[k] + 3 + j for k in spatial] for j in range(4)]
        self.spatial = tuple(q[row].T for row in rows)
        self.spatial_rates = tuple(v[row].T for row in rows)
        angles = [layout.starts[k] + 2 for k in planar]
        angle, turning = q[angles].T, v[angles].T
        self.angles = dict(zip(planar, ca.horzsplit(angle), strict=True)) if planar else {}
        self.angles[len(layout.kinds)] = ca.SX(0)
        zeros, ones = ca.SX.zeros(1, len(planar)), ca.SX.ones(1, len(planar))
        cos, sin = ca.cos(angle), ca.sin(angle)
        quaternion = (ca.cos(angle / 2), zeros, zeros, ca.sin(angle / 2))
        of_plane = ((cos, sin, zeros), (-sin, cos, zeros), (zeros, zeros, ones))
        still = len(layout.kinds) + 1 - len(spatial) - len(planar)
        fixed = [k for k in range(len(layout.kinds) + 1) if k not in {*spatial, *planar}]
        order = np.argsort([*spatial, *planar, *fixed]).tolist()

        def joined(first: ca.SX, second: ca.SX, constant: float) -> ca.SX:
            return ca.horzcat(first, second, ca.SX.ones(1, still) * constant)[:, order]

        self.e = tuple(
            joined(first, second, float(k == 0))
            for k, (first, second) in enumerate(zip(self.spatial, quaternion, strict=True))
        )
        own = rot.columns(self.spatial)
        self.directors = tuple(
            tuple(joined(own[j][k], of_plane[j][k], float(j == k)) for k in range(3))
            for j in range(3)
        )
        rate = rot.world_rate(self.spatial, self.spatial_rates)
        self.omega = tuple(
            joined(x, y, 0.0) for x, y in zip(rate, (zeros, zeros, turning), strict=True)
        )


def kinetic(bodies: Sequence[Body], poses: Poses, params: Any) -> ca.SX:
    r"""Return the kinetic energy of all bodies.

    Of turning it is :math:`\tfrac12 \Omega^T (J - j) \Omega + 2 j |e'|^2` with one of the moments
    for j. As :math:`|\Omega|^2 = 4 |e'|^2` where :math:`|e| = 1`, this is the energy there, and it
    gives the direction along e a mass. Beside the sphere the two forms differ by a multiple of its
    constraint, which adds to the multiplier of that alone. A ball has a constant mass.
    """
    layout = poses.layout
    masses = row([body.mass for body in bodies], params)
    moving = [x[:, : len(bodies)] for x in poses.velocity]
    found: ca.SX = ca.sum2(masses * rot.dot(moving, moving)) / 2
    spatial = [bodies[k] for k in layout.of_kind("spatial")]
    if spatial:
        rest, common = zip(*(_turning(body, params) for body in spatial), strict=True)
        rows = ca.vertsplit(stacked(rest))
        omega = rot.own_rate(poses.spatial, poses.spatial_rates)
        for i in range(3):
            for j in range(3):
                found += ca.sum2(rows[3 * j + i] * omega[i] * omega[j]) / 2
        squares = rot.dot(poses.spatial_rates, poses.spatial_rates)
        found += 2 * ca.sum2(row(common, params) * squares)
    for k in layout.of_kind("planar"):
        found += column(bodies[k].inertia, params, 1) * poses.omega[2][k] ** 2 / 2
    return found


def _turning(body: Body, params: Any) -> tuple[Any, Any]:
    """Return J - j as nine numbers or expressions, and j.

    That is the moment that two axes have in common, else one between the others.
    """
    if not callable(body.inertia):
        inertia = body.inertia if body.inertia.ndim == 2 else np.diag(body.inertia)
        moments = np.diag(inertia)
        alike = moments[moments == np.roll(moments, 1)]
        common = float(alike[0] if alike.size else np.sort(moments)[1])
        return (inertia - common * np.eye(3)).ravel(), common
    matrix = ca.densify(inertia_matrix(body, params))
    own = [matrix[k, k] for k in range(3)]
    pairs = [own[k] for k in range(3) if ca.is_equal(own[k], own[k - 1], 2)]
    constant = all(x.is_constant() for x in own)
    middle = ca.SX(sorted(float(x) for x in own)[1]) if constant else own[0]
    chosen = pairs[0] if pairs else middle
    return ca.densify(ca.vec(matrix - chosen * ca.SX.eye(3))), chosen


def constants(components: rot.Components) -> list[ca.SX]:
    """Return rows of parts of unit vectors as expressions.

    Roundoff of 0, 1 and -1 is taken off: products with these are no operations.
    """
    whole = [np.where(np.abs(x - np.round(x)) < NONE, np.round(x), x) for x in components]
    return [ca.SX(ca.DM(x)).T for x in whole]


def drawn(pairs: Sequence[tuple[Body, Value]], params: Any) -> ca.SX:
    """Return points of the world, as drawn, in the axes of their bodies, a column each."""
    places = [(resolved(point, params), resolved(body.at, params)) for body, point in pairs]
    if all(isinstance(x, np.ndarray) for pair in places for x in pair):
        turns = np.array([body.rotation for body, _ in pairs]).T
        arms = np.array([point - at for point, at in places]).T
        own = np.array(rot.rotate(rot.conjugate(turns), arms))
        # without the roundoff of zero, whose products vanish
        return ca.SX(ca.DM(np.where(np.abs(own) < NONE * np.abs(own).max(axis=0), 0.0, own)))
    columns = []
    for (body, _), (point, at) in zip(pairs, places, strict=True):
        arm = ca.vertsplit(column(point, params, 3) - column(at, params, 3))
        columns.append(ca.vertcat(*rot.rotate(rot.conjugate(body.rotation), arm)))
    found: ca.SX = ca.horzcat(*columns)
    return found
