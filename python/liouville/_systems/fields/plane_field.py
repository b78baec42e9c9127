"""Fields whose flow is made of planes: two coordinates at a time, by a Hamiltonian of them."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics.errors import misshapen
from liouville._systems.fields.field import Field

#: Planes, each with its variables: frozen ones, then the two that move.
Planes = list[tuple[_core.Plane, tuple[int, ...]]]


def planes_of(n: int) -> list[tuple[int | None, tuple[int, int]]]:
    """Return the frozen coordinate of each component of the potential, and its plane."""
    return [(None, (0, 1))] if n == 2 else [(0, (1, 2)), (1, (2, 0)), (2, (0, 1))]


class PlaneField(Field):
    """A base of fields v = curl A, of a plane (psi_y, -psi_x): each component of A has a plane.

    Attributes
    ----------
    kind : str
        What fields of this class are called in messages.
    counted : str
        What `size` counts, for plans.
    """

    kind: ClassVar[str]
    counted: ClassVar[str]
    _made: Planes | None

    @property
    @abstractmethod
    def degree(self) -> int | None:
        """The highest order that there is, None where there is none."""

    @property
    @abstractmethod
    def times(self) -> tuple[float, float] | None:
        """The first and the last time of the field, None where it has all."""

    @property
    @abstractmethod
    def size(self) -> int:
        """How many numbers or operations the planes have."""

    @abstractmethod
    def _make(self) -> Planes:
        """Hand the planes to the core."""

    @abstractmethod
    def steepness(self, rows: np.ndarray, h: float = 0.0) -> float:
        """Return a bound of the mixed derivatives of A; `rows` are states with the time, if any.

        With a step h also where this takes them, as far as one can see from where they are.
        """

    def steepest_at(self, rows: np.ndarray) -> np.ndarray | None:
        """Return the bound of the steps at each state, None where all have one."""
        del rows
        return None

    def is_land(self, x: np.ndarray) -> np.ndarray:
        """Return which of the states x, shape (..., n), are where nothing ever moves."""
        return np.zeros(x.shape[:-1], dtype=bool)

    @abstractmethod
    def operations(self, number: int) -> int:
        """Return about how many operations a flow of a plane takes."""

    @abstractmethod
    def said(self) -> list[str]:
        """Say what there is to know of the field, for plans."""

    @property
    def planes(self) -> Planes:
        """The planes as the core has them, each with its variables: frozen ones, then two."""
        if self._made is None:
            self._made = self._make()
        return self._made

    def velocity(self, x: ArrayLike, t: float = 0.0) -> np.ndarray:
        """Return the velocity of states x, shape (..., n); NaN where there is none.

        These are rates of states in unit time. Of a grid on a sphere of radius a these are
        dlon/dt = u / (a cos lat), in radians, and dmu/dt = v cos(lat) / a; of one on a cylinder
        dq/dt = R v_R and dphi/dt = v_phi / R. The time may be a date, where the field has dates.

        Raises
        ------
        ValueError
            x has another shape.
        """
        return self._sampled(x, t)[1]

    def potential(self, x: ArrayLike, t: float = 0.0) -> np.ndarray:
        """Return the potential at states x: of a plane the stream function, shape (...), else A.

        A vector potential has the shape (..., 3). The mean flow of a grid has none on a periodic
        axis, and is not in it.

        Raises
        ------
        ValueError
            x has another shape.
        """
        return self._sampled(x, t)[0]

    def _sampled(self, x: ArrayLike, t: float) -> tuple[np.ndarray, np.ndarray]:
        x = np.asarray(x, dtype=float)
        n, t = len(self.coordinates), self.in_time(t)
        if x.ndim == 0 or x.shape[-1] != n:
            raise misshapen("x", x.shape, f"(..., {n})")
        rows = self.extended(x.reshape(-1, n), t)
        a, v = np.zeros((len(rows), 3)), np.zeros((len(rows), n))
        for plane, order in self.planes:
            found = plane.sample(np.ascontiguousarray(rows[:, order])).reshape(-1, 3)
            a[:, 3 - sum(order[-2:])] = found[:, 0]
            v[:, order[-2:]] += found[:, 1:]
        potential = a[:, 2] if n == 2 else a
        return potential.reshape((*x.shape[:-1], *potential.shape[1:])), v.reshape(x.shape)
