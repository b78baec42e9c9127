"""Runs of each family of systems as functions of arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from liouville._basics.arguments import count
from liouville._basics.errors import hinted
from liouville._bridges.run import Array, RunFunction, Runnable, RunPoint
from liouville._methods import Method
from liouville._methods.control import Takes
from liouville._runs.choice import check_system, runner_of
from liouville._runs.mechanics.traced import takes_of
from liouville._runs.runner import Request
from liouville._runs.tangents import (
    PARAMS,
    Constrained,
    check_names,
    check_wrt,
    places_of,
    shapes_of,
)
from liouville._systems import Field, Mechanics, Schrodinger, SemiExplicit
from liouville._systems.derivatives import semi_explicit as _semi_explicit_sensitivity
from liouville._systems.derivatives import sensitivity as _sensitivity

#: Where redundant constraints are dependent on one another.
ON_CONSTRAINTS = (
    "some constraints imply others, and derivatives are then taken at starts on all of them: make "
    "q and v of variables along them, such as an angle and its rate"
)


def run_function(
    system: Any, method: Method | str, wrt: Any, returns: Any, request: Request
) -> RunFunction:
    """Return a run as a function.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong, or what is asked for has no pullback.
    """
    check_system(system)
    kind = next(kind for family, kind in FAMILIES.items() if isinstance(system, family))
    returns = system.states[0] if returns is None else returns
    return kind(system, method, wrt, returns, request)


class SteppedFunction(RunFunction):
    """A run with steps; see :class:`RunFunction`."""

    def _steps_of(self, request: Request, takes: Takes) -> None:
        steps = request.steps_of(self.system, takes)
        self._ends, self._asked = {"t0": steps.t0, "t1": steps.t1}, steps
        given = {"t_eval": request.t_eval, "events": request.events, "atol": request.atol}
        given |= {"rtol": request.rtol, "control": request.control}
        self._how = {name: value for name, value in given.items() if value is not None}
        if request.t_eval is not None:
            self._rows = np.size(request.t_eval)
        elif steps.control is None:
            self._how["every"] = every = count("every", request.every)
            self._rows = -(-steps.count // every) + 1
        else:
            sentence = "controlled steps are as many as a run needs, and an array has one shape"
            raise ValueError(hinted(sentence, "give t_eval=, the times whose states are returned"))
        if steps.control is None:
            self._how["steps"] = steps.count
        for name, event in (request.events or {}).items():
            if getattr(event, "terminal", False):
                sentence = f"event '{name}' ends the run, and an array has one shape"
                raise ValueError(hinted(sentence, "leave terminal out"))

    def _arguments(self, inputs: Sequence[Array]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return all of a run but its start, and its start, with these inputs."""
        ends, params, start, _ = self.parted(inputs)
        ends = {**self._ends, **ends}
        return {"t": (ends["t0"], ends["t1"]), "params": params, **self._how}, start

    def takes_members(self, varied: set[str]) -> bool:
        """Whether runs that differ in these inputs are those of an ensemble."""
        is_equal = self._asked.control is None
        return not varied or (is_equal and not varied & {"t0", "t1"})


class FieldFunction(SteppedFunction):
    """A run of a field; see :class:`RunFunction`."""

    def _named(self, wrt: Any, request: Request) -> dict[str, tuple[int, ...]]:
        self._steps_of(request, Takes(type(self.method).__name__))
        places = places_of(self.system)
        return {name: places[name][1] for name in check_names(wrt, places, "x")}

    def _known(self, request: Request) -> dict[str, tuple[int, ...]]:
        return {"x": (self._rows, len(self.system.coordinates))}

    def _fixed_start(self, start: Mapping[str, Any]) -> dict[str, Array]:
        if "x" in self.inputs and not start:
            return {}
        return {"x": self.system.start(start)}

    def point(self, inputs: list[Array]) -> RunPoint:
        """Return the run with these inputs; some may have a row for each member."""
        run, start = self._arguments(inputs)
        own, n = self.system.params, len(self.system.coordinates)
        for name, value in run["params"].items():
            if np.ndim(value) > np.ndim(own[name]):
                start["x"] = np.broadcast_to(start["x"], (len(value), n))
        return RunPoint(self, inputs, self.system, run, start)


class ConstrainedFunction(SteppedFunction):
    """A run on constraints; see :class:`RunFunction`."""

    def _named(self, wrt: Any, request: Request) -> dict[str, tuple[int, ...]]:
        self._steps_of(request, takes_of(self.method, "Spark or HHT"))
        return shapes_of(self.system, check_wrt(self.system, wrt, self._asked))

    def point(self, inputs: list[Array]) -> RunPoint:
        """Return the run with these inputs; some may have a row for each member."""
        return ConstrainedPoint(self, inputs, *self._arguments(inputs))


class SemiExplicitFunction(ConstrainedFunction):
    """A run of a semi-explicit system; see :class:`RunFunction`."""

    def _known(self, request: Request) -> dict[str, tuple[int, ...]]:
        rows, system = self._rows, self.system
        return {"y": (rows, len(system.coordinates)), "z": (rows, len(system.unknowns))}

    def _fixed_start(self, start: Mapping[str, Any]) -> dict[str, Array]:
        free = {name: np.zeros(self.inputs[name]) for name in ("y",) if name in self.inputs}
        y, z = self.system.start({**start, **free})
        return {"z": z} if free else {"y": y, "z": z}


class MechanicalFunction(ConstrainedFunction):
    """A run of a mechanical system; see :class:`RunFunction`.

    Of one with contacts the states returned are at the ends of the equal steps: a run keeps those
    at changes besides, as many as there are.
    """

    def _named(self, wrt: Any, request: Request) -> dict[str, tuple[int, ...]]:
        if self.system.contacts is not None:
            # imported here: few systems have contacts
            from liouville._runs import contacts

            steps = request.steps_of(self.system, takes_of(self.method, "Spark or HHT"))
            contacts.check_inputs(self.system, wrt, steps)
            if request.t_eval is None:
                ends = np.linspace(steps.t0, steps.t1, steps.count + 1)
                kept = [*range(0, steps.count, count("every", request.every)), steps.count]
                request = replace(request, t_eval=ends[kept])
        return super()._named(wrt, request)

    def takes_members(self, varied: set[str]) -> bool:
        """Whether runs that differ in these inputs are those of an ensemble."""
        return super().takes_members(varied) and (not varied or self.system.contacts is None)

    def _known(self, request: Request) -> dict[str, tuple[int, ...]]:
        rows, n = self._rows, len(self.system.coordinates)
        states: dict[str, tuple[int, ...]] = dict.fromkeys(self.system.states, (rows, n))
        return states | {"lam": (rows, len(self.system.constraints))}

    def _fixed_start(self, start: Mapping[str, Any]) -> dict[str, Array]:
        system = self.system
        free = [name for name in system.states if name in self.inputs]
        zeros = {name: np.zeros(self.inputs[name]) for name in free}
        values = dict(zip(system.states, system.start({**start, **zeros}), strict=True))
        return {name: x for name, x in values.items() if name not in free}


class ConstrainedPoint(RunPoint):
    """A run from a start that is moved onto its constraints."""

    system: Constrained

    def __init__(
        self, function: RunFunction, inputs: list[Array], run: dict[str, Any], given: dict[str, Any]
    ) -> None:
        system = function.system
        own = {"t": run["t"][0], "params": run["params"]}
        self._given, start = given, system.consistent(**own, **given)
        # z of a semi-explicit system is a guess
        self._moved = [name for name in system.states if name in places_of(system)]
        pairs = [(x, np.broadcast_to(given[x], start[x].shape)) for x in self._moved]
        self._is_consistent = all(np.array_equal(start[x], old) for x, old in pairs)
        super().__init__(function, inputs, system, run, dict(start))

    @property
    def wrt(self) -> list[str]:
        """The arguments of the pullback: all states, where the start was moved."""
        if self._is_consistent:
            return super().wrt
        others = [name for name in self.function.inputs if name not in self._moved]
        return [*self._moved, *others]

    @property
    def values(self) -> list[Array]:
        """The states in `outputs`, each of shape (k, n), or (k, P, n) of P members."""
        if "lam" in self.function.outputs and "lam" not in self.made[1].states:
            sentence = "multipliers of a structure's redundant constraints are not differentiated"
            raise ValueError(hinted(sentence, "leave 'lam' out of returns"))
        return super().values

    def directions(self, tangents: dict[str, Any]) -> dict[str, Any]:
        """Return directions of the start as it is moved, each of shape (d, ...)."""
        if self._is_consistent:
            return tangents
        places = places_of(self.system)
        rows = np.zeros((len(next(iter(tangents.values()))), places["t1"][0] + 1))
        for name, direction in tangents.items():
            first, shape = places[name]
            size = int(np.prod(shape))
            rows[:, first : first + size] = np.reshape(direction, (-1, size))
        n = len(self.system.coordinates)
        *states, tau = np.split(rows[:, :-1], n * np.arange(1, 1 + len(self._moved)), axis=1)
        moved = self._pushed((*states, tau))
        return tangents | dict(zip(self._moved, moved, strict=True))

    def gradients(self, found: dict[str, Any]) -> dict[str, Any]:
        """Return gradients by the start as it was given, from those by the start as it is moved."""
        if self._is_consistent:
            return found
        shape = found[self._moved[0]].shape
        if len(shape) == 1:
            return self._moved_back(found, None)
        each = [self._moved_back({x: y[k] for x, y in found.items()}, k) for k in range(shape[0])]
        return {name: np.array([own[name] for own in each]) for name in found}

    def _moved_back(self, found: dict[str, Any], member: int | None) -> dict[str, Any]:
        places, n = places_of(self.system), len(self.system.coordinates) * len(self._moved)
        more = np.zeros(places["t1"][0] - n)
        *states, more = self._pulled((*(found[name] for name in self._moved), more), member)
        found = found | dict(zip(self._moved, states, strict=True))
        for name in set(self.function.inputs) - {*self._moved, "t1"}:
            first, shape = places[name]
            own = more[first - n :][: int(np.prod(shape))]
            found[name] = found[name] + own.reshape(shape)
        return found

    def _pushed(self, moves: Any) -> tuple[Array, ...]:
        """Return changes of the start as it is moved, from those of it and of tau."""
        system, at, y, z, values = self._from(None)
        if isinstance(system, Mechanics):
            return _sensitivity.moved_start(system, at, y, z, values, moves)
        return (_semi_explicit_sensitivity.moved_start(system, at, y, values, moves),)

    def _pulled(self, found: Any, member: int | None) -> tuple[Array, ...]:
        """Return cotangents of the start as it was given and of tau, from those of it as moved."""
        system, at, y, z, values = self._from(member)
        if isinstance(system, Mechanics):
            return _sensitivity.pulled_start(system, at, y, z, values, found)
        return _semi_explicit_sensitivity.pulled_start(system, at, y, values, found)

    def _from(self, member: int | None) -> tuple[Constrained, float, Array, Array, Array]:
        """Return system, time and given start of a member, before it is moved onto constraints."""
        system, at = self.system, self.run["t"][0]

        def own(x: Any, axes: int) -> Any:
            return x if member is None or np.ndim(x) == axes else x[member]

        params = {x: own(y, np.ndim(system.params[x])) for x, y in self.run["params"].items()}
        values = system.values(params)
        y, z = system.start({name: own(self.start[name], 1) for name in system.states})
        is_whole = not isinstance(system, Mechanics) or system.stepped(at, y, z, values) is system
        y, z = system.start({name: own(self._given[name], 1) for name in system.states})
        if not is_whole:
            system.check(at, y, z, values, ON_CONSTRAINTS)
        return system, at, y, z, values


class WaveFunction(RunFunction):
    """A run of a Schrödinger equation; see :class:`RunFunction`."""

    def _named(self, wrt: Any, request: Request) -> dict[str, tuple[int, ...]]:
        # imported here: it needs the planner, which mechanics do not
        from liouville._runs.waves.derivative import check_wrt, places_of

        places = places_of(self.system)
        return {name: places[name][1] for name in check_wrt(self.system, wrt)}

    def _known(self, request: Request) -> dict[str, tuple[int, ...]]:
        # imported here: it needs the planner, which mechanics do not
        from liouville._runs.waves.wave import WaveRunner

        names = ("t", "h", "steps", "every")
        self._run = {name: getattr(request, name) for name in names}
        psi = self._start.get("psi", np.ones(self.system.size))
        runner = runner_of(self.system, self.method, replace(request, start={"psi": psi}))
        assert isinstance(runner, WaveRunner)
        return {"psi": (len(runner.plan.stops) + 1, self.system.size)}

    def _fixed_start(self, start: Mapping[str, Any]) -> dict[str, Array]:
        if "psi" in self.inputs and not start:
            return {}
        if "psi" not in start:
            raise TypeError("start value 'psi' is missing: it is neither in wrt nor given")
        return {"psi": self.system.outward(self.system.inward(start["psi"]))}

    def _fixed_params(self, params: Mapping[str, Any] | None) -> dict[str, Any]:
        found = super()._fixed_params(params)
        self.system = self.system.with_params(params)
        return found

    def takes_members(self, varied: set[str]) -> bool:
        """Whether runs that differ in these inputs are those of an ensemble."""
        # imported here: it needs the planner, which mechanics do not
        from liouville._methods.planner import WavePlan

        is_planned = isinstance(self.method, WavePlan)  # for one equation
        others = varied - {"psi"}
        return not others or (not is_planned and all(x.startswith(PARAMS) for x in others))

    def point(self, inputs: list[Array]) -> RunPoint:
        """Return the run with these inputs; psi and parameters may have a row for each member."""
        _, values, start, samples = self.parted(inputs)
        params = {name: x for name, x in values.items() if PARAMS + name in self.inputs}
        system = self.system.with_samples(samples) if samples else self.system
        return RunPoint(self, inputs, system, {**self._run, "params": params}, start)


#: How the systems of a family are run.
FAMILIES: dict[type[Runnable], type[RunFunction]] = {
    Mechanics: MechanicalFunction,
    SemiExplicit: SemiExplicitFunction,
    Field: FieldFunction,
    Schrodinger: WaveFunction,
}
