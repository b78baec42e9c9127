"""Poincare sections, whose points have the colour of their trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from liouville._basics.errors import hinted
from liouville._solution.solution import Array
from liouville._studies.section import Section
from liouville.plot.canvas import GREY, UNITS, colours, matplotlib, single, text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Length of the longer side of a section, in inches.
SIDE = 5.0

# Width of a letter of the title, in inches.
LETTER = 0.075

# Part of the square of that side which the ink of all points would cover.
INK = 0.35

# Areas of the smallest and the largest point, in points squared.
SMALLEST, LARGEST = 0.2, 5.0


def section(
    section: Section,
    axes: tuple[str, str] | None = None,
    *,
    period: float | Mapping[str, float] | None = None,
    ax: Axes | None = None,
) -> Axes:
    r"""Draw where trajectories cross a plane, each in a colour of its own, to equal scales.

    Parameters
    ----------
    section : Section
        What :func:`liouville.section` found.
    axes : tuple of two str, optional
        Names of the coordinates to the right and upwards; by default the first two that change on
        the plane.
    period : float or mapping of str to float, optional
        Period of both coordinates, or of each by its name, such as :math:`2 \pi` of an angle: they
        are folded into :math:`[0, period)`.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        With the points, which are an image even in a ``.pdf``. Seven trajectories have the colours
        of curves, more run through viridis in the order of their starts.

    Raises
    ------
    TypeError
        It is no section.
    ValueError
        There is no coordinate of one of these names, or a period is not positive and finite.
    """
    if not isinstance(section, Section):
        sentence = f"what plot.section draws must be a section, not a {type(section).__name__}"
        raise TypeError(hinted(sentence, "lv.section finds where trajectories cross a plane"))
    pair = _pair(section, axes)
    points = section.x[:, [section.names.index(name) for name in pair]]
    folds = _folds(pair, period)
    for column, fold in zip(points.T, folds, strict=True):
        if fold is not None:
            column %= fold
    spans = [_span(column, fold) for column, fold in zip(points.T, folds, strict=True)]
    drawn = ax if ax is not None else _room(spans, _title(section))
    if len(section):
        _scatter(drawn, points, section)
    else:
        drawn.text(0.5, 0.5, "no crossings", transform=drawn.transAxes, ha="center", color=GREY)
    drawn.set(xlim=spans[0], ylim=spans[1], aspect="equal")
    if ax is None:
        drawn.set_anchor("W")  # under its title
    for axis, name, fold in zip((drawn.xaxis, drawn.yaxis), pair, folds, strict=True):
        axis.set_label_text(f"{text(name)} {UNITS}", fontsize=9)
        if fold is not None and np.isclose(fold, 2 * np.pi):
            axis.set_ticks(np.arange(5) * np.pi / 2, ["0", "π/2", "π", "3π/2", "2π"])
    drawn.tick_params(labelsize=8, color=GREY, labelcolor="black")
    for spine in drawn.spines.values():
        spine.set(color=GREY, lw=0.6)
    drawn.set_title(_title(section), loc="left", fontsize=10)
    return drawn


def _pair(section: Section, axes: tuple[str, str] | None) -> tuple[str, str]:
    if axes is None:
        normal = np.abs(section.plane[0])
        crossed = int(np.argmax(normal)) if normal.any() else -1
        left = [name for k, name in enumerate(section.names) if k != crossed]
        if len(left) < 2:
            raise ValueError(f"a section of {len(section.names)} coordinates is no picture")
        return left[0], left[1]
    if isinstance(axes, str) or len(axes) != 2:
        raise ValueError(f"axes must be the names of two coordinates, not {axes!r}")
    for name in axes:
        if name not in section.names:
            raise ValueError(
                f"the section has no coordinate {name!r}\nhint: it has {', '.join(section.names)}"
            )
    return axes


def _folds(pair: Sequence[str], period: float | Mapping[str, float] | None) -> list[float | None]:
    given = period if isinstance(period, Mapping) else dict.fromkeys(pair, period)
    folds = [given.get(name) for name in pair]
    for fold in folds:
        if fold is not None and not (np.isfinite(fold) and fold > 0):
            raise ValueError(f"period must be positive and finite, not {fold}")
    return folds


def _span(values: Array, fold: float | None) -> tuple[float, float]:
    """Return the ends of an axis."""
    if fold is not None:
        return 0.0, fold
    low, high = (values.min(), values.max()) if values.size else (0.0, 1.0)
    margin = 0.04 * (high - low) or 0.5
    return low - margin, high + margin


def _room(spans: Sequence[tuple[float, float]], title: str) -> Axes:
    """Return the axes of a figure of the shape that is to be drawn, as wide as its title."""
    width, height = (high - low for low, high in spans)
    scale = SIDE / max(width, height)
    return single(max(LETTER * len(title), scale * width) + 0.7, max(2.0, scale * height) + 0.8)


def _scatter(axes: Axes, points: Array, section: Section) -> None:
    """Draw the points, mixed so that no trajectory hides another."""
    area = np.clip(INK * (72 * SIDE) ** 2 / max(1, len(points)), SMALLEST, LARGEST)
    shades = matplotlib("colors").to_rgba_array(colours(section.members))
    mixed = np.random.default_rng(0).permutation(len(points))
    x, y = points[mixed].T
    axes.scatter(x, y, s=area, c=shades[section.member[mixed]], linewidths=0, rasterized=True)


def _title(section: Section) -> str:
    """Describe a plane, as "z = 0 mod 2π, upwards", and how many points there are."""
    normal, offset = section.plane
    parts = [
        text(name) if factor == 1 else f"{factor:.3g} {text(name)}"
        for name, factor in zip(section.names, normal, strict=True)
        if factor
    ]
    plane = (
        " + ".join(parts or ["t"]) if len(parts) <= 4 else f"a plane of {len(parts)} coordinates"
    )
    words = f"{plane} = {_number(offset)}"
    words += f" mod {_number(section.period)}" if section.period else ""
    words += {"up": ", upwards", "down": ", downwards"}.get(section.direction, "")
    many = f"{len(section):,} crossings of {section.members} trajectories"
    return f"{words}: {many}" + ("" if section.status == "done" else f", {section.status}")


def _number(value: float) -> str:
    halves = value / np.pi
    if halves and np.isclose(halves, round(halves), rtol=1e-12, atol=0):
        return f"{round(halves)}π".removeprefix("1" if round(halves) == 1 else "")
    return f"{value:.6g}"
