"""Units of a data set, as CF, UDUNITS and models write them: of lengths, times and velocities."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted
from liouville._systems.fields.dates import ORDINARY, Dates

#: Lengths in metres and times in seconds, without the s of a plural.
LENGTHS = {"m": 1.0, "metre": 1.0, "meter": 1.0, "km": 1e3, "kilometre": 1e3, "kilometer": 1e3,
           "cm": 1e-2, "centimetre": 1e-2, "centimeter": 1e-2,
           "mm": 1e-3, "millimetre": 1e-3, "millimeter": 1e-3}  # fmt: skip
TIMES = {"s": 1.0, "sec": 1.0, "second": 1.0, "min": 60.0, "minute": 60.0, "h": 3600.0,
         "hr": 3600.0, "hour": 3600.0, "d": 86400.0, "day": 86400.0, "week": 604800.0,
         "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3,
         "us": 1e-6, "microsecond": 1e-6, "nanosecond": 1e-9}  # fmt: skip

#: Units that say that there are none.
NONE = ("", "1", "dimensionless", "none", "nondimensional")

#: A length over a time, or times it to the power -1.
RATE = re.compile(
    r"([a-z]+)\s*(?:/\s*([a-z]+)|\s+per\s+([a-z]+)|(?:\s+|[.*]\s*)([a-z]+)\s*(?:\^|\*\*)?-1)"
)


def length(unit: str) -> float | None:
    """Return a unit of length in metres, None where it is not known."""
    return _known(unit, LENGTHS)


def time(unit: str) -> float | None:
    """Return a unit of time in seconds, None where it is not known or of no fixed length."""
    return _known(unit, TIMES)


def velocity(unit: str) -> tuple[float, float] | None:
    """Return the units of length and of time of a velocity, None where they are not known."""
    match = RATE.fullmatch(unit.strip().lower())
    if match is None:
        return None
    along, over = length(match[1]), time(match[2] or match[3] or match[4])
    return None if along is None or over is None else (along, over)


def needed(name: str, unit: str) -> tuple[float, float]:
    """Return the units of a velocity, m/s where it has none and axes and times have others.

    Raises
    ------
    ValueError
        Its unit is not known.
    """
    if unit.lower() in NONE:
        return 1.0, 1.0
    found = velocity(unit)
    if found is None:
        sentence = f"'{name}' is in {unit!r}, which is no unit of velocity that is known"
        hint = f"convert it, and say so: dataset['{name}'].attrs['units'] = 'm s-1'"
        raise ValueError(hinted(sentence, hint))
    return found


def seconds(name: str, unit: str, values: NDArray[Any]) -> NDArray[np.float64] | None:
    """Return times in seconds, dates from the first one on; None where they have no unit.

    Raises
    ------
    ValueError
        Their unit is not known.
    """
    if values.dtype.kind in "mM":
        return np.asarray((values - values[0]) / np.timedelta64(1, "s"), dtype=float)
    if values.dtype.kind == "O":  # dates of a calendar without leap years, and other dates
        return np.array([(value - values[0]).total_seconds() for value in values])
    word, _, since = unit.partition(" since ")
    if not since and word.lower() in NONE:
        return None
    factor = time(word)
    if factor is None:
        sentence = f"'{name}' is in {unit!r}, which is no unit of time of a fixed length"
        raise ValueError(hinted(sentence, "give dates, or times in the unit of the velocity"))
    return np.asarray(values - values[0] * bool(since), dtype=float) * factor


def dates(values: NDArray[Any], unit: str, calendar: str, per_unit: float) -> Dates | None:
    """Return the first date, from which times are counted, None where there are no dates.

    Times are then in a unit of so many seconds.
    """
    if values.dtype.kind == "M":
        return Dates(values[0].astype("datetime64[ns]"), per_unit)
    if values.dtype.kind == "O":
        return Dates(values[0], per_unit, str(getattr(values[0], "calendar", calendar)))
    word, _, since = unit.partition(" since ")
    factor = time(word)
    if not since or factor is None or calendar not in ("", "standard", "gregorian", ORDINARY):
        return None
    day, _, clock = since.strip().partition("T" if "T" in since else " ")
    try:
        first = np.datetime64(f"{day}T{clock.strip() or '00:00'}".rstrip("Z"), "ns")
    except ValueError:  # of a zone, or written in another way
        return None
    return Dates(first + np.timedelta64(round(float(values[0]) * factor * 1e9), "ns"), per_unit)


def _known(unit: str, known: dict[str, float]) -> float | None:
    word = unit.strip().lower()
    return known.get(word, known.get(word.removesuffix("s")))
