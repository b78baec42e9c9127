"""Animations of planar mechanisms."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville.plot.canvas import ANIMATIONS, COLOURS, GREY, blank, check, colours, matplotlib
from liouville.plot.curves import of_chosen
from liouville.plot.thinning import thinned
from liouville.solution import Array, Solution
from liouville.systems._trace import Namespace

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

# More poses than this do not show.
POSES = 4000

Outline = Callable[[Array, Any], Sequence[ArrayLike]]


def animation(
    solution: Solution,
    outline: Outline,
    path: str | os.PathLike[str] | None = None,
    *,
    seconds: float = 6.0,
    fps: int = 25,
    member: int = 0,
) -> FuncAnimation:
    """Animate a planar mechanism.

    Parameters
    ----------
    solution : Solution
        The motion; it must have stored its states. A frame shows the kept step nearest in time.
    outline : callable
        ``outline(q, params)`` gives the bodies at one configuration, q of shape (n,), as a list of
        polylines of shape (k, 2); it sees ``params.name`` as a model's functions do. The last
        vertex of the first polyline leaves a trace of a second.
    path : path, optional
        Where to write the animation, as ``.gif``; not written by default.
    seconds : float, default 6
        How long the animation plays, in seconds.
    fps : int, default 25
        Frames per second.
    member : int, default 0
        Which member of an ensemble; a film of one that failed ends before.

    Returns
    -------
    FuncAnimation
        ``to_jshtml()`` shows it in a notebook.

    Raises
    ------
    AttributeError
        The solution has no positions.
    ValueError
        There is no such member, or as :func:`check` does.
    FileNotFoundError, ImportError
        As :func:`check` does.
    """
    if path is not None:
        check(path, ANIMATIONS)
    mpl = matplotlib("animation")
    q = of_chosen(solution, solution.y if "y" in solution.states else solution.q, member)
    params = Namespace(_params_of(solution, member))
    whole = np.flatnonzero(np.isfinite(q).all(axis=1))
    fine = whole[thinned(len(whole), POSES)]
    shapes = [[np.asarray(line, dtype=float) for line in outline(q[i], params)] for i in fine]
    corners = np.concatenate([line for shape in shapes for line in shape])
    trace = np.array([shape[0][-1] for shape in shapes])
    t = solution.t[fine]
    way = np.sign(t[-1] - t[0])
    times = np.linspace(t[0], t[-1], max(2, round(seconds * fps)))
    frames = np.searchsorted(way * (t[1:] + t[:-1]) / 2, way * times)

    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.06 * max(*(high - low), 1e-12)
    width, height = high - low + 2 * margin
    scale = 5.0 / max(width, height)
    figure = blank(max(2.5, scale * width), max(2.5, scale * height) + 0.3)
    axes = figure.add_subplot(
        aspect="equal",
        xlim=(low[0] - margin, high[0] + margin),
        ylim=(low[1] - margin, high[1] + margin),
        xticks=[],
        yticks=[],
    )
    axes.axis("off")
    (tail,) = axes.plot([], [], color=COLOURS[1], lw=1.2, alpha=0.7)
    bodies = [
        axes.plot([], [], color=colour, lw=2.5, marker="o", ms=4, mfc="white", mew=1.2)[0]
        for colour in colours(len(shapes[0]))
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

    draw(0)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # all frames have the layout of the first
    film: FuncAnimation = mpl.FuncAnimation(
        figure, draw, frames=len(frames), interval=1000 / fps, blit=False
    )
    if path is not None:
        # imported here, as it imports matplotlib
        from liouville.plot.gif import Writer

        film.save(Path(path), writer=Writer(fps=fps), dpi=100)
    return film


def _params_of(solution: Solution, member: int) -> dict[str, Any]:
    """Return the parameters of a run or of a member, as numbers and arrays."""
    found = {name: np.asarray(value)[()] for name, value in solution.params.items()}
    count = solution.members
    if count is None:
        return found
    # of a loaded solution the shapes of the defaults are not known
    defaults = dict.fromkeys(found, 0.0) if solution.system is None else solution.system.params
    own = {name for name, x in found.items() if np.ndim(x) > np.ndim(defaults[name])}
    return {name: x[member] if name in own and len(x) == count else x for name, x in found.items()}
