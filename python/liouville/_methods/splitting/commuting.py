"""Fields that are shears as they are: x' = f(x) with f constant along all values of f.

Then x + h f(x) is the flow. With a basis b_k of what f has for values, f = sum b_k g_k and
b_j . grad g_k = 0 for all j and k: shears that commute.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liouville._methods.splitting.elimination import NOISE
from liouville._methods.splitting.pieces import Shear
from liouville._systems.fields.terms import Terms


def commuting(terms: Terms) -> list[Shear]:
    """Return shears that commute and are the whole field; empty where it is none of that kind.

    The test is exact for rational coefficients, and up to roundoff for floating-point ones. Fields
    of variables that occur in no component are natural shears, and none of these.
    """
    terms = terms.merged(NOISE)
    found: list[Shear] = []
    if terms.functions:
        return found
    rest = terms
    while len(rest):
        largest = int(np.argmax(np.abs(rest.coefficient)))
        has_monomial = (rest.variables == rest.variables[largest]).all(axis=1)
        part, pivot = rest.selected(has_monomial), int(rest.component[largest])
        direction = np.zeros(terms.n, dtype=terms.coefficient.dtype)
        direction[part.component] = part.coefficient / rest.coefficient[largest]
        if len(_along(terms, direction)):
            return []
        own = rest.selected(rest.component == pivot)
        shear = Shear(direction, replace(own, component=np.zeros_like(own.component)))
        found.append(shear)
        rest = rest.joined(shear.field().scaled(-1)).merged(NOISE)
    is_natural = all(np.count_nonzero(shear.direction) == 1 for shear in found)
    return [] if is_natural else found


def _along(terms: Terms, direction: np.ndarray) -> Terms:
    """Return the derivative of a field along a direction."""
    parts = []
    for column in range(terms.variables.shape[1]):
        factor = terms.variables[:, column]
        hit = (factor >= 0) & (direction[factor] != 0)
        part = terms.selected(hit)
        variables = part.variables.copy()
        variables[:, column] = -1
        part = replace(part, variables=np.sort(variables, axis=1))
        parts.append(part.scaled(direction[factor[hit]]))
    return parts[0].joined(*parts[1:]).merged(NOISE) if parts else Terms.none(terms.n)
