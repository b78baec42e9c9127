"""What a run of a polynomial field records besides its state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from liouville import _core
from liouville.systems import _trace
from liouville.systems._linear import Matrix, Term
from liouville.systems._recorded import recorded
from liouville.systems._travel import opened, packed
from liouville.tape import record


@dataclass(frozen=True)
class Symbols:
    """The symbols of a field of n coordinates, made when they are needed."""

    n: int
    params: _trace.Parameters

    @cached_property
    def t(self) -> ca.SX:
        return ca.SX.sym("t")

    @cached_property
    def x(self) -> ca.SX:
        return ca.SX.sym("x", self.n)

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel as numbers; there are other symbols then."""
        return Symbols, (self.n, self.params)

    @property
    def args(self) -> tuple[Any, ...]:
        """What a user's function is called with."""
        return self.t, self.x, self.params

    @property
    def inputs(self) -> dict[str, ca.SX]:
        """The inputs of a tape."""
        return {"t": self.t, "x": self.x, "params": self.params.vector}


@dataclass(frozen=True)
class Invariant:
    """A quantity to record: an expression, plus a . x, plus x^T A x."""

    expression: ca.SX
    linear: _core.Rows | None = None
    quadratic: _core.Rows | None = None

    @classmethod
    def read(cls, name: str, value: Any, s: Symbols) -> Invariant:
        """Take a function, the row a, or the matrix A."""
        what = f"invariant '{name}'"
        if callable(value):
            return cls(_trace.scalar(what, value, s.args))
        if np.shape(value) == (1, s.n):
            row = value.toarray() if hasattr(value, "toarray") else np.asarray(value)
            matrix = Matrix.read(what, row[0])  # as a diagonal
            zeros = np.zeros_like(matrix.row)
            return cls(ca.SX(0), linear=_core.Rows(1, s.n, zeros, matrix.row, matrix.values))
        matrix = Matrix.read(what, value)
        if matrix.n != s.n:
            raise ValueError(f"{what} is a matrix of order {matrix.n}, wanted {s.n}")
        return cls(ca.SX(0), quadratic=matrix.rows)


class Observer:
    """The invariants of a field, and tapes of them and of more.

    Attributes
    ----------
    names : tuple of str
        Names of the invariants.
    """

    def __init__(self, symbols: Symbols, invariants: Mapping[str, Any] | None) -> None:
        self.invariants = {
            name: Invariant.read(name, value, symbols)
            for name, value in _trace.mapping("invariants", invariants).items()
        }
        self.names = tuple(self.invariants)
        self._symbols = symbols

    def __getstate__(self) -> dict[str, Any]:
        """Travel with the tape of the invariants, which is all that most runs want."""
        expressions = [x.expression for x in self.invariants.values()]
        return {
            "names": self.names,
            "_symbols": self._symbols,
            "_alone": self._alone,
            "_matrices": [(x.linear, x.quadratic) for x in self.invariants.values()],
            "_packed": packed([*self._symbols.inputs.values()], expressions),
        }

    _matrices: list[tuple[_core.Rows | None, _core.Rows | None]]
    _packed: str

    @cached_property
    def invariants(self) -> dict[str, Invariant]:
        """The invariants by name; where they have travelled, they are read when they are wanted."""
        expressions = opened(self._packed, [*self._symbols.inputs.values()])
        parts = zip(self.names, expressions, self._matrices, strict=True)
        return {name: Invariant(expression, *matrices) for name, expression, matrices in parts}

    @cached_property
    def _alone(self) -> tuple[_core.Tape, dict[str, int]]:
        return self._record({})

    def tape(
        self, observe: Mapping[str, Callable[..., Any]] | None
    ) -> tuple[_core.Tape, dict[str, int]]:
        """Return the tape of t, x and params, and the width of each of its parts."""
        return self._record(_trace.mapping("observe", observe)) if observe else self._alone

    def portable(self, observe: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return what is to be observed in a form that travels."""
        return recorded(observe, self._symbols.args)

    def _record(
        self, observe: Mapping[str, Callable[..., Any]]
    ) -> tuple[_core.Tape, dict[str, int]]:
        s = self._symbols
        parts = {f"invariant {name}": x.expression for name, x in self.invariants.items()}
        for name, function in observe.items():
            parts[f"observed {name}"] = _trace.column(f"observed '{name}'", function, s.args)
        tape = record("observer", s.inputs, *parts.values())
        products: list[Term] = []
        forms: list[Term] = []
        for k, invariant in enumerate(self.invariants.values()):
            if invariant.linear is not None:
                products.append((k, 1, 1.0, invariant.linear))
            if invariant.quadratic is not None:
                forms.append((k, 1, 1.0, invariant.quadratic))
        if products or forms:
            tape = tape.with_terms(np.empty(0), products, forms)
        return tape, {name: x.numel() for name, x in parts.items()}
