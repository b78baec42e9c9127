"""Coordinates of joints and points of bodies as functions: observed, fitted, met by events."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import liouville as lv

Z = (0, 0, 1)


def crane(planar=False):
    """Return a boom on a hinge, with a load on a slide along it and a bob in a ball joint."""
    m = lv.bodies.Assembly(gravity=(0, 0, -9.81))
    m.body("boom", mass=2.0, inertia=(0.1, 0.4, 0.4), at=(1, 0, 0))
    m.body("load", mass=1.0, inertia=(0.1, 0.1, 0.1), at=(1.5, 0, 0))
    m.body("bob", mass=0.5, inertia=(0.02, 0.03, 0.04), at=(1.5, 0, -0.5))
    m.revolute("hinge", "ground", "boom", at=(0, 0, 0), axis=(0, 1, 0))
    m.prismatic("slide", "boom", "load", axis=(1, 0, 0), spring=40.0)
    m.spherical("ball", "load", "bob", at=(1.5, 0, 0))
    return m


M = crane()
SYSTEM = M.system(params={"scale": 2.0})
START = M.start(values={"hinge": 0.3}, rates={"hinge": 0.5, "slide": 0.2})
RUN = {"t": (0, 0.5), "steps": 50}


def test_coordinates_and_rates_are_those_of_the_joint():
    observe = {
        "angle": SYSTEM.coordinate("hinge.angle"),
        "slide": SYSTEM.coordinate("slide"),
        "turning": SYSTEM.rate("hinge"),
        "spin": SYSTEM.rate("ball.spin_y"),
    }
    run = lv.integrate(SYSTEM, lv.Spark(3), **RUN, **START, observe=observe)
    hinge, slide, ball = (run.joint(name) for name in ("hinge", "slide", "ball"))
    for name, wanted in (
        ("angle", hinge.values["angle"]), ("slide", slide.values["slide"]),
        ("turning", hinge.rates["angle"]), ("spin", ball.rates["spin_y"]),
    ):  # fmt: skip
        np.testing.assert_allclose(run.observed[name], wanted, rtol=0, atol=1e-14)
    assert np.ptp(run.observed["slide"]) > 0.01


def test_points_are_those_of_the_bodies():
    tip = SYSTEM.point("boom", (1.0, 0.2, 0.0))
    observe = {"tip": tip, "load": SYSTEM.point("load")}
    run = lv.integrate(SYSTEM, lv.Spark(3), **RUN, **START, observe=observe)
    wanted = run.body("boom").point((1.0, 0.2, 0.0))
    np.testing.assert_allclose(run.observed["tip"], wanted, rtol=0, atol=1e-14)
    np.testing.assert_allclose(run.observed["load"], run.body("load").position, atol=1e-14)


def test_points_of_planar_bodies_are_in_their_plane():
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    m.planar_body("rod", mass=1.0, inertia=0.1, at=(0.5, 0))
    m.revolute("pin", "ground", "rod", at=(0, 0, 0), axis=Z)
    system = m.system()
    run = lv.integrate(
        system, lv.Spark(3), **RUN, **m.start(values={"pin": 0.2}),
        observe={"tip": system.point("rod", (0.5, 0, 0)), "angle": system.coordinate("pin")},
    )  # fmt: skip
    angle = run.observed["angle"]
    wanted = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(run.observed["tip"], wanted, atol=1e-13)


def test_events_meet_an_angle_and_a_height():
    angle, tip = SYSTEM.coordinate("hinge.angle"), SYSTEM.point("boom", (1.0, 0, 0))
    events = {
        "down": lv.Event(lambda t, q, v, lam, params: angle(t, q, v) - 0.6),
        "low": lv.Event(lambda t, q, v, lam, params: tip(t, q, v)[2] + 1.2),
        "level": lv.Event(SYSTEM.coordinate("slide")),
    }
    run = lv.integrate(SYSTEM, lv.Spark(3), t=(0, 0.5), steps=100, events=events, **START)
    q = run.events["down"].q
    assert len(q) == 1
    again = {"q": q[0], "v": run.events["down"].v[0]}
    at = lv.integrate(SYSTEM, lv.Spark(3), t=(0, 1e-6), steps=1, **again)
    assert at.joint("hinge").values["angle"][0] == pytest.approx(0.6, abs=1e-12)
    low = {name: run.events["low"].states[name][0] for name in ("q", "v")}
    at = lv.integrate(SYSTEM, lv.Spark(3), t=(0, 1e-6), steps=1, **low)
    assert at.body("boom").point((1.0, 0, 0))[0, 2] == pytest.approx(-1.2, abs=1e-12)


def test_an_encoder_at_a_joint_is_fitted_and_the_functions_are_pickled():
    m = lv.bodies.Assembly(gravity=(0, 0, -9.81))
    m.body("boom", mass=2.0, inertia=(0.1, 0.4, 0.4), at=(1, 0, 0))
    m.revolute(
        "hinge", "ground", "boom", at=(0, 0, 0), axis=(0, 1, 0), damping=lambda params: params.c
    )
    system, start = m.system(params={"c": 0.3}), m.start(values={"hinge": 0.3})
    run = lv.integrate(system, lv.Spark(3), **RUN, **start,
                       observe={"angle": system.coordinate("hinge")})  # fmt: skip
    again = pickle.loads(pickle.dumps(system))
    found = lv.fit(
        again, lv.Spark(3), {"t": run.t, "angle": run.observed["angle"]}, h=0.01,
        params={"c": 0.5}, observe={"angle": again.coordinate("hinge")}, **start,
    )  # fmt: skip
    assert found.params["c"] == pytest.approx(0.3, abs=1e-9)


def test_two_numbers_are_a_point_of_a_planar_body():
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    m.bar("rod", (0, 0), (1, 0), mass=1.0)
    m.revolute("pin", m.ground, "rod", at=(0, 0))
    system = m.system()
    run = lv.integrate(
        system, lv.Spark(3), **RUN, **m.start(), observe={"tip": system.point("rod", (0.5, 0))}
    )
    assert np.array_equal(run.body("rod").point((0.5, 0)), run.body("rod").point((0.5, 0, 0)))
    np.testing.assert_allclose(run.observed["tip"], run.body("rod").point((0.5, 0)), atol=1e-15)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: SYSTEM.coordinate("hinge.slide"), "joint 'hinge' has no coordinate 'slide'"),
        (lambda: SYSTEM.coordinate("hinge.slide"), "hint: write 'hinge.angle'"),
        (
            lambda: SYSTEM.coordinate("ball.spin_x"),
            "'ball' has no coordinate 'spin_x'",
        ),
        (lambda: SYSTEM.rate("ball"), "write 'ball.spin_x' or 'ball.spin_y' or 'ball.spin_z'"),
        (lambda: SYSTEM.rate("door"), "there is no joint 'door'"),
        (lambda: SYSTEM.point("door"), "there is no body 'door'"),
        (lambda: SYSTEM.point("boom", (1, 2)), "a point of body 'boom' must be 3 finite numbers"),
    ],
)
def test_names_that_are_not_there_are_refused(call, says):
    with pytest.raises(ValueError, match=says):
        call()


def test_tangents_of_joint_forces_are_those_of_differences():
    """Of a load that slides along a boom, in the world and in the axes of the joint."""
    v = SYSTEM.consistent(t=0.0, **START)["v"]
    run = lv.integrate(SYSTEM, lv.Spark(3), **RUN, **START, tangents={"v": v})
    size = 1e-5
    nearby = [
        lv.integrate(SYSTEM, lv.Spark(3), **RUN, q=START["q"], v=v * (1 + x)) for x in (size, -size)
    ]
    for joint in ("hinge", "slide", "ball"):
        for frame in ("world", "joint"):
            ends = [x.joint(joint, frame) for x in nearby]
            for what, function in (("force", SYSTEM.joint_force), ("torque", SYSTEM.joint_torque)):
                slope = np.subtract(*(getattr(x, what) for x in ends)) / (2 * size)
                found = run.tangent_of(function(joint, frame))["v"]
                np.testing.assert_allclose(found, slope, rtol=0, atol=1e-7)
    with pytest.raises(ValueError, match="frame must be 'world' or 'joint', not 'body'"):
        SYSTEM.joint_force("hinge", "body")


def test_a_mass_is_fitted_to_the_force_of_a_load_cell():
    """The swing of a rod is the same whatever its mass, which the force in its pin tells."""
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    m.planar_body("rod", mass=lambda p: p.m, inertia=lambda p: p.m / 12, at=(0.5, 0))
    m.revolute("pin", "ground", "rod", at=(0, 0, 0), axis=Z)
    system = m.system(params={"m": 2.5})
    start = m.start(values={"pin": 0.3})
    run = lv.integrate(system, lv.Spark(3), t=(0, 1), h=0.02, **start)
    load = run.joint("pin").force
    assert abs(load[:, 1]).max() > 10
    found = lv.fit(
        system, lv.Spark(3), {"t": run.t, "load": load}, params={"m": 1.0}, h=0.02,
        observe={"load": system.joint_force("pin")}, **start,
    )  # fmt: skip
    assert found.params["m"] == pytest.approx(2.5, rel=1e-9)
    tension = lambda t, q, v, lam, params: lam[0] ** 2 + lam[1] ** 2  # noqa: E731
    slopes = lv.integrate(
        system, lv.Spark(3), t=(0, 1), h=0.02, **start, tangents={"params.m": 1.0}
    ).tangent_of(tension)["params.m"]
    np.testing.assert_allclose(slopes, 2 * (run.lam**2).sum(axis=1) / 2.5, rtol=1e-9)


@pytest.mark.parametrize("method", [lv.Spark(3), lv.LobattoPair(3), lv.HHT(-0.1)])
@pytest.mark.parametrize("times", [{}, {"t_eval": [0.1, 0.234]}, {"states": False}])
def test_a_run_records_forces_in_joints(method, times):
    torque = SYSTEM.joint_torque("ball")
    observe = {
        "load": SYSTEM.joint_force("hinge"),
        "own": lambda t, q, v, lam, params: params.scale * torque(t, q, v, lam),
    }
    call = {"t": (0, 0.5), "steps": 20, **START}
    run = lv.integrate(SYSTEM, method, **call, **times, observe=observe)
    plain = lv.integrate(SYSTEM, method, **call, t_eval=times.get("t_eval", run.t))
    np.testing.assert_allclose(run.observed["load"], plain.joint("hinge").force, atol=1e-9)
    np.testing.assert_allclose(run.observed["own"], 2 * plain.joint("ball").torque, atol=1e-9)


def test_members_record_forces_in_joints_alone_in_lock_step_and_elsewhere():
    starts = [{**START, "v": x * START["v"]} for x in (1.0, 0.5, 0.0)]
    call = {"t": (0, 0.2), "steps": 10, "observe": {"load": SYSTEM.joint_force("slide")}}
    each = [lv.integrate(SYSTEM, lv.Spark(3), **call, **x).observed["load"] for x in starts]
    rows = {name: np.array([x[name] for x in starts]) for name in START}
    for how in ({}, {"states": False}, {"executor": ThreadPoolExecutor(2)}):
        run = lv.ensemble(SYSTEM, lv.Spark(3), **call, **rows, **how)
        np.testing.assert_allclose(run.observed["load"], np.stack(each, axis=1), atol=1e-11)


def test_a_force_in_a_joint_is_recorded_through_bounces_and_contact():
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    m.bar("rod", (0, 0), (1, 0), mass=1.0)
    m.revolute(
        "pin", m.ground, "rod", at=(0, 0), limits=lv.bodies.Limits(-0.2, 0.2, restitution=0.4)
    )
    system = m.system()
    run = lv.integrate(
        system, lv.Spark(3), t=(0, 1.5), h=0.02, **m.start(),
        observe={"load": system.joint_force("pin"), "lam": lambda t, q, v, lam, params: lam},
    )  # fmt: skip
    assert sum(len(x.changes) for x in run.contacts.values()) > 3
    np.testing.assert_allclose(run.observed["load"], run.joint("pin").force, atol=1e-9)
    assert np.array_equal(run.observed["lam"], run.lam)
