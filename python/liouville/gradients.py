"""Gradients of functions of a run, by everything that the run depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville import _core
from liouville.control import Control
from liouville.errors import IntegrationError, hinted
from liouville.integrate import integrate
from liouville.methods import Method
from liouville.progress import Progress
from liouville.runners import MechanicalRunner, Request, runner_of
from liouville.runners.execute import Checkpoints, execute
from liouville.runners.tangents import PARAMS, check_wrt, gradients_of, shapes_of
from liouville.solution import Solution
from liouville.systems import Mechanics

Array = NDArray[np.float64]

#: Gradients by name, each of the shape of what it is by.
Gradients = dict[str, Any]

#: Moved starts of a difference of order six, in units of its step, with their weights.
WEIGHTS = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}


class Pullback:
    """The transpose of a run's derivative: from cotangents of its states to gradients.

    It is called with cotangents by the names of the states, ``q``, ``v`` and ``lam`` of a
    Lagrangian: the derivatives of some scalar by these arrays of the solution, of the same shapes.
    It returns the derivatives of that scalar by everything in `wrt`.

    The states between are made again from checkpoints, about the square root of the number of
    steps of them, so a call takes one more run, and as much again and somewhat more for the
    transposed steps. Memory grows with that root.

    Attributes
    ----------
    wrt : tuple of str
        What gradients are by.
    """

    def __init__(
        self,
        runner: MechanicalRunner,
        solution: Solution,
        checkpoints: Checkpoints,
        wrt: tuple[str, ...],
    ) -> None:
        self.wrt, self._runner, self._checkpoints = wrt, runner, checkpoints
        self._steps = int(solution.stats["steps"])
        self._solution = solution
        names: tuple[str, ...] = (*runner.system.states, "lam")
        self._is_shared = runner.shares_multipliers
        if runner.multipliers != len(runner.constraints) and not self._is_shared:
            names = names[:2]
        self._shapes = {name: solution.states[name].shape for name in names}

    @property
    def states(self) -> tuple[str, ...]:
        """The states that have cotangents."""
        return tuple(self._shapes)

    def __repr__(self) -> str:
        """Name what it takes and what it gives."""
        return f"<Pullback of {', '.join(self._shapes)} to {', '.join(self.wrt)}>"

    def __call__(self, **cotangents: ArrayLike) -> Gradients:
        """Pull cotangents of the states back; see :class:`Pullback`.

        Raises
        ------
        TypeError, ValueError
            There is no such state, or a cotangent has another shape or is not finite.
        IntegrationError
            A step cannot be differentiated.
        """
        rows, runner = self._rows(cotangents), self._runner
        longer, more = 0.0, np.zeros(0)
        if self._is_shared:
            rows, more, longer = runner.pulled_multipliers(self._solution, rows)
        core = _core.Pullback(*runner.pullback())
        kept = np.minimum(np.arange(len(rows)) * runner.every, self._steps)
        for first, last, saved in self._checkpoints.reversed(self._steps):
            own = (first < kept) & (kept <= last)
            error = core.follow(saved, last, kept[own], np.ascontiguousarray(rows[own]))
            if error is not None:
                raise self._error(error)
        found = core.end(np.ascontiguousarray(rows[0]))
        if isinstance(found, dict):
            raise self._error(found)
        of_y, of_z, of_tau, stretch = found
        if more.size:
            of_tau = of_tau + more
        moved = runner.pulled_start((of_y, of_z, of_tau))
        return gradients_of(runner.system, runner.steps, moved, stretch + longer, self.wrt)

    def _error(self, error: dict[str, Any]) -> IntegrationError:
        sentence, hint, quantity = self._runner.describe(error)
        return IntegrationError(hinted(sentence, hint), quantity=quantity)

    def _rows(self, cotangents: Mapping[str, ArrayLike]) -> Array:
        """Return cotangents of all states as rows, one for each kept time."""
        known = ", ".join(self._shapes)
        if not cotangents:
            raise TypeError(hinted("no cotangents are given", f"there are {known}"))
        for name in cotangents:
            if name not in self._shapes:
                sentence = f"there is no cotangent of '{name}'"
                raise TypeError(hinted(sentence, f"there are {known}"))
        parts = []
        for name, shape in self._shapes.items():
            value = np.asarray(cotangents[name]) if name in cotangents else np.zeros(shape)
            if value.dtype.kind not in "iuf":
                raise TypeError(f"the cotangent of '{name}' is an array of real numbers")
            if value.shape != shape:
                sentence = f"the cotangent of '{name}' has shape {value.shape}, wanted {shape}"
                raise ValueError(hinted(sentence, "it is that of the solution's array"))
            if not np.isfinite(value).all():
                raise ValueError(f"the cotangent of '{name}' is not finite")
            parts.append(value.astype(float))
        if len(parts) < 3:
            parts.append(np.zeros((len(parts[0]), self._runner.multipliers)))
        return np.concatenate(parts, axis=1)


def vjp(
    system: Mechanics,
    method: Method,
    *,
    wrt: Sequence[str],
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    control: Control | None = None,
    every: int = 1,
    params: Mapping[str, ArrayLike] | None = None,
    progress: Progress = None,
    **start: ArrayLike,
) -> tuple[Solution, Pullback]:
    r"""Integrate a mechanical system, and return the run's pullback beside its solution.

    The gradient of a scalar function of the kept states by any number of parameters takes one call
    of the pullback; see :doc:`/theory/adjoint`.

    Parameters
    ----------
    system, method, t, h, steps, rtol, atol, control, every, params, progress
        As for :func:`integrate`: a system without nonholonomic constraints, by ``Spark``,
        ``LobattoPair`` or a composition of them. Controlled steps are held.
    wrt : sequence of str
        What gradients are by: states of the system such as ``"q"`` and ``"v"``, ``"params.name"``,
        and ``"t0"`` and ``"t1"`` where steps are equal.
    **start : array_like
        Start values, as for :func:`integrate`.

    Returns
    -------
    solution : Solution
        That of :func:`integrate`, bit for bit.
    pullback : Pullback
        Takes cotangents, ``pullback(q=..., lam=...)``, and returns a dict of gradients. Those by
        starts and parameters are of the run from the start as ``system.consistent`` moves it.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, or what is asked for has no pullback.
    IntegrationError
        A step failed, or the run was interrupted; ``error.solution`` is what was computed before.

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
    request = Request(
        t=t, h=h, steps=steps, rtol=rtol, atol=atol, control=control, every=every, params=params,
        start=start, has_pullback=True,
    )  # fmt: skip
    runner = runner_of(system, method, request)
    names = check_wrt(system, wrt, runner.steps)
    assert isinstance(runner, MechanicalRunner)
    checkpoints = Checkpoints(None if runner.steps.control else runner.steps.count)
    solution = execute(runner, progress, checkpoints)
    if solution.status != "done":
        raise IntegrationError(solution.message, solution=solution)
    return solution, Pullback(runner, solution, checkpoints, names)


@dataclass(frozen=True)
class GradientCheck:
    """How well a gradient agrees with a tangent and with differences.

    Attributes
    ----------
    dot : float
        Pullback against tangent: the difference of the two pairings in a random direction and for
        random cotangents, in units of the sum of the sizes of what they add up. Roundoff.
    differences : float
        The same of central differences of order six against the tangent: their truncation and
        roundoff, about 1e-10 where nothing is wrong.
    """

    dot: float
    differences: float


def check_gradient(
    system: Mechanics,
    method: Method,
    *,
    wrt: Sequence[str],
    t: tuple[float, float],
    size: float = 2e-3,
    seed: int = 0,
    params: Mapping[str, ArrayLike] | None = None,
    **run: Any,
) -> GradientCheck:
    """Check the gradient of a run in a random direction, by its tangent and by differences.

    The two tests see different things. The pairing of tangent and pullback is exact, but agrees
    even where a model bends within a step; differences see that, with their own error.

    Parameters
    ----------
    system, method, wrt, t, params
        As for :func:`vjp`.
    size : float, default 2e-3
        By how much differences move the start, in units of a random direction of size one.
    seed : int, default 0
        Of the random numbers.
    **run
        Steps and start, as for :func:`vjp`.

    Returns
    -------
    GradientCheck
        Both differences.

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
    solution, pullback = vjp(system, method, wrt=wrt, t=t, params=params, **run)
    rng = np.random.default_rng(seed)
    shapes = shapes_of(system, pullback.wrt)
    directions = {name: rng.standard_normal(shape) for name, shape in shapes.items()}
    states = {name: rng.standard_normal(solution.states[name].shape) for name in pullback.states}
    tangents = {name: np.asarray(x) for name, x in directions.items()}
    found = integrate(system, method, t=t, params=params, tangents=tangents, **run).tangents
    parts = [states[x] * tangent.states[x] for tangent in found.values() for x in states]
    forward, unit = (float(sum(f(x).sum() for x in parts)) for f in (np.asarray, np.abs))
    gradients = pullback(**states)
    back = sum(float(np.sum(gradients[name] * x)) for name, x in directions.items())
    start = {name: run.pop(name) for name in system.states}
    slope = 0.0
    for count, weight in WEIGHTS.items():
        for sign in (1, -1):
            own = _moved(system, t, start, params, directions, sign * count * size)
            moved = integrate(system, method, **run, **own)
            terms = sum(float(np.sum(x * moved.states[name])) for name, x in states.items())
            slope += sign * weight / size * terms
    return GradientCheck(dot=abs(back - forward) / unit, differences=abs(slope - forward) / unit)


def _moved(
    system: Mechanics,
    t: tuple[float, float],
    start: Mapping[str, Any],
    params: Mapping[str, ArrayLike] | None,
    directions: Mapping[str, Any],
    size: float,
) -> dict[str, Any]:
    """Return ends, start and parameters moved by so much of all directions, on the constraints."""
    values: dict[str, Any] = {**system.params, **(params or {})}
    for name, x in directions.items():
        if name.startswith(PARAMS):
            which = name.removeprefix(PARAMS)
            values[which] = np.asarray(values[which]) + size * x
    given = dict(zip(system.states, system.start(start), strict=True))
    own = {name: x + size * directions.get(name, 0.0) for name, x in given.items()}
    first, last = (t[k] + size * directions.get(f"t{k}", 0.0) for k in (0, 1))
    on_constraints = system.consistent(t=first, params=values, **own)
    return {"t": (first, last), "params": values, **on_constraints}
