"""Runs of a mechanical system."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted, quoted
from liouville._basics.faults import Description
from liouville._basics.job import AlphaTransposed, Job, WatchedSteps
from liouville._methods import Composition, LobattoPair, Method
from liouville._methods.control import Takes
from liouville._runs.edges import jump_near
from liouville._runs.mechanics.traced import TracedRunner
from liouville._runs.runner import Request
from liouville._solution.parts import AND
from liouville._solution.tangents import Tangent
from liouville._systems import Mechanical, Mechanics
from liouville._systems.mechanics import motion as _motion
from liouville._systems.mechanics.branches import branches
from liouville._systems.mechanics.redundant import sizes

if TYPE_CHECKING:
    from liouville._solution.solution import Solution
    from liouville._systems.derivatives.sensitivity import Cotangents

EPS = float(np.finfo(float).eps)

#: An absolute tolerance below so many units in the last digit of the largest coordinate is hard to
#: meet by those near zero.
FINE = 1e4

#: The method that is stepped as RATTLE.
RATTLE = LobattoPair(2)

#: The control of conservative systems by methods that are not symmetric.
REVERSIBLE = "reversible steps for rtol, as nothing changes the energy"

#: Solvers of the equations of a step, and where the core counts what they solved.
SOLVERS = {"newton": "newton_steps", "node-schur": "schur_steps"}

#: Errors of a step that has no solution, or none that is found.
UNSOLVED = ("not converged", "singular", "step too large")


class MechanicalRunner(TracedRunner):
    """Runs a mechanical system; see :class:`Runner`."""

    estimators = "Spark or HHT"

    system: Mechanics
    _left_out: tuple[int, ...] = ()

    def __init__(self, system: Mechanics, method: Method, request: Request) -> None:
        self._stepped = system
        self._is_general = method.form == "general"
        self._base = method.base if isinstance(method, Composition) else method
        super().__init__(system, method, request)
        self._leave_out()
        # a control given by name is not replaced
        by_rtol = self._control == "error" and request.control is None
        self._is_reversible = by_rtol and not self._is_general and system.is_conservative
        self._is_rattle = isinstance(self._problem, _core.Separable)
        self._set_directions(request)

    def _refuse_resets(self) -> None:
        """Refuse derivatives of what depends on the reactions of redundant constraints."""
        if not self._is_differentiated or self._watched is None:
            return
        events = zip(self._watch.events, self._watched[2], strict=False)
        for name, (*_, needs_lam, reset, _, _) in events:
            if needs_lam or reset is not None:
                sentence = f"event '{name}' has no derivatives, where some constraints imply others"
                hint = "leave redundant constraints out"
                raise ValueError(hinted(sentence, hint))

    def _leave_out(self) -> None:
        """Take the system without constraints that the others imply, if there are any."""
        y, z = (x if x.ndim == 1 else x[0] for x in self._begin[:2])
        point = self.steps.t0, y, z, self._values
        self._stepped = self.system.stepped(*point)
        if self._stepped is self.system:
            return
        self._refuse_resets()
        kept = self._stepped.constraints
        left = [k for k, name in enumerate(self.constraints) if name not in kept]
        self._left_out = tuple(left)
        self._problem = self._form()

    @property
    def _sizes_left_out(self) -> np.ndarray:
        """The sizes of what constraints left out are made of, a row for each member."""
        y, z, each = (np.atleast_2d(x) for x in (*self._begin[:2], self._each_values))
        each = np.broadcast_to(each, (len(y), each.shape[-1]))
        points = zip(y, z, map(np.ascontiguousarray, each), strict=True)
        left = [*self._left_out]
        return np.array([sizes(self.system, self.steps.t0, *point)[left] for point in points])

    def _watched_steps(self) -> WatchedSteps:
        """Return the watch of each step: energies, and constraints that are left out."""
        energy = left = None
        # damping adds to the energy on the way back
        is_ahead = self.steps.t0 < self.steps.t1
        is_damped = self.system.may_only_lose and is_ahead
        if self.system.is_conservative or is_damped:
            energy = _motion.energies(self.system), is_damped or not self._is_general
        if self._left_out:
            tape = _motion.rows_of(self.system, self._left_out)
            left = tape, [*self._left_out], self._sizes_left_out.ravel()
        return energy, left

    @property
    def _differentiated_system(self) -> Mechanics:
        return self._stepped

    def _job(self) -> Job:
        job = super()._job()
        if not self._parts:
            job.watched = self._watched_steps()
        job.is_reversible = self._is_reversible
        if self._directions is not None:
            # imported here: few runs have tangents
            from liouville._systems.derivatives.sensitivity import sensitivity

            own, (y, z) = self._directions, self._begin[:2]
            params = self._rows if self.members else self._values
            start = own.starts(self._stepped, self.steps.t0, y, z, params)
            dy, dz, tau = (np.ascontiguousarray(x) for x in (*start, own.tau))
            alpha = None
            if not self._is_general:
                from liouville._systems.derivatives.alpha_slopes import alpha_slopes

                alpha = alpha_slopes(self._stepped, self.choice)
            job.tangents = (sensitivity(self._stepped), dy, dz, tau, own.stretch, alpha)
        return job

    def tangents(self, t: np.ndarray, parts: Mapping[str, np.ndarray]) -> dict[str, Tangent]:
        """Return the tangents in records by the names of their directions, if any were wanted."""
        if self._directions is None:
            return {}
        own, rows, states = self._directions, parts["tangents"], self.system.states
        n, m = len(self.system.coordinates), len(self.constraints)
        if self.shares_multipliers:
            params = self._rows if self.members else self._values
            motion = (t, parts[states[0]], parts[states[1]], parts["lam"])
            assert own.moves is not None, "directions of a run"
            dt, ended_by = own.moves.of_times(t), self._watch.ended_by
            if self.times is None and not self.members and ended_by:
                sides, _ = self._moved_events[ended_by[0]]
                dt[-1] = sides[-1, 0].reshape(own.count, -1)[:, 0]
            rows = own.shared(self._stepped, motion, params, rows, dt)
        return own.read(states, rows, (n, n, m), self._moved_events)

    @property
    def shares_multipliers(self) -> bool:
        """Whether multipliers of redundant constraints are differentiated."""
        # imported here: few runs are differentiated
        from liouville._systems.derivatives.multipliers import are_shared

        return bool(self._left_out) and are_shared(self._stepped)

    def pulled_multipliers(
        self, solution: Solution, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Return cotangents of (y, z, lam) with the multipliers of a step, of tau and of stretch.

        `rows` have all multipliers, where some constraints imply others. The last is that of the
        last time where an event has ended the run.
        """
        from liouville._solution.chain_rule import ended
        from liouville._systems.derivatives.multipliers import SharedMultipliers

        n, (first, second) = len(self.system.coordinates), self.system.states
        found, stretch, last = np.zeros((len(rows), 2 * n + self.multipliers)), 0.0, 0.0
        tau = np.zeros(1 + self._values.size)
        found[:, : 2 * n] = rows[:, : 2 * n]
        for k in np.flatnonzero(rows[:, 2 * n :].any(axis=1)):
            at = float(solution.t[k]), solution.states[first][k], solution.states[second][k]
            shared = SharedMultipliers(self._stepped, at, solution.states["lam"][k], self._values)
            of_point, found[k, 2 * n :] = shared.pulled(rows[k, 2 * n :])
            found[k, : 2 * n] += of_point[1 : 1 + 2 * n]
            of_time = of_point[0] if self.times is None else 0.0
            if of_time and k == len(rows) - 1 and ended(solution):
                last, of_time = float(of_time), 0.0
            tau += np.append(of_time, of_point[1 + 2 * n :])
            stretch += of_time * (at[0] - self.steps.t0)
        return found, tau, stretch, last

    def sensitivity(self) -> tuple[_core.Sensitivity, AlphaTransposed | None]:
        """Return derivatives by time and parameters, and those of a step of the alpha family."""
        # imported here: few runs are differentiated
        from liouville._systems.derivatives.alpha_slopes import alpha_transposed
        from liouville._systems.derivatives.sensitivity import sensitivity

        alpha = None if self._is_general else alpha_transposed(self._stepped, self.choice)
        return sensitivity(self._stepped), alpha

    def pulled_start(self, found: Cotangents) -> Cotangents:
        """Return cotangents of a start that is moved onto the constraints, from those there."""
        # imported here: few runs are differentiated
        from liouville._systems.derivatives.sensitivity import pulled_start

        y, z = self._begin[:2]
        return pulled_start(self._stepped, self.steps.t0, y, z, self._values, found)

    @property
    def multipliers(self) -> int:
        """How many multipliers the equations of a step have."""
        return len(self._stepped.constraints)

    @property
    def control_taken(self) -> str:
        """A sentence on the steps, where a tolerance is met by reversible ones."""
        return REVERSIBLE if self._is_reversible else ""

    def _controls_taken(self) -> Takes:
        if not self._is_general:
            return Takes(type(self.choice).__name__, ("error",))
        return super()._controls_taken()

    @property
    def _sees_switches(self) -> bool:
        # the alpha family takes reversible steps where nothing changes the energy
        return super()._sees_switches and (self._is_general or not self.system.is_conservative)

    @property
    def _extra_states(self) -> tuple[str, ...]:
        return () if self._is_general else ("a",)

    @property
    def _is_hidden_kept(self) -> bool:
        """Whether the start satisfies the hidden constraints.

        A method that goes on with its own accelerations may have left them by itself.
        """
        goes_on = len(self._begin) == 3 and getattr(self.choice, "reaction", "") == "position"
        return not goes_on

    def _form(self) -> _core.Mechanical | _core.SecondOrder | _core.Separable:
        """Return the system in the form that the method steps fastest."""
        if not self._is_general:
            return self._stepped.second_order
        self._check_solver()
        takes_fast_path = self._base == RATTLE and self._control != "error"
        takes_fast_path = takes_fast_path and not self._is_differentiated
        fast = self._stepped.separable if takes_fast_path else None
        return self._stepped.problem if fast is None else fast

    def stats(self, run: _core.Run) -> dict[str, Any]:
        """Return the numbers of a run that this method has."""
        stats = super().stats(run)
        if run.done and self._is_general:
            stats["solver"] = "rattle" if self._is_rattle else _solver(run.stats)
        return stats

    def _unused_stats(self) -> set[str]:
        if not self._is_general:
            return {"newton_steps", "schur_steps"}
        return super()._unused_stats() | {"newton_steps" if self._is_rattle else "factorizations"}

    def balance(self, parts: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return where the energy went, if forces with a potential are separate from others."""
        if "work" not in parts or isinstance(self.system, Mechanical):
            return {}
        energy, work = (parts[name][..., 0] for name in ("invariant energy", "work"))
        start = self.initial.get("energy", energy[:1])
        return {"work": work, "dissipated": start + work - energy}

    def add_cause(self, error: dict[str, Any], run: _core.Run) -> None:
        """Name constraints nearly dependent, jumps near a step that fails, or a fine tolerance."""
        control = self.steps.control
        if error["kind"] == "step too small" and control and control[0] == "error":
            atol = float(control[2][0])
            largest = np.abs(self._begin[0]).max(initial=0.0)
            if self._is_atol_default and atol < FINE * EPS * largest:
                error["atol"] = atol
        if error["kind"] not in (*UNSOLVED, "step too small") or (place := run.place()) is None:
            return
        n, params = len(self.system.coordinates), self.system.values(self.params)
        w, rates = self._point(run.t, place)
        move = self._last_step(run) * rates
        if error["kind"] in UNSOLVED:
            # where the last step began, and where it leads
            for at in (w, w + move):
                if names := self._stepped.nearly_dependent(at[0], at[1 : 1 + n], params):
                    error["dependent"] = names
                    break
        found = branches(self.system)
        if found is not None and (name := jump_near(found, w, move)):
            error["jump"] = name

    def _last_step(self, run: _core.Run) -> float:
        """Return the size of the step that failed, or was about to, by which coordinates move."""
        if self.steps.control is None:
            return float(self.steps.mean(self.steps.t1, self.steps.count))
        return 8 * float(run.stats.get("h_next", 0.0))

    def _described(self, error: dict[str, Any]) -> Description:
        own = self.system if error.get("part") is not None else self._stepped
        sentence, hint, quantity = self._described_by(own, error)
        node_schur = getattr(self._base, "solver", "") == "node-schur"
        if error["kind"] == "not converged" and node_schur and "jump" not in error:
            hint += ", or solver='auto', which takes stiff forces too"
        return sentence, hint, quantity

    def _own_columns(self) -> dict[str, int]:
        own, n = super()._own_columns(), len(self.system.coordinates)
        if not self._is_general:
            own |= {"acceleration": n, "a": n} if self._states else {}
            own["work"] = 1
        return own

    def _check_solver(self) -> None:
        if self.system.nonholonomic and getattr(self._base, "solver", "") == "node-schur":
            raise ValueError(
                hinted(
                    "node Schur finds multipliers of holonomic constraints, and the system has "
                    f"nonholonomic ones: {quoted(self.system.nonholonomic)}",
                    "take solver='auto', which solves for everything together",
                )
            )


def _solver(stats: Mapping[str, float]) -> str:
    """Return the solvers of the step equations, for an ensemble those of all members."""
    return AND.join(name for name, count in SOLVERS.items() if stats[count])
