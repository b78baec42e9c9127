"""The quantities that may be fitted, by name, and the start of which some states are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.errors import hinted, quoted
from liouville._runs.tangents import PARAMS, places_of
from liouville._studies.fitting.measurements import System
from liouville._systems import Field, SemiExplicit
from liouville._systems.derivatives import semi_explicit as _semi_explicit_sensitivity
from liouville._systems.derivatives import sensitivity as _sensitivity
from liouville.analysis.linearization import linearized_at
from liouville.analysis.point import Array, Point, Split

#: A singular value below this part of the largest is zero.
RANK = 1e-10


def movable(system: System) -> tuple[str, ...]:
    """Return the states of a start that are free: z of a semi-explicit system follows from y."""
    return ("y",) if isinstance(system, SemiExplicit) else system.states


def started(system: System, given: Mapping[str, Any]) -> dict[str, Array]:
    """Return a start that was given, checked; TypeError or ValueError where it is none."""
    found = system.start(given)
    return dict(zip(system.states, (found,) if isinstance(system, Field) else found, strict=True))


def consistent(system: System, t: float, params: Mapping[str, Any], start: Any) -> dict[str, Array]:
    """Return a start as it is moved onto its constraints; fields have none."""
    return dict(
        start if isinstance(system, Field) else system.consistent(t=t, params=params, **start)
    )


def free_directions(
    system: System, t: float, start: Mapping[str, Array], params: Array, free: Sequence[str]
) -> Array:
    """Return directions of all states in which those named move on the constraints, as columns.

    Raises
    ------
    ValueError
        Constraints leave them no freedom.
    """
    if isinstance(system, Field) or not free:
        width = sum(x.size for x in start.values())
        return np.eye(width)[:, : width * len(free)]
    first, second = start.values()
    if isinstance(system, SemiExplicit):
        gradients = _semi_explicit_sensitivity.gradients(system, t, first, params)
        null = Split.of(gradients).null
        basis: Array = np.vstack([null, np.zeros((second.size, null.shape[1]))])
        held: list[int] = []
    else:
        basis = linearized_at(Point(system, t, first, second, params)).tangent
        held = [k for k, name in enumerate(system.states) if name not in free]
    if held:  # of what is tangent, that which leaves the other state where it is
        rows = basis[first.size * held[0] : first.size * (held[0] + 1)]
        _, sizes, right = np.linalg.svd(rows)
        rank = int((sizes > RANK * sizes.max(initial=0.0)).sum())
        basis = basis @ right[rank:].T
        moved = basis[first.size * (1 - held[0]) : first.size * (2 - held[0])]
        basis = basis @ np.linalg.inv(np.linalg.qr(moved)[1])  # orthonormal in the unit of its own
    if not basis.shape[1]:
        sentence = f"constraints leave no freedom to {quoted(free)}"
        if not held:
            raise ValueError(hinted(sentence, "fit parameters alone"))
        hint = f"write free={tuple(system.states)!r}"
        raise ValueError(hinted(f"{sentence} while the other state is held", hint))
    return basis


@dataclass(frozen=True)
class FreeStart:
    """A start that is moved in some directions, and then onto the constraints.

    Attributes
    ----------
    system : Mechanics, SemiExplicit or Field
        What starts, without constraints that the others imply.
    t : float
        When.
    states : dict of str to ndarray
        All states before they are moved: those that are held as they were given, wherever the
        constraints are, so that they are moved from there whatever is fitted.
    basis : ndarray, shape (w, L)
        The directions, as columns.
    """

    system: System
    t: float
    states: dict[str, Array]
    basis: Array

    @classmethod
    def of(
        cls,
        system: System,
        t: float,
        given: Mapping[str, Array],
        found: Mapping[str, Array],
        params: Mapping[str, Any],
        free: Sequence[str],
    ) -> FreeStart:
        """Return the free directions at a start that was found; other states are held as given."""
        values = system.values(params)
        basis = free_directions(system, t, found, values, free)
        held = [name for name in movable(system) if name not in free]
        states = {**found, **{name: given[name] for name in held}}
        if not isinstance(system, SemiExplicit | Field):
            y, z = found.values()
            system = system.stepped(t, y, z, values)
        return cls(system, t, states, basis)

    @property
    def bases(self) -> dict[str, Array]:
        """The directions of each state."""
        cuts = np.cumsum([len(x) for x in self.states.values()])[:-1]
        return dict(zip(self.states, np.split(self.basis, cuts), strict=True))

    def moved(self, along: Array, params: Mapping[str, Any]) -> dict[str, Array]:
        """Return the start, so far along each direction."""
        return consistent(self.system, self.t, params, self._beside(along))

    def _beside(self, along: Array) -> dict[str, Any]:
        return {name: x + self.bases[name] @ along for name, x in self.states.items()}

    def tangents(
        self,
        along: Array,
        params: Mapping[str, Any],
        fitted: Sequence[str],
        start: Mapping[str, Array],
    ) -> dict[str, Array]:
        """Return changes of the moved start: by all elements that are fitted, then by directions.

        A run moves its start with the parameters as the projection from there does. What is left to
        add is by how much that from the states before they are moved differs.
        """
        names, places = movable(self.system), places_of(self.system)
        n = len(self.system.coordinates)
        elements = [place for name in fitted for place in _elements(*places[PARAMS + name])]
        rows = np.zeros((len(elements) + along.size, places["t1"][0]))
        rows[np.arange(len(elements)), elements] = 1.0
        for name in names:
            rows[len(elements) :, places[name][0] :][:, :n] = self.bases[name].T
        moves = tuple(np.split(rows, n * np.arange(1, 1 + len(names)), axis=1))
        values = self.system.values(params)
        found = self._pushed(tuple(self._beside(along).values()), values, moves)
        own = tuple(x[: len(elements)] for x in moves)
        of_run = self._pushed(tuple(start.values()), values, own)
        for x, known in zip(found, of_run, strict=True):
            x[: len(elements)] -= known
        return dict(zip(names, map(np.ascontiguousarray, found), strict=True))

    def _pushed(self, at: tuple[Array, ...], values: Array, moves: Any) -> tuple[Array, ...]:
        if isinstance(self.system, Field):
            return tuple(moves[:1])
        if isinstance(self.system, SemiExplicit):
            move = _semi_explicit_sensitivity.moved_start
            return (move(self.system, self.t, at[0], values, moves),)
        y, z = at
        return _sensitivity.moved_start(self.system, self.t, y, z, values, moves)


def _elements(first: int, shape: tuple[int, ...]) -> range:
    return range(first, first + int(np.prod(shape)))


def values_of(
    params: Mapping[str, Any], start: Mapping[str, Array], names: Mapping[str, Sequence[str]]
) -> dict[str, float]:
    """Return all that may be fitted, by name."""
    found = {}
    for name, value in params.items():
        for k, x in enumerate(np.ravel(value)):
            found[f"params.{name}" + f"[{k}]" * np.ndim(value)] = float(x)
    for name, value in start.items():
        places = names["unknowns" if name == "z" and "unknowns" in names else "coordinates"]
        found |= {f"{name}.{x}": float(v) for x, v in zip(places, value, strict=True)}
    return found
