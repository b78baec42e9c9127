"""Explicit Runge-Kutta methods for triangular pieces: every one of them keeps volume there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics.errors import hinted


@dataclass(frozen=True, eq=False)
class Tableau:
    """A strictly lower triangular matrix A and weights b with sum 1."""

    a: np.ndarray
    b: np.ndarray

    @property
    def stages(self) -> int:
        """Return how many stages there are."""
        return self.b.size


#: By name: Euler; Runge's midpoint rule; Heun's trapezoidal rule; Kutta's of orders 3 and 4.
NAMED: dict[str, tuple[list[list[float]], list[float]]] = {
    "euler": ([[]], [1]),
    "midpoint": ([[], [1 / 2]], [0, 1]),
    "heun": ([[], [1]], [1 / 2, 1 / 2]),
    "kutta3": ([[], [1 / 2], [-1, 2]], [1 / 6, 2 / 3, 1 / 6]),
    "rk4": ([[], [1 / 2], [0, 1 / 2], [0, 0, 1]], [1 / 6, 1 / 3, 1 / 3, 1 / 6]),
}


def tableau(given: str | tuple[Any, Any]) -> Tableau:
    """Return an explicit method by its name, or from arrays (A, b).

    Raises
    ------
    ValueError
        The name is unknown, the arrays do not fit, or the method is not explicit or consistent.

    References
    ----------
    The named ones are in section II.1 of :cite:t:`hairer1993`.
    """
    if isinstance(given, str):
        if given not in NAMED:
            raise ValueError(f"runge_kutta must be one of {', '.join(NAMED)}, not {given!r}")
        rows, weights = NAMED[given]
        a = np.zeros((len(rows), len(rows)))
        for r, row in enumerate(rows):
            a[r, : len(row)] = row
        return Tableau(a, np.array(weights, dtype=float))
    if not isinstance(given, Sequence) or len(given) != 2:
        raise TypeError(f"runge_kutta must be a name or a pair of arrays (A, b), not {given!r}")
    a, b = (np.array(part, dtype=float) for part in given)
    if b.ndim != 1 or a.shape != (b.size, b.size):
        raise ValueError(f"A and b must have shapes (s, s) and (s,), not {a.shape} and {b.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()) or np.triu(a).any():
        raise ValueError(
            hinted("A is not strictly lower triangular", "triangular pieces take explicit methods")
        )
    if abs(b.sum() - 1) > 1e-14:
        raise ValueError(f"the weights b sum to {b.sum():.16g}, not to 1")
    return Tableau(a, b)
