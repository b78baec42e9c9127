"""SymPy's polynomials and expressions as fields; SymPy is imported when it is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.fields import read_terms as _read_terms
from liouville._systems.fields.expand import Expansion, Refused, Traced
from liouville._systems.fields.polynomials import Polynomial, value_of
from liouville._systems.fields.terms import Terms
from liouville._systems.sympy.expressions import FUNCTIONS, compiled_of
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Symbols


@dataclass(frozen=True)
class Given:
    """A field as a user gives it with SymPy's symbols.

    Attributes
    ----------
    names : tuple of str
        Names of the coordinates.
    params : dict of str to float
        Parameters with their values.
    is_driven : bool
        Whether the time is among the variables.
    """

    names: tuple[str, ...]
    params: dict[str, Any]
    is_driven: bool
    expressions: tuple[Any, ...]
    variables: tuple[Any, ...]
    constants: tuple[Any, ...]

    def terms(self, values: np.ndarray) -> Terms:
        """Expand the field with numbers for its parameters."""
        reader = _Reader(self, values)
        components = [reader.component(k) for k in range(len(self.names))]
        return reader.expansion.terms(components, len(self.names) if self.is_driven else None)

    @property
    def has_cases(self) -> bool:
        """Whether the field has functions by cases."""
        import sympy

        return any(x.has(sympy.Abs, sympy.sign) for x in self.expressions)

    def column(self, s: Symbols) -> ca.SX:
        """Return the field as CasADi's expressions."""
        each = (self.function(x)(s.t, s.x, s.params.namespace) for x in self.expressions)
        found: ca.SX = ca.vertcat(*each)
        return found

    def function(self, invariant: Any) -> Any:
        """Return an expression of SymPy's as a function f(t, x, params), all else as it is."""
        import sympy

        if isinstance(invariant, sympy.Poly):
            invariant = invariant.as_expr()
        if not isinstance(invariant, sympy.Basic):
            return invariant
        known = (*self.variables, *self.constants)
        for symbol in sorted(invariant.free_symbols - set(known), key=str):
            raise ValueError(f"an invariant contains '{symbol}', which is no coordinate")
        compiled = compiled_of(known, [invariant])

        def function(t: ca.SX, x: ca.SX, params: Any) -> Any:
            time = (t,) if self.is_driven else ()
            numbers = (getattr(params, str(symbol)) for symbol in self.constants)
            return compiled(*ca.vertsplit(x), *time, *numbers)[0]

        return function


def read(
    expressions: Sequence[Any], symbols: Sequence[Any], t: Any, params: Mapping[Any, Any] | None
) -> Given:
    """Check what is given.

    Raises
    ------
    TypeError, ValueError
        A coordinate is no symbol, or their number is not that of the expressions.
    ImportError
        SymPy is not installed.
    """
    try:
        import sympy
    except ImportError as error:
        sentence = "expressions of SymPy's need sympy"
        raise ImportError(hinted(sentence, "pip install sympy")) from error

    for symbol in (*symbols, *(() if t is None else (t,))):
        if not isinstance(symbol, sympy.Symbol):
            raise TypeError(f"coordinates must be symbols of SymPy's, not {symbol!r}")
    names = _trace.names([str(symbol) for symbol in symbols], "x")
    if isinstance(expressions, sympy.MatrixBase):
        expressions = list(expressions)
    found = [x if isinstance(x, sympy.Poly) else sympy.sympify(x, strict=True) for x in expressions]
    if len(found) != len(names):
        raise ValueError(f"the field must have {len(names)} expressions, not {len(found)}")
    by_name = {str(symbol): symbol for x in found for symbol in x.free_symbols}
    constants = tuple(by_name.get(x, sympy.Symbol(str(x))) for x in map(str, params or {}))
    values = {str(name): value for name, value in (params or {}).items()}
    variables = tuple(symbols) if t is None else (*symbols, t)
    return Given(names, values, t is not None, tuple(found), variables, constants)


class _Reader:
    """Expands SymPy's trees."""

    def __init__(self, given: Given, values: np.ndarray) -> None:
        import sympy

        self.sympy = sympy
        self.given = given
        time = (_read_terms.TIME,) if given.is_driven else ()
        self.expansion = Expansion((*given.names, *time))
        self._place = {symbol: k for k, symbol in enumerate(given.variables)}
        self._number = dict(zip(given.constants, values.tolist(), strict=True))

    def component(self, k: int) -> Polynomial:
        """Expand a component, or name what keeps it from being a polynomial."""
        found = self.value(self.given.expressions[k]).value
        if isinstance(found, Refused):
            raise ValueError(f"component '{self.given.names[k]}' contains {found}")
        return found

    def value(self, expression: Any) -> Traced:
        """Expand an expression."""
        sympy, expansion = self.sympy, self.expansion
        if isinstance(expression, sympy.Poly):
            return self._poly(expression)
        if expression in self._place:
            return expansion.traced_variable(self._place[expression])
        if expression in self._number:
            return expansion.traced(self._number[expression])
        if expression.is_Rational:
            return self._rational(Fraction(int(expression.p), int(expression.q)))
        if expression.is_Symbol:
            hint = f"give it a value: params={{'{expression}': ...}}"
            raise ValueError(
                hinted(f"'{expression}' is neither a coordinate nor a parameter", hint)
            )
        if expression.is_Add or expression.is_Mul:
            operation = "add" if expression.is_Add else "mul"
            found, *others = (self.value(arg) for arg in expression.args)
            for other in others:
                found = expansion.apply(operation, found, other)
            return found
        if expression.is_Pow:
            return self._power(*(self.value(arg) for arg in expression.args))
        if not expression.free_symbols & self._place.keys():
            return self._constant(expression)
        known = FUNCTIONS.get(expression.func.__name__)
        if known is not None:
            return expansion.apply(known, *(self.value(arg) for arg in expression.args))
        return Traced(Refused(f"{expression}, which has no place on a tape"), ())

    def _rational(self, value: Fraction) -> Traced:
        return Traced(self.expansion.rational(value), ("const", float(value)))

    def _poly(self, poly: Any) -> Traced:
        total = self._rational(Fraction(0))
        gens = [self.value(gen) for gen in poly.gens]
        for exponents, coefficient in poly.terms():
            term = self.value(coefficient)
            for gen, exponent in zip(gens, exponents, strict=True):
                if exponent:
                    power = self._power(gen, self._rational(Fraction(int(exponent))))
                    term = self.expansion.apply("mul", term, power)
            total = self.expansion.apply("add", total, term)
        return total

    def _power(self, base: Traced, exponent: Traced) -> Traced:
        if isinstance(base.value, dict) and isinstance(exponent.value, dict):
            number = value_of(exponent.value)
            if number is not None and number < 0 and value_of(base.value) != 0:
                inverse = self.expansion.apply("inv", base)
                return self.expansion.apply("pow", inverse, self.expansion.apply("neg", exponent))
        return self.expansion.apply("pow", base, exponent)

    def _constant(self, expression: Any) -> Traced:
        """Evaluate what depends on parameters at most."""
        number = complex(expression.subs(self._number))
        if number.imag or not np.isfinite(number.real):
            return Traced(Refused(f"{expression}, which is {number:.6g}"), ())
        return self.expansion.traced(number.real)
