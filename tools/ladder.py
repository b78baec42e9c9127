"""Compute the ladder: shears whose step is as long as possible for the error it may make.

``python tools/ladder.py make N THETA`` designs N shears for 0 <= x <= THETA and prints them as an
entry of the list of methods; add it to the list. ``python tools/ladder.py table`` computes the
error tables of the whole list again, from coefficients rounded to doubles, and writes it. Needs
numpy and python-flint. The theory is in ``docs/theory/schrodinger.md``.
"""

# ruff: noqa: T201

import argparse
import math
import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import reduce
from operator import mul
from pathlib import Path

import numpy as np
from flint import acb, arb, arb_mat, arb_poly, ctx
from shears import (
    BITS,
    FRACTIONS,
    completed,
    error_tables,
    factors,
    gain,
    parts,
    places,
    roots,
    shears,
    stability_matrix,
)

TABLE = Path(__file__).parent.parent / "crates/base/src/tableau/ladder/table.txt"
HEAD = """\
# The ladder: q <- q + c h H p and p <- p - c h H q in turn, with c the coefficients.
# method: name, stable or fast, ratio, theta, gain. Then the coefficients, and the largest errors on
# [0, f theta] for the fractions f. Written by tools/ladder.py, which says what the errors are.
"""


@dataclass(frozen=True)
class Method:
    """A sequence of shears, by digits, for 0 <= x <= theta."""

    is_stable: bool
    ratio: float
    theta: float
    digits: tuple[str, ...]

    @property
    def name(self) -> str:
        """Number of shears, kind, theta, and the ratio where it is not 1."""
        kind = "s" if self.is_stable else "f"
        ratio = "" if self.ratio == 1 else f"_r{self.ratio:g}"
        return f"L{len(self.digits)}{kind}_{self.theta:.4f}{ratio}"

    @property
    def coefficients(self) -> list[float]:
        """The digits as doubles."""
        return [float(digits) for digits in self.digits]


def read(path: Path) -> Iterator[Method]:
    """Return the methods of a list; what it says of their errors is not read."""
    text = path.read_text(encoding="utf-8")
    for block in text.split("\nmethod ")[1:]:
        (_, kind, ratio, theta, _), *lines = (line.split() for line in block.splitlines())
        digits = [word for line in lines if line[0] == "c" for word in line[1:]]
        yield Method(kind == "stable", float(ratio), float(theta), tuple(digits))


def entry(method: Method) -> str:
    """Return a method and its errors as they stand in the list."""
    coefficients, theta = method.coefficients, method.theta
    kind = "stable" if method.is_stable else "fast"
    rounding = gain(coefficients, theta)
    lines = [f"method {method.name} {kind} {method.ratio:g} {theta:.4f} {rounding:.3g}"]
    rows = range(0, len(coefficients), 4)
    lines += ["c " + " ".join(method.digits[row : row + 4]) for row in rows]
    tables = zip(("err", "dphi", "kappa"), error_tables(coefficients, theta), strict=True)
    lines += [f"{key} " + " ".join(f"{value:.3g}" for value in table) for key, table in tables]
    return "\n".join(lines) + "\n"


def write(path: Path, methods: Iterable[Method]) -> None:
    """Write a list of methods, by the number of their shears, then by theta."""
    in_order = sorted(methods, key=lambda method: (len(method.digits), method.theta))
    fractions = "fractions " + " ".join(f"{f:g}" for f in FRACTIONS) + "\n"
    path.write_text(HEAD + fractions + "".join(map(entry, in_order)), encoding="utf-8")


def frame(n: int, theta: float, is_stable: bool) -> tuple[arb_mat, arb_mat, list[arb]]:
    """Return the matrices that give nu and 1 + mu at Chebyshev's nodes, and w there."""
    m = math.ceil(1.5 * n)
    u = [((2 * i + 1) * arb.pi() / (4 * m)).cos() for i in range(m)]
    x = [theta * y for y in u]
    cos, sin = [y.cos() for y in x], [y.sin() for y in x]
    basis = [[y.chebyshev_t(k) for k in range(n + 1)] for y in u]
    w = [s * s if is_stable else y * y / (y * y + 1) for y, s in zip(x, sin, strict=True)]
    rows = list(zip(basis, cos, sin, strict=True))
    nus = arb_mat([[(-c if k % 2 else s) * t for k, t in enumerate(row)] for row, c, s in rows])
    mus = arb_mat([[(s if k % 2 else c) * t for k, t in enumerate(row)] for row, c, s in rows])
    return nus, mus, w


def rotation(
    n: int, theta: float, is_stable: bool, ratio: float
) -> tuple[arb_poly, arb_poly, list[acb]]:
    """Return p and S of degree n in all, and the squared roots of |beta|^2 = p^2 + S^2 - 1.

    In the frame that turns along, (p - i S) e^{ix} = 1 + mu + i nu. The unknowns are coefficients
    of Chebyshev polynomials in x / theta. By least squares nu is made small, and |beta|^2 led to
    eps^2 / 2 times a function w, eps the largest nu (or ``ratio`` times that). The weight of the
    latter grows until |beta|^2 is positive, and somewhat on where that is so for |x| < theta only.
    """
    nus, mus, w = frame(n, theta, is_stable)
    m = len(w)
    held, values = constraints(n, theta, is_stable)
    gram = nus.transpose() * nus
    mu, nu, room, weight = [arb(0)] * m, [arb(0)] * m, arb(0), arb(1)
    last, least = math.inf, None
    for sweep in range(60):
        # Newton's method for |beta|^2 / 2 = mu + (mu^2 + nu^2) / 2 = room w
        slopes = arb_mat(
            [
                [((1 + mu[i]) * mus[i, k] + nu[i] * nus[i, k]) / w[i] for k in range(n + 1)]
                for i in range(m)
            ]
        ).mid()
        target = [(1 + mu[i] + (mu[i] ** 2 + nu[i] ** 2) / 2) / w[i] + room for i in range(m)]
        square, across = weight * weight, slopes.transpose()
        solution = constrained(
            gram + across * slopes * square, across * arb_mat(m, 1, target) * square, held, values
        )
        nu = [y.mid() for y in (nus * solution).entries()]
        mu = [(y - 1).mid() for y in (mus * solution).entries()]
        eps = ratio * max(abs(y) for y in nu)
        room = eps * eps / 4
        found = [(a + (a * a + b * b) / 2) / c for a, b, c in zip(mu, nu, w, strict=True)]
        off = float(max(abs(y - room) for y in found) / room)
        if off < 2 and least is None:
            least = eps
        if least is not None and eps > 3 * least:
            break
        if off < 1:
            p, s = in_powers(solution.entries(), theta)
            squares = reflections(p, s, theta, is_stable)
            if squares is not None:
                return p, s, squares
        if sweep == 0:
            weight = (1e-6 / eps).mid()
        elif off < 1.5 * last:  # else Newton's method needs another iteration
            weight = (weight * (1.3 if off < 2 else 2)).mid()
        last = off
    raise ArithmeticError(f"p^2 + S^2 < 1 for some x: change theta = {theta}, or n = {n}")


def constraints(n: int, theta: float, is_stable: bool) -> tuple[arb_mat, arb_mat]:
    """Return the conditions p(0) = 1 and, for a stable method, K = 1 or -1 at multiples of pi."""
    rows = [[arb(0).chebyshev_t(k) if k % 2 == 0 else arb(0) for k in range(n + 1)]]
    values = [arb(1)]
    for j in range(1, int(theta / math.pi) + 1 if is_stable else 1):
        u = j * arb.pi() / theta
        ts = [u.chebyshev_t(k) for k in range(n + 1)]
        slopes = [arb(0)] + [k * u.chebyshev_u(k - 1) for k in range(1, n + 1)]
        rows.append([t if k % 2 == 0 else arb(0) for k, t in enumerate(ts)])
        rows.append([t if k % 2 == 0 else arb(0) for k, t in enumerate(slopes)])
        rows.append([t if k % 2 == 1 else arb(0) for k, t in enumerate(ts)])
        values += [arb((-1) ** j), arb(0), arb(0)]
    return arb_mat(rows), arb_mat(len(values), 1, values)


def constrained(gram: arb_mat, right: arb_mat, held: arb_mat, values: arb_mat) -> arb_mat:
    """Return the least squares solution that satisfies conditions, by multipliers."""
    n, m = gram.nrows(), held.nrows()
    full = gram.tolist()
    multipliers = held.tolist()
    rows = [full[i] + [multipliers[j][i] for j in range(m)] for i in range(n)]
    rows += [multipliers[j] + [arb(0)] * m for j in range(m)]
    both = arb_mat(n + m, 1, right.entries() + values.entries())
    solution = arb_mat(rows).mid().solve(both.mid())
    return arb_mat(n, 1, [y.mid() for y in solution.entries()[:n]])


def in_powers(series: list[arb], theta: float) -> tuple[arb_poly, arb_poly]:
    """Return the even and the odd part of a series of Chebyshev polynomials in x / theta."""
    step = arb_poly([0, 2 / arb(theta)])
    last, this = arb_poly([0, 1 / arb(theta)]), arb_poly([1])  # T_-1 = T_1
    sums = [arb_poly([0]), arb_poly([0])]
    for k, c in enumerate(series):
        sums[k % 2] += this * c
        last, this = this, step * this - last
    return sums[0], sums[1]


def reflections(p: arb_poly, s: arb_poly, theta: float, is_stable: bool) -> list[acb] | None:
    """Return the roots of p^2 + S^2 - 1 in -x^2, without those at 0 and the double ones.

    None where it is negative for some x.
    """
    excess = (p * p + s * s).coeffs()[2::2]
    for j in range(1, int(theta / math.pi) + 1 if is_stable else 1):
        for _ in range(2):
            excess = deflated(excess, (j * arb.pi()) ** 2)
    found = roots(arb_poly([c.mid() * (-1) ** k for k, c in enumerate(excess)]))
    if any(root.imag.overlaps(arb(0)) and root.real < 0 for root in found):
        return None
    return found


def deflated(coefficients: list[arb], root: arb) -> list[arb]:
    """Return a polynomial divided by x minus a root of it."""
    quotient = [arb(0)]
    for c in reversed(coefficients[1:]):
        quotient.append((c + root * quotient[-1]).mid())
    return quotient[:0:-1]


def design(n: int, theta: float, is_stable: bool = True, ratio: float = 1.0) -> Method:
    """Return the method of this length and purpose with the least gain found."""
    ctx.dps = 130 + int(1.8 * n)
    p, s, squares = rotation(n, theta, is_stable, ratio)
    pairs = factors(squares)
    common = arb_poly([0, 1])
    for j in range(1, int(theta / math.pi) + 1 if is_stable else 1):
        common *= arb_poly([(j * arb.pi()) ** 2, 0, 1])

    def tried(signs: list[int]) -> tuple[float, list[arb]]:
        b = reduce(mul, (pair[sign] for pair, sign in zip(pairs, signs, strict=True)), common)
        found = shears(*completed(p, s, b), n)
        return gain([float(c) for c in found], theta, density=1), found

    _, best = searched(tried, len(pairs))
    digits = tuple(c.str(25, radius=False) for c in best)
    method = Method(is_stable, ratio, theta, digits)
    if error_tables(method.coefficients, theta)[0][-1] > 0.1:
        raise ArithmeticError(f"the roots are too close to one another: change theta = {theta}")
    if is_stable and growth(method) > 1.1 * error_tables(method.coefficients, theta)[2][-1] + 1e-6:
        return Method(False, ratio, theta, digits)
    return method


def searched(
    tried: Callable[[list[int]], tuple[float, list[arb]]], count: int, starts: int = 60
) -> tuple[float, list[arb]]:
    """Return the best of choices between two factors for every root: the best of some, improved."""
    chance = random.Random(count)
    first = [[chance.randrange(2) for _ in range(count)] for _ in range(starts)]
    ranked = sorted(((*tried(signs), signs) for signs in first), key=lambda trial: trial[0])
    results = []
    for value, found, signs in ranked[:3]:
        since, k = 0, 0
        while since < count:
            flipped = [*signs[:k], 1 - signs[k], *signs[k + 1 :]]
            trial = tried(flipped)
            if trial[0] < value:
                (value, found), signs, since = trial, flipped, 0
            since, k = since + 1, (k + 1) % count
        results.append((value, found))
    return min(results, key=lambda trial: trial[0])


def growth(method: Method, doublings: int = 20) -> float:
    """Return the largest |K^N| - 1 for N = 1, 2, 4 .., 2^20."""
    before, ctx.prec = ctx.prec, BITS
    x = places(len(method.digits), method.theta)
    a, b, c, d = stability_matrix([arb(y) for y in method.coefficients], x)
    worst = 0.0
    for _ in range(doublings + 1):
        _, _, even, odd = parts((a, b, c, d))
        beta = np.sqrt((even**2 + odd**2).astype(float).clip(min=0))
        worst = max(worst, float((beta + np.sqrt(1 + beta**2)).max() - 1))
        rows = a * a + b * c, (a + d) * b, (a + d) * c, d * d + b * c
        a, b, c, d = (np.array([y.mid() for y in row], dtype=object) for row in rows)
    ctx.prec = before
    return worst


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("table").add_argument("file", nargs="?", type=Path, default=TABLE)
    make = verbs.add_parser("make")
    make.add_argument("n", type=int)
    make.add_argument("theta", type=float)
    make.add_argument("--fast", action="store_true", help="without conditions for stability")
    make.add_argument("--ratio", type=float, default=1.0, help="|beta| to error of the angle")
    arguments = parser.parse_args()
    if arguments.verb == "table":
        write(arguments.file, list(read(arguments.file)))
    else:
        method = design(arguments.n, arguments.theta, not arguments.fast, arguments.ratio)
        print(entry(method), end="")


if __name__ == "__main__":
    main()
