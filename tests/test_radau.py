"""Radau stages: coefficients, order, constraints, and what they damp that Gauss stages do not."""

import casadi as ca
import numpy as np
import pytest
from registry import PROBLEMS
from test_lobatto_pair import SOLVERS, back, form_defect

import liouville as lv
from liouville import _core


def test_coefficients_are_radau_s():
    tables = [_core.spark_tableau(s, "radau") for s in (1, 2, 3)]
    np.testing.assert_array_equal(tables[0]["a_f"], [[1.0]])
    np.testing.assert_array_equal(tables[0]["a_hat"], [[0.5, 0.0]])
    wanted = [[5 / 12, -1 / 12], [3 / 4, 1 / 4]]
    np.testing.assert_allclose(tables[1]["a_f"], wanted, rtol=0, atol=1.2e-16)
    r = np.sqrt(6)
    wanted = [(16 - r) / 36, (16 + r) / 36, 1 / 9]
    np.testing.assert_allclose(tables[2]["b"], wanted, rtol=0, atol=1.2e-16)
    np.testing.assert_allclose(tables[2]["c"], [(4 - r) / 10, (4 + r) / 10, 1], atol=1.2e-16)


@pytest.mark.parametrize("stages", [1, 2, 5, 13, 64])
def test_coefficients_satisfy_what_defines_them(stages):
    found = _core.spark_tableau(stages, "radau")
    b, c, c_hat = found["b"], found["c"], found["c_hat"]
    k = np.arange(1, 2 * stages)
    np.testing.assert_allclose(b @ c[:, None] ** (k - 1), 1 / k, rtol=0, atol=1e-15)
    k = k[:stages]
    for name, ends in (("a_v", c), ("a_bar", c_hat)):
        reached = found[name] @ c[:, None] ** (k - 1)
        np.testing.assert_allclose(reached, ends[:, None] ** k / k, rtol=0, atol=1e-15)
    k = k[: stages - 1]
    reached = found["a_hat"] @ c_hat[:, None] ** (k - 1)
    np.testing.assert_allclose(reached, c[:, None] ** k / k, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(found["a_v"][-1], b)
    np.testing.assert_array_equal(found["mu_bar"] + found["mu_hat"].T, 1.0)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("stages", [1, 2, 3, 4])
def test_constraints_hold_and_solvers_agree(stages, name):
    problem = PROBLEMS[name]
    runs = [
        lv.integrate(
            problem.system,
            lv.Spark(stages, solver, "radau"),
            t=problem.t,
            steps=100,
            **problem.start,
        )
        for solver in SOLVERS
    ]
    for run in runs:
        assert np.abs(run.residuals["constraint"]).max() < 5e-15
        assert np.abs(run.residuals["hidden"]).max() < 5e-15
        for state in problem.of[:2]:
            wanted = runs[2].states[state]
            np.testing.assert_allclose(run.states[state], wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_without_constraints_it_is_radau_iia(stages):
    oscillator = lv.Lagrangian(lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2, q=1)
    h = 0.5
    run = lv.integrate(
        oscillator, lv.Spark(stages, points="radau"), t=(0, h), steps=1, q=[1], v=[0]
    )
    s, z = stages, 1j * h
    # the subdiagonal Padé approximant of the exponential
    above, below = np.ones(1), np.ones(1)
    top = bottom = 1.0
    for k in range(1, s + 1):
        top *= (s - k) / ((2 * s - k) * k)
        bottom *= (s + 1 - k) / ((2 * s - k) * k)
        above, below = np.append(above, top), np.append(below, bottom)
    powers = z ** np.arange(s + 1)
    wanted = (above @ powers) / (below @ (powers * (-1.0) ** np.arange(s + 1)))
    np.testing.assert_allclose(run.q[-1], wanted.real, rtol=0, atol=5e-16)
    np.testing.assert_allclose(run.v[-1], -wanted.imag, rtol=0, atol=5e-16)


def sphere(force):
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - q[2],
        lambda t, q, params: (ca.dot(q, q) - 1) / 2,
        q=("x", "y", "z"),
        force=force,
    )


@pytest.mark.parametrize("stages", [1, 2, 3, 5])
def test_stiff_drag_is_damped_at_once(stages):
    start = {"q": [0.6, 0, -0.8], "v": [0, 1.25, 0]}
    thick = sphere(lambda t, q, v, params: -1e4 * v)
    run = lv.integrate(thick, lv.Spark(stages, points="radau"), t=(0.0, 1.0), steps=10, **start)
    speed = np.linalg.norm(run.v, axis=1)
    assert speed[1] < 0.01
    np.testing.assert_allclose(speed[3:], 0.6e-4, rtol=1e-3)  # gravity along the sphere over drag
    assert np.abs(run.residuals["hidden"]).max() < 5e-15


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_a_stiff_spring_across_the_sphere_comes_to_rest_and_gauss_goes_on(stages):
    system = sphere(lambda t, q, v, params: ca.vertcat(-1e6 * q[0], 0, 0))
    start = {"q": [1e-3, 0, -np.sqrt(1 - 1e-6)], "v": [0, 0.3, 0]}
    last = {
        points: np.abs(
            lv.integrate(
                system, lv.Spark(stages, points=points), t=(0.0, 2.0), steps=20, **start
            ).q[-5:, 0]
        ).max()
        for points in ("gauss", "radau")
    }
    assert last["radau"] < 1e-10
    assert last["gauss"] > 1e-4


def test_what_is_not_claimed_is_not_there():
    method = lv.Spark(2, points="radau")
    assert back(method, PROBLEMS["top"]) > 1e-8
    assert form_defect(method, "top") > 1e-6
    with pytest.raises(ValueError, match="only a symmetric method is composed"):
        lv.Composition(method, "Y4")
    with pytest.raises(ValueError, match="points must be one of gauss, radau, not 'chebyshev'"):
        lv.Spark(2, points="chebyshev")
