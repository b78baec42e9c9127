"""What is left to say of a member of an ensemble that could not go on."""

from __future__ import annotations

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
