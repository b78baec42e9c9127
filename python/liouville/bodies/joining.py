"""The methods of an assembly that add joints with an axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import hinted
from liouville.bodies.body import Value, given, numbers
from liouville.bodies.chaining import Effort, Which
from liouville.bodies.dry import Dry, frictions
from liouville.bodies.friction import Coulomb
from liouville.bodies.joints import Joint
from liouville.bodies.linking import Linking
from liouville.bodies.registry import along, check_plane, is_flat, pair_of, points_of


class Joining(Linking):
    """The joints of :class:`Assembly` with an axis.

    Everywhere, `at` is a point in the world as drawn, `(x, y, z)`, at a planar body `(x, y)` too,
    or two points, one on each body, where the drawing is open; a function of the parameters does
    as well. `axis` is a direction of any
    length, or two. An angle is that of b against a about the axis, a slide that of b along it,
    both zero as drawn. `damping` times the rate is a torque or force against it; `torque` and
    `force` are functions ``f(t, angle, rate, params)``; `spring` times the way from `rest` is one
    with an energy; `motion` is a function ``f(t, params)`` that the coordinate follows; `friction`
    is a :class:`~liouville.bodies.Dry`, Coulomb or :class:`~liouville.bodies.Stribeck`; `limits`
    are values with stops, pairs or :class:`~liouville.bodies.Limits`.
    """

    def revolute(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        axis: ArrayLike = (0, 0, 1),
        damping: Value = 0.0,
        torque: Effort | None = None,
        spring: Value = 0.0,
        rest: Value = 0.0,
        motion: Effort | None = None,
        friction: Coulomb | Dry | None = None,
        limits: Any = None,
    ) -> Joint:
        """Let b turn about an axis of a: a hinge.

        The angle, in radians, is that of b against a, positive by the right hand about `axis`, zero
        as drawn.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable
            The joint's point in the world as drawn, or one on each body where the drawing is open.
        axis : array_like, shape (3,) or (2, 3), default (0, 0, 1)
            Its direction in the world as drawn, of any length, or one in each body.
        damping : float or callable, default 0
            Times the rate of the angle a torque against it, in N m s.
        torque : callable, optional
            ``f(t, angle, rate, params)``, on b along the axis; the opposite one acts on a.
        spring, rest : float or callable, default 0
            Stiffness, in N m / rad, and the angle at which it is without torque.
        motion : callable, optional
            ``f(t, params)``, the angle that the joint is made to follow.
        friction : Dry, Coulomb or Stribeck, optional
            Dry friction: of a given size, which sticks, or pressed by the joint's own reaction.
        limits : tuple of two, or Limits, optional
            The least and the largest value, each with a stop, or None.

        Returns
        -------
        Joint
            Its coordinate is ``angle``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        more = damping, torque, spring, rest, motion, limits
        return self._with_axis("revolute", name, (a, b), at, axis, *more, friction=friction)

    def prismatic(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        axis: ArrayLike,
        at: Any = None,
        damping: Value = 0.0,
        force: Effort | None = None,
        spring: Value = 0.0,
        rest: Value = 0.0,
        motion: Effort | None = None,
        friction: Coulomb | Dry | None = None,
        limits: Any = None,
    ) -> Joint:
        """Let b slide along an axis of a, without turning.

        The slide is the way of b against a along `axis`, zero as drawn.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        axis : array_like, shape (3,) or (2, 3)
            Its direction in the world as drawn, of any length, or one in each body.
        at : array_like, shape (3,) or (2, 3), or callable, optional
            The point that its force and torque are about, the centre of b by default.
        damping : float or callable, default 0
            Times the rate of the slide a force against it, in N s / m.
        force : callable, optional
            ``f(t, slide, rate, params)``, on b along the axis; the opposite one acts on a.
        spring, rest : float or callable, default 0
            Stiffness, in N / m, and the slide at which it is without force.
        motion : callable, optional
            ``f(t, params)``, the slide that the joint is made to follow.
        friction : Dry, Coulomb or Stribeck, optional
            Dry friction: of a given size, which sticks, or pressed by the joint's own reaction.
        limits : tuple of two, or Limits, optional
            The least and the largest value, each with a stop, or None.

        Returns
        -------
        Joint
            Its coordinate is ``slide``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        body = self._body(b, f"joint '{name}'")
        at = body.at if at is None else at
        more = damping, force, spring, rest, motion, limits
        return self._with_axis("prismatic", name, (a, b), at, axis, *more, friction=friction)

    def cylindrical(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        axis: ArrayLike,
        damping: Any = 0.0,
        torque: Effort | None = None,
        force: Effort | None = None,
        spring: Any = 0.0,
        rest: Any = 0.0,
        motion: Any = None,
        friction: Coulomb | None = None,
        limits: Any = None,
    ) -> Joint:
        """Let b turn about an axis of a and slide along it.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable
            The joint's point in the world as drawn, or one on each body where the drawing is open.
        axis : array_like, shape (3,) or (2, 3)
            Its direction in the world as drawn, of any length, or one in each body.
        damping, spring, rest, motion : sequence, optional
            As for :meth:`revolute` and :meth:`prismatic`: pairs, of the angle and of the slide.
        torque, force : callable, optional
            ``f(t, angle, rate, params)`` and ``f(t, slide, rate, params)``, on b.
        friction : Coulomb or Stribeck, optional
            Dry friction, pressed by the joint's own reaction.
        limits : sequence, optional
            For each coordinate a pair of values with stops, Limits or None.

        Returns
        -------
        Joint
            Its coordinates are ``angle`` and ``slide``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        efforts = (torque, force)
        more = damping, efforts, spring, rest, motion, limits
        return self._with_axis("cylindrical", name, (a, b), at, axis, *more, friction=friction)

    def screw(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        axis: ArrayLike,
        lead: Value,
        damping: Any = 0.0,
        torque: Effort | None = None,
        force: Effort | None = None,
        spring: Any = 0.0,
        rest: Any = 0.0,
        motion: Any = None,
        friction: Coulomb | None = None,
        limits: Any = None,
    ) -> Joint:
        """Let b turn about an axis of a and slide along it by `lead` for each turn.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable
            The joint's point in the world as drawn, or one on each body where the drawing is open.
        axis : array_like, shape (3,) or (2, 3)
            Its direction in the world as drawn, of any length, or one in each body.
        lead : float or callable
            The slide of one turn, positive for a thread of the right hand; not zero.
        damping, spring, rest, motion : sequence, optional
            As for :meth:`revolute` and :meth:`prismatic`: pairs, of the angle and of the slide;
            of `motion` one of both is None.
        torque, force : callable, optional
            ``f(t, angle, rate, params)`` and ``f(t, slide, rate, params)``, on b.
        friction : Coulomb or Stribeck, optional
            Dry friction, pressed by the joint's own reaction.
        limits : sequence, optional
            For each coordinate a pair of values with stops, Limits or None.

        Returns
        -------
        Joint
            Its coordinates are ``angle`` and ``slide``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"joint '{name}'"
        lead = given(f"lead= of {of}", lead, ())
        if not callable(lead) and lead == 0:
            raise ValueError(hinted(f"lead= of {of} is zero", "take a revolute joint"))
        pitch = (lambda p: lead(p) / (2 * np.pi)) if callable(lead) else lead / (2 * np.pi)
        acting = damping, (torque, force), spring, rest, motion, limits
        more = {"pitch": pitch}, friction
        return self._with_axis("screw", name, (a, b), at, axis, *acting, *more)

    def universal(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        axes: ArrayLike,
        damping: Any = 0.0,
        torque: Any = None,
        spring: Any = 0.0,
        rest: Any = 0.0,
        motion: Any = None,
        friction: Coulomb | Dry | None = None,
        limits: Any = None,
    ) -> Joint:
        """Let b turn about two axes that cross at a right angle, the first of a, the second of b.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable
            The joint's point in the world as drawn, or one on each body where the drawing is open.
        axes : array_like, shape (2, 3)
            The axis in a and that in b, in the world as drawn.
        damping, torque, spring, rest, motion : sequence, optional
            As for :meth:`revolute`: pairs, of both angles.
        friction : Dry, Coulomb or Stribeck, optional
            Dry friction: of a given size, which sticks, or pressed by the joint's own reaction.
        limits : sequence, optional
            For each coordinate a pair of values with stops, Limits or None.

        Returns
        -------
        Joint
            Its coordinates are ``angle`` and ``second angle``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"joint '{name}'"
        first, second = pair_of(of, numbers(f"axes= of {of}", axes, (2, 3)))
        if abs(float(first @ second)) > 1e-9:
            raise ValueError(f"the two axes of {of} do not cross at a right angle")
        frames = self._frames(of, *self._sides(of, a, b), axis=first, x=second)
        return self._add(
            "universal",
            name,
            (a, b),
            points_of(of, at),
            frames,
            **frictions(of, "universal", friction),
            **along(of, "universal", damping, torque, spring, rest, motion, limits),
        )

    def planar(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        normal: ArrayLike,
        damping: Any = 0.0,
        effort: Any = None,
        spring: Any = 0.0,
        rest: Any = 0.0,
        motion: Any = None,
        friction: Coulomb | None = None,
        limits: Any = None,
    ) -> Joint:
        """Let b turn about a normal of a and slide across it.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Its bodies, or their names.
        at : array_like, shape (3,) or (2, 3), or callable
            The joint's point in the world as drawn, or one on each body where the drawing is open.
        normal : array_like, shape (3,) or (2, 3)
            Its direction in the world as drawn, of any length, or one in each body.
        damping, effort, spring, rest, motion : sequence, optional
            Three entries, of the angle and of both slides, as for :meth:`revolute`.
        friction : Coulomb or Stribeck, optional
            Dry friction, pressed by the joint's own reaction.
        limits : sequence, optional
            For each coordinate a pair of values with stops, Limits or None.

        Returns
        -------
        Joint
            Its coordinates are ``angle``, ``slide_x`` and ``slide_y``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        more = damping, effort, spring, rest, motion, limits
        return self._with_axis("planar", name, (a, b), at, normal, *more, friction=friction)

    def _with_axis(
        self,
        kind: str,
        name: str,
        sides: tuple[Which, Which],
        at: Any,
        axis: Any,
        damping: Any = 0.0,
        effort: Any = None,
        spring: Any = 0.0,
        rest: Any = 0.0,
        motion: Any = None,
        limits: Any = None,
        sizes: Mapping[str, Value] | None = None,
        friction: Coulomb | Dry | None = None,
    ) -> Joint:
        of = f"joint '{name}'"
        rubs = frictions(of, kind, friction)
        a, b = self._sides(of, *sides)
        frames = self._frames(of, a, b, axis=axis)
        check_plane(of, kind, a, b, pair_of(of, axis)[0])
        free = along(of, kind, damping, effort, spring, rest, motion, limits)
        more = {"sizes": dict(sizes or {}), **rubs, **free}
        return self._add(kind, name, sides, points_of(of, at, is_flat(a, b)), frames, **more)
