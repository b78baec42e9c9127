"""Directions of shears in general position, and how well they do."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from liouville._methods.splitting.elimination import inverse
from liouville._methods.splitting.pieces import Split
from liouville._systems.fields.terms import Terms, exact

#: Default directions are rounded to fractions of this denominator for fields of exact coefficients.
DENOMINATOR = 64


def along(n: int, d: int, is_exact: bool = False) -> np.ndarray:
    """Return d directions b_1, ..., b_d that are in general position with e_1, ..., e_n.

    That is, every square minor of the matrix (n, d) whose columns they are is nonzero. For d = 2
    its rows are sqrt(2) (cos t_i, sin t_i) with half of the angles equispaced between 0 and pi/2,
    and half between pi/2 and pi; for d > 2 they are those of the harmonic frame in the coordinates
    of n of its vectors, scaled to a largest entry of 1.
    """
    if d <= 1:
        rows = np.ones((n, d))
    elif d == 2:
        half = (n + 1) // 2
        first = np.arange(1, half + 1) / (half + 1)
        second = 1 + np.arange(1, n - half + 1) / (n - half + 1)
        angles = np.concatenate([first, second]) * np.pi / 2
        rows = np.sqrt(2) * np.column_stack([np.cos(angles), np.sin(angles)])
    else:
        frame, apart = harmonic(n, d), spread(n, d)
        rows = inverse(np.delete(frame, apart, axis=1)) @ frame[:, apart]
        rows /= np.abs(rows).max(axis=1, keepdims=True)
    return rounded(rows) if is_exact else rows


def harmonic(n: int, d: int, is_exact: bool = False) -> np.ndarray:
    """Return the n + d vectors of the harmonic tight frame, the columns of a matrix (n, n + d).

    Its minors are those of Vandermonde, and never zero.
    """
    count = n + d
    angle = 2 * np.pi * np.arange(count) / count
    rows = [np.full(count, np.sqrt(0.5))] if n % 2 else []
    for turns in np.arange(n // 2) + (1.0 if n % 2 else 0.5):
        rows += [np.cos(turns * angle), np.sin(turns * angle)]
    frame = np.sqrt(2 / count) * np.array(rows)
    return rounded(frame) if is_exact else frame


def spread(n: int, d: int) -> np.ndarray:
    """Return d of the numbers below n + d that are evenly spread."""
    return np.round((np.arange(d) + 0.5) * (n + d) / d).astype(int)


def powers(n: int, d: int) -> np.ndarray:
    """Return the directions b_k = (1, 2^(k-1), ..., n^(k-1)), for exact coefficients only.

    They are in general position with e_1, ..., e_n, but badly scaled.
    """
    return np.array([[Fraction(i**k) for k in range(d)] for i in range(1, n + 1)], dtype=object)


def rounded(numbers: np.ndarray) -> np.ndarray:
    """Return numbers as fractions of a small denominator, none of them zero."""
    whole = np.round(numbers * DENOMINATOR)
    whole[whole == 0] = 1
    return exact(Fraction(int(v), DENOMINATOR) for v in whole.ravel()).reshape(numbers.shape)


def norm(terms: Terms) -> float:
    """Return the norm of Bombieri: a coefficient of x^j counts j! / |j|! times its square.

    It does not change when the coordinates are rotated.
    """
    terms = terms.merged().to_float()
    weight = np.ones(len(terms))
    run = np.ones(len(terms))
    previous = np.full(len(terms), -1)
    for column in terms.variables.T:  # v v v gives 1 2 3, the factors of 3!
        run = np.where(column == previous, run + 1, 1)
        weight *= np.where(column >= 0, run, 1)
        previous = column
    factorial = np.cumprod([1.0, *range(1, terms.degree + 1)])
    return float(np.sqrt((terms.coefficient**2 * weight / factorial[terms.degrees]).sum()))


def growth(split: Split) -> float:
    """Return how much larger the pieces are than the field, by the sum of their norms."""
    return sum(norm(field) for field in split.fields()) / norm(split.field())
