"""Ensembles of mechanical systems: each member has the bits of a run of its own."""

import importlib
import os
import signal
import sys
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._runs import runner
from liouville._solution import parts
from liouville.problems import (
    chain,
    euler_top,
    heavy_top,
    knife_edge,
    pendulum,
    relativistic_particle,
    spherical_pendulum,
)

MODULE = importlib.import_module("liouville._runs.execute")
POLAR = spherical_pendulum.system


def bobs(count, seed=0):
    """Start spherical pendulums anywhere on the sphere, moving along it."""
    random = np.random.default_rng(seed)
    q = random.normal(size=(count, 3))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    v = random.normal(size=(count, 3))
    v -= q * np.sum(q * v, axis=1, keepdims=True)
    return {"q": q, "v": v}


def nearby(problem, count):
    """Repeat a start at speeds from nearly rest on."""
    y, z = problem.system.states
    speeds = np.linspace(0.01, 1.0, count)[:, None]
    return {y: np.asarray(problem.start[y], float), z: speeds * np.asarray(problem.start[z], float)}


def members(start, count):
    """Cut starts of an ensemble into those of each member."""
    return [
        {name: x[i] if np.ndim(x) == 2 else x for name, x in start.items()} for i in range(count)
    ]


def same(solution, member, alone):
    """Whether a member has the bits of a run of its own, in all that is recorded."""
    pairs = [(solution.states, alone.states), (solution.invariants, alone.invariants)]
    pairs += [(solution.residuals, alone.residuals), (solution.observed, alone.observed)]
    pairs += [(solution.balance, alone.balance)]
    for together, single in pairs:
        assert list(together) == list(single)
        for name, values in single.items():
            np.testing.assert_array_equal(together[name][:, member], values, err_msg=name)


CASES = {
    "spherical pendulum": (spherical_pendulum, lv.Spark(2), 0.05, 40),
    "one stage": (spherical_pendulum, lv.Spark(1), 0.05, 40),
    "four stages": (pendulum, lv.Spark(4), 0.1, 30),
    "to tolerance": (spherical_pendulum, lv.Spark(3, newton_tol=1e-7), 0.05, 40),
    "radau": (pendulum, lv.Spark(2, points="radau"), 0.05, 30),
    "pair": (spherical_pendulum, lv.LobattoPair(3), 0.05, 30),
    "rattle": (spherical_pendulum, lv.LobattoPair(2), 0.05, 30),
    "chain": (chain, lv.Spark(2), 0.02, 30),
    "top": (heavy_top, lv.Spark(2), 1e-3, 30),
    "node schur": (heavy_top, lv.Spark(2, solver="node-schur"), 1e-3, 30),
    "newton": (pendulum, lv.Spark(2, solver="newton"), 0.05, 20),
    "composed": (spherical_pendulum, lv.Composition(lv.Spark(2), "SU4"), 0.1, 20),
    "composed rattle": (pendulum, lv.Composition(lv.LobattoPair(2), "SU4"), 0.1, 20),
    "alpha": (pendulum, lv.HHT(alpha=-0.1), 0.01, 30),
    "nonholonomic": (knife_edge, lv.Spark(2), 0.05, 20),
    "not linear": (relativistic_particle, lv.Spark(2), 0.05, 20),
}


@pytest.mark.parametrize("name", CASES)
def test_a_member_is_a_run_of_its_own(name):
    problem, method, h, steps = CASES[name]
    count = 35  # two whole blocks and a part of one
    start = nearby(problem, count)
    span = {"t": (0, steps * h), "steps": steps, "every": 7}
    solution = lv.ensemble(problem.system, method, **span, **start, threads=2)
    assert solution.status == "done", solution.message
    assert solution.members == count
    for member, own in enumerate(members(start, count)):
        same(solution, member, lv.integrate(problem.system, method, **span, **own))


def test_stiff_members_leave_the_common_path_and_come_back():
    """Springs from soft to stiff: some members' steps are made by full Newton, by themselves."""
    stiffness = np.logspace(0, 9, 16)
    system = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2 - p.k * (q[0] - 0.6) ** 2 / 2 - q[2],
        lambda t, q, p: (ca.dot(q, q) - 1) / 2,
        q=("x", "y", "z"),
        params={"k": 1.0},
    )
    start = {"q": spherical_pendulum.start["q"], "v": spherical_pendulum.start["v"]}
    span = {"t": (0, 1), "h": 0.02}
    solution = lv.ensemble(system, lv.Spark(2), **span, params={"k": stiffness}, **start)
    assert 0 < solution.stats["newton_steps"] < 16 * 50
    for member in range(16):
        params = {"k": stiffness[member]}
        same(solution, member, lv.integrate(system, lv.Spark(2), **span, params=params, **start))


def test_neither_block_nor_place_nor_threads_change_a_bit():
    start = bobs(21)
    span = {"t": (0, 1), "h": 0.05, "every": 20}
    whole = lv.ensemble(POLAR, lv.Spark(2), **span, **start, threads=1)
    order = np.random.default_rng(1).permutation(21)[:13]
    for threads in (1, 2, 5):
        some = {name: x[order] for name, x in start.items()}
        part = lv.ensemble(POLAR, lv.Spark(2), **span, **some, threads=threads)
        for name, values in part.states.items():
            np.testing.assert_array_equal(values, whole.states[name][:, order])


def test_parameters_of_each_member():
    start, g = bobs(9), np.linspace(0.5, 2, 9)
    span = {"t": (0, 1), "h": 0.05, "every": 5}
    solution = lv.ensemble(POLAR, lv.Spark(2), **span, params={"g": g, "m": 2.0}, **start)
    for member, own in enumerate(members(start, 9)):
        params = {"g": g[member], "m": 2.0}
        same(solution, member, lv.integrate(POLAR, lv.Spark(2), **span, params=params, **own))
    np.testing.assert_array_equal(solution.params["g"], g)


def ending_forces():
    """Return a system whose forces have no value after t = k, and starts of ten with two such."""
    system = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2 - q[2] * ca.sqrt(p.k - t),
        lambda t, q, p: q[0],
        q=("x", "y", "z"),
        params={"k": 9.0},
    )
    k = np.full(10, 9.0)
    k[[3, 8]] = 2.02, 1.01
    return system, k, {"q": np.tile([0.0, 0.0, 1.0], (10, 1)), "v": np.zeros((10, 3))}


def test_a_member_that_fails_is_told_and_the_others_go_on():
    system, k, start = ending_forces()
    span = {"t": (0, 5), "h": 0.05, "every": 3}
    solution = lv.ensemble(system, lv.Spark(2), **span, params={"k": k}, **start)
    assert solution.status == "partly failed"
    assert [*solution.failures] == [3, 8]
    assert solution.message.startswith("2 of 10 members failed (3 and 8); the first, member 3: ste")
    own = {name: x[3] for name, x in start.items()}
    with pytest.raises(lv.IntegrationError) as alone:
        lv.integrate(system, lv.Spark(2), **span, params={"k": 2.02}, **own)
    error = alone.value
    failure = solution.failures[3]
    assert (failure.step, failure.t, failure.message) == (error.step, error.t, str(error))
    kept = (failure.step + 2) // 3
    np.testing.assert_array_equal(solution.q[:kept, 3], error.solution.q[:kept])
    assert np.isnan(solution.q[kept:, 3]).all()
    without = lv.ensemble(
        system, lv.Spark(2), **span, params={"k": np.delete(k, [3, 8])},
        **{name: x[:8] for name, x in start.items()},
    )  # fmt: skip
    np.testing.assert_array_equal(np.delete(solution.q, [3, 8], axis=1), without.q)
    assert "nan" not in repr(solution)
    member = solution.member(3)
    assert (member.status, member.message) == ("failed", failure.message)
    assert member.q.tobytes() == error.solution.q[:kept].tobytes()
    assert [one.status for one in solution].count("failed") == 2


def test_a_member_is_a_solution_of_its_own_that_shares_memory():
    start = bobs(5)
    g = np.linspace(0.9, 1.1, 5)
    run = {"t": (0, 1), "h": 0.05, "observe": {"height": lambda t, q, v, params: q[2]}}
    many = lv.ensemble(POLAR, lv.Spark(2), **run, params={"g": g}, **start)
    own = {name: x[-2] for name, x in start.items()}
    alone = lv.integrate(POLAR, lv.Spark(2), **run, params={"g": g[3]}, **own)
    found = many.member(-2)
    for group in parts.GROUPS:
        mine, whole = getattr(found, group), getattr(many, group)
        assert mine.keys() == getattr(alone, group).keys()
        for name, values in mine.items():
            assert values.tobytes() == getattr(alone, group)[name].tobytes()
            assert not values.size or np.shares_memory(values, whole[name])
    assert found.params == alone.params
    assert (found.members, found.failures, found.varied) == (None, {}, ())
    assert repr(found) == repr(alone)
    forces = alone.reaction()
    np.testing.assert_array_equal(found.reaction(), forces)
    np.testing.assert_array_equal(many.reaction()[:, 3], forces)
    assert len([*many]) == 5


def test_a_member_that_is_not_there_is_refused():
    many = lv.ensemble(POLAR, lv.Spark(2), t=(0, 0.1), h=0.05, **bobs(2))
    for member in (2, -3):
        with pytest.raises(ValueError, match=f"there is no member {member} of an ensemble of 2"):
            many.member(member)
    with pytest.raises(TypeError, match="member must be a number, not True"):
        many.member(True)
    one = many.member(0)
    with pytest.raises(ValueError, match="there is no member 0 of a single run"):
        one.member(0)
    with pytest.raises(TypeError, match=r"no members to go through\nhint: zip\(solution\.t"):
        iter(one)


def test_many_starts_are_moved_onto_their_constraints_each_as_alone():
    r = np.linspace(0.5, 2, 4)
    breathing = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2, lambda t, q, p: ca.dot(q, q) - p.r, q=2,
        params={"r": 1.0},
    )  # fmt: skip
    q, v = np.array([[1.0, 0.1], [0.0, 2.0], [1.0, 1.0], [3.0, 0.0]]), [1.0, 1.0]
    found = breathing.consistent(q=q, v=v, params={"r": r})
    for k in range(4):
        alone = breathing.consistent(q=q[k], v=v, params={"r": r[k]})
        assert all(found[name][k].tobytes() == alone[name].tobytes() for name in alone)
    assert lv.ensemble(breathing, lv.Spark(1), t=(0, 1), h=0.1, params={"r": r}, **found).members
    with pytest.raises(ValueError, match="member 2: no consistent start is near"):
        breathing.consistent(q=q * [[1], [1], [0], [1]], v=v)
    with pytest.raises(ValueError, match=r"parameter 'r' must have .* members as q has, not 3"):
        breathing.consistent(q=q, v=v, params={"r": r[:3]})


@pytest.mark.parametrize("where", [{}, {"chunk": 4}])
def test_an_ensemble_all_of_whose_members_failed_has_failed(where):
    system, _, start = ending_forces()
    k = np.linspace(1.01, 2.02, 10)
    span = {"t": (0, 5), "h": 0.05, "every": 3}
    with ThreadPoolExecutor(2) as executor:
        more = {**where, "executor": executor} if where else {}
        solution = lv.ensemble(system, lv.Spark(2), **span, params={"k": k}, **start, **more)
    assert solution.status == "failed"
    assert len(solution.failures) == 10
    assert solution.message.startswith(
        "10 of 10 members failed (0, 1, 2, 3, 4, 5 and 4 more); the first"
    )
    assert solution.stats["steps"] == solution.failures[9].step == 40
    assert np.isfinite(solution.q[0]).all()


@pytest.mark.skipif(sys.platform != "linux", reason="counts threads")
def test_no_more_threads_than_processors_are_started(monkeypatch):
    monkeypatch.setattr(runner, "processors", lambda: 2)
    seen = []

    def look(done, total):
        seen.append(len(os.listdir("/proc/self/task")))

    plan = lv.plan(euler_top.system, h=0.05, x=[1.0, 1.0, 1.0])  # its trials have threads, too
    before = len(os.listdir("/proc/self/task"))
    span = {"t": (0, 1), "h": 0.05, "progress": look, "threads": 1000}
    lv.ensemble(POLAR, lv.Spark(2), **span, **bobs(4000))
    lv.ensemble(euler_top.system, plan, **span, x=np.ones((4000, 3)), every=20)
    lv.integrate(euler_top.system, plan, **span, **euler_top.start)
    assert max(seen) <= before + 3 * 3  # of three runs, each with one more that leads


def test_processors_that_are_forbidden_are_not_counted(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 7}, raising=False)
    assert runner.threads_of(None) == runner.threads_of(1000) == 3
    assert runner.threads_of(2) == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    assert runner.threads_of(None) == os.cpu_count()


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_failures_are_saved(tmp_path, suffix):
    system, k, start = ending_forces()
    span = {"t": (0, 5), "h": 0.05, "every": 30}
    solution = lv.ensemble(system, lv.Spark(2), **span, params={"k": k}, **start)
    solution.save(tmp_path / f"run{suffix}")
    loaded = lv.load(tmp_path / f"run{suffix}")
    assert loaded.failures == solution.failures
    for name, values in solution.residuals.items():
        np.testing.assert_array_equal(loaded.residuals[name], values)
    np.testing.assert_array_equal(loaded.q, solution.q)


def test_final_states_and_observables_alone():
    start = bobs(10)
    span = {"t": (0, 1), "h": 0.05}
    height = {"height": lambda t, q, v, params: q[2]}
    all_of_it = lv.ensemble(POLAR, lv.Spark(2), **span, **start)
    ends = lv.ensemble(POLAR, lv.Spark(2), **span, **start, every=20)
    np.testing.assert_array_equal(ends.q, all_of_it.q[[0, -1]])
    seen = lv.ensemble(POLAR, lv.Spark(2), **span, **start, observe=height, states=False)
    assert not seen.states
    np.testing.assert_array_equal(seen.observed["height"], all_of_it.q[..., 2])


def test_an_interrupt_keeps_what_is_done(monkeypatch):
    monkeypatch.setattr(MODULE, "SLICE", 0.0)  # a turn of one block
    start = bobs(4000)

    def look(done, total):
        if done >= total / 2:
            signal.raise_signal(signal.SIGINT)

    span = {"t": (0, 5), "h": 0.05, "every": 50}
    found = lv.ensemble(POLAR, lv.Spark(2), **span, **start, threads=1, progress=look)
    assert found.status == "interrupted"
    is_over = np.isfinite(found.q[-1]).all(axis=-1)
    assert 0 < is_over.sum() < 4000
    some = {name: x[is_over] for name, x in start.items()}
    whole = lv.ensemble(POLAR, lv.Spark(2), **span, **some)
    np.testing.assert_array_equal(found.q[:, is_over], whole.q)


WRONG = {
    "no members": ({"q": [0.6, 0, -0.8], "v": [0, 1, 0]}, {}, r"no start value and no parameter"),
    "other counts": (
        {"q": np.tile([0.6, 0, -0.8], (3, 1)), "v": np.zeros((2, 3))}, {},
        "v must have 3 members as q has, not 2",
    ),
    "params": (
        {"q": np.tile([0.6, 0, -0.8], (3, 1)), "v": [0, 0, 0]}, {"g": [1.0, 2.0]},
        "parameter 'g' must have 3 members as q has, not 2",
    ),
    "a parameter of one": (
        {"q": [0.6, 0, -0.8], "v": [0, 1, 0]}, {"g": [1.0, 2.0, np.inf]},
        "member 2: parameter 'g' must be finite, not inf",
    ),
    "last axis": ({"q": np.zeros((3, 2)), "v": np.zeros((3, 3))}, {}, r", not \(3, 2\)"),
    "violated": (
        {"q": [[0.6, 0, -0.8], [0.6, 0.1, -0.8]], "v": [0, 1, 0]}, {},
        "member 1: start violates the constraint 'rod'",
    ),
    "not finite": (
        {"q": [[0.6, 0, -0.8], [0.6, np.nan, -0.8]], "v": [0, 1, 0]}, {},
        "q of 'y' of member 1 must be finite, not nan",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_ensemble_is_refused(name):
    start, params, message = WRONG[name]
    with pytest.raises(ValueError, match=message):
        lv.ensemble(POLAR, lv.Spark(2), t=(0, 1), h=0.05, params=params, **start)


def test_a_member_that_cannot_be_observed_is_named():
    g = np.where(np.arange(20) == 5, 1.0, 2.0)
    root = {"root": lambda t, q, v, params: ca.sqrt(params.g - 1.5)}
    run = {"t": (0, 1), "h": 0.1, "q": [0.6, 0, -0.8], "v": [0, 1, 0], "observe": root}
    found = lv.ensemble(POLAR, lv.Spark(2), params={"g": g}, **run)
    assert [*found.failures] == [5]
    assert "observed 'root' is not finite" in found.failures[5].message
    np.testing.assert_array_equal(found.observed["root"][:, g == 2], np.sqrt(0.5))
    assert np.isnan(found.observed["root"][:, 5]).all()


def test_coordinates_by_name_and_starts_for_all():
    q = {"x": [0.6, 0.0, 0.8], "y": 0.0, "z": [-0.8, -1.0, 0.6]}
    found = lv.ensemble(POLAR, lv.Spark(2), t=(0, 1), h=0.1, q=q, v=(0, 1.0, 0))
    assert found.q.shape == (11, 3, 3)
    np.testing.assert_array_equal(found.v[0], np.tile([0, 1.0, 0], (3, 1)))
