"""Eigenvalues of ARPACK with their multiplicities, which a Krylov space of one vector cannot see.

What was found is taken away, and the search begins again from another random vector, until it finds
nothing that belongs to the wanted eigenvalues.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Of eigenvalues that are equal to so much, relatively, one is not before the other.
EQUAL = 1e-8

#: A vector of which less than this part is left beside others is one of theirs.
INDEPENDENT = 1e-8

#: The precision of eigenvalues that are found beside larger ones, whose roundoff is in the way.
BESIDE = 1e-12


def nearest(linalg: Any, inverse: Callable[[Array], Array], mass: Any, count: int,
            starts: Iterator[Array]) -> tuple[Array, Array]:  # fmt: skip
    """Return the largest eigenvalues of the inverse of a symmetric pencil, and unit vectors.

    The inverse takes what the mass makes of a vector; `starts` are random ones in its image.
    """
    n = mass.shape[0]
    values, vectors = np.zeros(0), np.zeros((n, 0))
    more = count
    while True:

        def left(b: Array, values: Array = values, vectors: Array = vectors) -> Array:
            found: Array = inverse(b) - vectors @ (values * (vectors.T @ b))
            return found

        operator = linalg.LinearOperator((n, n), matvec=left, dtype=float)
        begin = next(starts)
        begin -= vectors @ (vectors.T @ (mass @ begin))
        # the first matrix is not used where its inverse is given
        squares, ways = linalg.eigsh(mass, more, mass, sigma=0.0, OPinv=operator, v0=begin)
        new = 1 / squares
        least = np.sort(np.abs(values))[-count] if values.size else 0.0
        values, vectors = np.append(values, new), np.hstack([vectors, ways])
        best = np.argsort(-np.abs(values), kind="stable")[:count]
        if least and np.abs(new).max() <= (1 + EQUAL) * least:
            return values[best], vectors[:, best]
        more = 1 if not least else 2 * more


def largest(linalg: Any, multiply: Callable[[Array], Array], count: int,
            starts: Iterator[Array]) -> tuple[Array, Array]:  # fmt: skip
    """Return the eigenvalues of largest size of a real matrix, and vectors."""
    basis = np.zeros((next(starts).size, 0))
    moved, more, least = basis, count, 0.0
    n = len(basis)
    while True:

        def left(x: Array, basis: Array = basis) -> Array:
            found = multiply(x)
            for _ in range(2):
                found = found - basis @ (basis.T @ found)
            return found

        operator = linalg.LinearOperator((n, n), matvec=left, dtype=float)
        new, ways = linalg.eigs(
            operator, more, which="LM", v0=left(next(starts)), tol=BESIDE * (least > 0)
        )
        fresh = [x for way in ways.T for x in (way.real, way.imag)]
        basis = _extended(basis, fresh)
        moved = np.column_stack([moved, *map(multiply, basis.T[moved.shape[1] :])])
        values, small = np.linalg.eig(basis.T @ moved)
        best = np.argsort(-np.abs(values), kind="stable")[:count]
        if least and np.abs(new).max() <= (1 + EQUAL) * least:
            return values[best], basis @ small[:, best]
        more = 2 if not least else 2 * more
        least = float(np.abs(values[best[-1]]))


def _extended(basis: Array, vectors: list[Array]) -> Array:
    """Return an orthonormal basis of one and of more vectors."""
    for vector in vectors:
        size = np.linalg.norm(vector)
        for _ in range(2):
            vector = vector - basis @ (basis.T @ vector)
        length = np.linalg.norm(vector)
        if length > INDEPENDENT * size:
            basis = np.column_stack([basis, vector / length])
    return basis
