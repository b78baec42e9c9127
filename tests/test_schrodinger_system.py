"""Hamiltonians cross to the core as they are, bounds hold, and others are refused.

One file, since chains, lattices, grids and matrices are all held against matrices written out.
"""

import pickle
import warnings
from functools import partial

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from properties import examples
from scipy.sparse.linalg import LinearOperator, aslinearoperator

import liouville as lv
from liouville._systems.waves import forms, graph
from liouville._systems.waves.entries import Entries

SEEDS = st.integers(0, 2**32 - 1)


def symmetric(rng, n, density=1.0, is_complex=False):
    """Return a random Hermitian array."""
    a = rng.normal(size=(n, n)) * (rng.random((n, n)) < density)
    if is_complex:
        a = a + 1j * rng.normal(size=(n, n)) * (rng.random((n, n)) < density)
    return a + a.conj().T


def multiplied(system, psi):
    """Return H psi / hbar as the core makes it, in the user's components."""
    inside = system.inward(psi)
    return system.outward(applied(system.hamiltonian, inside))


def applied(operator, psi):
    """Return a product of the core with a complex vector, the operator perhaps a doubled one."""
    if operator.size > psi.size:
        parts = np.split(operator.multiply(np.concatenate([psi.real, psi.imag])), 2)
    else:
        parts = [operator.multiply(np.ascontiguousarray(x)) for x in (psi.real, psi.imag)]
    return parts[0] + 1j * parts[1]


def agrees(system, matrix, rng):
    """Say whether the core multiplies as the matrix does, within bounds that hold."""
    n = len(matrix)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    wanted = matrix @ psi
    energies = np.linalg.eigvalsh(matrix)
    low, high = system.bounds
    assert low <= energies[0]
    assert energies[-1] <= high
    return np.allclose(multiplied(system, psi), wanted, rtol=0, atol=1e-13 * n * abs(wanted).max())


def chain_by_hand(chain):
    """Build a chain of spins from products of Pauli matrices, all states."""
    down = np.array([[0.0, 0.0], [1.0, 0.0]])  # |down><up|, up first
    z = np.diag([0.5, -0.5])

    def at(i, matrix):
        # bit i is the i-th from the right
        parts = [matrix if k == i else np.eye(2) for k in reversed(range(chain.length))]
        found = np.eye(1)
        for part in parts:
            found = np.kron(found, part)
        return found

    h = sum(field * at(i, z) for i, field in enumerate(chain.field))
    for (i, j), xy, zz in zip(chain.bonds, chain.xy, chain.z, strict=True):
        hop = at(i, down) @ at(j, down.T)
        h = h + xy / 2 * (hop + hop.T) + zz * at(i, z) @ at(j, z)
    return h


@examples(25)
@given(SEEDS, st.integers(1, 40), st.sampled_from([0.02, 0.3, 1.0]), st.booleans())
def test_a_matrix_of_any_form_multiplies_as_it_does_in_numpy(seed, n, density, is_complex):
    rng = np.random.default_rng(seed)
    matrix = symmetric(rng, n, density, is_complex)
    assert agrees(lv.Schrodinger(matrix), matrix, rng)
    assert agrees(lv.Schrodinger(sp.coo_array(matrix)), matrix, rng)


@examples(6)
@given(SEEDS, st.integers(260, 280))
def test_bounds_of_gershgorin_hold_where_eigenvalues_are_not_computed(seed, n):
    rng = np.random.default_rng(seed)
    matrix = symmetric(rng, n, 0.02, is_complex=bool(seed % 2))
    assert agrees(lv.Schrodinger(sp.csr_array(matrix)), matrix, rng)


@pytest.mark.parametrize(("scattered", "terms"), [(0, 1), (2, 1), (24, 2)])
def test_diagonals_are_seen_and_what_is_scattered_goes_by_rows(scattered, terms):
    rng, n = np.random.default_rng(0), 60
    matrix = np.diag(rng.normal(size=n)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
    for k in range(scattered):
        matrix[0, 5 + 2 * k] = matrix[5 + 2 * k, 0] = 1.0
    assert len(forms.operators(Entries.read("H", matrix))) == terms
    assert agrees(lv.Schrodinger(matrix), matrix, rng)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("up", [None, 0, 2, 5])
def test_a_chain_of_spins_is_what_its_formula_says(up, periodic):
    rng, n = np.random.default_rng(1), 5
    bonds = n if periodic else n - 1
    chain = lv.SpinChain(
        n, rng.normal(size=bonds), rng.normal(size=bonds), rng.normal(size=n), periodic, up
    )
    whole = chain_by_hand(chain)
    inside = whole[np.ix_(chain.basis, chain.basis)]
    assert abs(chain.entries().dense() - inside).max() < 1e-14
    assert agrees(lv.Schrodinger(chain), inside, rng)
    outside = np.setdiff1d(np.arange(2**n), chain.basis)
    assert not whole[np.ix_(outside, chain.basis)].any()  # the sector is closed


@pytest.mark.parametrize("periodic", [False, True])
def test_blocks_of_bonds_bound_a_long_chain_of_spins(periodic):
    rng, n = np.random.default_rng(2), 12
    chain = lv.SpinChain(n, 1.0, 0.7, rng.normal(size=n), periodic, up=6)
    energies = np.linalg.eigvalsh(chain.entries().dense())
    low, high = lv.Schrodinger(chain).bounds
    assert low <= energies[0]
    assert energies[-1] <= high
    assert high - low < 1.3 * np.ptp(energies)


@pytest.mark.parametrize("periodic", [False, True, (True, False, True)])
def test_a_lattice_hops_to_its_neighbours(periodic):
    rng, shape = np.random.default_rng(3), (5, 3, 4)
    hopping, potential = (1.0, 0.5, -0.25), rng.normal(size=shape)
    lattice = lv.Lattice(shape, hopping, potential, periodic)
    sites = np.arange(60).reshape(shape)
    matrix = np.diag(potential.ravel())
    for axis in range(3):
        for step in (1, -1):
            to = np.roll(sites, step, axis)
            keep = np.ones(shape, dtype=bool)
            if not lattice.periodic[axis]:
                np.moveaxis(keep, axis, 0)[0 if step == 1 else -1] = False
            matrix[sites[keep], to[keep]] -= hopping[axis]
    assert abs(lattice.entries().dense() - matrix).max() < 1e-15
    assert agrees(lv.Schrodinger(lattice), matrix, rng)


def test_a_closed_lattice_is_folded_so_that_neighbours_are_near():
    lattice = lv.Lattice((100, 7), periodic=True)
    order = lattice.order()
    assert lattice.entries().reach == 99 * 7
    assert lattice.entries().moved(order).reach == 2 * 7
    psi = np.arange(700) + 1.0
    system = lv.Schrodinger(lattice)
    assert np.array_equal(system.outward(system.inward(psi)), psi)


def test_a_scrambled_lattice_is_put_in_order(monkeypatch):
    rng = np.random.default_rng(4)
    monkeypatch.setattr(graph, "LARGE", 100)
    matrix = lv.Lattice((200, 2)).entries().dense()
    scramble = rng.permutation(400)
    matrix = matrix[np.ix_(scramble, scramble)]
    system = lv.Schrodinger(sp.csr_array(matrix))
    assert system.frame.order is not None
    assert system.frame.entries(Entries.read("H", matrix)).reach < 10
    assert agrees(system, matrix, rng)


@examples(25)
@given(SEEDS, st.integers(2, 60), st.floats(0.0, 0.2))
def test_phases_that_a_gauge_made_are_taken_away(seed, n, density):
    rng = np.random.default_rng(seed)
    phases = np.exp(2j * np.pi * rng.random(n))
    matrix = phases.conj()[:, None] * symmetric(rng, n, density) * phases
    system = lv.Schrodinger(sp.csr_array(matrix))
    assert system.is_real
    assert agrees(system, matrix, rng)


def test_a_zero_that_is_stored_has_no_phase():
    row, col = np.array([[0, 1, 1, 2], [1, 0, 2, 1]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert lv.Schrodinger(sp.coo_array(([1j, -1j, 0, 0], (row, col)), shape=(3, 3))).is_real


@pytest.mark.parametrize(("flux", "is_real"), [(0.0, True), (np.pi, True), (0.3, False)])
def test_a_ring_is_real_if_the_flux_through_it_is_zero_or_pi(flux, is_real):
    rng, n = np.random.default_rng(5), 7
    matrix = np.zeros((n, n), dtype=complex)
    for i in range(n):
        matrix[i, (i + 1) % n] = -np.exp(1j * flux / n)
    matrix += matrix.conj().T
    system = lv.Schrodinger(matrix)
    assert system.is_real == is_real
    assert system.hamiltonian.size == (n if is_real else 2 * n)
    assert agrees(system, matrix, rng)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    assert np.allclose(system.outward(system.inward(psi)), psi, atol=1e-15)
    assert np.isclose(np.linalg.norm(system.inward(psi)), np.linalg.norm(psi), rtol=1e-14)


def values_of(system, observe, psi):
    """Evaluate observables as the core does, one after another."""
    inside, found = system.inward(psi), {}
    for name, width, [(kind, *rest)] in system.observables(observe):
        q, p = inside.real.copy(), inside.imag.copy()
        if kind == "diagonal":
            found[name] = (rest[0] * (q**2 + p**2)).sum()
        elif kind == "symmetric":
            found[name] = (inside.conj() @ applied(rest[0], inside)).real
        else:
            found[name] = (rest[0] - 1j * rest[1]) @ inside
        assert width == (2 if kind == "overlap" else 1)
    return found


@pytest.mark.parametrize("which", ["plain", "folded", "gauge", "doubled"])
def test_observables_are_those_of_the_states_that_the_user_sees(which):
    rng, n = np.random.default_rng(6), 12
    matrix = lv.Lattice(n, periodic=which != "plain").entries().dense().astype(complex)
    phases = np.exp(2j * np.pi * rng.random(n)) if which == "gauge" else np.ones(n)
    matrix = phases.conj()[:, None] * matrix * phases
    if which == "doubled":
        matrix[0, 1], matrix[1, 0] = 1j, -1j
    folded = lv.Lattice(n, periodic=True)
    system = lv.Schrodinger(folded if which == "folded" else matrix)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    phi = rng.normal(size=n) + 1j * rng.normal(size=n)
    diagonal = rng.normal(size=n)
    twisted = symmetric(rng, n, is_complex=True)
    found = values_of(
        system,
        {
            "x": diagonal,
            "H": matrix,
            "sparse": sp.csr_array(matrix),
            "phi": phi,
            "twisted": twisted,
        },
        psi,
    )
    energy = (psi.conj() @ matrix @ psi).real
    assert np.isclose(found["x"], (diagonal * abs(psi) ** 2).sum(), rtol=1e-12)
    assert np.isclose(found["H"], energy, rtol=1e-12)
    assert np.isclose(found["sparse"], energy, rtol=1e-12)
    assert np.isclose(found["twisted"], (psi.conj() @ twisted @ psi).real, rtol=1e-12)
    assert np.isclose(found["phi"], phi.conj() @ psi, rtol=1e-12)


def test_a_grid_differentiates_what_it_can_hold_exactly():
    grid = lv.Grid((0.0, 0.0), (2 * np.pi, np.pi), (12, 8), mass=(2.0, 0.5))
    x, y = grid.points.T
    psi = np.exp(1j * (3 * x - 4 * y))
    assert np.allclose(multiplied(lv.Schrodinger(grid, hbar=0.5), psi), 0.5 * (9 / 4 + 16) * psi)
    with_potential = lv.Grid(
        (0.0, 0.0), (2 * np.pi, np.pi), (12, 8), lambda t, x, params: params.a * x[0] * x[1], 2.0
    )
    system = lv.Schrodinger(with_potential, params={"a": 3.0})
    assert np.allclose(multiplied(system, psi), (9 + 16) / 4 * psi + 3 * x * y * psi)
    assert system.bounds == (0.0, pytest.approx((36 + 64) / 4 + (3 * x * y).max()))
    again = system.with_params({"a": 1.0})
    assert np.allclose(multiplied(again, psi), (9 + 16) / 4 * psi + x * y * psi)
    assert system.inward(psi.reshape(12, 8)).shape == (96,)


def test_what_depends_on_time_has_bounds_at_each_time():
    grid = lv.Grid(-4.0, 4.0, 32, lambda t, x, params: params.a * t * x)
    system = lv.Schrodinger(grid, params={"a": 2.0})
    top = system.bounds_at(0.0)[1]
    assert system.is_driven
    assert system.bounds_at(1.5) == (pytest.approx(-12.0), pytest.approx(top + 3 * 3.75))
    matrix, term = np.diag([1.0, 2.0]), np.diag([1.0, -1.0])
    driven = lv.Schrodinger(matrix, drive=[(lambda t, params: -t, term)])
    assert np.allclose(driven.term_bounds, [(1.0, 2.0), (-1.0, 1.0)], rtol=0, atol=1e-12)
    assert driven.bounds_at(2.0) == pytest.approx((-1.0, 4.0), abs=1e-12)


def test_products_and_linear_operators_are_taken():
    rng, n = np.random.default_rng(7), 50
    matrix = symmetric(rng, n, 0.2)
    for product in (aslinearoperator(matrix), (n, lambda x: matrix @ x)):
        system = lv.Schrodinger(product, hbar=2.0)
        assert agrees(system, matrix / 2, rng)


def entry(i, j, value):
    matrix = np.eye(4, dtype=type(value))
    matrix[i, j] = value
    return matrix


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (entry(1, 2, 0.5), r"not Hermitian: H\[1, 2\] = 0.5, but H\[2, 1\] = 0, where"),
        (sp.csr_array(entry(3, 0, 0.5)), r"H\[0, 3\] = 0, but H\[3, 0\] = 0.5, where"),
        (entry(1, 2, 0.5j), r"H\[1, 2\] = 0\+0.5j, but H\[2, 1\] = 0\+0j, where"),
        (
            entry(1, 1, 1 - 0.5j),
            r"H\[1, 1\] = 1-0.5j is not real, .* largest: 1, .*\nhint: .*absorber=",
        ),
        (entry(2, 1, np.nan), r"H\[2, 1\] must be finite, not nan"),
        (sp.csr_array(entry(2, 1, np.inf)), r"H\[2, 1\] must be finite, not inf"),
        (np.ones((2, 3)), r"H must have shape \(N, N\), not \(2, 3\)"),
        (np.ones((2, 2, 2)), r"H must have shape \(N, N\), not \(2, 2, 2\)"),
        ((3, lambda x: x[:2]), r"vector that H returns must have shape \(3,\), not \(2,\)"),
        ((3, lambda x: x / 0), "H returns inf in place 0"),
        ((4, lambda x: entry(1, 2, 0.5) @ x), r"H is not Hermitian: x \. H y and y \. H x differ"),
        ((3, lambda x: 1j * x), r"H is not Hermitian: x \. H y and y \. H x differ"),
        (
            LinearOperator((2, 3), matvec=lambda x: x[:2], dtype=float),
            r"H must have shape \(N, N\), not \(2, 3\)",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_what_is_no_hamiltonian_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        lv.Schrodinger(given)


def test_a_matrix_of_single_precision_is_hermitian_to_its_own_digits():
    rng = np.random.default_rng(0)
    q = np.linalg.qr(rng.normal(size=(50, 50)))[0].astype(np.float32)
    h = q @ np.diag(np.arange(50, dtype=np.float32)) @ q.T
    assert (h != h.T).any()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = lv.integrate(
            lv.Schrodinger(h), "auto", t=(0, 1), psi=np.eye(50, dtype=np.complex64)[0],
            observe={"h": h, "place": np.arange(50, dtype=np.float32)},
        )  # fmt: skip
    mean = (h.astype(float) + h.astype(float).T) / 2
    energies, vectors = np.linalg.eigh(mean)
    exact = vectors @ (np.exp(-1j * energies) * vectors[0])
    assert found.psi.dtype == complex
    assert abs(found.psi[-1] - exact).max() < 1e-8
    assert found.observed["h"].dtype == float
    h[3, 4] += 1e-4 * abs(h).max()
    with pytest.raises(ValueError, match=r"H is not Hermitian: H\[3, 4\]"):
        lv.Schrodinger(h)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("H", "H must be an array of numbers, not .H."),
        (lambda x: x, r"H\(0\) must be an operator, not float\nhint: .* \(N, function of psi\)"),
        (lambda x, y, z: x, "function of unknown size"),
        ((3, lambda x: None), "H must return numbers for a vector, not NoneType"),
    ],
)
def test_what_is_of_the_wrong_kind_is_refused(given, message):
    with pytest.raises(TypeError, match=message):
        lv.Schrodinger(given)


def test_roundoff_of_a_symmetric_matrix_is_taken_away():
    rng = np.random.default_rng(8)
    matrix = symmetric(rng, 6)
    matrix[0, 1] *= 1 + 4e-16
    entries = Entries.read("H", matrix)
    assert np.array_equal(entries.dense(), entries.dense().T)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"hbar": 0.0}, "hbar must be positive"),
        ({"bounds": (1.0, -1.0)}, r"bounds must be \(least, largest\) energy, not \(1, -1\)"),
        ({"drive": [(lambda t, params: t, np.eye(2))]}, "H1 must have order 3 as H has, not 2"),
        ({"drive": [(lambda t, params: t, entry(0, 1, 0.5)[:3, :3])]}, r"H1\[0, 1\] = 0.5, but H1"),
    ],
)
def test_other_arguments_are_checked(keywords, message):
    with pytest.raises(ValueError, match=message):
        lv.Schrodinger(np.diag([1.0, 2.0, 3.0]), **keywords)


def test_bounds_that_leave_out_an_energy_are_refused_with_both_numbers():
    matrix = lv.Lattice(40).entries().dense()
    assert lv.Schrodinger(matrix, bounds=(-2.0, 2.0), hbar=0.5).bounds == (-4.0, 4.0)
    with pytest.raises(ValueError, match=r"no energy is above 1.5, but there is one.* 1.9"):
        _ = lv.Schrodinger(matrix, bounds=(-2.0, 1.5), hbar=0.5).bounds
    with pytest.raises(ValueError, match=r"no energy is below -1.5, but there is one.* -1.9"):
        _ = lv.Schrodinger(matrix, bounds=(-1.5, 2.0)).bounds


@pytest.mark.parametrize(
    ("psi", "message"),
    [
        (np.ones(3), r"psi must have shape \(4,\), not \(3,\)"),
        (np.ones((2, 4)), r"\nhint: lv.ensemble takes many"),
        (np.zeros(4), "psi is zero"),
        ([1.0, np.nan, 0.0, 0.0], r"psi\[1\] must be finite, not nan"),
    ],
)
def test_what_is_no_state_is_refused(psi, message):
    with pytest.raises(ValueError, match=message):
        lv.Schrodinger(np.eye(4)).inward(psi)


@pytest.mark.parametrize(
    ("observe", "error", "message"),
    [
        ({"a": np.ones(3)}, ValueError, r"observable 'a' must have shape \(4,\) or .*, not \(3,\)"),
        (
            {"a": (4, lambda x: entry(0, 1, 2.0) @ x)},
            ValueError,
            r"observable 'a' is not Hermitian: x \. .*\nhint: give it as a matrix",
        ),
        ({"a": [1, np.inf, 1, 1]}, ValueError, "observable 'a' must be finite, not inf in place 1"),
        ({"a": "x"}, TypeError, "observable 'a' must be an array of numbers"),
        (
            {"a": lambda t, x, params: x},
            TypeError,
            "observable 'a' is a function, and there is no grid",
        ),
        ({"a": sp.csr_array([[0, 1j], [-1j, 0]])}, ValueError, "observable 'a' must have order 4"),
    ],
)
def test_what_cannot_be_observed_is_refused(observe, error, message):
    with pytest.raises(error, match=message):
        lv.Schrodinger(np.eye(4)).observables(observe)


def test_what_is_recorded_of_every_run_is_no_name_of_an_observable():
    shaken = lv.Schrodinger(np.eye(4), drive=[(lambda t, params: ca.cos(t), np.ones((4, 4)))])
    for name in ("energy", "autocorrelation"):
        with pytest.raises(ValueError, match=f"'{name}' is recorded of every run"):
            lv.integrate(shaken, "auto", t=(0, 1), psi=np.ones(4), observe={name: np.ones(4)})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: lv.Lattice((4, 2), periodic=True), "axis 1 is periodic and must have 3 sites"),
        (
            lambda: lv.Lattice((4, 2), potential=np.ones(7)),
            r"potential must have shape .*, not \(7,\)",
        ),
        (lambda: lv.Lattice(3, potential=[0, np.nan, 0]), r"potential\[1\] must be finite"),
        (
            lambda: lv.Lattice((3, 3), hopping=(1, 2, 3)),
            "hopping must be one number, or one for each of 2 axes, not 3",
        ),
        (lambda: lv.SpinChain(1), "length must be 2 or more"),
        (lambda: lv.SpinChain(33, up=1), "chains have at most 32 spins"),
        (lambda: lv.SpinChain(4, up=5), "a chain of 4 has 0 to 4 spins up"),
        (
            lambda: lv.SpinChain(4, xy=[1, 2]),
            r"xy must have shape .*, a number for each bond, not \(2,\)",
        ),
        (lambda: lv.SpinChain(4, up=2).index(7), "state 7 is not among the 6"),
        (lambda: lv.Grid(1.0, 1.0, 8), "axis 0 must end above its start"),
        (lambda: lv.Grid(0.0, 1.0, 8, mass=0.0), "mass must be positive, not 0 along axis 0"),
        (lambda: lv.Grid(0.0, 1.0, (8, 8, 8, 8)), "a grid must have 1, 2 or 3 axes, not 4"),
    ],
)
def test_models_check_their_numbers(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_potential_that_is_not_finite_is_named_with_its_place():
    grid = lv.Grid(-1.0, 1.0, 4, lambda t, x, params: 1 / x)
    with pytest.raises(ValueError, match=r"potential is inf at t = 0 and x = 0\nhint"):
        lv.Schrodinger(grid)
    plane = lv.Grid((0, 0), (1, 1), (4, 4), lambda t, x, params: ca.log(1 - t) * x[0] * x[1])
    psi = np.ones(16) / 4
    for method in (lv.SplitOperator(), lv.Magnus(), "auto"):
        steps = {"steps": 10} if method != "auto" else {}
        with pytest.raises((ValueError, lv.IntegrationError), match=r"potential is -?(inf|nan) at"):
            lv.integrate(lv.Schrodinger(plane), method, t=(0, 2), psi=psi, **steps)
    late = lv.Grid(0, 1, 4, lambda t, x, params: 1 / ((t - 1.5) ** 2 + (x - 0.5) ** 2))
    with pytest.raises(
        lv.IntegrationError, match=r"step . of 4 .*: potential is inf at t = 1.5 and x = 0.5"
    ):
        lv.integrate(lv.Schrodinger(late), lv.SplitOperator("S2"), t=(0, 2), steps=4, psi=psi[:4])


def test_a_ring_with_flux_runs_by_a_series():
    rng, n = np.random.default_rng(9), 12
    matrix = symmetric(rng, n, is_complex=True)
    psi, system = rng.normal(size=n), lv.Schrodinger(matrix)
    energies, vectors = np.linalg.eigh(matrix)
    wanted = vectors @ (np.exp(-2j * energies) * (vectors.conj().T @ psi))
    solution = lv.integrate(
        system, lv.SchrodingerSplitting(1e-10), t=(0, 2), psi=psi, observe={"energy of H": matrix}
    )
    assert np.linalg.norm(solution.psi[-1] - wanted) < 1e-10 * np.linalg.norm(psi)
    assert np.ptp(solution.observed["energy of H"]) < 1e-8


def equations():
    """Return equations with parameters, each by a function of these."""
    rng = np.random.default_rng(8)
    h, b = (x + x.T for x in rng.standard_normal((2, 12, 12)))
    c = b + 1j * (h @ b - b @ h)
    x = np.linspace(-1, 4, 9)

    def of_matrices(a, w, **more):
        drive = [(lambda t, p: p.a * ca.sin(p.w[0] * t + p.w[1]), b), (more.pop("u", x), c)]
        return lv.Schrodinger(h, drive=drive, times=x, params={"a": a, "w": w}, **more)

    def of_grid(a, w, is_still=False, **more):
        def potential(t, x, p):
            return p.a * (x - (0.0 if is_still else ca.sin(p.w[0] * t))) ** 2 + p.w[1] * x

        grid = lv.Grid(-6, 6, 24, potential=potential)
        return lv.Schrodinger(grid, params={"a": a, "w": w}, **more)

    return {
        "matrices": of_matrices,
        "given bounds": partial(of_matrices, bounds=(-60, 60), hbar=0.8),
        "moving": of_grid,
        "still": partial(of_grid, is_still=True),
        "lanczos": partial(of_grid, is_still=True, bounds="lanczos", hbar=1.2),
    }


@pytest.mark.parametrize("name", equations())
def test_other_parameters_are_those_of_another_equation_bit_for_bit(name):
    """Matrices, which do not depend on them, are read once."""
    make = equations()[name]
    old, new = (0.4, [1.0, 0.2]), (0.7, [1.4, -0.3])
    first, wanted = make(*old), make(*new)
    psi = np.exp(1j * np.arange(first.size))
    lv.integrate(first, "auto", t=(0, 1), psi=psi)  # finds bounds, which are its own
    found = first.with_params({"a": new[0], "w": new[1]})
    assert found.params["a"] == new[0]
    assert first.params["a"] == old[0]
    assert found.bounds == wanted.bounds
    assert found.guarantee == wanted.guarantee
    for system in (found, pickle.loads(pickle.dumps(found))):
        one, two = (lv.integrate(x, "auto", t=(0, 1, 2), psi=psi) for x in (system, wanted))
        np.testing.assert_array_equal(one.psi, two.psi)
    again = first.with_params({"a": new[0], "w": new[1]}).with_params({"a": old[0], "w": old[1]})
    one, two = (lv.integrate(x, "auto", t=(0, 1), psi=psi) for x in (first, again))
    np.testing.assert_array_equal(one.psi, two.psi)


def test_other_samples_are_those_of_another_equation_bit_for_bit():
    make, u = equations()["matrices"], np.cos(np.arange(9.0))
    first, wanted = make(0.4, [1.0, 0.2]), make(0.7, [1.0, 0.2], u=u)
    found = first.with_samples({"drive[1]": u}).with_params({"a": 0.7})
    one, two = (lv.integrate(x, "auto", t=(0, 1), psi=np.eye(12)[1]) for x in (found, wanted))
    np.testing.assert_array_equal(one.psi, two.psi)
    assert found.term_bounds == first.term_bounds


@pytest.mark.parametrize("first", [0.0, 1.0, 1e-290], ids=["none", "equal", "tiny"])
def test_other_samples_take_the_places_of_equal_ones(first):
    """The program is recorded once; columns of equal numbers are told apart, and none overflows."""
    rng, times = np.random.default_rng(2), np.linspace(0, 1, 9)
    parts, psi = [np.diag([0.0, 1.0, 3.0]), np.eye(3)[::-1], np.ones((3, 3))], np.eye(3)[0]

    def system(*samples):
        return lv.Schrodinger(parts[0], drive=[*zip(samples, parts[1:], strict=True)], times=times)

    old, a, b, c = np.full(9, first), *rng.normal(size=(3, 9))
    start = system(old, old)
    one = start.with_samples({"drive[1]": b})
    both = one.with_samples({"drive[0]": a})
    other = both.with_samples({"drive[0]": c})
    cases = [(start, old, old), (one, old, b), (both, a, b), (other, c, b), (start, old, old)]
    for found, *samples in cases:
        run = {"t": (0, 1), "h": 0.1, "psi": psi}
        wanted = lv.integrate(system(*samples), lv.Magnus(4), **run)
        for own in (found, pickle.loads(pickle.dumps(found))):
            np.testing.assert_array_equal(lv.integrate(own, lv.Magnus(4), **run).psi, wanted.psi)
