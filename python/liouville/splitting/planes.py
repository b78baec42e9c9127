"""A gridded field as a sum of planes, each a Hamiltonian field of two coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from liouville import _core
from liouville.splitting.pieces import Natural
from liouville.systems.gridded import GriddedField

#: Newton's corrections of a flow, about.
CORRECTIONS = 3


@dataclass(frozen=True, eq=False)
class Plane:
    """The flow of two variables by a spline, by symplectic Euler.

    It is one of the planes of a gridded field, by its number, and is pickled with that field.
    """

    system: GriddedField
    number: int
    is_exact: ClassVar[bool] = False

    @property
    def plane(self) -> _core.Plane:
        """The spline, as the core has it."""
        return self.system.planes[self.number][0]

    @property
    def variables(self) -> tuple[int, ...]:
        """The frozen variables, then the two that move."""
        return self.system.planes[self.number][1]

    @property
    def operations(self) -> int:
        """Return about how many additions and multiplications a flow takes."""
        p = self.system.degree
        frozen: int = p ** (len(self.variables) - 2)
        window = (p + 1) * (p + 3)
        return 2 * window * (frozen + 2) + CORRECTIONS * 6 * (p + 1) ** 2

    def described(self, names: tuple[str, ...]) -> str:
        """Describe it with the names of the variables."""
        *frozen, v, w = (names[k] for k in self.variables)
        rest = f" with {' and '.join(frozen)} frozen" if frozen else ""
        return f"plane of {v} and {w}{rest}"


@dataclass(frozen=True, eq=False)
class PlaneSplit:
    """A gridded field as the sum of pieces, which follow one another in this order.

    Attributes
    ----------
    n : int
        How many variables there are.
    pieces : tuple
        The time's own shear, where there is one, and planes.
    """

    n: int
    pieces: tuple[Natural | Plane, ...]
    outward: ClassVar[None] = None

    def inward(self, x: np.ndarray) -> np.ndarray:
        """Return states: they are stepped as they are."""
        return x
