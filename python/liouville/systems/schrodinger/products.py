"""Hamiltonians that are known by their products only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville import _core
from liouville._arguments import count
from liouville.errors import hinted


@dataclass(frozen=True)
class Product:
    """A function that makes products with a real symmetric matrix of order n.

    Attributes
    ----------
    n : int
        The order.
    function : callable
        A real vector in, a real vector out, both of shape (n,).
    """

    n: int
    function: Callable[[np.ndarray], Any]

    @classmethod
    def read(cls, name: str, given: Any) -> Product | None:
        """Read a LinearOperator of SciPy's, or a pair (n, function); None if it is neither."""
        if isinstance(given, tuple) and len(given) == 2 and callable(given[1]):
            return cls(count(f"the size of {name}", given[0]), given[1])._checked(name)
        if not (hasattr(given, "matvec") and hasattr(given, "shape")):
            return None
        if len(given.shape) != 2 or given.shape[0] != given.shape[1]:
            raise ValueError(f"{name} has shape {given.shape}, wanted a square operator")
        if np.dtype(getattr(given, "dtype", None) or float).kind == "c":
            raise TypeError(
                hinted(
                    f"{name} is a complex operator known by its products only",
                    "give a complex Hamiltonian as a matrix: its phases may be taken away",
                )
            )
        return cls(int(given.shape[0]), given.matvec)._checked(name)

    def _checked(self, name: str) -> Product:
        found = self.function(np.ones(self.n))
        array = np.asarray(found)
        if array.dtype.kind not in "biuf":
            what = type(found).__name__ if array.dtype.kind == "O" else str(array.dtype)
            raise TypeError(f"{name} returns {what} for a real vector, wanted real numbers")
        if array.shape not in ((self.n,), (self.n, 1)):
            raise ValueError(f"{name} returns shape {array.shape}, wanted ({self.n},)")
        bad = np.flatnonzero(~np.isfinite(array))
        if bad.size:
            raise ValueError(f"{name} returns {array.flat[bad[0]]} in place {bad[0]}")
        return self

    def operator(self, factor: float) -> _core.Operator:
        """Return the operator, times a number."""

        def multiply(x: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(np.ravel(self.function(x)), dtype=float) * factor

        return _core.Operator.product(self.n, multiply)
