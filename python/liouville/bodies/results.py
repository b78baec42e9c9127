"""Motions of bodies and joints, and the forces in joints, from the states of a run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import amount
from liouville._basics.errors import Suggesting, hinted
from liouville._solution.parts import system_of
from liouville._systems.mechanics.redundant import _gradients
from liouville.bodies import rotations as rot
from liouville.bodies.body import spot
from liouville.bodies.joints import RATES
from liouville.bodies.mechanism import Mechanism
from liouville.bodies.model import Place

if TYPE_CHECKING:
    from liouville._solution.solution import Solution

Array = NDArray[np.float64]

#: Entries of directions that multipliers are free along, below which a multiplier is determined.
FREE = 1e-8


@dataclass(frozen=True, eq=False, repr=False)
class BodyMotion(Suggesting):
    """The motion of a body, in the world, at the k kept steps.

    Attributes
    ----------
    name : str
        Its name.
    t : ndarray, shape (k,)
        Times.
    position, velocity : ndarray, shape (k, 3)
        Of its centre of mass.
    rotation : ndarray, shape (k, 4)
        Unit quaternion from its axes to the world's.
    angular_velocity : ndarray, shape (k, 3)
        About the world's axes.
    """

    name: str
    t: Array
    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    _is_flat: bool = False

    def __repr__(self) -> str:
        """Name the body and its records."""
        return f"<motion of body {self.name!r}: {amount(len(self.t), 'record')}>"

    def point(self, at: ArrayLike) -> Array:
        """Return the path, shape (k, 3), of a point at rest in its axes, from its centre.

        Of a planar body two numbers are a point.
        """
        own = spot(f"a point of body '{self.name}'", at, self._is_flat)
        path: Array = self.position + np.stack(rot.rotate(self.rotation.T, own), axis=1)
        return path


@dataclass(frozen=True, eq=False, repr=False)
class JointMotion(Suggesting):
    """The motion of a joint and the wrench in it, at the k kept steps.

    Force and torque are those that keep the joint, and that prescribe its motion; they act on its
    second body, at its point there, and the opposite ones on the first. What dampers, motors and
    friction exert along its coordinates is in `efforts` and not among them, and what its springs
    exert in neither; but for compound joints, whose axes transmit all of it. Planar bodies do not
    know what holds them in their plane: between two of them, or one and the ground, force and
    torque are those of the plane, :math:`(F_x, F_y, 0)` and :math:`(0, 0, M_z)`, and a point mass
    knows no torque that holds it.

    `coordinates` are its `values` with angles continuous over turns. Of the first coordinate
    `angle` or `slide`, `rate` and `effort` are arrays; `is_determined` says whether force and
    torque are.

    Attributes
    ----------
    name : str
        Its name.
    t : ndarray, shape (k,)
        Times.
    force, torque : ndarray, shape (k, 3)
        In the world, or in the frame of the joint in its second body, the third axis along it.
    values : dict of str to ndarray, shape (k,)
        Angles and slides by name; angles from -2 pi to 2 pi where the system counts no turns, the
        second of a universal joint from -pi to pi.
    rates : dict of str to ndarray, shape (k,)
        Their rates by the same names; of joints without values, such as ball joints, rates alone:
        ``spin_x`` and so on, about the world's axes.
    efforts : dict of str to ndarray, shape (k,)
        What dampers, motors and friction exert along each, on the second body.
    """

    name: str
    t: Array
    force: Array
    torque: Array
    values: dict[str, Array]
    rates: dict[str, Array]
    efforts: dict[str, Array]
    _solution: Solution

    def __repr__(self) -> str:
        """Name the joint, its records, and its coordinates."""
        free = ", ".join(self.rates) or "none"
        return (
            f"<motion of joint {self.name!r}: {amount(len(self.t), 'record')}, coordinates: {free}>"
        )

    @cached_property
    def coordinates(self) -> dict[str, Array]:
        """Angles, continuous over turns, and slides by name, each of shape (k,).

        They count from their value at the start of the run, through all of its steps, whatever is
        kept of these.

        Raises
        ------
        ValueError
            A step was too long for that, or a reset turned the joint: rates do not say how far.
        """
        system = _mechanism(self._solution, f"joint '{self.name}'")
        found = {key: f"{self.name}.{key}" for key in self.values}
        angles = self._solution.angles
        if not angles and any(name in system.turned for name in found.values()):
            # of a file of an earlier release
            own = self._solution
            angles = system.continued(own.t, own.q, own.v, system.values(own.params))
        return {key: self._counted(key, angles.get(name)) for key, name in found.items()}

    def _counted(self, key: str, angle: Array | None) -> Array:
        """Return a coordinate, whose turns are counted where it has an angle of its own."""
        if angle is None:
            return self.values[key]
        unknown = np.isnan(angle)
        if unknown.any():
            k = int(np.argmax(unknown))
            since = f"after t = {self.t[k - 1]:.6g}" if k else f"before t = {self.t[0]:.6g}"
            sentence = (
                f"joint '{self.name}' has no continuous {key}: {since} it turned in one step, or "
                "by a reset, by another angle than its rates tell"
            )
            hint = "take smaller steps, or the angles as they jump from its values"
            raise ValueError(hinted(sentence, hint))
        return angle

    @property
    def is_determined(self) -> bool:
        """Whether the motion alone determines force and torque.

        In a loop that holds more than it needs, as planar ones of hinges in space do, those given
        are the least of many that are possible. Computed at the start of the run. Between planar
        bodies it is said of the part in the plane; where gravity across it, a spatial body or a
        point mass loads them out of the plane, the answer is no.
        """
        system = _mechanism(self._solution, f"joint '{self.name}'")
        place = system.place(self.name)
        if _is_loaded_across(system, self._solution, place):
            return False
        return _is_determined(system, self._solution, place)

    @property
    def angle(self) -> Array:
        """The angle about the axis, continuous over turns, shape (k,)."""
        return self._only(self.coordinates, "angle")

    @property
    def slide(self) -> Array:
        """The way along the axis, shape (k,)."""
        return self._only(self.coordinates, "slide")

    @property
    def rate(self) -> Array:
        """The rate of the first coordinate, shape (k,)."""
        return self._only(self.rates, next(iter(self.rates), "rate"))

    @property
    def effort(self) -> Array:
        """The force of dampers, motors and friction along the first coordinate, shape (k,)."""
        return self._only(self.efforts, next(iter(self.efforts), "effort"))

    def _only(self, found: dict[str, Array], name: str) -> Array:
        if name not in found:
            known = ", ".join(found) or "none"
            raise AttributeError(hinted(f"joint '{self.name}' has no {name}", f"it has {known}"))
        return found[name]


def body_of(solution: Solution, name: str) -> BodyMotion:
    """Return the motion of a body; see :meth:`Solution.body`."""
    system = _mechanism(solution, f"body '{name}'")
    body, layout = system.body(name), system.body_layout
    q, v = solution.q, solution.v
    x, e = layout.pose(q, body)
    parts = (x, e, *layout.twist(q, v, body))
    position, rotation, velocity, omega = (np.stack(part, axis=1) for part in parts)
    is_flat = layout.kinds[body] == "planar"
    return BodyMotion(name, solution.t, position, rotation, velocity, omega, is_flat)


def joint_of(solution: Solution, name: str, frame: str = "world") -> JointMotion:
    """Return the motion of a joint and the wrench in it; see :meth:`Solution.joint`."""
    system = _mechanism(solution, f"joint '{name}'")
    place = system.place(name)
    params, at = system.values(solution.params), (solution.t, solution.q, solution.v, solution.lam)
    wrench = system.wrenches(name, frame, params, *at)
    values, rates, efforts = (
        _columns(system, solution, place, what) for what in ("values", "rates", "efforts")
    )
    coordinates = {key: x for key, x in values.items() if key not in RATES}
    return JointMotion(
        name,
        solution.t,
        wrench[:, :3],
        wrench[:, 3:],
        coordinates,
        rates,
        efforts,
        solution,
    )


def _mechanism(solution: Solution, what: str) -> Mechanism:
    """Return the system of a single run with states."""
    system = system_of(solution, f"the motion of {what} needs")
    if not isinstance(system, Mechanism):
        raise TypeError(
            hinted(
                f"{what}: the system is a {type(system).__name__} and knows no bodies and joints",
                "make it with lv.bodies.Assembly",
            )
        )
    if solution.members is not None:
        hint = "take a member of the ensemble: solution.member(0)"
        raise ValueError(hinted(f"the motion of {what} is that of a single run", hint))
    return system


def _columns(system: Mechanism, solution: Solution, place: Place, what: str) -> dict[str, Array]:
    params = system.values(solution.params)
    found = system.output(what, params, solution.t, solution.q, solution.v)
    return {name: found[:, place.first + k] for k, name in enumerate(place.coordinates)}


def _is_loaded_across(system: Mechanism, solution: Solution, place: Place) -> bool:
    """Return whether a joint that knows the plane only may hold a force across it."""
    if {system.kind(body) for body in place.bodies} - {"planar", "ground"}:
        return False
    q, v = (np.zeros((1, len(system.coordinates))) for _ in range(2))
    gravity = system.output("gravity", system.values(solution.params), 0.0, q, v)[0]
    return bool(gravity[2]) or set(system.body_layout.kinds) != {"planar"}


def _is_determined(system: Mechanism, solution: Solution, place: Place) -> bool:
    """Return whether no change of multipliers that leaves all reactions touches this joint."""
    params = system.values(solution.params)
    slopes = _gradients(system, solution.t[0], solution.q[0], solution.v[0], params)
    basis, sizes, _ = np.linalg.svd(slopes)
    free = basis[:, int((sizes > FREE * sizes.max(initial=0.0)).sum()) :]
    own = [system.constraints.index(row) for row in place.rows]
    return not np.abs(free[own]).max(initial=0.0) > FREE
