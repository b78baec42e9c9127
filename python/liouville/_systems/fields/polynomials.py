"""Polynomials over the user's variables, exactly.

A polynomial maps monomials to coefficients. A monomial is the ascending tuple of its factors, with
repetition: variables by their number, and functions numbered after them. A coefficient is a pair:
its value, an exact rational, and its size, the sum of the absolute values of what was added up to
it. A float is a dyadic rational, so nothing is rounded before the end, and the size then tells a
coefficient from roundoff of the constants.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TypeAlias

from liouville._basics.errors import hinted

Rational: TypeAlias = int | Fraction
Monomial: TypeAlias = tuple[int, ...]
Polynomial: TypeAlias = dict[Monomial, tuple[Rational, float]]

ONE: Polynomial = {(): (1, 1.0)}

#: Numerators and denominators of a fraction that is taken as exact are at most this.
SHORT = 2**31

#: Where an expansion is given up.
MOST_TERMS, MOST_FACTORS = 10**7, 100


def value_of(p: Polynomial) -> Rational | None:
    """Return the number that a polynomial is, and None if it is none."""
    if not p:
        return 0
    return p[()][0] if len(p) == 1 and () in p else None


def constant(value: Rational) -> Polynomial:
    """Return a number as a polynomial."""
    return {(): (value, abs(float(value)))} if value else {}


def reduced(value: Fraction) -> Rational:
    """Return a fraction, or the integer that it is."""
    return value.numerator if value.denominator == 1 else value


def is_short(value: Rational) -> bool:
    """Return whether a fraction is taken as it stands."""
    return max(abs(value.numerator), value.denominator) <= SHORT


def total(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p + q."""
    found = dict(p)
    for monomial, (value, size) in q.items():
        _add_to(found, monomial, value, size)
    return found


def product(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p q."""
    if len(p) * len(q) > MOST_TERMS:
        raise too_large(f"a product has {len(p)} times {len(q)} terms")
    found: Polynomial = {}
    for left, (a, size_a) in p.items():
        for right, (b, size_b) in q.items():
            monomial = tuple(sorted(left + right)) if left and right else left or right
            _add_to(found, monomial, a * b, size_a * size_b)
    degree = max(map(len, found), default=0)
    if degree > MOST_FACTORS:
        raise too_large(f"a product has degree {degree}")
    return found


def too_large(what: str) -> ValueError:
    """Return the error of a field that is too large."""
    return ValueError(
        hinted(f"the field is too large to expand: {what}", "give it by PolynomialField.from_terms")
    )


def _add_to(p: Polynomial, monomial: Monomial, value: Rational, size: float) -> None:
    before, other = p.get(monomial, (0, 0.0))
    if found := before + value:
        p[monomial] = found, other + size
    else:
        p.pop(monomial, None)
