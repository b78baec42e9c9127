r"""A polymer of N beads on rigid bonds in space, held together by a weak trap.

Beads of mass m at r_1, ..., r_N, bonds b_i = r_{i+1} - r_i of length l:

.. math::

    L = \sum_{i=1}^{N} \left(\tfrac m2 |v_i|^2 - \tfrac a2 |r_i|^2\right)
        - \tfrac k2 \sum_{i=1}^{N-2} \left(\frac{b_i \cdot b_{i+1}}{l^2} - c\right)^2, \qquad
    0 = \frac{|b_i|^2 - l^2}{2 l}

Units are of mass a bead's, of length a bond's, of energy the thermal energy of the start, so that
m = l = 1. The angles between bonds have stiffness k = 20 and rest at the cosine c = 1/3, that of
saturated carbon; the trap has stiffness a = 0.02. Beads pass through each other.

The chain starts with its angles at rest, turned at random about its bonds, and with random
velocities of that temperature, less what would stretch bonds or move the centre of mass. Besides
the energy the angular momentum is constant.

The reference is for twenty beads: accelerations with the tensions of the bonds eliminated,
extrapolation in 45 digits, two tolerances 3e-29 apart (``tools/references.py``).
"""

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from liouville.problems import Parameters
from liouville.systems import Lagrangian

REST = 1 / 3  # cosine of the angle between bonds at rest


def build(beads: int) -> Lagrangian:
    """Make the system of a polymer.

    Parameters
    ----------
    beads : int
        Number of beads N, at least 2.

    Returns
    -------
    Lagrangian
        With coordinates x1, y1, z1, ..., zN and constraints bond1, ..., bond(N-1).
    """

    def lagrangian(t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
        bonds = bonds_of(q)
        cosines = ca.sum1(bonds[:, :-1] * bonds[:, 1:]) / params.l**2
        potential = params.k * ca.sumsqr(cosines - params.c) + params.a * ca.dot(q, q)
        return params.m / 2 * ca.dot(v, v) - potential / 2

    def constraint(t: ca.SX, q: ca.SX, params: Parameters) -> dict[str, ca.SX]:
        excess = (ca.sum1(bonds_of(q) ** 2) - params.l**2) / (2 * params.l)
        return {f"bond{i}": x for i, x in enumerate(ca.horzsplit(excess), start=1)}

    def bonds_of(q: ca.SX) -> ca.SX:
        places = ca.reshape(q, 3, beads)
        return places[:, 1:] - places[:, :-1]

    return Lagrangian(
        lagrangian,
        constraint,
        q=tuple(f"{axis}{i}" for i in range(1, beads + 1) for axis in "xyz"),
        params={"m": 1.0, "l": 1.0, "k": 20.0, "c": REST, "a": 0.02},
        invariants={f"spin_{axis}": partial(spin, k) for k, axis in enumerate("xyz")},
    )


def spin(k: int, t: ca.SX, q: ca.SX, v: ca.SX, params: Parameters) -> ca.SX:
    """Return a component of the angular momentum about the origin."""
    i, j = (k + 1) % 3, (k + 2) % 3
    return params.m * (ca.dot(q[i::3], v[j::3]) - ca.dot(q[j::3], v[i::3]))


def start_for(beads: int, seed: int = 1) -> dict[str, NDArray[np.float64]]:
    """Fold the chain at random and give it random velocities.

    Parameters
    ----------
    beads : int
        Number of beads N, at least 2.
    seed : int, default 1
        From 1 to 2147483646; another seed gives another start.

    Returns
    -------
    dict
        ``q`` and ``v``, each of shape (3 N,).
    """
    random = uniform(seed)
    bond, normal = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    bonds = [bond]
    for _ in range(beads - 2):
        turn = 2 * np.pi * next(random)
        across = np.cos(turn) * np.cross(normal, bond) + np.sin(turn) * normal
        after = REST * bond + np.sqrt(1 - REST**2) * across
        normal = np.cross(bond, after) / np.sqrt(1 - REST**2)
        bond = after / np.sqrt(after @ after)
        bonds.append(bond)
    q = np.cumsum([np.zeros(3), *bonds], axis=0)
    v = np.array([gauss(random) for _ in range(3 * beads)]).reshape(-1, 3)
    v -= v.mean(axis=0)
    pulls = np.diff(q, axis=0)
    along = (pulls * np.diff(v, axis=0)).sum(axis=1)
    impulses = pulls * tensions(pulls, along)[:, np.newaxis]
    v[:-1] += impulses
    v[1:] -= impulses
    return {"q": (q - q.mean(axis=0)).ravel(), "v": v.ravel()}


def tensions(bonds: NDArray[np.float64], rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve for impulses along bonds that take away these rates: 2 x_i - cos x_{i-1} - cos x_{i+1}.

    Bonds have length 1 and beads mass 1; the matrix is tridiagonal.
    """
    beside = [-float(one @ other) for one, other in pairwise(bonds)]
    pivots, x = [2.0], list(rates)
    for i, c in enumerate(beside):
        factor = c / pivots[i]
        pivots.append(2.0 - factor * c)
        x[i + 1] -= factor * x[i]
    x[-1] /= pivots[-1]
    for i in reversed(range(len(beside))):
        x[i] = (x[i] - beside[i] * x[i + 1]) / pivots[i]
    return np.array(x)


def uniform(seed: int) -> Iterator[float]:
    """Draw numbers between 0 and 1 by x <- 48271 x mod 2^31 - 1, the same on every machine."""
    while True:
        seed = 48271 * seed % (2**31 - 1)
        yield seed / (2**31 - 1)


def gauss(random: Iterator[float]) -> float:
    """Draw from the normal distribution (Box and Muller)."""
    radius = np.sqrt(-2 * np.log(next(random)))
    return float(radius * np.cos(2 * np.pi * next(random)))


system = build(20)
start = start_for(20)
interval = (0.0, 1.0)
h = 0.02
conserved = ("energy", "spin_x", "spin_y", "spin_z")
