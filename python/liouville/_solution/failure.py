"""Failures: the members of an ensemble that could not go on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Failure:
    """A member of an ensemble that failed while the others went on.

    Attributes
    ----------
    step : int
        Number of the failed step, from 0.
    t : float
        Time at its start; the member's rows after it are NaN.
    message : str
        Why, in the words of :class:`IntegrationError`.
    """

    step: int
    t: float
    message: str


#: A message has the numbers of so many failed members.
SHOWN = 6


def ending_of(failures: Mapping[int, Failure], members: int) -> str:
    """Return how an ensemble ended that was not interrupted."""
    if not failures:
        return "done"
    return "failed" if len(failures) == members else "partly failed"


def summary_of(failures: Mapping[int, Failure], members: int) -> str:
    """Return which of the members of an ensemble failed, and why the first of them did."""
    if not failures:
        return ""
    first, *others = failures
    count = f"{len(failures)} of {members} members failed"
    if others:
        shown = [*map(str, [first, *others][:SHOWN])]
        rest = len(failures) - len(shown)
        last = f"{rest} more" if rest else shown.pop()
        count += f" ({', '.join(shown)} and {last})"
    return f"{count}; the first, member {first}: {failures[first].message}"


def counted_on(message: str, step: int, of: int, done: int, total: int) -> str:
    """Return the message of a failed step, with its number in the whole computation."""

    def counted(found: re.Match[str]) -> str:
        return f"{found[1]} {done + step}" + (f" of {total}" if found[2] else "")

    return re.sub(rf"\b(step|after) {step}\b( of {of}\b)?", counted, message, count=1)
