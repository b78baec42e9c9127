"""Pullbacks of ensembles give each member the gradients that it has alone, bit for bit."""

import _thread
import time

import casadi as ca
import numpy as np
import pytest
import registry
from test_tangents import COVERED, directions_of
from test_wave_gradients import REGISTERED, ROWS

import liouville as lv
from liouville._runs.mechanics.adjoint import LockStep
from liouville._runs.runner import processors
from liouville.problems import abc_flow, load

RNG = np.random.default_rng(11)


def alone(system, method, wrt, run, start, params=None, threads=None):
    """Compare with runs of each member alone, and return the ensemble's own gradients."""
    solution, pullback = lv.vjp(
        system, method, wrt=wrt, **run, **start, params=params, threads=threads
    )
    cotangents = {
        name: RNG.standard_normal(solution.states[name].shape) for name in pullback.states
    }
    if pullback.adjoint.is_complex:
        cotangents = {name: x - 1j * x[::-1] for name, x in cotangents.items()}
    gradients = pullback(**cotangents)
    for k in range(solution.members):

        def own(given, ndim, k=k):
            return np.asarray(given)[k] if np.ndim(given) > ndim else given

        values = {x: own(value, np.ndim(system.params[x])) for x, value in (params or {}).items()}
        begin = {x: own(value, 1) for x, value in start.items()}
        one, back = lv.vjp(system, method, wrt=wrt, **run, **begin, params=values)
        assert all(np.array_equal(one.states[x], solution.states[x][:, k]) for x in cotangents)
        found = back(**{x: np.ascontiguousarray(c[:, k]) for x, c in cotangents.items()})
        for name in wrt:
            assert gradients[name].shape == (solution.members, *np.shape(found[name]))
            np.testing.assert_array_equal(gradients[name][k], found[name])
    return gradients


def starts(problem, many=3):
    """Return starts along a motion, a row for each member."""
    t0 = problem.interval[0]
    run = {"t": (t0, t0 + 40 * problem.h), "steps": 40, "every": 40 // many}
    found = lv.integrate(problem.system, lv.Spark(3), **run, **problem.start)
    return {name: found.states[name][:many] for name in problem.system.states}


@pytest.mark.parametrize("steps", [30, 300])
@pytest.mark.parametrize("method", [
    lv.Spark(3), lv.LobattoPair(2), lv.Composition(lv.Spark(1), "Y4"), lv.HHT(-0.1),
], ids=str)  # fmt: skip
def test_members_of_a_mechanism_have_the_gradients_of_runs_alone(method, steps):
    """With few steps, which are followed from the start, and with more, from checkpoints."""
    problem = load("double_pendulum")
    start = starts(problem)
    run = {"t": (0, 1), "steps": steps, "every": 7}
    wrt = ["q", "v", "params.l1", "params.m2", "params.g", "t0", "t1"]
    alone(problem.system, method, wrt, run, start, {"m2": [1.0, 1.5, 2.0], "g": 0.9})


def blocks(monkeypatch):
    """Return a list that each block pulled back in lock-step is written to, with its outcome."""
    seen, pulled = [], LockStep.pulled

    def noted(self, members, *others):
        found = pulled(self, members, *others)
        seen.append((members, found is not None))
        return found

    monkeypatch.setattr(LockStep, "pulled", noted)
    return seen


@pytest.mark.parametrize("method", [lv.Spark(2), lv.Composition(lv.Spark(1), "Y4")], ids=str)
def test_blocks_of_members_are_pulled_back_in_lock_step(method, monkeypatch):
    """With a last block that is not full, and invariants among the functions."""
    system, seen = load("double_pendulum").system, blocks(monkeypatch)
    start = system.consistent(q=load("double_pendulum").start["q"], v=RNG.standard_normal((19, 4)))
    run, params = {"t": (0.5, 1.5), "steps": 20, "every": 6}, {"m1": np.linspace(0.5, 2, 19)}
    wrt = ["q", "v", "params.m1", "params.g", "t0", "t1"]
    alone(system, method, wrt, run, start, params, threads=1)
    assert seen == [(range(16), True), (range(16, 19), True)]
    solution, pullback = lv.vjp(system, method, wrt=wrt, threads=1, **run, **start, params=params)
    energy = RNG.standard_normal(solution.invariants["energy"].shape)
    gradients = pullback(invariants={"energy": energy})
    assert all(found for _, found in seen)
    own = {name: x[18] for name, x in start.items()}
    _, back = lv.vjp(system, method, wrt=wrt, **run, **own, params={"m1": params["m1"][18]})
    for name, value in back(invariants={"energy": energy[:, 18].copy()}).items():
        np.testing.assert_array_equal(gradients[name][18], value)


def test_a_long_run_in_lock_step_is_repeated_piece_by_piece():
    """Its records do not fit: a step of these sixteen members leaves 1152 numbers, of 2**21."""
    problem = load("double_pendulum")
    run = {"t": (0, 4), "steps": 2000, "every": 300}
    alone(problem.system, lv.Spark(3), ["q", "params.g"], run, starts(problem))


def test_a_member_without_a_derivative_is_named_and_the_others_have_theirs(monkeypatch):
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - ca.sqrt(params.k) * q[0] ** 2) / 2,
        q=1, params={"k": 1.0},
    )  # fmt: skip
    seen = blocks(monkeypatch)
    run = {"t": (0, 1), "steps": 5, "q": np.ones((20, 1)), "v": np.zeros((20, 1))}
    k = np.ones(20)
    k[17] = 0.0
    wrt = ["q", "params.k"]
    solution, pullback = lv.vjp(system, lv.Spark(2), wrt=wrt, params={"k": k}, threads=1, **run)
    with pytest.raises(lv.IntegrationError, match=r"member 17: .* not finite") as caught:
        pullback(q=np.ones_like(solution.q))
    assert caught.value.member == 17
    assert seen == [(range(16), True), (range(16, 20), False)]


@pytest.mark.skipif(processors() < 2, reason="one processor has one thread")
def test_threads_in_lock_step_end_after_an_interrupt(monkeypatch):
    problem = load("double_pendulum")
    start, ended = starts(problem), []
    run = {"t": (0, 400), "steps": 40_000, "every": 40_000, "threads": 2}
    solution, pullback = lv.vjp(problem.system, lv.Spark(2), wrt=["v"], **run, **start)
    pulled = LockStep.pulled

    def interrupted(self, members, *others):
        if members.start == 0:
            return [dict.fromkeys(pullback.wrt, 0.0)] * len(members)
        time.sleep(0.05)  # the main thread is to wait by then
        _thread.interrupt_main()
        try:
            return pulled(self, members, *others)
        finally:
            ended.append(members)

    monkeypatch.setattr(LockStep, "pulled", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pullback(q=np.ones_like(solution.q))
    assert ended == [range(2, 3)]


@pytest.mark.parametrize("name", ["doubled_rod", "heavy_top", "kepler_on_sphere", "car_axis"])
def test_redundant_varying_and_moving_systems(name):
    problem = load(name)
    start = starts(problem, 2)
    if name == "car_axis":  # the constraints move with the time
        start = {x: np.stack([value[0]] * 2) for x, value in start.items()}
    first, second = problem.system.states
    run = {"t": (problem.interval[0], problem.interval[0] + 5 * problem.h), "steps": 5}
    alone(problem.system, lv.Spark(2), [first, second], run, start)


@pytest.mark.parametrize(("row", "name"), COVERED, ids=str)
def test_methods_for_mechanics(row, name):
    problem = registry.ALL[name]
    system, t0 = problem.system, problem.t[0]
    found = system.consistent(t=t0, **problem.start)
    y, z = (np.stack([x, x]) for x in found.values())
    y_and_z = dict(zip(system.states, (y, z * [[1.0], [0.9]]), strict=True))
    run = {"t": (t0, t0 + 0.5), "steps": 5, "every": 2}
    wrt = [*directions_of(system, "t0", "t1")]
    alone(system, row.method, wrt, run, system.consistent(t=t0, **y_and_z))


@pytest.mark.parametrize("row", registry.INDEX2, ids=str)
def test_methods_for_semi_explicit_systems(row):
    problem = registry.ALL["index 2"]
    system, (t0, t1) = problem.system, (0.2, 0.5)
    y, z = (problem.exact(t0)[name] for name in ("y", "z"))
    starts = [system.consistent(t=t0, y=y + k * 0.02, z=z) for k in range(2)]
    start = {name: np.stack([one[name] for one in starts]) for name in ("y", "z")}
    wrt = ["y", "t0", "t1", *(f"params.{name}" for name in system.params)]
    alone(system, row.method, wrt, {"t": (t0, t1), "steps": 5, "every": 2}, start)


@pytest.mark.parametrize(("row", "name"), [(row, row.on[0]) for row in registry.FIELDS], ids=str)
def test_methods_for_fields(row, name):
    """By one plan, as a member alone may be split in another way."""
    problem = registry.ALL[name]
    x, t0 = np.outer([1.0, 0.9], problem.start["x"]), problem.t[0]
    plan = lv.plan(problem.system, row.method, h=0.025, x=x, t=t0)
    alone(problem.system, plan, ["x", "t1"], {"t": (t0, t0 + 0.1), "steps": 4}, {"x": x})


@pytest.mark.parametrize(("row", "name"), REGISTERED, ids=str)
def test_methods_for_wave_functions(row, name):
    problem = registry.ALL[name]
    run = {"t": (problem.t[0], problem.t[0] + 1.0)}
    if isinstance(row.method, lv.Magnus | lv.GrayManolopoulos | lv.StabilitySplitting):
        run["steps"] = row.steps[-1]
    psi = np.ravel(problem.start["psi"])
    alone(problem.system, row.method, ["psi"], run, {"psi": np.stack([psi, 1j * psi[::-1]])})


def test_wave_functions_are_run_again_only_where_not_all_fit_in_memory(monkeypatch):
    """Each way has the same bits."""
    from liouville._runs import members_adjoint
    from liouville._runs.waves import derivative as wave_derivative

    samples, check = np.random.default_rng(2).standard_normal(9), wave_derivative.check_room
    matrix = np.diag([0.3, -0.2, 0.5]) + np.ones((3, 3)) / 7
    drive = [(samples, np.diag([1.0, 1.0], 1) + np.diag([1.0, 1.0], -1))]
    system = lv.Schrodinger(matrix, drive=drive, times=np.linspace(0, 2, 9))
    call = {"wrt": ["psi", "drive[0]"], "t": (0, 0.7, 2), "psi": np.eye(3) + 0.1j}
    runs, again = [], members_adjoint.execute
    monkeypatch.setattr(
        members_adjoint, "execute", lambda *a, **k: runs.append(1) or again(*a, **k)
    )

    def gradients():
        solution, pullback = lv.vjp(system, "auto", **call)
        cotangent = solution.psi * (1 + 0.5j)
        found = pullback(psi=cotangent)
        for name, value in pullback(psi=cotangent).items():  # what a run has left stays
            np.testing.assert_array_equal(value, found[name])
        return found

    kept = gradients()
    assert not runs

    def full(*args, runs, **options):
        if runs > 1:
            raise MemoryError("of all at once")
        check(*args, runs=runs, **options)

    monkeypatch.setattr(wave_derivative, "check_room", full)
    for name, value in gradients().items():
        np.testing.assert_array_equal(value, kept[name])
    assert len(runs) == 6


def test_one_start_and_many_lengths_sum_to_the_gradient_of_a_sum():
    """What members share has a gradient from each, as `jax.vmap` has it."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
        lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
        q=("x", "y"),
        params={"g": 9.81, "l": 2.0},
    )
    lengths = np.array([1.0, 1.5, 2.0])
    start = system.consistent(q=[0.6, -0.8], v=[0.8, 0.6], params={"l": lengths})
    run = {"t": (0, 0.5), "steps": 20, "every": 20}
    wrt = ["q", "params.g", "params.l"]
    gradients = alone(system, lv.Spark(2), wrt, run, start, {"l": lengths})
    assert gradients["params.g"].shape == (3,)
    found = lv.analysis.check_gradient(
        system, lv.Spark(2), wrt=wrt, **run, **start, params={"l": lengths}, threads=1
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-9


def test_members_of_a_field():
    system, x = abc_flow.system, RNG.random((3, 3))
    run = {"t": (0, 2), "steps": 20, "every": 6}
    plan = lv.plan(system, lv.VolumeSplitting(), h=0.1, x=x)
    wrt = ["x", "params.A", "t0", "t1"]
    alone(system, plan, wrt, run, {"x": x})
    alone(system, plan, wrt, run, {"x": x}, {"A": [1.0, 1.1, 0.9]})
    found = lv.analysis.check_gradient(system, plan, wrt=wrt, **run, x=x)
    assert found.dot < 1e-13
    assert found.differences < 1e-9


@pytest.mark.parametrize(("method", "run"), [
    ("auto", {"t": (0, 1, 3)}), (lv.Magnus(4), {"t": (0, 3), "steps": 9, "every": 4}),
], ids=str)  # fmt: skip
def test_members_of_a_wave_function(method, run):
    h, b = (x + x.T for x in RNG.standard_normal((2, 6, 6)))
    system = lv.Schrodinger(
        h,
        drive=[(RNG.standard_normal(9), b), (lambda t, p: p.a * ca.sin(t), b @ b)],
        times=np.linspace(0, 3, 9),
        params={"a": 0.3},
    )
    psi = RNG.standard_normal((3, 6)) + 1j * RNG.standard_normal((3, 6))
    alone(system, method, ["psi", "drive[0]", "params.a"], run, {"psi": psi})


@pytest.mark.parametrize("name", ["driven", "Magnus 4 by shears", "well", "still by shears"])
def test_members_of_wave_functions_with_parameters_of_their_own(name):
    """Each is planned as alone, also where all begin with the same state."""
    make, method, wrt, run = ROWS[name]
    system, run = make(), {"t": (0, 1, 3), **run}
    psi = RNG.standard_normal((3, system.size)) + 1j * RNG.standard_normal((3, system.size))
    vector = "c" if "still" in name else "w"
    params = {"a": 0.5, vector: system.params[vector] * [[1.0], [1.3], [0.8]]}
    params |= {"k": [1.0, 0.7, 2.0]} if "k" in system.params else {"b": 0.3}
    alone(system, method, wrt, run, {"psi": psi}, params)
    alone(system, method, wrt, run, {"psi": psi[0]}, params)


def test_members_that_do_not_fit_in_memory_together_are_run_again(monkeypatch):
    from liouville._runs.waves import derivative as wave_derivative

    system, found, check = ROWS["driven"][0](), [], wave_derivative.check_room
    psi = RNG.standard_normal((3, system.size))

    def check_one(plan, size, *, runs=1, **options):
        if runs > 1:
            raise MemoryError("too many at once")
        check(plan, size, runs=runs, **options)

    for patch in (check, check_one):
        monkeypatch.setattr(wave_derivative, "check_room", patch)
        solution, pullback = lv.vjp(
            system, "auto", wrt=["psi", "params.a"], t=(0, 2), psi=psi, params={"a": [1, 2, 3]}
        )
        found.append(pullback(psi=np.ones_like(solution.psi)))
    for name, gradient in found[0].items():
        np.testing.assert_array_equal(gradient, found[1][name])


def test_arrays_may_be_changed_between_a_run_and_its_pullback():
    """Members are run again, from the arrays as they were given."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=("x",), params={"k": 1.0}
    )
    run = {"wrt": ["q", "params.k"], "steps": 20, "t_eval": np.array([0.3, 0.7]), "t": [0, 1]}
    run |= {"params": {"k": np.array([1.0, 2.0])}, "q": [[1.0], [2.0]], "v": np.zeros((2, 1))}
    solution, pullback = lv.vjp(system, lv.Spark(3), **run)
    wanted = pullback(q=np.ones_like(solution.q))
    solution, pullback = lv.vjp(system, lv.Spark(3), **run)
    for array in (run["t_eval"], run["params"]["k"], run["v"]):
        array += 0.1
    run["params"].clear()
    run["q"][1][0] = run["t"][1] = 5.0
    found = pullback(q=np.ones_like(solution.q))
    assert all(np.array_equal(found[name], wanted[name]) for name in wanted)


def test_results_do_not_depend_on_threads():
    problem = load("double_pendulum")
    start, found = starts(problem), []
    for threads in (1, 2):
        solution, pullback = lv.vjp(
            problem.system, lv.Spark(2), wrt=["v"], t=(0, 1), steps=20, threads=threads, **start
        )
        found.append(pullback(q=np.ones_like(solution.q))["v"])
    np.testing.assert_array_equal(*found)


def test_ctrl_c_ends_the_members_that_threads_have():
    """It comes to the main thread; here it comes while the second member is pulled back."""
    problem = load("double_pendulum")
    start = starts(problem)
    run = {"t": (0, 40), "steps": 4000, "every": 4000}
    # full Newton: its members are pulled back one by one
    method = lv.Spark(2, "newton")
    solution, pullback = lv.vjp(problem.system, method, wrt=["v"], **run, **start)
    adjoint, seen = pullback.adjoint, []

    def of_member(member, make=adjoint._of_member):
        found = make(member)
        seen.append(found.checkpoints)
        if member == 1:
            _thread.interrupt_main()
        return found

    adjoint._of_member, adjoint._threads = of_member, 2
    with pytest.raises(KeyboardInterrupt):
        pullback(q=np.ones_like(solution.q))
    assert all(each.stop.is_set() for each in seen)
    with pytest.raises(KeyboardInterrupt):
        next(seen[0].reversed(4000))


@pytest.mark.parametrize("steps", [30, 300])
@pytest.mark.parametrize(
    "method", [lv.Spark(3), lv.LobattoPair(2), lv.Composition(lv.Spark(1), "Y4"), lv.HHT(-0.1)],
    ids=str,
)  # fmt: skip
def test_members_at_given_times(method, steps):
    """As runs alone, to the bit: states, tangents and gradients, on many threads."""
    problem = load("double_pendulum")
    start, times = starts(problem), [0.0, 0.013, 0.3, 0.31, 0.77, 1.0]
    run, params = {"t": (0, 1), "steps": steps, "t_eval": times}, {"m2": [1.0, 1.5, 2.0], "g": 0.9}
    wrt = ["q", "v", "params.l1", "params.m2", "params.g", "t0", "t1"]
    alone(problem.system, method, wrt, run, start, params)
    own = {"m2": params["m2"][2], "g": 0.9}
    one = {name: x[2] for name, x in start.items()}
    moves = {"params.l1": 1.0, "t1": 1.0, "q": np.eye(4)}
    many = lv.ensemble(problem.system, method, tangents=moves, params=params, **run, **start)
    last = lv.integrate(problem.system, method, tangents=moves, params=own, **run, **one)
    assert many.q.shape == (len(times), 3, 4)
    for name, tangent in last.tangents.items():
        found = many.member(2).tangents[name]
        for state, value in tangent.states.items():
            np.testing.assert_array_equal(found.states[state], value)


def test_a_member_that_fails_and_what_has_no_pullback_are_named():
    problem = load("double_pendulum")
    start = starts(problem)
    call = {"wrt": ["v"], "t": (0, 1), "steps": 20, **start}
    with pytest.raises(TypeError, match="members of an ensemble take equal steps: give h or steps"):
        lv.vjp(problem.system, lv.HHT(), **(call | {"steps": None, "rtol": 1e-6}))
    with pytest.raises(TypeError, match="rtol"):
        lv.vjp(problem.system, lv.Spark(2), **{**call, "steps": None}, rtol=1e-6)
    solution, pullback = lv.vjp(problem.system, lv.Spark(2), **call)
    with pytest.raises(ValueError, match=r"must have shape \(21, 3, 4\), not \(21, 4\)"):
        pullback(q=np.zeros_like(solution.q[:, 0]))
    fast = {**call, "v": start["v"] * [[1], [1e3], [1]]}
    with pytest.raises(lv.IntegrationError, match="1 of 3 members failed") as caught:
        lv.vjp(problem.system, lv.Spark(2), **fast)
    assert [*caught.value.solution.failures] == [1]
