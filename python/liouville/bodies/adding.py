"""The methods of an assembly that add bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.errors import hinted
from liouville._systems.tracing import trace as _trace
from liouville.bodies import rotations as rot
from liouville.bodies.body import Body, Value, check_mass, column, given, numbers, unit
from liouville.bodies.registry import Registry, with_height


class Adding(Registry):
    """The bodies of :class:`Assembly`."""

    def body(
        self,
        name: str,
        *,
        mass: Value,
        inertia: Value,
        at: Value = (0.0, 0.0, 0.0),
        rotation: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    ) -> Body:
        """Add a rigid body.

        Parameters
        ----------
        name : str
            Its name.
        mass : float or callable
            Its mass.
        inertia : array_like, shape (3,) or (3, 3), or callable
            Moments of inertia about the centre of mass in the body's own axes, the principal ones
            or all.
        at : array_like, shape (3,), or callable, default (0, 0, 0)
            Its centre of mass as drawn.
        rotation : array_like, shape (4,), default (1, 0, 0, 0)
            Quaternion from its own axes to the world's as drawn, of any length.

        Returns
        -------
        Body
            For joints and elements.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already. A mass and an inertia that depend on
            parameters are checked by :meth:`system`.
        """
        what = f"body '{name}'"
        if not callable(inertia):
            matrix = _trace.numbers(inertia)
            shape = (3, 3) if matrix is not None and matrix.ndim == 2 else (3,)
            inertia = numbers(f"inertia of {what}", inertia, shape)
        return self._with(
            Body(
                self._new(name),
                "spatial",
                given(f"mass of {what}", mass, ()),
                inertia,
                given(f"at= of {what}", at, (3,)),
                tuple(unit(f"rotation of {what}", rotation, 4).tolist()),
            )
        )

    def point_mass(self, name: str, *, mass: Value, at: Value = (0.0, 0.0, 0.0)) -> Body:
        """Add a body without extent, which cannot turn.

        Parameters
        ----------
        name : str
            Its name.
        mass : float or callable
            Its mass.
        at : array_like, shape (3,), or callable, default (0, 0, 0)
            Its place as drawn.

        Returns
        -------
        Body
            For joints and elements.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        what = f"body '{name}'"
        mass, at = given(f"mass of {what}", mass, ()), given(f"at= of {what}", at, (3,))
        return self._with(Body(self._new(name), "point", mass, None, at))

    def planar_body(
        self, name: str, *, mass: Value, inertia: Value, at: Value = (0.0, 0.0), angle: float = 0.0
    ) -> Body:
        """Add a body that moves in a plane across z.

        Parameters
        ----------
        name : str
            Its name.
        mass : float or callable
            Its mass.
        inertia : float or callable
            Its moment of inertia about z through the centre of mass.
        at : array_like, shape (2,) or (3,), or callable, default (0, 0)
            Its centre of mass as drawn; the third number is the height of its plane.
        angle : float, default 0
            That of its own x against the world's as drawn, in radians.

        Returns
        -------
        Body
            For joints and elements.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        what = f"body '{name}'"
        place: Value
        if callable(at):
            place = with_height(at)
        else:
            flat = _trace.numbers(at)
            size = 3 if flat is not None and flat.shape == (3,) else 2
            place = np.append(numbers(f"at= of {what}", at, (size,)), np.zeros(3 - size))
        half = float(numbers(f"angle of {what}", angle, ())) / 2
        own = given(f"inertia of {what}", inertia, ())
        rotation = tuple(float(x) for x in rot.turn((0.0, 0.0, 1.0), 2 * half))
        mass = given(f"mass of {what}", mass, ())
        return self._with(Body(self._new(name), "planar", mass, own, place, rotation))

    def bar(
        self,
        name: str,
        a: ArrayLike,
        b: ArrayLike,
        *,
        mass: Value,
        radius: float = 0.0,
    ) -> Body:
        """Add a uniform round bar between two points, with its own x along it.

        Parameters
        ----------
        name : str
            Its name.
        a, b : array_like, shape (2,) or (3,)
            Its ends as drawn, of two numbers for a planar body, of three for a body in space.
        mass : float or callable
            Its mass.
        radius : float, default 0
            That of its cross section, which a body in space needs for its turns about itself.

        Returns
        -------
        Body
            For joints and elements.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.

        Examples
        --------
        >>> import liouville as lv
        >>> m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
        >>> m.bar("rod", (0, 0), (0.6, 0.8), mass=3.0)
        <Body 'rod'>
        >>> m.revolute("pin", m.ground, "rod", at=(0, 0))
        <Revolute 'pin' of 'ground' and 'rod'>
        """
        what = f"body '{name}'"
        flat = _trace.numbers(a)
        size = 2 if flat is not None and flat.shape == (2,) else 3
        first = numbers(f"the first end of {what}", a, (size,))
        along = numbers(f"the second end of {what}", b, (size,)) - first
        length = float(np.linalg.norm(along))
        direction = unit(f"the line between the ends of {what}", along, size)
        thick = float(numbers(f"radius of {what}", radius, ()))
        if thick < 0 or (size == 3 and thick == 0):
            sentence = f"radius of {what} must be positive, not {thick:g}"
            hint = "a bar without radius is planar: its ends have two numbers"
            raise ValueError(hinted(sentence, hint) if size == 3 else sentence)
        weight = given(f"mass of {what}", mass, ())
        across = (3 * thick**2 + length**2) / 12
        middle = first + along / 2
        if size == 2:
            angle = float(np.arctan2(direction[1], direction[0]))
            inertia = _scaled(weight, np.array(across))
            return self.planar_body(name, mass=weight, inertia=inertia, at=middle, angle=angle)
        inertia = _scaled(weight, np.array([thick**2 / 2, across, across]))
        turned = rot.between(np.array([1.0, 0.0, 0.0]), direction)
        return self.body(name, mass=weight, inertia=inertia, at=middle, rotation=turned)

    def _with(self, body: Body) -> Body:
        if not (callable(body.mass) or callable(body.inertia)):
            check_mass(body, None)
        self._bodies[body.name] = body
        return body


def _scaled(mass: Value, entries: NDArray[np.float64]) -> Value:
    """Return the mass times an inertia by mass, a function of the parameters if the mass is."""
    if callable(mass):
        return lambda params: column(mass, params, 1) * entries
    return mass * entries
