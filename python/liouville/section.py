"""Poincare sections: where trajectories cross a plane."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._arguments import number
from liouville.errors import IntegrationError
from liouville.integrate import drive
from liouville.methods import VolumeSplitting
from liouville.planner import Plan
from liouville.routes import Asked, FieldRoute, route
from liouville.solution import Array
from liouville.splitting import crossed
from liouville.systems import PolynomialField


@dataclass(frozen=True, eq=False)
class Section:
    """The points where trajectories cross a plane, in the order of members, then of time.

    Attributes
    ----------
    x : ndarray, shape (K, n)
        The points, on the plane to roundoff.
    t : ndarray, shape (K,)
        When.
    member : ndarray of int, shape (K,)
        Of which trajectory.
    members : int
        How many trajectories there were.
    names : tuple of str
        The coordinates.
    plane : tuple of ndarray and float
        Normal and offset.
    method : str
        The method, as its repr.
    status : str
        ``"done"``, or ``"interrupted"`` with what was found before.
    """

    x: Array
    t: Array
    member: np.ndarray
    members: int
    names: tuple[str, ...]
    plane: tuple[Array, float]
    method: str
    status: str = "done"

    def __len__(self) -> int:
        """Return how many crossings there are."""
        return self.t.size

    def __repr__(self) -> str:
        """Tell how many crossings of how many trajectories."""
        return f"<Section {self.status}: {len(self)} crossings of {self.members} trajectories>"
