"""Hermitian operators that are known by their products only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics.arguments import count
from liouville._basics.errors import hinted, misshapen

#: A product with i x may differ from i times that with x by so much of its largest number.
LINEAR = 1e-10


def vector(name: str, found: Any, n: int) -> np.ndarray:
    """Return a product as n numbers; TypeError or ValueError for what a function else returns."""
    array = np.asarray(found)
    if array.dtype.kind not in "biufc":
        what = type(found).__name__ if array.dtype.kind == "O" else str(array.dtype)
        raise TypeError(f"{name} must return numbers for a vector, not {what}")
    if array.shape not in ((n,), (n, 1)):
        raise misshapen(f"the vector that {name} returns", array.shape, f"({n},)")
    if array.dtype.kind in "fc":
        with np.errstate(over="ignore"):  # of longer types, which are infinite then
            array = array.astype(complex if array.dtype.kind == "c" else float, copy=False)
    return array.reshape(n)


@dataclass(frozen=True)
class Product:
    """A function that makes products with a Hermitian matrix of order n.

    Attributes
    ----------
    n : int
        The order.
    function : callable
        A vector in, a vector out, both of shape (n,): real ones if the matrix is.
    is_real : bool
        Whether it is.
    """

    n: int
    function: Callable[[np.ndarray], Any]
    is_real: bool = True

    @classmethod
    def read(cls, name: str, given: Any) -> Product | None:
        """Read a LinearOperator of SciPy's, or a pair (n, function); None if it is neither."""
        if isinstance(given, tuple) and len(given) == 2 and callable(given[1]):
            return cls(count(f"the size of {name}", given[0]), given[1]).checked(name)
        if not (hasattr(given, "matvec") and hasattr(given, "shape")):
            return None
        if len(given.shape) != 2 or given.shape[0] != given.shape[1]:
            raise misshapen(name, given.shape, "(N, N)")
        is_real = np.dtype(getattr(given, "dtype", None) or float).kind != "c"
        return cls(int(given.shape[0]), given.matvec, is_real).checked(name)

    def checked(self, name: str) -> Product:
        """Return it, complex where its product is; ValueError for what is no linear operator."""
        array = vector(name, self.function(np.ones(self.n)), self.n)
        bad = np.flatnonzero(~np.isfinite(array))
        if bad.size:
            raise ValueError(f"{name} returns {array.flat[bad[0]]} in place {bad[0]}")
        if self.is_real and array.dtype.kind != "c":
            return self
        found = replace(self, is_real=False)
        found._check_linear(name)
        return found

    def _check_linear(self, name: str) -> None:
        """Refuse a function of real parts alone, or of a conjugate."""
        x = np.exp(1j * np.arange(self.n) ** 2)
        moved, turned = self.multiply(x), self.multiply(1j * x)
        off = np.abs(turned - 1j * moved).max()
        largest = np.abs(moved).max(initial=0.0)
        if not off <= LINEAR * largest:
            sentence = (
                f"{name} is not linear: of i x it makes no i H x, by {off:.1e} of {largest:.1e}"
            )
            raise ValueError(hinted(sentence, "take no real part and no conjugate of the vector"))

    def multiply(self, x: np.ndarray) -> np.ndarray:
        """Return the product with a complex vector, of a complex matrix."""
        return vector("the product with H", self.function(x), self.n).astype(complex)

    def operator(self, factor: float, is_doubled: bool = False) -> _core.Operator:
        """Return the operator, times a number; of a doubled or complex one that on (q, p)."""

        def multiply(x: np.ndarray) -> np.ndarray:
            found = vector("the product with H", self.function(x), self.n)
            if found.dtype.kind == "c":
                raise TypeError("the product with H is complex, and of another real vector was not")
            return np.ascontiguousarray(found, dtype=float) * factor

        def multiply_parts(x: np.ndarray) -> np.ndarray:
            found = self.multiply(x[: self.n] + 1j * x[self.n :]) * factor
            return np.concatenate([found.real, found.imag])

        if not self.is_real:
            return _core.Operator.product(2 * self.n, multiply_parts)
        found = _core.Operator.product(self.n, multiply)
        return found.repeated(2) if is_doubled else found
