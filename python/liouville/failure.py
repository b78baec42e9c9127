"""Failures: the members of an ensemble that could not go on."""

from __future__ import annotations

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


def summary_of(failures: Mapping[int, Failure], members: int) -> str:
    """Return how many of the members of an ensemble failed, and why the first of them did."""
    if not failures:
        return ""
    member, failure = next(iter(failures.items()))
    count = f"{len(failures)} of {members} members failed"
    return f"{count}; the first, member {member}: {failure.message}"
