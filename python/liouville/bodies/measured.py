"""Lagrangians of bodies and joints: what is measured of their motion, as functions of its state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems import Lagrangian
from liouville._systems.tape import record
from liouville._systems.tracing.expressions import Expressions
from liouville.bodies import rotations as rot
from liouville.bodies.body import Layout, spot
from liouville.bodies.joints import RATES
from liouville.bodies.model import Place
from liouville.bodies.poses import Poses

#: A function of (t, q, v, params), of forces of (t, q, v, lam, params).
Function = Callable[..., Any]

#: Kinds of bodies by what they know of a joint's force, and of its torque: a spatial body all, a
#: point mass no torque, a planar body the part in its plane.
FORCE, TORQUE = (
    ("spatial", "point", "planar", "ground"),
    ("spatial", "planar", "point", "ground"),
)


class Measured(Lagrangian):
    """The base of :class:`~liouville.bodies.mechanism.Mechanism`, by names of bodies and joints.

    Attributes
    ----------
    bodies, joints : tuple of str
        Names in the order of addition.
    """

    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    body_layout: Layout
    _places: dict[str, Place]
    _outputs: Expressions
    _output_tapes: dict[str, _core.Tape]

    def coordinate(self, name: str) -> Function:
        """Return a coordinate of a joint as a function of (t, q, v, params), such as "A.angle".

        It is for ``observe=`` of :func:`liouville.integrate` and of :func:`liouville.fit`, for
        events and for costs: ``lv.Event(system.coordinate("A.angle"))`` where the angle is zero.
        Angles are those of ``solution.joint("A").values``.

        Parameters
        ----------
        name : str
            The joint and its coordinate; the coordinate alone may be left out where there is one.

        Returns
        -------
        callable
            A scalar of expressions.

        Raises
        ------
        ValueError
            There is no such joint, or it has no such coordinate.
        """
        return self._measured("values", name)

    def rate(self, name: str) -> Function:
        """Return the rate of a coordinate of a joint, as :meth:`coordinate` returns its value.

        Ball joints have rates alone: ``system.rate("A.spin_x")`` about the world's axes.

        Parameters
        ----------
        name : str
            A joint, with its coordinate where it has several: ``"A"``, ``"hip.reach"``.

        Returns
        -------
        callable
            A function of (t, q, v, params), in radians or units of length a unit of time.

        Raises
        ------
        TypeError, ValueError
            The name is none of a joint's coordinate.
        """
        return self._measured("rates", name)

    def point(self, body: str, at: ArrayLike = (0.0, 0.0, 0.0)) -> Function:
        """Return the place of a point of a body in the world as a function of (t, q, v, params).

        Parameters
        ----------
        body : str
            Its name.
        at : array_like, shape (3,), of a planar body (2,)
            The point from the centre of mass, in the axes of the body.

        Returns
        -------
        callable
            A column of three expressions: ``lambda t, q, v, params: tip(t, q, v)[2]`` is the height
            of one.

        Raises
        ------
        ValueError
            There is no such body.
        """
        k = self.body(body)
        own = spot(f"a point of body '{body}'", at, self.body_layout.kinds[k] == "planar")

        def place(t: ca.SX, q: ca.SX, v: ca.SX, *more: Any) -> ca.SX:
            del t, more
            poses = Poses(self.body_layout, q, v)
            directors = poses.directors  # columns of the rotation, by component
            found: ca.SX = ca.vertcat(*(
                poses.x[i][k] + sum(directors[j][i][k] * own[j] for j in range(3))
                for i in range(3)
            ))  # fmt: skip
            return found

        return place

    def joint_force(self, name: str, frame: str = "world") -> Function:
        """Return the force in a joint as a function of (t, q, v, lam, params).

        It is for ``observe=`` of runs and of :func:`liouville.fit`, as a load cell measures it, for
        events, and for ``solution.tangent_of``. The force is that of
        ``solution.joint(name, frame).force``.

        Parameters
        ----------
        name : str
            The joint.
        frame : {"world", "joint"}
            What it is in the axes of.

        Returns
        -------
        callable
            A column of three expressions.

        Raises
        ------
        ValueError
            There is no such joint or frame.
        """
        return self._of_wrench(name, frame, slice(3))

    def joint_torque(self, name: str, frame: str = "world") -> Function:
        """Return the torque in a joint about its point, as :meth:`joint_force` the force."""
        return self._of_wrench(name, frame, slice(3, 6))

    def place(self, name: str) -> Place:
        """Return a joint by its name."""
        if name not in self._places:
            known = ", ".join(self._places) or "none"
            if name in self.constraints:
                sentence = f"{name!r} is a constraint, and no joint"
                hint = (
                    f"solution.reaction({name!r}) has its force on each of "
                    "solution.names['coordinates']"
                )
                raise ValueError(hinted(sentence, hint))
            raise ValueError(hinted(f"there is no joint {name!r}", f"joints are {known}"))
        return self._places[name]

    def body(self, name: str) -> int:
        """Return the place of a body by its name."""
        if name not in self.bodies:
            known = ", ".join(self.bodies)
            raise ValueError(hinted(f"there is no body {name!r}", f"bodies are {known}"))
        return self.bodies.index(name)

    def output(self, name: str, params: NDArray[np.float64], *at: ArrayLike) -> NDArray[np.float64]:
        """Return the value of an output of :meth:`Model.outputs` at (t, q, v)."""
        if name not in self._output_tapes:
            s = self.symbols
            self._output_tapes[name] = record(name, s.inputs(z=s.z), self._outputs.columns[name])
        rows = [np.ascontiguousarray(np.reshape(x, (np.size(at[0]), -1)), float) for x in at]
        return self._output_tapes[name].map(params, rows)

    def _measured(self, what: str, name: str) -> Function:
        if not isinstance(name, str):
            raise TypeError(f"a coordinate of a joint must be a name, 'A.angle', not {name!r}")
        joint, _, coordinate = name.rpartition(".")
        if joint not in self._places:
            joint, coordinate = name, ""
        place = self.place(joint)
        known = [x for x in place.coordinates if what == "rates" or x not in RATES]
        if not coordinate and len(known) == 1:
            coordinate = known[0]
        if coordinate not in known:
            of = "rate" if what == "rates" else "coordinate"
            own = " or ".join(f"'{joint}.{x}'" for x in known)
            hint = f"write {own}" if known else f"it leaves no {of} free"
            raise ValueError(hinted(f"joint '{joint}' has no {of} '{coordinate}'", hint))
        k = self._column(joint, coordinate)

        def measured(t: ca.SX, q: ca.SX, v: ca.SX, *more: Any) -> ca.SX:
            del more  # multipliers, and parameters, which are those of the system
            s, expression = self.symbols, self._outputs.columns[what][k]
            found: ca.SX = ca.substitute([expression], [s.t, s.y, s.z], [t, q, v])[0]
            return found

        return measured

    def _column(self, joint: str, coordinate: str) -> int:
        place = self._places[joint]
        return place.first + place.coordinates.index(coordinate)

    def wrenches(self, name: str, frame: str, params: NDArray[np.float64], *at: Any) -> Any:
        """Return force and torque in a joint, of shape (k, 6), at (t, q, v, lam)."""
        key = f"wrench of {name} in the {frame}"
        if key not in self._output_tapes:
            s = self.symbols
            inputs = s.inputs(z=s.z, lam=self._multipliers)
            self._output_tapes[key] = record(key, inputs, self._wrench(name, frame))
        rows = [np.ascontiguousarray(np.reshape(x, (len(at[0]), -1)), float) for x in at]
        return self._output_tapes[key].map(params, rows)

    def _of_wrench(self, name: str, frame: str, part: slice) -> Function:
        expression = self._wrench(name, frame)[part]

        def measured(t: ca.SX, q: ca.SX, v: ca.SX, lam: ca.SX, *more: Any) -> ca.SX:
            del more  # parameters, which are those of the system
            s = self.symbols
            own = [s.t, s.y, s.z, self._multipliers]
            found: ca.SX = ca.substitute([expression], own, [t, q, v, lam])[0]
            return found

        return measured

    def _wrench(self, name: str, frame: str) -> ca.SX:
        """Return force and torque on the second body of a joint, about the joint's point there."""
        place, layout = self.place(name), self.body_layout
        if frame not in ("world", "joint"):
            raise ValueError(f"frame must be 'world' or 'joint', not {frame!r}")
        lam, model = self._multipliers, self.model
        own = ca.SX.zeros(lam.numel())
        for row in map(self.constraints.index, place.rows):
            own[row] = lam[row]
        q = _row(self.symbols.y)
        total = model.r + model.nonholonomic.rn if self.nonholonomic else model.r
        reaction = _row(ca.substitute([total], [lam], [own])[0])
        points = ca.reshape(self._outputs.columns["points"], 3, -1)
        point = _row(points[:, 2 * self.joints.index(name) + 1])[0]
        x, e = layout.pose(q, place.bodies[1])
        at = rot.plus(x, rot.rotate(e, point))

        def on_second(order: Sequence[str]) -> tuple[Any, Any]:
            """Return both by the body whose kind comes first in an order."""
            ranks = [order.index(self.kind(body)) for body in place.bodies]
            side, sign = (0, -1.0) if ranks[0] < ranks[1] else (1, 1.0)
            force, torque = layout.wrench(q, reaction, place.bodies[side])
            centre, _ = layout.pose(q, place.bodies[side])
            about = rot.minus(torque, rot.cross(rot.minus(at, centre), force))
            if self.kind(place.bodies[side]) == "planar":
                about = (np.zeros(1), np.zeros(1), about[2])
            # the opposite wrench acts on the first body, about the same point
            return rot.times(sign, force), rot.times(sign, about)

        force, torque = on_second(FORCE)[0], on_second(TORQUE)[1]
        if frame == "joint":
            back = rot.conjugate(rot.product(e, place.frames[1]))
            force, torque = rot.rotate(back, force), rot.rotate(back, torque)
        found: ca.SX = ca.vertcat(*(part[0] for part in (*force, *torque)))
        return found

    def kind(self, body: int) -> str:
        """Return the kind of a body, the ground last."""
        return (*self.body_layout.kinds, "ground")[body]


def _row(column: ca.SX) -> NDArray[Any]:
    """Return expressions as an array of shape (1, n), which is what arithmetic of rows takes."""
    found = np.empty((1, column.numel()), dtype=object)
    for k in range(column.numel()):
        found[0, k] = column[k]
    return found
