"""Chains of spins one half."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import amount, check_memory, count
from liouville._basics.errors import misshapen
from liouville._systems.tracing.trace import numbers
from liouville._systems.waves.entries import Entries, check_size
from liouville._systems.waves.exchange import BUILDING, MOST, Exchange, states_of


@dataclass(frozen=True, init=False, eq=False, repr=False)
class SpinChain:
    r"""A chain of L spins one half with exchange between neighbours, and a field.

    .. math::

        H = \sum_i J_i (S^x_i S^x_{i+1} + S^y_i S^y_{i+1}) + \Delta_i S^z_i S^z_{i+1}
            + \sum_i h_i S^z_i

    It is real, and keeps the number of spins that are up, so that a state lives in the sector of
    one such number.

    Parameters
    ----------
    length : int
        Number of spins L, at least 2.
    xy, z : float or array_like, default 1.0
        J and :math:`\Delta`: of all bonds, or of each: L - 1 of them, L if periodic.
    field : float or array_like, default 0.0
        h, of all spins or of each.
    periodic : bool, default False
        Whether the last spin is a neighbour of the first; L is then at least 3.
    up : int, optional
        Number of spins that are up, for states of this sector; all states by default.

    Attributes
    ----------
    length, xy, z, field, periodic, up
        As given, with xy, z and field as arrays.
    basis : ndarray
        The basis states in order: bit i is set where spin i is down, so state 0 is all up.
    size : int
        Number of basis states N.

    Raises
    ------
    TypeError, ValueError
        A number is of the wrong kind or not finite, or there is not one for each bond or spin.

    Examples
    --------
    >>> import liouville as lv
    >>> lv.SpinChain(4, up=2).basis
    array([ 3,  5,  6,  9, 10, 12])
    """

    length: int
    xy: np.ndarray
    z: np.ndarray
    field: np.ndarray
    periodic: bool
    up: int | None

    def __init__(
        self,
        length: int,
        xy: ArrayLike = 1.0,
        z: ArrayLike = 1.0,
        field: ArrayLike = 0.0,
        periodic: bool = False,
        up: int | None = None,
    ) -> None:
        n = count("length", length)
        if n < 2 + bool(periodic):
            raise ValueError(f"length must be 2 or more, 3 of a periodic chain, not {n}")
        if up is not None:
            if isinstance(up, bool) or not isinstance(up, (int, np.integer)):
                raise TypeError(f"up must be a number of spins, not {up!r}")
            if not 0 <= up <= n:
                raise ValueError(f"up = {up}: a chain of {n} has 0 to {n} spins up")
        bonds = n if periodic else n - 1
        found = {
            "length": n, "xy": _along("xy", xy, bonds, "bond"), "z": _along("z", z, bonds, "bond"),
            "field": _along("field", field, n, "spin"), "periodic": bool(periodic),
            "up": None if up is None else int(up),
        }  # fmt: skip
        for name, value in found.items():
            object.__setattr__(self, name, value)
        hint = "give up=, the number of spins that are up, or fewer spins"
        if n > MOST:
            raise ValueError(f"length = {n}: chains have at most {MOST} spins")
        check_memory(f"a chain of {n} spins, with a state", (16.0 + BUILDING) * self.size, hint)

    def __repr__(self) -> str:
        """Name the length and the sector."""
        sector = "" if self.up is None else f", {self.up} up"
        ends = ", periodic" if self.periodic else ""
        return f"SpinChain({amount(self.length, 'spin')}{sector}{ends})"

    @property
    def size(self) -> int:
        """Number of basis states."""
        return 2**self.length if self.up is None else comb(self.length, self.up)

    @cached_property
    def basis(self) -> np.ndarray:
        """The basis states in order."""
        return states_of(self.length, self.up).states

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what can be computed again."""
        return {name: x for name, x in self.__dict__.items() if name != "basis"}

    def index(self, state: int) -> int:
        """Return the place of a basis state, from 0.

        Parameters
        ----------
        state : int
            Bit i is 1 where spin i is down.

        Raises
        ------
        ValueError
            The state is in another sector.
        """
        place = states_of(self.length, self.up).place(state)
        if place is None:
            raise ValueError(f"state {state} is not among the {self.size} of this sector")
        return place

    def sz(self, i: int) -> np.ndarray:
        """Return the diagonal of the z component of spin i, shape (size,): 1/2 up, -1/2 down."""
        return 0.5 - (self.basis >> i & 1)

    @property
    def bonds(self) -> list[tuple[int, int]]:
        """The pairs of neighbours."""
        pairs = [(i, i + 1) for i in range(self.length - 1)]
        return [*pairs, (self.length - 1, 0)] if self.periodic else pairs

    @property
    def exchange(self) -> Exchange:
        """The chain as the core takes it."""
        return Exchange(self.bonds, self.xy, self.z, self.field, self.up)

    def entries(self) -> Entries:
        """Return the matrix H in the basis."""
        return self.exchange.entries()


def _along(name: str, value: Any, size: int, what: str) -> np.ndarray:
    found = numbers(value)
    if found is None:
        raise TypeError(
            f"{name} must be a number, or an array of one for each {what}, not {value!r}"
        )
    if found.shape not in ((), (size,)):
        raise misshapen(name, found.shape, f"({size},), a number for each {what}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite, not {value!r}")
    check_size(name, found)
    found = np.broadcast_to(found, size).copy()
    found.setflags(write=False)
    return found
