"""Where IPOPT begins: states and controls along the time."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, misshapen
from liouville._solution.solution import Solution
from liouville._studies.optimal.arguments import Array
from liouville._studies.optimal.final import near_constraints
from liouville._studies.optimal.result import OptimalControl
from liouville._systems.mechanics.consistent import project
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._studies.optimal.problem import Problem

#: The way from start to end has so many pieces at least; along the constraints it takes this many
#: strides at most, the first of them aside where less than a part of the direction is free.
FEWEST, MOST, ASIDE, STUCK = 20, 200, 3, 1e-3

#: States y and z and controls, each with a row for each of the parts of the time asked for.
Path = Callable[[Array], tuple[Array, Array, Array]]


def path_of(guess: Any, problem: Problem) -> Path:
    """Return a guess as a function of parts of the time, from 0 to 1."""
    parts, arrays = _arrays(guess, problem)
    path = _straight(problem)

    def found(at: Array) -> tuple[Array, Array, Array]:
        y, z, u = path(at)
        first, second = problem.system.states
        y, z = (_at(at, parts, arrays, name, x) for name, x in ((first, y), (second, z)))
        own = problem.controls.split(u)
        columns = [_at(at, parts, arrays, name, x) for name, x in own.items()]
        return y, z, np.concatenate([x.reshape(at.size, -1) for x in columns], axis=1)

    return found


def _at(at: Array, parts: Array, arrays: dict[str, Array], name: str, default: Array) -> Array:
    """Interpolate an array that is given, else return the default."""
    if name not in arrays:
        return default
    given = arrays[name].reshape(parts.size, -1)
    return _interpolated(at, parts, given).reshape(default.shape)


def _straight(problem: Problem) -> Path:
    """Return the way from start to end along the constraints, with controls as parameters are."""
    (y0, z0), steps = problem.start, problem.times.steps
    y1, z1 = problem.final.guess(*problem.start)
    if problem.final.places and 0 not in problem.final.whole:  # some coordinates are open
        at = problem.times.end, (y1, z1), problem.params
        y1, _ = near_constraints(problem.system, *at)
    u = problem.params[problem.controls.places]
    moves = problem.equations.is_own_velocity and not np.array_equal(y0, y1)
    parts = np.linspace(0.0, 1.0, max(steps, FEWEST) + 1)
    y = _along(problem, y0 + parts[:, None] * (y1 - y0), parts)
    z = z0 + parts[:, None] * (z1 - z0)
    if moves:
        z = np.gradient(y, parts * (problem.times.end - problem.times.start), axis=0)

    def found(at: Array) -> tuple[Array, Array, Array]:
        y_at, z_at = (_interpolated(at, parts, x) for x in (y, z))
        return y_at, z_at, np.tile(u, (at.size, 1))

    return found


def _along(problem: Problem, y: Array, parts: Array) -> Array:
    """Return positions moved onto the constraints, on a way along these from start to end.

    The straight way is given, and returned where no other is found.
    """
    if not problem.equations.m or np.array_equal(y[0], y[-1]):
        return y
    try:
        way = _walked(problem, y[0], y[-1], 0)
        if way is None:
            way = _walked(problem, y[0], y[-1], ASIDE)
        if way is None:
            return y
        lengths = np.cumsum([0.0, *np.linalg.norm(np.diff(way, axis=0), axis=1)])
        even = _interpolated(parts, lengths / lengths[-1], way)
        times, (_, z) = problem.times, problem.start
        t = times.start + parts * (times.end - times.start)
        inner = [
            project(problem.system, "positions", t[k], even[k], z, problem.params)
            for k in range(1, len(parts) - 1)
        ]
    except ValueError:  # no place on the constraints is near
        return y
    return np.array([y[0], *inner, y[-1]])


def _walked(problem: Problem, start: Array, end: Array, first: int) -> Array | None:
    """Walk along the constraints by short strides, as straight to the end as they allow.

    The first ones may go aside, as nothing else leads to the opposite point of a circle. None where
    the end is not reached.
    """
    system, params, t = problem.system, problem.params, problem.times.end
    s, model = problem.reduced.symbols, problem.reduced.model
    slopes = ca.Function("g_y", [s.t, s.y, s.params.vector], [jacobian(model.g, s.y)])
    stride = np.linalg.norm(end - start) / FEWEST
    aside = np.random.default_rng(0).standard_normal(start.size)
    y, way = start, [start]
    for k in range(MOST):
        g_y = np.array(ca.DM(slopes(t, y, params)))
        towards = aside if k < first else end - y
        towards = towards - g_y.T @ np.linalg.lstsq(g_y.T, towards)[0]
        length = np.linalg.norm(towards)
        if not length > STUCK * np.linalg.norm(end - y):
            return None
        y = project(system, "positions", t, y + stride / length * towards, problem.start[1], params)
        way.append(y)
        if np.linalg.norm(end - y) <= stride:
            return np.array([*way, end])
    return None


def _interpolated(at: Array, parts: Array, rows: Array) -> Array:
    return np.stack([np.interp(at, parts, column) for column in rows.T], axis=1)


def _arrays(guess: Any, problem: Problem) -> tuple[Array, dict[str, Array]]:
    """Return parts of the time, and what is given at them by name."""
    if guess is None:
        return np.empty(0), {}
    known = [*problem.system.states, *problem.controls.names]
    if isinstance(guess, OptimalControl | Solution):
        given = dict(guess.states)
        if isinstance(guess, OptimalControl):
            given |= guess.controls
        elif guess.members is not None:
            raise ValueError(hinted("guess is an ensemble", "give a member: solution.member(0)"))
        arrays = {name: x for name, x in given.items() if name in known}
        return _parts(guess.t), _fitting(arrays, guess.t.size, problem)
    given = _trace.mapping("guess", guess)
    for name in given:
        if name not in (*known, "t"):
            raise ValueError(
                hinted(f"guess has no use for {name!r}", f"it takes t, {', '.join(known)}")
            )
    arrays = {name: _numbers(name, x) for name, x in given.items()}
    times = arrays.pop("t", None)
    if times is None:
        count = len(next(iter(arrays.values()))) if arrays else 2
        times = np.linspace(0.0, 1.0, count)
    if times.ndim != 1 or times.size < 2 or not (np.diff(times) > 0).all():
        raise ValueError("t of the guess must have two times or more, which increase")
    return _parts(times), _fitting(arrays, times.size, problem)


def _parts(t: Array) -> Array:
    found: Array = (t - t[0]) / (t[-1] - t[0])
    return found


def _numbers(name: str, given: Any) -> Array:
    array = _trace.numbers(given)
    if array is None or array.ndim == 0 or not np.isfinite(array).all():
        what = "one with NaN or infinity" if array is not None and array.ndim else repr(given)
        raise ValueError(f"{name} of the guess must be an array of finite numbers, not {what}")
    return array


def _fitting(arrays: dict[str, Array], count: int, problem: Problem) -> dict[str, Array]:
    n = len(problem.system.coordinates)
    for name, array in arrays.items():
        own = problem.controls.shapes.get(name, (n,))
        if array.shape != (count, *own):
            raise misshapen(f"{name} of the guess", array.shape, (count, *own))
    return arrays
