"""The quantities that a run of a polynomial field records besides its state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.tape import record
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.expressions import Expressions, Symbols, recorded
from liouville._systems.tracing.linear import Matrix, Term

#: An invariant: an expression, plus a . x with the row a, plus x^T A x.
Invariant: TypeAlias = "tuple[ca.SX, _core.Rows | None, _core.Rows | None]"


def invariant(name: str, value: Any, s: Symbols) -> Invariant:
    """Read an invariant: a function, the row a, or the matrix A."""
    what, n = f"invariant '{name}'", s.sizes["x"]
    if callable(value):
        return _trace.scalar(what, value, s.args), None, None
    if np.shape(value) == (1, n):
        row = value.toarray() if hasattr(value, "toarray") else np.asarray(value)
        matrix = Matrix.read(what, row[0])  # as a diagonal
        zeros = np.zeros_like(matrix.row)
        return ca.SX(0), _core.Rows(1, n, zeros, matrix.row, matrix.values), None
    matrix = Matrix.read(what, value)
    if matrix.n != n:
        raise ValueError(f"{what} must be a matrix of order {n}, not {matrix.n}")
    return ca.SX(0), None, matrix.rows


class Observer:
    """The invariants of a field, and tapes of them and of further quantities."""

    def __init__(self, symbols: Symbols, invariants: Mapping[str, Any] | None) -> None:
        read = {
            name: invariant(name, value, symbols)
            for name, value in _trace.mapping("invariants", invariants).items()
        }
        self.expressions = Expressions(symbols, {name: x for name, (x, _, _) in read.items()})
        self._matrices = [(row, matrix) for _, row, matrix in read.values()]
        self.names = tuple(read)

    def __getstate__(self) -> dict[str, Any]:
        """Return the tape of the invariants too, which most runs need alone."""
        return {**self.__dict__, "_alone": self._alone}

    @cached_property
    def _alone(self) -> tuple[_core.Tape, dict[str, int]]:
        return self._record({})

    def tape(self, observe: Mapping[str, Any] | None) -> tuple[_core.Tape, dict[str, int]]:
        """Return the tape of t, x and params, and the width of each of its parts."""
        return self._record(_trace.mapping("observe", observe)) if observe else self._alone

    def event(self, what: str, function: Callable[..., Any]) -> _core.Tape:
        """Return the tape of one function of t, x and params."""
        s, value = self.expressions.symbols, self._event_value(what, function)
        return record(what, s.inputs(), value)

    def event_slopes(self, what: str, function: Callable[..., Any]) -> _core.Tape:
        """Return the tape of its derivatives by (t, x, params)."""
        return self._slopes(self._event_value(what, function))

    def slopes_of(self, function: Callable[..., Any]) -> tuple[_core.Tape, int]:
        """Return the Jacobian of a function by (t, x, params), column by column, and its width."""
        s = self.expressions.symbols
        value = _trace.column("the function", function, s.args)
        return self._slopes(value), value.numel()

    def measured(self, functions: Mapping[str, Any]) -> tuple[_core.Tape, dict[str, int]]:
        """Record functions and their derivatives, as a mechanical system does for fits."""
        s = self.expressions.symbols
        columns = {
            name: _trace.column(f"observed '{name}'", function, s.args)
            for name, function in _trace.mapping("observe", functions).items()
        }
        values = ca.vertcat(ca.SX(0, 1), *columns.values())
        by = ca.jacobian(values, ca.vertcat(s.x, s.params.vector))
        tape = record("measured", s.inputs(lam=ca.SX(0, 1)), values, ca.densify(by))
        return tape, {name: x.numel() for name, x in columns.items()}

    def slopes_of_invariant(self, name: str) -> _core.Tape:
        """Return the tape of the derivatives of an invariant by (t, x, params)."""
        if any(part is not None for part in self._matrices[self.names.index(name)]):
            sentence = f"invariant '{name}' is a matrix, whose derivative is not recorded"
            raise TypeError(hinted(sentence, "give it as a function of t, x and params"))
        return self._slopes(self.expressions.columns[name])

    def _slopes(self, value: ca.SX) -> _core.Tape:
        s = self.expressions.symbols
        by = ca.vertcat(s.t, s.x, s.params.vector)
        return record("slopes", s.inputs(), ca.densify(ca.jacobian(value, by)))

    def _event_value(self, what: str, function: Callable[..., Any]) -> ca.SX:
        s = self.expressions.symbols
        value = _trace.scalar(what, function, s.args)
        if not ca.depends_on(value, ca.vertcat(s.t, s.x)):
            sentence = f"{what} is the same for all states"
            hint = "return what is to change its sign, such as x[1] - params.height"
            raise ValueError(hinted(sentence, hint))
        return value

    def portable(self, observe: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return functions to observe in a form that can be pickled."""
        args = self.expressions.symbols.args
        return recorded(observe, lambda _: args)

    def _record(self, observe: Mapping[str, Any]) -> tuple[_core.Tape, dict[str, int]]:
        s, columns = self.expressions.symbols, self.expressions.columns
        parts = {f"invariant {name}": x for name, x in columns.items()}
        for name, function in observe.items():
            parts[f"observed {name}"] = _trace.column(f"observed '{name}'", function, s.args)
        tape = record("observer", s.inputs(), *parts.values())
        products: list[Term] = [
            (k, 1, 1.0, row) for k, (row, _) in enumerate(self._matrices) if row is not None
        ]
        forms: list[Term] = [
            (k, 1, 1.0, matrix)
            for k, (_, matrix) in enumerate(self._matrices)
            if matrix is not None
        ]
        if products or forms:
            tape = tape.with_terms(np.empty(0), products, forms)
        return tape, {name: x.numel() for name, x in parts.items()}
