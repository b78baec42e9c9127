"""Ground and thermal states: energies that are known, errors within their bounds."""

import numpy as np
import pytest

import liouville as lv
from liouville.analysis import lowest_level
from liouville.analysis.thermal_state import coefficients

EXCHANGE = ["xx", "yy", "zz"]
TWISTED = [("xy", 0.4), ("yx", -0.4), ("zz", 1.0), ("x", 0.3), ("y", 0.2)]


@pytest.mark.parametrize(
    ("length", "energy"), [(4, -2.0), (8, -3.651093409), (12, -5.387390917)]
)  # of Bonner and Fisher: by all eigenvalues, and by Lanczos' method
def test_the_ground_energy_of_a_ring_is_the_published_one(length, energy):
    ring = lv.SpinSystem(length, EXCHANGE, periodic=True, up=length // 2)
    ground = lv.analysis.ground_state(lv.Schrodinger(ring))
    assert ground.energy == pytest.approx(energy, abs=6e-10)
    assert np.linalg.norm(ground.psi) == pytest.approx(1.0)
    assert ground.psi.dtype == float


@pytest.mark.parametrize("hbar", [1.0, 2.0])
@pytest.mark.parametrize("terms", [TWISTED, [("zz", -1.0), ("x", -1.2)]])
def test_errors_of_a_ground_state_are_within_its_bounds(terms, hbar):
    chain = lv.SpinSystem(9, terms, periodic=True)
    matrix = chain.matrix()
    exact = np.linalg.eigvalsh(matrix.toarray())
    system = lv.Schrodinger(chain, hbar=hbar)
    rough = lv.analysis.ground_state(system, tol=1e-3)
    assert abs(rough.energy - exact[0]) < rough.estimate + 1e-13
    assert rough.estimate < rough.bound
    ground = lv.analysis.ground_state(system)
    assert abs(ground.energy - exact[0]) < 1e-13 * np.ptp(exact)
    assert np.linalg.norm(matrix @ ground.psi - ground.energy * ground.psi) < 2 * ground.bound
    level = exact[exact > exact[0] + 1e-9]
    assert ground.gap == pytest.approx(level[0] - exact[0], abs=1e-8)
    assert ground.multiplicity == exact.size - level.size
    run = lv.integrate(system, lv.Chebyshev(), t=(0, 1), **ground.start)
    turned = np.exp(-1j * ground.energy / hbar) * ground.psi
    assert np.linalg.norm(run.psi[-1] - turned) < 1e-7


FERROMAGNET = [("xx", -1.0), ("yy", -1.0), ("zz", -1.0)]


@pytest.mark.parametrize(
    ("length", "terms", "multiplicity"),
    [
        (9, TWISTED, 2),
        (9, EXCHANGE, 4),
        (9, FERROMAGNET, 10),
        (10, FERROMAGNET, 11),
        (10, [("zz", -1.0), ("x", 0.3)], 1),
        (10, [("zz", -1.0), ("x", 0.05)], 2),
        (9, [("zz", 0.0)], 512),
        (3, [("zz", 0.0)], 8),
        (1, ["x"], 1),
    ],
)
def test_a_ground_level_has_all_its_states_and_the_gap_to_the_next_level(
    length, terms, multiplicity
):
    ring = lv.SpinSystem(length, terms, periodic=length > 2)
    matrix = ring.matrix().toarray()
    exact = np.linalg.eigvalsh(matrix)
    ground = lv.analysis.ground_state(lv.Schrodinger(ring))
    assert ground.multiplicity == multiplicity
    states = ground.states
    assert np.abs(states.conj() @ states.T - np.eye(multiplicity)).max() < 1e-12
    assert np.abs(states @ matrix.T - exact[0] * states).max() < 2e-9 * max(np.ptp(exact), 1)
    gap = exact[multiplicity] - exact[0] if multiplicity < exact.size else np.inf
    assert ground.gap == pytest.approx(gap, abs=1e-8)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("terms", [[("zz", 1.0), ("z", 0.3)], [("xx", 0.3), ("x", 1.0)]])
def test_blocks_stay_orthogonal_where_few_levels_exhaust_them(terms, seed, monkeypatch):
    # a ring of six has eleven levels: blocks of three have found them all in a few steps
    monkeypatch.setattr(lowest_level, "DENSE", 40)
    monkeypatch.setattr(lowest_level, "SEED", seed)
    ring = lv.SpinSystem(6, terms, periodic=True)
    matrix = ring.matrix().toarray()
    exact = np.linalg.eigvalsh(matrix)
    ground = lv.analysis.ground_state(lv.Schrodinger(ring))
    assert ground.multiplicity == (exact < exact[0] + 1e-9).sum()
    assert np.abs(ground.states @ matrix - exact[0] * ground.states).max() < 1e-9


@pytest.mark.parametrize("seed", range(12))
def test_copies_of_a_matrix_have_all_their_ground_states(seed, monkeypatch):
    monkeypatch.setattr(lowest_level, "DENSE", 40)
    rng = np.random.default_rng(seed)
    part, copies = rng.normal(size=(30, 30)), 2 + seed % 6
    part = np.where(rng.random((30, 30)) < 0.2, part, 0.0)
    matrix = np.kron(np.eye(copies), part + part.T)
    exact = np.linalg.eigvalsh(part + part.T)
    ground = lv.analysis.ground_state(lv.Schrodinger(matrix))
    assert ground.multiplicity == copies
    assert ground.energy == pytest.approx(exact[0], abs=1e-11)
    assert ground.gap == pytest.approx(exact[1] - exact[0], abs=1e-7)


def _random_hermitian(rng, energies, is_complex):
    """Return a matrix with these eigenvalues."""
    size = energies.size
    entries = rng.normal(size=(size, size)) + (1j * is_complex) * rng.normal(size=(size, size))
    vectors, _ = np.linalg.qr(entries if is_complex else entries.real)
    matrix = (vectors * energies) @ vectors.conj().T
    return (matrix + matrix.conj().T) / 2


@pytest.mark.parametrize(("multiplicity", "is_complex"), [(1, 0), (3, 1), (4, 0), (7, 1), (12, 0)])
def test_the_multiplicity_of_a_random_matrix_is_found(multiplicity, is_complex):
    rng = np.random.default_rng(multiplicity)
    energies = np.sort(rng.uniform(0.01, 1.0, 300))
    energies[:multiplicity] = 0.0
    matrix = _random_hermitian(rng, energies, is_complex)
    ground = lv.analysis.ground_state(lv.Schrodinger(matrix))
    assert ground.multiplicity == multiplicity
    assert ground.gap == pytest.approx(energies[multiplicity], abs=1e-8)


def test_a_level_of_more_states_than_are_sought_has_no_gap():
    energies = np.r_[np.zeros(1200), 1.0]
    ground = lv.analysis.ground_state(lv.Schrodinger((1201, lambda x: energies * x)))
    assert (ground.multiplicity, ground.gap) == (96, 0.0)
    assert abs(ground.energy) < 1e-12
    assert "96 or more states" in repr(ground)


def test_a_gap_below_the_tolerance_is_not_told():
    ground = lv.analysis.ground_state(lv.Schrodinger(lv.Lattice(3000)), tol=1e-2)
    assert ground.gap == 0.0
    assert -2 < ground.energy < -2 + ground.estimate


def test_a_cold_state_of_a_degenerate_level_has_all_its_entropy():
    ring = lv.SpinSystem(9, TWISTED, periodic=True)
    exact = np.linalg.eigvalsh(ring.matrix().toarray())
    thermal = lv.analysis.thermal_state(lv.Schrodinger(ring), 1e-3, states=60)
    assert thermal.energy == pytest.approx(exact[0], abs=1e-9)
    assert thermal.log_partition + exact[0] / 1e-3 == pytest.approx(np.log(2), abs=0.4)


def test_a_ground_state_of_a_driven_system_is_that_of_its_time():
    chain = lv.SpinSystem(8, [("zz", -1.0)], pauli=True)
    system = lv.Schrodinger(
        chain, drive=[(lambda t, params: -params.g * t, chain.operator("x"))], params={"g": 2.0}
    )
    ground = lv.analysis.ground_state(system, t=0.25, params={"g": 4.0})
    modes = np.linalg.svd(np.eye(8) + np.eye(8, k=-1), compute_uv=False)
    assert ground.energy == pytest.approx(-modes.sum(), abs=1e-11)
    assert ground.gap == pytest.approx(2 * modes[-1], abs=1e-8)


def test_a_grid_that_depends_on_time_has_a_ground_state():
    grid = lv.Grid(-10, 10, 160, potential=lambda t, x, params: (1 + t) ** 2 * x[0] ** 2 / 2)
    ground = lv.analysis.ground_state(lv.Schrodinger(grid), t=1.0)
    assert ground.energy == pytest.approx(1.0, abs=1e-10)
    assert ground.gap == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("terms", [TWISTED, [("zz", 1.0), ("x", 0.5)]])
def test_thermal_states_have_the_averages_of_all_states(terms):
    temperature, chain = 0.7, lv.SpinSystem(7, terms)
    system = lv.Schrodinger(chain, hbar=2.0)
    energies, vectors = np.linalg.eigh(chain.matrix().toarray())
    occupied = np.exp(-energies / temperature)
    exact = energies @ occupied / occupied.sum()
    thermal = lv.analysis.thermal_state(system, temperature, states=80)
    assert abs(thermal.energy - exact) < 3 * thermal.energy_error < 0.1
    assert thermal.log_partition == pytest.approx(np.log(occupied.sum()), abs=0.05)
    bonds = chain.operator("zz", 1.0, (2, 3))
    parts = vectors.conj().T @ (bonds[:, None] * vectors)
    average = np.diag(parts).real @ occupied / occupied.sum()
    run = lv.ensemble(system, lv.Chebyshev(), t=(0, 1), observe={"zz": bonds}, **thermal.start)
    seen = run.observed["zz"]
    assert (abs(thermal.mean(seen) - average) < 4 * thermal.error(seen)).all()


def test_imaginary_time_is_the_exponential():
    chain = lv.SpinSystem(6, [("zz", 1.0), ("x", 0.5)])
    energies, vectors = np.linalg.eigh(chain.matrix().toarray())
    start = np.random.default_rng(3).normal(size=chain.size)
    for temperature in (0.02, 1.0, 100.0):
        thermal = lv.analysis.thermal_state(lv.Schrodinger(chain), temperature, states=1, seed=3)
        cooled = vectors @ (
            np.exp(-(energies - energies[0]) / temperature / 2) * (vectors.T @ start)
        )
        cooled /= np.linalg.norm(cooled)
        assert np.linalg.norm(thermal.psi[0] - cooled) < thermal.bound + 1e-13


@pytest.mark.parametrize("x", [0.0, 1e-8, 0.3, 40.0, 3e4])
def test_what_a_series_leaves_out_is_known(x):
    factors, tail = coefficients(x)
    points = np.linspace(-1, 1, 801)
    series = np.polynomial.chebyshev.chebval(points, factors)
    assert abs(series - np.exp(-x * (points + 1))).max() < tail + 1e-13
    assert factors.size < 20 + 9 * np.sqrt(x)  # sqrt(2 x ln(2 / 1e-14)) and some more


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (
            lambda: lv.analysis.ground_state(lv.SpinSystem(4, ["z"])),
            TypeError,
            "must be a Schrodinger equation",
        ),
        (
            lambda: lv.analysis.ground_state(lv.Schrodinger(np.eye(2)), tol=0.0),
            ValueError,
            "tol must be from 1e-14 to below 1, not 0",
        ),
        (
            lambda: lv.analysis.thermal_state(lv.Schrodinger(np.eye(2)), 0.0),
            ValueError,
            "must be positive",
        ),
        (
            lambda: lv.analysis.thermal_state(lv.Schrodinger(np.eye(2)), 1.0, states=0),
            ValueError,
            "states",
        ),
    ],
)
def test_what_is_wrong_is_said(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_an_energy_outside_the_bounds_is_seen():
    system = lv.Schrodinger(lv.Lattice(300))
    system.__dict__["_spectrum"] = system._spectrum.__class__((-1.5, 1.5), "probable")
    with pytest.raises(RuntimeError, match="an energy lies outside the bounds"):
        lv.analysis.thermal_state(system, 0.05, states=1)


@pytest.mark.parametrize("temperature", [0.02, 0.005, 1e-3, 1e-6])
def test_a_cold_state_is_the_ground_state_however_wide_the_bounds_are(temperature):
    ring = lv.SpinSystem(12, ["xx", "yy", "zz"], periodic=True, up=6)
    thermal = lv.analysis.thermal_state(
        lv.Schrodinger(ring, bounds="gershgorin"), temperature, states=2
    )
    assert thermal.energy == pytest.approx(-5.387390917445, abs=1e-7)
    assert thermal.bound < 1e-8
    assert thermal.log_partition == pytest.approx(5.387390917445 / temperature, rel=0.05)


def test_states_of_infinite_temperature_are_random_alone():
    chain = lv.SpinSystem(6, ["xx", "yy", "zz"])
    hot = lv.analysis.thermal_state(lv.Schrodinger(chain), np.inf, states=3, seed=2)
    same = lv.analysis.thermal_state(lv.Schrodinger(chain), 1e300, states=3, seed=2)
    assert np.abs(hot.psi - same.psi).max() < 1e-14
    assert hot.log_partition == pytest.approx(np.log(64), abs=0.5)


def test_imaginary_time_of_a_state_is_the_exponential():
    parts = np.random.default_rng(3).normal(size=(2, 40, 40))
    real = parts[0] + parts[0].T
    for h, hbar in ((real, 1.0), (real + 1j * (parts[1] - parts[1].T), 0.5)):
        system = lv.Schrodinger(h, hbar=hbar)
        psi = np.random.default_rng(4).normal(size=40) + 0.5j
        levels, vectors = np.linalg.eigh(h)
        for tau in (0.0, 0.03, 1.0, 40.0):
            cool = lv.analysis.imaginary_time(system, tau, psi=3 * psi)
            weights = np.exp(-tau / hbar * (levels - levels[0])) * (vectors.conj().T @ psi)
            exact, size = vectors @ weights, np.linalg.norm(weights)
            assert np.linalg.norm(cool.psi - exact / size) < 1e-9
            log_norm = np.log(size / np.linalg.norm(psi)) - tau / hbar * levels[0]
            assert abs(cool.log_norm - log_norm) < 1e-9 * max(1, abs(log_norm))
            assert abs(cool.energy - np.vdot(exact, h @ exact).real / size**2) < 1e-8


def test_imaginary_time_ends_in_the_ground_state_however_long_it_is():
    system = lv.Schrodinger(lv.Grid(-8, 8, 64, potential=lambda t, x, params: x**2 / 2))
    psi = np.exp(-((system.grid.points[:, 0] - 1) ** 2))
    cool = lv.analysis.imaginary_time(system, 1e6, psi=psi)
    assert abs(cool.energy - 0.5) < 1e-10
    assert cool.psi.dtype == float
    assert abs(cool.log_norm + 0.5e6) < 10
    still = lv.analysis.imaginary_time(system, 1.0, **cool.start)
    assert np.linalg.norm(still.psi - cool.psi) < 1e-11
    again = lv.integrate(system, "auto", t=(0, 1), **cool.start)
    assert abs(again.observed["autocorrelation"][-1] - np.exp(-0.5j)) < 1e-8


def test_imaginary_time_refuses_bad_input():
    system = lv.Schrodinger(np.eye(2))
    with pytest.raises(ValueError, match="tau must be finite and not negative, not -1"):
        lv.analysis.imaginary_time(system, -1.0, psi=[1, 0])
    with pytest.raises(ValueError, match="psi must have shape"):
        lv.analysis.imaginary_time(system, 1.0, psi=[1, 0, 0])
    one = lv.analysis.imaginary_time(lv.Schrodinger([[2.0]]), 3.0, psi=[1.0])
    assert abs(one.log_norm + 6) < 1e-13
    assert one.psi[0] == 1
