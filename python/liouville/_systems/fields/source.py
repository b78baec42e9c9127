"""Fields as expressions, which are expanded into terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._systems.fields.expand import Expansion, expand
from liouville._systems.fields.polynomials import Polynomial
from liouville._systems.fields.read_terms import TIME
from liouville._systems.fields.terms import Terms
from liouville._systems.tracing.expressions import Expressions, Symbols


class Source:
    """Expressions of a field, expanded with numbers for its parameters.

    Parameters
    ----------
    column : SX
        The components.
    symbols : Symbols
        The symbols they are of.
    names : tuple of str
        Names of the coordinates.
    is_driven : bool, default False
        Take the time as a variable even if the field does not depend on it.

    Attributes
    ----------
    is_driven : bool
        Whether the time is a variable.
    expressions : Expressions
        The components.
    """

    def __init__(
        self, column: ca.SX, symbols: Symbols, names: tuple[str, ...], is_driven: bool = False
    ) -> None:
        self.expressions = Expressions(symbols, {"field": column})
        self.is_driven = is_driven or bool(ca.depends_on(column, symbols.t))
        self._names = names
        self._variables = (*names, TIME) if self.is_driven else names

    def __call__(self, values: np.ndarray, held: Mapping[int, str] | None = None) -> Terms:
        """Multiply the components out; parameters held, by number with a name, are variables."""
        expansion, components = self._expanded(self._column, values, held)
        return expansion.terms(components, len(self._names) if self.is_driven else None)

    @property
    def _column(self) -> ca.SX:
        return self.expressions.columns["field"]

    def _expanded(
        self, column: ca.SX, values: np.ndarray, held: Mapping[int, str] | None
    ) -> tuple[Expansion, list[Polynomial]]:
        held = held or {}
        names, inputs = (*self._variables, *held.values()), tuple(self.expressions.symbols.all)
        return expand(column, inputs, values, names, [*held])

    def depends_on(self, number: int) -> bool:
        """Return whether one of the parameters' numbers is in the components."""
        return bool(ca.depends_on(self._column, self.expressions.symbols.params.vector[number]))

    def derivative(
        self, values: np.ndarray, number: int, held: Mapping[int, str] | None = None
    ) -> Terms:
        """Multiply out the derivatives of the components by one of the parameters' numbers."""
        by = ca.jacobian(self._column, self.expressions.symbols.params.vector[number])
        expansion, components = self._expanded(by, values, held)
        return expansion.terms(components)


def callable_of(field: Any, s: Symbols) -> Any:
    """Return a function that calls a CasADi function with as many arguments as that takes."""
    if not isinstance(field, ca.Function):
        return field
    args = {1: (s.x,), 2: (s.t, s.x), 3: (s.t, s.x, s.params.vector)}.get(field.n_in())
    if args is None or field.n_out() != 1:
        raise ValueError(
            f"the CasADi function '{field.name()}' must have the inputs x, or t and x, or t, x and "
            f"params, and one output, not {field.n_in()} inputs and {field.n_out()} outputs"
        )
    for k, arg in enumerate(args):
        if field.numel_in(k) != arg.numel():
            raise ValueError(
                f"input {k} of the CasADi function '{field.name()}' must have {arg.numel()} "
                f"elements, not {field.numel_in(k)}"
            )
    return lambda *_: field(*args)
