"""Points of a trajectory: states at times that are not those of the steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import html

#: All that a state may be called, in the order of a solution's states.
STATES = ("x", "psi", "q", "y", "z", "v", "p", "lam", "acceleration", "a")

#: A time beyond an end by so many roundings of it is this end, by so much of the run at most.
ROUNDINGS, SHORT = 8, 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Points:
    """States of a trajectory at some times, each also an attribute: ``points.q``.

    Attributes
    ----------
    t : ndarray, shape (k,), or float
        The times.
    states : dict of str to ndarray
        ``q``, ``v``, ``p`` of shape (k, n) and ``lam`` of shape (k, m), or others by the names that
        the solution has them under; without the first axis where t is a single time. Of an event
        with a reset these are the states before it, and ``q_after``, ``v_after`` and so on those
        after it. The events of an ensemble have ``member``, shape (k,), too.
    """

    t: Any
    states: dict[str, NDArray[Any]]

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for values in (self.t, *self.states.values()):
            if isinstance(values, np.ndarray):
                values.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickle, its arrays read-only."""
        self.__dict__.update(state)
        self.__post_init__()

    def __getattr__(self, name: str) -> NDArray[Any]:
        """Give a state by its name."""
        states = self.__dict__.get("states", {})
        if name in states:
            found: NDArray[Any] = states[name]
            return found
        raise AttributeError(
            f"the points have no {name!r}\nhint: their states are {', '.join(states)}"
        )

    def __dir__(self) -> list[str]:
        """Name the states too."""
        return [*object.__dir__(self), *self.states]

    def of_member(self, member: int) -> Points:
        """Return the points of one member of an ensemble, by its number from 0."""
        own = self.states["member"] == member
        states = {name: x[own] for name, x in self.states.items() if name != "member"}
        return Points(self.t[own], states)

    def __len__(self) -> int:
        """Return how many there are."""
        return int(np.size(self.t))

    def _repr_html_(self) -> str:
        """Show a table of the arrays in a notebook."""
        rows = [("t", *html.described(np.atleast_1d(self.t)))]
        rows += [(name, *html.described(np.asarray(x))) for name, x in self.states.items()]
        return html.table(repr(self), rows, ("", "shape", "first and last"))

    def __repr__(self) -> str:
        """Return how many points of which states."""
        times = np.atleast_1d(self.t)
        span = f", t = {times[0]:g} to {times[-1]:g}" if times.size else ""
        return f"<{len(self)} Points{span}: {', '.join(self.states)}>"


def with_ends(times: NDArray[np.float64], first: float, last: float) -> NDArray[np.float64]:
    """Return times in which those that a few roundings put beyond an end of a run are this end."""
    length = abs(last - first)
    slack = min(ROUNDINGS * np.finfo(float).eps * max(abs(first), abs(last)), SHORT * length)
    for end, other in ((first, last), (last, first)):
        beyond = (end - times) * np.sign(other - end)
        times = np.where((beyond > 0) & (beyond <= slack), end, times)
    return times


def times_within(t: Any, first: float, last: float) -> NDArray[np.float64]:
    """Return a time or an array of times, each within a run from `first` to `last`."""
    times = np.asarray(t)
    if times.dtype.kind not in "iuf" or times.ndim > 1:
        raise TypeError(f"t must be a number or an array of numbers, not {t!r}")
    found = with_ends(times.astype(float), first, last)
    outside = found[~((min(first, last) <= found) & (found <= max(first, last)))]
    if outside.size:
        raise ValueError(
            f"t = {outside[0]:g} is outside the run, which goes from {first:g} to {last:g}"
        )
    return found
