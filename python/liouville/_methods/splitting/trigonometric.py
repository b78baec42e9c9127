"""Shears of fields with waves: x' = a cos(k . x + phase), a . k = 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._methods.splitting.pieces import Shear
from liouville._systems.fields.terms import ROUNDOFF, Terms, Wave, grouped


def numbered(n: int) -> list[str]:
    """Name variables that have no names."""
    return [f"x{i}" for i in range(n)]


def wave_shears(terms: Terms, names: Sequence[str] | None = None) -> tuple[list[Shear], Terms]:
    """Take the diagonal terms with waves that move from a field, as shears.

    Terms of equal factors are x' = a m(x) cos(k . x + phase), which is a shear if a . k = 0 and m
    is free of the variables that move. Those of parallel a are one piece. Where the wave stands
    still too, as a wave of time does, the terms are left for exponentials.

    Parameters
    ----------
    terms : Terms
        A field with at most one wave in a term, a cosine or a sine: ``Terms.resolved``.
    names : sequence of str, optional
        The variables, for messages.

    Returns
    -------
    list of Shear
        The shears.
    Terms
        The rest, whose terms with functions are off-diagonal, or of functions that stand still.

    Raises
    ------
    ValueError
        Some terms are no shear.
    """
    diagonal = terms.diagonal()
    diagonal = diagonal.selected(diagonal.has_function.any(axis=1))
    order, starts = grouped(list(diagonal.variables.T), terms.n + len(terms.functions))
    found: dict[tuple[Any, ...], list[Terms]] = {}
    taken = [terms]
    for rows in np.split(order, starts[1:]) if len(diagonal) else []:
        part = diagonal.selected(rows)
        if not _moves(part):
            continue
        taken.append(part.scaled(-1))
        _check_is_shear(part, names or numbered(terms.n))
        size = part.coefficient[np.abs(part.coefficient).argmax()]
        direction = tuple(zip(part.component.tolist(), part.coefficient / size, strict=True))
        g = Terms(terms.n, np.zeros(1), np.array([size]), part.variables[:1], terms.functions)
        found.setdefault(direction, []).append(g)
    rest = taken[0].joined(*taken[1:]).merged() if found else terms
    return [_shear(terms, a, parts) for a, parts in found.items()], rest


def _moves(part: Terms) -> bool:
    """Return whether terms of equal factors move a variable that one of their functions is of."""
    row = part.variables[0]
    functions = [part.functions[v - part.n] for v in row[row >= part.n]]
    return any(np.isin(part.component, function.places).any() for function in functions)


def _shear(terms: Terms, a: tuple[Any, ...], parts: list[Terms]) -> Shear:
    direction = np.zeros(terms.n, dtype=object if terms.is_exact else float)
    for i, value in a:
        direction[i] = value
    return Shear(direction, parts[0].joined(*parts[1:]).merged())


def _check_is_shear(part: Terms, names: Sequence[str]) -> None:
    """Refuse terms of equal factors that no shear is made of."""
    row = part.variables[0]
    row = row[row >= 0]
    is_free = not np.isin(part.component, row).any()
    slope = np.zeros(part.n)
    for function in (part.functions[v - part.n] for v in row[row >= part.n]):
        if isinstance(function, Wave):
            slope[list(function.places)] = function.k
        else:
            is_free &= not np.isin(part.component, function.places).any()
    products = part.coefficient.astype(float) * slope[part.component]
    if is_free and abs(products.sum()) <= ROUNDOFF * np.abs(products).sum():
        return
    written = part.written(tuple(row.tolist()), names)
    components = ", ".join(f"{names[i]}'" for i in part.component)
    raise ValueError(
        hinted(
            f"the terms {written} in {components} are neither off-diagonal nor a shear",
            "a wave cos(k.x) may move variables it does not contain, or some along a direction "
            "at right angles to k, free of the other factors",
        )
    )
