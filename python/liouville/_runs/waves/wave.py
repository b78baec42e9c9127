"""Runs of a Schrödinger equation, of one wave function or an ensemble of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics.arguments import check_memory, times_of
from liouville._basics.errors import hinted
from liouville._basics.faults import Description
from liouville._basics.job import Job
from liouville._methods import SplitOperator, Stepped, WaveMethod
from liouville._methods.control import Steps
from liouville._methods.planner import WavePlan, plan_run, plan_steps
from liouville._methods.planner.waves.choice import name_of
from liouville._methods.planner.waves.driven import Planned
from liouville._methods.planner.waves.levels import levels_of
from liouville._methods.planner.waves.propagators import Diagonal, Krylov, Series
from liouville._methods.planner.waves.resonance import resonance
from liouville._runs.runner import Request, Runner, threads_of
from liouville._runs.waves.failures import described
from liouville._runs.waves.steps import (
    POTENTIAL,
    check_no_steps,
    is_stepped,
    start_of,
    stops_of,
)
from liouville._solution.tangents import Tangent
from liouville._systems import Schrodinger

if TYPE_CHECKING:
    from liouville._runs.adjoint import Adjoint
    from liouville._runs.waves.derivative import WaveDerivative, WaveDirections
    from liouville._solution.solution import Solution

#: The memory that each propagator takes beside the records, in states, as measured.
STATES = {
    "shears": 2, "processed": 3, "chebyshev": 4, "magnus": 4, "magnus series": 5,
    "magnus steps": 12, "driven": 45, "split": 20, "split steps": 40,
    "diagonal": 4,
}  # fmt: skip

#: The memory of the two halves by which shears step a state of a complex H.
HALVES = 2

#: The memory of a window of several outputs beside these outputs: copies of terms.
OUTPUTS = 17


class WaveRunner(Runner):
    """Runs a Schrödinger equation; see :class:`Runner`."""

    system: Schrodinger
    choice: WaveMethod | WavePlan
    times: tuple[float, ...]
    _widened = 0
    nodes = np.empty(0)  # times at which a run that was differentiated took H

    def __init__(
        self, system: Schrodinger, method: WaveMethod | WavePlan, request: Request
    ) -> None:
        system = system.with_params(request.params)
        if (potential := request.start.get(POTENTIAL)) is not None:
            system = system.with_potential(potential)
        self.system = system
        self.params = system.params
        self.times = times = times_of(request.t)
        self.psi = system.inward(start_of(request.start), request.is_ensemble)
        self.members = self.psi.shape[:-1]
        self.threads = threads_of(request.threads)
        self._states = request.states
        # the core's forms of these are made again where a run is unpickled
        self._observe = system.portable(request.observe)
        self._observed = system.observables(self._observe)
        self.columns = {"psi": 2 * system.size} if request.states else {}
        # not by its values: members with parameters of their own have the same columns
        energy = "observed energy" if system.is_driven or system.may_absorb else "invariant energy"
        norm = "observed norm" if system.may_absorb else "invariant norm"
        self.columns |= {norm: 1, energy: 1, "observed autocorrelation": 2}
        if many := len(system.populations):
            kept = "observed" if system.mixes or system.may_absorb else "invariant"
            self.columns[f"{kept} populations"] = many
        for name, width, _ in self._observed:
            if f"observed {name}" in self.columns:
                sentence = f"'{name}' is recorded of every run of this equation"
                raise ValueError(hinted(sentence, "give the observable another name"))
            self.columns[f"observed {name}"] = width
        self.widths = self.columns
        # before a plan, as to plan many outputs takes long
        check = partial(self._check_records, request)
        self._stops: list[tuple[float, int]] | None = None
        if is_stepped(method, request):
            self._stops = stops_of(times, method, request, check)
        else:
            self.keep_less = "give fewer times in t=, or keep none with states=False"
            check(len(times))
        self.plan = self._planned(method, times, request)
        self._check_states()
        self._resonance = ""
        if system.nonlinearity is not None:
            self._resonance = resonance(system, self.plan, self.psi)
        self._records: list[_core.WaveRecord] = []
        self._derivatives: dict[int, WaveDerivative] = {}
        self._directions: WaveDirections | None = None
        if request.tangents is not None or request.has_pullback:
            self._differentiated(request)
        # given steps leave nothing to choose
        self.choice = method if self._stops is not None else self.plan
        self.method = self.plan.scheme
        self.steps = Steps(self.plan.t0, self.plan.stops[-1][0], self.plan.steps)
        self.every = -(-self.plan.steps // len(self.plan.stops))

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what the core has."""
        return {name: x for name, x in self.__dict__.items() if name != "_observed"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make it again."""
        self.__dict__.update(state)
        self._observed = self.system.observables(self._observe)

    def _planned(
        self, method: WaveMethod | WavePlan, times: tuple[float, ...], request: Request
    ) -> WavePlan:
        if isinstance(method, WavePlan):
            check_no_steps("a plan", request)
            method.check(times, self.system)
            return method
        if self._stops is not None:
            assert isinstance(method, Stepped)
            return plan_steps(self.system, method, times[0], self._stops)
        assert isinstance(method, Planned | SplitOperator)
        is_differentiated = request.tangents is not None or request.has_pullback
        plan = plan_run(self.system, method, times, self.psi, is_differentiated)
        check_no_steps(name_of(method), request)  # last: methods for H(t) do take steps
        return plan

    def _check_states(self) -> None:
        """Refuse a method whose states would not fit in memory."""
        core = self.plan.core
        count = core.dimension + 2 if isinstance(core, Krylov) else STATES[core.kind]
        count += self.system.size * isinstance(core, Diagonal)
        if self.plan.is_complex and core.kind in ("shears", "processed"):
            count += HALVES
        if isinstance(core, Series) and max(core.windows) > 1:
            count += OUTPUTS + max(core.windows)
        what = f"stepping a state of {self.system.size} components by {self.plan.scheme}"
        hint = "take SchrodingerSplitting(mode='stable'), which takes least, or a smaller dimension"
        check_memory(what, 16.0 * count * self.system.size, hint)

    def _differentiated(self, request: Request) -> None:
        """Have all runs leave what their derivatives need."""
        # imported here: few runs are differentiated
        from liouville._runs.waves import derivative as wave_derivative
        from liouville._runs.waves.windows import with_breaks

        self.plan = wave_derivative.followed(self.system, self.plan)
        runs = math.prod(self.members)
        if request.tangents is not None:
            self._directions = wave_derivative.WaveDirections(
                self.system, request.tangents, len(self.times)
            )
            names = wave_derivative.check_wrt(self.system, self._directions.names, len(self.times))
            self.plan = with_breaks(self.plan, self.system, names)
            self.check_room(runs)
            self._records = wave_derivative.records(self.system, self.plan, names, runs)

    @property
    def observed(self) -> dict[str, list[tuple[Any, ...]]]:
        """The parts that the core has of each observable that was asked for."""
        return {name: parts for name, _, parts in self._observed}

    @property
    def has_tangents(self) -> bool:
        """Whether tangents are wanted."""
        return self._directions is not None

    def check_room(self, runs: int) -> None:
        """Refuse so many runs like this with tangents if they leave more than fits in memory."""
        # imported here: few runs are differentiated
        from liouville._runs.waves.derivative import check_room
        from liouville._runs.waves.windows import of_potential

        own = self._directions
        assert own is not None, "a run with tangents"
        moved = own.count if of_potential(self.system, own.names) else 0
        check_room(self.plan, self.system.size, is_wanted=False, potentials=moved, runs=runs)

    def prepare(self, wrt: Any, runs: int = 1) -> tuple[str, ...]:
        """Plan a run that is to be differentiated by what `wrt` names; return the names.

        MemoryError if so many runs would leave more than fits in memory.
        """
        # imported here: few runs are differentiated
        from liouville._runs.waves import derivative as wave_derivative
        from liouville._runs.waves.windows import of_potential, with_breaks

        self.plan = wave_derivative.followed(self.system, self.plan)
        names = wave_derivative.check_wrt(self.system, wrt, len(self.times))
        self.plan = with_breaks(self.plan, self.system, names)
        potentials = bool(of_potential(self.system, names))
        is_wanted = set(names) != {"psi"}
        wave_derivative.check_room(
            self.plan, self.system.size, is_wanted=is_wanted, potentials=potentials, runs=runs
        )
        return names

    def transposed(self, wrt: Any, runs: int) -> Adjoint:
        """Return the transposed derivative of this run, one of so many, before it begins."""
        # imported here: few runs are differentiated
        from liouville._runs.waves.adjoint import WaveAdjoint
        from liouville._runs.waves.derivative import records

        names = self.prepare(wrt, runs)
        self._records = records(self.system, self.plan, names, 1)
        return WaveAdjoint(self, names)

    def adjoint(self, request: Request, wrt: Any) -> Adjoint:
        """Return the transposed derivative of the run by what `wrt` names, before it begins."""
        # imported here: few runs are differentiated
        from liouville._runs.members_adjoint import MembersAdjoint
        from liouville._runs.waves.adjoint import WaveAdjoint
        from liouville._runs.waves.derivative import records

        if not self.members:
            return self.transposed(wrt, 1)
        names = self.prepare(wrt)
        (many,) = self.members
        try:
            self.prepare(wrt, many)
        except MemoryError:  # of all at once

            def of_member(member: int) -> Adjoint:
                return self.adjoint_of(member, request, wrt)

            self._records = records(self.system, self.plan, names, many, is_closed=True)
            return MembersAdjoint(self, of_member, self.threads)
        self._records = records(self.system, self.plan, names, many)
        own = [WaveAdjoint(self, names, member) for member in range(many)]
        return MembersAdjoint(self, own.__getitem__, self.threads, holds_runs=True)

    def prepare_alone(self, wrt: Any) -> None:
        """Prepare the run as one that leaves nothing and is repeated alone."""
        # imported here: few runs are differentiated
        from liouville._runs.waves.derivative import records

        names = self.prepare(wrt)
        self._records = records(self.system, self.plan, names, 1, is_closed=True)

    def adjoint_of(self, member: int, request: Request, wrt: Any) -> Adjoint:
        """Return the transposed derivative of another run of a member, by itself."""
        start = {"psi": self.system.outward(np.atleast_2d(self.psi)[member])}
        own = replace(request, start=start, params=None, threads=1, is_ensemble=False)
        method = self.choice if self._stops is not None else self.plan
        return WaveRunner(self.system, method, own).adjoint(own, wrt)

    def derivative(self, names: Sequence[str], member: int = 0) -> WaveDerivative:
        """Return the derivative of a finished run by these names."""
        if member not in self._derivatives:
            threads = 1 if self.members else self.threads
            self._derivatives[member] = self._derivative_of(member, names, threads)
        return self._derivatives[member]

    def _derivative_of(self, member: int, names: Sequence[str], threads: int) -> WaveDerivative:
        # imported here: few runs are differentiated
        from liouville._runs.waves.derivative import WaveDerivative

        run, psi = (self._records[member], threads), np.atleast_2d(self.psi)[member]
        found = WaveDerivative(self.system, self.plan, psi, run, names, len(self.times))
        self.nodes = found.nodes
        return found

    def tangents(self, t: np.ndarray, parts: Mapping[str, np.ndarray]) -> dict[str, Tangent]:
        """Return tangents of the states kept, if any were wanted."""
        own = self._directions
        if own is None or len(t) <= len(self.plan.stops):
            return {}
        if self.members:
            runs = [(self, member) for member in range(self.members[0])]
            return self.tangents_of(runs, parts["psi"], self.threads)
        rows = self.derivative(own.names).followed(own.rows, parts["psi"])
        return own.read(rows.reshape(*rows.shape[:-2], -1))

    def check_tangents(self, request: Request, solution: Solution) -> None:
        """Refuse tangents of a run that a kink of H(t) makes wrong."""
        # imported here: few runs have tangents
        from liouville._runs.kinks import check_drives

        check_drives([self], solution)

    def tangents_of(
        self, runs: Sequence[tuple[WaveRunner, int]], psi: np.ndarray, threads: int
    ) -> dict[str, Tangent]:
        """Return tangents of members, each one of a runner, in the directions of this one."""
        own, count = self._directions, len(psi)
        assert own is not None, "a run with tangents"

        def followed(member: int) -> np.ndarray:
            if not np.isfinite(psi[-1, member]).all():  # it failed
                return np.full((count, own.count, self.system.size), np.nan, dtype=complex)
            runner, place = runs[member]
            derivative = runner._derivative_of(place, own.names, 1)
            return derivative.followed(own.rows, psi[:, member])

        # the first records tapes that all share
        found = [followed(0)]
        with ThreadPoolExecutor(threads) as pool:
            found += pool.map(followed, range(1, len(runs)))
        return own.read(np.stack(found, axis=1).reshape(count, len(runs), -1))

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""
        return _core.run(*self.to_core())

    def to_core(self) -> tuple[_core.Hamiltonian, object, Job]:
        """Return Hamiltonian, method and job for the core."""
        plan = self.plan
        observables: list[tuple[object, ...]] = [("symmetric", self.system.hamiltonian), ("start",)]
        observables += [("diagonal", each) for each in self.system.populations]
        observables += [each for _, _, parts in self._observed for each in parts]
        job = Job(
            start=(np.atleast_2d(self.psi),), span=(plan.t0, plan.stops), observer=observables,
            states=self._states, threads=self.threads, is_ensemble=bool(self.members),
            records=self._records,
        )  # fmt: skip
        core: object = plan.core
        if isinstance(core, Diagonal):
            core = replace(levels_of(self.system.settled), norm_tol=core.norm_tol)
        return plan.propagated(self.system), core, job

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run: steps, products for each state, the bound of its error."""
        members = int(np.prod(self.members))
        stats = {"steps": run.done, "products": run.stats["evaluations"] / 2 / members}
        if isinstance(self.plan.core, Series):
            self._widened = int(run.stats["cold_starts"])
            stats["widened"] = self._widened
        return stats if self.plan.bound is None else {**stats, "bound": self.plan.bound}

    def totals(self, rows: np.ndarray) -> dict[str, Any]:
        """Return the share of psi that was absorbed, of each member."""
        if not self.system.may_absorb or not len(rows):
            return {}
        norm = rows[..., 2 * self.system.size if self._states else 0]
        # an absorber that is zero takes nothing, and no other one less than that
        lost = 1 - (norm[-1] / norm[0]) ** 2
        share = np.fmax(0.0, lost) if self.system.absorber is not None else np.zeros_like(lost)
        return {"absorbed": share if self.members else float(share)}

    @property
    def control_taken(self) -> str:
        """A sentence on bounds of the spectrum that were wrong, or on steps in resonance."""
        if not self._widened:
            return self._resonance
        return (
            "an energy lies outside the bounds: a series was begun again with wider ones "
            f"{self._widened} time{'s' if self._widened > 1 else ''}"
        )

    def interrupted(self, done: int) -> str:
        """Return between which states that are kept a run was, if it goes from one to the next."""
        are_steps = self._stops is not None or self.plan.steps > len(self.plan.stops)
        if are_steps or done >= self.plan.steps:
            return super().interrupted(done)
        before, after = self.plan.times[done : done + 2]
        where = f"between t = {before:g} and {after:g}, where states are kept"
        return f"interrupted {where}: more times in t= keep more"

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Make complex what is complex, and give states and energies as the user has them."""
        paired = {"psi", "observed autocorrelation"}
        paired |= {f"observed {name}" for name, width, _ in self._observed if width == 2}
        found = {
            name: part.view(complex) if name in paired else part for name, part in parts.items()
        }
        if "psi" in found:
            found["psi"] = self.system.outward(found["psi"])
        for name in {"observed energy", "invariant energy"} & set(found):
            found[name] = self.system.hbar * found[name]
        return found

    def _described(self, error: dict[str, Any]) -> Description:
        h = self.steps.mean(self.steps.t1, self.steps.count)
        return described(error, self.system, self.plan.bounds, h)
