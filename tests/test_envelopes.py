"""Drives with complex envelopes, z K and its Hermitian conjugate."""

import pickle

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

import liouville as lv

RAISE = np.array([[0.0, 1.0], [0.0, 0.0]])
SPLIT = np.diag([0.3, -0.3])
OMEGA, NU = 0.8, 0.7
PARAMS = {"W": OMEGA, "nu": NU}


def z(t, params):
    return 0.5 * params.W * np.exp(1j * params.nu * t)


def conjugate(t, params):
    return 0.5 * params.W * np.exp(-1j * params.nu * t)


def turning(t):
    """Return the state from (1, 0) on, in closed form: H is constant in a frame that turns."""
    half = 0.5 * NU
    h = np.array([[0.3 + half, OMEGA / 2], [OMEGA / 2, -0.3 - half]])
    levels, vectors = np.linalg.eigh(h)
    rotated = vectors @ (np.exp(-1j * levels * t) * vectors.T[:, 0])
    return np.exp(1j * half * t * np.array([1, -1])) * rotated


GIVEN = {
    "one function of complex values": lambda: lv.Schrodinger(
        SPLIT, drive=[(z, RAISE)], params=PARAMS
    ),
    "both terms": lambda: lv.Schrodinger(
        SPLIT, drive=[(z, RAISE), (conjugate, RAISE.T)], params=PARAMS
    ),
    "a list as QuTiP has it": lambda: lv.Schrodinger(
        [
            SPLIT,
            [RAISE, lambda t, args: 0.5 * args["W"] * np.exp(1j * args["nu"] * t)],
            [RAISE.T, lambda t, args: 0.5 * args["W"] / np.exp(1j * args["nu"] * t)],
        ],
        params=PARAMS,
    ),
    "a pair of functions": lambda: lv.Schrodinger(
        SPLIT,
        drive=[
            (
                (
                    lambda t, params: 0.5 * params.W * ca.cos(params.nu * t),
                    lambda t, params: 0.5 * params.W * ca.sin(params.nu * t),
                ),
                sp.csr_array(RAISE),
            )
        ],
        params=PARAMS,
    ),
    "samples": lambda: lv.Schrodinger(
        SPLIT,
        drive=[(0.5 * OMEGA * np.exp(1j * NU * np.linspace(0, 5, 2001)), RAISE)],
        times=np.linspace(0, 5, 2001),
    ),
}


@pytest.mark.parametrize("given", GIVEN.values(), ids=GIVEN)
def test_an_envelope_is_that_of_both_terms_however_it_is_given(given):
    system = given()
    assert len(system.drives) == 2
    run = lv.integrate(system, "auto", t=(0, 5), psi=[1, 0])
    assert np.linalg.norm(run.psi[-1] - turning(5.0)) < 2e-8
    again = lv.integrate(pickle.loads(pickle.dumps(system)), "auto", t=(0, 5), psi=[1, 0])
    assert np.array_equal(run.psi, again.psi)


def test_arithmetic_of_envelopes_is_that_of_numpy():
    def envelope(t, p):
        gauss = np.exp(-((t - p.c) ** 2)) + abs(p.v[0] + 1j * t) - (2 - 1j) / (p.v[1] + 1j * t)
        return -gauss * np.cos(t) * np.conj(1j * t + 0.3) ** 2 - np.sqrt(t + p.c) + p.v[1] ** -2

    values = {"c": 0.4, "v": np.array([0.7, 1.9])}
    system = lv.Schrodinger(SPLIT, drive=[(envelope, RAISE)], params=values)
    times = np.linspace(0.1, 2, 7)
    names = type("P", (), values)
    exact = np.array([envelope(t, names) for t in times])
    found = system.drive_values(times)
    assert np.abs(found[:, 0] + 1j * found[:, 1] - exact).max() < 1e-13


def test_derivatives_by_parameters_go_through_an_envelope():
    system = lv.Schrodinger(SPLIT, drive=[(z, RAISE)], params=PARAMS)
    solution, pullback = lv.vjp(system, "auto", t=(0, 3), psi=[1, 0], wrt=["params.nu"])
    found = pullback(psi=2 * solution.psi * [[0, 0], [1, 0]])["params.nu"]
    ends = [
        abs(
            lv.integrate(system, lv.Chebyshev(1e-11), t=(0, 3), psi=[1, 0], params={"nu": nu}).psi[
                -1, 0
            ]
        )
        ** 2
        for nu in (NU - 1e-4, NU + 1e-4)
    ]
    assert abs(found - (ends[1] - ends[0]) / 2e-4) < 1e-6


def test_what_makes_no_hermitian_matrix_is_refused():
    with pytest.raises(ValueError, match=r"drive\[1\] is not the conjugate of drive\[0\]"):
        lv.Schrodinger(SPLIT, drive=[(z, RAISE), (z, RAISE.T)], params=PARAMS)
    with pytest.raises(ValueError, match="H1 is not Hermitian"):
        lv.Schrodinger(SPLIT, drive=[(lambda t, params: ca.cos(t), RAISE)])
    with pytest.raises(ValueError, match="H1 is not Hermitian"):
        lv.Schrodinger(SPLIT, drive=[(lambda t, params: np.cos(t), RAISE)])
    with pytest.raises(TypeError, match=r"has complex values.*\n.*drive \(\(x, y\), K\)"):
        lv.Schrodinger(SPLIT, drive=[(z, RAISE + RAISE.T)], params=PARAMS)
    with pytest.raises(ValueError, match=r"the samples of drive\[0\] are complex"):
        lv.Schrodinger(SPLIT, drive=[([1, 1j, 1], RAISE + RAISE.T)], times=[0, 1, 2])


@pytest.mark.parametrize("default", [{"W": 0.0, "nu": NU}, {"W": OMEGA, "nu": 0.0}])
def test_an_envelope_that_is_real_at_the_default_parameters_is_complex_at_others(default):
    system = lv.Schrodinger(SPLIT, drive=[(z, RAISE)], params=default)
    run = lv.integrate(system, t=(0, 2), psi=[1, 0], params=PARAMS)
    np.testing.assert_allclose(run.psi[-1], turning(2.0), atol=1e-7)
    for both in ([(z, RAISE), (z, RAISE.T)], [(conjugate, RAISE.T), (conjugate, RAISE)]):
        with pytest.raises(ValueError, match="is not the conjugate of"):
            lv.Schrodinger(SPLIT, drive=both, params={"W": OMEGA, "nu": 0.0})


POWERS = {
    "of a real number": lambda t, params: 0.5 * params.W * np.exp(params.nu) ** (1j * t),
    "of a NumPy number": lambda t, params: 0.5 * params.W * np.float64(np.exp(NU)) ** (1j * t),
    "of a float": lambda t, params: 0.5 * params.W * float(np.exp(NU)) ** (1j * t),
    "a third one": lambda t, params: 0.5 * params.W * np.exp(1j * params.nu * t / 3) ** 3,
}


@pytest.mark.parametrize("envelope", POWERS.values(), ids=POWERS)
def test_powers_of_complex_numbers_are_their_own(envelope):
    system = lv.Schrodinger(SPLIT, drive=[(envelope, RAISE)], params=PARAMS)
    run = lv.integrate(system, t=(0, 2), psi=[1, 0])
    np.testing.assert_allclose(run.psi[-1], turning(2.0), atol=1e-7)
