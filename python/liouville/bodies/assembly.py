"""An assembly: bodies, joints and elements by name, which become a Lagrangian."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import amount
from liouville._basics.errors import hinted, no_attribute, public, quoted
from liouville._systems.mechanics.contact import Coefficient, check_restitution
from liouville._systems.tracing import trace as _trace
from liouville.bodies.acting import Acting
from liouville.bodies.body import (
    Value,
    check_mass,
    check_size,
    evaluated,
    given,
    unit,
)
from liouville.bodies.chaining import Which
from liouville.bodies.elements import check_matrix, matrix_functions, parameter_functions
from liouville.bodies.mechanism import Mechanism
from liouville.bodies.registry import apart, is_flat, two_points
from liouville.bodies.shapes import Shape
from liouville.bodies.touching import Rope, Touch, touch_of

#: What joints and bodies are called elsewhere.
CALLED = {
    "hinge": "revolute", "pin": "revolute", "slider": "prismatic", "ball": "spherical",
    "weld": "fixed", "rod": "bar", "link": "bar", "rigid_body": "body", "particle": "point_mass",
}  # fmt: skip


class Assembly(Acting):
    """Bodies and joints as drawn, in the world's coordinates; a model in the making.

    Numbers that may be parameters, such as masses, places and stiffnesses, are taken as functions
    of them too: ``mass=lambda params: params.m``.

    Parameters
    ----------
    gravity : array_like, shape (3,), or callable, optional
        The acceleration of free fall; none by default.

    Attributes
    ----------
    ground : Body
        What stands still.
    params : dict
        Parameters that a file brought, such as signals of actuators, with default values.

    Examples
    --------
    >>> import liouville as lv
    >>> m = lv.bodies.Assembly(gravity=(0, 0, -9.81))
    >>> rod = m.body("rod", mass=1.0, inertia=(0.1, 0.1, 0.01), at=(0, 0, -0.5))
    >>> m.revolute("A", m.ground, rod, at=(0, 0, 0), axis=(0, 1, 0))
    <Revolute 'A' of 'ground' and 'rod'>
    >>> system = m.system()
    >>> start = m.start(values={"A": 0.3})
    """

    def __init__(self, gravity: Value = (0.0, 0.0, 0.0)) -> None:
        super().__init__()
        self._gravity = given("gravity", gravity, (3,))
        self._system: Mechanism | None = None
        self._params: Mapping[str, ArrayLike] | None = None
        self.params: dict[str, ArrayLike] = {}

    def __repr__(self) -> str:
        """Count what it has."""
        bodies = amount(len(self._bodies) - 1, "body", "bodies")
        return f"<Assembly of {bodies} and {amount(len(self._joints), 'joint')}>"

    if not TYPE_CHECKING:  # whatever has a type is there

        def __getattr__(self, name: str) -> Any:
            """Refuse a name, with what is called so elsewhere."""
            if name.startswith("_") or hasattr(type(self), name):
                return object.__getattribute__(self, name)  # raises the error of its own
            if name in CALLED:
                sentence = f"'Assembly' object has no attribute {name!r}"
                raise AttributeError(hinted(sentence, f"did you mean {CALLED[name]!r}?"), name=name)
            raise no_attribute("'Assembly' object", name, public(self))

    def _changed(self) -> None:
        self._system = None

    def contact(
        self,
        name: str,
        a: Shape,
        b: Shape,
        *,
        restitution: Coefficient = 0.0,
        friction: Coefficient = 0.0,
        static_friction: Coefficient | None = None,
        across: ArrayLike | None = None,
    ) -> Touch:
        """Let shapes of two bodies touch: a contact that hits, slides, sticks and lets go.

        Spheres touch all shapes, all shapes touch planes, and in a plane polygons and capsules
        touch one another. Pairs with one point of contact have the name given; corners, and ends
        of capsules, are counted behind it, ``"table.0"``. A slip is the velocity of the body of `a`
        against that of `b`, or of what touches a plane against it, to the right of its normal where
        `across` comes forwards.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Plane, Sphere, Capsule, Box or Polygon
            Shapes of different bodies, or of a body and the ground; see :mod:`liouville.bodies`.
        restitution, friction, static_friction : float or callable, optional
            As for :class:`~liouville.Contact`. Friction is for bodies that move in a plane, and in
            space for a sphere or capsule on a plane.
        across : array_like, shape (3,), optional
            The normal of the plane that bodies in space move in, for friction and for capsules
            that lie in it; planar bodies move across z.

        Returns
        -------
        Touch
            The contact.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, the shapes do not touch one another, or the name is there already.
        """
        of = f"contact '{name}'"
        for shape in (a, b):
            if not isinstance(shape, Shape):
                hint = "write lv.bodies.Sphere(body, radius=0.1) or lv.bodies.Plane('ground')"
                raise TypeError(hinted(f"{of} takes two shapes, not {shape!r}", hint))
        sides = self._sides(of, a.body, b.body)
        laws = {"restitution": restitution, "friction": friction}
        normal = None if across is None else unit(f"across= of {of}", across)
        more = laws | {"static_friction": static_friction}
        touch = touch_of(name, sides, (a, b), more, normal)
        self._touches[self._new(name)] = touch
        return touch

    def rope(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        length: Value | None = None,
        restitution: float = 0.0,
    ) -> Rope:
        """Keep two points within a length: a rope without mass, which may go slack.

        It is a contact, ``solution.contacts[name]``, whose gap is how much of it is slack, and
        whose normal force is its tension.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : sequence of two
            A point on a and one on b, each of shape (3,) or callable, in the world as drawn.
        length : float or callable, optional
            Its length, positive; the distance as drawn by default.
        restitution : float, default 0
            Of the jerk as it goes taut, from 0 to 1.

        Returns
        -------
        Rope
            The rope.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"rope '{name}'"
        sides = self._sides(of, a, b)
        points = two_points(of, at, is_flat(*sides))
        length = apart(points) if length is None else given(f"length= of {of}", length, ())
        check_size(f"length= of {of}", "length", length)
        check_restitution(restitution)
        self._touches[self._new(name)] = rope = Rope(name, *sides, points, length, restitution)
        return rope

    def system(
        self, params: Mapping[str, ArrayLike] | None = None, *, impacts: str = "poisson"
    ) -> Mechanism:
        """Make the system.

        Parameters
        ----------
        params : mapping of str to float or 1-D array_like, optional
            Parameters by name, with default values, as those of :class:`~liouville.Lagrangian`;
            they come after those of the assembly, and may give these other values.
        impacts : {"poisson", "newton", "sequence"}
            The law of the impacts of its contacts, as for :class:`~liouville.Lagrangian`.

        Returns
        -------
        Mechanism
            A Lagrangian whose solutions have :meth:`~liouville.Solution.joint`
            and :meth:`~liouville.Solution.body`.

        Raises
        ------
        TypeError, ValueError
            There are no bodies, or bodies that nothing connects with the ground; a mass or an
            inertia is that of no body, or a size that of no joint; a function returns the wrong
            number of values.
        """
        bodies = [body for body in self._bodies.values() if body is not self.ground]
        if not bodies:
            raise ValueError("the assembly has no bodies")
        if alone := self._unconnected():
            what = "is" if len(alone) == 1 else "are"
            sentence = f"{quoted(alone)} {what} not connected with the ground"
            hint = f"join it, or let it fly: m.free('flight', '{alone[0]}')"
            raise ValueError(hinted(sentence, hint))
        own = {**self.params, **_trace.mapping("params", params)}
        defaults = _trace.Parameters(own).defaults
        numbers_of = _trace.Namespace({name: _plain(x) for name, x in defaults.items()})
        for body in bodies:
            if callable(body.mass) or callable(body.inertia):
                check_mass(body, numbers_of)
            if callable(body.at):
                evaluated(f"at= of body '{body.name}'", body.at, numbers_of, 3)
        own_parts = list(self._joints.values()), list(self._elements.values())
        touches = list(self._touches.values())
        for what, name, function, size in parameter_functions(*own_parts, touches):
            found = evaluated(what, function, numbers_of, size)
            if size == 1:
                check_size(what, name, found[0])
        for what, name, function in matrix_functions(own_parts[1]):
            check_matrix(what, name, evaluated(what, function, numbers_of, 6, 36))
        self._params = params
        self._system = Mechanism(
            bodies,
            *own_parts,
            list(self._gears.values()),
            touches,
            self._gravity,
            own,
            impacts,
        )
        return self._system

    def start(
        self,
        values: Mapping[str, Any] | None = None,
        rates: Mapping[str, Any] | None = None,
        *,
        t: float = 0.0,
        params: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, Any]:
        """Return start values with some coordinates and rates of joints given.

        What is not given is as drawn, or as small as it can be. It is :meth:`Mechanism.assemble`
        of the system last made.

        Parameters
        ----------
        values, rates : mapping of str to float or sequence, optional
            Coordinates of joints, in radians or the unit of length, and their rates, by the
            joints' names; of several coordinates a sequence, with None for what is not given.
        t : float
            Time of the start.
        params : mapping of str to array_like, optional
            Parameters in the place of those of the system.

        Returns
        -------
        dict of str to ndarray
            ``q`` and ``v``, shape (n,), for ``**m.start()`` of a call.

        Raises
        ------
        ValueError
            A loop cannot be closed, values contradict one another, nothing is free to move, or
            there is no such joint.
        """
        system = self._system or self.system(self._params)
        return system.assemble(values, rates, t=t, params=params)


def _plain(x: NDArray[np.float64]) -> Any:
    return x if x.ndim else float(x)
