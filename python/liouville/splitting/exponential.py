"""Exponentials: x_i' = c_i x_i x^j, one piece for each monomial of the divergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liouville.splitting.colouring import Conflicts, Lists, coloured
from liouville.splitting.natural import classes
from liouville.splitting.pieces import Exponential, Scaling
from liouville.terms import Terms, grouped


def exponentials(terms: Terms, merged: bool = True) -> list[Scaling | Exponential]:
    """Split a diagonal field into exponentials.

    Parameters
    ----------
    terms : Terms
        Each term contains the variable of its component, and no function of it.
    merged : bool
        Whether monomials that stand still in their flow are united while none that is read is
        changed. Else there is one piece for each monomial, lower degrees first.
    """
    if not len(terms):
        return []
    rate, label = by_monomial(terms)
    still = ~_changes(rate, label) if merged else np.zeros(label.max() + 1, dtype=bool)
    if still.any():
        there = still[label]
        colours = _united(rate.selected(there), label[there])
        scalings = [Scaling(rate.selected(there).selected(c)) for c in classes(colours)]
    else:
        scalings = []
    alone = np.flatnonzero(~still[label])
    pieces = [alone[places] for places in classes(label[alone])]
    return [*scalings, *(_exponential(rate.selected(places)) for places in pieces)]


def by_monomial(terms: Terms) -> tuple[Terms, np.ndarray]:
    """Take a factor x_i from each term of component i, and number the monomials that are left."""
    terms = terms.merged()
    hits = terms.variables == terms.component[:, None]
    if not hits.any(axis=1).all():
        raise ValueError("an exponential needs the variable of its component in each term")
    variables = terms.variables.copy()
    variables[np.arange(len(terms)), hits.argmax(axis=1)] = -1
    rate = replace(terms, variables=np.sort(variables, axis=1))
    order, starts = grouped(list(rate.variables.T), terms.n + len(terms.functions))
    label = np.empty(len(rate), dtype=np.int64)
    label[order] = np.repeat(np.arange(starts.size), np.diff([*starts, len(rate)]))
    return rate, label


def _changes(rate: Terms, label: np.ndarray) -> np.ndarray:
    """Return for each monomial whether one of its variables is changed by its own piece."""
    moved = (rate.variables == rate.component[:, None]).any(axis=1)
    return np.bincount(label, moved, label.max() + 1) > 0


def _united(rate: Terms, label: np.ndarray) -> np.ndarray:
    """Colour the monomials, and return each term's colour."""
    _, number = np.unique(label, return_inverse=True)
    count = int(number.max()) + 1
    term, variable = rate.dependencies()
    writes = Lists.of(number, rate.component, count)
    reads = Lists.of(number[term], variable, count)
    return coloured(Conflicts(rate.n, writes, reads))[number]


def _exponential(rate: Terms) -> Exponential:
    row = rate.variables[0]
    monomial = tuple(row[row >= 0].tolist())
    return Exponential(rate.n, rate.component, rate.coefficient, monomial, rate.functions)
