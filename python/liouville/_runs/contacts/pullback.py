"""Pullbacks of runs with contacts: of their stretches, joined by the transposed changes.

From the last stretch to the first, cotangents of its records and of its end become those of its
start, of the time of this and of the parameters. The end is that of the event that ended it, whose
time is that of the next start. What happens at once between two stretches is transposed by
differences, as :mod:`~liouville._runs.contacts.tangent` takes it forwards.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import IntegrationError, hinted, quoted
from liouville._basics.progress import Progress
from liouville._methods.control import CONTROLS, LEAST_TOLERANCE, Takes
from liouville._runs.adjoint import EVENTS, INVARIANTS, Adjoint, Gradients
from liouville._runs.contacts.complementarity import Array
from liouville._runs.contacts.joined import used
from liouville._runs.contacts.members import ensemble
from liouville._runs.contacts.run import Course
from liouville._runs.contacts.single import course
from liouville._runs.contacts.stretch import Penetrates
from liouville._runs.execute import finished
from liouville._runs.members_adjoint import part_of
from liouville._runs.tangents import ENDS, PARAMS, check_wrt, gradients_of, shapes_of
from liouville._solution.solution import Solution
from liouville._systems.mechanics.contact import Mode

if TYPE_CHECKING:
    from liouville._methods import Method
    from liouville._methods.control import Steps
    from liouville._methods.planner import Plan
    from liouville._runs.contacts.stretch import Part
    from liouville._runs.runner import Request
    from liouville._systems import Mechanics


def vjp(
    system: Mechanics, method: Method | Plan | str, request: Request, wrt: Any, progress: Progress
) -> tuple[Solution, Adjoint]:
    """Integrate a system with contacts, and return the transposed derivative of its run."""
    of_members: list[ContactsAdjoint] = []

    def make(system: Any, method: Any, request: Request, progress: Progress) -> Solution:
        of_members.append(ContactsAdjoint(system, method, request, wrt))
        return of_members[-1].run(progress)

    if not request.is_ensemble:
        return make(system, method, request, progress), of_members[0]
    solution = ensemble(system, method, request, progress, make)
    return solution, ContactsMembersAdjoint(of_members)


def check_inputs(system: Mechanics, wrt: Any, steps: Steps) -> tuple[str, ...]:
    """Return names of what gradients are by, where the steps have pullbacks."""
    if steps.control is not None:
        raise TypeError("pullbacks of runs with contacts want equal steps: give h or steps")
    names = check_wrt(system, wrt, steps)
    if any(name in ENDS for name in names):
        raise TypeError("pullbacks of runs with contacts go without 't0' and 't1'")
    return names


class ContactsAdjoint(Adjoint):
    """The transposed derivative of a run with contacts; see :class:`Adjoint`."""

    _course: Course

    def __init__(
        self, system: Mechanics, method: Method | Plan | str, request: Request, wrt: Any
    ) -> None:
        steps = request.steps_of(system, Takes(repr(method), CONTROLS, LEAST_TOLERANCE / 100))
        names = check_inputs(system, wrt, steps)
        self.directions = {x: (shape, False) for x, shape in shapes_of(system, names).items()}
        self._system, self._method, self._request = system, method, request

    def run(self, progress: Progress) -> Solution:
        """Make the run."""
        self._course = course(self._system, self._method, self._request, progress)
        return self._course.solution()

    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shapes of what has cotangents, by the names of the states."""
        names = [*self._system.states]
        parts = zip(self._course.links, self._parts(), strict=True)
        if all("lam" in link.adjoint.shapes(part.run) for link, (part, _) in parts):
            names.append("lam")
        found = {name: solution.states[name].shape for name in names}
        for name, x in solution.invariants.items():
            found[f"{INVARIANTS}{name}"] = x.shape
        for event, points in solution.events.items():
            found[f"{EVENTS}{event}.t"] = points.t.shape
            found |= {f"{EVENTS}{event}.{x}": points.states[x].shape for x in names}
        return found

    def pulled(self, solution: Solution, cotangents: Mapping[str, Array]) -> Gradients:
        """Return gradients from cotangents of all states; see :class:`Adjoint`."""
        own, (first, second) = self._course, self._system.states
        of_t, of_y, of_z = 0.0, *np.zeros((2, len(self._system.coordinates)))
        of_params = np.zeros(own.now.params.size)
        given = list(self._given(cotangents))
        for link, (part, _), of_records in zip(
            own.links[::-1], self._parts()[::-1], given[::-1], strict=True
        ):
            behind = 0.0, 0 * of_y, 0 * of_z
            if link.is_bit:  # the next stretch begins where the bit began
                behind = of_t, of_y, of_z
            elif link.ended is None:
                of_records[first][-1] += of_y
                of_records[second][-1] += of_z
            else:
                event = f"{EVENTS}{link.ended}."
                for what, x in (("t", of_t), (first, of_y), (second, of_z)):
                    of_records[event + what][-1] += x
            found = link.adjoint.pulled(part.run, of_records)
            of_t, of_y, of_z = (
                found[name] + x for name, x in zip(("t0", first, second), behind, strict=True)
            )
            names = [PARAMS + name for name in self._system.params]
            of_params += np.concatenate([np.zeros(0), *(np.ravel(found[x]) for x in names)])
            for jump in link.jumps[::-1]:
                moved = jump.pulled(of_t, of_y, of_z)
                of_t, of_y, of_z = moved[0][0], moved[1], moved[2]
                of_params += moved[3]
        start = of_y, of_z, np.append(of_t, of_params)
        return gradients_of(self._system, own.steps, start, 0.0, self.wrt)

    def _parts(self) -> list[tuple[Part, Array]]:
        """Return the runs that records are of, and which of their records were kept."""
        stretches, every = self._course.stretches, self._course.request.every
        last, found, uses = len(stretches) - 1, [], used(stretches)
        for k, x in enumerate(stretches):
            if x.given is None:
                own = np.arange(0, x.whole.count if k == last else uses[k], every)
                if k == last:
                    own = np.union1d(own, [x.whole.count - 1])
                found.append((x.whole, own))
                continue
            t = x.given.run.t[: x.given.count]
            if k < last:
                t = t[t < stretches[k + 1].whole.run.t[0]]
            found.append((x.given, np.arange(len(t))))
        return found

    def _given(self, cotangents: Mapping[str, Array]) -> Iterator[dict[str, Array]]:
        """Give the cotangents of one stretch after another, from those of the whole run."""
        place, met = 0, dict.fromkeys(self._course.events, 0)
        for link, (part, rows) in zip(self._course.links, self._parts(), strict=True):
            found = {name: np.zeros(x) for name, x in link.adjoint.shapes(part.run).items()}
            for name, x in cotangents.items():
                own = x[place : place + len(rows)]
                if not name.startswith(EVENTS):
                    _fill(found[name], rows, own, part.system.own if name == "lam" else None)
            place += len(rows)
            for event, points in part.run.events.items():
                if event not in met:
                    continue
                count = int(np.sum(points.t <= part.until))
                there = slice(met[event], met[event] + count)
                met[event] += count
                for name, x in cotangents.items():
                    if name.startswith(f"{EVENTS}{event}."):
                        which = part.system.own if name.endswith(".lam") else None
                        _fill(found[name], np.arange(count), x[there], which)
            yield found

    def moved(self, directions: Mapping[str, Array], size: float) -> Mapping[str, Array]:
        """Return the states of the run, moved by so much of all directions."""
        system, request = self._system, self._request
        values: dict[str, Any] = {**system.params, **(request.params or {})}
        start = dict(request.start)
        for name, x in directions.items():
            own, key = (values if name.startswith(PARAMS) else start), name.removeprefix(PARAMS)
            own[key] = np.asarray(own[key]) + size * x
        # a run without derivative has its steps elsewhere: it goes on behind hits
        again = replace(request, params=values, start=start)
        try:
            near = course(system, self._method, again, None)
            self._check_sides(near.first_modes, size)
            found = finished(near.solution())
        except Penetrates:
            self._check_sides(None, size)
            raise
        kept = sum(len(rows) for _, rows in self._parts())
        if len(found.t) != kept:
            sentence = f"a moved run has {len(found.t)} records and not {kept}"
            hint = "steps begin anew at changes of contacts, so give t_eval="
            raise ValueError(hinted(sentence, hint))
        return found.states

    def _check_sides(self, modes: tuple[Mode, ...] | None, size: float) -> None:
        """Refuse a moved run that leaves a contact at its start, or begins below it."""
        own, contacts = self._course.first_modes, self._course.contacts
        closed = [
            name
            for k, name in enumerate(contacts.names)
            if contacts.has_gap(k)
            and own[k] is not Mode.OPEN
            and (modes is None or modes[k] is Mode.OPEN)
        ]
        if not closed:
            return
        what = "begins below" if modes is None else "leaves"
        sentence = (
            f"a run that is moved by {abs(size):g} {what} contact {quoted(closed)}, which is "
            "closed at the start: the gradient is that of motions on it"
        )
        hint = "start above it, or give wrt= what does not move a start across it"
        raise ValueError(hinted(sentence, hint))


class ContactsMembersAdjoint(Adjoint):
    """The transposed derivatives of the runs of members, each in modes of its own."""

    def __init__(self, each: Sequence[ContactsAdjoint]) -> None:
        self._each = each
        own = each[0].directions.items()
        self.directions = {x: ((len(each), *shape), kind) for x, (shape, kind) in own}

    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shapes of what has cotangents in the runs of all members."""
        each = [adjoint.shapes(solution) for adjoint in self._each]
        return {x: shape for x, shape in each[0].items() if all(x in own for own in each)}

    def pulled(self, solution: Solution, cotangents: Mapping[str, Array]) -> Gradients:
        """Return gradients of each member, along their first axis; see :class:`Adjoint`."""
        found = []
        for k, adjoint in enumerate(self._each):
            own = solution.member(k)
            try:
                found.append(adjoint.pulled(own, part_of(solution, own, k, cotangents)))
            except IntegrationError as error:
                raise IntegrationError(f"member {k}: {error}", t=error.t, member=k) from error
        return {name: np.array([each[name] for each in found]) for name in self.wrt}

    def moved(self, directions: Mapping[str, Array], size: float) -> Mapping[str, Array]:
        """Return the states of all runs, each moved by so much of its own directions."""
        each = [
            adjoint.moved({name: x[k] for name, x in directions.items()}, size)
            for k, adjoint in enumerate(self._each)
        ]
        return {name: np.stack([own[name] for own in each], axis=1) for name in each[0]}


def _fill(into: Array, rows: Array, values: Array, columns: Array | None) -> None:
    """Put values at rows, and at these columns."""
    if columns is None:
        into[rows] = values
    else:
        into[np.ix_(rows, columns)] = values
