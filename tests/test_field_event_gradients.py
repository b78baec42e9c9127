"""Derivatives of fields at given times and at events: differences, and transposes of each other."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.problems import abc_flow

RUN = {"t": (0.1, 1.7), "steps": 8}
#: Between the ends of steps, one of them within the first.
TIMES = [0.15, 0.67, 1.43]
#: Differences of order six.
WEIGHTS = ((1, 45 / 60), (2, -9 / 60), (3, 1 / 60))


def driven():
    """Return a field that depends on time."""
    return lv.PolynomialField(
        lambda t, x, params: [x[1], -params.k * x[0] + params.a * ca.sin(params.w * t) * x[0] ** 2],
        x=2,
        params={"k": 1.3, "a": 0.7, "w": 2.0},
    )


def gridded():
    """Return a stream function on a grid."""
    nodes = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    psi = np.sin(nodes)[:, None] * np.sin(nodes) + 0.3 * np.cos(nodes)[:, None]
    return lv.GriddedField(nodes, nodes, potential=psi, periodic=("x", "y"), degree=5)


def charged():
    """Return a charge in a magnetic bottle and a well."""
    return lv.ChargedParticles(
        B=lambda t, x, params: [-0.1 * x[0] * x[2], -0.1 * x[1] * x[2], params.b + 0.1 * x[2] ** 2],
        phi=lambda t, x, params: 0.1 * ca.cos(t) * ca.exp(-ca.dot(x, x)),
        charge=1.5,
        mass=0.8,
        params={"b": 1.0},
    )


def stream():
    """Return a stream function with a parameter, which moves."""
    return lv.PotentialField(
        lambda t, x, params: ca.sin(x[0] - params.c * t) * ca.cos(x[1]), x=2, params={"c": 0.4}
    )


#: A field, its start, and what it is differentiated by.
FIELDS = {
    "abc": (abc_flow.system, [0.3, 1.1, -0.4], ["params.A"]),
    "driven": (driven(), [0.8, 0.5], ["params.k", "params.a"]),
    "gridded": (gridded(), [0.9, 2.4], []),
    "charged": (charged(), [0.4, -0.2, 0.3, 0.5, 0.1, -0.3], ["params.b"]),
    "stream": (stream(), [0.5, 0.3], []),
}


def prepared(name):
    """Return a field, its plan, its start, and what it is differentiated by."""
    system, x, params = FIELDS[name]
    plan = lv.plan(system, lv.VolumeSplitting(), h=0.2, x=x)
    return system, plan, x, ["x", "t0", "t1", *params]


def crossing(system, plan, x, *, terminal=False):
    """Return an event that is met within the sixth step, and moves with the time."""
    t = 1.23
    before, at, after = lv.integrate(system, plan, **RUN, t_eval=[t - 0.01, t, t + 0.01], x=x).x
    way = (after - before) / np.linalg.norm(after - before)
    return {
        "wall": lv.Event(
            lambda t_of, x, params: ca.dot(way, x - at) + 0.2 * (t_of - t), terminal=terminal
        )
    }


@pytest.mark.parametrize("name", FIELDS)
def test_gradients_at_given_times(name):
    """By the start, its time, the end and parameters; times are held while the steps move."""
    system, plan, x, wrt = prepared(name)
    run = {**RUN, "t_eval": TIMES, "x": x}
    found = lv.analysis.check_gradient(system, plan, wrt=wrt, size=3e-4, **run)
    assert found.dot < 1e-13
    assert found.differences < 1e-8
    moved = lv.integrate(system, plan, tangents={"t0": 1.0}, **run)
    np.testing.assert_array_equal(moved.x, lv.integrate(system, plan, **run).x)


@pytest.mark.parametrize("name", FIELDS)
def test_runs_that_an_event_ends(name):
    """The last state is that of the event, and moves with it."""
    system, plan, x, wrt = prepared(name)
    events = crossing(system, plan, x, terminal=True)
    run = {**RUN, "every": 2, "events": events, "x": x}
    ended = lv.integrate(system, plan, **run)
    assert ended.t[-1] < 1.3
    found = lv.analysis.check_gradient(system, plan, wrt=wrt, size=3e-4, **run)
    assert found.dot < 1e-13
    assert found.differences < 1e-8


def sides(system, plan, x, run, name, direction, step):
    """Return runs moved by so much of a direction."""
    run = {**run, "x": np.asarray(x, dtype=float)}
    if name == "x":
        run["x"] = run["x"] + step * direction
    elif name in ("t0", "t1"):
        ends = list(run["t"])
        ends[name == "t1"] += step * direction
        run["t"] = tuple(ends)
    else:
        name = name.removeprefix("params.")
        run["params"] = {name: system.params[name] + step * direction}
    return lv.integrate(system, plan, **run)


@pytest.mark.parametrize("terminal", [False, True], ids=["passed", "terminal"])
@pytest.mark.parametrize("name", FIELDS)
def test_times_and_states_of_events(name, terminal):
    """Differences to 1e-9, and cotangents of both paired with tangents to roundoff."""
    system, plan, x, wrt = prepared(name)
    rng = np.random.default_rng(2)
    events = crossing(system, plan, x, terminal=terminal)
    run = {**RUN, "every": 3, "events": events}
    directions = {y: rng.standard_normal(len(x)) if y == "x" else 1.0 for y in wrt}
    moved = lv.integrate(system, plan, x=x, tangents=directions, **run)
    count = moved.events["wall"].t.size
    assert count >= 1
    step = 1e-3
    for y, direction in directions.items():
        args = system, plan, x, run, y, direction
        each = {k: (sides(*args, k * step), sides(*args, -k * step)) for k, _ in WEIGHTS}
        for state in ("t", "x"):
            wanted = sum(
                w * (getattr(a.events["wall"], state) - getattr(b.events["wall"], state)) / step
                for (k, w) in WEIGHTS
                for a, b in [each[k]]
            )
            own = getattr(moved.tangents[y].events["wall"], state)
            np.testing.assert_allclose(own, wanted, rtol=0, atol=1e-9)
    solution, pullback = lv.vjp(system, plan, wrt=wrt, x=x, **run)
    of_x = rng.standard_normal(solution.x.shape)
    own = {"t": rng.standard_normal(count), "x": rng.standard_normal((count, len(x)))}
    gradient = pullback(x=of_x, events={"wall": own})
    back = sum(float(np.vdot(gradient[y], direction)) for y, direction in directions.items())
    pairs = [
        a * b
        for y in wrt
        for tangent in [moved.tangents[y]]
        for a, b in [
            (of_x, tangent.x), *((own[z], getattr(tangent.events["wall"], z)) for z in "tx")
        ]
    ]  # fmt: skip
    size = sum(np.abs(pair).sum() for pair in pairs)
    assert abs(back - sum(pair.sum() for pair in pairs)) < 1e-12 * size


def test_members_at_times_and_events_are_as_alone():
    """Tangents and gradients, where some members meet the event and one ends there."""
    system, plan, x, _ = prepared("driven")
    events = crossing(system, plan, x, terminal=True)
    starts = np.array([x, [5.0, 5.0], np.multiply(1.01, x)])
    directions = {"x": np.eye(2), "params.a": 1.0, "t0": 1.0}
    many = lv.ensemble(system, plan, **RUN, events=events, x=starts, tangents=directions, threads=1)
    _, pullback = lv.vjp(system, plan, wrt=["x", "t0"], events=events, x=starts, **RUN)
    hits = many.events["wall"].member
    assert sorted(hits) == [0, 2]
    of_times = np.array([1.0, 2.0])
    found = pullback(events={"wall": {"t": of_times}})
    for member, start in enumerate(starts):
        alone = lv.integrate(system, plan, **RUN, events=events, x=start, tangents=directions)
        last = np.isfinite(many.x[:, member, 0])
        for name, tangent in alone.tangents.items():
            own = many.tangents[name]
            rows = min(last.sum(), len(tangent.x))
            np.testing.assert_array_equal(own.x[: rows - 1, member], tangent.x[: rows - 1])
            np.testing.assert_array_equal(
                own.events["wall"].t[hits == member], tangent.events["wall"].t
            )
        if member in hits:
            _, single = lv.vjp(system, plan, wrt=["x", "t0"], events=events, x=start, **RUN)
            wanted = single(events={"wall": {"t": of_times[hits == member]}})
            np.testing.assert_allclose(found["x"][member], wanted["x"], rtol=1e-13)
            np.testing.assert_allclose(found["t0"][member], wanted["t0"], rtol=1e-13)
    assert not found["x"][1].any()
    timed = lv.ensemble(system, plan, **RUN, t_eval=TIMES, x=starts, tangents=directions)
    alone = lv.integrate(system, plan, **RUN, t_eval=TIMES, x=x, tangents=directions)
    np.testing.assert_array_equal(timed.tangents["t0"].x[:, 0], alone.tangents["t0"].x)


def test_a_long_run_is_pulled_back_from_checkpoints():
    """More steps than two checkpoints have between them; events and times in all pieces."""
    system, plan, x, _ = prepared("driven")
    zero = {"axis": lambda t, x, params: x[1]}
    run = {"t": (0.0, 60.0), "steps": 1200, "x": x, "events": zero}
    moved = lv.integrate(system, plan, tangents={"params.a": 1.0}, **run)
    count = moved.events["axis"].t.size
    assert count > 15
    _, pullback = lv.vjp(system, plan, wrt=["params.a"], **run)
    weights = np.random.default_rng(0).standard_normal(count)
    found = pullback(events={"axis": {"t": weights}})["params.a"]
    wanted = weights * moved.tangents["params.a"].events["axis"].t
    assert found == pytest.approx(wanted.sum(), abs=1e-12 * np.abs(wanted).sum())


@pytest.mark.parametrize("does", ["is flat", "bends"])
def test_an_event_without_a_derivative_is_refused(does):
    """Its function does not change where it is zero, or otherwise on either side."""
    system, plan, x, _ = prepared("driven")
    at = lv.integrate(system, plan, **RUN, t_eval=[1.23], x=x).x[0]
    events = {
        "side": (lambda t, x, params: ca.sign(x[1] - at[1]))
        if does == "is flat"
        else (lambda t, x, params: x[1] - at[1] + 0.3 * ca.fabs(x[0] - at[0]))
    }
    says = rf"'side' {does} at t = 1\.2[23]\d*, where it is zero"
    with pytest.raises(lv.IntegrationError, match=says):
        lv.integrate(system, plan, **RUN, x=x, events=events, tangents={"x": [1.0, 0.0]})
    solution, pullback = lv.vjp(system, plan, wrt=["x"], **RUN, x=x, events=events)
    with pytest.raises(lv.IntegrationError, match=says):
        pullback(events={"side": {"t": np.ones(solution.events["side"].t.size)}})
