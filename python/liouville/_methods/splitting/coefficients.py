"""The coefficients of pieces, and their derivatives by those of the field."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from liouville._methods.splitting.border import packed
from liouville._methods.splitting.pieces import Split
from liouville._methods.splitting.planes import Plane, PlaneSplit
from liouville._systems.fields.terms import Terms

#: By which part of the field's size it is moved: no coefficient that is a short fraction vanishes.
PART = 0.6180339887498949


def coefficients(split: Split | PlaneSplit) -> np.ndarray:
    """Return the coefficients of all pieces, one after another as the core numbers them.

    They are those of terms, row by row, the rates of an exponential, or the entries of an affine
    piece's matrix and vector. Those of a plane are the parameters.
    """
    found = [
        piece.coefficients if isinstance(piece, Plane) else _parted(packed(piece))[0]
        for piece in split.pieces
    ]
    return np.concatenate([np.empty(0), *found])


def of_parameter(split: PlaneSplit, number: int) -> np.ndarray:
    """Return the derivatives of the coefficients of planes by one of the parameters' numbers."""
    found = []
    for piece in split.pieces:
        own = piece.coefficients if isinstance(piece, Plane) else _parted(packed(piece))[0]
        found.append(np.zeros(own.size))
        if isinstance(piece, Plane):
            found[-1][number] = 1.0
    return np.concatenate(found)


def derivative(
    split: Split, resplit: Callable[[Terms], Split], terms: Terms, change: Terms
) -> np.ndarray | None:
    """Return the derivatives of a split's coefficients along a change of its field.

    Pieces depend on the coefficients of a field linearly as long as each keeps its form, so a
    difference of any length is the derivative. None if the change has other terms than the field,
    or if pieces do not keep their form.
    """
    if not len(change):
        return np.zeros(coefficients(split).size)
    found = moved_by(terms, change)
    if found is None:
        return None
    moved, size = found
    splits = [resplit(field) for field in (terms.to_float(), moved)]
    if any(_form(other) != _form(split) for other in splits):
        return None
    before, after = map(coefficients, splits)
    return np.asarray((after - before) / size)


def moved_by(terms: Terms, change: Terms) -> tuple[Terms, float] | None:
    """Return a field moved along a change, and how far; None where it gets other terms."""
    here, change = terms.to_float(), change.to_float()
    if not len(change):
        return here, 1.0
    size = float(PART * np.abs(here.coefficient).max() / np.abs(change.coefficient).max())
    moved = here.joined(change.scaled(size)).merged()
    return (moved, size) if is_like(moved, terms) else None


def is_like(field: Terms, other: Terms) -> bool:
    """Return whether two fields have the same monomials in the same components."""
    return bool(
        field.compact().functions == other.compact().functions
        and np.array_equal(field.component, other.component)
        and np.array_equal(field.compact().variables, other.compact().variables)
    )


def _form(split: Split) -> list[tuple[Any, ...]]:
    """Return all of the pieces but their coefficients."""
    found = []
    for piece in split.pieces:
        rest = [x.tolist() if isinstance(x, np.ndarray) else x for x in _parted(packed(piece))[1]]
        found.append((*rest, piece.field().compact().functions))
    return found


def _parted(piece: tuple[Any, ...]) -> tuple[np.ndarray, tuple[Any, ...]]:
    """Return the coefficients of a piece on its way to the core, and the rest without functions."""
    match piece:
        case ("natural" | "scaling", rows, number, c, factors, _):
            order = np.argsort(number, kind="stable")
            return c[order], (piece[0], rows, number[order], factors[order])
        case ("turn", places, number, c, factors, _, is_cayley):
            order = np.argsort(number, kind="stable")
            return c[order], ("turn", places, number[order], factors[order], is_cayley)
        case ("shear", places, direction, _, c, factors, _):
            return c, ("shear", places, direction, factors)
        case ("exponential", rows, rates, monomial, _):
            return rates, ("exponential", rows, monomial)
        case ("affine", matrix, vector):
            return np.concatenate([matrix.ravel(), vector]), ("affine", matrix.shape)
        case ("triangular", order, number, c, factors, a, b):
            rank = np.argsort(number, kind="stable")
            return c[rank], ("triangular", order, number[rank], factors[rank], a, b)
    return np.empty(0), (piece[0],)
