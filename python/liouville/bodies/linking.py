"""The methods of an assembly that add joints without an axis: balls, rods, guides, rolling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import hinted
from liouville.bodies.body import Value, check_rows, check_size, given, unit
from liouville.bodies.chaining import Chaining, Which
from liouville.bodies.dry import frictions
from liouville.bodies.friction import Coulomb
from liouville.bodies.joints import Joint
from liouville.bodies.registry import (
    along,
    apart,
    check_plane,
    is_flat,
    points_of,
    tried,
    two_points,
)

#: Sizes of what the equations of a guide are given, by name.
AT_PLACE = {"position": 3}


class Linking(Chaining):
    """The joints of :class:`Assembly` that have no axis to turn about or slide along."""

    def fixed(self, name: str, a: Which, b: Which, *, at: Any = None) -> Joint:
        """Fix b to a.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable, optional
            The point that its force and torque are about, the centre of b by default.

        Returns
        -------
        Joint
            It has no coordinates.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"joint '{name}'"
        one, body = self._sides(of, a, b)
        points = (body.at, body.at) if at is None else points_of(of, at, is_flat(one, body))
        return self._add("fixed", name, (a, b), points)

    def spherical(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        damping: Value = 0.0,
        spring: Value = 0.0,
        friction: Coulomb | None = None,
    ) -> Joint:
        """Let b turn freely about a point of a: a ball joint.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable
            The joint's point in the world as drawn, or one on each body where the drawing is open.
        damping : float or callable, default 0
            Times the angular velocity of b against a a torque against it, in N m s.
        spring : float or callable, default 0
            Times the least angle from b as drawn a torque back, with an energy, in N m / rad. At
            half a turn it changes sides: steps that follow an error end there, others lose order.
        friction : Coulomb or Stribeck, optional
            Dry friction, pressed by the joint's own reaction.

        Returns
        -------
        Joint
            Its rates ``spin_x``, ``spin_y``, ``spin_z`` are about the axes of the world.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"joint '{name}'"
        more = along(of, "spherical", damping, None, 0.0, 0.0, None)
        more |= frictions(of, "spherical", friction)
        stiffness = given(f"spring= of {of}", spring, ())
        if callable(stiffness) or stiffness != 0:
            more["sizes"] = {"stiffness": stiffness}
        points = points_of(of, at, is_flat(*self._sides(of, a, b)))
        return self._add("spherical", name, (a, b), points, **more)

    def distance(
        self, name: str, a: Which, b: Which, *, at: Any, length: Value | None = None
    ) -> Joint:
        """Keep two points at a length: a rod without mass.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : sequence of two
            A point on a and one on b, each of shape (3,) or callable, in the world as drawn.
        length : float or callable, optional
            Their distance, positive; that as drawn by default.

        Returns
        -------
        Joint
            It has no coordinates.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"joint '{name}'"
        points = two_points(of, at, is_flat(*self._sides(of, a, b)))
        length = apart(points) if length is None else given(f"length= of {of}", length, ())
        if not callable(length) and not length > 0:
            hint = "points that coincide take a spherical joint"
            raise ValueError(hinted(f"length= of {of} is {float(length):g}", hint))
        return self._add("distance", name, (a, b), points, sizes={"length": length})

    def guide(
        self,
        name: str,
        a: Which,
        b: Which,
        equations: Callable[..., Any],
        *,
        at: Any = None,
        friction: Coulomb | None = None,
    ) -> Joint:
        """Keep a point of b on a curve or a surface of a.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        equations : callable
            ``equations(position, params)`` returns what vanishes there, two expressions of a curve,
            or one of a surface, of a position in the world as drawn; they move with a.
        at : array_like, shape (3,), or callable, optional
            The point of b as drawn, its centre by default.
        friction : Coulomb or Stribeck, optional
            Dry friction, pressed by the joint's own reaction.

        Returns
        -------
        Joint
            Its rates ``move_x``, ``move_y``, ``move_z`` are the velocity of the point against a,
            in the world.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"joint '{name}'"
        first, second = self._sides(of, a, b)
        check_rows(f"equations of {of}", tried(f"equations of {of}", equations, AT_PLACE, None))
        point = second.at if at is None else given(f"at= of {of}", at, (3,))
        points, rubs = (np.zeros(3), point), frictions(of, "guide", friction)
        return self._add("guide", name, (first, second), points, equations=equations, **rubs)

    def free(self, name: str, b: Which) -> Joint:
        """Let b fly freely.

        Parameters
        ----------
        name : str
            Its name.
        b : Body or str
            The body.

        Returns
        -------
        Joint
            Its rates ``move_x``, ``move_y``, ``move_z`` are the velocity of the centre of b, and
            ``spin_x``, ``spin_y``, ``spin_z`` its angular velocity about the axes of the world.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        body = self._body(b, f"joint '{name}'")
        return self._add("free", name, (self.ground, body), (np.zeros(3), body.at))

    def rolling(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        radius: Value,
        at: ArrayLike = (0.0, 0.0, 0.0),
        normal: ArrayLike = (0.0, 0.0, 1.0),
        axis: ArrayLike | None = None,
        centre: Any = None,
    ) -> Joint:
        """Let b, a ball or with `axis` a wheel with a sharp rim, roll on a plane of a.

        The point of contact does not slip; turning about the normal is free. Planar bodies roll on
        a line, with a normal in their plane and the axis along z.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        radius : float or callable
            Of the ball or wheel, positive.
        at : array_like, shape (3,)
            A point of the plane in the world as drawn.
        normal : array_like, shape (3,)
            Its normal, to the side that b is on.
        axis : array_like, shape (3,), optional
            That of a wheel as drawn; not along the normal.
        centre : array_like, shape (3,), or callable, optional
            That of the ball or wheel, by default its centre of mass.

        Returns
        -------
        Joint
            Its rates ``spin_x``, ``spin_y``, ``spin_z`` are about the axes of the world.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"joint '{name}'"
        sides = self._sides(of, a, b)
        radius = given(f"radius= of {of}", radius, ())
        check_size(f"radius= of {of}", "radius", radius)
        plane = unit(f"normal of {of}", normal)
        rim = plane if axis is None else unit(f"axis of {of}", axis)
        middle = sides[1].at if centre is None else given(f"centre= of {of}", centre, (3,))
        if axis is not None and abs(float(rim @ plane)) > 1 - 1e-12:
            raise ValueError(f"the wheel of {of} lies flat on its plane: it has no lowest point")
        check_plane(of, "rolling", *sides, plane)
        if axis is not None:
            check_plane(of, "revolute", *sides, rim)
        return self._add(
            "rolling ball" if axis is None else "rolling wheel",
            name,
            (a, b),
            (given(f"at= of {of}", at, (3,)), middle),
            self._frames(of, *sides, axis=(plane, rim)),
            sizes={"radius": radius},
        )
