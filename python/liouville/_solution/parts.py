"""Parts of a solution: one member of an ensemble, an interval of times, some coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import check_name, hinted
from liouville._solution.points import Points, times_within
from liouville._solution.tangents import Tangent
from liouville._systems import Mechanics, SemiExplicit
from liouville._systems.events import AFTER, sides_of

if TYPE_CHECKING:
    from liouville._solution.solution import Array, Solution

#: The groups of arrays of a solution with time as their first axis, then the member, if any.
GROUPS = ("states", "invariants", "residuals", "observed", "angles", "balance", "error")

#: What joins words, such as those of solvers.
AND = " and "

#: Times that differ by so many roundings are the same.
ROUNDINGS = 4

#: The states that have no number for each coordinate.
NOT_OF_COORDINATES = ("lam", "psi", "member")


def member_of(solution: Solution, member: int) -> Solution:
    """Return one member of an ensemble; see :meth:`liouville.Solution.member`."""
    count = solution.members
    if isinstance(member, bool) or not isinstance(member, int | np.integer):
        raise TypeError(f"member must be a number, not {member!r}")
    if count is None or not -count <= member < count:
        has = "a single run" if count is None else f"an ensemble of {count}"
        raise ValueError(f"there is no member {member} of {has}")
    k = int(member) % count
    arrays = _each(solution, lambda x: x[:, k])
    failure = solution.failures.get(k)
    rows = len(solution.t)
    if failure is not None or k in solution.endings or solution.status == "interrupted":
        rows = _reached(arrays, rows)
        arrays = _each(solution, lambda x: x[:rows, k])
    arrays["tangents"] = {name: x.of_member(k) for name, x in arrays["tangents"].items()}
    status, steps = "done", solution.stats.get("steps")
    if failure is not None:
        status, steps = "failed", failure.step
    elif k in solution.endings:
        # where no record is kept of the start its time is not known
        steps = (
            None if solution.initial else steps_made(solution.events, k, solution.t[0], solution.h)
        )
    elif rows < len(solution.t):
        status, steps = "interrupted", None
    params = solution.params
    return replace(
        solution,
        **arrays,
        t=solution.t[:rows],
        initial={name: np.asarray(x)[k] for name, x in solution.initial.items()},
        params=params | {name: params[name][k] for name in solution.varied},
        varied=(),
        stats={} if steps is None else {"steps": steps},
        status=status,
        message=solution.endings.get(k, "") if failure is None else failure.message,
        events={name: points.of_member(k) for name, points in solution.events.items()},
        contacts={name: x.of_member(k, rows) for name, x in solution.contacts.items()},
        endings={},
        members=None,
        failures={},
    )


def steps_made(events: Mapping[str, Points], member: int, t0: float, h: float) -> int:
    """Return how many equal steps a member made until an event ended it, the last in part."""
    ends = np.concatenate(
        [points.t[points.states["member"] == member] for points in events.values()]
    )
    slack = ROUNDINGS * float(np.spacing(np.abs([t0, *ends]).max()))
    return math.ceil(float(np.max((ends - t0) / h)) - slack / abs(h))


def part_of(
    solution: Solution, time: slice | float | None, coordinate: Sequence[str] | str | None
) -> Solution:
    """Return a part of a solution; see :meth:`liouville.Solution.sel`."""
    found = solution if time is None else _between(solution, time)
    return found if coordinate is None else _of_coordinates(found, coordinate)


def _each(solution: Solution, cut: Callable[[Array], Array]) -> dict[str, Any]:
    """Cut all arrays with a row for each kept step."""
    found: dict[str, Any] = {
        group: {name: cut(x) for name, x in getattr(solution, group).items()} for group in GROUPS
    }
    given = solution.reactions
    found["tangents"] = _of_tangents(
        solution, lambda states: {name: cut(x) for name, x in states.items()}
    )
    return found | {"reactions": None if given is None else cut(given)}


def _of_tangents(
    solution: Solution, change: Callable[[dict[str, Array]], dict[str, Array]]
) -> dict[str, Tangent]:
    return {name: tangent.each(change) for name, tangent in solution.tangents.items()}


def _reached(arrays: dict[str, Any], rows: int) -> int:
    """Return how many rows a member has: those after its last step are NaN throughout."""
    there = np.zeros(rows, dtype=bool)
    for group in GROUPS:
        for x in arrays[group].values():
            there |= ~np.isnan(x.reshape(rows, -1)).all(axis=1) if x.size else False
    return int(np.max(np.flatnonzero(there), initial=-1)) + 1


def _between(solution: Solution, time: slice | float) -> Solution:
    t = solution.t
    if isinstance(time, int | float | np.number) and not isinstance(time, bool):
        time = slice(time, time)
    if not isinstance(time, slice):
        raise TypeError(
            hinted(
                f"time must be a slice of times, not {time!r}",
                "slice(0.0, 1.0) takes both ends along; solution(t) gives the states at any times",
            )
        )
    step = 1 if time.step is None else time.step
    if isinstance(step, bool) or not isinstance(step, int | np.integer) or step < 1:
        raise ValueError(
            f"the step of a slice of times must be a number of kept states, not {step!r}"
        )
    low, high = sorted(
        float(default if x is None else x)
        for x, default in ((time.start, t.min(initial=np.inf)), (time.stop, t.max(initial=-np.inf)))
    )
    # 0.3 is among the times of steps of 0.1, whatever rounding made of it
    slack = ROUNDINGS * float(np.spacing(np.abs(t).max(initial=0.0)))
    low, high = low - slack, high + slack
    inside = np.flatnonzero((low <= t) & (t <= high))
    if not inside.size:
        run = f"the run goes from {t[0]:g} to {t[-1]:g}" if t.size else "the run has no state"
        asked = f"t = {low:g}" if f"{low:g}" == f"{high:g}" else f"a time from {low:g} to {high:g}"
        sentence = f"no kept state is at {asked}: {run}"
        is_within = t.size and low <= t.max() and t.min() <= high
        hint = "solution(t) gives the states at any times of the run"
        hint = hint if solution.dense_order and is_within else ""
        if solution.path is not None:
            hint = "its records are in its folder: liouville.load reads them"
        raise ValueError(hinted(sentence, hint) if hint else sentence)
    rows = slice(int(inside[0]), int(inside[-1]) + 1, int(step))
    starts = {name: x[0] for name, x in solution.invariants.items()} | solution.initial
    events = {name: _met(points, low, high) for name, points in solution.events.items()}
    contacts = {name: x.between(rows, low, high) for name, x in solution.contacts.items()}
    return replace(
        solution,
        **_each(solution, lambda x: x[rows]),
        t=t[rows],
        initial=starts if rows.start else solution.initial,
        events=events,
        contacts=contacts,
        dense_order=solution.dense_order if step == 1 else 0,
    )


def _met(points: Points, low: float, high: float) -> Points:
    inside = (low <= points.t) & (points.t <= high)
    return Points(points.t[inside], {name: x[inside] for name, x in points.states.items()})


def _of_coordinates(solution: Solution, names: Sequence[str] | str) -> Solution:
    known = solution.names["coordinates"]
    names = [names] if isinstance(names, str) else names
    for name in names:
        check_name(name, known, "coordinate")
    places = [known.index(name) for name in names]
    others = {*NOT_OF_COORDINATES, *(("z",) if "unknowns" in solution.names else ())}

    def cut(states: dict[str, Array]) -> dict[str, Array]:
        return {
            name: x if name.removesuffix(AFTER) in others else _columns(x, places)
            for name, x in states.items()
        }

    given = solution.reactions
    return replace(
        solution,
        states=cut(solution.states),
        reactions=None if given is None else _columns(given, places),
        events={name: Points(x.t, cut(x.states)) for name, x in solution.events.items()},
        tangents=_of_tangents(solution, cut),
        names=solution.names | {"coordinates": tuple(names)},
        dense_order=0,
    )


def _columns(x: Array, places: Sequence[int]) -> Array:
    """Return some columns, a view where they follow one another."""
    first = places[0] if places else 0
    if list(places) == list(range(first, first + len(places))):
        return x[..., first : first + len(places)]
    return x[..., places]


def between(solution: Solution, system: Any, times: Array) -> dict[str, Array]:
    """Return the states at times in the order of the run; see ``Solution.__call__``."""
    # imported here: it runs the method, and few solutions are asked
    from liouville._runs.between import between

    if solution.choice is None:
        hint = "liouville.load(path, system=..., method=...) gives them back"
        sentence = "dense output needs system and method, which a loaded solution does not carry"
        raise ValueError(hinted(sentence, hint))
    own = {name: x for name, x in solution.states.items() if name not in ("a", "acceleration")}
    names = [*system.places, *(name for name in own if name not in system.places)]
    if not times.size:
        return {name: own[name][:0] for name in names}
    run = pieces(solution, system.states)
    # a method of the alpha family begins with the accelerations that it carries
    carried: dict[str, Any] = {}
    if "a" in solution.states:
        carried["a"] = dict(zip(solution.t, solution.states["a"], strict=True))
    parts = between(system, solution.choice, (run, carried), times, solution.params)
    found = {name: np.concatenate([x[name] for x in parts]) for name in names}
    _, here, kept = np.intersect1d(times, solution.t, return_indices=True)
    for name, values in found.items():
        values[here] = own[name][kept]
    return found


def between_changes(solution: Solution, system: Any, times: Array) -> dict[str, Array]:
    """Return the same of a run with contacts, from its stretches; at a change the later one."""
    runs = solution.stretches
    which = np.searchsorted([run.t[0] for run, _ in runs[1:]], times, side="right")
    names = [*system.places]
    parts: list[dict[str, Array]] = [{name: solution.states[name][:0] for name in names}]
    for k in np.unique(which):
        run, own = runs[k]
        states = run(times[which == k]).states
        parts.append({name: states[name] for name in names} | {"lam": states["lam"][:, own]})
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def pieces(solution: Solution, names: tuple[str, ...]) -> list[tuple[Array, ...]]:
    """Return t and states at the ends of all steps, a piece of a run between resets after another.

    A piece begins with the state after a reset and ends with the one before the next.
    """
    t, *states = solution.t, *(solution.states[name] for name in names)
    each = [(x.t, sides_of(x.states, names)) for x in solution.events.values()]
    hits = [(times, *sides) for times, sides in each if sides is not None]
    way = 1 if not t.size or t[0] <= t[-1] else -1
    times = np.concatenate([np.empty(0), *(x[0] for x in hits)])
    order = np.argsort(way * times, kind="stable")
    times = times[order]
    if not times.size:
        return [(t, *states)]
    before, after = (
        [np.concatenate(x)[order] for x in zip(*(hit[k] for hit in hits), strict=True)]
        for k in (1, 2)
    )
    found, row, begin = [], 0, [x[:0] for x in (t, *states)]
    for group in np.split(np.arange(times.size), np.flatnonzero(np.diff(times)) + 1):
        first, last = _outermost(group, before, after)
        cut = int(np.searchsorted(way * t, way * times[first]))
        end = [x[first : first + 1] for x in (times, *before)]
        found.append(_joined(begin, [x[row:cut] for x in (t, *states)], end))
        begin = [x[last : last + 1] for x in (times, *after)]
        row = cut + int(np.array_equal(t[cut : cut + 1], begin[0]))  # the record after it
    found.append(_joined(begin, [x[row:] for x in (t, *states)]))
    return found


def _joined(*parts: list[Array]) -> tuple[Array, ...]:
    return tuple(np.concatenate(x) for x in zip(*parts, strict=True))


def _outermost(group: Array, before: list[Array], after: list[Array]) -> tuple[int, int]:
    """Return the first and the last of resets at one time, each of which leads to the next."""
    if len(group) == 1:
        return int(group[0]), int(group[0])
    starts, ends = (np.concatenate([x[group] for x in side], axis=1) for side in (before, after))
    leads = (starts[:, None] == ends[None]).all(axis=2)  # the row from the column
    np.fill_diagonal(leads, False)
    first = group[~leads.any(axis=1)]
    last = group[~leads.any(axis=0)]
    return int(first[0] if first.size else group[0]), int(last[-1] if last.size else group[-1])


def reaction(solution: Solution, constraint: str | int | None) -> Array:
    """Return reaction forces; see :meth:`liouville.Solution.reaction`."""
    if solution.reactions is not None and solution.system is None and constraint is None:
        return solution.reactions
    lam, y = solution.lam, solution.y if "y" in solution.states else solution.q
    if constraint is not None:
        only = np.zeros_like(lam)
        k = _number_of(constraint, solution.names["constraints"])
        only[..., k] = lam[..., k]
        lam = only
    system = system_of(solution, "reaction forces need")
    if not len(solution.t):
        return np.zeros_like(y)
    z = solution.states[system.states[1]]
    if solution.members is None:
        found: Array = system.reaction(solution.t, y, lam, solution.params, z)
        return found
    shares = []
    for k in range(solution.members):
        params = solution.params | {name: solution.params[name][k] for name in solution.varied}
        shares.append(system.reaction(solution.t, y[:, k], lam[:, k], params, z[:, k]))
    return np.stack(shares, axis=1)


def system_of(solution: Solution, needs: str) -> Any:
    """Return the system; ValueError if there is none, or if coordinates were left out."""
    if solution.system is None:
        hint = "liouville.load(path, system=...) gives it back"
        raise ValueError(
            hinted(f"{needs} the system, which a loaded solution does not carry", hint)
        )
    if solution.names["coordinates"] != solution.system.coordinates:
        kept = ", ".join(solution.names["coordinates"])
        raise ValueError(hinted(f"{needs} all coordinates, not {kept}", "ask before .sel(...)"))
    return solution.system


def _number_of(constraint: Any, names: Sequence[str]) -> int:
    if isinstance(constraint, bool) or not isinstance(constraint, str | int | np.integer):
        hint = "reactions add up: solution.reaction(a) + solution.reaction(b)"
        raise TypeError(hinted(f"constraint must be a name or index, not {constraint!r}", hint))
    if isinstance(constraint, str):
        check_name(constraint, names, "constraint")
        return list(names).index(constraint)
    if not -len(names) <= constraint < len(names):
        raise ValueError(
            f"constraint must be below {len(names)}, the number of them, not {constraint}"
        )
    return int(constraint)


def at_times(solution: Solution, t: ArrayLike) -> Points:
    """Return the states at any times within a run; see :meth:`liouville.Solution.__call__`."""
    if solution.dense_order and solution.members is not None:
        sentence = "dense output is that of one member of an ensemble"
        raise ValueError(hinted(sentence, "solution.member(0)(t) is that of the first"))
    system = system_of(solution, "dense output needs") if solution.dense_order else None
    if not solution.dense_order or not isinstance(system, Mechanics | SemiExplicit):
        sentence = (
            "dense output needs the states of all steps of a mechanical or semi-explicit system"
        )
        hint = "integrate with every=1, states=True and without t_eval"
        if solution.contacts:
            hint += "; pickles and files of runs with contacts have none"
        if "psi" in solution.states:
            hint = "of a wave give the times of all states to keep in t="
        elif "x" in solution.states:
            hint = "of a field give the times of the states to keep in t_eval="
        raise ValueError(hinted(sentence, hint))
    times = times_within(t, solution.t[0], solution.t[-1])
    flat, way = times.ravel(), 1 if solution.t[0] <= solution.t[-1] else -1
    unique, back = np.unique(way * flat, return_inverse=True)
    find = between_changes if solution.stretches else between
    found = find(solution, system, way * unique)
    states = {name: x[back].reshape(*times.shape, *x.shape[1:]) for name, x in found.items()}
    return Points(flat if times.ndim else float(flat[0]), states)
