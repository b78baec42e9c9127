"""The composition schemes: their digits satisfy the order conditions, and the core steps with them.

The conditions are checked in the free algebra of letters E_1, E_2, ... of degrees 1, 2, ..., in
which a general step and its adjoint are

    Phi_a = exp(a E_1 + a^2 E_2 + a^3 E_3 + ...),    Phi*_a = exp(a E_1 - a^2 E_2 + a^3 E_3 - ...)

A composition has order p if it equals exp(E_1) in all words of degree at most p: the coefficient
of the word E_i E_j .. E_k of r letters in Phi_a is a^(i + j + .. + k) / r!.
"""

from fractions import Fraction
from functools import partial
from math import factorial

import plain_splitting as plain
import pytest
from flint import arb, ctx
from mpmath import mp, mpf

from liouville import _core

SCHEMES = _core.compositions()


@pytest.fixture(autouse=True)
def digits():
    """Compute with more digits than there are."""
    with mp.workdps(45), ctx.workdps(60):
        yield


def mirrored(half, middle):
    return [*half, *middle, *half[::-1]]


def flows(scheme):
    """(is_adjoint, alpha) of a scheme, from its digits."""
    numbers = {name: [mpf(x) for x in texts] for name, texts in scheme["digits"].items()}
    if scheme["kind"] == "basic":
        return [(False, mpf(1))]
    if scheme["kind"] == "symmetric":
        *half, middle = numbers["gammas"]
        gammas = mirrored(half, [middle])
        return [(is_adjoint, gamma / 2) for gamma in gammas for is_adjoint in (True, False)]
    a, b = numbers["a"], numbers["b"]
    is_a_left = len(a) == len(b)
    middle = 1 - 2 * sum(a if is_a_left else b)
    a, b = (mirrored(a, [middle]), mirrored(b, [])) if is_a_left else (
        mirrored(a, []), mirrored(b, [middle])
    )  # fmt: skip
    merged = [x for pair in zip(a, b, strict=False) for x in pair] + a[-1:]
    alphas = [merged[0]]
    for coefficient in merged[1:-1]:
        alphas.append(coefficient - alphas[-1])
    assert abs(alphas[-1] - merged[-1]) < mpf(10) ** -38
    return [(k % 2 == 1, alpha) for k, alpha in enumerate(alphas)]


def words(degree):
    """Tuples of positive integers with this sum."""
    if degree == 0:
        return [()]
    return [(k, *rest) for k in range(1, degree + 1) for rest in words(degree - k)]


def residuals(flows, most):
    """Largest difference to exp(E_1) among words of each degree up to `most`, by intervals.

    Of the last degree, words of one and two letters: that one is off says that the order ends.
    """
    of_degree = [words(degree) for degree in range(most)]
    of_degree.append([word for word in words(most) if len(word) <= 2])
    all_words = [word for each in of_degree for word in each]
    series = {word: arb(word == ()) for word in all_words}
    for is_adjoint, alpha in flows:
        powers = [arb(mp.nstr(alpha, 45)) ** k for k in range(most + 1)]

        def letters(word, is_adjoint=is_adjoint, powers=powers):
            even = sum(k % 2 == 0 for k in word) if is_adjoint else 0
            return (-1) ** even * powers[sum(word)] / factorial(len(word))

        step = {word: letters(word) for word in all_words}
        series = {
            word: sum((series[word[:k]] * step[word[k:]] for k in range(len(word) + 1)), arb(0))
            for word in all_words
        }
    exact = {word: arb(set(word) <= {1}) / factorial(len(word)) for word in all_words}
    return [
        max(float(abs(series[word] - exact[word]).upper()) for word in each) for each in of_degree
    ]


@pytest.mark.parametrize("name", SCHEMES)
def test_a_scheme_satisfies_the_conditions_of_its_order_and_no_more(name):
    scheme = SCHEMES[name]
    found = residuals(flows(scheme), scheme["order"] + 1)
    assert max(found[:-1]) < mpf(10) ** -37
    assert found[-1] > 1e-9


@pytest.mark.parametrize("name", SCHEMES)
def test_the_core_steps_with_the_fractions_of_the_digits(name):
    scheme = SCHEMES[name]
    wanted = flows(scheme)
    assert [is_adjoint for is_adjoint, _ in wanted] == [x for x, _ in scheme["flows"]]
    for (_, exact), (_, alpha) in zip(wanted, scheme["flows"], strict=True):
        assert abs(mpf(alpha) - exact) <= abs(exact) * mpf(2) ** -53


def test_a_wrong_digit_is_seen():
    wrong = [(kind, alpha + (k in (0, 1)) * mpf(10) ** -36) for k, (kind, alpha) in
             enumerate(flows(SCHEMES["SS8s21"]))]  # fmt: skip
    assert max(residuals(wrong, 8)[:-1]) > mpf(10) ** -37


THIRD = [[0, 0, 0], [0.5, 0, 0], [-1, 2, 0]], [0.25, 0.5, 0.25]
EXAMPLE = [
    # x_0' = x_1 x_2 / 2 - 1/4
    ("natural", [0], [0, 0], [0.5, -0.25], [[1, 2], [-1, -1]], []),
    # (1, -1, 0) (x_0 + x_1)^2 / 4
    ("shear", [0, 1], [1, -1], [0] * 3, [0.25, 0.5, 0.25], [[0, 0], [0, 1], [1, 1]], []),
    ("scaling", [0, 1], [0, 1], [0.5, -0.5], [[2], [2]]),
    # x_0' = 3/4 x_0^2, x_1' = -x_0 x_1, x_2' = -x_0 x_2 / 2: alpha = 3/4
    ("exponential", [0, 1, 2], [0.75, -1, -0.5], [0]),
    ("triangular", [2, 0, 1], [1, 2, 2], [0.5, 1, -0.75], [[2, 2], [0, 2], [0, 0]], *THIRD),
    ("affine", [[0.25, 1, 0], [-1, -0.5, 0.5], [0, 0, 0.25]], [0, 0.125, 0]),
]
START = [Fraction(1, 5), Fraction(-1, 3), Fraction(2, 7)]


def distance(x, y):
    return max(abs(mpf(1) * a - b) for a, b in zip(x, y, strict=True))


def test_plain_pieces_move_along_their_fields_and_keep_volume():
    h = mpf(1) / 8
    for piece in EXAMPLE:
        wanted = plain.solution(plain.field([piece]), START, h, 2)
        found = plain.flow(piece, False, START, h)
        is_exact = piece[0] != "triangular"
        assert (distance(found, wanted) < mpf(10) ** -40) == is_exact
        assert distance(found, wanted) < h**3
        for is_adjoint in (False, True):
            move = partial(plain.flow, piece, is_adjoint, h=h)
            assert abs(plain.determinant(move, START) - 1) < mpf(10) ** -18


def test_the_plain_adjoint_undoes_the_step_of_minus_h():
    rational = [piece for piece in EXAMPLE if piece[0] in ("natural", "shear", "triangular")]
    h = Fraction(3, 8)
    there = plain.basic(rational, False, START, -h)
    assert plain.basic(rational, True, there, h) == START
    assert plain.basic(rational, False, there, h) != START
    there = plain.basic(EXAMPLE, False, START, -h)
    assert distance(plain.basic(EXAMPLE, True, there, h), START) < mpf(10) ** -43


@pytest.fixture(scope="module")
def sample():
    """Return pieces, a start, and where the sum of the pieces leads it in a quarter."""
    with mp.workdps(45):
        pieces, start = plain.in_digits(EXAMPLE[1:5]), plain.in_digits(START)
        return pieces, start, plain.solution(plain.field(pieces), start, mpf(1) / 4, 2)


@pytest.mark.parametrize("name", SCHEMES)
def test_a_composition_has_its_order_in_many_digits(name, sample):
    scheme, (pieces, start, wanted) = SCHEMES[name], sample
    maps = flows(scheme)
    errors = [
        distance(plain.walk(pieces, maps, start, mpf(1) / (4 * n), n), wanted) for n in (2, 4)
    ]
    assert abs(mp.log(errors[0] / errors[1], 2) - scheme["order"]) < 0.1
    assert errors[1] > mpf(10) ** -38
