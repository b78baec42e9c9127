"""Families of permutations: for each i and each d others, one of them places i after these."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations

import numpy as np

#: Moves of the search for a smaller family, and its seed.
MOVES, SEED = 4000, 1

#: Families are searched for so many pairs of i and d others; beyond, they are only gathered.
MOST_SEARCHED = 50_000

#: A move for the worse is made as often as this.
UPWARD = 0.05

#: Random permutations that are compared for each one gathered, times rows at most.
TRIES, MOST_COMPARED = 200, 10**7


@lru_cache(maxsize=64)
def family(n: int, d: int) -> np.ndarray:
    """Return permutations of n numbers, as positions: row q holds the place of each number in q.

    For any number i and any d others, i stands after all of them in one of the permutations. There
    are as few as possible for d = 1 and 2, and few for d > 2.
    """
    if d == 0 or n <= 1:
        return np.arange(n)[None]
    if d == 1:
        return np.array([np.arange(n), np.arange(n)[::-1]])
    if d == 2 and n > 2:
        return _from_intersecting_sets(n)
    if n <= d + 1:  # each number is last once
        return np.array([np.roll(np.arange(n), k) for k in range(n)])
    return covering(n, _all_pairs(n, d))


def smallest(n: int) -> int:
    """Return the size of the smallest family for d = 2: the dimension of the complete graph."""
    counts = [0, 1, 2, 4, 12, 81, 2646, 1_422_564, 229_809_982_112]
    return next(t for t, count in enumerate(counts) if n <= count)


def _from_intersecting_sets(n: int) -> np.ndarray:
    """Give each number a maximal family of subsets of {0, .., t-1} that meet pairwise.

    Such a family has one of each pair {B, complement of B}. In permutation l numbers are sorted by
    whether their choice contains l, pair by pair. At the first pair in which v and w differ, v is
    after w just in the permutations of v's choice; and two sets of v's family meet, so that v is
    after both of two others in some permutation.

    References
    ----------
    The sizes are those of :cite:t:`hosten1999`.
    """
    t = smallest(n)
    choices = _intersecting_families(n, t)
    positions = np.empty((t, n), dtype=np.int64)
    for place in range(t):
        keys = np.packbits((choices >> place) & 1, axis=1)
        order = np.lexsort(keys.T[::-1])
        positions[place, order] = np.arange(n)
    return positions


def _intersecting_families(n: int, t: int) -> np.ndarray:
    """Return the sets that n families choose, as bits of an integer: of shape (n, pairs).

    Pairs come in the order of their smaller set. Whatever a family has chosen, one set of the next
    pair meets all of it, so that choices are only ever added.
    """
    full = 2**t - 1
    sizes = [int(b).bit_count() for b in range(full + 1)]
    lows = sorted(range(2 ** (t - 1)), key=lambda b: (min(sizes[b], t - sizes[b]), b))
    choices = np.empty((1, 0), dtype=np.uint8 if t <= 8 else np.uint16)
    barred = np.zeros((1, -(-(full + 1) // 8)), dtype=np.uint8)  # sets that miss a chosen one
    for low in lows:
        first, second = low, full ^ low
        takes_first = np.flatnonzero(~_has(barred, first))
        takes_second = np.flatnonzero(~_has(barred, second))
        if len(choices) < n:
            # those that can only take one come first, so that no family is lost
            forced = np.setdiff1d(takes_second, takes_first, assume_unique=True)
            free = np.intersect1d(takes_second, takes_first, assume_unique=True)
            takes_second = np.concatenate([forced, free[: n - len(choices)]])
        else:
            takes_second = np.setdiff1d(takes_second, takes_first, assume_unique=True)
        rows = np.concatenate([takes_first, takes_second])
        taken = np.repeat([first, second], [takes_first.size, takes_second.size])
        choices = np.column_stack([choices[rows], taken.astype(choices.dtype)])
        barred = barred[rows]
        for chosen, part in (
            (first, slice(takes_first.size)),
            (second, slice(takes_first.size, None)),
        ):
            barred[part] |= _missing(chosen, full)
    return choices


def _has(barred: np.ndarray, subset: int) -> np.ndarray:
    return ((barred[:, subset >> 3] >> (subset & 7)) & 1).astype(bool)


def _missing(chosen: int, full: int) -> np.ndarray:
    """Return bits for the sets that do not meet one."""
    misses = (np.arange(full + 1) & chosen) == 0
    return np.packbits(misses, bitorder="little")


def _all_pairs(n: int, d: int) -> np.ndarray:
    """List each number with each d others: rows of 1 + d numbers."""
    rows = [
        (i, *others) for i in range(n) for others in combinations([*range(i), *range(i + 1, n)], d)
    ]
    return np.array(rows)


def covering(n: int, wanted: np.ndarray) -> np.ndarray:
    """Return few permutations so that each row's first number stands once after its others.

    They are gathered one by one; then, one after another, each is tried to be done without, by
    moving single numbers in the others.

    Parameters
    ----------
    n : int
        How many numbers there are.
    wanted : ndarray, shape (N, 1 + d)
        The rows; the others of a row may repeat.
    """
    rng = np.random.default_rng(SEED)
    positions = _gathered(n, wanted, rng)
    while len(wanted) <= MOST_SEARCHED and len(positions) > 2:
        fewer = _changed(positions[:-1].copy(), wanted, rng)
        if fewer is None:
            break
        positions = fewer
    return positions


def _is_after(position: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return np.asarray(position[wanted[:, 0]] > position[wanted[:, 1:]].max(axis=1))


def _gathered(n: int, wanted: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Add the best of some permutations until every row has one."""
    found: list[np.ndarray] = []
    left = wanted
    while len(left):
        tries = [_placing_last(n, left)]
        tries += [rng.permutation(n) for _ in range(min(TRIES, MOST_COMPARED // len(left)))]
        best = max(tries, key=lambda position: int(_is_after(position, left).sum()))
        found.append(best)
        left = left[~_is_after(best, left)]
    return np.array(found).reshape(-1, n)


def _placing_last(n: int, left: np.ndarray) -> np.ndarray:
    """Place numbers by how often they are to stand after others, that of the first row last."""
    often = np.bincount(left[:, 0], minlength=n).astype(float)
    often[left[0, 0]] = np.inf
    return np.argsort(np.argsort(often, kind="stable"))


def _changed(
    positions: np.ndarray, wanted: np.ndarray, rng: np.random.Generator
) -> np.ndarray | None:
    """Move single numbers until every row has a permutation; None if that is not found.

    A move serves a row that has none, and is the best there is in a permutation; it is made if not
    more rows are left without, and now and then though more are.
    """
    after = np.array([_is_after(position, wanted) for position in positions])
    counts = after.sum(axis=0)
    for _ in range(MOVES):
        missing = np.flatnonzero(counts == 0)
        if not missing.size:
            return positions
        q = rng.integers(len(positions))
        moves = _moves(positions[q], wanted[rng.choice(missing)])
        afters = [_is_after(moved, wanted) for moved in moves]
        others = counts - after[q]
        left = np.array([(others + each == 0).sum() for each in afters]) + rng.random(len(moves))
        best = int(left.argmin())
        if left[best] <= missing.size + 1 or rng.random() < UPWARD:
            positions[q], after[q] = moves[best], afters[best]
            counts = others + after[q]
    return positions if (counts > 0).all() else None


def _moves(position: np.ndarray, row: np.ndarray) -> list[np.ndarray]:
    """Place the row's first number after its others, wherever there is room."""
    order = np.argsort(position)
    rest = order[order != row[0]]
    least = int(np.flatnonzero(np.isin(rest, row[1:])).max()) + 1
    return [np.argsort(np.insert(rest, k, row[0])) for k in range(least, rest.size + 1)]
