"""Polynomial fields: expanded exactly, from functions or terms, or refused by name.

One file, since what either refuses is asked of the other.
"""

import math
import sys
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
import scipy.sparse
import sympy
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples

from liouville._systems import PolynomialField

XYZ = ("x", "y", "z")
SYMBOLS = sympy.symbols("x y z")


def terms_of(field):
    """Return the coefficient of each component and monomial."""
    terms = field.terms
    rows = zip(terms.component, terms.coefficient, terms.variables, strict=True)
    return {(int(i), tuple(row[row >= 0].tolist())): c for i, c, row in rows}


def traced(*rows, x=XYZ, **options):
    """Make a field of expressions in x, y, z, t and params."""
    return PolynomialField(
        lambda t, q, p: [row(t, *ca.vertsplit(q), p) for row in rows], x=x, **options
    )


def given_terms(*terms, **options):
    return PolynomialField.from_terms(XYZ, terms, **options)


# --- expansion -----------------------------------------------------------------------------------

NUMBERS = st.sampled_from([Fraction(x) for x in ("-2", "-1", "-1/2", "0", "1/4", "1", "3/2", "3")])
POWERS_OF_TWO = st.sampled_from([Fraction(x) for x in ("-1/2", "2", "4")])
LEAVES = st.sampled_from(["a", "b", "p"]) | NUMBERS
TREES = st.recursive(
    LEAVES,
    lambda tree: st.one_of(
        st.tuples(st.sampled_from(["+", "-", "*"]), tree, tree),
        st.tuples(st.just("^"), tree, st.integers(0, 3)),
        st.tuples(st.just("/"), tree, POWERS_OF_TWO),
        st.tuples(st.just("neg"), tree),
    ),
    max_leaves=8,
)


def built(tree, leaves, number):
    """Build an expression from leaves by name, and numbers."""
    if isinstance(tree, str):
        return leaves[tree]
    if isinstance(tree, Fraction):
        return number(tree)
    operation, left, *right = tree
    first = built(left, leaves, number)
    if operation == "neg":
        return -first
    if operation == "^":
        return first ** right[0]
    second = built(right[0], leaves, number)
    return {
        "+": lambda: first + second,
        "-": lambda: first - second,
        "*": lambda: first * second,
        "/": lambda: first / second,
    }[operation]()


@examples(100)
@given(st.tuples(TREES, TREES, TREES))
def test_expansion_is_exact(trees):
    p, others = Fraction(3, 4), ((1, 2), (0, 2), (0, 1))  # component i is free of variable i

    def field(t, x, params):
        leaves = [{"a": x[i], "b": x[k], "p": params.p} for i, k in others]
        return [built(*pair, lambda c: ca.SX(float(c))) for pair in zip(trees, leaves, strict=True)]

    expected = {}
    for component, (tree, (i, k)) in enumerate(zip(trees, others, strict=True)):
        leaves = {"a": SYMBOLS[i], "b": SYMBOLS[k], "p": sympy.Rational(3, 4)}
        poly = sympy.Poly(built(tree, leaves, lambda c: sympy.Rational(c)), *SYMBOLS)
        for exponents, c in poly.terms():
            if c:
                factors = tuple(v for v in range(3) for _ in range(exponents[v]))
                expected[component, factors] = Fraction(int(c.p), int(c.q))
    found = PolynomialField(field, x=XYZ, params={"p": float(p)})
    assume(found.terms.is_exact)  # CasADi multiplies numbers out, which may round
    assert terms_of(found) == expected


def test_rational_numbers_are_kept_and_others_rounded_once():
    exact = traced(lambda t, x, y, z, p: y / 3 + 0.75, lambda t, x, y, z, p: 7 * x, lambda *_: 0)
    assert exact.terms.is_exact
    assert terms_of(exact)[0, (1,)] == Fraction(1, 3)
    rounded = traced(lambda t, x, y, z, p: 0.1 * y**2 / 3, lambda *_: 0, lambda *_: 0)
    assert not rounded.terms.is_exact
    assert terms_of(rounded) == {(0, (1, 1)): float(Fraction(0.1) / 3)}


def test_what_roundoff_of_the_constants_left_is_no_term():
    cancelling = traced(
        lambda t, x, y, z, p: 0.1 * y + 0.2 * y - 0.3 * y + z, lambda *_: 0, lambda *_: 0
    )
    assert set(terms_of(cancelling)) == {(0, (2,))}
    small = traced(lambda t, x, y, z, p: 1e-30 * y + z, lambda *_: 0, lambda *_: 0)
    assert set(terms_of(small)) == {(0, (1,)), (0, (2,))}


def test_coefficients_may_depend_on_parameters_in_any_way():
    field = traced(
        lambda t, x, y, z, p: ca.sqrt(p.a) * y ** p.k[0] + ca.if_else(p.a > 1, z, 1 / z),
        lambda t, x, y, z, p: x / p.a,
        lambda t, x, y, z, p: p.k[1] ** p.a,
        params={"a": 4.0, "k": (2, 3)},
    )
    assert terms_of(field) == {(0, (1, 1)): 2, (0, (2,)): 1, (1, (0,)): 0.25, (2, ()): 81}
    other = field.with_params({"a": 9.0, "k": (3, 1)})
    assert terms_of(other) == {
        (0, (1, 1, 1)): 3,
        (0, (2,)): 1,
        (1, (0,)): Fraction(1, 9),
        (2, ()): 1,
    }
    assert other.params == {"a": 9.0, "k": pytest.approx([3, 1])}
    np.testing.assert_array_equal(other.values(None), [9, 3, 1])
    assert field.with_params(None) is field
    assert field.params["a"] == 4.0


def test_a_casadi_function_is_a_field():
    t, x, p = ca.MX.sym("t"), ca.MX.sym("x", 3), ca.MX.sym("p", 2)
    matrix = ca.DM([[0, 1, 0], [2, 0, 0], [0, 3, 0]])
    expected = {(0, (1,)): 2, (1, (0,)): 4, (2, (1,)): 6}
    full = ca.Function("f", [t, x, p], [ca.mtimes(matrix, x) * p[1]])
    assert terms_of(PolynomialField(full, x=XYZ, params={"k": (1, 2)})) == expected
    short = ca.Function("f", [x], [2 * ca.mtimes(matrix, x)])
    assert terms_of(PolynomialField(short, x=XYZ)) == expected
    with pytest.raises(
        ValueError, match=r"input 0 of the CasADi function 'f' must have 1 elements, not 3"
    ):
        PolynomialField(ca.Function("f", [x, t], [x]), x=XYZ)


def test_components_may_be_given_by_name():
    field = PolynomialField(lambda t, x, params: {"z": x[0] * x[1]}, x=XYZ)
    assert terms_of(field) == {(2, (0, 1)): 1}


# --- waves and time ------------------------------------------------------------------------------

WAVES = {
    "cells": (
        lambda t, x, y, z, p: ca.sin(x) * ca.cos(y),
        lambda t, x, y, z, p: -ca.cos(x) * ca.sin(y),
        lambda t, x, y, z, p: ca.sin(2 * x - y + 0.3) ** 2,
    ),
    "tide": (
        lambda t, x, y, z, p: ca.sin(0.5 * t) * y + x * ca.cos(t - 1),
        lambda t, x, y, z, p: x * ca.cos(3 * t) * ca.sin(z) - y * ca.sin(np.pi / 2 + t - 1),
        lambda t, x, y, z, p: ca.sin(t) ** 2 + ca.cos(t) ** 2,
    ),
    "mixed": (
        lambda t, x, y, z, p: x * ca.sin(y),
        lambda t, x, y, z, p: ca.cos(y),
        lambda t, x, y, z, p: y,
    ),
}


@pytest.mark.parametrize("name", WAVES)
def test_sines_and_cosines_are_factors(name):
    field = traced(*WAVES[name])
    t, q = ca.SX.sym("t"), ca.SX.sym("q", 3)
    column = ca.vertcat(*(row(t, *ca.vertsplit(q), None) for row in WAVES[name]))
    direct = ca.Function("f", [t, q], [column])
    points = np.random.default_rng(1).normal(size=(20, 3))
    for x in points:
        state = field.extended(x[None], 0.7)[0]
        found = field.terms.evaluate(state)
        np.testing.assert_allclose(found[:3], direct(0.7, x).full()[:, 0], rtol=0, atol=1e-14)
        assert found[3:].tolist() == [1.0] * field.is_driven


def test_squares_of_sine_and_cosine_make_a_constant():
    tide = traced(*WAVES["tide"])
    third = {monomial: c for (i, monomial), c in terms_of(tide).items() if i == 2}
    assert third == {(): 1.0}


def test_a_wave_that_expands_is_refused():
    with pytest.raises(ValueError, match=r"div f contains 1 \* cos\(x\)"):
        traced(lambda t, x, y, z, p: ca.sin(x), lambda *_: 0, lambda *_: 0)


def test_time_is_a_further_variable():
    field = traced(lambda t, x, y, z, p: t * y, lambda *_: 0, lambda t, x, y, z, p: t**2)
    assert field.is_driven
    assert field.terms.n == 4
    assert terms_of(field) == {(0, (1, 3)): 1, (2, (3, 3)): 1, (3, ()): 1}
    assert repr(field) == "PolynomialField(x, y, z; 2 terms of degree 2, driven)"
    named = given_terms((0, 1, ("y", "t")), (2, 1, {"t": 2}))
    assert named.is_driven
    assert terms_of(named) == terms_of(field)


# --- what is no such field -----------------------------------------------------------------------


def zero(*_):
    return 0


REFUSED = [
    (lambda t, x, y, z, p: ca.exp(x), r"component 'x' contains exp\(x\), which is no polynomial"),
    (lambda t, x, y, z, p: y + 1 / x, r"component 'x' contains 1/x, which is no polynomial"),
    (
        lambda t, x, y, z, p: y / (z - 2 * x),
        r"contains y/\(-2\*x \+ z\), which.*\nhint: other comp",
    ),
    (lambda t, x, y, z, p: (1 + x) ** -2, r"contains 1/\(x\*\*2 \+ 2\*x \+ 1\), which is no"),
    (lambda t, x, y, z, p: x**0.5 * z, r"contains sqrt\(x\), which is no polynomial"),
    (lambda t, x, y, z, p: (x * z) ** 1.5, r"contains \(x\*z\)\*\*\(3/2\), which is no polynomial"),
    (lambda t, x, y, z, p: ca.fabs(x), r"contains fabs\(x\), which is no polynomial"),
    (lambda t, x, y, z, p: ca.if_else(x > 0, 1, z), r"contains a choice by lt\(0, x\), which"),
    (lambda t, x, y, z, p: ca.sin(x * z), r"contains sin\(x\*z\), whose argument is not affine\nh"),
    (lambda t, x, y, z, p: ca.sin(x + ca.cos(t)), r"not affine\nhint: .* X = x \+ f\(t\)"),
    (lambda t, x, y, z, p: ca.sin(ca.cos(x)), r"contains sin\(cos\(x\)\), whose argument"),
    (lambda t, x, y, z, p: ca.log(p.a - 3) * y, r"contains log\(-1\), which is nan"),
    (lambda t, x, y, z, p: y / (p.a - 2), r"contains y/0, which is no polynomial"),
    (lambda t, x, y, z, p: y * ca.inf, r"contains the constant inf"),
    (lambda t, x, y, z, p: math.nan * y, r"field contains the constant nan"),
    (lambda t, x, y, z, p: (y + z) ** 1000, r"too large to expand: it has the exponent 1000"),
    (lambda t, x, y, z, p: (1e200 * y) ** 2, r"a coefficient of the field is too large"),
    (lambda t, x, y, z, p: 2 * x * y**2, r"not divergence-free: div f contains 2 \* y\*\*2\nhint"),
    (lambda t, x, y, z, p: 0.3 * x, r"div f contains 0.3\nhint"),
]


@pytest.mark.parametrize(("row", "message"), REFUSED)
def test_a_function_that_is_no_such_field_is_refused(row, message):
    with pytest.raises(ValueError, match=message):
        traced(row, zero, zero, params={"a": 2.0})


def test_sprott_a_and_nose_hoover_are_refused():
    with pytest.raises(ValueError, match=r"div f contains 1 \* z\nhint"):
        traced(
            lambda t, x, y, z, p: y,
            lambda t, x, y, z, p: -x + y * z,
            lambda t, x, y, z, p: 1 - y**2,
        )
    with pytest.raises(ValueError, match=r"div f contains -1 \* xi\nhint"):
        PolynomialField(
            lambda t, x, params: [x[1], -x[0] - x[2] * x[1], x[1] ** 2 - 1], x=("q", "p", "xi")
        )


def test_the_number_of_components_is_checked():
    with pytest.raises(ValueError, match="field must return 3 values, not 2"):
        PolynomialField(lambda t, x, params: [x[1], x[0]], x=XYZ)


def test_many_offending_monomials_are_counted():
    n = 9
    with pytest.raises(ValueError, match=r"2 \* x0, 2 \* x1, 2 \* x2, 2 \* x3, 2 \* x4 and 4 more"):
        PolynomialField(lambda t, x, params: x**2, x=n)


# --- terms ---------------------------------------------------------------------------------------

TERMS = [(0, 1, (1,)), (1, "-1/3", (0, 2, 2)), (2, Fraction(1, 2), ()), (2, 2, (0, 1))]


def test_all_ways_to_give_terms_are_the_same():
    field = given_terms(*TERMS)
    assert field.terms.is_exact
    named = given_terms(
        ("x", 1, "y"), ("y", "-1/3", {"z": 2, "x": 1}), ("z", "1/2", ()), ("z", 2, ("y", "x"))
    )
    assert terms_of(named) == terms_of(field)
    arrays = tuple(
        map(
            np.array,
            (
                [0, 1, 2, 2],
                [1, -1 / 3, 0.5, 2],
                [[-1, -1, 1], [0, 2, 2], [-1, -1, -1], [1, -1, 0]],
            ),
        )
    )
    floats = PolynomialField.from_terms(3, arrays)
    assert not floats.terms.is_exact
    assert terms_of(floats) == {key: float(c) for key, c in terms_of(field).items()}
    function = traced(
        lambda t, x, y, z, p: y,
        lambda t, x, y, z, p: -x * z**2 / 3,
        lambda t, x, y, z, p: 0.5 + 2 * x * y,
    )
    assert terms_of(function) == terms_of(field)
    x, y, z = SYMBOLS
    expressions = [y, -x * z**2 / 3, sympy.Poly(2 * x * y + sympy.Rational(1, 2), y, x)]
    assert terms_of(PolynomialField.from_sympy(expressions, SYMBOLS)) == terms_of(field)


def test_a_million_coordinates_are_taken():
    n = 10**6
    i = np.arange(n)
    variables = np.column_stack([np.roll(i, -1), np.roll(i, 1)])
    field = PolynomialField.from_terms(n, (i, np.ones(n), variables), invariants={"e": np.ones(n)})
    assert len(field.terms) == n
    tape, widths = field.observer(None)
    assert widths == {"invariant e": 1}
    assert tape.map(np.empty(0), [np.zeros((1, 1)), np.full((1, n), 2.0)]) == 4 * n


BAD_TERMS = [
    (ValueError, [(3, 1, (1,))], r"term 0 has the component 3: the 3 coordinates are numbered"),
    (ValueError, [(-1, 1, (1,))], r"term 0 has the component -1"),
    (ValueError, [*TERMS, (0, 1, (1, 7))], r"term 4 has the variable 7"),
    (
        ValueError,
        [("w", 1, (1,))],
        r"component 'w', which is no coordinate\nhint: they are x, y, z",
    ),
    (ValueError, [("t", 1, (1,))], r"component 't', which is no coordinate"),
    (ValueError, [(0, math.nan, (1,))], r"the coefficient of term 0 must be .*, not nan"),
    (ValueError, [(0, "a/b", (1,))], r"the coefficient of term 0 must be .*, not 'a/b'"),
    (ValueError, [(0, 1j, (1,))], r"the coefficient of term 0 must be .*, not 1j"),
    (ValueError, [(0, 1, {"y": -1})], r"power of 'y' in term 0 must be 0, 1, 2, ..., not -1"),
    (ValueError, [(0, 1, {"y": 0.5})], r"power of 'y' in term 0 must be 0, 1, 2, ..., not 0.5"),
    (ValueError, [(0, 1, (0, 1)), (1, "-1/4", (1, 1))], r"div f contains 1/2 \* y\n"),
    (
        TypeError,
        [(0, 1)],
        r"term 0 must be \(component, coefficient, variables\), not \(0, 1\)\nhint",
    ),
    (TypeError, [(0, 1, 2)], r"term 0 must be \(component, coefficient, variables\)"),
    (TypeError, [(0.5, 1, (1,))], r"component of term 0 must be an index or a name, not 0.5"),
    (TypeError, 7, r"terms must be \(component, coefficient, variables\), not 7"),
]


@pytest.mark.parametrize(("kind", "terms", "message"), BAD_TERMS)
def test_malformed_terms_are_refused(kind, terms, message):
    with pytest.raises(kind, match=message):
        PolynomialField.from_terms(XYZ, terms)


BAD_ARRAYS = [
    (([0, 3], [1.0, 1], [[1], [2]]), r"term 1 has the component 3"),
    (([0, 1], [1.0, math.inf], [[1], [2]]), r"the coefficient of term 1 must be finite, not inf"),
    (([0, 1], [1.0, 1], [[1], [-2]]), r"term 1 has the variable -2"),
    (([0, 1], [1.0], [[1], [2]]), r"must have shapes .*, not \(2,\), \(1,\), \(2, 1\)"),
    (
        ([0.0, 1], [1.0, 1], [[1], [2]]),
        r"a component must be an index, and the array is of float64",
    ),
]


@pytest.mark.parametrize(("arrays", "message"), BAD_ARRAYS)
def test_malformed_arrays_of_terms_are_refused(arrays, message):
    with pytest.raises((TypeError, ValueError), match=message):
        PolynomialField.from_terms(3, tuple(map(np.array, arrays)))


def test_repair_takes_out_rounding_and_no_more():
    rounded = [(0, 0.3333, (0, 1)), (1, -0.1667, (1, 1)), (2, 1.0, (0, 1))]
    with pytest.raises(ValueError, match=r"hint: if the coefficients were rounded.*repair=True"):
        given_terms(*rounded)
    found = terms_of(given_terms(*rounded, repair=True))
    excess = 0.3333 - 2 * 0.1667
    assert found[0, (0, 1)] == pytest.approx(0.3333 - excess / 5, rel=1e-15)
    assert found[1, (1, 1)] == pytest.approx(-0.1667 - 2 * excess / 5, rel=1e-15)
    assert found[2, (0, 1)] == 1.0


@pytest.mark.parametrize("is_exact", [False, True])
def test_repair_refuses_a_divergence_that_rounding_cannot_have_made(is_exact):
    number = Fraction if is_exact else float
    lorenz = [
        ("x", -10, ("x",)), ("x", 10, ("y",)), ("y", 28, ("x",)), ("y", -1, ("x", "z")),
        ("y", -1, ("y",)), ("z", 1, ("x", "y")), ("z", Fraction(-8, 3), ("z",)),
    ]  # fmt: skip
    terms = [(i, number(c), variables) for i, c, variables in lorenz]
    plain = r"-13\.6667\nhint: look for a sign or a missing term$"
    with pytest.raises(ValueError, match=plain):
        PolynomialField.from_terms(("x", "y", "z"), [(i, float(c), v) for i, c, v in lorenz])
    with pytest.raises(ValueError, match=r"div f contains -13\.6667, 1 of its terms"):
        PolynomialField.from_terms(("x", "y", "z"), terms, repair=True)
    # the sums of two monomials, on either side of the limit
    within = [(0, 1.0, (0, 1)), (1, -0.5 + 0.99e-3, (1, 1))]
    beyond = [(0, 1.0, (0, 1)), (1, -0.5 + 1.01e-3, (1, 1))]
    assert terms_of(given_terms(*within, repair=True))
    with pytest.raises(ValueError, match=r"0\.00202 \* y, 0\.00101 of its terms"):
        given_terms(*beyond, repair=True)


# --- SymPy ---------------------------------------------------------------------------------------


def test_without_sympy_the_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(ImportError, match="need sympy\nhint: pip install sympy"):
        PolynomialField.from_sympy([SYMBOLS[1], SYMBOLS[0]], SYMBOLS[:2])


def test_sympy_parameters_time_and_invariants():
    (x, y, z), t, k = SYMBOLS, sympy.Symbol("t"), sympy.Symbol("k")
    field = PolynomialField.from_sympy(
        [sympy.sqrt(k) * y * sympy.sin(t), (x - z) ** 2 / k, sympy.Poly(k * x * y, x, y)],
        (x, y, z),
        t=t,
        params={k: 4.0},
        invariants={"radius": x**2 + y**2 / k, "t": lambda t, x, params: t},
    )
    q = np.array([0.3, -0.2, 0.5, 1.1])
    expected = [2 * q[1] * np.sin(1.1), (q[0] - q[2]) ** 2 / 4, 4 * q[0] * q[1], 1]
    np.testing.assert_allclose(field.terms.evaluate(q), expected, rtol=1e-15)
    other = field.with_params({"k": 1.0}).terms.evaluate(q)
    np.testing.assert_allclose(other[:2], [expected[0] / 2, expected[1] * 4], rtol=1e-15)
    tape, _ = field.observer(None)
    values = tape.map(np.array([4.0]), [np.array([[1.1]]), q[None, :3]])
    np.testing.assert_allclose(values, [[0.09 + 0.01, 1.1]], rtol=1e-14)


def test_sympy_matrices_floats_and_symbols_with_assumptions_are_taken():
    x, y = sympy.symbols("x y", real=True)
    k = sympy.Symbol("k", positive=True)
    rows = sympy.Matrix([0.25 * y + sympy.Poly(k * y**2, y).as_expr(), sympy.cos(sympy.pi) * x])
    field = PolynomialField.from_sympy(rows, [x, y], params={"k": 3.0})
    expected = {(0, (1,)): 0.25, (0, (1, 1)): 3, (1, (0,)): -1}
    assert terms_of(field) == expected
    assert field.terms.is_exact


def test_what_sympy_cannot_expand_is_refused():
    x, y, _ = SYMBOLS
    for bad, message in (
        (sympy.exp(x), r"component 'x' contains exp\(x\), which is no polynomial"),
        (y / x, r"component 'x' contains 1/x, which is no polynomial"),
        (sympy.gamma(y), r"component 'x' contains gamma\(y\), which has no place on a tape"),
        (sympy.Symbol("k") * y, r"'k' is neither a coordinate nor a parameter\nhint: give it"),
        (sympy.I * y, r"component 'x' contains I, which is 0\+1j"),
    ):
        with pytest.raises(ValueError, match=message):
            PolynomialField.from_sympy([bad, 0, 0], SYMBOLS)
    with pytest.raises(TypeError, match=r"coordinates must be symbols of SymPy's, not 'x'"):
        PolynomialField.from_sympy([y, x, 0], ["x", "y", "z"])
    with pytest.raises(ValueError, match=r"the field must have 3 expressions, not 2"):
        PolynomialField.from_sympy([y, x], SYMBOLS)


# --- starts and what is recorded -----------------------------------------------------------------

FIELD = given_terms(*TERMS)

BAD_STARTS = [
    (ValueError, {"x": [1, 2]}, False, r"x must have shape \(3,\), not \(2,\)"),
    (ValueError, {"x": [1, math.nan, 2]}, False, r"x of 'y' must be finite, not nan"),
    (ValueError, {"x": {"x": 1, "y": 2}}, False, r"x must name x, y, z, not x, y"),
    (TypeError, {"x": "abc"}, False, r"x must be an array of real numbers, not 'abc'"),
    (TypeError, {"q": [1, 2, 3]}, False, r"'q' is no start value of this system"),
    (TypeError, {}, False, r"start value 'x' is missing"),
    (ValueError, {"x": [1, 2, 3]}, True, r"x must have shape \(P, 3\) for P members, not \(3,\)"),
    (ValueError, {"x": np.zeros((0, 3))}, True, r"shape \(P, 3\) for P members"),
    (
        ValueError,
        {"x": [[1, 2, 3], [1, 2, math.inf]]},
        True,
        r"x of 'z' of member 1 must be finite, not inf",
    ),
]


@pytest.mark.parametrize(("kind", "start", "members", "message"), BAD_STARTS)
def test_a_wrong_start_is_refused(kind, start, members, message):
    with pytest.raises(kind, match=message):
        FIELD.start(start, members)


def test_starts_may_be_given_by_name():
    np.testing.assert_array_equal(FIELD.start({"x": {"z": 3, "x": 1, "y": 2}}), [1.0, 2, 3])
    members = FIELD.start({"x": {"x": [1, 4], "y": [2, 5], "z": [3, 6]}}, members=True)
    np.testing.assert_array_equal(members, [[1.0, 2, 3], [4, 5, 6]])


def test_functions_and_matrices_are_recorded():
    matrix = np.array([[1.0, 2, 0], [0, 0, 0], [0, 0, -1]])
    field = given_terms(
        *TERMS,
        invariants={
            "function": lambda t, x, params: t + x[0] ** 3,
            "diagonal": [1.0, 2.0, 3.0],
            "dense": matrix,
            "sparse": scipy.sparse.csr_array(matrix),
            "linear": [[1.0, 0.0, -1.0]],
        },
    )
    assert field.invariants == ("function", "diagonal", "dense", "sparse", "linear")
    tape, widths = field.observer({"twice": lambda t, x, params: 2 * x})
    assert list(widths.values()) == [1, 1, 1, 1, 1, 3]
    assert list(widths)[-1] == "observed twice"
    x = np.array([2.0, -1, 0.5])
    form = x @ matrix @ x
    expected = [8.25, 4 + 2 + 0.75, form, form, 1.5, 4, -2, 1]
    np.testing.assert_allclose(
        tape.map(np.empty(0), [np.array([[0.25]]), x[None]])[0], expected, rtol=1e-15
    )


def test_an_invariant_of_the_wrong_size_is_refused():
    with pytest.raises(ValueError, match=r"invariant 'e' must be a matrix of order 3, not 2"):
        given_terms(*TERMS, invariants={"e": np.ones(2)})
    with pytest.raises(ValueError, match=r"invariant 'e' must return a scalar, not 3 values"):
        given_terms(*TERMS, invariants={"e": lambda t, x, params: x})
