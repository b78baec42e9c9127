"""Condensates: potentials that depend on the density, by the split operator."""

import pickle

import casadi as ca
import numpy as np
import pytest

import liouville as lv

COUPLING = {"g": 1.0}


def coupled(t, rho, params):
    return params.g * rho


def trapped(points=128, width=10.0, g=1.0, **more):
    grid = lv.Grid(-width, width, points, potential=lambda t, x, params: x**2 / 2)
    return lv.Schrodinger(grid, nonlinearity=coupled, params={"g": g}, **more)


def free(points, width, g, **more):
    return lv.Schrodinger(
        lv.Grid(-width, width, points), nonlinearity=coupled, params={"g": g}, **more
    )


def on(system, values):
    """Return values of a wave function as components."""
    return values * np.sqrt(system.grid.cell)


def packet(system, centre=1.0):
    psi = np.exp(-((system.grid.points[:, 0] - centre) ** 2) / 2) + 0j
    return psi / np.linalg.norm(psi)


def bright(x, t, v=1.5, x0=-5.0):
    """Return a solution of i psi' = -psi''/2 - |psi|^2 psi."""
    phase = np.exp(1j * (v * (x - x0) + (1 - v**2) * t / 2))
    return phase / np.cosh(x - x0 - v * t)


def test_a_bright_soliton_keeps_its_shape():
    system = free(640, 32.0, -1.0)
    x = system.grid.points[:, 0]
    run = lv.integrate(
        system, lv.SplitOperator(), t=(0, 6), h=0.02, every=100, psi=on(system, bright(x, 0.0))
    )
    for t, psi in zip(run.t, run.psi, strict=True):
        assert np.abs(psi - on(system, bright(x, t))).max() < 1e-9
    assert np.ptp(run.invariants["energy"]) < 1e-10
    # of psi = sech(x) e^{ivx}: v^2 + 1/3 - 2/3
    assert abs(run.invariants["energy"][0] - (1.5**2 - 1 / 3)) < 1e-10


def test_two_dark_solitons_move_at_their_speed():
    """A periodic box has a soliton and its mirror image, which undoes the jump of the phase."""
    v, width = 0.6, 40.0
    system = free(512, width, 1.0)
    x = system.grid.points[:, 0]
    gamma = np.sqrt(1 - v**2)

    def dark(y, t, v):
        return gamma * np.tanh(gamma * (y - v * t)) + 1j * v

    def pair(t):
        # the tails of tanh at the other one are 1 to roundoff
        left, right = dark(x + 20, t, v), dark(-(x - 20), t, v)
        return on(system, left * right / (gamma + 1j * v) * np.exp(-1j * t))

    run = lv.integrate(system, lv.SplitOperator(), t=(0, 8), h=0.05, every=160, psi=pair(0.0))
    assert np.abs(run.psi[-1] - pair(8.0)).max() < 1e-8


@pytest.mark.parametrize(
    ("scheme", "order", "steps"),
    [("S2", 2, 40), ("BM4", 4, 20), ("RKN4s6", 4, 20), ("RKN6s11", 6, 12), ("SS8s21", 8, 20)],
)
def test_orders_are_those_of_a_linear_equation(scheme, order, steps):
    system = trapped(g=4.0)
    start = {"t": (0, 1), "psi": packet(system)}
    exact = lv.integrate(system, lv.SplitOperator("RKN6s11"), steps=200, every=200, **start)
    errors = [
        np.linalg.norm(
            lv.integrate(system, lv.SplitOperator(scheme), steps=n, every=n, **start).psi[-1]
            - exact.psi[-1]
        )
        for n in (steps, 2 * steps)
    ]
    assert order - 0.4 < np.log2(errors[0] / errors[1]) < order + 1.6


@pytest.mark.parametrize("moving", [False, True])
def test_no_nonlinearity_has_the_bits_of_a_linear_equation(moving):
    def potential(t, x, params):
        return x**2 / 2 + (0.1 * ca.cos(t) * x if moving else 0)

    grid = lv.Grid(-8, 8, 64, potential=potential)
    linear, zero = lv.Schrodinger(grid), lv.Schrodinger(grid, nonlinearity=lambda t, rho, params: 0)
    options = {"t": (0, 1), "steps": 8, "psi": packet(linear), "observe": {"x": grid.points[:, 0]}}
    first, second = (lv.integrate(s, lv.SplitOperator(), **options) for s in (linear, zero))
    assert np.array_equal(first.psi, second.psi)
    for name, values in {**first.invariants, **first.observed}.items():
        assert np.allclose(values, {**second.invariants, **second.observed}[name], atol=1e-15)


def test_one_point_turns_its_phase_alone():
    system = lv.Schrodinger(
        lv.Grid(0, 1, 2), nonlinearity=lambda t, rho, params: rho**2 + t, hbar=2.0
    )
    psi = np.array([0.6, 0.6])  # at rest: both points alike
    run = lv.integrate(system, lv.SplitOperator("S2"), t=(0, 1), steps=40, psi=psi)
    density = 0.36 / 0.5
    assert np.abs(run.psi[-1] - psi * np.exp(-0.5j * (density**2 + 0.5))).max() < 1e-12
    wanted = density**3 / 3 + np.array([0.0, 1.0]) * density
    assert np.abs(run.observed["energy"][[0, -1]] - wanted).max() < 1e-12


def test_the_norm_is_kept_to_roundoff_and_the_energy_is_bounded():
    system = trapped(64, 8.0, 5.0)
    run = lv.integrate(
        system, lv.SplitOperator("BM4"), t=(0, 5000), steps=100_000, every=5000,
        psi=packet(system, 0.5), states=False,
    )  # fmt: skip
    norm, energy = run.invariants["norm"], run.invariants["energy"]
    assert np.abs(norm - 1).max() < 1e-13
    drift = np.abs(energy - energy[0])
    assert drift.max() < 1e-6
    assert drift[10:].max() < 3 * drift[:10].max()


@pytest.mark.parametrize("scheme", ["S2", "RKN6s11"])
def test_a_run_forth_and_back_ends_at_its_start(scheme):
    system = trapped(64, 8.0, 5.0)
    psi = packet(system)
    options = {"h": 0.02, "every": 100}
    there = lv.integrate(system, lv.SplitOperator(scheme), t=(0, 10), psi=psi, **options)
    back = lv.integrate(system, lv.SplitOperator(scheme), t=(10, 0), psi=there.psi[-1], **options)
    assert np.linalg.norm(back.psi[-1] - psi) < 1e-11


@pytest.mark.parametrize(
    ("g", "mu", "points", "width"),
    [
        (0.0, 0.5, 64, 8.0),
        (1.0, 0.869943814753, 128, 9.0),
        (10.0, 3.107243089426, 128, 10.0),
        (100.0, 14.134287086585, 256, 12.0),
    ],
)
def test_ground_states_have_their_chemical_potentials(g, mu, points, width):
    system = trapped(points, width, g)
    ground = lv.analysis.ground_state(system, tol=1e-11)
    assert abs(ground.chemical_potential - mu) < 1e-9
    x, psi = system.grid.points[:, 0], ground.psi
    motion = ground.energy - (psi**2 @ (x**2 / 2)) - g / 2 * np.sum(psi**4) / system.grid.cell
    virial = 2 * motion - psi**2 @ x**2 + g / 2 * np.sum(psi**4) / system.grid.cell
    assert abs(virial) < 1e-8
    still = lv.integrate(system, lv.SplitOperator(), t=(0, 1), steps=20, **ground.start)
    assert np.abs(still.psi[-1] - np.exp(-1j * mu) * psi).max() < 1e-7


def test_a_strong_one_is_that_of_thomas_and_fermi():
    ground = lv.analysis.ground_state(trapped(512, 20.0, 1000.0))
    mu = ground.chemical_potential
    assert abs(mu / (1500**2 / 8) ** (1 / 3) - 1) < 1e-4  # (3g/2)^(2/3) / 2
    x = trapped(512, 20.0).grid.points[:, 0]
    density = np.maximum(mu - x**2 / 2, 0) / 1000
    assert np.abs(ground.psi**2 / (40 / 512) - density).max() < 0.02 * density.max()


def test_an_attractive_one_is_a_soliton():
    system = lv.Schrodinger(
        lv.Grid(-10, 10, 128, potential=lambda t, x, params: 1e-6 * x**2),
        nonlinearity=coupled, params={"g": -4.0},
    )  # fmt: skip
    ground = lv.analysis.ground_state(system, tol=1e-8)
    assert abs(ground.chemical_potential + 2) < 1e-4  # -g^2/8
    assert abs(ground.energy + 16 / 24) < 1e-4


def test_the_energy_of_fractional_powers_is_exact():
    """As of unitary fermions and of beyond-mean-field corrections; conserved to the order."""
    grid = lv.Grid(-8, 8, 64, potential=lambda t, x, params: x**2 / 2)
    for power in (2 / 3, 1.5, 3.0):
        system = lv.Schrodinger(grid, nonlinearity=lambda t, rho, params, p=power: rho**p)
        psi = packet(system)
        rho = np.abs(psi) ** 2 / grid.cell
        linear = lv.integrate(lv.Schrodinger(grid), lv.SplitOperator(), t=(0, 1), steps=1, psi=psi)
        run = lv.integrate(system, lv.SplitOperator(), t=(0, 1), steps=1, psi=psi)
        wanted = grid.cell * np.sum(rho ** (power + 1)) / (power + 1)
        found = run.invariants["energy"][0] - linear.invariants["energy"][0]
        assert abs(found - wanted) < 1e-13


def place_of_zero(psi, x, y):
    """Return where a plane through the nine points about the deepest hole vanishes."""
    i, j = np.unravel_index(np.where(np.hypot(x, y) < 2.5, np.abs(psi), np.inf).argmin(), psi.shape)
    near = np.s_[i - 1 : i + 2, j - 1 : j + 2]
    columns = np.column_stack([np.ones(9), x[near].ravel(), y[near].ravel()])
    value, *slopes = np.linalg.lstsq(columns, psi[near].ravel(), rcond=None)[0]
    matrix = np.array([[s.real for s in slopes], [s.imag for s in slopes]])
    return np.linalg.solve(matrix, [-value.real, -value.imag])


def test_a_vortex_goes_around_its_trap_at_the_published_frequency():
    """Of Navarro et al., Phys. Rev. Lett. 110 (2013) 225301: ln(2^(3/2) pi mu) / (R^2 - r^2)."""
    g = 400.0
    grid = lv.Grid(
        (-8, -8), (8, 8), (72, 72), potential=lambda t, x, params: (x[0] ** 2 + x[1] ** 2) / 2
    )
    system = lv.Schrodinger(grid, nonlinearity=coupled, params={"g": g})
    ground = lv.analysis.ground_state(system, tol=1e-6)
    x, y = (axis.reshape(grid.shape) for axis in grid.points.T)
    z = (x - 1.0) + 1j * y
    psi = ground.psi.reshape(grid.shape) * z / np.sqrt(np.abs(z) ** 2 + 0.1)
    psi /= np.linalg.norm(psi)
    run = lv.integrate(system, lv.SplitOperator(), t=(0, 8), h=0.04, every=20, psi=psi)
    states = run.psi.reshape(-1, *grid.shape)
    places = np.array([place_of_zero(each, x, y) for each in states])
    angle = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    mu = ground.chemical_potential
    formula = np.log(2**1.5 * np.pi * mu) / (2 * mu - np.mean(np.sum(places**2, axis=1)))
    assert abs(np.polyfit(run.t, angle, 1)[0] / formula - 1) < 0.05
    kx, ky = np.meshgrid(*grid.k, indexing="ij")
    momenta = []
    for each in states:
        transform = np.fft.fft2(each)
        turned = x * np.fft.ifft2(ky * transform) - y * np.fft.ifft2(kx * transform)
        momenta.append(np.vdot(each, turned).real)
    assert np.ptp(momenta) < 1e-4 * momenta[0]


def test_a_collapse_is_named():
    system = lv.Schrodinger(
        lv.Grid(-10, 10, 256), nonlinearity=lambda t, rho, params: -params.g * rho**2,
        params={"g": 8.0},
    )  # fmt: skip
    psi = packet(system, 0.0)
    with pytest.raises(lv.IntegrationError, match="no longer resolves psi") as found:
        lv.integrate(system, lv.SplitOperator(), t=(0, 2), h=0.001, every=10, psi=psi)
    assert found.value.quantity == "psi"
    assert 0 < found.value.t < 0.5
    assert np.isfinite(found.value.solution.psi).all()
    assert np.abs(found.value.solution.invariants["norm"] - 1).max() < 1e-12
    with pytest.raises(RuntimeError, match="does not resolve the ground state"):
        lv.analysis.ground_state(system)


def test_a_finer_grid_takes_no_shorter_steps():
    """A state that half of the wave numbers hold is in no resonance with the others."""
    pairs, ends = [], []
    for points in (128, 1024):
        system = trapped(points, 10.0, 10.0)
        psi = packet(system, 1.0)
        run = lv.integrate(system, lv.SplitOperator(tol=1e-6), t=(0, 1), psi=psi)
        by_hand = lv.integrate(system, lv.SplitOperator(), t=(0, 1), steps=400, every=400, psi=psi)
        assert np.linalg.norm(run.psi[-1] - by_hand.psi[-1]) < 1e-6
        pairs.append(run.stats["products"])
        ends.append(run.psi[-1][:: points // 128] * (points / 128) ** 0.5)
    assert pairs[1] < 1.5 * pairs[0]
    assert np.linalg.norm(ends[0] - ends[1]) < 2e-6


def test_steps_in_resonance_are_named():
    """Waves with h (T + rho) near pi grow out of the roundoff on a uniform density."""
    system = free(64, np.pi * 2, 4.0)
    noise = np.random.default_rng(0).normal(size=64)
    psi = on(system, 1 + 1e-10 * noise)  # a density of 1
    wild = lv.integrate(system, lv.SplitOperator("S2"), t=(0, 6), h=np.pi / 200, psi=psi)
    assert wild.message == ""
    with pytest.raises(lv.IntegrationError, match="in resonance with") as found:
        lv.integrate(system, lv.SplitOperator("S2"), t=(0, 60), h=np.pi / 110, every=10, psi=psi)
    assert "smaller h" in str(found.value)
    even = on(system, 1 + 0 * noise)
    run = lv.integrate(system, lv.SplitOperator("S2"), t=(0, 5.5), h=np.pi / 110, psi=even)
    assert "may be in resonance with waves" in run.message
    limit = float(run.message.rsplit("h = ", 1)[1].split()[0])
    quiet = lv.integrate(system, lv.SplitOperator("S2"), t=(0, 5.5), h=0.99 * limit, psi=even)
    assert quiet.message == ""


def test_a_resonance_that_roundoff_outlives_is_not_named():
    """Noise that grows by e^16 is 1e-9: of a uniform density the phase is known."""
    system = free(64, np.pi * 2, 4.0)
    even = on(system, np.ones(64))
    run = lv.integrate(system, lv.SplitOperator("S2"), t=(0, 4), h=np.pi / 110, psi=even)
    assert run.message == ""
    assert np.abs(run.psi[-1] - np.exp(-16j) * even).max() < 1e-8


def test_members_have_couplings_of_their_own():
    system = trapped(64, 8.0)
    psi = packet(system)
    options = {"t": (0, 1), "steps": 10, "psi": psi}
    many = lv.ensemble(system, lv.SplitOperator(), params={"g": [0.0, 2.0]}, **options)
    for k, g in enumerate([0.0, 2.0]):
        alone = lv.integrate(system, lv.SplitOperator(), params={"g": g}, **options)
        assert np.array_equal(many.psi[:, k], alone.psi)


def test_a_pickle_runs_to_the_same_bits():
    system = trapped(64, 8.0)
    options = {"t": (0, 1), "steps": 5, "psi": packet(system)}
    run = lv.integrate(system, lv.SplitOperator(), **options)
    other = lv.integrate(pickle.loads(pickle.dumps(system)), lv.SplitOperator(), **options)
    assert np.array_equal(run.psi, other.psi)


@pytest.mark.parametrize(
    "method", [lv.Chebyshev(), lv.Lanczos(), lv.Magnus(), lv.SchrodingerSplitting(1e-6)]
)
def test_methods_for_linear_equations_refuse_one(method):
    system = trapped(64)
    with pytest.raises(TypeError, match="is for a linear equation, and this one has") as found:
        lv.integrate(system, method, t=(0, 1), psi=packet(system))
    assert "hint: take 'auto' or SplitOperator(tol=1e-8)" in str(found.value)
    with pytest.raises(TypeError, match="thermal state is for a linear equation"):
        lv.analysis.thermal_state(system, 1.0)


def test_bad_input_is_refused_before_the_run():
    with pytest.raises(TypeError, match="on a Grid, and H is none"):
        lv.Schrodinger(np.eye(2), nonlinearity=coupled, params=COUPLING)
    with pytest.raises(TypeError, match=r"nonlinearity.*must be a function|nonlinearity must"):
        lv.Schrodinger(lv.Grid(0, 1, 4), nonlinearity=3.0)
    system = lv.Schrodinger(lv.Grid(-5, 5, 32), nonlinearity=lambda t, rho, params: ca.log(rho))
    psi = packet(system)
    psi[0] = 0
    with pytest.raises(ValueError, match="nonlinearity is -inf at t = 0 and rho = 0"):
        lv.integrate(system, lv.SplitOperator(), t=(0, 1), steps=10, psi=psi)
    psi = packet(trapped(32))
    with pytest.raises(TypeError, match="no tangents and no pullback"):
        lv.vjp(trapped(32), lv.SplitOperator(), t=(0, 1), steps=4, psi=psi, wrt=["psi"])
