r"""Rigid bodies by the position of their centre and three orthonormal directors: a constant mass.

Body k has the twelve coordinates x, a, b, c in this order, with the directors a, b and c along its
principal axes. With :math:`J_a = \int s_a^2 dm` and so on its kinetic energy is

.. math:: T = \tfrac12 (m |\dot x|^2 + J_a |\dot a|^2 + J_b |\dot b|^2 + J_c |\dot c|^2) .
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

#: The places of the centre and of the directors among the coordinates of a body.
PARTS = "xabc"
SIZE = 12

Frame = tuple[ca.SX, ca.SX, ca.SX, ca.SX]


def coordinates(bodies: int) -> tuple[str, ...]:
    """Name the coordinates: x1x, x1y, x1z, a1x, ..., c1z, x2x, ...."""
    return tuple(
        f"{part}{k}{axis}" for k in range(1, bodies + 1) for part in PARTS for axis in "xyz"
    )


def frames(q: ca.SX) -> list[Frame]:
    """Return x, a, b and c of each body."""
    parts = [q[k : k + 3] for k in range(0, q.numel(), 3)]
    return [(parts[k], parts[k + 1], parts[k + 2], parts[k + 3]) for k in range(0, len(parts), 4)]


def kinetic(v: ca.SX, bodies: Sequence[tuple[float, float, float]]) -> ca.SX:
    """Return the kinetic energy of rods by mass, length and radius, whose axes are a."""
    energy = ca.SX(0)
    for (x, a, b, c), (mass, length, radius) in zip(frames(v), bodies, strict=True):
        along, across = length**2 / 12, radius**2 / 4
        energy += mass * (ca.sumsqr(x) + along * ca.sumsqr(a)) / 2
        energy += mass * across * (ca.sumsqr(b) + ca.sumsqr(c)) / 2
    return energy


def rigid(q: ca.SX) -> dict[str, ca.SX]:
    """Keep the directors orthonormal: six constraints for each body."""
    found = {}
    for k, (_, *directors) in enumerate(frames(q), start=1):
        for i, first in enumerate(PARTS[1:]):
            for j, second in enumerate(PARTS[1:]):
                if i <= j:
                    wanted = ca.dot(directors[i], directors[j]) - (i == j)
                    found[f"{first}{second}{k}"] = wanted / 2 if i == j else wanted
    return found


def hinge(
    name: str, points: tuple[ca.SX, ca.SX], axis: ca.SX, across: tuple[ca.SX, ca.SX]
) -> dict[str, ca.SX]:
    """Join two points, and keep the axis of one body normal to two directors of the other."""
    apart = points[0] - points[1]
    place = {f"{name}_{xyz}": apart[k] for k, xyz in enumerate("xyz")}
    return place | {f"{name}_{k}": ca.dot(axis, across[k]) for k in range(2)}


def row(*vectors: Sequence[float]) -> tuple[float, ...]:
    """Return vectors as one tuple of coordinates."""
    return tuple(float(x) for vector in vectors for x in vector)


def ends(q: NDArray[np.float64], body: int, length: float) -> NDArray[np.float64]:
    """Return the two ends of a rod, shape (2, 3)."""
    x, a = q[SIZE * body : SIZE * body + 3], q[SIZE * body + 3 : SIZE * body + 6]
    return np.array([x - length / 2 * a, x + length / 2 * a])
