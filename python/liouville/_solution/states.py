"""The states of a solution, and the balance of its energy, as attributes; names of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from liouville._basics.arguments import Named
from liouville._basics.errors import check_name, hinted, no_attribute, public
from liouville._solution.points import STATES, Points

if TYPE_CHECKING:
    from liouville._solution.solution import Solution

Array = NDArray[Any]

#: What makes two solutions equal.
RECORDED = (
    "t", "states", "invariants", "residuals", "observed", "balance", "events", "names", "params",
    "status", "members",
)  # fmt: skip

#: Groups of arrays by name that names may be meant for which are no attributes.
GROUPS = ("invariants", "observed", "residuals", "events", "stats", "tangents")
#: What other libraries call it, and what has it here.
ELSEWHERE = {
    "success": "solution.status is 'done'",
    "nfev": "solution.stats has numbers of evaluations",
    "njev": "solution.stats has numbers of factorizations",
    "sol": "solution(t) gives the states between steps",
    "t_events": "solution.events has the times of each event by name",
    "y_events": "solution.events has the states at each event by name",
}


class Stats(TypedDict, total=False):
    """The numbers of a run, those that its method has; see :class:`liouville.Solution`."""

    steps: int
    seconds: float
    iterations: int
    evaluations: int
    cold_starts: int
    solver: str
    newton_steps: int
    factorizations: int
    rejected: int
    h_smallest: float
    h_largest: float
    h_next: float
    flows: int
    pieces: int
    products: float
    widened: int
    bound: float
    absorbed: float


class States:
    """A base of :class:`Solution`: what it has of these is known by its system and method."""

    states: dict[str, Array]
    balance: dict[str, Array]
    units: dict[str, str]

    if not TYPE_CHECKING:  # whatever has a type is there

        def __getattr__(self, name: str) -> Any:
            """Say where it is what has another place here."""
            for group in GROUPS:
                if name in self.__dict__.get(group, ()):
                    sentence = f"the solution has no attribute {name!r}"
                    raise AttributeError(hinted(sentence, f"solution.{group}[{name!r}] has it"))
            hint = ELSEWHERE.get(name) or self._column_hint(name)
            if hint:
                raise AttributeError(hinted(f"the solution has no attribute {name!r}", hint))
            if name.startswith("_") or hasattr(type(self), name):
                return object.__getattribute__(self, name)  # raises the error of its own
            raise no_attribute("'Solution' object", name, public(self))

    def __dir__(self) -> list[str]:
        """Name what there is: no state that this solution has not."""
        return [x for x in object.__dir__(self) if x not in STATES or x in self.states]

    def __getitem__(self, which: Any) -> Any:
        """Give a state, an invariant, an observed quantity or a coordinate by its name.

        Of an ensemble a number gives a member.

        Raises
        ------
        KeyError
            There is no such name.
        TypeError
            A single run has no members.
        """
        own = cast("Solution", self)
        if not isinstance(which, str):
            if own.members is not None:
                return own.member(which)
            hint = "solution.q[0] is the first of its states, solution['q'] all of them"
            raise TypeError(hinted("a single run has no members to be numbered", hint))
        for group in (own.states, own.invariants, own.observed, own.balance):
            if which in group:
                return group[which]
        columns = own.names["coordinates"] if own.states else ()
        if which in columns and "psi" not in own.states:
            return next(iter(own.states.values()))[..., columns.index(which)]
        groups = (own.states, own.invariants, own.observed, own.balance, columns)
        return Named(dict.fromkeys(name for group in groups for name in group))[which]

    def __contains__(self, name: object) -> bool:
        """Return whether there is a quantity of this name."""
        try:
            return isinstance(name, str) and self[name] is not None
        except KeyError:
            return False

    def __len__(self) -> int:
        """Return the number of members; TypeError for a single run."""
        count = cast("Solution", self).members
        if count is None:
            hint = "len(solution.t) is the number of its times"
            raise TypeError(hinted("a single run has no members to count", hint))
        return count

    def __bool__(self) -> bool:
        """Return True: there is a solution."""
        return True

    def __eq__(self, other: object) -> bool:
        """Return whether two solutions have the same records, parameters and status.

        Numbers are compared bit for bit, NaN with NaN. How it was computed does not count: method,
        statistics, and the system itself.
        """
        if not isinstance(other, States):
            return NotImplemented
        return _same([vars(self).get(x) for x in RECORDED], [vars(other).get(x) for x in RECORDED])

    def __hash__(self) -> int:
        """Return a number that equal solutions have in common."""
        own = cast("Solution", self)
        return hash((own.status, own.members, own.t.tobytes()))

    def __iter__(self) -> Iterator[Solution]:
        """Go through the members of an ensemble; TypeError for a single run."""
        own = cast("Solution", self)
        if own.members is None:
            hint = "zip(solution.t, solution.q) goes through its times"
            raise TypeError(hinted("a single run has no members to go through", hint))
        return map(own.member, range(own.members))

    def with_units(self, units: Mapping[str, str] | None = None, **named: Any) -> Solution:
        """Return the same solution with units for the axes of figures and the heads of tables.

        Parameters
        ----------
        units : mapping of str to str
            Units by quantity: ``t``, states, invariants, ``work``, ``reaction`` or observed, and
            single columns by the names that tables have: ``{"q": "m", "q[angle]": "rad"}``. They
            are words; nothing is converted.
        **named
            Refused: single columns have names that are no keywords.

        Returns
        -------
        Solution
            It shares all arrays. Files keep the units, and variables of datasets that have one unit
            have it as attribute ``units``.

        Raises
        ------
        TypeError, ValueError
            A unit is no word, or there is no such quantity.
        """
        if named:
            given = ", ".join(f"{name}={unit!r}" for name, unit in named.items())
            sentence = f"with_units takes one mapping of names to units, not {given}"
            raise TypeError(hinted(sentence, f"with_units({ {**(units or {}), **named} })"))
        if not isinstance(units, Mapping):
            raise TypeError(f"units must be a mapping of names to units, not {units!r}")
        own = cast("Solution", self)
        groups = (own.states, own.invariants, own.balance, own.observed, own.residuals)
        known = ["t", *(name for group in groups for name in group), "reaction"]
        labels = [label for names in own.names.values() for label in names]
        for name, unit in units.items():
            quantity, _, label = str(name).partition("[")
            if name not in known and not (quantity in known and label[:-1] in labels):
                check_name(str(name), known, "quantity")
            if not isinstance(unit, str) or not unit:
                raise TypeError(f"the unit of '{name}' must be a word such as 'm', not {unit!r}")
        return replace(own, units=dict(units))

    @property
    def x(self) -> Array:
        """States of a ``PolynomialField``, shape (k, n), or (k, P, n) of an ensemble."""
        return self._state("x")

    @property
    def psi(self) -> Array:
        """Wave functions of a ``Schrodinger`` equation, complex, shape (k, N) or (k, P, N)."""
        return self._state("psi")

    @property
    def psi_on_grid(self) -> Array:
        """Waves in the shape of their grid or lattice, ``(k, *shape)`` or ``(k, P, *shape)``.

        A view of ``psi``. ValueError after :func:`liouville.load`, where no grid is known.
        """
        system: Any = cast("Solution", self).system
        psi = self.psi
        if system is None:
            hint = "write solution.psi.reshape(-1, *grid.shape), and components before grid.shape"
            raise ValueError(hinted("a solution that was loaded has no grid", hint))
        return psi.reshape(*psi.shape[:-1], *system.shapes[-1])

    @property
    def q(self) -> Array:
        """Positions, shape (k, n)."""
        return self._state("q")

    @property
    def v(self) -> Array:
        """Velocities, shape (k, n)."""
        return self._state("v")

    @property
    def p(self) -> Array:
        """Momenta, shape (k, n)."""
        return self._state("p")

    @property
    def lam(self) -> Array:
        """Multipliers of the constraints, shape (k, m)."""
        return self._state("lam")

    @property
    def y(self) -> Array:
        """Positions of a ``Mechanical`` system, coordinates of a ``SemiExplicit``, shape (k, n)."""
        return self._state("y")

    @property
    def z(self) -> Array:
        """Second half of the state of a ``Mechanical`` system, shape (k, n).

        Of a ``SemiExplicit`` system its algebraic unknowns, shape (k, l).
        """
        return self._state("z")

    @property
    def acceleration(self) -> Array:
        """Accelerations, with the reactions in them, shape (k, n)."""
        return self._state("acceleration")

    @property
    def a(self) -> Array:
        r"""The method's own accelerations without the reactions, at :math:`t + \Delta h`, (k, n).

        :math:`\Delta = \alpha_m - \alpha_f`; give the last to :func:`liouville.integrate` as ``a=``
        to go on with a run.
        """
        return self._state("a")

    @property
    def work(self) -> Array:
        """Energy that forces without a potential have put in since the start, shape (k,)."""
        return self._balanced("work")

    @property
    def dissipated(self) -> Array:
        r"""Energy lost since the start, :math:`E(0) + W - E(t)`, shape (k,).

        What the damping of the method took and, in a ``Structure``, that of its damping matrix;
        with it the errors of energy and work.
        """
        return self._balanced("dissipated")

    def _balanced(self, name: str) -> Array:
        if name in self.balance:
            return self.balance[name]
        hint = (
            "HHT and its relatives record it, for a Lagrangian or a Structure; "
            "lv.analysis.power_balance(solution) finds it for every method"
        )
        raise AttributeError(hinted(f"the solution has no {name!r}", hint))

    def _column_hint(self, name: str) -> str:
        """Return where a coordinate of this name is, empty if there is none."""
        labels = self.__dict__.get("names", {}).get("coordinates", ())
        if name not in labels or not self.states:
            return ""
        first = next(iter(self.states))
        return f"coordinate {name!r} is a column: solution.{first}[..., {labels.index(name)}]"

    def _state(self, name: str) -> Array:
        if name in self.states:
            return self.states[name]
        why, hint = "", f"its states are {', '.join(self.states)}"
        if not self.states:
            why = ": the run stored no states"
            hint = "integrate with states=True, or name what you need in observe="
        hint = self._column_hint(name) or hint
        raise AttributeError(f"the solution has no {name!r}{why}\nhint: {hint}")


def _same(a: Any, b: Any) -> bool:
    """Return whether two values are the same, arrays bit for bit and NaN with NaN."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(x, b[name]) for name, x in a.items())
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, Points) and isinstance(b, Points):
        return _same([a.t, a.states], [b.t, b.states])
    if isinstance(a, np.ndarray | float) and isinstance(b, np.ndarray | float):
        x, y = np.asarray(a), np.asarray(b)
        return x.dtype == y.dtype and np.array_equal(x, y, equal_nan=x.dtype.kind in "fc")
    return bool(a == b)


def unit_of(solution: Solution, name: str, labels: Sequence[str] = ()) -> str:
    """Return the unit of a quantity, or those of some of its columns; empty if it has none."""
    units = solution.units
    own = dict.fromkeys(units.get(f"{name}[{label}]", units.get(name, "")) for label in labels)
    found = [*own] if labels else [units.get(name, "")]
    return ", ".join(found) if all(found) else ""
