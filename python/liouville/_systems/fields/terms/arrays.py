"""Arrays of numbers, exact or not, and rows of them in groups."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np


def exact(numbers: Iterable[Any]) -> np.ndarray:
    """Return numbers as an array of fractions; floating-point ones are taken as they stand."""
    fractions = [
        Fraction(c) if not isinstance(c, np.generic) else Fraction(c.item()) for c in numbers
    ]
    result = np.empty(len(fractions), dtype=object)
    result[:] = fractions
    return result


def grouped(columns: Sequence[np.ndarray], size: int) -> tuple[np.ndarray, np.ndarray]:
    """Sort rows given by columns of numbers from -1 to `size` - 1; find where equal ones start.

    Returns the order of the rows, the first column leading, and the place of each group's first
    row in it.
    """
    base, most = size + 1, np.iinfo(np.int64).max
    keys: list[np.ndarray] = []
    room = 0
    for column in columns:
        if room > base:
            keys[-1] = keys[-1] * base + (column + 1)
            room //= base
        else:
            keys.append(column + 1)
            room = most // base
    rows = columns[0].size if columns else 0
    if len(keys) == 1 and (keys[0][1:] >= keys[0][:-1]).all():
        order = np.arange(rows)
    else:
        order = np.lexsort(keys[::-1]) if keys else np.arange(rows)
    differs = np.zeros(rows, dtype=bool)
    differs[:1] = True
    for key in keys:
        differs[1:] |= key[order][1:] != key[order][:-1]
    return order, np.flatnonzero(differs)


def widened(variables: np.ndarray, width: int) -> np.ndarray:
    """Put absent factors in front."""
    return np.pad(variables, ((0, 0), (width - variables.shape[1], 0)), constant_values=-1)
