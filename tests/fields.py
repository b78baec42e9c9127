"""Random divergence-free fields, and a few of the literature, as terms."""

from fractions import Fraction
from itertools import combinations_with_replacement
from math import factorial, prod

import numpy as np

from liouville._systems.fields.terms import Terms, Wave


def monomials(n, degree):
    return list(combinations_with_replacement(range(n), degree))


def random_exact(n, d, seed, homogeneous=False):
    """Dense, degrees 0 to d or d alone, coefficients of a few binary digits.

    Of the coefficients that make up a monomial of the divergence the last is what the others leave.
    """
    rng = np.random.default_rng(seed)

    def number():
        return Fraction(int(rng.integers(-16, 17)), 16)

    field = {}
    for m in range(d if homogeneous else 0, d + 1):
        for i in range(n):
            field |= {(i, M): number() for M in monomials(n, m) if i not in M}
        for j in monomials(n, m - 1) if m else []:
            excess, last = Fraction(0), int(rng.integers(n))
            for i in [i for i in range(n) if i != last]:
                c = number()
                field[i, tuple(sorted((*j, i)))] = c
                excess += (j.count(i) + 1) * c
            field[last, tuple(sorted((*j, last)))] = -excess / (j.count(last) + 1)
    return Terms.of(n, [(i, c, M) for (i, M), c in field.items()])


def random_normal(n, d, seed):
    """Homogeneous, normal in all directions of the norm of Bombieri, floating point."""
    rng = np.random.default_rng(seed)
    rows = []
    for i in range(n):
        for M in monomials(n, d):
            weight = factorial(d) / prod(factorial(M.count(v)) for v in set(M))
            rows.append((i, rng.normal() * np.sqrt(weight), M))
    field = {(i, M): c for i, c, M in rows}
    for j in monomials(n, d - 1):
        places = [(i, tuple(sorted((*j, i)))) for i in range(n)]
        w = [j.count(i) + 1 for i in range(n)]
        mean = sum(a * field[place] for a, place in zip(w, places, strict=True)) / sum(w)
        for place in places:
            field[place] -= mean
    return Terms.of(n, [(i, c, M) for (i, M), c in field.items()])


def on_ring(n, *terms):
    """Return the field x_i' = sum of c x_(i+a) x_(i+b) ..., modulo n; terms are (c, shifts)."""
    i = np.arange(n)
    component = np.concatenate([i for _ in terms])
    coefficient = np.repeat([float(c) for c, _ in terms], n)
    variables = np.concatenate(
        [np.column_stack([(i + s) % n for s in shifts]) for _, shifts in terms]
    )
    return Terms(n, component, coefficient, variables).merged()


def lorenz96(n):
    return on_ring(n, (1, (1, -1)), (-1, (-2, -1)))


def volterra(n):
    return on_ring(n, (1, (0, 1)), (-1, (0, -1)))


def toda(n):
    """a_i' = a_i (b_(i+1) - b_i), b_i' = 2 (a_i^2 - a_(i-1)^2), the a first."""
    rows = []
    for i in range(n):
        rows += [(i, 1, (i, n + (i + 1) % n)), (i, -1, (i, n + i))]
        rows += [(n + i, 2, (i, i)), (n + i, -2, ((i - 1) % n, (i - 1) % n))]
    return Terms.of(2 * n, rows)


SINE = -np.pi / 2


def abc_flow(a, b, c):
    """Return x' = a sin z + c cos y, y' = b sin x + a cos z, z' = c sin y + b cos x."""
    waves = [Wave((v,), (1.0,), phase) for v in range(3) for phase in (0.0, SINE)]
    cosine, sine = [3, 5, 7], [4, 6, 8]
    rows = [
        (0, a, (sine[2],)), (0, c, (cosine[1],)), (1, b, (sine[0],)), (1, a, (cosine[2],)),
        (2, c, (sine[1],)), (2, b, (cosine[0],)),
    ]  # fmt: skip
    return Terms.of(3, rows, tuple(waves))
