"""Bars between two points, and places of two numbers in the plane."""

import numpy as np
import pytest

import liouville as lv

PINS = (0.0, 0.0), (0.1, 0.5), (0.9, 0.9), (1.1, 0.0)
MASSES = {"crank": 1.0, "coupler": 2.0, "rocker": 1.8}


def drawn(m):
    """Hinge the bars of a four-bar by places of two numbers."""
    before = m.ground
    for joint, bar, pin in zip("ABCD", [*MASSES, m.ground], PINS, strict=True):
        m.revolute(joint, before, bar, at=pin)
        before = bar
    return m


def run(m, **more):
    return lv.integrate(
        m.system(more.get("params")), lv.Spark(3), t=(0, 1), h=0.02, **m.start(rates={"A": 3.0})
    )


def by_hand():
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    for k, (name, mass) in enumerate(MASSES.items()):
        along = np.subtract(PINS[k + 1], PINS[k])
        m.planar_body(
            name,
            mass=mass,
            inertia=mass * (along @ along) / 12,
            at=np.add(PINS[k], PINS[k + 1]) / 2,
            angle=np.arctan2(along[1], along[0]),
        )
    before = m.ground
    for joint, bar, pin in zip("ABCD", [*MASSES, m.ground], PINS, strict=True):
        m.revolute(joint, before, bar, at=(*pin, 0))
        before = bar
    return m


def test_a_four_bar_of_bars_moves_as_one_of_bodies_with_their_inertia():
    m, p = lv.bodies.Assembly(gravity=(0, -9.81, 0)), lv.bodies.Assembly(gravity=(0, -9.81, 0))
    for k, (name, mass) in enumerate(MASSES.items()):
        m.bar(name, PINS[k], PINS[k + 1], mass=mass)
        p.bar(name, PINS[k], PINS[k + 1], mass=lambda params, name=name: getattr(params, name))
    wanted = run(by_hand())
    assert np.abs(run(drawn(m)).q - wanted.q).max() < 1e-13
    assert np.abs(run(drawn(p), params=MASSES).q - wanted.q).max() < 1e-13
    tip = wanted.body("crank").point((np.hypot(*PINS[1]) / 2, 0, 0))  # its own x is along it
    assert np.abs(tip[0] - (*PINS[1], 0)).max() < 1e-15


def test_a_round_bar_in_space_swings_as_a_compound_pendulum():
    end, radius, mass, g = np.array([0.3, -0.2, -0.8]), 0.1, 2.0, 9.81
    length = np.linalg.norm(end)
    m = lv.bodies.Assembly(gravity=(0, 0, -g))
    m.bar("rod", (0, 0, 0), end, mass=mass, radius=radius)
    axis = np.cross(end, (0, 0, 1.0))  # it hangs in the plane of its line and of gravity
    m.revolute("pin", m.ground, "rod", at=(0, 0, 0), axis=axis)
    found = lv.integrate(m.system(), lv.Spark(4), t=(0, 1), h=0.01, **m.start())
    inertia = mass * (3 * radius**2 + length**2) / 12 + mass * length**2 / 4
    pendulum = lv.Lagrangian(
        lambda t, q, v, params: inertia * v[0] ** 2 / 2 + mass * g * length / 2 * np.cos(q[0]), q=1
    )
    tilt = np.arccos(-end[2] / length)
    alone = lv.integrate(pendulum, lv.Spark(4), t=(0, 1), h=0.01, q=tilt, v=0.0)
    assert np.abs(np.abs(found.joint("pin").angle) - np.abs(alone.q[:, 0] - tilt)).max() < 1e-11
    path = found.body("rod").point((-length / 2, 0, 0))
    assert np.abs(path).max() < 1e-13  # its first end stays in the pin


def test_springs_forces_and_rods_take_places_of_two_numbers():
    def swing(*height):
        m = lv.bodies.Assembly()
        m.bar("rod", (0, 0), (1, 0), mass=1.0)
        m.revolute("pin", m.ground, "rod", at=(0, 0, *height))
        ends = (0.5, 1, *height), (0.5, 0, *height)
        m.spring("spring", m.ground, "rod", at=ends, stiffness=30.0, rest=0.7)
        m.force("push", "rod", lambda t, x, v, params: [0, x[0], 0], at=(1, 0, *height))
        m.planar_body("bob", mass=1.0, inertia=0.1, at=(2, 0))
        m.distance("thread", "rod", "bob", at=((1, 0, *height), (2, 0, *height)))
        m.fixed("weld", "bob", m.planar_body("tail", mass=1.0, inertia=0.1, at=(3, 0)), at=(3, 0))
        return lv.integrate(m.system(), lv.Spark(3), t=(0, 1), h=0.02, **m.start())

    assert np.array_equal(swing().q, swing(0).q)


def moving(at):
    m = lv.bodies.Assembly(gravity=(0, -9.81, 0))
    m.bar("rod", (0.5, 0), (1, 0), mass=1.0)
    m.revolute("pin", m.ground, "rod", at=at)
    return m


def test_a_place_of_two_numbers_may_depend_on_parameters():
    m = moving(lambda params: (params.a, 0))
    some = lv.integrate(m.system({"a": 0.5}), lv.Spark(3), t=(0, 1), h=0.02, **m.start())
    same = moving((0.5, 0))
    assert np.array_equal(
        some.q, lv.integrate(same.system(), lv.Spark(3), t=(0, 1), h=0.02, **same.start()).q
    )


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda m: m.bar("b", (0, 0), (0, 0), mass=1), "line between the ends of body 'b' has len"),
        (
            lambda m: m.bar("b", (0, 0, 0), (1, 0, 0), mass=1),
            "radius of body 'b' must be positive, not 0\nhint: a bar without radius is planar",
        ),
        (lambda m: m.bar("b", (0, 0), (1, 0), mass=1, radius=-1), "must be positive, not -1$"),
        (lambda m: m.bar("b", (0, 0), (1, 0, 0), mass=1), "second end of body 'b' must be 2 fin"),
        (lambda m: m.bar("b", (0, 0), (1, np.nan), mass=1), "second end of body 'b' must be 2 fin"),
        (lambda m: m.bar("b", (0, 0), (1, 0), mass=0), "mass of body 'b'"),
        (
            lambda m: m.revolute("j", m.bar("b", (0, 0), (1, 0), mass=1), "cube", at=(0, 0)),
            "give three coordinates",
        ),
        (
            lambda m: m.spring(
                "s", m.bar("b", (0, 0), (1, 0), mass=1), "cube", at=(0, 0), stiffness=1
            ),
            "must be two points",
        ),
    ],
)
def test_bars_and_places_that_are_none_are_refused(call, sentence):
    m = lv.bodies.Assembly()
    m.body("cube", mass=1.0, inertia=(1, 1, 1), at=(0, 0, 0))
    with pytest.raises(ValueError, match=sentence):
        call(m)


def test_motions_name_themselves():
    m = moving((0.5, 0))
    found = lv.integrate(m.system(), lv.Spark(3), t=(0, 1), h=0.02, **m.start())
    assert repr(found.joint("pin")) == "<motion of joint 'pin': 51 records, coordinates: angle>"
    assert repr(found.body("rod")) == "<motion of body 'rod': 51 records>"
