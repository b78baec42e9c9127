"""The sparse matrix of a sum of products, by bit operations on blocks of basis states."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.scipy import scipy
from liouville._systems.waves.sites.basis import Basis, Integers
from liouville._systems.waves.sites.terms import Factor, Moved, Steps, Sum

#: So many basis states are looked at at once: their digits and amplitudes fit in a cache.
BLOCK = 2**13

#: From so many basis states the number of entries is estimated.
SAMPLE = 2**13

Numbers = NDArray[Any]


class Matrix:
    """A sum of products in a basis.

    Attributes
    ----------
    is_real : bool
        Whether all entries are real.
    is_diagonal : bool
        Whether nothing moves.
    """

    def __init__(self, basis: Basis, products: Sum) -> None:
        self.basis = basis
        is_real = all(z.imag == 0.0 for z in map(complex, products.amplitudes.values()))
        self.is_real = is_real and basis.is_real
        self._groups: dict[Steps, list[tuple[complex, Moved]]] = defaultdict(list)
        for key, z in products.amplitudes.items():
            self._groups[key.steps].append((z, key))
        self.is_diagonal = not any(self._groups)

    def diagonal(self) -> Numbers:
        """Return the diagonal, real if the matrix is."""
        kept = self._groups.get((), [])
        blocks = (Block(self.basis, states) for states in self._blocks())
        dtype = float if self.is_real else complex
        return np.concatenate([block.amplitudes(kept, dtype) for block in blocks])

    def entries(self) -> int:
        """Estimate the number of entries, from some of the states."""
        n, states = self.basis.size, self.basis.states
        some = states[:: -(-n // SAMPLE)]
        found = sum(len(at) for _, at, _ in self._moved(some))
        return n if not some.size else int(np.ceil(found * (n / some.size)))

    def csr(self) -> Any:
        """Return the matrix as SciPy has it, sparse by rows."""
        n = self.basis.size
        dtype = float if self.is_real else complex
        counts, cols, values = [], [], []
        for states in self._blocks():
            # column by column: the entries of row s are the conjugates of those of column s
            shape = (len(self._groups), states.size)
            col, value = np.full(shape, -1), np.zeros(shape, dtype)
            for k, at, (places, amplitudes) in self._moved(states):
                col[k, at], value[k, at] = places, amplitudes
            kept = col.T >= 0
            counts.append(np.count_nonzero(kept, axis=1))
            cols.append(col.T[kept].astype(np.int32))
            values.append(value.T[kept])
        starts = np.concatenate([[0], np.cumsum(np.concatenate(counts))])
        small = np.int32 if starts[-1] < 2**31 else np.int64
        found = (np.concatenate(values), np.concatenate(cols).astype(small, copy=False))
        matrix = scipy("sparse", "the matrix of a model of sites").csr_array(
            (*found, starts.astype(small)), shape=(n, n)
        )
        # states of a momentum are met by several of an orbit
        matrix.sum_duplicates()
        return matrix

    def _blocks(self) -> Iterator[Integers]:
        states = self.basis.states
        return (states[k : k + BLOCK] for k in range(0, states.size, BLOCK))

    def _moved(self, states: Integers) -> Iterator[tuple[int, Integers, tuple[Integers, Numbers]]]:
        """Give the number of each group, states that it acts on, where to, and conj. amplitudes."""
        block, width = Block(self.basis, states), self.basis.width
        dtype = float if self.is_real else complex
        for k, (steps, products) in enumerate(self._groups.items()):
            amplitudes = block.amplitudes(products, dtype)
            at = np.flatnonzero(amplitudes)
            moved = sum(step << (width * site) for site, step in steps)
            places, factors = self.basis.placed(states[at] + moved, states[at])
            yield k, at, (places, (amplitudes[at] * factors).conj())


class Block:
    """Some basis states, with what has been computed of them."""

    def __init__(self, basis: Basis, states: Integers) -> None:
        self.basis, self.states = basis, states
        self._digits: dict[int, Integers] = {}
        self._factors: dict[Factor, NDArray[np.float64]] = {}

    def amplitudes(self, products: list[tuple[complex, Moved]], dtype: type) -> Numbers:
        """Return the sum of the amplitudes of products that move the same digits."""
        total: Numbers = np.zeros(self.states.size, dtype)
        for z, key in products:
            own: Any = z.real if dtype is float else z
            for factor in key.factors:
                own = own * self._factor(factor)
            if key.mask:
                own = own * (1.0 - 2.0 * (np.bitwise_count(self.states & key.mask) & 1))
            total += own
        return total

    def _factor(self, factor: Factor) -> NDArray[np.float64]:
        if factor not in self._factors:
            if factor.site not in self._digits:
                self._digits[factor.site] = self.basis.digits(self.states, factor.site)
            self._factors[factor] = np.array(factor.values)[self._digits[factor.site]]
        return self._factors[factor]
