"""Resets of events: impacts by closed forms, momenta on constraints, and runs that Zeno ends."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville import problems

pendulum = problems.load("pendulum")
ball = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0], q=("height",))


def height(t, q, v, lam, params):
    return q[0]


def ground(loss, **more):
    return {"ground": lv.Event(height, "down", reset=lv.Impact(loss), **more)}


def drop(method, t, events, h=0.07, **more):
    """Let the ball fall from 1/2: it meets the ground at t = 1 with speed 1."""
    call = {"q": [0.5], "v": [0.0], "h": h, **more}
    return lv.integrate(ball, method, t=t, events=events, **call)


def bounces(loss, count):
    """Return when the ball is on the ground, and its speeds after it."""
    speeds = loss ** np.arange(1, count + 1)
    return 1 + np.concatenate([[0], np.cumsum(2 * speeds[:-1])]), speeds


CONTROLS = {
    "equal": (lv.Spark(2), {}),
    "rattle": (lv.LobattoPair(2), {}),
    "composed": (lv.Composition(lv.LobattoPair(2), "Y4"), {}),
    "alpha": (lv.HHT(0.0), {}),
    "index 3": (lv.ArnoldBruls(1.0), {}),
    "controlled": (lv.Spark(2), {"h": None, "rtol": 1e-8}),
    "reversible": (lv.Spark(2), {"control": lv.Reversible()}),
    "tolerant": (lv.HHT(0.0), {"h": None, "rtol": 1e-8}),
}


def test_a_run_has_states_one_rounding_before_its_events():
    """A part whose start and length add up to less than its end made no record, an IndexError."""
    for k in range(60):
        run = drop(lv.Spark(2), (0, 3.0), ground(0.8), h=None, rtol=10 ** (-6 - k / 20))
        assert run(np.nextafter(run.events["ground"].t, 0)).v.max() < 0


@pytest.mark.parametrize("kind", CONTROLS)
def test_a_ball_bounces_as_its_closed_form_says(kind):
    method, more = CONTROLS[kind]
    run = drop(method, (0, 8.4), ground(0.8), **more)
    times, speeds = bounces(0.8, 12)
    hits, count = run.events["ground"], int((times < 8.4).sum())
    assert len(hits) == count > 8
    np.testing.assert_allclose(hits.t, times[:count], rtol=1e-12)
    np.testing.assert_allclose(hits.v[:, 0], -speeds[:count] / 0.8, rtol=1e-11)
    np.testing.assert_allclose(hits.v_after[:, 0], speeds[:count], rtol=1e-11)
    np.testing.assert_array_equal(hits.q, hits.q_after)
    # between two hits the height is that of the parabola, on each side by itself
    middle = (hits.t[1:] + hits.t[:-1]) / 2
    np.testing.assert_allclose(run(middle).q[:, 0], speeds[: count - 1] ** 2 / 2, rtol=1e-11)
    np.testing.assert_array_equal(run(hits.t).v, hits.v_after)
    assert run(np.nextafter(hits.t, 0)).v.max() < 0
    assert run.message == (
        "reversible steps for rtol, as nothing changes the energy" if kind == "tolerant" else ""
    )
    if not more:
        np.testing.assert_array_equal(run.t, np.arange(len(run.t)) * run.h)
        assert run.stats["steps"] == len(run.t) - 1


@pytest.mark.parametrize("loss", [0.8, 0.05])
def test_hits_that_accumulate_end_the_run(loss):
    run = drop(lv.Spark(2), (0, 20), ground(loss))
    end = 1 + 2 * loss / (1 - loss)
    assert run.status == "done"
    assert run.message.startswith(f"the hits of 'ground' accumulate at t = {end:.6g}, and the run")
    assert run.t[-1] == pytest.approx(end, abs=2e-8)
    assert run.t[-1] == pytest.approx(run.events["ground"].t[-1], abs=1e-9)
    assert len(run.events["ground"]) < 120
    assert 0 < run.v[-1, 0] < 1e-8
    # on a ground whose place is rounded, too
    raised = {
        "ground": lv.Event(lambda t, q, v, lam, params: q[0] - 1, "down", reset=lv.Impact(loss))
    }
    run = drop(lv.Spark(2), (0, 20), raised, q=[1.5])
    assert f"accumulate at t = {end:.6g}" in run.message
    assert run.q.min() > 1 - 1e-12


def test_a_ball_without_rebound_stays_and_one_that_is_pulled_away_does_not():
    run = drop(lv.Spark(2), (0, 3), ground(0.0))
    assert run.message.startswith("the hits of 'ground' accumulate at t = 1, and")
    assert (run.t[-1], run.v[-1, 0]) == (pytest.approx(1, rel=1e-14), pytest.approx(0, abs=1e-15))
    swing = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - ca.sin(t) * q[0], q=1)
    run = lv.integrate(swing, lv.Spark(4), t=(0, 5), h=0.05, q=[1.0], v=[0.0], events=ground(0.0))
    assert run.message.startswith("the hits of 'ground' accumulate at t = ")
    late = lv.integrate(
        swing, lv.Spark(4), t=(3.3, 5), h=0.05, q=[0.001], v=[-1.0], events=ground(0.0)
    )
    assert len(late.events["ground"]) == 1
    assert not late.message
    assert late.q[-1, 0] > 0


def test_a_pendulum_hits_a_wall():
    """Its only freedom is reversed and loses its part; the impulse of the rod holds it."""
    wall = {"wall": lv.Event(lambda t, q, v, lam, params: q[0] - 0.3, "up", reset=lv.Impact(0.6))}
    run = lv.integrate(
        pendulum.system, lv.Spark(4), t=(0, 3), h=0.05, events=wall, q=(-0.8, -0.6), v=(0, 0)
    )
    hits = run.events["wall"]
    assert len(hits) == 2
    np.testing.assert_allclose(hits.v_after, -0.6 * hits.v, rtol=1e-13)
    speed = np.sum(hits.v**2, axis=1)
    drop_of = 2 * 9.81 * (np.sqrt(1 - 0.3**2) - 0.6)
    np.testing.assert_allclose(speed, [drop_of, 0.36 * drop_of], rtol=1e-8)
    for name in ("constraint", "hidden"):
        assert np.abs(run.residuals[name]).max() < 1e-14
    assert not run.message  # the watch over the energy knows of the losses
    # the rod pulls less after the impact, at the same place
    np.testing.assert_allclose(
        np.diff(np.stack([hits.lam, hits.lam_after]), axis=0)[0, :, 0],
        -0.64 * speed,
        rtol=1e-11,
    )


def chain(t, q, params):
    return {"first": ca.sumsqr(q[:2]) - 1, "second": ca.sumsqr(q[2:] - q[:2]) - 1}


M = np.diag([2.0, 2.0, 1.0, 1.0])
double = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, ca.mtimes(ca.DM(M), v)) / 2 - 9.81 * (2 * q[1] + q[3]),
    chain,
    q=("x", "y", "u", "w"),
)
START = double.consistent(q=(-0.7, -0.7, -1.6, -0.9), v=(0, 0, 0, 0))


def gradients(q):
    x, y, u, w = q
    return 2 * np.array([[x, y, 0, 0], [x - u, y - w, u - x, w - y]])


@pytest.mark.parametrize("method", [lv.Spark(3), lv.HHT(0.0)], ids=repr)
@pytest.mark.parametrize("law", ["impact", "function"])
def test_rods_hold_by_their_impulses(method, law):
    """What is not along their gradients is the impulse of the wall, or the jump asked for."""
    kick = lambda t, q, v, lam, params: [v[0], v[1], -0.5 * v[2], v[3] + 1]  # noqa: E731
    reset = lv.Impact(0.5) if law == "impact" else kick
    wall = {
        "wall": lv.Event(lambda t, q, v, lam, params: q[2] - 0.4, "up", reset=reset, terminal=2)
    }
    run = lv.integrate(double, method, t=(0, 6), h=0.01, events=wall, **START)
    hits = run.events["wall"]
    assert len(hits) == 2
    for name in ("constraint", "hidden"):
        assert np.abs(run.residuals[name]).max() < 1e-13
    for q, v, after in zip(hits.q, hits.v, hits.v_after, strict=True):
        wanted = v if law == "impact" else np.array([v[0], v[1], -0.5 * v[2], v[3] + 1])
        rods = gradients(q)
        assert np.abs(rods @ after).max() < 1e-13
        along = np.vstack([rods, [0, 0, 1, 0]]) if law == "impact" else rods
        jump = M @ (after - wanted)
        impulses = np.linalg.lstsq(along.T, jump, rcond=None)[0]
        assert np.abs(along.T @ impulses - jump).max() < 1e-12
        if law == "impact":
            assert after[2] == pytest.approx(-0.5 * v[2], rel=1e-12)
            assert impulses[2] < 0
    np.testing.assert_array_equal(run.v[-1], hits.v_after[-1])
    assert run.t[-1] == hits.t[-1]


def test_positions_are_moved_to_the_constraints_and_what_cannot_be_is_refused():
    def start(to):
        event = lv.Event(lambda t, q, v, lam, params: q[0] - 0.5, "up", reset=to)
        return lv.integrate(
            pendulum.system,
            lv.Spark(3),
            t=(0, 2),
            h=0.05,
            events={"gate": event},
            q=(0, -1),
            v=(4, 0),
        )

    run = start(lambda t, q, v, lam, params: {"q": [-0.6, -0.9]})
    hit = run.events["gate"]
    np.testing.assert_allclose(
        hit.q_after[0], np.array([-0.6, -0.9]) / np.hypot(0.6, 0.9), rtol=1e-13
    )
    assert abs(hit.q_after[0] @ hit.v_after[0]) < 1e-14
    assert np.abs(run.residuals["constraint"]).max() < 1e-14
    with pytest.raises(
        lv.IntegrationError,
        match=r"(?s)the reset of event 'gate' at t = 0\.134815 cannot be made consistent: "
        r"constraint 'rod' stays at -5.0e-01\nhint: return states near to the constraints",
    ) as info:
        start(lambda t, q, v, lam, params: {"q": [0.0, 0.0]})
    assert len(info.value.solution.events["gate"]) == 0
    with pytest.raises(lv.IntegrationError, match=r"reset 'gate' is not finite at t = 0\.134815"):
        start(lambda t, q, v, lam, params: ca.log(-q[0]) * v)


def test_an_impact_that_nothing_can_yield_to_is_refused():
    fixed = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2, lambda t, q, params: q[0] - t, q=("x", "y")
    )
    wall = {"wall": lv.Event(lambda t, q, v, lam, params: q[0] - 0.5, reset=lv.Impact())}
    with pytest.raises(
        lv.IntegrationError, match=r"event 'wall' at t = 0\.5 finds nothing that gives"
    ):
        lv.integrate(fixed, lv.Spark(2), t=(0, 1), h=0.1, events=wall, q=(0, 0), v=(1, 1))


def test_a_corner_resets_both_and_plain_events_of_the_same_time_are_kept():
    free = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2, q=("x", "y"))
    events = {
        "right": lv.Event(lambda t, q, v, lam, params: q[0] - 1, "up", reset=lv.Impact()),
        "seen": lambda t, q, v, lam, params: q[0] - 1,
        "top": lv.Event(lambda t, q, v, lam, params: q[1] - 1, "up", reset=lv.Impact(0.5)),
    }
    run = lv.integrate(free, lv.Spark(1), t=(0, 2), h=0.3, events=events, q=(0, 0), v=(1, 1))
    assert [len(run.events[name]) for name in events] == [1, 1, 1]
    np.testing.assert_allclose(run.v[-1], [-1, -0.5], rtol=1e-14)
    np.testing.assert_allclose(run.q[-1], [0, 0.5], atol=1e-14)
    np.testing.assert_allclose(run([0.5, 1.5]).q, [[0.5, 0.5], [0.5, 0.75]], rtol=1e-14)
    np.testing.assert_allclose(run(run.events["right"].t).v, [[-1, -0.5]], rtol=1e-14)


def test_counts_and_directions_work_together_with_resets():
    run = drop(lv.Spark(2), (0, 9), ground(0.8, terminal=3))
    times, speeds = bounces(0.8, 3)
    assert run.message == "event 'ground' at t = 3.88"
    np.testing.assert_allclose(run.t[-1], times[-1], rtol=1e-13)
    np.testing.assert_allclose(run.v[-1, 0], speeds[-1], rtol=1e-12)
    through = {
        "gate": lv.Event(lambda t, q, v, lam, params: q[0] - 0.2, "up", reset=lv.Impact(0.5))
    }
    run = drop(lv.Spark(2), (0, 1.5), through | ground(1.0))
    assert len(run.events["gate"]) == 1
    assert run.events["gate"].v_after[0, 0] == pytest.approx(-0.5 * np.sqrt(0.6), rel=1e-12)


def test_given_times_are_recorded_on_both_sides():
    whole = drop(lv.Spark(3), (0, 4), ground(0.8), h=0.31)
    hits = whole.events["ground"].t
    times = np.unique(np.concatenate([np.linspace(0, 4, 61), hits, np.nextafter(hits, 0)]))
    some = drop(lv.Spark(3), (0, 4), ground(0.8), h=0.31, t_eval=times)
    np.testing.assert_array_equal(some.t, times)
    found = whole(times)
    for name in ("q", "v", "p"):
        np.testing.assert_allclose(some.states[name], found.states[name], atol=1e-12)
    after = np.isin(times, hits)
    np.testing.assert_array_equal(some.v[after], whole.events["ground"].v_after)


bowl = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1], q=("x", "y"), params={"g": 1.0}
)


def depth(t, q, v, lam, params):
    return q[1] - q[0] ** 2 / 2


def test_members_of_an_ensemble_have_the_bits_of_single_runs(tmp_path):
    starts, g = np.array([[0.6, 1.5], [0.1, 1.0], [0.3, 0.8]]), np.array([1.0, 2.0, 1.5])
    events = {
        "wall": lv.Event(depth, "down", reset=lv.Impact(0.9), terminal=6),
        "low": lambda t, q, v, lam, params: q[1] - 0.3,
    }
    call = {"t": (0, 9), "h": 0.1, "events": events}
    many = lv.ensemble(bowl, lv.Spark(2), q=starts, v=np.zeros(2), params={"g": g}, **call)
    assert many.status == "done"
    many.save(tmp_path / "many.nc")
    loaded = lv.load(tmp_path / "many.nc")
    for k in range(3):
        one = lv.integrate(
            bowl, lv.Spark(2), q=starts[k], v=np.zeros(2), params={"g": g[k]}, **call
        )
        own = many.member(k)
        assert own.message == one.message == loaded.member(k).message
        assert own.message.startswith("event 'wall'") == (k in many.endings)
        rows = len(own.t)
        np.testing.assert_array_equal(own.q, one.q[:rows])
        assert len(one.t) - rows == (k in many.endings)  # the end itself is between the others
        for name in events:
            for found in (own, loaded.member(k)):
                assert list(found.events[name].states) == list(one.events[name].states)
                assert found.events[name].t.tobytes() == one.events[name].t.tobytes()
                for state, x in one.events[name].states.items():
                    assert found.events[name].states[state].tobytes() == x.tobytes()
        inside = one.t[:rows][:-1] + 0.05
        np.testing.assert_array_equal(own(inside).q, one(inside).q)
    assert 0 < len(many.endings) < 3
    few = many.sel(coordinate=["y"]).events["wall"]
    assert few.v_after.shape == (len(few), 1)
    with (
        ThreadPoolExecutor(1) as executor,
        pytest.raises(TypeError, match="an ensemble on an executor has no events"),
    ):
        lv.ensemble(bowl, lv.Spark(2), q=starts, v=np.zeros(2), executor=executor, **call)


def test_hamiltonian_and_semi_explicit_systems_are_reset_too():
    fall = lv.Hamiltonian(lambda t, q, p, params: p[0] ** 2 / 4 + 2 * q[0], q=1)
    for reset in (lv.Impact(0.5), lambda t, q, p, lam, params: -0.5 * p):
        met = lv.Event(lambda t, q, p, lam, params: q[0], "down", reset=reset)
        event = {"ground": met}
        run = lv.integrate(fall, lv.Spark(2), t=(0, 1.7), h=0.1, events=event, q=[0.5], p=[0.0])
        np.testing.assert_allclose(run.events["ground"].p_after[:, 0], [1.0], rtol=1e-13)
        np.testing.assert_allclose(run.events["ground"].v_after[:, 0], [0.5], rtol=1e-13)
    # y' = z on a circle of which y = (cos, sin): jumps to where the reset says, and z follows
    circle = lv.SemiExplicit(
        field=lambda t, y, z, params: [-y[1] + y[0] * z[0], y[0] + y[1] * z[0]],
        constraint=lambda t, y, params: ca.sumsqr(y) - 1,
        y=2,
        z=1,
    )
    gate = {
        "gate": lv.Event(lambda t, y, z, params: y[1] - 0.5, reset=lambda t, y, z, params: [2, 0])
    }
    run = lv.integrate(circle, lv.Spark(3), t=(0, 1.2), h=0.1, events=gate, y=[1, 0])
    np.testing.assert_allclose(run.events["gate"].t, [np.pi / 6, np.pi / 3], rtol=1e-9)
    np.testing.assert_allclose(run.events["gate"].y_after, [[1, 0]] * 2, atol=1e-14)
    assert np.abs(run.residuals["constraint"]).max() < 1e-14
    hit = {"gate": lv.Event(lambda t, y, z, params: y[1] - 0.5, reset=lv.Impact())}
    with pytest.raises(TypeError, match="event 'gate' has an Impact, and its system has no masses"):
        lv.integrate(circle, lv.Spark(3), t=(0, 1.2), h=0.1, events=hit, y=[1, 0])


def test_a_run_back_in_time_takes_impacts_without_loss_alone():
    there = drop(lv.Spark(2), (0, 4.5), ground(1.0))
    back = drop(lv.Spark(2), (4.5, 0), ground(1.0), q=there.q[-1], v=there.v[-1])
    np.testing.assert_allclose(back.events["ground"].t[::-1], there.events["ground"].t, rtol=1e-12)
    np.testing.assert_allclose([back.q[-1, 0], back.v[-1, 0]], [0.5, 0], atol=1e-13)
    np.testing.assert_allclose(back([0.5, 1.5]).q, there([0.5, 1.5]).q, rtol=1e-12)
    with pytest.raises(
        ValueError, match=r"event 'ground' has a reset, and the run goes back in time"
    ):
        drop(lv.Spark(2), (5, 0), ground(0.9))


def test_wrong_resets_are_refused():
    for reset, message in (
        (3, "reset must be an Impact or a function, not 3"),
        (
            lambda t, q, v, lam, params: [1, 2],
            "the reset of event 'e' 'v' must return 1 value, not 2",
        ),
        (
            lambda t, q, v, lam, params: {"w": v},
            "the reset of event 'e' gives 'w', which is none of q",
        ),
        (lambda t, q, v: v, r"the reset of event 'e' is called with \(t, q, v, lam, params\)"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            drop(lv.Spark(2), (0, 1), {"e": lv.Event(height, reset=reset)})
    with pytest.raises(ValueError, match=r"restitution must be from 0 to 1, not 1\.5"):
        lv.Impact(1.5)
    with pytest.raises(TypeError, match="restitution must be a number or a function, not 'all'"):
        lv.Impact("all")
    turn = lv.Event(lambda t, q, v, lam, params: v[0], reset=lv.Impact())
    with pytest.raises(ValueError, match="event 'e' has an Impact, whose gradient is that of a"):
        drop(lv.Spark(2), (0, 1), {"e": turn})


def test_restitution_may_depend_on_the_state():
    law = lv.Impact(lambda t, q, v, lam, params: 1 / (1 + ca.fabs(v[0])))
    run = drop(lv.Spark(2), (0, 3), {"ground": lv.Event(height, "down", reset=law)})
    np.testing.assert_allclose(run.events["ground"].v_after[:2, 0], [1 / 2, 1 / 3], rtol=1e-12)


def test_a_reset_may_give_some_entries_by_coordinate_and_the_balance_names_its_work():
    point = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2) / 2 - 9.81 * q[1], q=("x", "y")
    )
    law = lv.Event(
        lambda t, q, v, lam, params: q[1],
        "down",
        reset=lambda t, q, v, lam, params: {"v": {"y": -v[1] / 2}},
    )
    call = {"t": (0, 1), "h": 0.05, "q": [0, 1], "v": [2.0, 0]}
    run = lv.integrate(point, lv.Spark(2), events={"ground": law}, **call)
    hits = run.events["ground"]
    assert hits.v_after == pytest.approx(hits.v * [1, -0.5], abs=1e-12)
    balance = lv.analysis.power_balance(run)
    lost = -0.75 * (hits.v[:, 1] ** 2).sum() / 2
    assert balance.work["impacts"][[0, -1]] == pytest.approx([0, lost], abs=1e-12)
    assert np.abs(balance.defect).max() < 1e-11
    wrong = lv.Event(law.function, reset=lambda t, q, v, lam, params: {"v": {"z": 0.0}})
    with pytest.raises(ValueError, match="'v' has a value for 'z', which is no coordinate"):
        lv.integrate(point, lv.Spark(2), events={"ground": wrong}, **call)


@pytest.mark.parametrize("h", [0.05, 0.4])
def test_the_balance_parts_steps_at_resets(h):
    rubbed = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - 9.81 * q[0],
        q=("height",),
        force=lambda t, q, v, params: -0.1 * v,
    )
    ground = lv.Event(height, "down", reset=lv.Impact(0.5))
    call = {"t": (0, 0.8), "h": h, "q": [1.0], "v": [0.0]}
    run = lv.integrate(rubbed, lv.Spark(5), events={"ground": ground}, **call)
    assert len(run.events["ground"].t) == 1
    assert np.abs(lv.analysis.power_balance(run).defect).max() < 1e-10


FREE = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2, q=1)


@pytest.mark.parametrize("kept", [{}, {"t_eval": [0, 0.5, 1.0]}], ids=["steps", "times"])
@pytest.mark.parametrize("h", [0.25, 0.3], ids=["at an end of a step", "within one"])
def test_a_record_at_the_time_of_a_reset_is_of_the_state_after_it(h, kept, tmp_path):
    def at_one(*args):
        return args[0] - 1

    double = lv.Event(at_one, reset=lambda t, q, v, lam, p: 2 * v)
    triple = lv.Event(at_one, reset=lambda t, q, v, lam, p: 3 * v, terminal=True)
    call = {"t": (0, 2), "h": h, "q": [0], "v": [1], **kept}
    run = lv.integrate(FREE, lv.Spark(2), events={"double": double, "triple": triple}, **call)
    assert (run.t[-2] < 1, run.t[-1], run.v[-1, 0]) == (True, 1, 6)
    assert run.message == "event 'triple' at t = 1"
    goes_on = lv.integrate(FREE, lv.Spark(2), events={"double": double}, **call)
    if h == 0.25 or kept:
        assert goes_on.v[goes_on.t == 1] == 2
    assert goes_on.message == ""
    if not kept:
        store = lv.Store(tmp_path / "run.zarr", checkpoint=1)
        stored = lv.integrate(FREE, lv.Spark(2), events={"double": double}, store=store, **call)
        whole = lv.load(tmp_path / "run.zarr")
        assert np.array_equal(whole.t, goes_on.t)
        assert np.array_equal(whole.v, goes_on.v)
        assert stored.message == ""


@pytest.mark.parametrize(("direction", "met"), [("down", True), ("both", False), ("up", False)])
def test_a_ball_that_starts_on_its_ground_needs_a_direction(direction, met):
    ball = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - q[0], q=1)
    ground = lv.Event(lambda t, q, v, lam, p: q[0], direction, reset=lv.Impact(0.5))
    call = {"t": (0, 0.9), "h": 0.1, "q": [0], "v": [-1]}
    run = lv.integrate(ball, lv.Spark(2), events={"ground": ground}, **call)
    assert run.events["ground"].t.tolist() == [0.0] * met
    assert run.v[0, 0] == (0.5 if met else -1)
    assert (run.q[-1, 0] > 0) == met
    assert run.message == ""


@pytest.mark.parametrize("kind", ["equal", "rattle", "controlled", "reversible", "alpha"])
def test_a_hit_at_the_end_of_a_run_is_of_that_run(kind):
    """It is reset there, and the run that goes on has left the ground."""
    method, more = CONTROLS[kind]
    more = {"h": 0.125} | more
    first = drop(method, (0, 1), ground(0.8), **more)
    hit = first.events["ground"]
    np.testing.assert_allclose([hit.t, hit.v[:, 0], hit.v_after[:, 0]], [[1], [-1], [0.8]], 1e-12)
    np.testing.assert_array_equal(first.v[-1], hit.v_after[-1])
    again = drop(method, (1, 2.6), ground(0.8), **more | {"q": first.q[-1], "v": first.v[-1]})
    np.testing.assert_allclose(again.events["ground"].t, [2.6], rtol=1e-12)
    last = drop(method, (1, 2.6), ground(0.8, terminal=True), **more | {"q": [0], "v": first.v[-1]})
    assert last.message == "event 'ground' at t = 2.6"
    np.testing.assert_allclose(last.v[-1], [0.64], rtol=1e-12)


@pytest.mark.parametrize("names", [("x", "y", "end"), ("end", "y", "x"), ("y", "end", "x")])
@pytest.mark.parametrize("last", [True, False], ids=["at the end", "ended"])
def test_all_resets_of_the_time_at_which_a_run_ends_are_made(names, last):
    """In a corner, at the end of the run or where an event ends it, however they are listed."""
    square = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2, q=("x", "y"))
    events = {
        "x": lv.Event(lambda t, q, v, lam, params: q[0] - 1, "up", reset=lv.Impact()),
        "y": lv.Event(lambda t, q, v, lam, params: q[1] - 1, "up", reset=lv.Impact(0.5)),
        "end": lv.Event(lambda t, q, v, lam, params: q[0] + q[1] - 2, terminal=not last),
    }
    call = {"t": (0, 1 if last else 2), "h": 0.25, "q": (0, 0), "v": (1, 1)}
    run = lv.integrate(square, lv.Spark(2), events={name: events[name] for name in names}, **call)
    assert [run.events[name].t.tolist() for name in names] == [[1.0]] * 3
    np.testing.assert_allclose(run.v[-1], [-1, -0.5], rtol=1e-14)
    assert run.message == ("" if last else "event 'end' at t = 1")


def test_a_second_reset_at_the_end_is_left_out_where_the_first_turns_the_motion():
    """Two walls at one place, of which the first sends the ball back."""
    events = {
        name: lv.Event(lambda t, q, v, lam, params: q[0] - 1, "up", reset=lv.Impact(loss))
        for name, loss in (("first", 0.5), ("second", 0.25))
    }
    for end in (1, 1.5):
        run = lv.integrate(FREE, lv.Spark(2), t=(0, end), h=0.25, q=[0], v=[1], events=events)
        assert [len(points) for points in run.events.values()] == [1, 0]
        assert run.v[-1, 0] == -0.5


@pytest.mark.parametrize(("turned", "last"), [(0.0, 100.5), (1.0, 0.5)])
@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(2), lv.HHT()], ids=repr)
def test_a_second_reset_at_the_end_is_made_where_the_first_leaves_its_event_at_zero(
    method, turned, last
):
    """With `turned` the second event's function jumps from 0 to 1.5 at the first reset."""
    events = {
        "end": lv.Event(
            lambda t, q, v, lam, params: t - 1, terminal=True,
            reset=lambda t, q, v, lam, params: -0.5 * v,
        ),
        "kick": lv.Event(
            lambda t, q, v, lam, params: t - 1 + turned * (v[0] + 1),
            reset=lambda t, q, v, lam, params: v + 100,
        ),
    }  # fmt: skip
    run = lv.integrate(FREE, method, t=(0, 2), steps=7, q=[0.5], v=[-1], events=events)
    assert run.v[-1, 0] == pytest.approx(last, rel=1e-12)
    assert [len(points) for points in run.events.values()] == [1, int(last > 1)]


def test_hits_that_are_short_but_do_not_shrink_end_the_run_too():
    free = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2, q=1)
    width, impact = 1e-9, lv.Impact(1.0)
    walls = {
        "left": lv.Event(lambda t, q, v, lam, params: q[0], "down", reset=impact),
        "right": lv.Event(lambda t, q, v, lam, params: width - q[0], "down", reset=impact),
    }
    run = lv.integrate(free, lv.Spark(2), t=(0, 0.1), steps=1, q=[width / 2], v=[1.0], events=walls)
    hits = np.sort(np.concatenate([run.events[name].t for name in walls]))
    assert "follow one another so fast at t = " in run.message
    assert "accumulate" not in run.message
    assert 64 <= len(hits) < 1000
    assert np.abs(np.diff(hits) / width - 1).max() < 1e-6
    # wider, each of as many hits is one
    width = 1e-6
    run = lv.integrate(
        free, lv.Spark(2), t=(0, 2e-4), steps=1, q=[width / 2], v=[1.0],
        events={
            "left": walls["left"],
            "right": lv.Event(lambda t, q, v, lam, params: width - q[0], "down", reset=impact),
        },
    )  # fmt: skip
    assert run.message == ""
    assert sum(len(x.t) for x in run.events.values()) == 200
