"""A splitting by the names of its parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods.splitting.directions import along, harmonic
from liouville._methods.splitting.exponential import exponentials
from liouville._methods.splitting.natural import natural
from liouville._methods.splitting.pieces import Affine, Piece, Split
from liouville._methods.splitting.regular import regular
from liouville._methods.splitting.shears import shears
from liouville._methods.splitting.triangular import triangular
from liouville._methods.splitting.trigonometric import numbered, wave_shears
from liouville._methods.splitting.whole import whole
from liouville._systems.fields.terms import Terms

#: The splittings of the diagonal part, or of all of the field.
DIAGONAL = ("shears", "exponentials", "pairs", "regular", "n+d")

#: The splittings of the off-diagonal part.
OFF_DIAGONAL = ("natural", "triangular")

#: Affine parts of more variables are not exponentiated.
MOST_EXPONENTIATED = 2000

#: Monomials that a message names.
MOST_NAMED = 5


def split(
    terms: Terms,
    diagonal: str = "exponentials",
    off_diagonal: str = "natural",
    *,
    directions: Any = None,
    turn: Sequence[int] | None = None,
    permutations: Sequence[Any] | None = None,
    runge_kutta: str | tuple[Any, Any] = "euler",
    linear: str = "split",
    merged: bool = True,
    names: Sequence[str] | None = None,
) -> Split:
    """Write a divergence-free field as a sum of pieces with explicit volume-preserving maps.

    Parameters
    ----------
    terms : Terms
    diagonal : {"exponentials", "pairs", "shears", "regular", "n+d"}
        Pieces of the terms of a component that contain its own variable. ``"pairs"`` are
        exponentials of two variables each. ``"n+d"`` shears are the whole field.
    off_diagonal : {"natural", "triangular"}
        Pieces of the others.
    directions : array_like, optional
        Of ``"shears"``, shape (n, d), or of ``"n+d"``, shape (n, n + d).
    turn : sequence of int, optional
        A permutation of the variables: which of them takes which row of the directions.
    permutations : sequence of permutations, optional
        Of ``"triangular"`` pieces.
    runge_kutta : str or (A, b)
        Their method.
    linear : {"split", "exact"}
        Whether terms of degree 0 and 1 are one affine piece.
    merged : bool
        Whether pieces that can be made at once are one. Else those of the diagonal part come by
        monomial, then natural shears by component.
    names : sequence of str, optional
        The variables, for messages.

    Raises
    ------
    ValueError
        The field has a divergence, or it cannot be split so.
    """
    _check_word("diagonal", diagonal, DIAGONAL)
    _check_word("off_diagonal", off_diagonal, OFF_DIAGONAL)
    _check_word("linear", linear, ("split", "exact"))
    terms = terms.resolved().merged()
    _check_divergence(terms, names)
    affine: list[Piece] = []
    if linear == "exact":
        piece, terms = _affine(terms)
        affine = [piece] if piece else []
    if diagonal == "n+d":
        return _whole(terms, affine, _turned(terms, "n+d", directions, turn), merged)
    waves, terms = wave_shears(terms, names)
    parts, rest = _diagonal(terms, diagonal, _turned(terms, diagonal, directions, turn), merged)
    off = _off_diagonal(rest, off_diagonal, permutations, runge_kutta, merged)
    return Split(terms.n, (*affine, *waves, *parts, *off))


def _diagonal(
    terms: Terms, word: str, directions: np.ndarray | None, merged: bool
) -> tuple[list[Piece], Terms]:
    """Return the pieces of the diagonal part, and what is left.

    Terms with functions are always exponentials.
    """
    has_function = terms.has_function.any(axis=1)
    if word in ("exponentials", "pairs") or not has_function.any():
        return _plain_diagonal(terms, word, directions, merged)
    found, plain = _plain_diagonal(terms.selected(~has_function), word, directions, merged)
    others = terms.selected(has_function)
    rest = plain.joined(others.off_diagonal())
    return [*found, *exponentials(others.diagonal(), merged)], rest


def _plain_diagonal(
    terms: Terms, word: str, directions: np.ndarray | None, merged: bool
) -> tuple[list[Piece], Terms]:
    first: list[Piece] = []
    if word == "shears":
        found, rest = shears(replace(terms, functions=()), directions)
        return [*found], rest
    if word == "regular":
        sheared, terms = regular(replace(terms, functions=()))
        first = [*sheared]
    taken = exponentials(terms.diagonal(), merged, paired=word == "pairs")
    return [*first, *taken], terms.off_diagonal()


def _off_diagonal(
    terms: Terms,
    word: str,
    permutations: Sequence[Any] | None,
    runge_kutta: str | tuple[Any, Any],
    merged: bool,
) -> list[Piece]:
    if word == "natural":
        return [*natural(terms, merged)]
    has_function = terms.has_function.any(axis=1)
    plain = replace(terms.selected(~has_function), functions=())
    others = natural(terms.selected(has_function), merged)
    return [*triangular(plain, permutations, runge_kutta, merged), *others]


def _whole(terms: Terms, affine: list[Piece], directions: np.ndarray | None, merged: bool) -> Split:
    if terms.functions:
        hint = "take diagonal='exponentials', which leaves functions to pieces of their own"
        sentence = "n + d shears are for polynomials, and the field has functions"
        raise ValueError(hinted(sentence, hint))
    parts = whole(terms, directions, merged)
    inside = [_in_basis(piece, parts) if isinstance(piece, Affine) else piece for piece in affine]
    return replace(parts, pieces=(*inside, *parts.pieces))


def _in_basis(piece: Affine, parts: Split) -> Affine:
    assert parts.basis is not None
    assert parts.inverse is not None
    inverse = parts.inverse
    return Affine(inverse @ piece.matrix @ parts.basis, inverse @ piece.vector)


def _turned(
    terms: Terms, word: str, directions: Any, turn: Sequence[int] | None
) -> np.ndarray | None:
    """Return directions with their rows in another order, None for the default ones."""
    given = None if directions is None else np.asarray(directions)
    if turn is None or word not in ("shears", "n+d"):
        return given
    if sorted(turn) != list(range(terms.n)):
        raise ValueError(f"turn must be a permutation of the numbers 0 to {terms.n - 1}")
    if given is None and word == "shears":
        given = along(terms.n, terms.diagonal().degree, terms.is_exact)
    elif given is None:
        given = harmonic(terms.n, max(terms.degree, 1), terms.is_exact)
    return np.asarray(given)[list(turn)]


def _affine(terms: Terms) -> tuple[Affine | None, Terms]:
    """Take the terms of degree 0 and 1 from a field."""
    chosen = (terms.degrees <= 1) & ~terms.has_function.any(axis=1)
    part, n = terms.selected(chosen), terms.n
    if not len(part):
        return None, terms
    if n > MOST_EXPONENTIATED:
        raise ValueError(
            hinted(
                f"the exponential of a matrix of order {n} is not formed",
                "take linear='split'",
            )
        )
    kind = object if terms.is_exact else float
    extended = np.zeros((n, n + 1), dtype=kind)
    last = part.variables.max(axis=1, initial=-1)  # -1 is the column of constants
    extended[part.component, last] = part.coefficient
    return Affine(extended[:, :n].copy(), extended[:, n].copy()), terms.selected(~chosen)


def _check_word(name: str, value: Any, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, not {value!r}")


def _check_divergence(terms: Terms, names: Sequence[str] | None) -> None:
    excess = terms.excess()
    if not len(excess):
        return
    names = names or numbered(terms.n)
    found = excess.monomials()
    words = [f"{c} * {excess.written(monomial, names)}" for monomial, c in found[:MOST_NAMED]]
    more = f", and {len(found) - MOST_NAMED} more terms" if len(found) > MOST_NAMED else ""
    raise ValueError(
        hinted(
            f"the divergence of the field is not zero but {' + '.join(words)}{more}",
            "only fields without divergence preserve volume",
        )
    )
