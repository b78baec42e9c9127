"""Particles on a periodic grid: kinetic energy by Fourier transform, and a potential."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import check_memory, count, counted, number
from liouville._basics.errors import hinted
from liouville._systems.waves.lattice import on_sites, reals

#: The memory of so many states is taken while H is made.
STATES = 8.0


@dataclass(frozen=True)
class Flux:
    r"""The current through a plane, :math:`\hbar/m \Im(\bar\psi\, \psi_x)` over all of it.

    Attributes
    ----------
    shape : tuple of int
        That of the grid.
    axis : int
        The axis that goes through the plane.
    value, slope : ndarray
        The wave function on the plane and its derivative are sums of values with these factors.
    scale : float
        The factor of the result.
    """

    shape: tuple[int, ...]
    axis: int
    value: np.ndarray
    slope: np.ndarray
    scale: float

    def __call__(self, psi: np.ndarray) -> np.ndarray:
        """Return the product with a state."""
        lines = np.moveaxis(psi.reshape(self.shape), self.axis, -1)
        value, slope = lines @ self.value, lines @ self.slope
        found = self.value * slope[..., None] - self.slope * value[..., None]
        flat: np.ndarray = np.moveaxis(-0.5j * self.scale * found, -1, self.axis).ravel()
        return flat


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Grid:
    r"""A particle in one, two or three dimensions, on a periodic grid.

    .. math::

        H = -\sum_j \frac{\hbar^2}{2 m_j} \frac{\partial^2}{\partial x_j^2} + V(t, x)

    The points along an axis are :math:`\text{low} + i (\text{high} - \text{low}) / n` for i from 0
    to n - 1; derivatives are those of the trigonometric polynomial through them.

    Parameters
    ----------
    low, high : float or tuple of float
        Where each axis begins and ends; the end is the beginning again.
    points : int or tuple of int
        Number of points along each axis.
    potential : array_like or callable, optional
        V: an array of the grid's shape, or flat; or ``potential(t, x, params)``, called once with
        CasADi symbols, where x has the coordinates of a point. Zero by default. Of a wave function
        of several components it may have one more axis, or return a value for each.
    mass : float or tuple of float, default 1.0
        m, the same along all axes or for each.

    Attributes
    ----------
    low, high, shape, mass : tuple
        One value an axis; the shape are the numbers of points.
    potential : ndarray, callable or None
        As given, an array in the grid's shape.
    size : int
        Number of points N; components of a state follow one another as in a flat NumPy array:
        ``run.psi.reshape(-1, *grid.shape)`` has one on the axes for each record.
    axes, k : tuple of ndarray
        Coordinates along each axis, and wave numbers in the order of ``numpy.fft.fftfreq``.
    points : ndarray
        Coordinates of all points, shape (N, d).
    cell : float
        Volume that a point stands for: components of a state are values of a wave function times
        the square root of it.

    Raises
    ------
    TypeError, ValueError
        A number is of the wrong kind or not finite, an axis is empty, or shapes do not fit.

    Examples
    --------
    >>> import liouville as lv
    >>> grid = lv.Grid(-5, 5, 64, potential=lambda t, x, params: x**2 / 2)
    >>> grid.points[:2, 0]
    array([-5.     , -4.84375])
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    shape: tuple[int, ...]
    potential: np.ndarray | Callable[..., Any] | None
    mass: tuple[float, ...]

    def __init__(
        self,
        low: float | tuple[float, ...],
        high: float | tuple[float, ...],
        points: int | tuple[int, ...],
        potential: ArrayLike | Callable[..., Any] | None = None,
        mass: float | tuple[float, ...] = 1.0,
    ) -> None:
        given = points if isinstance(points, (tuple, list, np.ndarray)) else (points,)
        shape = tuple(count("a number of points", n) for n in given)
        if not 1 <= len(shape) <= 3:
            raise ValueError(f"a grid must have 1, 2 or 3 axes, not {len(shape)}")
        for axis, n in enumerate(shape):
            if n < 2:
                raise ValueError(f"axis {axis} must have 2 points or more, not {n}")
        needed = 16.0 * STATES * prod(shape)
        check_memory(f"a grid of {counted(prod(shape))} points", needed, "take fewer points")
        d = len(shape)
        begin, end, masses = reals("low", low, d), reals("high", high, d), reals("mass", mass, d)
        for axis, (a, b, m) in enumerate(zip(begin, end, masses, strict=True)):
            if not a < b:
                raise ValueError(
                    f"axis {axis} must end above its start, not go from {a:g} to {b:g}"
                )
            if m <= 0:
                raise ValueError(
                    hinted(
                        f"mass must be positive, not {m:g} along axis {axis}",
                        "a very heavy axis is one without kinetic energy",
                    )
                )
        if not (potential is None or callable(potential)):
            of_components = np.shape(potential)[:-d] if np.ndim(potential) == d + 1 else ()
            potential = on_sites("potential", potential, (*of_components, *shape))
        found = {"low": begin, "high": end, "shape": shape, "potential": potential, "mass": masses}
        for name, value in found.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Name the numbers of points and the ends of the axes."""
        ends = " x ".join(f"[{a:g}, {b:g})" for a, b in zip(self.low, self.high, strict=True))
        return f"Grid({' x '.join(map(str, self.shape))} points on {ends})"

    @property
    def size(self) -> int:
        """Number of points."""
        return prod(self.shape)

    @property
    def axes(self) -> tuple[np.ndarray, ...]:
        """Coordinates along each axis."""
        spans = zip(self.low, self.high, self.shape, strict=True)
        return tuple(a + (b - a) / n * np.arange(n) for a, b, n in spans)

    @property
    def k(self) -> tuple[np.ndarray, ...]:
        """Wave numbers along each axis."""
        spans = zip(self.low, self.high, self.shape, strict=True)
        return tuple(2 * np.pi / (b - a) * np.fft.fftfreq(n, 1 / n) for a, b, n in spans)

    @cached_property
    def points(self) -> np.ndarray:
        """Coordinates of all points, shape (N, d)."""
        return np.stack([x.ravel() for x in np.meshgrid(*self.axes, indexing="ij")], axis=1)

    @property
    def cell(self) -> float:
        """Volume that a point stands for."""
        spans = zip(self.low, self.high, self.shape, strict=True)
        return prod((b - a) / n for a, b, n in spans)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what can be computed again."""
        return {name: x for name, x in self.__dict__.items() if name != "points"}

    def flux(self, place: float, axis: int = 0, hbar: float = 1.0) -> tuple[int, Flux]:
        """Return the operator of the flux through a plane across an axis, upwards.

        It is an observable, ``observe={"out": grid.flux(5.0)}``: probability over time.

        Raises
        ------
        TypeError, ValueError
            There is no such axis, or the place is not on it.
        """
        if axis not in range(len(self.shape)):
            axes = "axis 0" if len(self.shape) == 1 else f"axes 0 to {len(self.shape) - 1}"
            raise ValueError(f"axis must be one of the grid, which has {axes}, not {axis!r}")
        at, low, high = number("place must be a number", place), self.low[axis], self.high[axis]
        if not low <= at <= high:
            raise ValueError(f"place must be on axis {axis}, from {low:g} to {high:g}, not {at:g}")
        k, n = self.k[axis], self.shape[axis]
        waves = np.exp(1j * np.outer(at - self.axes[axis], k)) / n
        value, slope = waves.sum(axis=1).real, (waves @ (1j * k)).real
        scale = hbar * n / (self.mass[axis] * (high - low))
        return self.size, Flux(self.shape, axis, value, slope, scale)

    def with_potential(self, potential: ArrayLike | Callable[..., Any]) -> Grid:
        """Return the grid with another potential."""
        return Grid(self.low, self.high, self.shape, potential, self.mass)

    def kinetic(self, hbar: float) -> list[np.ndarray]:
        """Return the kinetic energies of the wave numbers along each axis."""
        with np.errstate(over="ignore"):
            return [(hbar * k) ** 2 / (2 * m) for k, m in zip(self.k, self.mass, strict=True)]
