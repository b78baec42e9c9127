"""Checks of a gradient against a tangent and against differences."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import number
from liouville._basics.errors import Suggesting, hinted
from liouville._basics.options import started
from liouville._methods import Method
from liouville._runs.adjoint import Adjoint
from liouville._runs.choice import runner_of
from liouville._runs.execute import execute, finished
from liouville._runs.gradients import vjp
from liouville._runs.runner import Request
from liouville._runs.tangents import ENDS, PARAMS
from liouville._solution.solution import Solution
from liouville._solution.tangents import Tangent
from liouville._systems import Field, Mechanics, Schrodinger, SemiExplicit

#: Moved starts of a difference of order six, in units of its step, with their weights.
WEIGHTS = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}

#: The arguments of :func:`liouville.vjp` that a run with tangents takes too.
OPTIONS = {"h", "steps", "rtol", "atol", "control", "every", "t_eval", "events", "threads"}

#: The part of the largest state that a smaller one counts as where directions are scaled, and the
#: part of the states' own pairing that differences are measured by at least.
LEAST = 1e-3


@dataclass(frozen=True)
class GradientCheck(Suggesting):
    """How well a gradient agrees with a tangent and with differences.

    Attributes
    ----------
    dot : float
        Pullback against tangent: the difference of the two pairings in a random direction and for
        random cotangents, in units of the sum of the sizes of what they add up, or of 1e-3 of the
        same sum for the states themselves, where a run moves by less. Roundoff.
    differences : float
        The same of central differences of order six against the tangent: their truncation and
        roundoff, at the default size about 1e-14 to 1e-9 where nothing is wrong.
    """

    dot: float
    differences: float


def check_gradient(
    system: Mechanics | SemiExplicit | Field | Schrodinger,
    method: Method | str = "auto",
    *,
    wrt: Sequence[str],
    t: Sequence[Any] | NDArray[Any],
    size: float = 1e-3,
    seed: int = 0,
    params: Mapping[str, ArrayLike] | None = None,
    **run: Any,
) -> GradientCheck:
    """Check the gradient of a run in a random direction, by its tangent and by differences.

    Directions of a start are along its constraints, onto which runs nearby are moved besides.

    What bends or jumps is not refused here, but seen.

    The two tests see different things. The pairing of tangent and pullback is exact, but agrees
    even where a model bends within a step; differences see that, with their own error. They are of
    a run with the same steps: controlled ones end where those of the run did, but for events and
    switches, which are met wherever they are; records that these pass are left out. Of a
    Schrödinger equation bounds, windows and numbers of terms are the same.
    Members of an ensemble are moved in the same direction.

    Parameters
    ----------
    system, method, wrt, t, params
        As for :func:`liouville.vjp`.
    size : float, default 1e-3
        By which part of its values differences move what gradients are by, each number by a random
        multiple of it; by less of a name by which a state would move by more than by this part of
        its largest value in the run. Where all values are zero, in place of them one.
    seed : int, default 0
        Of the random numbers.
    **run
        Steps and start, as for :func:`liouville.vjp`.

    Returns
    -------
    GradientCheck
        Both differences.

    Raises
    ------
    TypeError, ValueError
        As of :func:`liouville.vjp`; an event that ends moved runs after other numbers of states,
        or those of members.
    IntegrationError
        A step of the run, or of a moved one, failed, or the run was interrupted.
    KeyboardInterrupt
        Another run was interrupted.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> found = lv.analysis.check_gradient(
    ...     pendulum.system, lv.Spark(2), wrt=["v", "params.g"], t=(0, 1), steps=20,
    ...     **pendulum.start,
    ... )
    >>> found.dot < 1e-13 and found.differences < 1e-9
    True
    """
    size = number("size must be a number", size)
    if not (size > 0 and math.isfinite(size)):
        raise ValueError(f"size must be positive and finite, not {size:g}")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise TypeError(f"seed must be an integer from 0 on, not {seed!r}")
    solution, pullback = vjp(system, method, wrt=wrt, t=t, params=params, **run)
    if solution.members is not None and solution.endings:
        sentence = "events end runs of members, which then have other numbers of states"
        raise ValueError(hinted(sentence, "check members one by one"))
    rng, adjoint = np.random.default_rng(seed), pullback.adjoint
    # what bends is to be seen by differences, and not refused
    adjoint.refuses_kinks = False

    def random(shape: tuple[int, ...], is_complex: bool) -> np.ndarray:
        real = np.asarray(rng.standard_normal(shape))
        return real + 1j * rng.standard_normal(shape) if is_complex else real

    is_many, span = solution.members is not None, abs(float(t[-1]) - float(t[0]))
    shapes = {x: (shape[is_many:], kind) for x, (shape, kind) in adjoint.directions.items()}
    alike = {
        x: random(*which) * _values(solution, x, which[0], span) for x, which in shapes.items()
    }
    states = {x: random(solution.states[x].shape, adjoint.is_complex) for x in pullback.states}
    own = {name: run[name] for name in OPTIONS & run.keys()}
    own_values = {x: y for x, y in run.items() if x not in {*OPTIONS, "progress", "start"}}
    start = started(run.get("start"), own_values)
    request = Request(
        t=t, params=params, tangents=alike, start=start, is_ensemble=is_many, **own
    )  # fmt: skip
    found = finished(_moving(system, method, request, run.get("progress"))).tangents
    parts = {x: _part(solution, tangent) for x, tangent in found.items()}
    directions = {
        x: np.broadcast_to(parts[x] * own, adjoint.directions[x][0]) for x, own in alike.items()
    }
    moves = {  # a row for each direction
        x: np.array([parts[name] * tangent.states[x] for name, tangent in found.items()])
        for x in states
    }
    unit = sum(float(np.abs(c * moves[x]).sum()) for x, c in states.items())
    forward = sum(float(np.vdot(c, moves[x].sum(axis=0)).real) for x, c in states.items())
    gradients = pullback(**states)
    back = sum(float(np.vdot(gradients[x], own).real) for x, own in directions.items())
    slopes = _differences(adjoint, directions, size, states)
    rest = [np.conj(c) * (slopes[x] - moves[x].sum(axis=0)) for x, c in states.items()]
    off = sum(float(np.nansum(x).real) for x in rest)
    # a run that hardly moves, or not at all, is not measured by the roundoff of its states
    sums = sum(float(np.abs(x * solution.states[name]).sum()) for name, x in states.items())
    unit = max(unit, LEAST * sums, sys.float_info.min)
    return GradientCheck(dot=abs(back - forward) / unit, differences=abs(off) / unit)


def _differences(
    adjoint: Adjoint, directions: Mapping[str, Any], size: float, like: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return derivatives of states like these by runs nearby, NaN where an event passes a record.

    Raises
    ------
    ValueError
        A run nearby has other records, or events pass them all.
    """
    found = {name: np.zeros_like(x) for name, x in like.items()}
    for count, weight in WEIGHTS.items():
        for sign in (1, -1):
            moved = adjoint.moved(directions, sign * count * size)
            if any(moved[name].shape != x.shape for name, x in found.items()):
                sentence = "an event ends a moved run after another number of states"
                raise ValueError(hinted(sentence, f"take a size below {size:g}, or a larger every"))
            for name in found:
                found[name] = found[name] + sign * weight / size * moved[name]
    if not any(np.isfinite(x).any() for x in found.values()):
        sentence = "events or switches pass every record of runs nearby"
        raise ValueError(hinted(sentence, f"take a size below {size:g}, or other times"))
    return found


def _moving(system: Any, method: Method | str, request: Request, progress: Any) -> Solution:
    """Return a run with its tangents, whatever they are."""
    if isinstance(system, Mechanics) and system.contacts is not None:
        # imported here: few systems have contacts
        from liouville._runs import contacts

        run = contacts.ensemble if request.is_ensemble else contacts.integrate
        return run(system, method, request, progress)
    return execute(runner_of(system, method, request), progress)


def _values(solution: Solution, name: str, shape: tuple[int, ...], span: float) -> np.ndarray:
    """Return the sizes of the values of what a gradient is by, 1 where all are zero."""
    if name in ENDS:
        values = np.array(span)
    elif name.startswith(PARAMS):
        values = np.abs(np.asarray(solution.params[name.removeprefix(PARAMS)], dtype=float))
        if values.ndim > len(shape):  # of members
            values = values.min(axis=0)
    else:
        values = np.array(_largest(solution.states[name]) if name in solution.states else 0.0)
    largest = float(values.max(initial=0.0))
    return np.broadcast_to(np.where(values > 0, values, largest or 1.0), shape)


def _part(solution: Solution, tangent: Tangent) -> float:
    """Return by which part of a direction no state moves by more than its size in the run."""
    sizes = {x: _largest(solution.states[x]) for x in tangent.states if x != "lam"}
    least = LEAST * max(sizes.values())
    moves = [_largest(tangent.states[x]) / (max(y, least) or 1.0) for x, y in sizes.items()]
    return 1 / max(1.0, *moves)


def _largest(values: np.ndarray) -> float:
    """Return the largest size of an array, in which members that are over are NaN."""
    return float(np.nanmax(np.abs(values), initial=0.0))
