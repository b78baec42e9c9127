"""Pieces on their way to the core: tuples of arrays, the kind first."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville import _core
from liouville.splitting.pieces import Affine, Exponential, Natural, Piece, Scaling, Shear, Split
from liouville.terms import Terms


def crossed(split: Split) -> _core.Split:
    """Hand a split field to the core."""
    return _core.Split(split.n, [packed(piece) for piece in split.pieces])


def packed(piece: Piece) -> tuple[Any, ...]:
    """Return a piece as the core reads it; its terms know their rows by number."""
    match piece:
        case Natural():
            rows = np.unique(piece.terms.component)
            return ("natural", rows, *_terms(piece.terms, rows), _waves(piece.terms))
        case Shear():
            places = np.flatnonzero(piece.direction)
            direction = _floats(piece.direction[places])
            g = _terms(piece.g, np.zeros(1, dtype=np.int64))
            return ("shear", places, direction, *g, _waves(piece.g))
        case Scaling():
            rows = np.unique(piece.rate.component)
            return ("scaling", rows, *_terms(piece.rate, rows))
        case Exponential():
            monomial = np.array(piece.monomial, dtype=np.int64)
            return ("exponential", piece.places, _floats(piece.rates), monomial)
        case Affine():
            return ("affine", _floats(piece.matrix), _floats(piece.vector))
        case _:
            a, b = piece.tableau.a, piece.tableau.b
            return ("triangular", piece.order, *_terms(piece.terms, piece.order), a, b)


def _floats(numbers: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(numbers, dtype=float)


def _terms(terms: Terms, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    number = np.zeros(terms.n, dtype=np.int64)
    number[rows] = np.arange(rows.size)
    factors = np.ascontiguousarray(terms.variables)
    return number[terms.component], _floats(terms.coefficient), factors


def _waves(terms: Terms) -> list[tuple[np.ndarray, np.ndarray, float]]:
    return [
        (np.array(wave.places, dtype=np.int64), np.array(wave.k, dtype=float), wave.phase)
        for wave in terms.waves
    ]
