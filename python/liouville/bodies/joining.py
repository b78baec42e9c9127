"""The methods of an assembly that add joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville.bodies.body import Body, Value, given, numbers, unit
from liouville.bodies.chaining import Chaining, Effort, Which
from liouville.bodies.friction import Coulomb, frictions
from liouville.bodies.joints import Joint
from liouville.bodies.registry import (
    apart,
    by_coordinate,
    check_damping,
    functions_of,
    pair_of,
    points_of,
    two_points,
)
from liouville.errors import hinted


class Joining(Chaining):
    """The joints of :class:`Assembly`.

    Everywhere, `at` is a point in the world as drawn, `(x, y, z)`, or two, one on each body, where
    the drawing is open; a function of the parameters is taken too. `axis` is a direction of any
    length, or two. An angle is that of b against a about the axis, a slide that of b along it,
    both zero as drawn. `damping` times the rate is a torque or force against it; `torque` and
    `force` are functions ``f(t, angle, rate, params)``; `spring` times the way from `rest` is one
    with an energy; `motion` is a function ``f(t, params)`` that the coordinate follows; `friction`
    is a :class:`~liouville.bodies.Coulomb` or a :class:`~liouville.bodies.Stribeck`.
    """

    def fixed(self, name: str, a: Which, b: Which, *, at: Any = None) -> Joint:
        """Fix b to a; `at` is the point that forces and torques are of, the centre of b."""
        of = f"joint '{name}'"
        _, body = self._sides(of, a, b)
        points = (body.at, body.at) if at is None else points_of(of, at)
        return self._add("fixed", name, (a, b), points)

    def revolute(
        self,
        name: str,
        a: Which,
        b: Which,
        *,
        at: Any,
        axis: ArrayLike,
        damping: Value = 0.0,
        torque: Effort | None = None,
        spring: Value = 0.0,
        rest: Value = 0.0,
        motion: Effort | None = None,
        friction: Coulomb | None = None,
    ) -> Joint:
        """Let b turn about an axis of a: a hinge."""
        return self._with_axis(
            "revolute",
            name,
            (a, b),
            at,
            axis,
            damping,
            torque,
            spring,
            rest,
            motion,
            friction=friction,
        )

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
        friction: Coulomb | None = None,
    ) -> Joint:
        """Let b slide along an axis of a, without turning; `at` is the centre of b by default."""
        body = self._body(b, f"joint '{name}'")
        at = body.at if at is None else at
        return self._with_axis(
            "prismatic",
            name,
            (a, b),
            at,
            axis,
            damping,
            force,
            spring,
            rest,
            motion,
            friction=friction,
        )

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
    ) -> Joint:
        """Let b turn about an axis of a and slide along it.

        `damping`, `spring`, `rest` and `motion` are pairs, of the angle and of the slide.
        """
        efforts = (torque, force)
        return self._with_axis(
            "cylindrical",
            name,
            (a, b),
            at,
            axis,
            damping,
            efforts,
            spring,
            rest,
            motion,
            friction=friction,
        )

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
    ) -> Joint:
        """Let b turn about an axis of a and slide along it by `lead` for each turn.

        `damping`, `spring`, `rest` and `motion` are pairs, of the angle and of the slide.
        """
        of = f"joint '{name}'"
        lead = given(f"lead= of {of}", lead, ())
        if not callable(lead) and lead == 0:
            raise ValueError(hinted(f"lead= of {of} is zero", "take a revolute joint"))
        pitch = (lambda p: lead(p) / (2 * np.pi)) if callable(lead) else lead / (2 * np.pi)
        acting = damping, (torque, force), spring, rest, motion, {"pitch": pitch}, friction
        return self._with_axis("screw", name, (a, b), at, axis, *acting)

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
        friction: Coulomb | None = None,
    ) -> Joint:
        """Let b turn about two axes that cross at a right angle, the first of a, the second of b.

        `damping`, `torque`, `spring`, `rest` and `motion` are pairs, of both angles.
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
            friction=frictions(of, "universal", friction),
            **_free(of, "universal", damping, torque, spring, rest, motion),
        )

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
        """Let b turn freely about a point of a; `damping` is against all angular velocities.

        `spring` times the least angle from b as drawn is a torque back, with an energy.
        """
        of = f"joint '{name}'"
        more = _free(of, "spherical", damping, None, 0.0, 0.0, None)
        more["friction"] = frictions(of, "spherical", friction)
        stiffness = given(f"spring= of {of}", spring, ())
        if callable(stiffness) or stiffness != 0:
            more["sizes"] = {"stiffness": stiffness}
        points = points_of(of, at)
        return self._add("spherical", name, (a, b), points, **more)

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
    ) -> Joint:
        """Let b turn about a normal of a and slide across it.

        `damping`, `effort`, `spring`, `rest` and `motion` have three entries, of the angle and of
        both slides.
        """
        more = damping, effort, spring, rest, motion
        return self._with_axis("planar", name, (a, b), at, normal, *more, friction=friction)

    def distance(
        self, name: str, a: Which, b: Which, *, at: Any, length: Value | None = None
    ) -> Joint:
        """Keep two points `at=(on a, on b)` at a length, as drawn by default: a massless rod."""
        of = f"joint '{name}'"
        points = two_points(of, at)
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

        ``equations(position, params)`` returns what vanishes there, two expressions of a curve, or
        one of a surface, of a position in the world as drawn; they move with a. The point is the
        centre of b by default.
        """
        of = f"joint '{name}'"
        first, second = self._sides(of, a, b)
        if not callable(equations):
            raise TypeError(f"equations of {of} are a function, not {equations!r}")
        point = second.at if at is None else given(f"at= of {of}", at, (3,))
        points, dry = (np.zeros(3), point), frictions(of, "guide", friction)
        return self._add("guide", name, (first, second), points, equations=equations, friction=dry)

    def free(self, name: str, b: Which) -> Joint:
        """Let b fly freely; its rates are its velocity and angular velocity."""
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

        The plane goes through `at`; `centre` is that of the ball or wheel, by default of its mass.
        The point of contact neither slips nor spins free of friction: it does not slip.
        """
        of = f"joint '{name}'"
        sides = self._sides(of, a, b)
        radius = given(f"radius= of {of}", radius, ())
        if not callable(radius) and not radius > 0:
            raise ValueError(f"radius= of {of} is {float(radius):g}, and wants to be positive")
        plane = unit(f"normal of {of}", normal)
        rim = plane if axis is None else unit(f"axis of {of}", axis)
        middle = sides[1].at if centre is None else given(f"centre= of {of}", centre, (3,))
        if axis is not None and abs(float(rim @ plane)) > 1 - 1e-12:
            raise ValueError(f"the wheel of {of} lies flat on its plane: it has no lowest point")
        return self._add(
            "rolling ball" if axis is None else "rolling wheel",
            name,
            (a, b),
            (given(f"at= of {of}", at, (3,)), middle),
            self._frames(of, *sides, axis=(plane, rim)),
            sizes={"radius": radius},
        )

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
        sizes: Mapping[str, Value] | None = None,
        friction: Coulomb | None = None,
    ) -> Joint:
        of = f"joint '{name}'"
        dry = frictions(of, kind, friction)
        a, b = self._sides(of, *sides)
        frames = self._frames(of, a, b, axis=axis)
        _check_plane(of, kind, a, b, pair_of(of, axis)[0])
        free = _free(of, kind, damping, effort, spring, rest, motion)
        more = {"sizes": dict(sizes or {}), "friction": dry, **free}
        return self._add(kind, name, sides, points_of(of, at), frames, **more)


def _free(
    of: str, kind: str, damping: Any, effort: Any, spring: Any, rest: Any, motion: Any
) -> dict[str, Any]:
    """Return what acts along the coordinates of a joint."""
    dampers = by_coordinate(of, kind, "damping", damping, 0.0)
    check_damping(of, dampers)
    efforts, motions = (
        functions_of(of, what, by_coordinate(of, kind, what, value, None))
        for what, value in (("torque= or force", effort), ("motion", motion))
    )
    stiffness = by_coordinate(of, kind, "spring", spring, 0.0)
    rests = by_coordinate(of, kind, "rest", rest, 0.0)
    springs = {name: (value, rests.get(name, 0.0)) for name, value in stiffness.items()}
    if kind == "screw" and len(motions) > 1:
        hint = "a screw turns as it slides: prescribe one of both"
        raise ValueError(hinted(f"motion= of {of} has two functions", hint))
    return {"damping": dampers, "springs": springs, "efforts": efforts, "motions": motions}


def _check_plane(of: str, kind: str, a: Body, b: Body, axis: NDArray[np.float64]) -> None:
    """Refuse an axis that bodies in a plane cannot turn about, or slide along."""
    if "planar" not in (a.kind, b.kind) or "spatial" in (a.kind, b.kind):
        return
    up = abs(float(axis[2]))
    fits = {"revolute": up > 1 - 1e-12, "planar": up > 1 - 1e-12, "prismatic": up < 1e-12}
    if not fits.get(kind, False):
        raise ValueError(
            hinted(
                f"{of} of '{a.name}' and '{b.name}' does not fit how these bodies move",
                "planar bodies turn about z and slide along directions across it",
            )
        )
