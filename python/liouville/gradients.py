"""Gradients of functions of a run, by everything that the run depends on."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._arguments import kept, number
from liouville._options import started
from liouville.control import Control
from liouville.errors import IntegrationError, hinted
from liouville.events import Event
from liouville.methods import Method
from liouville.progress import Progress
from liouville.runners import Request, check_system, runner_of
from liouville.runners.adjoint import EVENTS, INVARIANTS, Adjoint, Gradients
from liouville.runners.execute import execute, finished
from liouville.runners.tangents import ENDS, PARAMS
from liouville.solution import Solution
from liouville.systems import Field, Mechanics, Schrodinger, SemiExplicit, members
from liouville.tangents import Tangent

#: Moved starts of a difference of order six, in units of its step, with their weights.
WEIGHTS = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}

#: The arguments of :func:`vjp` that a run with tangents takes too.
OPTIONS = {"h", "steps", "rtol", "atol", "control", "every", "t_eval", "events", "threads"}

#: The part of the largest state that a smaller one counts as where directions are scaled, and the
#: part of the states' own pairing that differences are measured by at least.
LEAST = 1e-3


class Pullback:
    r"""The transpose of a run's derivative: from cotangents of its states to gradients.

    It is called with cotangents by the names of the states, ``q``, ``v`` and ``lam`` of a
    Lagrangian: the derivatives of some scalar by these arrays of the solution, of the same shapes.
    It returns the derivatives of that scalar by everything in `wrt`. Those by times of events and
    by the states there are ``events={"name": {"t": ..., "q": ...}}``, those by invariants of a
    mechanical or semi-explicit system ``invariants={"energy": ...}``.

    Cotangents of an ensemble have the member as their second axis, as its solution has, and its
    gradients have it as their first. Those of events are rows as in ``solution.events``, of one
    member after another; behind the end of a member's run they are zero. Members are pulled back
    in lock-step where they run so, without events, given times and cases of the model, otherwise
    one by one, from runs with the same bits, on as many threads as :func:`vjp` was given; wave
    functions from the run of all, where what it leaves fits in memory.

    On constraints the run records its steps, at most 64 MiB of them, and the first call follows
    these back. All others are made again from checkpoints, at most the square root of the number of
    steps of them, so a call takes up to one more run, and as much again and somewhat more for the
    transposed steps. Memory grows with that root. On constraints steps behind the last cotangent
    that is not zero are left out: what has no derivative there, as hits that accumulate, does not
    matter.

    A cotangent of ``psi`` is complex: with F a real function of the states kept, it is the array c
    for which :math:`dF = \operatorname{Re} \langle c | d\psi \rangle`, such as
    :math:`2 A \psi` for :math:`F = \langle \psi | A | \psi \rangle` and
    :math:`2 \varphi \langle \varphi | \psi \rangle` for
    :math:`F = |\langle \varphi | \psi \rangle|^2`. The gradient by a start ``psi`` is complex in
    the same way. States at the starts of windows are kept by the run, the terms of a window are
    made again.

    Attributes
    ----------
    wrt : tuple of str
        What gradients are by.
    adjoint : Adjoint
        The part of it that the family of the system has.
    """

    def __init__(self, adjoint: Adjoint, solution: Solution) -> None:
        self.wrt, self.adjoint, self._solution = adjoint.wrt, adjoint, solution
        self._shapes = adjoint.shapes(solution)

    @property
    def states(self) -> tuple[str, ...]:
        """The states that have cotangents."""
        others = EVENTS, INVARIANTS
        return tuple(name for name in self._shapes if not name.startswith(others))

    def __repr__(self) -> str:
        """Name what it takes and what it gives."""
        return f"<Pullback of {', '.join(self._shapes)} to {', '.join(self.wrt)}>"

    def __call__(self, **cotangents: Any) -> Gradients:
        """Pull cotangents of states, events and invariants back; see :class:`Pullback`.

        Raises
        ------
        TypeError, ValueError
            There is no such state, or a cotangent has another shape or is not finite.
        IntegrationError
            A step cannot be differentiated, or one that cotangents depend on begins at a kink of
            the model or passes over a jump of its equations that moves.
        KeyboardInterrupt
            It was interrupted (Ctrl-C); it may be called again.
        """
        events = cotangents.pop("events", {})
        given = [events, *events.values()] if isinstance(events, Mapping) else [None]
        if not all(isinstance(x, Mapping) for x in given):
            hint = 'write events={"name": {"t": ...}}'
            raise TypeError(hinted("cotangents of events are mappings of their states", hint))
        of_events = {f"{EVENTS}{e}.{x}": y for e, own in events.items() for x, y in own.items()}
        invariants = cotangents.pop("invariants", {})
        if not isinstance(invariants, Mapping):
            hint = 'write invariants={"energy": ...}'
            raise TypeError(hinted("cotangents of invariants are a mapping of their names", hint))
        of_invariants = {f"{INVARIANTS}{name}": x for name, x in invariants.items()}
        named = cotangents | of_events | of_invariants
        return self.adjoint.pulled(self._solution, self._checked(named))

    def _checked(self, cotangents: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
        """Return cotangents of all states, zero where none is given."""
        known = ", ".join(self._shapes)
        if not cotangents:
            raise TypeError(hinted("no cotangents are given", f"there are {known}"))
        for name in cotangents:
            if name not in self._shapes:
                sentence = f"there is no cotangent of '{name}'"
                raise TypeError(hinted(sentence, f"there are {known}"))
        is_complex, parts = self.adjoint.is_complex, {}
        kinds, kind = ("iufc", "complex") if is_complex else ("iuf", "real")
        for name, shape in self._shapes.items():
            try:
                value = np.asarray(cotangents[name]) if name in cotangents else np.zeros(shape)
            except ValueError:  # of rows of several lengths
                value = np.empty(0, dtype=object)
            if np.ma.is_masked(cotangents.get(name)):
                sentence = f"the cotangent of '{name}' has masked numbers"
                hint = "give zeros where nothing is to be pulled back: x.filled(0)"
                raise TypeError(hinted(sentence, hint))
            if value.dtype.kind not in kinds:
                raise TypeError(f"the cotangent of '{name}' is an array of {kind} numbers")
            if value.shape != shape:
                sentence = f"the cotangent of '{name}' has shape {value.shape}, wanted {shape}"
                raise ValueError(hinted(sentence, "it is that of the solution's array"))
            if not np.isfinite(value).all():
                raise ValueError(f"the cotangent of '{name}' is not finite")
            parts[name] = value.astype(complex if is_complex else float)
        return parts


def vjp(
    system: Mechanics | SemiExplicit | Field | Schrodinger,
    method: Method | str,
    *,
    wrt: Sequence[str],
    t: tuple[float, float] | Sequence[float],
    h: float | None = None,
    steps: int | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    control: Control | None = None,
    every: int = 1,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Event | Callable[..., Any]] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Progress = None,
    threads: int | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> tuple[Solution, Pullback]:
    r"""Integrate a system, and return the run's pullback beside its solution.

    The gradient of a scalar function of the kept states by any number of parameters takes one call
    of the pullback; see :doc:`/theory/adjoint`.

    Starts or parameters with a row for each of P members make an ensemble, as :func:`ensemble`
    takes it. Its gradients have the member as their first axis, whether a name has a value for each
    member or one for all: the gradient of a sum over members by what they share is
    ``gradient.sum(axis=0)``.

    Parameters
    ----------
    system, method, t, h, steps, rtol, atol, control, every, t_eval, events, params, progress
        As for :func:`integrate`, and of members as for :func:`ensemble`: a mechanical or
        semi-explicit system by ``Spark``, ``LobattoPair`` or a composition of them, whose
        controlled steps are held, as are the times in `t_eval`; a mechanical one by ``HHT``,
        ``GeneralizedAlpha`` and ``ArnoldBruls`` too, whose controlled steps end at no switches; a
        field without divergence; or a Schrödinger equation by ``"auto"``, ``Chebyshev``,
        ``Magnus`` with `h` or `steps`, or splittings of a real H into shears. Bounds, windows,
        steps and the numbers of terms are held.
    wrt : sequence of str
        What gradients are by: states of the system such as ``"q"`` and ``"v"``, ``"params.name"``,
        and ``"t0"`` and ``"t1"`` where steps are equal. Parameters of a field are those of its
        coefficients. Of a Schrödinger equation ``"psi"``, parameters of its drive and of the
        potential of a grid, and ``"drive[k]"``, the samples of a drive.
    threads : int, optional
        At most and by default as many as this process has processors. They take the members of an
        ensemble in turn, or the rows of a large wave function. The result does not depend on them.
    start, **values : mapping, or array_like by name
        Start values, as for :func:`integrate` or :func:`ensemble`.

    Returns
    -------
    solution : Solution
        That of :func:`integrate` or :func:`ensemble`, bit for bit, by
        ``LobattoPair(2)`` to roundoff; of an H that is differentiated by parameters or samples to
        the tolerance, as its series then have the terms, and its windows the ends, that derivatives
        need.
    pullback : Pullback
        Takes cotangents, ``pullback(q=..., lam=...)``, and returns a dict of gradients. Those by
        starts and parameters are of the run from the start as ``system.consistent`` moves it.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, or what is asked for has no pullback.
    IntegrationError
        A step of any member failed, or the run was interrupted; ``error.solution`` is what was
        computed before.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> run = {"t": (0, 1), "steps": 50, "every": 50}
    >>> solution, pullback = lv.vjp(
    ...     pendulum.system, lv.Spark(2), wrt=["v", "params.g"], **run, **pendulum.start
    ... )
    >>> by = pullback(q=[[0, 0], [0, 1]])  # of the height at the end
    >>> by["v"].shape
    (2,)
    """
    check_system(system)
    # members are run again by what is given here, which the caller may change meanwhile
    t, t_eval, params, given = (kept(x) for x in (t, t_eval, params, started(start, values)))
    request = Request(
        t=t, h=h, steps=steps, rtol=rtol, atol=atol, control=control, every=every, t_eval=t_eval,
        events=events, params=params, start=given, has_pullback=True, threads=threads,
        is_ensemble=members.are_given(system, given, params),
    )  # fmt: skip
    adjoint = runner_of(system, method, request).adjoint(request, wrt)
    solution = execute(adjoint.runner, progress, adjoint.checkpoints)
    if solution.status != "done":
        raise IntegrationError(solution.message, solution=solution)
    return solution, Pullback(adjoint, solution)


@dataclass(frozen=True)
class GradientCheck:
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
    method: Method | str,
    *,
    wrt: Sequence[str],
    t: tuple[float, float] | Sequence[float],
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
    a run with the same steps, so that steps on constraints have to be equal; of a Schrödinger
    equation bounds, windows and numbers of terms are the same.
    Members of an ensemble are moved in the same direction.

    Parameters
    ----------
    system, method, wrt, t, params
        As for :func:`vjp`.
    size : float, default 1e-3
        By which part of its values differences move what gradients are by, each number by a random
        multiple of it; by less of a name by which a state would move by more than by this part of
        its largest value in the run. Where all values are zero, in place of them one.
    seed : int, default 0
        Of the random numbers.
    **run
        Steps and start, as for :func:`vjp`.

    Returns
    -------
    GradientCheck
        Both differences.

    Raises
    ------
    TypeError, ValueError
        As of :func:`vjp`; controlled steps on constraints, which a moved run does not repeat, an
        event that ends moved runs after other numbers of states, or those of members.
    IntegrationError
        A step of the run, or of a moved one, failed, or the run was interrupted.
    KeyboardInterrupt
        Another run was interrupted.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> found = lv.check_gradient(
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
    if isinstance(system, Mechanics | SemiExplicit) and (
        run.get("rtol") is not None or run.get("control") is not None
    ):
        sentence = "runs moved by differences would take other steps where steps are controlled"
        raise TypeError(hinted(sentence, "give h or steps: equal ones are checked"))
    solution, pullback = vjp(system, method, wrt=wrt, t=t, params=params, **run)
    if solution.members is not None and solution.endings:
        sentence = "events end runs of members, which then have other numbers of states"
        raise ValueError(hinted(sentence, "check members one by one"))
    rng, adjoint = np.random.default_rng(seed), pullback.adjoint

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
    # what bends is to be seen by differences, and not refused
    adjoint.refuses_kinks = False
    moving = finished(execute(runner_of(system, method, request), run.get("progress")))
    found = moving.tangents
    parts = {x: _part(solution, tangent) for x, tangent in found.items()}
    directions = {
        x: np.broadcast_to(parts[x] * own, adjoint.directions[x][0]) for x, own in alike.items()
    }
    terms = [
        parts[name] * np.conj(states[x]) * tangent.states[x]
        for name, tangent in found.items()
        for x in states
    ]
    forward, unit = (float(sum(f(x).real.sum() for x in terms)) for f in (np.asarray, np.abs))
    gradients = pullback(**states)
    back = sum(float(np.vdot(gradients[x], own).real) for x, own in directions.items())
    slope = 0.0
    for count, weight in WEIGHTS.items():
        for sign in (1, -1):
            moved = adjoint.moved(directions, sign * count * size)
            if any(moved[name].shape != x.shape for name, x in states.items()):
                sentence = "an event ends a moved run after another number of states"
                raise ValueError(hinted(sentence, f"take a size below {size:g}, or a larger every"))
            pairing = sum(float(np.vdot(x, moved[name]).real) for name, x in states.items())
            slope += sign * weight / size * pairing
    # a run that hardly moves, or not at all, is not measured by the roundoff of its states
    sums = sum(float(np.abs(x * solution.states[name]).sum()) for name, x in states.items())
    unit = max(unit, LEAST * sums, sys.float_info.min)
    return GradientCheck(dot=abs(back - forward) / unit, differences=abs(slope - forward) / unit)


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
