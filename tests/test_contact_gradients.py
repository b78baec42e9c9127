"""Pullbacks of runs with contacts, and coefficients that are functions of the parameters."""

import pickle

import casadi as ca
import numpy as np
import pytest
from test_contact_tangents import CASES, STENCIL, run_of

import liouville as lv

G = 9.81


def rough(restitution, friction, static=None):
    """Return a ball with these laws above a floor."""
    floor = lv.Contact(
        lambda t, q, params: q[1],
        restitution=restitution,
        friction=friction,
        static_friction=static,
        slip=lambda t, q, v, params: v[0],
    )
    return lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - G * q[1],
        q=2,
        params={"e": 0.6, "mu": 0.2, "stiff": 1e6},
        contacts={"floor": floor},
    )


def given(params):
    return params.e


def rubbing(params):
    return params.mu


THROWN = {"q": [0.0, 1.0], "v": [3.0, 0.0]}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("more", [{}, {"every": 5}, {"t_eval": np.linspace(0.05, 1.55, 9)}])
def test_pullbacks_are_the_transposed_tangents_through_all_changes(name, more):
    make, start, until, changes = CASES[name]
    system = make()
    directions = {f"params.{x}": 1.0 for x in system.params}
    directions |= {"v": np.resize([0.3, -0.1, 1.0], len(start["q"]))}
    directions |= {"q": np.resize([0.1, 0.2, 0.3], len(start["q"]))}
    run = run_of(system, start, until, tangents=directions, **more)
    solution, pullback = lv.vjp(
        system, lv.Spark(3), wrt=[*directions], t=(0, until), h=0.02, **start, **more
    )
    assert solution.q.tobytes() == run.q.tobytes()
    assert sum(len(x.changes) for x in solution.contacts.values()) >= changes
    rng = np.random.default_rng(2)
    cotangents = {x: rng.standard_normal(solution.states[x].shape) for x in pullback.states}
    gradients = pullback(**cotangents)
    for direction, x in directions.items():
        own = run.tangents[direction].states
        terms = [cotangents[state] * own[state] for state in cotangents]
        forward, size = (sum(f(part).sum() for part in terms) for f in (np.asarray, np.abs))
        # near rest, and where a ball begins to roll, friction turns by 1e7 times its slip
        rounded = 1e-8 if name in ("puck", "bowled") else 1e-10
        assert abs(np.sum(x * gradients[direction]) - forward) < rounded * max(size, 1)


@pytest.mark.parametrize("name", ["belt", "ball"])
def test_gradients_through_ten_changes_are_those_of_differences(name):
    make, start, until, _ = CASES[name]
    system = make()
    names = [f"params.{x}" for x in system.params]
    solution, pullback = lv.vjp(
        system, lv.Spark(3), wrt=[*names, "v"], t=(0, until), h=0.02, t_eval=[until], **start
    )
    assert sum(len(x.changes) for x in solution.contacts.values()) >= 10
    found = pullback(q=np.ones(solution.q.shape))

    def end(params, v):
        moved = start | {"v": v}
        return run_of(system, moved, until, params=params, t_eval=[until]).q[-1].sum()

    for which in names:
        key = which.removeprefix("params.")
        parts = [w * end({key: system.params[key] + x * 1e-4}, start["v"]) for x, w in STENCIL]
        assert found[which] == pytest.approx(sum(parts) / 1e-4, rel=1e-7, abs=1e-7)
    along = np.eye(len(start["v"]))[0]
    parts = [w * end({}, np.asarray(start["v"]) + x * 1e-4 * along) for x, w in STENCIL]
    assert found["v"][0] == pytest.approx(sum(parts) / 1e-4, rel=1e-7, abs=1e-7)


def test_a_checked_gradient_says_that_a_closed_contact_has_one_side():
    system = rough(0.0, 0.2)
    call = {"t": (0, 1), "h": 0.1, "t_eval": [1.0], "q": [0.0, 0.0], "v": [3.0, 0.0]}
    for name, what in (("q", "begins below"), ("v", "leaves")):
        words = f"moved by 0.00[12] {what} contact 'floor', which is closed at the start"
        with pytest.raises(ValueError, match=words):
            lv.analysis.check_gradient(system, lv.Spark(2), wrt=[name], **call)
    found = lv.analysis.check_gradient(system, lv.Spark(2), wrt=["params.mu"], **call)
    assert found.differences < 1e-9


def test_cotangents_of_multipliers_events_and_invariants_go_through_changes():
    make, start, _, _ = CASES["stopped"]
    system, until, size = make(), 1.1, 1e-4
    events = {"low": lambda t, q, v, lam, params: q[1] + 0.95}
    call = {"t": (0, until), "h": 0.02, "events": events, **start}
    solution, pullback = lv.vjp(system, lv.Spark(3), wrt=["params.at"], **call)
    assert len(solution.events["low"]) > 1
    assert len(solution.contacts["stop"].changes) > 0
    last = np.zeros(solution.lam.shape)
    last[-1] = 1
    energies = np.zeros(len(solution.t))
    energies[-1] = 1
    met = np.zeros(len(solution.events["low"]))
    met[-1] = 1
    asked = (
        {"lam": last},
        {"invariants": {"energy": energies}},
        {"events": {"low": {"t": met}}},
    )

    def values(at):
        run = lv.integrate(system, lv.Spark(3), params={"at": at}, **call)
        return np.array([run.lam[-1, 0], run.invariants["energy"][-1], run.events["low"].t[-1]])

    wanted = sum(w * values(0.2 + x * size) for x, w in STENCIL) / size
    found = [pullback(**own)["params.at"] for own in asked]
    np.testing.assert_allclose(found, wanted, rtol=1e-7)


def test_a_check_says_that_changes_shift_records_and_passes_at_given_times():
    """A wheel stops at 0.4, the end of a step, and a bit later ones have a record more."""
    pad = lv.Contact(load=10.0, friction=0.5, slip=lambda t, q, v, params: v[0])
    wheel = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2, q=1, contacts={"pad": pad})
    call = {"t": (0, 1), "h": 0.1, "q": [0.0], "v": [2.0], "wrt": ["v"]}
    with pytest.raises(
        ValueError, match="12 records and not 11\nhint: steps begin anew at changes"
    ):
        lv.analysis.check_gradient(wheel, lv.Spark(2), **call)
    times = [0.05, 0.33, 0.77]
    found = lv.analysis.check_gradient(wheel, lv.Spark(2), t_eval=times, **call)
    assert max(found.dot, found.differences) < 1e-10


def test_a_gradient_is_checked_and_taken_with_impacts_at_the_start():
    system = rough(given, rubbing)
    wrt = ["q", "v", "params.e", "params.mu"]
    call = {"t": (0, 1.3), "h": 0.05}
    found = lv.analysis.check_gradient(system, lv.Spark(2), wrt=wrt, **call, **THROWN)
    assert found.dot < 1e-11
    assert found.differences < 1e-7
    hit = {"q": [0.0, 0.0], "v": [3.0, -2.0]}
    solution, pullback = lv.vjp(system, lv.Spark(2), wrt=wrt, t=(0, 0.1), h=0.05, **hit)
    last = np.zeros(solution.v.shape)
    last[-1, 0] = 1
    by = pullback(v=last)
    np.testing.assert_allclose(by["v"], [1, 0.2 * 1.6], atol=1e-12)
    assert by["params.e"] == pytest.approx(-0.2 * 2, abs=1e-12)
    assert by["params.mu"] == pytest.approx(-1.6 * 2, abs=1e-11)


def test_coefficients_may_be_functions_of_the_parameters():
    fixed, free = rough(0.6, 0.2), rough(given, rubbing)
    for start in (THROWN, {"q": [0, 0], "v": [2, 0]}):
        for steps in ({"h": 0.05}, {"rtol": 1e-8}):
            runs = [
                lv.integrate(system, lv.Spark(2), t=(0, 2), **steps, **start)
                for system in (fixed, free, pickle.loads(pickle.dumps(free)))
            ]
            assert runs[0].q.tobytes() == runs[1].q.tobytes() == runs[2].q.tobytes()
            assert runs[0].contacts["floor"].changes == runs[1].contacts["floor"].changes
    sticky = rough(0.0, 0.2, lambda params: 2 * params.mu)
    held = lv.integrate(sticky, lv.Spark(2), t=(0, 2), h=0.1, q=[0, 0], v=[1, 0])
    assert held.q[-1, 0] == pytest.approx(1 / (0.4 * G))
    dead = lv.integrate(
        rough(given, 0.0), lv.Spark(2), t=(0, 2), h=0.1, params={"e": 0.0}, **THROWN
    )
    assert [x.kind for x in dead.contacts["floor"].changes] == ["hit"]
    for params, words in (
        ({"e": 1.5}, "restitution of contact 'floor' must be from 0 to 1, not 1.5"),
        ({"mu": -1.0}, "friction of contact 'floor' must be zero or positive, not -1"),
    ):
        with pytest.raises(ValueError, match=words):
            lv.integrate(free, lv.Spark(2), t=(0, 2), h=0.1, params=params, **THROWN)
    with pytest.raises(TypeError, match="restitution of contact 'floor'"):
        rough(lambda: 0.5, 0.2)


def test_tangents_by_coefficients_have_steps_of_their_own_sizes():
    """A stiffness of 1e6 beside a friction of 0.2 moved that by as much."""
    run = lv.integrate(
        rough(given, rubbing), lv.Spark(2), t=(0, 0.6), h=0.1, q=[0, 1], v=[9, 0],
        tangents={"params.mu": 1.0, "params.e": 1.0},
    )  # fmt: skip
    falls = np.sqrt(2 * G)
    np.testing.assert_allclose(run.tangents["params.mu"].v[-1], [-1.6 * falls, 0], atol=1e-10)
    np.testing.assert_allclose(run.tangents["params.e"].v[-1], [-0.2 * falls, falls], atol=1e-10)


def test_restitution_and_friction_are_fitted_through_hits():
    system, t = rough(given, rubbing), np.linspace(0, 2, 40)
    truth = {"e": 0.72, "mu": 0.13}
    data = lv.integrate(system, lv.Spark(2), t=(0, 2), h=0.05, t_eval=t, params=truth, **THROWN)
    found = lv.fit(
        system, lv.Spark(2), {"t": t, "q": data.q}, params={"e": 0.6, "mu": 0.2}, h=0.05, **THROWN
    )
    assert found.params["e"] == pytest.approx(0.72, abs=1e-12)
    assert found.params["mu"] == pytest.approx(0.13, abs=1e-12)


def test_what_has_no_pullback_is_refused():
    system = rough(given, rubbing)
    for more, words in (
        ({"wrt": ["t1"], "h": 0.1}, "go without 't0' and 't1'"),
        ({"wrt": ["q"], "rtol": 1e-6}, "want equal steps"),
    ):
        with pytest.raises(TypeError, match=words):
            lv.vjp(system, lv.Spark(2), t=(0, 1), **(THROWN | more))


#: Two that bounce, one that slides to its rest, and one that an event ends.
MANY = {"q": [[0, 1], [0, 0.3], [0, 0], [0, 2]], "v": [[3, 0], [1, 0], [2, 0], [5, 0]]}
FAR = {"far": lv.Event(lambda t, q, v, lam, params: q[0] - 3.1, terminal=True)}


@pytest.mark.parametrize("more", [{}, {"t_eval": [0.3, 0.9]}, {"events": FAR}])
def test_members_have_the_tangents_and_pullbacks_of_runs_alone(more):
    system, call = rough(given, rubbing), {"t": (0, 1), "h": 0.05, **more}
    moves = {"params.e": 1.0, "v": np.eye(2)}
    many = lv.ensemble(system, lv.Spark(3), tangents=moves, **call, **MANY)
    solution, pullback = lv.vjp(system, lv.Spark(3), wrt=[*moves], **call, **MANY)
    assert solution.q.tobytes() == many.q.tobytes()
    assert len(solution.endings) == ("events" in more)
    rng = np.random.default_rng(4)
    there = {x: np.isfinite(solution.states[x]) for x in pullback.states}
    cotangents = {x: rng.standard_normal(ok.shape) * ok for x, ok in there.items()}
    gradients = pullback(**cotangents)
    for k in range(4):
        start = {name: x[k] for name, x in MANY.items()}
        own = call | {"t_eval": solution.member(k).t}
        one = lv.integrate(system, lv.Spark(3), tangents=moves, **own, **start)
        for name, tangent in many.member(k).tangents.items():
            for state, x in tangent.states.items():
                assert np.array_equal(x, one.tangents[name].states[state])
        run, back = lv.vjp(system, lv.Spark(3), wrt=[*moves], **own, **start)
        found = back(**{x: y[: len(run.t), k] for x, y in cotangents.items()})
        assert all(np.array_equal(gradients[name][k], x) for name, x in found.items())


def test_gradients_of_members_are_those_of_differences():
    system, wrt = rough(given, rubbing), ["params.e", "params.mu"]
    call = {"t": (0, 1), "h": 0.05, "t_eval": [0.7, 1.0]}
    found = lv.analysis.check_gradient(system, lv.Spark(3), wrt=wrt, **call, **MANY)
    assert found.dot < 1e-11
    assert found.differences < 1e-10
