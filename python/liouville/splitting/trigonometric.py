"""Shears of fields with waves: x' = a cos(k . x + phase), a . k = 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from liouville.errors import hinted
from liouville.splitting.pieces import Shear
from liouville.terms import ROUNDOFF, Terms, grouped


def numbered(n: int) -> list[str]:
    """Name variables that have no names."""
    return [f"x{i}" for i in range(n)]


def wave_shears(terms: Terms, names: Sequence[str] | None = None) -> tuple[list[Shear], Terms]:
    """Take the diagonal terms with waves from a field, as shears.

    Terms of equal factors are x' = a m(x) cos(k . x + phase), which is a shear if a . k = 0 and m
    is free of the variables that move. Those of parallel a are one piece.

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
        The rest, whose terms with waves are off-diagonal.

    Raises
    ------
    ValueError
        Some terms are no shear.
    """
    diagonal = terms.diagonal()
    diagonal = diagonal.selected((diagonal.variables >= terms.n).any(axis=1))
    if not len(diagonal):
        return [], terms
    order, starts = grouped(list(diagonal.variables.T), terms.n + len(terms.waves))
    found: dict[tuple[Any, ...], list[Terms]] = {}
    for rows in np.split(order, starts[1:]):
        part = diagonal.selected(rows)
        _check_is_shear(part, names or numbered(terms.n))
        size = part.coefficient[np.abs(part.coefficient).argmax()]
        direction = tuple(zip(part.component.tolist(), part.coefficient / size, strict=True))
        g = Terms(terms.n, np.zeros(1), np.array([size]), part.variables[:1], terms.waves)
        found.setdefault(direction, []).append(g)
    rest = terms.joined(diagonal.scaled(-1)).merged()
    return [_shear(terms, a, parts) for a, parts in found.items()], rest


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
    wave = part.waves[row[-1] - part.n]
    slope = np.zeros(part.n)
    slope[list(wave.places)] = wave.k
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
