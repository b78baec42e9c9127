"""The alpha methods: special cases, start values, changes of step, energy."""

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plain_alpha import Plain
from properties import examples
from registry import PROBLEMS, SECOND_ORDER
from scipy.linalg import null_space
from test_order import orders, shifted_phi

import liouville as lv
from liouville.analysis.convergence import slope
from liouville.problems import chain

METHODS = [
    lv.HHT(0.0),
    lv.HHT(-0.1, b=0),
    lv.HHT(-0.3, less_implicit=True),
    lv.GeneralizedAlpha(0.8),
    lv.GeneralizedAlpha(0.0, b=-1),
    lv.ArnoldBruls(0.5),
]


def plain_run(name, method, steps, t=None, **more):
    problem = PROBLEMS[name]
    plain, (t0, t1) = problem.plain, t or problem.t
    start = plain.start(t0, problem.start["q"], problem.start["v"], kind=method.reaction, **more)
    if isinstance(steps, int):
        steps = np.full(steps, (t1 - t0) / steps)
    how = {"kind": method.reaction, "b": getattr(method, "b", 0.0)}
    return plain.run(start, steps, method.coefficients, **how)


# --- special cases -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", SECOND_ORDER)
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_steps_are_those_of_the_plain_implementation(method, name):
    problem = PROBLEMS[name]
    t0, t1 = problem.t
    t = t0, t0 + (t1 - t0) / 3
    found = lv.integrate(problem.system, method, t=t, steps=25, **problem.start)
    states = plain_run(name, method, 25, t)
    for ours, theirs in (("q", "y"), ("v", "z"), ("a", "a")):
        expected = np.array([getattr(state, theirs) for state in states])
        # a is a second difference of y
        digits = 1e-12 if ours != "a" else 1e-11
        scale = digits * np.abs(expected).max()
        np.testing.assert_allclose(getattr(found, ours), expected, rtol=0, atol=scale)


@pytest.mark.parametrize("stiffness", [0.0, 1e5])
def test_a_long_chain_takes_the_plain_steps_with_few_factors_however_stiff_it_is(stiffness):
    links, h, steps = 12, 0.02, 6

    def places(t, q):
        return ca.horzcat(ca.DM.zeros(2, 1), ca.reshape(q, 2, links))

    def bending(t, q):
        x = places(t, q)
        return stiffness / 2 * ca.sumsqr(x[:, 2:] - 2 * x[:, 1:-1] + x[:, :-2])

    def constraint(t, q, params=None):
        x = places(t, q)
        return ca.vertsplit(((ca.sum1((x[:, 1:] - x[:, :-1]) ** 2) - 1) / 2).T)

    def force(t, y, z):
        return -ca.gradient(bending(t, y) + 9.81 * ca.sum1(y[1::2]), y)

    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - bending(t, q) - 9.81 * ca.sum1(q[1::2]),
        constraint,
        q=[f"q{k}" for k in range(2 * links)],
    )
    q = np.stack([np.arange(1.0, links + 1), np.zeros(links)], axis=1).ravel()
    start = {"q": q, "v": np.zeros(2 * links)}
    method = lv.HHT(-0.1)
    found = lv.integrate(system, method, t=(0.0, steps * h), steps=steps, **start)
    plain = Plain(2 * links, lambda t, y: ca.DM.eye(2 * links), force, constraint)
    begun = plain.start(0.0, q, start["v"], kind=method.reaction)
    sizes, how = np.full(steps, h), {"kind": method.reaction, "b": method.b}
    states = plain.run(begun, sizes, method.coefficients, **how)
    np.testing.assert_allclose(found.q, [state.y for state in states], rtol=0, atol=1e-12)
    assert found.stats["factorizations"] <= 3
    assert found.stats["cold_starts"] == 0


def test_the_acceleration_is_that_of_the_motion_and_has_the_reaction_in_it():
    problem = PROBLEMS["top"]
    found = lv.integrate(problem.system, lv.HHT(-0.1), t=problem.t, steps=20, **problem.start)
    for k, t in enumerate(found.t):
        acceleration, lam = problem.plain.acceleration(t, found.q[k], found.v[k])
        np.testing.assert_allclose(found.acceleration[k], acceleration, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.lam[k], lam, rtol=1e-12)
    phi = shifted_phi("top", -0.1 * found.h)[-1]
    assert np.abs(found.a[-1] - phi).max() < 0.1 * np.abs(found.acceleration[-1] - phi).max()


@pytest.mark.parametrize("method", [lv.HHT(0.0), lv.GeneralizedAlpha(1.0)], ids=str)
def test_without_damping_and_constraints_it_is_second_order_and_conserves_energy(method):
    system, stiffness = oscillators(3, seed=1)
    found = lv.integrate(
        system, method, t=(0.0, 200.0), steps=1000, q=[1.0, -0.5, 2.0], v=[0.0, 1.0, 0.5]
    )
    energy = found.invariants["energy"]
    assert np.ptp(energy) < (1e-12 if method == lv.HHT(0.0) else 0.1) * energy[0]
    assert np.linalg.eigvalsh(stiffness).min() > 0


def test_hht_with_alpha_0_is_the_trapezoidal_rule():
    def force(t, q, v):
        return np.array([np.sin(t) - np.sin(q[0]) - v[0] / 5 + q[1], -(q[1] ** 3) + v[0] * v[1]])

    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        q=2,
        force=lambda t, q, v, params: ca.vertcat(
            ca.sin(t) - ca.sin(q[0]) - v[0] / 5 + q[1], -(q[1] ** 3) + v[0] * v[1]
        ),
    )
    h, y, z = 0.1, np.array([1.0, 0.5]), np.array([0.0, -1.0])
    found = lv.integrate(system, lv.HHT(0.0), t=(0.0, 2.0), h=h, q=y, v=z)
    for n in range(20):
        t, y0, z0, f0 = n * h, y, z, force(n * h, y, z)
        for _ in range(60):
            y, z = y0 + h / 2 * (z0 + z), z0 + h / 2 * (f0 + force(t + h, y, z))
        np.testing.assert_allclose(found.q[n + 1], y, rtol=0, atol=2e-14)
        np.testing.assert_allclose(found.v[n + 1], z, rtol=0, atol=2e-14)


def oscillators(n, seed, damping=0.0):
    """Return a linear system with a random stiffness, and the stiffness."""
    root = np.random.default_rng(seed).normal(size=(n, n))
    stiffness = root @ root.T + np.eye(n)
    K = ca.DM(stiffness)
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - ca.dot(q, K @ q) / 2,
        q=n,
        force=(lambda t, q, v, params: -damping * v) if damping else None,
    )
    return system, stiffness


@pytest.mark.parametrize("alpha", [0.0, -0.1, -1 / 3])
def test_hht_on_a_linear_structure_is_the_textbook_recursion(alpha):
    n, c, h = 3, 0.3, 0.2
    system, K = oscillators(n, seed=2, damping=c)
    d, v = np.array([1.0, -0.5, 2.0]), np.array([0.0, 1.0, 0.5])
    a = -K @ d - c * v
    found = lv.integrate(system, lv.HHT(alpha), t=(0.0, 40 * h), steps=40, q=d, v=v)
    beta, gamma = (1 - alpha) ** 2 / 4, 0.5 - alpha
    effective = np.eye(n) + (1 + alpha) * (gamma * h * c * np.eye(n) + beta * h**2 * K)
    for k in range(40):
        # Hilber, Hughes and Taylor: M a1 + (1 + alpha)(C v1 + K d1) - alpha (C v0 + K d0) = 0
        ahead_d = d + h * v + h**2 * (0.5 - beta) * a
        ahead_v = v + h * (1 - gamma) * a
        old = alpha * (c * v + K @ d)
        a = np.linalg.solve(effective, old - (1 + alpha) * (c * ahead_v + K @ ahead_d))
        d, v = ahead_d + h**2 * beta * a, ahead_v + h * gamma * a
        np.testing.assert_allclose(found.q[k + 1], d, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.v[k + 1], v, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.a[k + 1], a, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SECOND_ORDER)
def test_generalized_alpha_without_weight_on_the_old_acceleration_is_hht(name):
    problem = PROBLEMS[name]
    one, two = (
        lv.integrate(problem.system, method, t=problem.t, steps=50, **problem.start)
        for method in (lv.GeneralizedAlpha(0.5), lv.HHT(-1 / 3))
    )
    for state in ("q", "v", "a", "lam"):
        np.testing.assert_allclose(one.states[state], two.states[state], rtol=0, atol=1e-12)


@examples(12)
@given(
    st.sampled_from([(2, 1), (3, 1), (4, 2), (5, 3)]),
    st.sampled_from(METHODS),
    st.integers(0, 2**32 - 1),
)
def test_linear_constraints_leave_the_method_itself_on_what_they_leave_free(size, method, seed):
    """With G q = 0, q = N x, each method steps x as it steps N^T M N x'' = N^T f, whatever b is."""
    n, m = size
    rng = np.random.default_rng(seed)
    root, square, G = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=(m, n))
    M, K, N = np.eye(n) + root @ root.T / n, square @ square.T, null_space(G)
    bound, free = (
        lv.Lagrangian(
            lambda t, q, v, params, M=M, K=K: (
                ca.dot(v, ca.DM(M) @ v) / 2 - ca.dot(q, ca.DM(K) @ q) / 2
            ),
            constraint,
            q=len(M),
            force=lambda t, q, v, params, N=N: ca.DM(N) @ (ca.sin(ca.DM(N).T @ q + t)),
        )
        for M, K, N, constraint in (
            (M, K, N, lambda t, q, params: ca.DM(G) @ q),
            (N.T @ M @ N, N.T @ K @ N, np.eye(n - m), None),
        )
    )
    x, u = rng.normal(size=(2, n - m))
    one = lv.integrate(bound, method, t=(0.0, 2.0), steps=20, q=N @ x, v=N @ u)
    two = lv.integrate(free, method, t=(0.0, 2.0), steps=20, q=x, v=u)
    np.testing.assert_allclose(one.q, two.q @ N.T, rtol=0, atol=1e-11)
    np.testing.assert_allclose(one.v, two.v @ N.T, rtol=0, atol=1e-11)
    for residual in one.residuals.values():
        assert np.abs(residual).max() < 1e-13


# --- start values ------------------------------------------------------------------------------


def start_offset(name, kind):
    """Return a start value of a, off by O(1) along the constraints or across them."""
    problem = PROBLEMS[name]
    y, z = (np.array(problem.start[key], dtype=float) for key in "qv")
    plain, t = problem.plain, problem.t[0]
    reaction = np.linalg.solve(plain.M(t, y).full(), plain.r(t, y, np.ones(plain.m)).full().ravel())
    if kind == "across":
        return plain.phi(t, y, z) + 3 * reaction
    return plain.phi(t, y, z) + 3 * null_space(plain.G(t, y).full())[:, 0]


@pytest.mark.parametrize("name", SECOND_ORDER)
def test_a_start_off_along_the_constraints_costs_an_order(name):
    found = orders(lv.HHT(-0.1), name, a=start_offset(name, "along"))
    assert abs(found["q"] - 1) < 0.15
    assert abs(found["v"] - 1) < 0.15


@pytest.mark.parametrize("name", SECOND_ORDER)
def test_a_start_off_across_the_constraints_does_no_harm(name):
    found = orders(lv.HHT(-0.1), name, a=start_offset(name, "across"))
    assert abs(found["q"] - 2) < 0.1
    assert abs(found["v"] - 2) < 0.1


def test_a_run_goes_on_where_it_stopped():
    problem, method = PROBLEMS["moving wire"], lv.HHT(-0.2)
    whole = lv.integrate(problem.system, method, t=(0.0, 2.0), steps=40, **problem.start)
    half = lv.integrate(problem.system, method, t=(0.0, 1.0), steps=20, **problem.start)
    rest = {"q": half.q[-1], "v": half.v[-1], "a": half.a[-1]}
    found = lv.integrate(problem.system, method, t=(1.0, 2.0), steps=20, **rest)
    np.testing.assert_allclose(found.q[-1], whole.q[-1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.v[-1], whole.v[-1], rtol=0, atol=1e-14)
    del rest["a"]
    other = lv.integrate(problem.system, method, t=(1.0, 2.0), steps=20, **rest)
    assert np.abs(other.q[-1] - whole.q[-1]).max() > 1e-7


def test_arnold_and_bruls_go_on_where_they_stopped_to_the_fourth_order():
    """Velocities are taken off their constraints, as they are there; reactions are found anew."""
    problem, method, off = PROBLEMS["breathing sphere"], lv.ArnoldBruls(), []
    start, end = problem.t
    middle = (start + end) / 2
    for n in (40, 80, 160, 320):
        whole = lv.integrate(problem.system, method, t=problem.t, steps=n, **problem.start)
        half = lv.integrate(
            problem.system, method, t=(start, middle), steps=n // 2, **problem.start
        )
        rest = {"q": half.q[-1], "v": half.v[-1], "a": half.a[-1]}
        found = lv.integrate(problem.system, method, t=(middle, end), steps=n // 2, **rest)
        off.append(np.abs(found.q[-1] - whole.q[-1]).max())
    assert min(one / two for one, two in pairwise(off)) > 12
    assert off[-1] > 1e-13


# --- changes of step ---------------------------------------------------------------------------


def alternating(method, name, steps, correct):
    """Return the end of runs of one step each, long and short, 4 to 1."""
    problem = PROBLEMS[name]
    plain, (t, end), a, last = problem.plain, problem.t, None, None
    y, z = problem.start["q"], problem.start["v"]
    for h in np.tile([1.6, 0.4], steps // 2) * (end - t) / steps:
        phi = plain.phi(t, y, z)
        a = phi if a is None else a
        if correct and last is not None:
            a = phi + h / last * (a - phi)
        found = lv.integrate(problem.system, method, t=(t, t + h), steps=1, q=y, v=z, a=a)
        t, y, z, a, last = t + h, found.q[-1], found.v[-1], found.a[-1], h
    return np.concatenate([y, z])


@pytest.mark.parametrize("correct", [True, False])
def test_steps_4_to_1_keep_the_order_if_a_is_moved_along_and_lose_it_otherwise(correct):
    problem, counts = PROBLEMS["breathing sphere"], (32, 64, 128, 256)
    exact = lv.integrate(problem.system, lv.Spark(8), t=problem.t, steps=64, **problem.start)
    exact = np.concatenate([exact.q[-1], exact.v[-1]])
    errors = [
        np.abs(alternating(lv.HHT(-0.3), "breathing sphere", steps, correct) - exact).max()
        for steps in counts
    ]
    found = np.log2(errors[-2] / errors[-1])
    assert abs(found - (2 if correct else 1)) < 0.1, errors


@pytest.mark.parametrize("name", SECOND_ORDER)
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_controlled_steps_are_those_of_the_plain_implementation(method, name):
    problem = PROBLEMS[name]
    options = {"rtol": 1e-4, "atol": 1e-5, "control": lv.Adaptive()}
    t0, t1 = problem.t
    t = t0, t0 + (t1 - t0) / 2
    exact = replace(method, newton_tol=1e-16)
    found = lv.integrate(problem.system, exact, t=t, **options, **problem.start)
    sizes = np.diff(found.t)
    assert sizes.max() > 1.2 * sizes.min()
    states = plain_run(name, method, sizes)
    for ours, theirs in (("q", "y"), ("v", "z")):
        expected = np.array([getattr(state, theirs) for state in states])
        np.testing.assert_allclose(getattr(found, ours), expected, rtol=0, atol=1e-10)


# --- energy ------------------------------------------------------------------------------------


def test_what_is_dissipated_is_what_the_balance_of_energy_lacks():
    problem = PROBLEMS["breathing sphere"]
    errors = []
    for steps in (100, 200, 400, 800):
        found = lv.integrate(problem.system, lv.HHT(-0.1), t=(0, 2), steps=steps, **problem.start)
        energy = found.invariants["energy"]
        balance = energy[0] + found.work - energy
        np.testing.assert_allclose(found.dissipated, balance, rtol=0, atol=1e-15)
        errors.append(np.abs(found.dissipated).max())
    assert np.abs(found.work).max() > 0.1
    assert abs(slope([1 / 100, 1 / 200, 1 / 400, 1 / 800], errors) - 2) < 0.1


def test_the_work_is_the_integral_of_the_power():
    problem = PROBLEMS["breathing sphere"]
    exact = lv.integrate(
        problem.system,
        lv.Spark(8),
        t=(0, 2),
        steps=64,
        **problem.start,
    )
    found = lv.integrate(problem.system, lv.HHT(-0.05), t=(0, 2), steps=4000, **problem.start)
    gained = np.ptp(exact.invariants["energy"][[0, -1]])
    assert abs(found.work[-1]) == pytest.approx(gained, rel=1e-5)
    assert found.work[0] == 0
    assert found.dissipated[0] == 0


def test_a_stiff_mode_dies_within_20_steps_where_spark_keeps_its_energy():
    """Two masses, one on a spring 10 000 times as stiff: omega h = 10 for the fast one."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - (q[0] ** 2 + 1e4 * q[1] ** 2) / 2, q=2
    )
    start = {"q": [1.0, 0.01], "v": [0.0, 0.0]}

    def fast(method):
        found = lv.integrate(system, method, t=(0.0, 100.0), h=0.1, **start)
        return found.v[:, 1] ** 2 / 2 + 1e4 * found.q[:, 1] ** 2 / 2, found

    damped, found = fast(lv.HHT(-0.1))
    kept, _ = fast(lv.Spark(2))
    assert damped[20] < 0.02 * damped[0]
    assert damped[-1] < 1e-20
    assert kept[-100:].max() == pytest.approx(kept[0], rel=1e-2)
    slow = found.v[:, 0] ** 2 / 2 + found.q[:, 0] ** 2 / 2
    assert slow[-1] > 0.98 * slow[0]


# --- taut constraints --------------------------------------------------------------------------


def sideways(method, product, links=10, steps=400):
    """Return how far a hanging chain swings after a nudge of 1e-6, with this h omega."""
    tension = np.arange(links, 0, -1)
    difference = np.eye(links) - np.eye(links, k=-1)
    omega = np.sqrt(np.linalg.eigvalsh(links * difference.T @ np.diag(tension) @ difference)[-1])
    system, hanging = chain.build(links), chain.start_for(links)["q"]
    nudge = np.zeros(2 * links)
    nudge[::2] = 1e-6 * np.random.default_rng(1).standard_normal(links)
    start = system.consistent(q=hanging, v=nudge)
    try:
        found = lv.integrate(
            system, method, t=(0.0, steps * product / omega), steps=steps, every=10, **start
        )
    except lv.IntegrationError:
        return np.inf
    return np.abs(found.q[:, ::2]).max()


@pytest.mark.parametrize(("b", "limit"), [(0, 2), (1 / 3, 2 * np.sqrt(3))])
def test_taut_constraints_limit_the_step_by_b_and_not_by_alpha(b, limit):
    for alpha in (0.0, -1 / 3):
        assert sideways(lv.HHT(alpha, b), 0.97 * limit) < 1e-5
        assert sideways(lv.HHT(alpha, b), 1.06 * limit) > 1e-4


def test_taut_constraints_do_not_limit_the_step_with_a_b_above_one_half():
    assert sideways(lv.HHT(-0.1, b=1), 10.0) < 1e-5


def test_taut_constraints_make_the_less_implicit_variant_grow():
    assert sideways(lv.HHT(-0.1, less_implicit=True), 1.5) > 1e-4


def test_arnold_and_bruls_step_over_taut_constraints():
    assert sideways(lv.ArnoldBruls(), 20.0) < 1e-5


@pytest.mark.parametrize(
    ("method", "k", "h", "side"),
    [
        (lv.HHT(), 1e5, 0.1, (1, 1)),
        (lv.GeneralizedAlpha(0.5, less_implicit=True), 1e2, 0.3, (1, 1)),
        (lv.GeneralizedAlpha(0.8), 1e3, 0.1, (1, 0)),
    ],
    ids=repr,
)
def test_roundings_of_a_constraint_that_cancel_are_roundoff(method, k, h, side):
    """A move of both coordinates may leave their sum as it is: no bound for its residual."""
    system = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2 - k * ca.cos(q[0]) * ca.cos(q[1] / 2),
        lambda t, q, p: side[0] * (q[0] + q[1]) - side[1],
        q=2,
    )
    run = lv.integrate(system, method, t=(0, 6 * h), steps=6, q=[7, side[1] - 7], v=[0.3, -0.3])
    assert run.status == "done"
