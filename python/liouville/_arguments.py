"""Checks of numbers, intervals and steps: what is wrong is said before anything runs."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville.errors import hinted

#: Beyond this, a step's number and its time are no longer exact.
MOST_STEPS = 2**53

#: Below this, the errors of a method of order 2 are those of roundoff.
LEAST_TOLERANCE = 1e-12

#: What may decide on the steps, if they are not equal.
CONTROLS = ("error", "reversible")

#: The absolute tolerance by default, in units of the relative one.
SMALL = 1e-3

#: The least step by default, in units of the last digit of t.
DIGITS = 64


@dataclass(frozen=True)
class Steps:
    """How a run goes from t0 to t1: `count` equal steps, or controlled ones.

    `control` is what the core is told: "error" with rtol, atol of shape (n,), the first step or 0
    where the method is to choose it, and the least; or "reversible" with the first and the least.
    """

    t0: float
    t1: float
    count: int = 1
    control: tuple[Any, ...] | None = None

    @property
    def total(self) -> str:
        """Return " of 100" for a message, where the number of steps is known."""
        return f" of {self.count}" if self.control is None else ""

    @property
    def tolerances(self) -> dict[str, float | list[float]]:
        """Return what controls the steps, if anything does."""
        if self.control is None:
            return {}
        if self.control[0] == "reversible":
            return {"h": self.control[1]}
        _, rtol, atol, _, _ = self.control
        return {"rtol": rtol, "atol": float(atol[0]) if np.ptp(atol) == 0 else atol.tolist()}

    def mean(self, times: np.ndarray, steps: int) -> float:
        """Return the step, or the mean of those made."""
        if self.control is None:
            return (self.t1 - self.t0) / self.count
        return float(times[-1] - self.t0) / steps if steps else 0.0


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


@dataclass(frozen=True)
class Takes:
    """A method's name, the controls of :data:`CONTROLS` it takes, and its least tolerance."""

    name: str
    controls: tuple[str, ...] = ()
    least: float = LEAST_TOLERANCE


def steps_of(
    t: Any,
    h: Any,
    steps: Any,
    control: Mapping[str, Any],
    coordinates: Sequence[str],
    takes: Takes | str,
) -> Steps:
    """Return the steps asked for, of a method of which the name says enough if they are equal.

    `control` has "control", "monitor", "rtol", "atol" and "h_min", None where they are not given.
    """
    t0, t1 = interval(t)
    takes = Takes(takes) if isinstance(takes, str) else takes
    given = {name: value for name, value in control.items() if value is not None}
    if given and not takes.controls:
        hint = "give h or steps, or take a method that controls its steps, such as HHT"
        raise TypeError(hinted(f"{takes.name} takes equal steps and no {next(iter(given))}", hint))
    kind = _kind(given, takes)
    if kind is not None and steps is not None:
        asks = "rtol, which controls them" if "rtol" in given else f"control='{kind}'"
        raise TypeError(f"give either steps, which are equal, or {asks}")
    if kind == "error":
        rtol = _relative(given, takes.least)
        first, least = _bounds(t0, t1, h, given.get("h_min"))
        atol = _tolerances(given.get("atol"), rtol, coordinates)
        return Steps(t0, t1, control=(kind, rtol, atol, first, least))
    if kind == "reversible":
        if h is None:
            raise TypeError("control='reversible' takes h, the step at the start")
        return Steps(t0, t1, control=(kind, *_bounds(t0, t1, h, given.get("h_min"))))
    if (h is None) == (steps is None):
        more = "" if "error" not in takes.controls or steps else ", or rtol"
        raise TypeError(f"give either h or steps{more}")
    return _equal(t0, t1, h, steps)


def _kind(given: Mapping[str, Any], takes: Takes) -> str | None:
    """Return which control is asked for, and refuse what belongs to another."""
    kind = given.get("control", "error" if "rtol" in given else None)
    if kind is None:
        for name in given:
            wanted = "control='reversible'" if name == "monitor" else "rtol="
            raise TypeError(hinted(f"{name} is for controlled steps", f"give {wanted} too"))
        return None
    if kind not in CONTROLS:
        raise ValueError(f"control is 'error', 'reversible' or None, not {kind!r}")
    if kind not in takes.controls:
        why, hint = {
            "error": ("does not estimate its errors", "give h or steps, or take Spark or HHT"),
            "reversible": ("is not symmetric, as reversible steps want it", "take Spark"),
        }[kind]
        raise TypeError(hinted(f"{takes.name} {why}", hint))
    foreign = ("monitor",) if kind == "error" else ("rtol", "atol")
    for name in foreign:
        if name in given:
            raise TypeError(f"control='{kind}' takes no {name}")
    return str(kind)


def _relative(given: Mapping[str, Any], least: float) -> float:
    if "rtol" not in given:
        raise TypeError("control='error' takes rtol, the relative tolerance")
    rtol = number("rtol is a number", given["rtol"])
    if not least <= rtol < 1:
        raise ValueError(f"rtol is from {least:g} to below 1, not {rtol:g}")
    return rtol


def _bounds(t0: float, t1: float, h: Any, h_min: Any) -> tuple[float, float]:
    """Return the first step, or 0, and the least."""
    first = 0.0 if h is None else _step("h", h, t0, t1)
    if h_min is None:
        least = DIGITS * float(np.spacing(max(abs(t0), abs(t1))))
        least = min(least, first) if first else least
    else:
        least = _step("h_min", h_min, t0, t1)
        if first and least > first:
            raise ValueError(f"h_min = {least:g} is larger than the first step, h = {first:g}")
    _check_moves(math.copysign(least, t1 - t0), max(t0, t1, key=abs))
    return first, least


def _equal(t0: float, t1: float, h: Any, steps: Any) -> Steps:
    if h is None:
        n = float(min(count("steps", steps), MOST_STEPS))
    else:
        n = abs(t1 - t0) / _step("h", h, t0, t1) * (1 - 1e-12)
    if n >= MOST_STEPS:
        what = "steps" if h is None else f"h = {h:g}"
        raise ValueError(f"{what}: more than {MOST_STEPS:.0e} steps cannot be counted")
    n = math.ceil(n)
    _check_moves((t1 - t0) / n, t0)
    return Steps(t0, t1, n)


def _tolerances(atol: Any, rtol: float, coordinates: Sequence[str]) -> np.ndarray:
    n = len(coordinates)
    if atol is None:
        return np.full(n, SMALL * rtol)
    try:
        values = np.asarray(atol)
    except ValueError:  # ragged
        values = np.array(None)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"atol is a number or an array of numbers, not {atol!r}")
    if values.shape not in ((), (n,)):
        raise ValueError(f"atol has shape {values.shape}, wanted () or ({n},)")
    values = np.array(np.broadcast_to(values, n), dtype=float)
    bad = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
    if bad.size:
        name, value = coordinates[bad[0]], values[bad[0]]
        raise ValueError(
            hinted(
                f"atol is positive and finite, not {value:g} for '{name}'",
                "it says which change does not matter; without atol= that is rtol / 1000",
            )
        )
    return values


def _step(name: str, value: Any, t0: float, t1: float) -> float:
    size = number(f"{name} is a number", value)
    if not (math.isfinite(size) and size > 0):
        hint = "to go backwards, give t=(end, start)"
        raise ValueError(hinted(f"{name} is positive and finite, not {size}", hint))
    if size > abs(t1 - t0) * (1 + 1e-9):
        raise ValueError(f"{name} = {size:g} is larger than the interval, {abs(t1 - t0):g}")
    return size


def _check_moves(step: float, t: float) -> None:
    if t + step == t:
        raise ValueError(f"a step of {step:g} does not move t = {t:g}")


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
