"""Conditions at the final time: whole states, single coordinates, functions.

Constraints leave n - m positions and n - m velocities to be given. A whole state, which satisfies
them itself, is given the m unknowns that it has too few, its distance along their gradients:
0 = y - y_T - g_y^T kappa together with g = 0 has kappa = 0 and independent rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, quoted
from liouville._studies.optimal.arguments import Array, Controls
from liouville._systems import Mechanics
from liouville._systems.mechanics.consistent import project
from liouville._systems.mechanics.form import differ, total_derivative
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.sparse import jacobian

#: A position found may be this part of its size off the one asked for, along the constraints'
#: gradients: another place that meets the same conditions, as the opposite point of a circle.
NEAR = 0.1
#: Conditions repeat others where less than this part of their gradient is their own.
OWN = 1e-6
#: A gradient below this part of that elsewhere vanishes.
FLAT = 1e-3
#: How far the position is moved, of its size, where a condition is looked at.
ASIDE = 1e-3


@dataclass(frozen=True)
class Final:
    """Conditions at the final time.

    Attributes
    ----------
    whole : dict of int to ndarray
        Whole states that are given: y by 0, z by 1.
    rows : SX
        Conditions that vanish, of t, y, z and parameters.
    labels : tuple of str
        Their names.
    places : tuple of int
        Of single coordinates, their places among y and z.
    values : ndarray
        What these coordinates are wanted to be.
    free : tuple of int
        The places of the parameters that are free among the elements of all.
    """

    whole: dict[int, Array] = field(default_factory=dict)
    rows: Any = None
    labels: tuple[str, ...] = ()
    places: tuple[int, ...] = ()
    values: Array = field(default_factory=lambda: np.empty(0))
    free: tuple[int, ...] = ()

    @classmethod
    def of(cls, system: Mechanics, controls: Controls, free: Controls, given: Any) -> Final:
        """Read them: a function, or a mapping of states, and of names to functions."""
        parts: dict[str, Any] = {} if given is None else given
        if callable(given):
            parts = {"final": given}
        whole: dict[int, Array] = {}
        rows, labels, places, values = [ca.SX(0, 1)], [], [], []
        s = system.symbols
        for name, value in _trace.mapping("final", parts).items():
            if name in system.states and not isinstance(value, Mapping):
                place = system.states.index(name)
                whole[place] = _trace.vector(f"final {name}", value, system.coordinates)
            elif name in system.states:
                place = system.states.index(name)
                for coordinate, own in value.items():
                    k = _coordinate(system, name, coordinate)
                    number = _number(f"final {name} of '{coordinate}'", own)
                    rows.append((s.y, s.z)[place][k] - number)
                    labels.append(f"final {name} of '{coordinate}'")
                    places.append(place * len(system.coordinates) + k)
                    values.append(number)
            else:
                names, expression = _function(system, controls, name, value)
                rows.append(expression)
                labels += names
        found = ca.vertcat(*rows)
        own = tuple(free.places.tolist())
        return cls(whole, found, tuple(labels), tuple(places), np.array(values, dtype=float), own)

    def guess(self, y: Array, z: Array) -> tuple[Array, Array]:
        """Return the final state with what is known of it."""
        both = np.concatenate([self.whole.get(0, y), self.whole.get(1, z)])
        both[list(self.places)] = self.values
        first, second = np.split(both, 2)
        return first, second

    def check(
        self, system: Mechanics, reduced: Mechanics, t: float, state: tuple[Array, Array],
        params: Array,
    ) -> None:  # fmt: skip
        """Refuse states off the constraints, and conditions that repeat others.

        Raises
        ------
        ValueError
            They are inconsistent, too many, or depend on one another.
        """
        self._check_whole(system, t, params)
        n, m = len(system.coordinates), len(reduced.constraints)
        count = len(self.labels) + (n - m) * len(self.whole)
        if count > 2 * (n - m) + len(self.free):
            sentence = (
                f"final has {count} independent conditions, and constraints leave {n - m} "
                f"positions and {n - m} velocities to be given"
            )
            raise ValueError(hinted(sentence, self._fewer(system)))
        self._check_own(system, reduced, t, state, params)

    def check_times(self, system: Mechanics, limits: tuple[float, float], params: Array) -> None:
        """Refuse a whole state that moving constraints leave within the limits of the end."""
        for t in filter(np.isfinite, limits):
            sentence = self._violated(system, t, params)
            if sentence is not None:
                hint = (
                    "constraints move, and the end is free: name the n - m entries to be "
                    f"reached, {system.states[0]}={{...}}, or give functions that vanish"
                )
                raise ValueError(hinted(sentence, hint))

    def _violated(self, system: Mechanics, t: float, params: Array) -> str | None:
        """Return which constraint a whole state is off, if it is."""
        if 0 not in self.whole:
            return None
        z = self.whole.get(1)
        at = self.whole[0][None], (np.zeros_like(self.whole[0]) if z is None else z)[None]
        found = system.violation(t, *at, params[None], hidden=z is not None)
        if found is None:
            return None
        sentence = system.violated(found, t, "").partition("\n")[0]
        return sentence.replace("start violates", "final state violates")

    def _check_whole(self, system: Mechanics, t: float, params: Array) -> None:
        first, second = system.states
        z = self.whole.get(1)
        sentence = self._violated(system, t, params)
        if sentence is not None:
            hint = f"system.consistent({first}=..., {second}=...) moves one onto them"
            raise ValueError(hinted(sentence, hint))
        if 0 not in self.whole and z is not None and system.constraints:
            if not z.any() and second == "v":
                return
            sentence = f"final gives all of {second}, and not all of {first}, where it is possible"
            raise ValueError(
                hinted(sentence, f"name the n - m entries that are wanted, {second}={{...}}")
            )

    def _fewer(self, system: Mechanics) -> str:
        first, second = system.states
        return f"leave those out that the others imply, or give all of {first} and of {second}"

    def _check_own(
        self, system: Mechanics, reduced: Mechanics, t: float, state: tuple[Array, Array],
        params: Array,
    ) -> None:  # fmt: skip
        """Refuse a condition whose gradient those of constraints and of others before span."""
        repeated = self.repeated(reduced, t, near_constraints(system, t, state, params), params)
        if repeated is not None:
            others = [name for name in self.labels if name != repeated]
            own = reduced.constraints
            of = [f"constraints {quoted(own[:4])}"] if own else []
            of += [f"all of {system.states[place]}" for place in self.whole]
            of += [", ".join(others[:4])] * bool(others)
            if not of:
                raise ValueError(f"{repeated} fixes nothing: it does not change with the state")
            sentence = f"{repeated} repeats what {' and '.join(of)} fix already"
            raise ValueError(hinted(sentence, self._fewer(system)))

    def repeated(
        self, system: Mechanics, t: float, state: tuple[Array, Array], params: Array
    ) -> str | None:
        """Name the first condition that repeats what constraints and others before it fix."""
        if not self.labels:
            return None
        s, model, n = system.symbols, system.model, len(system.coordinates)
        w = total_derivative(model.g, s, model.v)
        both = ca.vertcat(s.y, s.z, s.params.vector[[*self.free]])
        unit = ca.SX.eye(both.numel())
        parts = [unit[:n, :] if 0 in self.whole else jacobian(model.g, both)]
        parts += [unit[n : 2 * n, :] if 1 in self.whole else jacobian(w, both)]
        known = sum(part.shape[0] for part in parts)
        slopes = ca.Function("slopes", s.all, [ca.vertcat(*parts, jacobian(self.rows, both))])
        rows = np.array(ca.DM(slopes(t, *state, params)))
        kept, _, _ = _core.independent_rows(np.ascontiguousarray(rows), OWN)
        missing = [label for k, label in enumerate(self.labels) if known + k not in kept]
        return missing[0] if missing else None

    def flat(
        self, system: Mechanics, t: float, state: tuple[Array, Array],
        near: tuple[Array, Array], params: Array,
    ) -> str | None:  # fmt: skip
        """Name a condition whose gradient at a state is nothing beside that at another one."""
        s = system.symbols
        rows = jacobian(self.rows, ca.vertcat(s.y, s.z))
        slopes = ca.Function("slopes", s.all, [ca.densify(rows)])
        here, there = (np.array(slopes(t, *x, params)) for x in (state, near))
        sizes = [np.abs(x).max(axis=1, initial=0.0) for x in (here, there)]
        found = np.flatnonzero(sizes[0] < FLAT * sizes[1])
        return self.labels[found[0]] if found.size else None

    def block(
        self, system: Mechanics, t: ca.SX, y: ca.SX, z: ca.SX, params: ca.SX, guess: Array,
        end: float,
    ) -> tuple[ca.SX, tuple[str, ...], ca.SX, Array]:  # fmt: skip
        """Return the conditions on (t, y, z), their names, their own unknowns, and these' limits.

        The system is that without redundant constraints, `guess` and `end` are those of the
        parameters and of t.
        """
        s, model = system.symbols, system.model
        w = total_derivative(model.g, s, model.v)
        slopes = [jacobian(model.g, s.y), jacobian(w, s.z)]
        matrices = ca.Function("slopes", s.all, [*slopes, self.rows])
        _, of_z, rest = matrices(t, y, z, params)
        rows, labels, own, limits = [], [], [ca.SX(0, 1)], [np.empty(0)]
        m = model.g.numel()
        for place, wanted in self.whole.items():
            kappa = ca.SX.sym("kappa", m)
            at_end = matrices(t, wanted, z, params)[0] if place == 0 else of_z
            rows.append((y, z)[place] - ca.DM(wanted) - ca.mtimes(at_end.T, kappa))
            labels += [f"final {system.states[place]} of '{x}'" for x in system.coordinates]
            own.append(kappa)
            limits.append(
                self._limits(system, end, wanted, guess) if place == 0 else np.full(m, np.inf)
            )
        found = ca.vertcat(ca.SX(0, 1), *rows, rest)
        return found, (*labels, *self.labels), ca.vertcat(*own), np.concatenate(limits)

    def _limits(self, system: Mechanics, end: float, wanted: Array, params: Array) -> Array:
        """Return how large the distances along the gradients of constraints may become."""
        s, model = system.symbols, system.model
        slopes = ca.Function("slopes", [s.t, s.y, s.params.vector], [jacobian(model.g, s.y)])
        lengths = np.abs(np.array(ca.DM(slopes(end, wanted, params)))).max(axis=1, initial=0.0)
        found: Array = NEAR * (np.abs(wanted).max() or 1.0) / np.where(lengths > 0, lengths, 1.0)
        return found


def _coordinate(system: Mechanics, name: str, coordinate: Any) -> int:
    if coordinate not in system.coordinates:
        sentence = f"final {name}: there is no coordinate {coordinate!r}"
        raise ValueError(hinted(sentence, f"there are {quoted(system.coordinates[:6])}"))
    return system.coordinates.index(coordinate)


def _number(what: str, given: Any) -> float:
    value = _trace.numbers(given)
    if value is None or value.shape != () or not np.isfinite(value):
        raise ValueError(f"{what} must be a finite number, not {given!r}")
    return float(value)


def _function(
    system: Mechanics, controls: Controls, name: str, function: Any
) -> tuple[list[str], ca.SX]:
    if not callable(function):
        first, second = system.states
        sentence = f"final has no use for {name!r}: {function!r}"
        hint = f"it takes {first}=, {second}=, and functions of (t, {first}, {second}, params)"
        raise ValueError(hinted(sentence, hint))
    what = "final" if name == "final" else f"final condition '{name}'"
    names, expression = _trace.named(what, function, system.symbols.args)
    check_free(what, expression, system, controls)
    if len(names) == 1:
        return [what], expression
    return [f"{what} '{x}'" for x in names], expression


def check_free(what: str, expression: ca.SX, system: Mechanics, controls: Controls) -> None:
    """Refuse an expression at the final time that depends on controls."""
    for name in controls.names:
        if ca.depends_on(expression, getattr(system.symbols.params.namespace, name)):
            sentence = f"{what} depends on control '{name}', which acts before the final time"
            raise ValueError(hinted(sentence, "bound it, or put it into the cost"))


def near_constraints(
    system: Mechanics, t: float, state: tuple[Array, Array], params: Array
) -> tuple[Array, Array]:
    """Return a state near the constraints, and at no special place."""
    y, z = state
    shift = np.random.default_rng(0).standard_normal((2, y.size))
    y = y + ASIDE * (np.abs(y).max() or 1.0) * shift[0]
    z = z + ASIDE * (np.abs(z).max() or 1.0) * shift[1]
    with suppress(ValueError):  # too far away: the gradients there have to do
        y = project(system, "positions", t, y, z, params) if system.constraints else y
    return y, z


def is_own_velocity(system: Mechanics) -> bool:
    """Return whether the second state is the velocity itself."""
    return not differ(system.model.v, system.symbols.z)
