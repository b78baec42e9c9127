"""The panels of a solution, and the overview that puts them together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import check_name, hinted
from liouville._solution.points import STATES
from liouville._solution.solution import Solution
from liouville.plot.canvas import (
    COLOURS,
    UNITS,
    blank,
    drawn_on,
    in_unit,
    legend,
    names_of,
    text,
)
from liouville.plot.curves import draw_curves, draw_sizes, interleaved, of_member, of_solution
from liouville.plot.fans import chosen
from liouville.plot.observed import observed, scalars
from liouville.plot.quantum import shown
from liouville.plot.thinning import POINTS, few, some, thinned, varied

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: What is said of a drift that is measured by the kinetic energy.
KINETIC = ", relative to the kinetic"

#: Steps that differ by no more than this part of themselves are equal.
EQUAL = 1e-6
#: Titles of the curves of a state, and its symbol, where they are no positions.
TITLES = {
    "v": ("velocities", "$v$"),
    "p": ("momenta", "$p$"),
    "z": ("z", "$z$"),
    "x": ("states", "$x$"),
    "lam": ("multipliers", "$\\lambda$"),
    "acceleration": ("accelerations", "acceleration"),
    "a": ("accelerations of the method", "$a$"),
}


@of_solution
def trajectories(
    solution: Solution,
    of: str | None = None,
    *,
    names: Sequence[str] | None = None,
    against: str | None = None,
    fan: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw coordinates against time, or against one another.

    Parameters
    ----------
    solution : Solution
        What to draw; it must have stored its states. Of an ensemble are drawn up to 50 members,
        evenly chosen.
    of : str, optional
        The state to draw, by its name in ``solution.states``; positions by default, or ``x``.
        :func:`density` draws ``psi``.
    names : sequence of str, optional
        Names of the coordinates to draw; all by default.
    against : str, optional
        Name of the coordinate on the horizontal axis, to the same scale as the vertical one, with
        a dot at the start; time by default.
    fan : bool, default False
        Of an ensemble, draw the median and the bands that half of all members and 90 % are in.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With its curves.

    Raises
    ------
    ValueError
        There is no coordinate of one of these names, or no state that is drawn so; or a fan is of
        a single run, or against a coordinate.
    TypeError
        The names are one string.
    AttributeError
        The solution has no such state.
    """
    if of is None:
        of = next((name for name in ("y", "x", "psi") if name in solution.states), "q")
    if of not in STATES or of == "psi":
        hint = "plot.density draws psi" if of == "psi" else f"it has {', '.join(solution.states)}"
        hint = "plot.observed draws observables" if of in solution.observed else hint
        raise ValueError(hinted(f"the solution has no state {of!r} with curves", hint))
    values, (kind, known) = getattr(solution, of), _labels(solution, of)
    wanted = names_of(names, [name for name in known if name != against], known, kind)
    title, symbol = TITLES.get(of, ("positions", f"${of}$"))
    shown = {name: values[..., known.index(name)] for name in wanted}
    columns, note = chosen(solution, shown, fan)
    if against is None:
        units = in_unit(solution, "t"), in_unit(solution, of, wanted)
        scale = None if fan or len(wanted) > 1 else varied(solution)
        return draw_curves(ax, solution.t, columns, title + note, symbol, fan, units, scale)
    if fan:
        raise ValueError("a fan is drawn against time: leave against= out, or fan=")
    check_name(against, known, kind)
    symbol = "" if of in ("q", "y", "x") else f"{symbol} of "
    labels = [
        f"{symbol}{', '.join(map(text, some))} {in_unit(solution, of, some)}"
        for some in ([against], wanted)
    ]
    axes = drawn_on(ax, *labels)
    across, _ = few(solution, {against: values[..., known.index(against)]}, len(wanted))
    at = thinned(len(values), 5 * POINTS)

    def draw(name: str, member: int, style: dict[str, Any]) -> Any:
        x, y = (of_member(table, member)[at] for table in (across[against], columns[name]))
        axes.plot(x[:1], y[:1], "o", ms=4 if solution.members is None else 2, **style)
        return axes.plot(x, y, **style)[0]

    lines = interleaved(columns, draw)
    axes.set_aspect("equal", adjustable="datalim")
    legend(axes, lines, wanted, title + note)
    return axes


@of_solution
def invariants(
    solution: Solution,
    names: Sequence[str] | None = None,
    *,
    fan: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw the drift of invariants on a log scale, each with its running maximum.

    Parameters
    ----------
    solution : Solution
        What to draw.
    names : sequence of str, optional
        The invariants to draw; all by default.
    fan : bool, default False
        Of an ensemble, draw the median and the bands that half of all members and 90 % are in.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        Dots are ``solution.invariant_drift``, the largest of an ensemble, lines their maximum so
        far. The label of the axis, or the name, states where it is absolute or relative to the
        kinetic energy.

    Raises
    ------
    ValueError
        There is no invariant of one of these names.
    TypeError
        The names are one string.
    """
    known = list(solution.invariants)
    wanted = names_of(names, known, known, "invariant")
    absolute = {name: solution.is_drift_absolute(name) for name in wanted}
    change = "|I(t) - I(0)|"
    label, words = f"${change}\\,/\\,|I(0)|$", dict.fromkeys(wanted, "")
    if absolute and all(each.all() for each in absolute.values()):
        units = {in_unit(solution, name) for name in wanted}
        label = f"${change}$ {units.pop() if len(units) == 1 else UNITS}"
    else:
        words = {name: solution.drift_words(name) for name in wanted}
        if {*words.values()} == {KINETIC}:
            label, words = f"${change}$ over the kinetic energy", dict.fromkeys(wanted, "")
        elif any(words.values()):
            label = f"${change}$ over $|I(0)|$, or as named"
    sizes = {name + words[name]: solution.invariant_drift(name) for name in wanted}
    title = "drift" if set(wanted) - set(solution.changing) or not wanted else "change"
    return draw_sizes(ax, solution, sizes, f"{title} of invariants", label, fan)


@of_solution
def energy(solution: Solution, *, fan: bool = False, ax: Axes | None = None) -> Axes:
    """Draw where the energy went: its change, the work of other forces, and what was dissipated.

    Parameters
    ----------
    solution : Solution
        What to draw. Work and dissipation are those that its method records, see
        ``Solution.balance``; without them there is the change alone.
    fan : bool, default False
        Of an ensemble, draw the median and the bands that half of all members and 90 % are in.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With a curve for each; the work is left out where there is none.

    Raises
    ------
    AttributeError
        The solution has no energy.
    """
    columns = {name: values for name, values in solution.balance.items() if values.any()}
    if solution.balance:
        columns = {"change": solution.work - solution.dissipated} | columns
    elif "energy" in solution.invariants:
        record = solution.invariants["energy"]
        columns = {"change": record - solution.initial.get("energy", record[:1])}
    else:
        hint = f"plot.invariants draws {', '.join(solution.invariants) or 'what it has'}"
        raise AttributeError(hinted("the solution has no energy", hint))
    columns, note = chosen(solution, columns, fan)
    units = in_unit(solution, "t"), in_unit(solution, "energy")
    title = f"{'energy' if solution.balance else 'change of the energy'}{note}"
    return draw_curves(ax, solution.t, columns, title, "energy", fan, units)


@of_solution
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
    units = (in_unit(solution, "t"),) * 2
    axes = draw_curves(ax, solution.t[:-1], {"h": sizes}, title, "$h$", units=units)
    axes.set_yscale("log")
    if sizes.size and np.ptp(sizes) <= EQUAL * sizes.max():  # roundoff of the times is no picture
        axes.set_ylim(sizes.min() / 2, 2 * sizes.max())
    return axes


@of_solution
def residuals(solution: Solution, *, fan: bool = False, ax: Axes | None = None) -> Axes:
    """Draw how well each kind of constraint is kept, on a log scale.

    Parameters
    ----------
    solution : Solution
        What to draw.
    fan : bool, default False
        Of an ensemble, draw the median and the bands that half of all members and 90 % are in.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        Dots are the largest residual over the constraints, and over the members of an ensemble;
        lines its maximum so far.
    """
    sizes = {
        name: np.abs(values).max(axis=-1)
        for name, values in solution.residuals.items()
        if values.size
    }
    g, w = ("k", "k_t + k_y f") if "unknowns" in solution.names else ("g", "g_t + g_q v")
    symbols = {"constraint": g, "hidden": w, "nonholonomic": "k"}
    label = ",  ".join(f"$\\max |{symbols[name]}|$" for name in sizes)
    if fan:  # those of single steps are roundoff, and their bands noise
        sizes = {name: np.fmax.accumulate(own) for name, own in sizes.items()}
    return draw_sizes(ax, solution, sizes, "residuals" + ", largest so far" * fan, label, fan)


@of_solution
def multipliers(
    solution: Solution,
    *,
    names: Sequence[str] | None = None,
    fan: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw the multipliers against time.

    Parameters
    ----------
    solution : Solution
        What to draw; it must have stored its states.
    names : sequence of str, optional
        Names of the constraints whose multipliers to draw; all by default.
    fan : bool, default False
        Of an ensemble, draw the median and the bands that half of all members and 90 % are in.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With a curve for each multiplier, of an ensemble for each of up to 50 members.

    Raises
    ------
    ValueError
        There is no constraint of one of these names.
    TypeError
        The names are one string.
    AttributeError
        The solution has no multipliers.
    """
    return trajectories(solution, "lam", names=names, fan=fan, ax=ax)


@of_solution
def overview(solution: Solution, *, fan: bool = False) -> Figure:
    """Draw the overview of a run: motion, invariants, constraints and multipliers.

    Methods that damp have a panel of the energy too, and controlled steps one of their sizes; wave
    functions have their density and autocorrelation in the place of the motion. A
    panel that would have nothing to show is left out: multipliers of a system without constraints,
    motion of a run that stored no states (its observed scalars are drawn instead).

    Parameters
    ----------
    solution : Solution
        What to draw.
    fan : bool, default False
        Of an ensemble, draw medians and bands instead of members, where a panel can.

    Returns
    -------
    Figure
        Save it with ``savefig``.
    """
    panels: list[Callable[..., Axes]] = []
    panels += shown(solution, fan)
    if "psi" not in solution.states and solution.states:
        panels.append(partial(trajectories, fan=fan, names=some(solution.names["coordinates"])))
    if scalars(solution):
        panels.append(partial(observed, fan=fan))
    if solution.invariants:
        panels.append(partial(invariants, fan=fan))
    if solution.balance:
        panels.append(partial(energy, fan=fan))
    if solution.names["constraints"]:
        panels.append(partial(residuals, fan=fan))
        if "lam" in solution.states:
            panels.append(partial(multipliers, fan=fan, names=some(solution.names["constraints"])))
    if solution.states and (unknowns := some(solution.names.get("unknowns", ()))):
        panels.append(partial(trajectories, of="z", fan=fan, names=unknowns))
    if solution.tolerances and len(solution.t) > 1:
        panels.append(steps)
    rows = 2 if len(panels) >= 4 else 1
    columns = max(1, -(-len(panels) // rows))
    figure = blank(5.2 * columns, 3.5 * rows + 0.5)
    for i, panel in enumerate(panels):
        panel(solution, ax=figure.add_subplot(rows, columns, i + 1))
    count = solution.stats.get("steps", len(solution.t) - 1)
    head = f"{solution.method},  {solution.step_size},  {count} steps"
    failed = [solution.status] if solution.status != "done" else []
    if solution.failures:
        failed.append(f"{len(solution.failures)} of {solution.members} members failed")
    head = ", ".join([head, *failed])
    figure.suptitle(
        fill(head, round(12 * figure.get_figwidth())),  # as many letters as there is room for
        x=0.012,
        ha="left",
        fontsize=10,
        color=COLOURS[1] if failed else "black",
    )
    return figure


def _labels(solution: Solution, of: str) -> tuple[str, tuple[str, ...]]:
    """Return the kind of a state's columns, and a name for each."""
    kind = {"lam": "constraint", "z": "unknown"}.get(of, "coordinate")
    kind = kind if f"{kind}s" in solution.names else "coordinate"
    return kind, solution.names[f"{kind}s"]
