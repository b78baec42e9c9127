"""Plain contacts by hand: zero, rest, one and round numbers, beside closed forms."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

import liouville as lv
from liouville._runs.contacts.streak import Streak, refuse_endless

G = 9.81
METHODS = [lv.Spark(2), lv.LobattoPair(3)]
STEPS = [{"h": 0.1}, {"steps": 1}, {"rtol": 1e-8}]
FALL = np.sqrt(2 / G)  # from a height of 1


def block(friction=0.5, restitution=0.0, slope=0.0, g=G, off=0.0, twice=False):
    """Return a block on a floor at y = off, perhaps there twice, pulled along x by a slope."""
    floor = lv.Contact(
        lambda t, q, params: q[1] - off,
        friction=friction,
        restitution=restitution,
        slip=lambda t, q, v, params: v[0],
    )
    down, across = g * np.sin(slope), g * np.cos(slope)
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 + down * q[0] - across * q[1],
        q=("x", "y"),
        contacts={"floor": floor, "again": floor} if twice else {"floor": floor},
    )


def falls(height, speed, t):
    """Return height and speed of a flight after t."""
    return height + speed * t - G * t**2 / 2, speed - G * t


def pulled(slope, sign=1):
    return G * (np.sin(slope) - sign * 0.5 * np.cos(slope))


def stopped(slope):
    """Return what a speed of 2 up a slope comes to within 1: up, and down again where it slides."""
    slows, back = pulled(slope, -1), max(pulled(slope), 0.0)
    left = 1 - 2 / slows
    return [-2 / slows + back * left**2 / 2, 0], [back * left, 0]


EDGE = np.arctan(0.5)
REST = [0, 0], [0, 0]
UP = falls(0, np.sqrt(2 * G), 1 - FALL)
LOST = 3 - 0.1 * 2 * np.sqrt(2 * G)  # of a speed of 3, by the impulse 2 sqrt(2 g) at friction .1
#: What it is, q and v at the start, and those after 1.
CASES = {
    "at rest at 0": (block(), REST, REST),
    "at rest at 1": (block(off=1.0), ([1, 1], [0, 0]), ([1, 1], [0, 0])),
    "at rest without friction": (block(0.0), REST, REST),
    "at rest, elastic": (block(0.0, 1.0), REST, REST),
    "at rest on two equal floors": (block(twice=True), REST, REST),
    "weightless at rest": (block(g=0.0), REST, REST),
    "weightless along the floor": (block(g=0.0), ([0, 0], [1, 0]), ([1, 0], [1, 0])),
    "weightless and elastic": (block(0.0, 1.0, g=0.0), ([0, 0.5], [1, -1]), ([1, 0.5], [1, 1])),
    "weightless and plastic": (block(0.0, g=0.0), ([0, 0.5], [1, -1]), ([1, 0], [1, 0])),
    "weightless and rough": (block(0.5, g=0.0), ([0, 0.5], [1, -1]), ([0.75, 0], [0.5, 0])),
    "below the angle of friction": (block(slope=EDGE - 0.01), REST, REST),
    "at the angle of friction": (block(slope=EDGE), REST, REST),
    "above the angle of friction": (
        block(slope=EDGE + 0.01),
        REST,
        ([pulled(EDGE + 0.01) / 2, 0], [pulled(EDGE + 0.01), 0]),
    ),
    "up a slope that holds": (block(slope=0.3), ([0, 0], [-2, 0]), stopped(0.3)),
    "up a slope and down": (block(slope=0.6), ([0, 0], [-2, 0]), stopped(0.6)),
    "slides to rest": (block(), ([0, 0], [2, 0]), ([4 / G, 0], [0, 0])),
    "slides on two equal floors": (block(twice=True), ([0, 0], [2, 0]), ([4 / G, 0], [0, 0])),
    "dropped and plastic": (block(), ([0, 1], [0, 0]), REST),
    "dropped and elastic": (block(0.0, 1.0), ([0, 1], [0, 0]), ([0, UP[0]], [0, UP[1]])),
    "dropped, elastic and rough": (block(0.5, 1.0), ([0, 1], [0, 0]), ([0, UP[0]], [0, UP[1]])),
    "thrown, elastic and rough": (
        block(0.1, 1.0),
        ([0, 1], [3, 0]),
        ([3 * FALL + LOST * (1 - FALL), UP[0]], [LOST, UP[1]]),
    ),
    "dropped on two equal floors": (
        block(0.0, 1.0, twice=True),
        ([0, 1], [0, 0]),
        ([0, UP[0]], [0, UP[1]]),
    ),
    "leaves from touching": (
        block(restitution=0.5),
        ([0, 0], [0, 6]),
        ([0, falls(0, 6, 1)[0]], [0, falls(0, 6, 1)[1]]),
    ),
    "never comes there": (block(), ([0, 100], [1, 0]), ([1, 100 - G / 2], [1, -G])),
}


@pytest.mark.parametrize("name", CASES)
def test_plain_contacts_are_those_of_closed_forms(name):
    system, (q, v), (q_end, v_end) = CASES[name]
    for method in METHODS:
        for steps in STEPS:
            run = lv.integrate(system, method, t=(0, 1), q=q, v=v, **steps)
            np.testing.assert_allclose(run.q[-1], q_end, rtol=1e-13, atol=1e-13)
            np.testing.assert_allclose(run.v[-1], v_end, rtol=1e-13, atol=1e-13)
            assert run.message == ""


def test_an_ensemble_of_one_and_given_times_are_the_run():
    times = [0.1, 0.4, 0.5, 1.0]
    run = lv.integrate(block(), lv.Spark(2), t=(0, 1), h=0.1, q=[0, 0], v=[2, 0], t_eval=times)
    both = {"q": np.zeros((1, 2)), "v": [[2.0, 0]]}
    one = lv.ensemble(block(), lv.Spark(2), t=(0, 1), h=0.1, t_eval=times, **both)
    assert one.q[:, 0].tobytes() == run.q.tobytes()
    t = np.minimum(times, 4 / G)
    np.testing.assert_allclose(run.q[:, 0], 2 * t - G * t**2 / 4, atol=1e-15)


@pytest.mark.parametrize("slides", ["upper", "both"])
def test_a_stack_of_two_blocks_slides_apart(slides):
    contacts = {
        "floor": lv.Contact(
            lambda t, q, params: q[1], friction=0.5, slip=lambda t, q, v, params: v[0]
        ),
        "upper": lv.Contact(
            lambda t, q, params: q[3] - q[1] - 1,
            friction=0.2,
            slip=lambda t, q, v, params: v[2] - v[0],
        ),
    }
    stack = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * (q[1] + q[3]), q=4, contacts=contacts
    )
    start = {"q": [0, 0, 0, 1], "v": [slides == "both", 0, 1, 0]}
    lower = 0.5 / (0.8 * G) if slides == "both" else 0.0  # 2 mu g of the floor, less .2 g
    for steps in STEPS:
        run = lv.integrate(stack, lv.Spark(2), t=(0, 1), **start, **steps)
        np.testing.assert_allclose(run.q[-1], [lower, 0, 2.5 / G, 1], atol=1e-14)
        np.testing.assert_allclose(run.v[-1], 0, atol=1e-14)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("steps", [*STEPS, {"h": 0.25, "t_eval": [0.5, 1.0]}])
def test_a_hit_at_the_end_is_made(friction, steps):
    """A fall by g = 2 from 1 takes 1: its last record is behind the hit, by core and laws alike."""
    run = lv.integrate(
        block(friction, 0.5, g=2.0), lv.Spark(2), t=(0, 1), q=[0, 1], v=[0, 0], **steps
    )
    assert [(x.kind, x.t) for x in run.contacts["floor"].changes] == [("hit", 1.0)]
    np.testing.assert_allclose(run.v[-1], [0, 1], atol=1e-14)
    np.testing.assert_allclose(run.q[-1], 0, atol=1e-15)
    assert run.t[-1] == 1.0
    assert (np.diff(run.t) > 0).all()


def squeezed(restitution, **steps):
    """Run a ball between a wall at 0 and one that comes nearer by 1 - t."""
    walls = {
        "low": lv.Contact(lambda t, q, params: q[0], restitution=restitution),
        "high": lv.Contact(lambda t, q, params: 1 - t - q[0], restitution=restitution),
    }
    ball = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2, q=1, contacts=walls)
    call = {"t": (0, 2), "q": [0.5], "v": [0.1]} | steps
    return lv.integrate(ball, lv.Spark(2), **call)


@pytest.mark.parametrize(("restitution", "steps"), [(0.9, {"h": 0.05}), (1.0, {"rtol": 1e-8})])
def test_a_ball_between_walls_that_close_in_ends_by_their_names(restitution, steps):
    """It neither goes on without end nor falls through a wall."""
    words = "the hits of 'low' and 'high' come ever sooner and ever harder, without end until t = "
    with pytest.raises(lv.IntegrationError, match=words) as caught:
        squeezed(restitution, **steps)
    error = caught.value
    assert 0 <= error.t - error.solution.t[-1] < 1e-5
    assert 0.998 < error.t < 1
    assert float(str(error).split("t = ")[2].split("\n")[0]) == pytest.approx(1, abs=1e-4)
    assert error.solution.contacts["low"].gap.min() > -1e-12


@pytest.mark.parametrize("mass", [1e4, 1e6, 1e8])
def test_blocks_that_hit_pi_times_go_on_and_bounces_that_accumulate_end(mass):
    """Hits of blocks on a wall are at equal angles on a line, floor(pi / angle) in all."""
    angle, n = np.arctan(mass**-0.5), np.arange(1, 1000.0)
    blocks = np.arange(angle / 2, np.pi, 2 * angle)
    streak = Streak()
    for t, impulse in zip(-1 / np.tan(blocks), np.sin(blocks), strict=True):
        streak.hit(t, impulse)
        refuse_endless([streak], 0, ["wall"])
    for way in (1 / (n + 0.3), 1 / n**2, 0.9**n):
        streak = Streak()
        with pytest.raises(lv.IntegrationError, match="without end until t = 1"):  # noqa: PT012
            for t, impulse in zip(1 - way, n, strict=True):
                streak.hit(t, impulse)
                refuse_endless([streak], 0, ["wall"])


def test_a_ball_that_walls_squeeze_and_release_goes_on():
    """The gap 1 - .9 sin(t) shrinks to a tenth; speeds that grew ten times fall again."""
    walls = {
        "low": lv.Contact(lambda t, q, params: q[0], restitution=1.0),
        "high": lv.Contact(lambda t, q, params: 1 - 0.9 * ca.sin(t) - q[0], restitution=1.0),
    }
    ball = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2, q=1, contacts=walls)
    run = lv.integrate(ball, lv.Spark(2), t=(0, np.pi), h=0.05, q=[0.5], v=[5.0])
    assert np.abs(run.v).max() > 40
    assert abs(run.v[-1, 0]) == pytest.approx(5, rel=0.3)


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_tangents_refuse_a_graze_at_no_speed(steps):
    """The height (1 - t)^2 touches the floor and rises."""
    floor = lv.Contact(lambda t, q, params: q[0], restitution=0.5)
    body = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 + 2 * q[0], q=1, contacts={"floor": floor}
    )
    call = {"t": (0, 2), "steps": steps, "v": [-2.0], "tangents": {"q": [1.0]}}
    with pytest.raises(lv.IntegrationError, match="contact 'floor' is grazed at t = 1\n"):
        lv.integrate(body, lv.Spark(2), q=[1.0], **call)
    run = lv.integrate(body, lv.Spark(2), q=[1.0 + 1e-6], **call)
    assert run.tangents["q"].q[-1, 0] == pytest.approx(1)


def test_the_alpha_family_ends_by_name_where_a_contact_sticks():
    for method in (lv.GeneralizedAlpha(rho=0.9), lv.HHT(alpha=-0.1), lv.ArnoldBruls(rho=0.9)):
        call = {"t": (0, 1), "h": 0.1, "q": [0, 0], "v": [2, 0]}
        words = f"contact 'floor' sticks, which {type(method).__name__} does not hold"
        with pytest.raises(lv.IntegrationError, match=words) as caught:
            lv.integrate(block(), method, **call)
        assert caught.value.t == pytest.approx(4 / G, abs=1e-6)
        np.testing.assert_allclose(caught.value.solution.q[-1], [4 / G, 0], atol=1e-6)
        run = lv.integrate(block(0.0), method, **call)
        np.testing.assert_allclose(run.q[-1], [2, 0], atol=1e-14)


def touching(static, of_belt):
    """Return a block whose slip is (1 - t)^2 at friction 5, on ground or on a belt."""

    def belt(t):
        return 10 - 5 * t - (1 - t) ** 2 if of_belt else 0

    floor = lv.Contact(
        lambda t, q, params: q[1],
        friction=0.5,
        static_friction=static,
        slip=lambda t, q, v, params: v[0] - belt(t),
    )
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - 10 * q[1],
        q=2,
        force=None if of_belt else lambda t, q, v, params: [3 + 2 * t, 0],
        contacts={"floor": floor},
    )


@pytest.mark.parametrize("of_belt", [False, True])
@pytest.mark.parametrize("steps", [*STEPS, {"h": 0.07}, {"steps": 2}])
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_slip_that_touches_zero_sticks_where_static_friction_holds(method, steps, of_belt):
    call = {"t": (0, 2), "q": [0, 0], "v": [10.0 if of_belt else 1.0, 0], **steps}
    run = lv.integrate(touching(0.75, of_belt), method, **call)
    assert [x.kind for x in run.contacts["floor"].changes] == ["close", "stick"]
    assert run.contacts["floor"].changes[1].t == pytest.approx(1, abs=1e-7)
    assert run.q[-1, 0] == pytest.approx(10 - 1 / 3 if of_belt else 1 / 3, abs=1e-13)
    on = lv.integrate(touching(0.5, of_belt), method, **call)
    assert on.q[-1, 0] == pytest.approx(10 if of_belt else 2 / 3, abs=1e-13)


def test_derivatives_refuse_a_slip_that_touches_zero():
    call = {"t": (0, 2), "h": 0.1, "q": [0, 0], "v": [1.0, 0]}
    with pytest.raises(lv.IntegrationError, match=r"'floor: stop' .* t = 1"):
        lv.integrate(touching(0.75, False), lv.Spark(2), tangents={"v": [1.0, 0]}, **call)
    run, pullback = lv.vjp(touching(0.75, False), lv.Spark(2), wrt=["v"], **call)
    with pytest.raises(lv.IntegrationError, match=r"'floor: stop' .* t = 1"):
        pullback(q=np.ones_like(run.q))


def rod(first, **contacts):
    """Return a uniform rod of length and mass 1 by its centre and its angle, and its start."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (ca.sumsqr(v[:2]) + v[2] ** 2 / 12) / 2 - G * q[1],
        q=("x", "y", "angle"),
        contacts=contacts,
    )
    return system, {"q": [np.sin(first) / 2, np.cos(first) / 2, first], "v": np.zeros(3)}


@pytest.mark.parametrize("first", [0.3, 0.8])
def test_a_ladder_leaves_the_wall_at_two_thirds_of_its_height(first):
    floor = lv.Contact(lambda t, q, params: q[1] - ca.cos(q[2]) / 2)
    wall = lv.Contact(lambda t, q, params: q[0] - ca.sin(q[2]) / 2)
    ladder, start = rod(first, floor=floor, wall=wall)
    lies = lv.Event(lambda t, q, v, lam, params: q[2] - np.pi / 2, terminal=True)
    run = lv.integrate(ladder, lv.Spark(4), t=(0, 3), h=0.01, events={"lies": lies}, **start)
    assert [x.kind for x in run.contacts["wall"].changes] == ["close", "leave"]
    left = run.contacts["wall"].changes[-1].t
    k = np.searchsorted(run.t, left)
    assert run.q[k, 1] / run.q[0, 1] == pytest.approx(2 / 3, abs=1e-13)
    speed = np.cos(first) ** 1.5 * np.sqrt(G) / 3  # of the centre, which nothing changes any more
    assert run.v[-1, 0] == pytest.approx(speed, abs=1e-13)


@pytest.mark.parametrize("mu", [0.2, 0.3, 0.45, 0.8])
def test_the_foot_of_a_toppling_rod_slips_where_its_load_says(mu):
    """Below 0.37 it slips back at first, above forwards at once."""

    def ratio(angle, first=0.1):
        c, s, fallen = np.cos(angle), np.sin(angle), np.cos(first) - np.cos(angle)
        return 0.75 * s * (c - 2 * fallen) / (1 - 0.75 * s**2 - 1.5 * c * fallen)

    foot = lv.Contact(
        lambda t, q, params: q[1] - ca.cos(q[2]) / 2,
        friction=mu,
        slip=lambda t, q, v, params: v[0] - ca.cos(q[2]) / 2 * v[2],
    )
    system, start = rod(0.1, foot=foot)
    run = lv.integrate(system, lv.Spark(4), t=(0, 0.81), h=5e-3, **start)
    slip = next(x.t for x in run.contacts["foot"].changes if x.kind == "slip")
    sign, spans = (1, (0.1, 0.6)) if mu < 0.37 else (-1, (0.8, 1.0))
    wanted = brentq(lambda angle: ratio(angle) - sign * mu, *spans, xtol=1e-15)
    k = np.searchsorted(run.t, slip)
    assert run.q[k, 2] == pytest.approx(wanted, abs=1e-11)
    assert run.contacts["foot"].mode[k + 1].sign == -sign
    assert run.contacts["foot"].mode[-1].sign == 1


def test_a_block_on_a_table_that_shakes_slips_and_sticks_when_closed_forms_say():
    a, omega, mu = 0.02, 20.0, 0.5
    table = lv.Contact(
        lambda t, q, params: q[1],
        friction=mu,
        slip=lambda t, q, v, params: v[0] - a * omega * ca.cos(omega * t),
    )
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1], q=2, contacts={"table": table}
    )
    start = {"q": [0.0, 0.0], "v": [a * omega, 0.0]}
    run = lv.integrate(system, lv.Spark(2), t=(0, 1), h=5e-3, **start)
    slips = [x.t for x in run.contacts["table"].changes if x.kind == "slip"]
    first = np.arcsin(mu * G / (a * omega**2)) / omega
    np.testing.assert_allclose(slips, first + np.arange(7) * np.pi / omega, atol=1e-14)

    def behind(t):
        return a * omega * (np.cos(omega * t) - np.cos(omega * first)) + mu * G * (t - first)

    stops = [x.t for x in run.contacts["table"].changes if x.kind == "stick"][1:]
    last = brentq(behind, np.pi / omega, 0.19, xtol=1e-16)
    np.testing.assert_allclose(stops, last + np.arange(6) * np.pi / omega, atol=1e-13)


@pytest.mark.parametrize("steps", STEPS[::2])
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_disc_that_passes_an_edge_fast_leaves_where_it_passes(method, steps):
    """Behind the edge it would have to be pulled: v^2 > g r."""
    table = lv.Contact(lambda t, q, params: ca.if_else(q[0] < 0, q[1], ca.hypot(q[0], q[1])) - 0.1)
    disc = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        q=("x", "y"),
        contacts={"table": table},
    )
    for speed in (1.0, 1.2, 2.0):
        run = lv.integrate(disc, method, t=(0, 0.5), q=[-0.3, 0.1], v=[speed, 0], **steps)
        _, leave = run.contacts["table"].changes
        assert leave.kind == "leave"
        assert leave.t == pytest.approx(0.3 / speed, abs=1e-8)
        height, _ = falls(0.1, 0.0, 0.5 - 0.3 / speed)
        np.testing.assert_allclose(run.q[-1], [speed * 0.5 - 0.3, height], atol=1e-8)


@pytest.mark.parametrize("steps", STEPS[::2])
def test_a_disc_that_rolls_past_an_edge_fast_leaves_where_it_passes(steps):
    """Friction and load jump there at once."""
    table = lv.Contact(
        lambda t, q, params: ca.if_else(q[0] < 0, q[1], ca.hypot(q[0], q[1])) - 0.1,
        friction=0.5,
        slip=lambda t, q, v, params: v[0] + 0.1 * v[2],
    )
    disc = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2 + 0.005 * v[2] ** 2) / 2 - G * q[1],
        q=("x", "y", "turn"),
        contacts={"table": table},
    )
    for speed in (1.0, 1.04, 2.0):
        start = {"q": [-0.3, 0.1, 0], "v": [speed, 0, -10 * speed]}
        run = lv.integrate(disc, lv.Spark(2), t=(0, 0.5), **start, **steps)
        leave = run.contacts["table"].changes[-1]
        assert leave.kind == "leave"
        assert leave.t == pytest.approx(0.3 / speed, abs=1e-8)
        height, _ = falls(0.1, 0.0, 0.5 - 0.3 / speed)
        np.testing.assert_allclose(run.q[-1, :2], [speed * 0.5 - 0.3, height], atol=1e-7)
