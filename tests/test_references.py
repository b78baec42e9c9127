"""Published and independently computed values, to the digits they have."""

import re
from fractions import Fraction
from pathlib import Path

import kernels
import numpy as np
import pytest
from registry import PROBLEMS, REFERENCE, SYSTEMS, printed

import liouville as lv
from liouville import _core

ALL = sorted(SYSTEMS)
SOLVERS = ("node-schur", "newton")


def numbers(values):
    return np.array(values, dtype=float)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", ALL)
def test_one_step_has_the_digits_of_69_digit_arithmetic(name, solver):
    y0, z0 = printed(name, "y0", "z0")
    for stages, expected in REFERENCE["problems"][name]["spark_one_step_h=1/10"].items():
        found = lv.integrate(
            SYSTEMS[name](), lv.Spark(int(stages), solver), t=(0.0, 0.1), steps=1, q=y0, v=z0
        )
        np.testing.assert_allclose(found.q[-1], numbers(expected["y1"]), rtol=0, atol=5e-16)
        np.testing.assert_allclose(found.v[-1], numbers(expected["z1"]), rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ALL)
def test_ten_steps_have_the_digits_of_69_digit_arithmetic(name):
    y0, z0 = printed(name, "y0", "z0")
    for stages, expected in REFERENCE["problems"][name]["spark_10_steps_h=1/20"].items():
        found = lv.integrate(
            SYSTEMS[name](), lv.Spark(int(stages)), t=(0.0, 0.5), steps=10, q=y0, v=z0
        )
        np.testing.assert_allclose(found.q[-1], numbers(expected["y"]), rtol=0, atol=1e-15)
        np.testing.assert_allclose(found.v[-1], numbers(expected["z"]), rtol=0, atol=2e-15)


@pytest.mark.parametrize("name", ALL)
def test_high_order_reaches_the_exact_motion_and_its_multipliers(name):
    y0, z0 = printed(name, "y0", "z0")
    exact = REFERENCE["problems"][name]["end_states"]["1"]
    found = lv.integrate(SYSTEMS[name](), lv.Spark(7), t=(0.0, 1.0), steps=25, q=y0, v=z0)
    np.testing.assert_allclose(found.q[-1], numbers(exact["y"]), rtol=0, atol=2e-15)
    np.testing.assert_allclose(found.v[-1], numbers(exact["z"]), rtol=0, atol=4e-15)
    np.testing.assert_allclose(found.lam[-1], numbers(exact["psi"]), rtol=2e-14)


@pytest.mark.parametrize("name", ALL)
def test_multipliers_at_the_start_are_exact(name):
    y0, z0 = printed(name, "y0", "z0")
    found = lv.integrate(SYSTEMS[name](), lv.Spark(1), t=(0.0, 1e-3), steps=1, q=y0, v=z0)
    (expected,) = printed(name, "initial_psi")
    np.testing.assert_allclose(found.lam[0], expected, rtol=1e-15, atol=1e-15)


ALPHA_CASES = REFERENCE["extended_hht"]["cases"]


def alpha_method(case):
    """Return the method of a case; its parameter stands after the equals sign."""
    family, parameter = case["method"].split("=")
    cls = lv.HHT if family.startswith("HHT") else lv.GeneralizedAlpha
    number = float(Fraction(parameter))
    return cls(number, float(Fraction(case["b"])), case["less_implicit_R1"])


def alpha_case(case):
    less = ", less implicit" if case["less_implicit_R1"] else ""
    return f"{case['method']}, b={case['b']}{less}, {case['steps']} steps"


@pytest.mark.parametrize("case", ALPHA_CASES, ids=alpha_case)
def test_the_alpha_methods_have_the_digits_of_69_digit_arithmetic(case):
    problem, method = PROBLEMS["breathing sphere"], alpha_method(case)
    h, steps = float(Fraction(case["h"])), case["steps"]
    found = lv.integrate(problem.system, method, t=(0.0, steps * h), steps=steps, **problem.start)
    np.testing.assert_allclose(found.q[-1], numbers(case["y"]), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.v[-1], numbers(case["z"]), rtol=0, atol=3e-15)
    np.testing.assert_allclose(found.a[-1], numbers(case["a"]), rtol=0, atol=3e-15)
    exact = [float(Fraction(case["params"][key])) for key in ("am", "af", "ga", "be")]
    np.testing.assert_allclose(method.coefficients, exact, rtol=1e-15, atol=1e-16)


@pytest.mark.parametrize("case", ALPHA_CASES, ids=alpha_case)
def test_the_plain_implementation_has_them_too(case):
    problem, method = PROBLEMS["breathing sphere"], alpha_method(case)
    plain = problem.plain
    states = plain.run(
        plain.start(0.0, problem.start["q"], problem.start["v"]),
        [float(Fraction(case["h"]))] * case["steps"],
        method.coefficients,
        b=method.b,
        kind=method.reaction,
    )
    for key in "yza":
        np.testing.assert_allclose(getattr(states[-1], key), numbers(case[key]), atol=1e-14)
    for key, psi in zip(("Psi0", "Psi1"), states[-1].psi, strict=True):
        np.testing.assert_allclose(psi, numbers(case[key]), atol=1e-12)


TABLES = {
    "gauss_c": "c",
    "gauss_b": "b",
    "gauss_A": "a_v",
    "lobatto_c": "c_hat",
    "lobatto_b": "b_hat",
    "abar": "a_bar",
    "atilde": "a_hat",
}


def ulps(found, exact):
    size = np.spacing(np.maximum(np.abs(exact), np.finfo(float).tiny))
    return np.max(np.abs(found - exact) / size)


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
def test_coefficients_agree_with_the_25_digit_tables(stages):
    found = _core.spark_tableau(stages, "gauss")
    for printed_name, name in TABLES.items():
        exact = numbers(REFERENCE["gauss_lobatto_spark"][str(stages)][printed_name])
        assert ulps(found[name], exact) <= 1, name


@pytest.mark.parametrize("stages", range(1, 11))
def test_coefficients_are_right_to_the_last_bits_up_to_ten_stages(stages):
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(40):
        exact = by_definition(mpmath.mp, stages)
    found = _core.spark_tableau(stages, "gauss")
    for name, value in exact.items():
        assert ulps(found[name], np.array(value, dtype=float)) <= 2, name


def by_definition(mp, s):
    """Return the coefficients by their definitions, in the precision of `mp`."""
    legendre = [(-1) ** (s + k) * mp.binomial(s, k) * mp.binomial(s + k, k) for k in range(s + 1)]
    slope = [k * c for k, c in enumerate(legendre)][1:]

    def zeros(coefficients):
        guesses = np.polynomial.Polynomial([float(x) for x in coefficients]).roots()
        value = lambda x: mp.fsum(a * x**k for k, a in enumerate(coefficients))  # noqa: E731
        return sorted(mp.findroot(value, float(guess.real)) for guess in guesses)

    c, c_hat = zeros(legendre), [mp.mpf(0), *zeros(slope), mp.mpf(1)]

    def integral(nodes, j, x):
        basis = [mp.mpf(1)]  # coefficients, ascending
        for k, node in enumerate(nodes):
            if k != j:
                shifted, kept = [mp.mpf(0), *basis], [*basis, mp.mpf(0)]
                scale = nodes[j] - node
                basis = [(a - node * b) / scale for a, b in zip(shifted, kept, strict=True)]
        return mp.fsum(b * x ** (k + 1) / (k + 1) for k, b in enumerate(basis))

    b = [integral(c, j, mp.mpf(1)) for j in range(s)]
    b_hat = [integral(c_hat, j, mp.mpf(1)) for j in range(s + 1)]
    a_bar = [[integral(c, j, x) for j in range(s)] for x in c_hat]
    return {
        "a_v": [[integral(c, j, x) for j in range(s)] for x in c],
        "a_bar": a_bar,
        "a_hat": [
            [mp.mpf(0) if j == s else b_hat[j] * (1 - a_bar[j][i] / b[i]) for j in range(s + 1)]
            for i in range(s)
        ],
        "b": b,
        "c": c,
        "b_hat": b_hat,
        "c_hat": c_hat,
    }


def test_tests_that_compare_with_other_codes_are_found_in_their_text(tmp_path):
    """By what they use, their functions and fixtures use, or the file imports."""
    (tmp_path / "test_x.py").write_text("""
import numpy as np
from ordinary import solved
from scipy import linalg as la

WANTED = [la.expm(1.0)]

def helper():
    return WANTED

def test_by_a_helper(): helper()
def test_by_a_fixture(fixed): pass
def fixed(): return np.linalg.norm([1.0])
def test_by_itself(): solved()
def test_bits(x): x.tobytes()
def test_of_nothing_else(): assert np.pi
""")
    names = ["test_by_a_helper", "test_by_a_fixture", "test_by_itself", "test_bits"]
    assert kernels.compared(tmp_path / "test_x.py") == names


def test_one_file_alone_solves_ordinary_differential_equations():
    """It does so near roundoff, ten times better than any tolerance of a test."""
    solver = re.compile(r"\b(solve_ivp|odeint)\(|\bintegrate\.(ode|RK|DOP|LSODA|BDF|Radau)")
    files = Path(__file__).parent.glob("*.py")
    assert {x.name for x in files if solver.search(x.read_text("utf-8"))} == {"ordinary.py"}
