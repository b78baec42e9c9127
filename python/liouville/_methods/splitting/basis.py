"""Fields in other coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods.splitting.elimination import NOISE
from liouville._systems.fields.terms import Terms, exact

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
    n, degrees, coefficients = terms.n, terms.degrees, terms.coefficient
    kind = object if terms.is_exact else float
    if terms.is_exact:  # sums of integers take a tenth of the time of sums of fractions
        outward, below_outward = _integers(outward)
        inward, below_inward = _integers(inward)
        coefficients, below = _integers(coefficients)
    for m in np.unique(degrees).tolist():
        is_part = degrees == m
        part = terms.selected(is_part)
        tensor = np.zeros((n,) * (m + 1), dtype=kind)
        factors = part.variables[:, part.variables.shape[1] - m :]
        np.add.at(tensor, (part.component, *factors.T), coefficients[is_part])
        sizes = np.abs(tensor)
        tensor = _contracted(tensor, outward, inward)
        if not terms.is_exact:
            sizes = _contracted(sizes, np.abs(outward), np.abs(inward))
            tensor[np.abs(tensor) <= NOISE * sizes] = 0.0
        rows = np.array(np.nonzero(tensor)).T
        coefficient = tensor[tuple(rows.T)]
        if terms.is_exact:
            scale = below_outward * below * below_inward**m
            coefficient = exact(Fraction(x, scale) for x in coefficient)
        yield Terms(n, rows[:, 0], coefficient, rows[:, 1:]).merged(NOISE)


def _contracted(tensor: np.ndarray, outward: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """Apply one matrix to the first axis of a tensor, and another to each of the rest."""
    tensor = np.tensordot(outward, tensor, axes=1)
    for _ in range(tensor.ndim - 1):  # each contraction puts the axis it has done last
        tensor = np.tensordot(tensor, inward, axes=(1, 0))
    return tensor


def _integers(numbers: np.ndarray) -> tuple[np.ndarray, int]:
    """Return exact numbers as integers over their common denominator."""
    fractions = exact(numbers.flat)
    scale = math.lcm(*(x.denominator for x in fractions))
    integers = np.empty(numbers.size, dtype=object)
    integers[:] = [x.numerator * (scale // x.denominator) for x in fractions]
    return integers.reshape(numbers.shape), scale
