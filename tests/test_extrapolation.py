"""Richardson extrapolation of whole runs: orders, estimates, constraints."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville import problems

SPRING = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0] ** 2 / 2, q=("x",))
PENDULUM = problems.load("pendulum")
#: A rod that is twice as heavy as its mass, on a support that moves: time is in the constraint.
MOVING = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, v) / 2 - q[1],
    lambda t, q, params: (ca.sumsqr(q - ca.vertcat(ca.sin(t) / 4, 0)) - 1) / 2,
    q=("x", "y"),
)


@pytest.mark.parametrize(
    ("method", "wanted"),
    [
        (lv.HHT(), (3, 4)),
        (lv.Spark(1), (4, 6)),
        (lv.Spark(2), (6, 8)),
        (lv.LobattoPair(2), (4, 6)),
        (lv.LobattoPair(3), (6, 8)),
        (lv.Spark(2, points="radau"), (4, 5)),
        (lv.Composition(lv.Spark(1), "Y4"), (6, 8)),
    ],
    ids=repr,
)
def test_each_level_gains_the_order_that_the_symmetry_promises(method, wanted):
    exact, start = np.array([np.cos(6), -np.sin(6)]), {"q": [1.0], "v": [0.0]}
    for levels, least in zip((2, 3), wanted, strict=True):
        runs = [
            lv.analysis.extrapolate(SPRING, method, t=(0, 6), steps=n, levels=levels, **start)
            for n in (8, 16, 32, 64)
        ]
        errors = [np.linalg.norm(np.append(run.q[-1], run.v[-1]) - exact) for run in runs]
        coarse, fine = [pair for pair in pairwise(errors) if pair[1] > 1e-12][-1]
        assert np.log2(coarse / fine) > least - 0.35


@pytest.mark.parametrize(
    ("problem", "method", "steps"),
    [
        ("andrews", lv.HHT(-0.1), 500),
        ("andrews", lv.GeneralizedAlpha(0.8), 500),
        ("car_axis", lv.Spark(2), 300),
    ],
)
def test_constraints_hold_and_the_estimate_is_the_error_of_the_finest_run(problem, method, steps):
    problem = problems.load(problem)
    (end, reference), options = list(problem.reference.items())[-1], {"steps": steps, "every": 50}
    span = (problem.interval[0], end)
    best = lv.analysis.extrapolate(problem.system, method, t=span, **options, **problem.start)
    plain = lv.analysis.extrapolate(
        problem.system, method, t=span, error=True, **options, **problem.start
    )
    errors = [np.abs(run.q[-1] - reference["q"]).max() for run in (best, plain)]
    assert errors[0] < errors[1] / 20
    assert 0.8 < plain.error["q"][-1].max() / errors[1] < 1.25
    assert best.residuals["constraint"].max() < 1e-14 * max(1, abs(best.q).max())
    assert best.residuals["hidden"].max() < 1e-13 * abs(best.v).max()
    assert best.t.shape == plain.t.shape == (steps // 50 + 1,)


def test_multipliers_are_those_of_the_extrapolated_states():
    exact = lv.integrate(PENDULUM.system, lv.Spark(8), t=(0, 1), steps=40, **PENDULUM.start)
    options = {"t": (0, 1), "steps": 160, "every": 4, "levels": 3}
    found = lv.analysis.extrapolate(PENDULUM.system, lv.HHT(), **options, **PENDULUM.start)
    for name, most in (("q", 1e-8), ("v", 1e-8), ("lam", 1e-7), ("p", 1e-8)):
        gap = np.abs(found.states[name] - exact.states[name]).max()
        assert gap < most * max(1, np.abs(exact.states[name]).max()), name
    assert found.invariant_drift("energy").max() < 1e-7


@pytest.mark.parametrize("method", [lv.HHT(), lv.Spark(2), lv.ArnoldBruls()], ids=repr)
def test_time_in_the_model_and_in_what_is_observed_is_that_of_each_record(method):
    start = MOVING.consistent(q=[0.6, -0.8], v=[0, 0])
    options = {"t": (0, 2), "observe": {"support": lambda t, q, v, params: ca.sin(t) / 4}}
    exact = lv.integrate(MOVING, lv.Spark(7), steps=20, **options, **start)
    found = lv.analysis.extrapolate(
        MOVING, method, steps=100, every=5, levels=3, **options, **start
    )
    np.testing.assert_allclose(found.t, exact.t)
    np.testing.assert_allclose(found.q, exact.q, atol=2e-6)
    np.testing.assert_allclose(found.observed["support"], exact.observed["support"], atol=1e-15)
    assert found.residuals["constraint"].max() < 1e-15


def test_redundant_constraints_and_a_hamiltonian_are_extrapolated_backwards_too():
    rod = problems.load("doubled_rod")
    back = lv.analysis.extrapolate(rod.system, lv.Spark(2), t=(0.4, 0), steps=20, **rod.start)
    exact = lv.integrate(rod.system, lv.Spark(7), t=(0.4, 0), steps=20, **rod.start)
    np.testing.assert_allclose(back.q, exact.q, atol=1e-8)
    np.testing.assert_allclose(back.lam, exact.lam, atol=1e-6)
    oscillator = lv.Hamiltonian(lambda t, q, p, params: (p[0] ** 2 + q[0] ** 2) / 2, q=1)
    found = lv.analysis.extrapolate(oscillator, lv.Spark(2), t=(0, 1), h=0.1, q=[1.0], p=[0.0])
    assert abs(found.p[-1, 0] + np.sin(1)) < 1e-9
    assert set(found.error) == {"q", "p"}


def test_a_part_of_it_has_its_estimates_and_sums_of_all_runs_are_counted():
    found = lv.analysis.extrapolate(
        SPRING, lv.HHT(), t=(0, 1), steps=10, levels=3, q=[1.0], v=[0.0]
    )
    assert found.stats["steps"] == 70
    assert found.sel(time=slice(0.5, 1)).error["q"].shape == (6, 1)
    assert "3 runs, extrapolated" in repr(found)
    with pytest.raises(ValueError, match="read-only"):
        found.error["q"][0] = 0


def test_what_cannot_be_extrapolated_is_refused():
    start = {"t": (0, 1), "h": 0.1, "q": [1.0], "v": [0.0]}
    with pytest.raises(ValueError, match="levels must be a number of runs, two or more, not 1"):
        lv.analysis.extrapolate(SPRING, lv.HHT(), levels=1, **start)
    field = problems.load("abc_flow")
    with pytest.raises(
        TypeError, match=r"must be for mechanical systems.*\nhint: a field takes rtol="
    ):
        lv.analysis.extrapolate(field.system, lv.VolumeSplitting(), t=(0, 1), h=0.1, **field.start)
    with pytest.raises(lv.IntegrationError, match="step 0 of 1"):
        lv.analysis.extrapolate(PENDULUM.system, lv.Spark(2), t=(0, 1e3), steps=1, **PENDULUM.start)


def test_methods_are_named_and_options_of_other_runs_refused():
    """Runs of steps by errors, or that events end, cannot be combined."""
    call = {"t": (0, 1), "h": 0.1, "q": [1.0], "v": [0.0]}
    for name, method in (("hht", lv.HHT()), ("auto", lv.Spark(3))):
        found = lv.analysis.extrapolate(SPRING, name, **call)
        np.testing.assert_array_equal(found.q, lv.analysis.extrapolate(SPRING, method, **call).q)
    for option in ("events", "rtol", "tangents", "t_eval"):
        with pytest.raises(TypeError, match=f"extrapolate takes no {option}=\nhint: "):
            lv.analysis.extrapolate(SPRING, lv.HHT(), **call, **{option: 1e-6})
