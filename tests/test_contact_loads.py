"""Contacts that are pressed by a load that is given: brakes, and dry friction of joints."""

import pickle

import casadi as ca
import numpy as np
import pytest

import liouville as lv

G = 9.81
STEPS = [{"h": 0.1}, {"steps": 1}, {"rtol": 1e-8}, {"h": 0.1, "t_eval": [1.0, 2.0, 5.0]}]


def brake(load=4.0, friction=0.5, static=None):
    return lv.Contact(
        load=load, friction=friction, static_friction=static, slip=lambda t, q, v, params: v[0]
    )


def wheel(torque=None, **contacts):
    """Return a wheel of inertia 2."""
    return lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2,
        q=("angle",),
        params={"load": 4.0},
        contacts=contacts,
        force=torque,
    )


def rising(t, q, v, params):
    return [t]


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(3)], ids=repr)
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("way", [1, -1])
def test_a_brake_stops_a_wheel_and_holds_it(method, steps, way):
    """From 3 by a torque of 2 on an inertia of 2: after 3, at 4.5."""
    run = lv.integrate(wheel(brake=brake()), method, t=(0, 5), q=[0], v=[3 * way], **steps)
    record = run.contacts["brake"]
    assert run.q[-1, 0] == pytest.approx(4.5 * way, abs=1e-14)
    assert run.v[-1, 0] == pytest.approx(0, abs=1e-15)
    assert [x.kind for x in record.changes] == ["stick"]
    assert record.changes[0].t == pytest.approx(3, abs=1e-14)
    assert (record.normal == 4).all()
    assert (record.gap == 0).all()
    np.testing.assert_allclose(record.friction[run.t < 2.9], -2 * way)


@pytest.mark.parametrize("more", [{}, {"t_eval": [1.0, 3.0]}])
def test_a_wheel_that_stops_at_the_end_of_a_run_sticks_there(more):
    run = lv.integrate(wheel(brake=brake()), lv.Spark(2), t=(0, 3), h=0.1, q=[0], v=[3], **more)
    record = run.contacts["brake"]
    assert [mode.name for mode in record.mode[-2:]] == ["SLIP_UP", "STICK"]
    assert [(x.kind, x.t) for x in record.changes] == [("stick", pytest.approx(3, abs=1e-14))]
    assert record.friction[-2:] == pytest.approx([-2, 0])


def test_a_torque_that_grows_tears_a_brake_off_at_its_static_friction():
    run = lv.integrate(
        wheel(rising, brake=brake(static=0.75)), lv.Spark(2), t=(0, 5), h=0.1, q=[1], v=[0]
    )
    assert [(x.kind, x.t) for x in run.contacts["brake"].changes] == [
        ("stick", 0), ("slip", pytest.approx(3, abs=1e-13)),
    ]  # fmt: skip
    assert run.q[-1, 0] - 1 == pytest.approx((8 / 6 + 2) / 2, abs=1e-13)
    stuck = run.t < 3
    np.testing.assert_allclose(run.contacts["brake"].friction[stuck], -run.t[stuck], atol=1e-13)
    assert np.abs(lv.analysis.power_balance(run).defect).max() < 1e-13


def test_brakes_on_one_wheel_share_its_torque():
    both = wheel(rising, one=brake(), other=brake(2.0))
    run = lv.integrate(both, lv.Spark(2), t=(0, 5), h=0.1, q=[1], v=[0])
    for record in run.contacts.values():
        assert record.changes[-1].kind == "slip"
        assert record.changes[-1].t == pytest.approx(3, abs=1e-12)
        assert (np.abs(record.friction) <= 0.5 * record.normal + 1e-12).all()
    total = sum(record.friction for record in run.contacts.values())
    np.testing.assert_allclose(total, -np.minimum(run.t, 3), atol=1e-12)
    assert run.q[-1, 0] - 1 == pytest.approx(8 / 12, abs=1e-12)


def test_a_load_may_be_a_function_of_time_coordinates_and_parameters():
    clamped = wheel(brake=brake(lambda t, q, params: params.load * t / 4, 1.0))
    for system in (clamped, pickle.loads(pickle.dumps(clamped))):
        run = lv.integrate(system, lv.Spark(2), t=(0, 5), h=0.1, q=[0], v=[2])
        assert run.contacts["brake"].changes[0].t == pytest.approx(np.sqrt(8), abs=1e-13)
        assert run.q[-1, 0] == pytest.approx(2 * 8**0.5 - 8**1.5 / 12, abs=1e-13)
        np.testing.assert_allclose(run.contacts["brake"].normal, run.t)
    by = lv.integrate(
        clamped, lv.Spark(2), t=(0, 5), h=0.1, q=[0], v=[2], tangents={"params.load": 1.0}
    )
    # v = 2 - load t^2 / 16: it stops at q = 2/3 sqrt(32 / load) 2
    assert by.tangents["params.load"].q[-1, 0] == pytest.approx(-run.q[-1, 0] / 8, abs=1e-12)


def test_a_load_of_coordinates_keeps_the_order_and_the_derivatives():
    """It moves by x'' = -(1 + x)."""
    sledge = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        q=1,
        contacts={
            "snow": lv.Contact(
                load=lambda t, q, params: 1 + q[0], friction=1.0, slip=lambda t, q, v, params: v[0]
            )
        },
    )
    call = {"t": (0, 1), "h": 0.25, "q": [0], "v": [2.0]}
    run = lv.integrate(sledge, lv.Spark(4), tangents={"v": [1.0]}, **call)
    assert run.q[-1, 0] == pytest.approx(np.cos(1) + 2 * np.sin(1) - 1, abs=1e-11)
    assert run.tangents["v"].q[-1, 0] == pytest.approx(np.sin(1), abs=1e-11)


def test_gradients_go_through_a_brake_that_stops_a_wheel():
    clamped = wheel(rising, brake=brake(lambda t, q, params: params.load, 0.5, 0.75))
    call = {"t": (0, 5), "h": 0.1, "q": [0.0], "v": [0.5]}
    solution, pullback = lv.vjp(clamped, lv.Spark(2), wrt=["v", "params.load"], **call)
    assert [x.kind for x in solution.contacts["brake"].changes] == ["stick", "slip"]
    last = np.zeros(solution.q.shape)
    last[-1] = 1
    found, size = pullback(q=last), 1e-3

    def end(v, load):
        moved = call | {"v": [v]}
        return lv.integrate(clamped, lv.Spark(2), params={"load": load}, **moved).q[-1, 0]

    by_v = (end(0.5 + size, 4.0) - end(0.5 - size, 4.0)) / size / 2
    by_load = (end(0.5, 4 + size) - end(0.5, 4 - size)) / size / 2
    assert found["v"][0] == pytest.approx(by_v, abs=1e-6)
    assert found["params.load"] == pytest.approx(by_load, abs=1e-6)


def test_a_spring_with_dry_friction_loses_as_much_each_half_turn():
    """Coulomb's oscillator: amplitudes 2, 1.4, 0.8, 0.2, where it stays."""
    spring = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2,
        q=1,
        contacts={"guide": brake(1.0, 0.3)},
    )
    run = lv.integrate(spring, lv.Spark(4), t=(0, 20), h=0.1, q=[2.0], v=[0.0])
    assert run.q[-1, 0] == pytest.approx(-0.2, abs=1e-12)
    assert [x.kind for x in run.contacts["guide"].changes] == ["slip", "slip", "stick"]
    turns = [x.t for x in run.contacts["guide"].changes]
    np.testing.assert_allclose(turns, np.pi * np.arange(1, 4), atol=1e-12)
    assert run.contacts["guide"].friction[-1] == pytest.approx(-0.2, abs=1e-12)


def test_a_brake_gives_no_impulse_and_acts_beside_other_contacts():
    floor = lv.Contact(
        lambda t, q, params: q[1], restitution=0.5, friction=0.5, slip=lambda t, q, v, params: v[0]
    )
    body = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        q=2,
        force=lambda t, q, v, params: [params.pull * t, 0],
        params={"pull": 3.0},
        contacts={"brake": brake(1.0, 1.0), "floor": floor},
    )
    slides = lv.integrate(
        body, lv.Spark(2), t=(0, 0.44), h=0.05, q=[0, 1], v=[2, 0], params={"pull": 0.0}
    )
    assert slides.v[-1, 0] == pytest.approx(2 - 0.44, abs=1e-13)
    drop = lv.integrate(
        body, lv.Spark(2), t=(0, 0.5), h=0.05, q=[0, 1], v=[9, 0], params={"pull": 0.0}
    )
    assert drop.v[-1, 0] == pytest.approx(9 - 0.5 - 0.75 * np.sqrt(2 * G), abs=1e-12)
    pulled = lv.integrate(body, lv.Spark(2), t=(0, 3), h=0.05, q=[0, 0], v=[0, 0])
    tear = (1 + 0.5 * G) / 3
    for record in pulled.contacts.values():
        assert record.changes[-1].t == pytest.approx(tear, abs=1e-12)
    assert pulled.q[-1, 0] == pytest.approx((3 - tear) ** 3 / 2, abs=1e-12)


def test_loads_that_are_none_are_refused():
    def gap(t, q, params):
        return q[0]

    for given, words in (
        ({}, "a contact has a gap or a load, not neither"),
        ({"gap": gap, "load": 1.0}, "a contact has a gap or a load, not both"),
        ({"load": 1.0, "friction": 0.5}, "a contact with friction needs slip="),
        ({"load": "much", "friction": 0.5, "slip": max}, "load must be a number, not 'much'"),
    ):
        with pytest.raises(TypeError, match=words):
            lv.Contact(**given)
    for more in ({"load": 1.0}, {"load": 1.0, "friction": 0.5, "slip": max, "restitution": 0.5}):
        with pytest.raises(ValueError, match="a contact with a load has friction, and no rest"):
            lv.Contact(**more)
    with pytest.raises(ValueError, match="load must be zero or positive, not -1"):
        brake(-1.0)
    lifted = wheel(brake=brake(lambda t, q, params: 1 - t))
    for way in (1, -1):
        words = r"the load of contact 'brake' is negative, -0\.\d+, at t = 1\.1"
        with pytest.raises(lv.IntegrationError, match=words):
            lv.integrate(lifted, lv.Spark(2), t=(0, 5), h=0.1, q=[0], v=[9 * way])
    with pytest.raises(
        lv.IntegrationError, match="the load of contact 'brake' is negative, -1, at"
    ):
        lv.integrate(lifted, lv.Spark(2), t=(2, 5), h=0.1, q=[0], v=[9])
