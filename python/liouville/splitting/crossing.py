"""Pieces as the core takes them."""

from __future__ import annotations

import numpy as np

from liouville import _core
from liouville.splitting.pieces import (
    Affine,
    Exponential,
    Natural,
    Piece,
    Scaling,
    Shear,
    Split,
    Triangular,
)
from liouville.terms import Terms


def crossed(split: Split) -> _core.Split:
    """Return the core's form of a split field, with floating-point coefficients."""
    return _core.Split(split.n, [_crossed(piece) for piece in split.pieces])


def _crossed(piece: Piece) -> tuple[object, ...]:
    match piece:
        case Natural(terms):
            rows = np.unique(terms.component)
            return "natural", rows, *_polynomials(terms, rows), _waves(terms)
        case Shear(direction, g):
            places = np.flatnonzero(direction)
            along = direction[places].astype(float)
            return "shear", places, along, *_polynomials(g, np.zeros(1, np.int64)), _waves(g)
        case Scaling(rate):
            rows = np.unique(rate.component)
            return "scaling", rows, *_polynomials(rate, rows)
        case Exponential():
            monomial = np.array(piece.monomial, dtype=np.int64)
            return "exponential", piece.places, piece.rates.astype(float), monomial
        case Triangular(order, terms, tableau):
            a, b = (np.array(x, dtype=float) for x in (tableau.a, tableau.b))
            return "triangular", order, *_polynomials(terms, order), a, b
        case Affine(matrix, vector):
            return "affine", matrix.astype(float), vector.astype(float)


def _polynomials(terms: Terms, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the row of each term, its coefficient and its factors."""
    place = np.empty(max(terms.n, 1), dtype=np.int64)
    place[rows] = np.arange(rows.size)
    return (
        place[terms.component],
        terms.coefficient.astype(float),
        np.ascontiguousarray(terms.variables),
    )


def _waves(terms: Terms) -> list[tuple[np.ndarray, np.ndarray, float]]:
    return [
        (np.array(wave.places, dtype=np.int64), np.array(wave.k, dtype=float), wave.phase)
        for wave in terms.waves
    ]
