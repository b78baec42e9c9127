"""Exponents agree with variational equations, and come in pairs or sum to zero as theory says."""

import casadi as ca
import numpy as np
import pytest
from ordinary import solved

import liouville as lv
from liouville.problems import abc_flow, load


def henon_heiles():
    """Return the system of Hénon and Heiles."""
    return lv.Lagrangian(
        lambda t, q, v, params: (
            ca.dot(v, v) / 2 - ca.dot(q, q) / 2 - q[0] ** 2 * q[1] + q[1] ** 3 / 3
        ),
        q=("x", "y"),
    )


def variational(x, v, intervals, length):
    """Return the same exponents by another method, in the same orthonormal bases.

    The largest stiffness at the start is 1.2, so that lengths are those of (1.2 ** 0.5 dy, dp).
    """
    unit = 1.2 ** np.array([[0.25], [0.25], [-0.25], [-0.25]])

    def rates(t, w):
        q, d = w[:2], w[4:].reshape(4, 4)
        slope = np.zeros((4, 4))
        slope[:2, 2:] = np.eye(2)
        slope[2:, :2] = [[-1 - 2 * q[1], -2 * q[0]], [-2 * q[0], -1 + 2 * q[1]]]
        force = [-q[0] - 2 * q[0] * q[1], -q[1] - q[0] ** 2 + q[1] ** 2]
        return np.concatenate([w[2:4], force, (slope @ d).ravel()])

    state, basis, total = np.array([*x, *v]), np.eye(4)[:, [0, 1, 3, 2]], np.zeros(4)
    for _ in range(intervals):
        start = np.concatenate([state, (basis / unit).ravel()])
        end = solved(rates, (0, length), start)[-1]
        state, (basis, upper) = end[:4], np.linalg.qr(unit * end[4:].reshape(4, 4))
        total += np.log(np.abs(np.diagonal(upper)))
    return total / (intervals * length)


def test_exponents_are_those_of_the_variational_equation():
    """Of a finite time, to the accuracy of both; in pairs to roundoff."""
    found = lv.analysis.lyapunov(
        henon_heiles(), lv.Spark(4), t=(0, 20), h=0.1, every=20, q=[0, 0.1], v=[0.48, 0.1]
    )
    wanted = variational([0, 0.1], [0.48, 0.1], 10, 2.0)
    np.testing.assert_allclose(found.exponents, wanted, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.pairs, 0.0, atol=1e-13)
    np.testing.assert_array_equal(found.history[-1], found.exponents)
    assert found.t[-1] == 20.0
    assert found.final["q"].shape == (2,)


@pytest.mark.parametrize("name", ["spherical_pendulum", "heavy_top", "double_pendulum"])
def test_pairs_on_constraints(name):
    """2 (n - m) exponents in pairs, with masses that vary too."""
    problem = load(name)
    system = problem.system
    found = lv.analysis.lyapunov(system, lv.Spark(2), t=(0, 1), h=0.02, every=5, **problem.start)
    assert len(found.exponents) == 2 * (len(system.coordinates) - len(system.constraints))
    np.testing.assert_allclose(found.pairs, 0.0, atol=1e-11)


@pytest.mark.parametrize("units", [(1e-10, 1e-15, 1e-27), (1e11, 3e7, 1e30), (1e3, 1, 1e-3)])
def test_units_of_the_model_change_nothing(units):
    def exponents(length, time, mass):
        g = 9.81 * length / time**2
        spherical = lv.Lagrangian(
            lambda t, q, v, params: mass * (ca.dot(v, v) / 2 - g * q[2]),
            lambda t, q, params: {"rod": ca.dot(q, q) - length**2},
            q=3,
        )
        start = spherical.consistent(
            q=length * np.array([0.6, 0.1, -0.8]), v=length / time * np.array([0.3, 0.7, 0.2])
        )
        run = {"t": (0, 5 * time), "h": 0.05 * time}
        return time * lv.analysis.lyapunov(spherical, lv.Spark(4), **run, **start).exponents

    np.testing.assert_allclose(exponents(*units), exponents(1, 1, 1), rtol=0, atol=1e-9)


def test_friction_shifts_all_pairs():
    """By minus the rate at which momenta die out, to the order of the method."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
        lambda t, q, params: {"rod": ca.dot(q, q) - 1},
        q=("x", "y"),
        force=lambda t, q, v, params: -0.2 * v,
    )
    found = lv.analysis.lyapunov(system, lv.Spark(4), t=(0, 5), h=0.05, q=[1.0, 0.0], v=[0.0, 1.0])
    np.testing.assert_allclose(found.pairs, -0.2, atol=1e-9)


def test_exponents_of_a_field_sum_to_zero():
    """As volume is kept; of some of them the largest are the same."""
    method = lv.VolumeSplitting(composition="BM4")
    run = {"t": (0, 20), "h": 0.05, "x": [0.1, 0.2, 0.3]}
    found = lv.analysis.lyapunov(abc_flow.system, method, **run)
    assert abs(found.exponents.sum()) < 1e-12
    assert found.exponents[0] > 0.01
    first = lv.analysis.lyapunov(abc_flow.system, method, exponents=2, **run)
    np.testing.assert_allclose(first.exponents, found.exponents[:2], atol=1e-12)


def lorenz96(n):
    """Return the ring of Lorenz (1996) with friction and forcing, as half of z . F(y)."""

    def rates(t, y, z, params):
        return [(y[(i + 1) % n] - y[i - 2]) * y[i - 1] - y[i] + 8 for i in range(n)]

    def force(t, y, z, params):
        return -ca.jtimes(ca.vertcat(*rates(t, y, z, params)), y, z, True)

    return lv.Mechanical(velocity=rates, momentum=lambda t, y, z, params: z, force=force, y=n)


def test_equations_that_lose_volume_are_half_of_a_hamiltonian_system():
    """The first exponents are theirs, and their sum is the divergence, here -n."""
    n = 6
    run = {"t": (0, 2), "h": 0.01, "y": np.linspace(-1, 4, n), "z": np.zeros(n)}
    found = lv.analysis.lyapunov(lorenz96(n), lv.Spark(3), **run)
    first = lv.analysis.lyapunov(lorenz96(n), lv.Spark(3), exponents=n, **run)
    np.testing.assert_allclose(first.exponents, found.exponents[:n], atol=1e-12)
    assert abs(first.exponents.sum() + n) < 1e-6
    np.testing.assert_allclose(found.pairs, 0.0, atol=1e-12)


@pytest.mark.slow
def test_the_spectrum_of_lorenz96_is_the_published_one():
    """Lorenz and Emanuel (1998): errors double in 2.1 days of 0.2, and the dimension is 27.1."""
    n = 40
    system, method = lorenz96(n), lv.Spark(2)
    y = 8 + 0.01 * np.random.default_rng(0).standard_normal(n)
    run = {"h": 0.02, "z": np.zeros(n)}
    settled = lv.integrate(system, method, t=(0, 50), every=2500, y=y, **run).y[-1]
    found = lv.analysis.lyapunov(
        system, method, t=(0, 400), exponents=n, y=settled, **run
    ).exponents
    exponents = np.sort(found)[::-1]
    assert abs(np.log(2) / exponents[0] / 0.2 - 2.1) < 0.1
    assert np.count_nonzero(exponents > 0.01) == 13
    sums = np.cumsum(exponents)
    k = np.flatnonzero(sums > 0)[-1]
    assert abs(k + 1 + sums[k] / abs(exponents[k + 1]) - 27.1) < 0.3
    assert abs(sums[-1] + n) < 1e-3


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"t": (1, 0), "h": 0.1}, "runs backwards"),
        ({"t": (0, 1)}, "steps"),
        ({"t": (0, 1), "h": 0.1, "exponents": 5}, "there are 4 exponents, not 5"),
        ({"t": (0, 1), "h": 0.1, "every": 0}, "every must be at least 1"),
    ],
)
def test_bad_calls_are_refused(more, says):
    """By what is wrong."""
    with pytest.raises((TypeError, ValueError), match=says):
        lv.analysis.lyapunov(henon_heiles(), lv.Spark(2), q=[0, 0.1], v=[0.4, 0], **more)


def test_nonholonomic_motions_have_none_yet():
    """By the name of the constraint."""
    problem = load("knife_edge")
    with pytest.raises(TypeError, match="go without nonholonomic constraints: 'blade'"):
        lv.analysis.lyapunov(problem.system, lv.Spark(2), t=(0, 1), h=0.1, **problem.start)


def test_waves_have_none():
    """Their sentence says why."""
    waves = lv.Schrodinger(np.diag([0.0, 1.0]))
    with pytest.raises(TypeError, match="moves linearly"):
        lv.analysis.lyapunov(waves, lv.Chebyshev(), t=(0, 1), h=0.1, psi=[1, 0])


def test_failed_steps_are_counted_from_the_start():
    """And not from where directions were last made orthogonal."""
    run = {"t": (0, 100), "h": 0.05, "q": [0, 1.5], "v": [0.49, 0]}
    with pytest.raises(lv.IntegrationError, match="step 62 of 2000 at t") as caught:
        lv.analysis.lyapunov(henon_heiles(), lv.Spark(4), **run)
    assert (caught.value.step, caught.value.t) == (62, pytest.approx(3.1))


def test_steps_at_jumps_are_counted_from_the_start():
    rubbed = lv.Lagrangian(
        lambda t, q, v, p: (v[0] ** 2 - q[0] ** 2) / 2,
        force=lambda t, q, v, p: -0.2 * ca.sign(q[0] - 0.3),
        q=1,
    )
    run = {"t": (0, 10), "steps": 1000, "every": 10, "q": [1.0], "v": [0.0]}
    with pytest.raises(lv.IntegrationError, match="step 114 has no derivative") as caught:
        lv.analysis.lyapunov(rubbed, lv.Spark(2), **run)
    assert caught.value.step == 114
