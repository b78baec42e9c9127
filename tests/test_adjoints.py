"""Pullbacks are the transposes of tangents, to roundoff, whatever lies between two checkpoints.

That they agree with tangents says nothing about stages that were not solved to the end: tangents
are compared with differences in `test_tangents`, and a few gradients here.
"""

import time

import casadi as ca
import numpy as np
import pytest
from test_tangents import DENSE, SIZE, WEIGHTS, directions_of, general, moved, pendulum

import liouville as lv
from liouville._runs import execute
from liouville.problems import load


def paired(system, method, t, start, directions, least=0.0, **run):
    """Return how far the pairings of tangent and pullback are apart, in units of their parts.

    Where these are errors of the method alone, the unit is the least one.
    """
    rng = np.random.default_rng(2)
    solution, pullback = lv.vjp(system, method, wrt=[*directions], t=t, **run, **start)
    found = lv.integrate(system, method, t=t, tangents=directions, **run, **start)
    assert all(np.array_equal(solution.states[x], found.states[x]) for x in pullback.states)
    cotangents = {x: rng.standard_normal(solution.states[x].shape) for x in pullback.states}
    gradients = pullback(**cotangents)
    sizes = []
    for name, direction in directions.items():
        parts = [cotangents[x] * found.tangents[name].states[x] for x in cotangents]
        forward, unit = sum(x.sum() for x in parts), sum(np.abs(x).sum() for x in parts)
        sizes.append(abs(np.sum(gradients[name] * direction) - forward) / max(unit, least))
    return max(sizes)


def test_every_parameter_of_every_function_and_both_ends():
    system, t = general(), (0.2, 0.8)
    start = system.consistent(t=t[0], y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])
    directions = directions_of(system, "t0", "t1")
    for method in (lv.Spark(3), lv.LobattoPair(3, "C"), lv.Composition(lv.Spark(1), "Y4")):
        assert paired(system, method, t, start, directions, steps=10) < 1e-12
    found = lv.analysis.check_gradient(
        system, lv.Spark(2), wrt=[*directions], t=t, steps=4, **start
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-9


def test_the_pairing_is_kept_over_many_steps():
    system = pendulum()
    start = system.consistent(q=[1.2, -1.6], v=[1.6, 1.2])
    run = {"steps": 3000, "every": 3000}
    directions = directions_of(system)
    assert paired(system, lv.Spark(2), (0.0, 60.0), start, directions, **run) < 1e-12


def test_the_pairing_is_kept_over_a_hundred_thousand_steps():
    problem = load("double_pendulum")
    system, run = problem.system, {"steps": 100_000, "every": 100_000}
    # a small swing: the tangents of a chaotic one would lose what is compared
    start = system.consistent(q=[0.1, -0.99, 0.1, -1.99], v=np.zeros(4))
    directions = directions_of(system)
    assert paired(system, lv.Spark(3), (0.0, 2000.0), start, directions, **run) < 1e-12


@pytest.mark.parametrize(
    "control",
    [{"rtol": 1e-7}, {"rtol": 1e-7, "h": 0.4}, {"control": lv.Reversible(), "h": 0.02}],
    ids=str,
)
def test_controlled_steps_are_held(control):
    problem = load("double_pendulum")
    directions = directions_of(problem.system)
    run = {**control, "every": 3}
    method = lv.Spark(3)
    assert paired(problem.system, method, (0.0, 2.0), problem.start, directions, **run) < 1e-12


@pytest.mark.parametrize("steps", [
    {"rtol": 1e-5}, {"rtol": 1e-4, "every": 3}, {"rtol": 1e-5, "t_eval": [0.1, 0.33, 1.0]},
], ids=str)  # fmt: skip
@pytest.mark.parametrize("method", [
    lv.Spark(3), lv.Spark(2, points="radau"), lv.LobattoPair(3),
    lv.HHT(), lv.GeneralizedAlpha(), lv.ArnoldBruls(),
], ids=lambda method: type(method).__name__)  # fmt: skip
def test_controlled_steps_are_checked_by_differences(method, steps):
    """Moved runs take the steps of the first; those of the alpha family carry accelerations."""
    cases = [(pendulum(), ["q", "v", "params.l"], {"q": [1.2, -1.6], "v": [1.6, 1.2]})]
    if isinstance(method, lv.Spark | lv.LobattoPair):
        cases.append((general(), ["y", "z"], {"y": [0.6, 0.1, -0.8], "z": [0.1, 1.2, 0.4]}))
    for system, wrt, start in cases:
        call = {"wrt": wrt, "t": (0.0, 1.0), "size": 3e-4, **steps}
        found = lv.analysis.check_gradient(
            system, method, **call, **system.consistent(t=0.0, **start)
        )
        assert found.dot < 1e-12
        assert found.differences < 1e-10


@pytest.mark.parametrize("records", [
    {"rtol": 1e-5}, {"rtol": 1e-4, "every": 3}, {"rtol": 1e-5, "t_eval": [0.1, 1.0, 2.5, 3.0]},
], ids=str)  # fmt: skip
@pytest.mark.parametrize(
    "method", [lv.Spark(3), lv.HHT()], ids=lambda method: type(method).__name__
)
def test_controlled_steps_with_resets_are_checked_by_differences(method, records):
    """Moved runs hit the ground earlier or later, and the third top ends them."""
    ball = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2 - p.g * q[0] - q[0] ** 2 / 10, q=1,
        params={"e": 0.8, "g": 1.0}, force=lambda t, q, v, p: -0.1 * v,
    )  # fmt: skip
    events = {
        "ground": lv.Event(lambda t, q, v, lam, p: q[0], "down",
                           reset=lv.Impact(lambda t, q, v, lam, p: p.e)),
        "top": lv.Event(lambda t, q, v, lam, p: v[0], "down", terminal=3),
    }  # fmt: skip
    found = lv.analysis.check_gradient(
        ball, method, wrt=["q", "v", "params.e", "params.g"], t=(0, 8), events=events, q=[1.0],
        v=[0.5], size=1e-4, **records,
    )  # fmt: skip
    assert found.dot < 1e-14
    assert found.differences < 1e-8


@pytest.mark.parametrize("records", [
    {"rtol": 1e-5}, {"rtol": 1e-5, "every": 2}, {"rtol": 1e-5, "t_eval": [0.1, 0.5, 1.0, 3.0]},
], ids=str)  # fmt: skip
def test_steps_that_end_at_switches_are_checked_by_differences(records):
    """The force turns at k, which all runs pass elsewhere; a Lobatto pair has no derivative."""
    block = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2 - q[0] ** 4, q=1, params={"k": 0.3},
        force=lambda t, q, v, p: ca.if_else(q[0] < p.k, 1.0, -1.0) - 0.1 * v,
        switches={"side": lambda t, q, v, p: q[0] - p.k},
    )  # fmt: skip
    call = {"wrt": ["q", "v", "params.k"], "t": (0, 4.0), "q": [0.0], "v": [0.1], **records}
    found = lv.analysis.check_gradient(block, lv.Spark(3), **call)
    assert found.dot < 1e-14
    assert found.differences < 1e-10
    assert lv.analysis.check_gradient(block, lv.LobattoPair(3), **call).differences > 1e-3


def test_reversible_steps_are_checked_by_differences():
    found = lv.analysis.check_gradient(
        pendulum(), lv.Spark(3), wrt=["q", "params.l"], t=(0, 1), control=lv.Reversible(), h=0.05,
        q=[1.2, -1.6], v=[1.6, 1.2],
    )  # fmt: skip
    assert found.dot < 1e-12
    assert found.differences < 1e-10


@pytest.mark.parametrize(("method", "steps"), DENSE, ids=str)
def test_states_at_given_times(method, steps):
    t, times = (0.2, 0.8), [0.2, 0.23, 0.31, 0.35, 0.5, 0.79, 0.8]
    run = {"steps": steps, "t_eval": times}
    for system, start in ((general(), {"y": [0.6, 0.1, -0.8], "z": [0.1, 1.2, 0.4]}),
                          (pendulum(), {"q": [1.2, -1.6], "v": [1.6, 1.2]})):  # fmt: skip
        start = system.consistent(t=t[0], **start)
        directions = directions_of(system, "t0", "t1")
        assert paired(system, method, t, start, directions, least=1.0, **run) < 1e-12


@pytest.mark.parametrize("control", [{"steps": 40}, {"rtol": 1e-8}], ids=str)
def test_times_far_apart_in_long_runs_and_of_redundant_constraints(control):
    for name, method in (("doubled_rod", lv.Spark(2)), ("double_pendulum", lv.Spark(4))):
        system, t = load(name).system, (0.0, 1.0)
        start = system.consistent(**load(name).start)
        directions = directions_of(system, *([] if "rtol" in control else ["t0", "t1"]))
        run = {**control, "least": 1.0}
        times = [0.001, 0.3, 0.31, 0.311, 0.999]
        assert paired(system, method, t, start, directions, t_eval=times, **run) < 1e-12
        t, times = t[::-1], times[::-1]
        assert paired(system, method, t, start, directions, t_eval=times, **run) < 1e-12


def test_redundant_and_sparse_mechanisms():
    for name in ("doubled_rod", "andrews"):
        system = load(name).system
        start = system.consistent(**load(name).start)
        directions = directions_of(system, "t0", "t1")
        assert paired(system, lv.Spark(2), (0.0, 1e-3), start, directions, steps=5) < 1e-12


def springs(stiffness):
    """Return a chain whose links are springs but for every second one, which is a rod."""

    def lagrangian(t, q, v, params):
        x, y = q[0::2], q[1::2]
        dx, dy = ca.vertcat(x[0], x[1:] - x[:-1]), ca.vertcat(y[0], y[1:] - y[:-1])
        stretch = dx[0::2] ** 2 + dy[0::2] ** 2 - 1
        return ca.dot(v, v) / 2 - params.g * ca.sum1(y) - params.k / 2 * ca.sumsqr(stretch)

    def constraint(t, q, params):
        x, y = q[0::2], q[1::2]
        return ((x[1::2] - x[0::2]) ** 2 + (y[1::2] - y[0::2]) ** 2 - params.l**2) / 2

    names = [f"{axis}{i}" for i in range(1, 9) for axis in "xy"]
    params = {"g": 1.0, "k": stiffness, "l": 1.0}
    return lv.Lagrangian(lagrangian, constraint, q=names, params=params)


def test_linear_steps_are_corrected_and_where_that_fails_factored():
    """Large systems are solved by node Schur's corrections, which stiff springs make diverge."""
    across = np.array([0.6, -0.8])
    q = np.outer(np.arange(1, 9), across).ravel()
    v = np.outer(np.linspace(0.1, 0.4, 8), [0.8, 0.6]).ravel()
    for stiffness, steps, kind in ((1.0, 10, 1e-13), (1e6, 20, 1e-11)):
        system = springs(stiffness)
        start = system.consistent(q=q, v=v)
        directions = directions_of(system, "t1")
        run = {"t": (0.0, 0.5), "steps": steps}
        assert paired(system, lv.Spark(3), start=start, directions=directions, **run) < kind
        if stiffness == 1.0:
            found = lv.analysis.check_gradient(
                system, lv.Spark(3), wrt=[*directions], **run, **start
            )
            assert found.differences < 1e-9
        by_newton = {}
        for method in (lv.Spark(3), lv.Spark(3, solver="newton")):
            tangent = lv.integrate(system, method, **run, tangents={"v": v}, **start).tangents["v"]
            by_newton[method.solver] = tangent.q[-1]
        first, second = by_newton.values()
        np.testing.assert_allclose(first, second, rtol=0, atol=1e-9 * np.abs(first).max())


def test_a_cotangent_of_the_start_alone_is_projected():
    system = pendulum()
    start = system.consistent(q=[1.2, -1.6], v=[1.6, 1.2])
    run = {"wrt": ["q", "v", "params.l"], "t": (0, 1), "steps": 4, "every": 4}
    solution, pullback = lv.vjp(system, lv.Spark(2), **run, **start)
    at_start = np.array([[1.0, 0.0], [0.0, 0.0]])
    q, v = start["q"], start["v"]
    by = pullback(q=at_start)
    across = np.array([-q[1], q[0]]) / 2
    np.testing.assert_allclose(by["q"], across[0] * across, rtol=0, atol=1e-15)
    np.testing.assert_allclose(by["params.l"], q[0] / 2, rtol=1e-15)
    np.testing.assert_array_equal(by["v"], 0)
    # a velocity turns with the rod that it is to stay across
    by = pullback(v=at_start)
    np.testing.assert_allclose(by["v"], across[0] * across, rtol=0, atol=1e-15)
    np.testing.assert_allclose(by["q"], -q[0] / 4 * (v @ across) * across, rtol=0, atol=1e-15)
    assert repr(pullback) == "<Pullback of q, v, lam, invariants.energy to q, v, params.l>"
    assert solution.stats["steps"] == 4


def test_checks_by_differences_repeat_the_steps():
    """Ends that move keep their number of steps, and what cannot be repeated is refused."""
    system = pendulum()
    call = {"wrt": ["v", "params.l"], "t": (0, 1), "q": [1.2, -1.6], "v": [1.6, 1.2]}
    ends = call | {"wrt": ["params.l", "t0", "t1"]}
    for method in (lv.Spark(2), lv.HHT()):
        assert lv.analysis.check_gradient(system, method, h=0.1, **ends).differences < 1e-10
    refused = (
        ({"h": 0.1, "size": 0}, "size must be positive and finite, not 0"),
        ({"h": 0.1, "size": "a"}, "size must be a number"),
        ({"h": 0.1, "seed": -1}, "seed must be an integer from 0 on"),
        ({"h": 0.1, "wrt": []}, "wrt must be a sequence of names"),
    )
    for more, sentence in refused:
        with pytest.raises((TypeError, ValueError), match=sentence):
            lv.analysis.check_gradient(system, lv.Spark(2), **(call | more))
    # the bob passes below on its way, a step earlier in some of the runs
    below = {"low": lv.Event(lambda t, q, v, lam, params: q[0], "down", terminal=True)}
    call = {"wrt": ["params.l"], "t": (0, 9), "h": 0.005, "events": below, "q": [1.2, -1.6]}
    with pytest.raises(ValueError, match="an event ends a moved run after another number"):
        lv.analysis.check_gradient(system, lv.Spark(2), v=[0.0, 0.0], size=0.05, **call)


@pytest.mark.parametrize(("name", "wrt"), [
    ("andrews", ["q", "v", "params.c0", "params.i5", "t0", "t1"]),
    ("car_axis", ["q", "v", "t1"]), ("chain", ["q", "v", "params.g", "t1"]),
    ("rigid_chain", ["params.mu"]), ("pendulum", ["q", "v", "params.g", "params.l"]),
])  # fmt: skip
def test_differences_move_each_name_by_its_own_size(name, wrt):
    """Moments of inertia of 1e-6 beside springs of 1e3, and shares that hardly matter."""
    system, start = load(name).system, load(name).start
    run = {"t": (0.0, 0.02), "steps": 5, **system.consistent(**start)}
    for each in (wrt, *([x] for x in wrt)):
        found = lv.analysis.check_gradient(system, lv.HHT(), wrt=each, **run)
        assert found.dot < 1e-12
        assert found.differences < 1e-8


def test_a_check_sees_a_small_derivative_that_is_wrong():
    """A kink has a slope of zero for CasADi, and one half for central differences."""

    def bent(t, q, v, params):
        return v[0] ** 2 / 2 - params.g * q[0] + 1e-4 * q[0] * ca.if_else(params.k > 0, params.k, 0)

    system = lv.Lagrangian(bent, q=1, params={"g": 1.0, "k": 0.0})
    run = {"t": (0, 1), "steps": 9, "q": [1.0], "v": [0.0]}
    assert lv.analysis.check_gradient(system, lv.HHT(), wrt=["params.g"], **run).differences < 1e-12
    assert lv.analysis.check_gradient(system, lv.HHT(), wrt=["params.k"], **run).differences > 1e-4


def test_a_gradient_of_zero_is_right():
    """A restitution without an impact, a potential that underflows, a system at rest."""
    ball = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - p.g * q[0], q=1,
                         params={"e": 0.8, "g": 1.0})  # fmt: skip
    ground = lv.Event(lambda t, q, v, lam, p: q[0], "down",
                      reset=lv.Impact(lambda t, q, v, lam, p: p.e))  # fmt: skip
    run = {"t": (0, 0.5), "steps": 5, "v": [0.0]}
    grid = lv.Grid(-1, 1, 16, potential=lambda t, x, p: ca.exp(-1e6 * (x - p.c) ** 2))
    well = lv.Schrodinger(grid, params={"c": 100.0})
    for events in ({}, {"ground": ground}):
        for method in (lv.HHT(), lv.Spark(2)):
            call = {"wrt": ["params.e"], "events": events, "q": [1.0], **run}
            assert lv.analysis.check_gradient(ball, method, **call) == lv.analysis.GradientCheck(
                0.0, 0.0
            )
    still = {"params": {"g": 0.0}, "wrt": ["params.e"], "q": [0.0], **run}
    assert lv.analysis.check_gradient(ball, lv.HHT(), **still) == lv.analysis.GradientCheck(
        0.0, 0.0
    )
    top = lv.PolynomialField(lambda t, x, p: ca.vertcat(x[1], -x[0]), x=2, params={"z": [1.0, 2.0]})
    call = {"wrt": ["params.z"], "t": (0, 1), "steps": 5, "x": [1.0, 0.0]}
    assert lv.analysis.check_gradient(
        top, lv.VolumeSplitting(), **call
    ) == lv.analysis.GradientCheck(0.0, 0.0)
    found = lv.analysis.check_gradient(
        well, "auto", wrt=["params.c"], t=(0, 1), psi=np.ones(16) / 4
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-10


@pytest.mark.parametrize("call", [
    lv.vjp, lv.analysis.check_gradient, lv.integrate, lv.ensemble, lv.analysis.lyapunov,
    lv.casadi.solver,
])  # fmt: skip
@pytest.mark.parametrize("system", [None, lv.Lagrangian, "pendulum"], ids=str)
def test_what_is_no_system_is_refused(call, system):
    wrt = {} if call in (lv.integrate, lv.ensemble, lv.analysis.lyapunov) else {"wrt": ["v"]}
    with pytest.raises(TypeError, match="system must be a Lagrangian"):
        call(system, lv.Spark(2), t=(0, 1), h=0.1, q=[1.0], **wrt)


@pytest.mark.parametrize("call", [lv.vjp, lv.integrate, lv.analysis.lyapunov, lv.casadi.solver])
@pytest.mark.parametrize("method", [lv.Spark, lv.VolumeSplitting()], ids=str)
def test_what_is_no_method_is_refused(call, method):
    wrt = {"wrt": ["q"]} if call in (lv.vjp, lv.casadi.solver) else {}
    start = {"v": [1.6, 1.2]} if call is lv.casadi.solver else {"q": [1.2, -1.6], "v": [0, 0]}
    words = "does not step mechanical systems; methods that do: Spark"
    words = r"^Spark is a class: write lv\.Spark\(\)$" if method is lv.Spark else words
    with pytest.raises(TypeError, match=words):
        call(pendulum(), method, t=(0, 1), h=0.1, **start, **wrt)


@pytest.mark.parametrize(("call", "given", "sentence"), [
    ({"wrt": ["params.length"]}, None, "there is no direction 'params.length'"),
    ({"wrt": ["t1"], "steps": None, "rtol": 1e-6}, None, "where steps are controlled"),
    ({"wrt": "q"}, None, "wrt must be a sequence of names"),
    ({"wrt": ["q", ["v"]]}, None, r"there is no direction \['v'\]"),
    ({"method": lv.Spark(2, newton_tol=1e-6)}, None, "leave newton_tol out"),
    ({}, {}, "no cotangents are given"),
    ({}, {"x": 1.0}, "there is no cotangent of 'x'"),
    ({}, {"q": [1.0, 2.0]}, r"must have shape \(5, 2\), not \(2,\)"),
    ({}, {"lam": np.full((5, 1), np.nan)}, "the cotangent of 'lam' must be finite"),
    ({}, {"q": np.full((5, 2), 1j)}, "must be an array of real numbers"),
    ({}, {"q": np.ma.masked_less(np.eye(5, 2), 1)}, "the cotangent of 'q' has masked numbers"),
    ({}, {"q": [[1.0], [1.0, 2.0]]}, "must be an array of real numbers"),
    ({}, {"invariants": np.ones(5)}, "cotangents of invariants are a mapping of their names"),
    ({}, {"invariants": {"spin": np.ones(5)}}, "there is no cotangent of 'invariants.spin'"),
    ({}, {"invariants": {"energy": np.ones(4)}}, r"must have shape \(5,\), not \(4,\)"),
])  # fmt: skip
def test_bad_input_is_refused_by_a_sentence(call, given, sentence):
    arguments = {"system": pendulum(), "method": lv.Spark(2), "t": (0, 1), "steps": 4,
                 "wrt": ["q"], "q": [1.2, -1.6], "v": [1.6, 1.2]} | call  # fmt: skip
    with pytest.raises((TypeError, ValueError), match=sentence):
        lv.vjp(**arguments)[1](**(given or {}))


def spun(kind):
    """Return a system with friction, whose energy and spin change, and its start."""
    spin = {"spin": lambda t, q, v, params: params.l * ca.cos(t) * (q[0] * v[1])}
    if kind == "structure":  # of matrices that no expression has, one of them not symmetric
        mass, stiffness = [[2.0, 0.1], [0.1, 1.0]], [[5.0, -2.8], [-1.2, 6.0]]
        system = lv.Structure(
            mass, stiffness, 0.1 * np.eye(2), force=lambda t, q, v, params: -params.l * q**3,
            params={"l": 2.0}, invariants=spin,
        )  # fmt: skip
        return system, {"q": [1.2, -1.6], "v": [1.6, 1.2]}
    system = lv.Lagrangian(
        lambda t, q, v, params: params.m * ca.dot(v, v) / 2 - params.m * params.g * q[1],
        lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
        force=lambda t, q, v, params: -params.c * (1 + t) * v,
        invariants=spin,
        q=("x", "y"),
        params={"m": 1.5, "g": 9.81, "l": 2.0, "c": 0.3},
    )
    return system, {"q": [1.2, -1.6], "v": [1.6, 1.2]}


@pytest.mark.parametrize("kind", ["pendulum", "structure"])
@pytest.mark.parametrize("run", [{}, {"t_eval": [0.15, 0.33, 0.6]}], ids=str)
def test_cotangents_of_invariants(run, kind):
    """They depend on time and parameters themselves, and on the states that are kept."""
    (system, start), t, method = spun(kind), (0.1, 0.7), lv.Spark(2)
    directions, run = directions_of(system, "t0", "t1"), {"steps": 20, **run}
    solution, pullback = lv.vjp(system, method, wrt=[*directions], t=t, **run, **start)
    rng = np.random.default_rng(4)
    weights = {x: rng.standard_normal(len(solution.t)) for x in ("energy", "spin")}
    gradients = pullback(invariants=weights)
    found = sum(np.sum(gradients[name] * direction) for name, direction in directions.items())
    wanted = 0.0
    for count, weight in WEIGHTS.items():
        for step in (count * SIZE, -count * SIZE):
            at = t[0] + step * directions["t0"], t[1] + step * directions["t1"]
            own, params = moved(system, at[0], start, directions, step)
            values = lv.integrate(system, method, t=at, params=params, **run, **own).invariants
            part = sum(x @ values[name] for name, x in weights.items())
            wanted += np.sign(step) * weight / SIZE * part
    assert abs(found - wanted) < 1e-9 * abs(wanted)


def test_energies_of_members_of_structures_have_cotangents():
    system, start = spun("structure")
    call = {"wrt": ["q", "v", "params.l"], "t": (0, 1), "steps": 20, "v": start["v"]}
    rows = np.array([start["q"], [0.3, 0.4], [-1.0, 0.0]])
    weights = np.random.default_rng(6).standard_normal((21, 3))
    _, pullback = lv.vjp(system, lv.Spark(2), q=rows, **call)
    found = pullback(invariants={"energy": weights})
    for k, q in enumerate(rows):
        _, alone = lv.vjp(system, lv.Spark(2), q=q, **call)
        for name, x in alone(invariants={"energy": weights[:, k]}).items():
            np.testing.assert_array_equal(found[name][k], x)


def test_recorded_steps_have_the_gradients_of_repeated_ones(monkeypatch):
    """The first call follows what the run has recorded, others repeat it: to the same bits."""
    system, found = pendulum(), []
    start = system.consistent(q=[1.2, -1.6], v=[1.6, 1.2])
    call = {"wrt": ["q", "v", "params.l", "t1"], "t": (0, 3), "steps": 300, "every": 50, **start}
    cotangents = np.random.default_rng(5).standard_normal((7, 2))
    ends_before = np.where(np.arange(7)[:, None] < 3, cotangents, 0)
    for size in (execute.RECORDED, 2**16):  # of all steps, and of a third
        monkeypatch.setattr(execute, "RECORDED", size)
        for given in (cotangents, ends_before):
            pullback = lv.vjp(system, lv.Spark(2), **call)[1]
            found.append((given is cotangents, pullback(q=given)))
            found.append((given is cotangents, pullback(q=given)))
    for is_whole in (True, False):
        first, *others = [gradients for which, gradients in found if which == is_whole]
        for gradients in others:
            for name, x in first.items():
                np.testing.assert_array_equal(gradients[name], x)


def test_ctrl_c_ends_a_pullback_within_a_piece(pressing):
    """It need not wait for the steps between two checkpoints, and the next one is whole."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - ca.dot(q, q) / 2 - q[0] ** 2 * q[1],
        q=("x", "y"),
    )
    run = {"t": (0, 500), "steps": 50_000, "every": 50_000, "q": [0.1, 0.1], "v": [0.0, 0.1]}
    solution, pullback = lv.vjp(system, lv.Spark(4), wrt=["q"], **run)
    pullback(q=np.ones_like(solution.q))  # the recorded steps are used up
    before = time.process_time()
    whole = pullback(q=np.ones_like(solution.q))["q"]
    taken = time.process_time() - before
    with pressing(0.02) as since, pytest.raises(KeyboardInterrupt):
        pullback(q=np.ones_like(solution.q))
    assert since() < 0.5 * taken
    np.testing.assert_array_equal(pullback(q=np.ones_like(solution.q))["q"], whole)
