"""How much larger the pieces of a splitting are than the field, for random dense fields.

The growth is the sum of the pieces' norms over that of the field, in Bombieri's norm: coefficients
of x^j count j! / |j|!, and rotations change nothing. The fields are homogeneous, with normally
distributed coefficients in an orthonormal basis, without their divergence; the median of some.

Run as ``python benchmarks/growth.py``; takes ten seconds.
"""

from itertools import combinations_with_replacement
from math import factorial

import numpy as np
from report import show

from liouville._methods.splitting import split
from liouville._methods.splitting.directions import growth
from liouville._systems.fields.terms import Terms

#: Degree and numbers of variables.
CASES = ((2, (3, 6, 10, 20, 32)), (3, (3, 6, 10)))
#: Diagonal and off-diagonal pieces.
SPLITTINGS = {
    "exponentials, natural": ("exponentials", "natural"),
    "exponentials, triangular": ("exponentials", "triangular"),
    "regular, natural": ("regular", "natural"),
    "shears, natural": ("shears", "natural"),
    "n + d shears": ("n+d", "natural"),
}
FIELDS = 5


def dense(n, d, rng):
    """Return a random homogeneous field of degree d without divergence."""
    monomials = list(combinations_with_replacement(range(n), d))
    counts = np.array([np.bincount(each, minlength=n) for each in monomials])
    weights = [np.prod([factorial(j) for j in count]) / factorial(d) for count in counts.tolist()]
    coefficients = rng.standard_normal((n, len(monomials))) / np.sqrt(weights)
    component = np.repeat(np.arange(n), len(monomials))
    variables = np.tile(np.array(monomials), (n, 1))
    return Terms(n, component, coefficients.ravel(), variables).repaired()


def row(name, diagonal, off_diagonal):
    """Return the growth of a splitting for every case, not a number where there is none."""
    found = {"splitting": name}
    for d, sizes in CASES:
        for n in sizes:
            rng = np.random.default_rng(n)
            is_there = diagonal != "regular" or d == 2
            values = [
                growth(split(dense(n, d, rng), diagonal, off_diagonal, merged=False))
                for _ in range(FIELDS if is_there else 0)
            ]
            found[f"d = {d}, n = {n}"] = float(np.median(values)) if values else float("nan")
    return found


def main():
    show([row(name, *pieces) for name, pieces in SPLITTINGS.items()])


if __name__ == "__main__":
    main()
