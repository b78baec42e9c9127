"""The Lagrangian of an assembly, with its bodies and joints by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, quoted
from liouville._basics.faults import Description
from liouville._basics.job import Turning
from liouville._systems import members
from liouville._systems.mechanics.general import Mechanics
from liouville._systems.tape import record
from liouville._systems.tracing.expressions import Expressions
from liouville.bodies import turns
from liouville.bodies.body import Body, Layout, Value, check_numbers, check_size
from liouville.bodies.chaining import Coupling
from liouville.bodies.elements import Element, check_matrix, matrix_functions
from liouville.bodies.joints import Joint
from liouville.bodies.measured import Measured
from liouville.bodies.model import Model
from liouville.bodies.normal_forces import Rubs
from liouville.bodies.touching import Rope, Touch, looks

if TYPE_CHECKING:
    from liouville.bodies.chaining import Gear

Array = NDArray[np.float64]

#: A function of (t, q, v, params).
Function = Callable[..., Any]


class Mechanism(Measured):
    """A :class:`~liouville.Lagrangian` of bodies and joints, by :meth:`Assembly.system`.

    The coordinates of a spatial body are its centre of mass and the unit quaternion from its axes
    to the world's, ``"crank.x"`` to ``"crank.e3"``; of a point mass its place; of a planar body its
    centre and its angle. Those of compound joints follow, ``"A.angle"``, then the angles of other
    joints of spatial bodies that a spring, a coupling or a torque depends on: they count turns, and
    a constraint ``"A.turns"`` keeps them. The constraints of a joint have its name, ``"A.x"``,
    those that keep quaternions units that of the body, ``"crank.unit"``.

    Attributes
    ----------
    bodies, joints : tuple of str
        Names of the bodies but the ground, and of the joints.
    rubbing : tuple of str
        Names of the joints with friction.
    looks : list of Look
        How shapes that touch are drawn.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        joints: Sequence[Joint],
        elements: Sequence[Element],
        gears: Sequence[Gear | Coupling],
        touches: Sequence[Touch | Rope],
        gravity: Value,
        params: Mapping[str, ArrayLike] | None,
        impacts: str,
    ) -> None:
        counted = turns.counted(joints, gears, params or {})
        self.body_layout = Layout(bodies, joints, counted)
        model = Model(bodies, joints, elements, gears, touches, gravity, self.body_layout)
        contacts = model.contacts()
        self.rubbing = tuple(joint.name for joint in joints if joint.friction)
        if contacts and self.rubbing:
            sentence = f"friction in {self._rubbing_joints} knows nothing of what contacts press"
            hint = f"leave out either, the friction or contacts {quoted(tuple(contacts))}"
            raise ValueError(hinted(sentence, hint))
        super().__init__(
            model.lagrangian,
            model.constraint if joints or self.body_layout.of_kind("spatial") else None,
            nonholonomic=model.nonholonomic if model.is_nonholonomic else None,
            q=self.body_layout.coordinates,
            params=params,
            force=model.force,
            switches=model.switches,
            contacts=contacts,
            impacts=impacts,
        )
        self._places = {place.name: place for place in model.places()}
        self.bodies, self.joints = self.body_layout.names, tuple(self._places)
        self.turned = tuple(
            f"{place.name}.{x}"
            for place in self._places.values()
            for x in place.angles
            if x not in self.counted(place.name)
        )
        self.springs = model.springs()
        self.looks, _ = looks(model)
        self._outputs = Expressions(self.symbols, model.outputs())
        self._output_tapes: dict[str, _core.Tape] = {}
        self._varying = tuple(
            k for k, body in enumerate(bodies) if callable(body.mass) or callable(body.inertia)
        )
        self._limited = tuple((what, name) for what, name, _ in model.limited)
        self._matrices = tuple((what, name) for what, name, _ in matrix_functions(elements))
        self.checks_values = bool(self._limited or self._matrices or self._varying)
        self._wheels = tuple(joint.name for joint in joints if joint.kind == "rolling wheel")
        self._directions = model.directions

    def values(self, params: Mapping[str, ArrayLike] | None) -> Array:
        """Return the parameter vector with changes; ValueError where nothing has such a size."""
        found = super().values(params)
        # none while the system is made
        varying, limited, matrices = (
            self.__dict__.get(x) if params else None for x in ("_varying", "_limited", "_matrices")
        )
        still = np.zeros(len(self.coordinates))
        if limited:
            sizes = self.output("limited", found, 0.0, still, still)[0]
            for (what, name), size in zip(limited, sizes, strict=True):
                check_size(what, name, size)
        if matrices:
            entries = self.output("matrices", found, 0.0, still, still)[0].reshape(-1, 36)
            for (what, name), own in zip(matrices, entries, strict=True):
                check_matrix(what, name, own)
        if varying:
            masses, inertias = (
                self.output(name, found, 0.0, still, still)[0] for name in ("masses", "inertias")
            )
            kinds, inertias = self.body_layout.kinds, inertias.reshape(-1, 3, 3)
            for k in varying:
                check_numbers(self.bodies[k], kinds[k], masses[k], inertias[k])
        return found

    @property
    def kinds(self) -> Sequence[int]:
        """Lengths are of one kind, and angles and quaternions of another."""
        # imported here, as it knows this class
        from liouville.bodies.scales import of_coordinates

        return [int(unit) for unit in of_coordinates(self, 0.0)]

    @property
    def turning(self) -> Turning | None:
        """The tape of angles that a run continues and their rates, and their periods."""
        if not self.turned:
            return None
        if "turning" not in self._output_tapes:
            at = [self._column(*name.rsplit(".", 1)) for name in self.turned]
            columns = [self._outputs.columns[what][k] for what in ("values", "rates") for k in at]
            s = self.symbols
            self._output_tapes["turning"] = record("turning", s.inputs(z=s.z), ca.vertcat(*columns))
        kinds = [self._places[name.rsplit(".", 1)[0]].kind for name in self.turned]
        return self._output_tapes["turning"], turns.periods(kinds)

    def continued(
        self,
        t: Array,
        q: Array,
        v: Array,
        params: Array,
        first: Mapping[str, float] | None = None,
    ) -> dict[str, Array]:
        """Return the angles that no coordinate counts, by name, continued along k states.

        Those of the first are known where they are given.
        """
        if self.turning is None:
            return {}
        rows = [np.ascontiguousarray(x) for x in (t[:, None], q, v)]
        found = self.turning[0].map(params, rows)
        known = None if first is None else np.array([first[name] for name in self.turned])
        angles = turns.continued(t, found, self.turning[1], known)
        return dict(zip(self.turned, angles.T, strict=True))

    def rubs(self, params: Array, t: Array, q: Array, v: Array) -> list[Rubs] | None:
        """Return the numbers that determine normal forces at k states, or None without friction.

        Raises
        ------
        ValueError
            There are redundant constraints, so that normal forces are not determined.
        """
        if not self.rubbing:
            return None
        self.stepped(float(t[0]), q[0], v[0], params)
        rates, pushes, presses, least = (
            self.output(name, params, t, q, v)
            for name in ("rates without friction", "pushes", "presses", "least")
        )
        n, cuts = len(self.coordinates), np.cumsum(self._directions)[:-1]
        return [
            Rubs(own[:n], own[n:], push.reshape(-1, n), np.split(press, cuts), x)
            for own, push, press, x in zip(
                rates, pushes, presses.reshape(len(t), -1, rates.shape[1] - n), least, strict=True
            )
        ]

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
            Parameters that differ from their defaults; a row for each of P members is taken too.

        Returns
        -------
        dict of str to ndarray
            ``q`` and ``v`` for :func:`liouville.integrate`, of shape (P, n) for ``ensemble``.

        Raises
        ------
        TypeError, ValueError
            There is no such joint; a loop cannot be closed, or what is given contradicts it; the
            mechanism has no freedom left.
        """
        from liouville.bodies.starting import assembled

        def started(_: Any, own: Mapping[str, ArrayLike]) -> dict[str, Array]:
            return assembled(self, values, rates, t, own)

        many = members.each(self, {}, params, started)
        return assembled(self, values, rates, t, params) if many is None else many

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
        flat = any(f"'{name}." in sentence for name in self._wheels)
        if flat and error["kind"] == "not finite":
            hint = (
                "a wheel that has fallen flat on its plane has no lowest point: let an event end "
                "the run before"
            )
            return sentence, hint, quantity
        if self.rubbing and error["kind"] == "not finite":
            hint = (
                f"friction in {self._rubbing_joints} may jam there: what it exerts presses the "
                "joint harder than the load does; take less friction, or a smaller radius"
            )
        return sentence, hint, quantity

    def counted(self, name: str) -> tuple[str, ...]:
        """Return the angles of a joint that count turns."""
        place, layout = self.place(name), self.body_layout
        if place.axes or not any(
            layout.kinds[body] != "planar" for body in place.bodies if body < len(layout.kinds)
        ):
            return place.angles
        return tuple(x for x in place.angles if (name, x) in layout.counted)
