"""Functions of the user's that travel without themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from liouville.systems import _trace
from liouville.systems._travel import opened, packed


class Recorded:
    """A function of symbols that was called with some, and what it returned.

    It can be called with others: the symbols, and the namespace of the parameters last.
    """

    def __init__(self, what: str, function: Callable[..., Any], args: tuple[Any, ...]) -> None:
        *symbols, params = args
        column = _trace.column(what, function, args)
        self._packed = packed([*symbols, params.vector], [column])

    def __call__(self, *args: Any) -> ca.SX:
        """Return the expressions, of these symbols."""
        *symbols, namespace = args
        return opened(self._packed, [*symbols, _trace.vector_of(namespace)])[0]


def recorded(observe: Mapping[str, Any] | None, args: tuple[Any, ...]) -> dict[str, Recorded]:
    """Return what is to be observed in a form that travels."""
    return {
        name: Recorded(f"observed '{name}'", function, args)
        for name, function in _trace.mapping("observe", observe).items()
    }
