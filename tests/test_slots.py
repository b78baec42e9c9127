"""Drives of samples that hold up to the next time: controls in slots."""

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm, expm_frechet

import liouville as lv

RNG = np.random.default_rng(11)
SLOTS = 23
EDGES = np.sort(np.r_[0.0, RNG.uniform(0.0, 3.0, SLOTS - 1), 3.0])
U, V = RNG.normal(size=(2, SLOTS))


def hermitian(n):
    entries = RNG.normal(size=(n, n)) + 1j * RNG.normal(size=(n, n))
    return (entries + entries.conj().T) / 2


H0, B, C = (hermitian(5) for _ in range(3))
PSI = RNG.normal(size=5) + 1j * RNG.normal(size=5)
PSI /= np.linalg.norm(PSI)


def slotted(**more):
    return lv.Schrodinger(H0, drive=[(U, B), (V, C)], times=EDGES, order=0, **more)


def stepped(t0, t1, u=U, v=V):
    """Return the propagator from one time to a later one, by exponentials."""
    found = np.eye(5)
    for a, b, x, y in zip(EDGES[:-1], EDGES[1:], u, v, strict=True):
        length = min(b, t1) - max(a, t0)
        if length > 0:
            found = expm(-1j * length * (H0 + x * B + y * C)) @ found
    return found


@pytest.mark.parametrize("method", ["auto", lv.Chebyshev(1e-11), lv.Magnus(4, 1e-8)])
@pytest.mark.parametrize("span", [(0.0, 3.0), (0.37, 2.2), (EDGES[4], EDGES[9]), (0.0, EDGES[1])])
def test_each_slot_is_exact_forwards_and_back(method, span):
    tol = getattr(method, "tol", 1e-8)
    want = stepped(*span) @ PSI
    run = lv.integrate(slotted(), method, t=span, psi=PSI)
    assert np.linalg.norm(run.psi[-1] - want) <= tol
    back = lv.integrate(slotted(), method, t=span[::-1], psi=want)
    assert np.linalg.norm(back.psi[-1] - PSI) <= tol


def test_a_window_is_a_slot():
    plan = lv.plan(slotted(), t=(0, 3))
    assert plan.windows == SLOTS
    back = lv.plan(slotted(), t=(3, 0))
    assert back.windows == SLOTS


def test_outputs_within_slots_and_at_edges_are_right():
    t = np.sort(np.r_[EDGES, np.linspace(0.05, 2.95, 30)])
    run = lv.integrate(slotted(), "auto", t=t, psi=PSI)
    for time, psi in zip(t, run.psi, strict=True):
        assert np.linalg.norm(psi - stepped(0.0, time) @ PSI) <= 1e-8


def test_a_last_sample_for_the_last_time_holds_nowhere():
    # as QuTiP has as many samples as times
    system = lv.Schrodinger(
        H0, drive=[(np.r_[U, 9.0], B), (np.r_[V, -9.0], C)], times=EDGES, order=0
    )
    run = lv.integrate(system, "auto", t=(0, 3), psi=PSI)
    assert np.linalg.norm(run.psi[-1] - stepped(0.0, 3.0) @ PSI) <= 1e-8
    assert np.array_equal(run.psi, lv.integrate(slotted(), "auto", t=(0, 3), psi=PSI).psi)


def test_one_slot_is_an_h_without_time():
    system = lv.Schrodinger(H0, drive=[([0.7], B)], times=[0, 3], order=0)
    run = lv.integrate(system, "auto", t=(0, 3), psi=PSI)
    assert np.linalg.norm(run.psi[-1] - expm(-3j * (H0 + 0.7 * B)) @ PSI) <= 1e-8


def test_other_samples_take_the_place_of_those():
    run, _ = lv.vjp(slotted(), "auto", t=(0, 3), psi=PSI, wrt=["drive[0]"])
    other = slotted().with_samples({"drive[0]": V, "drive[1]": U})
    swapped = lv.integrate(other, "auto", t=(0, 3), psi=PSI)
    assert np.linalg.norm(run.psi[-1] - stepped(0.0, 3.0) @ PSI) <= 1e-8
    assert np.linalg.norm(swapped.psi[-1] - stepped(0.0, 3.0, V, U) @ PSI) <= 1e-8


def gradients(w):
    """Return those of Re <w, psi> by both drives, by derivatives of exponentials."""
    states = [PSI]
    for k, length in enumerate(np.diff(EDGES)):
        states.append(expm(-1j * length * (H0 + U[k] * B + V[k] * C)) @ states[-1])
    found = np.zeros((2, SLOTS))
    for k in reversed(range(SLOTS)):
        length = EDGES[k + 1] - EDGES[k]
        generator = -1j * length * (H0 + U[k] * B + V[k] * C)
        for drive, matrix in enumerate((B, C)):
            whole, moved = expm_frechet(generator, -1j * length * matrix)
            found[drive, k] = np.vdot(w, moved @ states[k]).real
        w = whole.conj().T @ w
    return found


@pytest.mark.parametrize("method", ["auto", lv.Chebyshev(1e-12)])
def test_gradients_by_samples_are_those_of_exponentials(method):
    w = RNG.normal(size=5) + 1j * RNG.normal(size=5)
    want = gradients(w)
    _, pullback = lv.vjp(slotted(), method, t=(0, 3), psi=PSI, wrt=["drive[0]", "drive[1]"])
    found = pullback(psi=[np.zeros(5), w])
    for drive in range(2):
        assert np.abs(found[f"drive[{drive}]"] - want[drive]).max() <= 1e-7
    direction = RNG.normal(size=SLOTS)
    run = lv.integrate(slotted(), method, t=(0, 3), psi=PSI, tangents={"drive[1]": direction})
    moved = np.vdot(w, run.tangents["drive[1]"].psi[-1]).real
    assert moved == pytest.approx(found["drive[1]"] @ direction, abs=1e-10)


def test_many_slots_take_a_time_of_their_number():
    def products(count):
        pulse = np.random.default_rng(3).normal(size=count)
        edges = np.linspace(0, 0.05 * count, count + 1)
        qubit = lv.Schrodinger(
            np.diag([1.0, -1.0]), drive=[(pulse, B[:2, :2])], times=edges, order=0
        )
        run = lv.integrate(qubit, "auto", t=(0, edges[-1]), psi=[1, 0])
        assert lv.plan(qubit, t=(0, edges[-1])).windows == count
        return run.stats["products"]

    assert products(1600) < 4.4 * products(400) < 4.4 * 10 * 400


@pytest.mark.parametrize("method", [lv.SplitOperator(tol=1e-9), "auto"])
def test_slots_of_a_field_on_a_grid(method):
    grid = lv.Grid(-10, 10, 96, potential=lambda t, x, params: x**2 / 2)
    x = grid.points[:, 0]
    k = 2 * np.pi * np.fft.fftfreq(96, x[1] - x[0])
    kinetic = np.fft.ifft(k[:, None] ** 2 / 2 * np.fft.fft(np.eye(96), axis=0), axis=0)
    psi = np.exp(-((x - 1) ** 2) / 2) + 0j
    psi /= np.linalg.norm(psi)
    system = lv.Schrodinger(grid, drive=[(U, x)], times=EDGES, order=0)
    run = lv.integrate(system, method, t=(0, 3), psi=psi)
    for length, value in zip(np.diff(EDGES), U, strict=True):
        psi = expm(-1j * length * (kinetic + np.diag(x**2 / 2 + value * x))) @ psi
    assert np.linalg.norm(run.psi[-1] - psi) <= getattr(method, "tol", 1e-8)


def test_a_jump_of_a_function_at_one_of_points_takes_no_search():
    drive = [(lambda t, params: ca.if_else(t < 1, 0.3, -1.2), B)]
    system = lv.Schrodinger(H0, drive=drive, points=[1.0])
    run = lv.integrate(system, "auto", t=(0, 3), psi=PSI)
    want = expm(-2j * (H0 - 1.2 * B)) @ expm(-1j * (H0 + 0.3 * B)) @ PSI
    assert np.linalg.norm(run.psi[-1] - want) <= 1e-8
    assert lv.plan(system, t=(0, 3)).windows <= 3


def test_bad_samples_are_refused_in_a_sentence():
    with pytest.raises(ValueError, match=r"order must be 0 or 3, not 1\n.*cubic spline"):
        lv.Schrodinger(H0, drive=[(U, B)], times=EDGES, order=1)
    with pytest.raises(TypeError, match="order is that of samples"):
        lv.Schrodinger(H0, drive=[(ca.sin, B)], order=0)
    with pytest.raises(ValueError, match="24 times, with 23 slots between"):
        lv.Schrodinger(H0, drive=[(U[:-1], B)], times=EDGES, order=0)
    with pytest.raises(ValueError, match=r"there are 24 times$"):
        lv.Schrodinger(H0, drive=[(U, B)], times=EDGES)
    with pytest.raises(ValueError, match="leaves the samples"):
        lv.integrate(slotted(), "auto", t=(0, 3.001), psi=PSI)
