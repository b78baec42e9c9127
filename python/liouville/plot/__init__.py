"""Figures of solutions, sections and fits, and animations and views of mechanisms.

Each panel function draws on the axes it is given, or on a figure of its own, and returns the axes:
``plot.invariants(solution).figure.savefig("drift.pdf")``. A notebook shows them, and an overview.
Nothing here uses ``pyplot``, so no window opens and no figure lingers. Colours are those of
Okabe and Ito, distinct in all kinds of colour vision; more than seven curves take the colours of
viridis in order. ``plt.style.use(plot.STYLE)`` gives figures of your own the same look.
"""

from liouville.plot.canvas import ANIMATIONS, COLOURS, FIGURES, FLOOR, STYLE, check
from liouville.plot.film import animation
from liouville.plot.fits import fit
from liouville.plot.observed import observed
from liouville.plot.orders import convergence
from liouville.plot.page import View, view
from liouville.plot.panels import (
    energy,
    invariants,
    multipliers,
    overview,
    residuals,
    steps,
    trajectories,
)
from liouville.plot.quantum import autocorrelation, cost, density, spectrum
from liouville.plot.sections import section

__all__ = [
    "ANIMATIONS",
    "COLOURS",
    "FIGURES",
    "FLOOR",
    "STYLE",
    "View",
    "animation",
    "autocorrelation",
    "check",
    "convergence",
    "cost",
    "density",
    "energy",
    "fit",
    "invariants",
    "multipliers",
    "observed",
    "overview",
    "residuals",
    "section",
    "spectrum",
    "steps",
    "trajectories",
    "view",
]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
