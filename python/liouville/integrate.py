"""The one way to run anything."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville.errors import IntegrationError, describe, hinted
from liouville.methods import METHODS, Spark
from liouville.solution import Solution
from liouville.systems import Mechanics

#: Seconds between two looks at the signals and the progress bar.
SLICE = 0.05

#: Beyond this, a step's number and its time are no longer exact.
MOST_STEPS = 2**53


def integrate(
    system: Mechanics,
    method: Spark,
    *,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    every: int = 1,
    observe: Mapping[str, Callable[..., Any]] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    states: bool = True,
    progress: Callable[[int, int], None] | None = None,
    **start: ArrayLike,
) -> Solution:
    r"""Integrate a system with a constant step size.

    Parameters
    ----------
    system : Lagrangian, Hamiltonian or Mechanical
        What is integrated.
    method : Spark
        How; see :doc:`/choose`.
    t : tuple of two floats
        Start and end, in the system's unit of time; an end before the start goes backwards.
    h : float, optional
        Step size, positive. The step used is ``(t1 - t0) / steps`` with the least number of steps
        that makes it at most `h`.
    steps : int, optional
        Number of steps, instead of `h`.
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
        ``progress(done, total)``, called about twenty times a second.
    **start : array_like
        Start values by the system's names, each of shape (n,): ``q`` and ``v``, ``q`` and ``p``,
        or ``y`` and ``z``. A dict by coordinate name is taken too.

    Returns
    -------
    Solution
        With k = ceil(steps / every) + 1 kept times. An interrupt (Ctrl-C) returns what was done,
        with status "interrupted".

    Raises
    ------
    TypeError
        An argument is of the wrong kind or missing.
    ValueError
        An argument is out of range, or the start violates the constraints.
    MemoryError
        What is to be kept would not fit in memory.
    IntegrationError
        A step failed; ``error.solution`` is what was computed before it.

    Notes
    -----
    Times are :math:`t_0 + n h`, computed and not summed up.
    """
    _check_kinds(system, method, states, progress)
    t0, t1 = _interval(t)
    count = _steps(t0, t1, h, steps)
    every = min(_positive("every", every), count)
    values = system.values(params)
    y, z = system.start(start)
    system.check(t0, y, z, values)
    tape, widths = system.observer(observe, states)
    _check_memory(-(-count // every) + 1, tape.outputs + (3 * y.size if states else 0))

    step = (t1 - t0) / count
    begin = time.perf_counter()
    run = _core.MechanicalRun.start(
        system.problem, method, tape, values, y, z, (t0, step, count, every), states
    )
    outcome: str | dict[str, Any]
    if isinstance(run, dict):
        outcome = run
        times, rows = np.empty(0), np.empty((0, sum(_columns(system, widths, states).values())))
        stats: dict[str, Any] = {"steps": 0}
    else:
        outcome = _drive(run, count, progress)
        (times, rows), stats = run.take(), {"steps": run.done, **run.stats}
    stats["seconds"] = time.perf_counter() - begin

    status, message, quantity = "done", "", ""
    if isinstance(outcome, dict):
        status = "failed"
        message, quantity = _explain(outcome, system, method, widths, (t0, count))
    elif outcome == "interrupted":
        status, message = outcome, f"interrupted after {stats['steps']} of {count} steps"
    if stats["steps"]:
        stats["solver"] = _solver(stats)
    solution = _solution(
        system,
        method,
        times,
        _split(system, widths, states, rows),
        h=step,
        stats=stats,
        params=params,
        status=status,
        message=message,
    )
    if isinstance(outcome, dict):
        raise IntegrationError(
            message,
            t=outcome.get("start", t0),
            step=stats["steps"],
            quantity=quantity,
            solution=solution,
        )
    return solution


def _check_kinds(system: Any, method: Any, states: Any, progress: Any) -> None:
    if not isinstance(system, Mechanics):
        raise TypeError(f"system is a Lagrangian, Hamiltonian or Mechanical, not {system!r}")
    if not isinstance(method, tuple(METHODS.values())):
        known = ", ".join(cls.__name__ for cls in METHODS.values())
        raise TypeError(f"{method!r} does not step mechanical systems; methods that do: {known}")
    if not isinstance(states, bool):
        raise TypeError(f"states is True or False, not {states!r}")
    if progress is not None and not callable(progress):
        raise TypeError(f"progress is a function, not {progress!r}")


def _interval(t: Any) -> tuple[float, float]:
    if not isinstance(t, (tuple, list, np.ndarray)) or len(t) != 2:
        raise TypeError(f"t is a pair (start, end), not {t!r}")
    t0, t1 = (_number("t is a pair of numbers", x) for x in t)
    if not math.isfinite(t1 - t0):
        raise ValueError(f"t is a finite interval, not ({t0:g}, {t1:g})")
    if t0 == t1:
        raise ValueError(f"t = ({t0:g}, {t1:g}) is no interval")
    return t0, t1


def _number(wanted: str, value: Any) -> float:
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise TypeError(f"{wanted}, not {value!r}")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _positive(name: str, value: Any) -> int:
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} is an integer, not {value!r}")
    if value < 1:
        raise ValueError(f"{name} is at least 1, not {value}")
    return int(value)


def _steps(t0: float, t1: float, h: Any, steps: Any) -> int:
    if (h is None) == (steps is None):
        raise TypeError("give either h or steps")
    if h is None:
        count = float(min(_positive("steps", steps), MOST_STEPS))
    else:
        h = _number("h is a number", h)
        if not (math.isfinite(h) and h > 0):
            raise ValueError(
                hinted(f"h is positive and finite, not {h}", "to go backwards, give t=(end, start)")
            )
        if h > abs(t1 - t0) * (1 + 1e-9):
            raise ValueError(f"h = {h:g} is larger than the interval, {abs(t1 - t0):g}")
        count = abs(t1 - t0) / h * (1 - 1e-12)
    if count >= MOST_STEPS:
        what = "steps" if h is None else f"h = {h:g}"
        raise ValueError(f"{what}: more than {MOST_STEPS:.0e} steps cannot be counted")
    count = math.ceil(count)
    if t0 + (t1 - t0) / count == t0:
        raise ValueError(f"a step of {(t1 - t0) / count:g} does not move t = {t0:g}")
    return count


def _check_memory(kept: int, width: int) -> None:
    needed = 8 * kept * (width + 1)
    there = 2**36
    if hasattr(os, "sysconf"):
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > 0.8 * there:
        raise MemoryError(
            hinted(
                f"keeping {kept} states takes {needed / 2**30:.0f} GiB, more than this machine has",
                "keep fewer with every=, or none with states=False",
            )
        )


def _drive(
    run: _core.MechanicalRun, count: int, progress: Callable[[int, int], None] | None
) -> str | dict[str, Any]:
    try:
        while (outcome := run.advance(SLICE)) == "paused":
            if progress is not None:
                progress(run.done, count)
    except KeyboardInterrupt:
        return "interrupted"
    if progress is not None:
        progress(run.done, count)
    return outcome


def _solver(stats: Mapping[str, int]) -> str:
    if stats["newton_steps"] == 0:
        return "node-schur"
    return "newton" if stats["newton_steps"] >= stats["steps"] else "node-schur and newton"


def _columns(system: Mechanics, widths: Mapping[str, int], states: bool) -> dict[str, int]:
    """Name the columns of a run's rows, with their widths."""
    n, m = len(system.coordinates), len(system.constraints)
    own = dict(zip((*system.states, "lam"), (n, n, m), strict=True)) if states else {}
    return {**own, **widths}


def _split(
    system: Mechanics, widths: Mapping[str, int], states: bool, rows: np.ndarray
) -> dict[str, np.ndarray]:
    columns = _columns(system, widths, states)
    edges = np.cumsum(list(columns.values()))[:-1]
    return dict(zip(columns, np.split(rows, edges, axis=1), strict=True))


def _solution(
    system: Mechanics,
    method: Spark,
    times: np.ndarray,
    parts: dict[str, np.ndarray],
    *,
    params: Mapping[str, ArrayLike] | None,
    **fields: Any,
) -> Solution:
    def those(prefix: str) -> dict[str, np.ndarray]:
        found = {k.removeprefix(prefix): x for k, x in parts.items() if k.startswith(prefix)}
        return {name: x[:, 0] if x.shape[1] == 1 else x for name, x in found.items()}

    return Solution(
        t=times,
        states={k: parts[k] for k in (*system.states, "v", "p", "lam") if k in parts},
        invariants=those("invariant "),
        residuals={k: parts[k] for k in ("constraint", "hidden")},
        observed=those("observed "),
        names={"coordinates": system.coordinates, "constraints": system.constraints},
        method=repr(method),
        params=_plain({**system.params, **dict(params or {})}),
        system=system,
        **fields,
    )


def _plain(params: Mapping[str, Any]) -> dict[str, float | list[float]]:
    arrays = {name: np.asarray(value, dtype=float) for name, value in params.items()}
    return {name: x.tolist() if x.ndim else float(x) for name, x in arrays.items()}


def _explain(
    trouble: dict[str, Any],
    system: Mechanics,
    method: Spark,
    widths: Mapping[str, int],
    span: tuple[float, int],
) -> tuple[str, str]:
    if trouble.get("quantity") == "observable":
        trouble |= _observable(trouble["index"], widths)
    t0, count = span
    if "step" in trouble:
        where = f"step {trouble['step']} of {count} at t = {trouble['start']:.6g} failed"
    else:
        where = f"the start at t = {t0:.6g} cannot be taken"
    sentence, hint, quantity = describe(trouble, system.coordinates, system.constraints)
    if trouble["kind"] == "not converged" and method.solver == "node-schur":
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
