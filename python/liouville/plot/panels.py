"""The panels of a solution, and the overview that puts them together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville.plot.canvas import (
    COLOURS,
    FLOOR,
    GREY,
    UNITS,
    blank,
    colours,
    drawn_on,
    legend,
    text,
)
from liouville.plot.quantum import shown
from liouville.plot.thinning import POINTS, extremes, few, some
from liouville.solution import Array, Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def trajectories(
    solution: Solution,
    of: str | None = None,
    *,
    names: Sequence[str] | None = None,
    against: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw coordinates against time, or against one another.

    Parameters
    ----------
    solution : Solution
        What to draw; it must have stored its states. Of an ensemble are drawn up to 50 members,
        evenly chosen.
    of : str, optional
        The state to draw: ``q``, ``v``, ``p``, ``y``, ``z`` or ``x``; positions by default, or
        ``x``.
    names : sequence of str, optional
        Names of the coordinates to draw; all by default.
    against : str, optional
        Name of the coordinate on the horizontal axis, to the same scale as the vertical one, with
        a dot at the start; time by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With its curves.

    Raises
    ------
    ValueError
        There is no coordinate of one of these names.
    AttributeError
        The solution has no such state.
    """
    if of is None:
        of = next((name for name in ("y", "x") if name in solution.states), "q")
    kind = "unknowns" if of == "z" else ""
    values, known = getattr(solution, of), solution.names.get(kind, solution.names["coordinates"])
    chosen = list(names) if names is not None else [name for name in known if name != against]
    for name in [*chosen, *([against] if against is not None else [])]:
        if name not in known:
            raise ValueError(
                f"the solution has no coordinate {name!r}\nhint: it has {', '.join(known)}"
            )
    title = {"v": "velocities", "p": "momenta", "z": "z", "x": "states"}.get(of, "positions")
    columns, note = few(solution, {name: values[..., known.index(name)] for name in chosen})
    if against is None:
        return _curves(ax, solution.t, columns, title + note, f"${of}$")
    symbol = "" if of in ("q", "y", "x") else f"${of}$ of "
    labels = [f"{symbol}{', '.join(map(text, some))} {UNITS}" for some in ([against], chosen)]
    axes = drawn_on(ax, *labels)
    across, _ = few(solution, {against: values[..., known.index(against)]}, len(chosen))
    stride = max(1, len(values) // (5 * POINTS))

    def draw(name: str, member: int, style: dict[str, Any]) -> Any:
        x, y = (_member(table, member)[::stride] for table in (across[against], columns[name]))
        axes.plot(x[:1], y[:1], "o", ms=4 if solution.members is None else 2, **style)
        return axes.plot(x, y, **style)[0]

    lines = _interleaved(columns, draw)
    axes.set_aspect("equal", adjustable="datalim")
    legend(axes, lines, chosen, title + note)
    return axes


def invariants(
    solution: Solution, names: Sequence[str] | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw the drift of invariants on a log scale, each with its running maximum.

    Parameters
    ----------
    solution : Solution
        What to draw.
    names : sequence of str, optional
        The invariants to draw; all by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        Dots are :meth:`Solution.invariant_drift`, the largest of an ensemble, lines their maximum
        so far.

    Raises
    ------
    ValueError
        There is no invariant of one of these names.
    """
    names = list(solution.invariants) if names is None else names
    sizes = {name: solution.invariant_drift(name) for name in names}
    title = "drift of invariants"
    if solution.members is not None:
        sizes = {name: drift.max(axis=1) for name, drift in sizes.items()}
        title += f", largest of {solution.members} members"
    return _sizes(ax, solution.t, sizes, title, "$|I(t) - I(0)|\\,/\\,|I(0)|$")


def energy(solution: Solution, *, ax: Axes | None = None) -> Axes:
    """Draw where the energy went: its change, the work of other forces, and what was dissipated.

    Parameters
    ----------
    solution : Solution
        What to draw; its method must record them, see ``Solution.balance``.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With a curve for each; the work is left out where there is none.

    Raises
    ------
    AttributeError
        The solution has no such record.
    """
    columns = {"change": solution.work - solution.dissipated}
    columns |= {name: values for name, values in solution.balance.items() if values.any()}
    return _curves(ax, solution.t, columns, "energy", "")


def steps(solution: Solution, *, ax: Axes | None = None) -> Axes:
    """Draw the times between kept states on a log scale, the step sizes where all are kept.

    Parameters
    ----------
    solution : Solution
        What to draw.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With one curve.
    """
    sizes = np.abs(np.diff(solution.t))
    is_whole = len(sizes) == solution.stats.get("steps", len(sizes))
    title = "step sizes" if is_whole else "times between kept states"
    axes = _curves(ax, solution.t[:-1], {"h": sizes}, title, "$h$")
    axes.set_yscale("log")
    return axes


def residuals(solution: Solution, *, ax: Axes | None = None) -> Axes:
    """Draw how well each kind of constraint is kept, on a log scale.

    Parameters
    ----------
    solution : Solution
        What to draw.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        Dots are the largest residual over the constraints, lines its maximum so far.
    """
    sizes = {
        name: np.max(np.abs(values), axis=1)
        for name, values in solution.residuals.items()
        if values.size
    }
    symbols = {
        "constraint": "$\\max |g|$",
        "hidden": "$\\max |g_t + g_q v|$",
        "nonholonomic": "$\\max |k|$",
    }
    label = ",  ".join(symbols[name] for name in sizes)
    return _sizes(ax, solution.t, sizes, "residuals", label)


def multipliers(
    solution: Solution, *, names: Sequence[str] | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the multipliers against time.

    Parameters
    ----------
    solution : Solution
        What to draw; it must have stored its states.
    names : sequence of str, optional
        Names of the constraints whose multipliers to draw; all by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With a curve for each multiplier.

    Raises
    ------
    ValueError
        There is no constraint of one of these names.
    """
    known = solution.names["constraints"]
    columns = {}
    for name in known if names is None else names:
        if name not in known:
            raise ValueError(
                f"the solution has no constraint {name!r}\nhint: it has {', '.join(known)}"
            )
        columns[name] = solution.lam[:, known.index(name)]
    return _curves(ax, solution.t, columns, "multipliers", "$\\lambda$")


def overview(solution: Solution) -> Figure:
    """Draw what a person wants to see first: motion, invariants, constraints and multipliers.

    Methods that damp have a panel of the energy too, and controlled steps one of their sizes; wave
    functions have their density and autocorrelation in the place of the motion. A
    panel that would have nothing to show is left out: multipliers of a system without constraints,
    motion of a run that stored no states (its observed scalars are drawn instead).

    Parameters
    ----------
    solution : Solution
        What to draw.

    Returns
    -------
    Figure
        Save it with ``savefig``.
    """
    panels: list[Callable[..., Axes]] = []
    of_scalar = 1 if solution.members is None else 2
    real = {k: values for k, values in solution.observed.items() if values.dtype.kind != "c"}
    scalars = {k: values for k, values in real.items() if values.ndim == of_scalar}
    panels += shown(solution)
    if "psi" not in solution.states and solution.states:
        panels.append(partial(trajectories, names=some(solution.names["coordinates"])))
    elif scalars:
        chosen, note = few(solution, scalars)
        title = f"observed{note}"
        panels.append(lambda solution, ax: _curves(ax, solution.t, chosen, title, ""))
    if solution.invariants:
        panels.append(invariants)
    if solution.balance:
        panels.append(energy)
    if solution.names["constraints"]:
        panels.append(residuals)
        if "lam" in solution.states:
            panels.append(partial(multipliers, names=some(solution.names["constraints"])))
    if solution.states and (unknowns := some(solution.names.get("unknowns", ()))):
        panels.append(partial(trajectories, of="z", names=unknowns))
    if solution.tolerances and len(solution.t) > 1:
        panels.append(steps)
    rows = 2 if len(panels) >= 4 else 1
    columns = max(1, -(-len(panels) // rows))
    figure = blank(5.2 * columns, 3.5 * rows + 0.5)
    for i, panel in enumerate(panels):
        panel(solution, ax=figure.add_subplot(rows, columns, i + 1))
    count = solution.stats.get("steps", len(solution.t) - 1)
    head = f"{solution.method},  {solution.step_size},  {count} steps"
    failed = solution.status != "done"
    head = f"{head}, {solution.status}" if failed else head
    figure.suptitle(
        fill(head, round(12 * figure.get_figwidth())),  # as many letters as there is room for
        x=0.012,
        ha="left",
        fontsize=10,
        color=COLOURS[1] if failed else "black",
    )
    return figure


def _curves(
    ax: Axes | None, t: Array, columns: Mapping[str, Array], title: str, symbol: str
) -> Axes:
    """Draw columns of shape (k,), or (k, P) of members, against time."""
    axes = drawn_on(ax, f"time $t$ {UNITS}", f"{symbol} {UNITS}")

    def draw(name: str, member: int, style: dict[str, Any]) -> Any:
        curve = _member(columns[name], member)
        at = extremes(curve)
        return axes.plot(t[at], curve[at], **style)[0]

    legend(axes, _interleaved(columns, draw), list(columns), title)
    return axes


def _member(values: Array, member: int) -> Array:
    return values if values.ndim == 1 else values[:, member]


def _interleaved(
    columns: Mapping[str, Array], draw: Callable[[str, int, dict[str, Any]], Any]
) -> list[Any]:
    """Draw all columns, member after member, so that none hides another; returns the first's."""
    shades = colours(len(columns))
    many = next((values.shape[1] for values in columns.values() if values.ndim > 1), 1)
    thin = {"lw": 0.7, "alpha": float(np.clip(12 / many, 0.3, 0.8))}
    style = thin if many > 1 else {"lw": 1.3}
    lines = [
        draw(name, member, {"color": colour, **style})
        for member in range(many)
        for name, colour in zip(columns, shades, strict=True)
    ]
    return lines[: len(columns)]


def _sizes(ax: Axes | None, t: Array, columns: Mapping[str, Array], title: str, label: str) -> Axes:
    axes = drawn_on(ax, f"time $t$ {UNITS}", label)
    axes.set_yscale("log")
    lines = []
    for sizes, colour in zip(columns.values(), colours(len(columns)), strict=True):
        # The start of a drift is zero by definition: it says nothing and stretches the axis.
        at = np.arange(1 if len(t) > 1 else 0, len(t), max(1, len(t) // POINTS))
        shown, worst = np.maximum(sizes, FLOOR)[at], np.maximum.accumulate(sizes)[at]
        axes.plot(t[at], shown, ".", ms=1.5, alpha=0.35, color=colour, rasterized=True)
        if np.any(worst > FLOOR):
            worst = np.where(worst > FLOOR, worst, np.nan)
        else:
            worst = np.full(len(at), FLOOR)
        lines += axes.plot(t[at], worst, color=colour, lw=1.3)
    if axes.get_ylim()[0] <= FLOOR:
        axes.set_ylim(bottom=FLOOR / 4)
        axes.annotate(
            "zero or less than $10^{-17}$",
            (1, FLOOR),
            xycoords=axes.get_yaxis_transform(),
            xytext=(-2, -3),
            textcoords="offset points",
            ha="right",
            va="top",
            fontsize=7,
            color=GREY,
        )
    legend(axes, lines, list(columns), title)
    return axes
