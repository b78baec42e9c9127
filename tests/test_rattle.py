"""RATTLE's fast path: against a textbook's, against the general pair, and by what it promises."""

import casadi as ca
import numpy as np
import pytest
from plain_rattle import System, bonds, run

import liouville as lv

RATTLE = lv.LobattoPair(2)


def linked(pairs, masses, size, spring=0.0, lengths=None, **more):
    """Return points on rods under gravity, with springs between those no rod joins, twice told."""
    n, count = size * len(masses), len(masses)
    lengths = np.ones(len(pairs)) if lengths is None else np.asarray(lengths)
    weights = np.repeat(masses, size)
    free = [(i, j) for i in range(count) for j in range(i) if not {(i, j), (j, i)} & set(pairs)]

    def point(q, i):
        return q[size * i : size * (i + 1)] if i >= 0 else ca.DM.zeros(size)

    def lagrangian(t, q, v, params):
        gravity = sum(m * q[size * i + size - 1] for i, m in enumerate(masses))
        bent = sum(ca.sumsqr(point(q, i) - point(q, j)) ** 2 for i, j in free)
        return ca.dot(ca.DM(weights), v**2) / 2 - gravity - spring * bent / 4

    def constraint(t, q, params):
        arms = [ca.sumsqr(point(q, j) - point(q, i)) for i, j in pairs]
        return [(arm - length**2) / 2 for arm, length in zip(arms, lengths, strict=True)]

    def force(t, q):
        r = q.reshape(-1, size)
        f = np.zeros_like(r)
        f[:, -1] = -np.asarray(masses)
        for i, j in free:
            apart = r[i] - r[j]
            pull = spring * (apart @ apart) * apart
            f[i] -= pull
            f[j] += pull
        return f.ravel()

    g, g_q = bonds(pairs, lengths, size)
    plain = System(np.diag(weights), force, g, g_q)
    return lv.Lagrangian(lagrangian, constraint, q=n), plain


def spherical_pendulum():
    system, plain = linked([(-1, 0)], [1.3], 3)
    return system, plain, {"q": [0.6, 0.0, -0.8], "v": [0.0, 1.25, 0.0]}


def double_pendulum():
    system, plain = linked([(-1, 0), (0, 1)], [1.0, 0.7], 2)
    return system, plain, {"q": [0.6, -0.8, 1.6, -0.8], "v": [0.8, 0.6, 0.8, 1.3]}


def molecule(pairs, count, seed):
    """Return a molecule that falls, with springs between its points."""
    rng = np.random.default_rng(seed)
    q = np.cumsum(rng.normal(size=(count, 3)), axis=0)
    lengths = [np.linalg.norm(q[j] - q[i]) for i, j in pairs]
    system, plain = linked(pairs, rng.uniform(1, 2, count), 3, 0.02, lengths)
    start = system.consistent(q=q.ravel(), v=rng.normal(size=3 * count), hold="q")
    return system, plain, start


def ring():
    return molecule([(i, (i + 1) % 6) for i in range(6)], 6, 1)


def tree():
    return molecule([(0, 1), (1, 2), (1, 3), (3, 4), (3, 5), (5, 6)], 7, 2)


def moved():
    """Return a pendulum of full mass whose pivot swings and rod breathes, pushed in time."""
    mass = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 1.5]])

    def constraint(t, q, params):
        arm = q - ca.vertcat(ca.sin(2 * t) / 5, 0, 0)
        return (ca.sumsqr(arm) - (1 + ca.cos(3 * t) / 10) ** 2) / 2

    def lagrangian(t, q, v, params):
        return ca.bilin(ca.DM(mass), v, v) / 2 - q[2] - q[1] ** 4 / 4 + ca.sin(t) * q[0]

    def arm(t, q):
        return q - np.array([np.sin(2 * t) / 5, 0, 0])

    def rate(t, q):
        length = 1 + np.cos(3 * t) / 10
        across = arm(t, q)[0] * np.cos(2 * t) * 2 / 5
        return np.array([-across + length * np.sin(3 * t) * 3 / 10])

    plain = System(
        mass,
        lambda t, q: np.array([np.sin(t), -(q[1] ** 3), -1.0]),
        lambda t, q: np.array([arm(t, q) @ arm(t, q) - (1 + np.cos(3 * t) / 10) ** 2]) / 2,
        lambda t, q: arm(t, q)[np.newaxis],
        rate,
    )
    system = lv.Lagrangian(lagrangian, constraint, q=3)
    return system, plain, system.consistent(q=[0.6, 0.2, -0.9], v=[0.1, 0.4, 0.0])


CASES = {f.__name__: f for f in (spherical_pendulum, double_pendulum, ring, tree, moved)}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    return CASES[request.param]()


def steps(system, start, h, count, method=RATTLE, t0=0.0, **options):
    return lv.integrate(system, method, t=(t0, t0 + count * h), steps=count, **start, **options)


def test_it_is_the_textbook_rattle(case):
    system, plain, start = case
    solution = steps(system, start, 0.01, 40)
    q, v = run(plain, (start["q"], start["v"]), 0.01, 40)
    assert solution.stats["solver"] == "rattle"
    assert abs(solution.q - q).max() < 2e-13
    assert abs(solution.v - v).max() < 2e-12


@pytest.mark.parametrize("wrap", [lambda method: method, lambda m: lv.Composition(m, "Y4")])
def test_it_is_the_general_pair(case, wrap):
    system, _, start = case
    fast, general = (
        steps(system, start, 0.02, 100, wrap(lv.LobattoPair(2, solver=solver)))
        for solver in ("auto", "newton")
    )
    assert (fast.stats["solver"], general.stats["solver"]) == ("rattle", "newton")
    for name in ("q", "v", "lam"):
        np.testing.assert_allclose(fast.states[name], general.states[name], rtol=0, atol=3e-12)


def test_one_force_and_two_factors_a_step():
    system, _, start = double_pendulum()
    stats = steps(system, start, 0.01, 200).stats
    assert stats["evaluations"] == 201
    assert stats["factorizations"] == 400
    assert stats["iterations"] < 3.2 * 200


def test_constraints_hold(case):
    system, _, start = case
    residuals = steps(system, start, 0.02, 200).residuals
    size = abs(np.asarray(start["q"])).max() ** 2
    assert abs(residuals["constraint"]).max() < 2e-15 * max(1, size)
    assert abs(residuals["hidden"]).max() < 2e-14 * max(1, size)


def test_a_step_back_undoes_a_step(case):
    system, _, start = case
    there = steps(system, start, 0.05, 20)
    back = steps(system, {"q": there.q[-1], "v": there.v[-1]}, -0.05, 20, t0=1.0)
    assert abs(back.q[-1] - start["q"]).max() < 1e-12
    assert abs(back.v[-1] - start["v"]).max() < 1e-12


def test_it_is_symplectic():
    """The area of two tangents stays, by central differences along the constraints."""
    system, _, start = double_pendulum()
    q, v = np.asarray(start["q"]), np.asarray(start["v"])
    rng, eps = np.random.default_rng(3), 1e-5

    def end(change):
        near = system.consistent(q=q + change[:4], v=v + change[4:])
        solution = steps(system, near, 0.1, 5)
        both = [np.concatenate([x.q[k], x.p[k]]) for x, k in ((solution, 0), (solution, -1))]
        return np.array(both)

    tangents = [(end(eps * d) - end(-eps * d)) / (2 * eps) for d in rng.normal(size=(2, 8))]

    def area(k):
        (q1, p1), (q2, p2) = (np.split(x[k], 2) for x in tangents)
        return q1 @ p2 - p1 @ q2

    assert abs(area(1) / area(0) - 1) < 1e-8


def test_the_energy_does_not_drift():
    system, _, start = spherical_pendulum()
    solution = steps(system, start, 0.01, 400_000, every=97, states=False)
    error = solution.invariants["energy"] - solution.invariants["energy"][0]
    slope = np.polyfit(solution.t, error, 1)[0]
    assert abs(error).max() < 3e-5
    assert abs(slope) < 1e-11


def falling(force=None, constraint=None):
    """Return a point in space that moves along x with speed 1."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        constraint,
        q=("x", "y", "z"),
        force=force,
    )
    return system, {"q": [0, 0, 0], "v": [1, 0, 0]}


def rails(t, q, params):
    """Two planes along x that coincide at x = 1."""
    return {"floor": q[2], "ramp": q[2] + (1 - q[0]) * q[1]}


FAILURES = [
    (
        falling(lambda t, q, v, params: [0, ca.sqrt(1 - t), 0]),
        1 / 64,
        64,
        "force of coordinate 'y'",
    ),
    (falling(None, rails), 1 / 64, 63, "constraints 'floor' and 'ramp' are redundant"),
    (
        spherical_pendulum()[::2],
        3.0,
        0,
        r"the step is too large for coordinate .\w+.: its equations have a solution connected "
        r"with the present state only up to h = \S+\nhint: take h below \S+, and well",
    ),
]


@pytest.mark.parametrize(("given", "h", "done", "message"), FAILURES)
def test_failures_name_what_failed(given, h, done, message):
    system, start = given
    with pytest.raises(lv.IntegrationError, match=message) as caught:
        steps(system, start, h, 100)
    solution = caught.value.solution
    assert solution.stats["steps"] == done
    assert np.isfinite(solution.q).all()


@pytest.mark.parametrize(
    ("system", "start"),
    [
        (falling(lambda t, q, v, params: -v)[0], {"q": [0, 0, 0], "v": [1, 0, 0]}),
        (
            lv.Lagrangian(lambda t, q, v, params: (1 + q[0] ** 2) * v[0] ** 2 / 2, q=1),
            {"q": [0.0], "v": [1.0]},
        ),
        (
            lv.Lagrangian(lambda t, q, v, params: (2 + ca.sin(t)) * v[0] ** 2 / 2, q=1),
            {"q": [0.0], "v": [1.0]},
        ),
    ],
    ids=["damped", "mass of q", "mass of t"],
)
def test_what_is_not_separable_goes_the_general_way(system, start):
    assert system.separable is None
    assert steps(system, start, 0.01, 3).stats["solver"] != "rattle"
