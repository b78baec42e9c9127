"""Colours for groups of assignments, so that those of one colour are one simultaneous assignment.

Groups conflict if one reads what the other writes. The fewest colours are the chromatic number of
that graph; a greedy colouring in two orders, mended by Kempe's chains, comes close, and is exact
for the lattices met in practice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from liouville._systems.fields.terms import grouped

#: The last colour is removed only if it has at most this many groups, and there are few colours.
MOST_MENDED, MOST_COLOURS = 32, 16

#: Chains of more groups are not exchanged.
LONGEST_CHAIN = 2000


@dataclass(frozen=True)
class Lists:
    """Lists of numbers one after another: list k is ``items[start[k] : start[k + 1]]``."""

    start: list[int]
    items: list[int]

    @classmethod
    def of(cls, rows: np.ndarray, items: np.ndarray, count: int) -> Lists:
        """Collect the distinct items of each row from pairs of a row and an item."""
        size = 1 + int(max(rows.max(initial=0), items.max(initial=0)))
        order, starts = grouped([rows, items], size)
        first = order[starts]
        start = np.searchsorted(rows[first], np.arange(count + 1))
        return cls(start.tolist(), items[first].tolist())

    def __getitem__(self, k: int) -> list[int]:
        """Return one list."""
        return self.items[self.start[k] : self.start[k + 1]]

    def turned(self, count: int) -> Lists:
        """Return for each item the rows that have it."""
        rows = np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))
        return Lists.of(np.array(self.items, dtype=np.int64), rows, count)


@dataclass(frozen=True)
class Conflicts:
    """Which of n variables each group writes, and which it reads."""

    n: int
    writes: Lists
    reads: Lists

    @property
    def count(self) -> int:
        """Return how many groups there are."""
        return len(self.writes.start) - 1

    @cached_property
    def _writers(self) -> Lists:
        return self.writes.turned(self.n)

    @cached_property
    def _readers(self) -> Lists:
        return self.reads.turned(self.n)

    def neighbours(self, group: int) -> set[int]:
        """Return the groups that conflict with one."""
        found = {g for v in self.reads[group] for g in self._writers[v]}
        found |= {g for v in self.writes[group] for g in self._readers[v]}
        return found - {group}

    def sizes(self) -> np.ndarray:
        """Return for how many groups each is in the way, those counted twice that are so twice."""
        ends = [np.array(lists.start) for lists in (self.writes, self.reads)]
        items = [np.array(lists.items, dtype=np.int64) for lists in (self.writes, self.reads)]
        writers, readers = (np.bincount(there, minlength=self.n) for there in items)
        found = np.zeros(self.count, dtype=np.int64)
        for end, there, others in zip(ends, items, (readers, writers), strict=True):
            total = np.concatenate([[0], np.cumsum(others[there])])
            found += total[end[1:]] - total[end[:-1]]
        return found


def coloured(conflicts: Conflicts) -> np.ndarray:
    """Return a colour 0, 1, ... for each group."""
    if not conflicts.count:
        return np.empty(0, dtype=np.int64)
    orders = [np.arange(conflicts.count)]
    largest_first = np.argsort(-conflicts.sizes(), kind="stable")
    if not np.array_equal(largest_first, orders[0]):
        orders.insert(0, largest_first)
    colours = min((_greedy(conflicts, order.tolist()) for order in orders), key=max)
    while _mended(conflicts, colours):
        pass
    return np.array(colours, dtype=np.int64)


def _greedy(conflicts: Conflicts, order: list[int]) -> list[int]:
    """Give each group the first colour that none in its way has; sets of colours are bits."""
    written, read = [0] * conflicts.n, [0] * conflicts.n
    bits = [0] * conflicts.count
    writes, reads = conflicts.writes, conflicts.reads
    for group in order:
        its_writes, its_reads = writes[group], reads[group]
        taken = 0
        for v in its_reads:
            taken |= written[v]
        for v in its_writes:
            taken |= read[v]
        bit = ~taken & (taken + 1)
        bits[group] = bit
        for v in its_reads:
            read[v] |= bit
        for v in its_writes:
            written[v] |= bit
    return [bit.bit_length() - 1 for bit in bits]


def _mended(conflicts: Conflicts, colours: list[int]) -> bool:
    """Try to do without the last colour."""
    last = max(colours, default=0)
    if not 2 <= last < MOST_COLOURS:
        return False
    groups = [g for g, colour in enumerate(colours) if colour == last]
    if len(groups) > MOST_MENDED:
        return False
    return all(_freed(conflicts, colours, group, last) for group in groups)


def _freed(conflicts: Conflicts, colours: list[int], group: int, last: int) -> bool:
    """Give a group a colour below the last, exchanging two colours along a chain if need be."""
    around = conflicts.neighbours(group)
    having: list[list[int]] = [[] for _ in range(last + 1)]
    for other in around:
        having[colours[other]].append(other)
    for colour in range(last):
        for exchanged in range(last):
            if not having[colour]:
                colours[group] = colour
                return True
            if exchanged == colour:
                continue
            chain = _chain(conflicts, colours, having[colour], colour, exchanged)
            if chain and chain.isdisjoint(having[exchanged]):
                for other in chain:
                    colours[other] = colour + exchanged - colours[other]
                colours[group] = colour
                return True
    return False


def _chain(
    conflicts: Conflicts, colours: list[int], start: list[int], *pair: int
) -> set[int] | None:
    """Return all that hang together with the start in two colours, None if these are many."""
    chain, front = set(start), list(start)
    while front:
        for other in conflicts.neighbours(front.pop()):
            if other not in chain and colours[other] in pair:
                chain.add(other)
                front.append(other)
        if len(chain) > LONGEST_CHAIN:
            return None
    return chain
