"""Stage equations solved to a tolerance: what it saves and costs; constraints hold all the same."""

import numpy as np
import pytest

import liouville as lv
from liouville.problems import car_axis, chain, chaplygin_sleigh, heavy_top, relativistic_particle

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
