"""Constraints along the path: functions of time, states and controls within limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._studies.optimal.arguments import BEYOND, Array, Controls, Free
from liouville._systems import Mechanics
from liouville._systems.tracing import trace as _trace


@dataclass(frozen=True)
class PathConstraints:
    """Functions of (t, y, z, params) with least and largest values.

    Attributes
    ----------
    rows : SX, shape (r, 1)
        The functions, in the system's symbols.
    labels : tuple of str
        Their names.
    low, high : ndarray, shape (r,)
        Their limits.
    sees_controls : ndarray of bool, shape (r,)
        Which of them depend on controls, and so have no value at nodes.
    """

    rows: ca.SX
    labels: tuple[str, ...]
    low: Array
    high: Array
    sees_controls: np.ndarray

    @classmethod
    def of(cls, system: Mechanics, controls: Controls, given: Any) -> PathConstraints:
        """Read them: ``{"clear": (function, least, largest)}``.

        Raises
        ------
        TypeError, ValueError
            A value is no function with two limits, or the limits leave nothing.
        """
        rows, labels, sides = [ca.SX(0, 1)], [], [np.empty((0, 2))]
        for name, value in _trace.mapping("path", given).items():
            if not isinstance(value, Sequence) or len(value) != 3 or not callable(value[0]):
                sentence = f"path '{name}' must be a function and two limits, not {value!r}"
                raise TypeError(hinted(sentence, "write (lambda t, q, v, params: ..., 0.0, None)"))
            what = f"path '{name}'"
            names, expression = _trace.named(what, value[0], system.symbols.args)
            count = expression.numel()
            pair = _trace.pair(what, value[1:], (count,))
            rows.append(expression)
            each = [f"path '{name}[{x.removeprefix(what)}]'" for x in names]
            labels += [what] if count == 1 else each
            sides.append(np.stack(pair, axis=1))
        found = ca.vertcat(*rows)
        low, high = np.concatenate(sides).T
        own = system.symbols.params.vector[controls.places.tolist()]
        pattern = ca.jacobian(found, own).sparsity()
        sees = np.bincount(pattern.row(), minlength=found.numel()) > 0
        for label in np.array(labels)[~sees & (low == high)]:
            sentence = f"{label} has equal limits, and no control in it that could keep them"
            hint = "make it a constraint of the system, whose forces keep it"
            raise ValueError(hinted(sentence, hint))
        return cls(found, tuple(labels), low, high, sees)

    def check_start(
        self, system: Mechanics, t: float, start: Sequence[Array], params: Array,
        free: Free,
    ) -> None:  # fmt: skip
        """Refuse a start beyond limits that no control and no state that is free moves.

        Raises
        ------
        ValueError
            A function is beyond one there.
        """
        s = system.symbols
        own = [(s.y, s.z)[place] for place in free.states]
        moves = ca.vertcat(*own, s.params.vector[free.params.places.tolist()])
        held = [k for k in self.of_states if not ca.depends_on(self.rows[k], moves)]
        function = ca.Function("path", s.all, [self.rows[held]])
        values = np.array(ca.DM(function(t, *start, params))).ravel()
        for k, value in zip(held, values.tolist(), strict=True):
            side = self.low[k] if value < self.low[k] else self.high[k]
            beyond = max(value - self.high[k], self.low[k] - value)
            if beyond > BEYOND * abs(side):
                sentence = f"{self.labels[k]} is {value:g} at the start"
                sides = f"from {self.low[k]:g} to {self.high[k]:g}"
                raise ValueError(f"{sentence}, and its limits are {sides}")

    @property
    def of_states(self) -> list[int]:
        """The places of those that have a value at nodes."""
        found: list[int] = np.flatnonzero(~self.sees_controls).tolist()
        return found

    def beyond(self, values: Array) -> str:
        """Name one whose values, a row at each place, go farthest beyond its limits; else empty."""
        most, words = BEYOND, ""
        for label, column, least, largest in zip(
            self.labels, values.T, self.low, self.high, strict=True
        ):
            for reached, side in ((column.min(), least), (column.max(), largest)):
                off = max(reached - largest, least - reached)
                size = abs(side) or float(np.abs(column).max())
                if off > most * size:
                    most = off / size
                    words = f"{label} goes to {reached:.3g}, beyond its limit of {side:g}"
        return words
