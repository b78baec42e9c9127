"""Propagators, and the modes of a period."""

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import j0, jn_zeros

import liouville as lv

X, Y, Z = np.array([[0, 1], [1, 0]]), np.array([[0, -1j], [1j, 0]]), np.diag([1, -1])


def turning(b=0.4, w=1.3, e=0.8):
    """Return a spin in a field that turns, its frequency, and H in the frame that turns with it."""
    drive = [(lambda t, params: ca.cos(w * t), b * X), (lambda t, params: ca.sin(w * t), b * Y)]
    return lv.Schrodinger(e * Z, drive=drive), w, (e - w / 2) * Z + b * X


def chain(params):
    drive = [(lambda t, params: params.a * ca.cos(2 * t), np.diag(np.arange(6.0)))]
    return lv.Schrodinger(lv.Lattice(6), drive=drive, params=params)


def test_the_propagator_of_a_static_matrix_is_its_exponential():
    parts = np.random.default_rng(0).normal(size=(2, 7, 7))
    h = parts[0] + parts[0].T + 1j * (parts[1] - parts[1].T)
    system = lv.Schrodinger(h, hbar=0.5)
    assert np.abs(lv.analysis.propagator(system, t=(0, 2)) - expm(-4j * h)).max() < 1e-8
    assert np.abs(lv.analysis.propagator(system, t=(2, 0)) - expm(4j * h)).max() < 1e-8


def test_the_propagator_of_one_component_is_a_phase():
    assert (
        np.abs(lv.analysis.propagator(lv.Schrodinger([[2.0]]), t=(1, 2)) - np.exp(-2j)).max() < 1e-8
    )


def test_a_turning_field_has_the_quasienergies_of_its_frame():
    system, w, frame = turning()
    period = 2 * np.pi / w
    modes = lv.analysis.floquet(system, period, lv.Chebyshev(1e-10))
    levels = np.linalg.eigvalsh(frame) + w / 2  # the frame turns once with half a phase each
    wanted = np.sort((levels + w / 2) % w - w / 2)
    assert np.abs(modes.quasienergies - wanted).max() < 1e-9
    assert modes.error < 1e-9
    start = np.array([0.6, 0.8j])
    rotated = expm(-1j * frame * 1000 * period) @ start * (-1) ** 1000
    assert np.abs(modes.after(start, 1000) - rotated).max() < 1e-6
    assert np.abs(modes.after(start, 0) - start).max() < 1e-14


def shirley(splitting, a, copies=30):
    """Return the two quasi-energies near zero of copies of two levels that a drive of 1 couples."""
    n = np.arange(-copies, copies + 1)
    one, next_to = np.eye(len(n)), np.eye(len(n), k=1) + np.eye(len(n), k=-1)
    levels = np.kron(np.diag(n), np.eye(2)) - splitting / 2 * np.kron(one, X)
    found = np.linalg.eigvalsh(levels + a / 4 * np.kron(next_to, Z))
    return found[np.abs(found) < 0.5]


def test_two_driven_levels_have_the_quasienergies_of_shirley_and_of_a_bessel_function():
    """A fast drive destroys tunnelling at a zero of J0, a slow one at weaker drives."""

    def modes(splitting, a):
        drive = [(lambda t, params: a / 2 * ca.cos(t), Z)]
        system = lv.Schrodinger(-splitting / 2 * X, drive=drive)
        return lv.analysis.floquet(system, 2 * np.pi, lv.Chebyshev(1e-12))

    for splitting in (0.3, 0.9):
        for a in (0.5, 1.5, 2.155, 4.0, 9.0):
            own = modes(splitting, a).quasienergies
            assert np.abs(own - shirley(splitting, a)).max() < 1e-11
    assert abs(modes(0.9, 2.155).quasienergies[1]) < 1e-4  # where they cross
    for a in (1.0, 4.0):  # of third order in the splitting
        assert np.abs(modes(1e-3, a).quasienergies[1] - 5e-4 * abs(j0(a))) < 1e-9
    stays = np.abs(modes(0.1, jn_zeros(0, 1)[0]).after([1, 0], np.arange(101))[:, 0]) ** 2
    assert stays.min() == pytest.approx(0.9978, abs=1e-4)


def test_modes_are_orthonormal_states_that_return():
    system = chain({"a": 1.0})
    modes = lv.analysis.floquet(system, np.pi, params={"a": 0.7}, t0=0.3)
    assert np.abs(modes.modes @ modes.modes.conj().T - np.eye(6)).max() < 1e-13
    many = lv.ensemble(
        system, lv.Chebyshev(1e-9), t=(0.3, 0.3 + np.pi), psi=modes.modes,
        params={"a": np.full(6, 0.7)},
    )  # fmt: skip
    phases = np.exp(-1j * modes.quasienergies * np.pi)[:, None]
    assert np.abs(many.psi[-1] - phases * modes.modes).max() < 1e-7
    assert (np.diff(modes.quasienergies) >= 0).all()
    assert (np.abs(modes.quasienergies) <= 1 + 1e-12).all()


def test_modes_of_equal_quasienergies_are_orthonormal_too():
    modes = lv.analysis.floquet(lv.Schrodinger(np.diag([1.0, 1.0, 1.0, 3.0])), 2 * np.pi)
    assert np.abs(modes.modes @ modes.modes.conj().T - np.eye(4)).max() < 1e-13


def test_a_half_of_a_period_is_no_period():
    with pytest.raises(ValueError, match="H is not periodic: at t = "):
        lv.analysis.floquet(chain({"a": 1.0}), np.pi / 2)


def test_bad_input_is_refused():
    system = chain({"a": 1.0})
    for period in (0.0, -1.0, np.inf):
        with pytest.raises(ValueError, match="period must be positive"):
            lv.analysis.floquet(system, period)
    with pytest.raises(TypeError, match="must be a Schrodinger equation"):
        lv.analysis.propagator(lv.Lattice(3), t=(0, 1))
    with pytest.raises(ValueError, match="at most 4096 components, not 5000"):
        lv.analysis.propagator(lv.Schrodinger(lv.Lattice(5000)), t=(0, 1))
    with pytest.raises(ValueError, match=r"must be a pair \(start, end\), not 3 times"):
        lv.analysis.propagator(system, t=(0, 1, 2))
    modes = lv.analysis.floquet(system, np.pi)
    with pytest.raises(ValueError, match=r"psi must have shape .6,., not .2,."):
        modes.after([1, 0], 3)
    with pytest.raises(TypeError, match="whole numbers"):
        modes.after(np.ones(6), 0.5)
