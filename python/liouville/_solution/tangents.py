"""Tangents of a solution: the derivatives of its states in one direction, or in several."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from liouville._solution.points import Points

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moves:
    """The changes of times and parameters along d directions.

    Attributes
    ----------
    params : ndarray, shape (d, P)
        Changes of the parameters.
    t0, stretch : ndarray, shape (d,)
        Changes of the start time, and by which part of themselves steps become longer.
    start : float
        The start time.
    holds_times : bool
        Whether the times of records do not follow.
    """

    params: Array
    t0: Array
    stretch: Array
    start: float
    holds_times: bool

    def cut(self, first: int, last: int) -> Moves:
        """Return the changes along some of the directions."""
        own = slice(first, last)
        return replace(self, params=self.params[own], t0=self.t0[own], stretch=self.stretch[own])

    def of_times(self, t: Array) -> Array:
        """Return changes of the times of records, shape (k, d)."""
        found: Array = np.zeros((len(t), len(self.t0)))
        if not self.holds_times:
            found += self.t0 + np.outer(t - self.start, self.stretch)
        return found


@dataclass(frozen=True, eq=False, repr=False)
class Tangent:
    """Derivatives of a solution's states at its kept times, each also an attribute: ``tangent.q``.

    Attributes
    ----------
    states : dict of str to ndarray
        By the names of the system: ``q`` and ``v``, ``q`` and ``p``, or ``y`` and ``z``, of shape
        (k, n), and ``lam`` of shape (k, m); of a Schrödinger equation ``psi``, complex. Of d
        directions at once they have these as the axis before the last, as in (k, d, n), and in an
        ensemble of P members these as their second: (k, P, d, n). There is no ``lam`` where
        constraints of a structure are redundant.
    events : dict of str to Points
        Derivatives of the times of events, ``tangent.events["name"].t`` of shape (k,) or (k, d),
        and of the states there, by the names that ``solution.events`` has, with ``member`` in an
        ensemble.
    moves : Moves or None
        Changes of times and parameters in these directions; of wave functions there are none.
    """

    states: dict[str, Array]
    events: dict[str, Points] = field(default_factory=dict)
    moves: Moves | None = None

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for values in self.states.values():
            values.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickle, its arrays read-only."""
        self.__dict__.update(state)
        self.__post_init__()

    def __getattr__(self, name: str) -> Array:
        """Give a derivative by the name of its state."""
        states = self.__dict__.get("states", {})
        if name in states:
            found: Array = states[name]
            return found
        why = ""
        if name == "lam":
            why = ": multipliers of a structure's redundant constraints are not differentiated"
        raise AttributeError(f"the tangent has no {name!r}{why}\nhint: it has {', '.join(states)}")

    def __repr__(self) -> str:
        """Return the shapes of the derivatives."""
        shapes = (f"{name} {x.shape}" for name, x in self.states.items())
        return f"<Tangent {', '.join(shapes)}>"

    def of_member(self, member: int) -> Tangent:
        """Return that of one member of an ensemble, whose arrays have been cut before."""
        return replace(self, events={name: x.of_member(member) for name, x in self.events.items()})

    def each(self, change: Callable[[dict[str, Array]], dict[str, Array]]) -> Tangent:
        """Return the same with other arrays."""
        return replace(self, states=change(self.states))
