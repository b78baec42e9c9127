"""Polynomials over the user's variables, expanded exactly, and expressions expanded into them.

A polynomial maps monomials to coefficients. A monomial is the ascending tuple of its factors, with
repetition: variables by their number, and waves numbered after them. A coefficient is a pair: its
value, an exact rational, and its size, the sum of the absolute values of what was added up to it. A
float is a dyadic rational, so nothing is rounded before the end, and the size then tells a
coefficient from roundoff of the constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TypeAlias

import numpy as np

from liouville import _casadi as ca
from liouville import tape
from liouville.errors import hinted
from liouville.systems._read_terms import TIME
from liouville.terms import Terms, Wave

Rational: TypeAlias = int | Fraction
Monomial: TypeAlias = tuple[int, ...]
Polynomial: TypeAlias = dict[Monomial, tuple[Rational, float]]

ONE: Polynomial = {(): (1, 1.0)}

#: Numerators and denominators of a fraction that is taken as exact are at most this.
SHORT = 2**31

#: The least coefficient that is not roundoff of the constants, in units of their size.
ROUNDOFF = 16 * float(np.finfo(float).eps)

#: Where an expansion is given up.
MOST_TERMS, MOST_FACTORS = 10**7, 100

#: What helps where the phase of a wave moves with time, but not evenly.
SWAYING = (
    "\nhint: a wave of x + f(t) is one of the coordinate X = x + f(t), whose velocity is x' + f'(t)"
)


class Refused(str):
    """The part of an expression that is no polynomial: "exp(x), which is no polynomial"."""


Value: TypeAlias = Polynomial | Refused


class Expansion:
    """Operations on polynomials over named variables.

    Attributes
    ----------
    names : sequence of str
        The names of the variables.
    waves : list of Wave
        Those met, each once.
    is_exact : bool
        Whether all constants met were short rationals, and so are meant as they stand.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self.waves: list[Wave] = []
        self.is_exact = True
        self._numbers: dict[Wave, int] = {}
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

    def apply(self, operation: str, *args: Value) -> Value:
        """Apply an operation by CasADi's name; what is refused stays so."""
        if operation == "if_else_zero" and args[0] == {}:
            return {}
        polynomials = []
        for arg in args:
            if isinstance(arg, Refused):
                return arg
            polynomials.append(arg)
        if operation in self._operations:
            return self._operations[operation](*polynomials)
        return self._evaluated(operation, *polynomials)

    def constant(self, value: float | Rational) -> Polynomial:
        """Return a finite number, exactly."""
        number = _reduced(Fraction(value))
        if not _is_short(number):
            self.is_exact = False
        return _constant(number)

    def rational(self, value: Fraction) -> Polynomial:
        """Return a number that is meant as it stands."""
        return _constant(_reduced(value))

    def variable(self, index: int) -> Polynomial:
        """Return a variable or, behind them, a wave."""
        return {(index,): (1, 1.0)}

    def add(self, p: Polynomial, q: Polynomial) -> Polynomial:
        """Return p + q."""
        found = dict(p)
        for monomial, (value, size) in q.items():
            _add_to(found, monomial, value, size)
        return found

    def negative(self, p: Polynomial) -> Polynomial:
        """Return -p."""
        return {monomial: (-value, size) for monomial, (value, size) in p.items()}

    def multiply(self, p: Polynomial, q: Polynomial) -> Polynomial:
        """Return p q."""
        if len(p) * len(q) > MOST_TERMS:
            raise _too_large(f"a product has {len(p)} times {len(q)} terms")
        found: Polynomial = {}
        for left, (a, size_a) in p.items():
            for right, (b, size_b) in q.items():
                monomial = tuple(sorted(left + right)) if left and right else left or right
                _add_to(found, monomial, a * b, size_a * size_b)
        degree = max(map(len, found), default=0)
        if degree > MOST_FACTORS:
            raise _too_large(f"a product has degree {degree}")
        return found

    def divide(self, p: Polynomial, q: Polynomial) -> Value:
        """Return p / q, where q is a number other than 0."""
        divisor = value_of(q)
        if not divisor:
            return self._refused(f"{self._enclosed(p)}/{self._enclosed(q)}")
        return self.multiply(p, _constant(_reduced(1 / Fraction(divisor))))

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
            raise _too_large(f"it has the exponent {exponent}")
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
            return Refused(f"{function}({self.written(p)}), whose argument is not affine{hint}")
        places = tuple(sorted(place for (place,) in affine))
        k = tuple(float(affine[place,][0]) for place in places)
        wave = Wave(places, k, float(offset) - (np.pi / 2 if function == "sin" else 0.0))
        self.is_exact = False
        number = self._numbers.setdefault(wave, len(self.waves))
        if number == len(self.waves):
            self.waves.append(wave)
        return self.variable(len(self.names) + number)

    def _is_of_time(self, monomial: Monomial) -> bool:
        """Return whether a monomial has no variable but t, alone or in waves."""
        count = len(self.names)
        places = {
            q for p in monomial for q in (self.waves[p - count].places if p >= count else (p,))
        }
        return {self.names[place] for place in places} == {TIME}

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
        return (
            self.constant(found) if math.isfinite(found) else Refused(f"{call}, which is {found}")
        )

    def _refused(self, expression: str) -> Refused:
        return Refused(f"{expression}, which is no polynomial")

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
        coefficient = str(value) if _is_short(value) else f"{float(value):.6g}"
        if not monomial:
            return coefficient
        terms = Terms.none(len(self.names))
        factors = replace(terms, waves=tuple(self.waves)).written(monomial, self.names)
        return {"1": factors, "-1": f"-{factors}"}.get(coefficient, f"{coefficient}*{factors}")

    def terms(self, components: Sequence[Polynomial], time: bool = False) -> Terms:
        """Collect the components of a field as terms, with 1 for the time if it is a variable.

        Coefficients stay rational if all constants were short; otherwise they are floats, and those
        that roundoff of the constants could have made are left out.
        """
        rows: list[tuple[int, Rational, Monomial]] = []
        for component, polynomial in enumerate(components):
            for monomial, (value, size) in polynomial.items():
                if math.isinf(size):
                    raise OverflowError
                limit = 0.0 if self.is_exact else ROUNDOFF * size
                if not -limit <= value <= limit:
                    rows.append((component, value, monomial))
        if time:
            rows.append((len(self.names) - 1, 1, ()))
        if len(rows) > MOST_TERMS:
            raise _too_large(f"it has {len(rows)} terms")
        found = Terms.of(len(self.names), rows, tuple(self.waves)).resolved()
        return found.merged() if self.is_exact else found.to_float().merged(ROUNDOFF)


def expand(
    column: ca.SX, inputs: Sequence[ca.SX], params: np.ndarray, names: Sequence[str]
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
        Names of the components of x, and of t behind them where the column depends on it.

    Raises
    ------
    ValueError
        An expression is no polynomial; component, operation and expression are named.
    """
    n, expansion = inputs[1].numel(), Expansion(names)
    slots: dict[int, Value] = {}
    components: list[Polynomial] = [{} for _ in range(column.numel())]
    groups = dict(zip(("t", "x", "params"), inputs, strict=True))
    for operation, slot, reads, number in tape.read("field", groups, ca.densify(column)):
        if operation == "input":
            group, place = reads
            slots[slot] = (
                expansion.constant(params[place])
                if group == 2
                else expansion.variable(place if group else n)
            )
        elif operation == "const":
            is_finite = math.isfinite(number)
            slots[slot] = (
                expansion.constant(number) if is_finite else Refused(f"the constant {number}")
            )
        elif operation == "output":
            found = slots[reads[0]]
            if isinstance(found, Refused):
                name = names[slot] if slot < n else str(slot)
                raise ValueError(f"component '{name}' contains {found}")
            components[slot] = found
        else:
            slots[slot] = expansion.apply(operation, *(slots[k] for k in reads))
    return expansion, components


def value_of(p: Polynomial) -> Rational | None:
    """Return the number that a polynomial is, and None if it is none."""
    if not p:
        return 0
    return p[()][0] if len(p) == 1 and () in p else None


def _constant(value: Rational) -> Polynomial:
    return {(): (value, abs(float(value)))} if value else {}


def _reduced(value: Fraction) -> Rational:
    return value.numerator if value.denominator == 1 else value


def _is_short(value: Rational) -> bool:
    return max(abs(value.numerator), value.denominator) <= SHORT


def _add_to(p: Polynomial, monomial: Monomial, value: Rational, size: float) -> None:
    before, other = p.get(monomial, (0, 0.0))
    if total := before + value:
        p[monomial] = total, other + size
    else:
        p.pop(monomial, None)


def _too_large(what: str) -> ValueError:
    return ValueError(
        hinted(f"the field is too large to expand: {what}", "give it by PolynomialField.from_terms")
    )
