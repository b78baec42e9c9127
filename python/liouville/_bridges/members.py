"""Runs with a row of inputs for each member, in lock-step or one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import IntegrationError

if TYPE_CHECKING:
    from liouville._bridges.run import RunFunction, RunPoint

Array = NDArray[Any]


class RunMembers:
    """Runs with many inputs: one if these are alike, an ensemble where it takes them, or each.

    Attributes
    ----------
    inputs : list of ndarray
        With which they are run, a row for each.
    """

    def __init__(self, function: RunFunction, inputs: list[Array]) -> None:
        self.inputs, self._function = inputs, function
        alike = [are_alike(x) for x in inputs]
        self._own = [x[0] if same else x for x, same in zip(inputs, alike, strict=True)]
        names = zip(function.inputs, alike, strict=True)
        self._varied = {name for name, same in names if not same}
        self._whole = None if self._varied else function.point(self._own)
        self._points: dict[int, RunPoint] = {}
        self._failed: dict[int, str] = {}

    @property
    def one(self) -> RunPoint:
        """The run, where there is one member."""
        assert self._whole is not None, "one member is no other than itself"
        return self._whole

    def _point(self, k: int) -> RunPoint:
        """Return the run of a member."""
        if k not in self._points:
            self._points[k] = self._function.point([np.asarray(x[k]) for x in self.inputs])
        return self._points[k]

    @property
    def values(self) -> list[Array]:
        """The states in `outputs`, each of shape (P, k, n), or (1, k, n) where all are alike."""
        if self._whole is not None:
            return [x[None] for x in self._whole.values]
        if (whole := self._made) is not None:
            return [np.moveaxis(x, 1, 0) for x in whole.values]
        shapes = [*self._function.outputs.values()]
        return self._stacked(
            [self._tried(k, lambda point, _: point.values, shapes) for k in range(self._count)]
        )

    def pushed(self, directions: Sequence[Array]) -> list[Array]:
        """Return the derivatives of all outputs, each member's by its own direction."""
        if self._whole is not None:
            return self._whole.pushed(directions)
        shapes = [*self._function.outputs.values()]

        def derived(point: RunPoint, k: int) -> list[Array]:
            return [x[0] for x in point.pushed([np.asarray(x[k])[None] for x in directions])]

        return self._stacked([self._tried(k, derived, shapes) for k in range(self._count)])

    def pulled(self, cotangents: Sequence[Array]) -> list[Array]:
        """Return the derivatives by all inputs of a scalar of each member."""
        if self._whole is not None:
            return self._stacked([self._whole.pulled(row) for row in zip(*cotangents, strict=True)])
        if (whole := self._made) is not None:
            try:
                return whole.pulled([np.moveaxis(x, 0, 1) for x in cotangents])
            except IntegrationError:  # a member has no derivative
                pass
        shapes = [*self._function.inputs.values()]

        def derived(point: RunPoint, k: int) -> list[Array]:
            return point.pulled([x[k] for x in cotangents])

        return self._stacked([self._tried(k, derived, shapes) for k in range(self._count)])

    @property
    def _count(self) -> int:
        return len(self.inputs[0])

    @cached_property
    def _made(self) -> RunPoint | None:
        """The ensemble, or None where there is none, or one with members that fail."""
        if not self._function.takes_members(self._varied):
            return None
        try:
            whole = self._function.point(self._own)
            _ = whole.made
        except FAILURES:
            return None
        return whole

    def _tried(
        self, k: int, call: Callable[[RunPoint, int], list[Array]], shapes: Sequence[Any]
    ) -> list[Array]:
        """Call with a member's run; NaN of these shapes, and a note, where the run fails."""
        types = self._function.types.values()
        kind = next(iter(types))
        try:
            if k not in self._failed:
                return call(self._point(k), k)
        except FAILURES as error:
            self._failed[k] = str(error)
        self._function.failures = dict(self._failed)
        return [np.full(shape, np.nan, dtype=kind) for shape in shapes]

    @staticmethod
    def _stacked(found: Sequence[Sequence[Array]]) -> list[Array]:
        return [np.stack(parts) for parts in zip(*found, strict=True)]


#: How the run of a member fails; numbers that are refused are its own.
FAILURES = (IntegrationError, ValueError)

#: Results of runs for arguments with a row for each member.
Call = Callable[[RunMembers, list[Any]], list[Array]]


def are_alike(rows: Array) -> bool:
    """Return whether all rows are the same; NaN is like nothing, but a row like itself."""
    return len(rows) == 1 or bool((rows == rows[:1]).all())
