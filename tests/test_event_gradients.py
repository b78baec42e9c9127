"""Events move with what a run depends on: their times, the states there, and all behind a reset."""

import casadi as ca
import numpy as np
import pytest
from event_cases import CONTROLS, ENDS, ball, check, general, paired, pendulum, walled
from test_tangents import directions_of

import liouville as lv


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


@pytest.mark.parametrize(
    "method", [lv.Spark(2), lv.LobattoPair(3), lv.Composition(lv.Spark(1), "Y4"), lv.HHT()], ids=str
)
def test_a_reset_that_leaves_the_constraints(method):
    """The way back to them is differentiated, correction by correction."""
    system, start, directions = pendulum()

    def beside(t, q, v, lam, params):
        return {"q": (1.2 + t / 99) * q + ca.vertcat(params.wall, q[0] / 9), "v": -params.e * v}

    wall = lv.Event(lambda t, q, v, lam, params: q[0] + params.wall, reset=beside, terminal=2)
    run = {"t": (0.1, 3.3), "steps": 62, "events": {"wall": wall}, "every": 4}
    more = directions | ENDS
    bound = 1e-9 if isinstance(method, lv.HHT) else None
    found = check(system, method, start=start, directions=more, bound=bound, **run)
    assert len(found.events["wall"]) == 2
    assert paired(system, method, start=start, directions=more, **run) < 1e-12


def test_a_reset_that_leaves_the_constraints_of_every_nonlinear_function():
    system, events, start = general()
    law = {"y": lambda t, y, z, params: y * (1.1 + t / 9) + params.a * z / 20}
    events["turn"] = lv.Event(
        events["turn"].function,
        reset=lambda t, y, z, lam, params: {"y": law["y"](t, y, z, params), "z": -params.c * z},
    )
    directions = directions_of(system, "t0", "t1")
    run = {"steps": 20, "events": events, "every": 3}
    found = check(system, lv.Spark(2), (0.2, 1.4), start, directions, **run)
    assert len(found.events["turn"])
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


@pytest.mark.parametrize("terminal", ["x", "y", None])
@pytest.mark.parametrize("seen", [0, 1])
def test_pullbacks_of_all_resets_at_the_end_of_a_run(terminal, seen):
    """In a corner, where one of them may end the run too, and with a plain event."""
    square = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1] / 9,
        q=("x", "y"), params={"a": 1.0, "g": 1.0},
    )  # fmt: skip
    end = 1.125
    events = {
        "x": lv.Event(
            lambda t, q, v, lam, params: q[0] - params.a * end, "up",
            reset=lv.Impact(0.5), terminal=terminal == "x",
        ),
        "y": lv.Event(
            lambda t, q, v, lam, params: q[1] - end + params.g * end**2 / 18, "up",
            reset=lambda t, q, v, lam, params: -params.a * v * (1 + t), terminal=terminal == "y",
        ),
        "seen": lv.Event(lambda t, q, v, lam, params: t + q[0] - 2 * end, terminal=seen),
    }  # fmt: skip
    directions = {"q": np.array([0.3, 0.7]), "v": np.array([0.2, -0.4])}
    directions |= {"params.a": 1.0, "params.g": 0.5}
    call = {"t": (0.0, end), "h": 0.125, "events": events}
    start = {"q": np.zeros(2), "v": np.ones(2)}
    run = lv.integrate(square, lv.Spark(2), **call, **start)
    assert [len(points) for points in run.events.values()] == [1, 1, 1]
    assert run.t[-1] == end
    assert paired(square, lv.Spark(2), start=start, directions=directions, **call) < 1e-12


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("reset", [True, False])
@pytest.mark.parametrize("every", [1, 3, 100])
@pytest.mark.parametrize("end", [0.0, 1.125, 1.1])
def test_pullbacks_of_events_at_the_ends_of_steps(terminal, reset, every, end):
    """The record there is of the state after the event, which the next step meets at its start."""
    ball = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1] / 9,
        q=("x", "y"), params={"a": end, "g": 1.0},
    )  # fmt: skip
    law = lv.Impact(0.5) if reset else None
    wall = lv.Event(lambda t, q, v, lam, params: q[0] - params.a, "up", terminal, reset=law)
    corner = lv.Event(
        lambda t, q, v, lam, params: q[1] - end + params.g * end**2 / 18, "up",
        reset=lambda t, q, v, lam, params: {"v": {"y": -params.g * v[1]}},
    )  # fmt: skip
    for events in ({"wall": wall}, {"wall": wall, "corner": corner}):
        directions = {"q": np.array([0.3, 0.7]), "v": np.array([0.2, -0.4])}
        directions |= {"params.a": 1.0, "params.g": 0.5}
        call = {"t": (0.0, 2.0), "h": 0.125, "every": every, "events": events}
        start = {"q": np.zeros(2), "v": np.ones(2)}
        assert paired(ball, lv.Spark(2), start=start, directions=directions, **call) < 1e-12


def pushed(sides=lambda x: ca.if_else(x < 0, 1.0, -1.0), make=None):
    """Return a mass that a force pushes until T and then holds back, and the event of that."""
    system = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2,
        force=lambda t, q, v, p: sides(t - p.T), q=("x",), params={"T": 1.0, "J": 0.5},
    )  # fmt: skip
    reset = make or (lambda t, q, v, lam, p: v)
    return system, {"turn": lv.Event(lambda t, q, v, lam, p: t - p.T, reset=reset)}


def by_switch(system, events, T, steps, t=(0.0, 2.0), method=None):
    """Return the derivatives of x and v at the end by T, as a tangent and as a gradient."""
    run = {"t": t, "steps": steps, "params": {"T": T}, "events": events, "q": [0.0], "v": [0.0]}
    method = method or lv.Spark(2)
    tangent = lv.integrate(system, method, tangents={"params.T": 1.0}, **run).tangents["params.T"]
    solution, pullback = lv.vjp(system, method, wrt=["params.T"], **run)
    last = np.zeros_like(solution.q)
    last[-1] = 1.0
    gradients = [pullback(**{name: last})["params.T"] for name in "qv"]
    return [tangent.q[-1, 0], tangent.v[-1, 0], *gradients]


@pytest.mark.parametrize("method", [lv.Spark(1), lv.Spark(2), lv.Spark(4)])
def test_a_force_that_jumps_at_the_end_of_a_step_moves_the_motion_as_one_within(method):
    """x(2) is T^2/2 + T (2 - T) - (2 - T)^2/2, whichever side the force is on at T."""
    system, events = pushed()
    for T in np.arange(1, 20) / 10:
        wanted = [2 * (2 - T), 2.0] * 2
        assert by_switch(system, events, T, 20, method=method) == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize(
    "sides",
    [
        lambda x: ca.if_else(x <= 0, 1.0, -1.0),
        lambda x: -ca.sign(x),
        lambda x: 1 - 2 * (x >= 0),
        lambda x: ca.if_else(x > 0, -1.0, 1.0),
    ],
)
def test_the_side_that_an_expression_takes_at_an_edge_does_not_matter(sides):
    for T in (0.5, 0.8, 1.7):
        wanted = [2 * (2 - T), 2.0] * 2
        assert by_switch(*pushed(sides), T, 20) == pytest.approx(wanted, abs=1e-12)


def test_round_times_of_a_hundred_jumps_among_two_hundred_steps():
    system, events = pushed()
    rng = np.random.default_rng(0)
    for T in np.round(rng.uniform(0.05, 1.95, 100), 2):
        run = {"t": (0, 2), "steps": 200, "params": {"T": T}, "events": events}
        found = lv.integrate(
            system, lv.Spark(2), **run, q=[0.0], v=[0.0], tangents={"params.T": 1.0}
        )
        tangent = found.tangents["params.T"]
        assert [tangent.q[-1, 0], tangent.v[-1, 0]] == pytest.approx([2 * (2 - T), 2.0])


@pytest.mark.parametrize(
    "method",
    [lv.Composition(lv.Spark(1)), lv.Spark(2, points="radau"), lv.LobattoPair(2), lv.HHT(-0.1)],
)
def test_methods_that_see_both_sides_of_a_jump_refuse_it_at_the_end_of_a_step_too(method):
    system, events = pushed()
    for steps in (20, 21):
        with pytest.raises(lv.IntegrationError, match="the equations jump with"):
            by_switch(system, events, 1.0, steps, method=method)


def test_a_kick_with_a_jump_at_the_end_of_a_step():
    """x(2) is T^2/2 + (T + J) (2 - T) - (2 - T)^2/2, whose derivative is 2 (2 - T) - J."""
    kicked = pushed(make=lambda t, q, v, lam, p: v + p.J)
    for steps in (20, 21):
        assert by_switch(*kicked, 1.0, steps) == pytest.approx([1.5, 2.0] * 2, abs=1e-12)


@pytest.mark.parametrize("steps", [16, 17])
def test_friction_that_turns_at_the_end_of_a_step_has_the_derivative_of_the_motion(steps):
    """A block is pushed up a slope, turns at t = 1 and slides back."""
    block = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2 - p.s * q[0],
        force=lambda t, q, v, p: -p.mu * ca.sign(v), q=("x",), params={"s": 1.5, "mu": 0.5},
    )  # fmt: skip
    turn = {"turn": lv.Event(lambda t, q, v, lam, p: v[0], reset=lambda t, q, v, lam, p: v)}
    tangents = {"params.mu": 1.0, "params.s": 1.0, "v": [1.0]}
    found = lv.integrate(
        block, lv.Spark(2), t=(0, 2), steps=steps, q=[0.0], v=[2.0], events=turn,
        tangents=tangents,
    )  # fmt: skip
    own = [found.tangents[name].q[-1, 0] for name in tangents]
    assert own == pytest.approx([-0.5, -1.5, 1.5], abs=1e-12)


def test_members_and_semi_explicit_systems_have_the_derivative_of_a_jump_at_the_end_of_a_step():
    system, events = pushed()
    run = {"t": (0, 2), "steps": 20, "tangents": {"params.T": 1.0}}
    T = np.array([0.5, 1.0, 1.05])
    found = lv.ensemble(
        system, lv.Spark(2), **run, params={"T": T}, events=events, q=[0.0], v=[0.0]
    )
    assert found.tangents["params.T"].q[-1, :, 0] == pytest.approx(2 * (2 - T), abs=1e-12)
    linked = lv.SemiExplicit(
        field=lambda t, y, z, p: [y[1], ca.if_else(t < p.T, 1.0, -1.0), z[0]],
        constraint=lambda t, y, p: {"c": y[2] - y[0]},
        y=("a", "b", "c"), z=("l",), params={"T": 1.0},
    )  # fmt: skip
    turn = {"turn": lv.Event(lambda t, y, z, p: t - p.T, reset=lambda t, y, z, p: y)}
    found = lv.integrate(linked, lv.Spark(2), **run, events=turn, y=[0.0, 0.0, 0.0])
    assert found.tangents["params.T"].y[-1] == pytest.approx([2.0, 2.0, 2.0], abs=1e-12)


@pytest.mark.parametrize("method", [lv.HHT(-0.1), lv.GeneralizedAlpha(), lv.Spark(2)])
@pytest.mark.parametrize("steps", [120, 121, 150])
def test_a_hit_a_few_roundings_before_the_end_of_a_step(method, steps):
    """A ball falls from 1/2 to the ground at t = 1, to roundoff; dv/dg at t = 1.5 is -3/4."""
    ball = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2 - p.g * q[0], q=("x",), params={"g": 1.0, "e": 0.5}
    )
    bounce = lv.Impact(lambda t, q, v, lam, p: p.e)
    events = {"ground": lv.Event(lambda t, q, v, lam, p: q[0], "down", reset=bounce)}
    run = {"t": (0, 1.5), "steps": steps, "q": [0.5], "v": [0.0], "events": events}
    found = lv.integrate(ball, method, tangents={"params.g": 1.0}, **run)
    solution, pullback = lv.vjp(ball, method, wrt=["params.g"], **run)
    last = np.zeros_like(solution.v)
    last[-1] = 1.0
    by_both = [found.tangents["params.g"].v[-1, 0], pullback(v=last)["params.g"]]
    assert by_both == pytest.approx([-0.75, -0.75], abs=1e-10)


@pytest.mark.parametrize("t_eval", [None, [1.0]])
@pytest.mark.parametrize("steps", [15, 16])
def test_a_record_at_the_time_of_a_hit_is_that_after_one_shortly_before(t_eval, steps):
    """The end of the run too: by g they are (1/4, -1/4), and (-1/2, -1) before it."""
    ball = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - p.g * q[0], q=1, params={"g": 1.0})
    bounce = lv.Event(lambda t, q, v, lam, p: q[0], "down", reset=lv.Impact(0.5))
    for end in (1.0, steps / 8):
        run = {"t": (0, end), "h": 1 / 8, "q": [0.5], "v": [0.0], "events": {"ground": bounce}}
        found = lv.integrate(ball, lv.Spark(2), tangents={"params.g": 1.0}, t_eval=t_eval, **run)
        place = np.flatnonzero(found.t == 1.0)[-1]
        tangent = found.tangents["params.g"]
        own = [tangent.q[place, 0], tangent.v[place, 0]]
        assert own == pytest.approx([0.25, -0.25], abs=1e-12)
        solution, pullback = lv.vjp(ball, lv.Spark(2), wrt=["params.g"], t_eval=t_eval, **run)
        at = np.zeros_like(solution.q)
        at[place] = 1.0
        gradients = [pullback(**{name: at})["params.g"] for name in "qv"]
        assert gradients == pytest.approx([0.25, -0.25], abs=1e-12)
