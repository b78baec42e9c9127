r"""Richardson extrapolation of whole runs, with an estimate of their error.

Runs with steps :math:`h_k = h/2^k` have errors :math:`c_1 h_k^{p_1} + c_2 h_k^{p_2} + \dots`, where
:math:`p_1` is the order of the method. Powers go up by two where the method is symmetric, and by
one where it is not. With :math:`X_{k,0}` the states of run k,

.. math::

    X_{k,j} = X_{k,j-1} + \frac{X_{k,j-1} - X_{k-1,j-1}}{2^{p_j} - 1} .

Constraints are nonlinear, so :math:`X_{k,j}` misses them by the square of the errors: positions are
moved onto them, then velocities. Multipliers are those of the moved states.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import hinted
from liouville._basics.options import check_options, started
from liouville._methods import Method
from liouville._runs.choice import named
from liouville._runs.ensemble import ensemble
from liouville._runs.execute import finished
from liouville._runs.integrate import integrate
from liouville._solution.parts import GROUPS
from liouville._solution.solution import Array, Solution
from liouville._solution.states import Stats
from liouville._systems import Mechanics

#: The numbers of a run that are summed over all runs, where it has them.
COUNTS = (
    "steps",
    "seconds",
    "iterations",
    "evaluations",
    "cold_starts",
    "newton_steps",
    "factorizations",
)

#: A run of which the start alone is wanted has this part of the step.
SHORT = 1e-9


def extrapolate(
    system: Mechanics,
    method: Method | str = "auto",
    *,
    t: tuple[float, float],
    h: float | None = None,
    steps: int | None = None,
    levels: int = 2,
    error: bool = False,
    every: int = 1,
    params: Mapping[str, ArrayLike] | None = None,
    observe: Mapping[str, Any] | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    **values: ArrayLike,
) -> Solution:
    r"""Integrate a mechanical system with h, h/2, ..., and extrapolate to h = 0.

    Of methods of order 2 this gains two orders for half as many steps again: it is how the alpha
    family reaches an error of 1e-6. Each run keeps what its method keeps; the extrapolated motion
    keeps energy and momenta to its error alone. Forces must be smooth: at a kink the errors have no
    expansion, and the estimate says little.

    Parameters
    ----------
    system : Lagrangian, Hamiltonian, Mechanical or Structure
        The system.
    method : Method or str
        A method for mechanical systems, with equal steps, or its name, as for ``integrate``.
    t : tuple of two floats
        Start and end.
    h, steps : float or int
        The step size of the first run, or its number of steps, as for :func:`liouville.integrate`.
    levels : int, default 2
        The number of runs, two or more: with h, h/2, h/4 and so on.
    error : bool, default False
        Whether the run with the smallest step is returned as it is, with the estimate of its error.
    every : int, default 1
        Keep one state in this many steps of the first run.
    params, observe
        As for :func:`liouville.integrate`.
    start, **values : mapping, or array_like by name
        Start values, as for :func:`liouville.integrate`.

    Returns
    -------
    Solution
        At the times of the first run. ``solution.error`` has an estimate for both states of the
        system, at each record: the distance of the two best values. Of an extrapolated motion it is
        the error of the value before, and therefore larger than its own; with ``error=True`` it is
        that of the run itself. ``stats`` has the sums of all runs.

    Raises
    ------
    TypeError
        The system is no mechanical one.
    ValueError
        ``levels`` is less than two, or another argument is out of range.
    IntegrationError
        A step of one of the runs failed.
    KeyboardInterrupt
        A run was cut short.

    References
    ----------
    :cite:t:`hairer2006`, II.9, for the powers.

    Examples
    --------
    >>> import liouville as lv
    >>> spring = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0] ** 2 / 2, q=("x",))
    >>> found = lv.analysis.extrapolate(spring, lv.HHT(), t=(0, 1), h=0.02, q=[1.0], v=[0.0])
    >>> f"{found.q[-1, 0]:.6f} {found.error['q'][-1, 0]:.0e}"  # cos 1
    '0.540302 9e-06'
    """
    if not isinstance(system, Mechanics):
        sentence = f"extrapolation must be for mechanical systems, not for {system!r}"
        raise TypeError(hinted(sentence, "a field takes rtol=, a wave function a tolerance"))
    system.check_smooth("extrapolation")
    if isinstance(levels, bool) or not isinstance(levels, int) or levels < 2:
        raise ValueError(f"levels must be a number of runs, two or more, not {levels!r}")
    taken: Method = named(system, method)
    given = started(start, values)
    check_options(given, "extrapolate")
    system.start(given)
    options: dict[str, Any] = {"t": t, "params": params, "observe": observe, **given}
    runs = [finished(integrate(system, taken, h=h, steps=steps, every=every, **options))]
    count = int(runs[0].stats["steps"])
    for k in range(1, levels):
        options |= {"steps": count * 2**k, "every": every * 2**k}
        runs.append(finished(integrate(system, taken, **options)))
    tables = {name: _extrapolated(taken, runs, name) for name in system.states}
    error_of = {name: np.abs(best - before) for name, (best, before) in tables.items()}
    if error:
        finest = {name: runs[-1].states[name] for name in system.states}
        found = runs[-1]
        error_of = {name: np.abs(best - finest[name]) for name, (best, _) in tables.items()}
    else:
        best = {name: value for name, (value, _) in tables.items()}
        found = _evaluated(system, taken, runs[-1], best, params, observe)
    stats: dict[str, Any] = dict(runs[-1].stats)
    for name in stats.keys() & set(COUNTS):
        stats[name] = sum(dict[str, Any](run.stats)[name] for run in runs)
    message = "; ".join(dict.fromkeys(run.message for run in runs if run.message))
    label = f"{taken!r}, {levels} runs" + ("" if error else ", extrapolated")
    return replace(
        found,
        error=error_of,
        stats=cast(Stats, stats),
        message=message,
        method=label,
        dense_order=0,
    )


def _powers(method: Any, count: int) -> list[int]:
    """Return the powers of h that are eliminated, one after another."""
    is_symmetric = getattr(getattr(method, "base", method), "is_symmetric", False)
    return [method.order + k * (2 if is_symmetric else 1) for k in range(count)]


def _extrapolated(method: Any, runs: list[Solution], name: str) -> tuple[Array, Array]:
    """Return the best value of a state at all records, and the one before it."""
    table = [run.states[name] for run in runs]
    before = table[-1]
    for power in _powers(method, len(runs) - 1):
        before = table[-1]
        table = [fine + (fine - coarse) / (2**power - 1) for coarse, fine in pairwise(table)]
    return table[-1], before


def _evaluated(
    system: Mechanics,
    method: Method,
    run: Solution,
    states: dict[str, Array],
    params: Mapping[str, ArrayLike] | None,
    observe: Mapping[str, Any] | None,
) -> Solution:
    """Return a solution with these states on the constraints, and all that follows from them.

    The records are starts of short runs, of one ensemble where time has no part in the model.
    """
    h = SHORT * abs(run.h)
    options: dict[str, Any] = {"steps": 1, "params": params, "observe": observe}
    times = run.t[:1] if system.is_autonomous and not observe else run.t
    parts: list[Solution] = []
    for k, t in enumerate(times):
        rows = {name: x if len(times) == 1 else x[k : k + 1] for name, x in states.items()}
        options |= system.consistent(float(t), params, None, **rows)
        span = (float(t), float(t) + max(h, SHORT * abs(float(t))))
        parts.append(finished(ensemble(system, method, t=span, **options)))
    arrays: dict[str, Any] = {
        group: {
            name: np.concatenate([getattr(part, group)[name][0] for part in parts])
            for name in getattr(parts[0], group)
        }
        for group in GROUPS
    }
    return replace(run, **arrays)
