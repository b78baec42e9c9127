"""Fields as expressions, which are expanded into terms."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville import _casadi as ca
from liouville.systems._expand import expand
from liouville.systems._expressions import Expressions, Symbols
from liouville.systems._read_terms import TIME
from liouville.terms import Terms


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

    Attributes
    ----------
    is_driven : bool
        Whether the field depends on time.
    expressions : Expressions
        The components.
    """

    def __init__(self, column: ca.SX, symbols: Symbols, names: tuple[str, ...]) -> None:
        self.expressions = Expressions(symbols, {"field": column})
        self.is_driven = ca.depends_on(column, symbols.t)
        self._variables = (*names, TIME) if self.is_driven else names

    def __call__(self, values: np.ndarray) -> Terms:
        """Multiply the components out."""
        symbols, column = self.expressions.symbols, self.expressions.columns["field"]
        expansion, components = expand(column, tuple(symbols.all), values, self._variables)
        return expansion.terms(components, self.is_driven)

    def derivative(self, values: np.ndarray, number: int) -> Terms:
        """Multiply out the derivatives of the components by one of the parameters' numbers."""
        symbols, column = self.expressions.symbols, self.expressions.columns["field"]
        by = ca.jacobian(column, symbols.params.vector[number])
        expansion, components = expand(by, tuple(symbols.all), values, self._variables)
        return expansion.terms(components)


def callable_of(field: Any, s: Symbols) -> Any:
    """Return a function that calls a CasADi function with as many arguments as that takes."""
    if not isinstance(field, ca.Function):
        return field
    args = {1: (s.x,), 2: (s.t, s.x), 3: (s.t, s.x, s.params.vector)}.get(field.n_in())
    if args is None or field.n_out() != 1:
        raise ValueError(
            f"the CasADi function '{field.name()}' has {field.n_in()} inputs and {field.n_out()} "
            "outputs, wanted x, or t and x, or t, x and params, and one output"
        )
    for k, arg in enumerate(args):
        if field.numel_in(k) != arg.numel():
            raise ValueError(
                f"input {k} of the CasADi function '{field.name()}' has {field.numel_in(k)} "
                f"elements, wanted {arg.numel()}"
            )
    return lambda *_: field(*args)
