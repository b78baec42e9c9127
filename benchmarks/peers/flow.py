"""Other codes on tracers in the Bajer-Moffatt flow, each with ``run(setting) -> (seconds, x)``.

x' = alpha z - 8 x y, y' = 11 x^2 + 3 y^2 + z^2 + beta x z - 3, z' = -alpha x + 2 y z - beta x y

with alpha = beta = 1, written out in each code. States are (P, 3). A setting is a number of steps,
or a tolerance. The Numba loops are compiled for this processor with fused and reordered operations;
compiling is not part of the time.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from copy import copy

import heyoka as hy
import numba
import numpy as np
from scipy.integrate import solve_ivp

from .rk4 import BLOCK, FAST, stepper

CHUNK = 16384  # tracers whose arrays stay in the cache, for NumPy


def clock(threads=1):
    """Return seconds, of the processor for one thread: other work on the machine does not count."""
    return time.process_time() if threads == 1 else time.perf_counter()


@numba.njit(inline="always", **FAST)
def field(x, y, z):
    return z - 8 * x * y, 11 * x * x + 3 * y * y + z * z + x * z - 3, -x + 2 * y * z - x * y


rk4_step = stepper(field)


@numba.njit(inline="always", **FAST)
def one_tracer(x, p, h, steps):
    a, b, c = x[p, 0], x[p, 1], x[p, 2]
    for _ in range(steps):
        a, b, c = rk4_step(a, b, c, h)
    x[p, 0], x[p, 1], x[p, 2] = a, b, c


@numba.njit(**FAST)
def loop(x, h, steps):
    for p in range(x.shape[0]):
        one_tracer(x, p, h, steps)


@numba.njit(parallel=True, **FAST)
def loop_in_threads(x, h, steps):
    for p in numba.prange(x.shape[0]):
        one_tracer(x, p, h, steps)


@numba.njit(inline="always", **FAST)
def one_block(x, first, h, steps):
    """Take a block through all steps, the loop over its tracers inside: it becomes vectors."""
    count = min(BLOCK, x.shape[0] - first)
    a, b, c = np.empty(count), np.empty(count), np.empty(count)
    for j in range(count):
        a[j], b[j], c[j] = x[first + j, 0], x[first + j, 1], x[first + j, 2]
    for _ in range(steps):
        for j in range(count):
            a[j], b[j], c[j] = rk4_step(a[j], b[j], c[j], h)
    for j in range(count):
        x[first + j, 0], x[first + j, 1], x[first + j, 2] = a[j], b[j], c[j]


@numba.njit(**FAST)
def blocks(x, h, steps):
    for first in range(0, x.shape[0], BLOCK):
        one_block(x, first, h, steps)


@numba.njit(parallel=True, **FAST)
def blocks_in_threads(x, h, steps):
    for block in numba.prange((x.shape[0] + BLOCK - 1) // BLOCK):
        one_block(x, block * BLOCK, h, steps)


class Numba:
    """RK4 compiled by Numba: a loop over tracers, or over blocks of them."""

    def __init__(self, start, span, *, vectorised, threads):
        kernels = ((loop, loop_in_threads), (blocks, blocks_in_threads))
        self.kernel = kernels[vectorised][threads > 1]
        self.start, self.span, self.threads = start, span, threads
        self.kernel(start[:2].copy(), 1e-3, 1)

    def run(self, steps):
        """Integrate with a number of steps."""
        numba.set_num_threads(self.threads)
        x = self.start.copy()
        begin = clock(self.threads)
        self.kernel(x, self.span / steps, steps)
        return clock(self.threads) - begin, x


def derivative(x):
    """Return the field at the points x (3, P)."""
    a, b, c = x
    first = c - 8 * a * b
    second = 11 * a * a + 3 * b * b + c * c + a * c - 3
    return np.stack([first, second, -a + 2 * b * c - a * b])


class NumPy:
    """RK4 in NumPy: arrays of all tracers, or of as many as the cache holds."""

    def __init__(self, start, span, *, chunk=CHUNK):
        self.start, self.span, self.chunk = start, span, chunk or len(start)

    def run(self, steps):
        """Integrate with a number of steps."""
        h, found = self.span / steps, []
        begin = clock()
        for first in range(0, len(self.start), self.chunk):
            x = np.ascontiguousarray(self.start[first : first + self.chunk].T)
            for _ in range(steps):
                k1 = derivative(x)
                k2 = derivative(x + h / 2 * k1)
                k3 = derivative(x + h / 2 * k2)
                k4 = derivative(x + h * k3)
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            found.append(x.T)
        x = np.concatenate(found)
        return clock() - begin, x


def symbolic():
    """Return the field as heyoka takes it."""
    x, y, z = hy.make_vars("x", "y", "z")
    second = 11.0 * x * x + 3.0 * y * y + z * z + x * z - 3.0
    return [(x, z - 8.0 * x * y), (y, second), (z, -x + 2.0 * y * z - x * y)]


class Heyoka:
    """heyoka's Taylor series on batches of as many tracers as a vector holds."""

    def __init__(self, start, span, *, threads):
        self.start, self.span, self.threads = start, span, threads
        self.width = hy.recommended_simd_size()
        self.states = np.ascontiguousarray(start.reshape(-1, self.width, 3).swapaxes(1, 2))
        self.made = {}

    def integrator(self, tol):
        """Compile the series of a tolerance, once."""
        if tol not in self.made:
            zero = np.zeros((3, self.width))
            self.made[tol] = hy.taylor_adaptive_batch(
                symbolic(), zero, tol=tol, fast_math=True, force_avx512=True
            )
        return self.made[tol]

    def run(self, tol):
        """Integrate with a tolerance."""
        made = [copy(self.integrator(tol)) for _ in range(self.threads)]
        shares = np.array_split(self.states, self.threads)
        begin = clock(self.threads)
        with ThreadPoolExecutor(self.threads) as pool:
            found = np.concatenate(list(pool.map(self.batches, made, shares)))
        seconds = clock(self.threads) - begin
        return seconds, found.swapaxes(1, 2).reshape(-1, 3)

    def batches(self, integrator, starts):
        """Integrate batches in turn; heyoka's own ensemble copies its integrator for each."""
        found, state = np.empty_like(starts), integrator.state
        for batch, start in enumerate(starts):
            integrator.set_time(0.0)
            state[:] = start
            integrator.propagate_until(self.span)
            found[batch] = state
        return found


class SciPy:
    """SciPy's DOP853: each tracer of a sample alone, or all of them as one system."""

    def __init__(self, start, span, *, sample):
        self.start, self.span, self.sample = start, span, sample

    def run(self, tol):
        """Integrate with a tolerance; the time of a sample is scaled to all tracers."""
        begin = clock()
        if self.sample:
            found = np.stack([self.alone(x, tol) for x in self.start[: self.sample]])
            return (clock() - begin) * len(self.start) / self.sample, found
        x = self.solve(lambda t, x: derivative(x.reshape(3, -1)).ravel(), self.start.T.ravel(), tol)
        return clock() - begin, x.reshape(3, -1).T

    def alone(self, x, tol):
        """Return the end of one tracer."""

        def of_one(t, state):
            x, y, z = state.tolist()
            return z - 8 * x * y, 11 * x * x + 3 * y * y + z * z + x * z - 3, -x + 2 * y * z - x * y

        return self.solve(of_one, x, tol)

    def solve(self, function, x, tol):
        """Return the end of a system."""
        found = solve_ivp(function, (0.0, self.span), x, method="DOP853", rtol=tol, atol=tol)
        if not found.success:
            raise RuntimeError(found.message)
        return found.y[:, -1]
