"""Curves against time and their dots, of a single run or of the members of an ensemble."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from liouville._basics.errors import hinted
from liouville._solution.solution import Array, Solution
from liouville.plot.canvas import (
    FLOOR,
    GREY,
    UNITS,
    colours,
    drawn_on,
    in_unit,
    legend,
    matplotlib,
    text,
)
from liouville.plot.fans import chosen, draw_fans
from liouville.plot.thinning import extremes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Panel = TypeVar("Panel", bound=Callable[..., Any])


def check_solution(what: str, solution: Any) -> None:
    """Refuse what is no solution."""
    if not isinstance(solution, Solution):
        hint = "integrate the system and show what that returns"
        raise TypeError(hinted(f"{what} must be a solution, not {solution!r}", hint))


def of_solution(draw: Panel) -> Panel:
    """Let a panel refuse what is no solution."""

    @wraps(draw)
    def checked(solution: Solution, *args: Any, **options: Any) -> Any:
        check_solution(f"what plot.{draw.__name__} draws", solution)
        return draw(solution, *args, **options)

    return cast("Panel", checked)


def draw_curves(
    ax: Axes | None,
    t: Array,
    columns: Mapping[str, Array],
    title: str,
    symbol: str,
    fan: bool = False,
    units: tuple[str, str] = (UNITS, UNITS),
    scale: tuple[str, Array] | None = None,
) -> Axes:
    """Draw columns of shape (k,), or (k, P) of members or their fan, against time.

    `units` are those of time and of the columns; `scale` is what the members of one column differ
    in, which colours them.
    """
    axes = drawn_on(ax, f"time $t$ {units[0]}", f"{symbol} {units[1]}")
    if fan:
        legend(axes, draw_fans(axes, t, columns), list(columns), title)
        return axes

    shade = (lambda _: {}) if scale is None else shaded(axes, *scale)

    def draw(name: str, member: int, style: dict[str, Any]) -> Any:
        style = style | shade(member)
        curve = of_member(columns[name], member)
        at = extremes(curve)
        return axes.plot(t[at], curve[at], **style)[0]

    lines = interleaved(columns, draw)
    if scale is not None:  # one colour would stand for all
        title = ", ".join([*columns, title])
        axes.set_title(title, loc="left", fontsize=10)
        return axes
    legend(axes, lines, list(columns), title)
    return axes


def shaded(axes: Axes, name: str, values: Array) -> Callable[[int], dict[str, Any]]:
    """Draw a bar of what members differ in, and return the colour of each."""
    norm = matplotlib("colors").Normalize(values.min(), values.max())
    colours_of = matplotlib("cm").ScalarMappable(norm, "viridis")
    bar = axes.figure.colorbar(colours_of, ax=axes, pad=0.02)
    bar.set_label(text(name), fontsize=9)
    bar.ax.tick_params(labelsize=8, color=GREY)
    return lambda member: {"color": colours_of.to_rgba(values[member]), "alpha": 0.9}


def of_member(values: Array, member: int) -> Array:
    """Return the column of a member, or the only one."""
    return values if values.ndim == 1 else values[:, member]


def of_chosen(solution: Solution, values: Array, member: int) -> Array:
    """Return values of shape (k, ...) of a run, or those (k, P, ...) of a member of an ensemble."""
    count = solution.members
    if not 0 <= member < (count or 1):
        has = "a single run" if count is None else f"an ensemble of {count}"
        raise ValueError(f"there is no member {member} of {has}")
    return values if count is None else values[:, member]


def interleaved(
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


def draw_sizes(
    ax: Axes | None,
    solution: Solution,
    columns: Mapping[str, Array],
    title: str,
    label: str,
    fan: bool = False,
) -> Axes:
    """Draw sizes of shape (k,), or the largest of (k, P), with their maximum so far; or a fan."""
    t = solution.t
    if fan:
        shown, note = chosen(solution, columns, fan)
        first = int(len(t) > 1 and not solution.initial)
        axes = drawn_on(ax, f"time $t$ {in_unit(solution, 't')}", label)
        axes.set_yscale("log")
        shown = {name: np.maximum(sizes, FLOOR)[first:] for name, sizes in shown.items()}
        legend(axes, draw_fans(axes, t[first:], shown), list(shown), title + note)
        return axes
    if solution.members is not None:
        columns = {name: np.fmax.reduce(sizes, axis=1) for name, sizes in columns.items()}
        title += f", largest of {solution.members} members"
    axes = drawn_on(ax, f"time $t$ {in_unit(solution, 't')}", label)
    axes.set_yscale("log")
    lines = []
    for sizes, colour in zip(columns.values(), colours(len(columns)), strict=True):
        # The start of a drift is zero by definition, and would stretch the axis.
        at = extremes(sizes)
        at = at[1:] if len(at) > 1 and not solution.initial else at
        shown, worst = np.maximum(sizes, FLOOR)[at], np.fmax.accumulate(sizes)[at]
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
