"""Limits of the coordinates of joints: stops, which are contacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._systems.mechanics.contact import check_restitution
from liouville.bodies.body import Value, given

HINT = "write limits=(low, high), with None for a side that is free, or lv.bodies.Limits"

#: Angles from quaternions jump there: what is limited within needs to count no turns.
TURNS = {"angle": 2 * np.pi, "second angle": np.pi}


@dataclass(frozen=True)
class Limits:
    """The least and the largest value of a coordinate of a joint: ``limits=`` of a joint.

    At either there is a stop, a :class:`~liouville.Contact` without friction. Its force is a torque
    where the coordinate is an angle.

    Attributes
    ----------
    low, high : float, callable or None
        In radians or metres from where the joint is drawn, or functions of the parameters; None
        where there is no stop.
    restitution : float, default 0
        From 0 (no rebound) to 1.

    Raises
    ------
    TypeError, ValueError
        There is no stop, the largest is not above the least, or the restitution is none.
    """

    low: Value | None = None
    high: Value | None = None
    restitution: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what are no limits."""
        check_restitution(self.restitution)
        for side, value in self.stops():
            object.__setattr__(self, side, given(f"{side} of limits", value, ()))
        if self.low is None and self.high is None:
            raise ValueError(hinted("limits have neither low nor high", HINT))
        low, high = self.low_and_high
        if not self.functions() and not low < high:
            raise ValueError(f"high of limits must be above low = {low:g}, not {high:g}")

    def stops(self) -> Iterator[tuple[str, Value]]:
        """Return the stops by the name of their side."""
        sides = ("low", self.low), ("high", self.high)
        return ((side, value) for side, value in sides if value is not None)

    def functions(self) -> dict[str, Value]:
        """Return the values that are functions of the parameters."""
        return {side: value for side, value in self.stops() if callable(value)}

    @property
    def low_and_high(self) -> tuple[float, float]:
        """The interval that numbers leave."""
        low = -np.inf if self.low is None or callable(self.low) else float(self.low)
        high = np.inf if self.high is None or callable(self.high) else float(self.high)
        return low, high

    def are_within(self, coordinate: str) -> bool:
        """Return whether an angle from quaternions serves, which jumps somewhere beyond."""
        low, high = self.low_and_high
        turn = TURNS.get(coordinate, np.inf)
        return -turn < low and high < turn


def limits_of(of: str, names: Sequence[str], value: Any) -> dict[str, Limits]:
    """Return limits by coordinate: of a joint with several there is one entry for each."""
    if value is None:
        return {}
    entries = [value] if len(names) == 1 and not _is_row(value, 1) else value
    if not _is_row(entries, len(names)) or not all(_is_entry(x) for x in entries):
        if len(names) == 1:
            raise TypeError(
                hinted(f"limits= of {of} must be two numbers or Limits, not {value!r}", HINT)
            )
        wanted = f"must be one entry for each of its coordinates {', '.join(names)}, not {value!r}"
        hint = "each is a pair (low, high), Limits or None"
        raise TypeError(hinted(f"limits= of {of} {wanted}", hint))
    pairs = zip(names, entries, strict=True)
    return {
        name: own if isinstance(own, Limits) else Limits(*own)
        for name, own in pairs
        if own is not None
    }


def _is_row(value: Any, size: int) -> bool:
    is_row = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    return is_row and len(value) == size


def _is_entry(value: Any) -> bool:
    return value is None or isinstance(value, Limits) or _is_row(value, 2)


def check_motion(of: str, limits: Mapping[str, Limits], motions: Mapping[str, Any]) -> None:
    """Refuse limits of a coordinate whose motion is given."""
    for name in limits:
        if name in motions:
            sentence = f"'{name}' of {of} has both limits= and motion="
            raise ValueError(
                hinted(sentence, "a motion that is given meets no stop: leave one out")
            )
