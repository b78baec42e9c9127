"""Runs of an ensemble of trajectories on constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted, quoted
from liouville._basics.job import Job
from liouville._methods.control import Takes
from liouville._runs.mechanics.mechanical import MechanicalRunner
from liouville._runs.mechanics.semi_explicit import SemiExplicitRunner
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request, threads_of
from liouville._systems import members
from liouville._systems.mechanics.redundant import are_implied, first_dependent, redundant

if TYPE_CHECKING:
    from liouville._runs.adjoint import Adjoint
    from liouville._runs.mechanics.adjoint import LockStep
    from liouville._systems.derivatives.sensitivity import Cotangents


#: The restriction of members, for messages.
EQUAL = "members of an ensemble take equal steps"


class Members(TracedRunner):
    """The parts of a runner that differ for an ensemble.

    Attributes
    ----------
    alone : type
        The runner of a member by itself.
    """

    alone: type[TracedRunner]

    def __init__(self, system: Any, method: Any, request: Request) -> None:
        self.threads = threads_of(request.threads)
        super().__init__(system, method, request)

    def _job(self) -> Job:
        job = super()._job()
        job.params, job.threads, job.is_ensemble = self._rows, self.threads, True
        return job

    def adjoint(self, request: Request, wrt: Any) -> Adjoint:
        """Return the transposed derivatives of all runs by what `wrt` names, before they begin."""
        # imported here: few runs are differentiated
        from liouville._runs.members_adjoint import MembersAdjoint

        names = (*self.system.states, *self._extra_states)

        def of_member(member: int) -> Adjoint:
            start = zip(names, (x[member] for x in self._begin), strict=False)
            params = dict(request.params or {})
            params |= {name: np.asarray(params[name])[member] for name in self.varied}
            own = replace(
                request, start=dict(start), params=params, threads=None, is_ensemble=False,
                watched=self._watched,
            )  # fmt: skip
            return self.alone(self.system, self.choice, own).adjoint(own, wrt)

        has_times = self.times is not None
        return MembersAdjoint(
            self, of_member, self.threads, has_times=has_times, lock_step=self.lock_step
        )

    def lock_step(self, wrt: tuple[str, ...]) -> LockStep | None:
        """Return the pullbacks of members in lock-step, None where they do not run so."""
        return None

    @property
    def _each_values(self) -> np.ndarray:
        """The values of all parameters, a row for each member or one for all."""
        return np.atleast_2d(self._rows)

    def _controls_taken(self) -> Takes:
        return Takes(type(self.choice).__name__, hint=f"{EQUAL}: give h or steps")

    def _take(self, request: Request) -> None:
        system = self.system
        given = members.starts(system, request.start, self._extra_states)
        params, of_params = members.parameters(system, request.params)
        self.varied = tuple(of_params)
        counts = {name: len(x) for name, x in given.items() if x.ndim == 2}
        counts |= {f"parameter '{name}'": many for name, many in of_params.items()}
        if not counts:
            shapes = {name: f"({x.size},)" for name, x in given.items() if name in request.start}
            raise ValueError(
                hinted(
                    "no start value and no parameter has a row for each member: "
                    + ", ".join(f"{name} has shape {shape}" for name, shape in shapes.items()),
                    "give arrays of shape (P, n) for P members; lv.integrate takes one start",
                )
            )
        many = members.common(counts)
        self.members = (many,)
        rows = (np.broadcast_to(x, (many, x.shape[-1])) for x in given.values())
        self._begin = tuple(np.ascontiguousarray(x) for x in rows)
        self._rows = np.ascontiguousarray(params)
        self._values = self._rows[0]
        y, z = self._begin[:2]
        members.check(system, self.steps.t0, y, z, self._rows, hidden=self._is_hidden_kept)


class MembersRunner(Members, MechanicalRunner):
    """Runs many trajectories of a mechanical system; see :class:`Runner`."""

    alone = MechanicalRunner

    def lock_step(self, wrt: tuple[str, ...]) -> LockStep | None:
        """Return the pullbacks of members in lock-step, None where they do not run so."""
        if not isinstance(self._problem, _core.Mechanical) or self._watched or self._left_out:
            return None
        # imported here: few runs are differentiated
        from liouville._runs.mechanics.adjoint import LockStep

        own, _ = self.sensitivity()
        core = _core.members_pullback(self._problem, self.choice, self._job(), own)
        return None if core is None else LockStep(self, core, wrt)

    def values_of(self, member: int) -> np.ndarray:
        """Return the values of all parameters of a member."""
        each = self._each_values
        found: np.ndarray = each[member % len(each)]
        return found

    def pulled_member(self, member: int, found: Sequence[np.ndarray]) -> Cotangents:
        """Return cotangents of a member's start, from those of the one moved onto constraints."""
        # imported here: few runs are differentiated
        from liouville._systems.derivatives.sensitivity import pulled_start

        y, z = (x[member] for x in self._begin[:2])
        of_y, of_z, of_tau = found
        at = self.steps.t0, y, z, self.values_of(member)
        return pulled_start(self._stepped, *at, (of_y, of_z, of_tau))

    def _leave_out(self) -> None:
        """Take the system without what the other constraints imply, which is alike of all."""
        super()._leave_out()
        t, (y, z), left = self.steps.t0, self._begin[:2], self._left_out
        params = np.broadcast_to(self._rows, (len(y), self._rows.shape[-1]))
        points = (y, z, np.ascontiguousarray(params))
        if left:
            for member in range(1, len(y)):
                y_own, z_own, own = (x[member] for x in points)
                if not are_implied(self.system, t, y_own, z_own, own, left):
                    self._refuse_ranks(left, 0, member)
            return
        if self.system.nonholonomic and not self.varied:
            return
        k = first_dependent(self.system, t, y, points[2], 1)
        while k is not None:
            if found := redundant(self.system, t, *(x[k] for x in points)):
                self._refuse_ranks(found, k, 0)
            k = first_dependent(self.system, t, y, points[2], k + 1)

    def _refuse_ranks(self, left: tuple[int, ...], one: int, other: int) -> None:
        """Refuse members of which the constraints that follow from others are not the same."""
        names = quoted([self.constraints[k] for k in left])
        raise ValueError(
            hinted(
                f"the other constraints imply {names} of member {one}, but not just that of "
                f"member {other}",
                "run members with the same redundant constraints in an ensemble of theirs",
            )
        )


class SemiExplicitMembersRunner(Members, SemiExplicitRunner):
    """Runs many trajectories of a semi-explicit system; see :class:`Runner`."""

    alone = SemiExplicitRunner
