"""Events: found where closed forms have them, all of them, and nothing else changed by it."""

import casadi as ca
import mpmath
import numpy as np
import pytest
from scipy import optimize

import liouville as lv
from liouville import problems

pendulum = problems.load("pendulum")
G = 9.81


def spin(t, q, v, lam, params):
    """Angular momentum: it vanishes where the pendulum turns."""
    return q[0] * v[1] - q[1] * v[0]


def quarter(amplitude):
    """Return the time from the lowest point to the turning point, to 30 digits."""
    with mpmath.workdps(30):
        k = mpmath.sin(mpmath.mpf(amplitude) / 2)
        return mpmath.ellipk(k**2) / mpmath.sqrt(mpmath.mpf("9.81"))


def swinging(amplitude):
    """Start at the lowest point with the speed that just leads to this angle."""
    speed = 2 * np.sqrt(G) * np.sin(amplitude / 2)
    return {"q": (0.0, -1.0), "v": (speed, 0.0)}


def swing(method, t, events, amplitude=2.0, h=0.05, **more):
    return lv.integrate(
        pendulum.system, method, t=t, h=h, events=events, **(swinging(amplitude) | more)
    )


@pytest.mark.parametrize("amplitude", [0.3, 2.0, 3.0])
def test_turning_points_of_a_pendulum(amplitude):
    run = swing(lv.Spark(6), (0, 12), {"turning": spin}, amplitude)
    exact = quarter(amplitude)
    found = run.events["turning"]
    wanted = [(2 * k + 1) * exact for k in range(len(found))]
    assert len(found) == int((12 / exact + 1) / 2)
    assert max(abs(t / x - 1) for t, x in zip(found.t, wanted, strict=True)) < 1e-12
    # the points are those of the method: on the constraint, and at rest
    assert np.abs(np.hypot(*found.q.T) - 1).max() < 1e-14
    assert np.abs(found.v).max() < 1e-12
    np.testing.assert_allclose(found.p, found.v, atol=1e-15)
    np.testing.assert_allclose(found.lam[:, 0], G * np.cos(np.pi - amplitude) * -1, rtol=1e-10)


def test_a_bob_bounces_off_a_wall():
    """It is reflected at the lowest point, and back there after half a period each time."""
    wall = lv.Event(lambda t, q, v, lam, params: q[0], terminal=True)
    amplitude = 1.3
    exact = quarter(amplitude)
    start = {"q": (np.sin(amplitude), -np.cos(amplitude)), "v": (0.0, 0.0)}
    t, times = 0.0, []
    for _ in range(6):
        run = lv.integrate(
            pendulum.system, lv.Spark(6), t=(t, t + 9), h=0.05, events={"wall": wall}, **start
        )
        assert run.status == "done"
        assert run.message == f"event 'wall' at t = {run.t[-1]:.6g}"
        hit = run.events["wall"]
        assert len(hit) == 1
        np.testing.assert_array_equal(hit.q[-1], run.q[-1])
        assert hit.t[-1] == run.t[-1]
        t = run.t[-1]
        times.append(t)
        start = {"q": run.q[-1], "v": -run.v[-1]}
    wanted = [(2 * k + 1) * exact for k in range(6)]
    assert max(abs(t / x - 1) for t, x in zip(times, wanted, strict=True)) < 1e-12


def test_a_string_goes_slack():
    """Its tension vanishes where cos(angle) = (2 g l - v0^2) / (3 g l)."""
    speed = np.sqrt(3.5 * G)
    slack = lv.Event(lambda t, q, v, lam, params: lam[0], "down", terminal=True)
    run = swing(lv.Spark(5), (0, 5), {"slack": slack}, q=(0.0, -1.0), v=(speed, 0.0), h=0.04)
    assert run.q[-1, 1] == pytest.approx((3.5 - 2) / 3, rel=1e-12)
    assert run.events["slack"].lam[0, 0] == pytest.approx(0.0, abs=1e-11)
    assert run.lam[:-1].min() > 0
    # going on from there, it does not go slack at once but has
    again = lv.integrate(
        pendulum.system, lv.Spark(5), t=(0, 0.3), h=0.04, events={"slack": slack},
        q=run.q[-1], v=run.v[-1],
    )  # fmt: skip
    assert not len(again.events["slack"])
    assert again.lam[-1, 0] < 0


def oscillators(n):
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - ca.dot(params.w**2, q**2) / 2,
        q=n,
        params={"w": np.ones(n)},
    )


def level(k, c):
    return lambda t, q, v, lam, params: q[k] - c


def test_none_of_ten_thousand_is_missed():
    """Where a cos(w t + b) = c, also for levels so near a that both are within a step."""
    n, span, total, worst = 8, 120.0, 0, 0.0
    system, random = oscillators(n), np.random.default_rng(6)
    for _ in range(26):
        w, b = random.uniform(0.3, 2.2, n), random.uniform(0, 2 * np.pi, n)
        a = random.uniform(0.1, 10, n)
        near = 1 - 10 ** random.uniform(-11, -1, n)
        c = np.where(random.random(n) < 0.5, near, random.uniform(0, 1, n)) * a
        c *= random.choice([-1, 1], n)
        run = lv.integrate(
            system, lv.Spark(7), t=(0, span), h=0.4, every=1000, params={"w": w},
            q=a * np.cos(b), v=-a * w * np.sin(b),
            events={f"e{k}": level(k, c[k]) for k in range(n)},
        )  # fmt: skip
        for k in range(n):
            turns = 2 * np.pi * np.arange(-1, span * w[k] / 6 + 3)
            angle = np.arccos(c[k] / a[k])
            exact = np.sort(np.concatenate([(turns + x - b[k]) / w[k] for x in (angle, -angle)]))
            exact = exact[(exact > 1e-9) & (exact < span - 1e-9)]
            found = run.events[f"e{k}"]
            assert len(found) == len(exact), (k, c[k] / a[k], found.t, exact)
            # near the amplitude its roundings move the times by as much as they are flat there
            worst = max(worst, np.sin(angle) * np.abs(found.t - exact).max())
            total += len(exact)
    assert total > 10_000
    assert worst < 1e-11


def test_a_pair_within_a_step_is_found_and_no_touching():
    """The largest deflection is met by levels below it, in pairs, and by none above."""
    system = oscillators(1)
    for gap in (1e-4, 1e-8, 1e-12):
        for above in (False, True):
            c = 1 + gap if above else 1 - gap
            run = lv.integrate(
                system, lv.Spark(6), t=(0, 6), h=0.5, q=[0.0], v=[1.0], events={"top": level(0, c)}
            )
            times = run.events["top"].t
            assert len(times) == (0 if above else 2)
            if not above:
                apart = np.sqrt(2 * gap)
                np.testing.assert_allclose(times - np.pi / 2, [-apart, apart], rtol=1e-2, atol=1e-9)


@pytest.mark.parametrize("stages", [1, 2])
@pytest.mark.parametrize("case", range(4))
def test_pairs_are_those_of_the_method_itself_however_coarse(stages, case):
    """A turn of e within a step, as parts of that step have it, is met twice just below it."""
    method, h = lv.Spark(stages), 0.06
    random = np.random.default_rng(case)
    angle, speed = random.uniform(-2, 2), random.uniform(-3, 3)
    start = {
        "q": (np.sin(angle), -np.cos(angle)),
        "v": (speed * np.cos(angle), speed * np.sin(angle)),
    }

    def e(q, v):
        return q[0] + 0.3 * v[1]

    run = lv.integrate(pendulum.system, method, t=(0, 60 * h), steps=60, **start)

    def part(k, theta):
        state = {"q": run.q[k], "v": run.v[k]}
        end = lv.integrate(pendulum.system, method, t=(0, theta * h), steps=1, **state)
        return e(end.q[-1], end.v[-1])

    values = e(run.q.T, run.v.T)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(values)))) + 1
    sign = np.sign(values[turns[0]] - values[turns[0] - 1])
    found = [
        optimize.minimize_scalar(
            lambda x, k=k: -sign * part(k, x),
            bounds=(0, 1),
            method="bounded",
            options={"xatol": 1e-8},
        )
        for k in (turns[0] - 1, turns[0])
    ]
    k = turns[0] - 1 + int(found[1].fun < found[0].fun)
    top = -min(x.fun for x in found)
    for gap, count in ((1e-6, 2), (1e-9, 2), (-1e-9, 0), (-1e-6, 0)):
        level = sign * (top - gap)
        near = lv.integrate(
            pendulum.system, method, t=(0, 60 * h), steps=60, **start,
            events={"turn": lambda t, q, v, lam, params, c=level: e(q, v) - c},
        ).events["turn"].t / h  # fmt: skip
        assert ((near > k - 0.05) & (near < k + 1.05)).sum() == count


def test_direction_is_that_of_the_run():
    events = {
        name: lv.Event(lambda t, q, v, lam, params: q[0], name) for name in ("both", "up", "down")
    }
    there = swing(lv.Spark(4), (0, 5), events)
    both, up, down = (there.events[name].t for name in ("both", "up", "down"))
    np.testing.assert_array_equal(np.sort(np.concatenate([up, down])), both)
    assert (there.events["up"].v[:, 0] > 0).all()
    assert (there.events["down"].v[:, 0] < 0).all()
    back = lv.integrate(
        pendulum.system, lv.Spark(4), t=(5, 0), h=0.05, events=events, q=there.q[-1], v=there.v[-1]
    )
    np.testing.assert_allclose(back.events["both"].t[::-1][-len(both) :], both, rtol=1e-10)
    np.testing.assert_allclose(back.events["up"].t[::-1], down, rtol=1e-10)


def test_events_end_a_run_after_as_many_as_wanted():
    low = lv.Event(lambda t, q, v, lam, params: q[0], terminal=3)
    run = swing(lv.Spark(4), (0, 9), {"turning": spin, "low": low})
    assert len(run.events["low"]) == 3
    assert len(run.events["turning"]) == 3
    assert run.t[-1] == run.events["low"].t[-1]
    assert (run.events["turning"].t < run.t[-1]).all()
    assert run.message == f"event 'low' at t = {run.t[-1]:.6g}"
    assert run.stats["steps"] == len(run.t) - 1
    assert abs(run.q[-1, 0]) < 1e-14
    assert np.abs(run.residuals["constraint"]).max() < 1e-14
    # the dense output ends there too
    np.testing.assert_array_equal(run(run.t[-1]).q, run.q[-1])
    with pytest.raises(ValueError, match="outside the run"):
        run(run.t[-1] + 1e-3)


@pytest.mark.parametrize(
    "method", [lv.Spark(1), lv.Spark(4), lv.HHT(-0.1), lv.Composition(lv.Spark(1), "Y4")], ids=repr
)
def test_looking_changes_no_bit(method):
    events = {"turning": spin, "tension": lambda t, q, v, lam, params: lam[0] - 15}
    alone = swing(method, (0, 3), None)
    watched = swing(method, (0, 3), events)
    assert [len(points) for points in watched.events.values()] == [2, 5]
    for name, values in alone.states.items():
        np.testing.assert_array_equal(values, watched.states[name])
    assert {**alone.stats, "seconds": 0} == {**watched.stats, "seconds": 0}


def test_controlled_steps_meet_events_too():
    run = lv.integrate(
        pendulum.system, lv.HHT(0.0), t=(0, 3), rtol=1e-7, **swinging(2.0),
        events={"turning": spin, "end": lv.Event(spin, terminal=2)}, t_eval=[0.5, 1.0, 2.5],
    )  # fmt: skip
    exact = float(quarter(2.0))
    np.testing.assert_allclose(run.events["turning"].t, [exact, 3 * exact], rtol=3e-5)
    assert run.status == "done"
    assert "event 'end'" in run.message
    np.testing.assert_array_equal(run.t, [t for t in (0.5, 1.0, 2.5) if t < 3 * exact])
    assert run.h == pytest.approx(3 * exact / run.stats["steps"], rel=1e-4)


def test_a_start_on_an_event_is_none():
    low = lambda t, q, v, lam, params: q[0]  # noqa: E731
    run = swing(lv.Spark(4), (0, 2), {"low": low})
    exact = float(quarter(2.0))
    np.testing.assert_allclose(run.events["low"].t, [2 * exact], rtol=1e-8)
    again = swing(lv.Spark(4), (0, 2 * exact + 1), {"low": lv.Event(low, terminal=True)})
    onwards = lv.integrate(
        pendulum.system, lv.Spark(4), t=(again.t[-1], 2), h=0.05, events={"low": low},
        q=again.q[-1], v=again.v[-1],
    )  # fmt: skip
    assert not len(onwards.events["low"])


def test_a_small_bounce_within_the_first_step_is_seen():
    """A ball that leaves the ground upwards is back after 2 v / g, however soon that is."""
    ball = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0], q=1)
    for speed in (1.0, 1e-2, 1e-4):
        run = lv.integrate(
            ball, lv.Spark(2), t=(0, 3), h=0.3, q=[0.0], v=[speed],
            events={"ground": lv.Event(level(0, 0.0), "down", terminal=True)},
        )  # fmt: skip
        assert run.t[-1] == pytest.approx(2 * speed, rel=1e-11)


def test_an_interrupted_and_a_failed_run_keep_their_events():
    def tired(done, total):
        if done > 40:
            raise KeyboardInterrupt

    events = {"turning": spin}
    run = lv.integrate(
        pendulum.system, lv.Spark(4), t=(0, 1e6), h=1e-3, every=1000, events=events,
        progress=tired, **swinging(2.0),
    )  # fmt: skip
    assert run.status == "interrupted"
    assert len(run.events["turning"]) == int((run.t[-1] / float(quarter(2.0)) + 1) / 2)
    with pytest.raises(
        lv.IntegrationError, match=r"event 'root' is not finite at t = 0\.8"
    ) as info:
        swing(lv.Spark(4), (0, 5), events | {"root": lambda t, q, v, lam, params: ca.sqrt(0.8 - t)})
    assert info.value.quantity == "root"
    assert len(info.value.solution.events["turning"]) == 1
    with pytest.raises(lv.IntegrationError, match=r"the start at t = 0 .* event 'log'"):
        swing(lv.Spark(4), (0, 5), {"log": lambda t, q, v, lam, params: ca.log(t)})


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_events_are_saved(tmp_path, suffix):
    none = lambda t, q, v, lam, params: q[0] - 2  # noqa: E731
    run = swing(lv.Spark(4), (0, 3), {"turning": spin, "per/cent": spin, "none": none})
    run.save(tmp_path / f"run{suffix}")
    loaded = lv.load(tmp_path / f"run{suffix}")
    assert list(loaded.events) == ["turning", "per/cent", "none"]
    assert loaded.dense_order == 8
    for name, points in run.events.items():
        np.testing.assert_array_equal(loaded.events[name].t, points.t)
        assert list(loaded.events[name].states) == list(points.states)
        for state, values in points.states.items():
            np.testing.assert_array_equal(loaded.events[name].states[state], values)


def test_wrong_events_are_refused():
    with pytest.raises(TypeError, match="function must be a function, not 3"):
        lv.Event(3)
    with pytest.raises(ValueError, match="direction must be one of both, up, down, not 'left'"):
        lv.Event(spin, "left")
    with pytest.raises(ValueError, match="terminal must be at least 1, or False, not -1"):
        lv.Event(spin, terminal=-1)
    with pytest.raises(TypeError, match="terminal must be True, False or a number, not 'yes'"):
        lv.Event(spin, terminal="yes")
    for events, message in (
        (spin, r"events must be a mapping of names, .*\nhint: name it"),
        ({3: spin}, "nonempty strings, not 3"),
        ({"a": 3}, "event 'a' must be an Event or a function, not 3"),
        ({"a": lambda t, q, v, lam, params: q}, "event 'a' must return a scalar, not 2 values"),
        ({"a": lambda t, q, v, lam, params: 1.0}, "event 'a' is the same for all states"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            swing(lv.Spark(2), (0, 1), events)


@pytest.mark.parametrize("every", [1, 7, 1000])
@pytest.mark.parametrize("t", [(0.0, 3.0), (1e6, 1e6 + 3.0), (3.0, 0.0)])
def test_members_that_an_event_ended_have_made_the_steps_of_runs_alone(t, every):
    """So has the ensemble, the most of them, where it ended all."""
    oscillator = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=1, params={"k": 1.0}
    )
    ends = {"low": lv.Event(lambda t, q, v, lam, params: q[0], terminal=True)}
    call = {"t": t, "h": 0.1, "every": every, "events": ends, "q": [1.0], "v": [0.0]}
    stiffness = [0.5, 2.0, 1.0]
    many = lv.ensemble(oscillator, lv.Spark(3), params={"k": stiffness}, **call)
    alone = [
        lv.integrate(oscillator, lv.Spark(3), params={"k": k}, **call).stats["steps"]
        for k in stiffness
    ]
    assert [member.stats["steps"] for member in many] == alone
    assert many.stats["steps"] == max(alone) < 30


FREE = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2, q=2)
STEPS = {
    "equal": (lv.Spark(2), {"h": 0.25}),
    "uneven": (lv.Spark(2), {"h": 0.3}),
    "rattle": (lv.LobattoPair(2), {"h": 0.25}),
    "controlled": (lv.HHT(0.0), {"rtol": 1e-6}),
    "reversible": (lv.Spark(2), {"h": 0.25, "control": lv.Reversible()}),
    "given times": (lv.Spark(2), {"h": 0.25, "t_eval": lambda t: np.linspace(*t, 4)}),
}


def free(kind, t, events, q=(0.0, 0.0), v=(1.0, 1.0)):
    method, more = STEPS[kind]
    times = {"t_eval": more["t_eval"](t)} if "t_eval" in more else {}
    return lv.integrate(FREE, method, t=t, q=q, v=v, events=events, **{**more, **times})


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize("way", [1, -1])
def test_an_event_where_a_run_is_split_is_met_once(kind, way):
    """A zero at the very end belongs to the run, one at the very start does not."""
    at_one = lambda t, q, v, lam, params: q[0] - way  # noqa: E731
    rising = {1: "up", -1: "down"}[way]
    for direction, count in (("both", 1), (rising, 1), ({"up": "down", "down": "up"}[rising], 0)):
        events = {"one": lv.Event(at_one, direction)}
        first = free(kind, (0, way), events, v=(1.0, 1.0))
        assert first.events["one"].t.tolist() == [way] * count
        second = free(kind, (way, 2 * way), events, q=first.q[-1], v=first.v[-1])
        assert len(second.events["one"]) == 0
        ends = free(kind, (0, way), {"one": lv.Event(at_one, direction, terminal=True)})
        assert ends.message.startswith(f"event 'one' at t = {way}") == bool(count)
        assert ends.t[-1] == way


def test_runs_that_are_split_at_their_events_have_those_of_the_whole():
    events = {
        "turning": spin,
        "lowest": lambda t, q, v, lam, params: q[0],
        "tension": lambda t, q, v, lam, params: lam[0] - 15,
        "time": lambda t, q, v, lam, params: t - 4 + 0 * q[0],
    }
    whole = swing(lv.Spark(4), (0, 6), events)
    cuts = np.unique([t for points in whole.events.values() for t in points.t])
    found, start = {name: [] for name in events}, {}
    for t0, t1 in zip([0.0, *cuts], [*cuts, 6.0], strict=True):
        part = swing(lv.Spark(4), (t0, t1), events, h=min(0.05, t1 - t0), **start)
        start = {"q": part.q[-1], "v": part.v[-1]}
        for name, points in part.events.items():
            found[name].extend(points.t)
    assert len(cuts) > 10
    for name, points in whole.events.items():
        np.testing.assert_allclose(found[name], points.t, rtol=1e-7)


def test_the_end_of_a_run_is_no_event_where_the_function_only_touches_zero():
    ball = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0], q=1)
    functions = {
        "top": lambda t, q, v, lam, params: q[0] - 0.5,
        "at rest": lambda t, q, v, lam, params: ca.fmax(0.375 - q[0], 0),
        "rising": lambda t, q, v, lam, params: v[0],
        "edge": lambda t, q, v, lam, params: ca.sqrt(1 - t) + 0 * q[0],
    }
    run = lv.integrate(ball, lv.Spark(2), t=(0, 1), h=0.25, q=[0.0], v=[1.0], events=functions)
    assert [len(points) for points in run.events.values()] == [0, 0, 1, 1]


def test_a_function_may_end_where_the_run_starts():
    root = {"root": lambda t, q, v, lam, params: ca.sqrt(q[0]) - 1}
    run = free("equal", (0, 2), root)
    np.testing.assert_allclose(run.events["root"].t, [1.0], rtol=1e-14)


@pytest.mark.parametrize("names", [("ends", "seen", "lam"), ("seen", "ends", "lam")])
@pytest.mark.parametrize("scale", [1.0, 3e3])
def test_all_events_of_the_time_at_which_one_ends_the_run_are_kept(names, scale):
    """Also where roundoff of large states parts them."""
    level = 0.7 * scale
    functions = {
        "ends": lv.Event(lambda t, q, v, lam, params: q[0] - level, terminal=True),
        "seen": lambda t, q, v, lam, params: 3 * (q[1] / 3 - level),
        "lam": lambda t, q, v, lam, params: (q[0] + q[1]) / 7 - 4 * level / 7,
        "later": lambda t, q, v, lam, params: q[0] - level * (1 + 1e-9),
    }
    for offset in (0.0, 1 / 3, 0.1):
        events = {name: functions[name] for name in [*names, "later"]}
        run = free("equal", (offset, 2), events, (0.0, 2 * level), (scale, scale))
        assert [len(points) for points in run.events.values()] == [1, 1, 1, 0]
        assert {points.t[0] for name, points in run.events.items() if name != "later"} <= {
            run.t[-1], np.nextafter(run.t[-1], 0),
        }  # fmt: skip
        assert run.message.startswith("event 'ends' at")


def test_a_second_zero_in_the_last_step_is_beyond_the_end():
    events = {
        "ends": lv.Event(lambda t, q, v, lam, params: q[0] - 0.3, terminal=True),
        "pair": lambda t, q, v, lam, params: (q[0] - 0.3) * (q[0] - 0.4),
    }
    run = free("equal", (0, 2), events)
    assert [len(points) for points in run.events.values()] == [1, 1]


@pytest.mark.parametrize(
    ("t", "height", "rate"),
    [
        (0.9271545530678674, 0.1949457516132066, 1.8122424665646286e-08),
        (0.06527041641129139, 0.6896089575922423, 6.720189588011071e-08),
    ],
)
def test_a_flight_within_roundoff_of_its_event_ends(t, height, rate):
    """Both ends of the bracket of a zero have one rounding of the height as their value."""
    ball = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - 9.81 * q[0], q=("y",))
    flight = 2 * rate / 9.81
    hit = lv.Event(lambda t, q, v, lam, params: q[0] - height, "down", terminal=True)
    run = lv.integrate(
        ball, lv.Spark(3), t=(t, t + 2 * flight), h=flight / 3, q=[height], v=[rate],
        events={"hit": hit},
    )  # fmt: skip
    assert run.status == "done"
    assert run.t[-1] <= t + 2 * flight
    assert abs(run.q[-1, 0] - height) < 1e-13


def slid(k, mu, t, x, v):
    """Return where a block on a spring with dry friction is: half oscillations about centres."""
    w = np.sqrt(k)
    while True:
        centre = -np.sign(v) * mu * 9.81 / k
        size, phase = np.hypot(x - centre, v / w), np.arctan2(-v / w, x - centre)
        turn = (np.ceil((phase + 1e-12) / np.pi) * np.pi - phase) / w
        if turn > t:
            return centre + size * np.cos(w * t + phase)
        t, x = t - turn, centre + size * np.cos(w * turn + phase)
        v = -np.sign(x)  # it slides back, from rest
        v *= 1e-300


def test_a_step_whose_force_turns_at_an_event_ends_there_though_it_cannot_be_made():
    """Of 41 springs four to seven turned near the end of a step, which has no solution there."""
    block = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=("x",),
        force=lambda t, q, v, params: -params.mu * 9.81 * ca.sign(v[0]),
        params={"k": 40.0, "mu": 0.11},
    )  # fmt: skip
    turn = lv.Event(lambda t, q, v, lam, params: v[0], reset=lambda t, q, v, lam, params: {})
    run = {"t": (0, 1.6), "h": 0.04, "events": {"turn": turn}}
    springs = np.linspace(35, 45, 41)
    wanted = [slid(k, 0.11, 1.6, 0.6, -0.8) for k in springs]
    for stages in (3, 4):
        many = lv.ensemble(
            block, lv.Spark(stages), params={"k": springs, "mu": 0.11}, **run,
            q=np.full((41, 1), 0.6), v=np.full((41, 1), -0.8),
        )  # fmt: skip
        assert not many.failures
        np.testing.assert_allclose(many.q[-1, :, 0], wanted, atol=10.0 ** (-2 * stages - 1))
    for k in springs[::10]:
        own = {**run, "params": {"k": k}, "q": [0.6], "v": [-0.8]}
        found, pullback = lv.vjp(block, lv.Spark(4), wrt=["params.k"], **own)
        assert len(found.events["turn"].t) == 3
        last = np.zeros_like(found.q)
        last[-1] = 1.0
        slope = (slid(k + 1e-5, 0.11, 1.6, 0.6, -0.8) - slid(k - 1e-5, 0.11, 1.6, 0.6, -0.8)) / 2e-5
        assert pullback(q=last)["params.k"] == pytest.approx(slope, abs=1e-8)


def test_a_step_that_cannot_be_made_and_has_no_event_fails_as_before():
    """A pole within the step is no event: the state is that before the step."""
    pole = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 + ca.log(1 - q[0]), q=("x",))
    never = lv.Event(lambda t, q, v, lam, params: q[0] + 9, reset=lambda t, q, v, lam, params: {})
    call = {"t": (0, 1), "steps": 4, "q": [0.0], "v": [9.0]}
    failed = []
    for events in (None, {"never": never}):
        with pytest.raises(lv.IntegrationError) as error:
            lv.integrate(pole, lv.Spark(2), **call, events=events)
        failed.append(error.value)
    assert str(failed[0]) == str(failed[1])
    for name in ("t", "q", "v"):
        one, other = (getattr(each.solution, name) for each in failed)
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("method", [lv.Spark(1), lv.LobattoPair(2)], ids=str)
def test_a_function_that_changes_by_less_than_a_rounding_in_a_step_is_searched(method):
    """In steps of 1e-9 the interpolated function is zero at both ends of a bracket."""
    angle, rate, at = 5.349, -1.1e-8, 0.5944737303279252
    rod = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - 9.81 * q[1],
        lambda t, q, params: ca.sumsqr(q) - 1,
        q=2,
    )
    q = [np.cos(angle), np.sin(angle)]
    run = lv.integrate(
        rod, method, t=(-5.0, -5.0 + 19e-9), steps=19, q=q, v=[-rate * q[1], rate * q[0]],
        events={"there": lv.Event(lambda t, q, v, lam, params: (q[0] - at) ** 3)},
    )  # fmt: skip
    assert run.status == "done"
    assert np.isfinite(run.events["there"].q).all()
    assert len(run.events["there"]) < 19
