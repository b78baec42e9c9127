"""Derivatives of invariants and of functions of states along the tangents of a run."""

import pickle

import casadi as ca
import numpy as np
import pytest
from test_structure import structure

import liouville as lv
from liouville.problems import abc_flow

#: Differences of order six.
WEIGHTS = ((1, 45 / 60), (2, -9 / 60), (3, 1 / 60))
PENDULUM = lv.Lagrangian(
    lambda t, q, v, params: params.m * (ca.dot(v, v) / 2 - params.g * q[1]) - 0.1 * t * q[0],
    lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
    q=("x", "y"),
    params={"m": 1.3, "g": 9.81, "l": 2.0, "k": [1.0, 2.0]},
    force=lambda t, q, v, params: -0.1 * params.k[0] * v,
    invariants={"own": lambda t, q, v, params: t * v[0] * params.k[1] + q[0]},
)
START = PENDULUM.consistent(q=[1.2, -1.6], v=[1.6, 1.2])
T = (0.1, 1.1)


def angle(t, q, v, params):
    return ca.atan2(q[0], -q[1])


def both(t, q, v, params):
    """Return a vector with time and a parameter in it."""
    return ca.vertcat(angle(t, q, v, params) * t, params.l * v[1])


def moved(name, by, run):
    """Return quantities of a run with one number moved."""
    ends, params = list(T), {"l": 2.0}
    if name == "params.l":
        params["l"] += by
    else:
        ends[name == "t1"] += by
    start = PENDULUM.consistent(t=ends[0], params=params, **START)
    found = lv.integrate(
        PENDULUM, lv.Spark(3), t=tuple(ends), params=params,
        observe={"angle": angle, "both": both}, **run, **start,
    )  # fmt: skip
    return {**found.invariants, **found.observed}


@pytest.mark.parametrize("run", [{"steps": 20, "every": 5}, {"steps": 20, "t_eval": [0.13, 0.77]}])
def test_differences_by_parameters_and_the_ends_of_the_time(run):
    """Kept times follow the ends, and given ones are held; to 1e-10."""
    directions = {"params.l": 1.0, "t0": 1.0, "t1": 1.0, "v": np.eye(2)}
    found = lv.integrate(PENDULUM, lv.Spark(3), t=T, tangents=directions, **run, **START)
    own = {name: found.tangent_of(name) for name in ("energy", "own")}
    own |= {"angle": found.tangent_of(angle), "both": found.tangent_of(both)}
    k = len(found.t)
    assert own["angle"]["params.l"].shape == own["energy"]["t0"].shape == (k,)
    assert own["both"]["v"].shape == (k, 2, 2)
    assert own["angle"]["v"].shape == (k, 2)
    for name in ("params.l", "t0", "t1"):
        sides = [(w, moved(name, j * 1e-3, run), moved(name, -j * 1e-3, run)) for j, w in WEIGHTS]
        for what, each in own.items():
            wanted = sum(w * (a[what] - b[what]) / 1e-3 for w, a, b in sides)
            np.testing.assert_allclose(each[name], wanted, rtol=0, atol=1e-10)


@pytest.mark.parametrize("steps", [{"steps": 20, "every": 3}, {"rtol": 1e-6}])
def test_invariants_are_paired_with_their_pullbacks_where_an_event_ends_the_run(steps):
    """The last time is that of the event, which both know; with time in the invariants."""
    spring = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2 + params.a * t * q[0],
        q=("x",),
        params={"k": 4.0, "a": 0.7},
        invariants={"own": lambda t, q, v, params: t**2 * v[0]},
    )
    end = lv.Event(lambda t, q, v, lam, params: q[0] - 0.2 - 0.1 * t, "down", terminal=True)
    run = {"t": (0.1, 2.0), "events": {"end": end}, "q": [1.0], "v": [0.0], **steps}
    directions = {"q": [1.0], "v": [0.5], "params.a": 1.0}
    found = lv.integrate(spring, lv.Spark(3), tangents=directions, **run)
    solution, pullback = lv.vjp(spring, lv.Spark(3), wrt=list(directions), **run)
    rng = np.random.default_rng(0)
    cotangents = {x: rng.standard_normal(solution.t.shape) for x in solution.invariants}
    gradient = pullback(invariants=cotangents)
    back = sum(float(np.vdot(gradient[x], y)) for x, y in directions.items())
    pairs = [x * found.tangent_of(i)[name] for i, x in cotangents.items() for name in directions]
    forth, size = (sum(f(pair).sum() for pair in pairs) for f in (np.asarray, np.abs))
    assert abs(back - forth) < 1e-12 * size

    # the last one by the start, by differences of runs that end at the event
    def last(by):
        return lv.integrate(spring, lv.Spark(3), **{**run, "q": [1.0 + by]}).invariants["own"][-1]

    if "steps" in steps:
        wanted = sum(w * (last(j * 1e-3) - last(-j * 1e-3)) / 1e-3 for j, w in WEIGHTS)
        assert found.tangent_of("own")["q"][-1] == pytest.approx(wanted, abs=1e-9)


def test_functions_at_events_move_with_their_times():
    """Of time, states, multipliers and parameters, of a run and of members; by differences."""
    event = {"side": lv.Event(lambda t, q, v, lam, params: q[0] - 0.3 * t)}
    lengths, size = np.array([2.0, 1.7]), 1e-5

    def pull(t, q, v, lam, params):
        return ca.vertcat(t * lam[0], params.l * v[1] + params.k[1] * t)

    def values(length):
        start = PENDULUM.consistent(params={"l": length}, **START)
        run = lv.integrate(PENDULUM, lv.Spark(4), t=(0, 3), steps=150, params={"l": length},
                           events=event, **start)  # fmt: skip
        at = run.events["side"]
        each = [at.t * at.lam[:, 0], length * at.v[:, 1] + 2.0 * at.t]
        return np.stack(each, axis=1), np.sum(at.v**2, axis=1) / 2 + 9.81 * at.q[:, 1]

    def checked(run, wanted):
        own = run.tangent_of(pull, event="side")["params.l"]
        np.testing.assert_allclose(own, wanted[0], rtol=1e-7, atol=1e-6)

    rows = [PENDULUM.consistent(params={"l": x}, **START) for x in lengths]
    call = {"t": (0, 3), "steps": 150, "events": event, "tangents": {"params.l": 1.0}}
    slopes = [
        [(a - b) / (2 * size) for a, b in zip(values(x + size), values(x - size), strict=True)]
        for x in lengths
    ]
    run = lv.integrate(PENDULUM, lv.Spark(4), **call, **rows[0])
    assert len(run.events["side"]) == 2
    checked(run, slopes[0])
    together = {name: np.array([x[name] for x in rows]) for name in ("q", "v")}
    many = lv.ensemble(PENDULUM, lv.Spark(4), **call, params={"l": lengths}, **together)
    checked(many, [np.concatenate(x) for x in zip(*slopes, strict=True)])
    by = run.tangent_of(lambda t, q, v, params: ca.dot(v, v) / 2 + params.g * q[1], event="side")
    np.testing.assert_allclose(by["params.l"], slopes[0][1], rtol=1e-7, atol=1e-6)
    with pytest.raises(ValueError, match="the run has no event 'top'\nhint: there are 'side'"):
        run.tangent_of("energy", event="top")


def test_members_and_pickles():
    """Each member has its own parameters; a pickle knows its directions."""
    lengths = [1.9, 2.0, 2.1]
    starts = PENDULUM.consistent(q=[1.2, -1.6], v=[1.6, 1.2], params={"l": lengths})
    call = {"t": T, "steps": 20, "tangents": {"params.l": 1.0, "q": np.eye(2)}}
    many = lv.ensemble(PENDULUM, lv.Spark(3), params={"l": lengths}, **call, **starts)
    found = many.tangent_of(both)
    assert found["q"].shape == (21, 3, 2, 2)
    for k in range(3):
        own = pickle.loads(pickle.dumps(many.member(k))).tangent_of(both)
        np.testing.assert_array_equal(found["params.l"][:, k], own["params.l"])
    later = many.member(1).sel(time=slice(0.5, None))
    np.testing.assert_array_equal(
        later.tangent_of("energy")["q"], many.tangent_of("energy")["q"][-len(later.t) :, 1]
    )


def test_structures_and_fields():
    """The energy of matrices, and functions of a field with its parameters."""
    system = structure()
    start = {"q": np.zeros(len(system.coordinates)), "v": np.zeros(len(system.coordinates))}
    run = {"t": (0.0, 0.5), "steps": 10, "params": {"a": 0.1}}
    start = system.consistent(**start, params=run["params"])
    start["v"] = system.consistent(q=start["q"], v=np.ones(len(start["q"])), params=run["params"])[
        "v"
    ]
    directions = {"v": np.ones(len(start["q"])), "params.a": 1.0}
    found = lv.integrate(system, lv.Spark(2), tangents=directions, **run, **start)
    solution, pullback = lv.vjp(system, lv.Spark(2), wrt=list(directions), **run, **start)
    weights = np.random.default_rng(1).standard_normal(len(solution.t))
    gradient = pullback(invariants={"energy": weights})
    along = found.tangent_of("energy")
    for name, direction in directions.items():
        wanted = float(np.vdot(gradient[name], direction))
        size = np.abs(weights * along[name]).sum()
        assert float(weights @ along[name]) == pytest.approx(wanted, abs=1e-12 * size)
    flow = lv.integrate(
        abc_flow.system, lv.VolumeSplitting(), t=(0, 1), steps=10, x=[0.1, 0.2, 0.3],
        tangents={"x": np.eye(3), "params.A": 1.0},
    )  # fmt: skip
    by = flow.tangent_of(lambda t, x, params: params.A * x[0] ** 2)["params.A"]
    own = flow.x[:, 0] ** 2 + 2 * flow.x[:, 0] * flow.tangents["params.A"].x[:, 0]
    np.testing.assert_allclose(by, own, rtol=1e-14)


def test_what_cannot_be_differentiated_is_said(tmp_path):
    """By name, with what there is."""
    run = lv.integrate(PENDULUM, lv.Spark(3), t=T, steps=5, tangents={"t1": 1.0}, **START)
    plain = lv.integrate(PENDULUM, lv.Spark(3), t=T, steps=5, **START)
    spin = lv.Schrodinger(np.diag([0.5, -0.5]))
    wave = lv.integrate(spin, "auto", t=(0, 1), psi=[1, 0], tangents={"psi": [0, 1]})
    run.save(tmp_path / "run.npz")
    loaded = lv.load(tmp_path / "run.npz", system=PENDULUM)
    for solution, what, error, says in (
        (loaded, "energy", ValueError, "a file keeps tangents of states, and not what"),
        (run, "speed", ValueError, "no invariant 'speed'\nhint: there are 'energy' and 'own'"),
        (plain, "energy", ValueError, "the run has no tangents"),
        (wave, "norm", TypeError, "must be a mechanical one or a field"),
        (run.sel(coordinate="x"), "energy", ValueError, "some of the coordinates only"),
    ):
        with pytest.raises(error, match=says):
            solution.tangent_of(what)
