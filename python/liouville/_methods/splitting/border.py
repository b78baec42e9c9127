"""Pieces on their way to the core: tuples of arrays, the kind first."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from liouville import _core
from liouville._methods.splitting.pieces import (
    Affine,
    Exponential,
    Natural,
    Piece,
    Scaling,
    Shear,
    Split,
    Turn,
)
from liouville._methods.splitting.planes import Plane, PlaneSplit
from liouville._systems.fields.terms import Function, Terms, Wave

#: Split fields as they are in the core, by those in Python.
_IN_CORE: WeakKeyDictionary[Split | PlaneSplit, _core.Split] = WeakKeyDictionary()


def to_core(split: Split | PlaneSplit) -> _core.Split:
    """Hand a split field to the core, once."""
    found = _IN_CORE.get(split)
    if found is None:
        found = _core.Split(split.n, [packed(piece) for piece in split.pieces])
        _IN_CORE[split] = found
    return found


def packed(piece: Piece | Plane) -> tuple[Any, ...]:
    """Return a piece as the core reads it; its terms have the numbers of their rows."""
    match piece:
        case Natural():
            return ("natural", *_rows(piece.terms.compact()))
        case Shear():
            places = np.flatnonzero(piece.direction)
            direction = _floats(piece.direction[places])
            g = piece.g.compact()
            terms = _terms(g, np.zeros(1, dtype=np.int64))
            return ("shear", places, direction, *terms, _functions(g))
        case Scaling():
            return ("scaling", *_rows(piece.rate.compact()))
        case Exponential():
            rates = _floats(piece.rates)
            m = Terms.of(piece.n, [(0, 1, piece.monomial)], piece.factors).compact()
            return ("exponential", piece.places, rates, m.variables[0], _functions(m))
        case Affine():
            return ("affine", _floats(piece.matrix), _floats(piece.vector))
        case Turn():
            r = piece.rates.compact()
            terms = _terms(r, np.arange(6))
            return ("turn", piece.places, *terms, _functions(r), piece.is_cayley)
        case Plane():
            return ("plane", piece.plane, np.array(piece.variables, dtype=np.int64))
        case _:
            a, b = piece.tableau.a, piece.tableau.b
            return ("triangular", piece.order, *_terms(piece.terms, piece.order), a, b)


def _floats(numbers: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(numbers, dtype=float)


def _rows(terms: Terms) -> tuple[Any, ...]:
    """Return components that are not zero, their terms, and the functions among their factors."""
    rows = np.unique(terms.component)
    return rows, *_terms(terms, rows), _functions(terms)


def _terms(terms: Terms, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    number = np.zeros(terms.n, dtype=np.int64)
    number[rows] = np.arange(rows.size)
    factors = np.ascontiguousarray(terms.variables)
    return number[terms.component], _floats(terms.coefficient), factors


def _functions(terms: Terms) -> list[tuple[Any, ...]]:
    """Return the functions among the factors of terms as the core reads them."""
    return [_function(function) for function in terms.functions]


def _function(function: Wave | Function) -> tuple[Any, ...]:
    places = np.array(function.places, dtype=np.int64)
    if isinstance(function, Wave):
        return places, np.array(function.k, dtype=float), function.phase
    return places, function.value, function.slopes, function.output
