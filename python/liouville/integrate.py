"""The one way to run anything."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import memory
from liouville.errors import IntegrationError, hinted
from liouville.events import Event
from liouville.failure import Failure, told
from liouville.methods import Method
from liouville.planner import Plan
from liouville.points import Points
from liouville.propagation import Propagation
from liouville.routes import Asked, Route, route
from liouville.solution import RESIDUALS, STATES, Solution
from liouville.systems import SemiExplicit, System

#: Seconds between two looks at the signals and the progress bar.
SLICE = 0.05


def integrate(
    system: System,
    method: Method | Plan | Propagation | str,
    *,
    t: tuple[float, float] | Sequence[float],
    h: float | None = None,
    steps: int | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    h_min: float | None = None,
    control: str | None = None,
    monitor: Callable[..., Any] | None = None,
    tol: float | None = None,
    every: int = 1,
    t_eval: ArrayLike | None = None,
    events: Mapping[str, Event | Callable[..., Any]] | None = None,
    observe: Mapping[str, Callable[..., Any]] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    states: bool = True,
    progress: Callable[[float, float], None] | None = None,
    threads: int | None = None,
    store: str | os.PathLike[str] | None = None,
    checkpoint: int | str | None = None,
    **start: ArrayLike,
) -> Solution:
    r"""Integrate a system with equal steps, or with steps of its own choice.

    Parameters
    ----------
    system : System
        A Lagrangian, Hamiltonian, Mechanical, Structure, SemiExplicit, PolynomialField or
        Schrodinger: what is integrated.
    method : Method, Plan or Propagation
        How; see :doc:`/choose`. ``"auto"`` for a Schrödinger equation.
    t : tuple of two floats, or sequence of float
        Start and end, in the system's unit of time; an end before the start goes backwards. A
        Schrödinger equation takes the times of all states to keep.
    h : float, optional
        Step size, positive. The step used is ``(t1 - t0) / steps`` with the least number of steps
        that makes it at most `h`. With `rtol`, the first step; by default the method chooses it.
        With ``control="reversible"``, the step at the start.
    steps : int, optional
        Number of steps, instead of `h`.
    rtol : float, optional
        Relative tolerance, which asks for controlled steps: the estimated error that a step adds
        to the coordinates is at most ``atol + rtol * |y|``, in the root mean square over them.
        ``Spark``, ``LobattoPair`` and the alpha family take it. Such steps are for forces that
        dissipate and for short runs: in the long run they lose what a symplectic method keeps.
    atol : float or array_like, shape (n,), optional
        Absolute tolerance, for all coordinates or for each, in their own unit; ``rtol / 1000`` by
        default.
    h_min : float, optional
        The run fails where it would need a smaller step; by default where the time has too few
        digits for it.
    control : {"error", "reversible"}, optional
        What decides on the steps, None for equal ones. ``"error"`` is what `rtol` asks for.
        ``"reversible"`` makes them follow a monitor by a rule that time reversal does not see, so
        that a symmetric method keeps its long-time behaviour; see :doc:`/theory/steps`.
    monitor : callable, optional
        ``monitor(t, q, v, params)`` (the system's own states), a positive scalar: how long steps
        should be, up to a factor, which `h` gives. By default a time scale of the acceleration,
        :math:`r^{3/2}` near a centre of gravity.
    tol : float, optional
        Error of a wave function at the end, relative to its norm, which decides on the steps.
    every : int, default 1
        Keep one state in this many; the start and the end are always kept.
    t_eval : array_like, shape (k,), optional
        Times to keep states at, in the order of the run and within it, instead of one state in
        `every`. The steps are the same; between them states are interpolated, and the residuals of
        the constraints then show the error of that. Of mechanical systems.
    events : mapping of str to Event or callable, optional
        Functions ``f(t, q, v, lam, params)`` whose changes of sign are wanted, by name; see
        :class:`Event` for those that have a direction or end the run. Of mechanical systems.
    observe : mapping of str to callable, optional
        Further quantities ``f(t, q, v, params)`` (the system's own states), scalars or vectors,
        evaluated in the core at each kept step.
    params : mapping, optional
        Parameters that differ from the system's defaults.
    states : bool, default True
        Whether states and multipliers are kept; without them only invariants, residuals and
        observed quantities are.
    progress : callable, optional
        ``progress(done, total)``, called about twenty times a second: numbers of steps, or times
        where steps are controlled.
    threads : int, optional
        Threads for a polynomial field of very many variables, as many as there are processors by
        default. The result does not depend on them, bit for bit.
    store : path, optional
        A ``.zarr`` folder that the records go to while the run is going on, in constant memory;
        there must be nothing there yet. A run that was cut off goes on with :func:`resume`.
    checkpoint : int or str, optional
        How often a stored run writes down where it is: after so many steps, or so much time, as in
        ``"30s"``, ``"10min"`` or ``"2h"``. By default ``"30s"``.
    **start : array_like
        Start values by the system's names, each of shape (n,): ``q`` and ``v``, ``q`` and ``p``,
        ``y`` and ``z``, ``x``, or ``psi``. Of a ``SemiExplicit`` system z is a guess that may be
        left out. A dict by coordinate name is taken too, but for ``psi``. The alpha family also
        takes its own ``a``, to go on from ``solution.a[-1]`` with the same step size.

    Returns
    -------
    Solution
        With k = ceil(steps / every) + 1 kept times. An interrupt (Ctrl-C) returns what was done,
        with status "interrupted". A run that an event ended is done, and its message says so.
        With `store` only the first and the last record, and where the others are: its ``path``,
        for :func:`load` or ``xarray.open_zarr``.

    Raises
    ------
    TypeError
        An argument is of the wrong kind or missing, or the method does not take this system.
    ValueError
        An argument is out of range, or the start violates the constraints.
    MemoryError
        What is to be kept would not fit in memory, or the matrices of the method.
    IntegrationError
        A step failed; ``error.solution`` is what was computed before it.
    FileExistsError
        There is something at `store` already.

    Notes
    -----
    Times are :math:`t_0 + n h`, computed and not summed up; those of steps that are not equal are
    summed with what rounding loses.
    """
    asked = Asked(
        t=t, h=h, steps=steps, every=every, observe=observe, params=params, states=states,
        control={
            "rtol": rtol, "atol": atol, "h_min": h_min, "control": control, "monitor": monitor
        },
        start=start, threads=threads, tol=tol, t_eval=t_eval, events=events,
        is_stored=store is not None,
    )  # fmt: skip
    if store is None:
        if checkpoint is not None:
            raise TypeError("checkpoint is for a stored run\nhint: give store= too, a .zarr folder")
        return run(route(system, method, asked), progress)
    from liouville import stored

    place = stored.place(store, checkpoint)
    return stored.begin(route(system, method, asked), place, progress)


def run(path: Route, progress: Callable[[float, float], None] | None = None) -> Solution:
    """Go the route of a system and a method to its end, and give what it left."""
    pace = path.pace
    clock = time.perf_counter()
    started = path.start()
    outcome: str | dict[str, Any]
    events: dict[str, Points] = {}
    reached, end = pace.t0, ""
    if isinstance(started, dict):
        outcome = started
        times, rows = np.empty(0), np.empty((0, *path.members, sum(path.columns.values())))
        stats: dict[str, Any] = {"steps": 0}
    else:
        outcome = drive(started, path, progress)
        reached = started.t
        (times, rows), stats = started.take(), path.stats(started)
        events, end = path.seen(started)
    stats["seconds"] = time.perf_counter() - clock

    status, message, quantity = verdict(outcome, path, stats, end)
    failures: dict[int, Failure] = {}
    if path.members and not isinstance(started, dict):
        failures = failed(started, path)
        message = _of_members(started, path, outcome, message, failures)
        if outcome == "done":
            stats["steps"] = pace.count
    ended = status, message
    solution = solution_of(path, times, rows, stats, reached, ended, events, failures)
    if failures and not solution.t.size:
        member, first = next(iter(failures.items()))
        raise IntegrationError(
            message, t=first.t, step=first.step, member=member, solution=solution
        )
    if isinstance(outcome, dict):
        raise failure(outcome, path, quantity, solution) from outcome.get("cause")
    return solution


def verdict(
    outcome: str | dict[str, Any], path: Route, stats: dict[str, Any], end: str
) -> tuple[str, str, str]:
    """Give status and message of a run, and which quantity is to blame if it failed."""
    if isinstance(outcome, dict):
        stats["steps"] = outcome.get("step", 0)
        return ("failed", *explained(outcome, path))
    if outcome == "interrupted":
        return outcome, f"interrupted after {stats['steps']}{path.pace.total} steps", ""
    return "done", end, ""


def _of_members(
    run: _core.Run,
    path: Route,
    outcome: str | dict[str, Any],
    message: str,
    failures: Mapping[int, Failure],
) -> str:
    """Give the message of an ensemble: how many of its members are over, and how many failed."""
    if isinstance(outcome, dict):
        return message
    if outcome == "interrupted":
        message = f"interrupted when {run.over} of {path.members[0]} members were over"
    return "; ".join(filter(None, [message, told(failures, path.members[0])]))


def failure(
    trouble: dict[str, Any], path: Route, quantity: str, solution: Solution
) -> IntegrationError:
    """Give the error of a run that failed, with what was computed before."""
    return IntegrationError(
        solution.message,
        t=trouble.get("start", path.pace.t0),
        step=int(solution.stats["steps"]),
        quantity=quantity,
        member=trouble.get("member") if path.members else None,
        solution=solution,
    )


def solution_of(
    path: Route,
    times: np.ndarray,
    rows: np.ndarray,
    stats: dict[str, Any],
    reached: float,
    outcome: tuple[str, str],
    events: Mapping[str, Points],
    failures: Mapping[int, Failure] | None = None,
) -> Solution:
    """Say what records of a route mean; `outcome` is status and message."""
    cuts = np.cumsum([*path.columns.values()])[:-1]
    # without any columns there is one empty part
    columns = dict(zip(path.columns, np.split(rows, cuts, axis=-1), strict=bool(path.columns)))
    parts = path.read(columns)
    return Solution(
        t=times,
        states={name: parts[name] for name in STATES if name in parts},
        invariants=_named("invariant ", parts),
        residuals={name: parts[name] for name in RESIDUALS if name in parts},
        observed=_named("observed ", parts),
        balance=path.balance(parts),
        names=_names(path),
        events=dict(events),
        dense_order=path.dense_order,
        h=path.pace.mean(np.array([reached]), stats["steps"]),
        tolerances=path.pace.tolerances,
        method=path.method,
        stats=stats,
        params=plain(path.params),
        status=outcome[0],
        message=outcome[1],
        members=path.members[0] if path.members else None,
        failures=dict(failures or {}),
        system=path.system,
    )


def drive(
    run: _core.Run, path: Route, progress: Callable[[float, float], None] | None
) -> str | dict[str, Any]:
    """Advance to the end, or until memory is full; returns how that ended."""
    most = path.every * memory() / path.row
    report = reporting(run, path, progress)
    try:
        while (outcome := advanced(run)) == "paused":
            report()
            if run.done > most:
                return {"kind": "no memory", "step": run.done, "start": run.t}
    except KeyboardInterrupt:
        return "interrupted"
    report()
    return outcome


def reporting(
    run: _core.Run, path: Route, progress: Callable[[float, float], None] | None
) -> Callable[[], None]:
    """Make what tells the caller how far a run is."""
    if progress is not None and not callable(progress):
        raise TypeError(f"progress is a function, not {progress!r}")
    pace = path.pace

    def report() -> None:
        if progress is None:
            return
        if pace.control is None:
            progress(run.done, pace.count)
        else:
            progress(abs(run.t - pace.t0), abs(pace.t1 - pace.t0))

    return report


def advanced(run: _core.Run, steps: int | None = None) -> str | dict[str, Any]:
    """Advance for a slice of time, to so many steps at most; returns how that ended."""
    try:
        return run.advance(SLICE, steps)
    except Exception as error:  # of a function of the user's that makes products
        return {"kind": "raised", "cause": error, "step": run.done, "start": run.t}


def failed(run: _core.Run, path: Route) -> dict[int, Failure]:
    """Return the members that failed, and why."""
    found = {}
    for trouble in run.failures():
        member, t = trouble.pop("member"), trouble.get("start", path.pace.t0)
        found[member] = Failure(trouble.get("step", 0), t, explained(trouble, path)[0])
    return found


def _names(path: Route) -> dict[str, tuple[str, ...]]:
    names = {"coordinates": path.system.coordinates, "constraints": path.constraints}
    if isinstance(path.system, SemiExplicit):
        names["unknowns"] = path.system.unknowns
    return names


def _named(prefix: str, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    found = {k.removeprefix(prefix): x for k, x in parts.items() if k.startswith(prefix)}
    return {name: x[..., 0] if x.shape[-1] == 1 else x for name, x in found.items()}


def plain(params: Mapping[str, Any]) -> dict[str, float | list[float]]:
    """Return parameters as numbers and lists of such."""
    arrays = {name: np.asarray(value, dtype=float) for name, value in params.items()}
    return {name: x.tolist() if x.ndim else float(x) for name, x in arrays.items()}


def explained(trouble: dict[str, Any], path: Route) -> tuple[str, str]:
    """Say where a run failed, why, and what to try; with it, which quantity is to blame."""
    if "step" in trouble:
        where = f"step {trouble['step']}{path.pace.total} at t = {trouble['start']:.6g} failed"
    else:
        where = f"the start at t = {path.pace.t0:.6g} cannot be taken"
    sentence, hint, quantity = path.describe(trouble)
    return hinted(f"{where}: {sentence}", hint), quantity
