"""A run as a function: from some of what it depends on to the states that it keeps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.arguments import kept
from liouville._basics.errors import hinted, misshapen, quoted
from liouville._basics.options import check_options
from liouville._bridges.members import Call, RunMembers, are_alike
from liouville._methods import Method
from liouville._runs.choice import named
from liouville._runs.execute import finished
from liouville._runs.gradients import Pullback, vjp
from liouville._runs.integrate import integrate
from liouville._runs.runner import Request
from liouville._runs.tangents import PARAMS, check_covered
from liouville._solution.solution import Solution
from liouville._systems import Field, Mechanics, Schrodinger, SemiExplicit

Array = NDArray[Any]

#: The systems whose runs are functions.
Runnable = Mechanics | SemiExplicit | Field | Schrodinger

#: What is said where a derivative is to be differentiated.
FIRST = "a run has first derivatives only, and no second ones"

#: The types of numbers, by the names that every library has for them.
DOUBLE, COMPLEX = "float64", "complex128"


def library(name: str, what: str) -> Any:
    """Import a library that is an extra of its name; ImportError names what needs it."""
    try:
        return import_module(name)
    except ImportError as error:
        hint = f'pip install "liouville[{name}]"'
        raise ImportError(hinted(f"{what} needs {name}", hint), name=name) from error


class RunFunction(ABC):
    """A run as a function of arrays, with its derivatives.

    The last point is kept, as libraries ask for values and then for derivatives at the same one.

    Attributes
    ----------
    system, method : Mechanics, Field or Schrodinger, and Method or str
        What is run, and how.
    inputs, outputs : dict of str to tuple of int
        Names with shapes: of what the run is a function of, and of the states that it returns.
    types : dict of str to str
        The types of the numbers of all inputs and outputs.
    is_single : bool
        Whether one output was asked for by its name alone.
    last : RunMembers or None
        The runs that were asked for last.
    failures : dict of int to str
        The members of these that failed, whose numbers are NaN, with what was said of each.
    """

    def __init__(
        self, system: Any, method: Method | str, wrt: Any, returns: Any, request: Request
    ) -> None:
        check_options(request.start, "integrate")
        method = named(system, method, request.rtol)
        check_covered(system, method, request)
        self.system, self.method = system, method
        self.inputs = self._named(wrt, request)
        if len(self.inputs) < len(wrt):
            raise ValueError(f"wrt must name each input once, not {wrt!r}")
        self._refuse_fixed(request.start, "")
        self._start = self._fixed_start(request.start)
        self._params = self._fixed_params(request.params)
        self.is_single = isinstance(returns, str)
        self.outputs = self._chosen((returns,) if self.is_single else returns, request)
        names = (*self.inputs, *self.outputs)
        self.types = {name: COMPLEX if name == "psi" else DOUBLE for name in names}
        self.last: RunMembers | None = None
        self.failures: dict[int, str] = {}

    @abstractmethod
    def _named(self, wrt: Any, request: Request) -> dict[str, tuple[int, ...]]:
        """Return the inputs with their shapes, each seen to be one that has derivatives."""

    @abstractmethod
    def _known(self, request: Request) -> dict[str, tuple[int, ...]]:
        """Return the states that may be outputs, with their shapes."""

    @abstractmethod
    def _fixed_start(self, start: Mapping[str, Any]) -> dict[str, Array]:
        """Return the start values that are no inputs, checked."""

    @abstractmethod
    def takes_members(self, varied: set[str]) -> bool:
        """Whether runs that differ in these inputs are those of an ensemble."""

    @abstractmethod
    def point(self, inputs: list[Array]) -> RunPoint:
        """Return the run with these inputs; some may have a row for each member."""

    def _fixed_params(self, params: Mapping[str, Any] | None) -> dict[str, Any]:
        own = self.system
        values = own.parameters.values if isinstance(own, Schrodinger) else own.values
        values(params)  # refuses names and shapes
        self._refuse_fixed(params or {}, PARAMS)
        return {**self.system.params, **kept(params or {})}

    def _refuse_fixed(self, given: Iterable[str], prefix: str) -> None:
        for name in given:
            if prefix + name in self.inputs:
                sentence = f"'{prefix + name}' is in wrt, and has a fixed value too"
                raise TypeError(hinted(sentence, "leave one of them out"))

    def _chosen(self, returns: Any, request: Request) -> dict[str, tuple[int, ...]]:
        known = self._known(request)
        if not isinstance(returns, Sequence) or not returns:
            sentence = "returns must be the name of a state or a sequence of names"
            raise TypeError(f"{sentence}, not {returns!r}")
        for name in returns:
            if name not in known:
                hint = f"there are {quoted([*known])}"
                raise ValueError(hinted(f"there is no state {name!r}", hint))
        found: dict[str, tuple[int, ...]] = {name: known[name] for name in returns}
        if len(found) < len(returns):
            raise ValueError(f"returns must name each state once, not {returns!r}")
        return found

    def ordered(self, given: Sequence[Any], named: Mapping[str, Any]) -> list[Any]:
        """Return inputs in the order of `wrt`, of which some are named: ``l`` for ``params.l``.

        Raises
        ------
        TypeError
            A name is no input, or one that is given already.
        """
        found: dict[str, Any] = dict(zip(self.inputs, given, strict=False))
        places = {name.rpartition(".")[2]: name for name in self.inputs} | {
            name: name for name in self.inputs
        }
        for name, value in named.items():
            if name not in places:
                hint = f"there are {', '.join(self.inputs)}"
                raise TypeError(hinted(f"the solver has no input {name!r}", hint))
            if places[name] in found:
                raise TypeError(f"the solver is given '{places[name]}' twice")
            found[places[name]] = value
        if not named:
            return [*given]
        return [found[name] for name in self.inputs if name in found]

    @property
    def described(self) -> str:
        """Inputs and outputs of the function with shapes, for its docstring."""
        ins, outs = (
            ", ".join(f"{name} {shape}" for name, shape in parts.items())
            for parts in (self.inputs, self.outputs)
        )
        return f"Run {type(self.system).__name__} by {self.method!r}: ({ins}) -> ({outs})."

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
            own = self.types[name]
            if kind != own:
                hint = "runs take numbers of 64 bits: x.double() or x.astype('float64')"
                sentence = f"'{name}' must be of type {own}, not {kind}"
                raise TypeError(hinted(sentence, hint) if kind == "float32" else sentence)
            if tuple(shape) != wanted:
                raise misshapen(f"'{name}'", shape, wanted)

    def members(self, inputs: Sequence[Any], known: RunMembers | None = None) -> RunMembers:
        """Run with a row of inputs for each member, unless these are known or the last runs again.

        Raises
        ------
        ValueError
            An input is not finite, or no start on the constraints is near.
        IntegrationError
            A step failed, or a run was interrupted; one with tangents raises KeyboardInterrupt.
        """
        types = [self.types[name] for name in self.inputs]
        # libraries use their memory again
        own = [np.array(x, dtype=kind) for x, kind in zip(inputs, types, strict=True)]
        if all(map(are_alike, own)):  # the same point, whatever is asked of it
            own = [x[:1] for x in own]
        for runs in (known, self.last):
            if runs is not None and all(map(np.array_equal, own, runs.inputs)):
                return runs
        self.failures = {}
        self.last = runs = RunMembers(self, own)
        return runs

    def mapped(
        self, args: Sequence[Any], call: Call, known: RunMembers | None = None
    ) -> list[Array]:
        """Call with runs and the arguments behind the inputs; all begin with the same axes."""
        shapes, arrays = [*self.inputs.values()], [np.asarray(x) for x in args]
        lead = arrays[0].shape[: arrays[0].ndim - len(shapes[0])]
        many = int(np.prod(lead))
        flat = [x.reshape(many, *x.shape[len(lead) :]) for x in arrays]
        at = self.members(flat[: len(shapes)], known)
        found = [np.broadcast_to(x, (many, *x.shape[1:])) for x in call(at, flat[len(shapes) :])]
        return [x.reshape((*lead, *x.shape[1:])) for x in found]

    def at(self, inputs: Sequence[Any]) -> RunPoint:
        """Run with these inputs, as :meth:`members` does."""
        return self.members([np.asarray(x)[None] for x in inputs]).one

    def parted(self, inputs: Sequence[Array]) -> tuple[dict[str, Any], ...]:
        """Return ends, parameters, start and all else of a run with these inputs."""
        ends, params, start = dict[str, float](), dict(self._params), dict[str, Any](self._start)
        more = dict[str, Any]()
        for name, value in zip(self.inputs, inputs, strict=True):
            if not np.isfinite(value).all():
                raise ValueError(f"'{name}' must be finite, not {value!r}")
            if name in ("t0", "t1"):
                ends[name] = float(value)
            elif name in self.system.states:
                start[name] = value
            elif name.startswith(PARAMS):
                params[name.removeprefix(PARAMS)] = value
            else:
                more[name] = value
        return ends, params, start, more


class RunPoint:
    """A run with some inputs, or an ensemble: what it returns, and its derivative there.

    Attributes
    ----------
    inputs : list of ndarray
        With which it is run.
    system : Mechanics, Field or Schrodinger
        What is run.
    run, start : dict
        How it is run, and its start.
    """

    def __init__(
        self,
        function: RunFunction,
        inputs: list[Array],
        system: Runnable,
        run: Mapping[str, Any],
        start: Mapping[str, Any],
    ) -> None:
        self.inputs, self.function = inputs, function
        self.system, self.run, self.start = system, run, start

    @property
    def wrt(self) -> list[str]:
        """The arguments of the pullback."""
        return [*self.function.inputs]

    @cached_property
    def made(self) -> tuple[Solution, Pullback]:
        """The run and its pullback."""
        return vjp(self.system, self.function.method, wrt=self.wrt, **self.run, **self.start)

    @property
    def values(self) -> list[Array]:
        """The states in `outputs`, each of shape (k, n), or (k, P, n) of P members."""
        return [self.made[0].states[name] for name in self.function.outputs]

    def directions(self, tangents: dict[str, Any]) -> dict[str, Any]:
        """Return directions of the run from those of its inputs, each of shape (d, ...)."""
        return tangents

    def pushed(self, directions: Sequence[Array]) -> list[Array]:
        """Return the derivatives of all outputs by d directions, of shapes (d, k, n)."""
        function, system = self.function, self.system
        tangents = self.directions(dict(zip(function.inputs, directions, strict=True)))
        run: dict[str, Any] = {**self.run, **self.start, "tangents": tangents}
        each = finished(integrate(system, function.method, **run)).tangents.values()
        sums = (sum(tangent.states[name] for tangent in each) for name in function.outputs)
        return [np.moveaxis(np.asarray(x), 1, 0) for x in sums]

    def gradients(self, found: dict[str, Any]) -> dict[str, Any]:
        """Return gradients by all inputs from those of the run."""
        return found

    def pulled(self, cotangents: Sequence[Array]) -> list[Array]:
        """Return the derivatives by all inputs of a scalar, from those by all outputs."""
        function, (_, pullback) = self.function, self.made
        pulled = pullback(**dict(zip(function.outputs, cotangents, strict=True)))
        found = self.gradients(pulled)
        return [np.asarray(found[name], dtype=function.types[name]) for name in function.inputs]
