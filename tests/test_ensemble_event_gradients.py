"""Members that meet events, each at times of its own, have the derivatives of runs alone."""

import numpy as np
import pytest
from event_cases import ball, general, pendulum, walled
from test_tangents import directions_of

import liouville as lv
from liouville.problems import load


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
@pytest.mark.parametrize("has_times", [False, True], ids=["steps", "t_eval"])
def test_members_have_the_tangents_and_pullbacks_of_runs_alone(name, has_times):
    """Also where an event ends their runs, each at a time of its own."""
    system, method, run, rows, params = several(name)
    t0, t1 = run["t"]
    if has_times:
        run = {**run, "every": 1, "t_eval": np.linspace(t0, t1, 9)[1:]}
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
        lv.analysis.check_gradient(system, method, wrt=["q"], **run, **rows)
    bounces = {**run, "events": {"ground": run["events"]["ground"]}}
    three = {x: value[:3] for x, value in rows.items()}  # the fourth comes to rest
    found = lv.analysis.check_gradient(
        system, method, wrt=["v", "params.e"], **bounces, **three, size=2e-4
    )
    assert found.dot < 1e-12
    assert found.differences < 1e-9


def test_pullbacks_of_members_trace_no_event_again():
    """A member takes the tapes of the ensemble."""
    system, method, run, rows, _ = several("ball")
    calls = []

    def ground(t, q, v, lam, params):
        calls.append(1)
        return q[1] - params.bend * q[0] ** 2

    events = {"ground": lv.Event(ground, "down", reset=run["events"]["ground"].reset)}
    three = {x: value[:3] for x, value in rows.items()}  # the fourth comes to rest
    call = {"system": system, "method": method, **run, "events": events}
    solution, pullback = lv.vjp(**call, wrt=["q"], **three)
    traced = len(calls)
    pullback(q=np.ones_like(solution.q))
    assert len(calls) == traced > 0
