"""The measured order of every row of the registry, in every state and in the multipliers.

Errors are those of the end states. For the alpha methods, whose errors change sign along the way,
they are the largest at 32 points, and the order is found to 0.1 as Theorem 2 of Jay and Negrut
(2007) says it.
"""

import functools

import numpy as np
import pytest
from registry import ALL, ALPHA, BS, PROBLEMS, ROWS, SECOND_ORDER

import liouville as lv
from liouville.analysis.convergence import slope, study

CASES = [(row, name) for row in ROWS for name in row.on if row.order and row not in ALPHA]
EXTENDED = [(row.method, name) for row in ALPHA if row.keeps for name in row.on]
POINTS, SIZES = 32, (256, 512, 1024)


@functools.cache
def end(name):
    """Return the end states of a problem, exact or at roundoff."""
    return ALL[name].end()


def measured(found, state, order):
    """Return the order of a study, whose slope leaves out what falls more slowly than h."""
    if order > 1:
        return found.order[state]
    return np.polyfit(np.log(found.h), np.log(found.errors[state]), 1)[0]


@pytest.mark.parametrize(("row", "name"), CASES, ids=lambda x: str(x))
def test_order_is_as_claimed(row, name):
    problem, exact = ALL[name], end(name)
    of = [state for state in problem.of if not row.of or state in row.of]
    hs = [(problem.t[1] - problem.t[0]) / steps for steps in row.counts(problem)]
    found = study(
        problem.system, row.method, problem.t, hs, problem.start, exact, of, floor=problem.floor
    )
    for state in of:
        order = measured(found, state, row.order)
        assert abs(order - row.order) < row.room, (state, order, found.errors[state])


def test_a_force_taken_at_the_wrong_time_loses_the_order():
    problem = PROBLEMS["moving wire"]
    late = dict(end("moving wire"))
    shifted = lv.integrate(
        problem.system, lv.Spark(8), t=(0.0, 4.0 + 1e-3), steps=64, **problem.start
    )
    late["q"] = shifted.q[-1]
    hs = [4 / steps for steps in problem.steps[2]]
    found = study(problem.system, lv.Spark(3), problem.t, hs, problem.start, late, of=("q",))
    assert not abs(found.order["q"] - 6) < 0.15


@functools.cache
def along(name, backwards=False):
    """Return the exact motion at 32 points."""
    problem = PROBLEMS[name]
    t = problem.t[::-1] if backwards else problem.t
    start = problem.start
    if backwards:
        there = lv.integrate(problem.system, lv.Spark(8), t=problem.t, steps=64, **problem.start)
        start = {state: there.states[state][-1] for state in start}
    found = lv.integrate(problem.system, lv.Spark(8), t=t, steps=2 * POINTS, every=2, **start)
    return t, start, found


@functools.cache
def shifted_phi(name, shift, backwards=False):
    """Return phi at the 32 points moved by `shift`, from an exact motion."""
    problem = PROBLEMS[name]
    t, start, _ = along(name, backwards)
    if shift:
        ahead = lv.integrate(problem.system, lv.Spark(8), t=(t[0], t[0] + shift), steps=1, **start)
        start = {state: ahead.states[state][-1] for state in start}
    t = t[0] + shift, t[1] + shift
    found = lv.integrate(problem.system, lv.Spark(8), t=t, steps=2 * POINTS, every=2, **start)
    return np.array([problem.plain.phi(*at) for at in zip(found.t, found.q, found.v, strict=True)])


def errors_along(method, name, steps, backwards=False, **more):
    """Return the largest errors at 32 points, and with them that of a against phi(t + D h)."""
    problem = PROBLEMS[name]
    t, start, exact = along(name, backwards)
    found = lv.integrate(
        problem.system, method, t=t, steps=steps, every=steps // POINTS, **start, **more
    )
    am, af, *_ = method.coefficients
    phi = shifted_phi(name, (am - af) * (t[1] - t[0]) / steps, backwards)
    errors = {state: np.abs(found.states[state] - exact.states[state]).max() for state in "qv"}
    # at the start a is what it is given, and after a few steps it has forgotten
    errors["a"] = np.abs(found.a - phi)[2:].max()
    errors["lam"] = np.abs(found.lam - exact.lam).max()
    return errors


def orders(method, name, sizes=SIZES, **how):
    errors = [errors_along(method, name, steps, **how) for steps in sizes]
    return {
        state: slope([1 / steps for steps in sizes], [error[state] for error in errors])
        for state in errors[0]
    }


@pytest.mark.parametrize(("method", "name"), EXTENDED, ids=lambda x: str(x))
def test_the_alpha_methods_have_order_2_in_everything(method, name):
    for state, found in orders(method, name).items():
        assert abs(found - 2) < 0.1, (state, found)


@pytest.mark.parametrize("name", SECOND_ORDER)
@pytest.mark.parametrize("method", [lv.HHT(-0.3, b) for b in BS], ids=lambda x: str(x))
def test_the_alpha_methods_have_order_2_backwards(method, name):
    for state, found in orders(method, name, backwards=True).items():
        assert abs(found - 2) < 0.1, (state, found)


@pytest.mark.parametrize(
    ("method", "name"),
    [(row.method, name) for row in ALPHA if not row.keeps for name in row.on],
    ids=lambda x: str(x),
)
def test_arnold_and_bruls_have_order_2_in_positions_and_velocities(method, name):
    found = orders(method, name)
    assert abs(found["q"] - 2) < 0.1
    assert abs(found["v"] - 2) < 0.1
