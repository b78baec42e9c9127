"""Controlled steps: what the error estimate says, and what the tolerance buys."""

import sys

import casadi as ca
import numpy as np
import pytest
from registry import PROBLEMS, SECOND_ORDER

import liouville as lv
from liouville.analysis.convergence import distance
from liouville.problems import load

TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7)


def kepler():
    return lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2 + 1 / ca.norm_2(q), q=("x", "y"))


def kepler_start(eccentricity):
    return {
        "q": [1 - eccentricity, 0],
        "v": [0, np.sqrt((1 + eccentricity) / (1 - eccentricity))],
    }


def exact_end(problem, t):
    found = lv.integrate(problem.system, lv.Spark(5), t=t, h=problem.h / 2, **problem.start)
    return found.q[-1]


@pytest.mark.parametrize(
    "name", ["pendulum", "spherical_pendulum", "double_pendulum", "chain", "andrews", "moving_wire"]
)
@pytest.mark.parametrize(
    "method", [lv.HHT(-0.1), lv.HHT(-0.1, b=0), lv.GeneralizedAlpha(0.8)], ids=str
)
def test_the_error_falls_with_the_tolerance(method, name):
    """A local error of order h^3 held at the tolerance leaves a global one of its power 2/3.

    Errors that partly cancel, as on some of these, fall faster.
    """
    problem = load(name)
    t = 0.0, min(5.0, problem.interval[1])
    exact = exact_end(problem, t)
    errors = []
    for rtol in TOLERANCES:
        atol = rtol * 1e-2 * np.abs(exact).max()
        found = lv.integrate(problem.system, method, t=t, rtol=rtol, atol=atol, **problem.start)
        errors.append(distance(found.q[-1], exact))
        assert found.stats["rejected"] < 0.2 * found.stats["steps"] + 5
    slope = np.polyfit(np.log(TOLERANCES), np.log(errors), 1)[0]
    assert 0.55 < slope < 1.2, errors
    assert errors[-1] < 1e-3


def estimate(system, method, t, h, start):
    """Find the error estimate of a first step: the least tolerance by which it is accepted."""
    low, high = np.log(1e-11), 0.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        atol = np.exp(middle)
        found = lv.integrate(
            system, method, t=(t, t + h), h=h, rtol=1e-12, atol=atol, control=lv.Adaptive(), **start
        )
        low, high = (middle, high) if found.stats["rejected"] else (low, middle)
    return np.exp(high)


def local_error(problem, method, h):
    """Return the error of y after a step from the exact a, in the mean over the coordinates."""
    plain, t = problem.plain, problem.t[0]
    am, af, *_ = method.coefficients
    shift = (am - af) * h
    there = lv.integrate(problem.system, lv.Spark(8), t=(t, t + shift), steps=1, **problem.start)
    a = plain.phi(t + shift, there.q[-1], there.v[-1])
    start = {**problem.start, "a": a}
    one = lv.integrate(problem.system, method, t=(t, t + h), steps=1, **start)
    exact = lv.integrate(problem.system, lv.Spark(8), t=(t, t + h), steps=1, **problem.start)
    return start, np.sqrt(np.mean((one.q[-1] - exact.q[-1]) ** 2))


@pytest.mark.parametrize("name", SECOND_ORDER)
@pytest.mark.parametrize(
    "method", [lv.HHT(-0.1, b=0), lv.HHT(-0.3), lv.GeneralizedAlpha(0.8)], ids=str
)
def test_the_estimate_is_the_local_error_or_more(method, name):
    problem = PROBLEMS[name]
    for h in (0.02, 0.01, 0.005):
        start, error = local_error(problem, method, h)
        found = estimate(problem.system, method, problem.t[0], h, start)
        assert 0.8 * error < found < 20 * error


@pytest.mark.parametrize("method", [lv.HHT(-0.1), lv.HHT(-0.3), lv.GeneralizedAlpha(0.5)], ids=str)
def test_without_constraints_the_estimate_is_the_local_error(method):
    system, start = kepler(), kepler_start(0.5)
    am, af, *_ = method.coefficients
    ratios = []
    for h in (0.04, 0.01):
        shift = (am - af) * h
        there = lv.integrate(system, lv.Spark(8), t=(0, shift), steps=1, **start)
        q = there.q[-1]
        more = {**start, "a": -q / np.linalg.norm(q) ** 3}
        one = lv.integrate(system, method, t=(0, h), steps=1, **more)
        exact = lv.integrate(system, lv.Spark(8), t=(0, h), steps=1, **start)
        error = np.sqrt(np.mean((one.q[-1] - exact.q[-1]) ** 2))
        ratios.append(estimate(system, method, 0.0, h, more) / error)
    assert abs(ratios[1] - 1) < 0.03
    assert abs(ratios[1] - 1) < 0.5 * abs(ratios[0] - 1) + 0.002


def test_steps_are_short_where_the_motion_is_fast():
    found = lv.integrate(kepler(), lv.HHT(0.0), t=(0.0, 4 * np.pi), rtol=1e-6, **kepler_start(0.9))
    middle = (found.t[1:] + found.t[:-1]) / 2
    sizes = np.diff(found.t)
    near = np.abs(np.linalg.norm(found.q, axis=1)[1:]) < 0.2
    assert sizes[~near].max() > 10 * sizes[near].min()
    # the shortest steps are at the passage through the perihelion
    assert np.abs(middle[np.argmin(sizes[20:]) + 20] % (2 * np.pi) - np.pi) > 0.9 * np.pi
    assert found.t[-1] == 4 * np.pi


def test_rejected_steps_happen_and_are_counted():
    kick = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - ca.dot(q, q) / 2,
        q=1,
        force=lambda t, q, v, params: 100 * ca.exp(-(((t - 5) / 0.02) ** 2)),
    )
    found = lv.integrate(kick, lv.HHT(-0.1), t=(0.0, 10.0), rtol=1e-4, atol=1e-6, q=[1.0], v=[0.0])
    exact = lv.integrate(kick, lv.Spark(4), t=(0.0, 10.0), h=1e-3, q=[1.0], v=[0.0])
    assert found.stats["rejected"] >= 1
    assert found.stats["steps"] == len(found.t) - 1
    assert np.all(np.diff(found.t) > 0)
    assert np.abs(found.q[-1] - exact.q[-1]).max() < 1e-2 * np.abs(exact.q).max()
    sizes = np.diff(found.t)
    kicked = np.abs(found.t[1:] - 5) < 0.05
    assert sizes[kicked].min() < 0.1 * sizes[~kicked].max()


def test_the_first_step_is_the_one_asked_for_if_it_is_good_enough():
    problem = load("slider_crank")
    found = lv.integrate(
        problem.system, lv.HHT(-0.1), t=(0.0, 0.1), h=1e-5, rtol=1e-3, control=lv.Adaptive(),
        **problem.start,
    )  # fmt: skip
    assert found.t[1] == pytest.approx(1e-5, rel=1e-12)
    assert np.diff(found.t).max() > 1e-4
    assert found.h == pytest.approx(0.1 / found.stats["steps"])


def test_controlled_steps_go_backwards_too():
    problem = PROBLEMS["moving wire"]
    there = lv.integrate(problem.system, lv.Spark(4), t=problem.t, steps=200, **problem.start)
    start = {"q": there.q[-1], "v": there.v[-1]}
    found = lv.integrate(
        problem.system, lv.HHT(-0.05), t=problem.t[::-1], rtol=1e-7, atol=1e-8, **start
    )
    assert np.all(np.diff(found.t) < 0)
    assert found.t[-1] == problem.t[0]
    np.testing.assert_allclose(found.q[-1], problem.start["q"], rtol=0, atol=1e-3)


def test_a_tolerance_of_its_own_for_each_coordinate():
    """A coordinate in a unit 2^20 times as small gets 2^20 times the tolerance."""

    def oscillators(unit):
        return lv.Lagrangian(
            lambda t, q, v, params: (
                (v[0] ** 2 + (v[1] / unit) ** 2) / 2 - (q[0] ** 2 + 4 * (q[1] / unit) ** 2) / 2
            ),
            q=2,
        )

    one, two = (
        lv.integrate(
            oscillators(unit),
            lv.HHT(-0.1),
            t=(0.0, 10.0),
            rtol=1e-9,
            atol=[1e-5, 1e-5 * unit],
            q=[1.0, unit],
            v=[0.0, 0.0],
        )
        for unit in (1.0, 2.0**20)
    )
    np.testing.assert_array_equal(one.t, two.t)


def test_a_step_that_would_be_too_small_ends_the_run_and_says_so():
    wall = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        q=1,
        force=lambda t, q, v, params: 1 / (1 - q[0]) ** 3,
    )
    with pytest.raises(lv.IntegrationError) as caught:
        lv.integrate(
            wall,
            lv.HHT(-0.1),
            t=(0.0, 10.0),
            rtol=1e-6,
            control=lv.Adaptive(1e-6),
            q=[0.0],
            v=[1.0],
        )
    assert caught.value.t < 1
    assert caught.value.solution.q[-1, 0] < 1
    assert np.diff(caught.value.solution.t).min() >= 1e-6 * (1 - 1e-9)


@pytest.mark.parametrize("rho", [0.9, 0.5])
@pytest.mark.parametrize("reaction", [lambda x: x + x**3, ca.sinh], ids=["x + x³", "sinh x"])
def test_reactions_that_bend_move_a_pendulum_by_the_position_alone_as_ideal_ones(reaction, rho):
    """Velocities off the hidden constraint made multipliers jump where the step changed."""
    system = lv.Mechanical(
        velocity=lambda t, y, z, params: z,
        momentum=lambda t, y, z, params: z,
        force=lambda t, y, z, params: [0, -100],
        reaction=lambda t, y, lam, params: -y * reaction(lam),
        constraint=lambda t, y, params: ca.sumsqr(y) - 1,
        y=2,
    )
    start = {"t": (0, 2), "y": [0.6, -0.8], "z": [0, 0]}
    right = lv.integrate(system, lv.Spark(4), h=2e-3, **start).y[-1]
    run = lv.integrate(system, lv.ArnoldBruls(rho), rtol=1e-5, **start)
    assert np.abs(run.y[-1] - right).max() < 5e-3
    assert run.stats["steps"] < 800


def test_a_run_may_be_interrupted_within_its_trial(monkeypatch):
    """The trial of reversible steps is made a step at a time, between looks at the signals."""
    problem = load("double_pendulum")
    run = {"t": (0.0, 1.0), "rtol": 1e-5, **problem.start}
    calls = []

    def report(done, total):
        calls.append(done)
        if len(calls) == stop_at:
            raise KeyboardInterrupt

    stop_at = 5
    monkeypatch.setattr(sys.modules["liouville._runs.execute"], "SLICE", 0.0)
    cut = lv.integrate(problem.system, lv.HHT(), progress=report, **run)
    assert (cut.status, cut.stats["steps"], calls) == ("interrupted", 0, [0.0] * 5)
    stop_at = 0
    slow = lv.integrate(problem.system, lv.HHT(), progress=report, **run)
    monkeypatch.undo()
    whole = lv.integrate(problem.system, lv.HHT(), **run)
    assert np.array_equal(whole.q, slow.q)
    assert np.array_equal(whole.t, slow.t)
