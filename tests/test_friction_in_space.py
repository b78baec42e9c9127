"""Friction in space, whose slip has two directions, beside closed forms and reduced equations."""

import pickle

import casadi as ca
import numpy as np
import pytest
from ordinary import solved

import liouville as lv
from liouville.bodies import Assembly, Capsule, Plane, Sphere

G = 9.81
METHODS = [lv.Spark(2), lv.Spark(4), lv.LobattoPair(3)]
STEPS = [{"h": 0.1}, {"steps": 1}, {"rtol": 1e-8}]


def contact(gap, friction, static=None, restitution=0.0, slip=None):
    return lv.Contact(
        gap, restitution, friction, static, slip or (lambda t, q, v, params: [v[0], v[1]])
    )


def block(friction, static=None, slope=0.0, belt=None):
    """Return a block on a plane that falls along x, at z = 0, perhaps on a belt."""
    down, across = G * np.sin(slope), G * np.cos(slope)

    def slip(t, q, v, params):
        along = belt(t, q) if belt else [0, 0]
        return [v[0] - along[0], v[1] - along[1]]

    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 + down * q[0] - across * q[2],
        q=("x", "y", "z"),
        contacts={"floor": contact(lambda t, q, params: q[2], friction, static, slip=slip)},
    )


RADIUS, MASS = 0.11, 5.0


def ball(friction=0.2, restitution=0.0):
    """Return a solid ball above z = 0, by its place and three angles whose rates are the spin."""

    def slip(t, q, v, params):
        return [v[0] - RADIUS * v[4], v[1] + RADIUS * v[3]]

    def gap(t, q, params):
        return q[2] - RADIUS

    return lv.Lagrangian(
        lambda t, q, v, params: (
            MASS * (ca.sumsqr(v[:3]) / 2 + RADIUS**2 * ca.sumsqr(v[3:]) / 5 - G * q[2])
        ),
        q=("x", "y", "z", "a", "b", "c"),
        contacts={"lane": contact(gap, friction, None, restitution, slip)},
    )


def check_laws(run, friction, static=None):
    """Hold the cone, the gaps and the energy at all records."""
    for record in run.contacts.values():
        most = max(friction, static or 0.0) * record.normal
        assert (record.friction <= most + 1e-9 * np.abs(most).max()).all()
        assert record.gap.min() > -1e-13
        assert record.normal.min() > -1e-10
        sticks = np.array([mode.name == "STICK" for mode in record.mode])
        assert np.abs(record.slip[sticks]).max(initial=0.0) < 1e-13
    energy = run.invariants["energy"]
    assert np.diff(energy).max() < 1e-12 * np.ptp(energy) + 1e-13


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_block_slides_along_an_oblique_line_and_stays(method, steps):
    run = lv.integrate(block(0.3), method, t=(0, 2), q=[1, 1, 0], v=[1.5, 2, 0], **steps)
    end, way = 2.5 / (0.3 * G), 2.5**2 / (0.6 * G)
    (_, stop) = run.contacts["floor"].changes
    assert stop.kind == "stick"
    assert stop.t == pytest.approx(end, abs=1e-12)
    np.testing.assert_allclose(run.q[-1], [1 + 0.6 * way, 1 + 0.8 * way, 0], atol=1e-12)
    assert np.abs(run.v[-1]).max() < 1e-15
    assert run.contacts["floor"].mode[0].name == "SLIDE"
    assert run.contacts["floor"].slip[0] == pytest.approx(2.5)
    check_laws(run, 0.3)


def down_a_slope(friction, slope, v, t):
    """Return place and velocity by the equations in the plane, while it slides."""

    def rates(t, y):
        n = np.hypot(y[2], y[3])
        pull, drag = G * np.sin(slope), friction * G * np.cos(slope)
        return [y[2], y[3], pull - drag * y[2] / n, -drag * y[3] / n]

    return np.split(solved(rates, [0, t], [0, 0, *v])[-1], 2)


@pytest.mark.parametrize("friction", [0.2, 0.3])
@pytest.mark.parametrize("v", [[0.5, 2.0], [-1.0, 1.0]])
def test_a_block_on_a_slope_turns_into_its_line(friction, v):
    run = lv.integrate(
        block(friction, slope=0.25), lv.Spark(4), t=(0, 0.4), h=0.02, q=[0, 0, 0], v=[*v, 0]
    )
    q, v = down_a_slope(friction, 0.25, v, 0.4)
    np.testing.assert_allclose(run.q[-1, :2], q, atol=1e-12)
    np.testing.assert_allclose(run.v[-1, :2], v, atol=1e-12)
    check_laws(run, friction)


def test_a_curved_way_stops_where_and_when_it_must():
    """By |v| = r, its angle to the slope and r + v_x, of which the speed decays as a power."""
    slope, friction, v = 0.25, 0.4, np.array([0.5, 2.0])
    pull, drag = G * np.sin(slope), friction * G * np.cos(slope)
    speed = np.hypot(*v)
    # (drag - pull)(drag + pull) t = drag |v| + pull v_x, from the rates of |v| and v_x
    end = (drag * speed + pull * v[0]) / (drag**2 - pull**2)
    errors = []
    for h in (0.1, 0.05):
        run = lv.integrate(
            block(friction, slope=slope), lv.Spark(3), t=(0, 2), h=h, q=[0, 0, 0], v=[*v, 0]
        )
        errors.append(abs(run.contacts["floor"].changes[-1].t - end))
        check_laws(run, friction)
    assert errors[0] < 1e-8
    assert errors[1] < errors[0] / 32
    assert np.abs(lv.analysis.power_balance(run).defect).max() < 1e-9
    near = end - 1e-6
    q, _ = down_a_slope(friction, slope, v, near)
    np.testing.assert_allclose(run.q[-1, :2], q, atol=1e-10)


@pytest.mark.parametrize("steps", [*STEPS, {"h": 0.1, "t_eval": [0.0, 1e-7, 0.5, 2.0]}])
@pytest.mark.parametrize("static", [None, 0.3])
def test_a_block_slides_down_from_rest_and_back_from_a_throw(static, steps):
    pull, drag = G * np.sin(0.5), 0.2 * G * np.cos(0.5)
    run = lv.integrate(
        block(0.2, static, slope=0.5), lv.Spark(3), t=(0, 2), q=[0, 0, 0], v=[0, 0, 0], **steps
    )
    assert run.t[0] == 0
    assert run.q[-1, 0] == pytest.approx(2 * (pull - drag), abs=1e-12)
    thrown = lv.integrate(
        block(0.2, static, slope=0.5), lv.Spark(3), t=(0, 2), q=[0, 0, 0], v=[-2, 0, 0], **steps
    )
    turn = 2 / (pull + drag)
    assert [x.kind for x in thrown.contacts["floor"].changes] == ["close", "slip"]
    assert thrown.contacts["floor"].changes[1].t == pytest.approx(turn, abs=1e-12)
    way = -turn + (pull - drag) * (2 - turn) ** 2 / 2
    assert thrown.q[-1, 0] == pytest.approx(way, abs=1e-11)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_bowling_ball_rolls_at_five_sevenths_of_its_speed(method, steps):
    v = np.array([2.4, 3.2])
    run = lv.integrate(
        ball(), method, t=(0, 2), q=[0, 0, RADIUS, 0, 0, 0], v=[*v, 0, 0, 0, 0], **steps
    )
    end = 2 * 4 / (7 * 0.2 * G)
    assert run.contacts["lane"].changes[-1].kind == "stick"
    assert run.contacts["lane"].changes[-1].t == pytest.approx(end, abs=1e-12)
    np.testing.assert_allclose(run.v[-1, :2], 5 / 7 * v, atol=1e-12)
    way = 4 * end - 0.1 * G * end**2 + 20 / 7 * (2 - end)
    np.testing.assert_allclose(run.q[-1, :2], v / 4 * way, atol=1e-12)
    check_laws(run, 0.2)


def test_a_ball_with_side_spin_follows_a_parabola():
    v = np.array([3.0, 1.0, 0, 2.0, -5.0, 1.0])
    m = Assembly(gravity=(0, 0, -G))
    body = m.body("ball", mass=MASS, inertia=[0.4 * MASS * RADIUS**2] * 3, at=(0, 0, RADIUS))
    m.free("flight", body)
    m.contact("lane", Sphere(body, RADIUS), Plane("ground"), friction=0.2)
    slip = np.array([v[0] - RADIUS * v[4], v[1] + RADIUS * v[3]])
    end, u = 2 * np.hypot(*slip) / (7 * 0.2 * G), slip / np.hypot(*slip)
    rolls = v[:2] - 0.2 * G * end * u
    place = v[:2] * end - 0.1 * G * end**2 * u + rolls * (1 - end)
    free = lv.integrate(ball(), lv.Spark(3), t=(0, 1), h=0.1, q=[0, 0, RADIUS, 0, 0, 0], v=v)
    np.testing.assert_allclose(free.q[-1, :2], place, atol=1e-12)
    run = lv.integrate(
        m.system(), lv.Spark(4), t=(0, 1), h=0.05, **m.start(rates={"flight": tuple(v)})
    )
    assert run.contacts["lane"].changes[-1].t == pytest.approx(end, abs=1e-9)
    np.testing.assert_allclose(run.body("ball").position[-1, :2], place, atol=1e-9)
    np.testing.assert_allclose(run.body("ball").velocity[-1, :2], rolls, atol=1e-9)
    check_laws(run, 0.2)


@pytest.mark.parametrize(("static", "accuracy"), [(0.4, 1e-12), (0.3, 1e-9)])
def test_a_block_on_a_table_that_spins_up_tears_off_and_slides(static, accuracy):
    """Static friction .4 or .3 at sliding friction .3; the table turns by t^2 / 2."""
    system = block(0.3, static, belt=lambda t, q: [-t * q[1], t * q[0]])
    tear = ((static * G) ** 2 - 1) ** 0.25
    ends = []
    for h in (0.05, 0.02):
        run = lv.integrate(system, lv.Spark(4), t=(0, tear + 0.7), h=h, q=[1, 0, 0], v=[0, 0, 0])
        slip = run.contacts["floor"].changes[-1]
        assert slip.kind == "slip"
        assert slip.t == pytest.approx(tear, abs=1e-13)
        stuck = run.t <= tear
        turned = run.t[stuck] ** 2 / 2
        np.testing.assert_allclose(run.q[stuck, 0], np.cos(turned), atol=1e-14)
        ends.append(run.q[-1, :2])
    np.testing.assert_allclose(*ends, atol=accuracy)
    if static > 0.3:
        np.testing.assert_allclose(ends[1], torn_off(tear, 0.7), atol=1e-9)


def torn_off(tear, more):
    """Return where a block comes to on the table from its tear, first along its acceleration."""
    turned, start = tear**2 / 2, 1e-5
    q = np.array([np.cos(turned), np.sin(turned)])
    v = tear * np.array([-q[1], q[0]])
    held = v / tear - tear**2 * q
    a = 0.3 * G * held / np.hypot(*held)

    def rates(t, y):
        slip = np.array([y[2] + t * y[1], y[3] - t * y[0]])
        return [y[2], y[3], *(-0.3 * G * slip / np.hypot(*slip))]

    begun = [*(q + start * v + start**2 / 2 * a), *(v + start * a)]
    return solved(rates, [tear + start, tear + more], begun)[-1, :2]


@pytest.mark.parametrize(("friction", "restitution"), [(0.1, 0.5), (0.9, 0.5), (0.1, 0.0)])
def test_a_ball_that_spins_hits_the_floor(friction, restitution):
    """It slips throughout, or its slip of size s is stopped by an impulse of 2 m s / 7."""
    v = np.array([3, 1, 0, 2.0, -5, 1])
    run = lv.integrate(
        ball(friction, restitution), lv.Spark(2), t=(0, 0.5), h=0.05,
        q=[0, 0, 1 + RADIUS, 0, 0, 0], v=v,
    )  # fmt: skip
    slip = np.array([v[0] - RADIUS * v[4], v[1] + RADIUS * v[3]])
    size, pressed = np.hypot(*slip), (1 + restitution) * np.sqrt(2 * G)
    hit = run.contacts["lane"].changes[0]
    across = min(friction * pressed, 2 / 7 * size)
    assert hit.normal == pytest.approx(MASS * pressed, rel=1e-13)
    assert hit.friction == pytest.approx(MASS * across, rel=1e-13)
    at = np.flatnonzero(run.t == hit.t)[0]
    np.testing.assert_allclose(run.v[at, :2], v[:2] - across * slip / size, atol=1e-13)
    check_laws(run, friction)


def rod(friction=0.3):
    """Return a rod of length 1 on its two ends, by x, y, z, yaw and pitch."""

    def end(side):
        def slip(t, q, v, params):
            return [
                v[0] - side / 2 * ca.sin(q[3]) * v[3],
                v[1] + side / 2 * ca.cos(q[3]) * v[3],
            ]

        return contact(lambda t, q, params: q[2] + side / 2 * ca.sin(q[4]), friction, slip=slip)

    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v[:3]) / 2 + (v[3] ** 2 + v[4] ** 2) / 24 - G * q[2],
        q=("x", "y", "z", "yaw", "pitch"),
        contacts={"front": end(1), "back": end(-1)},
    )


def test_a_rod_on_two_ends_slides_and_turns():
    def rates(t, y):
        found = np.append(y[3:], np.zeros(3))
        for side in (1, -1):
            arm = side / 2 * np.array([-np.sin(y[2]), np.cos(y[2])])
            slip = y[3:5] + arm * y[5]
            force = -0.3 * G / 2 * slip / np.hypot(*slip)
            found[3:] += [*force, 12 * (arm @ force)]
        return found

    start = {"q": [0, 0, 0, 0.4, 0], "v": [1, 0.5, 0, 3, 0]}
    run = lv.integrate(rod(), lv.Spark(4), t=(0, 0.3), h=0.02, **start)
    end = solved(rates, [0, 0.3], [0, 0, 0.4, 1, 0.5, 3])[-1]
    np.testing.assert_allclose(run.q[-1, [0, 1, 3]], end[:3], atol=1e-11)
    np.testing.assert_allclose(run.v[-1, [0, 1, 3]], end[3:], atol=1e-11)
    check_laws(run, 0.3)
    run = lv.integrate(rod(), lv.Spark(4), t=(0, 2), h=0.02, **start)
    assert {record.mode[-1].name for record in run.contacts.values()} == {"STICK"}
    assert np.abs(run.v[-1]).max() < 1e-15
    check_laws(run, 0.3)


def feet(count, *frictions, static=None, force=None):
    """Return a mass of 1 on feet at a distance of 1, by x, y, z, both tilts and the yaw."""
    angles = 2 * np.pi * np.arange(count) / count
    own = {
        f"foot {k}": lv.Contact(
            lambda t, q, params, x=x, y=y: q[2] + x * q[3] + y * q[4],
            friction=friction,
            static_friction=static,
            slip=lambda t, q, v, params, x=x, y=y: [v[0] - y * v[5], v[1] + x * v[5]],
        )
        for k, (x, y, friction) in enumerate(
            zip(np.cos(angles), np.sin(angles), frictions * (count // len(frictions)), strict=True)
        )
    }
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[2], q=6, force=force, contacts=own
    )


REST = {"t": (0, 1), "h": 0.05, "q": np.zeros(6), "v": np.zeros(6)}


@pytest.mark.parametrize("push", [0.0, 1.0])
@pytest.mark.parametrize("frictions", [(0.5,), (0.5, 0.0, 0.0)])
@pytest.mark.parametrize("count", [3, 6])
def test_feet_that_stick_share_their_load_or_one_holds_them_all(push, frictions, count):
    def force(t, q, v, params):
        return [push, 0, 0, 0, 0, 0]

    run = lv.integrate(feet(count, *frictions, force=force), lv.Spark(2), **REST)
    assert np.abs(run.q[-1]).max() < 1e-15
    check_laws(run, 0.5)
    rubs = sum(record.friction for record in run.contacts.values())
    assert (rubs > push - 1e-9).all()
    if len(frictions) > 1 and count == 3:
        assert run.contacts["foot 0"].friction == pytest.approx(push, abs=1e-12)
    assert sum(record.normal for record in run.contacts.values()) == pytest.approx(G, rel=1e-12)
    if len(frictions) == 1:
        assert run.contacts["foot 1"].normal == pytest.approx(G / count, rel=1e-6)


@pytest.mark.parametrize("static", [None, 0.4])
@pytest.mark.parametrize("turns", [False, True])
def test_a_tripod_is_torn_off_when_all_its_feet_bear_what_they_can(turns, static):
    """By a force, or a torque, of 5 t: with m = I = 1 and arms of 1 both are alike."""

    def force(t, q, v, params):
        return [0, 0, 0, 0, 0, 5 * t] if turns else [3 * t, 4 * t, 0, 0, 0, 0]

    run = lv.integrate(feet(3, 0.3, static=static, force=force), lv.Spark(3), **REST)
    tear = (static or 0.3) * G / 5
    for record in run.contacts.values():
        assert record.changes[-1].kind == "slip"
        assert record.changes[-1].t == pytest.approx(tear, abs=1e-9)
    speed = 5 * (1 - tear**2) / 2 - 0.3 * G * (1 - tear)
    want = speed * np.array([0, 0, 0, 0, 0, 1.0] if turns else [0.6, 0.8, 0, 0, 0, 0])
    np.testing.assert_allclose(run.v[-1], want, atol=1e-8)


def test_four_feet_that_slide_are_refused_by_their_names():
    words = "contacts share a load, and 'foot 0', 'foot 1', 'foot 2' and 'foot 3' slide in space"
    with pytest.raises(lv.IntegrationError, match=words):
        lv.integrate(feet(4, 0.5), lv.Spark(2), **{**REST, "v": [1, 0, 0, 0, 0, 0]})


def test_a_capsule_slides_along_to_its_rest_and_rolls_sideways():
    """Sideways it rolls with two thirds of its speed, as a cylinder of I = m r^2 / 2 does."""
    m = Assembly(gravity=(0, 0, -G))
    log = m.body("log", mass=2.0, inertia=[0.01, 0.15, 0.15], at=(0, 0, 0.1))
    m.free("flight", log)
    ends = [(-0.4, 0, 0.1), (0.4, 0, 0.1)]
    m.contact("floor", Capsule(log, ends, 0.1), Plane("ground"), friction=0.3)
    along, across = (
        lv.integrate(m.system(), lv.Spark(3), t=(0, 1), h=0.02, **m.start(rates={"flight": rates}))
        for rates in ((1, 0, 0, 0, 0, 0), (0, 1, 0, 0, 0, 0))
    )
    for run, last in ((along, 1 / (0.3 * G)), (across, 1 / (0.9 * G))):
        for record in run.contacts.values():
            assert record.changes[-1].kind == "stick"
            assert record.changes[-1].t == pytest.approx(last, abs=1e-10)
        check_laws(run, 0.3)
    place = along.body("log").position[-1]
    np.testing.assert_allclose(place, [1 / (0.6 * G), 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(across.body("log").velocity[-1], [0, 2 / 3, 0], atol=1e-12)


def test_a_puck_that_is_pressed_stops_and_is_torn_off():
    """A load of 2 at friction .5 on a mass of 1, and a force along (3, 4) t / 5 from then on."""
    puck = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2,
        q=2,
        force=lambda t, q, v, params: [0.6 * params.pull * t, 0.8 * params.pull * t],
        params={"pull": 0.0},
        contacts={
            "pad": lv.Contact(load=2.0, friction=0.5, slip=lambda t, q, v, params: [v[0], v[1]])
        },
    )
    run = lv.integrate(puck, lv.Spark(2), t=(0, 3), h=0.1, q=[0, 0], v=[-0.8, 0.6])
    np.testing.assert_allclose(run.q[-1], [-0.4, 0.3], atol=1e-13)
    pulled = lv.integrate(
        puck, lv.Spark(3), t=(0, 3), h=0.1, q=[0, 0], v=[0, 0], params={"pull": 1.0}
    )
    assert pulled.contacts["pad"].changes[-1].t == pytest.approx(1, abs=1e-13)
    np.testing.assert_allclose(pulled.q[-1], 8 / 6 * np.array([0.6, 0.8]), atol=1e-9)
    assert (pulled.contacts["pad"].normal == 2).all()


@pytest.mark.parametrize("terminal", [False, True])
def test_events_in_the_first_bit_of_a_slide_are_met(terminal):
    """A clock that runs beside passes 5e-7, half of what is made without the method."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 + 5 * q[0] - 8 * q[2],
        q=4,
        contacts={"floor": contact(lambda t, q, params: q[2], 0.2)},
    )
    clock = lv.Event(lambda t, q, v, lam, params: q[3] - 5e-7, terminal=terminal)
    run = lv.integrate(
        system, lv.Spark(2), t=(0, 1), h=0.1, q=[0] * 4, v=[0, 0, 0, 1], events={"clock": clock}
    )
    assert run.events["clock"].t == pytest.approx([5e-7], abs=1e-18)
    assert run.t[-1] == pytest.approx(5e-7 if terminal else 1, abs=1e-18)
    assert run.q[-1, 0] == pytest.approx(1.7 * run.t[-1] ** 2, abs=1e-12)


@pytest.mark.parametrize("steps", [{"h": 0.1}, {"rtol": 1e-8}])
def test_events_of_what_stops_are_met_in_the_last_bit(steps):
    """The slip comes down to zero, to 1e-12 and to 1e-9 within a billionth of a step."""
    events = {
        f"{low:g}": lv.Event(lambda t, q, v, lam, params, low=low: v[0] - low, "down")
        for low in (0.0, 1e-12, 1e-9)
    }
    call = {"t": (0, 2), "q": [1, 1, 0], "v": [1.5, 2, 0], "events": events} | steps
    run = lv.integrate(block(0.3), lv.Spark(3), **call)
    end = 2.5 / (0.3 * G)
    for name, points in run.events.items():
        assert points.t == pytest.approx([end - float(name) / (0.18 * G)], abs=1e-14)
        assert points.q[0] == pytest.approx(run.q[-1], abs=1e-12)
    events["0"] = lv.Event(events["0"].function, terminal=True)
    ended = lv.integrate(block(0.3), lv.Spark(3), **call)
    assert ended.message == f"event '0' at t = {end:.6g}"
    assert ended.t[-1] == pytest.approx(end, abs=1e-14)
    with pytest.raises(lv.IntegrationError, match="an event is met where the slip of contact"):
        lv.vjp(block(0.3), lv.Spark(3), wrt=["v"], **(call | {"h": 0.1, "rtol": None}))


def test_an_event_of_a_slip_that_begins_is_met_in_its_first_bit():
    pull = G * (np.sin(0.5) - 0.2 * np.cos(0.5))
    event = {"moves": lambda t, q, v, lam, params: v[0] - 1e-7}
    run = lv.integrate(
        block(0.2, slope=0.5), lv.Spark(3), t=(0, 1), h=0.1, q=[0] * 3, v=[0] * 3, events=event
    )
    assert run.events["moves"].t == pytest.approx([1e-7 / pull], rel=1e-6)


def test_members_files_and_pickles_have_the_same_records(tmp_path):
    system, call = block(0.3, slope=0.1), {"t": (0, 1), "h": 0.1}
    run = lv.integrate(system, lv.Spark(2), q=[0, 0, 0], v=[1, 0.5, 0], **call)
    run.save(tmp_path / "run.nc")
    again = lv.load(tmp_path / "run.nc")
    copied = lv.integrate(
        pickle.loads(pickle.dumps(system)), lv.Spark(2), q=[0, 0, 0], v=[1, 0.5, 0], **call
    )
    for other in (again, copied):
        for what in ("mode", "slip", "friction", "normal"):
            own = getattr(run.contacts["floor"], what)
            assert (getattr(other.contacts["floor"], what) == own).all()
    both = lv.ensemble(
        system, lv.Spark(2), q=[0, 0, 0], v=[[1, 0.5, 0], [0, 0.5, 0]], t_eval=[0, 0.5, 1], **call
    )
    np.testing.assert_allclose(both.q[-1, 0], run.q[-1], atol=1e-14)
    assert both.contacts["floor"].mode[-1, 1].name == "STICK"


FILE = """<mujoco><option timestep="{dt}" integrator="RK4" cone="elliptic" impratio="100"/>
<worldbody><geom name="floor" type="plane" size="5 5 1" friction="0.2 0 0" {soft}/>
<body name="ball" pos="0 0 0.11"><freejoint name="flight"/>
<geom name="shell" size="0.11" density="900" friction="0.2 0 0" {soft}/></body></worldbody>
</mujoco>"""


def test_a_ball_of_a_file_rolls_as_that_of_mujoco_made_stiff():
    mujoco = pytest.importorskip("mujoco")
    m = lv.bodies.from_mjcf(FILE.format(dt=1e-3, soft=""))
    rates = (3, 1, 0, 2, -5, 1)
    run = lv.integrate(
        m.system(), lv.Spark(3), t=(0, 1), h=0.05, **m.start(rates={"flight": rates})
    )
    errors = []
    for dt in (1e-3, 2e-4):
        soft = f'solref="{2.02 * dt} 1" solimp="0.9999 0.9999 0.001"'
        data = mujoco.MjData(model := mujoco.MjModel.from_xml_string(FILE.format(dt=dt, soft=soft)))
        data.qvel[:] = rates
        for _ in range(round(1 / dt)):
            mujoco.mj_step(model, data)
        errors.append(np.abs(data.qpos[:3] - run.body("ball").position[-1]).max())
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 4


def test_what_friction_in_space_has_not_is_refused_by_name():
    system, call = block(0.3), {"t": (0, 1), "h": 0.1, "q": [0, 0, 0], "v": [1, 1, 0]}
    with pytest.raises(ValueError, match="the slip of contact 'c' must be one value, or two in"):
        lv.Lagrangian(
            lambda t, q, v, params: ca.sumsqr(v),
            q=3,
            contacts={
                "c": contact(lambda t, q, params: q[2], 0.3, slip=lambda t, q, v, params: v[:3])
            },
        )
    with pytest.raises(ValueError, match="of contacts 'floor', is for systems of up to 16 coord"):
        lv.Lagrangian(
            lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[2],
            q=17,
            contacts={"floor": contact(lambda t, q, params: q[2], 0.3)},
        )
    for method in (lv.HHT(alpha=-0.1), lv.GeneralizedAlpha(rho=0.9)):
        with pytest.raises(lv.IntegrationError, match="contact 'floor' sticks, which"):
            lv.integrate(system, method, **call)
        with pytest.raises(lv.IntegrationError, match="contact 'floor' slides from rest in space"):
            lv.integrate(block(0.1, slope=0.5), method, **{**call, "v": [0, 0, 0]})
