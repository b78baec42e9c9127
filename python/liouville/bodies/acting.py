"""The methods of an assembly that add springs, beams and forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tracing import trace as _trace
from liouville.bodies.body import Value, check_size, column, given, numbers, unit
from liouville.bodies.chaining import Which
from liouville.bodies.elements import Element, beam_stiffness, check_matrix
from liouville.bodies.joining import Joining
from liouville.bodies.registry import Frames, apart, is_flat, place_of, points_of, tried, two_points

#: Sizes of what the function of a force or a torque is given, by name.
FUNCTIONS = {
    "force": {"t": 1, "position": 3, "velocity": 3},
    "torque": {"t": 1, "angular_velocity": 3},
}


class Acting(Joining):
    """The elements of :class:`Assembly`: what acts between bodies without holding them."""

    def spring(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        stiffness: Value,
        rest: Value | None = None,
        damping: Value = 0.0,
    ) -> Element:
        """Add a spring between two points, with a damper along it.

        It pulls by stiffness times what it is longer than at rest. It must not shrink to length
        zero, but with ``rest=0`` and no damping, whose force :math:`-k d` needs no direction.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : sequence of two
            A point on a and one on b, each of shape (3,) or callable, in the world as drawn.
        stiffness : float or callable
            In N / m.
        rest : float or callable, optional
            Its length without force; that as drawn by default.
        damping : float or callable, default 0
            Times the rate of its length a force against it, in N s / m.

        Returns
        -------
        Element
            The spring.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"spring '{name}'"
        points = two_points(of, at, is_flat(*self._sides(of, a, b)))
        length = apart(points)
        values = {
            "stiffness": given(f"stiffness= of {of}", stiffness, ()),
            "rest": length if rest is None else given(f"rest= of {of}", rest, ()),
            "damping": given(f"damping= of {of}", damping, ()),
        }
        check_size(f"rest= of {of}", "rest length", values["rest"])
        check_size(f"damping= of {of}", "damping", values["damping"])
        is_smooth = rest is not None and not any(
            callable(values[x]) or values[x] for x in ("rest", "damping")
        )
        if not callable(length) and length == 0 and not is_smooth:
            sentence = f"the points of {of} coincide: its direction is not defined"
            raise ValueError(hinted(sentence, "rest=0 without damping= needs none"))
        return self._act("spring", name, (a, b), points, values)

    def damper(self, name: str, a: Which, b: Which, *, at: Any, damping: Value) -> Element:
        """Add a damper along the line between two points.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : sequence of two
            A point on a and one on b, each of shape (3,) or callable, in the world as drawn.
        damping : float or callable
            Times the rate of their distance a force against it, in N s / m.

        Returns
        -------
        Element
            The damper.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        return self.spring(name, a, b, at=at, stiffness=0.0, damping=damping)

    def bushing(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        stiffness: Value,
        damping: Value = (0.0,) * 6,
        axis: ArrayLike = (0.0, 0.0, 1.0),
    ) -> Element:
        """Hold b by stiffness in all directions of a frame of a with the third axis `axis`.

        Turns are measured by twice the vector part of the quaternion: forces are those of a
        rotation vector up to its third power.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable
            The joint's point in the world as drawn, or one on each body where the drawing is open.
        stiffness, damping : array_like, shape (6,) or (6, 6), or callable
            Of three shifts, in N / m, and of three turns, in N m / rad; a symmetric matrix such as
            that of a beam. Damping, zero by default, is the same over a rate.
        axis : array_like, shape (3,), default (0, 0, 1)
            The third axis of its frame in the world as drawn.

        Returns
        -------
        Element
            The bushing.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"bushing '{name}'"
        values = {}
        for what, value in (("stiffness", stiffness), ("damping", damping)):
            found = None if callable(value) else _trace.numbers(value)
            shape = (6, 6) if found is not None and found.ndim == 2 else (6,)
            values[what] = given(f"{what}= of {of}", value, shape)
            if not callable(values[what]):
                check_matrix(f"{what}= of {of}", what, values[what])
        sides = self._sides(of, a, b)
        frames = self._frames(of, *sides, axis=axis)
        points = points_of(of, at, is_flat(*sides))
        return self._act("bushing", name, sides, points, values, frames)

    def beam(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        axial: Value,
        bending: Any,
        torsion: Value,
        across: ArrayLike | None = None,
        damping: Value = 0.0,
    ) -> Element:
        """Hold b by a straight beam without mass from a, between points `at=(on a, on b)`.

        It is that of Euler and Bernoulli, straight as drawn, for small turns of b against a.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies.
        at : sequence
            Both of its ends in the world as drawn.
        axial, torsion : float or callable
            Its stiffnesses EA and GJ.
        bending : float, callable or pair of them
            EI about any axis, or about `across` and about the third direction.
        across : array_like, shape (3,), optional
            A direction across the beam.
        damping : float or callable, default 0
            Time that its damping matrix is in times of its stiffness.

        Returns
        -------
        Element
            The beam.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong.
        """
        of = f"beam '{name}'"
        points = two_points(of, at)
        ends = [numbers(f"at= of {of}", point, (3,)) for point in points]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        along = unit(f"the line between the ends of {of}", ends[1] - ends[0])
        x = None
        if across is not None:
            given_x = unit(f"across= of {of}", across)
            x = unit(f"across= of {of}, beside the beam,", given_x - (given_x @ along) * along)
        pair = bending if isinstance(bending, Sequence | np.ndarray) else (bending, bending)
        if len(pair) != 2:
            raise ValueError(f"bending= of {of} must be one stiffness or two, not {bending!r}")
        names = ("axial", "bending", "bending", "torsion", "damping")
        sizes = [
            given(f"{what}= of {of}", value, ())
            for what, value in zip(names, (axial, *pair, torsion, damping), strict=True)
        ]
        for what, value in zip(names, sizes, strict=True):
            check_size(f"{what}= of {of}", "damping", value)  # none of them is negative

        def stiffness(params: Any) -> ca.SX:
            own = [column(value, params, 1) for value in sizes[:4]]
            return beam_stiffness(length, *own)

        values = {
            "stiffness": stiffness,
            "damping": lambda params: column(sizes[4], params, 1) * stiffness(params),
            "length": np.array(length),
        }
        frames = self._frames(of, *self._sides(of, a, b), axis=along, x=x)
        return self._act("beam", name, (a, b), points, values, frames)

    def force(
        self, name: str, body: Which, force: Callable[..., Any], *, at: Any = None
    ) -> Element:
        """Let a force act at a point of a body.

        Parameters
        ----------
        name : str
            Its name.
        body : Body or str
            The body.
        force : callable
            ``force(t, position, velocity, params)`` returns three components in the world, of the
            position and velocity of the point there.
        at : array_like, shape (3,), of a planar body (2,), or callable, optional
            The point as drawn, the centre of mass by default.

        Returns
        -------
        Element
            The force.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        own = self._body(body, f"force '{name}'")
        flat = own.kind == "planar"
        place = own.at if at is None else place_of(f"at= of force '{name}'", at, flat)
        return self._act("force", name, (self.ground, own), (place, place), {}, function=force)

    def torque(self, name: str, body: Which, torque: Callable[..., Any]) -> Element:
        """Let a torque act on a body.

        Parameters
        ----------
        name : str
            Its name.
        body : Body or str
            The body.
        torque : callable
            ``torque(t, angular_velocity, params)`` returns three components in the world, of the
            angular velocity there.

        Returns
        -------
        Element
            The torque.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        own = self._body(body, f"torque '{name}'")
        place = own.at
        return self._act("torque", name, (self.ground, own), (place, place), {}, function=torque)

    def _act(
        self,
        kind: str,
        name: str,
        sides: tuple[Which, Which],
        points: tuple[Value, Value],
        values: Mapping[str, Value],
        frames: Frames | None = None,
        function: Any = None,
    ) -> Element:
        of = f"{kind} '{name}'"
        if kind in FUNCTIONS:
            tried(of, function, FUNCTIONS[kind], 3)
        a, b = self._sides(of, *sides)
        own = frames or self._frames(of, a, b)
        element = Element(self._new(name), kind, a, b, points, own, values, function)
        self._elements[name] = element
        return element
