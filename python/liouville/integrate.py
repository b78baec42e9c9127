"""The one way to run anything."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import MOST_STEPS, Steps, check_memory, count, memory, steps_of
from liouville.errors import IntegrationError, describe, hinted
from liouville.methods import METHODS, Method, Spark
from liouville.solution import STATES, Solution
from liouville.systems import Mechanical, Mechanics

#: Seconds between two looks at the signals and the progress bar.
SLICE = 0.05

KEEP_LESS = "keep fewer with every=, or none with states=False"


def integrate(
    system: Mechanics,
    method: Method,
    *,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    rtol: float | None = None,
    atol: ArrayLike | None = None,
    h_min: float | None = None,
    every: int = 1,
    observe: Mapping[str, Callable[..., Any]] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    states: bool = True,
    progress: Callable[[float, float], None] | None = None,
    **start: ArrayLike,
) -> Solution:
    r"""Integrate a system with equal steps, or with steps controlled by their errors.

    Parameters
    ----------
    system : Lagrangian, Hamiltonian, Mechanical or Structure
        What is integrated.
    method : Spark, HHT, GeneralizedAlpha or ArnoldBruls
        How; see :doc:`/choose`.
    t : tuple of two floats
        Start and end, in the system's unit of time; an end before the start goes backwards.
    h : float, optional
        Step size, positive. The step used is ``(t1 - t0) / steps`` with the least number of steps
        that makes it at most `h`. With `rtol`, the first step; by default the method chooses it.
    steps : int, optional
        Number of steps, instead of `h`.
    rtol : float, optional
        Relative tolerance, which asks for controlled steps: the estimated error that a step adds
        to the coordinates is at most ``atol + rtol * |y|``, in the root mean square over them. All
        methods but ``Spark`` take it.
    atol : float or array_like, shape (n,), optional
        Absolute tolerance, for all coordinates or for each, in their own unit; ``rtol / 1000`` by
        default.
    h_min : float, optional
        The run fails where it would need a smaller step; by default where the time has too few
        digits for it.
    every : int, default 1
        Keep one state in this many; the start and the end are always kept.
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
    **start : array_like
        Start values by the system's names, each of shape (n,): ``q`` and ``v``, ``q`` and ``p``,
        or ``y`` and ``z``. A dict by coordinate name is taken too. All methods but ``Spark`` also
        take their own ``a``, to go on from ``solution.a[-1]`` with the same step size.

    Returns
    -------
    Solution
        With k = ceil(steps / every) + 1 kept times. An interrupt (Ctrl-C) returns what was done,
        with status "interrupted".

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

    Notes
    -----
    Times are :math:`t_0 + n h`, computed and not summed up, but for controlled steps.
    """
    _check_kinds(system, method, states, progress)
    is_general = method.form == "general"
    control = {"rtol": rtol, "atol": atol, "h_min": h_min}
    equal = type(method).__name__ if is_general else ""
    pace = steps_of(t, h, steps, control, system.coordinates, equal)
    every = min(count("every", every), pace.count if pace.control is None else MOST_STEPS)
    values = system.values(params)
    begin = system.start(start, () if is_general else ("a",))
    goes_on = len(begin) == 3 and getattr(method, "reaction", "") == "position"
    # such a method leaves the hidden constraint by itself, and goes on from there
    system.check(pace.t0, begin[0], begin[1], values, hidden=not goes_on)
    tape, widths = system.observer(observe, states)
    columns = _columns(system, method, widths, states)
    row = 8 * (1 + sum(columns.values()))
    _check_sizes(system, method, -(-pace.count // every) + 1, row)
    problem = system.problem if is_general else system.second_order

    clock = time.perf_counter()
    run = _core.MechanicalRun.start(
        problem, method, tape, values, begin, (pace.t0, pace.t1, pace.count, every),
        pace.control, states,
    )  # fmt: skip
    outcome: str | dict[str, Any]
    if isinstance(run, dict):
        outcome = run
        times, rows = np.empty(0), np.empty((0, sum(columns.values())))
        stats: dict[str, Any] = {"steps": 0}
    else:
        outcome = _drive(run, pace, progress, every * memory() / row)
        (times, rows), stats = run.take(), {"steps": run.done, **run.stats}
    stats["seconds"] = time.perf_counter() - clock

    status, message, quantity = "done", "", ""
    if isinstance(outcome, dict):
        status = "failed"
        message, quantity = _explain(outcome, system, method, widths, pace)
    elif outcome == "interrupted":
        status, message = outcome, f"interrupted after {stats['steps']}{pace.total} steps"
    if stats["steps"] and is_general:
        stats["solver"] = _solver(stats)
    parts = dict(zip(columns, np.split(rows, np.cumsum([*columns.values()])[:-1], 1), strict=True))
    solution = Solution(
        t=times,
        states={name: parts[name] for name in STATES if name in parts},
        invariants=_named("invariant ", parts),
        residuals={name: parts[name] for name in ("constraint", "hidden")},
        observed=_named("observed ", parts),
        balance=_balance(system, parts),
        names={"coordinates": system.coordinates, "constraints": system.constraints},
        h=pace.mean(times, stats["steps"]),
        tolerances=pace.tolerances,
        method=repr(method),
        stats=stats,
        params=_plain({**system.params, **dict(params or {})}),
        status=status,
        message=message,
        system=system,
    )
    if isinstance(outcome, dict):
        raise IntegrationError(
            message,
            t=outcome.get("start", pace.t0),
            step=stats["steps"],
            quantity=quantity,
            solution=solution,
        )
    return solution


def _check_kinds(system: Any, method: Any, states: Any, progress: Any) -> None:
    if not isinstance(system, Mechanics):
        raise TypeError(
            f"system is a Lagrangian, Hamiltonian, Mechanical or Structure, not {system!r}"
        )
    if not isinstance(method, tuple(METHODS.values())):
        known = ", ".join(cls.__name__ for cls in METHODS.values())
        raise TypeError(f"{method!r} does not step mechanical systems; methods that do: {known}")
    if not isinstance(states, bool):
        raise TypeError(f"states is True or False, not {states!r}")
    if progress is not None and not callable(progress):
        raise TypeError(f"progress is a function, not {progress!r}")


def _check_sizes(system: Mechanics, method: Method, kept: int, row: int) -> None:
    check_memory(f"keeping {kept} states", kept * row, KEEP_LESS)
    if isinstance(method, Spark):
        n, m, s = len(system.coordinates), len(system.constraints), method.stages
        dense = s * m * (n + s * m) if method.solver == "node-schur" else 2 * (s * (n + m)) ** 2
        hint = "HHT and its relatives take large sparse systems"
        check_memory(f"{method!r} on {n} coordinates, dense,", 8 * dense, hint)


def _drive(
    run: _core.MechanicalRun,
    pace: Steps,
    progress: Callable[[float, float], None] | None,
    most: float,
) -> str | dict[str, Any]:
    """Advance to the end, and at most by so many steps; returns how that ended."""

    def report() -> None:
        if progress is None:
            return
        if pace.control is None:
            progress(run.done, pace.count)
        else:
            progress(abs(run.t - pace.t0), abs(pace.t1 - pace.t0))

    try:
        while (outcome := run.advance(SLICE)) == "paused":
            report()
            if run.done > most:
                return {"kind": "no memory", "step": run.done, "start": run.t}
    except KeyboardInterrupt:
        return "interrupted"
    report()
    return outcome


def _solver(stats: Mapping[str, int]) -> str:
    if stats["newton_steps"] == 0:
        return "node-schur"
    return "newton" if stats["newton_steps"] >= stats["steps"] else "node-schur and newton"


def _columns(
    system: Mechanics, method: Method, widths: Mapping[str, int], states: bool
) -> dict[str, int]:
    """Name the columns of a run's rows, with their widths."""
    n, m = len(system.coordinates), len(system.constraints)
    own = dict(zip((*system.states, "lam"), (n, n, m), strict=True)) if states else {}
    if method.form == "second order":
        own |= {"acceleration": n, "a": n} if states else {}
        own["work"] = 1
    return {**own, **widths}


def _named(prefix: str, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    found = {k.removeprefix(prefix): x for k, x in parts.items() if k.startswith(prefix)}
    return {name: x[:, 0] if x.shape[1] == 1 else x for name, x in found.items()}


def _balance(system: Mechanics, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Say where the energy went, if the system tells forces with a potential from others."""
    if "work" not in parts or isinstance(system, Mechanical):
        return {}
    energy, work = (parts[name][:, 0] for name in ("invariant energy", "work"))
    return {"work": work, "dissipated": energy[:1] + work - energy}


def _plain(params: Mapping[str, Any]) -> dict[str, float | list[float]]:
    arrays = {name: np.asarray(value, dtype=float) for name, value in params.items()}
    return {name: x.tolist() if x.ndim else float(x) for name, x in arrays.items()}


def _explain(
    trouble: dict[str, Any],
    system: Mechanics,
    method: Method,
    widths: Mapping[str, int],
    pace: Steps,
) -> tuple[str, str]:
    if trouble.get("quantity") == "observable":
        trouble |= _observable(trouble["index"], widths)
    if "step" in trouble:
        where = f"step {trouble['step']}{pace.total} at t = {trouble['start']:.6g} failed"
    else:
        where = f"the start at t = {pace.t0:.6g} cannot be taken"
    sentence, hint, quantity = describe(trouble, system.coordinates, system.constraints)
    if trouble["kind"] == "not converged" and getattr(method, "solver", "") == "node-schur":
        hint += ", or solver='auto', which takes stiff forces too"
    return hinted(f"{where}: {sentence}", hint), quantity


def _observable(index: int, widths: Mapping[str, int]) -> dict[str, Any]:
    """Say which part of a record an index falls into, and where in that part."""
    models = {"p": "momentum", "v": "velocity", "hidden": "hidden constraint"}
    for part, width in widths.items():
        if index < width:
            return {"quantity": models.get(part, part), "index": index}
        index -= width
    return {}
