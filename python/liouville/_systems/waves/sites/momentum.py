r"""Sectors of a momentum: one state for each orbit of basis states under translations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._systems.waves.sites.basis import Basis, Charge, Integers
from liouville._systems.waves.sites.terms import Factor, Moved, Sum

#: Bytes of a basis state of the whole while orbits are made.
ORBITS = 48.0


@dataclass(frozen=True)
class MomentumBasis(Basis):
    r"""States of a momentum k of a periodic chain of L sites, with T a translation by one site.

    Each is that of an orbit of p basis states, by its least one r,

    .. math::

        |r, k\rangle = \frac{1}{\sqrt p} \sum_{j < p} e^{-2 \pi i k j / L}\, T^j |r\rangle,

    where :math:`k p` is a multiple of L; other orbits have no state of this momentum.

    Attributes
    ----------
    momentum : int
        k, from 0 to L - 1.
    """

    momentum: int = 0

    @property
    def asked(self) -> str:
        """The user's request in words, with the momenta that exist where this one has no state."""
        own = " and ".join(filter(None, [super().asked, f"momentum={self.momentum}"]))
        if self.size or not self.whole.size:
            return own
        periods = np.unique(self._orbits[2])
        there = [k for k in range(self.sites) if (k * periods % self.sites == 0).any()]
        return f"{own}: the momenta there are {', '.join(map(str, there))}"

    @property
    def is_real(self) -> bool:
        """Whether all phases are 1 or -1."""
        return 2 * self.momentum % self.sites == 0

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
        least, shift, period = (part[self.rank(moved)] for part in self._orbits)
        places: Integers = self._places[least]
        own = self._orbits[2][self.rank(origin)]
        amplitudes = self._phases[self.momentum * shift % self.sites] * np.sqrt(own / period)
        return places, amplitudes.real if self.is_real else amplitudes

    def place(self, state: int) -> int | None:
        """Return the place of the orbit of a state, None if it has none of this momentum."""
        place = self.whole.place(state)
        found = -1 if place is None else int(self._places[self._orbits[0][place]])
        return None if found < 0 else found

    def projected(self, psi: NDArray[Any]) -> NDArray[Any]:
        r"""Return the part :math:`\langle r, k | \psi \rangle` of a state of all momenta."""
        found = np.zeros(self.size, dtype=complex)
        states = self.states
        for j in range(self.sites):
            phase = self._phases[self.momentum * j % self.sites]
            found += phase * psi[self.whole.rank(states)]
            states = self._translated(states)
        period = self._orbits[2][self._leasts[self._is_kept]]
        found *= np.sqrt(period) / self.sites
        return found.real if self.is_real and not np.iscomplexobj(psi) else found

    def __getstate__(self) -> dict[str, object]:
        """Leave out what can be computed again."""
        return {**super().__getstate__(), "momentum": self.momentum}

    @cached_property
    def _every(self) -> Integers:
        return np.concatenate([np.empty(0, np.int64), *self.blocks()])

    @cached_property
    def _phases(self) -> NDArray[np.complex128]:
        found: NDArray[np.complex128] = np.exp(2j * np.pi * np.arange(self.sites) / self.sites)
        return found

    def _translated(self, states: Integers) -> Integers:
        bits = self.width * (self.sites - 1)
        found: Integers = (states & ((1 << bits) - 1)) << self.width | states >> bits
        return found

    @cached_property
    def _orbits(self) -> tuple[Integers, Integers, Integers]:
        """Rank of the least state of an orbit, shift to it, and period, by basis state."""
        every = self._every
        least, back, period = every.copy(), np.zeros_like(every), np.full_like(every, self.sites)
        moved = every
        for j in range(1, self.sites):
            moved = self._translated(moved)
            is_less = moved < least
            least[is_less], back[is_less] = moved[is_less], j
            period[(moved == every) & (period == self.sites)] = j
        return self.rank(least), (-back) % self.sites, period

    @cached_property
    def _leasts(self) -> Integers:
        """The ranks of the least states of all orbits."""
        found: Integers = np.unique(self._orbits[0])
        return found

    @cached_property
    def _is_kept(self) -> NDArray[np.bool_]:
        """Which orbits have a state of this momentum."""
        found: NDArray[np.bool_] = self.momentum * self._orbits[2][self._leasts] % self.sites == 0
        return found

    @cached_property
    def _places(self) -> Integers:
        """The place of each least state, by its rank; -1 for others, and for orbits left out."""
        found = np.full(self._every.size, -1)
        kept = self._leasts[self._is_kept]
        found[kept] = np.arange(kept.size)
        return found


def with_momentum(basis: Basis, momentum: int) -> MomentumBasis:
    """Return the states of a momentum in a basis."""
    charges: tuple[Charge, ...] = basis.charges
    return MomentumBasis(basis.sites, basis.levels, charges, momentum)


def moving(products: Sum, sites: int) -> Moved | None:
    """Return a product of a sum whose translation by one site has another coefficient, if any."""
    plain = {_ordered(key): z for key, z in products.amplitudes.items()}
    largest = max(map(abs, plain.values()), default=0.0)
    for key, z in products.amplitudes.items():
        other = plain.get(_ordered(_translated(key, sites)), 0.0)
        if abs(other - z) > 1e-12 * largest:
            return key
    return None


def _translated(key: Moved, sites: int) -> Moved:
    steps = tuple(((site + 1) % sites, step) for site, step in key.steps)
    factors = tuple(replace(each, site=(each.site + 1) % sites) for each in key.factors)
    return Moved(steps, factors, key.mask)


def _ordered(key: Moved) -> Moved:
    def by_site(each: Factor) -> tuple[int, tuple[float, ...]]:
        return each.site, each.values

    return Moved(tuple(sorted(key.steps)), tuple(sorted(key.factors, key=by_site)), key.mask)
