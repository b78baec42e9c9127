"""Runs of a field, or of an ensemble of its states."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from hashlib import blake2b
from math import ceil, inf
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._basics.faults import Description, describe
from liouville._basics.job import Job
from liouville._methods import VolumeSplitting
from liouville._methods.control import TRIAL, Steps, Takes
from liouville._methods.planner import FieldPlan, plan_field
from liouville._methods.splitting import Split, described, to_core, variables_of
from liouville._runs.execute import execute, finished
from liouville._runs.fields.parts import check_affine, check_times, have_same_basis, split_by
from liouville._runs.fields.trial_steps import RECORDS, first_step, trial_steps
from liouville._runs.runner import Request, Runner, kept, threads_of
from liouville._runs.watch import Watch, initial_of
from liouville._solution.points import Points
from liouville._solution.tangents import Tangent
from liouville._systems import Field, PolynomialField, members

if TYPE_CHECKING:
    from liouville._runs.adjoint import Adjoint
    from liouville._runs.fields.hits import Hits

#: Equal steps alone keep volume.
TAKES = Takes(
    "VolumeSplitting",
    TRIAL,
    hint="give h, steps or rtol: with a step size that depends on the state, volume is not kept",
)

#: How many members make trial runs.
TRIED = 32


#: The prefix of directions that are parameters.
PARAMS = "params."


class FieldRunner(Runner):
    """Runs a field, or an ensemble of its states; see :class:`Runner`. This one is polynomial."""

    system: Field
    choice: FieldPlan

    def __init__(
        self, system: Field, method: VolumeSplitting | FieldPlan, request: Request
    ) -> None:
        self.base, self._given, self._is_atol_default = system, method, request.atol is None
        self.systems, x = self._with_params(system, request)
        if request.tangents is not None and not self.varied:
            self.systems = [self._changing(request.tangents)]
        self.system = system = self.systems[0]
        self.steps = request.steps_of(system, TAKES)
        for each in self.systems:
            if isinstance(each, PolynomialField):
                check_times(each, self.steps)
        if self.steps.control is not None:
            self.steps, method = self._tried(method, self.steps, np.atleast_2d(x))
        self.every = kept(self.steps, request.every)
        span = (self.steps.t0, self.steps.t1)
        self._watch = Watch(request.events, request.t_eval, span, self.every)
        self.members = x.shape[:-1]
        self.threads = threads_of(request.threads)
        self._states = request.states
        self._observer, self.widths = system.observer(request.observe, request.states)
        self.columns = {"x": x.shape[-1]} if request.states else {}
        self._directions = None
        if request.tangents is not None:
            # imported here: few runs have tangents
            from liouville._runs.fields.derivative import FieldDirections

            has_times = self._watch.times is not None
            self._directions = FieldDirections(
                system, request.tangents, self.steps, has_times=has_times
            )
            rows = self._directions.count + self.has_events
            self.widths = {**self.widths, "tangents": rows * x.shape[-1]}
        self.columns |= self.widths
        times = self._watch.times
        records = self.steps.records(self.every) if times is None else times.size
        self._check_records(request, records)
        self.x = system.extended(np.atleast_2d(x), self.steps.t0)
        h = self.steps.mean(self.steps.t1, self.steps.count)
        self.choice, self.split = self._planned(method, h)
        self._watched = self._watch.to_core(system, self.choice.method.order or 0, {})
        own = [self._own_plan(each, h) for each in self.systems] if self.varied else []
        self.plans, self.splits = [plan for plan, _ in own], [split for _, split in own]
        self.split = self.splits[0] if own else self.split
        self.method = repr(self.choice.method)
        #: Directions as the core takes them.
        self._moves = None if self._directions is None else self._directions.to_core(self)
        #: The derivatives of the functions of events, and the hits with theirs.
        self._slopes = {
            name: system.event_slopes(name, event)
            for name, event in (self._watch.events if self._directions else {}).items()
        }
        self.hits: dict[str, Hits] = {}
        #: The event that has ended the run, of an ensemble those of the members.
        self.endings: dict[int, str] = {}

    def _with_params(self, system: Field, request: Request) -> tuple[list[Field], np.ndarray]:
        """Return the field with its parameters, or with rows of them that of each member; and x."""
        of_params: dict[str, int] = {}
        if request.is_ensemble:
            rows, of_params = members.parameters(system, request.params)
        if not of_params:
            found = system.with_params(request.params)
            self.params = found.params
            return [found], system.start(request.start, request.is_ensemble)
        counts = {f"parameter '{name}'": many for name, many in of_params.items()}
        if members.are_given(system, request.start, None):
            x = system.start(request.start, members=True)
            members.common({"x": len(x)} | counts)
        else:
            x = np.tile(system.start(request.start), (members.common(counts), 1))
        if request.tangents is not None and any(x.startswith(PARAMS) for x in request.tangents):
            sentence = "members with parameters of their own have no tangents by parameters"
            raise ValueError(hinted(sentence, "integrate them one by one"))
        self.varied = tuple(of_params)
        self.params = {**system.params, **(request.params or {})}
        systems = []
        for member, row in enumerate(rows):
            try:
                systems.append(system.with_params(row))
            except ValueError as error:
                raise ValueError(f"member {member}: {error}") from None
        return systems, x

    def _changing(self, names: Any) -> Field:
        """Return the field with all terms and variables that these directions change."""
        # imported here: few runs are differentiated
        from liouville._runs.fields.derivative import differentiable

        is_named = isinstance(names, (list, tuple, Mapping)) and all(
            isinstance(x, str) for x in names
        )
        return differentiable(self.systems[0], names) if is_named else self.systems[0]

    def _own_plan(self, system: Field, h: float) -> tuple[FieldPlan, Split]:
        """Return the plan of all and the field of a member split by it, or its own."""
        assert isinstance(system, PolynomialField)
        plan, split = split_by(self.choice, system, h, self.x)
        if not have_same_basis(split, self.split):
            sentence = "members have other shears: a parameter that is 0 leaves terms out"
            raise ValueError(hinted(sentence, "take diagonal='exponentials', or run them apart"))
        check_affine(split, h)
        return plan, split

    def _planned(self, method: VolumeSplitting | FieldPlan, h: float) -> Any:
        """Return the plan for steps h, and the field split by it, of members that of most terms."""
        fields = [each for each in self.systems if isinstance(each, PolynomialField)]
        system = max(fields, key=lambda each: len(each.terms))
        if isinstance(method, FieldPlan) and self.varied:
            plan, parts = method, split_by(method, system, h, self.x)[1]
        elif isinstance(method, FieldPlan):
            plan, make = method, lambda: method.split(system.terms, system.variables)
            parts = system.kept(method, make)
        else:
            plan, parts = self._chosen(system, method, h)
        check_affine(parts, h)
        return plan, parts

    def _chosen(
        self, system: PolynomialField, method: VolumeSplitting, h: float
    ) -> tuple[FieldPlan, Split]:
        """Return the plan of a method, for steps h, and the field split by it."""
        # what leaves nothing open depends on neither step nor start
        count, start = self.steps.count, blake2b(self.x.tobytes()).digest()
        trial = (h, count, self.x.shape, start) if method.is_open else None
        plan, parts = system.kept(
            (method, trial),
            lambda: plan_field(system.terms, method, h, self.x, count, names=system.variables),
        )
        return replace(plan, h=h), parts

    def _tried(
        self, method: VolumeSplitting | FieldPlan, asked: Steps, x: np.ndarray
    ) -> tuple[Steps, VolumeSplitting | FieldPlan]:
        """Return equal steps that meet a tolerance, and the plan they were found with."""
        assert asked.control is not None, "steps for a tolerance"
        rows, x, t0 = x, x[:TRIED], asked.t0
        length = abs(asked.t1 - t0)
        kind, rtol, atol, h, least = asked.control
        if not h:
            h = first_step(lambda states: self._rates(states, t0), x, asked.t1 - t0)
        method, order, h = self._planned_once(method, float(np.copysign(h, asked.t1 - t0)), x, t0)
        asked = replace(asked, control=(kind, rtol, atol, abs(h), least))

        def run(steps: int) -> np.ndarray:
            request = Request(
                t=(t0, asked.t1), steps=steps, every=steps // RECORDS, start={"x": x},
                is_ensemble=True,
            )  # fmt: skip
            return np.asarray(finished(execute(type(self)(self.system, method, request))).x[1:])

        fewest = ceil(length / self._longest_step(method, rows, t0))
        return trial_steps(run, asked, order, fewest), method

    def _longest_step(self, plan: VolumeSplitting | FieldPlan, x: np.ndarray, t: float) -> float:
        """Return the longest step that can be made from states x, shape (P, n)."""
        del plan, x, t
        return inf

    def _rates(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the rates of states x, shape (P, n)."""
        assert isinstance(self.system, PolynomialField)
        rows = self.system.extended(x, t)
        rates = np.array([self.system.terms.evaluate(row) for row in rows], dtype=float)
        return rates[:, : x.shape[1]]

    def _planned_once(
        self, method: VolumeSplitting | FieldPlan, h: float, x: np.ndarray, t: float
    ) -> tuple[VolumeSplitting | FieldPlan, int, float]:
        """Return the plan for trial runs, its order, and the step that they begin with."""
        system = self.system
        assert isinstance(system, PolynomialField)
        if not isinstance(method, FieldPlan):
            states = system.extended(x, t)
            count = ceil(abs((self.steps.t1 - t) / h))
            method, _ = plan_field(system.terms, method, h, states, count, names=system.variables)
        order = method.method.order
        assert order is not None, "a plan leaves nothing open"
        return method, order, h

    @property
    def has_events(self) -> bool:
        """Whether events are looked for."""
        return bool(self._watch.events)

    @property
    def given_times(self) -> np.ndarray | None:
        """The times of the records, where they are given."""
        return self._watch.times

    @property
    def ending(self) -> str | None:
        """The event that has ended the run, None where it came to its end."""
        return self.endings.get(0)

    @property
    def record_times(self) -> np.ndarray:
        """The times of the records: the given ones, or those of kept steps."""
        steps = self.steps
        if self._watch.times is not None:
            return self._watch.times
        made = np.unique([*range(0, steps.count, self.every), steps.count])
        times = steps.t0 + made * steps.mean(steps.t1, steps.count)
        times[-1] = steps.t1
        return np.asarray(times)

    def remark_on(self, t: np.ndarray, x: np.ndarray) -> str:
        """Return sentences on starts and records that cannot be right; by default none."""
        del t, x
        return ""

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""
        return _core.run(to_core(self.split), self.choice.method, self.job)

    @property
    def job(self) -> Job:
        """The run as the core begins it."""
        steps, parts = self.steps, self.split
        return Job(
            start=(parts.inward(self.x),), span=(steps.t0, steps.t1, steps.count, self.every),
            watch=self._watched, varied=[to_core(split) for split in self.splits],
            observer=self._observer, params=self._each_values.ravel(), states=self._states,
            seen=(len(self.system.coordinates), parts.outward), threads=self.threads,
            is_ensemble=bool(self.members), tangents=self._moves,
        )  # fmt: skip

    @property
    def _each_values(self) -> np.ndarray:
        """The parameters, a row for each member where these have their own."""
        return np.array([system.values(None) for system in self.systems])

    def events(self, run: _core.Run) -> tuple[dict[str, Points], dict[int, str]]:
        """Return the events met, by name, and a sentence on each that ended a run, by member."""
        if not self._watch.events:
            return {}, {}
        params = self._each_values if self.members else self._each_values[0]
        more = self.widths.get("tangents", 0)
        found, said, rest = self._watch.events_of(run, self.system, params, more)
        names = [*self._watch.events]
        self.endings = {member: names[which] for which, _, _, member in run.events()[1]}
        if self._directions is not None:
            # imported here: few runs have tangents
            from liouville._runs.fields.hits import Hits

            h = self.steps.mean(self.steps.t1, self.steps.count)
            self.hits = {
                name: Hits.of(found[name], *own, self._slopes[name], self._each_values, h)
                for name, own in rest.items()
            }
        return found, said

    @property
    def initial(self) -> dict[str, Any]:
        """The invariants at the start, where no record is kept of it; see :class:`Solution`."""
        t0, times = self.steps.t0, self._watch.times
        if not self.system.invariants or times is None or times[0] == t0:
            return {}
        x = np.ascontiguousarray(self.x[:, : len(self.system.coordinates)])
        each, at = self._each_values, np.array([[t0]])
        rows = [
            self._observer.map(each[k % len(each)], [at, x[k : k + 1]])[0] for k in range(len(x))
        ]
        return initial_of(np.array(rows), self.widths, self.system.invariants, bool(self.members))

    def adjoint(self, request: Request, wrt: Any) -> Adjoint:
        """Return the transposed derivative of the run by what `wrt` names, before it begins."""
        # imported here: few runs are differentiated
        from liouville._runs.fields.derivative import FieldAdjoint
        from liouville._runs.members_adjoint import MembersAdjoint

        changing = self._changing(wrt) if not self.varied else self.system
        if changing is not self.system:
            return type(self)(changing, self._given, request).adjoint(request, wrt)
        if not self.members:
            return FieldAdjoint(self, request, wrt)
        has_times = self.has_events or self.given_times is not None
        first = FieldAdjoint(self._member(0), request, wrt)

        def of_member(member: int) -> Adjoint:
            if self.varied:
                return FieldAdjoint(self._member(member), request, wrt)
            return first.of(self._member(member))

        return MembersAdjoint(self, of_member, self.threads, has_times=has_times)

    def _member(self, member: int) -> FieldRunner:
        """Return the run of a member alone, split as they all are."""
        own = copy(self)
        own.members, own.varied, own.splits = (), (), []
        own.x = self.x[member : member + 1]
        if self.varied:
            own.choice = self.plans[member]
            own.systems = self.systems[member : member + 1]
            own.system, own.split = own.systems[0], self.splits[member]
            own.params = own.system.params
        return own

    def tangents(self, t: np.ndarray, parts: Mapping[str, np.ndarray]) -> dict[str, Tangent]:
        """Return the tangents in records by the names of their directions, if any were wanted."""
        if self._directions is None:
            return {}
        return self._directions.read(t, parts["tangents"], self)

    @property
    def control_taken(self) -> str:
        """A sentence on the steps, where a tolerance was given."""
        if self.steps.trial is None:
            return ""
        h, made = self.steps.mean(self.steps.t1, self.steps.count), self.steps.trial[1]
        return f"equal steps of {h:.4g} for rtol, from trial runs of {made} steps"

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run: steps, flows of pieces, and how many pieces there are."""
        steps, done = self.steps, run.done
        if self.members:  # those that all members have made
            done = round((run.t - steps.t0) / (steps.t1 - steps.t0) * steps.count)
        return {
            "steps": done,
            "flows": run.stats["evaluations"],
            "pieces": max(len(split.pieces) for split in self.splits or [self.split]),
        }

    def _described(self, error: dict[str, Any]) -> Description:
        if error.get("quantity") == "tangents":
            sentence = "the tangents have grown beyond the largest number"
            hint = "make the run shorter; lv.analysis.lyapunov makes them orthogonal on its way"
            return sentence, hint, "tangents"
        names = self.system.variables
        if error.get("quantity") == "event":
            error["quantity"] += f" {[*self._watch.events][error['index']]}"
        split = self.splits[error.get("member", error.get("of", 0))] if self.splits else self.split
        if error["kind"] == "step too large":  # of sections alone
            sentence = "more planes are crossed within it than a section takes"
            return sentence, f"try a longer period=, or h = {abs(error['solved']):.2g}", "plane"
        if error["kind"] == "singular piece":
            piece = split.pieces[error["piece"]]
            error["quantity"] = described(piece, variables_of(split, names))
        if error["kind"] == "singular function":
            functions = split.pieces[error["piece"]].field().compact().functions
            error["quantity"] = functions[error["function"]].written(names)
        outward = split.outward
        if error["kind"] == "overflow" and outward is not None:
            # the coordinate that has most of what is not finite
            error["index"] = int(np.abs(outward[:, error["index"]]).argmax())
        return describe(error, names, ())
