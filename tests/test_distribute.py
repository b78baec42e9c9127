"""Ensembles on executors: the same bits, whatever becomes of the workers."""

import multiprocessing
import os
import pickle
import signal
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from dataclasses import replace
from itertools import permutations

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._runs import distribute
from liouville.problems import harmonic_oscillator, load, lorenz96

EULER = load("euler_top").system
SPLITTING = lv.VolumeSplitting("shears", "natural", "S2", "split")


def starts(members, n=3, seed=0):
    return np.random.default_rng(seed).normal(size=(members, n))


def same(a, b):
    """Compare all members that both have, bit by bit."""
    assert a.t.tobytes() == b.t.tobytes()
    for group in distribute.GROUPS:
        left, right = getattr(a, group), getattr(b, group)
        assert list(left) == list(right)
        for name, x in left.items():
            assert x.shape == right[name].shape
            kept = [k for k in range(a.members) if not {k} & {*a.failures, *b.failures}]
            assert x[:, kept].tobytes() == right[name][:, kept].tobytes(), name
    assert (a.method, a.params, a.h, a.names) == (b.method, b.params, b.h, b.names)
    assert a.system is not None


class Weak(Executor):
    """Does tasks at once, but its workers die of the first ones."""

    def __init__(self, deaths, error=BrokenExecutor):
        self.deaths, self.error, self.sent = deaths, error, []

    def submit(self, task, *args):
        self.sent.append(args)
        future = Future()
        if self.deaths:
            self.deaths -= 1
            future.set_exception(self.error("died"))
            return future
        try:
            future.set_result(task(*pickle.loads(pickle.dumps(args))))
        except Exception as error:
            future.set_exception(pickle.loads(pickle.dumps(error)))
        return future


class KilledWorker(Exception):
    """Has the name of what dask raises."""


def test_a_field_on_threads_has_the_bits_of_one_run():
    options = {
        "t": (0, 1), "steps": 20, "every": 7, "x": starts(50), "params": {"a": [1.0, -3.0, 2.0]},
        "observe": {"first": lambda t, x, params: x[0] ** 2 + params.a[0]},
    }  # fmt: skip
    wanted = lv.ensemble(EULER, lv.VolumeSplitting(), **options)
    seen = []
    with ThreadPoolExecutor(2) as executor:
        found = lv.ensemble(
            EULER, lv.VolumeSplitting(), executor=executor, chunk=9, **options,
            progress=lambda done, total: seen.append((done, total)),
        )  # fmt: skip
    same(found, wanted)
    assert seen[-1] == (50, 50)
    assert len(seen) == 6
    assert (found.status, found.failures) == ("done", {})
    assert found.stats["steps"] == 20


@pytest.mark.parametrize(
    "method", [lv.SchrodingerSplitting(1e-6), lv.SplitOperator(), lv.Lanczos(1e-6)]
)
def test_wave_functions_on_threads_have_the_bits_of_one_run(method):
    system, n = harmonic_oscillator.system, harmonic_oscillator.system.size
    how = {"steps": 7, "every": 3} if isinstance(method, lv.SplitOperator) else {}
    psi = starts(10, n) + 1j * starts(10, n, seed=1)
    psi[3] = psi[3].real  # alone it would be propagated as a real one
    observe = {"well": lambda t, x, params: x[0] ** 2}
    options = {"t": (0, 1), "psi": psi, "observe": observe, **how}
    wanted = lv.ensemble(system, method, **options)
    with ThreadPoolExecutor(2) as executor:
        same(lv.ensemble(system, method, executor=executor, chunk=1, **options), wanted)


def springs(c):
    """Return members on stiff and soft springs, whose force has no value from t = c on."""
    system = lv.Lagrangian(
        lambda t, q, v, p: ca.dot(v, v) / 2 - p.k * (q[0] - 0.6) ** 2 / 2 - q[2],
        lambda t, q, p: (ca.dot(q, q) - 1) / 2,
        q=("x", "y", "z"),
        params={"k": 1.0, "c": 2.0},
        force=lambda t, q, v, p: ca.vertcat(1e-9 * ca.sqrt(p.c - t), 0, 0),
    )
    params = {"k": np.logspace(0, 9, 18), "c": np.r_[np.full(17, 2.0), c]}
    start = load("spherical_pendulum").start
    return system, {"t": (0, 1), "h": 0.02, "params": params, "q": start["q"], "v": start["v"]}


def field(params):
    system = lv.PolynomialField(
        lambda t, x, p: ca.vertcat(p.a * x[1] * x[2], x[0] * x[2], -2 * x[0] * x[1]),
        x=3, params={"a": 1.0},
    )  # fmt: skip
    start = np.random.default_rng(0).standard_normal((18, 3))
    return system, {"t": (0, 1), "steps": 20, "x": start, "params": params}


def waves(is_driven=False):
    drive = [(lambda t, p: ca.sin(t), np.arange(40.0) / 40)] if is_driven else []
    system = lv.Schrodinger(lv.Lattice((40,)), drive=drive)
    start = np.random.default_rng(0).standard_normal((18, 40)) + 0j
    return system, {"t": (0, 5), "psi": start / np.linalg.norm(start, axis=1)[:, None]}


#: Systems, arguments of a run of eighteen members, more than a block of any kind, and methods.
COUNTED = {
    "newton and node-schur": (*springs(2.0), lv.Spark(2)),
    "one fails": (*springs(0.5), lv.Spark(2)),
    "composed": (*springs(2.0), lv.Composition(lv.Spark(1), "SU4")),
    "alpha": (*springs(2.0), lv.HHT()),
    "field": (*field({}), lv.VolumeSplitting()),
    "fields": (*field({"a": np.r_[0.0, np.linspace(1, 2, 17)]}), lv.VolumeSplitting()),
    "series": (*waves(), lv.Chebyshev()),
    "stable": (*waves(), lv.SchrodingerSplitting(mode="stable")),
    "Krylov": (*waves(), lv.Lanczos()),
    "windows": (*waves(is_driven=True), lv.Chebyshev()),
    "Magnus": (*waves(is_driven=True), lv.Magnus()),
}


@pytest.mark.parametrize("name", COUNTED)
def test_numbers_of_an_ensemble_are_those_of_its_members_whatever_computes_them(name):
    """A block in lock-step counts as its members, without its empty places."""
    system, call, method = COUNTED[name]
    alone = []
    for k in range(18):
        own = {x: y[k] if np.ndim(y) == 2 else y for x, y in call.items()}
        if "params" in own:
            own["params"] = {x: y[k] for x, y in own["params"].items()}
        try:
            alone.append(lv.integrate(system, method, **own).stats)
        except lv.IntegrationError as error:
            alone.append(error.solution.stats)
    wanted = {x: sum(stats[x] for stats in alone) for x in alone[0] if x != "solver"}
    wanted |= {
        x: max(stats[x] for stats in alone) for x in ("steps", "pieces", "bound") if x in wanted
    }
    if "products" in wanted:
        wanted["products"] /= 18
    if "solver" in alone[0]:
        words = {word for stats in alone for word in stats["solver"].split(" and ")}
        wanted["solver"] = " and ".join(sorted(words))
    with ThreadPoolExecutor(2) as executor:
        several = [{"threads": 1}, {"threads": 3}, {"executor": executor, "chunk": 5}]
        for how in several:
            found = lv.ensemble(system, method, **call, **how).stats
            assert found.keys() == wanted.keys()
            for x in found.keys() - {"seconds"}:
                same = (
                    wanted[x] if isinstance(wanted[x], str) else pytest.approx(wanted[x], rel=1e-14)
                )
                assert found[x] == same, (x, how)


def test_numbers_and_method_are_those_of_all_chunks():
    """A chunk of one member is planned for it, and chunks arrive in any order."""
    system = lv.Schrodinger(
        np.diag([0.5, -0.5]), drive=[(lambda t, params: ca.cos(params.w * t), [[0, 1], [1, 0]])],
        params={"w": 1.0},
    )  # fmt: skip
    options = {"t": (0, 1), "psi": [1, 0], "params": {"w": np.linspace(1, 2, 3)}}
    wanted = lv.ensemble(system, "auto", **options)
    with ThreadPoolExecutor(1) as executor:
        found = lv.ensemble(system, "auto", executor=executor, chunk=1, **options)
    same(found, wanted)
    assert repr(found) == repr(wanted)
    task = distribute.Task(None, {}, {}, {}, 3, 1, 0.0)
    part = lv.ensemble(system, "auto", **options | {"params": {"w": [1.0]}})
    stats = [{"steps": 5, "solver": name} for name in ("newton", "node-schur", "newton")]
    for order in permutations(range(3)):
        joined = distribute.Joined(task)
        for k in order:
            joined.add(k, k + 1, replace(part, stats=stats[k]))
        whole = joined.solution([], False, 0.0).stats
        assert whole == {"steps": 5, "solver": "newton and node-schur", "seconds": 0.0}


def test_spawned_processes_need_no_functions_of_the_user():
    field = lv.PolynomialField(
        lambda t, x, params: [params.w * x[1], -params.w * x[0] + ca.sin(t)],
        x=2,
        params={"w": 2.0},
        invariants={"size": lambda t, x, params: ca.dot(x, x)},
    )
    options = {"t": (0, 1), "h": 0.1, "x": starts(40, 2), "params": {"w": 3.0}}
    options["observe"] = {"first": lambda t, x, params: params.w * x[0]}
    wanted = lv.ensemble(field, SPLITTING, **options)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        same(lv.ensemble(field, SPLITTING, executor=executor, **options), wanted)
        pids = list(executor._processes)

        def kill(done, total):
            if pids:
                os.kill(pids.pop(), signal.SIGKILL)

        x = starts(4000, 2)
        options |= {"x": x, "h": 1e-4, "every": 10_000, "states": False}
        broken = lv.ensemble(
            field, SPLITTING, executor=executor, chunk=16, progress=kill, **options
        )
    assert broken.failures
    assert 0 < len(broken.failures) < 4000
    assert f"{len(broken.failures)} of 4000 members failed (" in broken.message
    assert broken.status == "partly failed"
    assert "its worker died (BrokenProcessPool)" in broken.message
    is_lost = np.isnan(broken.invariants["size"][-1])
    assert sorted(broken.failures) == np.flatnonzero(is_lost).tolist()
    k = int(np.flatnonzero(~is_lost)[0])
    options |= {"x": x[k : k + 1]}
    alone = lv.ensemble(field, SPLITTING, **options)
    assert np.array_equal(alone.invariants["size"][:, 0], broken.invariants["size"][:, k])


@pytest.mark.parametrize("error", [BrokenExecutor, CancelledError, KilledWorker])
def test_a_task_whose_worker_died_is_sent_again(error):
    options = {"t": (0, 1), "steps": 5, "x": starts(64)}
    wanted = lv.ensemble(EULER, SPLITTING, **options)
    executor = Weak(deaths=5, error=error)
    found = lv.ensemble(EULER, SPLITTING, executor=executor, chunk=16, **options)
    same(found, wanted)
    assert not found.failures
    attempts = [args[-1] for args in executor.sent]
    assert sorted(attempts) == [0, 0, 0, 0, 1, 1, 1, 1, 2]


def test_a_task_of_which_workers_die_is_given_up():
    class Cursed(Weak):
        def submit(self, task, *args):
            self.deaths = args[2]["x"][0, 0] == x[16, 0]
            return super().submit(task, *args)

    x = starts(64)
    executor = Cursed(0)
    found = lv.ensemble(EULER, SPLITTING, t=(0, 1), steps=5, x=x, executor=executor, chunk=16)
    assert list(found.failures) == list(range(16, 32))
    assert (found.status, found.failures[16].step) == ("partly failed", 0)
    assert found.message.startswith(
        "16 of 64 members failed (16, 17, 18, 19, 20, 21 and 10 more); the first"
    )
    assert np.isnan(found.x[:, 16:32]).all()
    same(found, lv.ensemble(EULER, SPLITTING, t=(0, 1), steps=5, x=x))
    assert len(executor.sent) == 3 + 1 + distribute.AGAIN


def test_an_executor_without_living_workers_is_an_error():
    with pytest.raises(BrokenExecutor) as caught:
        lv.ensemble(EULER, SPLITTING, t=(0, 1), steps=5, x=starts(64), executor=Weak(100))
    assert "__main__" in caught.value.__notes__[0]


@pytest.mark.parametrize(("deaths", "sent", "whole"), [(0, 4, 2), (2, 8, 6)])
def test_a_large_system_is_not_sent_with_every_task(monkeypatch, deaths, sent, whole):
    monkeypatch.setattr(distribute, "LARGE", 0)
    monkeypatch.setattr(distribute, "_workers", lambda executor: 2)
    monkeypatch.setattr(distribute, "_cache", {})
    options = {"t": (0, 1), "steps": 5, "x": starts(64, 4)}
    system = lorenz96.build(4)
    wanted = lv.ensemble(system, SPLITTING, **options)
    executor = Weak(deaths)  # of those that had the system with them; others ask for it then
    same(lv.ensemble(system, SPLITTING, executor=executor, chunk=16, **options), wanted)
    assert len(executor.sent) == sent
    assert sum(args[1] is not None for args in executor.sent) == whole


def test_an_interrupt_keeps_what_is_done():
    options = {"t": (0, 1), "steps": 5, "x": starts(64)}
    wanted = lv.ensemble(EULER, SPLITTING, **options)

    def interrupt(done, total):
        if done >= 32:
            raise KeyboardInterrupt

    executor = Weak(0)
    found = lv.ensemble(
        EULER, SPLITTING, executor=executor, chunk=16, progress=interrupt, **options
    )
    assert found.status == "interrupted"
    assert found.message.startswith("interrupted after ")
    there = ~np.isnan(found.x).any(axis=(0, 2))
    assert 32 <= there.sum() <= 64
    assert found.x[:, there].tobytes() == wanted.x[:, there].tobytes()


def test_a_failing_member_has_its_number_in_the_whole_ensemble():
    field = lv.PolynomialField(lambda t, x, params: [x[0] ** 2, -2 * x[0] * x[1]], x=("x", "y"))
    x = np.full((64, 2), 0.01)
    x[[37, 50]] = 1.0, 2.0
    options = {"t": (0, 4), "steps": 200, "x": x}
    wanted = lv.ensemble(field, SPLITTING, **options)
    found = lv.ensemble(field, SPLITTING, executor=Weak(0), chunk=16, **options)
    same(found, wanted)
    assert list(wanted.failures) == [37, 50]
    assert (found.failures, found.message) == (wanted.failures, wanted.message)
    assert found.x.tobytes() == wanted.x.tobytes()


BOB = load("spherical_pendulum").system


def bobs(members):
    q = starts(members)
    q /= np.linalg.norm(q, axis=1)[:, None]
    return {"q": q, "v": np.cross(q, starts(members, seed=1))}


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(2), lv.HHT()])
def test_members_of_a_mechanical_system_have_parameters_of_their_own(method):
    start = bobs(40)
    options = {
        "t": (0, 1), "h": 0.05, "every": 6, "params": {"g": np.linspace(1, 10, 40), "m": 2.0},
        "observe": {"height": lambda t, q, v, params: params.g * q[2]}, **start,
    }  # fmt: skip
    wanted = lv.ensemble(BOB, method, **options)
    found = lv.ensemble(BOB, method, executor=Weak(0), chunk=7, **options)
    same(found, wanted)
    one = {"q": start["q"][0], "v": start["v"][0]}  # all start there
    wanted = lv.ensemble(BOB, method, **(options | one))
    same(lv.ensemble(BOB, method, executor=Weak(0), chunk=7, **(options | one)), wanted)


def troubled(x, params):
    """Integrate members that fail where x is negative, alone, or at the start if all do."""
    solution = lv.ensemble(EULER, SPLITTING, t=(0, 1), steps=5, x=abs(x) * params["scale"][:, None])
    bad = np.flatnonzero(x[:, 0] < 0).tolist()
    failures = {k: lv.Failure(2, 0.4, "it is so") for k in bad}
    if len(bad) < len(x):
        return replace(solution, failures=failures)
    nothing = {group: {k: v[:0] for k, v in getattr(solution, group).items()} for group in ROWS}
    nothing = replace(solution, t=np.empty(0), failures=failures, **nothing)
    raise lv.IntegrationError("all failed", solution=nothing)


ROWS = ("states", "invariants")


def test_members_that_fail_alone_are_counted_in_the_whole_ensemble():
    x, scale = abs(starts(64)), np.linspace(1, 2, 64)
    whole = lv.ensemble(EULER, SPLITTING, t=(0, 1), steps=5, x=x * scale[:, None])
    bad = [3, 20, *range(32, 48)]
    x[bad] *= -1
    task = distribute.Task(troubled, {"x": x}, {"scale": scale}, {"scale": 1.0}, 64, 1000, 0.0)
    found = distribute.distribute(task, Weak(0), 16)
    assert list(found.failures) == bad
    assert found.message == (
        "18 of 64 members failed (3, 20, 32, 33, 34, 35 and 12 more); the first, member 3: it is so"
    )
    assert np.isnan(found.x[:, 32:48]).all()
    assert np.array_equal(found.x[:, :32], whole.x[:, :32])
    assert np.array_equal(found.x[:, 48:], whole.x[:, 48:])
    x[:] = -1.0
    with pytest.raises(lv.IntegrationError, match="64 of 64 members failed"):
        distribute.distribute(task, Weak(0), 16)


def test_bad_calls_are_refused_before_anything_is_sent():
    options = {"t": (0, 1), "steps": 5, "x": starts(4)}
    executor = Weak(0)
    with pytest.raises(
        TypeError, match=r"executor must be a concurrent.futures.Executor(.|\n)*dask"
    ):
        lv.ensemble(EULER, SPLITTING, executor=4, **options)
    with pytest.raises(TypeError, match="chunk is for an executor"):
        lv.ensemble(EULER, SPLITTING, chunk=4, **options)
    with pytest.raises(ValueError, match="chunk"):
        lv.ensemble(EULER, SPLITTING, executor=executor, chunk=0, **options)
    with pytest.raises(TypeError, match="progress must be a function"):
        lv.ensemble(EULER, SPLITTING, executor=executor, progress=3, **options)
    with pytest.raises(ValueError, match="shape"):
        lv.ensemble(EULER, SPLITTING, executor=executor, **(options | {"x": starts(4, 2)}))
    assert not executor.sent


@pytest.fixture(scope="module")
def cluster():
    """Start two workers of dask's, each a process."""
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        yield client


@pytest.mark.filterwarnings("ignore::UserWarning:distributed")
@pytest.mark.parametrize(
    ("members", "steps"), [(2_000, 200), pytest.param(100_000, 100, marks=pytest.mark.slow)]
)
def test_a_dask_cluster_loses_nothing_with_a_worker(cluster, members, steps):
    system, method = BOB, lv.Spark(2)
    options = {"t": (0, 10), "steps": steps, "every": steps, **bobs(members)}
    killed = []

    def kill(done, total):
        if not killed:
            pids = cluster.run(os.getpid)
            killed.append(next(iter(pids.values())))
            os.kill(killed[0], signal.SIGKILL)

    found = lv.ensemble(
        system, method, executor=cluster.get_executor(), chunk=members // 20, progress=kill,
        **options,
    )  # fmt: skip
    assert killed
    assert (found.status, found.message, found.failures) == ("done", "", {})
    same(found, lv.ensemble(system, method, **options))
