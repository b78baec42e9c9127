"""Ensembles with contacts: each member runs by itself, in modes of its own."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from liouville._basics.arguments import count
from liouville._basics.errors import IntegrationError, hinted
from liouville._basics.progress import Progress, reported
from liouville._methods.control import Takes
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.single import integrate
from liouville._runs.contacts.stretch import Penetrates
from liouville._runs.execute import plain
from liouville._runs.watch import given
from liouville._solution.contacts import COLUMNS, ContactRecord
from liouville._solution.failure import Failure, ending_of, summary_of
from liouville._solution.parts import GROUPS
from liouville._solution.points import Points
from liouville._systems import members

if TYPE_CHECKING:
    from liouville._methods import Method
    from liouville._methods.planner import Plan
    from liouville._runs.runner import Request
    from liouville._solution.solution import Solution
    from liouville._solution.states import Stats
    from liouville._solution.tangents import Tangent
    from liouville._systems import Mechanics


#: What makes the run of a member, as :func:`integrate` does.
Make = Callable[["Mechanics", "Method | Plan | str", "Request", Progress], "Solution"]


def ensemble(
    system: Mechanics,
    method: Method | Plan | str,
    request: Request,
    progress: Progress,
    make: Make = integrate,
) -> Solution:
    """Integrate members one after another, with records at the same times."""
    starts = members.starts(system, request.start)
    _, of_params = members.parameters(system, request.params)
    counts = {name: len(x) for name, x in starts.items() if x.ndim == 2}
    counts |= {f"parameter '{name}'": many for name, many in of_params.items()}
    if not counts:
        sentence = "no start value and no parameter has a row for each member"
        hint = "give arrays of shape (P, n) for P members; lv.integrate takes one start"
        raise ValueError(hinted(sentence, hint))
    many = members.common(counts)
    steps = request.steps_of(system, Takes(repr(method), hint="members take equal steps"))
    times = given(request.t_eval, (steps.t0, steps.t1), request.every)
    if times is None:
        each = count("every", request.every)
        numbers = np.append(np.arange(0, steps.count, each), steps.count)
        times = steps.t0 + numbers * ((steps.t1 - steps.t0) / steps.count)
        times[-1] = steps.t1
    runs: list[Solution | None] = []
    failures: dict[int, Failure] = {}
    with reported(progress, "members") as report:
        for k in range(many):
            start = {name: x[k] if x.ndim == 2 else x for name, x in starts.items()}
            own = {name: np.asarray(x)[k] for name, x in _varied(request, of_params).items()}
            params = dict(request.params or {}) | own
            more = replace(
                request, start=start, params=params, t_eval=times, every=1, is_ensemble=False
            )
            try:
                runs.append(make(system, method, more, None))
            except Penetrates as error:
                raise Penetrates(f"member {k}: {error}") from None
            except IntegrationError as error:
                runs.append(error.solution)
                made = 0 if error.solution is None else int(error.solution.stats["steps"])
                reached = steps.t0 if error.t is None else error.t
                failures[k] = Failure(made, reached, str(error))
            if runs[-1] is not None and runs[-1].status == "interrupted":
                break
            if report is not None:
                report(k + 1, many)
    return _joined(runs, times, many, failures, request, tuple(of_params))


def _varied(request: Request, of_params: Mapping[str, int]) -> dict[str, Any]:
    return {name: (request.params or {})[name] for name in of_params}


def _joined(
    runs: Sequence[Solution | None],
    times: Array,
    many: int,
    failures: dict[int, Failure],
    request: Request,
    varied: tuple[str, ...],
) -> Solution:
    """Return the members as an ensemble: what they did not come to is NaN."""
    shape, first = (len(times), many), next((run for run in runs if run is not None), None)
    if first is None:
        raise IntegrationError(summary_of(failures, many), t=failures[0].t, member=0)
    arrays: dict[str, Any] = {
        group: {
            name: _rows([None if x is None else getattr(x, group)[name] for x in runs], shape)
            for name in getattr(first, group)
        }
        for group in GROUPS
    }
    tangents = {name: _tangent(name, runs, shape) for name in first.tangents}
    contacts = {
        name: _record([None if x is None else x.contacts[name] for x in runs], shape)
        for name in first.contacts
    }
    ended = {
        k: run.message
        for k, run in enumerate(runs)
        if run is not None and run.status == "done" and len(run.t) < len(times)
    }
    is_cut = any(run is not None and run.status == "interrupted" for run in runs)
    initial = {}
    if request.t_eval is not None and first.initial:
        initial = {
            name: np.array([np.nan if run is None else run.initial[name] for run in runs])
            for name in first.initial
        }
    return replace(
        first,
        **arrays,
        t=times,
        initial=initial,
        tangents=tangents,
        contacts=contacts,
        events=_events(runs),
        stats=cast("Stats", _stats(runs)),
        params=plain(first.params | {name: (request.params or {})[name] for name in varied}),
        varied=varied,
        members=many,
        failures=failures,
        endings=ended,
        status="interrupted" if is_cut else ending_of(failures, many),
        message=f"interrupted after {len(runs) - 1} of {many} members"
        if is_cut
        else "; ".join(filter(None, [summary_of(failures, many), _remark(runs, ended)])),
    )


def _rows(parts: Sequence[Array | None], shape: tuple[int, int]) -> Array:
    """Return rows of members, one member after another along the second of these axes."""
    like = next(x for x in parts if x is not None)
    empty = None if like.dtype == object else np.nan
    found = np.full((*shape, *like.shape[1:]), empty, dtype=like.dtype)
    for k, x in enumerate(parts):
        if x is not None:
            found[: len(x), k] = x
    return found


def _tangent(name: str, runs: Sequence[Solution | None], shape: tuple[int, int]) -> Tangent:
    """Return the tangent of all members in a direction; of a run that failed there may be none."""
    own = [None if run is None else run.tangents.get(name) for run in runs]
    like = next(x for x in own if x is not None)
    states = {
        state: _rows([None if x is None else x.states[state] for x in own], shape)
        for state in like.states
    }
    return replace(like, states=states)


def _record(own: Sequence[ContactRecord | None], shape: tuple[int, int]) -> ContactRecord:
    """Return the record of a contact of all members."""
    changes = [() if record is None else record.changes for record in own]
    return ContactRecord(
        changes=(*changes, *[()] * (shape[1] - len(own))),
        **{
            what: _rows([None if x is None else getattr(x, what) for x in own], shape)
            for what in COLUMNS
        },
    )


def _remark(runs: Sequence[Solution | None], ended: Collection[int]) -> str:
    """Return the message of the first member that comes to the end with one."""
    said = [
        f"member {k}: {run.message}"
        for k, run in enumerate(runs)
        if run is not None and run.status == "done" and run.message and k not in ended
    ]
    more = f" (and {len(said) - 1} more members have messages)" if said[1:] else ""
    return f"{said[0]}{more}" if said else ""


def _events(runs: Sequence[Solution | None]) -> dict[str, Points]:
    """Return the events of one member after another."""
    there = [(k, run) for k, run in enumerate(runs) if run is not None]
    found = {}
    for name, points in there[0][1].events.items():
        states = {
            state: np.concatenate([run.events[name].states[state] for _, run in there])
            for state in points.states
        }
        which = [np.full(len(run.events[name].t), k, dtype=np.int64) for k, run in there]
        t = np.concatenate([run.events[name].t for _, run in there])
        found[name] = Points(t, states | {"member": np.concatenate(which)})
    return found


def _stats(runs: Sequence[Solution | None]) -> dict[str, Any]:
    """Return sums over members, of steps the most."""
    found: dict[str, Any] = {}
    for run in runs:
        for name, value in () if run is None else run.stats.items():
            old = found.get(name)
            if old is None or isinstance(value, str):
                found[name] = value
            else:
                found[name] = max(old, value) if name == "steps" else old + value
    return found
