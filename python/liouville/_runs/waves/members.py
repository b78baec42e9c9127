"""Runs of an ensemble of wave functions whose equations differ by parameters or potentials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._basics.faults import Description
from liouville._methods import WaveMethod
from liouville._methods.control import Steps
from liouville._methods.planner import WavePlan
from liouville._runs.runner import Request, Runner, threads_of
from liouville._runs.waves.steps import POTENTIAL, potentials_of, start_of
from liouville._runs.waves.wave import WaveRunner
from liouville._solution.tangents import Tangent
from liouville._systems import Schrodinger, members

if TYPE_CHECKING:
    from liouville._runs.adjoint import Adjoint
    from liouville._solution.solution import Solution


class WaveMembersRunner(Runner):
    """Runs wave functions, each by an equation of its own; see :class:`Runner`.

    Each member is planned as a run alone is, and has its bits.
    """

    system: Schrodinger
    choice: WaveMethod

    def __init__(
        self, system: Schrodinger, method: WaveMethod | WavePlan, request: Request
    ) -> None:
        if isinstance(method, WavePlan):
            sentence = "a plan is that of one H, and parameters have a value for each member"
            raise TypeError(hinted(sentence, "give the method, and each member is planned"))
        self.system, self.choice = system, method
        self.threads = threads_of(request.threads)
        psi = start_of(request.start)
        of_params = members.parameters(system, request.params)[1]
        counts = {f"parameter '{name}'": many for name, many in of_params.items()}
        if system.is_many(psi):
            counts = {"psi": len(psi)} | counts
        system.inward(psi, "psi" in counts)  # what it refuses is that of no member alone
        potentials = potentials_of(request.start, system)
        if potentials is not None:
            counts[POTENTIAL] = len(potentials)
        many = members.common(counts)
        self.members, self.varied = (many,), tuple(of_params)
        given: Mapping[str, Any] = request.params or {}
        self.params = {**system.params, **given}
        self._each: list[WaveRunner] = []
        for k in range(many):
            values = {name: x[k] if name in of_params else x for name, x in given.items()}
            start = {"psi": psi[k] if "psi" in counts else psi}
            if potentials is not None:
                start[POTENTIAL] = potentials[k]
            own = replace(
                request, start=start, params=values, threads=1, is_ensemble=False,
                has_pullback=False,
            )  # fmt: skip
            try:
                self._each.append(WaveRunner(system, method, own))
            except ValueError as error:
                raise ValueError(f"member {k}: {error}") from None
        first = self._each[0]
        self.columns, self.widths = first.columns, first.widths
        schemes = {each.method for each in self._each}
        self.method = first.method if len(schemes) == 1 else repr(method)
        longest = max((each.steps for each in self._each), key=lambda steps: steps.count)
        self.steps = Steps(longest.t0, longest.t1, longest.count)
        self.every = max(each.every for each in self._each)
        self._check_records(request, len(first.plan.stops) + 1)
        if request.tangents is not None:
            first.check_room(many)

    def start(self) -> _core.Run | dict[str, Any]:
        """Start the run, or return the error of its start."""
        return _core.run_each([each.to_core() for each in self._each], self.threads)

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run: steps, products for each state, the bound of its error."""
        stats: dict[str, Any] = {}
        for each in self._each:
            stats |= each.stats(run)
        stats["products"] /= len(self._each)
        bounds = [each.plan.bound for each in self._each if each.plan.bound is not None]
        stats.pop("bound", None)
        return stats | ({"bound": max(bounds)} if len(bounds) == len(self._each) else {})

    def totals(self, rows: np.ndarray) -> dict[str, Any]:
        """Return the share of psi that was absorbed, of each member."""
        found = [each.totals(rows[:, k]) for k, each in enumerate(self._each)]
        return {"absorbed": np.array([x["absorbed"] for x in found])} if all(found) else {}

    @property
    def control_taken(self) -> str:
        """A sentence on bounds of the spectrum that were wrong."""
        return self._each[0].control_taken

    def read(self, parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Make complex what is complex, and give states and energies as the user has them."""
        return self._each[0].read(parts)

    def tangents(self, t: np.ndarray, parts: Mapping[str, np.ndarray]) -> dict[str, Tangent]:
        """Return tangents of the states kept, if any were wanted."""
        first = self._each[0]
        if not first.has_tangents or len(t) <= len(first.plan.stops):
            return {}
        runs = [(each, 0) for each in self._each]
        return first.tangents_of(runs, parts["psi"], self.threads)

    def check_tangents(self, request: Request, solution: Solution) -> None:
        """Refuse tangents of a member that a kink of its H(t) makes wrong."""
        # imported here: few runs have tangents
        from liouville._runs.kinks import check_drives

        check_drives(self._each, solution)

    def adjoint(self, request: Request, wrt: Any) -> Adjoint:
        """Return the transposed derivatives of all runs by what `wrt` names, before they begin."""
        # imported here: few runs are differentiated
        from liouville._runs.members_adjoint import MembersAdjoint

        many = len(self._each)
        try:
            own = [each.transposed(wrt, many) for each in self._each]
            return MembersAdjoint(self, own.__getitem__, self.threads, holds_runs=True)
        except MemoryError:  # of all at once
            for each in self._each:
                each.prepare_alone(wrt)

        def of_member(member: int) -> Adjoint:
            return self._each[member].adjoint_of(0, request, wrt)

        return MembersAdjoint(self, of_member, self.threads)

    def _described(self, error: dict[str, Any]) -> Description:
        found: Description = self._each[error.get("member", 0)].describe(error)
        return found
