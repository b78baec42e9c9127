"""Names, bodies, points and directions of an assembly, checked as they are given."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, quoted
from liouville._systems.tracing import trace as _trace
from liouville.bodies import rotations as rot
from liouville.bodies.body import (
    Body,
    Value,
    check_size,
    column,
    given,
    resolved,
    spot,
    unit,
)
from liouville.bodies.elements import Element
from liouville.bodies.joints import ANGLES, KINDS, RATES, Joint
from liouville.bodies.limits import check_motion, limits_of

Z = (0.0, 0.0, 1.0)
#: Kinds of joints about a point that one of the bodies turns about.
TURNING = ("revolute", "universal", "spherical")
Frames = tuple[tuple[float, ...], tuple[float, ...]]


class Registry:
    """The base of :class:`Assembly`: what has been added, by name."""

    def __init__(self) -> None:
        self.ground = Body("ground", "ground", at=np.zeros(3))
        self._bodies: dict[str, Body] = {"ground": self.ground}
        self._joints: dict[str, Joint] = {}
        self._elements: dict[str, Element] = {}
        self._gears: dict[str, Any] = {}
        self._touches: dict[str, Any] = {}

    def _changed(self) -> None:
        """Note that something was added."""

    def _new(self, name: Any) -> str:
        """Return a name that nothing has yet."""
        if not isinstance(name, str) or not name:
            raise TypeError(f"a body, joint or element has a name, not {name!r}")
        kinds = ("body", self._bodies), ("joint", self._joints), ("element", self._elements)
        for kind, known in (*kinds, ("gear", self._gears), ("contact", self._touches)):
            if name in known:
                article = "an" if kind == "element" else "a"
                sentence = f"there is {article} {kind} called '{name}' already"
                hint = f"m.remove({name!r}) takes it out of the assembly m"
                raise ValueError(hinted(sentence, hint) if name != "ground" else sentence)
        self._changed()
        return name

    def remove(self, name: str) -> None:
        """Take a body, joint, element, gear, coupling or contact out again: its name is free then.

        Parameters
        ----------
        name : str
            Its name.

        Raises
        ------
        ValueError
            There is nothing of this name, or something that is left needs it.
        """
        kinds = (self._bodies, self._joints, self._elements, self._gears, self._touches)
        known = next((own for own in kinds if name in own and name != "ground"), None)
        if known is None:
            there = quoted([x for own in kinds for x in own if x != "ground"]) or "nothing"
            raise ValueError(hinted(f"the assembly has no {name!r}", f"there is {there}"))
        held: list[Any] = [*self._joints.values(), *self._elements.values()]
        held += self._touches.values()
        users = [x.name for x in held if name in (x.a.name, x.b.name) and known is self._bodies]
        users += [x.name for x in self._gears.values() if name in x.uses and known is self._joints]
        if users:
            sentence = f"{quoted(users)} {'needs' if len(users) == 1 else 'need'} {name!r}"
            raise ValueError(hinted(sentence, f"m.remove({users[0]!r}) first"))
        del known[name]
        self._changed()

    def _body(self, body: Any, of: str) -> Body:
        """Return a body of this assembly, given itself or by name."""
        if isinstance(body, str):
            if body in self._bodies:
                return self._bodies[body]
            known = quoted(tuple(self._bodies))
            raise ValueError(hinted(f"{of} joins {body!r}, which is no body", f"there are {known}"))
        if not isinstance(body, Body):
            raise TypeError(f"{of} joins bodies of the assembly, or their names, not {body!r}")
        if self._bodies.get(body.name) is not body:
            raise ValueError(f"{of} joins {body!r}, which belongs to another assembly")
        return body

    def _sides(self, of: str, a: Any, b: Any) -> tuple[Body, Body]:
        """Return two different bodies."""
        first, second = self._body(a, of), self._body(b, of)
        if first is second:
            raise ValueError(f"{of} joins '{first.name}' with itself")
        return first, second

    def _add(
        self,
        kind: str,
        name: str,
        sides: tuple[Any, Any],
        points: tuple[Value, Value],
        frames: Frames | None = None,
        **more: Any,
    ) -> Joint:
        """Add a joint."""
        of = f"joint '{name}'"
        a, b = self._sides(of, *sides)
        if kind in TURNING and {a.kind, b.kind} <= {"point", "ground"}:
            point = (b if b.kind == "point" else a).name
            hint = "take a body, or a rod without mass: m.distance"
            raise ValueError(hinted(f"{of} would turn '{point}', a point mass, which cannot", hint))
        both = {*more.get("dry", ())} & {*more.get("motions", ())}
        if both:
            sentence = f"'{min(both)}' of {of} has both friction= and motion="
            raise ValueError(
                hinted(sentence, "a motion that is given does not stick: leave one out")
            )
        joint = Joint(self._new(name), kind, a, b, points, frames or self._frames(of, a, b), **more)
        self._joints[name] = joint
        return joint

    def _frames(self, of: str, a: Body, b: Body, axis: Any = Z, x: Any = None) -> Frames:
        """Return the frames of a joint in both bodies, for an axis or one for each body.

        With x, that is the direction of the frames' first axes.
        """
        first, second = pair_of(of, axis)
        if x is None and "planar" in (a.kind, b.kind) and abs(first[2]) < 1e-12:
            x = np.cross(Z, first)  # then the third axis is across the plane
        frame = rot.between(np.array(Z), first) if x is None else rot.of_frame(x, first)
        other = rot.product(rot.between(first, second), frame)
        return tuple(
            tuple(float(c) for c in rot.product(rot.conjugate(body.rotation), own))
            for body, own in ((a, frame), (b, other))
        )  # type: ignore[return-value]

    def _unconnected(self) -> list[str]:
        """Return the bodies that nothing connects with the ground."""
        pairs = [(x.a.name, x.b.name) for x in self._joints.values()]
        pairs += [
            (x.a.name, x.b.name)
            for x in self._elements.values()
            if x.kind in ("spring", "bushing", "beam")
        ]
        reached, size = {"ground"}, 0
        while len(reached) > size:
            size = len(reached)
            for a, b in pairs:
                if a in reached or b in reached:
                    reached |= {a, b}
        return [name for name in self._bodies if name not in reached]


def pair_of(of: str, axis: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the directions of an axis on both bodies, from one or two."""
    found = _trace.numbers(axis)
    if found is not None and found.shape == (2, 3):
        return unit(f"axis of {of}", found[0]), unit(f"axis of {of}", found[1])
    own = unit(f"axis of {of}", axis)
    return own, own


def is_flat(a: Body, b: Body) -> bool:
    """Return whether two bodies meet in the plane: one is planar, and none is in space."""
    return "planar" in (a.kind, b.kind) and "spatial" not in (a.kind, b.kind)


def points_of(of: str, at: Any, flat: bool = False) -> tuple[Value, Value]:
    """Return the points on both bodies, from one or two places in the world as drawn.

    In a `flat` mechanism two numbers are a place too, of height zero.
    """
    what = f"at= of {of}"
    if callable(at):
        return (with_height(at),) * 2 if flat else (at, at)
    pair = _trace.numbers(at)
    if pair is not None and pair.shape == (2,) and not flat:
        hint = "give three coordinates, or two points, one on each body"
        raise ValueError(hinted(f"{what} must be a place in space, not {at!r}", hint))
    is_place = pair is not None and pair.ndim == 1
    if not is_place and isinstance(at, Sequence | np.ndarray) and len(at) == 2:
        return place_of(what, at[0], flat), place_of(what, at[1], flat)
    own = place_of(what, at, flat)
    return own, own


def place_of(what: str, at: Any, flat: bool) -> Value:
    """Return a place in space, from two numbers too if that is `flat`."""
    if callable(at):
        return with_height(given(what, at, ())) if flat else given(what, at, (3,))
    return spot(what, at, flat)


def two_points(of: str, at: Any, flat: bool = False) -> tuple[Value, Value]:
    """Return two points that are given one by one."""
    numeric = _trace.numbers(at)
    is_place = numeric is not None and numeric.ndim == 1
    if is_place or not isinstance(at, Sequence | np.ndarray) or len(at) != 2:
        raise ValueError(f"at= of {of} must be two points, one on each body, not {at!r}")
    return points_of(of, at, flat)


def apart(points: tuple[Value, Value]) -> Value:
    """Return the distance of two points as drawn, a function if they are."""
    if callable(points[0]) or callable(points[1]):
        return lambda p: ca.norm_2(column(points[1], p, 3) - column(points[0], p, 3))
    return float(np.linalg.norm(np.asarray(points[1]) - np.asarray(points[0])))


def by_coordinate(of: str, kind: str, what: str, value: Any, empty: Any) -> dict[str, Any]:
    """Return given values by the names of a joint's coordinates: one value or one for each."""
    return coordinate_values(of, KINDS[kind].coordinates, what, value, empty)


def coordinate_values(
    of: str, names: Sequence[str], what: str, value: Any, empty: Any
) -> dict[str, Any]:
    """Return given values by the names of coordinates."""
    if callable(value) or not isinstance(value, Sequence | np.ndarray):
        alike = len(names) == 1 or set(names) <= set(RATES)
        if not alike and value is not empty and not (_is_number(value) and value == empty):
            raise ValueError(
                f"{what}= of {of} must be a value for each of {', '.join(names)}, not {value!r}"
            )
        value = [value] * len(names)
    if len(value) != len(names):
        raise ValueError(
            f"{what}= of {of} must be a value for each of {', '.join(names)}, not {len(value)}"
        )
    found = {}
    for name, own in zip(names, value, strict=True):
        if own is None or (_is_number(own) and own == empty):
            continue
        is_law = empty is None and callable(own)  # a function of more than the parameters
        found[name] = own if is_law else given(f"{what}= of {of}", own, ())
    return found


def functions_of(
    of: str, what: str, values: dict[str, Any], angles: Collection[str]
) -> dict[str, Any]:
    """Refuse what is no function along coordinates, some of which are angles."""
    for name, value in values.items():
        if not callable(value):
            raise TypeError(f"{what}= of {of} must be a function, not {value!r}")
        measure = "angle" if name in angles else "slide"
        args = ["t"] if what == "motion" else ["t", measure, "rate"]
        word = what if what == "motion" else "torque" if name in (*angles, *RATES) else "force"
        known = [x for x in args if x != measure or name not in RATES]
        tried(f"{word} of {of}", value, dict.fromkeys(known, 1))
    return values


def tried(
    what: str, function: Callable[..., Any], sizes: Mapping[str, int], size: int | None = 1
) -> ca.SX | None:
    """Call a user's function once, to refuse it where it is given; returns what it returns.

    Parameters have no values and no shapes yet: a function that uses them and does not fit with
    scalars is left to ``system``.
    """
    guess = _Unknown({})
    args = {name: ca.SX.sym(name, count) for name, count in sizes.items()}
    try:
        return _trace.column(what, function, {**args, "params": _Guessed(guess)}, size)
    except Exception:
        if not vars(guess):
            raise
        return None


class _Unknown(_trace.Namespace):
    """Parameters before they have values: a symbol for any name."""

    def __getattr__(self, name: str) -> Any:
        """Return a new symbol, and keep it."""
        if name.startswith("__"):
            raise AttributeError(name)
        return self.__dict__.setdefault(name, ca.SX.sym(name))


class _Guessed:
    def __init__(self, namespace: _Unknown) -> None:
        self.namespace = namespace

    @property
    def vector(self) -> ca.SX:
        return _trace.vector_of(self.namespace)


def check_damping(of: str, damping: Mapping[str, Value]) -> None:
    """Refuse negative damping."""
    for value in damping.values():
        check_size(f"damping= of {of}", "damping", value)


def along(
    of: str,
    kind: str,
    damping: Any,
    effort: Any,
    spring: Any,
    rest: Any,
    motion: Any,
    limits: Any = None,
) -> dict[str, Any]:
    """Return dampers, springs, efforts and motions along the coordinates of a joint."""
    dampers = by_coordinate(of, kind, "damping", damping, 0.0)
    check_damping(of, dampers)
    efforts, motions = (
        functions_of(of, what, by_coordinate(of, kind, what, value, None), ANGLES)
        for what, value in (("torque= or force", effort), ("motion", motion))
    )
    stiffness = by_coordinate(of, kind, "spring", spring, 0.0)
    rests = by_coordinate(of, kind, "rest", rest, 0.0)
    springs = {name: (value, rests.get(name, 0.0)) for name, value in stiffness.items()}
    if kind == "screw" and len(motions) > 1:
        hint = "a screw turns as it slides: prescribe one of both"
        raise ValueError(hinted(f"motion= of {of} has two functions", hint))
    stops = limits_of(of, KINDS[kind].coordinates, limits)
    check_motion(of, stops, motions)
    return {
        "damping": dampers,
        "springs": springs,
        "efforts": efforts,
        "motions": motions,
        "limits": stops,
    }


def check_plane(of: str, kind: str, a: Body, b: Body, axis: NDArray[np.float64]) -> None:
    """Refuse an axis that bodies in a plane cannot turn about, or slide along."""
    if "planar" not in (a.kind, b.kind) or "spatial" in (a.kind, b.kind):
        return
    up = abs(float(axis[2]))
    fits = {"revolute": up > 1 - 1e-12, "planar": up > 1 - 1e-12}
    fits |= dict.fromkeys(("prismatic", "rolling"), up < 1e-12)
    if not fits.get(kind, False):
        raise ValueError(
            hinted(
                f"{of} of '{a.name}' and '{b.name}' does not fit how these bodies move",
                "planar bodies turn about z, and slide and roll along directions across it",
            )
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number)


def with_height(at: Any) -> Callable[[Any], Any]:
    """Return a function for a place in the plane as one for a place in space."""

    def place(params: Any) -> Any:
        found = resolved(at, params)
        size = found.numel() if isinstance(found, ca.SX | ca.DM) else len(found)
        own = column(found, params, size)
        return own if size == 3 else ca.vertcat(own, 0)

    return place
