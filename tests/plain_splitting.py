"""Splitting steps written down as they are defined, in rationals or in mpmath's many digits.

Pieces are tuples as the core reads them
(``liouville._methods.splitting.border.packed``), of lists or arrays:

    ("natural", rows, term_rows, coefficients, factors, functions)              x_i += h R_i
    ("shear", places, direction, term_rows, coefficients, factors, functions)   x += h g a
    ("scaling", rows, term_rows, coefficients, factors, functions)          x_i *= exp(h p_i)
    ("exponential", rows, rates, monomial, functions)                       x_i' = c_i x_i x^j
    ("triangular", order, term_rows, coefficients, factors, A, b)           explicit Runge-Kutta
    ("affine", matrix, vector)                                              x' = A x + c

Term k is ``coefficients[k]`` times the variables ``factors[k]`` (negative ones are absent, n + q
is the q-th of the functions, waves (places, k, phase)) and belongs to row ``term_rows[k]``. Nothing
is fused, and every number is taken for the rational that it is.
"""

from fractions import Fraction
from math import prod

from mpmath import mp, mpf


def numbers(values):
    """Return a list, or list of lists, of the exact values."""
    values = values.tolist() if hasattr(values, "tolist") else values
    if isinstance(values, list | tuple):
        return [numbers(value) for value in values]
    return values if isinstance(values, int | mpf) else Fraction(values)


def in_digits(values):
    """Return a piece, or a list of them, with mpmath's numbers for fractions: much faster."""
    values = values.tolist() if hasattr(values, "tolist") else values
    if isinstance(values, list | tuple):
        return type(values)(in_digits(value) for value in values)
    return mpf(1) * values if isinstance(values, float | Fraction) else values


def places(values):
    """Return a list, or list of lists, of integers."""
    return [places(v) if hasattr(v, "__len__") else int(v) for v in values]


def terms(rows, term_rows, coefficients, factors):
    """Return terms (variable, coefficient, factors)."""
    rows = places(rows)
    return [
        (rows[row], coefficient, [v for v in monomial if v >= 0])
        for row, coefficient, monomial in zip(
            places(term_rows), numbers(coefficients), places(factors), strict=True
        )
    ]


def value(term, x, functions=()):
    """Evaluate a term."""
    _, coefficient, factors = term

    def factor(v):
        if v < len(x):
            return x[v]
        where, k, phase = functions[v - len(x)]
        angle = zip(places(where), numbers(k), strict=True)
        return mp.cos(sum((k * x[i] for i, k in angle), numbers(phase)))

    return coefficient * prod(map(factor, factors), start=Fraction(1))


def natural(x, h, rows, term_rows, coefficients, factors, functions=()):
    z = list(x)
    for term in terms(rows, term_rows, coefficients, factors):
        z[term[0]] += h * value(term, x, functions)
    return z


def shear(x, h, rows, direction, term_rows, coefficients, factors, functions=()):
    g = sum(value(term, x, functions) for term in terms([0], term_rows, coefficients, factors))
    z = list(x)
    for i, a in zip(places(rows), numbers(direction), strict=True):
        z[i] += h * g * a
    return z


def scaling(x, h, rows, term_rows, coefficients, factors, functions=()):
    z = list(x)
    for term in terms(rows, term_rows, coefficients, factors):
        z[term[0]] *= mp.exp(h * value(term, x, functions))
    return z


def exponential(x, h, rows, rates, monomial, functions=()):
    monomial, rates = places(monomial), numbers(rates)
    m = value((0, Fraction(1), monomial), x, functions)
    alpha = sum(c * monomial.count(i) for i, c in zip(places(rows), rates, strict=True))
    time = -mp.log(1 - alpha * h * m) / alpha if alpha else h * m
    z = list(x)
    for i, c in zip(places(rows), rates, strict=True):
        z[i] *= mp.exp(c * time)
    return z


def affine(x, h, matrix, vector):
    matrix, vector = numbers(matrix), numbers(vector)
    whole = [[*row, c] for row, c in zip(matrix, vector, strict=True)] + [[0] * (len(x) + 1)]
    moved = mp.expm(mp.matrix(whole) * h) * mp.matrix([*x, 1])
    return list(moved)[:-1]


def triangular(x, h, order, term_rows, coefficients, factors, A, b):
    """Step by the Runge-Kutta method: Z_r = x + h sum_q A_rq K_q, z = x + h sum_r b_r K_r."""
    of, A, b = terms(order, term_rows, coefficients, factors), numbers(A), numbers(b)
    K = []
    for row in A:
        Z = list(x)
        for a, k in zip(row, K, strict=False):
            Z = [z + h * a * slope for z, slope in zip(Z, k, strict=True)]
        K.append([sum(value(t, Z) for t in of if t[0] == i) for i in range(len(x))])
    slopes = zip(*K, strict=True)
    return [
        z + h * sum(c * s for c, s in zip(b, k, strict=True))
        for z, k in zip(x, slopes, strict=True)
    ]


def triangular_adjoint(x, h, order, term_rows, coefficients, factors, A, b):
    """Find z with Psi_{-h}(z) = x, one component after another.

    The step of -h from z takes a component k to z_k - h sum_r b_r K_r,k, whose slopes depend only
    on what stands before k; so do the stages of what comes next.
    """
    of, A, b = terms(order, term_rows, coefficients, factors), numbers(A), numbers(b)
    z, Z = list(x), [list(x) for _ in b]
    for k in places(order):
        K = [sum(value(t, stage) for t in of if t[0] == k) for stage in Z]
        z[k] = x[k] + h * sum(c * slope for c, slope in zip(b, K, strict=True))
        for r, stage in enumerate(Z):
            stage[k] = z[k] - h * sum(A[r][q] * K[q] for q in range(r))
    return z


KINDS = {f.__name__: f for f in (natural, shear, scaling, exponential, affine, triangular)}


def flow(piece, is_adjoint, x, h):
    """Move by a piece; only the triangular ones are not their own adjoints."""
    kind, *data = piece
    step = triangular_adjoint if is_adjoint and kind == "triangular" else KINDS[kind]
    return step(x, h, *data)


def basic(pieces, is_adjoint, x, h):
    """Make a basic step, the first piece first, or its adjoint, the last piece first."""
    for piece in reversed(pieces) if is_adjoint else pieces:
        x = flow(piece, is_adjoint, x, h)
    return x


def walk(pieces, flows, x, h, steps=1):
    """Make steps of a composition [(is_adjoint, alpha), ...], the first map first."""
    for _ in range(steps):
        for is_adjoint, alpha in flows:
            x = basic(pieces, is_adjoint, x, alpha * h)
    return x


def field(pieces):
    """Return the terms (variable, coefficient, factors) of the sum of the pieces."""
    total = []
    for kind, *data in pieces:
        match kind:
            case "natural" | "triangular":
                total += terms(*data[:4])
            case "shear":
                g = terms([0], *data[2:5])
                where = zip(places(data[0]), numbers(data[1]), strict=True)
                total += [(i, a * c, v) for i, a in where for _, c, v in g]
            case "scaling":
                total += [(i, c, [*v, i]) for i, c, v in terms(*data)]
            case "exponential":
                where = zip(places(data[0]), numbers(data[1]), strict=True)
                total += [(i, c, [*places(data[2]), i]) for i, c in where]
            case "affine":
                matrix, vector = map(numbers, data)
                total += [(i, c, [j]) for i, row in enumerate(matrix) for j, c in enumerate(row)]
                total += [(i, c, []) for i, c in enumerate(vector)]
    return [term for term in total if term[1]]


def solution(of, x, t, steps, degree=40):
    """Solve x' = f(x) for a polynomial field without waves, by Taylor series in equal steps."""
    h = mpf(t) / steps
    for _ in range(steps):
        x = [sum(c * h**k for k, c in enumerate(series)) for series in taylor(of, x, degree)]
    return x


def taylor(of, x, degree):
    """Return the coefficients of t^0 .. t^degree of each variable."""
    series = [[mpf(1) * value] for value in x]
    # of each term the products of its first factors, the coefficient among them
    products = [[[coefficient]] + [[] for _ in factors] for _, coefficient, factors in of]
    for k in range(degree):
        slopes = [mpf(0)] * len(x)
        for (i, _, factors), partial in zip(of, products, strict=True):
            if k > 0:
                partial[0].append(0)
            for last, product, v in zip(partial, partial[1:], factors, strict=False):
                product.append(sum(last[q] * series[v][k - q] for q in range(k + 1)))
            slopes[i] += partial[-1][k]
        for coefficients, slope in zip(series, slopes, strict=True):
            coefficients.append(slope / (k + 1))
    return series


def determinant(move, x):
    """Return the determinant of a map's derivative, by differences: to half of the digits."""
    delta = mpf(10) ** (-mp.dps // 2)
    base = move(x)
    columns = []
    for i in range(len(x)):
        moved = move([value + delta * (i == j) for j, value in enumerate(x)])
        columns.append([(a - b) / delta for a, b in zip(moved, base, strict=True)])
    return mp.det(mp.matrix(columns))
