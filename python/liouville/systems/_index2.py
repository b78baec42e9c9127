"""Symbols and expressions of semi-explicit systems of index 2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from liouville.systems import _trace
from liouville.systems._travel import packed


@dataclass(frozen=True)
class Symbols:
    """The symbols of a system: time, coordinates, algebraic unknowns and parameters."""

    t: ca.SX
    y: ca.SX
    z: ca.SX
    params: _trace.Parameters

    @property
    def point(self) -> dict[str, ca.SX]:
        """The inputs of a tape that depends on z."""
        return {"t": self.t, "y": self.y, "z": self.z, "params": self.params.vector}

    @property
    def place(self) -> dict[str, ca.SX]:
        """The inputs of a tape that does not."""
        return {"t": self.t, "y": self.y, "params": self.params.vector}

    @property
    def args(self) -> tuple[Any, ...]:
        """What a user's function of a point is called with."""
        return self.t, self.y, self.z, self.params


@dataclass(frozen=True)
class Traced:
    """The expressions f, k and w of a system, and what is recorded along a run."""

    symbols: Symbols
    field: ca.SX
    constraint: ca.SX
    hidden: ca.SX
    invariants: dict[str, ca.SX]

    def packed(self) -> str:
        """Write them down."""
        expressions = [self.field, self.constraint, self.hidden, *self.invariants.values()]
        return packed([*self.symbols.point.values()], expressions)
