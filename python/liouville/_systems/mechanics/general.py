"""The general form all mechanical systems are reduced to, as tapes for the core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.arguments import amount
from liouville._basics.errors import hinted, quoted, shown
from liouville._systems.mechanics import motion as _motion
from liouville._systems.mechanics.consistent import project
from liouville._systems.mechanics.form import (
    Model,
    Nonholonomic,
    compiled,
    is_separable,
    kept_or_lost,
    observing,
    second_order,
    separable,
    total_derivative,
)
from liouville._systems.mechanics.singular import nearly_dependent
from liouville._systems.mechanics.traced import SWITCH, TracedSystem
from liouville._systems.mechanics.violations import FLOOR, TOLERANCE, finite_time, missed
from liouville._systems.program import elements
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Symbols
from liouville._systems.tracing.layout import Layout, of_mechanics

if TYPE_CHECKING:
    from liouville._runs.contacts.traced import Contacts
    from liouville._systems.mechanics.contact import Contact

#: The hint where a start violates a constraint.
ONTO = "system.consistent({}=..., {}=...) moves a start onto its constraints"

#: A state that violates a constraint, by its number; the kind and the number of the constraint, its
#: value and the largest allowed.
Violation = tuple[int, str, int, float, float]


class Mechanics(TracedSystem):
    r"""A mechanical system in the general form, made by one of its public constructors.

    .. math::

        y' = v(t, y, z), \quad \frac{d}{dt} p(t, y, z) = f(t, y, z) + r(t, y, \lambda), \quad
        0 = g(t, y)

    with the hidden constraint :math:`w := g_t + g_y v`. Nonholonomic constraints
    :math:`0 = k(t, y, z)` add reactions :math:`r_n(t, y, z, \nu)` of their own. All derivatives and
    their sparsity come from CasADi; parameters stay symbolic.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    constraints : tuple of str
        Names of the m holonomic constraints, then of the l nonholonomic ones.
    holonomic, nonholonomic : tuple of str
        The same apart.
    states : tuple of str
        What its coordinates and their partner are called: ("q", "v"), ("q", "p") or ("y", "z").
    invariants : tuple of str
        Names of what is recorded along a run, "energy" among them where there is one.
    is_conservative : bool
        Whether nothing changes the energy: no time, no force without a potential, no damping, and
        no constraint on velocities that asks for motion.
    gains_energy : bool
        Whether something does, of a system whose energy is recorded.
    may_only_lose : bool
        Whether that is nothing but forces of the state, which may be damping.
    model, symbols, expressions, tapes, patterns
        Expressions of CasADi, what they are of, and their programs, for the rest of the library.
    """

    problem: _core.Mechanical
    #: What its contacts are, traced; None where it has none.
    contacts: Contacts | None = None

    def __init__(
        self,
        symbols: Symbols,
        model: Model,
        *,
        states: tuple[str, str],
        coordinates: tuple[str, ...],
        constraints: tuple[str, ...],
        invariants: Mapping[str, ca.SX],
        power: ca.SX | None = None,
        switches: Mapping[str, ca.SX] | None = None,
    ) -> None:
        self.coordinates = coordinates
        self.constraints = constraints
        m = model.g.numel()
        self.holonomic, self.nonholonomic = constraints[:m], constraints[m:]
        self.states = states
        self.model, self._linear, self.is_ideal = model, model.linear, model.is_ideal
        own, columns = model.nonholonomic, {name: getattr(model, name) for name in "vpfrg"}
        columns |= {"k": own.k, "rn": own.rn, **({} if power is None else {"power": power})}
        columns |= {SWITCH + name: x for name, x in (switches or {}).items()}
        self._keep(Expressions(symbols, columns, lam=model.lam, nu=own.nu), invariants)
        self.is_conservative, self.may_only_lose = kept_or_lost(symbols, model, power)
        self.gains_energy = power is not None and not self.is_conservative
        self._recorded: dict[str, Any] = {}
        at = symbols.inputs(z=symbols.z, lam=self._multipliers)
        found = (switches or {}).items()
        self.switch_tapes = {name: record(f"switch '{name}'", at, x) for name, x in found}
        self.tapes, self.patterns, self.problem = compiled(symbols, model)

    def check_smooth(
        self, what: str, hint: str = "lv.integrate, lv.ensemble, lv.vjp and lv.fit take them"
    ) -> None:
        """Refuse contacts where what is asked for knows of none."""
        if self.contacts is not None:
            names = quoted(self.contacts.names)
            sentence = f"{what} knows of no contacts, and the system has {names}"
            raise TypeError(hinted(sentence, hint))

    def _touch(self, contacts: Mapping[str, Contact] | None, impacts: str) -> None:
        """Give the system contacts."""
        if contacts:
            # imported here: few systems have them
            from liouville._runs.contacts.traced import Contacts

            self.contacts = Contacts(self, contacts, impacts)

    @cached_property
    def model(self) -> Model:
        columns, more = self.expressions.columns, self.expressions.more
        own = Nonholonomic(columns["k"], columns["rn"], more["nu"])
        v, p, f, r, g = (columns[name] for name in "vpfrg")
        return Model(v, p, f, r, g, more["lam"], own, self._linear, self.is_ideal)

    def _state(self) -> dict[str, Any]:
        self.observer(None)  # every run needs it
        if "energy" in self.invariants and (self.is_conservative or self.may_only_lose):
            _motion.energies(self)
        return {name: x for name, x in self.__dict__.items() if name != "model"}

    def _restore(self, state: dict[str, Any]) -> None:
        super()._restore(state)
        if self.contacts is not None:
            self.contacts.system = self

    def __repr__(self) -> str:
        """Name the kind of system and its coordinates."""
        counts = [amount(len(self.holonomic), "constraint")] * bool(
            self.holonomic or not self.nonholonomic
        )
        counts += [f"{len(self.nonholonomic)} nonholonomic"] * bool(self.nonholonomic)
        return f"{type(self).__name__}({shown(self.coordinates)}; {', '.join(counts)})"

    def start(self, start: Mapping[str, Any], also: tuple[str, ...] = ()) -> tuple[np.ndarray, ...]:
        """Check start values and return them as arrays of shape (n,).

        Those named in `also` may be left out; a method starts them itself.

        Raises
        ------
        TypeError
            One of the two is missing or no array of numbers, or there is another.
        ValueError
            One has a wrong shape, an unknown coordinate, or is not finite.
        """
        takes = f"takes {self.states[0]}= and {self.states[1]}="
        for name in start:
            if name not in self.states and name not in also:
                raise TypeError(f"'{name}' is no start value of this system, which {takes}")
        for name in self.states:
            if name not in start:
                raise TypeError(f"start value '{name}' is missing: this system {takes}")
        given = (*self.states, *(name for name in also if start.get(name) is not None))
        return tuple([_trace.vector(name, start[name], self.coordinates) for name in given])

    def check(
        self,
        t: float,
        y: np.ndarray,
        z: np.ndarray,
        params: np.ndarray,
        hint: str = ONTO,
        *,
        hidden: bool = True,
    ) -> None:
        """Refuse a start that violates the constraint or, if asked, the hidden constraint."""
        found = self.violation(t, y[None], z[None], params[None], hidden=hidden)
        if found is not None:
            raise ValueError(self.violated(found, t, hint.format(*self.states)))

    def violation(
        self, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray, *, hidden: bool
    ) -> Violation | None:
        """Return the first of P states that violates a constraint, and how; None if all are fine.

        `params` has a row for each state, or one for all.
        """
        if not self.constraints:
            return None
        limits = (TOLERANCE, FLOOR, self.kinds)
        return _core.violation(self.problem, params, t, (y, z), limits, hidden)

    @property
    def kinds(self) -> Sequence[int]:
        """The kind of each coordinate, those of one kind having one unit; empty where all have."""
        return ()

    def violated(self, violation: Violation, t: float, hint: str) -> str:
        """Return the fault of a start, in the user's names."""
        _, kind, index, value, limit = violation
        (first, second), own = self.states, self.holonomic
        what, symbol, names = {
            "constraint": ("constraint", f"g({first})", own),
            "hidden": ("hidden constraint", f"g_t + g_{first} v", own),
            "nonholonomic": ("nonholonomic constraint", f"k({first}, {second})", self.nonholonomic),
        }[kind]
        return missed(what, symbol, names[index], value, limit, t, hint)

    def nearly_dependent(self, t: float, y: np.ndarray, params: np.ndarray) -> tuple[str, ...]:
        """Name the holonomic constraints whose gradients are nearly dependent at a point."""
        values = self.at_point("node_blocks", params, t, y, np.zeros(len(self.holonomic)))
        pattern = self.patterns["g_y"]
        return nearly_dependent(pattern, values[: len(pattern[2])], self.holonomic)

    def consistent(
        self,
        t: float = 0.0,
        params: Mapping[str, ArrayLike] | None = None,
        hold: str | None = None,
        **start: Any,
    ) -> dict[str, Any]:
        r"""Move a start onto the constraints by the least change in the mass metric.

        Positions are moved by :math:`M^{-1} g_y^T \mu` until :math:`g = 0`, which from afar is the
        least change only nearly, then velocities (or momenta) by the same directions, and those
        of nonholonomic constraints, until :math:`g_t + g_y v = 0` and :math:`k = 0`.

        Parameters
        ----------
        t : float, default 0
            Time, for constraints that depend on it.
        params : mapping, optional
            Parameters that differ from their defaults.
        hold : str, optional
            What must not move: the name of the positions ("q" or "y"), which must satisfy g = 0
            already, or of their partner ("v", "p" or "z"), for which positions are sought that
            satisfy all constraints.
        **start : array_like
            Start values near the constraints, by the system's names, each of shape (n,). As for
            :func:`liouville.ensemble` they, and the parameters, may have a row for each of P
            members.

        Returns
        -------
        dict of str to ndarray
            Start values for :func:`liouville.integrate`, or of shape (P, n) for ``ensemble``.

        Raises
        ------
        TypeError, ValueError
            An argument is wrong, or no consistent start is found near the one given.
        """
        # imported here, as it checks systems of this class
        from liouville._systems import members

        many = members.consistent(self, start, params, t=t, hold=hold)
        if many is not None:
            return many
        t = finite_time(t)
        y, z = self.start(start)
        values = self.values(params)
        first, second = self.states
        if hold not in (None, first, second):
            raise ValueError(f"hold must be '{first}', '{second}' or None, not {hold!r}")
        if self.constraints:
            if hold is None:
                y = project(self, "positions", t, y, z, values)
            elif hold == second:
                y = project(self, "both", t, y, z, values)
            if hold != second:
                z = project(self, "partner", t, z, y, values)
            self.check(t, y, z, values, f"without hold={hold!r} there may be a start nearby")
        return {first: y, second: z}

    @cached_property
    def is_autonomous(self) -> bool:
        """Whether time has no part in its functions."""
        columns = self.expressions.columns.values()
        return not any(ca.depends_on(x, self.symbols.t) for x in columns)

    @cached_property
    def second_order(self) -> _core.SecondOrder:
        """The system as a second order equation.

        Raises
        ------
        TypeError
            The velocity is not z, or the momentum is not linear in it.
        """
        return _core.SecondOrder(
            self.problem,
            *second_order(self.symbols, self.model, self.expressions.columns.get("power")),
        )

    @cached_property
    def separable(self) -> _core.Separable | None:
        """The system for RATTLE, where v and p depend on z only and f on (t, y) only; else None."""
        if not is_separable(self.symbols, self.model):
            return None
        return _core.Separable(self.problem, separable(self.symbols, self.model))

    def reaction(
        self,
        t: np.ndarray,
        y: np.ndarray,
        lam: np.ndarray,
        params: Mapping[str, ArrayLike] | None = None,
        z: np.ndarray | None = None,
    ) -> np.ndarray:
        r"""Return the generalised reaction forces :math:`r(t, y, \lambda)` at k points.

        Those of nonholonomic constraints are among them.

        Parameters
        ----------
        t : ndarray, shape (k,)
            Times.
        y : ndarray, shape (k, n)
            Positions.
        lam : ndarray, shape (k, m)
            Multipliers, those of nonholonomic constraints last.
        params : mapping of str to array_like, optional
            Parameters in the place of the defaults.
        z : ndarray, shape (k, n), optional
            Velocities or momenta, which reactions of nonholonomic constraints depend on.

        Returns
        -------
        ndarray, shape (k, n)
            The forces on the coordinates.

        Raises
        ------
        TypeError
            There are nonholonomic constraints, and z is missing.
        ValueError
            There is no such parameter.
        """
        values, m, own = self.values(params), len(self.holonomic), len(self.nonholonomic)
        lam = np.reshape(lam, (np.size(t), m + own))
        forces = self.map_tape("node", values, t, y, lam[:, :m])[:, m:]
        if own:
            if z is None:
                raise TypeError("reactions of nonholonomic constraints depend on z: give z=")
            forces = forces + self.map_tape("nonholonomic", values, t, y, z, lam[:, m:])[:, own:]
        return forces

    def map_tape(self, name: str, params: np.ndarray, *args: ArrayLike) -> np.ndarray:
        k = np.size(args[0])
        rows = [np.ascontiguousarray(np.reshape(x, (k, -1)), dtype=float) for x in args]
        return self.tapes[name].map(params, rows)

    def at_point(self, name: str, params: np.ndarray, *args: ArrayLike) -> np.ndarray:
        values: np.ndarray = self.map_tape(name, params, *args)[0]
        return values

    def stepped(self, t: float, y: np.ndarray, z: np.ndarray, params: np.ndarray) -> Mechanics:
        """Return the system without constraints that the others imply around this state."""
        if len(self.constraints) < 2:
            return self
        # imported here, as it makes systems of this class
        from liouville._systems.mechanics.redundant import redundant, without

        return without(self, redundant(self, t, y, z, params))

    def states_at(
        self, t: np.ndarray, rows: np.ndarray, params: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Name all states at k points, of which rows (y, z, lam) are given."""
        own, (tape, widths) = super().states_at(t, rows, params), self._states_tape
        y, z = (own[name] for name in self.states)
        args = [np.ascontiguousarray(x) for x in (t.reshape(-1, 1), y, z)]
        cuts = np.cumsum([*widths.values()])[:-1]
        more = np.split(tape.map(params, args), cuts, axis=1)
        return own | dict(zip(widths, more, strict=True))

    @cached_property
    def _states_tape(self) -> tuple[_core.Tape, dict[str, int]]:
        """The tape of what (y, z) are not called, p and v, with the width of each."""
        s, model = self.symbols, self.model
        parts = {"p": model.p, "v": model.v}
        parts = {name: x for name, x in parts.items() if name != self.states[1]}
        tape = record("states", s.inputs(z=s.z), *parts.values())
        widths = {name: x.numel() for name, x in parts.items()}
        return observing(tape, widths, model.linear), widths

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """The names of the entries of all states that a run keeps, by the name of the state."""
        first, second = self.states
        return {first: self.coordinates, second: self.coordinates, "lam": self.constraints}

    @property
    def layout(self) -> Layout:
        return of_mechanics(self)

    @property
    def _vectors(self) -> dict[str, list[str]]:
        (first, second), n = self.states, len(self.coordinates)
        lam, m = elements("lam", len(self.constraints)), len(self.holonomic)
        states = {"y": elements(first, n), "z": elements(second, n)}
        return {"t": ["t"], **states, "lam": lam[:m], "nu": lam[m:]}

    @property
    def _velocity(self) -> ca.SX:
        return self.model.v

    @property
    def _multipliers(self) -> ca.SX:
        return ca.vertcat(self.model.lam, self.model.nonholonomic.nu)

    def _parts(self, states: bool) -> dict[str, ca.SX]:
        s, model = self.symbols, self.model
        parts: dict[str, ca.SX] = {}
        if states:
            parts |= {"p": model.p} if self.states[1] != "p" else {}
            parts |= {"v": model.v} if self.states[1] != "v" else {}
        elif self.is_conservative:
            parts["kinetic"] = ca.dot(model.p, model.v) / 2
        parts |= {"constraint": model.g, "hidden": total_derivative(model.g, s, model.v)}
        return parts | ({"nonholonomic": model.nonholonomic.k} if self.nonholonomic else {})

    def _observer(
        self, observe: Mapping[str, Any], states: bool
    ) -> tuple[_core.Tape, dict[str, int]]:
        tape, widths = super()._observer(observe, states)
        return observing(tape, widths, self._linear), widths
