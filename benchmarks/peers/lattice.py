"""RK4 on inviscid Lorenz-96 and the memory's speed, in loops compiled by Numba.

x_i' = (x_{i+1} - x_{i-2}) x_{i-1}, indices modulo n

Each code has ``run(steps) -> (seconds, x)``. The loops are compiled for this processor with fused
and reordered operations; compiling is not part of the time.
"""

import time

import numba
import numpy as np

FAST = {"fastmath": True, "error_model": "numpy"}
TILE = 1024  # sites that go through a whole step in the first cache
BEFORE, AFTER = 8, 4  # neighbours that the four stages of a step need of a tile


@numba.njit(**FAST)
def derivative(x, k):
    n = x.shape[0]
    for i in range(n):
        k[i] = (x[(i + 1) % n] - x[i - 2]) * x[i - 1]


@numba.njit(**FAST)
def plain(x, other, work, h, steps):
    """RK4 as one writes it down: the derivative in a function, its arrays combined in loops."""
    n = x.shape[0]
    k, y = work[0], work[1]
    for _ in range(steps):
        derivative(x, k)
        for i in range(n):
            other[i] = x[i] + h / 6 * k[i]
            y[i] = x[i] + h / 2 * k[i]
        for weight, ahead in ((h / 3, h / 2), (h / 3, h)):
            derivative(y, k)
            for i in range(n):
                other[i] += weight * k[i]
                y[i] = x[i] + ahead * k[i]
        derivative(y, k)
        for i in range(n):
            other[i] += h / 6 * k[i]
        x, other = other, x
    return x


@numba.njit(inline="always", **FAST)
def stage(y, x, total, out, ahead, weight, is_first, low, high):
    """Add weight f(y) to the total and write x + ahead f(y), for the sites from low to high."""
    following, previous, second = y[low + 1 :], y[low - 1 :], y[low - 2 :]
    x, total, out = x[low:], total[low:], out[low:]
    for j in range(high - low):
        k = (following[j] - second[j]) * previous[j]
        total[j] = (x[j] if is_first else total[j]) + weight * k
        out[j] = x[j] + ahead * k


@numba.njit(**FAST)
def first_stage(x, total, out, ahead, weight, low, high):
    stage(x, x, total, out, ahead, weight, True, low, high)


@numba.njit(**FAST)
def next_stage(y, x, total, out, ahead, weight, low, high):
    stage(y, x, total, out, ahead, weight, False, low, high)


@numba.njit(**FAST)
def last_stage(y, total, out, weight, low, high):
    following, previous, second = y[low + 1 :], y[low - 1 :], y[low - 2 :]
    total = total[low:]
    for j in range(high - low):
        out[j] = total[j] + weight * ((following[j] - second[j]) * previous[j])


@numba.njit(**FAST)
def tile_step(x, out, low, high, h, work):
    """Take the sites from low to high through a step, their neighbours' stages computed again."""
    n, size = x.shape[0], high - low + BEFORE + AFTER
    x0, total, y, z = work[0], work[1], work[2], work[3]
    if low >= BEFORE and high + AFTER <= n:
        x0 = x[low - BEFORE : high + AFTER]
    else:
        for j in range(size):
            x0[j] = x[(low - BEFORE + j) % n]
    first_stage(x0, total, y, h / 2, h / 6, 2, size - 1)
    next_stage(y, x0, total, z, h / 2, h / 3, 4, size - 2)
    next_stage(z, x0, total, y, h, h / 3, 6, size - 3)
    last_stage(y, total, out[low:], h / 6, 8, size - 4)


@numba.njit(**FAST)
def tiles(x, other, work, h, steps):
    n = x.shape[0]
    for _ in range(steps):
        for low in range(0, n, TILE):
            tile_step(x, other, low, min(low + TILE, n), h, work[0])
        x, other = other, x
    return x


@numba.njit(parallel=True, **FAST)
def tiles_in_threads(x, other, work, h, steps):
    n, threads = x.shape[0], work.shape[0]
    count = (n + TILE - 1) // TILE
    for _ in range(steps):
        for thread in numba.prange(threads):
            for tile in range(thread * count // threads, (thread + 1) * count // threads):
                low = tile * TILE
                tile_step(x, other, low, min(low + TILE, n), h, work[thread])
        x, other = other, x
    return x


class Numba:
    """RK4 compiled by Numba: as one writes it down, or tile by tile in the cache, vectorised."""

    def __init__(self, start, span, *, tiled, threads):
        self.start, self.span, self.tiled, self.threads = start, span, tiled, threads
        self.kernel = (tiles, tiles_in_threads)[threads > 1] if tiled else plain
        shape = (threads, 4, TILE + BEFORE + AFTER) if tiled else (2, len(start))
        self.work = np.zeros(shape)
        self.kernel(start.copy(), start.copy(), self.work, 0.0, 1)

    def run(self, steps):
        """Integrate with a number of steps."""
        numba.set_num_threads(self.threads)
        x, other = self.start.copy(), self.start.copy()
        begin = time.perf_counter()
        x = self.kernel(x, other, self.work, self.span / steps, steps)
        return time.perf_counter() - begin, x


@numba.njit(**FAST)
def triad(a, b, c, repeats):
    for _ in range(repeats):
        for i in range(a.shape[0]):
            a[i] = b[i] + 3.0 * c[i]
        b, a = a, b


@numba.njit(parallel=True, **FAST)
def triad_in_threads(a, b, c, repeats):
    for _ in range(repeats):
        for i in numba.prange(a.shape[0]):
            a[i] = b[i] + 3.0 * c[i]
        b, a = a, b


class Triad:
    """a = b + 3 c with arrays that together have so many bytes, as STREAM does."""

    def __init__(self, size, *, threads):
        self.arrays = [np.full(max(size // 24, 1), 1e-300) for _ in range(3)]
        self.kernel = (triad, triad_in_threads)[threads > 1]
        self.threads = threads
        self.run(1)

    def run(self, repeats):
        """Return the seconds and the bytes a second."""
        numba.set_num_threads(self.threads)
        begin = time.perf_counter()
        self.kernel(*self.arrays, repeats)
        seconds = time.perf_counter() - begin
        return seconds, 24 * len(self.arrays[0]) * repeats / seconds
