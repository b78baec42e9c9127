"""A run that fails says where, at what and why, and hands over what it had; so does Ctrl-C.

One file for all kinds of failures, since all are asked for the same: time, step, name and what is
left.
"""

import os
import re
import signal
import subprocess
import sys
import time
from functools import cache

import casadi as ca
import numpy as np
import pytest
from plain_spark import Plain, gauss
from registry import printed, top, top_lagrangian

import liouville as lv
from liouville import problems
from liouville._bridges.functions import run_function
from liouville._runs.runner import Request
from liouville.analysis import convergence

MODULE = sys.modules["liouville._runs.execute"]

H = 1 / 64  # times are exact, so that t = 1 is met to the bit


def kinetic(t, q, v, params):
    return ca.dot(v, v) / 2


def sliding(force=None, *, constraint=None, lagrangian=kinetic, q=("x", "y", "z"), **options):
    """Build a particle that slides along x."""
    return lv.Lagrangian(lagrangian, constraint, q=q, force=force, **options)


def root(t, q, v, params):
    return ca.sqrt(1 - t)


def ramps(t, q, params):
    """Two planes along x that coincide at x = 1."""
    return {"floor": q[2], "ramp": q[2] + (1 - q[0]) * q[1]}


ALONG_X = {"q": [0, 0, 0], "v": [1, 0, 0]}
TOWARDS_0 = {"q": [1, 0, 0], "v": [-1, 0, 0]}

# id, system, start, options, step, quantity, message: all go wrong at t = 1, or in the step after
FAILURES = [
    (
        "a root in the force",
        sliding(lambda t, q, v, params: [0, root(t, q, v, params), 0]),
        ALONG_X,
        {},
        64,
        "y",
        r"force of coordinate 'y' is not finite at t = 1\.00",
    ),
    (
        "a logarithm in the force",
        sliding(lambda t, q, v, params: [0, 0, ca.log(q[0])]),
        TOWARDS_0,
        {},
        None,  # at 0 or a rounding beside it
        "z",
        r"force of coordinate 'z' is not finite at t = 1(\.00\d+)?\n",
    ),
    (
        "a root in the potential",
        sliding(lagrangian=lambda t, q, v, params: ca.dot(v, v) / 2 - ca.sqrt(1 - q[0]) ** 3),
        ALONG_X,
        {},
        None,
        "x",
        "force of coordinate 'x' is not finite",
    ),
    (
        "a constraint that ends",
        sliding(constraint=lambda t, q, params: {"rail": q[1] - ca.sqrt(1 - t)}),
        {"q": [0, 1, 0], "v": [1, -0.5, 0]},
        {},
        63,
        "rail",
        "hidden constraint 'rail' is not finite at t = 1\n",
    ),
    (
        "an observable",
        sliding(),
        ALONG_X,
        {"observe": {"speed": kinetic, "depth": root}},
        64,
        "depth",
        r"observed 'depth' is not finite at t = 1\.01",
    ),
    (
        "an observable without states",
        sliding(),
        ALONG_X,
        {"observe": {"both": lambda *args: [1, root(*args)]}, "states": False},
        64,
        "both",
        "observed 'both' is not finite",
    ),
    (
        "an invariant",
        sliding(invariants={"my root": root}),
        ALONG_X,
        {},
        64,
        "my root",
        "invariant 'my root' is not finite",
    ),
    (
        "a mass that is used up",
        sliding(lagrangian=lambda t, q, v, params: v[0] ** 2 + (1 - t) * v[1] ** 2 + v[2] ** 2),
        ALONG_X,
        {},
        63,
        "y",
        "(?s)mass matrix is singular: coordinate 'y' has no inertia.*give 'y' a mass",
    ),
    (
        "a mass lost to another",
        sliding(lagrangian=lambda t, q, v, params: ca.dot(v, v) / 2 + t * v[0] * v[1]),
        {"q": [0, 0, 0], "v": [0, 0, 1]},
        {},
        63,
        "y",
        "mass matrix is singular",
    ),
    (
        "two constraints become one",
        sliding(constraint=ramps),
        ALONG_X,
        {},
        63,
        "floor",
        "(?s)constraints 'floor' and 'ramp' are redundant.*singular position",
    ),
    (
        "a gradient vanishes",
        sliding(constraint=lambda t, q, params: {"wedge": (1 - q[0]) * q[1]}),
        ALONG_X,
        {},
        63,
        "wedge",
        "gradient of constraint 'wedge' vanishes",
    ),
    (
        "the tangent of a circle",
        sliding(
            constraint=lambda t, q, params: {
                "circle": (ca.sumsqr(q[:2]) - 1) / 2,
                "line": q[1] + 1 - (1 - t) ** 2 * q[2],
            }
        ),
        {"q": [0, -1, 0], "v": [0, 0, 0]},
        {},
        63,
        "circle",
        "constraints 'circle' and 'line' are redundant",
    ),
]


def arrays(solution):
    """Return every array of a solution by name."""
    groups = {
        "states": solution.states,
        "invariants": solution.invariants,
        "residuals": solution.residuals,
        "observed": solution.observed,
    }
    inside = {f"{group} {k}": x for group, parts in groups.items() for k, x in parts.items()}
    return {"t": solution.t, **inside}


def assert_same_bits(one, two):
    one, two = arrays(one), arrays(two)
    assert one.keys() == two.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], two[name], err_msg=name)


@pytest.mark.parametrize("solver", ["auto", "newton"])
@pytest.mark.parametrize(
    ("system", "start", "options", "step", "quantity", "message"),
    [pytest.param(*row, id=name) for name, *row in FAILURES],
)
def test_a_failure_says_where_at_what_and_why(
    system, start, options, step, quantity, message, solver
):
    method = lv.Spark(3, solver)
    with pytest.raises(lv.IntegrationError, match=message) as caught:
        lv.integrate(system, method, t=(0, 2), h=H, **start, **options)
    error, solution = caught.value, caught.value.solution
    assert step in (error.step, None)
    assert error.quantity == quantity
    assert error.t == error.step * H == solution.t[-1]
    assert f"step {error.step} of 128 at t = {error.t:.6g} failed" in str(error)
    assert "\nhint: " in str(error)
    assert (solution.status, solution.message) == ("failed", str(error))
    assert solution.stats["steps"] == error.step
    until = lv.integrate(system, method, t=(0, error.t), steps=error.step, **start, **options)
    assert_same_bits(solution, until)
    assert all(np.isfinite(values).all() for values in arrays(solution).values())


def test_a_failure_in_the_first_step_keeps_the_start():
    system = sliding(lambda t, q, v, params: [0, ca.sqrt(-t), 0])
    with pytest.raises(lv.IntegrationError, match="step 0 of 128") as caught:
        lv.integrate(system, lv.Spark(3), t=(0, 2), h=H, **ALONG_X)
    np.testing.assert_array_equal(caught.value.solution.q, [ALONG_X["q"]])


def test_a_failure_at_the_start_keeps_nothing():
    with pytest.raises(lv.IntegrationError, match="the start at t = 0 cannot") as caught:
        lv.integrate(
            sliding(), lv.Spark(3), t=(0, 2), h=H, observe={"a": lambda t, *_: 1 / t}, **ALONG_X
        )
    error = caught.value
    assert (error.t, error.step, error.quantity) == (0, 0, "a")
    assert error.solution.q.shape == (0, 3)
    assert "nothing computed" in repr(error.solution)


def test_thinned_output_of_a_failure_is_thinned():
    system = sliding(lambda t, q, v, params: [0, root(t, q, v, params), 0])
    with pytest.raises(lv.IntegrationError) as caught:
        lv.integrate(system, lv.Spark(3), t=(0, 2), h=H, every=16, **ALONG_X)
    np.testing.assert_array_equal(caught.value.solution.t, [0, 0.25, 0.5, 0.75, 1])


def test_a_driven_mechanism_stops_at_its_dead_point():
    # crank and rod of equal length: upright, the slider may go anywhere
    driven = lv.Lagrangian(
        kinetic,
        lambda t, q, params: {
            "drive": q[0] - ca.pi / 2 * t,
            "rod": ((q[1] - ca.cos(q[0])) ** 2 + ca.sin(q[0]) ** 2 - 1) / 2,
        },
        q=("crank", "slider"),
    )
    for stages in (1, 2, 3, 4):
        with pytest.raises(lv.IntegrationError) as caught:
            lv.integrate(driven, lv.Spark(stages), t=(0, 2), h=H, q=[0, 2], v=[np.pi / 2, 0])
        assert 0.95 < caught.value.t <= 1
        assert "the gradient of constraint 'rod' nearly vanishes there" in str(caught.value)
        assert "smaller" not in str(caught.value)


def test_a_free_mechanism_passes_its_dead_point_by():
    free = lv.Lagrangian(
        kinetic,
        lambda t, q, params: {
            "crank": (ca.sumsqr(q[:2]) - 1) / 2,
            "rod": ((q[2] - q[0]) ** 2 + q[1] ** 2 - 1) / 2,
        },
        q=("x", "y", "slider"),
    )
    turn = lv.integrate(free, lv.Spark(4), t=(0, 4), h=H, q=[1, 0, 2], v=[0, 1, 0])
    assert turn.q[:, 2].min() < -1.2
    np.testing.assert_allclose(turn.q[:, 2], 2 * turn.q[:, 0], rtol=0, atol=1e-10)
    assert turn.invariant_drift("energy").max() < 1e-9
    with pytest.raises(lv.IntegrationError, match="'crank' and 'rod' are redundant"):
        lv.integrate(free, lv.Spark(4), t=(0, 4), h=H, q=[0, 1, 0], v=[-1, 0, -2])


def spinning():
    """Return a pendulum without gravity that turns once in 2 pi."""
    pendulum = lv.Lagrangian(kinetic, lambda t, q, params: (ca.dot(q, q) - 1) / 2, q=2)
    return pendulum, {"q": [1, 0], "v": [0, 1]}


# Steps of the top and of a pendulum at unit speed where the branch of solutions ends.
FOLDS = {1: 0.2523, 2: 0.6949, 3: 0.8796}
TURNS = {1: 1.0, 2: 2.745, 3: 3.348}


def as_far_as_it_goes(*args, **options):
    """Return the solution and None, or what a failing run had done and its error."""
    try:
        return lv.integrate(*args, **options), None
    except lv.IntegrationError as error:
        return error.solution, error


@pytest.mark.parametrize("solver", ["auto", "newton"])
@pytest.mark.parametrize("stages", FOLDS)
def test_a_step_too_large_is_refused_and_never_answered_wrongly(stages, solver):
    y0, z0 = printed("heavy_top_quaternion", "y0", "z0")
    plain = Plain.lagrangian(4, top_lagrangian, lambda t, q: (ca.dot(q, q) - 1) / 2)
    fold, system = FOLDS[stages], top()
    below = np.linspace(0.3, 0.995, 8) * fold
    branch = plain.branch(gauss(stages), y0, z0, below)
    for h, true in zip(below, branch, strict=True):
        one = {"t": (0, h), "steps": 1, "q": y0, "v": z0}
        made = lv.integrate(system, lv.Spark(stages, solver), **one).q[-1]
        np.testing.assert_allclose(made, true, rtol=0, atol=1e-12)
    for h in np.linspace(1.001, 2.5, 8) * fold:
        one = {"t": (0, h), "steps": 1, "q": y0, "v": z0}
        with pytest.raises(lv.IntegrationError, match="take h below") as caught:
            lv.integrate(system, lv.Spark(stages, solver), **one)
        assert caught.value.quantity in ("q0", "q1", "q2", "q3")
        found = re.search(r"up to h = (\S+)\n", str(caught.value))
        assert 0.6 * fold < float(found[1]) < 1.001 * fold
    back = {"t": (0, -1.5 * fold), "steps": 1, "q": y0, "v": -np.array(z0)}
    with pytest.raises(lv.IntegrationError, match=r"up to h = -\S+\nhint: take \|h\| below [0-9]"):
        lv.integrate(system, lv.Spark(stages, solver), **back)


def bursting(t, q, v, params):
    """Drive x = 1 / (1 - t)^2."""
    return [6 * q[0] ** 2]


@pytest.mark.parametrize(
    ("force", "options", "quantity", "message", "reached"),
    [
        (bursting, {}, "step", r"asks for a step of .*less than h_min\nhint: .*h_min", 1e-3),
        (bursting, {"control": lv.Adaptive(1e-3)}, "step", r"less than h_min\nhint: ", 0.5),
        (
            lambda t, q, v, params: [root(t, q, v, params)],
            {},
            "x",
            r"force of coordinate 'x' is not finite at t = 1.*\nhint: look for",
            1e-3,
        ),
    ],
    ids=["blow-up", "a large h_min", "a root"],
)
def test_controlled_steps_go_as_far_as_they_can(force, options, quantity, message, reached):
    system = sliding(force, q=("x",))
    span = {"t": (0, 2), "rtol": 1e-6, **options}
    with pytest.raises(lv.IntegrationError, match=message) as caught:
        lv.integrate(system, lv.HHT(), **span, q=[1], v=[2])
    error, kept = caught.value, caught.value.solution
    assert (error.quantity, error.step) == (quantity, len(kept.t) - 1)
    assert "step " in str(error)
    assert " of " not in str(error).split("failed")[0]
    assert error.t == kept.t[-1]
    assert 1 - reached < kept.t[-1] < 1 + 1e-3
    assert kept.status == "failed"
    assert kept.tolerances["rtol"] == 1e-6
    if force is bursting:
        far = kept.t < 0.9
        np.testing.assert_allclose(kept.q[far, 0], (1 - kept.t[far]) ** -2, rtol=1e-3)


@pytest.mark.parametrize("method", [lv.HHT(), lv.GeneralizedAlpha(0.5, less_implicit=True)])
def test_a_run_goes_on_from_its_end(method):
    wire = problems.load("moving_wire")
    whole = lv.integrate(wire.system, method, t=(0, 2), steps=200, **wire.start)
    half = lv.integrate(wire.system, method, t=(0, 1), steps=100, **wire.start)
    begin = {"t": (1, 2), "steps": 100, "q": half.q[-1], "v": half.v[-1]}
    rest = lv.integrate(wire.system, method, **begin, a=half.a[-1])
    other = lv.integrate(wire.system, method, **begin)
    for name, values in whole.states.items():
        np.testing.assert_allclose(rest.states[name], values[100:], atol=1e-10, err_msg=name)
    assert np.abs(other.q[-1] - whole.q[-1]).max() > 1e-8
    np.testing.assert_allclose(half.work[-1] + rest.work, whole.work[100:], atol=1e-10)


def test_progress_of_controlled_steps_goes_by_time(monkeypatch):
    monkeypatch.setattr(MODULE, "SLICE", 0.0)  # a step
    pendulum, start = spinning()
    seen = []

    def look(*progress):
        if progress[0] > 0:  # not while the steps are still tried
            seen.append(progress)
        if len(seen) == 3:
            signal.raise_signal(signal.SIGINT)

    solution = lv.integrate(
        pendulum, lv.HHT(), t=(10, -1e6), rtol=1e-4, every=1000, progress=look, **start
    )
    done, total = np.transpose(seen)
    assert np.all(total == 10 + 1e6)
    assert np.all(np.diff(done) > 0)
    assert solution.status == "interrupted"
    assert solution.message == f"interrupted after {solution.stats['steps']} steps"
    assert 10 - solution.t[-1] >= done[-1] > 0 > solution.h


def test_a_run_stops_before_its_states_fill_the_memory(monkeypatch):
    monkeypatch.setattr(MODULE, "SLICE", 0.0)  # a step
    monkeypatch.setattr(MODULE, "memory", lambda: 1e5)
    pendulum, start = spinning()
    with pytest.raises(lv.IntegrationError, match=r"not fit in memory\nhint: .*every=") as caught:
        lv.integrate(pendulum, lv.HHT(), t=(0, 1e9), rtol=1e-4, **start)
    assert len(caught.value.solution.t) > 500


@pytest.mark.parametrize("stages", TURNS)
def test_no_step_of_a_fast_pendulum_lands_on_another_motion(stages):
    pendulum, start = spinning()
    plain = Plain.lagrangian(
        2, lambda t, q, v: ca.dot(v, v) / 2, lambda t, q: (ca.dot(q, q) - 1) / 2
    )
    steps = np.linspace(0.2, 0.99, 20) * TURNS[stages]
    branch = plain.branch(gauss(stages), np.array([1.0, 0]), np.array([0, 1.0]), steps)
    for h, true in zip(steps, branch, strict=True):
        made = lv.integrate(pendulum, lv.Spark(stages), t=(0, 5 * h), steps=5, **start)
        z = made.q @ [1, 1j]
        np.testing.assert_allclose(z[1:] / z[:-1], true @ [1, 1j], rtol=0, atol=1e-11)
    for h in np.linspace(1.01 * TURNS[stages], 7, 20):
        with pytest.raises(lv.IntegrationError):
            lv.integrate(pendulum, lv.Spark(stages), t=(0, h), steps=1, **start)


def test_node_schur_gives_up_where_auto_goes_on():
    stiff = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.k / 2 * q[0] ** 2 - q[1],
        lambda t, q, params: (ca.dot(q, q) - 1) / 2,
        q=("x", "y"),
        params={"k": 1e4},
    )
    swing = {"t": (0, 2), "h": 0.05, "q": [0.6e-3, -np.sqrt(1 - 0.6e-3**2)], "v": [0, 0]}
    with pytest.raises(lv.IntegrationError, match=r"(?s)did not converge.*solver='auto'"):
        lv.integrate(stiff, lv.Spark(3, "node-schur"), **swing)
    solution = lv.integrate(stiff, lv.Spark(3, "auto"), **swing)
    assert solution.stats["solver"] == "newton"
    assert solution.invariant_drift("energy").max() < 1e-6
    soft = lv.integrate(stiff, lv.Spark(3, "auto"), params={"k": 1.0}, **swing)
    assert soft.stats["solver"] == "node-schur"


def test_an_interrupt_returns_what_was_done():
    pendulum, start = spinning()

    def interrupt(done, total):
        signal.raise_signal(signal.SIGINT)

    method = lv.Spark(3, newton_tol=1e-20)  # the same for runs of any length
    solution = lv.integrate(
        pendulum, method, t=(0, 2**20), h=H, every=256, progress=interrupt, **start
    )
    steps = solution.stats["steps"]
    assert solution.status == "interrupted"
    assert solution.message == f"interrupted after {steps} of {2**26} steps"
    assert 0 < steps < 2**26
    kept = steps // 256
    assert kept > 0
    until = lv.integrate(pendulum, method, t=(0, 4.0 * kept), h=H, every=256, **start)
    cut = {name: values[: kept + 1] for name, values in arrays(solution).items()}
    for name, values in arrays(until).items():
        np.testing.assert_array_equal(cut[name], values, err_msg=name)


@cache
def pendulum_data():
    pendulum = problems.load("pendulum")
    made = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), steps=50, **pendulum.start)
    return {"t": made.t[::10], "q": made.q[::10] + 0.01}


def within(name, method, function, **more):
    problem = problems.load(name)
    return function(problem.system, method, t=(0, 1), **more, **problem.start)


def study(system, method, *, t, **start):
    return convergence.study(system, method, t, [0.1, 0.05, 0.02], start)


def fit(system, method, *, t, **start):
    return lv.fit(system, method, pendulum_data(), h=0.02, free=("v",), t0=t[0], **start)


def bridge(system, method, *, t, **start):
    request = Request(t=t, steps=20, start={"q": start["q"]}, has_pullback=True)
    at = run_function(system, method, ["v"], None, request).at([np.array(start["v"])])
    return at.pushed([np.ones((1, 2))])


def optimum(system, method, *, t, **start):
    found = lv.optimal_control(
        system, method, t=t, steps=5, controls=("g",), cost=lambda t, q, v, params: params.g**2,
        final={"q": [0.0, -1.0]}, **start
    )  # fmt: skip
    return found.solution


def pulled(system, method, *, t, **start):
    both = {name: np.array([x, x]) for name, x in start.items()}
    run = {"t": t, "steps": 300, "every": 300, "threads": 1}  # too many to go without checkpoints
    solution, pullback = lv.vjp(system, method, wrt=["v"], **run, **both)
    return pullback(q=np.ones_like(solution.q))


#: Computations made of runs.
COMPUTATIONS = {
    "exponents": lambda: within("pendulum", lv.Spark(2), lv.analysis.lyapunov, h=0.01, every=20),
    "exponents of a field": lambda: within(
        "abc_flow", lv.VolumeSplitting(), lv.analysis.lyapunov, h=0.01, every=20
    ),
    "fit": lambda: within("pendulum", lv.Spark(2), fit),
    "study": lambda: within("pendulum", lv.Spark(2), study),
    "trial runs": lambda: within("abc_flow", lv.VolumeSplitting(), lv.integrate, rtol=1e-6),
    "optimum": lambda: within("pendulum", lv.Spark(2), optimum),
    "derivatives for other libraries": lambda: within("pendulum", lv.Spark(2), bridge),
    "gradient": lambda: within(
        "pendulum", lv.Spark(2), lv.analysis.check_gradient, steps=20, wrt=["v"]
    ),
    "gradient of a field": lambda: within(
        "abc_flow", lv.VolumeSplitting(), lv.analysis.check_gradient, steps=20, wrt=["x"]
    ),
    "gradients of members": lambda: within("pendulum", lv.HHT(), pulled),
    "gradients of waves": lambda: lv.analysis.check_gradient(
        lv.Schrodinger(lv.Lattice(4)), lv.Chebyshev(), t=(0, 1), psi=np.eye(2, 4), wrt=["psi"]
    ),
}


@pytest.mark.parametrize("name", COMPUTATIONS)
def test_a_computation_goes_on_from_no_run_that_was_cut_short(name, monkeypatch):
    """However far it is: it is interrupted as a whole, or returns its own run as such."""
    advance, calls, last = MODULE.advance_slice, [], [0]

    def advance_slice(*given):
        calls.append(1)
        if len(calls) == last[0]:
            signal.raise_signal(signal.SIGINT)
        return advance(*given)

    pendulum_data()
    monkeypatch.setattr(MODULE, "SLICE", 0.0)  # a step: there are as many each time
    monkeypatch.setattr(MODULE, "advance_slice", advance_slice)
    COMPUTATIONS[name]()
    count, ended = len(calls), 0
    for last[0] in {1, 2, count // 2, count - 1, count} & set(range(1, count + 1)):
        calls.clear()
        try:
            found = COMPUTATIONS[name]()
            assert found.status == "interrupted"
        except lv.IntegrationError as error:
            assert error.solution.status == "interrupted"  # noqa: PT017
        except KeyboardInterrupt:
            ended += 1
    assert ended


CHILD = """
import signal
from test_failures import lv, spinning
signal.signal(signal.SIGINT, signal.default_int_handler)
pendulum, start = spinning()
solution = lv.integrate(
    pendulum, lv.Spark(3), t=(0, 1e9), h=0.01, every=1000,
    progress=lambda done, total: print(flush=True), **start,
)
print(solution.status, len(solution.t))
"""


@pytest.mark.skipif(os.name != "posix", reason="sends a signal to a process")
def test_ctrl_c_from_outside_ends_a_run_that_would_take_days():
    command = [sys.executable, "-c", CHILD]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=os.path.dirname(__file__)
    ) as child:
        child.stdout.readline()  # it is running
        child.send_signal(signal.SIGINT)
        status, kept = child.stdout.read().split()
    assert status == "interrupted"
    assert int(kept) > 1


def test_the_last_good_state_is_kept_however_thin_the_output():
    pendulum, start = spinning()
    bursting = lv.Lagrangian(
        kinetic,
        lambda t, q, params: (ca.dot(q, q) - 1) / 2,
        q=2,
        force=lambda t, q, v, params: ca.vertcat(1e-30 * ca.sqrt(1 - t), 0),
    )
    every_step = lv.integrate(pendulum, lv.Spark(2), t=(0, 1), steps=10, **start)
    with pytest.raises(lv.IntegrationError, match="force") as caught:
        lv.integrate(bursting, lv.Spark(2), t=(0, 2), h=0.1, every=1000, **start)
    kept = caught.value.solution
    assert kept.stats["steps"] == caught.value.step == round(10 * kept.t[-1])
    np.testing.assert_allclose(kept.t, [0, caught.value.step / 10], rtol=1e-15)
    np.testing.assert_allclose(kept.q[-1], every_step.q[caught.value.step], rtol=0, atol=1e-14)


def long_runs():
    chain = np.zeros(2**12, dtype=complex)
    chain[5] = 1.0
    wave = lv.Schrodinger((2**12, lambda x: 2 * x - np.roll(x, 1) - np.roll(x, -1)), bounds=(0, 4))
    swing, turn = problems.load("pendulum"), problems.load("euler_top")
    steps = {"t": (0, 1e5), "steps": 10**8, "every": 10**7}
    x = np.tile(turn.start["x"], (3, 1))
    return {
        "mechanics": lambda: lv.integrate(swing.system, lv.Spark(2), **steps, **swing.start),
        "field": lambda: lv.integrate(turn.system, lv.VolumeSplitting(), **steps, **turn.start),
        "members": lambda: lv.ensemble(turn.system, lv.VolumeSplitting(), **steps, x=x),
        "wave": lambda: lv.integrate(wave, lv.Chebyshev(1e-6), t=(0, 1e4), psi=chain),
        "pullback": lambda: lv.vjp(
            swing.system, lv.Spark(2), wrt=["v"], **steps, **swing.start
        ),
        "section": lambda: lv.section(
            turn.system, lv.VolumeSplitting(), plane=turn.system.coordinates[0], t=(0, 1e6),
            h=0.001, x=x,
        ),
        "tracing": lambda: lv.Lagrangian(lambda t, q, v, params: time.sleep(5), q=1),
    }  # fmt: skip


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there are no alarms")
@pytest.mark.parametrize("name", long_runs())
def test_an_exception_of_a_signal_handler_is_raised_as_it_is(name):
    alarm = TimeoutError("time is over")

    def handler(number, frame):
        raise alarm

    before = signal.signal(signal.SIGALRM, handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(TimeoutError) as raised:
            long_runs()[name]()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert raised.value is alarm
    assert not hasattr(alarm, "__notes__")


STICKS = lv.Lagrangian(
    lambda t, q, v, p: (v[0] ** 2 - q[0] ** 2) / 2,
    force=lambda t, q, v, p: -p.mu * ca.sign(v[0]), q=("x",), params={"mu": 0.5},
)  # fmt: skip


@pytest.mark.parametrize(
    "method", [lv.Spark(2), lv.Spark(2, solver="node-schur"), lv.LobattoPair(2), lv.HHT()], ids=str
)
@pytest.mark.parametrize("x", [0.2, 1.0], ids=["from rest", "later"])
def test_friction_that_sticks_is_named_with_what_takes_it(method, x):
    """A smaller h does not help a block that its friction holds."""
    for more in ({}, {"states": False}, {"every": 1000}, {"t_eval": [4.9], "states": False}):
        with pytest.raises(lv.IntegrationError) as caught:
            lv.integrate(STICKS, method, t=(0, 5), h=0.05, q=[x], v=[0.0], **more)
        said = str(caught.value)
        assert "the equations jump with 'sign(v[0])' near there\nhint: friction that sticks" in said
        assert "lv.Contact" in said
        assert "smaller h" not in said
        assert "solver='auto'" not in said


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
@pytest.mark.parametrize(
    "method",
    [lv.Spark(1), lv.Spark(2), lv.Spark(3, points="radau"), lv.LobattoPair(3), lv.HHT()],
    ids=str,
)
def test_controlled_steps_that_creep_where_friction_sticks_are_given_up(method, rtol):
    """They would be some ten million; those of before are kept."""
    run = {"t": (0, 5), "rtol": rtol, "q": [0.2], "v": [1.0]}
    for more in ({}, {"t_eval": [0.1, 4.0]}, {"states": False}, {"every": 1000, "states": False}):
        with pytest.raises(lv.IntegrationError) as caught:
            lv.integrate(STICKS, method, **run, **more)
        assert 4.07 < caught.value.t < 4.2
        said = str(caught.value)
        assert "shrunk" in said or "jump with 'sign(v[0])' near there\nhint: friction" in said
        end = 4.0 if "t_eval" in more else pytest.approx(caught.value.t)
        assert caught.value.solution.t[-1] == end


def test_short_steps_beside_a_jump_that_does_not_matter_go_on():
    """A fast part needs short steps behind a long one, for longer than runs are looked at."""
    system = lv.Lagrangian(
        lambda t, q, v, p: ca.sumsqr(v) / 2 - 1e11 * q[0] ** 2,
        force=lambda t, q, v, p: ca.vertcat(0, -ca.sign(v[1])), q=2,
    )  # fmt: skip
    kick = lv.Event(lambda t, *_: t - 0.5, reset=lambda t, q, v, *_: {"v": [1.0, 0.0]})
    start = {"q": [0, 0], "v": [0, 0]}
    run = lv.integrate(
        system, lv.Spark(3), t=(0, 0.6), rtol=1e-6, atol=1e-12, events={"kick": kick}, **start
    )
    assert run.stats["steps"] > 50000
    assert run.stats["h_largest"] > 1e4 * run.h


def test_a_jump_far_from_a_step_that_fails_is_not_named():
    system = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2 - 1e6 * ca.cos(q[0]),
        force=lambda t, q, v, p: ca.sign(v[0] - 1e9), q=1,
    )  # fmt: skip
    with pytest.raises(lv.IntegrationError) as caught:
        lv.integrate(system, lv.Spark(2), t=(0, 5), h=0.05, q=[0.3], v=[1.0])
    assert "jump" not in str(caught.value)
