"""The base of systems whose functions are traced: parameters, records, start values, pickles."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._basics.faults import Description, describe
from liouville._basics.job import Reset, Turning
from liouville._systems.events import Event, Impact
from liouville._systems.mechanics.form import total_derivative
from liouville._systems.mechanics.monitor import traced
from liouville._systems.program import Program, elements, parameters
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Parametrised, Symbols, recorded
from liouville._systems.tracing.layout import POINT, Layout
from liouville._systems.tracing.signatures import takes_multipliers
from liouville._systems.tracing.sparse import jacobian

#: The prefix of invariants among the expressions and in a record.
INVARIANT = "invariant "

#: The beginning of the names of switches where springs of ball joints change sides.
HALF_TURN = "half a turn of "
#: The prefix of switches among the expressions.
SWITCH = "switch "

Function = Callable[..., Any]

#: Tapes of an event and of its reset, and whether the event uses multipliers.
EventTapes = tuple[_core.Tape, bool, Reset | None]


class TracedSystem(Parametrised, ABC):
    """A system of expressions that CasADi differentiates and the core evaluates as tapes.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    constraints : tuple of str
        Names of the constraints.
    states : tuple of str
        Names of its two states.
    invariants : tuple of str
        Names of the quantities recorded along a run.
    """

    coordinates: tuple[str, ...]
    constraints: tuple[str, ...]
    states: tuple[str, str]
    invariants: tuple[str, ...]
    #: Tapes of the functions at whose zeros controlled steps end, by name.
    switch_tapes: Mapping[str, _core.Tape] = MappingProxyType({})
    #: Angles that a run continues from step to step, as no coordinate counts their turns.
    turned: tuple[str, ...] = ()
    #: Whether `values` refuses finite parameters.
    checks_values = False

    problem: _core.Mechanical | _core.SemiExplicit
    tapes: dict[str, _core.Tape]

    def _keep(self, expressions: Expressions, invariants: Mapping[str, ca.SX]) -> None:
        """Keep expressions, and the invariants among them."""
        symbols, columns = expressions.symbols, expressions.columns
        columns = columns | {INVARIANT + name: x for name, x in invariants.items()}
        self.invariants = tuple(invariants)
        self.expressions = Expressions(symbols, columns, **expressions.more)
        self._observers: dict[bool, tuple[_core.Tape, dict[str, int]]] = {}

    @property
    def symbols(self) -> Symbols:  # type: ignore[override]
        return self.expressions.symbols

    @property
    def turning(self) -> Turning | None:
        """The tape of angles that a run continues and their rates, and their periods."""
        return None

    def continued(
        self,
        t: np.ndarray,
        y: np.ndarray,
        z: np.ndarray,
        params: np.ndarray,
        first: Mapping[str, float] | None = None,
    ) -> dict[str, np.ndarray]:
        """Return the angles that no coordinate counts, by name, continued along k states.

        Those of the first are known where they are given.
        """
        del t, y, z, params, first
        return {}

    @property
    @abstractmethod
    def places(self) -> dict[str, tuple[str, ...]]:
        """The names of the entries of all states that a run keeps, by the name of the state."""

    @property
    @abstractmethod
    def _velocity(self) -> ca.SX:
        """The expression of y'."""

    @property
    def _multipliers(self) -> ca.SX | None:
        """The symbols of the multipliers, None in a system whose functions do not see any."""
        return None

    @property
    @abstractmethod
    def layout(self) -> Layout:
        """The tapes by name, but for that of the records."""

    @property
    @abstractmethod
    def _vectors(self) -> dict[str, list[str]]:
        """The names of the elements of each vector that tapes take, by the core's names."""

    def tape(self, name: str) -> Program:
        """Return a program that runs inside a step; ``print`` shows it.

        Parameters
        ----------
        name : str
            A tape, or a part of one, such as "force": then only what leads to it.

        Returns
        -------
        Program
            Registers are numbered, inputs and outputs named.

        Raises
        ------
        ValueError
            There is no such tape; the message lists those that there are.

        Examples
        --------
        >>> from liouville.problems import pendulum
        >>> print(pendulum.system.tape("reaction"))
        reaction, of node: 7 operations for reaction[0], reaction[1]
          each time:
            r13 = mul(0.5, lam[0])
            r16 = twice(q[0])
            r17 = twice(q[1])
            r19 = mul(r16, r13)
            r20 = mul(r17, r13)
            reaction[0] = neg(r19)
            reaction[1] = neg(r20)
        """
        recorder, widths = self.observer(None)
        kept = {part.removeprefix(INVARIANT): width for part, width in widths.items() if width}
        named = {x: [x] if x in self.invariants else elements(x, k) for x, k in kept.items()}
        layout = {**self.layout, "observer": (POINT, named)}
        place = next((tape for tape, (_, parts) in layout.items() if name in (tape, *parts)), None)
        if place is None:
            known = dict.fromkeys(part for _, parts in layout.values() for part in parts)
            sentence = f"there is no tape {name!r}; there are {', '.join(layout)}"
            raise ValueError(hinted(sentence, f"or name a part of one: {', '.join(known)}"))
        (vectors, parts), first = layout[place], 0
        inputs = [x for vector in vectors for x in self._vectors[vector]]
        inputs += parameters(self.symbols.params.defaults)
        outputs = [x for names in parts.values() for x in names]
        tape = recorder if place == "observer" else self.tapes[place]
        if name == place:
            return Program(name, tape, inputs, outputs)
        for part, names in parts.items():
            if part == name:
                break
            first += len(names)
        wanted = range(first, first + len(parts[name]))
        return Program(f"{name}, of {place}", tape, inputs, outputs, wanted)

    def observer(
        self, observe: Mapping[str, Function] | None, states: bool = True
    ) -> tuple[_core.Tape, dict[str, int]]:
        """Record what a run keeps besides its states; returns the tape and each part's width."""
        if observe:
            return self._observer(observe, states)
        if states not in self._observers:
            self._observers[states] = self._observer({}, states)
        return self._observers[states]

    def _observer(
        self, observe: Mapping[str, Function], states: bool
    ) -> tuple[_core.Tape, dict[str, int]]:
        s, parts = self.symbols, self._parts(states)
        columns = self.expressions.columns
        parts |= {name: columns[name] for name in (INVARIANT + each for each in self.invariants)}
        own = self._expressions_of(observe)
        parts |= {f"observed {name}": x for name, x in own.items()}
        inputs, lam = s.inputs(z=s.z), self._multipliers
        if lam is not None and ca.depends_on(ca.vertcat(ca.SX(0, 1), *own.values()), lam):
            inputs = self._inputs_of_functions
        tape = record("observer", inputs, *parts.values())
        return tape, {name: x.numel() for name, x in parts.items()}

    def measured(self, functions: Mapping[str, Function]) -> tuple[_core.Tape, dict[str, int]]:
        """Record functions of (t, y, z, params), or of (t, y, z, lam, params), and derivatives.

        Returns the tape, whose derivatives by y, z, lam and params stand one column of the Jacobian
        after another, and the width of each function.
        """
        columns = self._expressions_of(functions)
        values = ca.vertcat(ca.SX(0, 1), *columns.values())
        inputs = self._inputs_of_functions
        by = ca.vertcat(*(x for name, x in inputs.items() if name != "t"))
        tape = record("measured", inputs, values, ca.densify(ca.jacobian(values, by)))
        return tape, {name: x.numel() for name, x in columns.items()}

    def slopes_of(self, function: Function) -> tuple[_core.Tape, int]:
        """Record the Jacobian by (t, y, z, lam, params), by columns, and the function's width."""
        value, inputs = self._expression("the function", function), self._inputs_of_functions
        by = ca.vertcat(*inputs.values())
        tape = record("slopes", inputs, ca.densify(ca.jacobian(value, by)))
        return tape, value.numel()

    def _expressions_of(self, observe: Mapping[str, Function]) -> dict[str, ca.SX]:
        """Return the expressions of functions to observe, by name."""
        return {
            name: self._expression(f"observed '{name}'", function)
            for name, function in _trace.mapping("observe", observe).items()
        }

    def _expression(self, what: str, function: Function) -> ca.SX:
        """Return the expressions of a function, which may have multipliers as an argument."""
        return _trace.column(what, function, self._args_of(function))

    def _args_of(self, function: Function) -> Mapping[str, Any]:
        """Return the arguments of a function of the states, and of multipliers where it has lam."""
        has_lam = takes_multipliers(function) and self._multipliers is not None
        return self._args_of_events if has_lam else self.symbols.args

    @property
    def _inputs_of_functions(self) -> dict[str, ca.SX]:
        lam = ca.SX(0, 1) if self._multipliers is None else self._multipliers
        return self.symbols.inputs(z=self.symbols.z, lam=lam)

    @abstractmethod
    def _parts(self, states: bool) -> dict[str, ca.SX]:
        """Return the expressions that every run records, with those of states or without."""

    def portable(self, observe: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return functions to observe in a form that can be pickled."""
        return recorded(observe, self._args_of)

    @property
    def _args_of_events(self) -> dict[str, Any]:
        """The arguments of an event's functions."""
        *point, params = self.symbols.args.items()
        lam = self._multipliers
        return dict([*point, *([] if lam is None else [("lam", lam)]), params])

    @property
    def _replaceable(self) -> dict[str, ca.SX]:
        """The states that a reset replaces, the last by default."""
        return dict(zip(self.states, (self.symbols.y, self.symbols.z), strict=True))

    def event(self, name: str, event: Event) -> EventTapes:
        """Record the functions of an event, and return whether it uses the multipliers."""
        s, what = self.symbols, f"event '{name}'"
        value, law = self.event_expressions(name, event)
        lam = ca.SX(0, 1) if self._multipliers is None else self._multipliers
        needs_lam = lam.numel() > 0 and ca.depends_on(value, lam)
        inputs = s.inputs(z=s.z, lam=lam)
        tape = record(what, inputs, value)
        if event.reset is None:
            return tape, needs_lam, None
        rate = None
        if not ca.depends_on(value, ca.vertcat(s.z, lam)):
            rate = record(what, s.inputs(z=s.z), total_derivative(value, s, self._velocity))
        reset = record(f"the reset of {what}", inputs, *law)
        return tape, needs_lam, (reset, isinstance(event.reset, Impact), rate)

    def event_expressions(self, name: str, event: Event) -> tuple[ca.SX, list[ca.SX]]:
        """Return the function of an event, and its reset: of an impact restitution and gradient."""
        s, what, lam = self.symbols, f"event '{name}'", self._multipliers
        value = _trace.scalar(what, event.function, self._args_of_events)
        lam = ca.SX(0, 1) if lam is None else lam
        if not ca.depends_on(value, ca.vertcat(s.t, s.y, s.z, lam)):
            raise ValueError(
                hinted(
                    f"{what} is the same for all states",
                    "return what is to change its sign, such as "
                    f"{self.states[0]}[1] - params.height",
                )
            )
        if event.reset is None:
            return value, []
        if isinstance(event.reset, Impact):
            has_rate = not ca.depends_on(value, ca.vertcat(s.z, lam))
            return value, self._impact(what, value, event.reset, has_rate=has_rate)
        args, own = self._args_of_events, (self._replaceable, self.places)
        law = _trace.replaced(f"the reset of {what}", event.reset, args, *own)
        return value, law + [s.z] * (len(law) == 1)

    def _impact(self, what: str, value: ca.SX, impact: Impact, has_rate: bool) -> list[ca.SX]:
        """Return the restitution of an impact and the gradient of its event."""
        first, second = self.states
        if second == "z" and first == "y" and "lam" not in self._args_of_events:
            hint = "give a function of (t, y, z, params) that returns the y after it"
            raise TypeError(hinted(f"{what} has an Impact, and its system has no masses", hint))
        if not has_rate or not ca.depends_on(value, self.symbols.y):
            sentence = f"{what} has an Impact, whose gradient is that of a function of (t, {first})"
            hint = f"return what vanishes at contact, a function of {first}"
            raise ValueError(hinted(sentence, hint))
        given = impact.restitution
        if callable(given):
            which = f"the restitution of {what}"
            restitution = _trace.scalar(which, given, self._args_of_events)
        else:
            restitution = ca.SX(float(given))
        return [restitution, ca.densify(ca.gradient(value, self.symbols.y))]

    def monitor(self, function: Function) -> tuple[_core.Tape, bool]:
        """Record a function of (t, y, z) and its rate along the motion, and whether z' is in it."""
        return traced(self.symbols, self._velocity, function)

    def stepped(self, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray) -> Self:
        """Return the system as a run from this state steps it."""
        del t, y, z, params
        return self

    def states_at(
        self, t: np.ndarray, rows: np.ndarray, params: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Name all states at k points, of which rows of those that a run keeps are given."""
        del t, params
        widths = [len(names) for names in self.places.values()]
        return dict(zip(self.places, np.split(rows, np.cumsum(widths)[:-1], axis=1), strict=True))

    def describe(self, error: dict[str, Any]) -> Description:
        """Describe an error of the core in the user's names: sentence, hint and quantity."""
        return describe(error, self.coordinates, self.constraints)

    def _state(self) -> dict[str, Any]:
        self.observer(None)  # every run needs it
        return super()._state()


def traced_invariants(
    invariants: Mapping[str, Function] | None, args: _trace.Args, energy: ca.SX | None = None
) -> dict[str, ca.SX]:
    """Trace the quantities that a user wants recorded, besides the energy of the system's own.

    ValueError if one would take the place of that energy, whose drift judges a run.
    """
    given = _trace.mapping("invariants", invariants)
    if energy is not None and "energy" in given:
        sentence = "invariant 'energy' is the system's own, recorded of every run"
        raise ValueError(hinted(sentence, "leave it out, or give yours another name"))
    found = {x: _trace.scalar(f"invariant '{x}'", f, args) for x, f in given.items()}
    return found if energy is None else {"energy": energy, **found}


def traced_switches(switches: Mapping[str, Function] | None, args: _trace.Args) -> dict[str, ca.SX]:
    """Trace the functions at whose zeros controlled steps end."""
    return {
        name: _trace.scalar(f"switch '{name}'", function, args)
        for name, function in _trace.mapping("switches", switches).items()
    }


def check_moved(
    names: tuple[str, ...],
    constraints: ca.SX,
    y: ca.SX,
    what: tuple[str, str] = ("constraint", "coordinates"),
) -> None:
    """Refuse constraints that no coordinate moves, and say what they are instead."""
    moved = set(ca.sparsify(jacobian(constraints, y)).sparsity().row())
    for k, name in enumerate(names):
        if k in moved:
            continue
        value = constraints[k]
        if ca.depends_on(value, y):
            why = "it jumps, as a comparison does"
        elif value.is_constant():
            why = f"it is the number {float(value):g}"
        else:
            why = "none of them is in it"
        raise ValueError(
            hinted(
                f"{what[0]} '{name}' is the same for all {what[1]}: {why}",
                "return what is to vanish, such as x - 1 where x == 1 is meant",
            )
        )
