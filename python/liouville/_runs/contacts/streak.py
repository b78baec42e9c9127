"""Hits that come ever sooner and ever harder, as between walls that close in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted

#: So many such hits at least have no end where flights are this part of the longest, ...
LEAST, ENDLESS = 8, 1e-5
#: ... and contacts take part whose flights are this part.
TAKES_PART = 1e-4
#: Their end is predicted anew each time that flights are this part of those before, ...
MARKED = 0.1
#: ... to this part of the time until then.
ROUNDED = 1e-6


@dataclass
class Streak:
    """Hits of a contact in turn, each harder and after a shorter flight than the one before.

    Attributes
    ----------
    t, impulse, flight : float
        The last hit, its impulse, and the flight before it.
    earlier, longest : float
        The flight before that, and the first of the streak.
    count : int
        How many hits there are behind that.
    marked, ends : float and tuple of float
        The flight at the last prediction of the end, and the last three predictions.
    is_settled : bool
        Whether these come together: flights that shrink to some least one have no end, and
        predictions of it that fly apart.
    """

    t: float = np.nan
    impulse: float = 0.0
    flight: float = np.nan
    earlier: float = np.nan
    longest: float = np.nan
    count: int = 0
    marked: float = np.nan
    ends: tuple[float, ...] = ()
    is_settled: bool = False

    def hit(self, t: float, impulse: float) -> None:
        """Take a hit."""
        flight = t - self.t
        if not flight:  # one of several at once
            return
        self.count += 1
        if not (flight < self.flight and impulse > self.impulse):
            self.longest, self.count = flight, 0
            self.marked, self.ends, self.is_settled = flight, (), False
        self.t, self.impulse, self.earlier, self.flight = t, impulse, self.flight, flight
        if flight <= MARKED * self.marked:
            self._mark()

    def _mark(self) -> None:
        """Predict the end, and compare it with the predictions before."""
        self.marked, self.ends = self.flight, (*self.ends[-2:], self.end)
        if len(self.ends) > 2:
            before, last = np.abs(np.diff(self.ends))
            self.is_settled = bool(last <= max(before, ROUNDED * (self.end - self.t)))

    def has_shrunk(self, part: float) -> bool:
        """Whether flights are as short as this part of the longest."""
        return self.flight <= part * self.longest

    @property
    def end(self) -> float:
        """When hits accumulate: between walls that close in, the n-th is 1 / n before it."""
        ratio = self.flight / self.earlier
        return self.t + self.flight * (1 + ratio) / (1 - ratio)


def refuse_endless(streaks: Sequence[Streak], k: int, names: Sequence[str]) -> None:
    """Refuse a hit of the contact k that is one of too many, by the contacts that take part."""
    own = streaks[k]
    if own.count >= LEAST and own.has_shrunk(ENDLESS) and own.is_settled:
        part = [n for n, x in zip(names, streaks, strict=True) if x.has_shrunk(TAKES_PART)]
        what = f"the hits of {quoted(part)} come ever sooner and ever harder"
        sentence = f"at t = {own.t:g} {what}, without end until t = {own.end:.6g}"
        hint = "what was done is kept, and an event ends the run before"
        raise IntegrationError(hinted(sentence, hint), t=own.t)
