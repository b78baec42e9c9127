"""Panels of wave functions: where they are, what they contain, and what they cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import hinted
from liouville._solution.solution import Array, Solution
from liouville.plot.canvas import FLOOR, GREY, UNITS, colours, drawn_on, legend, scale_by_decades
from liouville.plot.curves import draw_curves, of_chosen, of_solution
from liouville.plot.fans import chosen

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A map has no more rows and columns than this: pixels of a wide figure.
PIXELS = 1000

# Times are equally far apart if they are so to this part.
EQUAL = 1e-6

# Points of a spectrum for each frequency that the times resolve.
PADDED = 8


@of_solution
def density(solution: Solution, *, member: int = 0, at: int = -1, ax: Axes | None = None) -> Axes:
    r"""Draw :math:`|\psi|^2` as a map: place across and time up, or the places of a plane.

    It is the sum over components of several.

    Parameters
    ----------
    solution : Solution
        What to draw; it must have stored its states.
    member : int, default 0
        Which member of an ensemble.
    at : int, default -1
        Of a lattice or grid with two axes, which kept state; the last by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With its map, and a bar of colours beside it.

    Raises
    ------
    ValueError
        The states are those of three axes, which have no map; or there is no such member or state.
    AttributeError
        The solution has no psi.
    """
    psi = of_chosen(solution, solution.psi, member)
    if not -len(psi) <= at < len(psi):
        raise ValueError(f"there is no state {at}: {len(psi)} are kept")
    many = getattr(solution.system, "components", 1)
    rho = (np.abs(psi) ** 2).reshape(len(psi), many, -1).sum(axis=1)
    source = getattr(solution.system, "source", None)
    axes_of = getattr(source, "axes", None)
    shape = getattr(source, "shape", (rho.shape[-1],))
    shape = shape if np.prod(shape) == rho.shape[-1] else (rho.shape[-1],)
    if len(shape) > 2:
        raise ValueError(
            hinted(
                f"a state on {' x '.join(map(str, shape))} places has no map",
                "draw a cut or a sum of abs(solution.psi)**2 reshaped",
            )
        )
    places = axes_of or tuple(np.arange(n, dtype=float) for n in shape)
    symbols = ("x", "y") if axes_of else ("first place", "second place")
    if len(shape) == 2:
        values = rho[at].reshape(shape).T
        axes = drawn_on(ax, *(f"${s}$ {UNITS}" if axes_of else s for s in symbols))
        title = f"$|\\psi|^2$ at $t$ = {solution.t[at]:.6g}{_of(solution, member)}"
        axes.set_aspect("equal")
        return _map(axes, places[0], places[1], values, title)
    axes = drawn_on(ax, f"$x$ {UNITS}" if axes_of else "place", f"time $t$ {UNITS}")
    # a packet that begins as a point would leave all else dark
    most = 2 * float(np.nanmedian(rho.max(axis=1)))
    title = f"$|\\psi|^2${_of(solution, member)}"
    return _map(axes, places[0], solution.t, rho, title, most)


@of_solution
def autocorrelation(
    solution: Solution, *, member: int = 0, fan: bool = False, ax: Axes | None = None
) -> Axes:
    r"""Draw the autocorrelation :math:`\langle \psi(0) | \psi(t) \rangle` against time.

    Parameters
    ----------
    solution : Solution
        What to draw.
    member : int, default 0
        Which member of an ensemble.
    fan : bool, default False
        Of an ensemble, draw the median of the modulus and the bands that half of all members and
        90 % are in.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With its modulus, and real and imaginary parts.

    Raises
    ------
    ValueError
        The solution has no autocorrelation, or no such member.
    """
    overlap = _overlap(solution, member)
    if fan:
        columns = {"|C|": np.abs(solution.observed["autocorrelation"])}
        columns, note = chosen(solution, columns, fan)
        title = f"autocorrelation{note}"
        return draw_curves(ax, solution.t, columns, title, "$C(t)$", fan)
    axes = drawn_on(ax, f"time $t$ {UNITS}", "$C(t)$")
    shades = colours(3)
    parts = {"|C|": np.abs(overlap), "real part": overlap.real, "imaginary part": overlap.imag}
    lines = [
        axes.plot(solution.t, values, color=colour, lw=1.6 if k == 0 else 0.9)[0]
        for k, (values, colour) in enumerate(zip(parts.values(), shades, strict=True))
    ]
    legend(axes, lines, list(parts), f"autocorrelation{_of(solution, member)}")
    return axes


@of_solution
def spectrum(
    solution: Solution,
    *,
    energies: ArrayLike | None = None,
    member: int = 0,
    ax: Axes | None = None,
) -> Axes:
    r"""Draw the spectrum of the autocorrelation: peaks at eigenvalues, as high as their weights.

    .. math::

        S(E) = \frac{\int w(t) \operatorname{Re}\left(C(t) e^{i E t / \hbar}\right) dt}
        {\int w(t) dt}, \qquad w(t) = \cos^2 \frac{\pi t}{2 T}

    from the start to the end T of the run.

    Parameters
    ----------
    solution : Solution
        What to draw, of a Hamiltonian without drive, kept at equal times.
    energies : array_like, optional
        Eigenvalues to mark.
    member : int, default 0
        Which member of an ensemble.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With one curve, over the range of energies of the system.

    Raises
    ------
    ValueError
        The times are not equally far apart, or too few; or as for :func:`autocorrelation`.
    """
    overlap, t = _overlap(solution, member), solution.t - solution.t[0]
    if len(t) < 3 or np.ptp(np.diff(t)) > EQUAL * abs(t[1]):
        sentence = "a spectrum wants at least three kept states, equally far apart"
        raise ValueError(hinted(sentence, "give t= as np.linspace(start, end, count)"))
    hbar, (low, high) = _scale(solution.system, abs(t[1]))
    frequency, values = transformed(t, overlap, low)
    energy, low, high = hbar * frequency, hbar * low, hbar * high
    axes = drawn_on(ax, f"energy $E$ {UNITS}", "$S(E)$")
    inside = energy <= high
    lines = axes.plot(energy[inside], values[inside], color=colours(1)[0], lw=1.2)
    names = ["spectrum"]
    if energies is not None:
        marks = np.asarray(energies, dtype=float)
        marks = marks[(marks >= low) & (marks <= high)]
        ticks = axes.plot(marks, np.zeros(len(marks)), "|", ms=9, color=GREY, zorder=3)
        lines, names = [*lines, *ticks], [*names, "eigenvalues"]
    seen = 2 * np.pi * hbar / abs(t[1])
    if seen < (high - low) * (1 - EQUAL):
        names[0] = f"spectrum, with energies above {low + seen:.3g} folded into it"
    legend(axes, lines, names, f"spectrum of the autocorrelation{_of(solution, member)}")
    return axes


def shown(solution: Solution, fan: bool = False) -> list[Callable[..., Axes]]:
    """Return the panels of wave functions for an overview; none if there are none."""
    panels: list[Callable[..., Axes]] = []
    places = getattr(getattr(solution.system, "source", None), "shape", ())
    if "psi" in solution.states and len(places) < 3:
        panels.append(density)
    if "autocorrelation" in solution.observed:
        panels.append(partial(autocorrelation, fan=fan))
    return panels


def transformed(t: Array, overlap: Array, low: float) -> tuple[Array, Array]:
    """Return frequencies from `low` on, and the windowed transform of an autocorrelation."""
    step, count = t[1] - t[0], PADDED * len(t)
    window = np.cos(np.pi / 2 * np.arange(len(t)) / (len(t) - 1)) ** 2
    window[0] /= 2  # half of a trapezium
    values = count * np.fft.ifft(overlap * window, count).real / window.sum()
    period = 2 * np.pi / abs(step)
    frequency = np.fft.fftfreq(count, step / (2 * np.pi))
    frequency = low + (frequency - low) % period
    order = np.argsort(frequency)
    return frequency[order], values[order]


def cost(
    runs: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    what: str = "products $H \\psi$",
    ax: Axes | None = None,
) -> Axes:
    """Draw errors against what they cost, both on log scales.

    Parameters
    ----------
    runs : mapping of str to tuple of two array_like
        By the name of each method: costs and errors, each of shape (k,).
    what : str, optional
        What the cost is.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With a curve for each method.
    """
    axes = drawn_on(ax, what, "error")
    scale_by_decades(axes)
    lines = []
    for (costs, errors), colour in zip(runs.values(), colours(len(runs)), strict=True):
        x, y = np.asarray(costs, dtype=float), np.asarray(errors, dtype=float)
        by_cost = np.argsort(x)
        shown = np.maximum(y[by_cost], FLOOR)
        lines += axes.plot(x[by_cost], shown, "o-", ms=3.5, lw=1.3, color=colour)
    legend(axes, lines, list(runs), "error against cost")
    return axes


def _scale(system: Any, step: float) -> tuple[float, tuple[float, float]]:
    """Return Planck's constant, and the frequencies that there may be."""
    if system is None:
        return 1.0, (-np.pi / step, np.pi / step)
    return system.hbar, system.bounds


def _of(solution: Solution, member: int) -> str:
    """Say which member of an ensemble is drawn."""
    return "" if solution.members is None else f", member {member} of {solution.members}"


def _overlap(solution: Solution, member: int) -> Array:
    if "autocorrelation" not in solution.observed:
        raise ValueError(hinted("the solution has no autocorrelation", "it needs the state at t0"))
    return of_chosen(solution, solution.observed["autocorrelation"], member)


def _map(
    axes: Axes, x: Array, y: Array, values: Array, title: str, most: float | None = None
) -> Axes:
    """Draw a map whose colours end at `most`, if there is more; a pixel has its largest value."""
    is_cut = most is not None and most < np.nanmax(values)
    (x, columns), (y, rows) = (_pixels(places) for places in (x, y))
    values = np.fmax.reduceat(np.fmax.reduceat(values, rows, axis=0), columns, axis=1)
    shown = axes.pcolormesh(
        x, y, values, shading="nearest", cmap="magma",
        rasterized=True, vmin=0.0, vmax=most if is_cut else None,
    )  # fmt: skip
    axes.grid(visible=False)
    bar = axes.figure.colorbar(shown, ax=axes, pad=0.02, extend="max" if is_cut else "neither")
    bar.ax.tick_params(labelsize=8, color=GREY)
    axes.set_title(title, loc="left", fontsize=10)
    return axes


def _pixels(places: Array) -> tuple[Array, Array]:
    """Return the middle of each pixel along an axis, and the first place in it."""
    first = np.arange(0, len(places), max(1, -(-len(places) // PIXELS)))
    last = np.append(first[1:], len(places)) - 1
    return (places[first] + places[last]) / 2, first
