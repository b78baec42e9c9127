"""Dates: what the times of a field are counted from, and in which unit."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.errors import hinted

#: Units of time by their lengths in seconds.
UNITS = {1.0: "seconds", 60.0: "minutes", 3600.0: "hours", 86400.0: "days"}

#: The calendar of ordinary dates.
ORDINARY = "proleptic_gregorian"


@dataclass(frozen=True)
class Dates:
    """The date of the time 0, and the unit that times are in.

    Attributes
    ----------
    first : numpy.datetime64, or a date of another calendar
        The date at the time 0.
    seconds : float
        The unit of times, in seconds.
    calendar : str
        The name of the calendar, by CF.
    """

    first: Any
    seconds: float = 1.0
    calendar: str = ORDINARY

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes of CF, "seconds since ..."; empty for an unusual unit."""
        unit = UNITS.get(self.seconds)
        if unit is None:
            return {}
        first = str(np.datetime_as_string(self.first)) if self._is_ordinary else str(self.first)
        return {"units": f"{unit} since {first.replace('T', ' ')}", "calendar": self.calendar}

    @property
    def _is_ordinary(self) -> bool:
        return isinstance(self.first, np.datetime64)

    def number(self, date: Any) -> float:
        """Return the time of a date."""
        if self._is_ordinary:
            own = np.datetime64(date) if isinstance(date, np.datetime64) else _plain(date)
            return float((own - self.first) / np.timedelta64(1, "s")) / self.seconds
        return float((date - self.first).total_seconds()) / self.seconds

    def length(self, span: Any) -> float:
        """Return a span of time as a number."""
        return float(np.timedelta64(span) / np.timedelta64(1, "s")) / self.seconds

    def written(self, t: float) -> str:
        """Write a time as a date, to the second."""
        if not self._is_ordinary:
            return str(self.first + datetime.timedelta(seconds=round(t * self.seconds)))
        found = self.first + np.timedelta64(round(t * self.seconds), "s")
        return str(found.astype("datetime64[s]"))


def _plain(date: datetime.datetime) -> np.datetime64:
    """Return a date of Python's; one with a zone is taken in universal time."""
    if date.tzinfo is not None:
        date = date.astimezone(datetime.UTC).replace(tzinfo=None)
    return np.datetime64(date, "us")


def is_date(value: Any) -> bool:
    """Return whether a value is a date, or one of a calendar with other years."""
    return (
        isinstance(value, np.datetime64 | datetime.datetime)
        or (isinstance(value, np.ndarray) and value.dtype.kind == "M")
        or hasattr(value, "calendar")
    )


def is_span(value: Any) -> bool:
    """Return whether a value is a span of time."""
    return isinstance(value, np.timedelta64 | datetime.timedelta)


def in_numbers(system: Any, dates: Dates | None, given: Any) -> Any:
    """Return a time, or several, with numbers for dates and spans.

    Raises
    ------
    TypeError
        There is a date, and the times of the system have none.
    """
    many = given if isinstance(given, tuple | list | np.ndarray) else (given,)
    if isinstance(given, np.ndarray) and given.dtype.kind not in "MmO":
        return given
    if not any(is_date(each) or is_span(each) for each in many):
        return given
    if dates is None:
        what = next(each for each in many if is_date(each) or is_span(each))
        sentence = f"times of {system!r} must be numbers, not {what!r}"
        raise TypeError(hinted(sentence, "a GriddedField has dates where t= or its data set has"))
    found = [
        dates.number(each) if is_date(each) else dates.length(each) if is_span(each) else each
        for each in many
    ]
    return found[0] if many is not given else tuple(found)
