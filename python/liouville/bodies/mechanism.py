"""The Lagrangian of an assembly, which still knows its bodies and joints by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville import _casadi as ca
from liouville import _core
from liouville.bodies import rotations as rot
from liouville.bodies.body import Body, Layout, Value, column, row, stacked
from liouville.bodies.chaining import Coupling
from liouville.bodies.compound import grouped, rotors
from liouville.bodies.elements import Efforts, Element, of_elements, of_joints
from liouville.bodies.friction import contact, multipliers, normal_forces
from liouville.bodies.joints import KINDS, MOTION, Joint, local, rolled
from liouville.bodies.poses import Poses, kinetic
from liouville.errors import Description, hinted, quoted
from liouville.systems import Lagrangian
from liouville.systems._expressions import Expressions
from liouville.systems.mechanics import Mechanics
from liouville.tape import record

if TYPE_CHECKING:
    from liouville.bodies.chaining import Gear

Array = NDArray[np.float64]


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


class Mechanism(Lagrangian):
    """A :class:`~liouville.Lagrangian` of bodies and joints, by :meth:`Assembly.system`.

    The coordinates of a spatial body are its centre of mass and the unit quaternion from its axes
    to the world's, ``"crank.x"`` to ``"crank.e3"``; of a point mass its place; of a planar body its
    centre and its angle. Those of compound joints follow, ``"A.angle"``. The constraints of a joint
    have its name, ``"A.x"``, those that keep quaternions units that of the body, ``"crank.unit"``.

    Attributes
    ----------
    bodies, joints : tuple of str
        Names of the bodies but the ground, and of the joints.
    rubbing : tuple of str
        Names of the joints with friction.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        joints: Sequence[Joint],
        elements: Sequence[Element],
        gears: Sequence[Gear | Coupling],
        gravity: Value,
        params: Mapping[str, ArrayLike] | None,
    ) -> None:
        self._body_layout = Layout(bodies, joints)
        model = _Model(bodies, joints, elements, gears, gravity, self._body_layout)
        super().__init__(
            model.lagrangian,
            model.constraint if joints or self._body_layout.of_kind("spatial") else None,
            nonholonomic=model.nonholonomic if model.is_nonholonomic else None,
            q=self._body_layout.coordinates,
            params=params,
            force=model.force,
        )
        self._places = {place.name: place for place in model.places()}
        self.bodies, self.joints = self._body_layout.names, tuple(self._places)
        self._outputs = Expressions(self._symbols, model.outputs())
        self._output_tapes: dict[str, _core.Tape] = {}
        self.rubbing = tuple(joint.name for joint in joints if joint.friction is not None)

    def output(self, name: str, params: NDArray[np.float64], *at: ArrayLike) -> NDArray[np.float64]:
        """Return what :meth:`_Model.outputs` names at (t, q, v)."""
        if name not in self._output_tapes:
            s = self._symbols
            self._output_tapes[name] = record(name, s.inputs(z=s.z), self._outputs.columns[name])
        rows = [np.ascontiguousarray(np.reshape(x, (np.size(at[0]), -1)), float) for x in at]
        return self._output_tapes[name].map(params, rows)

    def assemble(
        self,
        values: Mapping[str, ArrayLike] | None = None,
        rates: Mapping[str, ArrayLike] | None = None,
        *,
        t: float = 0.0,
        params: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Return start values with some coordinates and rates of joints given.

        The others are solved for by Gauss-Newton steps along the freedoms of a tree of joints,
        from the places as drawn; coordinates given move there by small strides, so that loops stay
        on their branch. Rates that are not given are as small as they can be.

        Parameters
        ----------
        values, rates : mapping, optional
            Coordinates and their rates by joint: a number, or of joints with several a sequence,
            with None for those to be solved for. Angles in radians; values are zero as drawn.
        t : float, default 0
            Time, for motions prescribed.
        params : mapping, optional
            Parameters that differ from their defaults.

        Returns
        -------
        dict of str to ndarray
            ``q`` and ``v`` for :func:`liouville.integrate`.

        Raises
        ------
        TypeError, ValueError
            There is no such joint; a loop cannot be closed, or what is given contradicts it; the
            mechanism has no freedom left.
        """
        from liouville.bodies.starting import assembled

        return assembled(self, values, rates, t, params)

    def stepped(  # type: ignore[override]
        self, t: float, y: Array, z: Array, params: Array
    ) -> Mechanics:
        """Return the system without redundant constraints, which friction must not have.

        Raises
        ------
        ValueError
            There are redundant constraints, so that normal forces are not determined.
        """
        found = super().stepped(t, y, z, params)
        if self.rubbing and found is not self:
            left = quoted(tuple(name for name in self.constraints if name not in found.constraints))
            sentence = (
                f"friction in {self._rubbing_joints} has no normal force: loops hold more than "
                f"they need, by the constraints {left}"
            )
            hint = "take planar bodies in a planar loop, or joints that leave more free"
            raise ValueError(hinted(sentence, hint))
        return found

    @property
    def _rubbing_joints(self) -> str:
        return f"joint{'s' if len(self.rubbing) > 1 else ''} {quoted(self.rubbing)}"

    def describe(self, error: dict[str, Any]) -> Description:
        """Describe an error of the core in the user's names: sentence, hint and quantity."""
        sentence, hint, quantity = super().describe(error)
        if self.rubbing and error["kind"] == "not finite":
            hint = (
                f"friction in {self._rubbing_joints} may jam there: what it exerts presses the "
                "joint harder than the load does; take less friction, or a smaller radius"
            )
        return sentence, hint, quantity

    def place(self, name: str) -> Place:
        """Return a joint by its name."""
        if name not in self._places:
            known = ", ".join(self._places) or "none"
            raise ValueError(hinted(f"there is no joint {name!r}", f"joints are {known}"))
        return self._places[name]

    def body(self, name: str) -> int:
        """Return the place of a body by its name."""
        if name not in self.bodies:
            known = ", ".join(self.bodies)
            raise ValueError(hinted(f"there is no body {name!r}", f"bodies are {known}"))
        return self.bodies.index(name)


class _Model:
    """The functions of a Lagrangian, which share what they compute of one set of symbols."""

    def __init__(
        self,
        bodies: Sequence[Body],
        joints: Sequence[Joint],
        elements: Sequence[Element],
        gears: Sequence[Gear | Coupling],
        gravity: Value,
        layout: Layout,
    ) -> None:
        self.bodies, self.joints, self.elements = bodies, joints, elements
        self.couplings = [x for x in gears if isinstance(x, Coupling)]
        self.gears = [x for x in gears if not isinstance(x, Coupling)]
        self.gravity, self.layout = gravity, layout
        self.indices = {body.name: k for k, body in enumerate(bodies)} | {"ground": len(bodies)}
        self.is_nonholonomic = bool(self.gears) or any("rolling" in x.kind for x in joints)

    def _compute(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> None:
        """Make the expressions that all functions are parts of."""
        self.t, self.q, self.v, self.params = t, q, v, params
        self.poses = Poses(self.layout, q, v)
        self.groups = grouped(self.joints, self.indices, self.poses, params)
        self.potential, self.coordinates = of_joints(self.groups, t, params)
        more, self.efforts = of_elements(self.elements, self.indices, self.poses, t, params)
        self.potential += more

    def lagrangian(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> ca.SX:
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
        return (
            units | rows | {coupling.name: self._coupled(coupling) for coupling in self.couplings}
        )

    def _coupled(self, coupling: Coupling) -> ca.SX:
        """Return what a coupling holds at zero."""
        value: ca.SX
        value, *other = (self.coordinates[joint][0] for joint in coupling.joints)
        for k, factor in enumerate(coupling.coefficients):
            value = value - factor * (other[0] ** k if k else 1)
        return value

    def nonholonomic(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> dict[str, ca.SX]:
        found: dict[str, ca.SX] = {}
        for group in self.groups:
            if "rolling" in group.items[0].kind:
                slips = rolled(group)
                for k, joint in enumerate(group.items):
                    rows = {
                        f"{joint.name}.roll_{axis}": x[k]
                        for axis, x in zip("xy", slips, strict=True)
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
        found = self._pushed(v)
        if any(joint.friction is not None for joint in self.joints):
            self._rub(t, q, v, params, found)
            found = self._pushed(v)
        return found

    def _rub(self, t: ca.SX, q: ca.SX, v: ca.SX, params: Any, force: ca.SX) -> None:
        """Add friction, whose normal forces these forces determine, to the efforts of joints."""
        holonomic = self.constraint(t, q, params)
        rolling = self.nonholonomic(t, q, v, params)
        g, k = (ca.vertcat(ca.SX(0, 1), *x.values()) for x in (holonomic, rolling))
        mass, rest, slopes, gamma = multipliers(self.energy, force, g, k, (t, q, v))
        contacts = [
            contact(group, j, [*holonomic, *rolling], self.coordinates)
            for group in self.groups
            for j, joint in enumerate(group.items)
            if joint.friction is not None
        ]
        normal = normal_forces(contacts, mass, rest, slopes, gamma, v)
        for x, N in zip(contacts, normal, strict=True):
            for name, unit in x.forces.items():
                value, rate, effort = self.coordinates[x.name, name]
                self.coordinates[x.name, name] = value, rate, effort + N * unit

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

    def outputs(self) -> dict[str, ca.SX]:
        """Return the expressions of what is read of a motion."""
        order = [(joint.name, name) for joint in self.joints for name in joint.coordinates]
        own = [self.coordinates[key] for key in order]
        values, rates, efforts = zip(*own, strict=True) if own else ((), (), ())
        points = [
            local((joint.a, joint.b)[side], joint.points[side], self.params)
            for joint in self.joints
            for side in range(2)
        ]
        anchors = [local(x.a, axis.point, self.params) for x in self.joints for axis in x.axes]
        return {
            "values": _column([ca.SX(0) if x is None else x for x in values]),
            "rates": _column(rates),
            "efforts": _column(efforts),
            "points": ca.vec(stacked(points)) if points else ca.SX(0, 1),
            "anchors": ca.vec(stacked(anchors)) if anchors else ca.SX(0, 1),
            "drawn": ca.vec(stacked([_place(body, self.params) for body in self.bodies])),
            "pitches": ca.vec(row([x.sizes.get("pitch", 0.0) for x in self.joints], self.params)),
        }


def _place(body: Body, params: Any) -> Any:
    return column(body.at, params, 3) if callable(body.at) else body.at


def _column(parts: Sequence[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *parts)
