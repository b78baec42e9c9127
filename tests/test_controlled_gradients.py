"""Controlled steps of differentiated runs follow the errors of tangents: a motion may rest."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.problems import load

#: Of order 2, and of higher ones.
LOW = [lv.Spark(1), lv.LobattoPair(2), lv.HHT(-0.05), lv.GeneralizedAlpha(0.8), lv.ArnoldBruls(0.8)]
HIGH = [*map(lv.Spark, (2, 3, 5)), lv.Spark(3, points="radau"), lv.LobattoPair(3)]


def gradient(system, method, name, start, pulled="q", **run):
    """Return the derivative of the sum of the last positions by `name`, and the run."""
    solution, pullback = lv.vjp(system, method, wrt=[name], **run, **start)
    cotangent = np.zeros_like(solution.states[pulled])
    cotangent[-1] = 1.0
    return pullback(**{pulled: cotangent})[name], solution


@pytest.mark.parametrize("method", LOW + HIGH, ids=str)
def test_pendulum_that_hangs_at_rest(method):
    """Its motion takes a few steps; the tangent is cos(sqrt(g) t)."""
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 + 9.81 * ca.cos(q[0]), q=("angle",)
    )
    rtol, bound = (1e-6, 1e-3) if method in LOW else (1e-8, 1e-6)
    start, run = {"q": [0.0], "v": [0.0]}, {"t": (0, 20), "rtol": rtol}
    found = lv.integrate(system, method, tangents={"q": [1.0]}, **run, **start)
    by_q, solution = gradient(system, method, "q", start, **run)
    assert np.array_equal(solution.t, found.t)
    right = np.cos(np.sqrt(9.81) * 20)
    assert abs(found.tangents["q"].q[-1, 0] - right) < bound
    assert abs(by_q[0] - found.tangents["q"].q[-1, 0]) < 1e-10


def test_hamiltonian_at_rest():
    system = lv.Hamiltonian(
        lambda t, q, p, params: p[0] ** 2 / (2 * params.m) - params.m * 9.81 * ca.cos(q[0]),
        q=("angle",), params={"m": 3.0},
    )  # fmt: skip
    for method in (lv.Spark(2), lv.Spark(4), lv.LobattoPair(3)):
        by_q, _ = gradient(system, method, "q", {"q": [0.0], "p": [0.0]}, t=(0, 20), rtol=1e-8)
        assert abs(by_q[0] - np.cos(np.sqrt(9.81) * 20)) < 1e-5


def test_semi_explicit_system_at_rest():
    """A linear oscillator of first order, with a sum that is held."""
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: [y[1], params.a - 9.81 * y[0], z[0]],
        constraint=lambda t, y, params: y[2] - y[0], y=3, z=1, params={"a": 0.0},
    )  # fmt: skip
    w = np.sqrt(9.81)
    found = lv.integrate(
        system, lv.Spark(3), t=(0, 20), rtol=1e-8, y=[0, 0, 0], tangents={"params.a": 1.0}
    )
    right = (1 - np.cos(w * 20)) / 9.81
    assert abs(found.tangents["params.a"].y[-1, 0] - right) < 1e-6


CORNER = np.array([0, 0, 1, 0, 0.5, np.sqrt(0.75)])


def rods(t, q, params):
    """Return two pins, and two rods of length 1 from them to a corner."""
    reach = [(ca.sumsqr(q[4:] - q[k : k + 2]) - 1) / 2 for k in (0, 2)]
    return [q[0], q[1], q[2] - 1, q[3], *reach]


@pytest.mark.parametrize("method", LOW + HIGH + [lv.Spark(3, solver="newton")], ids=str)
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_two_pins_and_a_bar_stay_where_they_are(method, rtol):
    """Constraints leave no direction, and roundings of a random impulse are none."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - params.g * (q[1] + q[3] + q[5]),
        rods, q=6, params={"g": 9.81},
    )  # fmt: skip
    start = {"q": CORNER, "v": np.zeros(6)}
    run = lv.integrate(system, method, t=(0, 2), rtol=rtol, tangents={"params.g": 1.0}, **start)
    assert np.abs(run.q[-1] - CORNER).max() < 1e-14
    assert np.abs(run.tangents["params.g"].q[-1]).max() < 1e-14


@pytest.mark.parametrize("method", [lv.Spark(1), lv.LobattoPair(2)], ids=str)
@pytest.mark.parametrize("cube", [0, 1])
def test_a_tangent_from_rest_grows_out_of_its_first_steps(method, cube):
    """By a method of order two they were a millionth of the motion's, which is one of g t²."""
    system = lv.Mechanical(
        velocity=lambda t, y, z, params: z,
        momentum=lambda t, y, z, params: z,
        force=lambda t, y, z, params: [0, -params.g],
        reaction=lambda t, y, lam, params: -y * (lam + cube * lam**3),
        constraint=lambda t, y, params: ca.sumsqr(y) - 1,
        y=2,
        params={"g": 9.81},
    )
    start, run = {"y": [0.6, -0.8], "z": [0, 0]}, {"t": (0, 1e-3), "rtol": 1e-9}
    found = lv.integrate(system, method, tangents={"params.g": 1.0}, **start, **run)
    right = found.z[-1] * 1e-3 / (2 * 9.81)
    off = found.tangents["params.g"].y[-1] - right
    assert np.abs(off).max() < 1e-6 * np.abs(right).max()
    assert found.stats["steps"] < 30_000


WINDOWS = [lv.Spark(2), lv.Spark(3), lv.Spark(3, points="radau"), lv.LobattoPair(3), lv.HHT(-0.05)]


@pytest.mark.parametrize("method", WINDOWS, ids=str)
@pytest.mark.parametrize("amplitudes", [np.zeros(20), np.repeat([0.0, 1.0], 10)], ids=["0", "half"])
def test_windows_of_a_force_that_is_zero(method, amplitudes):
    """A jump that a step misses is in the velocity from there on."""

    def force(t, q, v, params):
        windows = (ca.logic_and(t >= k / 2, t < (k + 1) / 2) for k in range(20))
        return sum(ca.if_else(window, params.a[k], 0) for k, window in enumerate(windows))

    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2, force=force, q=1, params={"a": amplitudes}
    )
    start, run = {"q": [0.0], "v": [0.0]}, {"t": (0, 10), "rtol": 1e-9}
    right = 0.5 * (10 - (np.arange(20) + 0.5) / 2)
    found = lv.integrate(system, method, tangents={"params.a": np.eye(20)}, **run, **start)
    assert np.abs(found.tangents["params.a"].q[-1, :, 0] - right).max() < 1e-6
    by_a, _ = gradient(system, method, "params.a", start, **run)
    assert np.abs(by_a - right).max() < 1e-6


@pytest.mark.parametrize("method", WINDOWS, ids=str)
def test_a_jump_of_a_tangent_on_a_constraint(method):
    """A bead on a line: velocities are known to roundings of positions in a step."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: q[1] - q[0] / 3,
        force=lambda t, q, v, params: ca.vertcat(ca.if_else(t < 1.23456, params.a, params.b), 0),
        q=2, params={"a": 0.0, "b": 0.0},
    )  # fmt: skip
    run = {"t": (0, 3), "rtol": 1e-9, "q": [0.0, 0.0], "v": [0.0, 0.0]}
    found = lv.integrate(system, method, tangents={"params.a": 1.0, "params.b": 1.0}, **run)
    rest = 3 - 1.23456
    right = {"a": (1.23456**2 / 2 + 1.23456 * rest) * 0.9, "b": rest**2 / 2 * 0.9}
    for name, value in right.items():
        assert abs(found.tangents[f"params.{name}"].q[-1, 0] - value) < 1e-5


@pytest.mark.parametrize("method", [lv.Spark(1), lv.LobattoPair(2), *HIGH, lv.HHT(-0.05)], ids=str)
@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_parameters_of_a_double_pendulum_released_from_rest(method, rtol):
    """Tangents by parameters begin at zero, smaller than the roundoff of their parts."""

    def lagrangian(t, q, v, params):
        (a, b), (da, db) = ca.vertsplit(q), ca.vertsplit(v)
        l1, l2, m1, m2 = params.l1, params.l2, params.m1, params.m2
        cross = m2 * l1 * l2 * da * db * ca.cos(a - b)
        kinetic = (m1 + m2) * (l1 * da) ** 2 / 2 + m2 * (l2 * db) ** 2 / 2 + cross
        return kinetic + params.g * ((m1 + m2) * l1 * ca.cos(a) + m2 * l2 * ca.cos(b))

    params = {"m1": 1.0, "m2": 0.7, "l1": 1.0, "l2": 0.8, "g": 9.81}
    system = lv.Lagrangian(lagrangian, q=2, params=params)
    run = {"t": (0, 2), "q": [1.0, 0.5], "v": [0.0, 0.0]}
    tangents = {f"params.{name}": 1.0 for name in params}
    found = lv.integrate(system, method, rtol=rtol, tangents=tangents, **run)
    right = lv.integrate(system, lv.Spark(4), steps=200, tangents=tangents, **run)
    for name in tangents:
        size = np.abs(right.tangents[name].q).max()
        apart = found.tangents[name].q[-1] - right.tangents[name].q[-1]
        assert np.abs(apart).max() < 1e3 * rtol * size


def test_tangents_that_are_roundoff():
    """A mass that falls freely falls as any other does."""
    system = lv.Lagrangian(
        lambda t, q, v, params: params.m * (ca.dot(v, v) / 2 - 9.81 * q[1]),
        q=2, params={"m": 1e-3},
    )  # fmt: skip
    run = {"t": (0, 100), "q": [0.0, 0.0], "v": [1.0, 0.0]}
    for method in (lv.Spark(2), lv.Spark(3), lv.LobattoPair(3), lv.HHT(-0.05)):
        for rtol in (1e-4, 1e-8, 1e-11):
            found = lv.integrate(system, method, rtol=rtol, tangents={"params.m": 1.0}, **run)
            assert found.stats["steps"] < 200
            assert np.abs(found.tangents["params.m"].q).max() < 1e-6


def test_a_tangent_that_decays_is_as_accurate_as_it_is_small():
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - 9.81 * q[0] ** 2) / 2,
        force=lambda t, q, v, params: -2 * params.c * v, q=1, params={"c": 0.5},
    )  # fmt: skip
    run = {"t": (0, 30), "rtol": 1e-8, "q": [0.0], "v": [0.0]}
    found = lv.integrate(system, lv.Spark(3), tangents={"q": [1.0]}, **run)
    w = np.sqrt(9.81 - 0.25)
    right = np.exp(-15.0) * (np.cos(30 * w) + 0.5 / w * np.sin(30 * w))
    assert abs(found.tangents["q"].q[-1, 0] - right) < 1e-4 * np.exp(-15.0)


def test_steps_are_those_of_a_run_whatever_it_is_differentiated_by():
    problem = load("double_pendulum")
    run = {"t": (0, 2), "rtol": 1e-7, **problem.start}
    first = lv.integrate(problem.system, lv.Spark(3), tangents={"q": [1, 0, 0, 0]}, **run)
    far = lv.integrate(problem.system, lv.Spark(3), tangents={"v": 1e9 * np.eye(4)}, **run)
    assert np.array_equal(first.t, far.t)
    assert np.array_equal(first.q, far.q)
