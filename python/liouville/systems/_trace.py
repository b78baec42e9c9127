"""Calling the user's functions with symbols, and checking what they return."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike


class Parameters:
    """The parameters of a system: names, default values, and their symbols.

    Parameters
    ----------
    defaults : mapping of str to float or 1-D array_like
        Values used unless a run gives others.
    """

    def __init__(self, defaults: Mapping[str, ArrayLike]) -> None:
        self.defaults = {name: _parameter(name, value) for name, value in dict(defaults).items()}
        symbols = {name: ca.SX.sym(name, max(x.size, 1)) for name, x in self.defaults.items()}
        self.vector = ca.vertcat(ca.SX(0, 1), *symbols.values())
        self.namespace = _Namespace(symbols)

    def values(self, changes: Mapping[str, ArrayLike] | None) -> np.ndarray:
        """Return the defaults with changes, one after another."""
        values = dict(self.defaults)
        for name, value in dict(changes or {}).items():
            if name not in values:
                known = ", ".join(self.defaults) or "none"
                raise ValueError(f"there is no parameter '{name}'; the system's parameters: {known}")
            new = _parameter(name, value)
            if new.shape != values[name].shape:
                raise ValueError(
                    f"parameter '{name}' has shape {new.shape}, wanted {values[name].shape}"
                )
            values[name] = new
        return np.concatenate([np.empty(0), *(x.ravel() for x in values.values())])


class _Namespace:
    def __init__(self, symbols: Mapping[str, ca.SX]) -> None:
        self.__dict__.update(symbols)

    def __getattr__(self, name: str) -> ca.SX:
        known = ", ".join(self.__dict__) or "none"
        raise AttributeError(f"there is no parameter '{name}'; the system's parameters: {known}")


def _parameter(name: str, value: ArrayLike) -> np.ndarray:
    if not isinstance(name, str) or not name.isidentifier():
        raise ValueError(f"a parameter's name is an identifier, not {name!r}")
    array = np.array(value)
    if array.dtype.kind not in "iuf" or array.ndim > 1 or array.size == 0:
        raise ValueError(f"parameter '{name}' is a number or a 1-D array of numbers, not {value!r}")
    if not np.isfinite(array).all():
        raise ValueError(f"parameter '{name}' is not finite: {value!r}")
    return array.astype(float)


def names(value: Sequence[str] | int, prefix: str) -> tuple[str, ...]:
    """Return coordinate names, from names or a number of coordinates."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"a system has at least one coordinate, not {prefix}={value}")
        return tuple(f"{prefix}{k}" for k in range(value))
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise TypeError(f"{prefix} is a sequence of names or a number, not {value!r}")
    found = tuple(value)
    if not found or not all(isinstance(name, str) and name for name in found):
        raise ValueError(f"{prefix} needs at least one name, and each a string: {value!r}")
    twice = sorted({name for name in found if found.count(name) > 1})
    if twice:
        raise ValueError(f"{prefix} names {twice[0]!r} twice")
    return found


def call(what: str, function: Callable[..., Any], *args: Any) -> Any:
    """Call a function of the user's with symbols; an error in it says which function it was."""
    if not callable(function):
        raise TypeError(f"{what} is a function, not {function!r}")
    try:
        return function(*args)
    except Exception as error:
        error.add_note(
            f"raised while `{what}` was called with CasADi symbols; "
            "use casadi's functions (ca.sin), and ca.if_else for a choice"
        )
        raise


def scalar(what: str, value: Any) -> ca.SX:
    """Return the expression of a scalar function."""
    expression = _column(what, value)
    if expression.numel() != 1:
        raise ValueError(f"{what} returns {expression.numel()} values, wanted a scalar")
    return expression


def column(what: str, value: Any, size: int | None = None) -> ca.SX:
    """Return the expressions of a vector function as a column of the wanted size."""
    expression = _column(what, value)
    if size is not None and expression.numel() != size:
        raise ValueError(f"{what} returns {expression.numel()} values, wanted {size}")
    return expression


def named(what: str, value: Any) -> tuple[tuple[str, ...], ca.SX]:
    """Return names and expressions of constraints: a mapping, a sequence, or a scalar."""
    if isinstance(value, Mapping):
        found = tuple(str(name) for name in value)
        parts = [scalar(f"{what} '{name}'", part) for name, part in value.items()]
        return found, ca.vertcat(ca.SX(0, 1), *parts)
    expression = _column(what, value)
    count = expression.numel()
    found = (what,) if count == 1 else tuple(f"{what}{k}" for k in range(count))
    return found, expression


def _column(what: str, value: Any) -> ca.SX:
    if value is None:
        raise TypeError(f"{what} returns None; is a `return` missing?")
    if isinstance(value, np.ndarray):
        value = list(value.ravel())
    if isinstance(value, Iterable) and not isinstance(value, (ca.SX, ca.DM, str, bytes)):
        parts = [_column(what, part) for part in value]
        return ca.vertcat(ca.SX(0, 1), *parts)
    try:
        expression = ca.SX(value)
    except (NotImplementedError, TypeError):
        kind = type(value).__name__
        raise TypeError(f"{what} returns a {kind}, wanted CasADi expressions or numbers") from None
    return ca.vec(ca.densify(expression))
