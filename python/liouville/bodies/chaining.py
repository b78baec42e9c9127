"""The methods of an assembly that add compound joints, and relations between joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import hinted
from liouville.bodies import rotations as rot
from liouville.bodies.adding import Adding
from liouville.bodies.body import Body, Value, check_size, given, numbers, unit
from liouville.bodies.dry import frictions_of_axes
from liouville.bodies.joints import RATES, Axis, Joint
from liouville.bodies.limits import check_motion, limits_of
from liouville.bodies.registry import check_damping, coordinate_values, functions_of

Which = Body | str
Effort = Callable[..., Any]


@dataclass(frozen=True, eq=False)
class Gear:
    """A relation between joints: the sum of factors times values is zero, or that of the rates."""

    name: str
    ratios: Mapping[tuple[str, str], Value]

    @property
    def uses(self) -> set[str]:
        """The joints that it relates."""
        return {joint for joint, _ in self.ratios}

    @property
    def joints(self) -> tuple[tuple[str, str], ...]:
        """Joints and coordinates whose values it relates, none where one has a rate alone."""
        has_values = all(coordinate not in RATES for _, coordinate in self.ratios)
        return tuple(self.ratios) if has_values else ()


@dataclass(frozen=True, eq=False)
class Coupling:
    """A relation between values of joints: the first is a polynomial of the second, or constant."""

    name: str
    joints: tuple[tuple[str, str], ...]
    coefficients: tuple[float, ...]

    @property
    def uses(self) -> set[str]:
        """The joints that it relates."""
        return {joint for joint, _ in self.joints}


class Chaining(Adding):
    """Compound joints, gears and couplings of :class:`Assembly`."""

    def compound(
        self,
        name: str,
        a: Which,
        b: Which,
        axes: Sequence[tuple[Any, ...]],
        *,
        names: Sequence[str] | None = None,
        armature: Any = 0.0,
        damping: Any = 0.0,
        effort: Any = None,
        spring: Any = 0.0,
        rest: Any = 0.0,
        motion: Any = None,
        friction: Any = None,
        limits: Any = None,
    ) -> Joint:
        """Let b turn about and slide along several axes, each carried by those before.

        Coordinates are unknowns of their own, which count turns. A rotor on an axis adds to the
        energy half of its inertia times the square of the rate.

        Parameters
        ----------
        name : str
            Its name.
        a, b : Body or str
            Bodies in space, or the ground.
        axes : sequence
            From a to b, ``("turn", direction, point)`` or ``("slide", direction)``, in the world as
            drawn.
        names : sequence of str, optional
            Names of the coordinates, by default "angle" or "slide" of one axis, "turn 1" or
            "slide 2" of several.
        armature, damping, effort, spring, rest, motion, friction, limits : optional
            Of the only coordinate, or a sequence with one each: inertia of a rotor, coefficient of
            a damper, a function ``f(t, angle, rate, params)``, stiffness, and where it rests; a
            function ``f(t, params)`` that the coordinate follows; a
            :class:`~liouville.bodies.Dry`, or a :class:`~liouville.bodies.Coulomb` that is pressed
            by the joint's force across the axis; a pair of values with stops, or
            :class:`~liouville.bodies.Limits`.

        Returns
        -------
        Joint
            Its force and torque are all that b needs, along the axes too.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong.
        """
        of = f"joint '{name}'"
        sides = self._sides(of, a, b)
        for body in sides:
            if body.kind not in ("spatial", "ground"):
                raise ValueError(f"{of} joins bodies in space, and '{body.name}' is {body.kind}")
        words = [x[0] if isinstance(x, Sequence) and x else None for x in axes]
        if not words or set(words) - {"turn", "slide"}:
            raise ValueError(
                hinted(
                    f"axes of {of} are {axes!r}",
                    "write ('turn', direction, point) or ('slide', direction)",
                )
            )
        if names is None:
            single = "angle" if words == ["turn"] else "slide"
            names = [f"{word} {k + 1}" for k, word in enumerate(words)]
            names = [single] if len(words) == 1 else names
        _check_names(of, names, len(words))
        found = [self._axis(of, sides, own, x) for own, x in zip(names, axes, strict=True)]
        turns = [axis.point for axis in found if axis.turns]
        at = turns[-1] if turns else sides[1].at
        dampers = coordinate_values(of, names, "damping", damping, 0.0)
        check_damping(of, dampers)
        rotors = coordinate_values(of, names, "armature", armature, 0.0)
        for own, value in rotors.items():
            check_size(f"armature of '{own}' of {of}", "armature", value)
        angles = [axis.name for axis in found if axis.turns]
        efforts, motions = (
            functions_of(of, what, coordinate_values(of, names, what, value, None), angles)
            for what, value in (("effort", effort), ("motion", motion))
        )
        rests = coordinate_values(of, names, "rest", rest, 0.0)
        stiffness = coordinate_values(of, names, "spring", spring, 0.0)
        stops = limits_of(of, names, limits)
        check_motion(of, stops, motions)
        return self._add(
            "compound",
            name,
            sides,
            (at, at),
            axes=tuple(found),
            armature=rotors,
            damping=dampers,
            efforts=efforts,
            motions=motions,
            springs={own: (value, rests.get(own, 0.0)) for own, value in stiffness.items()},
            limits=stops,
            **frictions_of_axes(of, {axis.name: axis.turns for axis in found}, friction),
        )

    def _axis(self, of: str, sides: tuple[Body, Body], name: str, axis: Any) -> Axis:
        turns = axis[0] == "turn"
        if len(axis) != (3 if turns else 2):
            wanted = "('turn', direction, point)" if turns else "('slide', direction)"
            raise ValueError(hinted(f"an axis of {of} is {axis!r}", f"write {wanted}"))
        direction = unit(f"direction of '{name}' of {of}", axis[1])
        own = rot.rotate(rot.conjugate(sides[0].rotation), direction)
        point = given(f"point of '{name}' of {of}", axis[2], (3,)) if turns else np.zeros(3)
        return Axis(name, turns, tuple(float(x) for x in own), point)

    def gear(self, name: str, ratios: Mapping[str, Value]) -> None:
        """Keep the sum of factors times values of joints at zero: a gear, a rack, a differential.

        Values are zero as drawn, angles count turns, and so the phase of the teeth is kept. Where
        a joint has rates alone, as a ball joint has, it is the sum of factors times rates.
        Factors of equal signs make the joints turn opposite ways, as wheels outside each other do.

        Parameters
        ----------
        name : str
            Its name; ``solution.reaction(name)`` has its force or torque on each coordinate.
        ratios : mapping of str to float or callable
            Factors by joint, two or more: ``{"A": 20, "B": 31}`` of wheels with these numbers of
            teeth, or their radii; of joints with more rates the first is meant. A rack takes its
            wheel's radius and -1, or 1 where it runs the other way.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or the name is there already.
        """
        of = f"gear '{name}'"
        if not isinstance(ratios, Mapping) or len(ratios) < 2:
            raise TypeError(
                f"{of} takes factors by the names of two joints or more, not {ratios!r}"
            )
        found = {}
        for joint, factor in ratios.items():
            own = self._coordinate(of, joint)
            if own in found:
                raise ValueError(f"{of} has two factors for '{own[1]}' of joint '{own[0]}'")
            found[own] = given(f"factor of {of}", factor, ())
            if not callable(factor) and factor == 0:
                sentence = f"factor of joint '{own[0]}' in {of} must not be zero"
                raise ValueError(
                    hinted(sentence, "a joint that the gear does not turn is left out")
                )
        self._gears[self._new(name)] = Gear(name, found)

    def couple(self, name: str, joint: Any, other: Any = None, *, by: ArrayLike) -> None:
        """Keep a coordinate at a polynomial of another, or at a constant without another.

        Parameters
        ----------
        name : str
            The name of this constraint; its multiplier is the effort against the first coordinate.
        joint, other : str or tuple of str
            A joint, of which the first coordinate is meant, or the joint and the coordinate.
        by : array_like
            Coefficients of the polynomial from the constant on; values are zero as drawn.

        Raises
        ------
        TypeError, ValueError
            There is no such joint or coordinate, or it is a rate without a value.
        """
        of = f"coupling '{name}'"
        pair = [self._coordinate(of, x) for x in (joint, other) if x is not None]
        for own, coordinate in pair:
            if coordinate in RATES:
                raise ValueError(f"'{coordinate}' of joint '{own}' has no value for {of}")
        if len(set(pair)) < len(pair):
            raise ValueError(f"{of} couples joint '{pair[0][0]}' with itself")
        coefficients = numbers(f"by= of {of}", by, (max(np.size(by), 1),))
        if other is None and coefficients[1:].any():
            raise ValueError(f"{of} has a polynomial of no other joint")
        self._gears[self._new(name)] = Coupling(name, tuple(pair), tuple(coefficients.tolist()))

    def _coordinate(self, of: str, which: Any) -> tuple[str, str]:
        """Return a joint and a coordinate of it, the first by default, by their names."""
        joint, coordinate = which if isinstance(which, tuple) else (which, None)
        if joint not in self._joints:
            known = ", ".join(self._joints) or "none"
            raise ValueError(hinted(f"{of} has no joint {joint!r}", f"joints are {known}"))
        own = self._joints[joint].coordinates
        if not own:
            raise ValueError(f"joint '{joint}' has no rate that {of} could take")
        if coordinate is not None and coordinate not in own:
            sentence = f"{of}: joint '{joint}' has no {coordinate!r}"
            raise ValueError(hinted(sentence, f"its coordinates are {', '.join(own)}"))
        return joint, coordinate or own[0]


def _check_names(of: str, names: Any, count: int) -> None:
    good = isinstance(names, Sequence) and all(isinstance(x, str) and x for x in names)
    if not good or len(set(names)) != count or len(names) != count:
        raise ValueError(f"names= of {of} must be {count} different names, not {names!r}")
    if bad := set(names) & set(RATES):
        raise ValueError(f"names= of {of}: {min(bad)!r} is the name of a rate")
