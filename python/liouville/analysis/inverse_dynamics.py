"""Efforts of actuators that a motion needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics.arguments import amount
from liouville._basics.errors import Suggesting, hinted, misshapen, quoted
from liouville._solution.solution import Solution
from liouville._systems import Mechanics
from liouville._systems.mechanics.motion import rates as recorded
from liouville._systems.mechanics.singular import dense
from liouville._systems.tracing import trace as _trace
from liouville.analysis.point import Array, Point, Split, mechanical
from liouville.bodies import Mechanism
from liouville.bodies.normal_forces import Rubs

#: A motion may miss its constraints by this part of their size, and near zero by so much.
CONSISTENT, FLOOR = 1e-6, 1e-9
#: A force left that is more than this part of those there is one that the actuators cannot make.
MADE = 1e-8
#: Actuators do different things where the smallest singular value is above this part.
APART = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class InverseDynamics(Suggesting):
    """Efforts that make a motion, at k times.

    Attributes
    ----------
    t : ndarray, shape (k,)
        The times.
    efforts : dict of str to ndarray, shape (k,)
        The effort of each actuator, besides the forces that the system has: a torque along an
        angle, a force along a length.
    rates : dict of str to ndarray, shape (k,)
        The rates that they work on: effort times rate is the power.
    lam : ndarray, shape (k, m)
        Multipliers of the constraints, of redundant ones those of least norm.
    residual : ndarray, shape (k,)
        The largest generalised force that is left; roundoff unless least squares were asked for.
    """

    t: Array
    efforts: dict[str, Array]
    rates: dict[str, Array]
    lam: Array
    residual: Array

    def __repr__(self) -> str:
        """Give the largest efforts."""
        most = [f"{name} {np.abs(x).max():.4g}" for name, x in self.efforts.items()]
        left, times = self.residual.max(), amount(len(self.t), "time")
        return f"<InverseDynamics at {times}: most {', '.join(most)}; left {left:.1e}>"


def inverse_dynamics(
    system: Mechanics,
    motion: Solution | Mapping[str, ArrayLike],
    actuators: Sequence[str] | Mapping[str, Callable[..., Any]],
    *,
    params: Mapping[str, ArrayLike] | None = None,
    least_squares: bool = False,
) -> InverseDynamics:
    r"""Compute the efforts u of actuators that make a motion.

    .. math::

        M a = f - g_q^T \lambda - k_v^T \nu + B u

    with the columns :math:`(\partial \rho / \partial v)^T` of B, where an actuator works on the
    rate :math:`\rho`. Constraints, redundant ones too, take up what they can. Friction of joints is
    pressed by the multipliers of this motion.

    Parameters
    ----------
    system : Mechanics
        A Lagrangian, Structure, Mechanical with v = z, or the system of an assembly, without the
        actuators.
    motion : Solution or mapping
        The solution of a system with the same coordinates, whose own forces give the accelerations;
        or arrays ``t`` of shape (k,), and ``q``, ``v`` (or ``y``, ``z``) and ``acceleration`` of
        shape (k, n), in the system's units.
    actuators : sequence of str, or mapping of str to callable
        Where efforts act: joints of an assembly by name, ``"A"``, with all of their coordinates, or
        one of several, ``"A.slide"``; coordinates; or by name functions ``rate(t, q, v, params)``,
        linear in v.
    params : mapping, optional
        Parameters that differ from their defaults; by default those of the solution.
    least_squares : bool, default False
        Whether the nearest efforts are given where the actuators cannot make the motion, and the
        least where several can.

    Returns
    -------
    InverseDynamics
        Efforts, rates, multipliers and what is left.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong; the motion violates the constraints; too few actuators make it, or
        they are too many to be told apart.

    References
    ----------
    :cite:t:`jay2007` for the equations.

    Examples
    --------
    >>> import liouville as lv
    >>> spring, mass = lv.Structure([1.0], [[4.0]]), lv.Structure([1.0], [[0.0]])
    >>> motion = lv.integrate(spring, lv.Spark(3), t=(0, 1), h=0.1, q=[1.0], v=[0.0])
    >>> found = lv.analysis.inverse_dynamics(mass, motion, ["q0"])
    >>> bool(abs(found.efforts["q0"] + 4.0 * motion.q[:, 0]).max() < 1e-12)
    True
    """
    system = mechanical(system, "inverse_dynamics")
    if "v_z" in system.patterns or not system.is_ideal:
        raise TypeError(
            hinted(
                "inverse dynamics takes systems in velocities, with ideal reactions",
                "write the system as a Lagrangian",
            )
        )
    t, y, z, a, values = _motion(system, motion, params)
    names, slopes = _actuators(system, actuators, (t, y, z), values)
    own = system.rubs(values, t, y, z) if isinstance(system, Mechanism) else None
    rows = [
        _solved(Point(system, time, q, v, values), names, b, least_squares, u, rubs)
        for time, q, v, b, u, rubs in zip(
            t.tolist(), y, z, slopes, a, own or repeat(None, len(t)), strict=True
        )
    ]
    efforts, lam, left = (np.array(x) for x in zip(*rows, strict=True))
    speeds = np.einsum("kij,kj->ki", slopes, z)
    return InverseDynamics(
        t,
        {name: efforts[:, j] for j, name in enumerate(names)},
        {name: speeds[:, j] for j, name in enumerate(names)},
        lam,
        left,
    )


def _motion(
    system: Mechanics,
    motion: Solution | Mapping[str, ArrayLike],
    params: Mapping[str, ArrayLike] | None,
) -> tuple[Array, Array, Array, Array, Array]:
    """Return times, coordinates, velocities, accelerations and parameters."""
    first, second = system.states
    if isinstance(motion, Solution):
        return _solution(system, motion, params)
    given = _trace.mapping("motion", motion)
    wanted = ("t", first, second, "acceleration")
    if set(given) != set(wanted):
        hint = "a spline of q gives both: CubicSpline(t, q).derivative()"
        raise TypeError(
            hinted(f"motion must have {', '.join(wanted)}, not {', '.join(map(str, given))}", hint)
        )
    arrays = {name: _trace.numbers(given[name]) for name in wanted}
    k, n = np.size(given["t"]), len(system.coordinates)
    for name, array in arrays.items():
        shape = (k,) if name == "t" else (k, n)
        if array is None or array.shape != shape or not k:
            if array is None:
                raise ValueError(f"{name} of the motion must be an array of numbers")
            raise misshapen(f"{name} of the motion", array.shape, shape)
        if not np.isfinite(array).all():
            raise ValueError(f"{name} of the motion is not finite everywhere")
    t, y, z, a = (np.asarray(x) for x in arrays.values())
    return t, y, z, a, system.values(params)


def _solution(
    system: Mechanics, motion: Solution, params: Mapping[str, ArrayLike] | None
) -> tuple[Array, Array, Array, Array, Array]:
    """Return the same of a solution, with accelerations by its own system."""
    own = motion.system
    if motion.members is not None:
        raise ValueError(hinted("the motion is an ensemble", "take a member: solution.member(0)"))
    if not isinstance(own, Mechanics) or "v_z" in own.patterns:
        raise ValueError(
            hinted(
                "the solution carries no system in velocities that gives its accelerations",
                "give t, q, v and acceleration as arrays",
            )
        )
    if own.coordinates != system.coordinates:
        raise ValueError(
            f"the motion is one of {', '.join(own.coordinates[:6])}, the system has the "
            f"coordinates {', '.join(system.coordinates[:6])}"
        )
    y, z = (motion.states[name] for name in own.states)
    values = own.values(motion.params)
    times = zip(motion.t.tolist(), y, z, strict=True)
    a = np.array([Point(own, time, q, v, values).motion()[0] for time, q, v in times])
    if params is None:
        params = {name: x for name, x in motion.params.items() if name in system.params}
    return motion.t, y, z, a, system.values(params)


def _actuators(
    system: Mechanics, actuators: Any, at: tuple[Array, Array, Array], values: Array
) -> tuple[list[str], Array]:
    """Return the names of actuators and the derivatives of their rates by v, (k, j, n)."""
    t, y, z = at
    k, n = y.shape
    if isinstance(actuators, Mapping):
        functions = _trace.mapping("actuators", actuators)
        tape, patterns = recorded(system, functions)
        found = tape.map(values, [t.reshape(-1, 1), np.ascontiguousarray(y), np.array(z)])
        slopes = np.array([dense(patterns["rates"], row) for row in found])
        names = list(functions)
    else:
        if isinstance(actuators, str) or not isinstance(actuators, Sequence):
            hint = f"give a list, [{actuators!r}]" if isinstance(actuators, str) else "give names"
            raise TypeError(
                hinted(f"actuators must be names or functions, not {actuators!r}", hint)
            )
        names = [x for name in actuators for x in _rates_of(system, name)]
        places = [_place(system, name) for name in names]
        slopes = np.zeros((k, len(names), n))
        if any(is_joint for is_joint, _ in places):
            # rates of joints are linear in v: their values at unit velocities are the derivatives
            grid = np.repeat(t, n), np.repeat(y, n, axis=0), np.tile(np.eye(n), (k, 1))
            joints = system.output("rates", values, *grid).reshape(k, n, -1)  # type: ignore[attr-defined]
        for j, (is_joint, place) in enumerate(places):
            slopes[:, j] = joints[:, :, place] if is_joint else np.eye(n)[place]
    if not names:
        raise ValueError("no actuators are named")
    return names, slopes


def _rates_of(system: Mechanics, name: str) -> list[str]:
    """Name all coordinates of a joint that has several, and no others."""
    if name in system.coordinates or name not in getattr(system, "joints", ()):
        return [name]
    own = system.place(name).coordinates  # type: ignore[attr-defined]
    return [f"{name}.{x}" for x in own] if len(own) > 1 else [name]


def _place(system: Mechanics, name: str) -> tuple[bool, int]:
    """Return whether an actuator is that of a joint, and the place of its rate."""
    if name in system.coordinates:
        return False, system.coordinates.index(name)
    joints: tuple[str, ...] = getattr(system, "joints", ())
    of, _, which = str(name).partition(".")
    for joint in (x for x in (name, of) if x in joints):
        place = system.place(joint)  # type: ignore[attr-defined]
        own = which if joint != name else (place.coordinates[0] if place.coordinates else "")
        if own in place.coordinates and (joint != name or len(place.coordinates) == 1):
            return True, place.first + place.coordinates.index(own)
        known = quoted([f"{joint}.{x}" for x in place.coordinates]) or "none"
        raise ValueError(hinted(f"actuator '{name}' names no one coordinate", f"there is {known}"))
    known = ", ".join([*joints, *system.coordinates][:12])
    sentence = f"there is no joint or coordinate {name!r} for an actuator"
    raise ValueError(hinted(sentence, f"there are {known}"))


def _solved(
    point: Point,
    names: list[str],
    slopes: Array,
    least_squares: bool,
    a: Array,
    rubs: Rubs | None,
) -> tuple[Array, Array, float]:
    """Return efforts, multipliers and the largest force left at a time."""
    # the forces of a mechanism have friction under other efforts, none
    force, rate = (rubs.force, rubs.rate) if rubs else point.rates
    _check(point, a, rate)
    system = point.system
    felt = point.reactions(np.zeros(len(system.constraints)))
    units = point.units
    split = Split.of(felt.T, units)
    inside = split.null.T @ slopes.T
    sizes = np.linalg.svd(inside, compute_uv=False)
    limit = APART * np.linalg.norm(slopes * units, axis=1).max()
    rank = int((sizes > limit).sum())
    if rank < len(names) and not least_squares:
        few = f"{inside.shape[0]} freedoms are left by the constraints"
        sentence = f"efforts of {quoted(names)} cannot be told apart at t = {point.t:g}: {few}"
        raise ValueError(hinted(sentence, "name fewer, or least_squares=True gives the least"))
    cutoff = limit / max(sizes.max(initial=0.0), 1e-300)
    needed = point.blocks("stage_blocks")["p_z"] @ a - force
    if rubs:  # one column more for the normal force of each contact
        columns = np.column_stack([needed, *-rubs.pushes])
        parts = np.linalg.lstsq(inside, split.null.T @ columns, rcond=cutoff)[0]
        normal = rubs.normal_forces(split.inverse.T @ (columns - slopes.T @ parts))
        if not np.isfinite(normal).all():
            sentence = f"friction jams at t = {point.t:g}: no efforts make this motion"
            raise ValueError(hinted(sentence, "take less friction, or a smaller radius"))
        friction = normal @ rubs.pushes
        needed, force = needed - friction, force + friction
    wanted = split.null.T @ needed
    efforts = np.linalg.lstsq(inside, wanted, rcond=cutoff)[0]
    left = (split.null / units[:, None] ** 2) @ (wanted - inside @ efforts)
    worst = int(np.argmax(units * np.abs(left)))
    scale = np.abs(units * needed).max() + np.abs(units * force).max()
    own = units[worst] * abs(left[worst])
    if own > MADE * scale and not (
        least_squares or own <= MADE * scale + units[worst] * point.roundings[worst]
    ):
        sentence = (
            f"{quoted(names)} cannot make this motion: at t = {point.t:g} a force of "
            f"{abs(left[worst]):.2g} is left on '{system.coordinates[worst]}', with {len(names)} "
            f"actuators for {inside.shape[0]} freedoms"
        )
        hint = "name more actuators, or least_squares=True gives the nearest efforts"
        raise ValueError(hinted(sentence, hint))
    lam = split.inverse.T @ (needed - slopes.T @ efforts)
    return efforts, lam, float(np.abs(left).max())


def _check(point: Point, a: Array, rate: Array) -> None:
    """Refuse a motion that violates the constraints, or whose accelerations do."""
    system = point.system
    if not system.constraints:
        return
    limits, state = (CONSISTENT, FLOOR, system.kinds), (point.y[None], point.z[None])
    found = _core.violation(system.problem, point.params[None], point.t, state, limits, True)
    if found is not None:
        sentence = system.violated(found, point.t, "").partition("\n")[0]
        hint = "inverse dynamics needs a motion that the mechanism can make"
        raise ValueError(hinted(sentence.replace("start violates", "motion violates"), hint))
    held = point.held()
    off = np.abs(rate + held @ a)
    size = np.abs(rate) + np.abs(held) @ np.abs(a) + FLOOR / CONSISTENT
    k = int(np.argmax(off / size))
    if off[k] > CONSISTENT * size[k]:
        name = system.constraints[k]
        sentence = f"accelerations of the motion violate constraint '{name}' at t = {point.t:g}"
        raise ValueError(hinted(sentence, "they are the second derivatives of its coordinates"))
