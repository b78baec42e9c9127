"""Polynomial vector fields without divergence."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from copy import copy
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from liouville._systems.fields import read_terms as _read_terms
from liouville._systems.fields.divergence import check_divergence, check_rounding
from liouville._systems.fields.field import Field
from liouville._systems.fields.observer import Observer
from liouville._systems.fields.source import Source, callable_of
from liouville._systems.fields.terms import Terms, Wave
from liouville._systems.sympy import fields as _sympy
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Symbols

Function = Callable[..., Any]
Made = TypeVar("Made")

#: So many plans are kept with a field.
MOST_KEPT = 8


class PolynomialField(Field):
    r"""A polynomial vector field without divergence.

    .. math::

        x' = f(t, x), \qquad f_i(t, x) = \sum_j c_{ij}(t)\, x_1^{j_1} \cdots x_n^{j_n}, \qquad
        \sum_i \frac{\partial f_i}{\partial x_i} = 0

    Its flow preserves volume. The divergence vanishes if for every monomial :math:`x^j` the sum
    :math:`\sum_i (j_i + 1) c_i` does, where :math:`c_i` is the coefficient of :math:`x_i x^j` in
    :math:`f_i`. This is checked when the field is made. Sines and cosines of affine functions of t
    and x may be factors too, and so may any function of t and of other coordinates than that of
    the component: ``exp(-t)``, a table of t, ``sqrt(1 + y**2)`` in the component of x.

    Parameters
    ----------
    field : callable
        ``field(t, x, params)``: n expressions, or a dict of those that are not zero by coordinate
        names. A CasADi ``Function`` of x, of t and x, or of t, x and all parameters as one column
        is taken too. It is called once; its products and powers are multiplied out exactly.
    x : sequence of str, or int
        Names of the n coordinates, or their number.
    params : mapping of str to float or 1-D array_like, optional
        Parameters by name, with default values; functions have ``params.name``. Coefficients may
        depend on them in any way.
    invariants : mapping of str to callable or array, optional
        Quantities to record: functions ``f(t, x, params)``; or, much faster for a million
        coordinates, a matrix A for :math:`x^T A x`, sparse or not, of shape (n, n) or, if diagonal,
        (n,); or one of shape (1, n) for a linear function of x.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    states : tuple of str
        What a start and a solution call the state: ("x",).
    terms : Terms
        The terms of the field; if it is driven, the time is a further variable, with velocity 1.
    is_driven : bool
        Whether the field depends on time.

    Raises
    ------
    TypeError
        An argument is of the wrong kind.
    ValueError
        The field has a divergence or is zero, or a component has a function of its own coordinate
        that is no polynomial; the message names the monomials, or the component and the function.

    Notes
    -----
    Numbers of a function that are fractions with numerator and denominator up to :math:`2^{31}`,
    such as 3, 0.75 or the 3 in ``x / 3``, are taken as they stand: if all are, the coefficients are
    rational, ``terms.is_exact``, and so is the check. Otherwise, as with 0.1, the coefficients are
    floats, rounded once; one that roundoff of the constants could have made is taken for zero, and
    a divergence is taken for zero up to 64 units in the last place of its terms.

    References
    ----------
    :cite:t:`mclachlan2008`, :cite:t:`hairer2006`, section VI.9.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville._systems import PolynomialField
    >>> def rotation(t, x, params):
    ...     return [params.a * x[1] * x[2], -x[0] * x[2], (1 - params.a) * x[0] * x[1]]
    >>> PolynomialField(rotation, x=("x", "y", "z"), params={"a": 0.5})
    PolynomialField(x, y, z; 3 terms of degree 2)
    >>> def sprott(t, x, params):
    ...     return [x[1], -x[0] + x[1] * x[2], 1 - x[1] ** 2]
    >>> PolynomialField(sprott, x=("x", "y", "z"))
    Traceback (most recent call last):
    ...
    ValueError: the field is not divergence-free: div f contains 1 * z
    hint: ...
    """

    #: Values derived from the terms, by their purpose.
    _kept: Mapping[Hashable, Any]
    _sympy: Any

    def __init__(
        self,
        field: Function,
        *,
        x: Sequence[str] | int,
        params: Mapping[str, ArrayLike] | None = None,
        invariants: Mapping[str, Any] | None = None,
    ) -> None:
        names = _trace.names(x, "x")
        s = Symbols(_trace.Parameters(params), {"x": len(names)})
        column = _trace.placed("field", callable_of(field, s), s.args, names)
        source = Source(column, s, names)
        self._build(names, s, source, source.is_driven, invariants)

    def _build(
        self,
        names: tuple[str, ...],
        symbols: Symbols,
        source: Callable[..., Terms],
        is_driven: bool,
        invariants: Mapping[str, Any] | None,
    ) -> Self:
        self.coordinates = names
        self.is_driven = is_driven
        self.symbols = symbols
        self._source = source
        self._observer, self._recorded = Observer(symbols, invariants), {}
        self._values = self.values(None)
        self.terms, self._kept = self._expanded(self._values), {}
        return self

    def kept(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return the object kept under this key, or make it and keep it."""
        found: Made | None = self._kept.get(key)
        if found is None:
            found = make()
            # those before stay as they are, for other threads
            self._kept = dict([*self._kept.items()][1 - MOST_KEPT :]) | {key: found}
        return found

    def _state(self) -> dict[str, Any]:
        """Return the attributes to pickle: without parameters neither terms nor waves change."""
        own = self.__dict__ | {"_kept": {}}
        may_bend = not all(isinstance(x, Wave) for x in self.terms.functions)
        return own if self._values.size or may_bend else own | {"_source": None}

    @property
    def _traced(self) -> Source:
        """The components as expressions, of a field with parameters."""
        if isinstance(self._source, Source):
            return self._source
        given, s = self._sympy, self.symbols
        return self.kept("traced", lambda: Source(given.column(s), s, given.names, self.is_driven))

    @property
    def expressions(self) -> Expressions | None:
        """The components as expressions, None where the field is known by terms."""
        return self._source.expressions if isinstance(self._source, Source) else None

    def _expanded(self, values: np.ndarray) -> Terms:
        try:
            terms = self._traced(values, self.held) if self.held else self._source(values)
        except OverflowError:
            raise ValueError("a coefficient of the field is too large for a float") from None
        check_divergence(terms, self.variables)
        return terms

    @classmethod
    def from_terms(
        cls,
        x: Sequence[str] | int,
        terms: Any,
        *,
        invariants: Mapping[str, Any] | None = None,
        repair: bool = False,
    ) -> Self:
        r"""Make a field from its terms.

        Parameters
        ----------
        x : sequence of str, or int
            Names of the n coordinates, or their number.
        terms : iterable of tuple, or tuple of three ndarray
            Terms ``(component, coefficient, variables)``. The component is an index or a name. The
            coefficient is a number, or a string such as ``"-3/8"``; if none is a float, all are
            kept and checked as fractions. The variables are indices or names, each as often as its
            power says: ``("x", "y", "y")`` is x*y**2, and ``()`` is 1. Powers can be given instead
            as a mapping, ``{"x": 1, "y": 2}``. The name t, if no coordinate has it, is the time.

            Or, for millions of terms, arrays: components of shape (N,), coefficients of shape (N,),
            taken as floats, and indices of variables of shape (N, d), -1 where there are less.
        invariants : mapping, optional
            As for :class:`PolynomialField`.
        repair : bool, default False
            Take the nearest field with these terms that has no divergence, for coefficients that
            were rounded. From each :math:`c_i` of a monomial of the divergence is subtracted
            :math:`w_i \sum_l w_l c_l / \sum_l w_l^2` with :math:`w_i = j_i + 1`. A sum
            :math:`|\sum_l w_l c_l|` above :math:`10^{-3} \sum_l w_l |c_l|` is no rounding and is
            refused.

        Returns
        -------
        PolynomialField

        Raises
        ------
        TypeError, ValueError
            A term is malformed, which is named by its number from 0; there is more to repair
            than rounding; or as for :class:`PolynomialField`.

        Examples
        --------
        >>> from liouville._systems import PolynomialField
        >>> terms = [("x", 1, ("y",)), ("y", -1, ("x",)), ("y", 1, ("y", "z")), ("z", 1, ())]
        >>> PolynomialField.from_terms(("x", "y", "z"), [*terms, ("z", "-1/2", {"z": 2})])
        PolynomialField(x, y, z; 5 terms of degree 2)
        """
        names = _trace.names(x, "x")
        found, is_driven = _read_terms.read(names, terms)
        if repair:
            check_rounding(found, (*names, _read_terms.TIME) if is_driven else names)
            found = found.repaired()
        symbols = Symbols(_trace.Parameters(None), {"x": len(names)})
        return cls.__new__(cls)._build(names, symbols, lambda _: found, is_driven, invariants)

    @classmethod
    def from_sympy(
        cls,
        expressions: Sequence[Any],
        symbols: Sequence[Any],
        *,
        t: Any = None,
        params: Mapping[Any, ArrayLike] | None = None,
        invariants: Mapping[str, Any] | None = None,
    ) -> Self:
        """Make a field from SymPy's polynomials or expressions; rational numbers stay exact.

        Parameters
        ----------
        expressions : sequence of sympy.Poly or sympy.Expr
            The n components.
        symbols : sequence of sympy.Symbol
            The n coordinates.
        t : sympy.Symbol, optional
            The time, if the field depends on it.
        params : mapping of sympy.Symbol or str to float, optional
            Values of the other symbols.
        invariants : mapping, optional
            As for :class:`PolynomialField`; SymPy's expressions are taken too.

        Returns
        -------
        PolynomialField

        Raises
        ------
        TypeError, ValueError
            An expression has another symbol, or as for :class:`PolynomialField`.
        ImportError
            SymPy is not installed.

        Examples
        --------
        >>> import sympy
        >>> from liouville._systems import PolynomialField
        >>> x, y = sympy.symbols("x y")
        >>> PolynomialField.from_sympy([x * (x - 2 * y) / 3, y * (y - 2 * x) / 3], [x, y])
        PolynomialField(x, y; 4 terms of degree 2)
        """
        given = _sympy.read(expressions, symbols, t, params)
        source: Callable[[np.ndarray], Terms]
        s = Symbols(_trace.Parameters(given.params), {"x": len(given.names)})
        functions = {
            name: given.function(value)
            for name, value in _trace.mapping("invariants", invariants).items()
        }
        source, is_driven = given.terms, given.is_driven
        if given.has_cases:  # which are looked at where the field is differentiated
            given.terms(s.params.values(None))  # refuses in SymPy's words
            traced = Source(given.column(s), s, given.names)
            source, is_driven = traced, traced.is_driven
        found = cls.__new__(cls)
        found._sympy = given
        return found._build(given.names, s, source, is_driven, functions)

    def __repr__(self) -> str:
        """Name the coordinates and the number of terms."""
        names = self.coordinates
        if len(names) > 20:
            names = (*names[:3], "...", names[-1])
        count, time = len(self.terms) - self.is_driven, ", driven" if self.is_driven else ""
        words = f"{count} term{'' if count == 1 else 's'} of degree {self.terms.degree}{time}"
        return f"{type(self).__name__}({', '.join(names)}; {words})"

    def holding(self, numbers: Sequence[int]) -> Self:
        """Return the field with some of the parameters' numbers as variables that are at rest.

        Raises
        ------
        ValueError
            It is no field then.
        """
        # a run with tangents that is made beside a pullback has the same
        return self.kept(("holding", *numbers), lambda: self._holding(numbers))

    def _holding(self, numbers: Sequence[int]) -> Self:
        other = copy(self)
        other.held = {number: f"params[{number}]" for number in numbers}
        other.terms, other._kept = other._expanded(self._values), {}
        return other

    def depends_on(self, number: int) -> bool:
        """Return whether one of the parameters' numbers is in the field."""
        return self._traced.depends_on(number)

    def by_parameter(self, number: int) -> Terms:
        """Return the derivative of the field by one of the numbers that :meth:`values` gives.

        Raises
        ------
        ValueError
            It is no field of monomials and functions.
        """
        known: dict[int, Terms] = self.kept("derivatives", dict)
        if number not in known:
            known[number] = self._traced.derivative(self._values, number, self.held)
        return known[number]

    def with_params(self, params: Mapping[str, ArrayLike] | np.ndarray | None) -> Self:
        """Return the field expanded with other numbers, by name or as :meth:`values` gives them.

        Raises
        ------
        ValueError
            There is no such parameter, or the field has a divergence then.
        """
        values = self.numbers(params)
        if np.array_equal(values, self._values):
            return self
        other = copy(self)
        other.symbols = self.symbols.with_params(self.symbols.params.replaced(values))
        other._values = values
        other.terms, other._kept = other._expanded(values), {}
        return other
