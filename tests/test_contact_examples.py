"""Contacts of the gallery and of machines, beside closed forms and others' numbers."""

from pathlib import Path

import numpy as np
import pytest
from ordinary import solved

import liouville as lv
from liouville.bodies import Assembly, Capsule, Dry, Plane, Sphere

G = 9.81
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


@pytest.fixture
def page(monkeypatch):
    """Return a function that runs a page of the gallery, and returns the names that it defines."""
    plt = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))

    def run(name):
        path, scope = EXAMPLES / f"{name}.py", {}
        with plt.rc_context():
            exec(compile(path.read_text(encoding="utf-8"), path, "exec"), scope)
        return scope

    return run


def test_a_walker_has_the_published_cycle_and_law_of_small_slopes(page):
    """Bhounsule's program passivewalker; table 1 of Garcia, Chatterjee, Ruina, Coleman (1998)."""
    found = page("walker")
    off = np.abs(found["angles"] - 0.200161072169750)
    assert off[-1] < 1e-8
    assert (off[-5:].max() / off[:5].max()) ** (1 / (len(off) - 5)) == pytest.approx(0.59, abs=0.03)
    root = 0.1
    angle, v = 0.970956 * root, -1.045203 * 0.970956 * root
    run = lv.integrate(
        found["system"],
        lv.Spark(4),
        t=(0, 120),
        h=0.02,
        q=[-np.sin(angle), np.cos(angle), angle, -angle],
        v=[-np.cos(angle) * v, -np.sin(angle) * v, v, np.cos(2 * angle) * v],
        params={"slope": root**3, "step": 2 * np.sin(angle), "m": 1e-6},
    )
    # a foot of a millionth of the hip may hit once more at the same time, by roundoff
    lands = np.unique([x.t for x in run.contacts["left"].changes if x.kind == "hit"])
    assert run(lands[-1]).q[2] / root == pytest.approx(0.970956, abs=0.2 * root**2)
    period = 3.812092 + 1.579129 * root**2
    assert np.diff(lands)[-1] / 2 == pytest.approx(period, abs=2 * root**4)


def test_blocks_hit_as_often_as_pi_says_and_discs_share_their_energy(page, capsys):
    """Galperin (2003); the mean of x^2 with a probability (1 - x)^9 above x is 2/110."""
    found = page("billiards")
    said = capsys.readouterr().out.splitlines()
    assert said == ["1 to 1: 3 hits", "1 to 100: 31 hits", "1 to 10000: 314 hits"]
    for run in (*found["runs"].values(), found["run"]):
        assert np.max(run.invariant_drift("energy")) < 1e-12
    assert np.mean(found["share"] ** 2) == pytest.approx(2 / 110, rel=0.2)  # five deviations


def test_thrown_balls_roll_when_and_where_closed_forms_say(page, capsys):
    page("bowling")
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 3
    for line in said:
        when, speed = line.split("off by ")[1].split(" s, ")
        assert float(when) < 2e-9
        assert float(speed.removesuffix(" m/s")) < 2e-9


def test_a_coin_slides_by_its_reduced_equations_and_rolls_as_eulers_disc_does(page):
    """The normal force is that which keeps the edge on the table; I = m a^2 / 4 and m a^2 / 2."""
    a, across, axial, mu = 0.012, 0.012**2 / 4, 0.012**2 / 2, 0.2

    def rates(t, y):
        heading, tilt, vx, vy, spin, falls, turn = y
        c, s, cos, sin = np.cos(heading), np.sin(heading), np.cos(tilt), np.sin(tilt)
        slip = np.array([c * vx + s * vy + a * turn, c * vy - s * vx + a * sin * falls])
        u = slip / np.hypot(*slip)
        arm = a * (cos + mu * sin * u[1])
        pulls = (across * spin * cos - axial * turn) * spin * sin - arm * (G - a * sin * falls**2)
        tilts = pulls / (across + arm * a * cos)
        force = -mu * (G + a * (cos * tilts - sin * falls**2)) * u
        turns = (axial * turn / across - 2 * spin * cos) * falls / sin
        fx, fy = c * force[0] - s * force[1], s * force[0] + c * force[1]
        return np.array([spin, falls, fx, fy, turns, tilts, a * force[0] / axial])

    found = page("coin")
    coin, start = found["coin"], found["start"]
    v, tilt = start["v"], start["q"][4]
    run = lv.integrate(coin, lv.Spark(4), t=(0, 0.12), h=0.001, **start)
    end = solved(rates, [0, 0.12], [0, tilt, *v[:2], v[3], 0, v[3] * np.cos(tilt)])[-1]
    np.testing.assert_allclose(run.q[-1, 3:5], end[:2], atol=1e-9)
    np.testing.assert_allclose(run.v[-1, :2], end[2:4], atol=1e-10)
    np.testing.assert_allclose(run.v[-1, 3:5], end[4:6], atol=1e-8)
    rolls = found["run"].sel(time=slice(0.14, 1.5)).invariants["energy"]
    assert np.ptp(rolls) < 1e-12 * np.abs(rolls).max()
    # about a centre at rest it rolls with spin^2 = 4 g / (a sin tilt)
    spin = np.sqrt(4 * G / (a * np.sin(0.3)))
    start = {
        "q": [0, 0, a * np.sin(0.3), 0, 0.3, 0],
        "v": [0, 0, 0, spin, 0, -spin * np.cos(0.3)],
    }
    run = lv.integrate(coin, lv.Spark(4), t=(0, 0.2), h=0.001, **start)
    assert {mode.name for mode in run.contacts["table"].mode} == {"STICK"}
    np.testing.assert_allclose(run.q[:, 4], 0.3, atol=1e-12)
    np.testing.assert_allclose(run.q[:, :2], 0, atol=1e-13)


def test_a_clock_loses_in_each_beat_what_its_weight_gives(page):
    found = page("clock")
    given, in_hits, in_air = (np.diff(x[found["at"]]) for x in found["parts"].values())
    assert given[-1] == pytest.approx(2e-3 * np.pi / 6, rel=1e-4)
    assert in_hits[-1] + in_air[-1] == pytest.approx(given[-1], rel=2e-3)  # it swings up still
    assert np.abs(found["balance"].defect).max() < 1e-5 * given.sum()
    swings = [np.abs(run.joint("pivot").angle[run.t > 28]).max() for run in found["runs"].values()]
    assert swings[0] == pytest.approx(swings[1], rel=0.05)


def test_an_escapement_of_a_rack_ticks_when_its_closed_form_says():
    """The pins of a rack push a foliot on faces of 45 degrees to and fro, d beyond both ways.

    A pin and the foliot have one speed v and the acceleration F / (M + m), until the pin escapes.
    The rack alone falls on by 0.5 - 2 d, less what the foliot comes to meet it, and hits.
    """
    push, rack_mass, mass, d, v = 2.0, 0.5, 1.5, 0.1, 0.5
    m = Assembly()
    rack = m.planar_body("rack", mass=rack_mass, inertia=1.0, at=(1, 1))
    foliot = m.planar_body("foliot", mass=mass, inertia=1.0, at=(1, 1))
    m.prismatic("way", "ground", rack, axis=(1, 0, 0), force=lambda t, x, v, params: push)
    m.prismatic("guide", "ground", foliot, axis=(0, 1, 0))
    off = 0.03 / np.sqrt(2)  # by both radii
    for name, x, side in (("up", 0.0, 1), ("down", 0.5, -1)):
        tip = np.array([x + d + off, side * (off - d)])
        face = Capsule(foliot, [tip, tip + np.array([-1, side])], 0.01)
        for k in range(4):
            m.contact(f"{name} {k}", Sphere(rack, 0.02, at=(-k, 0)), face)
    start = m.start(rates={"way": v, "guide": v})
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 6), rtol=1e-10, **start)
    hits = [x for record in run.contacts.values() for x in record.changes if x.kind == "hit"]
    slow, fast = push / (rack_mass + mass), push / rack_mass
    t, v, way = 0.0, v, d
    for hit in sorted(hits, key=lambda x: x.t):
        v, before = np.sqrt(v**2 + 2 * slow * way), v
        t += (v - before) / slow
        falls = (np.sqrt(4 * v**2 + 2 * fast * (0.5 - 2 * d)) - 2 * v) / fast
        t, way, hits_with = t + falls, 2 * d + v * falls, v + fast * falls
        v = (rack_mass * hits_with - mass * v) / (rack_mass + mass)
        assert hit.t == pytest.approx(t, abs=1e-11)
        assert hit.normal == pytest.approx(np.sqrt(2) * rack_mass * (hits_with - v), abs=1e-11)
    assert len(hits) == 5


@pytest.mark.parametrize("way", [1, -1])
def test_a_shoe_that_leads_brakes_harder_than_one_that_trails(way):
    """About its pivot the shoe has the moments of the push, the normal force and friction."""
    m = Assembly()
    drum = m.planar_body("drum", mass=5.0, inertia=0.1, at=(0, 0))
    m.revolute("axle", "ground", drum, at=(0, 0))
    lever = m.planar_body("lever", mass=0.5, inertia=0.01, at=(-0.25, 0))
    m.revolute("pivot", "ground", lever, at=(-0.27, -0.2))
    m.contact("shoe", Sphere(lever, 0.03, at=(-0.23, 0)), Sphere(drum, 0.2), friction=0.4)
    m.force("push", lever, lambda t, x, v, params: (50.0, 0, 0), at=(-0.25, 0.2))
    start = m.start(rates={"axle": 10.0 * way})
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 1), h=0.01, **start)
    normal = 50 * 0.4 / (0.2 - 0.4 * 0.07 * way)
    shoe = run.contacts["shoe"]
    assert shoe.normal[1] == pytest.approx(normal, rel=1e-12)
    assert shoe.changes[-1].kind == "stick"
    assert shoe.changes[-1].t == pytest.approx(10 * 0.1 / (0.2 * 0.4 * normal), rel=1e-12)


def test_a_clutch_brings_both_sides_to_one_speed():
    m = Assembly()
    for name, inertia in (("engine", 0.3), ("wheels", 0.6)):
        body = m.planar_body(name, mass=1.0, inertia=inertia, at=(0, 0))
        m.revolute(f"axle of {name}", "ground", body, at=(0, 0))
    m.revolute("clutch", "engine", "wheels", at=(0, 0), friction=Dry(4.0, 5.0))
    start = m.start(rates={"axle of engine": 10.0})
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 1), h=0.05, **start)
    (change,) = run.contacts["clutch.angle.friction"].changes
    assert change.kind == "stick"
    assert change.t == pytest.approx(10 / (4 / 0.3 + 4 / 0.6), rel=1e-12)
    for name in ("engine", "wheels"):
        assert run.joint(f"axle of {name}").rate[-1] == pytest.approx(10 / 3, rel=1e-12)


def test_a_front_wheel_bears_less_as_the_rear_one_drives_and_lifts_at_last():
    """Wheels without mass: N = m (g b - a h) / l of distances b, l and a centre at the height h."""
    for torque, bears in ((300.0, 200 * (G * 0.6 - 5.0 * 0.6) / 1.4), (700.0, 0.0)):
        m = Assembly(gravity=(0, -G, 0))
        frame = m.planar_body("frame", mass=200.0, inertia=30.0, at=(0.6, 0.6))
        m.free("flight", frame)
        for name, x, drive in (("rear", 0.0, torque), ("front", 1.4, 0.0)):
            wheel = m.planar_body(name, mass=1e-6, inertia=1e-9, at=(x, 0.3))
            motor = {"torque": lambda t, angle, rate, params, drive=drive: -drive}
            m.revolute(f"axle {name}", frame, wheel, at=(x, 0.3), **motor)
            road = Plane("ground", normal=(0, 1))
            m.contact(f"tyre {name}", Sphere(wheel, 0.3), road, friction=1.5)
        run = lv.integrate(m.system(), lv.Spark(3), t=(0, 0.1), h=0.01, **m.start())
        assert run.contacts["tyre front"].normal[1] == pytest.approx(bears, rel=1e-6)
        assert run.contacts["tyre rear"].mode[-1].name == "STICK"
        assert (run.contacts["tyre front"].gap[-1] > 1e-4) == (torque == 700)


def test_a_stone_on_a_rope_goes_slack_flies_and_is_caught_again():
    """From below with v^2 = 3.5 g l it goes slack at 120 degrees and flies for 4 v sin 120 / g."""
    m = Assembly(gravity=(0, -G, 0))
    stone = m.planar_body("stone", mass=1.0, inertia=0.01, at=(0, -1))
    m.free("flight", stone)
    m.rope("rope", "ground", stone, at=((0, 0), (0, -1)), length=1.0)
    rates = {"flight": (np.sqrt(3.5 * G), None, None, None, None, None)}
    run = lv.integrate(m.system(), lv.Spark(4), t=(0, 1.5), h=0.01, **m.start(rates=rates))
    close, leave, hit = run.contacts["rope"].changes
    assert (close.kind, leave.kind, hit.kind) == ("close", "leave", "hit")
    x, y = run(leave.t).q[:2]
    assert np.degrees(np.arctan2(x, -y)) == pytest.approx(120, abs=1e-9)
    flight = 4 * np.sqrt(G / 2) * np.sin(2 * np.pi / 3) / G
    assert hit.t - leave.t == pytest.approx(flight, abs=1e-10)
