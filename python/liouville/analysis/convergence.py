"""Errors over a sequence of step sizes, and the order they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import html
from liouville._basics.errors import IntegrationError, Suggesting
from liouville._methods import Method, VolumeSplitting
from liouville._methods.planner import FieldPlan, plan
from liouville._runs.execute import finished
from liouville._runs.integrate import integrate
from liouville._solution.solution import Array
from liouville._systems import Field, System


@dataclass(frozen=True, eq=False, repr=False)
class Study(Suggesting):
    r"""Errors of a method at the end of an interval, for a sequence of step sizes.

    Attributes
    ----------
    h : ndarray, shape (k,)
        Step sizes used, the largest first.
    errors : dict of str to ndarray, shape (k,)
        For each state its :func:`distance` from the reference; NaN where the run failed.
    order : dict of str to float
        For each state the slope fitted by :func:`slope`.
    method : str
        The method, as its repr, with nothing left to choose.
    """

    h: Array
    errors: dict[str, Array]
    order: dict[str, float]
    method: str = ""

    def slopes(self, name: str) -> Array:
        """Give the slope between each step size and the one before it, NaN for the first."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.diff(np.log(self.errors[name]), prepend=np.nan) / np.diff(
                np.log(self.h), prepend=np.nan
            )

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Give heads and rows of text: step sizes, errors with their slopes, the orders fitted."""
        heads = ["h"] + [text for name in self.errors for text in (f"error of {name}", "slope")]
        slopes = {name: self.slopes(name) for name in self.errors}
        rows = []
        for i, size in enumerate(self.h):
            row = [f"{size:.6g}"]
            for name, errors in self.errors.items():
                row.append("failed" if np.isnan(errors[i]) else f"{errors[i]:.2e}")
                row.append(f"{slopes[name][i]:.2f}" if np.isfinite(slopes[name][i]) else "")
            rows.append(row)
        fits = [f"{fit:.2f}" if np.isfinite(fit) else "none" for fit in self.order.values()]
        return heads, [*rows, ["fitted", *(cell for fit in fits for cell in ("", fit))]]

    def __repr__(self) -> str:
        """Return the table as text."""
        heads, rows = self.table()
        widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in (heads, *rows)
        ]
        return "\n".join([f"<Study of {self.method}", *lines]) + ">"

    def _repr_html_(self) -> str:
        """Show the table in a notebook; :func:`liouville.plot.convergence` draws it."""
        heads, rows = self.table()
        return html.table(f"Study of {self.method}", rows, heads)


def study(
    system: System,
    method: Method | FieldPlan,
    t: tuple[float, float],
    hs: Sequence[float],
    start: Mapping[str, Any],
    reference: Mapping[str, ArrayLike] | None = None,
    of: Sequence[str] | None = None,
    params: Mapping[str, ArrayLike] | None = None,
    floor: float = 2e-14,
) -> Study:
    r"""Integrate with each step size and compare the end states with a reference.

    Parameters
    ----------
    system, method
        As for :func:`liouville.integrate`; the steps are equal. What a ``VolumeSplitting`` leaves
        open is chosen once, for the step size in the middle: errors are those of one method.
    t : tuple of float
        The interval; the end states are compared at its end.
    hs : sequence of float
        Step sizes, in any order; each is shortened to divide the interval.
    start : dict
        Start values by name.
    reference : dict of str to array_like, optional
        End states by name. By default those of a run with a quarter of the smallest step size,
        which is good enough for methods of order 2 and above.
    of : sequence of str, optional
        The states to compare, by default those that the system starts from. The ``a`` of an alpha
        method stands for a time that depends on the step size, :math:`t + \Delta h`: at the end of
        the interval it differs by O(h) from that of a fine run, and only a reference of its own
        would show its order 2.
    params : dict, optional
        As for :func:`liouville.integrate`.
    floor : float, default 2e-14
        As for :func:`slope`.

    Returns
    -------
    Study
        Errors and orders; a run that fails has the error NaN. It prints as a table, and
        :func:`liouville.plot.convergence` draws it.

    Raises
    ------
    ValueError
        A step size or start value is wrong, or ``reference`` lacks a state asked for.
    IntegrationError
        The fine run, which is to be the reference, failed.
    KeyboardInterrupt
        A run was interrupted: its end state is not that of the interval.
    """
    of = system.states if of is None else of
    names = tuple(of)
    if len(hs) == 0:
        raise ValueError("a study needs at least one step size, and hs is empty")
    hs = sorted(hs, key=abs, reverse=True)
    if isinstance(system, Field) and isinstance(method, VolumeSplitting):
        method = plan(system, method, h=hs[len(hs) // 2], t=t, params=params, **start)

    def end(h: float) -> tuple[float, dict[str, Array]]:
        solution = integrate(system, method, t=t, h=h, every=10**9, params=params, **start)
        finished(solution)
        return solution.h, {name: getattr(solution, name)[-1] for name in names}

    if reference is None:
        reference = end(hs[-1] / 4)[1]
    elif missing := [name for name in names if name not in reference]:
        raise ValueError(
            f"the reference lacks {', '.join(missing)}\n"
            f"hint: of={tuple(name for name in names if name in reference)} leaves it out"
        )
    used, errors = [], []
    for h in hs:
        try:
            h, states = end(h)
            errors.append([distance(states[name], reference[name]) for name in names])
        except IntegrationError:
            errors.append([np.nan] * len(names))
        used.append(abs(h))
    sizes = np.array(used)
    columns = dict(zip(names, np.array(errors).T, strict=True))
    order = {name: slope(sizes, column, floor) for name, column in columns.items()}
    chosen = method.method if isinstance(method, FieldPlan) else method
    return Study(sizes, columns, order, repr(chosen))


def slope(h: ArrayLike, errors: ArrayLike, floor: float = 2e-14) -> float:
    """Fit the slope of log error against log h where the error follows a power of h.

    The longest run of step sizes is taken over which the error falls at least as fast as h: before
    it the steps are too coarse for the power to show, after it there is only roundoff, of which
    errors less than ten times as large have too great a share. The finest four of the run are
    fitted, where the power shows best.

    Parameters
    ----------
    h : array_like, shape (k,)
        Step sizes, the largest first.
    errors : array_like, shape (k,)
        Their errors; those that are not finite are left out.
    floor : float, default 2e-14
        Errors below it are taken as roundoff and left out.

    Returns
    -------
    float
        The slope; NaN if fewer than three step sizes are left to fit.
    """
    h, errors = np.asarray(h, dtype=float), np.asarray(errors, dtype=float)
    good = np.isfinite(errors) & (errors > floor)
    x, y = np.log(h[good]), np.log(errors[good])
    stalls = np.flatnonzero(np.diff(y) / np.diff(x) < 1) + 1
    run = max(np.split(np.arange(len(x)), stalls), key=len)
    roundoff = np.max(y[run.max(initial=-1) + 1 :], initial=-np.inf)
    run = run[y[run] > roundoff + np.log(10)][-4:]
    return float(np.polyfit(x[run], y[run], 1)[0]) if len(run) >= 3 else float("nan")


def distance(x: ArrayLike, reference: ArrayLike | Mapping[int, complex]) -> float:
    r"""Give :math:`\max_i |x_i - x^*_i| / \max_i |x^*_i|`, the absolute error if :math:`x^* = 0`.

    Parameters
    ----------
    x, reference : array_like, shape (n,)
        A state :math:`x` and the one it should be, :math:`x^*`, or a mapping of the components that
        are known of it, with their places.

    Returns
    -------
    float
        The relative error; zero if n = 0.
    """
    if isinstance(reference, Mapping):
        x, reference = np.asarray(x)[list(reference)], list(reference.values())
    x, reference = np.asarray(x), np.asarray(reference)
    size = np.max(np.abs(reference), initial=0.0)
    return float(np.max(np.abs(x - reference), initial=0.0) / (size if size > 0 else 1.0))
