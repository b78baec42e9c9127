"""Where the terms of a field come from."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from liouville.systems._expand import expand
from liouville.systems._given import TIME
from liouville.systems._observer import Symbols
from liouville.systems._travel import opened, packed
from liouville.terms import Terms


class Source:
    """Expressions of a field, expanded with numbers for its parameters.

    Parameters
    ----------
    column : SX
        The components.
    symbols : Symbols
        The symbols they are of.
    names : tuple of str
        Names of the coordinates.

    Attributes
    ----------
    is_driven : bool
        Whether the field depends on time.
    """

    def __init__(self, column: ca.SX, symbols: Symbols, names: tuple[str, ...]) -> None:
        self._column, self._symbols = column, symbols
        self.is_driven = ca.depends_on(column, symbols.t)
        self._variables = (*names, TIME) if self.is_driven else names

    def __call__(self, values: np.ndarray) -> Terms:
        """Multiply the components out."""
        symbols = tuple(self._symbols.inputs.values())
        expansion, components = expand(self._column, symbols, values, self._variables)
        return expansion.terms(components, self.is_driven)

    @cached_property
    def _column(self) -> ca.SX:
        return opened(self._packed, [*self._symbols.inputs.values()])[0]

    @cached_property
    def _packed(self) -> str:
        return packed([*self._symbols.inputs.values()], [self._column])

    def __getstate__(self) -> dict[str, Any]:
        """Travel as a function, which is read where other parameters are given."""
        own = {**self.__dict__, "_packed": self._packed}
        return {name: x for name, x in own.items() if name != "_column"}
