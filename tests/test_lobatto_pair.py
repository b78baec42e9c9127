"""Lobatto pairs: coefficients, printed steps, orders, what they keep, what they are equal to."""

import casadi as ca
import numpy as np
import pytest
from registry import PROBLEMS, REFERENCE, SYSTEMS, double_pendulum, printed
from test_invariants import consistent, symplectic_defect

import liouville as lv
from liouville import _core
from liouville._methods.lobatto import FORCES

PRINTED = REFERENCE["lobatto_IIIA_IIIB_one_step_h=1/10"]
NAMES = {"A": "IIIA", "B": "IIIB", "C": "IIIC", "C*": "IIICstar", "D": "IIID"}
SOLVERS = ("auto", "node-schur", "newton")


def floats(table):
    return np.array(table, dtype=float)


# --- coefficients ------------------------------------------------------------------------------


@pytest.mark.parametrize("stages", [2, 3, 4])
@pytest.mark.parametrize("force", FORCES)
def test_coefficients_agree_with_the_25_digit_tables(force, stages):
    found, exact = _core.lobatto_pair(stages, force), REFERENCE["lobatto"][str(stages)]
    for name, letter in (("a_v", "IIIA"), ("a_bar", "IIIA"), ("a_hat", "IIIB"), ("a_r", "IIIB")):
        np.testing.assert_allclose(found[name], floats(exact[letter]), rtol=0, atol=1.2e-16)
    np.testing.assert_allclose(found["a_f"], floats(exact[NAMES[force]]), rtol=0, atol=1.2e-16)
    for name, letter in (("b", "b"), ("c", "c"), ("b_hat", "b"), ("c_hat", "c")):
        np.testing.assert_allclose(found[name], floats(exact[letter]), rtol=2.3e-16, atol=0)


@pytest.mark.parametrize("stages", range(2, 33))
def test_what_steps_use_is_symplectic_without_rounding(stages):
    found = _core.lobatto_pair(stages, "B")
    np.testing.assert_array_equal(found["mu_v"] + found["mu_f"].T, 1.0)
    np.testing.assert_array_equal(found["mu_bar"] + found["mu_hat"].T, 1.0)


@pytest.mark.parametrize("stages", [2, 3, 5, 9, 17])
def test_coefficients_satisfy_what_defines_them(stages):
    tables = {force: _core.lobatto_pair(stages, force) for force in FORCES}
    b, c = tables["B"]["b"], tables["B"]["c"]
    k = np.arange(1, stages + 1)
    exact = c[:, None] ** k / k
    reach = {
        force: np.abs(tables[force]["a_f"] @ (c[:, None] ** (k - 1)) - exact) for force in "ABC"
    }
    assert reach["A"].max() < 4e-16
    assert reach["B"][:, : stages - 2].max(initial=0) < 1e-15
    assert reach["C"][:, : stages - 1].max() < 1e-15
    np.testing.assert_allclose(tables["C"]["a_f"][:, 0], b[0], rtol=2.3e-16)
    np.testing.assert_array_equal(tables["C*"]["mu_f"] + tables["C"]["mu_f"].T, 1.0)
    np.testing.assert_array_equal(tables["D"]["mu_f"] + tables["D"]["mu_f"].T, 1.0)


# --- steps -------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("stages", [2, 3, 4])
@pytest.mark.parametrize("name", PRINTED)
def test_a_step_has_the_digits_of_69_digit_arithmetic(name, stages, solver):
    start, exact = printed(name, "y0", "z0"), PRINTED[name][str(stages)]
    method = lv.LobattoPair(stages, solver=solver)
    found = lv.integrate(SYSTEMS[name](), method, t=(0.0, 0.1), steps=1, q=start[0], v=start[1])
    np.testing.assert_allclose(found.q[-1], floats(exact["y1"]), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(found.v[-1], floats(exact["z1"]), rtol=0, atol=9e-16)


@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize("name", PROBLEMS)
def test_both_constraints_hold_to_roundoff(name, force):
    problem = PROBLEMS[name]
    for stages in (2, 3, 4):
        method = lv.LobattoPair(stages, force)
        found = lv.integrate(problem.system, method, t=problem.t, steps=100, **problem.start)
        assert np.abs(found.residuals["constraint"]).max() < 5e-15
        assert np.abs(found.residuals["hidden"]).max() < 5e-15


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("stages", [2, 3, 4])
def test_three_solvers_find_one_solution(stages, name):
    problem = PROBLEMS[name]
    runs = [
        lv.integrate(
            problem.system,
            lv.LobattoPair(stages, solver=solver),
            t=problem.t,
            steps=80,
            **problem.start,
        )
        for solver in SOLVERS
    ]
    for run in runs[:2]:
        for state in problem.of[:2]:
            wanted = runs[2].states[state]
            np.testing.assert_allclose(run.states[state], wanted, rtol=0, atol=1e-13)
    assert runs[1].stats["solver"] == "node-schur"
    assert runs[2].stats["solver"] == "newton"


# --- structure ---------------------------------------------------------------------------------


def back(method, problem, t=0.3, h=0.15):
    """Return how far a step back is from undoing a step."""
    start = consistent(problem, t)
    there = lv.integrate(problem.system, method, t=(t, t + h), steps=1, **start)
    end = {state: there.states[state][-1] for state in start}
    again = lv.integrate(problem.system, method, t=(t + h, t), steps=1, **end)
    return max(np.abs(again.states[state][-1] - start[state]).max() for state in start)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("stages", [2, 3, 4])
def test_a_step_back_undoes_a_step_where_the_pair_is_symmetric(stages, name):
    for force in FORCES:
        method = lv.LobattoPair(stages, force)
        defect = back(method, PROBLEMS[name])
        assert defect < 5e-15 if method.is_symmetric else defect > 5e-14, (force, defect)


def form_defect(method, name):
    problem, t, h = PROBLEMS[name], 0.2, 0.2

    def flow(moved):
        found = lv.integrate(problem.system, method, t=(t, t + h), steps=1, **moved)
        return found.q[-1], found.p[-1]

    return symplectic_defect(problem.system, consistent(problem, t), t, flow)


@pytest.mark.parametrize("name", ["top", "relativistic"])
@pytest.mark.parametrize("stages", [2, 3, 4])
def test_b_keeps_the_symplectic_form_and_no_other_does(stages, name):
    defects = {force: form_defect(lv.LobattoPair(stages, force), name) for force in FORCES}
    assert defects.pop("B") < 1e-11
    assert min(defects.values()) > 1e-10, defects


def test_the_energy_error_of_rattle_does_not_grow():
    found = lv.integrate(
        SYSTEMS["spherical"](), lv.LobattoPair(), t=(0.0, 5e3), steps=100_000,
        states=False, q=[0.6, 0, -0.8], v=[0, 1.25, 0],
    )  # fmt: skip
    errors = np.abs(found.invariants["energy"] - found.invariants["energy"][0])
    assert errors.max() == pytest.approx(errors[:10_000].max(), rel=1e-3)
    assert errors.max() > 1e-9


# --- what it is equal to -----------------------------------------------------------------------


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
def test_with_constant_mass_and_force_it_is_gauss_lobatto(stages):
    start = {"q": [1, 0, 1, -1], "v": [0, 0, 0, 0]}
    runs = [
        lv.integrate(double_pendulum(), method, t=(0.0, 1.0), steps=40, **start)
        for method in (lv.LobattoPair(stages + 1), lv.Spark(stages))
    ]
    for state in ("q", "v"):
        first, second = (run.states[state] for run in runs)
        np.testing.assert_allclose(first, second, rtol=0, atol=2e-14)


def driven(force):
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - q[2] - q[0] ** 4 / 4,
        lambda t, q, params: (ca.dot(q, q) - 1) / 2,
        q=("x", "y", "z"),
        force=force,
    )


@pytest.mark.parametrize("stages", [2, 3, 4])
def test_for_constant_mass_and_forces_of_position_b_c_d_are_one_map(stages):
    start = {"q": [0.6, 0, -0.8], "v": [0, 1.25, 0]}

    def ends(system):
        runs = {
            force: lv.integrate(
                system, lv.LobattoPair(stages, force), t=(0.0, 1.0), steps=10, **start
            )
            for force in FORCES
        }
        exact = runs.pop("B")
        return {
            force: max(np.abs(run.q - exact.q).max(), np.abs(run.v - exact.v).max())
            for force, run in runs.items()
        }

    same = ends(driven(lambda t, q, v, params: ca.vertcat(ca.sin(3 * t), q[0] * q[2], 0)))
    assert max(same["C"], same["C*"], same["D"]) < 1e-14
    assert same["A"] > 1e-10
    apart = ends(driven(lambda t, q, v, params: ca.vertcat(v[1] * v[2], -v[0] / 5, 0)))
    assert min(apart.values()) > 1e-11


# --- compositions and bad calls ----------------------------------------------------------------


@pytest.mark.parametrize("force", ["C", "C*"])
def test_what_is_not_symmetric_is_not_composed(force):
    with pytest.raises(ValueError, match=r"is not: a step back does(.|\n)*hint: Spark"):
        lv.Composition(lv.LobattoPair(2, force), "Y4")


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"stages": 1}, ValueError, "stages must be from 2 to 32, not 1"),
        ({"stages": 33}, ValueError, "stages must be from 2 to 32, not 33"),
        ({"stages": 2.0}, TypeError, "stages must be an integer, not 2.0"),
        ({"force": "c*"}, ValueError, r"one of A, B, .*\nhint: did you mean 'C\*'"),
        ({"force": None}, ValueError, "not None"),
        ({"solver": "fast"}, ValueError, "solver must be one of auto, node-schur"),
    ],
)
def test_bad_numbers_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        lv.LobattoPair(**arguments)


def test_stiff_forces_are_left_to_newton():
    stiff = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 1e4 * q[0] ** 2 - q[1] * (1 + v[0] ** 2),
        lambda t, q, params: (ca.dot(q, q) - 1) / 2,
        q=("x", "y"),
    )
    run = lv.integrate(stiff, lv.LobattoPair(3), t=(0, 1), h=0.02, q=[0, -1], v=[0.1, 0])
    assert run.stats["newton_steps"] > 0
    assert np.abs(run.residuals["constraint"]).max() < 5e-15
