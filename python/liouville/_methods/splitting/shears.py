"""The diagonal part of a field by d shears: x' = b_k g_k(x), b_k . grad g_k = 0."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from liouville._basics.errors import hinted, misshapen
from liouville._methods.splitting.commuting import commuting
from liouville._methods.splitting.directions import along
from liouville._methods.splitting.elimination import NOISE, SingularError, solved
from liouville._methods.splitting.pieces import Shear, one_component, same_kind
from liouville._systems.fields.terms import Terms

#: Shears that would have more terms in all components are not formed.
MOST_TERMS = 10**8

#: Diagonal terms that are left over by roundoff are below this, relative to the pieces.
LEFT_OVER = 1e-8


def shears(terms: Terms, directions: np.ndarray | None = None) -> tuple[list[Shear], Terms]:
    """Take shears from a field so that what is left is off-diagonal.

    A field that is shears as it is has these and no rest. Otherwise, of degree m only the first m
    directions are used.

    Parameters
    ----------
    terms : Terms
        A field without divergence and without waves.
    directions : ndarray, shape (n, d), optional
        Every square minor is nonzero; see :func:`~liouville._methods.splitting.directions.along`.

    Returns
    -------
    list of Shear
        At most as many as the degree of the diagonal part.
    Terms
        The off-diagonal rest.

    Raises
    ------
    ValueError
        The directions are too few or not in general position, or the result would be too large.
    """
    terms = terms.merged()
    if whole := commuting(terms):
        return whole, Terms.none(terms.n, terms.is_exact)
    diagonal = terms.diagonal()
    d = diagonal.degree
    if terms.n * len(diagonal) > MOST_TERMS:
        hint = "take diagonal='exponentials', which keeps a sparse field sparse"
        raise ValueError(hinted("shears along dense directions would fill the field in", hint))
    b = _directions(terms, d, directions)
    parts: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in range(d)]
    for m in range(1, d + 1):
        part = diagonal.selected(diagonal.degrees == m)
        for rows, gamma in _Degree(part, b[:, :m], m).solutions():
            for k in range(m):
                parts[k].append((gamma[:, k], rows))
    scalars = [one_component(terms.n, part, terms.is_exact) for part in parts]
    pieces = [Shear(b[:, k], g) for k, g in enumerate(scalars) if len(g)]
    return pieces, _rest(terms, pieces)


def _directions(terms: Terms, d: int, given: np.ndarray | None) -> np.ndarray:
    if given is None:
        return along(terms.n, d, terms.is_exact)
    b = np.asarray(given)
    if b.ndim != 2 or len(b) != terms.n or b.shape[1] < d:
        raise misshapen("directions", b.shape, f"({terms.n}, {d})")
    return same_kind(b[:, :d], terms)


def _rest(terms: Terms, pieces: list[Shear]) -> Terms:
    """Return the field without the shears; without its diagonal terms, which are roundoff."""
    rest = terms.joined(*(piece.field().scaled(-1) for piece in pieces)).merged(NOISE)
    left = np.abs(rest.diagonal().coefficient).max(initial=0)
    largest = max([np.abs(terms.coefficient).max(initial=0), *_sizes(pieces)])
    if left > (0 if terms.is_exact else LEFT_OVER * largest):
        raise ValueError(
            hinted(
                f"the shears leave {float(left):.1e} of the diagonal part",
                "the directions are close to a special position: choose others",
            )
        )
    return rest.off_diagonal()


def _sizes(pieces: list[Shear]) -> Iterator[float]:
    for piece in pieces:
        yield np.abs(piece.direction).max() * np.abs(piece.g.coefficient).max()


class _Degree:
    """The shears of the part of degree m, one set of variables after another, larger sets first.

    With gamma_k the coefficient of a monomial x^M in g_k, and c_i in component i of the field:

        sum_k B_ik gamma_k(M) = c_i(M)                          for each variable i of M
        sum_i B_ik (j_i + 1) gamma_k(x_i x^j) = 0               for each k and |j| = m - 1

    For the monomials of which exactly the variables of a set S occur, and j likewise, the unknowns
    outside are of larger sets, and what is left has full column rank. Monomials of a set are given
    by their exponents, which are positive. In floating point a gamma is zero that is noise against
    the largest of its set, and against those of larger sets that it follows from.
    """

    def __init__(self, terms: Terms, b: np.ndarray, m: int) -> None:
        self.terms, self.b, self.m = terms, b, m
        self.kind = object if terms.is_exact else float
        self.sets = self._all_sets()
        self.number = {each: k for sets in self.sets for k, each in enumerate(sets)}
        self.exponents = [_compositions(m, size) for size in range(m + 1)]
        self.lower = [_compositions(m - 1, size) for size in range(m + 1)]

    def _all_sets(self) -> list[list[tuple[int, ...]]]:
        """Collect the variables of each monomial, and all their subsets, by size."""
        found: list[set[tuple[int, ...]]] = [set() for _ in range(self.m + 1)]
        for row in {tuple(row) for row in self.terms.variables.tolist()}:
            variables = tuple(sorted(set(row) - {-1}))
            found[len(variables)].add(variables)
        for size in range(self.m, 1, -1):
            for each in found[size]:
                found[size - 1].update(combinations(each, size - 1))
        return [sorted(sets) for sets in found]

    def solutions(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield rows of variables, and their coefficients in g_1, ..., g_m."""
        wanted = self._wanted()
        known = [self._zeros(size, self.lower[size], self.m) for size in range(self.m + 1)]
        largest = [np.zeros(len(sets)) for sets in self.sets]
        for size in range(self.m, 0, -1):
            if not self.sets[size]:
                continue
            sets = np.array(self.sets[size])
            gamma = self._solved(sets, wanted[size], known[size])
            if not self.terms.is_exact:
                np.maximum(largest[size], np.abs(gamma).max(axis=(1, 2)), out=largest[size])
                gamma[np.abs(gamma) <= NOISE * largest[size][:, None, None]] = 0.0
            if size > 1:
                self._add_known(known[size - 1], sets, gamma)
                for p in range(size):
                    np.maximum.at(largest[size - 1], self._without(sets, p), largest[size])
            for at, powers in enumerate(self.exponents[size]):
                yield np.repeat(sets, powers, axis=1), gamma[:, at]

    def _zeros(self, size: int, exponents: list[tuple[int, ...]], last: int) -> np.ndarray:
        return np.zeros((len(self.sets[size]), len(exponents), last), dtype=self.kind)

    def _wanted(self) -> list[np.ndarray]:
        """Return c by size: of shape (sets, exponents, variables)."""
        wanted = [self._zeros(size, self.exponents[size], size) for size in range(self.m + 1)]
        places = [{e: k for k, e in enumerate(each)} for each in self.exponents]
        terms = self.terms
        for i, c, row in zip(terms.component, terms.coefficient, terms.variables, strict=True):
            factors = row[row >= 0].tolist()
            each = sorted(set(factors))
            at = places[len(each)][tuple(factors.count(v) for v in each)]
            wanted[len(each)][self.number[tuple(each)], at, each.index(i)] += c
        return wanted

    def _solved(self, sets: np.ndarray, wanted: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Solve for gamma, of shape (sets, exponents, m)."""
        count, size = sets.shape
        exponents, lower, m = self.exponents[size], self.lower[size], self.m
        place = {e: k for k, e in enumerate(exponents)}
        b = self.b[sets]
        matching = size * len(exponents)
        matrix = np.zeros((count, matching + m * len(lower), m * len(exponents)), dtype=self.kind)
        for at in range(len(exponents)):
            matrix[:, at * size : (at + 1) * size, at * m : (at + 1) * m] = b
        for at, j in enumerate(lower):
            for p in range(size):
                raised = place[_raised(j, p)]
                for k in range(m):
                    row, column = matching + at * m + k, raised * m + k
                    matrix[:, row, column] += b[:, p, k] * (j[p] + 1)
        right = np.concatenate([wanted.reshape(count, -1), -known.reshape(count, -1)], axis=1)
        try:
            gamma = solved(matrix, right)
        except SingularError as error:
            raise ValueError(
                hinted(
                    "the directions are not in general position",
                    "every square minor of the matrix whose columns they are must be nonzero",
                )
            ) from error
        return gamma.reshape(count, len(exponents), m)

    def _add_known(self, known: np.ndarray, sets: np.ndarray, gamma: np.ndarray) -> None:
        """Carry what is solved over to the sets with one variable less."""
        size = sets.shape[1]
        place = {e: k for k, e in enumerate(self.lower[size - 1])}
        for p in range(size):
            number = self._without(sets, p)
            for at, powers in enumerate(self.exponents[size]):
                if powers[p] == 1:
                    row = place[powers[:p] + powers[p + 1 :]]
                    np.add.at(known[:, row], number, self.b[sets[:, p]] * gamma[:, at])

    def _without(self, sets: np.ndarray, p: int) -> np.ndarray:
        """Return the numbers of sets without their variable p."""
        return np.array([self.number[tuple(s)] for s in np.delete(sets, p, axis=1).tolist()])


def _compositions(total: int, parts: int) -> list[tuple[int, ...]]:
    """List the ways to write a number as a sum of positive ones."""
    if parts == 0:
        return [()] if total == 0 else []
    return [
        (first, *rest)
        for first in range(total - parts + 1, 0, -1)
        for rest in _compositions(total - first, parts - 1)
    ]


def _raised(powers: tuple[int, ...], place: int) -> tuple[int, ...]:
    return (*powers[:place], powers[place] + 1, *powers[place + 1 :])
