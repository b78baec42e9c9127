"""Strictly triangular pieces: in some order, no component depends on what stands behind it."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods.splitting.natural import component_colours
from liouville._methods.splitting.permutations import covering, family
from liouville._methods.splitting.pieces import Triangular
from liouville._methods.splitting.runge_kutta import tableau
from liouville._systems.fields.terms import Terms, grouped

#: For terms of so many different variables there are families of permutations in closed form.
CLOSED_FORM = 2


def triangular(
    terms: Terms,
    permutations: Sequence[Any] | None = None,
    runge_kutta: str | tuple[Any, Any] = "euler",
    merged: bool = True,
) -> list[Triangular]:
    """Put every term into the first permutation that admits it.

    A term of component i is admitted if i stands after all its variables.

    Parameters
    ----------
    terms : Terms
        No component depends on its own variable; no waves.
    permutations : sequence of permutations of the variables, optional
        By default a family that admits every field of this degree, of as few as is known.
    runge_kutta : str or (A, b)
        The method of each piece.
    merged : bool
        Whether variables of one colour stand for each other in the default family.

    Raises
    ------
    ValueError
        A term is admitted by no permutation.
    """
    terms, method = terms.merged(), tableau(runge_kutta)
    if not len(terms):
        return []
    if permutations is not None:
        positions = _given(permutations, terms.n)
    else:
        positions = _default(terms, merged)
    first = _first_admissible(terms, positions)
    pieces = []
    for q, position in enumerate(positions):
        part = terms.selected(first == q)
        if len(part):
            changed = np.unique(part.component)
            order = changed[np.argsort(position[changed], kind="stable")]
            pieces.append(Triangular(order, part, method))
    return pieces


def _given(permutations: Sequence[Any], n: int) -> np.ndarray:
    orders = np.asarray(permutations)
    if orders.ndim != 2 or orders.shape[1] != n or (np.sort(orders) != np.arange(n)).any():
        raise ValueError(f"permutations must be rows with each of the numbers 0 to {n - 1} once")
    return np.argsort(orders, axis=1)


def _default(terms: Terms, merged: bool) -> np.ndarray:
    """Return places of the variables: those of one colour share one, those at rest stand first."""
    colours = component_colours(terms)
    if not merged:
        colours = np.where(colours < 0, -1, np.arange(terms.n))
    positions = _family(terms, colours)
    at_rest = np.full((len(positions), 1), -1)
    return np.concatenate([positions, at_rest], axis=1)[:, colours]


def _family(terms: Terms, colours: np.ndarray) -> np.ndarray:
    """Return permutations of the colours that admit every term."""
    count = int(colours.max()) + 1
    term, variable = terms.dependencies()
    moves = colours[variable] >= 0
    pairs = [term[moves], colours[variable[moves]]]
    order, starts = grouped(pairs, max(len(terms), count))
    term, colour = (column[order[starts]] for column in pairs)
    each = np.bincount(term, minlength=len(terms))
    d = int(each.max(initial=0))
    if d <= CLOSED_FORM:
        return family(count, d)
    rows = np.full((len(terms), 1 + d), -1)
    rows[:, 0] = colours[terms.component]
    rows[term, 1 + np.arange(term.size) - (np.cumsum(each) - each)[term]] = colour
    if len(_distinct(rows[each == d])) == count * comb(count - 1, d):
        return family(count, d)
    rows = rows[each > 0]
    return covering(count, _distinct(np.where(rows < 0, rows[:, 1:2], rows)))


def _distinct(rows: np.ndarray) -> np.ndarray:
    order, starts = grouped(list(rows.T), int(rows.max(initial=0)) + 1)
    return np.asarray(rows[order[starts]])


def _first_admissible(terms: Terms, positions: np.ndarray) -> np.ndarray:
    """Return the number of the first permutation in which all variables stand before i."""
    first = np.full(len(terms), -1)
    for q in range(len(positions) - 1, -1, -1):
        position = np.append(positions[q], -1)  # of absent factors
        before = position[terms.variables].max(axis=1, initial=-1)
        first[before < position[terms.component]] = q
    if (first < 0).any():
        k = int(np.argmax(first < 0))
        row = terms.variables[k]
        raise ValueError(
            hinted(
                f"no permutation places variable {terms.component[k]} after all of "
                f"{row[row >= 0].tolist()}, and there is such a term",
                "add one, or leave permutations out",
            )
        )
    return first
