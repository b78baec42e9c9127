"""Spins, fermions and bosons: matrices by Kronecker products, energies that are known, sectors."""

import pickle
from itertools import combinations, product

import numpy as np
import pytest
from ordinary import propagated

import liouville as lv
from liouville._systems.waves.sites.matrix import Matrix


def spin_matrices(spin):
    """Return the letters of a spin, whose state 0 is all up."""
    m = spin - np.arange(int(2 * spin) + 1)
    up = np.diag(np.sqrt(spin * (spin + 1) - m[1:] * (m[1:] + 1)), 1).astype(complex)
    return {
        "x": (up + up.T) / 2, "y": (up - up.T) / 2j, "z": np.diag(m + 0j), "+": up, "-": up.T,
    }  # fmt: skip


def by_kronecker(sites, letters, terms):
    """Return a sum of products; site 0 has the fastest digit."""
    d = len(letters["z"])
    total = np.zeros((d**sites, d**sites), complex)
    for word, coefficient, places in terms:
        for c, at in zip(np.broadcast_to(coefficient, len(places)), places, strict=True):
            term = np.eye(d**sites)
            for letter, site in zip(word, at, strict=True):
                left, right = np.eye(d ** (sites - 1 - site)), np.eye(d**site)
                term = term @ np.kron(np.kron(left, letters[letter]), right)
            total += c * term
    return total


def energies(system):
    return np.linalg.eigvalsh(system.matrix().toarray())


def sums(levels, number):
    """Return the energies of so many free fermions."""
    return sorted(sum(chosen) for chosen in combinations(levels, number))


def packed(sites, levels):
    """Return the states of sites in order of numbers with the base `levels`."""
    width = (levels - 1).bit_length()
    digits = product(range(levels), repeat=sites)
    return [sum(x << (width * i) for i, x in enumerate(reversed(s))) for s in digits]


@pytest.mark.parametrize("spin", [0.5, 1, 1.5])
def test_a_sum_of_products_is_that_of_kronecker(spin):
    rng, sites = np.random.default_rng(0), 4
    pairs, alone = [(0, 1), (1, 3), (2, 0)], [(i,) for i in range(sites)]
    terms = [
        ("xy", rng.normal(size=3), pairs),  # with its partner a Dzyaloshinskii-Moriya term
        ("yx", -0.4, [(0, 3)]),
        ("zz", 0.7, [*pairs, (3, 3)]),  # a site with itself: an anisotropy
        ("xyz", 0.3, [(2, 0, 1)]),
        ("y", rng.normal(size=sites), alone),
        ("+-", 0.2 + 0.4j, [(0, 2)]),
        ("-+", 0.2 - 0.4j, [(0, 2)]),
    ]
    system = lv.SpinSystem(sites, terms, spin=spin)
    assert system.basis.tolist() == packed(sites, int(2 * spin) + 1)
    whole = by_kronecker(sites, spin_matrices(spin), terms)
    assert abs(system.matrix().toarray() - whole).max() < 1e-14 * abs(whole).max()
    other = [("x+", 0.3, [(0, 2)]), ("z", 1.0, alone)]  # not Hermitian
    seen = system.operator([("x+", 0.3, [(0, 2)]), ("z",)]).toarray()
    assert abs(seen - by_kronecker(sites, spin_matrices(spin), other)).max() < 1e-14


@pytest.mark.parametrize("spin", [0.5, 1])
def test_local_operators_commute_as_spins_do(spin):
    system = lv.SpinSystem(3, ["z"], spin=spin)
    x, y = (system.operator(letter, 1.0, [1]).toarray() for letter in "xy")
    z = np.diag(system.operator("z", 1.0, [1]))
    assert abs(x @ y - y @ x - 1j * z).max() < 1e-15
    assert abs(x @ x + y @ y + z @ z - spin * (spin + 1) * np.eye(len(x))).max() < 1e-15


def test_the_energies_of_the_ising_chain_are_those_of_free_fermions():
    n, j, h = 8, 1.3, 0.6
    chain = lv.SpinSystem(n, [("zz", -j), ("x", -h)], pauli=True)
    modes = np.linalg.svd(h * np.eye(n) + j * np.eye(n, k=-1), compute_uv=False)
    exact = sorted(np.dot(signs, modes) for signs in product((-1, 1), repeat=n))
    assert abs(energies(chain) - exact).max() < 1e-12
    # with x and z exchanged the parity is fixed, and the sectors share the energies
    terms = [("xx", -j), ("z", -h)]
    halves = [lv.SpinSystem(n, terms, pauli=True, parity=k) for k in (0, 1)]
    assert [half.size for half in halves] == [128, 128]
    found = np.sort(np.concatenate([energies(half) for half in halves]))
    assert abs(found - exact).max() < 1e-12


@pytest.mark.parametrize(
    ("sites", "spin", "least"),
    [(4, 0.5, -2.0), (6, 0.5, -(2 + 13**0.5) / 2), (8, 0.5, -3.651093409), (4, 1, -6.0)],
)
def test_the_ground_energy_of_a_ring_is_the_published_one(sites, spin, least):
    terms = [("xx", 1.0), ("yy", 1.0), ("zz", 1.0)]
    ring = lv.SpinSystem(sites, terms, spin=spin, periodic=True, up=int(sites * spin))
    assert energies(ring)[0] == pytest.approx(least, abs=1e-9)


def test_sectors_have_the_energies_of_all_states():
    rng, n = np.random.default_rng(1), 6
    far = [(i, j) for i in range(n) for j in range(i)]
    strengths = rng.normal(size=len(far))
    terms = [("xx", strengths, far), ("yy", strengths, far), ("zz", 0.5), ("z", rng.normal(size=n))]
    twist = [("xy", 0.4), ("yx", -0.4), ("zzz", 0.2)]
    for more in ([], twist):
        whole = energies(lv.SpinSystem(n, [*terms, *more]))
        parts = [energies(lv.SpinSystem(n, [*terms, *more], up=k)) for k in range(n + 1)]
        assert abs(np.sort(np.concatenate(parts)) - whole).max() < 1e-12
        assert lv.SpinSystem(n, [*terms, *more], up=3, parity=1).size == 20


def test_sectors_of_parity_have_the_energies_of_all_fermions_and_bosons():
    pairing = [("+- + h.c.", -1.0), ("++ + h.c.", 0.5), ("n", 0.4)]
    spinful = [("+-| + h.c.", -1.0), ("|+- + h.c.", -0.7), ("+|+ + h.c.", 0.3), ("n|n", 2.0)]
    squeezing = [("+- + h.c.", -1.0), ("++ + h.c.", 0.3, [(i, i) for i in range(4)]), ("n", 0.9)]
    for make in (
        lambda **own: lv.FermionSystem(6, pairing, **own),
        lambda **own: lv.FermionSystem(6, pairing, periodic=True, **own),
        lambda **own: lv.FermionSystem(3, spinful, spinful=True, **own),
        lambda **own: lv.BosonSystem(4, squeezing, cutoff=4, **own),
    ):
        halves = [make(parity=k) for k in (0, 1)]
        assert sum(half.size for half in halves) == make().size
        found = np.sort(np.concatenate([energies(half) for half in halves]))
        assert abs(found - energies(make())).max() < 1e-12
        for k, half in enumerate(halves):
            assert f"parity={k}" in repr(half)
            counts = np.array(
                [
                    sum(half._basis.digits(half.basis, i)[j] for i in range(half._basis.sites))
                    for j in range(half.size)
                ]
            )
            assert (counts % 2 == k).all()
    kitaev = lv.FermionSystem(2, [("+- + h.c.", -1.0), ("++ + h.c.", 0.5)], parity=0)
    assert energies(kitaev) == pytest.approx([-0.5, 0.5])
    rabi = lv.FermionSystem(4, [("n", 1.0)], particles=2, parity=0)
    assert rabi.size == 6


@pytest.mark.parametrize("up", [None, 3])
def test_exchange_without_a_matrix_is_the_matrix(up):
    rng, n = np.random.default_rng(2), 6
    pairs = [(0, 1), (4, 1), (2, 5), (0, 3), (5, 0)]
    strengths = rng.normal(size=len(pairs))
    flips = ("+- + h.c.", strengths / 2, pairs)
    system = lv.SpinSystem(n, [flips, ("zz", 0.7), ("z", rng.normal(size=n))], up=up)
    assert system.exchange is not None
    matrix = system.matrix().toarray()
    assert abs(system.exchange.entries().dense() - matrix).max() < 1e-14
    x = rng.normal(size=system.size)
    assert abs(lv.Schrodinger(system).hamiltonian.multiply(x) - matrix @ x).max() < 1e-13
    low, high = system.exchange._of_blocks()
    ends = np.linalg.eigvalsh(matrix)[[0, -1]]
    assert low <= ends[0]
    assert ends[1] <= high <= 2 * ends[1] - ends[0]


def test_spins_without_bonds_are_bounded_by_their_fields():
    chain = lv.SpinSystem(10, [("xx", 1.0, (0, 1)), ("yy", 1.0, (0, 1)), ("z", 2.0)])
    low, high = lv.Schrodinger(chain).bounds
    assert (low, high) == pytest.approx((-10.0, 10.0), abs=0.5)
    assert low <= -10
    assert high >= 10


def test_a_driven_system_moves_as_dense_matrices_say():
    chain = lv.SpinSystem(5, [("zz", -1.0), ("x", -0.4)], pauli=True)
    transverse = chain.operator("x") * 0.3
    driven = lv.Schrodinger(chain, drive=[(lambda t, params: t, transverse)])
    psi = chain.product_state([1.0, 0.0])
    assert psi[chain.index(0)] == 1.0
    observe = {"zz": chain.operator("zz", 1.0, (0, 4)), "x": chain.operator("x", 1 / 5)}
    found = lv.integrate(driven, "auto", t=(0.0, 1.0), psi=psi, observe=observe)

    def product(t, y):
        return chain.matrix() @ y + t * (transverse @ y)

    own = propagated(product, (0, 1), psi)[-1]
    assert np.linalg.norm(found.psi[-1] - own) < 1e-7
    kron = by_kronecker(5, spin_matrices(0.5), [("zz", 4.0, [(0, 4)])])
    assert found.observed["zz"][-1] == pytest.approx((own.conj() @ kron @ own).real, abs=1e-7)


def test_a_product_of_local_states_is_that_of_kronecker():
    chain = lv.SpinSystem(3, ["z"], spin=1)
    rng = np.random.default_rng(3)
    local = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    whole = np.kron(np.kron(local[2], local[1]), local[0])
    psi = chain.product_state(local)
    assert abs(psi - whole / np.linalg.norm(whole)).max() < 1e-15
    half = lv.SpinSystem(4, ["z"], up=2)
    assert half.index([0, 1, 0, 1]) == half.index(0b1010)
    assert half.product_state([1, 1]) == pytest.approx(np.full(6, 6**-0.5))


def test_fermions_anticommute():
    system = lv.FermionSystem(2, ["n|"], spinful=True)
    words = [("-|", 0), ("-|", 1), ("|-", 0), ("|-", 1)]
    c = [system.operator(word, 1.0, [i]).toarray() for word, i in words]
    for (i, a), (j, b) in product(enumerate(c), repeat=2):
        assert abs(a @ b + b @ a).max() == 0.0
        assert abs(a @ b.T + b.T @ a - (i == j) * np.eye(16)).max() == 0.0
    pair = system.operator("+-|", 1.0, (1, 0)).toarray()
    assert abs(pair - c[1].T @ c[0]).max() == 0.0
    assert abs(system.operator("-|+", 1.0, (0, 1)).toarray() - c[0] @ c[3].T).max() == 0.0


@pytest.mark.parametrize("number", [2, 3])
def test_free_fermions_on_a_ring_with_flux_fill_its_levels(number):
    n, flux = 7, 0.9
    hop = np.exp(1j * flux / n)
    ring = lv.FermionSystem(n, [("+- + h.c.", -hop)], particles=number, periodic=True)
    levels = -2 * np.cos((2 * np.pi * np.arange(n) - flux) / n)
    assert abs(energies(ring) - sums(levels, number)).max() < 1e-12


def test_two_sites_of_hubbard_have_the_energies_of_the_formula():
    u, terms = 3.0, [("+-| + h.c.", -1.0), ("|+- + h.c.", -1.0), ("n|n", 3.0)]
    pair = lv.FermionSystem(2, terms, particles=(1, 1))
    root = np.hypot(u, 4.0)
    assert abs(energies(pair) - [(u - root) / 2, 0, u, (u + root) / 2]).max() < 1e-14
    levels = -2 * np.cos(np.pi * np.arange(1, 4) / 4)
    free = lv.FermionSystem(3, terms[:2], particles=(2, 1))
    whole = np.sort(np.add.outer(sums(levels, 2), levels).ravel())
    assert abs(energies(free) - whole).max() < 1e-14
    several = lv.FermionSystem(3, terms[:2], particles=3, spinful=True)
    assert several.size == 20
    assert energies(several)[0] == pytest.approx(whole[0], abs=1e-14)


def test_bosons_hop_with_the_square_roots_of_their_numbers():
    n, number = 4, 3
    free = lv.BosonSystem(n, [("+- + h.c.", -1.0)], particles=number)
    levels = -2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))
    fillings = (np.bincount(x, minlength=n) for x in product(range(n), repeat=number))
    exact = sorted(
        {tuple(filling): filling @ levels for filling in map(np.asarray, fillings)}.values()
    )
    assert abs(energies(free) - exact).max() < 1e-13
    apart = lv.BosonSystem(2, [("nn", 1.0, [(0, 0), (1, 1)]), ("n", -1.0)], particles=4)
    assert energies(apart).tolist() == [4.0, 6.0, 6.0, 12.0, 12.0]  # n (n - 1) of each
    one = lv.BosonSystem(1, ["n"], cutoff=5)
    b = one.operator("-", 1.0, [0]).toarray()
    assert np.diag(b @ b.T - b.T @ b) == pytest.approx([1, 1, 1, 1, 1, -5])


def test_phases_of_hopping_are_those_of_a_gauge():
    ring = lv.BosonSystem(3, [("+- + h.c.", np.exp(0.5j))], cutoff=1, periodic=True, particles=1)
    levels = np.sort(2 * np.cos(2 * np.pi * np.arange(3) / 3 + 0.5))
    assert abs(energies(ring) - levels).max() < 1e-14
    assert not lv.Schrodinger(ring).is_real  # the flux through the ring is no multiple of pi
    chain = lv.BosonSystem(3, [("+- + h.c.", np.exp(0.5j))], cutoff=1, particles=1)
    assert lv.Schrodinger(chain).is_real


@pytest.mark.parametrize(
    "system",
    [
        lv.SpinSystem(5, [("xx", 1.0), ("z", 0.3)], parity=1),
        lv.SpinSystem(5, [("+- + h.c.", 0.5)], up=2),
        lv.FermionSystem(3, ["+-| + h.c."], particles=(1, 2)),
        lv.BosonSystem(3, ["+- + h.c."], particles=2),
    ],
)
def test_a_pickle_has_the_same_matrix_and_makes_the_same_equation(system):
    other = pickle.loads(pickle.dumps(system))
    assert repr(other) == repr(system)
    assert (other.matrix() != system.matrix()).nnz == 0
    equation = pickle.loads(pickle.dumps(lv.Schrodinger(system)))
    assert equation.bounds == lv.Schrodinger(system).bounds


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: lv.SpinSystem(4, [("zz", 1.0), ("x", 0.5)], up=2),
         "term 1, 'x', on site 0, changes the number of spins up, so that up=2 is no sector"),
        (lambda: lv.SpinSystem(4, [("xz", 1.0)], parity=0),
         "term 0, 'xz', on sites 0, 1, changes the parity of the number of steps down"),
        (lambda: lv.SpinSystem(4, [("zz",), ("+-", 1j)]),
         r"term 1, '\+-', on sites 0, 1, has no Hermitian conjugate in the sum"),
        (lambda: lv.SpinSystem(4, [("z", 1j)]), "'z', on site 0, .* another coeff.*\nhint: make"),
        (lambda: lv.FermionSystem(4, ["+-"]), r"\nhint: write its letters as .*, which adds it$"),
        (lambda: lv.FermionSystem(4, ["n|n"]), "has the letter '|'\nhint: .*give spinful=True"),
        (lambda: lv.SpinSystem(6, ["xx", "yy"], periodic=True, up=0, momentum=1),
         "no state with up=0 and momentum=1: the momenta there are 0$"),
        (lambda: lv.SpinSystem(4, [("zw", 1.0)]), "term 0, 'zw', has the letter 'w'"),
        (lambda: lv.SpinSystem(4, [("zz", 1.0, (0, 4))]), "is on site 4: there are 0 to 3"),
        (lambda: lv.SpinSystem(4, [("zz", 1.0, (0, 1, 2))]), "must be 2 for its 2 letters"),
        (lambda: lv.SpinSystem(4, [("zz", [1.0, 2.0])]), "or one for each of its 3 places"),
        (lambda: lv.SpinSystem(4, [("z", np.nan)]), "of term 0, 'z', must be finite"),
        (lambda: lv.SpinSystem(2, ["z"], periodic=True), "must be 3 or more of a periodic"),
        (lambda: lv.SpinSystem(4, ["z"], up=5), "up must be from 0 to 4 for 4 spins, not 5"),
        (lambda: lv.SpinSystem(4, ["z"], up=2, parity=1), "have no state with up=2 and parity=1"),
        (lambda: lv.SpinSystem(4, ["z"], spin=0.7), "a multiple of 1/2"),
        (lambda: lv.SpinSystem(4, ["z"], up=2).index(7), "state 7 is not among the 6"),
        (lambda: lv.SpinSystem(4, ["z"], up=1).operator("x"), "the term, 'x', on site 0, changes"),
        (lambda: lv.FermionSystem(4, ["-| + h.c."], particles=(1, 1)),
         "changes the number of fermions"),
        (lambda: lv.FermionSystem(4, ["nn"], particles=(1, 1)), "term 0, 'nn', has no bar"),
        (lambda: lv.FermionSystem(4, ["- + h.c."], parity=1),
         r"changes the parity of the number of fermions, so that parity=1 is .*\nhint: leave p"),
        (lambda: lv.FermionSystem(4, ["n"], particles=2, parity=1), "no state with particles=2"),
        (lambda: lv.BosonSystem(4, ["n", "+ + h.c."], cutoff=2, parity=0),
         "changes the parity of the number of bosons"),
        (lambda: lv.BosonSystem(4, ["n"], cutoff=2, parity=2), "parity must be from 0 to 1, not 2"),
        (lambda: lv.BosonSystem(4, ["n"]), "give cutoff= or particles="),
        (lambda: lv.BosonSystem(4, ["+- + h.c.", ("+ + h.c.", 1.0)], particles=2),
         r"term 1, '\+', on site 0, changes the number of bosons, so that particles=2"),
        (lambda: lv.SpinSystem(4, ["z"]).product_state([0, 0]), "has the norm 0 in the sector"),
        (lambda: lv.SpinSystem(60, ["z"]), "60 sites of 2 states: at most 48 .*\nhint: longer"),
        (lambda: lv.SpinSystem(1, ["xx"]), "'xx', acts on 2 neighbouring sites, and there is 1\n"),
        (lambda: lv.SpinSystem(3, ["x"]).operator("z+-z"), "'z.-z', acts on 4 .*, and there are 3"),
        (lambda: lv.BosonSystem(1, ["n", "+- + h.c."], cutoff=2), r"1, '\+- \+ h.c.', acts on 2"),
        (lambda: lv.SpinSystem(4, [("z", 1.0, [])]), "term 0, 'z', has no sites\nhint: leave"),
        (lambda: lv.BosonSystem(10, ["n"], cutoff=200),
         "10 sites of 201 states: at most 6 .*\nhint: of 10 sites the most bosons .* cutoff=26$"),
        (lambda: lv.BosonSystem(60, ["n"], cutoff=2), "at most 30 .*\nhint: longer ones"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_a_chain_of_24_fits_and_what_does_not_is_refused_with_numbers(monkeypatch):
    monkeypatch.setattr("liouville._basics.arguments.memory", lambda: 18.0 * 2**30)
    exchange = [("xx", 1.0), ("yy", 1.0), ("zz", 1.0)]
    second = [("+- + h.c.", 0.2, [(i, i + 2) for i in range(22)])]
    chain = lv.SpinSystem(24, [*exchange, *second], up=12)
    assert (chain.size, chain.exchange is not None) == (2704156, True)
    size = r"SpinSystem\(28 spins, up=14\) of 40116600 states, with a state, takes [\d.]+ GiB"
    with pytest.raises(MemoryError, match=size):
        lv.SpinSystem(28, [*exchange, ("zzz", 1.0)], up=14)
    with pytest.raises(MemoryError, match=r"of 17179869184 states, .* with 18 GiB available"):
        lv.SpinSystem(34, [("zz", 1.0), ("x", 1.0)])
    with pytest.raises(
        MemoryError, match=r"12 sites of at most 12\).*\nhint: take a smaller cutoff="
    ):
        lv.BosonSystem(12, ["n"], cutoff=12)
    with pytest.raises(MemoryError, match=r"hint: .* by up=, parity= or momentum="):
        lv.SpinSystem(40, ["xx"])
    with pytest.raises(MemoryError, match=r"hint: fix particles=, parity= or momentum= where"):
        lv.FermionSystem(30, ["n"])


def test_the_number_of_entries_is_known_beforehand():
    system = lv.SpinSystem(18, [("xx", 1.0), ("zzz", 1.0), ("z", 0.3)], parity=0)
    estimate = Matrix(system._basis, system._products).entries()
    assert estimate == pytest.approx(system.matrix().nnz, rel=0.02)


def test_a_complex_matrix_is_known_to_take_more(monkeypatch):
    monkeypatch.setattr("liouville._basics.arguments.memory", lambda: 2.0**30)
    twist = [("xy", 1.0), ("yx", -1.0)]
    assert lv.SpinSystem(18, [("xx", 1.0), ("yy", 1.0), ("x", 1.0)]).size == 2**18
    with pytest.raises(MemoryError, match=r"takes 1\.\d+ GiB, with 1 GiB available"):
        lv.SpinSystem(18, [*twist, ("x", 1.0)])


def test_a_product_that_is_zero_but_for_roundoff_is_nothing():
    with_it = lv.SpinSystem(3, [("xyx + h.c.", 0.2, [(0, 0, 0)]), ("zz",)], spin=1)
    without = lv.SpinSystem(3, ["zz"], spin=1)
    assert abs(with_it.matrix() - without.matrix()).max() < 1e-14
