"""Pieces in words, with the names of the variables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
from liouville._methods.splitting.trigonometric import numbered
from liouville._systems.fields.terms import Terms

#: As many variables are named; of more than that, the first few are.
NAMED, FEW = 8, 3


def described(piece: Piece, names: Sequence[str] | None = None) -> str:
    """Describe a piece: which variables it changes, and how."""
    match piece:
        case Natural():
            changed, terms = piece.terms.component, piece.terms
            return f"natural shear of {_listed(changed, terms.n, names)}: {_counted(terms)}"
        case Shear():
            changed, terms = np.flatnonzero(piece.direction), piece.g
            return f"shear along {_listed(changed, terms.n, names)}: {_counted(terms)}"
        case Scaling():
            changed, terms = piece.rate.component, piece.rate
            return f"scaling of {_listed(changed, terms.n, names)}: {_counted(terms)}"
        case Exponential():
            by = piece.field().written(piece.monomial, names or numbered(piece.n))
            what = f"exponential of {_listed(piece.places, piece.n, names)}"
            return f"{what} by {by}" if piece.monomial else what
        case Turn():
            what = "turn by Cayley's map" if piece.is_cayley else "turn"
            pushed = " and push" if (piece.rates.component >= 3).any() else ""
            return f"{what}{pushed} of {_listed(piece.places, piece.rates.n, names)}"
        case Affine():
            terms = piece.field()
            changed = terms.component
            return f"affine part, of {_listed(changed, terms.n, names)}: {_counted(terms)}"
        case _:
            changed, terms = piece.order, piece.terms
            return f"triangular in {_listed(changed, terms.n, names)}: {_counted(terms)}"


def variables_of(parts: Split, names: Sequence[str] | None = None) -> Sequence[str]:
    """Name what the pieces change: the variables, or those y of x = A y."""
    if parts.basis is None:
        return names or numbered(parts.n)
    return [f"y{k}" for k in range(parts.n)]


def _listed(places: np.ndarray, n: int, names: Sequence[str] | None) -> str:
    """Name variables, or some of very many."""
    words = names or numbered(n)
    changed = np.unique(places).tolist()
    shown = changed if len(changed) <= NAMED else changed[:FEW]
    more = f" and {len(changed) - FEW} more" if len(changed) > NAMED else ""
    return ", ".join(words[v] for v in shown) + more


def _counted(terms: Terms) -> str:
    return "1 term" if len(terms) == 1 else f"{len(terms)} terms"
