"""The energy of conservative systems by the alpha family with controlled steps."""

from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

import liouville as lv

METHODS = [lv.HHT(), lv.HHT(-0.3), lv.HHT(0.0, b=0), lv.GeneralizedAlpha(0.8)]
G = 9.81


def apart(a, b):
    return (ca.sumsqr(a - b) - 1) / 2


@cache
def four_bar():
    """Return two links in a row on rods from the ground, and a start through flat positions."""
    points = [(2 * i, 2 * i + 2) for i in range(3)]

    def lagrangian(t, q, v, params):
        r = [q[a:b] for a, b in points]
        w = [v[a:b] for a, b in points]
        rods = sum(ca.sumsqr(x) / 6 for x in w) - sum(G * x[1] / 2 for x in r)
        for (x, y), (a, b) in zip(pairwise(w), pairwise(r), strict=True):
            rods += (ca.sumsqr(x) + ca.dot(x, y) + ca.sumsqr(y)) / 6 - G * (a[1] + b[1]) / 2
        return rods

    def constraint(t, q, params):
        r = [q[a:b] for a, b in points]
        rods = {f"rod{i}": apart(x, ca.DM([i, 0])) for i, x in enumerate(r)}
        return rods | {f"bar{i}": apart(r[i + 1], r[i]) for i in range(2)}

    start = {"q": [0, 1, 1, 1, 2, 1], "v": [1, 0] * 3}
    return lv.Lagrangian(lagrangian, constraint, q=6), start


@cache
def pendulum(force=None):
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        lambda t, q, params: {"rod": apart(q, ca.DM([0, 0]))},
        q=2,
        force=force,
    )
    return system, {"q": [1, 0], "v": [0, 0]}


@cache
def spring():
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - 25 * (ca.norm_2(q) - 1) ** 2 - G * q[2], q=3
    )
    return system, {"q": [0.6, 0, -0.8], "v": [0, 1.25, 0]}


@cache
def kepler():
    system = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), q=2)
    return system, {"q": [1.9, 0], "v": [0, np.sqrt(0.1 / 1.9)]}


def change(run):
    """Return the largest change of the energy, and its mean in the last quarter of the time."""
    energy = run.invariants["energy"] - run.invariants["energy"][0]
    t0, t1 = run.t[0], run.t[-1]
    last = run.t > t0 + 0.75 * (t1 - t0)
    return np.abs(energy).max(), np.trapezoid(energy[last], run.t[last]) / np.ptp(run.t[last])


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("problem", [four_bar, pendulum, spring], ids=lambda f: f.__name__)
def test_no_more_energy_is_lost_than_by_as_many_equal_steps(problem, rtol, method):
    system, start = problem()
    t = 0.0, 10.0
    run = lv.integrate(system, method, t=t, rtol=rtol, **start)
    equal = lv.integrate(system, method, t=t, steps=run.stats["steps"], **start)
    (largest, lost), (bound, mean) = change(run), change(equal)
    assert largest < 1.25 * bound
    assert lost > -1.25 * abs(mean) - 0.1 * bound


def test_the_pi_controller_loses_what_reversible_steps_keep():
    system, start = four_bar()
    options = {"t": (0.0, 10.0), "rtol": 1e-3}
    run = lv.integrate(system, lv.HHT(), **options, **start)
    other = lv.integrate(system, lv.HHT(), control=lv.Adaptive(), **options, **start)
    assert change(run)[1] > -0.1
    assert change(other)[1] < -1
    assert "reversible steps" in run.message
    assert "reversible" not in other.message


@pytest.mark.parametrize("problem", [pendulum, spring, kepler], ids=lambda f: f.__name__)
def test_the_error_is_not_larger_than_by_the_pi_controller(problem):
    system, start = problem()
    t = 0.0, 5.0
    exact = lv.integrate(system, lv.Spark(6), t=t, rtol=1e-12, **start).q[-1]
    for rtol in (1e-3, 1e-5):
        errors = [
            np.abs(lv.integrate(system, lv.HHT(), t=t, rtol=rtol, **more, **start).q[-1] - exact)
            for more in ({}, {"control": lv.Adaptive()})
        ]
        assert errors[0].max() < 1.5 * errors[1].max()


def test_steps_are_equal_where_others_would_save_little_and_follow_a_passage():
    system = lv.Lagrangian(lambda t, q, v, params: (ca.sumsqr(v) - ca.sumsqr(q)) / 2, q=2)
    run = lv.integrate(system, lv.HHT(), t=(0.0, 20.0), rtol=1e-4, q=[1, 0], v=[0, 0.8])
    assert np.ptp(np.diff(run.t)[:-1]) < 1e-12
    system, start = kepler()
    run = lv.integrate(system, lv.HHT(), t=(0.0, 4 * np.pi), rtol=1e-4, **start)
    assert np.diff(run.t)[:-1].max() > 20 * np.diff(run.t)[:-1].min()


@pytest.mark.parametrize(
    "force",
    [lambda t, q, v, params: -0.1 * v, lambda t, q, v, params: ca.vertcat(ca.cos(t), 0)],
    ids=["friction", "drive"],
)
def test_what_changes_the_energy_has_the_pi_controller(force):
    system, start = pendulum(force)
    options = {"t": (0.0, 3.0), "rtol": 1e-4}
    run = lv.integrate(system, lv.HHT(), **options, **start)
    same = lv.integrate(system, lv.HHT(), control=lv.Adaptive(), **options, **start)
    assert run.message == ""
    np.testing.assert_array_equal(run.t, same.t)
    np.testing.assert_array_equal(run.q, same.q)


def hump():
    """Return an oscillator that becomes ten times as fast on the way, long after the trial."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - q[1] ** 2 / 2 * (1 + 99 / (1 + (q[0] / 5) ** 2)),
        q=2,
    )
    return system, {"q": [-100, 0.01], "v": [1, 0]}


def test_a_later_part_that_needs_shorter_steps_has_them():
    system, start = hump()
    t, options = (0.0, 150.0), {"rtol": 1e-12, "atol": 1e-7}
    run = lv.integrate(system, lv.HHT(0.0), t=t, **options, **start)
    sizes = np.diff(run.t)
    assert run.stats["rejected"] > 0
    assert sizes[run.t[1:] > 100].max() < 0.6 * sizes[run.t[1:] < 40].max()
    # the scale never grows again
    late = sizes[run.t[1:] > 120][:-1]
    assert late.max() < 1.01 * late.min()


def test_backwards_is_as_good():
    system, start = four_bar()
    run = lv.integrate(system, lv.HHT(), t=(10.0, 0.0), rtol=1e-3, **start)
    assert run.t[-1] == 0.0
    assert np.all(np.diff(run.t) < 0)
    assert change(run)[1] > -0.1


def test_a_collision_ends_the_run():
    with pytest.raises(lv.IntegrationError, match=r"a step of .* would be needed"):
        lv.integrate(kepler()[0], lv.HHT(), t=(0, 3), rtol=1e-3, q=[1, 0], v=[0, 0])
