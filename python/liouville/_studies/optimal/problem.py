"""An optimal control problem, checked, and what its nonlinear program gives."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import IntegrationError, OptimizationError, hinted
from liouville._methods import Spark
from liouville._runs.execute import finished
from liouville._runs.integrate import integrate
from liouville._solution.solution import Solution
from liouville._studies.optimal.arguments import (
    Array,
    Bounds,
    Controls,
    Free,
    Times,
    checked_method,
    mechanical,
    named_values,
)
from liouville._studies.optimal.final import Final, check_free, near_constraints
from liouville._studies.optimal.guess import path_of
from liouville._studies.optimal.nodal import Hamiltonian
from liouville._studies.optimal.path import PathConstraints
from liouville._studies.optimal.result import OptimalControl
from liouville._studies.optimal.transcription import Equations, Transcription
from liouville._systems.tracing import trace as _trace

#: IPOPT's words for a solution, and for the exception of CasADi's that Ctrl-C is there.
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
INTERRUPTED = "NonIpopt_Exception_Thrown"

#: Those for a limit that is exceeded, with the option that sets it.
EXCEEDED = {
    "Maximum_Iterations_Exceeded": "max_iter",
    "Maximum_CpuTime_Exceeded": "max_cpu_time",
    "Maximum_WallTime_Exceeded": "max_wall_time",
}

#: A final state may be off the one asked for by this part of its size.
REACHED = 1e-6

#: Equations that IPOPT leaves by less than this, in its units, hold.
HOLDS = 1e-8

#: So many steps at most are made again to see whether a run follows them.
MOST, TINY = 20, 1e-12


class Problem:
    """A checked request, with its nonlinear program."""

    def __init__(
        self, system: Any, method: Any, controls: Any, cost: Any, final_cost: Any, times: Times,
        final: Any, bounds: Any, path: Any, free: Any, params: Any, start: Mapping[str, Any],
    ) -> None:  # fmt: skip
        self.system, self.times = mechanical(system), times
        self.method: Spark = checked_method(self.system, method)
        self.controls = Controls.of(system, controls)
        self.params = np.array(system.values(params))
        self.start: tuple[Array, Array] = system.start(start)
        system.check(times.start, *self.start, self.params)
        self.reduced = system.stepped(times.start, *self.start, self.params)
        self.free = Free.of(system, self.controls, free)
        self.bounds = Bounds.of(system, self.controls, self.free.params, bounds)
        self.final = Final.of(system, self.controls, self.free.params, final)
        self.path = PathConstraints.of(system, self.controls, path)
        self._functions = {**self._costs(cost, final_cost), "path": self.path.rows}
        self.equations = self._equations(self.free.params)
        self._check_used()
        self._check_end()
        self.transcription = self._transcribed(self.bounds, self.path)

    def _transcribed(self, bounds: Bounds, path: PathConstraints | None) -> Transcription:
        return Transcription(
            self.reduced, self.method.stages, self.equations, self.times, self.final, self.params,
            bounds, path, self.free.states,
        )  # fmt: skip

    def _equations(self, free: Controls) -> Equations:
        return Equations(self.reduced, self.controls, self.params, self._functions, free)

    def _costs(self, cost: Any, final_cost: Any) -> dict[str, ca.SX]:
        given = {"cost": cost, "final_cost": final_cost}
        found = {
            name: _trace.scalar(name, function, self.system.symbols.args)
            for name, function in given.items()
            if function is not None
        }
        if not found:
            hint = "cost=lambda t, q, v, params: params.F**2 is the effort of a control"
            raise TypeError(hinted("optimal control needs cost or final_cost", hint))
        if "final_cost" in found:
            check_free("final_cost", found["final_cost"], self.system, self.controls)
        return found

    def _check_used(self) -> None:
        model = self.system.model
        places = [model.p, model.v, model.f, model.r, self.final.rows, *self._functions.values()]
        for name in self.free.params.names:
            own = getattr(self.system.symbols.params.namespace, name)
            if not any(ca.depends_on(x, own) for x in places):
                sentence = f"nothing depends on the free parameter '{name}'"
                raise ValueError(hinted(sentence, "leave it out, or use it in force or cost"))

    def _check_end(self) -> None:
        end = self.final.guess(*self.start)
        self.final.check(self.system, self.reduced, self.times.end, end, self.params)
        if self.times.limits is not None:
            self.final.check_times(self.system, self.times.limits, self.params)
        for place, values in enumerate(end):
            if place not in self.free.states:
                self.bounds.check(self.system, place, self.start[place], "at the start")
            if place in self.final.whole:
                self.bounds.check(self.system, place, values, "at the end")
        self.path.check_start(self.system, self.times.start, self.start, self.params, self.free)

    def solve(self, guess: Any, options: Mapping[str, Any]) -> OptimalControl:
        """Solve it from a guess."""
        self.options = options
        begun = perf_counter()
        transcription, program = self.transcription, self.transcription.program
        path = path_of(guess, self)
        if isinstance(guess, OptimalControl | Solution):
            given = named_values(self.system.symbols.params.defaults, self.params)
            given |= {x: guess.params[x] for x in self.free.params.names if x in guess.params}
            self.params[:] = self.system.values(given)
        limits = transcription.bounds(self.start)
        x0 = np.clip(transcription.guess(self.start, path), *limits)
        with np.errstate(all="ignore"):
            found, stats = program.solve(x0, limits, transcription.sizes(x0), options)
        if stats["return_status"] == INTERRUPTED:
            raise KeyboardInterrupt(f"interrupted after {stats['iter_count']} iterations")
        result = self._result(found, stats, perf_counter() - begun)
        if stats["return_status"] not in SOLVED:
            free = int(np.count_nonzero(limits[0] < limits[1]))
            raise self._error(found, stats, free, result)
        self._check_reached(result)
        self._check_leaps(result, found["x"][transcription.layout.V])
        return result

    def _result(
        self, found: dict[str, Array], stats: dict[str, Any], seconds: float
    ) -> OptimalControl:
        layout, program, system = self.transcription.layout, self.transcription.program, self.system
        x, steps = found["x"], self.times.steps
        end = float(x[layout.end[0]]) if layout.end.size else self.times.end
        h = (end - self.times.start) / steps
        t: Array = self.times.start + h * np.arange(steps + 1.0)
        self.params[self.free.params.places] = x[layout.params]
        y, z, u = x[layout.y], x[layout.z], x[layout.u]
        costates = self._costates(found)
        nodal, message = self._nodal(t, y, z, costates[1], u)
        repeated = self.final.repeated(self.reduced, end, (y[-1], z[-1]), self.params)
        if repeated is not None:
            message = f"{repeated} repeats others at the end found, where costates are not unique"
        lam = self._multipliers(t, y, z, nodal)
        states = system.states_at(t, np.hstack([y, z, lam]), self.params)
        table, names = self.transcription.table, self.controls.names
        every = system.symbols.params.defaults
        return OptimalControl(
            t=t,
            states=states,
            controls=self.controls.split(nodal),
            stage_t=t[:-1, None] + h * table["c"],
            stage_controls=self.controls.split(u),
            weights=table["b"].copy(),
            costates={
                system.states[0]: self._along(t, y, costates[0]),
                "p": costates[1],
            },
            cost=float(found["f"][0]),
            h=h,
            status=stats["return_status"],
            iterations=int(stats["iter_count"]),
            message=message,
            stats={
                "variables": program.size,
                "equations": program.equations,
                "violation": float(np.abs(found["g"]).max(initial=0.0)),
                "seconds": seconds,
            },
            method=repr(self.method),
            params={k: v for k, v in named_values(every, self.params).items() if k not in names},
            system=system,
            _how=(self.method, self.controls),
        )

    def _costates(self, found: dict[str, Array]) -> tuple[Array, Array]:
        """Return the costates of position and momentum at all nodes.

        They are multipliers of the updates of a step, with the opposite sign; at the start those of
        the first step's other rows are added, which the gradient of the whole has in it.
        """
        transcription, n, m = self.transcription, self.equations.n, self.equations.m
        program, layout = transcription.program, transcription.layout
        rows = program.rows_of(transcription.step, found["lam_g"])
        last = rows[:, -(2 * n + m) :]
        lam, pi = -last[:, :n], -last[:, n : 2 * n]
        own = 0 if self.equations.is_own_velocity else self.method.stages * n
        stages = rows[0, own : own + self.method.stages * n].reshape(-1, n)
        first = pi[0] - stages.sum(axis=0)
        slope = program.slope(found["x"], found["lam_g"])[layout.y[0]]
        s, model = self.reduced.symbols, self.reduced.model
        p_y = ca.Function("p_y", s.all, [ca.jacobian(model.p, s.y)])
        moved = np.array(ca.DM(p_y(self.times.start, *self.start, self.params)))
        return np.vstack([slope - moved.T @ first, lam]), np.vstack([first, pi])

    def _along(self, t: Array, y: Array, costate: Array) -> Array:
        """Return the part of costates of the position that is along the constraints."""
        s, model = self.reduced.symbols, self.reduced.model
        if not self.equations.m:
            return costate
        slopes = ca.Function("g_y", [s.t, s.y, s.params.vector], [ca.jacobian(model.g, s.y)])
        found = costate.copy()
        for k, (time, place) in enumerate(zip(t, y, strict=True)):
            g_y = np.array(ca.DM(slopes(time, place, self.params)))
            found[k] -= g_y.T @ np.linalg.lstsq(g_y.T, costate[k])[0]
        return found

    def _nodal(self, t: Array, y: Array, z: Array, pi: Array, stages: Array) -> tuple[Array, str]:
        """Return controls at nodes, and a remark on them."""
        c = self.transcription.table["c"]
        ends = np.linalg.solve(
            np.vander(c, increasing=True).T, np.vander([0.0, 1.0], c.size, True).T
        )
        start, end = np.einsum("ik,nij->knj", ends, stages)
        interpolated = np.vstack([start[:1], (end[:-1] + start[1:]) / 2, end[-1:]])
        bounds = self.bounds.controls
        interpolated = np.clip(interpolated, *bounds)
        if self.path.sees_controls.any():
            return interpolated, (
                "controls at nodes are interpolated between stages, where the path bounds them"
            )
        equations = self._equations(Controls.among(self.system, ()))  # with the parameters found
        found = Hamiltonian(equations).minimum((t, y, z, pi), interpolated, bounds)
        if found is not None:
            return found, ""
        return interpolated, (
            "controls at nodes are interpolated between stages: the Hamiltonian has no minimum in "
            "them that says more"
        )

    def _multipliers(self, t: Array, y: Array, z: Array, u: Array) -> Array:
        """Return the multipliers at nodes, from accelerations there; NaN where there are none."""
        params, rows = self.params.copy(), []
        for k in range(t.size):
            params[self.controls.places] = u[k]
            at = float(t[k]), np.ascontiguousarray(y[k]), np.ascontiguousarray(z[k])
            found = _core.multipliers(self.reduced.problem, params, *at)
            if isinstance(found, dict):
                rows.append(np.full(len(self.system.constraints), np.nan))
            else:
                rows.append(found)
        return np.array(rows).reshape(t.size, -1)

    def _check_reached(self, result: OptimalControl) -> None:
        for place, wanted in self.final.whole.items():
            name = self.system.states[place]
            off = np.abs(result.states[name][-1] - wanted)
            size = max(np.abs(wanted).max(), np.abs(result.states[name]).max())
            if off.max() > REACHED * size:
                k = int(np.argmax(off))
                sentence = (
                    f"the motion found ends with {name} of '{self.system.coordinates[k]}' "
                    f"{off[k]:.2g} off: it meets the constraints at another place"
                )
                hint = f"give more of the final state, or a guess that ends at this {name}"
                raise self._failed(hinted(sentence, hint), result)

    def _check_leaps(self, result: OptimalControl, V: Array) -> None:
        """Refuse a solution of the step equations that no run follows.

        Large steps have other solutions, where reactions throw the mechanism across a gap. They are
        looked for where velocities within a step are more than twice those at its ends, and made
        again by a run.
        """
        ends, inside = np.abs(result.states["v"]).max(axis=1), np.abs(V).max(axis=(1, 2))
        # where nothing moves, nothing leaps
        least = TINY * inside.max() or 1.0
        ratio = inside / (np.maximum(ends[:-1], ends[1:]) + least)
        first, second = self.system.states
        for k in np.argsort(-ratio)[:MOST].tolist():
            if not ratio[k] > 2:
                return
            start = {name: result.states[name][k] for name in (first, second)}
            t = float(result.t[k]), float(result.t[k + 1])
            try:
                run = integrate(
                    result.driven, self.method, t=t, steps=1, params=result.params, **start
                )
                finished(run)
                off = np.abs(run.states[first][-1] - result.states[first][k + 1]).max()
            except (IntegrationError, ValueError):
                off = np.inf
            if off > REACHED * max(np.abs(result.states[first]).max(), TINY):
                sentence = (
                    f"the motion found leaps in step {k}, at t = {t[0]:g}: its equations hold, and "
                    "no run follows them"
                )
                hint = "take more steps, a guess along a motion, or bounds that leave one"
                raise self._failed(hinted(sentence, hint), result)

    def _error(
        self,
        found: Mapping[str, Array],
        stats: Mapping[str, Any],
        free: int,
        result: OptimalControl,
    ) -> OptimizationError:
        """Return the error of a run of IPOPT with so many unknowns that found nothing."""
        g, program = found["g"], self.transcription.program
        row = int(np.argmax(np.abs(g))) if np.isfinite(g).all() else 0
        label, copy = program.label(row)
        step = "" if label.startswith("final") else f" in step {copy}"
        off = f"{label}{step} is {abs(g[row]):.1e} off"
        if holds := stats["off"] < HOLDS:
            off = "its equations hold, and its cost may not be the least"
        counted = f"IPOPT stopped after {result.iterations} iterations, {result.status}"
        match result.status:
            case "Infeasible_Problem_Detected" if free < (count := program.conditions):
                sentence = f"{free} unknowns of the steps cannot meet {count} conditions: {off}"
                hint = "take more steps, wider bounds or fewer final conditions"
            case "Infeasible_Problem_Detected":
                sentence = f"no motion meets all conditions near the last one: {off}"
                if broken := self._broken(found["x"]):
                    sentence += f"; without {broken}"
                hint = "allow more time, wider bounds or fewer final conditions, or give a guess"
            case status if status in EXCEEDED:
                sentence = f"no optimum is found yet: {off}"
                hint = (
                    "go on from guess=error.result, solve with fewer steps first and give that as "
                    f"the guess, or raise options={{'{EXCEEDED[status]}': ...}}"
                )
            case "Diverging_Iterates":
                sentence = "the cost falls without end"
                hint = "bound the controls, or make the cost rise with them"
            case "Not_Enough_Degrees_Of_Freedom":
                sentence = "there are more final conditions than the controls can meet"
                hint = "give fewer final conditions, or more steps"
            case "Invalid_Number_Detected":
                sentence = (
                    "a function of the model, the cost or the end is not finite where IPOPT looked"
                )
                hint = "look for a division by zero or a root, bound the states, or give a guess"
            case _ if flat := self._flat(result):
                sentence = f"no optimum is found: {flat} is met where its gradient vanishes"
                hint = "write it so that it changes its sign there, as x - 1 and not as its square"
            case _ if holds:
                sentence = f"no optimum is found: {off}"
                hint = "look for kinks and jumps of cost and model, or give a guess nearer to it"
            case _:
                sentence = f"no optimum is found: {off}"
                hint = "give a guess nearer to it, or bounds that keep away from singular positions"
        return self._failed(hinted(f"{sentence} ({counted})", hint), result)

    def _broken(self, guess: Array) -> str:
        """Name the limit that a motion needs to break, empty where none is found."""
        free = self.bounds.without(controls=False)
        trials: list[tuple[Bounds, PathConstraints | None, str]] = []
        if self.path.labels:
            trials.append((self.bounds, None, "limits"))
        trials += [(free, self.path, "bounds"), (free, None, "bounds")]
        trials += [(self.bounds.without(controls=True), None, "bounds")]
        for bounds, path, what in trials:
            transcription = self._transcribed(bounds, path)
            layout, limits = transcription.layout, transcription.bounds(self.start)
            sizes = transcription.sizes(guess)
            with np.errstate(all="ignore"):
                found, stats = transcription.program.solve(guess, limits, sizes, self.options)
            if stats["return_status"] in SOLVED:
                x = found["x"]
                z = np.vstack([x[layout.z], x[layout.Z].reshape(-1, self.equations.n)])
                u = x[layout.u].reshape(-1, self.controls.size)
                said = self.bounds.beyond(self.system, self.controls, (x[layout.y], z, u))
                if not said and self.path.labels:
                    said = self.path.beyond(self.transcription.along(x))
                return f"{what} {said}" if said else ""
        return ""

    def _flat(self, result: OptimalControl) -> str | None:
        """Name a condition of the end whose gradient is none where IPOPT stopped."""
        first, second = (result.states[name][-1] for name in self.system.states)
        near = near_constraints(
            self.system, self.times.end, self.final.guess(*self.start), self.params
        )
        return self.final.flat(self.system, float(result.t[-1]), (first, second), near, self.params)

    def _failed(self, message: str, result: OptimalControl) -> OptimizationError:
        return OptimizationError(
            message, status=result.status, iterations=result.iterations, result=result
        )
