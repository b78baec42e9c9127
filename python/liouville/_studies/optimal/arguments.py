"""Arguments of an optimal control problem, checked: controls, bounds, times, guesses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._basics.arguments import count, interval, number
from liouville._basics.errors import hinted, quoted
from liouville._methods import Method, Spark
from liouville._runs.choice import named
from liouville._runs.tangents import PARAMS
from liouville._systems import Mechanics
from liouville._systems.tracing import trace as _trace

Array = NDArray[np.float64]

#: What goes beyond a bound by less than this part of it is at the bound.
BEYOND = 1e-6


@dataclass(frozen=True)
class Controls:
    """Parameters of a system that are functions of time.

    Attributes
    ----------
    names : tuple of str
        Their names.
    shapes : dict of str to tuple
        The shape of each, () or (k,).
    places : ndarray of int
        Where their elements are among the elements of all parameters.
    """

    names: tuple[str, ...]
    shapes: dict[str, tuple[int, ...]]
    places: NDArray[np.int64]

    @classmethod
    def of(cls, system: Mechanics, given: Any) -> Controls:
        """Find them among the parameters, and refuse those that are not in forces alone."""
        if isinstance(given, str) or not isinstance(given, Sequence):
            hint = f"write controls=({given!r},)" if isinstance(given, str) else "name parameters"
            raise TypeError(hinted(f"controls must be a sequence of names, not {given!r}", hint))
        defaults = system.symbols.params.defaults
        names = tuple(given)
        for name in names:
            if name not in defaults:
                known = ", ".join(defaults) or "none"
                sentence = f"control {name!r} is no parameter of the system, which has {known}"
                hint = "declare it with its default, params={'F': 0.0}, and use it in the force"
                raise ValueError(hinted(sentence, hint))
            if names.count(name) > 1:
                raise ValueError(f"controls names {name!r} twice")
        if not names:
            raise ValueError("controls names no parameter")
        found = cls.among(system, names)
        found._check(system)
        return found

    @classmethod
    def among(cls, system: Mechanics, names: tuple[str, ...]) -> Controls:
        """Find these parameters among all."""
        defaults = system.symbols.params.defaults
        sizes = [max(x.size, 1) for x in defaults.values()]
        firsts = dict(zip(defaults, np.cumsum([0, *sizes]).tolist(), strict=False))
        places = [np.arange(firsts[x], firsts[x] + defaults[x].size) for x in names]
        shapes = {x: defaults[x].shape for x in names}
        return cls(names, shapes, np.concatenate([np.empty(0, dtype=np.int64), *places]))

    def _check(self, system: Mechanics) -> None:
        model = system.model
        elsewhere = {
            "the momentum": model.p,
            "the velocity": model.v,
            "a constraint": ca.vertcat(model.g, model.nonholonomic.k),
            "a reaction": ca.vertcat(model.r, model.nonholonomic.rn),
        }
        for name in self.names:
            own = getattr(system.symbols.params.namespace, name)
            for what, expression in elsewhere.items():
                if ca.depends_on(expression, own):
                    sentence = f"control '{name}' is in {what}, and controls act by forces alone"
                    hint = "let a force drive the motion, and bound or prescribe that at its end"
                    raise ValueError(hinted(sentence, hint))
            if not ca.depends_on(model.f, own):
                sentence = f"control '{name}' is in no force: nothing depends on it"
                raise ValueError(hinted(sentence, f"use params.{name} in the force"))

    @property
    def size(self) -> int:
        """The number of their elements."""
        return len(self.places)

    def split(self, values: Array) -> dict[str, Array]:
        """Name elements along the last axis."""
        sizes = [math.prod(shape) for shape in self.shapes.values()]
        parts = np.split(values, np.cumsum(sizes)[:-1], axis=-1)
        return {
            name: part.reshape(*part.shape[:-1], *self.shapes[name])
            for name, part in zip(self.names, parts, strict=True)
        }


@dataclass(frozen=True)
class Times:
    """Start, end or its limits, and the number of equal steps."""

    start: float
    end: float
    limits: tuple[float, float] | None
    steps: int

    @classmethod
    def of(cls, t: Any, h: Any, steps: Any, final_time: Any) -> Times:
        """Check what is given of them."""
        t0, t1 = interval(t)
        if t1 < t0:
            raise ValueError(f"optimal control goes forward in time, not from {t0:g} to {t1:g}")
        if (h is None) == (steps is None):
            raise TypeError("optimal control takes either h or steps")
        if steps is None:
            h = number("h must be a number", h)
            if not 0 < h < math.inf:
                raise ValueError(f"h must be positive, not {h:g}")
            steps = max(1, math.ceil((t1 - t0) / h * (1 - 1e-12)))
        return cls(t0, t1, cls._limits(final_time, t0, t1), count("steps", steps))

    @staticmethod
    def _limits(given: Any, t0: float, t1: float) -> tuple[float, float] | None:
        if given is None:
            return None
        low, high = _trace.pair("final_time", given, ())
        if not t0 < low <= t1 <= high:
            sentence = f"final_time must be limits around t = {t1:g}, not {low:g} to {high:g}"
            raise ValueError(hinted(sentence, f"both must be above the start, {t0:g}"))
        return float(low), float(high)

    @property
    def h(self) -> float:
        """The step, of a guess where the final time is free."""
        return (self.end - self.start) / self.steps


def mechanical(system: Any) -> Mechanics:
    """Return a mechanical system, and refuse what has no such program."""
    if not isinstance(system, Mechanics):
        sentence = f"optimal control takes a mechanical system, not a {type(system).__name__}"
        hint = "a Lagrangian, Hamiltonian, Mechanical, Structure or the system of an assembly"
        raise TypeError(hinted(sentence, hint))
    system.check_smooth("optimal control")
    if system.nonholonomic:
        sentence = (
            f"optimal control takes holonomic constraints, and '{system.nonholonomic[0]}' is none"
        )
        hint = (
            "the adjoint of nonholonomic steps is another method, whose controls have lower order"
        )
        raise TypeError(hinted(sentence, hint))
    return system


def checked_method(system: Any, method: Method | str) -> Spark:
    """Return the method, or that of a name, whose stages are Gauss points."""
    method = named(system, method)
    if not isinstance(method, Spark):
        sentence = f"optimal control takes the step equations of Spark, not of {method!r}"
        raise TypeError(hinted(sentence, "lv.Spark(3) has order 6 in the controls too"))
    if method.points != "gauss":
        sentence = f"optimal control takes Gauss points, not {method.points!r}"
        raise ValueError(
            hinted(sentence, "the adjoint of Radau stages is another method, of lower order")
        )
    return method


@dataclass(frozen=True)
class Free:
    """Unknowns beside the controls: states of the start, and numbers of the system.

    Attributes
    ----------
    states : tuple of int
        The places of the states of the start that are free, 0 for y and 1 for z.
    params : Controls
        Parameters that are free; they do not change in time.
    """

    states: tuple[int, ...]
    params: Controls

    @classmethod
    def of(cls, system: Mechanics, controls: Controls, given: Any) -> Free:
        """Read them by the names of states, and of parameters as ``"params.m"``."""
        if isinstance(given, str) or not isinstance(given, Sequence):
            hint = f"write free={system.states!r} or one of both in a tuple"
            raise TypeError(hinted(f"free must be a sequence of states, not {given!r}", hint))
        defaults = system.symbols.params.defaults
        known = [*system.states, *(PARAMS + x for x in defaults if x not in controls.names)]
        for name in given:
            if name not in known:
                raise ValueError(f"free must be of {', '.join(known)}, not {name!r}")
            if given.count(name) > 1:
                raise ValueError(f"free names {name!r} twice")
        states = tuple(system.states.index(x) for x in given if x in system.states)
        names = tuple(x.removeprefix(PARAMS) for x in given if x not in system.states)
        found = cls(states, Controls.among(system, names))
        model = system.model
        on_constraints = ca.vertcat(model.g, model.nonholonomic.k)
        for name in names:
            if ca.depends_on(on_constraints, getattr(system.symbols.params.namespace, name)):
                sentence = f"free parameter '{name}' is in a constraint, which the start is on"
                raise ValueError(hinted(sentence, "make it a coordinate, which bounds may hold"))
        return found


@dataclass(frozen=True)
class Bounds:
    """Least and largest values, of y and z, shape (2, 2, n), of controls and of free parameters."""

    states: Array
    controls: Array
    params: Array

    @classmethod
    def of(cls, system: Mechanics, controls: Controls, free: Controls, given: Any) -> Bounds:
        """Read them by the names of controls, free parameters and states."""
        sides = np.array([-np.inf, np.inf])[:, None]
        n = len(system.coordinates)
        states = np.tile(sides[:, None], (1, 2, n))
        shapes = {**controls.shapes, **free.shapes}
        own = {name: np.empty((2, *shape)) for name, shape in shapes.items()}
        for name in own:
            own[name][:] = sides.reshape(2, *([1] * (own[name].ndim - 1)))
        for name, value in _trace.mapping("bounds", given).items():
            if name in own:
                what = "control" if name in controls.shapes else "parameter"
                own[name][:] = _trace.pair(f"{what} '{name}'", value, shapes[name])
            elif name in system.states:
                place = system.states.index(name)
                states[:, place] = _state_bounds(system, name, value, states[:, place])
            else:
                known = ", ".join([*own, *system.states])
                raise ValueError(hinted(f"bounds has no use for {name!r}", f"it takes {known}"))
        found = np.concatenate([x.reshape(2, -1) for x in own.values()], axis=1)
        return cls(states, found[:, : controls.size], found[:, controls.size :])

    def without(self, *, controls: bool) -> Bounds:
        """Return bounds that leave states free, and controls if asked."""
        sides = np.array([-np.inf, np.inf])
        free = np.broadcast_to(sides[:, None], self.controls.shape)
        states = np.broadcast_to(sides[:, None, None], self.states.shape)
        return Bounds(states.copy(), free.copy() if controls else self.controls, self.params)

    def beyond(self, system: Mechanics, controls: Controls, values: Sequence[Array]) -> str:
        """Name the bound that rows of y, z and u go beyond by most of it, empty if none do."""
        names = [f"{state} of '{x}'" for state in system.states for x in system.coordinates]
        names += [f"'{x}'" for x, shape in controls.shapes.items() for _ in range(math.prod(shape))]
        most, words = BEYOND, ""
        low, high = np.hstack([self.states.reshape(2, -1), self.controls]).tolist()
        columns = [column for rows in values for column in rows.T]
        for name, column, least, largest in zip(names, columns, low, high, strict=True):
            for reached, side in ((column.min(), least), (column.max(), largest)):
                off = max(reached - largest, least - reached)
                if off > most * (abs(side) or float(np.abs(column).max())):
                    most = off / (abs(side) or float(np.abs(column).max()))
                    words = f"{name} goes to {reached:.3g}, beyond its bound of {side:g}"
        return words

    def check(self, system: Mechanics, place: int, values: Array, when: str) -> None:
        """Refuse a state, y (0) or z (1), outside its bounds."""
        low, high = self.states[:, place]
        bad = np.flatnonzero((values < low) | (values > high))
        if bad.size:
            k = int(bad[0])
            name = f"{system.states[place]} of '{system.coordinates[k]}'"
            bounds = f"from {low[k]:g} to {high[k]:g}"
            raise ValueError(f"{name} is {values[k]:g} {when}, and its bounds are {bounds}")


def _state_bounds(system: Mechanics, name: str, value: Any, free: Array) -> Array:
    if not isinstance(value, Mapping):
        return np.array(_trace.pair(name, value, (len(system.coordinates),)))
    found = free.copy()
    for coordinate, own in value.items():
        if coordinate not in system.coordinates:
            known = f"there are {quoted(system.coordinates[:6])}"
            raise ValueError(hinted(f"bounds of {name}: there is no '{coordinate}'", known))
        sides = _trace.pair(f"{name} of '{coordinate}'", own, ())
        found[:, system.coordinates.index(coordinate)] = sides
    return found


def named_values(defaults: Mapping[str, Array], values: Array) -> dict[str, Any]:
    """Name the elements of all parameters."""
    places = np.cumsum([x.size for x in defaults.values()])[:-1]
    parts = zip(defaults.items(), np.split(values, places), strict=True)
    return {name: x.reshape(own.shape) if own.ndim else float(x[0]) for (name, own), x in parts}
