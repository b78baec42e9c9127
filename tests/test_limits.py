"""Limits of joints: stops that hit, hold and let go, beside closed forms and other coordinates."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.bodies import Limits

G = 9.81


def pendulum(limits, body="spatial", **more):
    """Return a bob on a hinge, one below it as drawn."""
    m = lv.bodies.Assembly(gravity=(0, -G, 0))
    if body == "spatial":
        bob = m.body("bob", mass=1.0, inertia=(0.11, 0.02, 0.1), at=(0, -1, 0))
    else:
        bob = m.planar_body("bob", mass=1.0, inertia=0.1, at=(0, -1))
    m.revolute("A", m.ground, bob, at=(0, 0, 0), limits=limits, **more)
    return m


def moved(m, t, h=0.02, params=None, **start):
    own = m.start(**start, params=params)
    return lv.integrate(m.system(), lv.Spark(3), t=(0, t), h=h, params=params, **own)


@pytest.mark.parametrize("body", ["spatial", "planar"])
def test_a_pendulum_bounces_on_a_stop_and_rests_there(body):
    run = moved(pendulum(Limits(-0.3, -0.1, restitution=0.5), body), 3, values={"A": -0.3})
    stop = run.contacts["A.angle.high"]
    plain = lv.Lagrangian(
        lambda t, q, v, params: 1.1 * v[0] ** 2 / 2 + G * ca.cos(q[0]),
        q=1,
        contacts={"stop": lv.Contact(lambda t, q, params: -0.1 - q[0], restitution=0.5)},
    )
    own = lv.integrate(plain, lv.Spark(3), t=(0, 3), h=0.02, q=[-0.3], v=[0.0])
    changes = own.contacts["stop"].changes
    # bounces die down at roundoff of the gap, which that of more coordinates is
    assert len(stop.changes) > len(changes) - 3 > 15
    for one, other in zip(stop.changes[:10], changes, strict=False):
        assert one.t == pytest.approx(other.t, abs=1e-12)
        assert one.normal == pytest.approx(other.normal, abs=1e-11)
    assert stop.mode[-1].name == "CLOSED"
    assert stop.changes[-1].rest == pytest.approx(changes[-1].rest, abs=1e-10)
    assert stop.normal[-1] == pytest.approx(G * np.sin(0.1), abs=1e-13)
    np.testing.assert_allclose(run.joint("A").force[-1], [0, G, 0], atol=1e-12)
    assert run.joint("A").angle[-1] == pytest.approx(-0.1, abs=1e-15)
    assert run.contacts["A.angle.low"].changes == ()


def test_a_slide_falls_on_its_stop_and_stays():
    m = lv.bodies.Assembly(gravity=(0, 0, -G))
    carriage = m.body("carriage", mass=2.0, inertia=(0.1, 0.1, 0.1))
    m.prismatic("P", m.ground, carriage, axis=(0, 0, 1), limits=(-1, None))
    run = moved(m, 1)
    (hit,) = run.contacts["P.slide.low"].changes
    assert hit.t == pytest.approx(np.sqrt(2 / G), abs=1e-14)
    assert hit.normal == pytest.approx(2 * np.sqrt(2 * G), abs=1e-13)
    assert run.contacts["P.slide.low"].normal[-1] == pytest.approx(2 * G, abs=1e-13)
    assert abs(run.body("carriage").position[-1] - [0, 0, -1]).max() < 1e-15
    assert abs(run.joint("P").force).max() < 1e-14


def test_limits_of_several_coordinates_are_each_their_own():
    m = lv.bodies.Assembly(gravity=(0, -G, 0))
    puck = m.planar_body("puck", mass=1.0, inertia=0.1, at=(0, 1))
    walls = (None, Limits(-0.5, 0.5, restitution=1), (-0.5, None))
    m.planar("P", m.ground, puck, at=(0, 1, 0), normal=(0, 0, 1), limits=walls)
    run = moved(m, 3, rates={"P": (1.0, 0.8, 0.0)})
    hits = [c.t for c in run.contacts["P.slide_x.high"].changes]
    np.testing.assert_allclose(hits, [0.5 / 0.8, 2.5 / 0.8][: len(hits)], atol=1e-12)
    assert run.contacts["P.slide_x.low"].changes[0].t == pytest.approx(1.5 / 0.8, abs=1e-12)
    assert "P.angle.low" not in run.contacts
    assert run.contacts["P.slide_y.low"].mode[-1].name == "CLOSED"
    np.testing.assert_allclose(run.joint("P").rates["angle"], 1.0, atol=1e-13)
    arm = lv.bodies.Assembly(gravity=(0, 0, -G))
    link = arm.body("link", mass=2.0, inertia=(0.2, 0.2, 0.02), at=(0, 0, -0.5))
    arm.compound(
        "hip",
        arm.ground,
        link,
        [("turn", (1, 0, 0), (0, 0, 0)), ("slide", (0, 0, 1))],
        names=("roll", "reach"),
        limits=(None, (-0.2, None)),
    )
    down = moved(arm, 0.5)
    assert down.contacts["hip.reach.low"].changes[0].t == pytest.approx(np.sqrt(0.4 / G), abs=1e-13)


@pytest.mark.parametrize("body", ["spatial", "planar"])
def test_a_stop_beyond_a_turn_is_met_once_the_turn_is_done(body):
    run = moved(pendulum(Limits(high=7.0), body), 1, rates={"A": 30.0}, h=0.01)
    assert run.contacts["A.angle.high"].mode[-1].name != "OPEN" or run.joint("A").angle.max() <= 7
    hit = run.contacts["A.angle.high"].changes[0]
    assert run.joint("A").angle.max() == pytest.approx(7.0, abs=1e-13)
    before = np.sqrt(30.0**2 - 2 * G * (1 - np.cos(7.0)) / 1.1)
    assert hit.normal == pytest.approx(1.1 * before, rel=1e-9)


def four_bar(spatial, limits):
    m = lv.bodies.Assembly(gravity=(0, -G, 0))
    corners = {"crank": ((0, 0), (0, 0.5)), "rocker": ((1.1, 0), (0.9, 0.9))}
    corners["coupler"] = (0, 0.5), (0.9, 0.9)
    for name, (a, b) in corners.items():
        length, angle = np.hypot(*np.subtract(b, a)), np.arctan2(*np.subtract(b, a)[::-1])
        middle, inertia = np.add(a, b) / 2, 2 * length**2 / 12
        if spatial:
            turn = np.cos(angle / 2), 0, 0, np.sin(angle / 2)
            moments = 0.02, inertia, inertia
            m.body(name, mass=2.0, inertia=moments, at=(*middle, 0), rotation=turn)
        else:
            m.planar_body(name, mass=2.0, inertia=inertia, at=middle, angle=angle)
    m.revolute("A", m.ground, "crank", at=(0, 0, 0), limits=limits)
    m.revolute("B", "crank", "coupler", at=(0, 0.5, 0))
    m.revolute("C", "coupler", "rocker", at=(0.9, 0.9, 0))
    m.revolute("D", m.ground, "rocker", at=(1.1, 0, 0))
    return m


def test_a_redundant_loop_in_space_stops_as_the_same_one_in_the_plane():
    """At the stop nothing of it moves, and its joints hold three times more than they need."""
    limits = Limits(-0.5, 0.5, restitution=0.3)
    space, plane = (moved(four_bar(x, limits), 3, rates={"A": 3.0}) for x in (True, False))
    own, other = (run.contacts["A.angle.high"] for run in (space, plane))
    times = [[c.t for c in x.changes] for x in (own, other)]
    np.testing.assert_allclose(times[0][:8], times[1][:8], atol=1e-11)
    assert own.mode[-1].name == other.mode[-1].name == "CLOSED"
    assert own.normal[-1] == pytest.approx(other.normal[-1], abs=1e-10)
    force = [run.joint("A").force[-1] for run in (space, plane)]
    np.testing.assert_allclose(force[0], force[1], atol=1e-10)


def test_stops_may_depend_on_parameters():
    m = pendulum((lambda params: -params.a, None))
    system = m.system(params={"a": 0.3})
    start = m.start(values={"A": 0.5})
    for a in (0.3, 0.1):
        run = lv.integrate(system, lv.Spark(3), t=(0, 1), h=0.02, params={"a": a}, **start)
        hit = run.contacts["A.angle.low"].changes[0]
        assert run.joint("A").angle.min() == pytest.approx(-a, abs=1e-14)
        assert hit.normal == pytest.approx(
            np.sqrt(2 * 1.1 * G * (np.cos(a) - np.cos(0.5))), rel=1e-10
        )


def test_impacts_may_be_those_of_newton():
    m = pendulum(Limits(-0.1, 0.1, restitution=0.5))
    for impacts in ("poisson", "newton"):
        run = lv.integrate(
            m.system(impacts=impacts), lv.Spark(3), t=(0, 1), h=0.02, **m.start(rates={"A": 1.0})
        )
        hits = [c.normal for c in run.contacts["A.angle.high"].changes if c.kind == "hit"]
        assert hits
    law = "impacts must be 'poisson', 'newton' or 'sequence', not 'moreau'"
    with pytest.raises(ValueError, match=law):
        m.system(impacts="moreau")


def turned_and_slid():
    m = lv.bodies.Assembly()
    m.body("b", mass=1.0, inertia=(1, 1, 1))
    m.cylindrical("C", "ground", "b", at=(0, 0, 0), axis=(0, 0, 1), limits=(0, 1))


def rubbed():
    dry = lv.bodies.Coulomb(mu=0.2, v_s=1e-3, radius=0.01)
    return pendulum((-1, 1), friction=dry).system()


REFUSED = {
    "low of limits must be a finite number, not 'a'": lambda: pendulum(("a", 1)),
    "high of limits must be above low = 1, not 0": lambda: pendulum((1, 0)),
    "high of limits must be above low = 1, not 1": lambda: pendulum((1, 1)),
    "limits= of joint 'A' must be .*, not 3": lambda: pendulum(3),
    r"limits= of joint 'A' must be .*, not \(1, 2, 3\)": lambda: pendulum((1, 2, 3)),
    "limits have neither low nor high": lambda: pendulum((None, None)),
    "limits= of joint 'A' must be .*, not 'ab'": lambda: pendulum("ab"),
    "restitution must be from 0 to 1, not 2": lambda: Limits(0, 1, restitution=2),
    "restitution must be a number, not None": lambda: Limits(0, 1, restitution=None),
    "'angle' of joint 'A' has both limits= and motion=": lambda: pendulum(
        (0, 1), motion=lambda t, params: t
    ),
    r"one entry for each of its coordinates angle, slide, not \(0, 1\)": turned_and_slid,
    "friction in joint 'A' knows nothing of what contacts press": rubbed,
    "contact 'A.angle.high' penetrates by 0.3 at the start": lambda: moved(
        pendulum((-0.3, 0.2)), 1, values={"A": 0.5}
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_are_no_limits_is_said(words):
    with pytest.raises((TypeError, ValueError), match=words):
        REFUSED[words]()
