"""Compute the shears that are stable for the longest steps of their order.

With z = x^2 a stability polynomial of order 2k begins like cos x, to z^k; its other coefficients,
up to z^m, make the interval [0, z*] on which |p| <= 1 as long as it can be.
``python tools/stability.py`` computes those of orders 2 to 8 with up to 16 pairs of shears, takes
them apart into shears with a_i = b_{m+1-i}, and writes the list, together with the methods of order
m by their digits. Needs numpy, scipy and python-flint. The theory is in
``docs/theory/schrodinger.md``.
"""

import itertools
import math
from collections.abc import Iterable, Iterator
from decimal import Decimal
from functools import reduce
from operator import mul
from pathlib import Path

import numpy as np
from flint import arb, arb_mat, arb_poly, ctx
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.optimize import linprog
from shears import factors, gain, roots, shears

TABLE = Path(__file__).parent.parent / "crates/base/src/tableau/stability/table.txt"
HEAD = """\
# Shears that are stable for long steps: q <- q + c h H p and p <- p - c h H q in turn.
# method: kind, order, pairs of shears, largest stable |x|, gain. Then the coefficients. Written by
# tools/stability.py.
"""
DIGITS = 150
TIGHT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
GRAY_MANOLOPOULOS = {
    2: (
        "0.2928932188134524755991556",
        "0.7071067811865475244008444",
    ),
    3: (
        "0.2683300957817599249569552",
        "-0.1879916187991597820078529",
        "0.9196615230173998570508976",
    ),
    4: (
        "0.1118965355841510588388286",
        "0.7035015731785553518205457",
        "-0.1465431690690313993751526",
        "0.3311450603063249887157782",
    ),
    5: (
        "0.1128511547751039686825545",
        "0.3024509556083154459991832",
        "-0.1142574668692440987062326",
        "0.415962124956773882201046",
        "0.2829932315290508018234489",
    ),
    6: (
        "0.0706793917080426899672203",
        "0.2713546241538742026808255",
        "0.3281116727332105900031381",
        "-0.1016181476059250971471826",
        "0.2323716825713742960636031",
        "0.1991007764394233184323956",
    ),
}


def cosine(k: int) -> list[arb]:
    """Return 1 - z/2 + z^2/24 - ... up to z^k."""
    return [arb((-1) ** j) / math.factorial(2 * j) for j in range(k + 1)]


def guessed(k: int, m: int) -> tuple[NDArray[np.float64], float]:
    """Return the series of p's free part, over (z / z*)^(k + 1), and z*, to some digits.

    The end of the interval is bisected; a linear program says whether |p| <= 1 can be held.
    """
    u = (1 - np.cos(np.linspace(0, math.pi, 160 * m + 1)[1:])) / 2
    series = chebyshev.chebvander(2 * u - 1, m - k - 1) * u[:, None] ** (k + 1)

    def least(end: float) -> tuple[float, NDArray[np.float64]]:
        z = end * u
        fixed = np.polynomial.Polynomial([float(c) for c in cosine(k)])(z)
        late = z > 1
        ones = np.ones(late.sum())
        rows = np.block([[series[late], -ones[:, None]], [-series[late], -ones[:, None]]])
        bounds = np.concatenate([1 - fixed[late], 1 + fixed[late]])
        cost = np.append(np.zeros(m - k), 1.0)
        for options in (TIGHT, {}):  # the tighter one may find nothing
            result = linprog(cost, rows, bounds, bounds=(None, None), options=options)
            if result.x is not None:
                break
        return float(result.x[-1]), result.x[:-1]

    low, high = 1.0, 4.0 * m * m
    while high - low > 1e-7 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if least(middle)[0] <= 0 else (low, middle)
    return least(low)[1], low


def shifted(j: int) -> list[int]:
    """Return the coefficients of the Chebyshev polynomial T_j(2u - 1)."""
    last, this = [1], [-1, 2]
    for _ in range(j):
        doubled = [
            4 * a - 2 * b - c
            for a, b, c in itertools.zip_longest([0, *this], this, last, fillvalue=0)
        ]
        last, this = this, doubled
    return last


def polished(k: int, m: int) -> tuple[arb_poly, list[arb]]:
    """Return p and the places where it touches 1 or -1, by Newton's method."""
    if m == k:
        return arb_poly(cosine(k)), []
    series, end = guessed(k, m)
    scale = arb(end)
    fixed = [c * scale**j for j, c in enumerate(cosine(k))]
    free = arb_poly([0])
    for j, weight in enumerate(series):
        free += float(weight) * arb_poly([int(c) for c in shifted(j)])
    c = free.coeffs() + [arb(0)] * (m - k - free.length())
    p = arb_poly(fixed + c)
    values = np.vectorize(lambda u: float(p(arb(float(u)))))
    slope = chebyshev.Chebyshev.interpolate(values, m, domain=[0, 1]).deriv()
    flat = [complex(u) for u in slope.roots()]
    real = sorted(u.real for u in flat if abs(u.imag) < 1e-3 and 0 < u.real < 1)
    u = [arb(float(x)) for x in real[1 - k % 2 :][: m - k]]  # p > -1 near pi where k is even
    signs = [arb(1 if (i + k) % 2 == 0 else -1) for i in range(m - k)]
    for _ in range(60):
        p = arb_poly(fixed + c)
        first, second = p.derivative(), p.derivative().derivative()
        residual = [p(x) - sign for x, sign in zip(u, signs, strict=True)] + [first(x) for x in u]
        rows = [[x ** (k + 1 + j) for j in range(m - k)] + [arb(0)] * (m - k) for x in u]
        rows += [
            [(k + 1 + j) * x ** (k + j) for j in range(m - k)]
            + [second(x) if i == other else arb(0) for other in range(m - k)]
            for i, x in enumerate(u)
        ]
        for i, x in enumerate(u):
            rows[i][m - k + i] = first(x)
        step = arb_mat(rows).mid().solve(arb_mat(2 * (m - k), 1, residual).mid()).entries()
        c = [(x - y).mid() for x, y in zip(c, step[: m - k], strict=True)]
        u = [(x - y).mid() for x, y in zip(u, step[m - k :], strict=True)]
        if max(abs(float(y)) for y in step) < 10.0 ** (-0.7 * DIGITS):
            break
    coefficients = cosine(k) + [x / scale ** (k + 1 + j) for j, x in enumerate(c)]
    return arb_poly([x.mid() for x in coefficients]), [x * scale for x in u]


def remainder(p: arb_poly, touches: list[arb]) -> list[arb]:
    """Return (1 - p^2) / z, divided by z - z_j twice for every touch."""
    rest = [-c for c in (p * p).coeffs()[1:]]
    for z in touches + touches:
        quotient = [arb(0)]
        for c in reversed(rest[1:]):
            quotient.append((c + z * quotient[-1]).mid())
        rest = quotient[:0:-1]
    return rest


def limit(p: arb_poly, touches: list[arb]) -> arb:
    """Return x*, up to which |p| <= 1."""
    found = roots(arb_poly([c.mid() for c in remainder(p, touches)]))
    return min((z.real for z in found if z.imag.overlaps(arb(0)) and z.real > 0), key=float).sqrt()


def factorised(p: arb_poly, touches: list[arb]) -> list[arb]:
    """Return the shears with K21 = -K12 that have the least gain and go forwards in time."""
    m, rest = p.degree(), remainder(p, touches)
    pairs = factors(roots(arb_poly([c.mid() for c in rest])))
    common = reduce(mul, (arb_poly([1, -1 / z]) for z in touches), arb_poly([1]))
    end = float(limit(p, touches))
    best: list[arb] = []
    for signs in itertools.product((0, 1), repeat=len(pairs)):
        t = reduce(
            mul, (pair[sign] for pair, sign in zip(pairs, signs, strict=True)), arb_poly([1])
        )
        de = common * arb_poly([0, *t.coeffs()[1::2]])
        scale = -p[m] / de[m]
        upper, lower = common * arb_poly(t.coeffs()[::2]) * scale, p - de * scale
        found = shears(in_x(upper, 1), in_x(lower, 0), 2 * m)
        if not best or growth(found, end) < growth(best, end):
            best = found
    # the polynomials leave the sign of x open
    return best if sum(float(c) for c in best[::2]) > 0 else [-c for c in best]


def growth(coefficients: list[arb], end: float) -> float:
    """Return the gain of coefficients."""
    return gain([float(c) for c in coefficients], end)


def in_x(polynomial: arb_poly, power: int) -> arb_poly:
    """Return a polynomial in z as one in x, times a power of x."""
    spread = [[c, arb(0)] for c in polynomial.coeffs()]
    return arb_poly([arb(0)] * power + list(itertools.chain(*spread)))


def trace(coefficients: list[arb]) -> arb_poly:
    """Return p, in z."""
    one, zero, x = arb_poly([1]), arb_poly([0]), arb_poly([0, 1])
    a, b, c, d = one, zero, zero, one
    for k, coefficient in enumerate(coefficients):
        if k % 2 == 0:
            a, b = a + coefficient * x * c, b + coefficient * x * d
        else:
            c, d = c - coefficient * x * a, d - coefficient * x * b
    return arb_poly([c.mid() / 2 for c in (a + d).coeffs()[::2]])


def entry(kind: str, order: int, coefficients: list[arb], end: arb) -> str:
    """Return a method as it stands in the list."""
    rounding = growth(coefficients, float(end))
    pairs = len(coefficients) // 2
    lines = [f"method {kind} {order} {pairs} {end.str(20, radius=False)} {rounding:.3g}"]
    digits = [f"{Decimal(c.str(25, radius=False)):f}" for c in coefficients]
    lines += ["c " + " ".join(digits[row : row + 4]) for row in range(0, len(digits), 4)]
    return "\n".join(lines) + "\n"


def entries() -> Iterator[str]:
    """Return the whole list."""
    for k in range(1, 5):
        for m in range(k, 17):
            p, touches = polished(k, m)
            yield entry("stability", 2 * k, factorised(p, touches), limit(p, touches))
    for m, digits in GRAY_MANOLOPOULOS.items():
        a = [arb(text) for text in digits]
        coefficients = list(itertools.chain(*zip(a, reversed(a), strict=True)))
        yield entry("gray-manolopoulos", m, coefficients, limit(trace(coefficients), []))


def write(path: Path, texts: Iterable[str]) -> None:
    """Write the list."""
    path.write_text(HEAD + "".join(texts), encoding="utf-8")


if __name__ == "__main__":
    ctx.dps = DIGITS
    write(TABLE, list(entries()))
