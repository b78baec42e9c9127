r"""Sectors of a momentum: one state for each orbit of basis states under translations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._systems.waves.sites.basis import Basis, Integers
from liouville._systems.waves.sites.terms import Moved, Sum

#: Bytes of a basis state of the whole while orbits are made.
ORBITS = 48.0


@dataclass(frozen=True)
class Orbits:
    r"""Orbits under translations, by basis state: :math:`|s\rangle = \pm T^m |r\rangle`.

    Attributes
    ----------
    least, shift, sign : ndarray of int
        The rank of r, the least state of the orbit; m; and the sign.
    period, returned : ndarray of int
        The number p of states of the orbit, and the sign of :math:`T^p |s\rangle = \pm |s\rangle`.
    """

    least: Integers
    shift: Integers
    sign: Integers
    period: Integers
    returned: Integers


@dataclass(frozen=True)
class MomentumBasis(Basis):
    r"""States of a momentum k of a periodic chain of L sites, with T a translation by one site.

    Each is that of an orbit of p basis states, by its least one r,

    .. math::

        |r, k\rangle = \frac{1}{\sqrt p} \sum_{j < p} e^{-2 \pi i k j / L}\, T^j |r\rangle,

    where :math:`T^p |r\rangle = e^{2 \pi i k p / L} |r\rangle`; other orbits have no state of this
    momentum. A fermion that comes from the last site to the first passes all others of its spin,
    so that T and :math:`T^p` have signs.

    Attributes
    ----------
    momentum : int
        k, from 0 to L - 1.
    length : int
        L; with spin the digits of all sites are there for spin up, then for spin down.
    is_fermionic : bool
        Whether digits are numbers of fermions.
    """

    momentum: int = 0
    length: int = 0
    is_fermionic: bool = False

    @property
    def asked(self) -> str:
        """The user's request in words, with the momenta that exist where this one has no state."""
        own = " and ".join(filter(None, [super().asked, f"momentum={self.momentum}"]))
        if self.size or not self.whole.size:
            return own
        there = [k for k in range(self.length) if self._is_there(k).any()]
        return f"{own}: the momenta there are {', '.join(map(str, there))}"

    @property
    def is_real(self) -> bool:
        """Whether all phases are 1 or -1."""
        return 2 * self.momentum % self.length == 0

    @property
    def whole(self) -> Basis:
        """The basis states of all momenta."""
        return Basis(self.sites, self.levels, self.charges)

    @property
    def size(self) -> int:
        """Number of states."""
        return int(self.states.size)

    @cached_property
    def states(self) -> Integers:
        """The least basis state of each orbit, ascending."""
        found: Integers = self._every[self._leasts[self._is_kept]]
        return found

    def placed(self, moved: Integers, origin: Integers) -> tuple[Integers, NDArray[Any]]:
        """Return the places of the orbits of states, -1 for those left out, and amplitudes there.

        They are those of the momentum's states where a state of the basis, `origin`, is moved.
        """
        ranks, orbits = self.rank(moved), self._orbits
        places: Integers = self._places[orbits.least[ranks]]
        sizes = np.sqrt(orbits.period[self.rank(origin)] / orbits.period[ranks])
        phases = self._phases[self.momentum * orbits.shift[ranks] % self.length]
        amplitudes = phases * (orbits.sign[ranks] * sizes)
        return places, amplitudes.real if self.is_real else amplitudes

    def place(self, state: int) -> int | None:
        """Return the place of the orbit of a state, None if it has none of this momentum."""
        place = self.whole.place(state)
        found = -1 if place is None else int(self._places[self._orbits.least[place]])
        return None if found < 0 else found

    def projected(self, psi: NDArray[Any]) -> NDArray[Any]:
        r"""Return the part :math:`\langle r, k | \psi \rangle` of a state of all momenta."""
        found = np.zeros(self.size, dtype=complex)
        states, sign = self.states, np.ones(self.size)
        for j in range(self.length):
            phase = self._phases[self.momentum * j % self.length]
            found += phase * sign * psi[self.whole.rank(states)]
            sign *= self._sign(states)
            states = self._translated(states)
        period = self._orbits.period[self._leasts[self._is_kept]]
        found *= np.sqrt(period) / self.length
        return found.real if self.is_real and not np.iscomplexobj(psi) else found

    def __getstate__(self) -> dict[str, object]:
        """Leave out what can be computed again."""
        own = {"momentum": self.momentum, "length": self.length, "is_fermionic": self.is_fermionic}
        return {**super().__getstate__(), **own}

    @cached_property
    def _every(self) -> Integers:
        return np.concatenate([np.empty(0, np.int64), *self.blocks()])

    @cached_property
    def _phases(self) -> NDArray[np.complex128]:
        found: NDArray[np.complex128] = np.exp(2j * np.pi * np.arange(self.length) / self.length)
        return found

    def _translated(self, states: Integers) -> Integers:
        """Return states whose digits are moved by one site."""
        bits = self.width * (self.length - 1)
        firsts = sum(1 << (self.width * site) for site in range(0, self.sites, self.length))
        first = firsts * ((1 << self.width) - 1)
        found: Integers = (states & ~(first << bits)) << self.width | states >> bits & first
        return found

    def _sign(self, states: Integers) -> Integers:
        """Return the sign of each state as all its fermions are moved by one site."""
        passed = np.zeros_like(states)
        if self.is_fermionic:
            for first in range(0, self.sites, self.length):
                own = states >> first & ((1 << self.length) - 1)
                passed += (own >> (self.length - 1)) * (np.bitwise_count(own) - 1)
        found: Integers = 1 - 2 * (passed & 1)
        return found

    @cached_property
    def _orbits(self) -> Orbits:
        every = self._every
        least, back = every.copy(), np.zeros_like(every)
        period = np.full_like(every, self.length)
        sign, turned, returned = np.ones((3, every.size), np.int64)
        moved = every
        for j in range(1, self.length):
            turned = turned * self._sign(moved)
            moved = self._translated(moved)
            is_less = moved < least
            least[is_less], back[is_less], sign[is_less] = moved[is_less], j, turned[is_less]
            is_back = (moved == every) & (period == self.length)
            period[is_back], returned[is_back] = j, turned[is_back]
        return Orbits(self.rank(least), (-back) % self.length, sign, period, returned)

    @cached_property
    def _leasts(self) -> Integers:
        """The ranks of the least states of all orbits."""
        found: Integers = np.unique(self._orbits.least)
        return found

    def _is_there(self, momentum: int) -> NDArray[np.bool_]:
        """Return which orbits have a state of a momentum."""
        period, returned = (x[self._leasts] for x in (self._orbits.period, self._orbits.returned))
        turns = 2 * momentum * period + self.length * (returned < 0)
        found: NDArray[np.bool_] = turns % (2 * self.length) == 0
        return found

    @cached_property
    def _is_kept(self) -> NDArray[np.bool_]:
        """Which orbits have a state of this momentum."""
        return self._is_there(self.momentum)

    @cached_property
    def _places(self) -> Integers:
        """The place of each least state, by its rank; -1 for others, and for orbits left out."""
        found = np.full(self._every.size, -1)
        kept = self._leasts[self._is_kept]
        found[kept] = np.arange(kept.size)
        return found


def moving(products: Sum, translated: Sum) -> Moved | None:
    """Return a product of a sum that has another coefficient in the translated sum, if any."""
    largest = max(map(abs, products.amplitudes.values()), default=0.0)
    for key, z in products.amplitudes.items():
        if abs(translated.amplitudes.get(key, 0.0) - z) > 1e-12 * largest:
            return key
    return None
