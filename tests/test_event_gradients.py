"""Events move with what a run depends on: their times, the states there, and all behind a reset.

Tangents are compared with differences of order six, of runs that meet the same events, and
pullbacks with tangents. One file, since the events, systems and comparisons are those of all
methods and of ensembles.
"""

import casadi as ca
import numpy as np
import pytest
from test_tangents import WEIGHTS, directions_of, farthest, moved

import liouville as lv
from liouville.problems import load

ENDS = {"t0": 0.3, "t1": 0.2}


def ball():
    """Return a ball above a bent ground, with its law of impact."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
        q=("x", "y"), params={"g": 1.0, "e": 0.8, "bend": 0.1},
    )  # fmt: skip
    ground = lv.Event(
        lambda t, q, v, lam, params: q[1] - params.bend * q[0] ** 2,
        "down",
        reset=lv.Impact(lambda t, q, v, lam, params: params.e),
    )
    start = {"q": np.array([0.1, 0.5]), "v": np.array([0.3, 0.1])}
    directions = {"q": np.array([0.3, 0.7]), "v": np.array([0.2, -0.4])}
    directions |= {"params.g": 1.0, "params.e": 1.0, "params.bend": 0.5}
    return system, {"ground": ground}, start, directions


def walled(law):
    """Return the events of a pendulum at a wall with some law of reset, and its run."""
    resets = {
        "impact": lv.Impact(lambda t, q, v, lam, params: params.e),
        "velocities": lambda t, q, v, lam, params: -params.e * (1 + t / 9) * v,
        "none": None,
    }
    events = {
        "wall": lv.Event(lambda t, q, v, lam, params: q[0] + params.wall, reset=resets[law]),
        "low": lv.Event(lambda t, q, v, lam, params: q[1] + 1.9 + t / 50, terminal=4),
        "pull": lambda t, q, v, lam, params: lam[0] - 3.5 * params.m,
    }
    return {"steps": 31, "events": events, "every": 4}


def pendulum():
    """Return a driven pendulum, its length in its constraint alone, at a wall."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (
            params.m * ca.dot(v, v) / 2 - params.m * params.g * q[1] - ca.sin(t) * q[0] / 5
        ),
        lambda t, q, params: ca.dot(q, q) - (params.l + ca.sin(t) / 20) ** 2,
        q=("x", "y"), params={"m": 1.5, "g": 9.81, "l": 2.0, "e": 0.7, "wall": 0.3},
    )  # fmt: skip
    directions = {"q": np.array([0.3, 0.7]), "v": np.array([0.2, -0.4])}
    directions |= {"params.l": 1.0, "params.e": 1.0, "params.wall": 0.5}
    return system, system.consistent(t=0.1, q=[1.2, -1.6], v=[1.6, 1.2]), directions


def general():
    """Return a system whose velocities and momenta are nonlinear, with its start and its events."""
    system = lv.Mechanical(
        velocity=lambda t, y, z, params: (
            z * (1 + params.a * ca.dot(y, y) / 9) + params.a * ca.sin(t) * ca.vertcat(y[1:], 1)
        ),
        momentum=lambda t, y, z, params: (
            z * (1 + ca.dot(z, z) / 4 + ca.cos(t) / 5) + params.a * y * y / 5
        ),
        force=lambda t, y, z, params: ca.vertcat(z[1], -z[0], -params.c),
        reaction=lambda t, y, lam, params: (
            -y * lam + params.a * lam * ca.vertcat(y[1], 0, t / 9)
        ),
        constraint=lambda t, y, params: ca.dot(y, y) - (params.l + ca.sin(t) / 9) ** 2,
        y=3, params={"a": 0.4, "c": 0.7, "l": 1.1},
    )  # fmt: skip
    events = {
        "turn": lv.Event(
            lambda t, y, z, lam, params: y[1] - params.c - t / 9 + 0.2,
            reset=lv.Impact(lambda t, y, z, lam, params: params.c + y[0] / 9),
        ),
        "side": lv.Event(
            lambda t, y, z, lam, params: z[1] + y[0] / 2 + lam[0] / 9,
            reset=lambda t, y, z, lam, params: z * params.c * (1 + t / 9),
        ),
    }
    return system, events, system.consistent(t=0.2, y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])


def outputs(states, events):
    """Return states and what events have, under one name each."""
    found = dict(states)
    for event, points in events.items():
        found[event, "t"] = points.t
        found |= {(event, name): x for name, x in points.states.items()}
    return {name: x for name, x in found.items() if x.size}


def differences(system, method, t, start, directions, size=2e-4, **run):
    """Return differences of all outputs in the sum of some directions."""
    total = {}
    for count, weight in WEIGHTS.items():
        for sign in (1, -1):
            step = sign * count * size
            at = t[0] + step * directions.get("t0", 0.0), t[1] + step * directions.get("t1", 0.0)
            own, params = moved(system, at[0], start, directions, step)
            found = lv.integrate(system, method, t=at, params=params, **run, **own)
            names = {*system.states, "lam"} & {*found.states}
            for name, x in outputs({x: found.states[x] for x in names}, found.events).items():
                total[name] = total.get(name, 0.0) + sign * weight / size * x
    return total


def check(system, method, t, start, directions, bound=None, size=2e-4, **run):
    """Check tangents by differences, direction by direction; return the run.

    Steps that are controlled are chosen anew by differences, which are then as much worse.
    """
    bound = bound or (1e-10 if "steps" in run else 1e-8)
    found = lv.integrate(system, method, t=t, tangents=directions, **run, **start)
    plain = lv.integrate(system, method, t=t, **run, **start)
    assert np.array_equal(found.states[system.states[1]], plain.states[system.states[1]])
    for name, direction in directions.items():
        wanted = differences(system, method, t, start, {name: direction}, size, **run)
        tangent = found.tangents[name]
        own = outputs(tangent.states, tangent.events)
        assert farthest(own, {x: wanted[x] for x in own}) < bound, name
    return found


CONTROLS = [{"steps": 26}, {"rtol": 1e-7}, {"control": lv.Reversible(), "h": 0.01}]


@pytest.mark.parametrize("control", CONTROLS, ids=str)
def test_bouncing_ball(control):
    system, events, start, directions = ball()
    more = ENDS if "steps" in control else {}
    run = {**control, "events": events, "every": 10_000}
    found = check(system, lv.Spark(2), (0.0, 3.1), start, directions | more, **run)
    assert len(found.events["ground"]) >= 2
    assert found.tangents["q"].events["ground"].v_after.shape == found.events["ground"].v.shape


@pytest.mark.parametrize("law", ["impact", "velocities", "none"])
def test_wall_recorded_and_terminal_events_of_a_pendulum(law):
    system, start, directions = pendulum()
    run = walled(law)
    found = check(system, lv.Spark(3), (0.1, 3.3), start, directions | ENDS, **run)
    assert all(len(points) for points in found.events.values())


def test_every_function_nonlinear_and_states_at_given_times():
    system, events, start = general()
    directions = directions_of(system, "t0", "t1")
    run = {"steps": 20, "events": events, "t_eval": [0.25, 0.33, 0.9, 1.11, 1.23]}
    found = check(system, lv.Spark(2), (0.2, 1.4), start, directions, **run)
    assert len(found.events["turn"]) * len(found.events["side"]) >= 1


def paired(system, method, t, start, directions, **run):
    """Return how far the pairings of tangent and pullback are apart, in units of their parts.

    Where these are errors of the method alone, or zero, the unit is one.
    """
    rng = np.random.default_rng(2)
    pullback = lv.vjp(system, method, wrt=[*directions], t=t, **run, **start)[1]
    found = lv.integrate(system, method, t=t, tangents=directions, **run, **start)
    own = next(iter(found.tangents.values()))
    weights = {x: rng.standard_normal(y.shape) for x, y in own.states.items()}
    of_events = {
        event: {"t": rng.standard_normal(points.t.shape)}
        | {x: rng.standard_normal(y.shape) for x, y in points.states.items()}
        for event, points in own.events.items()
    }
    gradients = pullback(**weights, events=of_events)
    sizes = []
    for name, direction in directions.items():
        tangent = found.tangents[name]
        parts = [weights[x] * y for x, y in tangent.states.items()]
        for event, points in tangent.events.items():
            each = {"t": points.t, **points.states}
            parts += [of_events[event][x] * y for x, y in each.items()]
        forward, unit = sum(x.sum() for x in parts), sum(np.abs(x).sum() for x in parts)
        sizes.append(abs(np.sum(gradients[name] * direction) - forward) / max(unit, 1))
    return max(sizes)


@pytest.mark.parametrize("control", CONTROLS, ids=str)
def test_pullbacks_of_a_bouncing_ball(control):
    system, events, start, directions = ball()
    more = ENDS if "steps" in control else {}
    run = {**control, "events": events}
    assert paired(system, lv.Spark(2), (0.0, 4.1), start, directions | more, **run) < 1e-12


@pytest.mark.parametrize("law", ["impact", "velocities", "none"])
def test_pullbacks_of_a_pendulum_at_a_wall(law):
    system, start, directions = pendulum()
    for method in (lv.Spark(3), lv.Composition(lv.Spark(1), "Y4")):
        run = {"directions": directions | ENDS, **walled(law)}
        assert paired(system, method, (0.1, 3.3), start, **run) < 1e-12
        run["t_eval"], run["every"] = [0.1, 0.2, 0.71, 1.5, 1.6, 2.01], 1
        assert paired(system, method, (0.1, 3.3), start, **run) < 1e-12


def test_pullbacks_where_every_function_is_nonlinear():
    system, events, start = general()
    directions = directions_of(system, "t0", "t1")
    run = {"steps": 20, "events": events, "t_eval": [0.2, 0.33, 0.9, 1.11, 1.4]}
    assert paired(system, lv.Spark(2), (0.2, 1.4), start, directions, **run) < 1e-12


@pytest.mark.parametrize("method", [lv.Spark(2), lv.HHT(), lv.ArnoldBruls(0.8)], ids=str)
def test_the_time_of_free_fall(method):
    system, events, _, _ = ball()
    start = {"q": np.array([0.0, 0.5]), "v": np.zeros(2)}
    run = {"t": (0.0, 1.5), "steps": 5, "events": events}
    directions = {"params.g": 1.0, "params.e": 1.0}
    found = lv.integrate(system, method, tangents=directions, **run, **start)
    fallen = found.tangents["params.g"].events["ground"]
    assert fallen.t[0] == pytest.approx(-0.5, abs=1e-14)  # of sqrt(2 y / g)
    bounced = found.tangents["params.e"].events["ground"]
    np.testing.assert_allclose(bounced.v_after[0], [0.0, 1.0], atol=1e-14)


def test_what_has_no_derivative_is_refused():
    system, start, _ = pendulum()
    call = {"system": system, "method": lv.Spark(2), "t": (0.1, 3), "steps": 60, **start,
            "tangents": {"params.l": 1.0}}  # fmt: skip
    beside = lv.Event(lambda t, q, v, lam, params: q[0] + 0.3,
                      reset=lambda t, q, v, lam, params: {"q": 1.001 * q, "v": -v})  # fmt: skip
    with pytest.raises(lv.IntegrationError, match="leads beside the constraints"):
        lv.integrate(**call, events={"wall": beside})
    free, *_ = ball()
    fall = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=1,
                         params={"g": 9.81})  # fmt: skip
    ground = {"ground": lv.Event(lambda t, q, v, lam, params: q[0], "down",
                                 reset=lambda t, q, v, lam, params: -v / 2)}  # fmt: skip
    drop = {"t": (0.0, 10.0), "steps": 1000, "events": ground, "q": [1.0], "v": [0.0]}
    accumulate = (
        r"hits of 'ground' accumulate at t = 1.35457, and so near.*\nhint: end the run before"
    )
    with pytest.raises(lv.IntegrationError, match=accumulate):
        lv.integrate(fall, lv.Spark(2), tangents={"params.g": 1.0}, **drop)
    heights = {"q": [[100.0], [1.0]], "v": [0.0]}
    both = lv.ensemble(fall, lv.Spark(2), tangents={"params.g": 1.0}, **(drop | heights))
    assert [*both.failures] == [1]
    assert "hits of 'ground' accumulate at t = 1.35457" in both.failures[1].message
    solution, pullback = lv.vjp(fall, lv.Spark(2), wrt=["v"], **drop)
    assert "accumulate at t = 1.35457" in solution.message
    with pytest.raises(lv.IntegrationError, match=accumulate):
        pullback(q=np.ones_like(solution.q))
    up = {"q": np.array([0.0, 1.0]), "v": np.array([0.0, 2.0])}
    flat, jump = "'top' has no slope along the motion at", "'top' jumps at"
    functions = (
        (lambda t, q, v, lam, params: ca.sign(q[1] - 1.5), jump),
        (lambda t, q, v, lam, params: ca.if_else(q[1] > 1.5, params.g, -1), jump),
        (lambda t, q, v, lam, params: ca.floor(2 * t) - 0.5, jump),
        (lambda t, q, v, lam, params: (t - 0.5) ** 3, flat),
        (touch := lambda t, q, v, lam, params: (q[1] - 1.5) ** 3, flat),
    )
    for function, sentence in functions:
        call = {"t": (0, 1.9), "steps": 7, "events": {"top": function}, **up}
        with pytest.raises(lv.IntegrationError, match=sentence):
            lv.integrate(free, lv.Spark(2), tangents={"params.g": 1.0}, **call)
        solution, pullback = lv.vjp(free, lv.Spark(2), wrt=["params.g"], **call)
        with pytest.raises(lv.IntegrationError, match=sentence):
            pullback(q=np.ones_like(solution.q))
    two = up | {"v": np.array([[0.0, 2.0], [0.0, 0.5]])}
    many = lv.ensemble(free, lv.Spark(2), t=(0, 1.9), steps=7, events={"top": touch},
                       tangents={"params.g": 1.0}, **two)  # fmt: skip
    assert [*many.failures] == [0]
    assert flat in many.failures[0].message
    assert np.isfinite(many.tangents["params.g"].q[:, 1]).all()


@pytest.mark.parametrize("method", [lv.Spark(2), lv.HHT(), lv.Spark(4)], ids=str)
@pytest.mark.parametrize(
    "kept",
    [{}, {"every": 2}, {"t_eval": np.linspace(0, 1.4, 29)}],
    ids=["steps", "every", "t_eval"],
)
def test_cotangents_before_hits_accumulate(method, kept):
    """They are those of a run that ends before, to the bit."""
    fall = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - 9.81 * q[0], q=1,
                         params={"e": 0.5})  # fmt: skip
    loss = lv.Impact(lambda t, q, v, lam, params: params.e)

    def ground(hits):
        return {
            "ground": lv.Event(lambda t, q, v, lam, params: q[0], "down", terminal=hits, reset=loss)
        }

    run = {"wrt": ["q", "params.e"], "t": (0, 6), "steps": 60, **kept}
    one = {"q": [1.0], "v": [0.0]}
    solution, pullback = lv.vjp(fall, method, **run, events=ground(False), **one)
    assert "accumulate at t = 1.35457" in solution.message
    short, before = lv.vjp(fall, method, **run, events=ground(2), **one)  # at t = 0.903
    for count, hits in ((0, 0), (1, 0), (len(short.t) - 1, 0), (3, 1), (len(short.t) - 1, 2)):
        cotangents, times = np.zeros_like(solution.q), np.zeros(len(solution.events["ground"]))
        cotangents[:count], times[:hits] = 1.0, 1.0
        found = pullback(q=cotangents, events={"ground": {"t": times}})
        wanted = before(q=cotangents[: len(short.t)], events={"ground": {"t": times[:2]}})
        assert found == wanted
    if "t_eval" in kept:
        return
    rows = {"q": [[1.0], [100.0]], "v": [0.0]}
    both, pulled = lv.vjp(fall, method, **run, events=ground(False), **rows)
    cotangents = np.zeros_like(both.q)
    cotangents[2, 0], cotangents[-1, 1] = 1.0, 1.0
    found = pulled(q=cotangents)["q"][:, 0]
    alone = lv.vjp(fall, method, **run, events=ground(False), q=[100.0], v=[0.0])[1]
    np.testing.assert_array_equal(found, [1.0, alone(q=cotangents[:, 1])["q"][0]])


@pytest.mark.parametrize("times", [[0.1, 0.2, 0.9], [0.8, 0.9]], ids=str)
def test_given_times_behind_the_end_of_a_run_have_no_cotangents(times):
    fall = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=1,
                         params={"g": 9.81})  # fmt: skip
    ground = lv.Event(lambda t, q, v, lam, params: q[0], "down", terminal=True)
    run = {"t": (0, 1), "steps": 10, "t_eval": times, "events": {"ground": ground}}
    solution, pullback = lv.vjp(fall, lv.Spark(4), wrt=["q"], **run, q=[1.0], v=[0.0])
    hit = pullback(events={"ground": {"t": [1.0]}})["q"]
    np.testing.assert_allclose(hit, solution.events["ground"].t / 2, rtol=1e-12)
    np.testing.assert_allclose(pullback(q=np.ones_like(solution.q))["q"], len(solution.t))


@pytest.mark.parametrize("name", ["ball", "general", "pendulum"])
@pytest.mark.parametrize("method", [lv.Spark(2), lv.Spark(4), lv.LobattoPair(4)], ids=str)
def test_each_row_of_cotangents_follows_the_steps_that_it_depends_on(name, method):
    """Also given times within the first steps and behind resets, and each event by itself."""
    if name == "general":
        system, events, start = general()
        directions, t = {"params.c": 1.0, "y": np.array([0.2, 0.4, -0.1])}, (0.2, 1.4)
    elif name == "ball":
        system, events, start, directions = ball()
        t = (0.0, 3.1)
    else:
        (system, start, directions), events, t = pendulum(), walled("impact")["events"], (0.1, 2.3)
    times = np.sort(np.random.default_rng(3).uniform(*t, 25))
    for kept in ({"t_eval": times}, {"every": 3}):
        run = {"t": t, "steps": 20, "events": events, **kept, **start}
        tangents = lv.integrate(system, method, tangents=directions, **run).tangents
        solution, pullback = lv.vjp(system, method, wrt=[*directions], **run)
        state, rows = system.states[1], np.eye(len(solution.t))
        each = [{state: np.outer(row, np.ones(len(start[state])))} for row in rows]
        wanted = [{x: y.states[state][k].sum() for x, y in tangents.items()}
                  for k in range(len(rows))]  # fmt: skip
        for event, points in solution.events.items():
            each += [{"events": {event: {"t": row}}} for row in np.eye(len(points))]
            wanted += [{x: y.events[event].t[k] for x, y in tangents.items()}
                       for k in range(len(points))]  # fmt: skip
        for cotangents, own in zip(each, wanted, strict=True):
            found = pullback(**cotangents)
            for x, along in directions.items():
                assert np.sum(found[x] * along) == pytest.approx(own[x], rel=1e-9, abs=1e-10)


def several(name):
    """Return a system, a method, runs of members that meet events, their starts and directions."""
    rng = np.random.default_rng(6)
    if name == "general":
        system, events, start = general()
        rows = {x: value + 0.05 * rng.standard_normal((4, 3)) for x, value in start.items()}
        run = {"t": (0.2, 1.4), "steps": 20, "every": 3, "events": events}
        return system, lv.Spark(2), run, rows, {"c": [0.7, 0.75, 0.65, 0.7], "l": 1.05}
    if name in ("ball", "HHT"):
        system, events, start, _ = ball()
        rows = {x: value * [[1.0], [1.2], [0.8], [0.1]] for x, value in start.items()}
        ends = {"far": lv.Event(lambda t, q, v, lam, params: q[0] - params.e, terminal=True)}
        run = {"t": (0.0, 3.1), "steps": 26, "events": events | ends}
        method = lv.HHT() if name == "HHT" else lv.LobattoPair(3)
        return system, method, run, rows, {"e": [0.8, 0.7, 0.9, 0.8]}
    system, start, _ = pendulum()
    rows = {x: np.array(value * [[1.0], [0.9], [1.1], [1.0]]) for x, value in start.items()}
    run = {"t": (0.1, 3.3), **walled(name)}
    method = lv.Composition(lv.Spark(1), "Y4") if name == "impact" else lv.Spark(2)
    return system, method, run, rows, {"wall": [0.3, 0.2, 0.25, 5.0]}


@pytest.mark.parametrize("name", ["impact", "velocities", "none", "general", "ball", "HHT"])
def test_members_have_the_tangents_and_pullbacks_of_runs_alone(name):
    """Also where an event ends their runs, each at a time of its own."""
    system, method, run, rows, params = several(name)
    t0 = run["t"][0]
    each = [
        {x: value[k] if np.ndim(value) else value for x, value in params.items()} for k in range(4)
    ]
    starts = [
        system.consistent(t=t0, params=each[k], **{x: value[k] for x, value in rows.items()})
        for k in range(4)
    ]
    rows = {x: np.array([start[x] for start in starts]) for x in rows}
    moves = directions_of(system, "t0", "t1")
    call = {"system": system, "method": method, **run}
    many = lv.ensemble(**call, params=params, tangents=moves, **rows)
    assert many.status == "done"
    solution, pullback = lv.vjp(**call, wrt=[*moves], params=params, **rows)
    rng = np.random.default_rng(1)
    there = {x: np.isfinite(solution.states[x]) for x in pullback.states}
    cotangents = {x: rng.standard_normal(ok.shape) * ok for x, ok in there.items()}
    of_events = {
        event: {"t": rng.standard_normal(len(points))} for event, points in solution.events.items()
    }
    gradients = pullback(**cotangents, events=of_events)
    met = 0
    for k in range(4):
        one = lv.integrate(**call, params=each[k], tangents=moves, **starts[k])
        own = many.member(k)
        for x, tangent in one.tangents.items():
            for state, value in own.tangents[x].states.items():
                np.testing.assert_array_equal(value, tangent.states[state][: len(own.t)])
            for event, points in tangent.events.items():
                found = own.tangents[x].events[event]
                np.testing.assert_array_equal(found.t, points.t)
                assert {*found.states} == {*points.states}
                for state, value in points.states.items():
                    np.testing.assert_array_equal(found.states[state], value)
                met += len(found)
        alone, back = lv.vjp(**call, wrt=[*moves], params=each[k], **starts[k])
        given = {}
        for x, value in cotangents.items():
            given[x] = np.zeros_like(alone.states[x])
            given[x][: len(own.t)] = value[: len(own.t), k]
        hits = {
            event: {"t": value["t"][solution.events[event].member == k]}
            for event, value in of_events.items()
        }
        for x, value in back(**given, events=hits).items():
            np.testing.assert_array_equal(gradients[x][k], value)
    assert met
    assert bool(many.endings) == (name != "general")


def test_pullbacks_of_members_are_the_transpose_of_their_tangents():
    """With cotangents of all states, at events and after resets too."""
    system, method, run, rows, _ = several("general")
    call = {"system": system, "method": method, **run, "params": {"l": 1.1}}
    start = [system.consistent(t=0.2, **{x: rows[x][k] for x in rows}) for k in range(4)]
    rows = {x: np.array([each[x] for each in start]) for x in rows}
    moves = directions_of(system, "t0", "t1")
    many = lv.ensemble(**call, tangents=moves, **rows)
    solution, pullback = lv.vjp(**call, wrt=[*moves], **rows)
    rng = np.random.default_rng(2)
    states = {x: rng.standard_normal(solution.states[x].shape) for x in pullback.states}
    events = {
        event: {
            x: rng.standard_normal(np.shape(value))
            for x, value in {"t": points.t, **points.states}.items()
            if x != "member"
        }
        for event, points in solution.events.items()
    }
    known = {
        x.split(".")[2] for x in pullback.adjoint.shapes(solution) if x.startswith("events.turn.")
    }
    events = {e: {x: y for x, y in own.items() if x in known} for e, own in events.items()}
    found = pullback(**states, events=events)
    for k in range(4):
        back = sum(np.vdot(found[x][k], move) for x, move in moves.items())
        parts = []
        for tangent in many.tangents.values():
            parts += [states[x][:, k] * tangent.states[x][:, k] for x in states]
            for event, own in events.items():
                at = tangent.events[event].of_member(k)
                is_own = solution.events[event].member == k
                parts.append(own["t"][is_own] * at.t)
                parts += [own[x][is_own] * at.states[x] for x in own if x != "t"]
        sizes = sum(np.abs(part).sum() for part in parts)
        assert abs(back - sum(part.sum() for part in parts)) < 1e-12 * sizes
    assert sum(map(len, solution.events.values())) >= 4


def test_redundant_members_whose_runs_end():
    """Multipliers that are shared have tangents up to there."""
    problem = load("doubled_rod")
    system, start = problem.system, problem.start
    first = next(iter(start.values()))
    low = lv.Event(lambda t, q, v, lam, params: q[0] - 0.9 * first[0], terminal=True)
    run = {"t": (0, 2), "steps": 40, "every": 4, "events": {"low": low}}
    rows = {x: np.stack([value, value]) for x, value in start.items()}
    moves = {"params.g": 1.0}
    many = lv.ensemble(system, lv.Spark(2), **run, params={"g": [9.0, 3.0]}, tangents=moves, **rows)
    assert {*many.endings} == {0, 1}
    for k, g in enumerate([9.0, 3.0]):
        one = lv.integrate(system, lv.Spark(2), **run, params={"g": g}, tangents=moves, **start)
        own, alone = many.member(k).tangents["params.g"], one.tangents["params.g"]
        for x, value in own.states.items():
            np.testing.assert_array_equal(value, alone.states[x][: len(value)])
        np.testing.assert_array_equal(own.events["low"].t, alone.events["low"].t)


def test_a_cotangent_behind_the_end_of_a_member_is_refused():
    system, method, run, rows, _ = several("ball")
    solution, pullback = lv.vjp(system, method, wrt=["q"], **run, **rows)
    assert solution.endings
    ones = np.ones_like(solution.q)
    with pytest.raises(ValueError, match=r"the run of member \d is over at t = "):
        pullback(q=ones)
    kept = np.where(np.isnan(solution.q), 0.0, ones)
    assert np.isfinite(pullback(q=kept)["q"]).all()
    with pytest.raises(ValueError, match="check members one by one"):
        lv.check_gradient(system, method, wrt=["q"], **run, **rows)
    bounces = {**run, "events": {"ground": run["events"]["ground"]}}
    three = {x: value[:3] for x, value in rows.items()}  # the fourth comes to rest
    found = lv.check_gradient(system, method, wrt=["v", "params.e"], **bounces, **three, size=2e-4)
    assert found.dot < 1e-12
    assert found.differences < 1e-9


def test_cotangents_of_events_have_their_names_and_shapes():
    system, events, start, _ = ball()
    run = {"wrt": ["params.g"], "t": (0, 2.2), "steps": 9, "events": events}
    solution, pullback = lv.vjp(system, lv.Spark(2), **run, **start)
    hits = len(solution.events["ground"])
    with pytest.raises(TypeError, match=r"no cotangent of 'events\.wall\.t'"):
        pullback(events={"wall": {"t": [1.0]}})
    with pytest.raises(ValueError, match=rf"has shape \({hits + 1},\), wanted \({hits},\)"):
        pullback(events={"ground": {"t": np.ones(hits + 1)}})
    with pytest.raises(TypeError, match="are mappings of their states"):
        pullback(events=[1.0])


def test_controlled_steps_that_end_at_switches():
    """A force that jumps moves the derivative by the time at which it does."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2,
        force=lambda t, q, v, params: -params.c * ca.if_else(q[0] > params.at, 1.0, -1.0),
        switches={"side": lambda t, q, v, params: q[0] - params.at},
        q=1, params={"c": 0.5, "at": 0.3},
    )  # fmt: skip
    start = {"q": np.array([1.0]), "v": np.array([0.2])}
    directions = {"params.c": 1.0, "params.at": 1.0, "q": np.array([1.0])}
    run = {"rtol": 1e-10, "every": 10_000}
    check(system, lv.Spark(3), (0.0, 4.0), start, directions, **run)
    assert paired(system, lv.Spark(3), (0.0, 4.0), start, directions, **run) < 1e-12
