"""Normal forces of joints with friction, from where a mechanism is and how it moves.

They are those of :mod:`~liouville.bodies.friction`: of a single slip the root of a quadratic
equation; of several such roots one after another in turn, and then Newton's method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from liouville._basics import casadi as ca
from liouville._systems.tracing.sparse import jacobian, solve
from liouville.bodies.friction import Rubbing

#: Normal forces of several slips are found in turn, this many times, then by so many corrections
#: of Newton's method; they are found where these leave no more than this part of them.
TURNS, CORRECTIONS, FOUND = 4, 6, 1e-9
#: Those of numbers are found by so many corrections at most, down to this part of them.
MOST, LAST = 50, 1e-13

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rubs:
    """Numbers that determine normal forces at one state.

    Attributes
    ----------
    force : ndarray, shape (n,)
        The force f - p_t - p_q v of all but friction.
    rate : ndarray, shape (m,)
        The rates of constraints without accelerations.
    pushes : ndarray, shape (J, n)
        The generalised force of each of J slips for a normal force of one.
    presses : list of ndarray, shape (j, m)
        What multipliers press each contact with.
    least : ndarray, shape (J,)
        The square of what normal forces are rounded off below.
    """

    force: Array
    rate: Array
    pushes: Array
    presses: list[Array]
    least: Array

    def normal_forces(self, lam: Array) -> Array:
        """Return the normal forces N under multipliers ``lam[:, 0] + lam[:, 1:] @ N``.

        They are found by Newton's method, and nan where friction jams.
        """
        ways = [press @ lam for press in self.presses]
        found = self._sizes([own[:, 0] for own in ways])
        for _ in range(MOST):
            all_of = [own[:, 0] + own[:, 1:] @ found for own in ways]
            sizes = self._sizes(all_of)
            slopes = [x @ own[:, 1:] / y for x, own, y in zip(all_of, ways, sizes, strict=True)]
            matrix = np.eye(len(found)) - slopes
            minors = [np.linalg.det(matrix[:k, :k]) for k in range(1, len(found) + 1)]
            if not np.all(np.isfinite(minors)) or minors[-1] == 0:
                break
            step = np.linalg.solve(matrix, sizes - found)
            found = found + step
            if np.abs(step).max() <= LAST * sizes.max():
                if min(minors) > 0 and found.min() > 0:  # else those of another branch
                    return found
                break
        return np.full(len(found), np.nan)

    def _sizes(self, pressing: Sequence[Array]) -> Array:
        squares = [own @ own + x for own, x in zip(pressing, self.least, strict=True)]
        return np.sqrt(squares)


def normal_forces(
    slips: Sequence[Rubbing],
    mass: ca.SX,
    force: ca.SX,
    slopes: ca.SX,
    gamma: ca.SX,
    v: ca.SX,
) -> tuple[list[ca.SX], list[ca.SX]]:
    r"""Return the normal forces of slips, of M a + G^T lam = F + friction and G a = -gamma.

    With S = G M^-1 G^T the multipliers are :math:`\lambda_0 + \sum_j N_j \Lambda_j`, where
    :math:`S \lambda_0 = G M^{-1} F + \gamma` and :math:`S \Lambda_j = G M^{-1} d_j`. What presses
    each contact, of which they are the sizes, comes second.
    """
    weighted = solve(mass, slopes.T)  # M^-1 G^T
    right = ca.mtimes(weighted.T, ca.horzcat(force, *pushes(slips, v)))
    right[:, 0] += gamma
    parts = ca.horzsplit(ca.ldl_solve(right, *ca.ldl(ca.mtimes(slopes, weighted))))
    # what presses contact i is pressed[i] + sum_j N_j more[i][j]
    pressed = [ca.mtimes(x.press, parts[0]) for x in slips]
    more = [[ca.mtimes(x.press, own) for own in parts[1:]] for x in slips]
    found = [ca.SX(0)] * len(slips)
    for _ in range(1 if len(slips) == 1 else TURNS):
        for k, x in enumerate(slips):
            others = [
                N * way for j, (N, way) in enumerate(zip(found, more[k], strict=True)) if j != k
            ]
            found[k] = _root(sum(others, pressed[k]), more[k][k], x.least)
    if len(slips) > 1:
        found = _corrected(found, slips, pressed, more)
    return found, _pressing(found, pressed, more)


def pushes(slips: Sequence[Rubbing], v: ca.SX) -> list[ca.SX]:
    """Return the generalised forces of slips for normal forces of one."""
    return [ca.jtimes(ca.vertcat(*x.rates), v, ca.vertcat(*x.forces.values()), True) for x in slips]


def _pressing(
    found: Sequence[ca.SX], pressed: Sequence[ca.SX], more: Sequence[Sequence[ca.SX]]
) -> list[ca.SX]:
    """Return the force that presses each contact under these normal forces."""
    return [
        sum((N * way for N, way in zip(found, ways, strict=True)), own)
        for own, ways in zip(pressed, more, strict=True)
    ]


def _root(pressed: ca.SX, more: ca.SX, least: ca.SX) -> ca.SX:
    """Return the N > 0 of N^2 = |pressed + N more|^2 + least, nan where friction can jam."""
    scale = ca.sqrt(1 - ca.dot(more, more))
    half = ca.dot(pressed, more) / scale
    found: ca.SX = (half + ca.sqrt(half**2 + ca.dot(pressed, pressed) + least)) / scale
    return found


def _corrected(
    found: list[ca.SX],
    slips: Sequence[Rubbing],
    pressed: Sequence[ca.SX],
    more: Sequence[Sequence[ca.SX]],
) -> list[ca.SX]:
    """Return normal forces by Newton's method, nan where it finds none: there friction jams."""

    def pressing() -> tuple[list[ca.SX], list[ca.SX]]:
        all_of = _pressing(found, pressed, more)
        sizes = [ca.sqrt(ca.dot(own, own) + x.least) for own, x in zip(all_of, slips, strict=True)]
        return all_of, sizes

    pivots: list[ca.SX] = []
    for _ in range(CORRECTIONS):
        all_of, sizes = pressing()
        matrix = [
            [float(i == j) - ca.dot(own, way) / size for j, way in enumerate(ways)]
            for i, (own, size, ways) in enumerate(zip(all_of, sizes, more, strict=True))
        ]
        off = [size - N for size, N in zip(sizes, found, strict=True)]
        steps, pivots = _eliminated(matrix, off)
        found = [N + step for N, step in zip(found, steps, strict=True)]
    _, sizes = pressing()
    left = sum((size - N) ** 2 for size, N in zip(sizes, found, strict=True))
    are_found = left <= FOUND**2 * sum(size**2 for size in sizes)
    for pivot in pivots:  # else these are forces of another branch
        are_found = ca.logic_and(are_found, pivot > 0)
    one = ca.sqrt(ca.if_else(are_found, 1, -1))
    return [N * one for N in found]


def _eliminated(matrix: list[list[ca.SX]], right: list[ca.SX]) -> tuple[list[ca.SX], list[ca.SX]]:
    """Solve linear equations by Gauss's elimination; returns the pivots too."""
    n, rows = len(right), [[*row, own] for row, own in zip(matrix, right, strict=True)]
    for k in range(n):
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [
                x - factor * y if j > k else x
                for j, (x, y) in enumerate(zip(rows[i], rows[k], strict=True))
            ]
    found: list[ca.SX] = [ca.SX(0)] * n
    for k in reversed(range(n)):
        known = sum(rows[k][j] * found[j] for j in range(k + 1, n))
        found[k] = (rows[k][n] - known) / rows[k][k]
    return found, [rows[k][k] for k in range(n)]


def multipliers(
    energy: ca.SX, force: ca.SX, g: ca.SX, k: ca.SX, at: tuple[ca.SX, ca.SX, ca.SX]
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return M, F, G and gamma of a Lagrangian, its forces and its constraints at (t, q, v)."""
    t, q, v = at

    def rate(x: ca.SX) -> ca.SX:
        return ca.jtimes(x, ca.vertcat(t, q), ca.vertcat(1, v))

    p = ca.gradient(energy, v)
    w = rate(g)
    slopes = ca.vertcat(jacobian(g, q), jacobian(k, v))
    return (
        jacobian(p, v),
        ca.gradient(energy, q) + force - rate(p),
        slopes,
        ca.vertcat(rate(w), rate(k)),
    )
