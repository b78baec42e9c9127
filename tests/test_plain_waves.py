"""Plain waves by every method: one level, no energies, eigenstates, drives that do nothing."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pytest
import scipy.linalg

import liouville as lv

FLIP = np.eye(2)[::-1]
ONE = np.ones((1, 1))
TOL = 1e-6


class Plain(NamedTuple):
    """A Hamiltonian, a start, and the integral of H from 0 to t, whose parts commute in time."""

    make: Callable[[], Any]
    psi: Any
    integral: Callable[[float], Any]


def matrix(h, psi, **more):
    return Plain(lambda: lv.Schrodinger(h, **more), psi, lambda t: t * np.asarray(h))


def driven(h, f, drive, psi, integral):
    return Plain(lambda: lv.Schrodinger(h, drive=[(f, drive)]), psi, integral)


def flat(n, value, potential=None):
    """Return a constant wave on a grid, an eigenstate of a constant potential."""
    return Plain(
        lambda: lv.Schrodinger(lv.Grid(0, 1, n, potential=potential)),
        np.full(n, n**-0.5),
        lambda t: t * value * np.eye(n),
    )


ZERO = np.zeros((2, 2))
MODELS = {
    "one level of energy 0": matrix(0 * ONE, [1.0]),
    "one level of energy 1": matrix(ONE, [1.0]),
    "two levels of energy 0": matrix(ZERO, [1.0, 0.0]),
    "identity": matrix(np.eye(3), [1.0, 0.0, 0.0]),
    "degenerate": matrix(np.diag([1.0, 1.0, 2.0]), [0.0, 0.6, 0.8]),
    "eigenstate": matrix(FLIP, [0.5**0.5, 0.5**0.5]),
    "two levels": matrix(FLIP, [1.0, 0.0]),
    "complex zero": matrix(ZERO + 0j, [1.0, 0.0]),
    "complex": matrix(np.array([[0, 1j], [-1j, 0]]), [1.0, 0.0]),
    "function that is zero": Plain(
        lambda: lv.Schrodinger((3, lambda x: 0 * x)), [1.0, 0, 0], lambda t: np.zeros((3, 3))
    ),
    "lattice of one site": Plain(
        lambda: lv.Schrodinger(lv.Lattice(1)), [1.0], lambda t: np.zeros((1, 1))
    ),
    "spins without a bond": Plain(
        lambda: lv.Schrodinger(lv.SpinSystem(2, [("zz", 0.0)])),
        np.eye(4)[0],
        lambda t: 0 * np.eye(4),
    ),
    "no bosons": Plain(
        lambda: lv.Schrodinger(lv.BosonSystem(1, [("n", 1.0)], particles=0)),
        [1.0],
        lambda t: 0 * ONE,
    ),
    "free grid": flat(16, 0.0),
    "grid of two points": flat(2, 0.0),
    "grid with a constant potential": flat(8, 2.0, lambda t, x, p: 2.0),
    "grid with a potential that jumps": flat(8, 0.0, lambda t, x, p: 0 * x[0] * (t > 0.5)),
    "drive of 0": driven(
        np.diag([1.0, 2]), lambda t, p: 0.0, FLIP, [1.0, 0], lambda t: t * np.diag([1.0, 2])
    ),
    "drive of 1": driven(
        np.diag([1.0, 2]),
        lambda t, p: 1.0,
        FLIP,
        [1.0, 0],
        lambda t: t * (np.diag([1.0, 2]) + FLIP),
    ),
    "drive by a matrix of 0": driven(
        np.diag([1.0, 2]), lambda t, p: ca.cos(t), ZERO, [1.0, 0], lambda t: t * np.diag([1.0, 2])
    ),
    "drive alone": driven(ZERO, lambda t, p: ca.cos(t), FLIP, [1.0, 0], lambda t: np.sin(t) * FLIP),
}
#: Waves on a grid that are not linear, or that are absorbed: the rate of what is left.
OTHER = {
    "nonlinearity of 0": ({"nonlinearity": lambda t, rho, p: 0 * rho}, 0.0, 0.0),
    "nonlinearity of 2": ({"nonlinearity": lambda t, rho, p: 2.0}, 2.0, 0.0),
    "absorber of 0": ({"absorber": np.zeros(8)}, 0.0, 0.0),
    "absorber of 1": ({"absorber": np.ones(8, dtype=int)}, 0.0, 1.0),
}
METHODS = {
    "auto": "auto",
    "series": lv.Chebyshev(TOL),
    "splitting": lv.SchrodingerSplitting(TOL),
    "Lanczos": lv.Lanczos(TOL),
    "Magnus": lv.Magnus(4, tol=TOL),
    "split operator": lv.SplitOperator(tol=TOL),
}


def serves(method, name):
    if method == "split operator":
        return "grid" in name
    return method != "Lanczos" or not name.startswith(("drive", "grid with a potential that"))


@pytest.mark.parametrize("name", MODELS)
def test_plain_waves_run_by_every_method_and_have_nothing_to_say(name):
    make, psi, integral = MODELS[name]
    equation, psi = make(), np.asarray(psi)

    def end(t0, t1):
        return scipy.linalg.expm(-1j * (integral(t1) - integral(t0))) @ psi

    for label, method in METHODS.items():
        if not serves(label, name):
            continue
        for times in ((0, 1), (1, 0), (0, 100), (1e3, 1e3 + 1), [0.0, 0.5, 1.0]):
            found = lv.integrate(equation, method, t=times, psi=psi)
            assert not found.message, (label, times)
            np.testing.assert_allclose(
                found.psi[-1],
                end(times[0], times[-1]),
                rtol=0,
                atol=TOL,
                err_msg=f"{label} {times}",
            )


@pytest.mark.parametrize("name", OTHER)
def test_waves_that_one_method_takes_run_by_auto(name):
    more, energy, rate = OTHER[name]
    equation = lv.Schrodinger(lv.Grid(0, 1, 8), **more)
    psi = np.full(8, 8**-0.5)
    for method in ("auto", lv.SplitOperator(tol=TOL)):
        found = lv.integrate(equation, method, t=(0, 2), psi=psi)
        assert not found.message
        np.testing.assert_allclose(
            found.psi[-1], psi * np.exp(-2 * (1j * energy + rate)), rtol=0, atol=TOL
        )


DISORDER = np.random.default_rng(1).uniform(-2, 2, (5, 24))


CHAIN = lv.Schrodinger(lv.Lattice(24))


def hops(n, is_closed=False):
    """Return the H of a chain of n sites, open or closed."""
    h = -np.eye(n, k=1) - np.eye(n, k=-1)
    return h - is_closed * (np.eye(n, k=n - 1) + np.eye(n, k=1 - n))


def kinetic(grid):
    """Return the kinetic energy on a grid of one axis."""
    waves = np.fft.fft(np.eye(grid.size), norm="ortho")
    return waves.conj().T @ np.diag(grid.k[0] ** 2 / 2) @ waves


@pytest.mark.parametrize(
    ("source", "h"),
    [
        (lv.Lattice(24), hops(24)),
        (
            lv.Lattice((4, 6), periodic=(False, True)),
            np.kron(hops(4), np.eye(6)) + np.kron(np.eye(4), hops(6, is_closed=True)),
        ),
        (lv.Grid(0, 12, 24), kinetic(lv.Grid(0, 12, 24))),
    ],
)
def test_members_with_potentials_of_their_own_have_the_bits_of_runs_alone(source, h):
    psi = np.exp(-((np.arange(24) - 12) ** 2) / 4 + 0.5j * np.arange(24))
    psi /= np.linalg.norm(psi)
    clean, times = lv.Schrodinger(source), (0.0, 1.0, 3.0)
    run = lv.ensemble(clean, "auto", t=times, psi=psi, potential=DISORDER)
    for k, potential in enumerate(DISORDER):
        own = lv.Schrodinger(source.with_potential(potential))
        assert np.array_equal(lv.integrate(own, "auto", t=times, psi=psi).psi, run.psi[:, k])
        alone = lv.integrate(clean, "auto", t=times, psi=psi, potential=potential)
        assert np.array_equal(alone.psi, run.psi[:, k])
        for t, found in zip(times, run.psi[:, k], strict=True):
            wanted = scipy.linalg.expm(-1j * t * (h + np.diag(potential))) @ psi
            assert np.linalg.norm(found - wanted) <= 1e-8


@pytest.mark.parametrize(
    ("potential", "kind", "words"),
    [
        (
            DISORDER[0],
            ValueError,
            r"potential must have shape \(P, 24\) for P members, not \(24,\)",
        ),
        (DISORDER[:, 1:], ValueError, r"must have shape \(P, 24\) for P members, not \(5, 23\)"),
        (DISORDER[:0], ValueError, "potential has no members along its first axis"),
        (
            DISORDER * [[1], [1], [np.nan], [1], [1]],
            ValueError,
            r"member 2: potential\[0\] must be",
        ),
        (1j * DISORDER, TypeError, "potential must be real numbers, not complex ones"),
    ],
)
def test_potentials_of_members_that_do_not_fit_are_refused(potential, kind, words):
    with pytest.raises(kind, match=words):
        lv.ensemble(CHAIN, "auto", t=(0, 1), psi=np.eye(24)[0], potential=potential)


def test_a_potential_of_its_own_is_for_grids_and_lattices():
    with pytest.raises(TypeError, match="potential= is that of a Grid or a Lattice, not of"):
        lv.integrate(lv.Schrodinger(np.eye(2)), "auto", t=(0, 1), psi=[1, 0], potential=[1, 2])
    with pytest.raises(ValueError, match="potential must have 3 members as psi has, not 5"):
        lv.ensemble(CHAIN, "auto", t=(0, 1), psi=np.eye(24)[:3], potential=DISORDER)
    with pytest.raises(ValueError, match=r"potential must have shape \(24,\), not \(5, 24\)"):
        lv.integrate(CHAIN, "auto", t=(0, 1), psi=np.eye(24)[0], potential=DISORDER)


def test_workers_take_members_that_share_a_state_in_the_shape_of_the_lattice():
    clean, psi = lv.Schrodinger(lv.Lattice((4, 6))), np.eye(24)[9].reshape(4, 6)
    potential = DISORDER.reshape(5, 4, 6)
    run = lv.ensemble(clean, "auto", t=(0, 1), psi=psi, potential=potential)
    with ThreadPoolExecutor(2) as executor:
        other = lv.ensemble(
            clean, "auto", t=(0, 1), psi=psi, potential=potential, executor=executor, chunk=2
        )
    assert np.array_equal(run.psi, other.psi)


def test_psi_has_the_shape_of_its_grid_as_a_view(tmp_path):
    start = np.zeros((4, 5), dtype=complex)
    start[1, 2], start[3, 0] = 1, 1j
    for source in (lv.Lattice((4, 5)), lv.Grid((0, 0), (4, 5), (4, 5))):
        system = lv.Schrodinger(source)
        run = lv.integrate(system, "auto", t=(0, 1, 2), psi=start)
        assert run.psi_on_grid.shape == (3, 4, 5)
        assert np.array_equal(run.psi_on_grid[0], start)
        assert np.shares_memory(run.psi_on_grid, run.psi)
        many = lv.ensemble(system, "auto", t=(0, 1), psi=[start, 1j * start])
        assert many.psi_on_grid.shape == (2, 2, 4, 5)
        assert np.array_equal(many.psi_on_grid[0, 1], 1j * start)
    line = lv.integrate(lv.Schrodinger([[1.0]]), "auto", t=(0, 1), psi=[1])
    assert line.psi_on_grid.shape == line.psi.shape == (2, 1)
    run.save(tmp_path / "run.npz")
    with pytest.raises(ValueError, match=r"loaded has no grid\nhint: write solution.psi.reshape"):
        lv.load(tmp_path / "run.npz").psi_on_grid  # noqa: B018
    field = lv.PolynomialField(lambda t, x, p: [x[1], -x[0]], x=2)
    with pytest.raises(AttributeError):
        lv.integrate(field, t=(0, 1), h=0.1, x=[1, 0]).psi_on_grid  # noqa: B018
