"""RK4 by Numba on tracers in the ABC flow, with ``run(steps) -> (seconds, x)``.

x' = A sin z + C cos y, y' = B sin x + A cos z, z' = C sin y + B cos x

States are (P, 3). The loops are compiled for this processor with fused and reordered operations;
compiling is not part of the time. Sines and cosines are those that Numba takes: the C library's, or
Intel's SVML in vectors where it is installed.
"""

import time
from math import cos, sin

import numba
import numpy as np

from .rk4 import BLOCK, FAST, stepper

A, B, C = 1.0, 0.8, 0.6


@numba.njit(inline="always", **FAST)
def field(x, y, z):
    return A * sin(z) + C * cos(y), B * sin(x) + A * cos(z), C * sin(y) + B * cos(x)


rk4_step = stepper(field)


@numba.njit(**FAST)
def loop(x, h, steps):
    for p in range(x.shape[0]):
        a, b, c = x[p, 0], x[p, 1], x[p, 2]
        for _ in range(steps):
            a, b, c = rk4_step(a, b, c, h)
        x[p, 0], x[p, 1], x[p, 2] = a, b, c


@numba.njit(**FAST)
def vectors(x, h, steps):
    """Take blocks through all steps, the loop over tracers inside: it becomes vectors."""
    for first in range(0, x.shape[0], BLOCK):
        count = min(BLOCK, x.shape[0] - first)
        part = x[first : first + count].T.copy()
        a, b, c = part[0], part[1], part[2]
        for _ in range(steps):
            for j in range(count):
                a[j], b[j], c[j] = rk4_step(a[j], b[j], c[j], h)
        x[first : first + count] = part.T


class RK4:
    """RK4 compiled by Numba on one thread: a loop over tracers, or over blocks of them."""

    def __init__(self, start, span, kernel):
        self.kernel, self.start, self.span = kernel, start, span
        kernel(start[:2].copy(), 1e-3, 1)

    def run(self, steps):
        """Integrate with a number of steps."""
        x = np.array(self.start)
        begin = time.process_time()
        self.kernel(x, self.span / steps, steps)
        return time.process_time() - begin, x
