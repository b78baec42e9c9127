"""Sequences of shears: their stability matrices, the errors these make, and shears from matrices.

A sequence is a list of coefficients c_1 .. c_n; q <- q + c h H p for c_1, c_3 .. and
p <- p - c h H q for c_2, c_4 .. On an eigenvector of H, with x = h times its eigenvalue, the step
is a matrix K(x) of determinant 1, and the exact one a rotation. With

    p = (K11 + K22) / 2,  S = (K12 - K21) / 2,  De = (K11 - K22) / 2,  Do = (K12 + K21) / 2

p and De are even in x, S and Do odd, and p^2 + S^2 = 1 + De^2 + Do^2.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from flint import acb, arb, arb_poly, ctx
from numpy.typing import NDArray

Numbers = NDArray[Any]  # of arb, or of floats
Matrix = tuple[Numbers, Numbers, Numbers, Numbers]

BITS = 220  # of the numbers behind a table of errors
FRACTIONS = (
    *(0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.55, 0.6),
    *(0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.925, 0.95, 0.975, 1.0),
)
CLOSE = 1e-12  # to a multiple of pi, for a sine


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
    """Return p, S, De and Do."""
    a, b, c, d = matrix
    return (a + d) / 2, (b - c) / 2, (a - d) / 2, (b + c) / 2


def places(n: int, theta: float) -> Numbers:
    """Return where the errors are looked at: a fine grid, and close to every multiple of pi."""
    count = max(2000, 40 * n)
    grid = [arb(theta) * k / count for k in range(1, count + 1)]
    grid += [arb(theta) * fraction for fraction in FRACTIONS]
    for k in range(1, int(theta / math.pi) + 1):
        middle = k * arb.pi()
        grid += [middle + sign * arb(10) ** -m for m in range(3, 12) for sign in (-1, 1)]
        grid.append(middle)
    return np.array([x.mid() for x in grid if float(x) <= theta], dtype=object)


def each(function: Callable[..., arb], *arrays: Iterable[arb]) -> NDArray[np.float64]:
    """Return a function of numbers, for all of them, in doubles."""
    return np.array([float(function(*row)) for row in zip(*arrays, strict=True)])


def error_tables(coefficients: Sequence[float], theta: float) -> tuple[list[float], ...]:
    """Return err, dphi and kappa, each the largest on [0, f theta] for the f of ``FRACTIONS``.

    err is |K - R|, R the exact rotation. With cos phi = p the part of K^N that is no rotation is
    |beta| |sin N phi / sin phi|, for which N eps + kappa is a bound: eps the largest |beta| at the
    multiples of pi, where a stable method has none but for the rounding of its coefficients, and
    kappa the largest (|beta| - eps) / |sin phi|. dphi is the largest |phi - x|, plus eps. The last
    two are infinite where |p| > 1.
    """
    before, ctx.prec = ctx.prec, BITS
    x = places(len(coefficients), theta)
    p, s, even, odd = parts(stability_matrix([arb(c) for c in coefficients], x))
    cos, sin = (np.array([f(y) for y in x], dtype=object) for f in (arb.cos, arb.sin))
    beta = each(arb.sqrt, [abs(y) for y in even**2 + odd**2])
    err = each(arb.sqrt, [abs(y) for y in (p - cos) ** 2 + (s - sin) ** 2]) + beta
    exact = np.array([max(y.mid(), arb(0)).sqrt() for y in 1 - p * p], dtype=object)
    angles = [each(arb.atan2, r * cos - p * sin, p * cos + r * sin) for r in (exact, -exact)]
    is_stable = np.array([float(y) <= CLOSE**2 for y in p * p - 1])
    dphi = np.where(is_stable, np.minimum(*np.abs(angles)), math.inf)
    is_middle = np.array([abs(float(y)) < CLOSE for y in sin])
    sine, x = np.maximum(exact.astype(float), CLOSE), x.astype(float)
    ctx.prec = before
    tables: tuple[list[float], ...] = ([], [], [])
    for fraction in FRACTIONS:
        inside = x <= theta * fraction
        eps = max(beta[inside & is_middle], default=0.0)
        kappa = np.where(is_stable, np.maximum(beta - eps, 0) / sine, math.inf)[inside].max()
        worst = err[inside].max(), dphi[inside].max() + eps, kappa
        for table, value in zip(tables, worst, strict=True):
            table.append(above(value))
    return tables


def above(value: float) -> float:
    """Return three digits that are no less, with 0.2 % for what lies between two places."""
    if not math.isfinite(value):
        return math.inf
    value *= 1.002
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / unit) * unit:.2e}")


def gain(coefficients: Sequence[float], theta: float, density: int = 8) -> float:
    """Return how many roundings a step is worth, as a root mean square; the largest on [0, theta].

    Two numbers are rounded in a shear, c x times one component and the sum that becomes the other,
    and what rounding has changed goes through the shears behind it.
    """
    n = len(coefficients)
    x = np.linspace(0, theta, density * n + 1)[1:]
    rows = np.zeros((n + 1, 4, len(x)))
    rows[0] = np.array([[1.0], [0.0], [0.0], [1.0]])
    for k, c in enumerate(coefficients):
        rows[k + 1] = rows[k]
        to, source, step = (0, 2, c * x) if k % 2 == 0 else (2, 0, -c * x)
        rows[k + 1, to : to + 2] += step * rows[k, source : source + 2]
    after, total = rows[0].copy(), np.zeros(len(x))  # columns: the first, then the second
    for k in reversed(range(n)):
        c = coefficients[k]
        to, source, step = (0, 2, c * x) if k % 2 == 0 else (2, 0, -c * x)
        product = step**2 * (rows[k + 1, source : source + 2] ** 2).sum(axis=0)
        rounded = product + (rows[k + 1, to : to + 2] ** 2).sum(axis=0)
        total += rounded * (after[to : to + 2] ** 2).sum(axis=0)
        after[source : source + 2] += step * after[to : to + 2]
    return float(np.sqrt(total.max()))


def roots(polynomial: arb_poly) -> list[acb]:
    """Return the roots of a polynomial, complex ones with a positive imaginary part."""
    found = polynomial.complex_roots(tol=arb(2) ** (30 - ctx.prec), maxprec=4 * ctx.prec)
    return [root for root in found if root.imag.overlaps(arb(0)) or root.imag > 0]


def factors(squares: Sequence[acb]) -> list[tuple[arb_poly, arb_poly]]:
    """Return for every root Y, with its conjugate, y - sqrt(Y) and y + sqrt(Y), multiplied out."""
    pairs = []
    for square in squares:
        if square.imag.overlaps(arb(0)):
            root = square.real.sqrt().mid()
            pairs.append((arb_poly([-root, 1]), arb_poly([root, 1])))
        else:
            pair = square.sqrt()
            middle, end = 2 * pair.real.mid(), (pair.real**2 + pair.imag**2).mid()
            pairs.append((arb_poly([end, -middle, 1]), arb_poly([end, middle, 1])))
    return pairs


def completed(p: arb_poly, s: arb_poly, b: arb_poly) -> tuple[arb_poly, arb_poly]:
    """Return K12 and K22 of the matrix with De + i Do = b(i x), b up to a factor.

    The factor is that for which the shears are as many as the degree of p or S, whichever is more.
    """
    n = b.degree()
    signs = (1, 1, -1, -1)  # of i^k, real and imaginary
    coefficients = [signs[k % 4] * c for k, c in enumerate(b.coeffs())]
    scale = (-p[n] if n % 2 == 0 else s[n]) / coefficients[n]
    even = arb_poly([c * scale if k % 2 == 0 else 0 for k, c in enumerate(coefficients)])
    odd = arb_poly([c * scale if k % 2 == 1 else 0 for k, c in enumerate(coefficients)])
    return s + odd, p - even


def shears(upper: arb_poly, lower: arb_poly, n: int) -> list[arb]:
    """Return the n coefficients of the shears whose second column is K12 and K22, by Euclid."""
    columns = [list(poly.coeffs()) + [arb(0)] * (n + 1) for poly in (upper, lower)]
    found = []
    for degree in range(n, 0, -1):
        to = (degree + 1) % 2  # an odd number of shears ends with one into q
        high, low = columns[to], columns[1 - to]
        c = (high[degree] / low[degree - 1]).mid()
        found.append(c if to == 0 else -c)
        for k in range(degree):
            high[k + 1] = (high[k + 1] - c * low[k]).mid()
    return found[::-1]
