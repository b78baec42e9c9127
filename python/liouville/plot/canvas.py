"""Axes, colours, names and legends of all figures; matplotlib is imported when called."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any

from liouville._basics.errors import check_name, hinted
from liouville._solution.states import unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from liouville._solution.solution import Solution

FIGURES, ANIMATIONS = (".png", ".pdf", ".svg"), (".gif", ".html", ".mp4")

# A log axis has no zero: exact values are drawn here, below the roundoff of one operation.
FLOOR = 1e-17

#: Backends without windows, and those of notebooks.
STILL = (
    *("agg", "cairo", "pdf", "pgf", "ps", "svg", "template"),
    *("inline", "nbagg", "notebook", "widget", "ipympl", "backend_inline", "matplotlib_inline"),
)

#: The unit in labels where none is given.
UNITS = "(system's units)"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
GREY = "#6e6e6e"

#: How all figures look, as settings of matplotlib: ``plt.style.use(plot.STYLE)``.
STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.prop_cycle": f"cycler(color={list(COLOURS)})",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "figure.constrained_layout.use": True,
    "figure.figsize": (6.0, 3.8),
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "xtick.color": GREY,
    "xtick.labelcolor": "black",
    "xtick.labelsize": 8,
    "ytick.color": GREY,
    "ytick.labelcolor": "black",
    "ytick.labelsize": 8,
}

# Between decades an axis of so many decades or fewer has labels.
LABELLED = 2
GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau"
    " upsilon phi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
)


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
        matplotlib is not installed, or ffmpeg, which writes ``.mp4``, is not on the path.
    """
    matplotlib("figure")
    if Path(path).suffix not in suffixes:
        raise ValueError(
            f"cannot draw to {str(path)!r}\nhint: use a name that ends in {' or '.join(suffixes)}"
        )
    if not Path(path).absolute().parent.is_dir():
        raise FileNotFoundError(f"the folder of {str(path)!r} does not exist\nhint: create it")
    if Path(path).suffix == ".mp4" and which("ffmpeg") is None:
        raise ImportError(
            "a film as .mp4 needs ffmpeg, which is not on the path\n"
            "hint: install it, or write a .gif, or a page that turns under the mouse: .html"
        )


def matplotlib(module: str) -> Any:
    """Import matplotlib, or a module of it."""
    try:
        return importlib.import_module(f"matplotlib.{module}" if module else "matplotlib")
    except ImportError as error:
        raise ImportError('figures need matplotlib\nhint: pip install "liouville[plot]"') from error


def blank(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches, which ``plt.show()`` shows.

    Where there is no window pyplot need not know of it, and would keep it: a notebook shows it by
    its value.
    """
    matplotlib("figure")  # names the extra where it is missing
    from liouville.plot.shown import ShownFigure

    options: Any = {"figsize": (width, height), "dpi": 150, "layout": "constrained"}
    pyplot = sys.modules.get("matplotlib.pyplot")
    backend = matplotlib("").get_backend().lower() if pyplot else "agg"
    if pyplot is None or {*re.split("[/.:]+", backend)} & {*STILL}:
        return ShownFigure(**options)
    found: Figure = pyplot.figure(FigureClass=ShownFigure, **options)
    return found


def single(width: float, height: float) -> Axes:
    """Return the only axes of a figure of a size in inches."""
    figure = blank(width, height)
    from liouville.plot.shown import ShownAxes

    return figure.add_subplot(axes_class=ShownAxes)


def drawn_on(ax: Axes | None, xlabel: str, ylabel: str) -> Axes:
    """Dress the axes given, or those of a new figure."""
    axes: Axes = single(6.0, 3.8) if ax is None else ax
    axes.set_xlabel(xlabel, fontsize=STYLE["axes.labelsize"])
    axes.set_ylabel(ylabel, fontsize=STYLE["axes.labelsize"])
    axes.tick_params(labelsize=STYLE["xtick.labelsize"], color=GREY)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=STYLE["grid.color"], lw=STYLE["grid.linewidth"])
    axes.set_axisbelow(True)
    return axes


def scale_by_decades(axes: Axes) -> None:
    """Make both scales logarithmic, with labels at 1, 2 and 5 where decades are few."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    ticker = matplotlib("ticker")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(ticker.LogLocator(subs=(2, 5)))
        few = (LABELLED, LABELLED)
        axis.set_minor_formatter(ticker.LogFormatterSciNotation(minor_thresholds=few))
    axes.tick_params(which="both", labelsize=STYLE["xtick.labelsize"])


def in_unit(solution: Solution, name: str, labels: Sequence[str] = ()) -> str:
    """Return the unit of a quantity, or of some of its columns, in brackets for an axis."""
    unit = unit_of(solution, name, labels)
    return f"({text(unit)})" if unit else UNITS


def names_of(
    names: Sequence[str] | None, default: Sequence[str], known: Sequence[str], kind: str
) -> list[str]:
    """Return the names asked for, each of which is known."""
    if isinstance(names, str):
        hint = f"give a list, such as names={[*known[:2]]!r}"
        raise TypeError(hinted(f"names must be a sequence of names, not {names!r}", hint))
    chosen = list(default if names is None else names)
    for name in chosen:
        check_name(name, known, kind)
    return chosen


def colours(count: int) -> Sequence[Any]:
    """Return `count` colours, the most distinct first."""
    if count <= len(COLOURS):
        return COLOURS[:count]
    viridis = matplotlib("").colormaps["viridis"]
    return [viridis(k * 0.92 / (count - 1)) for k in range(count)]


def _is_greek(name: str) -> bool:
    return name in GREEK.split()


def text(name: str) -> str:
    """Give a name as text: Greek letters as such, signs that mean something to matplotlib not."""
    if _is_greek(name):
        return f"$\\{name}$"
    return name.replace("$", r"\$").replace("_", r"$\_$")


def legend(axes: Axes, lines: Sequence[Any], names: Sequence[str], title: str) -> None:
    """Write a title, and below it names for lines, of which very many are not all named."""
    if (count := len(names)) > 14:  # the ends and a few between show the order of the colours
        last = len(names) - 1
        shown = [round(k * last / 5) for k in range(6)]
        lines, names = [lines[i] for i in shown], [names[i] for i in shown]
        title += f"; {len(shown)} of {count} are named"
    rows = 0
    if names:
        width = max(1 if _is_greek(name) else len(name) for name in names) + 6
        rows = -(-len(names) * width // 70)
        columns = -(-len(names) // rows)
        found = axes.legend(
            lines,
            [text(name) for name in names],
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
        for handle in found.legend_handles:
            if handle is not None:
                handle.set_alpha(1)  # of curves that many others shine through, too
    else:
        axes.text(0.5, 0.5, "nothing to show", transform=axes.transAxes, ha="center", color=GREY)
    axes.set_title(title, loc="left", fontsize=10, pad=6 + 13 * rows)
