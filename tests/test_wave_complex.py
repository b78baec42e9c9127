"""Complex Hermitian Hamiltonians: every method, drives, gauges, observables, refusals."""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from ordinary import propagated
from scipy.linalg import expm
from scipy.sparse.linalg import LinearOperator, expm_multiply

import liouville as lv

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import driven_products


def hofstadter(rows, cols, flux):
    """Return a lattice with so many flux quanta through a cell, in the Landau gauge."""
    row, col, values = [], [], []
    for i in range(rows):
        for j in range(cols):
            here = i * cols + j
            if i + 1 < rows:
                row, col, values = [*row, here], [*col, here + cols], [*values, -1.0 + 0j]
            if j + 1 < cols:
                phase = np.exp(2j * np.pi * flux * i)
                row, col, values = [*row, here], [*col, here + 1], [*values, -phase]
    half = sp.csr_array((values, (row, col)), shape=(rows * cols,) * 2)
    return half + half.conj().T


def hermitian(n, seed=1):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(n, n)) + 1j * rng.normal(size=(n, n))
    return (matrix + matrix.conj().T) / (2 * np.sqrt(n))


def state(n, seed=0):
    rng = np.random.default_rng(seed)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    return psi / np.linalg.norm(psi)


def after(matrix, t, psi):
    energies, vectors = np.linalg.eigh(matrix.toarray() if sp.issparse(matrix) else matrix)
    return vectors @ (np.exp(-1j * energies * t) * (vectors.conj().T @ psi))


FLUX = hofstadter(6, 7, 0.21)
PSI = state(42)

METHODS = {
    "auto": "auto",
    "series": lv.Chebyshev(1e-9),
    "Krylov": lv.Lanczos(1e-9),
    "fast": lv.SchrodingerSplitting(1e-9, mode="fast"),
    "stable": lv.SchrodingerSplitting(1e-9, mode="stable"),
}


@pytest.mark.parametrize("name", METHODS)
def test_every_method_keeps_to_its_tolerance_and_returns(name):
    method = METHODS[name]
    system = lv.Schrodinger(FLUX)
    assert not system.is_real
    times = np.array([0.3, 1.0, 4.5, 12.0])
    plan = lv.plan(system, method, t=times)
    solution = lv.integrate(system, method, t=times, psi=PSI)
    for t, psi in zip(times, solution.psi, strict=True):
        assert np.linalg.norm(psi - after(FLUX, t - 0.3, PSI)) < (1e-8 if name == "auto" else 1e-9)
    assert abs(solution.invariants["norm"] - 1).max() < 1e-9
    assert np.ptp(solution.invariants["energy"]) < 1e-8
    if name != "Krylov":
        assert solution.stats["products"] == plan.products
    back = lv.integrate(system, method, t=(12.0, 0.3), psi=solution.psi[-1])
    assert np.linalg.norm(back.psi[-1] - PSI) < 2e-8
    many = lv.ensemble(system, method, t=(0.3, 1.0), psi=[PSI, PSI[::-1], 2 * PSI])
    one = lv.integrate(system, method, t=(0.3, 1.0), psi=2 * PSI)
    assert np.abs(many.psi[-1, 2] - one.psi[-1]).max() < 1e-13


@pytest.mark.parametrize(
    "method", [lv.GrayManolopoulos(6), lv.StabilitySplitting(6, 8), lv.Magnus(4, 1e-11)]
)
def test_methods_with_steps_take_it_too(method):
    system, wanted = lv.Schrodinger(FLUX), after(FLUX, 2.0, PSI)
    errors = [
        np.linalg.norm(lv.integrate(system, method, t=(0, 2.0), steps=n, psi=PSI).psi[-1] - wanted)
        for n in (12, 24)
    ]
    if isinstance(method, lv.Magnus):
        assert errors[1] < 2e-11
    else:
        assert errors[0] / errors[1] > 2**5.5


def test_a_stable_splitting_of_two_halves_keeps_the_norm_over_many_steps():
    system = lv.Schrodinger(FLUX)
    method = lv.SchrodingerSplitting(1e-3, mode="stable")
    solution = lv.integrate(system, method, t=np.linspace(0, 5000, 6), psi=PSI, threads=2)
    assert solution.stats["steps"] > 100
    assert abs(solution.invariants["norm"] - 1).max() < 1e-5
    whole = after(FLUX, 5000.0, PSI)
    assert np.linalg.norm(solution.psi[-1] - whole) < 1e-3


@pytest.mark.parametrize("form", ["dense", "sparse", "operator", "function"])
def test_it_is_given_in_any_form(form):
    matrix = FLUX.toarray()
    given = {
        "dense": matrix,
        "sparse": FLUX,
        "operator": LinearOperator(matrix.shape, matvec=lambda x: FLUX @ x, dtype=complex),
        "function": (42, lambda x: FLUX @ x),
    }[form]
    system = lv.Schrodinger(given, hbar=0.5)
    solution = lv.integrate(system, lv.Chebyshev(1e-9), t=(0, 3.0), psi=PSI)
    wanted = expm_multiply(-3j / 0.5 * FLUX.tocsr(), PSI)
    assert np.linalg.norm(solution.psi[-1] - wanted) < 2e-9
    assert solution.invariants["energy"][0] == pytest.approx((PSI.conj() @ FLUX @ PSI).real)
    energies = np.linalg.eigvalsh(matrix)[[0, -1]] / 0.5
    for bounds in ("auto", "lanczos"):
        found = lv.Schrodinger(given, hbar=0.5, bounds=bounds).bounds
        assert found[0] <= energies[0] < energies[1] <= found[1]
        assert np.ptp(found) <= 1.3 * np.ptp(energies)


def test_a_large_one_agrees_with_scipy_by_fewer_products_with_lanczos_bounds():
    flux = hofstadter(24, 25, 0.13)
    psi = state(600)
    wanted = expm_multiply(-40j * flux.tocsr(), psi)
    for bounds in ("gershgorin", "lanczos"):
        solution = lv.integrate(
            lv.Schrodinger(flux, bounds=bounds), lv.Chebyshev(1e-10), t=(0, 40.0), psi=psi
        )
        assert np.linalg.norm(solution.psi[-1] - wanted) < 1e-9


# --- H(t) ----------------------------------------------------------------------------------------


def peierls(n=9):
    """Return the matrices of cos A and sin A of a ring, and a potential."""
    hop = sp.diags_array([np.ones(n - 1), [1.0]], offsets=[1, 1 - n], format="csr")
    even, odd = -(hop + hop.T), -1j * (hop - hop.T)
    return sp.diags_array(np.cos(np.arange(n))).tocsr(), even, odd


@pytest.mark.parametrize("method", ["auto", lv.Magnus(4, 1e-11)])
def test_a_constant_field_is_the_gauge_transform_of_none(method):
    # on an open chain A is gauged away: psi_j picks up exp(i A j)
    n, a = 8, 0.7
    hop = np.diag(np.ones(n - 1), 1)
    v = np.diag(np.cos(np.arange(n)))
    drive = [
        (lambda t, p: ca.cos(p.A), -(hop + hop.T)),
        (lambda t, p: ca.sin(p.A) + 0 * t, -1j * (hop - hop.T)),
    ]
    system = lv.Schrodinger(v.astype(complex), drive=drive, params={"A": a})
    psi, phases = state(n), np.exp(-1j * a * np.arange(n))
    steps = {} if method == "auto" else {"steps": 60}
    with_field = lv.integrate(system, method, t=(0, 4.0), psi=phases * psi, **steps)
    without = after(v - hop - hop.T, 4.0, psi)
    assert np.linalg.norm(with_field.psi[-1] / phases - without) < 1e-8


def test_a_growing_field_gives_the_density_of_a_tilted_chain():
    n, field = 8, 0.9
    hop = np.diag(np.ones(n - 1), 1)
    drive = [
        (lambda t, p: ca.cos(field * t), -(hop + hop.T)),
        (lambda t, p: ca.sin(field * t), -1j * (hop - hop.T)),
    ]
    system = lv.Schrodinger(np.zeros((n, n)), drive=drive)
    psi = state(n)
    solution = lv.integrate(system, lv.Chebyshev(1e-9), t=np.linspace(0, 5, 6), psi=psi)
    for t, found in zip(solution.t, solution.psi, strict=True):
        tilted = after(-hop - hop.T - field * np.diag(np.arange(n)), t, psi)
        assert np.abs(np.abs(found) ** 2 - np.abs(tilted) ** 2).max() < 1e-8


def driven_system():
    v, even, odd = peierls()
    drive = [
        (lambda t, p: ca.cos(ca.sin(t)), even),
        (lambda t, p: ca.sin(ca.sin(t)), odd),
    ]
    return lv.Schrodinger(v, drive=drive), (v, even, odd)


def driven_reference(parts, t1, psi):
    v, even, odd = parts

    def product(t, y):
        return v @ y + np.cos(np.sin(t)) * (even @ y) + np.sin(np.sin(t)) * (odd @ y)

    return propagated(product, (0, t1), psi)[-1]


def test_a_ring_in_an_oscillating_field_by_series_and_by_magnus():
    system, parts = driven_system()
    assert not system.is_real
    psi = state(9)
    wanted = driven_reference(parts, 6.0, psi)
    for tol in (1e-5, 1e-10):
        solution = lv.integrate(system, lv.Chebyshev(tol), t=(0, 6.0), psi=psi)
        assert np.linalg.norm(solution.psi[-1] - wanted) < tol
    for order in (2, 4):
        errors = []
        for steps in (40, 80):
            run = lv.integrate(system, lv.Magnus(order, 1e-12), t=(0, 6.0), steps=steps, psi=psi)
            errors.append(np.linalg.norm(run.psi[-1] - wanted))
        assert np.log2(errors[0] / errors[1]) > order - 0.2
        # an exponential of theta 0.2 with a tail of 1e-14 is a series of degree 9 at most
        assert run.stats["products"] <= 80 * 9 * lv.Magnus(order).scheme[1]
        back = lv.integrate(system, lv.Magnus(order, 1e-12), t=(6.0, 0), steps=80, psi=run.psi[-1])
        assert np.linalg.norm(back.psi[-1] - psi) < 1e-11


def test_a_circular_drive_takes_six_tenths_of_the_products_of_dop853():
    h0, functions, drive, span, psi = driven_products.circular(8)
    parts = sp.csr_array(h0), [(f, sp.csr_array(h)) for f, h in functions]
    system = lv.Schrodinger(h0, drive=drive)
    exact = lv.integrate(system, lv.Chebyshev(1e-11), t=span, psi=psi).psi[-1]
    solution = lv.integrate(system, lv.Chebyshev(1e-6), t=span, psi=psi)
    error = np.linalg.norm(solution.psi[-1] - exact)

    def product(t, y):
        return parts[0] @ y + sum(f(t) * (h @ y) for f, h in parts[1])

    other, count = driven_products.dop853(product, 0.0, span, psi.astype(complex), 1e-8)
    assert error <= 1e-6
    assert error <= np.linalg.norm(other - exact) <= 1e-6
    assert solution.stats["products"] <= 0.6 * count


def test_grids_and_products_take_complex_drives():
    n = 16
    kick = hermitian(n, 3)
    potential = lambda t, x, p: x**2 / 2 + ca.sin(t) * x  # noqa: E731
    grid = lv.Grid(-4.0, 4.0, n, potential)
    system = lv.Schrodinger(grid, drive=[(lambda t, p: ca.cos(2 * t), kick)])
    kinetic = np.fft.ifft(grid.kinetic(1.0)[0][:, None] * np.fft.fft(np.eye(n), axis=0), axis=0)
    x, psi = grid.points[:, 0], state(n)

    def matrix(t):
        return kinetic + np.diag(x**2 / 2 + np.sin(t) * x) + np.cos(2 * t) * kick

    wanted = propagated(lambda t, y: matrix(t) @ y, (0, 1.5), psi)[-1]
    solution = lv.integrate(system, lv.Chebyshev(1e-9), t=(0, 1.5), psi=psi)
    assert np.linalg.norm(solution.psi[-1] - wanted) < 1e-9
    energy = solution.observed["energy"]
    assert energy[-1] == pytest.approx((wanted.conj() @ matrix(1.5) @ wanted).real)
    still = kinetic.real + np.diag(x**2 / 2)
    system = lv.Schrodinger((n, lambda y: still @ y), drive=[(lambda t, p: ca.cos(2 * t), kick)])
    wanted = propagated(lambda t, y: still @ y + np.cos(2 * t) * (kick @ y), (0, 1.5), psi)[-1]
    solution = lv.integrate(system, lv.Chebyshev(1e-9), t=(0, 1.5), psi=psi)
    assert np.linalg.norm(solution.psi[-1] - wanted) < 1e-9


# --- what is observed, stored and refused --------------------------------------------------------


def test_observables_may_be_complex_and_need_not_be_hermitian():
    rng = np.random.default_rng(4)
    general = rng.normal(size=(42, 42)) + 1j * rng.normal(size=(42, 42))
    real = rng.normal(size=(42, 42))
    current = 1j * (sp.triu(FLUX) - sp.tril(FLUX))
    by_products = LinearOperator((42, 42), matvec=lambda x: current @ x, dtype=complex)
    observe = {
        "general": general,
        "real": sp.csr_array(real),
        "current": current,
        "op": by_products,
    }
    for matrix in (FLUX, abs(FLUX)):
        solution = lv.integrate(
            lv.Schrodinger(matrix), "auto", t=np.linspace(0, 2, 4), psi=PSI, observe=observe
        )
        for name, a in (("general", general), ("real", real), ("current", current)):
            found = solution.observed[name]
            wanted = [psi.conj() @ (a @ psi) for psi in solution.psi]
            assert found.dtype == (float if name == "current" else complex)
            assert np.abs(found - wanted).max() < 1e-12
        assert np.allclose(solution.observed["op"], solution.observed["current"], atol=1e-13)
    with pytest.raises(
        ValueError, match=r"observable 'a' is not Hermitian: x \. .*\nhint: give it"
    ):
        lv.integrate(
            lv.Schrodinger(FLUX), "auto", t=(0, 1), psi=PSI, observe={"a": (42, lambda x: real @ x)}
        )


@pytest.mark.parametrize("method", [lv.Chebyshev(1e-8), lv.SchrodingerSplitting(1e-8, "stable")])
def test_a_stored_run_goes_on_with_the_same_bits(tmp_path, method):
    system, times = lv.Schrodinger(FLUX), np.linspace(0, 30, 11)
    whole = lv.integrate(system, method, t=times, psi=PSI)
    plan = lv.plan(system, method, t=times)
    assert plan.is_complex
    plan.save(tmp_path / "plan.json")
    again = lv.Plan.load(tmp_path / "plan.json")
    assert again.is_complex
    assert lv.integrate(system, again, t=times, psi=PSI).psi.tobytes() == whole.psi.tobytes()
    energies = np.linalg.eigvalsh(FLUX.toarray())
    real = lv.Schrodinger(np.diag(energies), bounds=system.bounds)
    with pytest.raises(ValueError, match="made for a complex H"):
        lv.integrate(real, plan, t=times, psi=PSI)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({(0, 1): 0.25}, r"H\[0, 1\] = \S+, but H\[1, 0\] = \S+, where H - H\^\+ is largest: 0.25"),
        (
            {(0, 1): 0.25, (5, 4): 0.5j},
            r"H\[4, 5\] = .* but H\[5, 4\] = .* largest: 0.5, or 0.45 of",
        ),
        ({(3, 3): -0.5j}, r"H\[3, 3\] = 0-0.5j is not real, where H - H\^\+ is largest: 1"),
    ],
)
def test_what_is_not_hermitian_is_refused_with_its_largest_defect(change, message):
    matrix = FLUX.toarray()
    for place, value in change.items():
        matrix[place] += value
    with pytest.raises(ValueError, match=message):
        lv.Schrodinger(matrix)
    with pytest.raises(ValueError, match=r"H is not Hermitian: x \. H y .* differ by \S+ of"):
        lv.Schrodinger((42, lambda x: matrix @ x))


def test_a_function_that_drops_imaginary_parts_is_refused():
    real = FLUX.toarray().real
    with pytest.raises(ValueError, match="H is not linear: of i x it makes no i H x"):
        lv.Schrodinger((42, lambda x: (real @ x.real).astype(complex)))


def test_the_propagator_is_unitary_and_that_of_scipy():
    matrix = hermitian(6)
    system = lv.Schrodinger(matrix)
    found = lv.ensemble(system, lv.Chebyshev(1e-13), t=(0, 1.5), psi=np.eye(6)).psi[-1].T
    assert np.abs(found - expm(-1.5j * matrix)).max() < 1e-12
    assert np.abs(found.conj().T @ found - np.eye(6)).max() < 1e-12
