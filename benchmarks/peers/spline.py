"""The classical Runge-Kutta method on a periodic bicubic spline, one tracer after another in Numba.

x' = psi_y, y' = -psi_x on a square of n^2 cells, whose side is 2 pi. Fused and reordered operations
are allowed; compiling is not part of the time.
"""

import numba
import numpy as np

from .rk4 import FAST

SIDE = 2 * np.pi


def coefficients(psi):
    """Return the coefficients of the spline through node values, beyond a period too."""
    n = len(psi)
    of_nodes = (4 + 2 * np.cos(2 * np.pi * np.arange(n) / n)) / 6
    c = np.fft.ifft2(np.fft.fft2(psi) / np.outer(of_nodes, of_nodes)).real
    around = (np.arange(n + 3) - 1) % n
    return np.ascontiguousarray(c[around][:, around])


@numba.njit(inline="always", **FAST)
def functions(s):
    r = 1 - s
    values = (r**3 / 6, (3 * s**3 - 6 * s**2 + 4) / 6, (3 * r**3 - 6 * r**2 + 4) / 6, s**3 / 6)
    slopes = (-(r**2) / 2, (3 * s**2 - 4 * s) / 2, (4 * r - 3 * r**2) / 2, s**2 / 2)
    return values, slopes


@numba.njit(inline="always", **FAST)
def velocity(c, x, y):
    n = c.shape[0] - 3
    per = n / SIDE
    u, v = (x - np.floor(x / SIDE) * SIDE) * per, (y - np.floor(y / SIDE) * SIDE) * per
    i, j = min(int(u), n - 1), min(int(v), n - 1)
    (a0, a1, a2, a3), (b0, b1, b2, b3) = functions(u - i)
    (p0, p1, p2, p3), (q0, q1, q2, q3) = functions(v - j)
    by_x, by_y = 0.0, 0.0
    for r, a, b in ((0, a0, b0), (1, a1, b1), (2, a2, b2), (3, a3, b3)):
        c0, c1, c2, c3 = c[i + r, j], c[i + r, j + 1], c[i + r, j + 2], c[i + r, j + 3]
        by_x += b * (c0 * p0 + c1 * p1 + c2 * p2 + c3 * p3)
        by_y += a * (c0 * q0 + c1 * q1 + c2 * q2 + c3 * q3)
    return by_y * per, -by_x * per


@numba.njit(**FAST)
def rk4(c, start, t, steps):
    """Return the ends of tracers (P, 2)."""
    ends, h = np.empty_like(start), t / steps
    for p in range(start.shape[0]):
        x, y = start[p, 0], start[p, 1]
        for _ in range(steps):
            u1, v1 = velocity(c, x, y)
            u2, v2 = velocity(c, x + h / 2 * u1, y + h / 2 * v1)
            u3, v3 = velocity(c, x + h / 2 * u2, y + h / 2 * v2)
            u4, v4 = velocity(c, x + h * u3, y + h * v3)
            x += h / 6 * (u1 + 2 * (u2 + u3) + u4)
            y += h / 6 * (v1 + 2 * (v2 + v3) + v4)
        ends[p, 0], ends[p, 1] = x, y
    return ends
