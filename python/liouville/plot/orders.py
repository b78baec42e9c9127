"""Errors against step sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville.plot.canvas import GREY, UNITS, colours, drawn_on, legend, scale_by_decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from liouville.analysis.convergence import Study


def convergence(study: Study, *, ax: Axes | None = None) -> Axes:
    """Draw the errors of a study against its step sizes, both on log scales.

    Parameters
    ----------
    study : Study
        What :func:`liouville.analysis.convergence.study` returned.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With a curve for each state, and where it has an order a dashed line of that slope.
    """
    axes = drawn_on(ax, f"step size $h$ {UNITS}", "error")
    scale_by_decades(axes)
    lines, names = [], []
    for (name, errors), colour in zip(
        study.errors.items(), colours(len(study.errors)), strict=True
    ):
        drawn = np.where(errors > 0, errors, np.nan)
        lines += axes.plot(study.h, drawn, "o-", ms=3.5, lw=1.3, color=colour)
        order = study.order[name]
        names.append(f"{name}, order {order:.2f}" if np.isfinite(order) else name)
        good = np.flatnonzero(np.isfinite(drawn))
        if np.isfinite(order) and good.size:
            k = good[len(good) // 2]
            slope = drawn[k] * (study.h / study.h[k]) ** round(order)
            axes.plot(study.h, slope, "--", lw=0.8, color=GREY, zorder=1)
    legend(axes, lines, names, f"error of {study.method}" if study.method else "error")
    return axes
