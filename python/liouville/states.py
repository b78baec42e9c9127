"""The states of a solution, and the balance of its energy, as attributes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from numpy.typing import NDArray

from liouville.errors import check_name, hinted

if TYPE_CHECKING:
    from liouville.solution import Solution

Array = NDArray[Any]

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
            return object.__getattribute__(self, name)  # raises the error of its own

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
            raise TypeError(f"units is a mapping of names to units, not {units!r}")
        own = cast("Solution", self)
        groups = (own.states, own.invariants, own.balance, own.observed, own.residuals)
        known = ["t", *(name for group in groups for name in group), "reaction"]
        labels = [label for names in own.names.values() for label in names]
        for name, unit in units.items():
            quantity, _, label = str(name).partition("[")
            if name not in known and not (quantity in known and label[:-1] in labels):
                check_name(str(name), known, "quantity")
            if not isinstance(unit, str) or not unit:
                raise TypeError(f"the unit of '{name}' is a word such as 'm', not {unit!r}")
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
            "lv.power_balance(solution) finds it for every method"
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


def unit_of(solution: Solution, name: str, labels: Sequence[str] = ()) -> str:
    """Return the unit of a quantity, or those of some of its columns; empty if it has none."""
    units = solution.units
    own = dict.fromkeys(units.get(f"{name}[{label}]", units.get(name, "")) for label in labels)
    found = [*own] if labels else [units.get(name, "")]
    return ", ".join(found) if all(found) else ""
