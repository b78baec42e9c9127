"""Starts that violate constraints: by how much they may, and what is said of those that do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.tracing import trace as _trace

#: A start may miss its constraints by this much of the size of what they are made of.
TOLERANCE = 1e-10

#: Coordinates that are all below this start at zero but for roundoff, which is as large.
FLOOR = 1e-14

#: A start may miss its constraints by so many times what roundings make of them.
ROUNDINGS = 64


def finite_time(t: Any) -> float:
    """Return a time as a number; ValueError if it is none."""
    time = _trace.numbers(t)
    if time is None or time.shape != () or not np.isfinite(time):
        raise ValueError(f"t must be a finite number, not {t!r}")
    return float(time)


def check_residual(
    what: str,
    symbol: str,
    names: tuple[str, ...],
    value: np.ndarray,
    limit: np.ndarray,
    t: float,
    hint: str,
) -> None:
    """Refuse values of constraints at the start that are not finite or over their limits."""
    with np.errstate(invalid="ignore"):
        over = np.abs(value) - limit
    k = int(np.argmin(np.isfinite(value))) if not np.isfinite(value).all() else int(np.argmax(over))
    if not over[k] <= 0:
        raise ValueError(missed(what, symbol, names[k], value[k], limit[k], t, hint))


def missed(
    what: str, symbol: str, name: str, value: float, limit: float, t: float, hint: str
) -> str:
    """Return the fault of a constraint's value at the start."""
    if not math.isfinite(value + limit):
        fault = f"is {value}" if not math.isfinite(value) else "has no finite derivative"
        return hinted(
            f"the {what} '{name}' {fault} at the start, t = {t:g}",
            "look for a division by zero, a root or a logarithm of the model there",
        )
    sentence = (
        f"start violates the {what} '{name}': |{symbol}| = {abs(value):.1e} "
        f"at t = {t:g}, and at most {limit:.1e} is taken"
    )
    return hinted(sentence, hint)
