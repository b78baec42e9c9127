"""Fields as arrays of terms: sums, parts, derivatives and the divergence, told from plain loops."""

from collections import defaultdict
from fractions import Fraction
from math import prod

import numpy as np
import pytest
from fields import SINE, abc_flow, lorenz96, random_exact
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from liouville._systems.fields.terms import Terms, Wave

N = 4
FEW = examples(40)
numbers = st.fractions(-3, 3, max_denominator=8)
rows = st.lists(
    st.tuples(st.integers(0, N - 1), numbers, st.lists(st.integers(0, N - 1), max_size=4)),
    max_size=20,
)
points = st.lists(numbers, min_size=N, max_size=N)


def plainly(terms, x):
    """Return the field at x, by its definition."""
    f = [Fraction(0)] * N
    for i, c, factors in terms:
        f[i] += c * prod(x[v] for v in factors)
    return f


def divergence(terms, x):
    total = Fraction(0)
    for i, c, factors in terms:
        left = list(factors)
        if i in left:
            left.remove(i)
            total += c * factors.count(i) * prod(x[v] for v in left)
    return total


@FEW
@given(rows, points)
def test_merging_keeps_the_field_and_leaves_each_monomial_once(given_rows, x):
    terms = Terms.of(N, given_rows)
    keys = [
        (i, tuple(row))
        for i, row in zip(terms.component.tolist(), terms.variables.tolist(), strict=True)
    ]
    assert keys == sorted(set(keys))
    assert (terms.coefficient != 0).all()
    assert terms.evaluate(np.array(x, dtype=object)).tolist() == plainly(given_rows, x)


@FEW
@given(rows, rows, points)
def test_sums_differences_and_parts(left, right, x):
    a, b, x_ = Terms.of(N, left), Terms.of(N, right), np.array(x, dtype=object)
    assert ((a + b).evaluate(x_) == a.evaluate(x_) + b.evaluate(x_)).all()
    assert ((a - b).evaluate(x_) == a.evaluate(x_) - b.evaluate(x_)).all()
    assert len(a - a) == 0
    assert len(a.diagonal() + a.off_diagonal() - a) == 0
    assert not any(i in v for i, v in zip(*parts(a.off_diagonal()), strict=True))
    assert all(i in v for i, v in zip(*parts(a.diagonal()), strict=True))


def parts(terms):
    return terms.component.tolist(), terms.variables.tolist()


@FEW
@given(rows, points)
def test_divergence_is_the_sum_of_derivatives(given_rows, x):
    terms, at = Terms.of(N, given_rows), np.array(x, dtype=object)
    assert terms.divergence().evaluate(at)[0] == divergence(given_rows, x)
    trace = sum(terms.derivative(v).evaluate(at)[v] for v in range(N))
    assert trace == divergence(given_rows, x)


def test_millions_of_terms_are_merged_told_apart_and_checked():
    n = 1_000_000
    terms = lorenz96(n)
    twice = terms.joined(terms).merged()
    assert len(twice) == len(terms) == 2 * n
    assert len(twice.diagonal()) == 0
    assert twice.offending() == []
    spoilt = terms.joined(Terms(n, [3], [0.5], [[3, 7]]))
    assert spoilt.offending() == [((7,), 0.5)]


@pytest.mark.parametrize(
    ("field", "left"),
    [
        ("sprott_a", [((2,), 1)]),  # x' = y, y' = -x + y z, z' = 1 - y^2
        ("nose_hoover", [((2,), -1)]),  # q' = p, p' = -q - xi p, xi' = p^2 - 1
        ("squares", [((), 3), ((0,), 2), ((0, 1), Fraction(9, 2))]),
    ],
)
def test_a_divergence_is_found_by_its_monomials(field, left):
    given_rows = {
        "sprott_a": [(0, 1, [1]), (1, -1, [0]), (1, 1, [1, 2]), (2, 1, []), (2, -1, [1, 1])],
        "nose_hoover": [(0, 1, [1]), (1, -1, [0]), (1, -1, [2, 1]), (2, 1, [1, 1]), (2, -1, [])],
        "squares": [(0, 3, [0]), (0, 1, [0, 0]), (1, "9/4", [1, 0, 1])],
    }[field]
    terms = Terms.of(3, given_rows)
    assert terms.offending() == left
    assert terms.to_float().offending() == left


def test_names_of_monomials():
    terms = Terms.none(3)
    assert terms.written((0, 2, 2), ["u", "v", "w"]) == "u*w**2"
    assert terms.written((), ["u", "v", "w"]) == "1"
    waved = Terms.of(2, [(0, 1, [2])], (Wave((0, 1), (2.0, -1.0)),))
    assert waved.written((1, 2), ["u", "v"]) == "v*cos(2*u - v)"


def test_roundoff_is_no_divergence_and_little_more_is():
    sums = Terms.of(3, [(0, 0.1, [0, 0]), (1, 0.2, [0, 1]), (2, -0.4, [0, 2])])
    assert sums.divergence().coefficient.tolist() != [0.0]  # 2 * 0.1 + 0.2 - 0.4, rounded
    assert sums.offending() == []
    off = Terms.of(3, [(0, 0.1, [0, 0]), (1, 0.2, [0, 1]), (2, -0.4 * (1 + 1e-13), [0, 2])])
    assert len(off.offending()) == 1


def test_noise_of_sums_is_dropped_on_request():
    terms = Terms(1, [0, 0, 0], [0.1, 0.2, -0.3], [[-1], [-1], [-1]])
    assert len(terms.merged()) == 1
    assert len(terms.merged(noise=1e-15)) == 0


@FEW
@given(rows)
def test_repairing_is_the_orthogonal_projection(given_rows):
    terms = Terms.of(N, given_rows)
    repaired = terms.repaired()
    assert repaired.offending() == []
    # what is taken away is a multiple of the weights of each monomial of the divergence
    multiples = defaultdict(set)
    taken = terms - repaired
    for i, c, factors in zip(taken.component, taken.coefficient, taken.variables, strict=True):
        left = factors.tolist()
        left.remove(i)
        multiples[tuple(left)].add(c / (left.count(i) + 1))
    assert all(len(each) == 1 for each in multiples.values())


def test_repairing_leaves_a_field_without_divergence_alone():
    terms = random_exact(4, 3, seed=0)
    assert len(terms.repaired() - terms) == 0


def test_exact_coefficients_are_recognised():
    assert Terms.of(2, [(0, "-3/8", [1]), (1, 2, [0])]).is_exact
    assert not Terms.of(2, [(0, "-3/8", [1]), (1, 2.0, [0])]).is_exact
    exact, rounded = random_exact(3, 2, 1), random_exact(3, 2, 1).to_float()
    assert exact.joined(rounded).is_exact is False


# Waves


def waves():
    return (
        Wave((0,), (1.0,), SINE),
        Wave((1,), (1.0,)),
        Wave((0, 1), (2.0, -0.5), 0.3),
        Wave((0,), (-1.0,), 1.1),
    )


def test_derivatives_of_products_of_waves():
    terms = Terms.of(2, [(0, 1.5, (2, 3, 1)), (1, -2.0, (4, 4, 5, 0)), (1, 0.3, (0, 0))], waves())
    x, step = np.array([0.3, 0.7]), 1e-5
    for v in range(2):
        e = step * np.eye(2)[v]
        slope = (terms.evaluate(x + e) - terms.evaluate(x - e)) / (2 * step)
        assert np.allclose(terms.derivative(v).evaluate(x), slope, atol=1e-8)


def test_products_of_waves_are_sums_of_cosines_and_sines():
    terms = Terms.of(2, [(0, 1.5, (2, 3, 1)), (1, -2.0, (4, 4, 5, 0)), (1, 0.3, (0, 0))], waves())
    resolved = terms.resolved()
    assert ((resolved.variables >= 2).sum(axis=1) <= 1).all()
    assert {wave.phase for wave in resolved.functions} == {0.0, SINE}
    assert all(wave.k[0] > 0 for wave in resolved.functions)
    x = np.random.default_rng(0).normal(size=(5, 2))
    assert np.allclose(resolved.evaluate(x), terms.evaluate(x), atol=1e-14)


def test_divergence_of_waves():
    assert abc_flow(1, "1/2", 3).offending() == []
    sin_x, cos_x, sin_y, cos_y = range(2, 6)
    factors = tuple(Wave((v,), (1.0,), phase) for v in (0, 1) for phase in (SINE, 0.0))
    cells = [(0, 1, (sin_x, cos_y)), (1, -1, (cos_x, sin_y))]
    assert Terms.of(2, cells, factors).offending() == []
    spoilt = Terms.of(2, [*cells, (1, 2, (cos_x, sin_y))], factors)  # 2 cos x cos y too much
    (monomial, value), *others = spoilt.offending()
    assert len(others) == 1
    assert value == pytest.approx(1.0)
    assert spoilt.excess().written(monomial, "xy") == "cos(x + y)"
    turned = Terms.of(2, [(0, 1.0, (2,)), (1, -1.0, (3,))], (
        Wave((0, 1), (1.0, 1.0), np.pi / 2), Wave((0, 1), (-1.0, -1.0), SINE),
    ))  # fmt: skip
    assert turned.offending() == []  # both are -sin(x + y)
