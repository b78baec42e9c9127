"""A run as a function: from some of what it depends on to the states that it keeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._arguments import count
from liouville._options import check_options
from liouville.control import Takes
from liouville.errors import hinted, quoted
from liouville.gradients import vjp
from liouville.integrate import integrate
from liouville.methods import Method
from liouville.runners import Request
from liouville.runners.tangents import (
    PARAMS,
    check_covered,
    check_wrt,
    places_of,
    shapes_of,
)
from liouville.systems import Mechanics
from liouville.systems._sensitivity import moved_start, pulled_start

Array = NDArray[np.float64]

#: The type of all numbers, by the name that every library has for it.
DOUBLE = "float64"

#: Where redundant constraints are dependent on one another.
ON_CONSTRAINTS = (
    "some constraints imply others, and derivatives are then taken at starts on all of them: make "
    "q and v of variables along them, such as an angle and its rate"
)


def library(name: str, what: str) -> Any:
    """Import a library that is an extra of its name; ImportError says what needs it."""
    try:
        return import_module(name)
    except ImportError as error:
        hint = f'pip install "liouville[{name}]"'
        raise ImportError(hinted(f"{what} needs {name}", hint), name=name) from error


class RunFunction:
    """A run with equal steps as a function of arrays, with its derivatives.

    The last point is kept, as libraries ask for values and then for derivatives at the same one.

    Attributes
    ----------
    system, method : Mechanics, Method
        What is run, and how.
    inputs, outputs : dict of str to tuple of int
        Names with shapes: of what the run is a function of, and of the states that it returns.
    is_single : bool
        Whether one output was asked for by its name alone.
    """

    def __init__(
        self, system: Mechanics, method: Method, wrt: Any, returns: Any, request: Request
    ) -> None:
        check_options(request.start, "integrate")
        check_covered(system, method, request)
        if not isinstance(system, Mechanics):
            sentence = f"a run of a {type(system).__name__} is no function of arrays yet"
            raise TypeError(hinted(sentence, "lv.vjp has its pullback"))
        self.system, self.method = system, method
        steps = request.steps_of(system, Takes(type(method).__name__))
        self.inputs = shapes_of(system, check_wrt(system, wrt, steps))
        if len(self.inputs) < len(wrt):
            raise ValueError(f"wrt names each input once, not {wrt!r}")
        self._start = self._fixed_start(request.start)
        self._params = self._fixed_params(request.params)
        self._steps, self._every = steps.count, count("every", request.every)
        self._ends = {"t0": steps.t0, "t1": steps.t1}
        self.is_single = isinstance(returns, str)
        self.outputs = self._shapes((returns,) if self.is_single else returns)
        self._last: RunPoint | None = None

    def _fixed_start(self, start: Mapping[str, Any]) -> dict[str, Array]:
        system = self.system
        self._refuse_fixed(start, "")
        free = [name for name in system.states if name in self.inputs]
        zeros = {name: np.zeros(self.inputs[name]) for name in free}
        values = dict(zip(system.states, system.start({**start, **zeros}), strict=True))
        return {name: x for name, x in values.items() if name not in free}

    def _fixed_params(self, params: Mapping[str, Any] | None) -> dict[str, Any]:
        self.system.values(params)  # refuses names and shapes
        self._refuse_fixed(params or {}, PARAMS)
        return {**self.system.params, **(params or {})}

    def _refuse_fixed(self, given: Mapping[str, Any], prefix: str) -> None:
        for name in given:
            if prefix + name in self.inputs:
                sentence = f"'{prefix + name}' is in wrt, and has a fixed value too"
                raise TypeError(hinted(sentence, "leave one of them out"))

    def _shapes(self, returns: Any) -> dict[str, tuple[int, ...]]:
        kept, n = -(-self._steps // self._every) + 1, len(self.system.coordinates)
        known = dict.fromkeys(self.system.states, (kept, n))
        known["lam"] = (kept, len(self.system.constraints))
        if not isinstance(returns, Sequence) or not returns:
            raise TypeError(f"returns is the name of a state or a sequence of names: {returns!r}")
        for name in returns:
            if name not in known:
                hint = f"there are {quoted([*known])}"
                raise ValueError(hinted(f"there is no state {name!r}", hint))
        found: dict[str, tuple[int, ...]] = {name: known[name] for name in returns}
        if len(found) < len(returns):
            raise ValueError(f"returns names each state once, not {returns!r}")
        return found

    def check(self, given: Sequence[tuple[Sequence[int], str]]) -> None:
        """Refuse inputs by their shapes and the names of their types.

        Raises
        ------
        TypeError, ValueError
            There are too many or too few, of another type or of other shapes.
        """
        if len(given) != len(self.inputs):
            sentence = f"the solver takes {len(self.inputs)} arrays, not {len(given)}"
            raise TypeError(hinted(sentence, f"in the order of wrt: {', '.join(self.inputs)}"))
        for (name, wanted), (shape, kind) in zip(self.inputs.items(), given, strict=True):
            if kind != DOUBLE:
                raise TypeError(hinted(f"'{name}' is of type {kind}", f"numbers are {DOUBLE} here"))
            if tuple(shape) != wanted:
                raise ValueError(f"'{name}' has shape {tuple(shape)}, wanted {wanted}")

    def at(self, inputs: Sequence[Any]) -> RunPoint:
        """Run with these inputs, unless it is the last run again.

        Raises
        ------
        ValueError
            An input is not finite, or no start on the constraints is near.
        IntegrationError
            A step failed, or the run was interrupted.
        """
        own = [np.array(x, dtype=float) for x in inputs]  # libraries use their memory again
        last = self._last
        if last is None or not all(map(np.array_equal, own, last.inputs)):
            self._last = last = RunPoint(self, own)
        return last

    def arguments(self, inputs: Sequence[Array]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return all of a run but its start, and its start, with these inputs."""
        ends, params, start = dict(self._ends), dict(self._params), dict(self._start)
        for name, value in zip(self.inputs, inputs, strict=True):
            if not np.isfinite(value).all():
                raise ValueError(f"'{name}' is not finite")
            if name in ends:
                ends[name] = float(value)
            elif name in self.system.states:
                start[name] = value
            else:
                params[name.removeprefix(PARAMS)] = value
        run = {"t": (ends["t0"], ends["t1"]), "params": params}
        return run | {"steps": self._steps, "every": self._every}, start


class RunPoint:
    """A run with some inputs: what it returns, and its derivative there.

    Attributes
    ----------
    inputs : list of ndarray
        With which it was run.
    values : list of ndarray
        The states in `outputs`, each of shape (k, n).
    """

    def __init__(self, function: RunFunction, inputs: list[Array]) -> None:
        self.inputs, self._function = inputs, function
        self._run, self._given = function.arguments(inputs)
        system, method = function.system, function.method
        own = {"t": self._run["t"][0], "params": self._run["params"]}
        start = system.consistent(**own, **self._given)
        given = dict(zip(system.states, system.start(self._given), strict=True))
        self._is_consistent = all(np.array_equal(x, given[name]) for name, x in start.items())
        self._run |= dict(start)
        moving = [name for name in function.inputs if name not in system.states]
        wrt = [*function.inputs] if self._is_consistent else [*system.states, *moving]
        solution, self._pullback = vjp(system, method, wrt=wrt, **self._run)
        if "lam" in function.outputs and "lam" not in self._pullback.states:
            sentence = "multipliers of a structure's redundant constraints are not differentiated"
            raise ValueError(hinted(sentence, "leave 'lam' out of returns"))
        self.values = [solution.states[name] for name in function.outputs]

    def pushed(self, directions: Sequence[Array]) -> list[Array]:
        """Return the derivatives of all outputs by d directions, of shapes (d, k, n)."""
        function, system = self._function, self._function.system
        tangents = dict(zip(function.inputs, directions, strict=True))
        if not self._is_consistent:
            n, places = len(system.coordinates), places_of(system)
            rows = np.zeros((len(directions[0]), places["t1"][0] + 1))
            for name, direction in tangents.items():
                first, shape = places[name]
                size = int(np.prod(shape))
                rows[:, first : first + size] = np.reshape(direction, (-1, size))
            moves = rows[:, :n], rows[:, n : 2 * n], rows[:, 2 * n : -1]
            moved = moved_start(*self._start(), moves)
            tangents |= dict(zip(system.states, moved, strict=True))
        run = self._run | {"tangents": tangents}
        each = integrate(system, function.method, **run).tangents.values()
        sums = (sum(tangent.states[name] for tangent in each) for name in function.outputs)
        return [np.moveaxis(np.asarray(x), 1, 0) for x in sums]

    def pulled(self, cotangents: Sequence[Array]) -> list[Array]:
        """Return the derivatives by all inputs of a scalar, from those by all outputs."""
        function, system = self._function, self._function.system
        found = self._pullback(**dict(zip(function.outputs, cotangents, strict=True)))
        if not self._is_consistent:
            n, places = len(system.coordinates), places_of(system)
            states = [found[name] for name in system.states]
            more = np.zeros(places["t1"][0] - 2 * n)
            *states, more = pulled_start(*self._start(), (*states, more))
            found |= dict(zip(system.states, states, strict=True))
            for name in set(function.inputs) - {*system.states, "t1"}:
                first, shape = places[name]
                own = more[first - 2 * n :][: int(np.prod(shape))]
                found[name] = found[name] + own.reshape(shape)
        return [np.asarray(found[name], dtype=float) for name in function.inputs]

    def _start(self) -> tuple[Mechanics, float, Array, Array, Array]:
        """Return what the start that was given is moved from, to differentiate the move."""
        system = self._function.system
        at, values = self._run["t"][0], system.values(self._run["params"])
        y, z = system.start({name: self._run[name] for name in system.states})
        is_whole = system.stepped(at, y, z, values) is system
        y, z = system.start(self._given)
        if not is_whole:
            system.check(at, y, z, values, ON_CONSTRAINTS)
        return system, at, y, z, values
