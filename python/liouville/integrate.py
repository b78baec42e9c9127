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
    if not isinstance(system, Mechanics):
        raise TypeError(f"system is a Lagrangian, Hamiltonian or Mechanical, not {system!r}")
    if not isinstance(method, tuple(METHODS.values())):
        known = ", ".join(cls.__name__ for cls in METHODS.values())
        raise TypeError(f"{method!r} does not step mechanical systems; methods that do: {known}")
    t0, t1 = _interval(t)
    count = _steps(t0, t1, h, steps)
    every = _positive("every", every)
    values = system.values(params)
    y, z = system.start(start)
    system.check(t0, y, z, values)
    tape, widths = system.observer(observe, states)
    _check_memory(count // every + 2, tape.outputs + (3 * y.size if states else 0))

    step = (t1 - t0) / count
    begin = time.perf_counter()
    run = _core.MechanicalRun.start(
        system.problem, method, tape, values, y, z, (t0, step, count, every), states
    )
    outcome: str | dict[str, Any]
    if isinstance(run, dict):
        outcome = {**run, "step": 0, "start": t0}
        times, rows, stats = np.empty(0), np.empty((0, sum(_columns(system, widths, states).values()))), {}
    else:
        outcome = _drive(run, count, progress)
        (times, rows), stats = run.take(), {"steps": run.done, **run.stats}
    stats["seconds"] = time.perf_counter() - begin
    if stats.get("steps"):
        stats["solver"] = _solver(stats)

    message = ""
    if isinstance(outcome, dict):
        message, quantity = _explain(outcome, system, widths, count)
    solution = _solution(
        system, method, times, _split(system, widths, states, rows),
        h=step, stats=stats, params=params,
        status="failed" if isinstance(outcome, dict) else outcome, message=message,
    )
    if isinstance(outcome, dict):
        raise IntegrationError(
            message, t=outcome["start"], step=outcome["step"], quantity=quantity, solution=solution
        )
    return solution


def _interval(t: Any) -> tuple[float, float]:
    try:
        t0, t1 = (float(x) for x in t)
    except (TypeError, ValueError):
        raise TypeError(f"t is a pair (start, end), not {t!r}") from None
    if not (math.isfinite(t0) and math.isfinite(t1)):
        raise ValueError(f"t is a finite interval, not ({t0}, {t1})")
    if t0 == t1:
        raise ValueError(f"t = ({t0:g}, {t1:g}) is no interval")
    return t0, t1


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
        count = _positive("steps", steps)
    else:
        if isinstance(h, (bool, np.bool_)) or not isinstance(h, (int, float, np.integer, np.floating)):
            raise TypeError(f"h is a number, not {h!r}")
        if not (math.isfinite(h) and h > 0):
            raise ValueError(
                hinted(f"h is positive and finite, not {h:g}", "to go backwards, give t=(end, start)")
            )
        if h > abs(t1 - t0) * (1 + 1e-9):
            raise ValueError(f"h = {h:g} is larger than the interval, {abs(t1 - t0):g}")
        count = math.ceil(abs(t1 - t0) / float(h) * (1 - 1e-12))
    if count > 2**53:
        raise ValueError(f"{count:.1e} steps are more than can be counted")
    if t0 + (t1 - t0) / count in (t0,):
        raise ValueError(f"a step of {(t1 - t0) / count:g} does not move t = {t0:g}")
    return count


def _check_memory(kept: int, width: int) -> None:
    needed = 8 * kept * (width + 1)
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 2**36
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
    trouble: dict[str, Any], system: Mechanics, widths: Mapping[str, int], count: int
) -> tuple[str, str]:
    if trouble.get("quantity") == "observable":
        trouble["name"] = _observable(trouble["index"], widths)
    sentence, hint, quantity = describe(trouble, system.coordinates, system.constraints)
    where = f"step {trouble['step']} of {count} at t = {trouble['start']:.6g} failed"
    return hinted(f"{where}: {sentence}", hint), quantity


def _observable(index: int, widths: Mapping[str, int]) -> str:
    for name, width in widths.items():
        if index < width:
            return name
        index -= width
    return "observable"
