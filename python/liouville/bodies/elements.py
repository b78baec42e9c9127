"""Springs, dampers, bushings and forces at points: what acts without holding anything.

A rate rho(q, v), linear in v, and its effort tau give the generalised forces (d rho / d v)^T tau,
whose power is rho tau: action and reaction come out together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville.bodies import rotations as rot
from liouville.bodies.body import Body, Value, called, column, row
from liouville.bodies.joints import RATES, Ends, Group, Joint
from liouville.bodies.poses import Poses

#: Rates and their efforts, the same number of expressions each.
Efforts = list[tuple[Any, Any]]


@dataclass(frozen=True, eq=False)
class Element:
    """A spring, a bushing or a force, by the methods of :class:`Assembly`.

    Attributes
    ----------
    name, kind : str
        Its name, and ``"spring"``, ``"bushing"``, ``"beam"``, ``"force"`` or ``"torque"``.
    a, b : Body
        The bodies that it acts between; a force acts on b.
    points, frames : tuple of two
        As those of a joint.
    values : dict
        Its stiffness, rest length and damping, numbers or functions of the parameters.
    function : callable or None
        Of a force.
    """

    name: str
    kind: str
    a: Body
    b: Body
    points: tuple[Value, Value]
    frames: tuple[tuple[float, ...], tuple[float, ...]]
    values: Mapping[str, Value]
    function: Callable[..., Any] | None = None

    def __repr__(self) -> str:
        """Name the element."""
        return f"<{self.kind.capitalize()} {self.name!r}>"

    @property
    def functions(self) -> Iterator[tuple[str, Value, int]]:
        """Its functions of the parameters, as those of a joint."""
        found = [("at", point, 3) for point in self.points]
        if self.kind == "spring":
            names = {"rest": "rest length"}
            found += [(names.get(name, name), x, 1) for name, x in self.values.items()]
        yield from (own for own in found if callable(own[1]))


def parameter_functions(
    joints: Sequence[Joint], elements: Sequence[Element], touches: Sequence[Any]
) -> Iterator[tuple[str, str, Value, int]]:
    """Return the functions of the parameters: what and its name, function, number of values."""
    owners: list[tuple[str, Any]] = [(f"joint '{x.name}'", x) for x in joints]
    owners += [(f"{x.kind} '{x.name}'", x) for x in (*elements, *touches)]
    for of, owner in owners:
        for name, function, size in owner.functions:
            yield f"{name} of {of}", name, function, size


def of_elements(
    elements: Sequence[Element], places: Mapping[str, int], poses: Poses, t: ca.SX, params: Any
) -> tuple[ca.SX, Efforts]:
    """Return the potential of all elements, and their efforts."""
    potential, efforts = ca.SX(0), []
    for kind, act in (("spring", _springs), ("bushing", _bushings), ("beam", _bushings)):
        own = [element for element in elements if element.kind == kind]
        if own:
            energy, more = act(Group(own, places, poses, params))
            potential += energy
            efforts += more
    for element in elements:
        if element.kind in ("force", "torque"):
            efforts += _force(element, Ends([element], places, poses, params), t)
    return potential, efforts


def _values(group: Ends, name: str) -> ca.SX:
    return row([x.values[name] for x in group.items], group.params)


def _springs(group: Group) -> tuple[ca.SX, Efforts]:
    """Springs and dampers along the line between two points."""
    stiffness, damping = _values(group, "stiffness"), _values(group, "damping")
    square, rest = rot.dot(group.d, group.d), _values(group, "rest")
    length = ca.sqrt(square)
    # without a rest length the energy is smooth where the points coincide
    stretched = [
        square[k] if rest[k].is_zero() else (length[k] - rest[k]) ** 2 for k in range(rest.numel())
    ]
    energy = ca.sum2(stiffness * ca.horzcat(*stretched)) / 2
    if damping.is_zero():
        return energy, []
    rate = rot.dot(group.d, group.d_rate) / length
    return energy, [(rate, -damping * rate)]


def _bushings(group: Group) -> tuple[ca.SX, Efforts]:
    """Stiffness and damping between two frames, in the axes of the first.

    Turns are 2 p_1..3, the rotation vector up to its third power.
    """
    turned = [2 * x * ca.sign(group.p[0]) for x in group.p[1:]]
    axes = [group.axis(0, k) for k in range(3)]
    ways = [group.along(axis) for axis in axes]
    if group.items[0].kind == "beam":  # along the third axis as drawn
        ways[2] = ways[2] - _values(group, "length")
    shifts = [*ways, *turned]
    rates = [group.along_rate(axis) for axis in axes]
    rates += [rot.dot(group.spin, axis) for axis in axes]
    energy, efforts = ca.SX(0), []
    for k, element in enumerate(group.items):
        shift, rate = (ca.vertcat(*(x[k] for x in rows)) for rows in (shifts, rates))
        matrices = [
            _matrix(element.values[name], group.params) for name in ("stiffness", "damping")
        ]
        energy += ca.bilin(matrices[0], shift, shift) / 2
        if not matrices[1].is_zero():
            efforts.append((rate, -ca.mtimes(matrices[1], rate)))
    return energy, efforts


def _matrix(value: Value, params: Any) -> ca.SX:
    entries = column(value, params, 6)
    return ca.diag(entries) if entries.numel() == 6 else ca.reshape(entries, 6, 6).T


def check_matrix(what: str, name: str, entries: NDArray[np.float64]) -> None:
    """Refuse entries of a matrix that is not symmetric, or has power to drive."""
    matrix = np.diag(entries.ravel()) if entries.size == 6 else entries.reshape(6, 6)
    largest = np.abs(matrix).max()
    if not np.isfinite(largest):
        raise ValueError(f"{what} must be finite numbers, not {matrix.tolist()}")
    if not np.allclose(matrix, matrix.T, rtol=0, atol=1e-9 * largest):
        raise ValueError(f"{what} must be symmetric")
    least = float(np.linalg.eigvalsh(matrix)[0])
    if name != "stiffness" and least < -1e-9 * largest:
        raise ValueError(f"{what} must have no negative eigenvalue, and has {least:.3g}")


def matrix_functions(elements: Sequence[Element]) -> Iterator[tuple[str, str, Value]]:
    """Return the functions of bushings and beams: what and its name, and the function."""
    for element in elements:
        for name in ("stiffness", "damping"):
            value = element.values.get(name)
            if element.kind in ("bushing", "beam") and callable(value):
                what = f"{name} of {element.kind} '{element.name}'"
                # the stiffness of a bushing may be negative, as that of a spring
                own = name if element.kind == "bushing" else f"{name} of a beam"
                yield what, own, value


def matrix_rows(elements: Sequence[Element], params: Any) -> list[ca.SX]:
    """Return the entries of those matrices, 36 of each."""
    return [ca.vec(_matrix(value, params)) for _, _, value in matrix_functions(elements)]


def beam_stiffness(length: float, axial: Any, about_x: Any, about_y: Any, torsion: Any) -> ca.SX:
    """Return the stiffness of the end of a beam along z against its beginning, shape (6, 6)."""
    found = ca.SX.zeros(6, 6)
    found[2, 2], found[5, 5] = axial / length, torsion / length
    for bending, shift, turn, sign in ((about_y, 0, 4, -1), (about_x, 1, 3, 1)):
        found[shift, shift], found[turn, turn] = 12 * bending / length**3, 4 * bending / length
        found[shift, turn] = found[turn, shift] = sign * 6 * bending / length**2
    return found


def _force(element: Element, ends: Ends, t: ca.SX) -> Efforts:
    assert element.function is not None
    if element.kind == "torque":
        rate = ca.vertcat(*ends.of(ends.poses.omega, 1))
        args = {"t": t, "angular_velocity": rate}
    else:
        rate = ca.vertcat(*ends.point_velocity(1))
        args = {"t": t, "position": ca.vertcat(*ends.r[1]), "velocity": rate}
    what = f"{element.kind} '{element.name}'"
    return [(rate, called(what, element.function, args, ends.params, 3))]


def of_joints(
    groups: Sequence[Group], t: ca.SX, params: Any
) -> tuple[ca.SX, dict[tuple[str, str], tuple[Any, Any, Any]]]:
    """Return the potential of the springs of joints, and what their coordinates are.

    That is by joint and coordinate the value or None, the rate, and the effort of dampers and
    motors, without springs.
    """
    potential = ca.SX(0)
    found = {}
    for group in groups:
        if any("stiffness" in joint.sizes for joint in group.items):  # of ball joints
            stiffness = row([joint.sizes.get("stiffness", 0.0) for joint in group.items], params)
            potential += ca.sum2(stiffness * group.turn_square) / 2
        for j, first in enumerate(group.items[0].coordinates):
            value, rate = group.coordinate(first)
            rates = ca.horzsplit(rate)
            values = [None] * len(rates) if value is None else ca.horzsplit(value)
            for joint, own, speed in zip(group.items, values, rates, strict=True):
                name = joint.coordinates[j]
                if name in joint.springs:
                    assert own is not None
                    stiffness, rest = (column(x, params, 1) for x in joint.springs[name])
                    potential += stiffness * (own - rest) ** 2 / 2
                effort = _effort(joint, name, (t, own, speed), params)
                found[joint.name, name] = own, speed, effort
    return potential, found


def _effort(joint: Joint, name: str, at: tuple[ca.SX, Any, ca.SX], params: Any) -> ca.SX:
    t, value, rate = at
    effort = ca.SX(0)
    if name in joint.damping:
        effort -= column(joint.damping[name], params, 1) * rate
    if name in joint.efforts:
        measure = "angle" if name in joint.angles else "slide"
        what = f"{'torque' if name in (*joint.angles, *RATES) else 'force'} of joint '{joint.name}'"
        args = {"t": t, measure: value, "rate": rate}
        if name in RATES:
            del args[measure]
        effort += called(what, joint.efforts[name], args, params)
    return effort
