r"""Normal forces and friction in space, whose bound is a circle.

Unknown are N and T of contacts that act on one another, with :math:`w = K (N, T) + q` the
accelerations of gaps and slips, and :math:`R = \mu (N + N_0)`:

.. math::

    w_n \ge 0, \quad N \ge 0, \quad N w_n = 0, \qquad
    |T| \le R, \quad T = -R\, w_t / |w_t| \ (w_t \ne 0) .

Sweeps over the contacts, which project T onto its circle, find what each contact does, and Newton's
method the forces: of what slides :math:`w_t \times T = 0` and :math:`|T|^2 = R^2`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from liouville._runs.contacts.complementarity import SOLVED, Array

if TYPE_CHECKING:
    from liouville._runs.contacts.law import _Group

#: The largest number of sweeps; behind 8, 16, 32 ... of them Newton's method is tried.
MOST_SWEEPS, FIRST_TRY = 4096, 8
#: Its steps, which end where they change nothing but by this part.
MOST_STEPS, SETTLED = 20, 1e-15
#: Equations are dependent where a singular value is below this part of the largest.
DEPENDENT = 1e-13


def cones(group: _Group) -> tuple[Array, Array] | None:
    """Return N and T of a group of contacts; None where none are found."""
    rows = np.concatenate(group.rows)
    problem = _Problem(np.hstack([group.normals, group.tangents])[rows], group.b[rows], group)
    # a contact that a load presses has no gap, and N is none but the load
    if not (np.diag(problem.K)[[*problem.gaps, *range(problem.p, len(rows))]] > 0).all():
        return None
    x, next_try = np.zeros(len(rows)), FIRST_TRY
    for count in range(1, MOST_SWEEPS + 1):
        problem.sweep(x)
        if count == next_try:
            next_try *= 2
            found = problem.polished(x)
            if found is not None:
                return found[: problem.p], found[problem.p :]
    return None


class _Problem:
    """The problem of a group; x is N and then T."""

    def __init__(self, K: Array, q: Array, group: _Group) -> None:
        self.K, self.q, self.p = K, q, len(group.i)
        self.gaps = np.flatnonzero(K[: self.p].any(axis=1))
        #: Places in x of the friction of each contact, its coefficient and what it bears.
        self.slips = [self.p + np.flatnonzero(group.j == i) for i in range(self.p)]
        self.mu, self.borne = np.zeros(self.p), np.zeros(self.p)
        self.mu[group.j], self.borne[group.j] = group.mu, group.borne
        #: Friction moves at most so much by a unit of it.
        self.stiff = [
            float(np.linalg.eigvalsh((K + K.T)[np.ix_(own, own)] / 2)[-1]) if own.size else 1.0
            for own in self.slips
        ]

    def bounds(self, x: Array) -> Array:
        """Return the largest friction of each contact."""
        found: Array = self.mu * (x[: self.p] + self.borne)
        return found

    def _wanted(self, x: Array, i: int) -> tuple[Array, float]:
        """Return the friction that would stop a slip, as far as it itself does, and its size."""
        own = self.slips[i]
        T = x[own] - (self.K[own] @ x + self.q[own]) / self.stiff[i]
        return T, float(np.linalg.norm(T))

    def sweep(self, x: Array) -> None:
        """Improve x contact by contact."""
        for i in range(self.p):
            if i in self.gaps:
                x[i] = max(x[i] - (self.K[i] @ x + self.q[i]) / self.K[i, i], 0.0)
            T, size = self._wanted(x, i)
            most = self.mu[i] * (x[i] + self.borne[i])
            x[self.slips[i]] = T * (most / size) if size > most else T

    def polished(self, x: Array) -> Array | None:
        """Return the solution that Newton's method finds near x; None if it is none."""
        p, most = self.p, self.bounds(x)
        presses = x[:p] > 0
        slides = [
            bool(own.size) and self._wanted(x, i)[1] > most[i] for i, own in enumerate(self.slips)
        ]
        keeps = np.ones(len(x), dtype=bool)
        keeps[:p] = presses
        for i, own in enumerate(self.slips):
            keeps[own] = most[i] > 0
        x, kept = np.where(keeps, x, 0.0), np.flatnonzero(keeps)
        for _ in range(MOST_STEPS):
            rest, slopes = self.K @ x + self.q, self.K.copy()
            for i in np.flatnonzero(slides).tolist():
                self._slide(x, i, rest, slopes)
            # contacts that share a load have many solutions, and one is enough for what moves
            step = np.linalg.lstsq(slopes[np.ix_(kept, kept)], rest[kept], rcond=DEPENDENT)[0]
            x[kept] -= step
            if not np.isfinite(x).all():
                return None
            if np.abs(step).max(initial=0.0) <= SETTLED * np.abs(x).max(initial=0.0):
                break
        return x if self._is_solved(x) else None

    def _slide(self, x: Array, i: int, rest: Array, slopes: Array) -> None:
        """Replace the equations of what sticks by those of what slides."""
        own, most = self.slips[i], self.mu[i] * (x[i] + self.borne[i])
        T, w, K = x[own], rest[own], self.K[own].copy()
        size = float(np.linalg.norm(T)) or 1.0
        slopes[own] = 0.0
        if len(own) == 1:
            rest[own], slopes[own, own] = T - np.sign(T) * most, 1.0
            slopes[own, i] = -np.sign(T) * self.mu[i]
            return
        first, second = own
        rest[first] = (w[0] * T[1] - w[1] * T[0]) / size
        slopes[first] = (K[0] * T[1] - K[1] * T[0]) / size
        slopes[first, second] += w[0] / size
        slopes[first, first] -= w[1] / size
        rest[second] = (T @ T - most**2) / (2 * size)
        slopes[second, own] = T / size
        slopes[second, i] -= self.mu[i] * most / size

    def _is_solved(self, x: Array) -> bool:
        """Whether the laws hold."""
        p, w, most = self.p, self.K @ x + self.q, self.bounds(x)
        small = SOLVED * (np.abs(self.K) @ np.abs(x) + np.abs(self.q)).max()
        weak = SOLVED * np.abs(x).max()
        off = [-float(w[:p].min()), *np.abs(w[:p][x[:p] > weak])]
        for i, own in enumerate(self.slips):
            if not own.size:
                continue
            T, rate = x[own], w[own]
            size, speed = float(np.linalg.norm(T)), float(np.linalg.norm(rate))
            if size > most[i] + weak:
                return False
            # a contact whose friction is within its bound does not move; else it moves against it
            off.append(speed if size < most[i] - weak else speed * size + float(T @ rate))
        return bool(x[:p].min() >= -weak and max(off) <= small)
