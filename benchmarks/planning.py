"""Seconds of the processor that the planning of a field takes, the first time.

Of every field of the library, of Lorenz's ring of 200, of a dense field of degree 5 in three
variables, and of n + d shears for 40 terms in 8 variables. A field keeps its last plans.
"""

import time
from itertools import combinations_with_replacement

import numpy as np

import liouville as lv
from liouville import problems
from liouville.problems import lorenz96


def dense(degree):
    """Return a field of all monomials up to a degree in three variables."""
    rng, terms = np.random.default_rng(0), []
    for lower in range(degree):
        for monomial in combinations_with_replacement("xyz", lower):
            c = [int(rng.integers(1, 9)) for _ in range(2)]
            last = sum(a * (monomial.count(v) + 1) for a, v in zip(c, "xy", strict=True))
            c.append(f"{-last}/{monomial.count('z') + 1}")
            terms += [(v, a, (*monomial, v)) for v, a in zip("xyz", c, strict=True)]
        for v in "xyz":
            others = combinations_with_replacement("xyz".replace(v, ""), lower + 1)
            terms += [(v, int(rng.integers(1, 9)), monomial) for monomial in others]
    return lv.PolynomialField.from_terms(["x", "y", "z"], terms)


def sparse(n, count):
    """Return a field of quadratic terms without their component's variable."""
    rng, terms = np.random.default_rng(0), {}
    while len(terms) < count:
        i, j, k = (int(v) for v in rng.integers(0, n, 3))
        if i not in (j, k):
            terms[i, min(j, k), max(j, k)] = float(rng.normal())
    return lv.PolynomialField.from_terms(n, [(i, c, (j, k)) for (i, j, k), c in terms.items()])


def seconds(field, x, h=0.01, **given):
    begun = time.process_time()
    lv.plan(field, lv.VolumeSplitting(**given), h=h, x=x)
    return time.process_time() - begun


if __name__ == "__main__":
    rng, found = np.random.default_rng(0), {}
    for name in problems.FIELDS:
        problem = problems.load(name)
        found[name] = seconds(problem.system, problem.start["x"], problem.h)
    slowest = max(found, key=found.get)
    print(f"{len(found)} fields of the library: {found[slowest]:.2f} at most, {slowest}")
    print(f"ring of 200: {seconds(lorenz96.build(200), rng.normal(size=200)):.2f}")
    print(f"degree 5, three variables: {seconds(dense(5), [0.1, 0.2, 0.3]):.2f}")
    field, x = sparse(8, 40), rng.normal(size=8) / 8
    print(f"n + d, 8 variables, 40 terms: {seconds(field, x, diagonal='n+d'):.2f}")
