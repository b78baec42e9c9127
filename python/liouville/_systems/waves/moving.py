"""Hermitian operators that depend on time and are known by their products only."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics.arguments import count
from liouville._basics.errors import hinted, misshapen
from liouville._systems.waves.foreign import plain
from liouville._systems.waves.products import Product, vector

#: Operators that are kept: a step takes sums of as many.
KEPT = 4

#: Times at which its order is looked for: at the first of them many have a division by zero.
TRIED = (0.0, 1.0)


@dataclass(frozen=True)
class MovingProduct:
    """A function that makes products with a Hermitian matrix of order n that depends on time.

    Attributes
    ----------
    name : str
        Its name in messages.
    n : int
        The order.
    function : callable
        A time and a complex vector in, a vector out, both of shape (n,).
    """

    name: str
    n: int
    function: Callable[[float, np.ndarray], Any]

    @classmethod
    def read(cls, name: str, given: Any) -> MovingProduct | None:
        """Read a pair (n, function of t and x), or a function of t that returns an operator."""
        if isinstance(given, tuple) and len(given) == 2 and callable(given[1]):
            if _parameters(given[1]) != 2:
                return None
            return cls(name, count(f"the size of {name}", given[0]), given[1])
        if not callable(given) or hasattr(given, "matvec") or _parameters(given) != 1:
            return None
        return cls(name, _order(name, given), OperatorAt(name, given))

    def check_alone(self, drive: Sequence[Any]) -> None:
        """Refuse drives beside it."""
        if drive:
            hint = "add them to its products"
            raise TypeError(hinted(f"{self.name} is a function of time and takes no drive", hint))

    def at(self, t: float) -> Product:
        """Return the operator at a time, whose products with two vectors have been looked at.

        Raises
        ------
        TypeError, ValueError
            It returns no numbers there, not as many, none that are finite, or is not linear.
        """
        found = Product(self.n, partial(self.function, t), is_real=False)
        return found.checked(f"{self.name}({t:g})")

    def multiply(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the product at a time, which is looked at: it may be another than at the start."""
        name = f"{self.name}({t:g})"
        found = vector(name, self.function(t, x), self.n)
        if not np.isfinite(found).all() and np.isfinite(x).all():
            place = int(np.flatnonzero(~np.isfinite(found))[0])
            raise ValueError(f"{name} returns {found[place]} in place {place}")
        return found

    def operator(self, factor: float) -> _core.Operator:
        """Return sums of it at several times, on (q, p), times a number."""

        def multiply(nodes: list[tuple[float, float]], x: np.ndarray) -> np.ndarray:
            psi = x[: self.n] + 1j * x[self.n :]
            found = np.zeros(self.n, dtype=complex)
            for weight, t in nodes:
                found += factor * weight * self.multiply(t, psi)
            return np.concatenate([found.real, found.imag])

        return _core.Operator.product(2 * self.n, multiply, is_driven=True)


class OperatorAt:
    """Products with what a function of time returns, which is called once for each time."""

    def __init__(self, name: str, function: Callable[[float], Any]) -> None:
        self.name, self.function = name, function
        self._at = lru_cache(KEPT)(partial(_operator, name, function))

    def __call__(self, t: float, x: np.ndarray) -> Any:
        """Return the product with a vector; ValueError if the operator has another order."""
        n, multiply = self._at(t)
        if n != x.size:
            wanted = f"({x.size}, {x.size}) as at t = 0"
            raise misshapen(f"{self.name}({t:g})", (n, n), wanted)
        return multiply(x)

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the function alone."""
        return OperatorAt, (self.name, self.function)


def _order(name: str, function: Callable[[float], Any]) -> int:
    """Return the order of an operator that depends on time, at the first time where it is one."""
    for t in TRIED[:-1]:
        with contextlib.suppress(ArithmeticError), np.errstate(all="ignore"):
            return _operator(name, function, t)[0]
    return _operator(name, function, TRIED[-1])[0]


def _operator(
    name: str, function: Callable[[float], Any], t: float
) -> tuple[int, Callable[[np.ndarray], Any]]:
    """Return the order of an operator at a time, and its product."""
    found = plain(name, function(t))
    shape = getattr(found, "shape", None)
    multiply = getattr(found, "matvec", None) or getattr(found, "__matmul__", None)
    if shape is None or multiply is None:
        sentence = f"{name}({t:g}) must be an operator, not {type(found).__name__}"
        hint = "of products H psi give (N, function of psi) or (N, function of t and psi)"
        raise TypeError(hinted(sentence, hint))
    if len(shape) != 2 or shape[0] != shape[1]:
        raise misshapen(f"{name}({t:g})", shape, "(N, N)")
    return int(shape[0]), multiply


def _parameters(function: Callable[..., Any]) -> int:
    """Return how many arguments a function must have; one if it has no signature."""
    try:
        known = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # of some functions that are not written in Python
        return 1
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(one.kind in kinds and one.default is one.empty for one in known)
