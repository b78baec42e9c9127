"""Bodies: their coordinates, their energy, and where their points and axes are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.signatures import check_signature
from liouville.bodies import rotations as rot

#: The coordinates of each kind of body, after its name.
PARTS = {
    "ground": (),
    "spatial": ("x", "y", "z", "e0", "e1", "e2", "e3"),
    "point": ("x", "y", "z"),
    "planar": ("x", "y", "angle"),
}

#: Moments of inertia may miss the triangle inequality by this part of the largest.
TRIANGLE = 1e-9

#: Sizes that have to be positive, others that must not be negative, and one that must not be zero.
POSITIVE = frozenset({"radius", "length", "v_s", "force_s", "v_stribeck"})
#: What slow slips add to a coefficient of friction.
EXCESS = "mu_static - mu"
NOT_NEGATIVE = frozenset({"damping", "armature", "mu", "mu_static", EXCESS, "rest length"})
NOT_ZERO = frozenset({"lead"})

#: Numbers, or a function of the parameters.
Value = Any


@dataclass(frozen=True, eq=False)
class Body:
    """A body of an assembly, by :meth:`Assembly.body` and its relatives.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        ``"spatial"``, ``"point"``, ``"planar"`` or ``"ground"``.
    mass, inertia, at : float, array or callable
        As they were given.
    rotation : tuple of float
        Unit quaternion of its own axes when drawn.
    """

    name: str
    kind: str
    mass: Value = 0.0
    inertia: Value = None
    at: Value = (0.0, 0.0, 0.0)
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)

    def __repr__(self) -> str:
        """Name the body."""
        return f"<Body {self.name!r}>"


def resolved(value: Value, params: Any) -> Any:
    """Return a value that may be a function of the parameters."""
    return value(params) if callable(value) else value


def column(value: Value, params: Any, size: int) -> ca.SX:
    """Return numbers or a function of the parameters as a column of expressions."""
    found = resolved(value, params)
    if isinstance(found, ca.SX | ca.DM):
        return ca.SX(found)
    if isinstance(found, np.ndarray) and found.dtype == float:
        found = ca.SX(ca.DM(found.ravel()))
        return found if found.numel() > 1 or size == 1 else ca.repmat(found, size, 1)
    if isinstance(found, Sequence | np.ndarray):
        return ca.vertcat(*(ca.SX(x) for x in np.asarray(found, dtype=object).ravel().tolist()))
    return ca.SX(found) if size == 1 else ca.repmat(ca.SX(found), size, 1)


def row(values: Sequence[Value], params: Any) -> ca.SX:
    """Return a number or a function of the parameters of each of many as a row."""
    if all(isinstance(value, float | np.ndarray) for value in values):
        return ca.SX(ca.DM(np.array(values, dtype=float).ravel())).T
    return ca.horzcat(*(column(value, params, 1) for value in values))


def stacked(points: Sequence[Any]) -> ca.SX:
    """Return vectors, of numbers or expressions, as columns."""
    if all(isinstance(point, np.ndarray) for point in points):
        return ca.SX(ca.DM(np.array(points).T))
    return ca.horzcat(*(ca.SX(ca.DM(x) if isinstance(x, np.ndarray) else x) for x in points))


def given(what: str, value: Value, shape: tuple[int, ...]) -> Value:
    """Return a function of the parameters as it is, and numbers as an array of this shape."""
    if callable(value):
        check_signature(what, value, {"params": None})
        return value
    return numbers(what, value, shape)


def numbers(what: str, value: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return finite numbers as an array of this shape; else say what they are of."""
    found = _trace.numbers(value)
    if found is None or found.shape != shape or not np.isfinite(found).all():
        wanted = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise ValueError(f"{what} must be {wanted}, not {value!r}")
    return found


def spot(what: str, value: Any, is_flat: bool) -> NDArray[np.float64]:
    """Return a place in space; in the plane two numbers are one too, of height zero."""
    found = _trace.numbers(value)
    if is_flat and found is not None and found.shape == (2,):
        return np.append(numbers(what, value, (2,)), 0.0)
    return numbers(what, value, (3,))


def unit(what: str, value: Any, size: int = 3) -> NDArray[np.float64]:
    """Return a direction, or a quaternion, of length one."""
    found = numbers(what, value, (size,))
    length = float(np.linalg.norm(found))
    if length == 0:
        raise ValueError(f"{what} has length zero")
    return found / length


def evaluated(
    what: str, value: Value, params: Any, size: int, or_size: int = 0
) -> NDArray[np.float64]:
    """Return the numbers of a value at the defaults of the parameters, so many or so many."""
    if isinstance(value, np.ndarray):
        return value.ravel()
    try:
        found = np.array(ca.DM(ca.evalf(column(value, params, size)))).ravel()
    except AttributeError as error:
        raise ValueError(f"{what}: {error}") from error
    except (TypeError, RuntimeError, NotImplementedError) as error:
        raise TypeError(f"{what} does not return numbers: {error}") from error
    if found.size not in (size, or_size) or not np.isfinite(found).all():
        wanted = f"{size} or {or_size}" if or_size else f"{size}"
        raise ValueError(f"{what} must be {wanted} finite numbers, not {found.tolist()}")
    return found


def is_limited(name: str) -> bool:
    """Return whether a size of this name is limited."""
    return name.partition(" of ")[0] in POSITIVE | NOT_NEGATIVE | NOT_ZERO


def check_size(what: str, name: str, value: Value) -> None:
    """Refuse a number that no size of this name is; functions are looked at by their numbers."""
    if callable(value):
        return
    number, of = float(value), name.partition(" of ")[0]
    for names, is_one, wanted in (
        (POSITIVE, number > 0, f"be positive, not {number:g}"),
        (NOT_NEGATIVE, number >= 0, f"be zero or positive, not {number:g}"),
        (NOT_ZERO, number != 0, "not be zero"),
    ):
        if of in names and not is_one:
            raise ValueError(f"{what} must {wanted}")


def check_mass(body: Body, params: Any) -> None:
    """Refuse a mass or an inertia that no body has."""
    mass = evaluated(f"mass of body '{body.name}'", body.mass, params, 1)[0]
    what = f"inertia of body '{body.name}'"
    if body.kind == "point":
        entries = np.empty((0, 0))
    elif body.kind == "planar":
        entries = np.full((3, 3), evaluated(what, body.inertia, params, 1)[0])
    elif callable(body.inertia):
        entries = np.array(ca.DM(ca.evalf(inertia_matrix(body, params))))
    else:
        entries = body.inertia if body.inertia.ndim == 2 else np.diag(body.inertia)
    check_numbers(body.name, body.kind, mass, entries)


def check_numbers(name: str, kind: str, mass: float, entries: NDArray[np.float64]) -> None:
    """Refuse a mass, or entries of an inertia, that no body has; a planar one has its moment."""
    if not mass > 0:
        raise ValueError(f"mass of body '{name}' must be positive, not {mass:g}")
    if kind == "point":
        return
    what = f"inertia of body '{name}'"
    if kind == "planar":
        if not entries[0, 0] > 0:
            raise ValueError(f"{what} must be positive, not {entries[0, 0]:g}")
        return
    if not np.isfinite(entries).all():
        raise ValueError(f"{what} must be finite")
    if not np.allclose(entries, entries.T, rtol=1e-9, atol=0):
        raise ValueError(f"{what} must be symmetric")
    moments = np.linalg.eigvalsh(entries)
    if not moments[0] > 0:
        sentence = f"{what} must have positive principal moments, not {moments[0]:.3g}"
        hint = "a thin rod takes 1e-8 of the others about its axis, a point m.point_mass"
        raise ValueError(hinted(sentence, hint))
    if moments[0] + moments[1] < moments[2] * (1 - TRIANGLE):
        raise ValueError(
            hinted(
                f"{what} is that of no body: of its principal moments "
                f"{', '.join(f'{x:.6g}' for x in moments)} the largest exceeds the sum of the "
                "others",
                "moments are about the centre of mass",
            )
        )


def inertia_matrix(body: Body, params: Any) -> ca.SX:
    """Return the inertia about the centre, in the body's axes, shape (3, 3)."""
    value = resolved(body.inertia, params)
    entries = column(value, params, 3)
    if entries.numel() == 3:
        return ca.diag(ca.vec(entries))
    if entries.numel() == 9:
        return ca.reshape(entries, 3, 3)
    raise ValueError(
        f"inertia of body '{body.name}' is three principal moments or a matrix of shape (3, 3), "
        f"not {value!r}"
    )


class Layout:
    """Where the coordinates of all bodies are, the ground last.

    Attributes
    ----------
    names : tuple of str
        Names of the bodies but the ground.
    kinds : tuple of str
        Their kinds.
    starts : tuple of int
        The first coordinate of each.
    rotations : tuple of tuple of float
        The quaternion of each as drawn.
    planes : tuple of float
        The height of the plane that a planar body moves in, for all bodies.
    coordinates : tuple of str
        Names of all coordinates, those of bodies first.
    own : dict of str to int
        The first coordinate of each compound joint.
    counted : dict of (str, str) to int
        The coordinates of angles that count turns, by joint and coordinate.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        joints: Sequence[Any] = (),
        counted: Sequence[tuple[str, str]] = (),
    ) -> None:
        self.names = tuple(body.name for body in bodies)
        self.kinds = tuple(body.kind for body in bodies)
        self.planes = tuple(
            float(body.at[2]) if body.kind == "planar" and not callable(body.at) else 0.0
            for body in bodies
        )
        self.rotations = tuple(body.rotation for body in bodies)
        self.coordinates = tuple(
            f"{body.name}.{part}" for body in bodies for part in PARTS[body.kind]
        )
        sizes = [len(PARTS[kind]) for kind in self.kinds]
        self.starts = tuple(np.cumsum([0, *sizes])[:-1].tolist())
        self.own: dict[str, int] = {}
        for joint in joints:
            if joint.axes:
                self.own[joint.name] = len(self.coordinates)
                self.coordinates += tuple(f"{joint.name}.{axis.name}" for axis in joint.axes)
        self.counted = {own: len(self.coordinates) + k for k, own in enumerate(counted)}
        self.coordinates += tuple(f"{joint}.{name}" for joint, name in counted)

    def of_kind(self, kind: str) -> list[int]:
        """Return the places of the bodies of one kind."""
        return [k for k, own in enumerate(self.kinds) if own == kind]

    def pose(self, q: NDArray[np.float64], body: int) -> tuple[Any, Any]:
        """Return position and quaternion by components, of rows of coordinates (k, n)."""
        zero = np.zeros(len(q))
        if body == len(self.kinds):
            return (zero,) * 3, (zero + 1, zero, zero, zero)
        at, kind = self.starts[body], self.kinds[body]
        own = q[:, at : at + len(PARTS[kind])].T
        if kind == "spatial":
            return tuple(own[:3]), tuple(own[3:])
        if kind == "point":
            return tuple(own), (zero + 1, zero, zero, zero)
        half = own[2] / 2
        place = (own[0], own[1], zero + self.planes[body])
        return place, (np.cos(half), zero, zero, np.sin(half))

    def twist(self, q: NDArray[np.float64], v: NDArray[np.float64], body: int) -> tuple[Any, Any]:
        """Return velocity and angular velocity in the world by components."""
        zero = np.zeros(len(q))
        if body == len(self.kinds):
            return (zero,) * 3, (zero,) * 3
        at, kind = self.starts[body], self.kinds[body]
        own = v[:, at : at + len(PARTS[kind])].T
        if kind == "spatial":
            return tuple(own[:3]), rot.world_rate(self.pose(q, body)[1], own[3:])
        if kind == "point":
            return tuple(own), (zero,) * 3
        return (own[0], own[1], zero), (zero, zero, own[2])

    def wrench(
        self, q: NDArray[np.float64], force: NDArray[np.float64], body: int
    ) -> tuple[Any, Any]:
        """Return force, and torque about the centre, of generalised forces (k, n)."""
        zero = np.zeros(len(q))
        at, kind = self.starts[body], self.kinds[body]
        own = force[:, at : at + len(PARTS[kind])].T
        if kind == "spatial":
            return tuple(own[:3]), rot.torque_of(self.pose(q, body)[1], own[3:])
        if kind == "point":
            return tuple(own), (zero,) * 3
        return (own[0], own[1], zero), (zero, zero, own[2])

    def rates(self, poses: Any, velocity: Any, omega: Any) -> NDArray[np.float64]:
        """Return v of bodies, shape (n, j), of j twists of each, of shape (3, bodies, j)."""
        e = np.asarray(poses[1])[:, :, None]
        found = np.zeros((sum(len(PARTS[kind]) for kind in self.kinds), *velocity.shape[2:]))
        for kind in set(self.kinds):
            own = self.of_kind(kind)
            first = np.array(self.starts)[own]
            place, spin = velocity[:, own], omega[:, own]
            if kind == "spatial":
                rows = (*place, *rot.rate_of(e[:, own], spin))
            else:
                rows = (*place,) if kind == "point" else (place[0], place[1], spin[2])
            for j, rates in enumerate(rows):
                found[first + j] = rates
        return found

    def gathered(self, poses: Any) -> NDArray[np.float64]:
        """Return q of bodies, shape (n,), of poses of shapes (3, bodies) and (4, bodies)."""
        x, e = poses
        rows: list[float] = []
        for k, kind in enumerate(self.kinds):
            if kind == "spatial":
                rows += [*x[:, k], *e[:, k]]
            else:
                own = [*x[:, k]]
                angle = 2 * np.arctan2(e[3, k], e[0, k])
                rows += own if kind == "point" else [own[0], own[1], angle]
        return np.array(rows, dtype=float)


def called(
    what: str,
    function: Callable[..., Any],
    args: dict[str, Any],
    namespace: Any,
    size: int | None = 1,
) -> ca.SX:
    """Call a user's function of expressions, by symbols of its own, which messages name."""
    fresh = {name: ca.SX.sym(name, ca.SX(x).numel()) for name, x in args.items()}
    found = _trace.column(what, function, {**fresh, "params": Known(namespace)}, size)
    return ca.substitute(
        found, ca.vertcat(*fresh.values()), ca.vertcat(*(ca.vec(ca.SX(x)) for x in args.values()))
    )


def check_rows(what: str, rows: ca.SX | None) -> None:
    """Refuse more equations of a guide than there are of a curve; None is not looked at."""
    if rows is not None and rows.numel() > 2:
        raise ValueError(f"{what} must be 1 of a surface or 2 of a curve, not {rows.numel()}")


class Known:
    """Parameters as a model's function has them, in the form that tracing takes."""

    def __init__(self, namespace: Any) -> None:
        self.namespace, self.vector = namespace, _trace.vector_of(namespace)
