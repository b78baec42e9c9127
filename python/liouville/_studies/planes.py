"""Planes and surfaces of sections: what is given of them, and the functions that vanish on them."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import number
from liouville._basics.errors import hinted, misshapen
from liouville._solution.solution import Array
from liouville._systems.events import DIRECTIONS, Event

#: Name of the event of a surface.
SURFACE = "plane"


def level(normal: Array, cuts: tuple[float, float | None, int]) -> Callable[..., Any]:
    """Return a function that is zero on planes; of parallel ones also half-way between them."""
    offset, period, _ = cuts

    def level(t: Any, x: Any, params: Any) -> Any:
        del t, params
        along = sum(float(a) * x[k] for k, a in enumerate(normal) if a)
        if period is None:
            return along - offset
        return np.sin((along - offset) * (2 * np.pi / period))

    return level


def is_on(along: Array, cuts: tuple[float, float | None, int]) -> np.ndarray:
    """Return which points are on planes and not half-way between them."""
    offset, period, _ = cuts
    if period is None:
        return np.ones(len(along), dtype=bool)
    return np.asarray(np.cos((along - offset) * (2 * np.pi / period)) > 0)


def event(
    surface: Callable[..., Any],
    cuts: tuple[float, float | None, int],
    direction: str,
    is_given: bool,
) -> dict[str, Event]:
    """Return the event of a function that is given, or of one that is zero on planes."""
    if not is_given:
        return {SURFACE: Event(surface, direction)}
    offset, period, _ = cuts
    if period is not None:
        hint = "return a function that is zero on all of them, such as sin(x[0])"
        raise ValueError(hinted("period= is that of planes, and plane= is a function", hint))

    @functools.wraps(surface)  # its arguments are looked at
    def crossed(t: Any, x: Any, params: Any) -> Any:
        found = surface(t, x, params)
        lone = found[0] if isinstance(found, (list, tuple)) and len(found) == 1 else found
        try:
            return lone - offset
        except TypeError:  # refused by name
            return found

    return {SURFACE: Event(crossed, direction)}


def normal(plane: str | ArrayLike, names: Sequence[str]) -> Array:
    """Return the normal of a plane."""
    if isinstance(plane, str):
        if plane not in names:
            known = ", ".join(names[:10]) + (", ..." if len(names) > 10 else "")
            raise ValueError(f"there is no coordinate '{plane}': the system has {known}")
        axis: Array = np.eye(len(names))[names.index(plane)]
        return axis
    try:
        normal = np.array(plane, dtype=float)
    except (TypeError, ValueError):
        normal = np.empty(())
    if not normal.ndim:
        sentence = (
            f"plane must be a coordinate's name, a function or an array of numbers, not {plane!r}"
        )
        hint = "an Event's function and direction go into plane= and direction="
        raise TypeError(hinted(sentence, hint) if isinstance(plane, Event) else sentence)
    if normal.shape != (len(names),):
        raise misshapen("plane", normal.shape, f"({len(names)},)")
    if not np.isfinite(normal).all() or not normal.any():
        raise ValueError("the normal of a plane must be finite and not zero")
    return normal


def cuts(offset: Any, period: Any, direction: Any) -> tuple[float, float | None, int]:
    """Return the offset, the period, and +1 for up, -1 for down, 0 for both."""
    c = number("offset must be a number", offset)
    if not math.isfinite(c):
        raise ValueError(f"offset must be finite, not {c}")
    if period is not None:
        period = number("period must be a number", period)
        if not (math.isfinite(period) and period > 0):
            raise ValueError(f"period must be positive and finite, not {period}")
    if direction not in DIRECTIONS:
        raise ValueError(f"direction must be one of {', '.join(DIRECTIONS)}, not {direction!r}")
    return c, period, DIRECTIONS[direction]
