"""Fields in other coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from liouville.errors import hinted
from liouville.terms import Terms, exact

#: Tensors of more entries are not formed.
MOST_ENTRIES = 10**8


def transformed(terms: Terms, outward: np.ndarray, inward: np.ndarray) -> Terms:
    """Return the field A f(A^-1 x), which is f(y) in the coordinates x = A y.

    Parameters
    ----------
    terms : Terms
        f, without waves.
    outward, inward : ndarray, shape (n, n)
        A and its inverse, exact if the field is to stay exact.
    """
    parts = list(_by_degree(terms, outward, inward))
    return Terms.none(terms.n, terms.is_exact).joined(*parts)


def check_size(n: int, degree: int) -> None:
    """Refuse fields whose terms in other coordinates are too many."""
    if n ** (degree + 1) > MOST_ENTRIES:
        raise ValueError(
            hinted(
                f"a dense field of degree {degree} in {n} variables is too large",
                "take diagonal='exponentials', which keeps a sparse field sparse",
            )
        )


def _by_degree(terms: Terms, outward: np.ndarray, inward: np.ndarray) -> Iterator[Terms]:
    n, degrees = terms.n, terms.degrees
    for m in np.unique(degrees).tolist():
        part = terms.selected(degrees == m)
        kind = object if terms.is_exact else float
        tensor = np.zeros((n,) * (m + 1), dtype=kind)
        factors = part.variables[:, part.variables.shape[1] - m :]
        np.add.at(tensor, (part.component, *factors.T), part.coefficient)
        tensor = np.tensordot(outward, tensor, axes=1)
        for _ in range(m):  # each contraction puts the axis it has done last
            tensor = np.tensordot(tensor, inward, axes=(1, 0))
        rows = np.array(np.nonzero(tensor)).T
        coefficient = tensor[tuple(rows.T)]
        if terms.is_exact:
            coefficient = exact(coefficient)
        yield Terms(n, rows[:, 0], coefficient, rows[:, 1:]).merged()
