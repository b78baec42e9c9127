"""Exponentials: x_i' = c_i x_i x^j, one piece for each monomial of the divergence, or several."""

from __future__ import annotations

from dataclasses import replace
from math import gcd

import numpy as np

from liouville._methods.splitting.colouring import Conflicts, Lists, coloured
from liouville._methods.splitting.natural import classes
from liouville._methods.splitting.pieces import LARGEST_ROOT, Exponential, Scaling, same_kind
from liouville._systems.fields.terms import Terms, grouped


def exponentials(
    terms: Terms, merged: bool = True, paired: bool = False
) -> list[Scaling | Exponential]:
    """Split a diagonal field into exponentials.

    Parameters
    ----------
    terms : Terms
        Each term contains the variable of its component, and no function of it.
    merged : bool
        Whether monomials that stand still in their flow are united while none that is read is
        changed. Else there is one piece for each monomial, lower degrees first.
    paired : bool
        Whether the others change two variables each where that needs no logarithms.
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
    pieces = [rate.selected(alone[places]) for places in classes(label[alone])]
    if paired:
        pieces = [pair for piece in pieces for pair in _pairs(piece)]
    return [*scalings, *map(_exponential, pieces)]


def has_pairs(terms: Terms) -> bool:
    """Return whether exponentials of a diagonal field are not the same in pairs."""
    return len(exponentials(terms, paired=True)) > len(exponentials(terms))


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


def _pairs(rate: Terms) -> list[Terms]:
    """Split the rates of one monomial x^j into those of two variables each, one of them in all.

    With c_i of the other variable, that one has -c_i (j_i + 1) / (j + 1), j its own power: the
    powers of 1 - alpha h m do not depend on the field then, and are fractions of |j_i - j|.
    """
    if len(rate) < 3:
        return [rate]
    power = [int(p) for p in (rate.variables[:1] == rate.component[:, None]).sum(axis=1)]
    costs = [_cost_around(j, [*power[:at], *power[at + 1 :]]) for at, j in enumerate(power)]
    at = int(np.argmin(costs))
    if not np.isfinite(costs[at]):
        return [rate]
    pairs = []
    for other in (k for k in range(len(rate)) if k != at):
        pair = rate.selected(np.array([other, at]))
        one = same_kind(np.array([power[other] + 1]), rate) / same_kind(
            np.array([power[at] + 1]), rate
        )
        rates = pair.coefficient.copy()
        rates[1] = -rates[0] * one[0]
        pairs.append(replace(pair, coefficient=rates))
    return pairs


def _cost_around(j: int, others: list[int]) -> float:
    """Return the sum of the degrees of the roots that pairs take, infinite without roots."""
    degrees = [abs(k - j) // gcd(k - j, j + 1) for k in others]
    return sum(degrees) if all(0 < q <= LARGEST_ROOT for q in degrees) else np.inf


def _exponential(rate: Terms) -> Exponential:
    row = rate.variables[0]
    monomial = tuple(row[row >= 0].tolist())
    return Exponential(rate.n, rate.component, rate.coefficient, monomial, rate.functions)
