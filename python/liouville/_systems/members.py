"""Start values of an ensemble: a row for each member, each on its constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import misshapen, shown
from liouville._systems.fields.field import Field
from liouville._systems.mechanics.general import ONTO, Mechanics
from liouville._systems.mechanics.semi_explicit import SemiExplicit
from liouville._systems.mechanics.traced import TracedSystem
from liouville._systems.tracing import trace as _trace
from liouville._systems.waves.equation import Schrodinger


def are_given(
    system: Mechanics | SemiExplicit | Field | Schrodinger,
    start: Mapping[str, Any],
    params: Mapping[str, ArrayLike] | None,
) -> bool:
    """Return whether a start value or a parameter has a row for each member."""
    own = system.params
    given = params.items() if isinstance(params, Mapping) else ()
    if any(name in own and np.ndim(x) == np.ndim(own[name]) + 1 for name, x in given):
        return True
    if isinstance(system, Schrodinger):
        shape = np.shape(start.get("potential", 0.0))
        return system.is_many(start.get("psi")) or (
            shape not in ((), *system.potential_shapes) and shape[1:] in system.potential_shapes
        )

    def axes(value: Any) -> int:
        if isinstance(value, Mapping):
            return 1 + max((np.ndim(x) for x in value.values()), default=0)
        return np.ndim(value)

    return any(axes(x) == 2 for x in start.values())


def starts(
    system: Mechanics | SemiExplicit, start: Mapping[str, Any], also: tuple[str, ...] = ()
) -> dict[str, np.ndarray]:
    """Check start values: arrays of shape (P, n), or (n,) for all members alike.

    Raises
    ------
    TypeError, ValueError
        As the system's own `start` does, naming the member.
    """
    names = dict.fromkeys(also, system.coordinates) | system.places
    found = {}
    for name, value in start.items():
        known = name in (*system.states, *also)
        array = _rows(name, value, names[name]) if known else None
        if array is not None:
            found[name] = array
    single = {name: np.zeros(len(names[name])) if name in found else x for name, x in start.items()}
    given = (*system.states, *(name for name in also if start.get(name) is not None))
    values = zip(given, system.start(single, also), strict=True)
    return {name: found.get(name, x) for name, x in values}


def parameters(
    system: Mechanics | SemiExplicit | Field | Schrodinger,
    changes: Mapping[str, ArrayLike] | None,
) -> tuple[np.ndarray, dict[str, int]]:
    """Return rows of parameters, one or one for each member, and the members of those that vary."""
    defaults = system.params
    values = system.parameters.values if isinstance(system, Schrodinger) else system.values
    given = _trace.mapping("params", changes)
    own: dict[str, np.ndarray] = {}
    for name, value in given.items():
        array = _trace.numbers(value)
        ndim = np.ndim(defaults[name]) if name in defaults else 0
        if array is not None and name in defaults and array.ndim == ndim + 1:
            own[name] = array
    shared = {name: value for name, value in given.items() if name not in own}
    if not own:
        return values(shared)[None], {}
    counts = {name: len(x) for name, x in own.items()}
    many = min(counts.values())
    if not many:
        return np.empty((0, values(shared).size)), counts

    def of_member(member: int) -> np.ndarray:
        try:
            return values({**shared, **{name: x[member] for name, x in own.items()}})
        except ValueError as error:
            raise ValueError(f"member {member}: {error}") from None

    rows, end = np.tile(of_member(0), (many, 1)), 0
    for name, x in defaults.items():
        begin, end = end, end + np.size(x)
        if name in own:
            rows[:, begin:end] = own[name][:many].reshape(many, -1)
    # all have the shape of the first; a look at each takes as long as twenty steps
    each = isinstance(system, TracedSystem) and system.checks_values
    refused = np.flatnonzero(~np.isfinite(rows).all(axis=1)).tolist()
    for member in range(many) if each else refused:
        of_member(member)
    return rows, counts


def common(counts: Mapping[str, int]) -> int:
    """Return the number of members that all have, by what they are called; ValueError else."""
    first, many = next(iter(counts.items()))
    for name, count in counts.items():
        if count != many:
            raise ValueError(f"{name} must have {many} members as {first} has, not {count}")
    if not many:
        raise ValueError(f"{first} has no members along its first axis")
    return many


def consistent(
    system: Mechanics | SemiExplicit,
    start: Mapping[str, Any],
    params: Mapping[str, ArrayLike] | None,
    **options: Any,
) -> dict[str, np.ndarray] | None:
    """Move the start of each member onto its constraints; None if this is the start of one.

    Raises
    ------
    TypeError, ValueError
        As the system's own `consistent` does, naming the member.
    """
    many = {
        name: array
        for name, value in start.items()
        if name in system.places and (array := _rows(name, value, system.places[name])) is not None
    }

    def moved(given: dict[str, Any], values: dict[str, Any]) -> dict[str, np.ndarray]:
        return system.consistent(params=values, **options, **(dict(start) | given))

    return each(system, many, params, moved)


def each(
    system: Mechanics | SemiExplicit,
    many: Mapping[str, np.ndarray],
    params: Mapping[str, ArrayLike] | None,
    started: Callable[[dict[str, Any], dict[str, Any]], dict[str, np.ndarray]],
) -> dict[str, np.ndarray] | None:
    """Start each member by its own row of `many` and its parameters; None where there is one."""
    _, of_params = parameters(system, params)
    counts = {name: len(x) for name, x in many.items()}
    counts |= {f"parameter '{name}'": count for name, count in of_params.items()}
    if not counts:
        return None
    given: dict[str, Any] = dict(params or {})
    found = []
    for member in range(common(counts)):
        own = {name: x[member] for name, x in many.items()}
        values = given | {name: given[name][member] for name in of_params}
        try:
            found.append(started(own, values))
        except ValueError as error:
            raise ValueError(f"member {member}: {error}") from None
    return {name: np.stack([one[name] for one in found]) for name in system.states}


def check(
    system: Mechanics | SemiExplicit,
    t: float,
    y: np.ndarray,
    z: np.ndarray,
    params: np.ndarray,
    *,
    hidden: bool = True,
) -> None:
    """Refuse members that violate their constraints; `params` has a row for each, or one."""
    if isinstance(system, Mechanics):
        found = system.violation(t, y, z, params, hidden=hidden)
        if found is not None:
            sentence = system.violated(found, t, ONTO.format(*system.states))
            raise ValueError(f"member {found[0]}: {sentence}")
        return
    for member in range(len(y)):
        values = params[member if len(params) > 1 else 0]
        try:
            system.check(t, y[member], z[member], values)
        except ValueError as error:
            raise ValueError(f"member {member}: {error}") from None


def _rows(name: str, value: Any, places: tuple[str, ...]) -> np.ndarray | None:
    """Return rows with a number for each coordinate, None where there are not several."""
    if isinstance(value, Mapping):
        if set(value) != set(places):
            return None
        columns = [x for place in places if (x := _trace.numbers(value[place])) is not None]
        if len(columns) < len(places) or {x.ndim for x in columns} not in ({1}, {0, 1}):
            return None
        lengths = {len(x): place for x, place in zip(columns, places, strict=True) if x.ndim}
        if len(lengths) > 1:
            (one, of_one), (other, of_other) = list(lengths.items())[:2]
            raise ValueError(
                f"{name} of '{of_other}' must have {one} members as '{of_one}', not {other}"
            )
        array = np.stack(np.broadcast_arrays(*columns), axis=-1)
    else:
        given = _trace.numbers(value)
        if given is not None and given.ndim == 1 and len(places) == 1 and given.size > 1:
            given = given[:, None]  # a number for each member, of one coordinate
        if given is None or given.ndim != 2:
            return None
        array = given
    n = len(places)
    if array.shape[1] != n:
        hint = f"along the last axis give a number for each of {shown(places)}"
        raise misshapen(name, array.shape, f"(P, {n}) for P members", hint)
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        member, place = (int(k) for k in bad[0])
        found = array[member, place]
        raise ValueError(
            f"{name} of '{places[place]}' of member {member} must be finite, not {found}"
        )
    return array
