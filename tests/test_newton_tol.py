"""Stage equations solved to a tolerance: what it saves and costs; constraints hold all the same."""

from itertools import pairwise

import numpy as np
import pytest

import liouville as lv
from liouville.problems import (
    andrews,
    car_axis,
    chain,
    chaplygin_sleigh,
    heavy_top,
    pendulum,
    relativistic_particle,
    slider_crank,
)

CASES = {
    "node Schur": (car_axis, lv.Spark, {"stages": 6}, 0.04, 30),
    "sparse Schur": (chain, lv.Spark, {"stages": 4}, 0.05, 30),
    "Newton": (heavy_top, lv.Spark, {"stages": 4}, 0.01, 30),
    "sparse Newton": (chain, lv.Spark, {"stages": 4, "solver": "newton"}, 0.05, 10),
    "nonholonomic": (chaplygin_sleigh, lv.Spark, {"stages": 3}, 0.1, 30),
    "pair": (car_axis, lv.LobattoPair, {"stages": 5}, 0.02, 30),
    "not linear": (relativistic_particle, lv.Spark, {"stages": 3}, 0.1, 30),
}


@pytest.mark.parametrize("name", CASES)
def test_fewer_corrections_and_errors_below_the_tolerance(name):
    problem, method, options, h, steps = CASES[name]

    def run(tolerance):
        chosen = method(**options, newton_tol=tolerance)
        return lv.integrate(problem.system, chosen, t=(0, steps * h), steps=steps, **problem.start)

    whole = run(None)
    size = np.abs(whole.q).max()
    corrections = [whole.stats["iterations"]]
    for tolerance in (1e-11, 1e-8, 1e-5):
        loose = run(tolerance)
        corrections.append(loose.stats["iterations"])
        residual = max(np.abs(x).max(initial=0.0) for x in loose.residuals.values())
        assert np.abs(loose.q - whole.q).max() < 1e3 * tolerance * size
        assert residual < 1e-13 * size
    # to roundoff another solver may have been the better choice
    assert corrections[1:] == sorted(corrections[1:], reverse=True)
    assert corrections[-1] <= max(0.75 * corrections[0], 2 * steps)


def test_what_is_below_roundoff_changes_nothing():
    same = [
        lv.integrate(
            car_axis.system, lv.Spark(4, newton_tol=tol), t=(0, 1), steps=50, **car_axis.start
        )
        for tol in (None, 0.03 * np.finfo(float).eps / 100)
    ]
    np.testing.assert_array_equal(same[0].q, same[1].q)


ALPHA = [lv.HHT, lv.GeneralizedAlpha, lv.ArnoldBruls]


@pytest.mark.parametrize("method", ALPHA)
@pytest.mark.parametrize("problem", [pendulum, slider_crank, andrews, chain])
def test_alpha_steps_take_fewer_corrections_and_keep_their_constraints(method, problem):
    def run(tolerance):
        chosen = method(newton_tol=tolerance)
        return lv.integrate(
            problem.system, chosen, t=(0, 50 * problem.h), h=problem.h, **problem.start
        )

    whole, loose = run(None), run(1e-7)
    size = np.abs(whole.q).max()
    assert loose.stats["iterations"] < 0.8 * whole.stats["iterations"]
    assert np.abs(loose.q - whole.q).max() < 1e-4 * size
    assert np.abs(loose.residuals["constraint"]).max() < 1e-15 * max(size, 1)
    if method is not lv.ArnoldBruls:  # whose hidden constraint is off by O(h^2)
        speed = np.abs(whole.v).max() + size / problem.h
        assert np.abs(loose.residuals["hidden"]).max() < 1e-14 * speed


@pytest.mark.parametrize("method", ALPHA)
def test_what_is_no_tolerance_is_refused_by_alpha_methods(method):
    with pytest.raises(ValueError, match=r"newton_tol must be above 0 and at most 0.01, not 0.5"):
        method(newton_tol=0.5)
    with pytest.raises(TypeError, match=r"newton_tol must be a float or None, not 'fine'"):
        method(newton_tol="fine")


PIECES = {pendulum: 5.0, heavy_top: 1.0, andrews: 0.03, car_axis: 3.0}


def controlled(problem, method, rtol, **more):
    call = {"t": (0, PIECES[problem]), "control": lv.Adaptive()} | problem.start | more
    return lv.integrate(problem.system, method, rtol=rtol, **call)


@pytest.mark.parametrize("problem", PIECES)
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_rtol_binds_the_equations(problem, rtol):
    exact = controlled(problem, lv.Spark(8), 1e-12).q[-1]
    bound = controlled(problem, lv.Spark(4), rtol)
    whole = controlled(problem, lv.Spark(4, newton_tol=1e-19), rtol)
    assert bound.stats["iterations"] < 0.8 * whole.stats["iterations"]
    assert np.abs(bound.q[-1] - exact).max() < 20 * rtol * np.abs(exact).max()
    assert np.abs(bound.residuals["constraint"]).max() < 1e-15
    assert np.abs(bound.residuals["hidden"]).max() < 1e-13


@pytest.mark.parametrize("problem", PIECES)
def test_no_tolerance_takes_more_corrections_than_a_tighter_one(problem):
    taken = [
        controlled(problem, lv.Spark(4), rtol).stats["iterations"]
        for rtol in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
    ]
    assert all(loose <= 1.15 * tight for loose, tight in pairwise(taken))


def test_runs_with_tangents_solve_their_equations_to_roundoff():
    plain = controlled(pendulum, lv.Spark(4), 1e-4)
    along = controlled(pendulum, lv.Spark(4), 1e-4, tangents={"q": [0.0, 0.0]})
    whole = controlled(pendulum, lv.Spark(4, newton_tol=1e-19), 1e-4)
    taken = [run.stats["iterations"] / run.stats["steps"] for run in (plain, along, whole)]
    assert taken[0] < 0.8 * taken[1]
    assert taken[1] > 0.9 * taken[2]
