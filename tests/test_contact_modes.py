"""Contacts that last and friction that sticks, beside closed forms."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._runs.contacts import Mode
from liouville._runs.contacts.complementarity import lemke
from liouville._runs.contacts.law import impact, solve

G = 9.81
METHODS = [lv.Spark(1), lv.Spark(2), lv.Spark(4), lv.LobattoPair(3)]


def block(friction=0.5, static=None, force=None, slope=0.0, params=None):
    """Return a block on a slope, whose floor is y = 0."""
    floor = lv.Contact(
        lambda t, q, params: q[1],
        friction=friction,
        static_friction=static,
        slip=lambda t, q, v, params: v[0],
    )
    down, across = G * np.sin(slope), G * np.cos(slope)
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 + down * q[0] - across * q[1],
        q=("x", "y"),
        force=force,
        contacts={"floor": floor},
    )


def ball(restitution, ground=0.0):
    floor = lv.Contact(lambda t, q, params: q[0] - ground, restitution=restitution)
    return lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - G * q[0], q=("y",), contacts={"ground": floor}
    )


def belt():
    """Return a block on a spring and on a belt that moves at 0.5."""
    contact = lv.Contact(
        lambda t, q, params: q[1],
        friction=0.2,
        static_friction=0.3,
        slip=lambda t, q, v, params: v[0] - 0.5,
    )
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - q[0] ** 2 / 2 - G * q[1],
        q=2,
        contacts={"belt": contact},
    )


BELT_PERIOD = 2 * (np.pi - np.arctan(0.2 * G)) + 0.4 * G


def tilted(friction, force=None, width=0.5, height=0.3, restitution=0.0):
    """Return a box in the plane, on two corners."""
    inertia = (width**2 + height**2) / 3

    def corner(q, side):
        c, s = ca.cos(q[2]), ca.sin(q[2])
        return q[0] + side * c * width + s * height, q[1] + side * s * width - c * height

    def slip(q, v, side):
        return v[0] + (-side * ca.sin(q[2]) * width + ca.cos(q[2]) * height) * v[2]

    contacts = {
        name: lv.Contact(
            lambda t, q, params, side=side: corner(q, side)[1],
            restitution=restitution,
            friction=friction,
            slip=lambda t, q, v, params, side=side: slip(q, v, side),
        )
        for name, side in (("left", -1), ("right", 1))
    }
    return lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2 + inertia * v[2] ** 2) / 2 - G * q[1],
        q=("x", "y", "angle"),
        force=force,
        contacts=contacts,
    )


def kinds(run, name):
    return [change.kind for change in run.contacts[name].changes]


def obeys(run, friction, static=None):
    """Hold all records to the laws of contact, by the records themselves."""
    static = friction if static is None else static
    for record in run.contacts.values():
        size = max(1.0, abs(run.q).max())
        strong = max(1.0, abs(record.normal).max())
        assert record.gap.min() > -1e-13 * size
        assert record.normal.min() > -1e-12 * strong
        assert abs(record.gap * record.normal).max() < 1e-12 * strong * size
        assert (abs(record.friction) <= static * record.normal + 1e-11 * strong).all()
        slips = [mode.sign for mode in record.mode]
        wrong = record.friction + friction * np.array(slips) * record.normal
        assert abs(wrong[np.array(slips) != 0]).max(initial=0.0) < 1e-12 * strong
    rise = np.diff(run.invariants["energy"])
    assert rise.max(initial=0.0) < 1e-9 * abs(run.invariants["energy"]).max()


@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize("x", [0.0, 1.0])
def test_a_block_slides_to_rest_and_stays(method, x):
    run = lv.integrate(block(), method, t=(0, 1), h=0.1, q=[x, 0], v=[2, 0])
    stop = 2 / (0.5 * G)
    assert run.q[-1, 0] - x == pytest.approx(stop, abs=1e-14)
    assert kinds(run, "floor") == ["close", "stick"]
    assert run.contacts["floor"].changes[-1].t == pytest.approx(stop, abs=1e-14)
    assert run.contacts["floor"].mode[-1] is Mode.STICK
    assert run.contacts["floor"].mode[0].name == "SLIP_UP"
    obeys(run, 0.5)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_block_on_a_slope_does_not_creep(method):
    run = lv.integrate(block(slope=0.4), method, t=(0, 100), h=0.5, q=[1, 0], v=[0, 0])
    assert abs(run.q - [1, 0]).max() < 1e-15
    assert run.contacts["floor"].friction[-1] == pytest.approx(-G * np.sin(0.4), abs=1e-13)
    slides = lv.integrate(block(0.3, slope=0.4), method, t=(0, 2), h=0.1, q=[0, 0], v=[0, 0])
    pull = G * (np.sin(0.4) - 0.3 * np.cos(0.4))
    assert slides.q[-1, 0] == pytest.approx(2 * pull, abs=1e-13)


def test_a_pull_that_grows_tears_at_the_static_friction():
    system = block(0.3, 0.5, force=lambda t, q, v, params: [t, 0])
    run = lv.integrate(system, lv.Spark(2), t=(0, 8), h=0.1, q=[0, 0], v=[0, 0])
    tear, after = 0.5 * G, 8 - 0.5 * G
    assert run.contacts["floor"].changes[-1].t == pytest.approx(tear, abs=1e-13)
    assert run.q[-1, 0] == pytest.approx(after**3 / 6 + 0.2 * G * after**2 / 2, abs=1e-12)
    assert abs(run.q[run.t < tear, 0]).max() < 1e-30


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(3)], ids=repr)
def test_bounces_die_down_where_the_series_says(method, restitution):
    run = lv.integrate(ball(restitution), method, t=(0, 5), h=0.1, q=[1.0], v=[0.0])
    fall = np.sqrt(2 / G)
    rest = fall * (1 + 2 * restitution / (1 - restitution))
    closing = run.contacts["ground"].changes[-1]
    assert closing.kind == "close"
    assert closing.rest == pytest.approx(rest, abs=1e-12)
    hits = [change.t for change in run.contacts["ground"].changes[:-1]]
    flights = np.diff(hits[:8])
    np.testing.assert_allclose(flights[1:] / flights[:-1], restitution, rtol=1e-9)
    assert abs(run.q[-1, 0]) < 1e-15
    assert run.contacts["ground"].gap.min() > -1e-15


def test_an_elastic_ball_keeps_its_energy_and_a_plastic_one_stays():
    run = lv.integrate(ball(1.0), lv.Spark(2), t=(0, 20), h=0.1, q=[1.0], v=[0.0])
    assert run.invariant_drift("energy").max() < 1e-12
    assert len(run.contacts["ground"].changes) == 22
    dead = lv.integrate(ball(0.0, 1.0), lv.Spark(2), t=(0, 1), h=0.1, q=[2.0], v=[0.0])
    assert kinds(dead, "ground") == ["hit"]
    assert (dead.q[-1], dead.v[-1]) == (1.0, 0.0)
    assert dead.contacts["ground"].changes[0].normal == pytest.approx(np.sqrt(2 * G), abs=1e-14)


def test_a_belt_makes_a_block_stick_and_slip():
    """The cycle: stuck for 2 (mu_s - mu) g / v, slipping with the spring until it is as fast."""
    run = lv.integrate(belt(), lv.Spark(4), t=(0, 200), h=0.1, q=[0, 0], v=[0.5, 0])
    torn = [change.t for change in run.contacts["belt"].changes if change.kind == "slip"]
    assert torn[0] == pytest.approx(0.3 * G / 0.5, abs=1e-14)
    np.testing.assert_allclose(np.diff(torn), BELT_PERIOD, rtol=0, atol=1e-11)
    assert len(torn) == 25
    record = run.contacts["belt"]
    stuck = np.array([mode is Mode.STICK for mode in record.mode])
    assert abs(record.slip[stuck]).max() < 1e-15


def cradle(balls, restitution=1.0, impacts="poisson"):
    """Return balls of mass 1 in a row, which touch at distance 1."""
    gaps = {
        f"{k}": lv.Contact(lambda t, q, params, k=k: q[k + 1] - q[k] - 1, restitution=restitution)
        for k in range(balls - 1)
    }
    kinetic = lambda t, q, v, params: ca.sumsqr(v) / 2  # noqa: E731
    return lv.Lagrangian(kinetic, q=balls, contacts=gaps, impacts=impacts)


def test_a_cradle_of_balls_that_touch_is_symmetric():
    run = lv.integrate(cradle(3), lv.Spark(2), t=(0, 2), h=0.1, q=[-1, 1, 2], v=[1, 0, 0])
    np.testing.assert_allclose(run.v[-1], [-1 / 3, 2 / 3, 2 / 3], rtol=0, atol=1e-15)


@pytest.mark.parametrize("method", [*METHODS, lv.HHT(-0.05)], ids=repr)
@pytest.mark.parametrize("steps", [{"h": 0.1}, {"rtol": 1e-8}], ids=str)
def test_a_cradle_by_a_sequence_of_hits_throws_as_many_balls_as_come(method, steps):
    row = cradle(5, impacts="sequence")
    for come in range(1, 5):
        q = np.arange(5.0)
        q[:come] -= 1
        run = lv.integrate(row, method, t=(0, 2), q=q, v=1.0 * (np.arange(5) < come), **steps)
        np.testing.assert_allclose(run.v[-1], np.arange(5) >= 5 - come, rtol=0, atol=1e-13)
        wanted = np.arange(5.0)
        wanted[-come:] += 1
        np.testing.assert_allclose(run.q[-1], wanted, rtol=0, atol=1e-12)
        assert max(run.invariant_drift("energy")) < 1e-14


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_a_sequence_of_hits_is_that_of_balls_that_are_a_bit_apart(e):
    """With no restitution it ends where all have the same share."""
    row = cradle(3, e, "sequence")
    run = lv.integrate(row, lv.Spark(2), t=(0, 2), h=0.1, q=[-1, 1, 2], v=[1, 0, 0])
    v = np.array([1.0, 0, 0])
    while (nears := v[:-1] - v[1:]).max() > 1e-14:
        k = nears.argmax()
        v[k : k + 2] += (1 + e) / 2 * nears[k] * np.array([-1, 1])
    np.testing.assert_allclose(run.v[-1], v, rtol=0, atol=1e-12)
    assert e or np.abs(v - 1 / 3).max() < 1e-13


@pytest.mark.parametrize("e", [0.0, 0.3])
def test_a_sequence_of_hits_without_end_ends_where_its_rates_die_down(e):
    """A light ball between heavy ones, which hit it in turn."""
    masses = 100.0, 1.0, 1000.0
    gaps = {
        f"{k}": lv.Contact(lambda t, q, params, k=k: q[k + 1] - q[k] - 1, restitution=e)
        for k in range(2)
    }
    kinetic = lambda t, q, v, params: sum(m * v[k] ** 2 / 2 for k, m in enumerate(masses))  # noqa: E731
    row = lv.Lagrangian(kinetic, q=3, contacts=gaps, impacts="sequence")
    run = lv.integrate(row, lv.Spark(2), t=(0, 2), h=0.1, q=[-1, 1, 2], v=[1, 0, 0])
    v = np.array([1.0, 0, 0])
    while (nears := v[:-1] - v[1:]).max() > 1e-14:
        k = nears.argmax()
        share = np.array([-masses[k + 1], masses[k]]) / (masses[k] + masses[k + 1])
        v[k : k + 2] += (1 + e) * nears[k] * share
    np.testing.assert_allclose(run.v[-1], v, rtol=0, atol=1e-12)
    assert np.ptp(v) < 1e-12
    said = "100 hits of '0' and '1' in turn at t = 1 were ended by one without restitution"
    assert run.message == (said if e else "")


def test_a_law_of_impacts_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match="impacts must be 'poisson', 'newton' or 'sequence', not"):
        cradle(2, impacts="moreau")


@pytest.mark.parametrize("method", [lv.Spark(3), lv.LobattoPair(3)], ids=repr)
def test_a_box_on_two_corners_sticks_slides_and_tips(method):
    """Two corners that stick are four rows of rank three: their forces are a linear program."""
    run = lv.integrate(
        tilted(0.4, lambda t, q, v, params: [t, 0, 0]), method, t=(0, 6), h=0.2, q=[0, 0.3, 0],
        v=[0, 0, 0],
    )  # fmt: skip
    slides, after = 0.4 * G, 6 - 0.4 * G
    assert run.contacts["left"].changes[-1].t == pytest.approx(slides, abs=1e-12)
    assert {mode.name for record in run.contacts.values() for mode in record.mode[-3:]} == {
        "SLIP_UP"
    }
    assert run.q[-1, 0] == pytest.approx(after**3 / 6, abs=1e-11)
    assert abs(run.q[run.t < slides] - [0, 0.3, 0]).max() < 1e-15
    obeys(lv.integrate(tilted(0.4), method, t=(0, 1), h=0.1, q=[0, 0.3, 0], v=[1, 0, 0]), 0.4)
    tips = lv.integrate(
        tilted(3.0, lambda t, q, v, params: [t, 0, 0]), method, t=(0, 17), h=0.2, q=[0, 0.3, 0],
        v=[0, 0, 0],
    )  # fmt: skip
    leaves = [x for x in tips.contacts["left"].changes if x.kind == "leave"]
    assert leaves[0].t == pytest.approx(G * 0.5 / 0.3, abs=1e-12)
    assert tips.contacts["right"].mode[-1] is Mode.STICK


def test_a_beam_on_three_feet_tips_when_the_load_has_walked_out():
    weight = 5.0
    feet = {
        f"{k}": lv.Contact(lambda t, q, params, k=k: q[0] + k * ca.sin(q[1])) for k in (-1, 0, 1)
    }
    beam = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 + v[1] ** 2 / 6 - G * q[0],
        q=("y", "angle"),
        force=lambda t, q, v, params: [-weight, -weight * t],
        contacts=feet,
    )
    run = lv.integrate(beam, lv.Spark(3), t=(0, 3), h=0.1, q=[0, 0], v=[0, 0])
    left = [change.t for change in run.contacts["-1"].changes if change.kind == "leave"]
    assert left[0] == pytest.approx(1 + G / weight, abs=1e-12)
    assert run.contacts["1"].mode[-1] is Mode.CLOSED


def test_a_rocking_block_loses_what_housner_says():
    """From a tilt of 0.1 rad: the rate after the impact over that before it."""
    width, height, tilt = 0.5, 2.0, -0.1
    system = tilted(2.0, width=width, height=height)
    c, s = np.cos(tilt), np.sin(tilt)
    start = [-(c * width + s * height), -(s * width - c * height), tilt]
    run = lv.integrate(system, lv.Spark(4), t=(0, 1.0), h=0.02, q=start, v=[0, 0, 0])
    hit = run.contacts["left"].changes[0]
    after = run.v[np.searchsorted(run.t, hit.t), 2]
    of_corner = 4 / 3 * (width**2 + height**2)
    before = np.sqrt(2 * G * (start[1] - height) / of_corner)
    assert after / before == pytest.approx(1 - 1.5 * width**2 / (width**2 + height**2), abs=1e-12)
    assert kinds(run, "right") == ["close", "stick", "leave"]


def test_the_order_is_that_of_the_method_through_changes():
    """A block on a stiffening spring stops and turns back, slipping all the way."""

    def end(method, steps):
        system = lv.Lagrangian(
            lambda t, q, v, params: ca.sumsqr(v) / 2 - q[0] ** 4 / 4 - q[1],
            q=2,
            contacts={
                "floor": lv.Contact(
                    lambda t, q, params: q[1] - ca.sin(q[0]) / 5,
                    friction=0.1,
                    slip=lambda t, q, v, params: v[0],
                )
            },
        )
        start = system.consistent(q=[1.5, 0.2 * np.sin(1.5)], v=[0, 0])
        run = lv.integrate(system, method, t=(0, 5), steps=steps, **start)
        assert len(run.contacts["floor"].changes) > 1
        return run.q[-1]

    exact = end(lv.Spark(6), 200)
    for method, order in ((lv.Spark(1), 2), (lv.Spark(2), 4), (lv.LobattoPair(3), 4)):
        errors = [np.abs(end(method, n) - exact).max() for n in (80, 160, 320)]
        slopes = [np.log2(a / b) for a, b in pairwise(errors)]
        assert np.mean(slopes) > order - 0.4, (method, errors)


def test_random_problems_of_lemke_are_solved_and_poisson_gains_no_energy():
    rng = np.random.default_rng(5)
    for _ in range(200):
        n = int(rng.integers(1, 7))
        B = rng.normal(size=(n, n))
        Z, q = B @ B.T + 1e-6 * np.eye(n), rng.normal(size=n)
        z = lemke(Z, q)
        w = Z @ z + q
        assert w.min() > -1e-9
        assert abs(w @ z) < 1e-8 * max(1, abs(z).max())
    for _ in range(200):
        c = int(rng.integers(1, 4))
        rows = rng.normal(size=(2 * c, 2 * c + 1))
        A, rates = rows @ rows.T, rng.normal(size=2 * c)
        rates[:c] = -abs(rates[:c])
        found = impact(
            A, rates, np.ones(c, bool), rng.uniform(0, 1, c), rng.uniform(0.1, 1, c),
            np.arange(c), "poisson",
        )  # fmt: skip
        assert found.normal.min() >= 0
        assert found.across.min() > -1e-9
        impulses = np.append(found.normal, found.friction)
        gained = impulses @ (np.append(found.across, found.along) + rates)
        assert gained < 1e-9 * abs(impulses) @ abs(rates)


def test_one_contact_has_the_forces_of_coulomb():
    for push, friction, along in ((1, -1, 0), (6, -4.905, 1.095), (-6, 4.905, -1.095)):
        b = np.array([-G, push])
        found = solve(np.eye(2), b, np.array([True]), np.array([0]), np.array([0.5]), np.array([0]))
        assert found.normal[0] == pytest.approx(G)
        assert (found.friction[0], found.along[0]) == pytest.approx((friction, along))


def test_events_and_observables_go_through_all_stretches():
    run = lv.integrate(
        block(), lv.Spark(2), t=(0, 1), h=0.1, q=[0, 0], v=[2, 0], every=2,
        observe={"twice": lambda t, q, v, params: 2 * q[0]},
        events={"early": lambda t, q, v, lam, params: q[0] - 0.3},
    )  # fmt: skip
    assert run.events["early"].q[0, 0] == pytest.approx(0.3, abs=1e-14)
    np.testing.assert_allclose(run.observed["twice"], 2 * run.q[:, 0], rtol=0, atol=1e-15)
    ends = lv.integrate(
        block(), lv.Spark(2), t=(0, 1), h=0.1, q=[0, 0], v=[2, 0],
        events={"early": lv.Event(lambda t, q, v, lam, params: q[0] - 0.3, terminal=True)},
    )  # fmt: skip
    assert ends.q[-1, 0] == pytest.approx(0.3, abs=1e-14)
    assert "early" in ends.message
    assert "contact 'floor': 1 closing, 1 stop" in repr(run)


def test_a_constraint_beside_a_contact_keeps_its_multiplier():
    """A rod swings onto a floor under its end, plastic, and lies there."""
    rod = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        lambda t, q, params: {"rod": (ca.sumsqr(q) - 1) / 2},
        q=("x", "y"),
        contacts={"floor": lv.Contact(lambda t, q, params: q[1] + 0.5)},
    )
    run = lv.integrate(rod, lv.Spark(3), t=(0, 2), h=0.02, q=[1, 0], v=[0, 0])
    assert run.lam.shape == (len(run.t), 1)
    assert run.q[-1, 1] == pytest.approx(-0.5, abs=1e-14)
    assert abs(run.v[-1]).max() < 1e-14
    assert max(x.max(initial=0.0) for x in map(np.abs, run.residuals.values())) < 1e-13
    assert run.contacts["floor"].normal[-1] == pytest.approx(G, abs=1e-12)


REFUSED = {
    "penetrates by 0.5 at the start": lambda: lv.integrate(
        block(), lv.Spark(2), t=(0, 1), h=0.1, q=[0, -0.5], v=[0, 0]
    ),
    "rtol must be from 1e-14 to below 1, not 2": lambda: lv.integrate(
        block(), lv.Spark(2), t=(0, 1), rtol=2, q=[0, 0], v=[0, 0]
    ),
    "give either steps, which are equal, or rtol": lambda: lv.integrate(
        block(), lv.Spark(2), t=(0, 1), rtol=1e-3, steps=3, q=[0, 0], v=[0, 0]
    ),
    "goes forwards in time": lambda: lv.integrate(
        block(), lv.Spark(2), t=(1, 0), h=0.1, q=[0, 0], v=[0, 0]
    ),
    "extrapolation knows of no contacts": lambda: lv.analysis.extrapolate(
        block(), lv.Spark(2), t=(0, 1), h=0.1, q=[0, 0], v=[0, 0]
    ),
    "equilibrium knows of no contacts": lambda: lv.analysis.equilibrium(block(), q=[0, 0]),
    "friction needs slip=": lambda: lv.Contact(lambda t, q, params: q[0], friction=0.1),
    "restitution must be from 0 to 1, not 2": lambda: lv.Contact(print, restitution=2),
    "friction must be zero or positive, not -1": lambda: lv.Contact(print, friction=-1),
    "static_friction must be at least friction = 0.5, not 0.1": lambda: block(0.5, 0.1),
    "the slip of contact 'a' must be affine": lambda: lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        q=1,
        contacts={"a": lv.Contact(lambda t, q, p: q[0], 0, 0.1, slip=lambda t, q, v, p: v[0] ** 2)},
    ),
    "the gap of contact 'a' is the same for all coordinates": lambda: lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        q=1,
        contacts={"a": lv.Contact(lambda t, q, params: t)},
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_wrong_is_said(words):
    with pytest.raises((TypeError, ValueError), match=words):
        REFUSED[words]()


def test_friction_that_jams_ends_the_run_by_name():
    """Painlevé's rod: steep, sliding, with friction 2 there is no acceleration."""
    angle = np.arctan(2.0)
    c, s = np.cos(angle), np.sin(angle)
    rod = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2 + v[2] ** 2 / 3) / 2 - G * q[1],
        q=("x", "y", "angle"),
        contacts={
            "foot": lv.Contact(
                lambda t, q, params: q[1] - ca.sin(q[2]),
                friction=2.0,
                slip=lambda t, q, v, params: v[0] + ca.sin(q[2]) * v[2],
            )
        },
    )
    start = {"q": [0, s, angle], "v": [1.0, 0, 0]}
    try:
        lv.integrate(rod, lv.Spark(2), t=(0, 1), h=0.01, **start)
    except lv.IntegrationError as error:
        assert "no accelerations obey the laws of contacts 'foot'" in str(error)  # noqa: PT017
    else:
        back = {"q": [0, s, angle], "v": [-1.0, 0, 0]}
        with pytest.raises(lv.IntegrationError, match="no accelerations obey the laws of contacts"):
            lv.integrate(rod, lv.Spark(2), t=(0, 1), h=0.01, **back)
    del c


CONTROLS = {
    "rtol": {"rtol": 1e-9},
    "first step": {"rtol": 1e-9, "h": 0.01},
    "monitor": {
        "control": lv.Reversible(lambda t, q, v, params: 1 / (1 + ca.sumsqr(v))),
        "h": 0.05,
    },
    "acceleration": {"control": lv.Reversible(), "h": 0.05},
    "least": {"rtol": 1e-9, "control": lv.Adaptive(h_min=1e-3)},
}


@pytest.mark.parametrize("method", [lv.Spark(4), lv.LobattoPair(4)], ids=repr)
@pytest.mark.parametrize("steps", CONTROLS.values(), ids=CONTROLS)
def test_controlled_steps_go_through_changes(method, steps):
    run = lv.integrate(block(), method, t=(0, 1), q=[1, 0], v=[2, 0], **steps)
    assert run.q[-1, 0] - 1 == pytest.approx(2 / (0.5 * G), abs=1e-13)
    assert kinds(run, "floor") == ["close", "stick"]
    bounces = lv.integrate(ball(0.5), method, t=(0, 5), q=[1.0], v=[0.0], **steps)
    rest = bounces.contacts["ground"].changes[-1].rest
    assert rest == pytest.approx(3 * np.sqrt(2 / G), abs=1e-12)
    torn = [
        change.t
        for change in lv.integrate(
            belt(), method, t=(0, 30), q=[0, 0], v=[0.5, 0], **steps
        ).contacts["belt"].changes
        if change.kind == "slip"
    ]  # fmt: skip
    np.testing.assert_allclose(np.diff(torn), BELT_PERIOD, rtol=0, atol=1e-7)
    assert len(torn) == 4


def test_controlled_steps_say_what_they_were():
    run = lv.integrate(belt(), lv.Spark(4), t=(0, 30), rtol=1e-8, q=[0, 0], v=[0.5, 0])
    assert run.tolerances == pytest.approx({"rtol": 1e-8, "atol": 1e-11})
    assert run.stats["h_smallest"] <= run.h <= run.stats["h_largest"] <= 30
    assert run.h == pytest.approx(30 / run.stats["steps"])
    assert run.stats["rejected"] > 0


def test_a_disc_wedged_in_between_corners_stays():
    """Two corners of one body hold it: forces have no largest margin, and the motion is plain."""
    n = np.array([[np.sin(0.3), np.cos(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    contacts = {
        f"{k}": lv.Contact(
            lambda t, q, params, k=k: ca.dot(n[k], q[:2] - n[k]),
            friction=0.6,
            slip=lambda t, q, v, params, k=k: n[k][1] * v[0] - n[k][0] * v[1] + v[2],
        )
        for k in range(2)
    }
    disc = lv.Lagrangian(
        lambda t, q, v, params: (ca.sumsqr(v[:2]) + v[2] ** 2 / 2) / 2 - G * q[1],
        q=3,
        contacts=contacts,
    )
    place = [0, 1 / np.cos(0.3), 0]
    run = lv.integrate(disc, lv.Spark(3), t=(0, 1), h=0.1, q=place, v=[0, 0, 0])
    assert abs(run.q - place).max() < 1e-14
    forces = sum(np.outer(run.contacts[f"{k}"].normal, n[k]) for k in range(2))
    along = np.array([[n[k][1], -n[k][0]] for k in range(2)])
    forces = forces + sum(np.outer(run.contacts[f"{k}"].friction, along[k]) for k in range(2))
    np.testing.assert_allclose(forces, [[0, G]] * len(run.t), atol=1e-11)


def test_bounces_of_many_at_rest_do_not_hide_one():
    """Contacts that do not act on one another are solved for apart, each by its own size."""
    A = np.eye(4)
    A[1, 1] = A[3, 3] = 1e-6
    before = np.array([-1e-17, -1e-8, 3.0, -2e-9])
    found = impact(
        A, before, np.ones(2, bool), np.zeros(2), np.full(2, 0.5), np.arange(2), "poisson"
    )
    np.testing.assert_allclose(found.normal, [0.0, 1e-2], rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(found.friction[1], 2e-3, rtol=1e-12)


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(3)], ids=repr)
def test_a_flight_that_an_acceleration_begins_may_be_shorter_than_a_step(method):
    """Pushed up by 0.03 - 100 t: it is back at 3 * 0.03 / 100."""
    pushed = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2,
        q=1,
        force=lambda t, q, v, params: [0.03 - 100 * t],
        contacts={"floor": lv.Contact(lambda t, q, params: q[0])},
    )
    run = lv.integrate(pushed, method, t=(0, 0.1), h=0.01, q=[0.0], v=[0.0])
    (hit,) = run.contacts["floor"].changes
    assert hit.t == pytest.approx(9e-4, abs=1e-13)
    assert hit.normal == pytest.approx(50 * 9e-4**2 - 0.03 * 9e-4, abs=1e-13)
    assert run.contacts["floor"].mode[-1] is Mode.CLOSED


@pytest.mark.parametrize("restitution", [0.0, 0.2])
@pytest.mark.parametrize("push", [-1.0, 0.0])
def test_floors_that_are_nearly_one_hold_what_slides_from_the_one_onto_the_other(push, restitution):
    """Gaps y and y + 3e-8 x: moving to the left a mass is on the second, which is higher there."""
    slope = 3e-8
    floors = {
        name: lv.Contact(lambda t, q, params, k=k: q[1] + k * q[0], restitution=restitution)
        for name, k in (("flat", 0.0), ("steep", slope))
    }
    mass = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1], q=2, contacts=floors)
    run = lv.integrate(mass, lv.Spark(2), t=(0, 1), h=0.05, q=[0, 0], v=[-10, push])
    steep = run.contacts["steep"]
    assert steep.changes[0].kind == "hit"
    assert steep.mode[-1] is Mode.CLOSED
    assert run.contacts["flat"].mode[-1] is Mode.OPEN
    assert run.v[-1, 1] == pytest.approx(10 * slope, rel=1e-7)
    assert min(record.gap.min() for record in run.contacts.values()) > -1e-16
