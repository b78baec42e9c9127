"""Residuals of a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville._basics.errors import hinted
from liouville._studies.fitting import Fit
from liouville.plot.canvas import GREY, UNITS, colours, drawn_on, legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def fit(fit: Fit, *, ax: Axes | None = None) -> Axes:
    """Draw the residuals of a fit in units of their standard deviations, against time.

    Those of a model that is right are noise: 95 % of them are between the lines, and none is like
    its neighbours.

    Parameters
    ----------
    fit : Fit
        What :func:`liouville.fit` found.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With dots in a colour for each quantity that was measured, of all trials together.

    Raises
    ------
    TypeError
        It is no fit.
    """
    if not isinstance(fit, Fit):
        sentence = f"what plot.fit draws must be a fit, not {fit!r}"
        raise TypeError(hinted(sentence, "lv.fit finds parameters from measurements"))
    axes = drawn_on(ax, f"time $t$ {UNITS}", r"residuals / $\sigma$")
    of = np.concatenate([trial.quantities for trial in fit.trials])
    t = np.concatenate([trial.t for trial in fit.trials])
    sizes = np.concatenate([trial.residuals for trial in fit.trials]) / (fit.sigma or 1.0)
    names = list(dict.fromkeys(of.tolist()))
    lines = []
    for name, colour in zip(names, colours(len(names)), strict=True):
        lines += axes.plot(t[of == name], sizes[of == name], ".", ms=4, color=colour)
    for side in (-1.96, 1.96):
        axes.axhline(side, color=GREY, lw=0.8, ls="--")
    good = f"chi2/dof = {fit.chi2 / fit.dof:.3g}" if fit.dof and fit.sigma is None else ""
    legend(axes, lines, names, f"residuals of the fit{good and ', ' + good}")
    return axes
