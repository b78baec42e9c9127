"""What the alpha methods do to an oscillation: their amplification matrices, measured and known.

With W = omega h, one step on q'' = -omega^2 q maps (q, h v, h^2 a) by a 3 by 3 matrix.
"""

import casadi as ca
import numpy as np
import pytest

import liouville as lv

ALPHAS, RHOS = (0.0, -0.05, -0.1, -0.2, -0.3, -1 / 3), (0.0, 0.3, 0.5, 0.8, 0.9, 1.0)
METHODS = [*map(lv.HHT, ALPHAS), *map(lv.GeneralizedAlpha, RHOS), lv.ArnoldBruls(0.8)]

OSCILLATOR = lv.Lagrangian(
    lambda t, q, v, params: (ca.dot(v, v) - params.w**2 * ca.dot(q, q)) / 2,
    q=("x",),
    params={"w": 1.0},
)


def measured(method, w):
    """Return the matrix whose columns are steps of size 1 from unit starts."""
    columns = []
    for q, v, a in np.eye(3):
        start = {"q": [q], "v": [v], "a": [a]}
        found = lv.integrate(OSCILLATOR, method, t=(0.0, 1.0), steps=1, params={"w": w}, **start)
        columns.append([found.q[-1, 0], found.v[-1, 0], found.a[-1, 0]])
    return np.array(columns).T


def known(am, af, gamma, beta, w):
    """Return L^-1 R, with L x1 = R x0 the step's equations as Chung and Hulbert write them."""
    left = [[1, 0, -beta], [0, 1, -gamma], [(1 - af) * w**2, 0, 1 - am]]
    right = [[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-af * w**2, 0, -am]]
    return np.linalg.solve(left, right)


def radius(matrix):
    return np.abs(np.linalg.eigvals(matrix)).max()


@pytest.mark.parametrize("w", [1e-3, 0.3, 1.0, 10.0, 1e3])
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_the_amplification_matrix_is_the_known_one(method, w):
    expected = known(*method.coefficients, w)
    # forces of size w^2 cancel but for roundoff
    limit = 1e-14 * np.abs(expected).max() + 1e-16 * w**2
    np.testing.assert_allclose(measured(method, w), expected, rtol=0, atol=limit)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_no_oscillation_grows(method):
    for w in np.logspace(-3, 6, 91):
        assert radius(known(*method.coefficients, w)) <= 1 + 1e-7


@pytest.mark.parametrize("alpha", ALPHAS)
def test_hht_leaves_of_a_fast_oscillation_what_its_alpha_says(alpha):
    # at -1/3 all three eigenvalues meet there, and roundoff counts by its cube root
    assert radius(measured(lv.HHT(alpha), 1e5)) == pytest.approx(
        (1 + alpha) / (1 - alpha), abs=1e-4 if alpha > -1 / 3 else 1e-3
    )


@pytest.mark.parametrize("rho", RHOS)
def test_generalized_alpha_leaves_of_a_fast_oscillation_its_rho(rho):
    # all three eigenvalues are -rho there, and roundoff parts them by its third root
    assert radius(measured(lv.GeneralizedAlpha(rho), 1e5)) == pytest.approx(rho, abs=1e-3)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_slow_oscillations_are_damped_by_the_third_power_of_their_frequency(method):
    """The damping ratio is (af - am)(1 - am - af)^2 W^3 / 8 to leading order."""
    am, af, *_ = method.coefficients
    leading = (af - am) * (1 - am - af) ** 2 / 8
    for w in (0.05, 0.1):
        value = max(np.linalg.eigvals(measured(method, w)), key=np.imag)
        ratio = -np.log(np.abs(value)) / np.angle(value)
        assert ratio == pytest.approx(leading * w**3, rel=5 * w, abs=1e-13)


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_slow_oscillations_are_slowed_by_the_square_of_their_frequency(method):
    am, af, *_ = method.coefficients
    leading = 3 * af**2 / 8 - af * am / 4 - af / 4 - am**2 / 8 + am / 4 - 1 / 12
    for w in (0.05, 0.1):
        value = max(np.linalg.eigvals(measured(method, w)), key=np.imag)
        assert np.angle(value) / w - 1 == pytest.approx(leading * w**2, rel=5 * w)


def test_of_two_methods_with_the_same_radius_generalized_alpha_damps_slow_oscillations_less():
    for rho in (0.6, 0.8, 0.9):
        hht, generalized = (
            radius(measured(method, 0.3))
            for method in (lv.HHT((rho - 1) / (rho + 1)), lv.GeneralizedAlpha(rho))
        )
        assert hht < generalized < 1
