"""Pullbacks of ensembles: those of their members, which threads take in turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from threading import Event, Lock
from typing import TYPE_CHECKING

import numpy as np

from liouville._basics.errors import IntegrationError, hinted
from liouville._runs.adjoint import EVENTS, Adjoint, Gradients
from liouville._runs.execute import execute, finished
from liouville._runs.runner import Runner
from liouville._solution.solution import Solution

if TYPE_CHECKING:
    from liouville._runs.mechanics.adjoint import LockStep

#: A run of no more steps is followed back from its start: it needs no other checkpoint.
SHORT = 256


class MembersAdjoint(Adjoint):
    """The transposed derivative of the runs of an ensemble; see :class:`Adjoint`.

    Members are pulled back in lock-step where they run so and the model has no cases. Otherwise a
    member is run again by itself, with the same bits, so that checkpoints of no more members are
    kept than there are threads; unless the adjoints of members are of their runs in the ensemble,
    which have left what these need.
    """

    def __init__(
        self,
        runner: Runner,
        of_member: Callable[[int], Adjoint],
        threads: int,
        *,
        holds_runs: bool = False,
        has_times: bool = False,
        lock_step: Callable[[tuple[str, ...]], LockStep | None] | None = None,
    ) -> None:
        self.runner, self._of_member, self._threads = runner, of_member, threads
        self._holds_runs, self._has_times = holds_runs, has_times
        self._lock_step = lock_step
        self._first, (self._count,) = of_member(0), runner.members
        self.is_complex = self._first.is_complex
        each = self._first.directions.items()
        self.directions = {
            name: ((self._count, *shape), is_complex) for name, (shape, is_complex) in each
        }

    def shapes(self, solution: Solution) -> dict[str, tuple[int, ...]]:
        """Return the shapes of what has cotangents, by the names of the states."""
        return self._first.shapes(solution)

    def pulled(self, solution: Solution, cotangents: Mapping[str, np.ndarray]) -> Gradients:
        """Return gradients of each member, along their first axis; see :class:`Adjoint`."""
        stop, tracing = Event(), Lock()

        def pulled(member: int) -> Gradients:
            with tracing:  # CasADi does not trace in several threads
                adjoint = self._of_member(member)
            adjoint.refuses_kinks = self.refuses_kinks
            if adjoint.checkpoints is not None:
                adjoint.checkpoints.stop = stop
            return self._pulled(adjoint, solution, member, cotangents)

        together, size = None, 1
        if self._lock_step is not None and self._first.kinks is None:
            together = self._lock_step(self.wrt)
        if together is not None:
            size = min(together.most, -(-self._count // self._threads))

        def pulled_block(first: int) -> list[Gradients]:
            members, found = range(first, min(first + size, self._count)), None
            if together is not None and not stop.is_set():
                found = together.pulled(members, solution, cotangents)
            return [pulled(member) for member in members] if found is None else found

        # the first records tapes that all share
        found, others = pulled_block(0), range(size, self._count, size)
        if self._threads == 1:
            found += chain.from_iterable(map(pulled_block, others))
        else:
            pool = ThreadPoolExecutor(self._threads)
            try:
                found += chain.from_iterable(pool.map(pulled_block, others))
            finally:  # where one fails, and after Ctrl-C, the others end
                stop.set()
                if together is not None:
                    together.stop()
                pool.shutdown(cancel_futures=True)
        return {name: np.array([each[name] for each in found]) for name in self.wrt}

    def _pulled(
        self,
        adjoint: Adjoint,
        solution: Solution,
        member: int,
        cotangents: Mapping[str, np.ndarray],
    ) -> Gradients:
        steps, checkpoints = adjoint.runner.steps.count, adjoint.checkpoints
        # the run of a member that an event ended has fewer steps, and a last state there; between
        # steps cotangents add up piece by piece
        is_whole = member not in solution.endings and not self._has_times
        try:
            if self._holds_runs:
                own = solution.member(member)
            elif checkpoints is not None and is_whole and steps <= SHORT:
                own, run = solution.member(member), adjoint.runner.start()
                assert not isinstance(run, dict), "a member that has run"
                checkpoints.stride = steps
                checkpoints.take(run)
            else:
                own = finished(execute(adjoint.runner, checkpoints=checkpoints))
            if own.status != "done":
                raise IntegrationError(own.message, solution=own)
            return adjoint.pulled(own, part_of(solution, own, member, cotangents))
        except IntegrationError as error:
            sentence = f"member {member}: {error}"
            raise IntegrationError(
                sentence, t=error.t, step=error.step, quantity=error.quantity, member=member
            ) from error

    def moved(self, directions: Mapping[str, np.ndarray], size: float) -> Mapping[str, np.ndarray]:
        """Return the states of all runs, each moved by so much of its own directions."""

        def moved(member: int) -> Mapping[str, np.ndarray]:
            adjoint = self._of_member(member)
            if adjoint.holds_run and not self._holds_runs:
                finished(execute(adjoint.runner))
            return adjoint.moved({name: x[member] for name, x in directions.items()}, size)

        each = [moved(member) for member in range(self._count)]
        return {name: np.stack([states[name] for states in each], axis=1) for name in each[0]}


def part_of(
    solution: Solution, own: Solution, member: int, cotangents: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the cotangents of a member's own run, which may end before others."""
    found = {}
    for name, x in cotangents.items():
        if name.startswith(EVENTS):
            event = name.removeprefix(EVENTS).rpartition(".")[0]
            is_own = solution.events[event].states["member"] == member
            found[name] = np.ascontiguousarray(x[is_own])
            continue
        rows = np.zeros((len(own.t), *x.shape[2:]), dtype=x.dtype)
        there = len(solution.member(member).t)
        if x[there:, member].any():
            sentence = f"the run of member {member} is over at t = {own.t[-1]:g}"
            hint = f"cotangents of '{name}' are zero behind it, where its states are NaN"
            raise ValueError(hinted(sentence, hint))
        rows[:there] = x[:there, member]
        found[name] = rows
    return found
