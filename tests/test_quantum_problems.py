"""The Schrödinger equations of the library: their states, their references, and runs to them."""

import numpy as np
import pytest

import liouville as lv
from liouville import problems
from liouville.problems import (
    harmonic_oscillator,
    heisenberg,
    lattice2d,
    lattice3d,
    poschl_teller,
    tight_binding,
    walker_preston,
)

#: Problems whose Hamiltonian does not depend on time.
STATIC = [name for name in problems.QUANTUM if name != "walker_preston"]


def dense(system):
    """Return H / hbar as an array, from products with unit vectors."""
    unit = np.eye(system.hamiltonian.size)
    return np.array([system.hamiltonian.multiply(row) for row in unit])


def off(psi, wanted):
    """Return how far a state is from a reference: a whole state, or a dict of components."""
    if isinstance(wanted, dict):
        return max(abs(psi[place] - value) for place, value in wanted.items())
    return np.linalg.norm(psi - wanted)


@pytest.mark.parametrize("name", problems.QUANTUM)
def test_a_problem_has_what_it_should(name):
    problem = problems.load(name)
    assert isinstance(problem.system, lv.Schrodinger)
    assert np.linalg.norm(problem.system.inward(problem.start["psi"])) == pytest.approx(1.0)
    assert problem.system.is_driven == ("energy" not in problem.conserved)
    assert 0 < problem.tol < 1e-6
    assert problem.interval[0] < min(problem.reference)
    assert max(problem.reference) <= problem.interval[1]
    assert problem.source


@pytest.mark.parametrize("name", [name for name in STATIC if name != "lattice3d"])
def test_eigenvectors_lead_to_the_reference(name):
    problem = problems.load(name)
    energies, vectors = np.linalg.eigh(dense(problem.system))
    start = vectors.T @ problem.system.inward(problem.start["psi"])
    for t, wanted in problem.reference.items():
        psi = problem.system.outward(vectors @ (np.exp(-1j * energies * t) * start))
        assert off(psi, wanted["psi"]) < 2e-13 * max(1, np.ptp(energies) * t / 10)


def test_the_states_of_the_well_are_eigenstates_with_the_energies_of_the_formula():
    system = poschl_teller.system
    for n in range(poschl_teller.STATES):
        state = poschl_teller.state(n)
        residual = system.hamiltonian.multiply(state) - poschl_teller.energy(n) * state
        assert np.linalg.norm(residual) < 1e-10
    overlaps = [[a @ b for a in map(poschl_teller.state, (0, 3, 8))] for b in
                map(poschl_teller.state, (0, 3, 8))]  # fmt: skip
    assert abs(np.array(overlaps) - np.eye(3)).max() < 1e-13


def test_the_coherent_state_solves_the_equation_of_the_grid():
    system, h = harmonic_oscillator.system, 1e-3
    for t in (0.0, 0.7, 3.0):
        ahead, behind = (harmonic_oscillator.exact(t + s * h) for s in (1, -1))
        psi = harmonic_oscillator.exact(t)
        product = system.hamiltonian.multiply(psi.real.copy()) + 1j * system.hamiltonian.multiply(
            psi.imag.copy()
        )
        assert np.linalg.norm((ahead - behind) / (2 * h) * 1j - product) < 3e-5


def test_the_ground_state_of_the_molecule_has_the_energy_of_morse():
    grid = walker_preston.system.grid
    d, alpha = walker_preston.PARAMS["D"], walker_preston.PARAMS["alpha"]
    quantum = alpha * np.sqrt(2 * d / walker_preston.MASS)
    x, psi = grid.points[:, 0], walker_preston.start["psi"]
    values = d * (1 - np.exp(-alpha * x)) ** 2
    static = lv.Schrodinger(lv.Grid(-0.8, 4.32, 64, values, walker_preston.MASS))
    wanted = quantum / 2 - quantum**2 / (16 * d)
    assert psi @ static.hamiltonian.multiply(psi) == pytest.approx(wanted, rel=1e-9)


def test_disorder_is_the_same_everywhere():
    found = tight_binding.disorder(3, 4.0)
    states = [1103527590, 377401575, 662824084]
    assert np.array_equal(found, [4.0 * (state / 2**31 - 0.5) for state in states])


RUNS = [
    *((name, lv.SchrodingerSplitting(tol=1e-10)) for name in STATIC),
    *((name, lv.Chebyshev(tol=1e-10)) for name in STATIC),
]


@pytest.mark.parametrize(("name", "method"), RUNS)
def test_a_run_reaches_the_reference_and_keeps_what_it_should(name, method):
    problem = problems.load(name)
    times = [problem.interval[0], *problem.reference]
    solution = lv.integrate(problem.system, method, t=times, **problem.start)
    for k, wanted in enumerate(problem.reference.values(), 1):
        assert off(solution.psi[k], wanted["psi"]) < 5 * method.tol
    for invariant in problem.conserved:
        assert solution.invariant_drift(invariant).max() < 1e-9


@pytest.mark.parametrize(
    ("method", "steps", "error"),
    [
        (lv.SplitOperator("RKN6s11"), 72, 1e-9),
        (lv.SplitOperator("BM4"), 400, 1e-8),
        (lv.Magnus(order=4, tol=1e-9), 1000, 1e-7),
    ],
)
def test_the_molecule_in_the_laser_reaches_its_reference(method, steps, error):
    t = walker_preston.interval
    solution = lv.integrate(walker_preston.system, method, t=t, steps=steps, **walker_preston.start)
    assert off(solution.psi[-1], walker_preston.reference[t[1]]["psi"]) < error
    assert solution.invariant_drift("norm").max() < 1e-8


def test_the_chain_of_spins_reaches_its_observables():
    problem = heisenberg
    spin = problem.chain.sz(0).astype(float)
    solution = lv.integrate(
        problem.system, lv.SchrodingerSplitting(tol=1e-12), t=problem.interval,
        observe={"z component of spin 0": spin}, **problem.start,
    )  # fmt: skip
    wanted = problem.reference[5.0]
    assert solution.observed["z component of spin 0"][-1] == pytest.approx(
        wanted["z component of spin 0"], abs=1e-11
    )
    assert solution.invariants["energy"][-1] == pytest.approx(wanted["energy"], abs=1e-11)
    place = problem.chain.index(85)
    assert solution.observed["autocorrelation"][-1] == pytest.approx(
        wanted["psi"][place], abs=1e-11
    )


def test_the_square_with_disorder_reaches_its_reference():
    solution = lv.integrate(
        tight_binding.disordered, lv.SchrodingerSplitting(tol=1e-11), t=tight_binding.interval,
        **tight_binding.disordered_start,
    )  # fmt: skip
    assert off(solution.psi[-1], tight_binding.disordered_reference[10.0]["psi"]) < 1e-11


@pytest.mark.parametrize("problem", [lattice2d, lattice3d])
def test_the_bowl_keeps_a_product_of_states(problem):
    chain = lv.Schrodinger(problem.chain(problem.SITES))
    line = problem.packet(problem.SITES)
    line = line / np.linalg.norm(line)
    energies, vectors = np.linalg.eigh(dense(chain))
    line = vectors @ (np.exp(-10j * energies) * (vectors.T @ line))
    middle = problem.SITES // 2
    axes = len(problem.system.source.shape)
    for place, value in problem.reference[10.0]["psi"].items():
        found = line[place // problem.SITES ** (axes - 1)] * line[middle] ** (axes - 1)
        assert abs(found - value) < 1e-13
