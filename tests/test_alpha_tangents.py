"""Tangents of the alpha family, whose accelerations are part of what moves, against differences.

Events are here too: a part of a step has another size than the step before, with which
accelerations are moved along, and behind a reset they begin anew.
"""

import casadi as ca
import numpy as np
import pytest
from event_cases import ENDS, ball, check, pendulum, walled
from event_cases import paired as paired_with_events
from registry import ALL, ALPHA
from test_adjoints import paired
from test_tangents import differences, directions_of, farthest, summed

import liouville as lv

METHODS = [lv.HHT(), lv.HHT(-0.1, less_implicit=True), lv.GeneralizedAlpha(0.6),
           lv.ArnoldBruls(0.8)]  # fmt: skip


def system_of(constrained):
    """Return a system whose mass, forces and reactions bend with everything there is."""

    def momentum(t, y, z, params):
        return z * (1 + params.a * ca.dot(y, y) / 5 + ca.cos(t) / 7)

    def force(t, y, z, params):
        wind = params.b * ca.sin(2 * t) * ca.vertcat(1, 0, y[0])
        return ca.vertcat(z[1], -z[0], -params.c) - params.a * z / 5 + wind - y * y * z / 9

    def reaction(t, y, lam, params):
        return -y * lam + params.a * lam * ca.vertcat(y[1], 0, t / 9)

    def length(t, y, params):
        return ca.dot(y, y) - (params.l + ca.sin(t) / 9) ** 2

    more = {"reaction": reaction, "constraint": length} if constrained else {}
    return lv.Mechanical(
        velocity=lambda t, y, z, params: z, momentum=momentum, force=force, y=3,
        params={"a": 0.4, "b": 0.3, "c": 0.7, "l": 1.1}, **more,
    )  # fmt: skip


def started(constrained):
    """Return such a system with its start and directions of all there is."""
    system = system_of(constrained)
    start = system.consistent(t=0.2, y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])
    directions = directions_of(system, "t0", "t1")
    # the length is nothing to a free motion
    if not constrained:
        directions.pop("params.l")
    return system, start, directions


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("constrained", [True, False], ids=["constrained", "free"])
def test_every_parameter_of_every_function_and_both_ends(method, constrained):
    (system, start, directions), t = started(constrained), (0.2, 0.8)
    found = check(system, method, t, start, directions, bound=1e-9, size=2e-3, steps=5)
    plain = lv.integrate(system, method, t=t, steps=5, **start)
    assert np.array_equal(found.a, plain.a)


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("constrained", [True, False], ids=["constrained", "free"])
def test_pullbacks_are_the_transposes_of_tangents(method, constrained):
    (system, start, directions), t = started(constrained), (0.2, 0.8)
    assert paired(system, method, t, start, directions, steps=10, every=3) < 1e-12
    held = {**start, "a": np.array([0.1, -0.2, 0.3])}
    assert paired(system, method, t, held, directions, steps=2) < 1e-12


#: Every row of the registry, each on one of its problems in turn.
ROWS = [(row, row.on[k % len(row.on)]) for k, row in enumerate(ALPHA)]


@pytest.mark.parametrize(("row", "name"), ROWS, ids=str)
def test_tangents_are_differences(row, name):
    problem = ALL[name]
    system, t = problem.system, (problem.t[0], problem.t[0] + 0.3)
    start = system.consistent(t=t[0], **problem.start)
    directions, run = directions_of(system), {"steps": 3, "every": 3}
    found = lv.integrate(system, row.method, t=t, tangents=directions, **run, **start)
    wanted = differences(system, row.method, t, start, directions, **run)
    own = summed(found, directions)
    assert farthest(own, {x: wanted[x] for x in own}) < 1e-8
    directions = directions_of(system, "t0", "t1")
    assert paired(system, row.method, t, start, directions, steps=5, every=2) < 1e-12
    # a time that parts a step, and accelerations that begin anew there
    law = {"reset": lambda t, y, z, lam, params: z}
    run = {"steps": 5, "events": {"half": lv.Event(lambda s, *_: s - t[0] - 0.17, **law)}}
    assert paired_with_events(system, row.method, t, start, directions, **run) < 1e-12


def test_accelerations_that_are_given_stay_and_members_are_those_of_runs():
    system, t = system_of(True), (0.2, 0.8)
    start = system.consistent(t=t[0], y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])
    run, directions = {"t": t, "steps": 4}, {"params.c": 1.0, "params.l": 1.0}
    held = {**start, "a": np.array([0.1, -0.2, 0.3])}
    found = lv.integrate(system, lv.HHT(), tangents=directions, **run, **held).tangents
    free = lv.integrate(system, lv.HHT(), tangents=directions, **run, **start).tangents
    assert np.abs(found["params.c"].y - free["params.c"].y).max() > 1e-3
    both = {name: np.stack([x, x]) for name, x in start.items()}
    members = lv.ensemble(system, lv.HHT(), tangents=directions, **run, **both).tangents
    assert np.array_equal(members["params.l"].lam[:, 1], free["params.l"].lam)


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("constrained", [True, False], ids=["constrained", "free"])
def test_states_at_given_times(method, constrained):
    (system, start, directions), t = started(constrained), (0.2, 0.8)
    times = [0.23, 0.33, 0.71, 0.79]
    run = {"steps": 5, "t_eval": times}
    check(system, method, t, start, directions, bound=1e-9, size=2e-3, **run)
    run["t_eval"] = [0.2, *times, 0.8]
    assert paired(system, method, t, start, directions, least=1.0, **run) < 1e-12
    held = {name: x for name, x in directions.items() if name not in ("t0", "t1")}
    run = {"rtol": 1e-4, "t_eval": times, "least": 1.0}
    assert paired(system, method, t, start, held, **run) < 1e-12


def spring():
    """Return a free particle on a nonlinear spring, whose energy nothing changes."""
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.k * ca.dot(q, q) ** 2 / 4,
        q=2, params={"k": 1.5},
    )  # fmt: skip


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("control", [{"rtol": 1e-4}, {"rtol": 1e-4, "h": 0.3}], ids=str)
def test_controlled_steps_are_held(method, control):
    system, t, run = system_of(True), (0.2, 1.7), {**control, "every": 3}
    start = system.consistent(t=t[0], y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])
    directions = directions_of(system)
    assert paired(system, method, t, start, directions, **run) < 1e-12
    free, begin = spring(), {"q": np.array([1.0, 0.2]), "v": np.array([0.1, 0.7])}
    assert paired(free, method, (0.0, 3.0), begin, directions_of(free), **run) < 1e-12


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_steps_that_change_their_size_have_the_tangents_of_their_accelerations(method):
    """Two runs with the sizes of one: the second goes on with its accelerations moved along."""
    system, t = system_of(True), (0.2, 1.2)
    start = system.consistent(t=t[0], y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])
    # the steps follow tangents too
    run = {"t": t, "rtol": 1e-3, "atol": 1e-5, "tangents": {"params.c": 1.0}}
    found = lv.integrate(system, method, **run, **start)
    assert len(set(np.diff(found.t))) > 3
    sizes, total = 1e-7, 0.0
    for sign in (1, -1):
        moved = lv.integrate(system, method, params={"c": 0.7 + sign * sizes}, **run, **start)
        assert len(moved.t) == len(found.t)
        total = total + sign * moved.y / (2 * sizes)
        assert np.abs(moved.t - found.t).max() < 1e-4
    # the choice of the steps is not differentiated: they move by a part of the tolerance
    assert np.abs(total - found.tangents["params.c"].y)[-1].max() < 5e-2


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("control", [{"steps": 26}, {"rtol": 1e-5}], ids=str)
def test_bouncing_ball(method, control):
    system, events, start, directions = ball()
    directions |= ENDS if "steps" in control else {}
    run = {**control, "events": events}
    found = check(system, method, (0.0, 3.1), start, directions, every=10_000, **run)
    assert len(found.events["ground"]) >= 2
    assert paired_with_events(system, method, (0.0, 3.1), start, directions, **run) < 1e-12
    # accelerations that are given, and what the first part of a step makes of them
    held = {**start, "a": np.array([0.1, -0.7])}
    run["t_eval"] = [0.0, 0.3, 1.1, 1.12, 2.9]
    assert paired_with_events(system, method, (0.0, 3.1), held, directions, **run) < 1e-12


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("law", ["impact", "velocities", "none"])
def test_wall_recorded_and_terminal_events_of_a_pendulum(method, law):
    system, start, directions = pendulum()
    run = {"directions": directions | ENDS, **walled(law), "steps": 40}
    found = check(system, method, (0.1, 3.3), start, bound=1e-9, **run)
    assert all(len(points) for points in found.events.values())
    assert paired_with_events(system, method, (0.1, 3.3), start, **run) < 1e-12
    run |= {"t_eval": [0.1, 0.2, 0.71, 1.5, 1.6, 2.01], "every": 1}
    assert paired_with_events(system, method, (0.1, 3.3), start, **run) < 1e-12


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_resets_where_every_function_is_nonlinear(method):
    system, start, directions = started(True)
    events = {
        "turn": lv.Event(
            lambda t, y, z, lam, params: y[1] - params.c - t / 9 + 0.2,
            reset=lv.Impact(lambda t, y, z, lam, params: params.c + y[0] / 9),
        ),
        "side": lv.Event(
            lambda t, y, z, lam, params: z[0] + y[1] / 2 + lam[0] / 9 - 0.3,
            reset=lambda t, y, z, lam, params: z * params.c * (1 + t / 9),
        ),
    }
    run = {"steps": 30, "events": events}
    found = check(system, method, (0.2, 1.4), start, directions, bound=1e-8, **run)
    assert len(found.events["turn"]) * len(found.events["side"]) >= 1
    assert paired_with_events(system, method, (0.2, 1.4), start, directions, **run) < 1e-12


def test_controlled_steps_that_end_at_switches_are_refused():
    """A derivative by when they end would be that of accelerations from one side of the switch."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2,
        force=lambda t, q, v, params: -params.c * ca.if_else(q[0] > 0.3, 1.0, -1.0),
        switches={"side": lambda t, q, v, params: q[0] - 0.3},
        q=1, params={"c": 0.5},
    )  # fmt: skip
    call = {"t": (0, 2), "tangents": {"params.c": 1.0}, "q": [1.0], "v": [0.2]}
    with pytest.raises(TypeError, match="tangents by HHT go without steps that end at switches"):
        lv.integrate(system, lv.HHT(), rtol=1e-6, **call)
    with pytest.raises(lv.IntegrationError, match="the equations jump with"):
        lv.integrate(system, lv.HHT(), steps=50, **call)
    before = call | {"t": (0, 0.5)}
    found = lv.integrate(system, lv.HHT(), steps=50, **before)
    assert np.isfinite(found.tangents["params.c"].q).all()


@pytest.mark.parametrize("method", [lv.Spark(2), *METHODS], ids=str)
def test_a_given_time_a_rounding_after_the_end_of_a_step_is_that_end(method):
    """Step 12 of 24 ends at 0.8999999999999999: its state and its tangent are on the circle."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
        lambda t, q, params: ca.dot(q, q) - 1, q=2,
    )  # fmt: skip
    run = {"t": (0.3, 1.5), "steps": 24, "q": [0.6, -0.8], "v": [0.8, 0.6]}
    steps = lv.integrate(system, method, **run)
    assert steps.t[12] == 0.8999999999999999 < 0.9
    for moved in ("t0", "t1"):
        for given in ([0.9], [0.85, 0.9, 1.2], [0.9, 0.9 + 1e-12]):
            found = lv.integrate(system, method, t_eval=given, tangents={moved: 1.0}, **run)
            at = given.index(0.9)
            assert np.array_equal(found.t, given)
            assert np.array_equal(found.q[at], steps.q[12])
            assert np.array_equal(found.v[at], steps.v[12])
            assert abs(found.q[at] @ found.tangents[moved].q[at]) < 1e-14
    backwards = run | {"t": (1.5, 0.3)}
    steps = lv.integrate(system, method, **backwards)
    given = np.nextafter(steps.t[7:9], 0.0)  # beyond the ends
    found = lv.integrate(system, method, t_eval=given, **backwards)
    assert np.array_equal(found.q, steps.q[7:9])
