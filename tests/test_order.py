"""The measured order of every row of the registry, in every state and in the multipliers."""

import numpy as np
import pytest
from registry import PROBLEMS, ROWS

import liouville as lv
from liouville.convergence import study

CASES = [(row, name) for row in ROWS for name in row.on]


@pytest.fixture(scope="module")
def exact():
    """End states of each problem by a method of order 16, at roundoff."""

    def end(problem):
        solution = lv.integrate(problem.system, lv.Spark(8), t=problem.t, steps=64, **problem.start)
        return {name: solution.states[name][-1] for name in problem.of}

    return {name: end(problem) for name, problem in PROBLEMS.items()}


@pytest.mark.parametrize(("row", "name"), CASES, ids=lambda x: str(x))
def test_order_is_as_claimed(row, name, exact):
    problem = PROBLEMS[name]
    span = problem.t[1] - problem.t[0]
    hs = [span / steps for steps in problem.steps[row.method.stages - 1]]
    found = study(
        problem.system, row.method, problem.t, hs, problem.start, exact[name], of=problem.of
    )
    for state in problem.of:
        assert abs(found.order[state] - row.order) < 0.15, (state, found.errors[state])
        assert np.all(np.isfinite(found.errors[state]))


def test_a_force_taken_at_the_wrong_time_loses_the_order(exact):
    problem = PROBLEMS["moving wire"]
    late = {**exact["moving wire"]}
    shifted = lv.integrate(
        problem.system, lv.Spark(8), t=(0.0, 4.0 + 1e-3), steps=64, **problem.start
    )
    late["q"] = shifted.q[-1]
    hs = [4 / steps for steps in problem.steps[2]]
    found = study(problem.system, lv.Spark(3), problem.t, hs, problem.start, late, of=("q",))
    assert not abs(found.order["q"] - 6) < 0.15
