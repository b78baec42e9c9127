"""The forces on charged particles, as terms: polynomials, or one program of them all."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain

import numpy as np

from liouville._basics import casadi as ca
from liouville._systems.fields.expand import expand
from liouville._systems.fields.functions import Opaque
from liouville._systems.fields.source import Source
from liouville._systems.fields.terms import Function, Terms
from liouville._systems.tape import record
from liouville._systems.tracing.expressions import Expressions, Symbols

#: Fields of more terms, or of a higher degree, are one program.
MOST_TERMS, MOST_DEGREE = 40, 4

#: The numbers of velocities, or momenta.
V = (3, 4, 5)


class Forces(Source):
    """Terms of x' = v, v' = w x v + e with w = -(q/m) B and e = (q/m) E, by x alone.

    Of relativistic particles w is divided by gamma, and so is v in x'.

    Parameters
    ----------
    symbols : Symbols
        The symbols of time, the six coordinates and the parameters.
    names : tuple of str
        Names of the coordinates.
    magnetic, electric : SX
        B and E.
    is_relativistic : bool
        Whether there is a parameter c.

    Attributes
    ----------
    has_b, has_e : bool
        Whether they are there.
    size : int
        How many of their components there are.
    """

    def __init__(
        self,
        symbols: Symbols,
        names: tuple[str, ...],
        magnetic: ca.SX,
        electric: ca.SX,
        is_relativistic: bool,
    ) -> None:
        given = symbols.params.namespace
        part, v = given.charge / given.mass, symbols.x[3:]
        inverse = 1 / ca.sqrt(1 + ca.dot(v, v) / given.c**2) if is_relativistic else ca.SX(1)
        turned = ca.cross(v * inverse, magnetic)
        column = ca.vertcat(v * inverse, part * (electric + turned))
        super().__init__(column, symbols, names)
        rates = ca.vertcat(-part * magnetic, part * electric)
        columns = {"field": column, "rates": rates, "inverse": inverse}
        self.expressions = Expressions(symbols, columns)
        self.has_b, self.has_e = (not x.is_zero() for x in (magnetic, electric))
        self.size = sum(not rates[k].is_zero() for k in range(6))
        self._is_relativistic = is_relativistic

    def __call__(self, values: np.ndarray, held: Mapping[int, str] | None = None) -> Terms:
        """Return all terms of the field; parameters held, by number with a name, are variables."""
        rates, n = self.rates(values, held), len(self._variables) + len(held or {})
        parts = [self.drift(values, held)]
        for k in range(3):
            j, m = (k + 1) % 3, (k + 2) % 3
            for sign, row, factor in ((1, j, m), (-1, m, j)):
                parts.append(_moved(rates, row, V[k], V[factor]).scaled(sign))
            parts.append(_moved(rates, 3 + k, V[k]))
        found = Terms.none(n).joined(*parts).to_float()
        return found.merged()

    def drift(self, values: np.ndarray, held: Mapping[int, str] | None = None) -> Terms:
        """Return the terms of x', and of the time where it is a variable."""
        names = (*self._variables, *(held or {}).values())
        rows: list[tuple[int, float, tuple[int, ...]]]
        rows = [(6, 1.0, ())] if self.is_driven else []
        functions: tuple[Function, ...] = ()
        if self._is_relativistic:
            functions = self._gamma(values, held)
        more = (len(names),) if functions else ()
        rows += [(k, 1.0, (V[k], *more)) for k in range(3)]
        return Terms.of(len(names), rows, functions).to_float()

    def rates(self, values: np.ndarray, held: Mapping[int, str] | None = None) -> Terms:
        """Return w, components 0 to 2, and e, components 3 to 5, as terms."""
        names = (*self._variables, *(held or {}).values())
        found = self._expanded_rates(names, values, held)
        found = self._recorded_rates(names, values, held) if found is None else found
        if not self._is_relativistic:
            return found
        functions = self._gamma(values, held)
        alone = Terms(len(names), np.zeros(1), np.ones(1), np.array([[len(names)]]), functions)
        return _product(found.selected(found.component < 3), alone).joined(
            found.selected(found.component >= 3)
        )

    def _expanded_rates(
        self, names: tuple[str, ...], values: np.ndarray, held: Mapping[int, str] | None
    ) -> Terms | None:
        """Return the rates multiplied out, None where they are no short polynomials."""
        inputs = tuple(self.expressions.symbols.all)
        column = self.expressions.columns["rates"]
        try:
            expansion, parts = expand(column, inputs, values, names, [*(held or {})])
            if any(isinstance(function, Opaque) for function in expansion.functions):
                return None
            found = expansion.terms(parts).to_float()
        except (ValueError, OverflowError):
            return None
        is_short = len(found) <= MOST_TERMS and found.degree <= MOST_DEGREE
        return found if is_short else None

    def _recorded_rates(
        self, names: tuple[str, ...], values: np.ndarray, held: Mapping[int, str] | None
    ) -> Terms:
        """Return the rates as the values of one program."""
        what = " and ".join(["B"] * self.has_b + ["E"] * self.has_e)
        places = tuple(k for k in range(len(names)) if k not in V)
        column, functions = self._program(what, "rates", places, values, held)
        rows: list[tuple[int, float, tuple[int, ...]]] = []
        for k in range(6):
            if k in functions:
                rows.append((k, 1.0, (len(names) + [*functions].index(k),)))
            elif not column[k].is_zero():
                rows.append((k, float(column[k]), ()))
        return Terms.of(len(names), rows, tuple(functions.values())).to_float()

    def _gamma(self, values: np.ndarray, held: Mapping[int, str] | None) -> tuple[Function, ...]:
        """Return 1/gamma, of the velocities."""
        _, functions = self._program("1/gamma", "inverse", V, values, held)
        return tuple(functions.values())

    def _program(
        self,
        what: str,
        name: str,
        places: tuple[int, ...],
        values: np.ndarray,
        held: Mapping[int, str] | None,
    ) -> tuple[ca.SX, dict[int, Function]]:
        """Return a column with numbers for parameters, and what in it depends on variables.

        That is one program, and each number that it gives is a function.
        """
        symbols, numbers = self.expressions.symbols, self.expressions.symbols.params.vector
        held, column = held or {}, self.expressions.columns[name]
        rest = [k for k in range(numbers.numel()) if k not in held]
        column = ca.substitute(column, numbers[rest], ca.DM(values[rest]))
        variables = [*ca.vertsplit(symbols.x), *[symbols.t] * self.is_driven]
        wanted = [*places, *range(len(variables), len(variables) + len(held))]
        variables += [numbers[number] for number in held]
        used = tuple(k for k in dict.fromkeys(wanted) if ca.depends_on(column, variables[k]))
        if not used:
            return column, {}
        x = ca.vertcat(*(variables[k] for k in used))
        there = [k for k in range(column.numel()) if ca.depends_on(column[k], x)]
        numbers_of = ca.densify(ca.vertcat(*(column[k] for k in there)))
        by = ca.densify(ca.vec(ca.jacobian(numbers_of, x).T))
        inputs = {"x": x, "params": ca.SX(0, 1)}
        value, slopes, guards = (
            record(what, inputs, part) for part in (numbers_of, by, ca.SX(0, 1))
        )
        key = (name, values.tobytes(), tuple(held))
        return column, {
            k: Function(used, (*key, output), what, value, slopes, guards, output)
            for output, k in enumerate(there)
        }

    def derivative(
        self, values: np.ndarray, number: int, held: Mapping[int, str] | None = None
    ) -> Terms:
        """Refuse derivatives of terms: a parameter becomes a variable for them."""
        raise ValueError("parameters of charged particles are held")


def _moved(rates: Terms, row: int, to: int, *factors: int) -> Terms:
    """Return a component as that of another variable, times variables."""
    part = rates.selected(rates.component == row)
    more = np.tile(np.array(factors, dtype=np.int64), (len(part), 1))
    variables = np.hstack([part.variables, more])
    return Terms(rates.n, np.full(len(part), to), part.coefficient, variables, part.functions)


def _product(left: Terms, right: Terms) -> Terms:
    """Return the terms of a field, each times one function."""
    functions = tuple(dict.fromkeys(chain(left.functions, right.functions)))
    number = left.n + functions.index(right.functions[0])
    variables = np.hstack([left.variables, np.full((len(left), 1), number)])
    return Terms(left.n, left.component, left.coefficient, variables, functions)
