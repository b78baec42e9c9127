"""Constraints along the path: functions of time, states and controls within limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._studies.optimal.arguments import BEYOND, Array, Controls
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
            names, expression = _trace.named(f"path '{name}'", value[0], system._symbols.args)
            count = expression.numel()
            pair = _trace.pair(f"path '{name}'", value[1:], (count,))
            rows.append(expression)
            labels += [f"path '{name}'" if count == 1 else f"path '{x}'" for x in names]
            sides.append(np.stack(pair, axis=1))
        found = ca.vertcat(*rows)
        low, high = np.concatenate(sides).T
        own = system._symbols.params.vector[controls.places.tolist()]
        pattern = ca.jacobian(found, own).sparsity()
        sees = np.bincount(pattern.row(), minlength=found.numel()) > 0
        return cls(found, tuple(labels), low, high, sees)

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
