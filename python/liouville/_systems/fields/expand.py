"""Expressions expanded into polynomials whose factors are variables and functions of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems import tape
from liouville._systems.fields.functions import Node, Opaque, is_case
from liouville._systems.fields.polynomials import (
    MOST_FACTORS,
    MOST_TERMS,
    ONE,
    Monomial,
    Polynomial,
    Rational,
    constant,
    is_short,
    product,
    reduced,
    too_large,
    total,
    value_of,
)
from liouville._systems.fields.read_terms import TIME
from liouville._systems.fields.terms import Function, Terms, Wave, written

#: A term of a field: component, coefficient and monomial.
Row: TypeAlias = tuple[int, Rational, Monomial]

#: The least coefficient that is not roundoff of the constants, in units of their size.
ROUNDOFF = 16 * float(np.finfo(float).eps)

#: Operations of polynomials that functions by cases take in.
ARITHMETIC = frozenset(("add", "sub", "mul", "div", "inv", "sq", "twice", "neg", "pow", "constpow"))

#: The hint where the phase of a wave moves with time, but not evenly.
SWAYING = (
    "\nhint: a wave of x + f(t) is one of the coordinate X = x + f(t), whose velocity is x' + f'(t)"
)


class Refused(str):
    """The part of an expression that no field can have: "log(-1), which is nan"."""


class NoPolynomial(Refused):
    """The part of an expression that is no polynomial: "exp(x), which is no polynomial"."""


Value: TypeAlias = Polynomial | Refused


class Traced(NamedTuple):
    """An expression: expanded, and as it stands."""

    value: Value
    node: Node


class Expansion:
    """Operations on polynomials over named variables.

    Attributes
    ----------
    names : sequence of str
        The names of the variables.
    functions : list of Wave or Opaque
        The factors met that are no variables, each once.
    is_exact : bool
        Whether all constants met were short rationals, and so are meant as they stand.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self.functions: list[Wave | Opaque] = []
        self.is_exact = True
        self._numbers: dict[Any, int] = {}
        self._operations: dict[str, Callable[..., Value]] = {
            "add": self.add,
            "sub": lambda p, q: self.add(p, self.negative(q)),
            "neg": self.negative,
            "twice": lambda p: self.add(p, p),
            "mul": self.multiply,
            "sq": lambda p: self.multiply(p, p),
            "div": self.divide,
            "inv": lambda p: self.divide(ONE, p),
            "pow": self.power,
            "constpow": self.power,
            "sin": lambda p: self.wave("sin", p),
            "cos": lambda p: self.wave("cos", p),
            "if_else_zero": self._choice,
        }

    def apply(self, operation: str, *args: Traced) -> Traced:
        """Apply an operation by CasADi's name; what is refused stays so."""
        node = (operation, *(arg.node for arg in args))
        if operation == "if_else_zero" and args[0].value == {}:
            return Traced({}, ("const", 0.0))
        polynomials = []
        for arg in args:
            if isinstance(arg.value, Refused):
                return Traced(arg.value, node)
            polynomials.append(arg.value)
        if operation in ARITHMETIC and self._is_by_cases(polynomials):
            first = next(f for p in polynomials for f in self._opaque_in(p) if f.is_by_cases)
            within = self._function(operation, polynomials, node, "", first.reason)
            return Traced(within, node)
        if operation in self._operations:
            found = self._operations[operation](*polynomials)
        else:
            found = self._evaluated(operation, *polynomials)
        if isinstance(found, NoPolynomial):
            found = self._opaque(operation, polynomials, node, found)
        return Traced(found, node)

    def _opaque(
        self, operation: str, args: list[Polynomial], node: Node, reason: NoPolynomial
    ) -> Polynomial:
        """Return an operation without a polynomial as a function; of a quotient its divisor's."""
        if operation in ("div", "inv"):
            divided = args[0] if operation == "div" else ONE
            text = f"(1/{self._enclosed(args[-1])})"
            inverse = self._function("inv", args[-1:], ("inv", node[-1]), text, reason)
            return product(divided, inverse)
        text = reason.partition(", which")[0].partition(", whose")[0]
        return self._function(operation, args, node, text, reason)

    def _function(
        self, operation: str, args: Sequence[Polynomial], node: Node, text: str, reason: str
    ) -> Polynomial:
        """Return a function as a factor."""
        key = (operation, *(tuple(sorted((m, value) for m, (value, _) in p.items())) for p in args))
        if key not in self._numbers:
            places = tuple(sorted(set().union(*map(self._places, args))))
            within = (f.is_by_cases for p in args for f in self._opaque_in(p))
            is_by_cases = is_case(operation) or any(within)
            self._numbers[key] = len(self.functions)
            self.functions.append(Opaque(places, key, node, text, reason, is_by_cases))
        return self.variable(len(self.names) + self._numbers[key])

    def _opaque_in(self, p: Polynomial) -> Iterator[Opaque]:
        """Return the functions in a polynomial that are no waves."""
        count = len(self.names)
        for q in {q for monomial in p for q in monomial if q >= count}:
            function = self.functions[q - count]
            if isinstance(function, Opaque):
                yield function

    def _places(self, p: Polynomial) -> set[int]:
        """Return the variables that a polynomial depends on, also through functions."""
        count = len(self.names)
        found: set[int] = set()
        for q in {q for monomial in p for q in monomial}:
            found.update(self.functions[q - count].places if q >= count else (q,))
        return found

    def _is_by_cases(self, args: Sequence[Polynomial]) -> bool:
        """Return whether an operation is one more of a function by cases, such as a table.

        Its cases are not multiplied out: it takes in all that depends on no other variable than
        it does itself. Numbers stay factors.
        """
        if len(args) == 2 and any(value_of(p) is not None for p in args):
            return False
        functions = [f for p in args for f in self._opaque_in(p) if f.is_by_cases]
        if not functions or (len(args) == 1 and len(args[0]) == 1):
            return False
        places = set().union(*map(self._places, args))
        return places == set().union(*(f.places for f in functions))

    def number(self, value: float | Rational) -> Polynomial:
        """Return a finite number, exactly."""
        number = reduced(Fraction(value))
        if not is_short(number):
            self.is_exact = False
        return constant(number)

    def traced(self, value: float) -> Traced:
        """Return a number as an expression."""
        is_finite = math.isfinite(value)
        found = self.number(value) if is_finite else Refused(f"the constant {value}")
        return Traced(found, ("const", float(value)))

    def traced_variable(self, index: int) -> Traced:
        """Return a variable as an expression."""
        return Traced(self.variable(index), ("variable", index))

    def rational(self, value: Fraction) -> Polynomial:
        """Return a number that is meant as it stands."""
        return constant(reduced(value))

    def variable(self, index: int) -> Polynomial:
        """Return a variable or, behind them, a function."""
        return {(index,): (1, 1.0)}

    def add(self, p: Polynomial, q: Polynomial) -> Polynomial:
        """Return p + q."""
        return total(p, q)

    def negative(self, p: Polynomial) -> Polynomial:
        """Return -p."""
        return {monomial: (-value, size) for monomial, (value, size) in p.items()}

    def multiply(self, p: Polynomial, q: Polynomial) -> Polynomial:
        """Return p q."""
        return product(p, q)

    def divide(self, p: Polynomial, q: Polynomial) -> Value:
        """Return p / q, where q is a number other than 0."""
        divisor = value_of(q)
        if not divisor:
            refused = Refused if divisor == 0 else NoPolynomial
            return refused(f"{self._enclosed(p)}/{self._enclosed(q)}, which is no polynomial")
        return self.multiply(p, constant(reduced(1 / Fraction(divisor))))

    def power(self, p: Polynomial, q: Polynomial) -> Value:
        """Return p to the power of q, which is a natural number if p is none."""
        exponent = value_of(q)
        is_natural = exponent is not None and exponent.denominator == 1 and exponent >= 0
        if exponent is not None and is_natural and exponent <= MOST_FACTORS:
            found = ONE
            for bit in f"{exponent.numerator:b}":
                found = self.multiply(found, found)
                found = self.multiply(found, p) if bit == "1" else found
            return found
        if exponent is not None and value_of(p) is not None:
            return self._evaluated("pow", p, q)
        if is_natural:
            raise too_large(f"it has the exponent {exponent}")
        return self._refused(f"{self._enclosed(p)}**{self._enclosed(q)}")

    def wave(self, function: str, p: Polynomial) -> Value:
        """Return the sine or the cosine of an affine polynomial."""
        if value_of(p) is not None:
            return self._evaluated(function, p)
        affine = dict(p)
        offset, _ = affine.pop((), (0, 0.0))
        others = [m for m in affine if len(m) > 1 or m[0] >= len(self.names)]
        if others:
            hint = SWAYING if all(map(self._is_of_time, others)) else ""
            sentence = f"{function}({self.written(p)}), whose argument is not affine{hint}"
            return NoPolynomial(sentence)
        places = tuple(sorted(place for (place,) in affine))
        k = tuple(float(affine[place,][0]) for place in places)
        wave = Wave(places, k, float(offset) - (np.pi / 2 if function == "sin" else 0.0))
        self.is_exact = False
        number = self._numbers.setdefault(wave, len(self.functions))
        if number == len(self.functions):
            self.functions.append(wave)
        return self.variable(len(self.names) + number)

    def _is_of_time(self, monomial: Monomial) -> bool:
        """Return whether a monomial has no variable but t, alone or in functions."""
        return {self.names[place] for place in self._places({monomial: (1, 1.0)})} == {TIME}

    def _choice(self, condition: Polynomial, p: Polynomial) -> Value:
        if value_of(condition) is None:
            return self._refused(f"a choice by {self.written(condition)}")
        return p

    def _evaluated(self, operation: str, *args: Polynomial) -> Value:
        """Apply an operation to numbers."""
        call = f"{operation}({', '.join(map(self.written, args))})"
        values = [value_of(arg) for arg in args]
        numbers = [float(value) for value in values if value is not None]
        if len(numbers) < len(args):
            return self._refused(call)
        found = tape.evaluate(operation, *numbers)
        return self.number(found) if math.isfinite(found) else Refused(f"{call}, which is {found}")

    def _refused(self, expression: str) -> Refused:
        return NoPolynomial(f"{expression}, which is no polynomial")

    def _enclosed(self, p: Polynomial) -> str:
        text = self.written(p)
        return text if text.replace(".", "").replace("_", "").isalnum() else f"({text})"

    def written(self, p: Polynomial) -> str:
        """Write a polynomial in the user's names, or its first terms."""
        monomials = sorted(p, key=lambda monomial: (-len(monomial), monomial))
        words = [self._term(monomial, p[monomial][0]) for monomial in monomials[:4]]
        words += ["..."] if len(p) > 4 else []
        return " + ".join(words).replace("+ -", "- ") or "0"

    def _term(self, monomial: Monomial, value: Rational) -> str:
        coefficient = str(value) if is_short(value) else f"{float(value):.6g}"
        if not monomial:
            return coefficient
        factors = written(monomial, self.names, self.functions)
        return {"1": factors, "-1": f"-{factors}"}.get(coefficient, f"{coefficient}*{factors}")

    def terms(self, components: Sequence[Polynomial], time: int | None = None) -> Terms:
        """Collect the components of a field as terms, with 1 for the time if that is a variable.

        Coefficients stay rational if all constants were short; otherwise they are floats, and those
        that roundoff of the constants could have made are left out.
        """
        is_exact = self.is_exact and not any(any(self._opaque_in(p)) for p in components)
        rows: list[Row] = []
        for component, polynomial in enumerate(components):
            for monomial, (value, size) in polynomial.items():
                if math.isinf(size):
                    raise OverflowError
                limit = 0.0 if is_exact else ROUNDOFF * size
                if not -limit <= value <= limit:
                    rows.append((component, value, monomial))
        if time is not None:
            rows.append((time, 1, ()))
        if len(rows) > MOST_TERMS:
            raise too_large(f"it has {len(rows)} terms")
        self._check_functions(rows)
        found = Terms.of(len(self.names), *self._with_functions(rows)).resolved()
        return found.merged() if is_exact else found.to_float().merged(ROUNDOFF)

    def _check_functions(self, rows: Sequence[Row]) -> None:
        """Refuse a component with a function of its own variable that is no polynomial."""
        count = len(self.names)
        for component, _, monomial in rows:
            for function in (self.functions[q - count] for q in monomial if q >= count):
                if isinstance(function, Opaque) and component in function.places:
                    name = self.names[component]
                    sentence = f"component '{name}' contains {function.reason}"
                    hint = (
                        f"other components than that of '{name}' may have any function of it; "
                        "in the plane or in space lv.PotentialField takes any field by its "
                        "potential, lv.GriddedField by samples"
                    )
                    raise ValueError(sentence if "hint" in sentence else hinted(sentence, hint))

    def _with_functions(
        self, rows: Sequence[Row]
    ) -> tuple[Sequence[Row], tuple[Wave | Function, ...]]:
        """Return terms with the functions that they use, as tapes."""
        count = len(self.names)
        used = sorted({q - count for _, _, monomial in rows for q in monomial if q >= count})
        number = {count + q: count + k for k, q in enumerate(used)}
        functions = [self.functions[q] for q in used]
        recorded = [f.recorded(self.names) if isinstance(f, Opaque) else f for f in functions]
        return [
            (component, value, tuple(number.get(q, q) for q in monomial))
            for component, value, monomial in rows
        ], tuple(recorded)


def expand(
    column: ca.SX,
    inputs: Sequence[ca.SX],
    params: np.ndarray,
    names: Sequence[str],
    held: Sequence[int] = (),
) -> tuple[Expansion, list[Polynomial]]:
    """Expand expressions in the inputs t, x and params, with numbers for the latter.

    Parameters
    ----------
    column : SX
        The expressions, one a component.
    inputs : sequence of three SX
        The symbols t, x and params.
    params : ndarray
        The numbers.
    names : sequence of str
        Names of the components of x, of t where the column depends on it, and of what is held.
    held : sequence of int
        The parameters' numbers that are variables, behind all others.

    Raises
    ------
    ValueError
        An expression is no polynomial; component, operation and expression are named.
    """
    n, expansion = inputs[1].numel(), Expansion(names)
    slots: dict[int, Traced] = {}
    components: list[Polynomial] = [{} for _ in range(column.numel())]
    groups = dict(zip(("t", "x", "params"), inputs, strict=True))
    for operation, slot, reads, number in tape.read("field", groups, ca.densify(column)):
        if operation == "input":
            group, place = reads
            if group == 2 and place in held:
                group, place = 1, len(names) - len(held) + held.index(place)
            slots[slot] = (
                expansion.traced(params[place])
                if group == 2
                else expansion.traced_variable(place if group else n)
            )
        elif operation == "const":
            slots[slot] = expansion.traced(number)
        elif operation == "output":
            found = slots[reads[0]].value
            if isinstance(found, Refused):
                name = names[slot] if slot < n else str(slot)
                raise ValueError(f"component '{name}' contains {found}")
            components[slot] = found
        else:
            slots[slot] = expansion.apply(operation, *(slots[k] for k in reads))
    return expansion, components
