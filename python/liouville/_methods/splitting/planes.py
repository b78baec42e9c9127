"""A field as a sum of planes, each a Hamiltonian field of two coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from liouville import _core
from liouville._methods.splitting.pieces import Natural
from liouville._systems.fields.plane_field import PlaneField


@dataclass(frozen=True, eq=False)
class Plane:
    """The flow of two variables by a Hamiltonian, by symplectic Euler.

    It is one of the planes of a field, by its number, and is pickled with that field.
    """

    system: PlaneField
    number: int
    is_exact: ClassVar[bool] = False

    @property
    def plane(self) -> _core.Plane:
        """The Hamiltonian, as the core has it."""
        return self.system.planes[self.number][0]

    @property
    def variables(self) -> tuple[int, ...]:
        """The frozen variables, then the two that move."""
        return self.system.planes[self.number][1]

    @property
    def operations(self) -> int:
        """Return about how many additions and multiplications a flow takes."""
        return self.system.operations(self.number)

    @property
    def coefficients(self) -> np.ndarray:
        """The numbers that the Hamiltonian has as parameters: a spline has none."""
        return self.system.values(None)

    def described(self, names: tuple[str, ...]) -> str:
        """Describe it with the names of the variables."""
        *frozen, v, w = (names[k] for k in self.variables)
        rest = f" with {' and '.join(frozen)} frozen" if frozen else ""
        return f"plane of {v} and {w}{rest}"


@dataclass(frozen=True, eq=False)
class PlaneSplit:
    """A field as the sum of pieces, which follow one another in this order.

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
