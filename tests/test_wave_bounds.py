"""Bounds of spectra: the ways to find them, what they are, and tolerances that cost no less."""

import numpy as np
import pytest
import scipy.sparse as sp
from test_wave_plans import UNIT, eigen, random_state

import liouville as lv


def sparse(n=700, seed=0):
    """Return a random matrix whose discs are far wider than its spectrum."""
    matrix = sp.random_array((n, n), density=10 / n, rng=np.random.default_rng(seed))
    matrix.data -= 0.5
    return sp.csr_array(matrix + matrix.T)


@pytest.mark.parametrize("seed", range(3))
def test_closer_bounds_hold_the_spectrum_and_a_plan_says_what_they_are(seed):
    matrix = sparse(seed=seed)
    ends = np.linalg.eigvalsh(matrix.toarray())[[0, -1]]
    width = np.ptp(ends)
    found = {}
    for way in ("auto", "gershgorin", "lanczos"):
        system = lv.Schrodinger(matrix, bounds=way)
        span = 400.0 / width
        found[way] = plan = lv.plan(system, lv.Chebyshev(1e-6), t=(0.0, span))
        low, high = plan.bounds
        assert low <= ends[0] < ends[1] <= high
        assert f"({plan.guarantee})" in str(plan)
    guarantees = {way: plan.guarantee for way, plan in found.items()}
    assert guarantees == {
        "auto": "probable", "gershgorin": "rigorous", "lanczos": "with probability 1 - 1e-6",
    }  # fmt: skip
    widths = {way: np.ptp(plan.bounds) / width for way, plan in found.items()}
    assert widths["auto"] < 1.03 < widths["lanczos"] < 1.2 < 1.5 < widths["gershgorin"]
    assert found["auto"].products < 0.75 * found["gershgorin"].products


def test_short_runs_and_small_matrices_have_rigorous_bounds():
    matrix = sparse()
    assert lv.plan(lv.Schrodinger(matrix), t=(0.0, 1.0)).guarantee == "rigorous"
    assert lv.plan(lv.Schrodinger(lv.Lattice(40)), t=(0.0, 1e3)).guarantee == "rigorous"
    given = lv.plan(lv.Schrodinger(matrix, bounds=(-50.0, 50.0)), t=(0.0, 1e3))
    assert (given.guarantee, given.bounds) == ("given", (-50.0, 50.0))


def test_a_plan_with_probable_bounds_runs_and_is_pickled_with_its_system():
    matrix = sparse()
    system = lv.Schrodinger(matrix)
    psi, t = random_state(np.random.default_rng(0), matrix.shape[0]), (0.0, 60.0)
    plan = lv.plan(system, t=t)
    assert plan.guarantee == "probable"
    energies, vectors = eigen(system)
    wanted = vectors @ (np.exp(-1j * energies * t[1]) * (vectors.T @ psi))
    assert np.linalg.norm(lv.integrate(system, plan, t=t, psi=psi).psi[-1] - wanted) <= 1e-8
    with pytest.raises(ValueError, match="another spectrum"):
        lv.integrate(lv.Schrodinger(sparse(seed=1)), plan, t=t, psi=psi)


def test_bounds_that_are_no_way_are_refused():
    with pytest.raises(
        ValueError, match="bounds must be one of 'auto', 'gershgorin', 'lanczos' or a"
    ):
        lv.Schrodinger(np.eye(2), bounds="tight")
    products = lv.Schrodinger((3, lambda x: 2 * x), bounds="gershgorin")
    with pytest.raises(ValueError, match=r"by its products, .*\nhint: give bounds='lanczos'"):
        lv.plan(products, t=(0.0, 1.0))


def test_an_energy_beyond_given_bounds_is_found_and_the_window_made_again():
    # so small a part of the start that Lanczos' method does not see it beforehand
    energies = np.append(np.linspace(-1.0, 1.0, 4000), 1.00002)
    system = lv.Schrodinger(energies, bounds=(-1.0, 1.0))
    psi = np.full(energies.size, energies.size**-0.5)
    t = np.linspace(0.0, 3000.0, 5)
    solution = lv.integrate(system, lv.Chebyshev(1e-7), t=t, psi=psi)
    assert solution.stats["widened"] == 1
    assert "an energy lies outside the bounds" in solution.message
    wanted = np.exp(-1j * np.outer(t, energies)) * psi
    assert np.linalg.norm(solution.psi - wanted, axis=1).max() <= 1e-7
    alone = lv.integrate(lv.Schrodinger(energies), lv.Chebyshev(1e-7), t=t, psi=psi)
    assert alone.stats["widened"] == 0
    assert not alone.message


TOLERANCES = np.sort(np.concatenate([[5e-13, 2e-13], 10.0 ** np.arange(-13.0, -1.0, 0.3)]))[::-1]


@pytest.mark.parametrize("method", [lv.SchrodingerSplitting, lv.Chebyshev])
@pytest.mark.parametrize(
    ("system", "times"),
    [
        (lv.Schrodinger(lv.SpinChain(8)), (0.0, 0.4 / 5.1247)),
        (UNIT, (0.0, 20.0)),
        (UNIT, np.linspace(0.0, 60.0, 14)),
        (UNIT, np.linspace(0.0, 100.0, 101)),
    ],
    ids=["defect", "end", "some", "many"],
)
def test_a_tighter_tolerance_is_never_cheaper(system, times, method):
    products = []
    for tol in TOLERANCES:
        try:
            products.append(lv.plan(system, method(tol), t=times).products)
        except ValueError as refused:
            assert "out of reach" in str(refused)  # noqa: PT017
    assert len(products) > 30
    assert (np.diff(products) >= 0).all(), products
