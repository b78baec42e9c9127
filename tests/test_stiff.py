"""Steps that are large for their forces: solved on the branch that begins at the present state.

The reference is a textbook Newton's method in numpy, with a matrix for each correction, from the
still start; for any stiffness it converges to that branch.
"""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville import _core

SPRING = lv.Lagrangian(
    lambda t, q, v, p: ca.dot(v, v) / 2 - q[1] - p.k / 2 * (ca.sqrt(ca.dot(q, q)) - 1) ** 2,
    q=2,
    params={"k": 1.0},
)
DOWN = np.array([0.0, -1.0])


def force(k, q):
    r = np.hypot(*q)
    return DOWN - k * (r - 1) * q / r


def stiffness(k, q):
    r = np.hypot(*q)
    u = np.outer(q, q) / r**2
    return -k * (u + (1 - 1 / r) * (np.eye(2) - u))


def newton(residual, x):
    """Newton's method with a matrix for each correction, until corrections are roundoff."""
    for _ in range(60):
        value, matrix = residual(x)
        d = np.linalg.solve(matrix, -value)
        x = x + d
        if np.abs(d).max() <= 1e-13 * np.abs(x).max():
            break
    return x


def by_stages(a_v, a_f, b, k, q, h):
    """One step from rest by the coefficients of a SPARK method: the position."""
    s, e = len(b), np.eye(2)

    def residual(v):
        v = v.reshape(s, 2)
        y = q + h * a_v @ v
        f = np.array([force(k, y) for y in y])
        jac = [stiffness(k, y) for y in y]
        blocks = [
            [
                (i == j) * e - h**2 * sum(a_f[i, m] * a_v[m, j] * jac[m] for m in range(s))
                for j in range(s)
            ]
            for i in range(s)
        ]
        return (v - h * a_f @ f).ravel(), np.block(blocks)

    return q + h * b @ newton(residual, np.zeros(2 * s)).reshape(s, 2)


def by_alpha(weights, k, q, h):
    """One step from rest of a alpha method: the position."""
    m, f, _, beta = weights
    start = force(k, q)

    def end(a):
        return q + h**2 * ((0.5 - beta) * start + beta * a)

    def residual(a):
        y = end(a)
        value = (1 - m) * a + m * start - (1 - f) * force(k, y) - f * start
        return value, (1 - m) * np.eye(2) - (1 - f) * beta * h**2 * stiffness(k, y)

    # the acceleration whose position is that of the still start
    return end(newton(residual, -(0.5 - beta) / beta * start))


def spark(s, points="gauss"):
    at = _core.spark_tableau(s, points)
    return lambda k, q, h: by_stages(at["a_v"], at["a_f"], at["b"], k, q, h)


def hht(alpha):
    return lambda *of: by_alpha((0, -alpha, 0.5 - alpha, (1 - alpha) ** 2 / 4), *of)


def generalized(rho):
    m, f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    return lambda *of: by_alpha((m, f, 0.5 - m + f, (1 - m + f) ** 2 / 4), *of)


METHODS = [
    (lv.Spark(1), spark(1)),
    (lv.Spark(2), spark(2)),
    (lv.Spark(3), spark(3)),
    (lv.Spark(2, points="radau"), spark(2, "radau")),
    (lv.HHT(), hht(-0.1)),
    (lv.HHT(-0.3), hht(-0.3)),
    (lv.GeneralizedAlpha(0.8), generalized(0.8)),
]
GRID = [
    (10.0**k, 10.0**stretch, h)
    for k in range(2, 13)
    for stretch in range(-6, 0)
    for h in (0.01, 0.02, 0.05, 0.1)
]


@pytest.mark.parametrize(
    "cells", [slice(None, None, 5), pytest.param(slice(None), marks=pytest.mark.slow)], ids=str
)
@pytest.mark.parametrize(("method", "textbook"), METHODS, ids=lambda x: repr(x)[:28])
def test_a_stretched_stiff_spring_stays_on_its_side(method, textbook, cells):
    refused = 0
    for k, stretch, h in GRID[cells]:
        q = np.array([1 + stretch, 0.0])
        run = {"t": (0, h), "steps": 1, "q": q, "v": [0, 0], "params": {"k": k}}
        try:
            found = lv.integrate(SPRING, method, **run).q[-1]
        except lv.IntegrationError:
            refused += 1
            continue
        # what roundoff in the tension moves; another branch is further away than the amplitude
        noise = 1e-7 + 4 * np.finfo(float).eps * k * h**2
        assert np.abs(found - textbook(k, q, h)).max() <= noise, (k, stretch, h)
    assert refused <= 0.02 * len(GRID[cells])


def test_members_in_lock_step_have_the_same_verdicts():
    k = 10.0 ** np.arange(2, 13)
    run = {"t": (0, 0.2), "h": 0.05, "q": [1.01, 0], "v": [0, 0]}
    for method in (lv.Spark(1), lv.Spark(2)):
        together = lv.ensemble(SPRING, method, params={"k": k}, **run)
        for member, stiff in enumerate(k):
            alone = lv.integrate(SPRING, method, params={"k": stiff}, **run)
            assert np.array_equal(together.q[:, member], alone.q)


SWING = lv.Lagrangian(
    lambda t, q, v, p: ca.dot(v, v) / 2 - p.k / 2 * (ca.sqrt(ca.dot(q, q)) - 1) ** 2 - 9.81 * q[2],
    q=3,
    params={"k": 1.0},
)


@pytest.mark.parametrize(
    ("method", "k", "h"),
    [
        (lv.HHT(), 1e8, 0.01),
        (lv.HHT(-0.3), 1e7, 0.02),
        (lv.GeneralizedAlpha(0.0), 1e8, 0.01),
        (lv.Spark(1), 1e8, 0.01),
        (lv.Spark(1, solver="newton"), 1e8, 0.01),
        (lv.Spark(2), 1e9, 0.01),
    ],
)
def test_stiff_springs_turn_far_in_a_step(method, k, h):
    """A bar of this stiffness swings as a rigid pendulum does, up to its elongation."""
    run = lv.integrate(
        SWING, method, t=(0, 1), h=h, q=[0.6, 0, -0.8], v=[0, 1.25, 0], params={"k": k}
    )
    lengths = np.linalg.norm(run.q, axis=1)
    assert np.abs(lengths - 1).max() <= 40 / k + 1e-3 * (h / 0.01) ** 2 * isinstance(
        method, lv.Spark
    )


def half(d, r=1):
    return (ca.dot(d, d) - r**2) / 2


def mechanism(bars, inertia):
    """Return a row of equal rods on the ground, joined by bars: points with mass, or rods."""

    def lagrangian(t, q, v, p):
        if not inertia:
            return ca.dot(v, v) / 2

        def r(x, i):
            return x[2 * i : 2 * i + 2]

        total = sum(ca.dot(r(v, i), r(v, i)) / 6 - 9.81 * q[2 * i + 1] / 2 for i in range(bars + 1))
        for i in range(bars):
            a, b = r(v, i), r(v, i + 1)
            total += (ca.dot(a, a) + ca.dot(a, b) + ca.dot(b, b)) / 6
            total -= 9.81 * (q[2 * i + 1] + q[2 * i + 3]) / 2
        return total

    def constraint(t, q, p):
        rods = {f"rod{i}": half(q[2 * i : 2 * i + 2] - ca.DM([i, 0])) for i in range(bars + 1)}
        links = {
            f"bar{i}": half(q[2 * i + 2 : 2 * i + 4] - q[2 * i : 2 * i + 2]) for i in range(bars)
        }
        return rods | links

    return lv.Lagrangian(lagrangian, constraint, q=2 * bars + 2)


MECHANISMS = {"parallelogram": mechanism(1, inertia=False), "four-bar": mechanism(2, inertia=True)}
FAMILY = [
    *(lv.Spark(s) for s in (1, 2, 3, 4, 6)),
    lv.Spark(3, solver="newton"),
    lv.Spark(2, points="radau"),
    lv.LobattoPair(),
    lv.LobattoPair(3),
    lv.HHT(),
    lv.GeneralizedAlpha(0.8),
    lv.GeneralizedAlpha(0.5, less_implicit=True),
    lv.ArnoldBruls(0.8),
]
SIZES = np.geomspace(0.06, 0.0002, 24)


def check_flat_position(name, method, h, place):
    """Turn all rods together through their flat position, reached after `place` of nine steps."""
    system, w = MECHANISMS[name], 1.0 if name == "parallelogram" else 4.0
    angle = np.pi / 2 - place * h * w
    count = len(system.coordinates) // 2
    along, across = [np.sin(angle), np.cos(angle)], [np.cos(angle), -np.sin(angle)]
    q = np.array([[i, 0] for i in range(count)]) + along
    start = {"q": q.ravel(), "v": w * np.tile(across, count)}
    run = lv.integrate(system, method, t=(0, 9 * h), steps=9, **start)
    arms = run.q.reshape(-1, count, 2) - np.array([[i, 0] for i in range(count)])
    # the other motion through the flat position would part them by as much as they turn
    apart = np.abs(arms - arms[:, :1]).max()
    assert apart <= 0.05 * h * w, (name, method, h, place, apart)
    assert np.abs(run.residuals["constraint"]).max() <= 1e-8
    assert arms[0, 0, 1] > 0 > arms[-1, 0, 1]


@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("method", FAMILY, ids=lambda x: repr(x)[:28])
def test_mechanisms_pass_their_flat_positions(name, method):
    for h in SIZES[::6]:
        check_flat_position(name, method, h, 4.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("method", FAMILY, ids=lambda x: repr(x)[:28])
def test_mechanisms_pass_their_flat_positions_from_many_places(name, method):
    for h in SIZES:
        for place in 4 + np.random.default_rng(3).random(8):
            check_flat_position(name, method, h, place)


@pytest.mark.parametrize(
    ("method", "h"),
    [
        (lv.LobattoPair(), 0.01),
        (lv.LobattoPair(), 0.002),
        (lv.Spark(4), 0.016),
        (lv.Spark(4), 0.0021),
        (lv.Spark(2), 0.003),
        (lv.HHT(), 0.005),
    ],
    ids=repr,
)
def test_a_four_bar_keeps_its_energy_through_flat_positions(method, h):
    start = {"q": [0, 1, 1, 1, 2, 1], "v": [1, 0] * 3}
    run = lv.integrate(MECHANISMS["four-bar"], method, t=(0, 2), h=h, **start)
    energy = run.invariants["energy"]
    assert np.ptp(energy) <= 0.05 * abs(energy[0])


KEPLER = lv.Lagrangian(lambda t, q, v, p: ca.dot(v, v) / 2 + 1 / ca.sqrt(ca.dot(q, q)), q=2)


def test_an_energy_that_changes_by_more_than_its_size_gets_a_word():
    e = 0.999
    start = {"q": [1 + e, 0], "v": [0, np.sqrt((1 - e) / (1 + e))]}
    run = lv.integrate(KEPLER, lv.LobattoPair(2), t=(0, 6), h=0.05, **start)
    assert run.status == "done"
    assert "energy has changed from -0.5 to" in run.message
    both = {"q": [[1, 0], start["q"]], "v": [[0, 1], start["v"]]}
    many = lv.ensemble(KEPLER, lv.LobattoPair(2), t=(0, 6), h=0.05, **both)
    assert "energy of member 1 has changed" in many.message
    for method in (lv.LobattoPair(2), lv.HHT(), lv.Spark(1)):
        good = lv.integrate(KEPLER, method, t=(0, 6), h=0.05, q=[1, 0], v=[0, 1])
        assert good.message == ""
    driven = lv.Lagrangian(lambda t, q, v, p: ca.dot(v, v) / 2, q=1, force=lambda t, q, v, p: [9])
    assert lv.integrate(driven, lv.Spark(1), t=(0, 9), h=0.1, q=[0], v=[0]).message == ""


def nearly_singular(link):
    """Return a slider-crank that nearly passes its centre, as its links are nearly equal."""
    system = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2,
        lambda t, q, p: [half(q[:2]), half(q[:2] - ca.vertcat(q[2], 0), link)],
        q=3,
    )
    q = [np.cos(1.0), np.sin(1.0), np.cos(1.0) + np.sqrt(link**2 - np.sin(1.0) ** 2)]
    return system, system.consistent(q=q, v=[-1, 0.5, 0], hold="q")


@pytest.mark.parametrize("states", [True, False])
@pytest.mark.parametrize("method", [lv.Spark(3), lv.Spark(2), lv.LobattoPair(), lv.HHT()], ids=repr)
def test_an_energy_that_jumps_gets_a_word(method, states):
    crank, start = nearly_singular(1.000001)
    run = lv.integrate(crank, method, t=(0, 3), h=0.01, states=states, **start)
    assert "the energy has jumped by" in run.message
    assert "between t = 1.92 and t = 2.24" in run.message
    whole, plain = nearly_singular(1.1)
    good = lv.integrate(whole, method, t=(0, 3), h=0.01, states=states, **plain)
    assert good.message == ""


@pytest.mark.parametrize("method", [lv.Spark(3), lv.HHT()], ids=repr)
def test_what_is_said_of_an_energy_depends_not_on_what_is_kept(method, tmp_path):
    crank, start = nearly_singular(1.000001)
    call = {"t": (0, 3), "h": 0.01}
    said = lv.integrate(crank, method, **call, **start).message
    assert "the energy has jumped by" in said
    for kept in ({"every": 100}, {"t_eval": [0.3, 1.0]}, {"states": False, "every": 300}):
        assert lv.integrate(crank, method, **call, **kept, **start).message == said
    stored = lv.integrate(crank, method, **call, every=100, store=tmp_path / "run.zarr", **start)
    assert stored.message == said
    q = np.array([start["q"]] * 2)
    both = lv.ensemble(crank, method, **call, every=300, q=q, v=start["v"])
    assert both.message == said.replace("energy has", "energy of member 0 has")


def swing(damping):
    """Return a four-bar with a fast crank, and its start."""
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    bars = {
        "c": ((0, 0), (0, 0.5), 1),
        "k": ((0, 0.5), (0.9, 0.9), 2),
        "r": ((1.1, 0), (0.9, 0.9), 1.8),
    }
    for name, (a, b, mass) in bars.items():
        d = np.subtract(b, a)
        at, angle = np.add(a, b) / 2, np.arctan2(d[1], d[0])
        m.planar_body(name, mass=mass, inertia=mass * d @ d / 12, at=at, angle=angle)
    axis = (0, 0, 1)
    m.revolute("A", m.ground, "c", at=(0, 0, 0), axis=axis, damping=damping)
    m.revolute("B", "c", "k", at=(0, 0.5, 0), axis=axis)
    m.revolute("C", "k", "r", at=(0.9, 0.9, 0), axis=axis)
    m.revolute("D", m.ground, "r", at=(1.1, 0, 0), axis=axis)
    return m.system(), m.start(rates={"A": 20.0})


def test_an_energy_that_can_only_fall_gets_a_word_where_it_rises(tmp_path):
    free, start = swing(0.0)
    run = lv.integrate(free, lv.HHT(), t=(0, 3), h=0.03, **start)
    assert "the energy, which can only fall, has risen from 74.7 at t = 0.96 to 223" in run.message
    assert lv.integrate(free, lv.HHT(), t=(0, 3), h=0.0075, **start).message == ""
    damped, start = swing(0.3)
    coarse = {"t": (0, 3), "h": 0.1, **start}
    told = lv.integrate(damped, lv.ArnoldBruls(), **coarse).message
    assert "the energy, which can only fall, has risen from" in told
    for kept in ({"states": False}, {"every": 30}):
        assert lv.integrate(damped, lv.ArnoldBruls(), **coarse, **kept).message == told
    stored = lv.integrate(damped, lv.ArnoldBruls(), **coarse, store=tmp_path / "run.zarr")
    assert told in stored.message
    assert lv.integrate(damped, lv.ArnoldBruls(), t=(0, 3), h=0.005, **start).message == ""


@pytest.mark.parametrize("method", [lv.HHT(), lv.Spark(2), lv.LobattoPair()], ids=repr)
@pytest.mark.parametrize(
    "force",
    [
        lambda t, q, v, p: 2 * (1 - q[0] ** 2) * v[0],
        lambda t, q, v, p: -0.3 * ca.tanh((v[0] - 1) / 0.1),
        lambda t, q, v, p: -10 * (q[0] - 1) - 0.3 * v[0],
        lambda t, q, v, p: 9 * ca.exp(-(((t - 5) / 0.1) ** 2)) - 0.1 * v[0],
    ],
    ids=["excited", "belt", "controlled", "kicked"],
)
def test_an_energy_that_a_force_raises_gets_no_word(force, method, tmp_path):
    system = lv.Lagrangian(
        lambda t, q, v, p: (v[0] ** 2 - q[0] ** 2) / 2, q=1, force=lambda *a: [force(*a)]
    )
    call = {"t": (0, 20), "h": 0.05, "q": [0.01], "v": [0]}
    run = lv.integrate(system, method, **call)
    assert np.ptp(run.invariants["energy"]) > 0.15
    assert (
        run.message
        == lv.integrate(system, method, **call, store=tmp_path / "run.zarr").message
        == ""
    )


def hanging(v=0.0):
    """Return a pendulum whose energy is zero where it hangs, and its start there."""
    system = lv.Lagrangian(
        lambda t, q, v, p: half(v, 0) - 9.81 * (q[1] + 1), lambda t, q, p: half(q), q=2
    )
    return system, {"q": [0.0, -1.0], "v": [v, 0.0]}


@pytest.mark.parametrize("method", [lv.Spark(2), lv.Spark(3), lv.HHT(), lv.LobattoPair()], ids=repr)
def test_roundings_of_what_rests_get_no_word_and_a_slow_drift_gets_one(method, tmp_path):
    """Energies of 1e-35 J of a pendulum at rest change by more than their size."""
    system, rest = hanging()
    call = {"t": (0, 10), "h": 0.01}
    for more in ({}, {"states": False}, {"store": tmp_path / "run.zarr"}):
        assert lv.integrate(system, method, **call, **more, **rest).message == ""
    spring = lv.Lagrangian(lambda t, q, v, p: half(v, 0) - 50 * (ca.norm_2(q) - 0.7) ** 2, q=2)
    start = {"q": 0.7 * np.array([np.sin(0.3), np.cos(0.3)]), "v": [0.0, 0.0]}
    assert lv.integrate(spring, method, **call, **start).message == ""


@pytest.mark.parametrize(("place", "swing"), [(0.0, 1e-30), (1.0, 1e-10)])
def test_an_energy_far_below_others_gets_a_word_where_it_grows(place, swing, tmp_path):
    spring = lv.Lagrangian(lambda t, q, v, p: half(v, 0) - half(q - place, 0), q=1)
    call = {"t": (0, 42), "h": 2.1, "q": [place + swing], "v": [0.0]}
    for more in ({}, {"store": tmp_path / "run.zarr"}):
        run = lv.integrate(spring, lv.LobattoPair(2), **call, **more)
        assert "by more than its own size" in run.message
    starts = {"q": [[place], [place + swing]], "v": [[0.0], [0.0]]}
    many = lv.ensemble(spring, lv.LobattoPair(2), t=(0, 42), h=2.1, **starts)
    assert "energy of member 1 has changed" in many.message


#: What a weight does, what holds it, and where it rests with no energy.
BORNE = {
    "block": (lambda q: 9.81 * q[1], lambda q: q[1], [0.0, 0.0]),
    "block, far": (lambda q: 9.81 * q[1], lambda q: q[1], [1.0, 0.0]),
    "lever": (lambda q: 9.81 * (q[0] + q[1]), lambda q: q[0] + q[1], [1.0, -1.0]),
    "hanging": (lambda q: 1e6 * (q[1] + 1), lambda q: ca.sumsqr(q) - 1, [0.0, -1.0]),
}


@pytest.mark.parametrize("name", BORNE)
@pytest.mark.parametrize(
    "method", [lv.Spark(3), lv.Spark(6), lv.LobattoPair(4), lv.HHT(), lv.ArnoldBruls()], ids=repr
)
def test_roundings_of_borne_weights_at_rest_get_no_word(name, method):
    potential, held, q = BORNE[name]
    system = lv.Lagrangian(
        lambda t, q, v, p: half(v, 0) - potential(q), lambda t, q, p: held(q), q=2
    )
    run = lv.integrate(system, method, t=(0, 2), h=0.1, q=q, v=[0.0, 0.0])
    assert run.message == ""


def test_a_turntable_drives_its_ball_without_a_word():
    ball = lv.problems.load("rolling_ball")
    run = lv.integrate(ball.system, lv.Spark(2), t=ball.interval, h=0.1, **ball.start)
    assert run.changing == ("energy",)
    assert run.message == ""


def test_of_an_ensemble_the_member_whose_energy_jumps_is_named():
    crank, start = nearly_singular(1.000001)
    v = start["v"] * np.array([[0.1], [1.0]])
    both = lv.ensemble(crank, lv.Spark(3), t=(0, 3), h=0.01, q=start["q"], v=v)
    assert "the energy of member 1 has jumped by 2.9 % of its size" in both.message


def test_an_energy_that_changes_gets_a_word_without_states():
    net = lv.Structure(np.full(8, 2.0), np.linspace(1, 800, 8))
    start = {"q": np.ones(8), "v": np.zeros(8)}
    for system, begin in ((KEPLER, {"q": [1.999, 0], "v": [0, 0.02237]}), (net, start)):
        run = {"t": (0, 8), "h": 0.11, **begin}
        told = lv.integrate(system, lv.LobattoPair(), **run).message
        assert "by more than its own size" in told
        assert told == lv.integrate(system, lv.LobattoPair(), states=False, **run).message


def test_a_pendulum_from_rest_at_height_zero_says_nothing():
    swing = lv.Lagrangian(lambda t, q, v, p: ca.dot(v, v) / 2 - q[1], lambda t, q, p: half(q), q=2)
    for method in (lv.Spark(1), lv.HHT(), lv.LobattoPair()):
        run = lv.integrate(swing, method, t=(0, 20), h=0.1, q=[1, 0], v=[0, 0])
        assert run.invariants["energy"][0] == 0
        assert run.message == ""


@pytest.mark.parametrize(("method", "steps"), [(lv.Spark(3), 28), (lv.Spark(8), 10)])
def test_long_steps_are_confirmed_by_few_others(method, steps):
    """A solution far from where its step begins is followed to a shorter step, not found again."""
    problem = lv.problems.load("pendulum")
    run = lv.integrate(problem.system, method, t=problem.interval, steps=steps, **problem.start)
    assert run.stats["newton_steps"] < 4 * steps


def test_of_an_ensemble_members_that_resets_change_are_watched_beside_the_others():
    """A ball bounces off a floor and loses by it, and another starts too high to meet it."""
    ball = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - q[0], q=1)
    floor = lv.Event(
        lambda t, q, v, lam, p: q[0], direction="down", reset=lambda t, q, v, lam, p: -0.7 * v
    )
    run = {"t": (0, 3), "h": 0.1, "q": [[1.0], [9.0]], "v": [0.0], "events": {"floor": floor}}
    balls = lv.ensemble(ball, lv.Spark(2), **run)
    assert set(balls.events["floor"].member) == {0}
    assert np.ptp(balls.invariants["energy"][:, 0]) > 0.5
    assert balls.message == ""
