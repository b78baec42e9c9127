"""Derivatives of invariants, and of functions of states, along the tangents of a run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted, quoted
from liouville._systems import Field, Mechanics, SemiExplicit
from liouville._systems.derivatives.invariants import pulled_invariants

if TYPE_CHECKING:
    from liouville._solution.points import Points
    from liouville._solution.solution import Solution
    from liouville._solution.tangents import Tangent

Array = NDArray[Any]

#: Gradients by (t, states, params) at records, shape (k, 1 + N + P, w), of times and states.
Slopes = Callable[[Array, tuple[Array, ...], Array], Array]


def tangent_of(solution: Solution, what: Any, event: str | None = None) -> dict[str, Array]:
    """Return derivatives in all directions; see :meth:`liouville.Solution.tangent_of`."""
    if not solution.tangents:
        sentence = "the run has no tangents"
        raise ValueError(hinted(sentence, 'integrate with tangents={"params.l": 1.0}'))
    system = solution.system
    if not isinstance(system, Mechanics | SemiExplicit | Field):
        sentence = f"the system must be a mechanical one or a field, not {system!r}"
        raise TypeError(hinted(sentence, "along dψ the mean of A changes by 2 Re <ψ|A|dψ>"))
    if event is not None and event not in solution.events:
        known = f"there are {quoted([*solution.events])}" if solution.events else "it has none"
        raise ValueError(hinted(f"the run has no event {event!r}", known))
    slopes, is_scalar = _slopes(system, what)
    if solution.members is None:
        found = _along(solution, system, what, slopes, event)
    else:
        whole = (_whole(solution, k, event) for k in range(solution.members))
        each = [_along(own, system, what, slopes, event) for own in whole]
        joined: Any = partial(np.stack, axis=1) if event is None else np.concatenate
        found = {name: joined([x[name] for x in each]) for name in solution.tangents}
    return {name: x[..., 0] if is_scalar else x for name, x in found.items()}


def _slopes(system: Mechanics | SemiExplicit | Field, what: Any) -> tuple[Slopes, bool]:
    """Return the gradient of an invariant by its name, or of a function, and whether it is one."""
    if callable(what):
        tape, width = system.slopes_of(what)
        return lambda t, states, values: _mapped(tape, width, t, states, values), width == 1
    if not isinstance(what, str) or what not in system.invariants:
        known = f"there are {quoted([*system.invariants])}" if system.invariants else "it has none"
        sentence = f"the system has no invariant {what!r}"
        raise ValueError(hinted(sentence, f"{known}; an observable is given as its function"))
    if isinstance(system, Field):
        tape = system.slopes_of_invariant(what)
        return lambda t, states, values: _mapped(tape, 1, t, states, values), True
    place = [*system.invariants].index(what)

    def pulled(t: Array, states: tuple[Array, ...], values: Array) -> Array:
        weights = np.zeros((len(t), len(system.invariants)))
        weights[:, place] = 1.0
        first, second = states
        return pulled_invariants(system, (t, first, second), values, weights)[..., None]

    return pulled, True


def _mapped(tape: Any, width: int, t: Array, states: tuple[Array, ...], values: Array) -> Array:
    found: Array = tape.map(values, [np.ascontiguousarray(x) for x in (t[:, None], *states)])
    return found.reshape(len(t), -1, width)


def _whole(solution: Solution, member: int, event: str | None) -> Solution:
    """Return a member with all records, NaN where it is over, or with its events alone."""
    own = solution.member(member)
    missing = len(solution.t) - len(own.t)
    return own if event is not None or not missing else solution.sel(member=member)


def _of_multipliers(tangent: Tangent | Points, lam: Array, by: Array) -> Array:
    """Return the derivatives of the multipliers, zero where there are none and none are needed."""
    if "lam" in tangent.states:
        return tangent.states["lam"]
    first = next(iter(tangent.states.values()))
    count, size = 1 + 2 * first.shape[-1], lam.shape[1]
    if by[:, count : count + size].any():
        raise ValueError("multipliers of redundant constraints have no derivatives here")
    return np.zeros((*first.shape[:-1], size))


def _along(
    solution: Solution,
    system: Mechanics | SemiExplicit | Field,
    what: Any,
    slopes: Slopes,
    event: str | None,
) -> dict[str, Array]:
    """Return the derivatives of a run at its records or at an event, shape (k, ..., w)."""
    values = system.values(solution.params)
    at = solution if event is None else solution.events[event]
    states = tuple(at.states[name] for name in system.states)
    if callable(what) and isinstance(system, Mechanics):
        states += (at.states["lam"],)
    widths = {name: len(system.places[name]) for name in system.states}
    if any(x.shape[1] != width for x, width in zip(states, widths.values(), strict=False)):
        sentence = "the solution has some of the coordinates only"
        raise ValueError(hinted(sentence, "differentiate the whole one, and select then"))
    by, found, last = slopes(at.t, states, values), {}, ended(solution)
    for name, tangent in solution.tangents.items():
        moved = tangent if event is None else tangent.events[event]
        rows = [moved.states[state] for state in system.states]
        if len(states) > len(rows):
            rows.append(_of_multipliers(moved, states[-1], by))
        many = [x if x.ndim == 3 else x[:, None] for x in rows]
        moves = tangent.moves
        if moves is None:
            sentence = "a file keeps tangents of states, and not what directions change besides"
            raise ValueError(hinted(sentence, "differentiate the run before it is saved"))
        times = moves.of_times(at.t)
        if event is not None:
            times = tangent.events[event].t.reshape(times.shape)
        elif last is not None:
            times[-1] = tangent.events[last].t[-1]
        params = np.broadcast_to(moves.params, (len(times), *moves.params.shape))
        along = np.concatenate([times[..., None], *many, params], axis=2)
        own = np.einsum("kdi,kiw->kdw", along, by)
        found[name] = own if rows[0].ndim == 3 else own[:, 0]
    return found


def ended(solution: Solution) -> str | None:
    """Return the event that has ended a run at its last time, None where there is none."""
    for name, points in solution.events.items():
        is_last = points.t.size > 0 and points.t[-1] == solution.t[-1]
        if is_last and f"'{name}'" in solution.message:
            return name
    return None
