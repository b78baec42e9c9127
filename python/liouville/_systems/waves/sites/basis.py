"""Basis states of sites: packed into the bits of integers, and ranked by two small tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted

Integers = NDArray[np.int64]

#: States are integers of 64 bits, and their sign is not used.
MOST_BITS = 62

#: A half of the sites has at most so many states, so that its tables are small.
LARGEST_HALF = 2**24


@dataclass(frozen=True)
class Charge:
    """A sum of the digits of some sites that a sector fixes, or its remainder.

    Attributes
    ----------
    name : str
        Its name in messages, such as "the number of spins up".
    asked : str
        How the user asked for it, such as "up=3".
    first, last : int
        The sites that count are those from the first to before the last.
    total : int
        The sum of their digits.
    modulus : int
        2 if only its parity is fixed, 0 if the sum itself is.
    """

    name: str
    asked: str
    first: int
    last: int
    total: int
    modulus: int = 0

    def change(self, steps: tuple[tuple[int, int], ...]) -> int:
        """Return by how much steps of digits, pairs of site and step, change it."""
        found = sum(step for site, step in steps if self.first <= site < self.last)
        return found % self.modulus if self.modulus else found


@dataclass(frozen=True)
class Basis:
    """All states of sites with digits 0 to d - 1, or those with fixed charges, ascending.

    The digit of site i is in the bits from ``width * i`` on. States with the same high sites stand
    beside each other: their low sites have all digits that give the charges, ascending. The rank
    of a state is the first of its high sites plus the rank of its low ones among these
    :cite:p:`lin1990`.

    Attributes
    ----------
    sites, levels : int
        Number of sites, and d.
    charges : tuple of Charge
        What is fixed.
    """

    sites: int
    levels: int
    charges: tuple[Charge, ...] = field(default=())

    @property
    def whole(self) -> Basis:
        """The basis states that states are made of: these."""
        return self

    def projected(self, psi: NDArray[Any]) -> NDArray[Any]:
        """Return a state of all basis states in this basis."""
        return psi

    @property
    def asked(self) -> str:
        """The user's request in words."""
        return " and ".join(charge.asked for charge in self.charges)

    @property
    def is_real(self) -> bool:
        """Whether states are made of basis states by real numbers."""
        return True

    @property
    def width(self) -> int:
        """Bits of a site."""
        return max(1, (self.levels - 1).bit_length())

    def check(self, hint: str = "longer ones are for tensor networks") -> None:
        """Refuse more sites than an integer or the tables have room for."""
        if not self._has_room(self.sites, self.levels):
            most = MOST_BITS // self.width
            while not self._has_room(most, self.levels):
                most -= 1
            sentence = f"{self.sites} sites of {self.levels} states: at most {most} are taken"
            raise ValueError(hinted(sentence, hint))

    @property
    def most_levels(self) -> int:
        """The most states that so many sites may have, 1 if there are too many."""
        levels = self.levels
        while levels > 1 and not self._has_room(self.sites, levels):
            levels -= 1
        return levels

    @staticmethod
    def _has_room(sites: int, levels: int) -> bool:
        """Return whether an integer and the tables have room for so many sites."""
        width = max(1, (levels - 1).bit_length())
        return sites * width <= MOST_BITS and levels ** (sites - sites // 2) <= LARGEST_HALF

    @property
    def size(self) -> int:
        """Number of states."""
        return int(self._firsts[1])

    def digits(self, states: Integers, site: int) -> Integers:
        """Return the digits of a site."""
        found: Integers = states >> (self.width * site) & ((1 << self.width) - 1)
        return found

    def blocks(self) -> Iterator[Integers]:
        """Give the states in ascending order, those with the same high sites at once."""
        shift = self.width * (self.sites // 2)
        for high, needed in zip(self._high[0].tolist(), self._needed.tolist(), strict=True):
            if (lows := self._classes.get(needed)) is not None:
                yield (high << shift) + lows

    @cached_property
    def states(self) -> Integers:
        """The states in order."""
        return np.concatenate([np.empty(0, np.int64), *self.blocks()])

    def rank(self, states: Integers) -> Integers:
        """Return the places of states, which must be in the basis."""
        shift = self.width * (self.sites // 2)
        found: Integers = self._firsts[0][states >> shift]
        found += self._ranks[states & ((1 << shift) - 1)]
        return found

    def placed(self, moved: Integers, origin: Integers) -> tuple[Integers, NDArray[Any]]:
        """Return the places of states, and amplitudes there, where a state, `origin`, is moved."""
        return self.rank(moved), np.ones(origin.size)

    def place(self, state: int) -> int | None:
        """Return the place of a state, None if it is not in the basis."""
        if not 0 <= state < 1 << (self.width * self.sites):
            return None
        at = np.array([state])
        if any(self.digits(at, i)[0] >= self.levels for i in range(self.sites)):
            return None
        for charge in self.charges:
            found = sum(int(self.digits(at, i)[0]) for i in range(charge.first, charge.last))
            if (found - charge.total) % charge.modulus if charge.modulus else found != charge.total:
                return None
        return int(self.rank(at)[0])

    def __getstate__(self) -> dict[str, object]:
        """Leave out what can be computed again."""
        return {name: getattr(self, name) for name in ("sites", "levels", "charges")}

    @cached_property
    def _low(self) -> tuple[Integers, Integers]:
        return self._half(0, self.sites // 2)

    @cached_property
    def _high(self) -> tuple[Integers, Integers]:
        return self._half(self.sites // 2, self.sites)

    def _half(self, first: int, last: int) -> tuple[Integers, Integers]:
        """Return the states of some sites, from bit 0 on, and their charges as columns."""
        states = np.zeros(1, np.int64)
        sums = np.zeros((1, len(self.charges)), np.int64)
        digits = np.arange(self.levels)
        for i in range(first, last):
            states = ((digits << (self.width * (i - first)))[:, None] + states).ravel()
            counts = np.array([c.first <= i < c.last for c in self.charges], dtype=np.int64)
            sums = (digits[:, None, None] * counts + sums).reshape(states.size, len(self.charges))
        for k, charge in enumerate(self.charges):
            if charge.modulus:
                sums[:, k] %= charge.modulus
        return states, sums

    def _keys(self, sums: Integers) -> Integers:
        """Return one number for the charges of each state, -1 where one of them is negative."""
        keys = np.zeros(len(sums), np.int64)
        for k in range(len(self.charges)):
            keys = keys * (self.sites * self.levels + 1) + sums[:, k]
        keys[(sums < 0).any(axis=1)] = -1
        return keys

    @cached_property
    def _classes(self) -> dict[int, Integers]:
        """The low sites' states by their charges."""
        states, sums = self._low
        keys = self._keys(sums)
        by_key = np.argsort(keys, kind="stable")
        found, starts = np.unique(keys[by_key], return_index=True)
        parts = np.split(states[by_key], starts[1:])
        return dict(zip(found.tolist(), parts, strict=True))

    @cached_property
    def _needed(self) -> Integers:
        """The charges that each state of the high sites needs of the low ones."""
        sums = np.array([charge.total for charge in self.charges], dtype=np.int64) - self._high[1]
        for k, charge in enumerate(self.charges):
            if charge.modulus:
                sums[:, k] %= charge.modulus
        return self._keys(sums)

    @cached_property
    def _firsts(self) -> tuple[Integers, int]:
        """The rank of the first state with these high sites, and how many states there are."""
        sizes = {key: lows.size for key, lows in self._classes.items()}
        counts = np.array([sizes.get(key, 0) for key in self._needed.tolist()], dtype=np.int64)
        firsts = np.zeros(1 << (self.width * (self.sites - self.sites // 2)), np.int64)
        firsts[self._high[0]] = np.cumsum(counts) - counts
        return firsts, int(counts.sum())

    @cached_property
    def _ranks(self) -> Integers:
        """The rank of each state of the low sites among those with the same charges."""
        ranks = np.zeros(1 << (self.width * (self.sites // 2)), np.int64)
        for lows in self._classes.values():
            ranks[lows] = np.arange(lows.size)
        return ranks
