"""Natural shears: x_i += h R_i(x), one variable at a time or those of one colour at once."""

from __future__ import annotations

import numpy as np

from liouville._methods.splitting.colouring import Conflicts, Lists, coloured
from liouville._methods.splitting.pieces import Natural
from liouville._systems.fields.terms import Terms


def natural(terms: Terms, merged: bool = True) -> list[Natural]:
    """Split an off-diagonal field into natural shears.

    Parameters
    ----------
    terms : Terms
        No component depends on its own variable.
    merged : bool
        Whether components of one colour are one piece; else each is one, in their order.
    """
    terms = terms.merged()
    colours = component_colours(terms) if merged else np.arange(terms.n)
    return [Natural(terms.selected(there)) for there in classes(colours[terms.component])]


def component_colours(terms: Terms) -> np.ndarray:
    """Colour the components so that none depends on a variable of its own colour.

    Components that are zero have the colour -1.
    """
    rows = np.unique(terms.component)
    number = np.full(terms.n, -1)
    number[rows] = np.arange(rows.size)
    term, variable = terms.dependencies()
    moves = number[variable] >= 0  # a variable without velocity conflicts with none
    reads = Lists.of(number[terms.component[term[moves]]], variable[moves], rows.size)
    writes = Lists(list(range(rows.size + 1)), rows.tolist())
    colours = np.full(terms.n, -1)
    colours[rows] = coloured(Conflicts(terms.n, writes, reads))
    return colours


def classes(labels: np.ndarray) -> list[np.ndarray]:
    """Return the places of each label that occurs, labels ascending."""
    order = np.argsort(labels, kind="stable")
    ends = np.flatnonzero(np.diff(labels[order])) + 1
    return np.split(order, ends) if order.size else []
