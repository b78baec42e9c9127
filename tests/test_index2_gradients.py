"""Tangents and pullbacks of semi-explicit systems, whose z follows from y at every point."""

import casadi as ca
import numpy as np
import pytest
from event_cases import check
from event_cases import paired as paired_with_events
from registry import ALL, INDEX2
from test_adjoints import paired
from test_tangents import differences, directions_of, farthest, summed

import liouville as lv


def general():
    """Return a system whose field and constraints are nonlinear in everything, z among it."""

    def field(t, y, z, params):
        pull = (z[0] + params.a * z[0] ** 3 / 9) * y
        pull += params.b[0] * z[1] * ca.vertcat(0, 1, y[0], t)
        drift = ca.vertcat(y[1] * y[2], -y[0], params.c * ca.sin(t), y[0] * y[3])
        return drift - params.a * y / 5 - pull

    def constraint(t, y, params):
        length = ca.dot(y, y) - (params.l + ca.sin(t) / 9) ** 2
        return {"length": length, "height": y[1] + params.c * y[0] * y[2] / 4 - ca.cos(t) / 5}

    params = {"a": 0.4, "b": [0.8], "c": 0.7, "l": 1.1}
    return lv.SemiExplicit(field=field, constraint=constraint, y=4, z=2, params=params)


def started():
    system = general()
    start = system.consistent(t=0.2, y=[0.6, 0.1, -0.8, 0.3])
    directions = directions_of(system, "t0", "t1")
    return system, start, {name: x for name, x in directions.items() if name != "z"}


@pytest.mark.parametrize("row", INDEX2, ids=str)
def test_rows_of_the_registry(row):
    problem = ALL["index 2"]
    system, t, start = problem.system, (0.2, 0.5), problem.start
    start = system.consistent(t=t[0], y=problem.exact(t[0])["y"], z=problem.exact(t[0])["z"])
    directions = {"y": np.array([0.3, -0.7]), "t0": 0.2, "t1": 0.3}
    found = lv.integrate(system, row.method, t=t, steps=3, tangents=directions, **start)
    wanted = differences(system, row.method, t, start, directions, steps=3)
    assert farthest(summed(found, directions), wanted) < 1e-9
    plain = lv.integrate(system, row.method, t=t, steps=3, **start)
    assert np.array_equal(found.z, plain.z)
    assert paired(system, row.method, t, start, directions, steps=5, every=2) < 1e-12
    law = {"reset": lambda t, y, z, params: {"y": y}}
    run = {"steps": 5, "events": {"half": lv.Event(lambda s, *_: s - 0.37, **law)}}
    run["t_eval"] = [0.23, 0.31, 0.41]
    assert paired_with_events(system, row.method, t, start, directions, **run) < 1e-12


@pytest.mark.parametrize("method", [lv.Spark(1), lv.Spark(3), lv.Spark(2, points="radau"),
                                    lv.Composition(lv.Spark(1), "SU4")], ids=str)  # fmt: skip
def test_every_parameter_of_every_function_and_both_ends(method):
    (system, start, directions), t = started(), (0.2, 0.8)
    found = lv.integrate(system, method, t=t, steps=4, tangents=directions, **start)
    for name, direction in directions.items():
        wanted = differences(system, method, t, start, {name: direction}, steps=4)
        assert farthest(found.tangents[name].states, wanted) < 1e-9, name
    assert paired(system, method, t, start, directions, steps=10, every=3) < 1e-12
    found = lv.analysis.check_gradient(system, method, wrt=["y", "params.l"], t=t, steps=4, **start)
    assert found.dot < 1e-13
    assert found.differences < 1e-9


#: Methods by the kinds of polynomials between their steps.
DENSE = [lv.Spark(1), lv.Spark(2), lv.Spark(3), lv.Spark(4), lv.Spark(2, points="radau"),
         lv.Composition(lv.Spark(1), "SU4")]  # fmt: skip


@pytest.mark.parametrize("method", DENSE, ids=str)
def test_states_at_given_times(method):
    (system, start, directions), t = started(), (0.2, 0.8)
    run = {"steps": 5, "t_eval": [0.23, 0.33, 0.71, 0.79]}
    check(system, method, t, start, directions, bound=1e-9, size=2e-3, **run)
    run["t_eval"] = [0.2, *run["t_eval"], 0.8]
    assert paired(system, method, t, start, directions, least=1.0, **run) < 1e-12
    held = {name: x for name, x in directions.items() if name not in ("t0", "t1")}
    if not isinstance(method, lv.Composition):
        run = {"rtol": 1e-6, "t_eval": run["t_eval"], "least": 1.0}
        assert paired(system, method, t, start, held, **run) < 1e-12


def watched():
    """Return events of all kinds, of y, z, time and parameters."""

    def turned(t, y, z, params):
        rest = (params.l + ca.sin(t) / 9) ** 2 - ca.dot(y[:3], y[:3])
        return {"y": ca.vertcat(y[:3], -ca.sqrt(rest))}

    return {
        "side": lv.Event(lambda t, y, z, params: y[2] - params.c * t / 9 + 0.75, reset=turned),
        "pull": lambda t, y, z, params: z[0] + params.b[0] * t / 4,
        "last": lv.Event(lambda t, y, z, params: y[0] - 0.7 - params.a * z[1] / 9, terminal=2),
    }


@pytest.mark.parametrize("method", [lv.Spark(2), lv.Spark(2, points="radau"),
                                    lv.Composition(lv.Spark(1), "SU4")], ids=str)  # fmt: skip
def test_events_and_resets(method):
    system, start, directions = started()
    run = {"steps": 24, "events": watched(), "every": 5}
    found = check(system, method, (0.2, 2.2), start, directions, bound=1e-9, **run)
    assert all(len(points) for points in found.events.values())
    assert paired_with_events(system, method, (0.2, 2.2), start, directions, **run) < 1e-12
    run |= {"t_eval": [0.2, 0.41, 0.9, 1.3], "every": 1}
    assert paired_with_events(system, method, (0.2, 2.2), start, directions, **run) < 1e-12


@pytest.mark.parametrize("points", ["gauss", "radau"])
def test_events_that_jump_or_bend_have_no_derivative(points):
    """By y and by z, which follows from y."""
    system, start, _ = started()
    run = {"t": (0.2, 2.2), "steps": 24, **start}
    method = lv.Spark(2, points=points)
    pull = {"pull": lambda t, y, z, params: z[0] + t / 4}
    when = lv.integrate(system, method, events=pull, **run).events["pull"].t[0]
    bent = {"pull": lambda t, y, z, params: z[0] + t / 4 + ca.fmax(y[0] * (t - when), 0)}
    step = {"pull": lambda t, y, z, params: z[0] + t / 4 + ca.sign(z[0] + t / 4) / 5}
    for events, what in ((bent, "bends"), (step, "jumps")):
        sentence = rf"'pull' {what} at t = {when:.6g},"
        with pytest.raises(lv.IntegrationError, match=sentence):
            lv.integrate(system, method, events=events, tangents={"params.c": 1.0}, **run)
        solution, pullback = lv.vjp(system, method, wrt=["y"], events=events, **run)
        with pytest.raises(lv.IntegrationError, match=sentence):
            pullback(events={"pull": {"t": np.ones(len(solution.events["pull"]))}})


@pytest.mark.parametrize("points", ["gauss", "radau"])
def test_a_reset_that_leaves_the_constraints(points):
    """The way back to them is differentiated, correction by correction."""
    system, start, directions = started()

    def beside(t, y, z, params):
        return {"y": (1.2 + t / 9) * y * params.l + z[0] / 20}

    side = lv.Event(lambda t, y, z, params: y[2] + 0.75, reset=beside, terminal=3)
    run = {"steps": 24, "events": {"side": side}, "every": 5}
    method = lv.Spark(2, points=points)
    found = check(system, method, (0.2, 2.2), start, directions, **run)
    assert len(found.events["side"]) == 3
    assert paired_with_events(system, method, (0.2, 2.2), start, directions, **run) < 1e-12


@pytest.mark.parametrize("control", [
    {"rtol": 1e-7},
    {"control": lv.Reversible(monitor=lambda t, y, z, params: 1 + y[0] ** 2), "h": 0.03},
], ids=["errors", "reversible"])  # fmt: skip
def test_controlled_steps_are_held(control):
    system, start, directions = started()
    directions = {name: x for name, x in directions.items() if name not in ("t0", "t1")}
    run = {**control, "every": 3}
    assert paired(system, lv.Spark(2), (0.2, 1.4), start, directions, **run) < 1e-12
    run = {"t": (0.2, 1.4), "tangents": directions, **start}
    held = lv.integrate(system, lv.Spark(2), **run, **control)
    equal = lv.integrate(system, lv.Spark(3), steps=200, **run)
    for name in directions:
        own, wanted = (x.tangents[name].y[-1] for x in (held, equal))
        np.testing.assert_allclose(own, wanted, rtol=0, atol=1e-3)


def test_a_start_is_moved_and_members_are_those_of_runs():
    system, start, directions = started()
    found = lv.integrate(system, lv.Spark(2), t=(0.2, 0.8), steps=4, tangents=directions, **start)
    y, away = start["y"], found.tangents["params.l"].y[0]
    # outwards by as much as the length grows, with the time held, whatever the other constraint
    assert y @ away == pytest.approx(directions["params.l"] * np.sqrt(y @ y), rel=1e-12)
    rows = {name: np.stack([x, x]) for name, x in start.items()}
    values = {"params": {"c": [0.7, 0.7]}, "t": (0.2, 0.8), "steps": 4}
    many = lv.ensemble(system, lv.Spark(2), tangents=directions, **values, **rows)
    for name, tangent in found.tangents.items():
        assert np.array_equal(many.tangents[name].z[:, 1], tangent.z)
    hit = {"events": watched(), "t": (0.2, 2.2), "steps": 24, "tangents": directions}
    both = lv.ensemble(system, lv.Spark(2), **hit, **rows).member(1).tangents["params.c"]
    alone = lv.integrate(system, lv.Spark(2), **hit, **start).tangents["params.c"]
    assert np.array_equal(both.events["side"].y_after, alone.events["side"].y_after)
    assert np.array_equal(both.events["last"].t, alone.events["last"].t)
    of_many = lv.vjp(system, lv.Spark(2), wrt=["y", "params.l"], **values, **rows)
    one = lv.vjp(system, lv.Spark(2), wrt=["y", "params.l"], t=(0.2, 0.8), steps=4, **start)
    own = one[1](z=np.ones_like(one[0].z))
    both = of_many[1](z=np.ones_like(of_many[0].z))
    assert all(np.array_equal(both[name][1], own[name]) for name in own)


@pytest.mark.parametrize(("more", "sentence"), [
    ({"tangents": {"z": [1.0, 0.0]}}, "z follows from y by the hidden constraint"),
    ({"tangents": {"t1": 1.0}, "rtol": 1e-6, "steps": None}, "where steps are controlled"),
])  # fmt: skip
def test_what_has_no_tangents_is_refused(more, sentence):
    system, start, _ = started()
    call = {"t": (0.2, 0.8), "steps": 4, "tangents": {"params.c": 1.0}} | more
    with pytest.raises((TypeError, ValueError), match=sentence):
        lv.integrate(system, lv.Spark(2), **call, **start)
