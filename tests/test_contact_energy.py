"""Where the energy of runs with contacts goes: friction, impacts, walls and belts that move."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.analysis import power_balance

G = 9.81


def ground(height=lambda t: 0.0, belt=0.0, restitution=0.0, friction=0.0):
    return lv.Contact(
        lambda t, q, params: q[1] - height(t),
        restitution=restitution,
        friction=friction,
        slip=lambda t, q, v, params: v[0] - belt,
    )


def thrown(contact, method=None, pull=0.0, **call):
    body = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        q=("x", "y"),
        force=lambda t, q, v, params: [pull * t, 0],
        contacts={"ground": contact},
    )
    call = {"t": (0, 1), "h": 0.02, "q": [0.0, 0.0], "v": [1.0, 0.0]} | call
    return lv.integrate(body, method or lv.Spark(2), **call)


def test_friction_takes_what_a_block_had():
    run = thrown(ground(friction=0.3))
    found = power_balance(run)
    assert found.work["friction"][-1] == pytest.approx(-0.5, abs=1e-14)
    assert found.power["friction"][0] == pytest.approx(-0.3 * G)
    assert np.abs(found.defect).max() < 1e-14


def test_a_belt_gives_what_friction_takes_and_what_a_block_gets():
    """On the belt it is at rest after v/(mu g): the slip's way is half of the belt's."""
    run = thrown(ground(friction=0.3, belt=0.6), v=[0.0, 0.0])
    found = power_balance(run)
    assert found.work["contacts"][-1] == pytest.approx(0.36, abs=1e-14)
    assert found.work["friction"][-1] == pytest.approx(-0.18, abs=1e-14)
    assert np.abs(found.defect).max() < 1e-14


def test_impacts_take_what_the_restitution_leaves():
    run = thrown(ground(restitution=0.5), q=[0.0, 0.1])
    found = power_balance(run)
    hits = [x for x in run.contacts["ground"].changes if x.kind == "hit"]
    fall = np.sqrt(0.2 * G)
    first = np.searchsorted(run.t, hits[0].t)
    assert found.work["impacts"][first] == pytest.approx(-0.75 * fall**2 / 2)
    assert found.work["impacts"][first - 1] == 0
    assert found.work["impacts"][-1] == pytest.approx(-0.1 * G, abs=1e-13)
    assert np.abs(found.defect).max() < 1e-13


def test_a_ground_that_moves_and_a_force_account_for_all():
    contact = ground(lambda t: 0.1 * ca.sin(5 * t), 0.2, restitution=0.5, friction=0.3)
    run = thrown(contact, lv.Spark(4), pull=3.0, t=(0, 3), v=[0.0, 0.5])
    found = power_balance(run)
    assert {"forces", "contacts", "friction"} <= found.work.keys()
    assert min(np.abs(x).max() for x in found.work.values() if x.any()) > 1e-3
    assert np.abs(found.defect).max() < 1e-11
    part = power_balance(run.sel(time=slice(1, 2)))
    assert np.abs(part.defect).max() < 1e-11


def test_contacts_that_share_a_load_account_for_all():
    feet = {
        name: lv.Contact(
            lambda t, q, params, side=side: q[1] + side * ca.sin(q[2]),
            friction=0.4,
            slip=lambda t, q, v, params: v[0],
        )
        for name, side in (("left", -1), ("right", 1))
    }
    box = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        q=("x", "y", "angle"),
        force=lambda t, q, v, params: [2 * t, 0, 0],
        contacts=feet,
    )
    start = {"q": [0.0, 0.0, 0.0], "v": [0.0, 0.0, 0.0]}
    run = lv.integrate(box, lv.Spark(2), t=(0, 3), h=0.1, **start)
    found, since = power_balance(run), 3 - 0.2 * G
    assert found.work["friction"][-1] == pytest.approx(-0.4 * G * run.q[-1, 0])
    assert run.q[-1, 0] == pytest.approx(since**3 / 3)
    assert np.abs(found.defect).max() < 1e-13


@pytest.mark.parametrize("more", [{}, {"t_eval": [0.3, 0.62, 1.0]}, {"every": 4}])
def test_the_alpha_family_records_what_contacts_take(more):
    """Work and dissipation are those since the start, not since the last change."""
    method = lv.GeneralizedAlpha(0.9)
    run = thrown(ground(restitution=0.5), method, pull=3.0, q=[0.0, 0.1], h=0.002, **more)
    np.testing.assert_allclose(run.work, 3 * (run.t**2 / 2 + run.t**4 / 8 * 3), atol=1e-4)
    assert run.dissipated[-1] == pytest.approx(0.1 * G, abs=1e-4)
    slid = thrown(
        ground(friction=0.3, belt=-0.2),
        method,
        h=0.002,
        t=(0, 0.3),
        **(more if "every" in more else {}),
    )
    way = 1.2 * 0.3 - 0.3 * G * 0.045
    assert slid.dissipated[-1] == pytest.approx(0.3 * G * way, abs=1e-4)
