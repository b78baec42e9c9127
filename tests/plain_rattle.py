"""RATTLE written down as textbooks have it, in dense NumPy: the oracle of the fast path.

From (t, q, v) to t + h, with G = g_q and multipliers found by Newton's method without a guess
(Andersen 1983; Hairer, Lubich and Wanner 2006, VII.1.4):

    w  = v + h/2 M^-1 (f(t, q) - G(q)^T lam),     q1 = q + h w,     g(t + h, q1) = 0
    v1 = w + h/2 M^-1 (f(t + h, q1) - G(q1)^T mu),     g_t + G(q1) v1 = 0

No rounding errors are carried along, and nothing is kept from step to step.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Vector = np.ndarray


@dataclass(frozen=True)
class System:
    """M q'' = f(t, q) - g_q^T lam, 0 = g(t, q)."""

    mass: np.ndarray
    force: Callable[[float, Vector], Vector]
    constraint: Callable[[float, Vector], Vector]
    gradient: Callable[[float, Vector], np.ndarray]
    drift: Callable[[float, Vector], Vector] = lambda t, q: np.zeros(1)


def step(system: System, t: float, q: Vector, v: Vector, h: float) -> tuple[Vector, Vector]:
    """Make one step."""
    inverse = np.linalg.inv(system.mass)
    before = system.gradient(t, q)
    free = v + h / 2 * inverse @ system.force(t, q)
    lam, pull = np.zeros(len(before)), inverse @ before.T
    for _ in range(50):
        w = free - h / 2 * pull @ lam
        moved = q + h * w
        matrix = h**2 / 2 * system.gradient(t + h, moved) @ pull
        change = np.linalg.solve(matrix, system.constraint(t + h, moved))
        lam = lam + change
        if np.abs(change).max() <= 1e-15 * np.abs(lam).max():
            break
    w = free - h / 2 * pull @ lam
    moved = q + h * w
    after = system.gradient(t + h, moved)
    free = w + h / 2 * inverse @ system.force(t + h, moved)
    rate = system.drift(t + h, moved) + after @ free
    impulse = np.linalg.solve(after @ inverse @ after.T, rate)
    return moved, free - inverse @ after.T @ impulse


def run(
    system: System, start: tuple[Vector, Vector], h: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return q and v after each step, the start first: shapes (steps + 1, n)."""
    q, v = (np.asarray(x, dtype=float) for x in start)
    path = [(q, v)]
    for k in range(steps):
        q, v = step(system, k * h, q, v, h)
        path.append((q, v))
    return np.array([q for q, _ in path]), np.array([v for _, v in path])


def bonds(pairs: list[tuple[int, int]], lengths: Vector, size: int) -> tuple[Callable, Callable]:
    """Return g and g_q of rods |r_j - r_i|^2 = l^2 in `size` dimensions; -1 is the origin."""

    def ends(q: Vector) -> list[tuple[Vector, Vector]]:
        r = np.vstack([q.reshape(-1, size), np.zeros(size)])
        return [(r[i], r[j]) for i, j in pairs]

    def constraint(t: float, q: Vector) -> Vector:
        arms = np.array([b - a for a, b in ends(q)])
        return ((arms**2).sum(axis=1) - np.asarray(lengths) ** 2) / 2

    def gradient(t: float, q: Vector) -> np.ndarray:
        rows = np.zeros((len(pairs), len(q) // size + 1, size))
        for row, (i, j), (a, b) in zip(rows, pairs, ends(q), strict=True):
            row[j] += b - a
            row[i] -= b - a
        return rows[:, :-1].reshape(len(pairs), -1)

    return constraint, gradient
