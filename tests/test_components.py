"""Wave functions of several components on a grid: spinors, mixtures, Rabi coupling."""

import pickle

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
import pytest
from test_condensates import bright

import liouville as lv

RABI = np.array([[0.2, 0.7], [0.7, -0.2]])
SPIN_ONE = np.array([[0.0, 0.3, 0.0], [0.3, 0.0, 0.3], [0.0, 0.3, 0.0]])


def alike(t, rho, params):
    return -rho[0] - rho[1]


def turned(coupling, t):
    """Return exp(-i C t)."""
    levels, vectors = np.linalg.eigh(coupling)
    return vectors @ np.diag(np.exp(-1j * levels * t)) @ vectors.conj().T


def packet(grid, centre=1.0, momentum=0.0):
    x = grid.points
    psi = np.exp(-((x - centre) ** 2).sum(axis=1) / 2 + 1j * momentum * x[:, 0])
    return psi / np.linalg.norm(psi)


def mixture(coupling=None, points=128, g=(3.0, 2.0, 1.0)):
    """Return two components in traps apart, with interactions of each and between them."""
    grid = lv.Grid(
        -10, 10, points, potential=lambda t, x, params: [x**2 / 2, (x - 0.5) ** 2 / 2 + 0.3]
    )

    def interacting(t, rho, params):
        return [
            params.g[0] * rho[0] + params.g[1] * rho[1],
            params.g[1] * rho[0] + params.g[2] * rho[1],
        ]

    return lv.Schrodinger(
        grid, components=2, coupling=coupling, nonlinearity=interacting, params={"g": list(g)}
    )


@pytest.mark.parametrize("coupling", [None, RABI, RABI * [[1, 1j], [-1j, 1]]])
def test_a_soliton_of_manakov_turns_its_spin_by_the_coupling_alone(coupling):
    grid = lv.Grid(-32, 32, 640)
    system = lv.Schrodinger(grid, components=2, coupling=coupling, nonlinearity=alike)
    spin = np.array([0.6, 0.8j])
    x = grid.points[:, 0]

    def exact(t):
        turn = np.eye(2) if coupling is None else turned(coupling, t)
        return np.outer(turn @ spin, bright(x, t)) * np.sqrt(grid.cell)

    run = lv.integrate(system, lv.SplitOperator(), t=(0, 6), h=0.02, every=100, psi=exact(0.0))
    assert run.psi_on_grid.shape == (4, 2, 640)
    for t, psi in zip(run.t, run.psi_on_grid, strict=True):
        assert np.abs(psi - exact(t)).max() < 1e-9
    assert np.ptp(run.invariants["norm"]) < 1e-12
    energy = run.invariants["energy"]
    assert np.ptp(energy) < 1e-9
    mean = 0.0 if coupling is None else (spin.conj() @ coupling @ spin).real
    assert abs(energy[0] - (1.5**2 - 1 / 3 + 2 * mean)) < 1e-9
    populations = run.invariants if coupling is None else run.observed
    found = populations["populations"]
    assert np.abs(found - (np.abs(run.psi_on_grid) ** 2).sum(axis=2)).max() < 1e-12
    by_tolerance = lv.integrate(system, lv.SplitOperator(tol=1e-6), t=(0, 6), psi=exact(0.0))
    assert np.linalg.norm(by_tolerance.psi_on_grid[-1] - exact(6.0)) < 1e-5


@pytest.mark.parametrize(
    ("scheme", "order", "steps"),
    [("S2", 2, 160), ("BM4", 4, 40), ("RKN4s6", 4, 40), ("BM6", 6, 40), ("RKN6s11", 4, 40)],
)
def test_schemes_keep_their_order_beside_a_coupling_but_for_rkn6s11(scheme, order, steps):
    """[V, [V, [V, C]]] is not zero where the components have different potentials."""
    grid = lv.Grid(-16, 16, 128, lambda t, x, params: [x**2 / 2 + 2 * x, x**2 / 2 - 2 * x])
    system = lv.Schrodinger(
        grid, components=2, coupling=[[0, 1], [1, 0]],
        nonlinearity=lambda t, rho, params: [3 * rho[0] + 2 * rho[1], 2 * rho[0] + rho[1]],
    )  # fmt: skip
    psi = np.array([packet(grid), 0.7j * packet(grid, -0.5, 0.4)])

    def end(scheme, steps):
        method = lv.SplitOperator(scheme)
        return lv.integrate(system, method, t=(0, 1), steps=steps, every=steps, psi=psi).psi[-1]

    exact = end("SS8s21", 320)
    errors = [np.linalg.norm(end(scheme, n) - exact) for n in (steps // 2, steps)]
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.3
    assert errors[1] > 1e-12
    plan = lv.plan(system, lv.SplitOperator(scheme, 1e-6), t=(0, 1), psi=psi)
    says = f"{scheme} has order 4 where components are coupled; BM6 has 6" in plan.reasons
    assert says == (scheme == "RKN6s11")


def test_components_that_do_not_interact_have_the_bits_of_single_runs():
    def moving(t, x, params):
        return x**2 / 2 * (1 + 0.1 * np.sin(t))

    both = lv.Grid(-10, 10, 128, lambda t, x, params: [moving(t, x, params), x**2 + 0.1 * t])
    grids = (
        lv.Grid(-10, 10, 128, moving),
        lv.Grid(-10, 10, 128, lambda t, x, params: x**2 + 0.1 * t),
    )
    psi = np.array([packet(both), packet(both, -0.5, 0.4)])
    system = lv.Schrodinger(
        both, components=2, nonlinearity=lambda t, rho, params: [2 * rho[0], -rho[1]]
    )
    run = lv.integrate(system, lv.SplitOperator(), t=(0, 1), steps=15, psi=psi)
    for k, (grid, g) in enumerate(zip(grids, (2.0, -1.0), strict=True)):
        system = lv.Schrodinger(grid, nonlinearity=lambda t, rho, params, g=g: g * rho)
        single = lv.integrate(system, lv.SplitOperator(), t=(0, 1), steps=15, psi=psi[k])
        assert np.array_equal(run.psi_on_grid[:, k], single.psi)


def test_energy_and_populations_of_a_mixture_are_kept_over_many_steps():
    system = mixture()
    psi = np.array([packet(system.grid), packet(system.grid, -0.5, 0.4)])
    run = lv.integrate(system, lv.SplitOperator(), t=(0, 40), h=0.02, every=50, psi=psi)
    assert np.ptp(run.invariants["energy"]) < 1e-8
    assert np.ptp(run.invariants["populations"], axis=0).max() < 1e-11
    back = lv.integrate(system, lv.SplitOperator(), t=(40, 0), h=0.02, every=2000, psi=run.psi[-1])
    assert np.linalg.norm(back.psi[-1] - psi.ravel()) < 1e-8


def dense(system, coupling):
    """Return H of a linear equation as a matrix, from the kinetic energy of plane waves."""
    grid, n = system.grid, system.grid.size
    waves = np.exp(1j * np.outer(grid.axes[0] - grid.low[0], grid.k[0])) / np.sqrt(n)
    kinetic = waves @ np.diag(grid.kinetic(1.0)[0]) @ waves.conj().T
    count = len(coupling)
    return (
        np.kron(np.eye(count), kinetic) + np.kron(coupling, np.eye(n)) + np.diag(system.potential)
    )


RING = np.array([[0.0, 0.4, -0.4j], [0.4, 0.1, 0.4], [0.4j, 0.4, 0.0]])


@pytest.mark.parametrize(
    "coupling", [SPIN_ONE, RING, SPIN_ONE * 1j * [[0, 1, 0], [-1, 0, 1], [0, -1, 0]]]
)
@pytest.mark.parametrize("method", ["auto", lv.Chebyshev(), lv.Lanczos()])
def test_a_linear_equation_of_three_components_is_that_of_its_matrix(coupling, method):
    """A flux goes through the ring, so that no phases make it real."""
    grid = lv.Grid(-6, 6, 32, lambda t, x, params: [x**2 / 2, x**2 / 2 + 0.2, 0.3 * x])
    system = lv.Schrodinger(grid, components=3, coupling=coupling)
    assert system.is_real == (coupling is not RING)
    h = dense(system, coupling)
    psi = np.array([packet(grid), 0.5j * packet(grid, 0.0), np.zeros(32)])
    run = lv.integrate(system, method, t=(0, 2), psi=psi)
    exact = turned(h, 2.0) @ psi.ravel()
    assert np.linalg.norm(run.psi[-1] - exact) < 2e-8
    assert abs(run.invariants["energy"][0] - (psi.ravel().conj() @ h @ psi.ravel()).real) < 1e-12
    low, high = system.bounds
    assert low <= np.linalg.eigvalsh(h)[0]
    assert np.linalg.eigvalsh(h)[-1] <= high
    ground = lv.analysis.ground_state(system)
    assert abs(ground.energy - np.linalg.eigvalsh(h)[0]) < 1e-9


def test_observables_of_one_component_are_those_of_all_and_matrices_act_between_them():
    grid = lv.Grid(
        (-8, -6), (8, 6), (32, 24), potential=lambda t, x, params: (x[0] ** 2 + x[1] ** 2) / 2
    )
    system = lv.Schrodinger(grid, components=2, coupling=RABI)
    psi = np.array([packet(grid), 0.5 * packet(grid, -0.5, 0.4)]).reshape(2, 32, 24)
    x = grid.points[:, 0]
    observe = {
        "x": x,
        "x on the grid": x.reshape(32, 24),
        "x in a list": x.tolist(),
        "x of each": lambda t, x, params: x[0],
        "spin": np.diag([1.0, -1.0]),
        "also spin": lambda t, x, params: [1.0, -1.0],
        "flip": np.array([[0, 1], [0, 0]]),
        "overlap": psi,
        "flux": grid.flux(1.0),
    }
    run = lv.integrate(system, "auto", t=(0, 0.5), psi=psi, observe=observe)
    for values, psi in zip(zip(*run.observed.values(), strict=True), run.psi_on_grid, strict=True):
        found = dict(zip(run.observed, values, strict=True))
        flat = psi.reshape(2, -1)
        rho = np.abs(flat) ** 2
        for name in ("x", "x on the grid", "x in a list", "x of each"):
            assert abs(found[name] - (rho * x).sum()) < 1e-12
        for name in ("spin", "also spin"):
            assert abs(found[name] - (rho[0] - rho[1]).sum()) < 1e-12
        assert abs(found["flip"] - np.vdot(flat[0], flat[1])) < 1e-12
        flux = sum(np.vdot(each, grid.flux(1.0)[1](each)).real for each in flat)
        assert abs(found["flux"] - flux) < 1e-12


def test_members_plans_files_and_pickles_hold_several_components(tmp_path):
    system = mixture(RABI)
    psi = np.array([packet(system.grid), packet(system.grid, -0.5, 0.4)])
    many = np.array([psi, psi[::-1]])
    options = {"t": (0, 0.5), "h": 0.05, "params": {"g": [1.0, 0.5, 2.0]}}
    run = lv.ensemble(system, lv.SplitOperator(), psi=many, **options)
    assert run.psi_on_grid.shape == (11, 2, 2, 128)
    assert run.observed["populations"].shape == (11, 2, 2)
    single = lv.integrate(
        pickle.loads(pickle.dumps(system)), lv.SplitOperator(), psi=psi, **options
    )
    assert np.array_equal(single.psi, run.psi[:, 0])
    method = lv.SplitOperator(tol=1e-6)
    lv.plan(system, method, t=(0, 0.5), psi=psi).save(tmp_path / "plan.json")
    planned = lv.integrate(
        system, lv.Plan.load(tmp_path / "plan.json"), t=(0, 0.5), psi=psi, params=options["params"]
    )
    assert np.linalg.norm(planned.psi[-1] - single.psi[-1]) < 1e-5
    stored = lv.integrate(
        system, lv.SplitOperator(), psi=psi, store=tmp_path / "run.zarr", **options
    )
    assert np.array_equal(stored.psi[-1], single.psi[-1])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"coupling": RABI}, "coupling must have order 1, a row for each component, not 2"),
        ({"components": 2, "coupling": [[0, 1], [2, 0]]}, "coupling is not Hermitian"),
        ({"components": 2, "coupling": np.eye(3)}, "not 3\nhint: give components=3"),
        (
            {"components": 2, "absorber": lambda t, x, params: [1, -1]},
            "as -1 at x = -5 of component 1",
        ),
        ({"components": 0}, "components must be"),
        (
            {"components": 2, "nonlinearity": lambda t, rho, params: [rho[0], rho[0], rho[1]]},
            "nonlinearity must return one value, or 2, one for each component, not 3",
        ),
        (
            {"components": 3, "coupling": RING, "nonlinearity": lambda t, rho, params: rho},
            "a nonlinearity takes a coupling that phases of the components make real",
        ),
    ],
)
def test_what_fits_no_components_is_refused(options, said):
    with pytest.raises(ValueError, match=said):
        lv.Schrodinger(lv.Grid(-5, 5, 32), **options).absorber  # noqa: B018


def test_a_nonlinearity_without_an_energy_is_refused_and_so_is_what_takes_one_component():
    grid = lv.Grid(-5, 5, 32)
    system = lv.Schrodinger(
        grid, components=2, nonlinearity=lambda t, rho, params: [rho[1], 2 * rho[0]]
    )
    psi = np.array([packet(grid), packet(grid)])
    with pytest.raises(
        ValueError, match=r"dW\[0\] / d rho\[1\] is 1, and with both exchanged it is 2"
    ):
        lv.integrate(system, lv.SplitOperator(), t=(0, 1), h=0.1, psi=psi)
    with pytest.raises(TypeError, match="populations are missing: nothing couples"):
        lv.analysis.ground_state(mixture())
    with pytest.raises(TypeError, match="populations= are those of components without coupling"):
        lv.analysis.ground_state(mixture(RABI), populations=[0.5, 0.5])
    of_one = lv.Schrodinger(grid, nonlinearity=lambda t, rho, params: rho)
    with pytest.raises(TypeError, match="populations= are those of components=, and there is one"):
        lv.analysis.ground_state(of_one, populations=[1.0])
    with pytest.raises(TypeError, match="populations must be real numbers, not"):
        lv.analysis.ground_state(mixture(), populations=[0.5j, 0.5])
    turning = [(lambda t, params: ca.cos(t), RABI)]
    with pytest.raises(TypeError, match="a nonlinearity takes drives by diagonal matrices alone"):
        lv.Schrodinger(grid, components=2, nonlinearity=alike, drive=turning)
    with pytest.raises(ValueError, match=r"populations must be positive and 1 in all, not \[0.5"):
        lv.analysis.ground_state(mixture(), populations=[0.5, 0.6])
    with pytest.raises(ValueError, match=r"populations must have shape \(2,\)"):
        lv.analysis.ground_state(mixture(), populations=[1.0])
    with pytest.raises(TypeError, match="components= is for wave functions on a Grid"):
        lv.Schrodinger(np.eye(4), components=2)
    linear = lv.Schrodinger(grid, components=2, coupling=RABI)
    with pytest.raises(TypeError, match="no derivatives of runs of several components"):
        lv.vjp(linear, "auto", t=(0, 1), psi=psi, wrt=["psi"])
    with pytest.raises(ValueError, match=r"potential must have shape .* as components= says"):
        lv.Schrodinger(lv.Grid(-5, 5, 32, np.zeros((3, 32))), components=2)
    with pytest.raises(ValueError, match=r"psi must have shape \(64,\) or \(2, 32\), not \(32,\)"):
        lv.integrate(linear, "auto", t=(0, 1), psi=psi[0])
    singular = lv.Grid(-5, 5, 32, lambda t, x, params: [x, 1 / x])
    with pytest.raises(ValueError, match="x = 0 of component 1"):
        lv.Schrodinger(singular, components=2)


def test_an_array_of_potentials_has_a_row_for_each_component():
    x = np.arange(32) * 10 / 32 - 5
    rows = np.array([x**2 / 2, (x - 0.5) ** 2 / 2])
    of_array = lv.Schrodinger(lv.Grid(-5, 5, 32, rows), components=2, coupling=RABI)
    by_function = lv.Schrodinger(
        lv.Grid(-5, 5, 32, lambda t, x, params: [x**2 / 2, (x - 0.5) ** 2 / 2]),
        components=2, coupling=RABI,
    )  # fmt: skip
    assert np.abs(of_array.potential - by_function.potential).max() < 1e-14
    # an absorber, too, is one of each where it has no rows
    wide = lv.Schrodinger(
        lv.Grid(-5, 5, 32, rows), components=2, coupling=RABI, absorber=0.1 * x**2
    )
    psi = np.array([packet(wide.grid), packet(wide.grid)])
    run = lv.integrate(wide, "auto", t=(0, 1), psi=psi)
    h = dense(wide, RABI) - 1j * np.diag(np.tile(0.1 * x**2, 2))
    levels, vectors = np.linalg.eig(h)
    exact = vectors @ (np.exp(-1j * levels) * np.linalg.solve(vectors, psi.ravel()))
    assert np.linalg.norm(run.psi[-1] - exact) < 1e-7
    assert np.ptp(run.observed["populations"][:, 0]) > 0.01


@pytest.mark.parametrize("coupling", [None, RABI, RABI * [[1, 1j], [-1j, 1]]])
def test_equal_interactions_have_the_ground_state_of_one_component(coupling):
    """All components have its density, and the coupling its lowest energy on top."""
    grid = lv.Grid(-10, 10, 128, lambda t, x, params: x**2 / 2)
    single = lv.analysis.ground_state(
        lv.Schrodinger(grid, nonlinearity=lambda t, rho, params: 20 * rho)
    )
    system = lv.Schrodinger(
        grid, components=2, coupling=coupling,
        nonlinearity=lambda t, rho, params: 20 * (rho[0] + rho[1]),
    )  # fmt: skip
    options = {"populations": [0.3, 0.7]} if coupling is None else {}
    ground = lv.analysis.ground_state(system, **options)
    spin = np.sqrt([0.3, 0.7]) if coupling is None else np.linalg.eigh(coupling)[1][:, 0]
    shift = 0.0 if coupling is None else np.linalg.eigvalsh(coupling)[0]
    assert abs(ground.energy - single.energy - shift) < 1e-11
    assert np.abs(ground.chemical_potential - single.chemical_potential - shift).max() < 1e-8
    overlap = np.vdot(np.outer(spin, single.psi), ground.psi)
    assert abs(abs(overlap) - 1) < 1e-12


@pytest.mark.parametrize("coupling", [None, 0.5 * RABI])
def test_the_ground_state_of_a_mixture_stands_still(coupling):
    system = mixture(coupling, g=(30.0, 25.0, 20.0))
    options = {"populations": [0.4, 0.6]} if coupling is None else {}
    ground = lv.analysis.ground_state(system, **options)
    assert ground.residual < 1e-8
    run = lv.integrate(system, lv.SplitOperator("BM6"), t=(0, 2), h=0.01, every=50, **ground.start)
    rho = np.abs(run.psi) ** 2
    assert np.abs(rho - rho[0]).max() < 1e-9
    assert abs(run.invariants["energy"][0] - ground.energy) < 1e-11
    populations = {**run.invariants, **run.observed}["populations"]
    # no other state near it has less energy
    rng = np.random.default_rng(1)
    for _ in range(4):
        other = ground.psi.reshape(2, -1) * (1 + 0.1 * rng.normal(size=(2, 1))) + 0.02 * packet(
            system.grid, rng.normal()
        )
        sizes = np.linalg.norm(other, axis=1, keepdims=True)
        if coupling is None:
            other *= np.sqrt(populations[0])[:, None] / sizes
        else:
            other /= np.linalg.norm(other)
        near = lv.integrate(system, lv.SplitOperator(), t=(0, 1e-3), steps=1, psi=other)
        assert near.invariants["energy"][0] > ground.energy


def test_a_map_of_several_components_has_the_density_of_all():
    grid = lv.Grid(-5, 5, 32)
    system = lv.Schrodinger(grid, components=2, coupling=RABI)
    psi = np.array([packet(grid), packet(grid, -1.0)])
    run = lv.integrate(system, "auto", t=np.linspace(0, 1, 5), psi=psi)
    axes = lv.plot.density(run)
    drawn = axes.collections[0].get_array()
    plt.close(axes.figure)
    assert np.abs(drawn - (np.abs(run.psi_on_grid) ** 2).sum(axis=1)).max() < 1e-14


def test_a_drive_may_couple_components_and_members_have_potentials_of_their_own():
    """All of a state turns alike, whatever the trap, under a resonant coupling f(t)."""
    grid = lv.Grid(-6, 6, 32, lambda t, x, params: x**2 / 2)
    flip = np.array([[0.0, 1.0], [1.0, 0.0]])
    system = lv.Schrodinger(grid, components=2, drive=[(lambda t, params: ca.cos(t), flip)])
    psi = np.array([packet(grid), np.zeros(32)])
    x = grid.points[:, 0]
    potentials = np.array([x**2 / 2, x**2, 0 * x])
    run = lv.ensemble(system, "auto", t=(0, 1), psi=psi, potential=potentials)
    assert (
        np.abs(
            run.observed["populations"][-1] - [np.cos(np.sin(1)) ** 2, np.sin(np.sin(1)) ** 2]
        ).max()
        < 1e-8
    )
    each = lv.ensemble(
        system, "auto", t=(0, 1), psi=psi, potential=np.stack([potentials, potentials], axis=1)
    )
    assert np.abs(each.psi - run.psi).max() < 1e-12
    tilted = lv.Schrodinger(
        grid, components=2, drive=[(lambda t, params: ca.cos(t), x)],
        nonlinearity=lambda t, rho, params: rho,
    )  # fmt: skip
    moved = lv.integrate(tilted, lv.SplitOperator(), t=(0, 1), steps=20, psi=psi)
    single = lv.Schrodinger(
        grid, drive=[(lambda t, params: ca.cos(t), x)], nonlinearity=lambda t, rho, params: rho
    )
    alone = lv.integrate(single, lv.SplitOperator(), t=(0, 1), steps=20, psi=psi[0])
    assert np.array_equal(moved.psi_on_grid[-1, 0], alone.psi[-1])
