"""Absorbing potentials on grids and lattices, against dense matrices."""

import pickle

import casadi as ca
import numpy as np
import pytest
import scipy.integrate
import scipy.sparse as sp
from scipy.linalg import expm

import liouville as lv

LOW, HIGH, POINTS = -12.0, 12.0, 64


def barrier(t, x, params):
    return 2 / (1 + x**2)


def ramp(t, x, params):
    """Rise as a square from |x| = 6 on, without a jump."""
    return params.w * ((abs(x) - 6 + abs(abs(x) - 6)) / 12) ** 2


def absorbing(w=2.0, potential=barrier, **more):
    grid = lv.Grid(LOW, HIGH, POINTS, potential=potential)
    return lv.Schrodinger(grid, absorber=ramp, params={"w": w}, **more)


def packet(grid, v=2.0):
    x = grid.points[:, 0]
    psi = np.exp(-((x + 3) ** 2) / 2 + 1j * v * x)
    return psi / np.linalg.norm(psi)


def dense(system, t):
    """Return exp(-iHt) of the whole matrix."""
    grid, n = system.grid, system.grid.size
    (k,) = grid.k
    kinetic = np.fft.ifft(k[:, None] ** 2 / 2 * np.fft.fft(np.eye(n), axis=0), axis=0)
    x = grid.points[:, 0]
    return expm(-1j * t * (kinetic + np.diag(barrier(0, x, None) - 1j * system.absorber)))


@pytest.mark.parametrize("scheme", ["S2", "BM4", "RKN4s6", "RKN6s11"])
def test_runs_are_those_of_the_dense_matrix(scheme):
    system = absorbing()
    psi = packet(system.grid)
    exact = dense(system, 5.0) @ psi
    steps = 20_000 if scheme == "S2" else 1000
    run = lv.integrate(
        system, lv.SplitOperator(scheme), t=(0, 5), steps=steps, every=steps, psi=psi
    )
    assert np.linalg.norm(run.psi[-1] - exact) < 1e-7
    assert abs(run.stats["absorbed"] - (1 - np.linalg.norm(exact) ** 2)) < 1e-7
    assert 0.1 < run.stats["absorbed"] < 0.99
    assert "norm" not in run.invariants
    assert (np.diff(run.observed["norm"]) < 0).all()


@pytest.mark.parametrize(
    ("scheme", "order", "steps"), [("S2", 2, 30), ("BM4", 4, 30), ("RKN6s11", 6, 18)]
)
def test_orders_are_those_without_an_absorber(scheme, order, steps):
    """By a smooth absorber, as a kink in it has an order of its own."""
    grid = lv.Grid(LOW, HIGH, POINTS, potential=barrier)
    system = lv.Schrodinger(grid, absorber=np.cosh(grid.points[:, 0] / 4) / 20)
    psi = packet(grid)
    exact = dense(system, 2.0) @ psi
    errors = [
        np.linalg.norm(
            lv.integrate(system, lv.SplitOperator(scheme), t=(0, 2), steps=n, psi=psi).psi[-1]
            - exact
        )
        for n in (steps, 2 * steps)
    ]
    assert order - 0.4 < np.log2(errors[0] / errors[1]) < order + 1.5


def test_a_resonance_decays_with_its_published_width():
    """The s-wave of 7.5 r^2 exp(-r), as odd states of a line: E = 3.42639, width 0.025549."""
    grid = lv.Grid(-30, 30, 384, potential=lambda t, r, params: 7.5 * r**2 * ca.exp(-ca.fabs(r)))
    system = lv.Schrodinger(
        grid, absorber=lambda t, r, params: 4 * (ca.fmax(ca.fabs(r) - 15, 0) / 15) ** 3
    )
    r = grid.points[:, 0]
    psi = r * np.exp(-1.9 * r**2)
    run = lv.integrate(
        system, lv.SplitOperator(), t=(0, 40), h=0.05, every=40, psi=psi / np.linalg.norm(psi),
        observe={"inside": (np.abs(r) < 5).astype(float)}, states=False,
    )  # fmt: skip
    late = run.t > 25
    width = -np.polyfit(run.t[late], np.log(run.observed["inside"][late]), 1)[0]
    assert abs(width - 0.025549) < 5e-6


def test_a_uniform_absorber_is_a_decay():
    system = lv.Schrodinger(lv.Grid(LOW, HIGH, POINTS), absorber=0.3, hbar=2.0)
    run = lv.integrate(system, lv.SplitOperator(), t=(0, 4), steps=8, psi=packet(system.grid))
    assert np.abs(run.observed["norm"] - np.exp(-0.15 * run.t)).max() < 1e-13
    assert abs(run.stats["absorbed"] - (1 - np.exp(-1.2))) < 1e-13


@pytest.mark.parametrize("absorber", [0.0, np.zeros(POINTS), lambda t, x, params: 0 * x])
def test_nothing_that_absorbs_has_the_bits_of_a_hermitian_equation(absorber):
    grid = lv.Grid(LOW, HIGH, POINTS, potential=barrier)
    options = {"t": (0, 1), "steps": 10, "psi": packet(grid)}
    one = lv.integrate(lv.Schrodinger(grid), lv.SplitOperator(), **options)
    other = lv.integrate(lv.Schrodinger(grid, absorber=absorber), lv.SplitOperator(), **options)
    assert np.array_equal(one.psi, other.psi)
    assert other.stats["absorbed"] == 0
    assert np.array_equal(other.observed["norm"], one.invariants["norm"])


def test_a_potential_that_moves_is_absorbed_by_the_same_flows():
    """Two forms of one H: a table of phases, and a potential with a time that it does not use."""
    still = absorbing()
    moving = absorbing(potential=lambda t, x, params: barrier(t, x, params) + 1e-300 * t)
    assert moving.is_driven
    options = {"t": (0, 2), "steps": 50, "psi": packet(still.grid), "observe": {}}
    one, other = (lv.integrate(s, lv.SplitOperator(), **options) for s in (still, moving))
    assert np.abs(one.psi - other.psi).max() < 1e-14
    assert abs(one.stats["absorbed"] - other.stats["absorbed"]) < 1e-14


def test_members_and_pickles_absorb_alike():
    system = absorbing()
    psi = packet(system.grid)
    options = {"t": (0, 2), "steps": 40}
    many = lv.ensemble(system, lv.SplitOperator(), params={"w": [0.5, 2.0]}, psi=psi, **options)
    for k, w in enumerate([0.5, 2.0]):
        alone = lv.integrate(absorbing(w), lv.SplitOperator(), psi=psi, **options)
        assert np.array_equal(many.psi[:, k], alone.psi)
        assert many.stats["absorbed"][k] == alone.stats["absorbed"]
    some = lv.ensemble(system, lv.SplitOperator(), params={"w": [0.0, 2.0]}, psi=psi, **options)
    assert np.array_equal(some.psi[:, 1], many.psi[:, 1])
    assert np.abs(some.stats["absorbed"] - [0, many.stats["absorbed"][1]]).max() < 1e-12
    assert np.array_equal(some.observed["norm"][:, 1], many.observed["norm"][:, 1])
    starts = lv.ensemble(system, lv.SplitOperator(), psi=[psi, psi.conj()], states=False, **options)
    assert starts.stats["absorbed"].shape == (2,)
    other = lv.integrate(pickle.loads(pickle.dumps(system)), lv.SplitOperator(), psi=psi, **options)
    assert np.array_equal(other.psi, many.psi[:, 1])


def test_what_grows_is_refused():
    grid = lv.Grid(LOW, HIGH, POINTS)
    with pytest.raises(
        ValueError, match=r"absorber must not be negative, where psi grows, as -0.5 at x = -12"
    ):
        lv.Schrodinger(grid, absorber=np.where(grid.points[:, 0] < -11.9, -0.5, 0.0))
    with pytest.raises(ValueError, match="must not depend on time"):
        lv.Schrodinger(grid, absorber=lambda t, x, params: t * x**2)
    with pytest.raises(TypeError, match="the absorber is a function of the position on a Grid"):
        lv.Schrodinger(np.eye(3), absorber=lambda t, x, params: x)
    with pytest.raises(ValueError, match=r"where psi grows, as -1 at component 2"):
        lv.Schrodinger(lv.Lattice(3), absorber=[0, 1, -1])
    lattice = lv.Schrodinger(lv.Lattice(3), absorber=[0, 1, 1])
    with pytest.raises(ValueError, match="psi would grow back in time"):
        lv.integrate(lattice, "auto", t=(1, 0), psi=[1, 0, 0])
    driven = lv.Schrodinger(
        lv.Lattice(3), absorber=[0, 1, 1], drive=[(lambda t, params: t, [1, 2, 3])]
    )
    with pytest.raises(TypeError, match=r"an H\(t\) that absorbs is stepped on a Grid"):
        lv.integrate(driven, "auto", t=(0, 1), psi=[1, 0, 0])
    with pytest.raises(TypeError, match="leave one of them out"):
        lv.Schrodinger(grid, absorber=1.0, nonlinearity=lambda t, rho, params: rho)
    with pytest.raises(ValueError, match=r"must have shape \(64,\)"):
        lv.Schrodinger(grid, absorber=np.ones(3))
    system, psi = absorbing(), packet(grid)
    with pytest.raises(ValueError, match="psi would grow back in time"):
        lv.integrate(system, lv.SplitOperator(), t=(1, 0), steps=10, psi=psi)
    with pytest.raises(ValueError, match="Y4 has flows back in time") as found:
        lv.integrate(system, lv.SplitOperator("Y4"), t=(0, 1), steps=10, psi=psi)
    assert "take one of S2, BM4" in str(found.value)
    with pytest.raises(ValueError, match="too long for an absorber of 2000"):
        lv.integrate(absorbing(2000.0), lv.SplitOperator(), t=(0, 1), steps=10, psi=psi)
    far = lv.integrate(absorbing(2000.0), lv.SplitOperator("S2"), t=(0, 9), steps=90, psi=psi)
    assert 0 < far.stats["absorbed"] < 1


@pytest.mark.parametrize("method", [lv.Chebyshev(), lv.SchrodingerSplitting(1e-6), lv.Magnus()])
def test_methods_that_keep_the_norm_refuse_one(method):
    system = absorbing()
    with pytest.raises(TypeError, match="is for a Hermitian H, and this one has an absorber"):
        lv.integrate(system, method, t=(0, 1), psi=packet(system.grid))
    with pytest.raises(TypeError, match="a ground state is for a Hermitian H"):
        lv.analysis.ground_state(system)
    lattice = lv.Schrodinger(lv.Lattice(3), absorber=[0, 1, 1])
    for of in (lattice, system):
        psi = np.ones(of.size)
        with pytest.raises(TypeError, match=r"(?s)a derivative of a run .* absorber\nhint: leave"):
            lv.vjp(of, "auto", wrt=["psi"], t=(0, 1), psi=psi)


RNG = np.random.default_rng(7)
RING = sp.coo_array((np.exp(0.3j * np.arange(30)), (np.arange(30), (np.arange(30) + 1) % 30)))
FULL = RNG.normal(size=(12, 12)) + 1j * RNG.normal(size=(12, 12))

MATRICES = {
    "chain": lv.Lattice(40),
    "closed plane": lv.Lattice((5, 6), potential=RNG.normal(size=30), periodic=True),
    "phases with a gauge": sp.diags_array([np.full(19, 1j), np.full(19, -1j)], offsets=[1, -1]),
    "flux through a ring": RING + RING.conj().T,
    "dense complex": FULL + FULL.conj().T,
    "spins": lv.SpinSystem(5, ["xx", "yy", "zz"], up=2),
    "by products": (20, lambda x: 2 * x - np.roll(x, 1) - np.roll(x, -1)),
    "one component": [[2.0]],
    "two alike": np.zeros((2, 2)),
    "far energies": 1e4 * np.eye(9) + np.diag(np.ones(8), 1) + np.diag(np.ones(8), -1),
    "grid": lv.Grid(-4, 4, 32, potential=lambda t, x, params: x**2),
}


def whole(given, hbar=1.0):
    """Return the matrix of a Hamiltonian."""
    if isinstance(given, lv.Grid):
        (k,), unit = given.k, np.eye(given.size)
        kinetic = np.fft.ifft((hbar * k[:, None]) ** 2 / 2 * np.fft.fft(unit, axis=0), axis=0)
        return kinetic + np.diag(given.points[:, 0] ** 2)
    if isinstance(given, tuple):
        return np.array([given[1](x) for x in np.eye(given[0])]).T
    if isinstance(given, lv.Lattice):
        given = given.entries().dense()
    if isinstance(given, lv.SpinSystem):
        given = given.matrix()
    return given.toarray() if sp.issparse(given) else np.array(given)


@pytest.mark.parametrize("name", MATRICES)
@pytest.mark.parametrize("tol", [1e-4, 1e-8, 1e-11])
def test_krylov_spaces_are_those_of_the_dense_matrix(name, tol):
    """Within the tolerance, which is a bound; W is of random numbers, some of them zero."""
    if name == "far energies" and tol < 1e-8:
        pytest.skip("out of reach of double precision, and refused")
    plain = lv.Schrodinger(MATRICES[name], hbar=0.5)
    n = plain.size
    w = np.where(np.arange(n) % 3 == 1, 0, np.random.default_rng(n).uniform(0, 2, n))
    system = lv.Schrodinger(MATRICES[name], absorber=w, hbar=0.5)
    rng = np.random.default_rng(1)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    psi /= np.linalg.norm(psi)
    h = whole(MATRICES[name], 0.5)
    times = [0.5, 0.7, 2.0, 6.0]
    for dimension in (3 if tol > 1e-5 else 8, 20):
        run = lv.integrate(system, lv.Lanczos(tol, dimension), t=times, psi=psi)
        for t, found in zip(times, run.psi, strict=True):
            exact = expm(-2j * (t - 0.5) * (h - 1j * np.diag(w))) @ psi
            assert np.linalg.norm(found - exact) <= run.stats["bound"]
    wanted = 1 - np.linalg.norm(exact) ** 2
    assert abs(run.stats["absorbed"] - wanted) <= 2 * tol
    assert run.stats["absorbed"] > 0


def test_a_lattice_that_absorbs_runs_by_auto():
    """A packet that leaves a plane through its rim, beside the dense matrix."""
    shape = (9, 8)
    rim = np.zeros(shape)
    rim[0] = rim[-1] = rim[:, 0] = rim[:, -1] = 0.8
    system = lv.Schrodinger(lv.Lattice(shape), absorber=rim)
    psi = np.zeros(shape)
    psi[4, 4] = 1
    run = lv.integrate(system, "auto", t=np.linspace(-1, 9, 11), psi=psi)
    h = whole(lv.Lattice(shape))
    exact = expm(-10j * (h - 1j * np.diag(rim.ravel()))) @ psi.ravel()
    assert np.linalg.norm(run.psi[-1] - exact) < 1e-8
    assert abs(run.stats["absorbed"] - (1 - np.linalg.norm(exact) ** 2)) < 1e-8
    assert run.stats["absorbed"] > 0.5
    assert (np.diff(run.observed["norm"]) < 0).all()
    plan = lv.plan(system, t=(0, 10))
    assert "Arnoldi" in str(plan)
    again = lv.integrate(pickle.loads(pickle.dumps(system)), "auto", t=run.t, psi=psi)
    assert np.array_equal(again.psi, run.psi)
    many = lv.ensemble(system, lv.Lanczos(), t=run.t, psi=[psi, 1j * psi])
    assert np.array_equal(many.psi[:, 0], run.psi)


def test_an_absorber_of_zero_on_a_lattice_is_none():
    psi = np.eye(30)[7]
    run, plain = (
        lv.integrate(lv.Schrodinger(lv.Lattice(30), **more), "auto", t=(0, 5), psi=psi)
        for more in ({"absorber": np.zeros(30)}, {})
    )
    assert np.array_equal(run.psi, plain.psi)
    assert run.stats["absorbed"] == 0


def test_a_uniform_absorber_on_a_lattice_is_a_decay():
    plain, system = (lv.Schrodinger(lv.Lattice(30), **more) for more in ({}, {"absorber": 0.3}))
    run = lv.integrate(system, "auto", t=(0, 20), psi=np.eye(30)[7])
    free = lv.integrate(plain, lv.Lanczos(1e-12), t=(0, 20), psi=np.eye(30)[7])
    assert np.linalg.norm(run.psi[-1] - np.exp(-6) * free.psi[-1]) < 1e-9
    still = lv.Schrodinger(np.zeros((3, 3)), absorber=[0, 1e6, 1.0])
    left = lv.integrate(still, "auto", t=(0, 3), psi=[1, 1, 1]).psi[-1]
    assert np.abs(left - [1, 0, np.exp(-3)]).max() < 1e-8


def test_the_flux_through_two_points_is_what_leaves_between_them():
    grid = lv.Grid(LOW, HIGH, 256, potential=barrier)
    system, psi = lv.Schrodinger(grid, absorber=ramp, params={"w": 2.0}), packet(grid)
    (k,), x, steps = grid.k, grid.points[:, 0], 2000
    run = lv.integrate(
        system, lv.SplitOperator(), t=(0, 5), steps=steps, psi=psi,
        observe={"right": grid.flux(6.0), "left": grid.flux(-6.0)},
    )  # fmt: skip
    exact, at = dense(system, 5.0) @ psi, int(np.argmin(np.abs(x - 6)))
    slope = np.fft.ifft(1j * k * (k > k.min()) * np.fft.fft(exact))[at]
    wanted = (exact[at].conj() * slope).imag / grid.cell
    assert x[at] == 6.0
    assert abs(run.observed["right"][-1] - wanted) < 1e-7
    out = scipy.integrate.simpson(run.observed["right"] - run.observed["left"], x=run.t)
    left = between(run.psi[[0, -1]], k)
    assert out == pytest.approx(left[0] - left[1], abs=1e-6)


def between(psi, k, end=6.0):
    """Return the integrals of |psi|^2 from -end to end, exact for what the grid has of it."""
    n, length = 4 * k.size, HIGH - LOW
    x = LOW + length / n * np.arange(n)
    waves = np.exp(1j * np.outer(x - LOW, k)) / k.size
    density = np.abs(np.fft.fft(psi) @ waves.T) ** 2 * k.size / length
    modes = 2 * np.pi / length * np.fft.fftfreq(n, 1 / n)
    each = np.fft.fft(density) / n * np.exp(-1j * modes * LOW)
    return (each @ (2 * end * np.sinc(modes * end / np.pi))).real


def test_the_flux_of_a_plane_wave_is_its_velocity_over_the_volume():
    grid = lv.Grid((0, 0), (2, 3), (8, 10), mass=(2.0, 1.0))
    waves = [np.exp(2j * np.pi * grid.points[:, axis] / (2, 3)[axis]) for axis in (0, 1)]
    for axis, (length, speed) in enumerate(((2, np.pi / 2), (3, 2 * np.pi / 3))):
        size, flux = grid.flux(0.7, axis=axis)
        psi = waves[axis] / size**0.5
        assert np.vdot(psi, flux(psi)) == pytest.approx(speed / length, abs=1e-13)
    with pytest.raises(ValueError, match="place must be on axis 1, from 0 to 3, not 4"):
        grid.flux(4, axis=1)
    with pytest.raises(
        ValueError, match="axis must be one of the grid, which has axes 0 to 1, not 2"
    ):
        grid.flux(1.0, axis=2)


def test_a_stored_run_says_what_was_absorbed_after_an_interruption_too(tmp_path):
    system = lv.Schrodinger(lv.Grid(LOW, HIGH, POINTS), absorber=0.3)
    options = {"t": (0, 2), "steps": 40, "every": 2, "psi": packet(system.grid)}

    def progress(done, total):
        if done > 20:
            raise KeyboardInterrupt

    path = tmp_path / "run.zarr"
    first = lv.integrate(
        system, lv.SplitOperator(), store=lv.Store(path, 4), progress=progress, **options
    )
    assert first.status == "interrupted"
    part, left = first.stats["absorbed"], lv.load(path).observed["norm"]
    assert abs(part - (1 - (left[-1] / left[0]) ** 2)) < 1e-13
    whole = lv.resume(path)
    assert abs(whole.stats["absorbed"] - (1 - np.exp(-1.2))) < 1e-13
    assert part < lv.load(path).stats["absorbed"] == whole.stats["absorbed"]


@pytest.mark.parametrize("method", ["auto", lv.Lanczos(), lv.Magnus(), lv.Chebyshev()])
def test_a_lattice_that_absorbs_and_is_driven_is_refused_with_what_takes_it(method):
    system = lv.Schrodinger(
        lv.Lattice(8), absorber=np.ones(8), drive=[(lambda t, params: t, np.arange(8.0))]
    )
    with pytest.raises(TypeError, match="absorbs is stepped on a Grid alone, with diagonal drives"):
        lv.integrate(system, method, t=(0, 1), psi=np.eye(8)[0])
