"""The expressions of an assembly: its Lagrangian, constraints, forces, what is read of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._systems.mechanics.contact import Contact
from liouville._systems.mechanics.traced import HALF_TURN
from liouville.bodies import rotations as rot
from liouville.bodies import turns
from liouville.bodies.body import (
    Body,
    Layout,
    Value,
    column,
    inertia_matrix,
    is_limited,
    row,
    stacked,
)
from liouville.bodies.chaining import Coupling, Gear
from liouville.bodies.compound import grouped, rotors
from liouville.bodies.dry import sticking
from liouville.bodies.elements import (
    Efforts,
    Element,
    matrix_rows,
    of_elements,
    of_joints,
    parameter_functions,
)
from liouville.bodies.friction import edge, reversal, rubbed, switches
from liouville.bodies.joints import KINDS, MOTION, Joint
from liouville.bodies.normal_forces import multipliers, normal_forces, pushes
from liouville.bodies.poses import Poses, drawn, kinetic
from liouville.bodies.rolling import is_across, rolled
from liouville.bodies.touching import Rope, Touch, looks, stops


@dataclass(frozen=True)
class Place:
    """A joint in the numbers of a mechanism.

    Attributes
    ----------
    name, kind : str
        Its name, and its kind.
    bodies : tuple of two int
        The places of its bodies; the ground is last.
    frames : tuple of two
        The quaternion of its frame in each body.
    rows : tuple of str
        Names of its constraints, the nonholonomic ones among them.
    coordinates : tuple of str
        What it leaves free.
    first : int
        The place of the first of them among those of all joints.
    angles : tuple of str
        Those of them that are angles.
    axes : tuple of (bool, tuple of float)
        Of a compound joint, whether b turns and the direction in the axes of the first body.
    """

    name: str
    kind: str
    bodies: tuple[int, int]
    frames: tuple[tuple[float, ...], tuple[float, ...]]
    rows: tuple[str, ...]
    coordinates: tuple[str, ...]
    first: int
    angles: tuple[str, ...] = ()
    axes: tuple[tuple[bool, tuple[float, ...]], ...] = ()


class Model:
    """The functions of a Lagrangian, which share what they compute of one set of symbols."""

    def __init__(
        self,
        bodies: Sequence[Body],
        joints: Sequence[Joint],
        elements: Sequence[Element],
        gears: Sequence[Gear | Coupling],
        touches: Sequence[Touch | Rope],
        gravity: Value,
        layout: Layout,
    ) -> None:
        self.bodies, self.joints, self.elements = bodies, joints, elements
        self.touches = touches
        self.couplings = [x for x in gears if x.joints]
        self.gears = [x for x in gears if isinstance(x, Gear) and not x.joints]
        self.gravity, self.layout = gravity, layout
        self.indices = {body.name: k for k, body in enumerate(bodies)} | {"ground": len(bodies)}
        self.is_nonholonomic = bool(self.gears) or any("rolling" in x.kind for x in joints)
        #: Where friction turns, and springs of ball joints, by name: there controlled steps end.
        #: Forces add those of normal forces, which they find.
        self.switches: dict[str, Callable[..., ca.SX]] = {
            name: self._edge(joint, *own)
            for joint in joints
            for name, own in switches(joint).items()
        }
        balls = [joint for joint in joints if "stiffness" in joint.sizes]
        self.switches |= {f"{HALF_TURN}{x.name}": self._half_turn(x) for x in balls}
        #: What determines normal forces, and how many directions press each contact.
        self.rubs: dict[str, ca.SX] = {}
        self.directions: tuple[int, ...] = ()

    def _compute(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> None:
        """Make the expressions that all functions are parts of."""
        self.t, self.q, self.v, self.params = t, q, v, params
        self.poses = Poses(self.layout, q, v)
        self.groups = grouped(self.joints, self.indices, self.poses, params)
        self.potential, self.coordinates = of_joints(self.groups, t, params)
        more, self.efforts = of_elements(self.elements, self.indices, self.poses, t, params)
        self.potential += more

    def lagrangian(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> ca.SX:
        """Return T - U."""
        self._compute(t, q, v, params)
        energy = kinetic(self.bodies, self.poses, params) - self.potential
        energy += rotors(self.groups, self.coordinates, params)
        gravity = column(self.gravity, params, 3)
        if not gravity.is_zero():
            masses = row([body.mass for body in self.bodies], params)
            for k in range(3):
                energy += gravity[k] * ca.sum2(masses * self.poses.x[k][:, : len(self.bodies)])
        self.energy = energy
        return energy

    def constraint(self, t: ca.SX, q: ca.SX, params: Any) -> dict[str, ca.SX]:
        """Return the constraints, which are those of the symbols of the Lagrangian."""
        found: dict[str, dict[str, ca.SX]] = {joint.name: {} for joint in self.joints}
        for group in self.groups:
            for name in KINDS[group.items[0].kind].rows:
                held = ca.horzsplit(group.row(name))
                for joint, own in zip(group.items, held, strict=True):
                    if not own.is_zero():  # as between planar bodies
                        found[joint.name][f"{joint.name}.{name}"] = own
            for k, joint in enumerate(group.items):
                if joint.equations is not None:
                    guides = enumerate(group.guide(k))
                    found[joint.name] |= {f"{joint.name}.{j}": own for j, own in guides}
                for name in joint.motions:
                    own = f"{joint.name}{MOTION}" + (f" {name}" if len(joint.motions) > 1 else "")
                    found[joint.name][own] = group.drive(k, name, t)
        self.rows = {name: tuple(rows) for name, rows in found.items()}
        rows = {name: own for part in found.values() for name, own in part.items()}
        norms = ca.horzsplit(rot.dot(self.poses.spatial, self.poses.spatial) - 1)
        spatial = self.layout.of_kind("spatial")
        units = {f"{self.bodies[k].name}.unit": norms[j] / 2 for j, k in enumerate(spatial)}
        # units first: of dependent constraints those that come first are kept
        rows |= turns.rows(self.groups)
        return (
            units | rows | {coupling.name: self._coupled(coupling) for coupling in self.couplings}
        )

    def _coupled(self, coupling: Gear | Coupling) -> ca.SX:
        """Return the constraint of a coupling or a gear."""
        value: ca.SX
        if isinstance(coupling, Gear):
            values = [self.coordinates[joint][0] for joint in coupling.ratios]
            factors = [column(factor, self.params, 1) for factor in coupling.ratios.values()]
            return ca.dot(ca.vertcat(*factors), ca.vertcat(*values))
        value, *other = (self.coordinates[joint][0] for joint in coupling.joints)
        for k, factor in enumerate(coupling.coefficients):
            value = value - factor * (other[0] ** k if k else 1)
        return value

    def nonholonomic(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> dict[str, ca.SX]:
        """Return the constraints on velocities, of what rolls."""
        found: dict[str, ca.SX] = {}
        for group in self.groups:
            if "rolling" in group.items[0].kind:
                slips = rolled(group)
                for k, joint in enumerate(group.items):
                    rows = {
                        f"{joint.name}.roll_{axis}": x[k]
                        for j, (axis, x) in enumerate(zip("xy", slips, strict=True))
                        if not (turns.is_planar(joint) and is_across(joint, j))
                    }
                    self.rows[joint.name] += tuple(rows)
                    found |= rows
        for gear in self.gears:
            found[gear.name] = sum(
                column(factor, params, 1) * self.coordinates[name, coordinate][1]
                for (name, coordinate), factor in gear.ratios.items()
            )
        # these velocities are symbols of their own
        return {name: ca.substitute(own, self.v, v) for name, own in found.items()}

    def force(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> ca.SX:
        """Return the forces without an energy."""
        found = self._pushed(v)
        if any(joint.friction for joint in self.joints):
            self._rub(t, q, v, params, found)
            found = self._pushed(v)
        return found

    def _rub(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any, force: ca.SX) -> None:
        """Add friction, whose normal forces these forces determine, to the efforts of joints."""
        holonomic = self.constraint(t, q, params)
        rolling = self.nonholonomic(t, q, v, params)
        g, k = (ca.vertcat(ca.SX(0, 1), *x.values()) for x in (holonomic, rolling))
        mass, rest, slopes, gamma = multipliers(self.energy, force, g, k, (t, q, v))
        gravity = column(self.gravity, params, 3)
        slips = [
            own
            for group in self.groups
            for j in range(len(group.items))
            for own in rubbed(group, j, [*holonomic, *rolling], self.coordinates, gravity)
        ]
        normal, pressing = normal_forces(slips, mass, rest, slopes, gamma, v)
        self.directions = tuple(x.press.shape[0] for x in slips)
        self.rubs = {
            "rates without friction": ca.densify(ca.vertcat(rest, gamma)),
            "pushes": ca.densify(ca.vertcat(*pushes(slips, v))),
            "presses": ca.vec(ca.densify(ca.vertcat(*(x.press for x in slips)).T)),
            "least": ca.densify(ca.vertcat(*(x.least for x in slips))),
        }
        for x, N, n in zip(slips, normal, pressing, strict=True):
            self.switches |= reversal(x, n)
            for name, unit in x.forces.items():
                value, rate, effort = self.coordinates[x.name, name]
                self.coordinates[x.name, name] = value, rate, effort + N * unit

    def _edge(
        self, joint: Joint, names: tuple[str, ...], velocity: str, k: int
    ) -> Callable[..., ca.SX]:
        def beyond(t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> ca.SX:
            del t, q, v
            return edge(joint, names, velocity, k, self.coordinates, params)

        return beyond

    def _half_turn(self, joint: Joint) -> Callable[..., ca.SX]:
        def cosine(t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> ca.SX:
            del t, q, v, params
            group = next(x for x in self.groups if joint in x.items)
            return ca.SX(group.p[0][group.items.index(joint)])

        return cosine

    def _pushed(self, v: ca.SX) -> ca.SX:
        """Return the generalised forces of all efforts."""
        own: Efforts = [(rate, effort) for _, rate, effort in self.coordinates.values()]
        pairs = [
            (ca.vec(rate), ca.vec(effort))
            for rate, effort in [*own, *self.efforts]
            if not effort.is_zero()
        ]
        if not pairs:
            return ca.SX(v.numel(), 1)
        rates, efforts = (ca.vertcat(*x) for x in zip(*pairs, strict=True))
        return ca.jtimes(rates, v, efforts, True)

    def contacts(self) -> dict[str, Contact]:
        """Return the contacts, whose functions are expressions of the symbols of the Lagrangian."""
        found = {name: own for joint in self.joints for name, own in stops(self, joint)}
        found |= {name: own for joint in self.joints for name, own in sticking(self, joint)}
        return found | {name: own for x in self.touches for name, own in x.contacts(self)}

    def places(self) -> list[Place]:
        """Return the joints in numbers."""
        found, first = [], 0
        for joint in self.joints:
            sides = self.indices[joint.a.name], self.indices[joint.b.name]
            rows, own = self.rows.get(joint.name, ()), joint.coordinates
            axes = tuple((axis.turns, axis.direction) for axis in joint.axes)
            what = joint.name, joint.kind, sides, joint.frames, rows
            found.append(Place(*what, own, first, joint.angles, axes))
            first += len(own)
        return found

    def springs(self) -> list[tuple[int, int]]:
        """Return the places of the bodies of each spring, damper and rope."""
        return [(self.indices[x.a.name], self.indices[x.b.name]) for x in self._strings]

    @property
    def _strings(self) -> list[Any]:
        """Springs, dampers and ropes."""
        own = [element for element in self.elements if element.kind == "spring"]
        return own + [touch for touch in self.touches if isinstance(touch, Rope)]

    def outputs(self) -> dict[str, ca.SX]:
        """Return the expressions of what is read of a motion."""
        order = [(joint.name, name) for joint in self.joints for name in joint.coordinates]
        own = [self.coordinates[key] for key in order]
        values, rates, efforts = zip(*own, strict=True) if own else ((), (), ())
        points = [
            ((joint.a, joint.b)[side], joint.points[side])
            for joint in self.joints
            for side in range(2)
        ]
        anchors = [(x.a, axis.point) for x in self.joints for axis in x.axes]
        return {
            "values": _column([ca.SX(0) if x is None else x for x in values]),
            "rates": _column(rates),
            "efforts": _column(efforts),
            "points": self._drawn(points),
            "anchors": self._drawn(anchors),
            "drawn": ca.vec(stacked([_place(body, self.params) for body in self.bodies])),
            "pitches": self._sizes("pitch"),
            "matrices": _column(matrix_rows(self.elements, self.params)),
            "limited": _column([column(x, self.params, 1) for _, _, x in self.limited]),
            **self._looks(),
            **self.rubs,
        }

    @property
    def limited(self) -> list[tuple[str, str, Value]]:
        """Limited sizes that are functions of the parameters: what, name and function."""
        functions = parameter_functions(self.joints, self.elements, self.touches)
        return [(what, name, x) for what, name, x, _ in functions if is_limited(name)]

    def _looks(self) -> dict[str, ca.SX]:
        """Return the expressions of what is drawn besides."""
        ends = [
            ((string.a, string.b)[side], string.points[side])
            for string in self._strings
            for side in range(2)
        ]
        _, shapes = looks(self)
        outlines = [(body, point) for body, shape in shapes for point in shape.points(body)]
        roundings = [column(shape.rounding, self.params, 1) for _, shape in shapes]
        return {
            "outlines": self._drawn(outlines),
            "roundings": _column(roundings),
            "radii": self._sizes("radius"),
            "ends": self._drawn(ends),
            "masses": ca.vec(row([body.mass for body in self.bodies], self.params)),
            "inertias": ca.vec(stacked([_inertia(body, self.params) for body in self.bodies])),
            "gravity": column(self.gravity, self.params, 3),
        }

    def _drawn(self, pairs: Sequence[tuple[Body, Value]]) -> ca.SX:
        return ca.vec(drawn(pairs, self.params)) if pairs else ca.SX(0, 1)

    def _sizes(self, name: str) -> ca.SX:
        """Return a measure of all joints, zero of those that have none."""
        return ca.vec(row([joint.sizes.get(name, 0.0) for joint in self.joints], self.params))


def _inertia(body: Body, params: Any) -> Any:
    """Return the entries of the inertia about the centre; of a planar body, all of them that."""
    if body.kind != "spatial":
        moment = 0.0 if body.kind == "point" else body.inertia
        return ca.repmat(column(moment, params, 1), 9, 1)
    if callable(body.inertia):
        return ca.vec(ca.densify(inertia_matrix(body, params)))
    return (body.inertia if body.inertia.ndim == 2 else np.diag(body.inertia)).ravel()


def _place(body: Body, params: Any) -> Any:
    return column(body.at, params, 3) if callable(body.at) else body.at


def _column(parts: Sequence[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *parts)
