"""Checks of numbers, intervals and memory, before anything runs."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np

from liouville.errors import hinted

#: Beyond this, a step's number and its time are no longer exact.
MOST_STEPS = 2**53


def number(wanted: str, value: Any) -> float:
    """Return a real number as a float; TypeError says what is wanted."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise TypeError(f"{wanted}, not {value!r}")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def count(name: str, value: Any) -> int:
    """Return an integer that is at least 1."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} is an integer, not {value!r}")
    if value < 1:
        raise ValueError(f"{name} is at least 1, not {value}")
    return int(value)


def interval(t: Any) -> tuple[float, float]:
    """Return start and end of a finite interval that is not empty."""
    if not isinstance(t, (tuple, list, np.ndarray)) or len(t) != 2:
        raise TypeError(f"t is a pair (start, end), not {t!r}")
    t0, t1 = (number("t is a pair of numbers", x) for x in t)
    if not math.isfinite(t1 - t0):
        raise ValueError(f"t is a finite interval, not ({t0:g}, {t1:g})")
    if t0 == t1:
        raise ValueError(f"t = ({t0:g}, {t1:g}) is no interval")
    return t0, t1


def times_of(t: Any) -> tuple[float, ...]:
    """Return a start and later times, or earlier ones: a pair, or as many as wanted."""
    if isinstance(t, np.ndarray) and t.ndim == 1:
        t = t.tolist()
    if not isinstance(t, (tuple, list)) or len(t) < 2:
        raise TypeError(f"t is a pair (start, end) or a sequence of times, not {t!r}")
    times = tuple(number("t is made of numbers", x) for x in t)
    interval((times[0], times[-1]))
    steps = np.diff(times)
    bad = np.flatnonzero(~(np.isfinite(steps) & (steps * np.sign(times[-1] - times[0]) > 0)))
    if bad.size:
        k = int(bad[0])
        raise ValueError(f"times rise or fall: t has {times[k]:g} and then {times[k + 1]:g}")
    return times


def memory() -> float:
    """Return how many bytes may be taken."""
    there = 2**36
    if hasattr(os, "sysconf"):
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return 0.8 * there


def check_memory(what: str, needed: float, hint: str) -> None:
    """Refuse what would not fit in memory."""
    if needed > memory():
        sentence = f"{what} takes {needed / 2**30:.0f} GiB, more than this machine has"
        raise MemoryError(hinted(sentence, hint))
