"""Sequences of shears: their stability matrices, and the errors these make.

A sequence is a list of coefficients c_1 .. c_n; q <- q + c h H p for c_1, c_3 .. and
p <- p - c h H q for c_2, c_4 .. On an eigenvector of H, with x = h times its eigenvalue, the step is
a matrix K(x) of determinant 1, and the exact one a rotation. Everything here is computed with
numbers of ``BITS`` bits.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import gmpy2
import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[Any]  # of objects of gmpy2, or of floats
Matrix = tuple[Numbers, Numbers, Numbers, Numbers]

BITS = 220
FRACTIONS = (
    *(0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.55, 0.6),
    *(0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.925, 0.95, 0.975, 1.0),
)
CLOSE = 1e-12  # to a multiple of pi, for a sine

_COS, _SIN, _SQRT = (np.frompyfunc(f, 1, 1) for f in (gmpy2.cos, gmpy2.sin, gmpy2.sqrt))
_ANGLE = np.frompyfunc(gmpy2.atan2, 2, 1)


def numbers(values: Iterable[object]) -> Numbers:
    """Return numbers of ``BITS`` bits; doubles and digits are taken for exactly what they say."""
    with gmpy2.context(precision=BITS):
        return np.array([gmpy2.mpfr(value) for value in values], dtype=object)


def stability_matrix(coefficients: Iterable[Any], x: Numbers) -> Matrix:
    """Return K11, K12, K21, K22 at every x."""
    zero, one = 0 * x, 0 * x + 1
    a, b, c, d = one, zero, zero, one
    for k, coefficient in enumerate(coefficients):
        if k % 2 == 0:
            a, b = a + coefficient * x * c, b + coefficient * x * d
        else:
            c, d = c - coefficient * x * a, d - coefficient * x * b
    return a, b, c, d


def parts(matrix: Matrix) -> Matrix:
    """Return p and S, the rotation's cosine and sine, and De and Do, what is no rotation."""
    a, b, c, d = matrix
    return (a + d) / 2, (b - c) / 2, (a - d) / 2, (b + c) / 2


def places(n: int, theta: float) -> Numbers:
    """Return where the errors are looked at: a fine grid, and close to every multiple of pi."""
    count = max(2000, 40 * n)
    grid = {gmpy2.mpfr(theta) * k / count for k in range(1, count + 1)}
    grid |= {gmpy2.mpfr(theta) * gmpy2.mpfr(fraction) for fraction in FRACTIONS}
    for k in range(1, int(theta / math.pi) + 1):
        middle = k * gmpy2.const_pi()
        grid |= {middle + sign * gmpy2.exp10(-m) for m in range(3, 12) for sign in (-1, 1)}
        grid.add(middle)
    return np.array(sorted(x for x in grid if x <= theta), dtype=object)


def error_tables(coefficients: Sequence[float], theta: float) -> tuple[list[float], ...]:
    """Return err, dphi and kappa, each the largest on [0, f theta] for the f of ``FRACTIONS``.

    err is |K - R|, R the exact rotation. With cos phi = p the part of K^N that is no rotation is
    |beta| |sin N phi / sin phi|, for which N eps + kappa is a bound: eps the largest |beta| at the
    multiples of pi, where a stable method has none but for the rounding of its coefficients, and
    kappa the largest (|beta| - eps) / |sin phi|. dphi is the largest |phi - x|, plus eps. The last
    two are infinite where |p| > 1.
    """
    with gmpy2.context(precision=BITS):
        x = places(len(coefficients), theta)
        p, s, even, odd = parts(stability_matrix(numbers(coefficients), x))
        cos, sin = _COS(x), _SIN(x)
        beta = _SQRT(even**2 + odd**2)
        err = _SQRT((p - cos) ** 2 + (s - sin) ** 2) + beta
        sine = _SQRT(np.maximum(1 - p * p, 0))
        angle = [abs(_ANGLE(r * cos - p * sin, p * cos + r * sin)) for r in (sine, -sine)]
        is_stable = abs(p) - 1 <= CLOSE**2
        dphi = np.where(is_stable, np.minimum(*angle), gmpy2.inf())
        tables: tuple[list[float], ...] = ([], [], [])
        for fraction in FRACTIONS:
            inside = x <= gmpy2.mpfr(theta) * gmpy2.mpfr(fraction)
            eps = max(beta[inside & (abs(sin) < CLOSE)], default=gmpy2.mpfr(0))
            excess = np.maximum(beta - eps, 0) / np.maximum(sine, CLOSE)
            excess = np.where(is_stable, excess, gmpy2.inf())
            worst = max(err[inside]), max(dphi[inside]) + eps, max(excess[inside])
            for table, value in zip(tables, worst, strict=True):
                table.append(above(value))
        return tables


def above(value: object) -> float:
    """Return three digits that are no less, with 0.2 % for what lies between two places."""
    if not math.isfinite(float(value)):  # type: ignore[arg-type]
        return math.inf
    value = 1.002 * float(value)  # type: ignore[arg-type]
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / unit) * unit:.2e}")


def gain(coefficients: Sequence[float], theta: float) -> float:
    """Return how many roundings a step is worth, as a root mean square; the largest on [0, theta].

    Two numbers are rounded in a shear, c x times one component and the sum that becomes the other,
    and what rounding has changed goes through the shears behind it.
    """
    n = len(coefficients)
    x = np.linspace(0, theta, 8 * n + 1)[1:]
    shears = np.zeros((n, len(x), 2, 2)) + np.eye(2)
    before = [np.zeros((len(x), 2, 2)) + np.eye(2)]
    for k, c in enumerate(coefficients):
        shears[k, :, k % 2, 1 - k % 2] = c * x * (1 - 2 * (k % 2))
        before.append(shears[k] @ before[-1])
    after, total = before[0], np.zeros(len(x))
    for k in reversed(range(n)):
        row = before[k + 1]
        product = (coefficients[k] * x) ** 2 * (row[:, 1 - k % 2] ** 2).sum(axis=1)
        rounded = product + (row[:, k % 2] ** 2).sum(axis=1)
        total += rounded * (after[:, :, k % 2] ** 2).sum(axis=1)
        after = after @ shears[k]
    return float(np.sqrt(total.max()))
