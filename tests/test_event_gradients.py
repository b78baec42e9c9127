"""Events move with what a run depends on: their times, the states there, and all behind a reset.

Tangents are compared with differences of order six, of runs that meet the same events, and
pullbacks with tangents.
"""

import casadi as ca
import numpy as np
import pytest
from test_tangents import WEIGHTS, directions_of, farthest, moved

import liouville as lv

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
            names = (*system.states, "lam")
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
    free, events, at, _ = ball()
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
    solution, pullback = lv.vjp(fall, lv.Spark(2), wrt=["v"], **drop)
    assert "accumulate at t = 1.35457" in solution.message
    with pytest.raises(lv.IntegrationError, match=accumulate):
        pullback(q=np.ones_like(solution.q))
    up = {"q": np.array([0.0, 1.0]), "v": np.array([0.0, 2.0])}
    touch = lv.Event(lambda t, q, v, lam, params: (q[1] - 1.5) ** 3)
    with pytest.raises(lv.IntegrationError, match="touched and not crossed"):
        lv.integrate(free, lv.Spark(2), t=(0, 1.9), steps=7, events={"top": touch},
                     tangents={"params.g": 1.0}, **up)  # fmt: skip
    with pytest.raises(TypeError, match="tangents of an ensemble go without events="):
        lv.ensemble(free, lv.Spark(1), t=(0, 1), steps=1, tangents={"params.g": 1.0},
                    events=events, **{name: x[None] for name, x in at.items()})  # fmt: skip


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
