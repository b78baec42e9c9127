"""Exponentials that cannot blow up: shears take the squares out of the diagonal part first."""

from __future__ import annotations

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods.splitting.elimination import NOISE
from liouville._methods.splitting.pieces import Shear, one_component
from liouville._systems.fields.terms import Terms, exact

#: Fields with less than this part of all their terms are sparse.
SPARSE = 0.3

#: In sparse fields a shear is along so many variables, up to two more.
GROUP = 3


def regular(terms: Terms) -> tuple[list[Shear], Terms]:
    """Take shears from a field of degree 2 so that its exponentials have no singularities.

    Along a = (1, ..., 1) in m >= 3 of the variables,

        g = sum_(i<l) w_il (x_i - x_l)^2,   w_il = (s_i + s_l - S / (m - 1)) / (m - 2),

    where s_i is the coefficient of x_i^2 in component i and S the sum of these: then a g has the
    same squares, as sum_l w_il = s_i. In a dense field there is one such shear, in a sparse one
    they are along few variables each.

    Parameters
    ----------
    terms : Terms
        A field without divergence and without waves.

    Returns
    -------
    list of Shear
        The shears.
    Terms
        The rest, whose diagonal part has no squares, while its off-diagonal one has more terms.

    Raises
    ------
    ValueError
        The diagonal part has another degree than 2, or there are less than 3 variables.
    """
    terms = terms.merged()
    diagonal = terms.diagonal()
    if diagonal.degree > 2:
        raise ValueError(
            hinted(
                "exponentials without singularities are for a diagonal part of degree 2, not "
                f"{diagonal.degree}",
                "take diagonal='exponentials' or 'shears'",
            )
        )
    squares = diagonal.selected(
        (diagonal.variables == diagonal.component[:, None]).sum(axis=1) == 2
    )
    if not len(squares):
        return [], terms
    if terms.n < 3:
        hint = "take diagonal='exponentials' or 'shears'"
        raise ValueError(hinted("exponentials without singularities want 3 variables", hint))
    s = np.zeros(terms.n, dtype=object if terms.is_exact else float)
    s[squares.component] = squares.coefficient
    is_dense = len(terms) >= SPARSE * terms.n * (terms.n + 1) * (terms.n + 2) / 2
    groups = [np.arange(terms.n)] if is_dense else _groups(terms, squares.component)
    pieces = [_shear(terms.n, group, s[group], terms.is_exact) for group in groups]
    rest = terms.joined(*(piece.field().scaled(-1) for piece in pieces)).merged(NOISE)
    has_square = (rest.variables == rest.component[:, None]).sum(axis=1) == 2
    return pieces, rest.selected(~has_square)  # of squares only roundoff is left


def _groups(terms: Terms, places: np.ndarray) -> list[np.ndarray]:
    """Divide variables into groups of at least three neighbours, some others added if need be."""
    if places.size < GROUP:
        others = np.setdiff1d(np.arange(terms.n), places)
        term, variable = terms.dependencies()
        used = variable[np.isin(terms.component[term], places)]
        near = np.bincount(used, minlength=terms.n)[others]
        chosen = others[np.argsort(-near, kind="stable")][: GROUP - places.size]
        return [np.sort(np.concatenate([places, chosen]))]
    return np.array_split(places, places.size // GROUP)


def _shear(n: int, group: np.ndarray, s: np.ndarray, is_exact: bool) -> Shear:
    m = group.size
    first, second = np.triu_indices(m, 1)
    whole = s.sum()
    w = (s[first] + s[second] - whole / (m - 1)) / (m - 2)
    if not is_exact:
        w[np.abs(w) <= NOISE * np.abs(s).sum()] = 0.0
    i, k = group[first], group[second]
    squares = [(w, np.column_stack([i, i])), (w, np.column_stack([k, k]))]
    g = one_component(n, [*squares, (-2 * w, np.column_stack([i, k]))], is_exact)
    direction = np.zeros(n)
    direction[group] = 1
    return Shear(exact(direction) if is_exact else direction, g)
