"""Finished runs checked step by step with equations written down independently.

Random chains of springs and rods, soft and stiff. A step of a SPARK method is followed from h = 0
with a Newton matrix for each correction, to the solution on the branch of the state before; one in
a hundred may be another solution, next to a turn of the branch, but solves the equations. A step of
an alpha method is corrected once more by its full Newton matrix, which shows its residual.
"""

import casadi as ca
import numpy as np
import plain_alpha
import plain_spark
import pytest
from plain_spark import gauss, lobatto

import liouville as lv

EPS = np.finfo(float).eps

SPARK = [
    (lv.Spark(1), gauss(1)),
    (lv.Spark(2), gauss(2)),
    (lv.Spark(3), gauss(3)),
    (lv.Spark(2, solver="newton"), gauss(2)),
    (lv.LobattoPair(), lobatto(2)),
    (lv.LobattoPair(force="A"), lobatto(2, "A")),
]
ALPHA = [
    (lv.HHT(), plain_alpha.hht(-0.1)),
    (lv.HHT(-0.3), plain_alpha.hht(-0.3)),
    (lv.GeneralizedAlpha(0.8), plain_alpha.generalized(0.8)),
]


def chain(rng):
    """Return Lagrangian, constraint, start, size and stiffness of a random chain in the plane."""
    n = int(rng.integers(1, 4))
    stiff = 10 ** rng.uniform(0, 8, n)
    is_rod = rng.random(n) < 0.4
    angle = rng.uniform(-1, 1, n)
    # springs that store a few joules at most: more is nothing that a step could resolve
    length = 1 + np.where(is_rod, 0, rng.uniform(-1, 1, n) / np.sqrt(1 + stiff))
    along = np.stack([np.sin(angle), -np.cos(angle)], 1)
    q = np.cumsum(length[:, None] * along, 0)
    across = rng.uniform(-1, 1, n)[:, None] * along[:, ::-1] * [-1, 1]
    v = np.cumsum(across, 0)

    def links(x):
        points = [x[2 * i : 2 * i + 2] for i in range(n)]
        return [
            point - before for point, before in zip(points, [ca.DM([0, 0]), *points], strict=False)
        ]

    def lagrangian(t, q, v, params=None):
        total = ca.dot(v, v) / 2 - sum(q[2 * i + 1] for i in range(n))
        for link, k, rod in zip(links(q), stiff, is_rod, strict=True):
            if not rod:
                total -= k / 2 * (ca.sqrt(ca.dot(link, link)) - 1) ** 2
        return total

    def constraint(t, q, params=None):
        return [
            (ca.dot(link, link) - 1) / 2 for link, rod in zip(links(q), is_rod, strict=True) if rod
        ]

    return lagrangian, constraint if is_rod.any() else None, q.ravel(), v.ravel(), stiff.max()


def as_far_as_it_goes(system, method, **run):
    try:
        return lv.integrate(system, method, **run)
    except lv.IntegrationError as error:
        return error.solution


def run_of(rng, method, steps, plain):
    """Return a run of a random chain, its equations written again, its step, and their bound."""
    lagrangian, constraint, q, v, k = chain(rng)
    h = 10 ** rng.uniform(-3, -1.2)
    system = lv.Lagrangian(lagrangian, constraint, q=len(q))
    made = as_far_as_it_goes(system, method, t=(0, steps * h), steps=steps, q=q, v=v)
    own = plain.lagrangian(len(q), lagrangian, constraint)
    return made, own, h, 1e-11 + 100 * EPS * (1 + k * h**2)


def check_spark(rng, method, tableau, steps):
    """Return steps made, those off the branch, and the largest error in bounds of roundoff."""
    made, plain, h, bound = run_of(rng, method, steps, plain_spark.Plain)
    worst, off = 0.0, 0
    parts = h * 2.0 ** np.arange(-5, 1)
    for n in range(len(made.t) - 1):
        y, z, found = made.q[n], made.v[n], made.q[n + 1]
        *_, true = plain.branch(tableau, y, z, parts, parts=2)
        size = bound * (np.abs(y).max() + h * np.abs(z).max() + np.abs(found).max())
        error = np.abs(true - found).max() / size
        if not error <= 1:
            off += 1
            rest = plain.correction(tableau, y, z, h, found, made.v[n + 1])
            error = np.abs(rest).max() / size
        worst = max(worst, error)
    return len(made.t) - 1, off, worst


def check_alpha(rng, method, weights, steps):
    """Return the same, without a look at branches."""
    made, plain, h, bound = run_of(rng, method, steps, plain_alpha.Plain)
    worst = 0.0
    for n in range(len(made.t) - 1):
        start = plain.start(made.t[n], made.q[n], made.v[n], made.a[n])
        moved = plain.correction(start, h, weights, made.q[n + 1], made.v[n + 1], made.a[n + 1])
        sizes = (np.abs(x).max() for x in (start.y, h * start.z, made.q[n + 1]))
        worst = max(worst, np.abs(moved).max() / (bound * sum(sizes)))
    return len(made.t) - 1, 0, worst


def check_many(seeds, steps):
    done, off = 0, 0
    for seed in seeds:
        rng = np.random.default_rng([20, seed])
        methods, check = [(SPARK, check_spark), (ALPHA, check_alpha)][seed % 3 == 2]
        method, coefficients = methods[rng.integers(len(methods))]
        count, others, worst = check(rng, method, coefficients, steps)
        assert worst <= 1, (seed, method, worst)
        done, off = done + count, off + others
    assert off <= done / 100
    return done


def test_finished_steps_solve_their_equations():
    assert check_many(range(24), 5) >= 105


@pytest.mark.slow
def test_a_hundred_thousand_finished_steps_solve_their_equations():
    assert check_many(range(1000, 5000), 30) >= 100_000
