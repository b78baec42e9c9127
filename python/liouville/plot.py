"""Figures of a solution, and animations of planar mechanisms.

Each panel function draws on the axes it is given, or on a figure of its own, and returns the axes:
``plot.invariants(solution).figure.savefig("drift.pdf")``. Nothing here touches ``pyplot``, so no
window opens and no figure lingers; all of it is one file, for nothing else knows matplotlib.
Colours are those of Okabe and Ito, told apart by all eyes; curves beyond seven run through the
colours of viridis in order.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville.solution import Array, Solution

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURES, ANIMATIONS = (".png", ".pdf", ".svg"), (".gif",)

# A log axis has no zero: what is exactly kept is drawn here, below the roundoff of one operation.
FLOOR = 1e-17

# More points than this do not show; a curve keeps the extremes of what it leaves out.
POINTS = 4000

# An overview shows no more curves than this in a panel, evenly chosen.
CURVES = 40

# Nor more members of an ensemble.
MEMBERS = 50

UNITS = "(system's units)"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
GREY = "#6e6e6e"
GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau"
    " upsilon phi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
)

Outline = Callable[[Array, Any], Sequence[ArrayLike]]


def check(path: str | os.PathLike[str], suffixes: Sequence[str] = FIGURES) -> None:
    """Refuse a path that a figure could not be saved to, before a long run and not after it.

    Parameters
    ----------
    path : path
        Where the figure is to go.
    suffixes : sequence of str, default FIGURES
        The kinds of file allowed; ``ANIMATIONS`` for animations.

    Raises
    ------
    ValueError
        The suffix is none of those allowed.
    FileNotFoundError
        The folder does not exist.
    ImportError
        matplotlib is not installed.
    """
    _matplotlib("figure")
    if Path(path).suffix not in suffixes:
        raise ValueError(
            f"cannot draw to {str(path)!r}\nhint: use a name that ends in {' or '.join(suffixes)}"
        )
    if not Path(path).absolute().parent.is_dir():
        raise FileNotFoundError(f"the folder of {str(path)!r} does not exist\nhint: create it")


def trajectories(
    solution: Solution,
    of: str = "q",
    *,
    names: Sequence[str] | None = None,
    against: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw coordinates against time, or against one another.

    Parameters
    ----------
    solution : Solution
        What to draw; it must have stored its states.
    of : str, default "q"
        The state to draw: ``q``, ``v``, ``p``, ``y``, ``z`` or ``x``.
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
    values, known = getattr(solution, of), solution.names["coordinates"]
    chosen = list(names) if names is not None else [name for name in known if name != against]
    for name in [*chosen, *([against] if against is not None else [])]:
        if name not in known:
            raise ValueError(
                f"the solution has no coordinate {name!r}\nhint: it has {', '.join(known)}"
            )
    if solution.members is not None:
        values = values[:, :: max(1, -(-solution.members // MEMBERS))]
    columns = {name: values[..., known.index(name)] for name in chosen}
    title = {"v": "velocities", "p": "momenta", "z": "z", "x": "states"}.get(of, "positions")
    if against is None:
        return _curves(ax, solution.t, columns, title, f"${of}$")
    symbol = "" if of in ("q", "y", "x") else f"${of}$ of "
    labels = [f"{symbol}{', '.join(map(_text, some))} {UNITS}" for some in ([against], chosen)]
    axes = _axes(ax, *labels)
    x = values[..., known.index(against)]
    stride = max(1, len(x) // (5 * POINTS))
    for column, colour in zip(columns.values(), _colours(len(columns)), strict=True):
        axes.plot(x[::stride], column[::stride], color=colour, lw=1.3)
        axes.plot(x[0], column[0], "o", ms=4, color=colour)
    axes.set_aspect("equal", adjustable="datalim")
    _legend(axes, list(columns), title)
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
    if solution.members is not None:
        sizes = {name: drift.max(axis=1) for name, drift in sizes.items()}
    return _sizes(ax, solution.t, sizes, "drift of invariants", "$|I(t) - I(0)|\\,/\\,|I(0)|$")


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
    """Draw how well the constraint and the hidden constraint are kept, on a log scale.

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
    return _sizes(ax, solution.t, sizes, "residuals", "$\\max |g|$,  $\\max |g_t + g_q v|$")


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

    Methods that damp have a panel of the energy too, and controlled steps one of their sizes. A
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
    scalars = {name: values for name, values in solution.observed.items() if values.ndim == 1}
    if solution.states:
        of = next(name for name in ("q", "y", "x") if name in solution.states)
        shown = _some(solution.names["coordinates"])
        panels.append(lambda solution, ax: trajectories(solution, of, names=shown, ax=ax))
    elif scalars:
        panels.append(lambda solution, ax: _curves(ax, solution.t, scalars, "observed", ""))
    if solution.invariants:
        panels.append(invariants)
    if solution.balance:
        panels.append(energy)
    if solution.names["constraints"]:
        panels.append(residuals)
        if solution.states:
            held = _some(solution.names["constraints"])
            panels.append(lambda solution, ax: multipliers(solution, names=held, ax=ax))
    if solution.tolerances and len(solution.t) > 1:
        panels.append(steps)
    rows = 2 if len(panels) >= 4 else 1
    columns = max(1, -(-len(panels) // rows))
    figure = _figure(5.2 * columns, 3.5 * rows + 0.5)
    for i, panel in enumerate(panels):
        panel(solution, ax=figure.add_subplot(rows, columns, i + 1))
    count = solution.stats.get("steps", len(solution.t) - 1)
    head = f"{solution.method},  {solution.step_size},  {count} steps"
    failed = solution.status != "done"
    figure.suptitle(
        f"{head}, {solution.status}" if failed else head,
        x=0.012,
        ha="left",
        fontsize=10,
        color=COLOURS[1] if failed else "black",
    )
    return figure


def animation(
    solution: Solution,
    outline: Outline,
    path: str | os.PathLike[str] | None = None,
    *,
    seconds: float = 6.0,
    fps: int = 25,
) -> FuncAnimation:
    """Animate a planar mechanism.

    Parameters
    ----------
    solution : Solution
        The motion; it must have stored its states. A frame shows the kept step nearest in time.
    outline : callable
        ``outline(q, params)`` gives the bodies at one configuration, q of shape (n,), as a list of
        polylines of shape (k, 2); ``params`` is ``solution.params``. The last vertex of the first
        polyline leaves a trace of a second.
    path : path, optional
        Where to write the animation, as ``.gif``; not written by default.
    seconds : float, default 6
        How long the animation plays, in seconds.
    fps : int, default 25
        Frames per second.

    Returns
    -------
    FuncAnimation
        ``to_jshtml()`` shows it in a notebook.

    Raises
    ------
    AttributeError
        The solution has no positions.
    ValueError, FileNotFoundError, ImportError
        As :func:`check` does.
    """
    if path is not None:
        check(path, ANIMATIONS)
    mpl = _matplotlib("animation")
    q = solution.y if "y" in solution.states else solution.q
    fine = np.unique(np.linspace(0, len(q) - 1, POINTS).round().astype(int))
    shapes = [
        [np.asarray(line, dtype=float) for line in outline(q[i], solution.params)] for i in fine
    ]
    corners = np.concatenate([line for shape in shapes for line in shape])
    trace = np.array([shape[0][-1] for shape in shapes])
    t, way = solution.t[fine], np.sign(solution.t[-1] - solution.t[0])
    times = np.linspace(t[0], t[-1], max(2, round(seconds * fps)))
    frames = np.searchsorted(way * (t[1:] + t[:-1]) / 2, way * times)

    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.06 * max(*(high - low), 1e-12)
    width, height = high - low + 2 * margin
    scale = 5.0 / max(width, height)
    figure = _figure(max(2.5, scale * width), max(2.5, scale * height) + 0.3)
    axes = figure.add_subplot(
        aspect="equal",
        xlim=(low[0] - margin, high[0] + margin),
        ylim=(low[1] - margin, high[1] + margin),
    )
    axes.axis("off")
    (tail,) = axes.plot([], [], color=COLOURS[1], lw=1.2, alpha=0.7)
    bodies = [
        axes.plot([], [], color=colour, lw=2.5, marker="o", ms=4, mfc="white", mew=1.2)[0]
        for colour in _colours(len(shapes[0]))
    ]
    clock = axes.set_title("", loc="left", fontsize=9, color=GREY)

    digits = max(0, 2 - int(np.floor(np.log10(abs(t[-1] - t[0]) or 1.0))))

    def draw(i: int) -> list[Any]:
        for body, line in zip(bodies, shapes[frames[i]], strict=True):
            body.set_data(line[:, 0], line[:, 1])
        recent = slice(frames[max(0, i - fps)], frames[i] + 1)
        tail.set_data(trace[recent, 0], trace[recent, 1])
        clock.set_text(f"t = {t[frames[i]]:.{digits}f}")
        return [*bodies, tail, clock]

    film: FuncAnimation = mpl.FuncAnimation(
        figure, draw, frames=len(frames), interval=1000 / fps, blit=False
    )
    if path is not None:
        film.save(Path(path), writer=mpl.PillowWriter(fps=fps), dpi=100)
    return film


def _curves(
    ax: Axes | None, t: Array, columns: Mapping[str, Array], title: str, symbol: str
) -> Axes:
    axes = _axes(ax, f"time $t$ {UNITS}", f"{symbol} {UNITS}")
    for values, colour in zip(columns.values(), _colours(len(columns)), strict=True):
        for curve in values.reshape(len(t), -1).T:
            at = _extremes(curve)
            axes.plot(t[at], curve[at], color=colour, lw=1.3)
    _legend(axes, list(columns), title)
    return axes


def _sizes(ax: Axes | None, t: Array, columns: Mapping[str, Array], title: str, label: str) -> Axes:
    axes = _axes(ax, f"time $t$ {UNITS}", label)
    axes.set_yscale("log")
    for sizes, colour in zip(columns.values(), _colours(len(columns)), strict=True):
        # The start of a drift is zero by definition: it says nothing and stretches the axis.
        at = np.arange(1 if len(t) > 1 else 0, len(t), max(1, len(t) // POINTS))
        shown, worst = np.maximum(sizes, FLOOR)[at], np.maximum.accumulate(sizes)[at]
        axes.plot(t[at], shown, ".", ms=1.5, alpha=0.35, color=colour, rasterized=True)
        if np.any(worst > FLOOR):
            worst = np.where(worst > FLOOR, worst, np.nan)
        else:
            worst = np.full(len(at), FLOOR)
        axes.plot(t[at], worst, color=colour, lw=1.3)
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
    _legend(axes, list(columns), title)
    return axes


def _some(names: Sequence[str]) -> Sequence[str]:
    return names[:: max(1, -(-len(names) // CURVES))]


def _extremes(values: Array) -> Any:
    """Give the indices of the points worth drawing: all, or the extremes of equal blocks."""
    if len(values) <= POINTS:
        return np.arange(len(values))
    blocks = np.array_split(np.arange(len(values)), POINTS // 2)
    ends = [block[pick(values[block])] for block in blocks for pick in (np.argmin, np.argmax)]
    return np.unique([0, *ends, len(values) - 1])


def _colours(count: int) -> Sequence[Any]:
    if count <= len(COLOURS):
        return COLOURS[:count]
    viridis = _matplotlib("").colormaps["viridis"]
    return [viridis(x) for x in np.linspace(0, 0.92, count)]


def _is_greek(name: str) -> bool:
    return name in GREEK.split()


def _text(name: str) -> str:
    """Give a name as text: Greek letters as such, signs that mean something to matplotlib not."""
    if _is_greek(name):
        return f"$\\{name}$"
    return name.replace("$", r"\$").replace("_", r"$\_$")


def _legend(axes: Axes, names: list[str], title: str) -> None:
    lines = [line for line in axes.lines if line.get_linestyle() == "-"][: len(names)]
    if len(names) > 14:  # the ends and a few between tell the order of the colours
        shown = np.linspace(0, len(names) - 1, 6).round().astype(int)
        lines, names = [lines[i] for i in shown], [names[i] for i in shown]
    rows = 0
    if names:
        width = max(1 if _is_greek(name) else len(name) for name in names) + 6
        rows = -(-len(names) * width // 70)
        columns = -(-len(names) // rows)
        axes.legend(
            lines,
            [_text(name) for name in names],
            ncols=columns,
            loc="lower left",
            bbox_to_anchor=(0, 1),
            frameon=False,
            fontsize=8,
            handlelength=1.2,
            columnspacing=1.2,
            borderaxespad=0.2,
            borderpad=0,
        )
    else:
        axes.text(0.5, 0.5, "nothing to show", transform=axes.transAxes, ha="center", color=GREY)
    axes.set_title(title, loc="left", fontsize=10, pad=6 + 13 * rows)


def _axes(ax: Axes | None, xlabel: str, ylabel: str) -> Axes:
    axes: Axes = _figure(6.0, 3.8).add_subplot() if ax is None else ax
    axes.set_xlabel(xlabel, fontsize=9)
    axes.set_ylabel(ylabel, fontsize=9)
    axes.tick_params(labelsize=8, color=GREY)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e4e4e4", lw=0.6)
    axes.set_axisbelow(True)
    return axes


def _figure(width: float, height: float) -> Figure:
    figure: Figure = _matplotlib("figure").Figure(
        figsize=(width, height), dpi=150, layout="constrained"
    )
    return figure


def _matplotlib(module: str) -> Any:
    try:
        return importlib.import_module(f"matplotlib.{module}" if module else "matplotlib")
    except ImportError as error:
        raise ImportError('figures need matplotlib\nhint: pip install "liouville[plot]"') from error
