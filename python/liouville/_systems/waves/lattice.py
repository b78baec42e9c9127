"""Particles that hop on a lattice."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import count
from liouville._basics.errors import hinted, misshapen
from liouville._systems.tracing.trace import numbers
from liouville._systems.waves.entries import (
    MAKING,
    OPEN,
    Bounds,
    Entries,
    check_entries,
    check_size,
)


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Lattice:
    r"""A particle on a rectangular lattice, which hops to the nearest sites.

    .. math::

        (H \psi)_j = V_j \psi_j - J \sum_{k \text{ next to } j} \psi_k

    Parameters
    ----------
    shape : int or tuple of int
        Number of sites along each axis.
    hopping : float or tuple of float, default 1.0
        J, the same along all axes or for each.
    potential : array_like, optional
        V at the sites: an array of the lattice's shape, or flat; zero by default.
    periodic : bool or tuple of bool, default False
        Whether the ends of an axis are neighbours; such an axis has at least 3 sites.

    Attributes
    ----------
    shape, hopping, potential, periodic
        As given: tuples, and the potential as an array of the lattice's shape.
    size : int
        Number of sites N; components of a state follow one another as in a flat NumPy array.

    Raises
    ------
    TypeError, ValueError
        A number is of the wrong kind or not finite, or shapes do not fit.

    Examples
    --------
    >>> import liouville as lv
    >>> lv.Lattice((3, 4), periodic=(False, True)).size
    12
    """

    shape: tuple[int, ...]
    hopping: tuple[float, ...]
    potential: np.ndarray
    periodic: tuple[bool, ...]

    def __init__(
        self,
        shape: int | tuple[int, ...],
        hopping: float | tuple[float, ...] = 1.0,
        potential: ArrayLike | None = None,
        periodic: bool | tuple[bool, ...] = False,
    ) -> None:
        sites = shape if isinstance(shape, (tuple, list, np.ndarray)) else (shape,)
        sites = tuple(count("a number of sites", n) for n in sites)
        if not sites:
            raise ValueError("a lattice must have an axis or more")
        ends = tuple(bool(x) for x in per_axis("periodic", periodic, len(sites)))
        for axis, (n, closed) in enumerate(zip(sites, ends, strict=True)):
            if closed and n < 3:
                raise ValueError(
                    hinted(
                        f"axis {axis} is periodic and must have 3 sites or more, not {n}",
                        "of fewer, both neighbours of a site would be the same",
                    )
                )
        check_entries("a lattice", (1 + 2 * len(sites)) * prod(sites), MAKING)
        object.__setattr__(self, "shape", sites)
        object.__setattr__(self, "hopping", reals("hopping", hopping, len(sites)))
        object.__setattr__(self, "potential", on_sites("potential", potential, sites))
        object.__setattr__(self, "periodic", ends)

    def __repr__(self) -> str:
        """Name the shape, and the axes that are closed."""
        closed = ", periodic" if all(self.periodic) else ", open" if not any(self.periodic) else ""
        return f"Lattice({' x '.join(map(str, self.shape))}{closed})"

    @property
    def size(self) -> int:
        """Number of sites."""
        return prod(self.shape)

    def with_potential(self, potential: ArrayLike) -> Lattice:
        """Return the lattice with another potential."""
        return Lattice(self.shape, self.hopping, potential, self.periodic)

    def entries(self) -> Entries:
        """Return the matrix H."""
        sites = np.arange(self.size).reshape(self.shape)
        row, col, values = [sites.ravel()], [sites.ravel()], [self.potential.ravel()]
        for axis, (hopping, closed) in enumerate(zip(self.hopping, self.periodic, strict=True)):
            first = np.moveaxis(sites, axis, 0)
            pairs = [(first[:-1], first[1:]), *([(first[-1], first[0])] if closed else [])]
            for a, b in pairs:
                row += [a.ravel(), b.ravel()]
                col += [b.ravel(), a.ravel()]
                values += [np.full(2 * a.size, -hopping)]
        return Entries.of(
            self.size, np.concatenate(row), np.concatenate(col), np.concatenate(values)
        )

    def bounds(self) -> Bounds:
        """Bound the energies: the closed formula of the free lattice beside the potential."""
        width = 0.0
        for n, hopping, closed in zip(self.shape, self.hopping, self.periodic, strict=True):
            width += 2 * abs(hopping) * (1.0 if closed else np.cos(np.pi / (n + 1)))
        low, high = float(self.potential.min()), float(self.potential.max())
        return low - width, high + width

    def order(self) -> np.ndarray | None:
        """Return the order of sites, folded if the first axis is closed: 0, n-1, 1, n-2, ..."""
        if not self.periodic[0]:
            return None
        n = self.shape[0]
        folded = np.stack([np.arange(n), np.arange(n)[::-1]], axis=1).ravel()[:n]
        return np.arange(self.size).reshape(n, -1)[folded].ravel()


def per_axis(name: str, value: Any, axes: int) -> tuple[Any, ...]:
    """Return one value an axis, from one for all or a tuple."""
    if not isinstance(value, (tuple, list, np.ndarray)):
        return (value,) * axes
    if len(value) != axes:
        raise ValueError(
            f"{name} must be one number, or one for each of {axes} axes, not {len(value)}"
        )
    return tuple(value)


def reals(name: str, value: Any, axes: int) -> tuple[float, ...]:
    """Return a finite number an axis."""
    found = numbers(per_axis(name, value, axes))
    if found is None or found.ndim != 1:
        raise TypeError(f"{name} must be a number, or a tuple of numbers, not {value!r}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite, not {value!r}")
    return tuple(found.tolist())


def on_sites(name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return finite numbers on all sites, in an array of this shape."""
    if value is None:
        return np.zeros(shape)
    found = numbers(value)
    if found is None:
        given = np.asarray(value)
        if given.dtype.kind == "c":
            raise TypeError(hinted(f"{name} must be real numbers, not complex ones", OPEN))
        what = repr(value) if given.ndim == 0 else f"one of {given.dtype.name}"
        raise TypeError(f"{name} must be an array of real numbers, not {what}")
    if found.shape not in ((), shape, (prod(shape),)):
        flat = f" or ({prod(shape)},)" if len(shape) > 1 else ""
        raise misshapen(name, found.shape, f"{shape}{flat}")
    bad = np.flatnonzero(~np.isfinite(found))
    if bad.size:
        place = ", ".join(map(str, np.unravel_index(bad[0], found.shape)))
        raise ValueError(f"{name}[{place}] must be finite, not {found.flat[bad[0]]}")
    check_size(name, found)
    found = np.broadcast_to(found, shape) if found.ndim == 0 else found.reshape(shape)
    found = found.copy()
    found.setflags(write=False)
    return found
