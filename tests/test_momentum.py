"""Sectors of a momentum: spectra, states and what has none."""

import numpy as np
import pytest

import liouville as lv

CHAINS = {
    "Heisenberg": ([("xx",), ("yy",), ("zz", 0.7)], {"up": 4}, 8),
    "Ising": ([("zz", -1.0), ("x", -0.5)], {"pauli": True}, 8),
    "twisted": ([("xy", 0.3), ("yx", -0.3), ("zz",), ("xx",)], {}, 7),
    "odd": ([("xx", -1.0), ("z", -0.4)], {"parity": 1}, 9),
    "spin one": ([("xx",), ("yy",), ("zz",)], {"spin": 1, "up": 5}, 5),
}


def matrix(system):
    return system.matrix().toarray()


@pytest.mark.parametrize("name", CHAINS)
def test_spectra_of_all_momenta_are_that_of_the_whole(name):
    terms, sector, length = CHAINS[name]
    whole = lv.SpinSystem(length, terms, periodic=True, **sector)
    found, sizes = [], 0
    for k in range(length):
        own = lv.SpinSystem(length, terms, periodic=True, momentum=k, **sector)
        h = matrix(own)
        assert h.shape == (own.size, own.size)
        assert np.abs(h - h.conj().T).max() < 1e-13
        found.append(np.linalg.eigvalsh(h))
        sizes += own.size
    assert sizes == whole.size
    assert np.abs(np.sort(np.concatenate(found)) - np.linalg.eigvalsh(matrix(whole))).max() < 1e-12


@pytest.mark.parametrize(
    ("sector", "length"),
    [({"particles": 4}, 6), ({"cutoff": 2}, 5), ({"cutoff": 3, "parity": 1}, 4)],
)
def test_spectra_of_bosons_of_all_momenta_are_that_of_the_whole(sector, length):
    on_site = [(i, i) for i in range(length)]
    terms = [("+- + h.c.", -np.exp(0.3j)), ("nn", 2.0, on_site), ("nn", 0.7), ("n", -2.0)]
    whole = lv.BosonSystem(length, terms, periodic=True, **sector)
    each = [
        lv.BosonSystem(length, terms, periodic=True, momentum=k, **sector) for k in range(length)
    ]
    assert sum(own.size for own in each) == whole.size
    assert all(f"momentum={k}" in repr(own) for k, own in enumerate(each))
    found = np.concatenate([np.linalg.eigvalsh(matrix(own)) for own in each])
    assert np.abs(np.sort(found) - np.linalg.eigvalsh(matrix(whole))).max() < 1e-12
    psi = whole.product_state(np.ones(whole._basis.levels))  # of momentum 0
    density = {"n": each[0].operator("nn")}, {"n": whole.operator("nn")}
    runs = [
        lv.integrate(lv.Schrodinger(own), "auto", t=(0, 1), psi=start, observe=observe)
        for own, start, observe in (
            (each[0], each[0].product_state(np.ones(whole._basis.levels)), density[0]),
            (whole, psi, density[1]),
        )
    ]
    assert runs[0].observed["n"][-1] == pytest.approx(runs[1].observed["n"][-1], abs=1e-7)


HOPS = [("+- + h.c.", -np.exp(0.3j)), ("nn", 0.7)]
HUBBARD = [("+-| + h.c.", -np.exp(0.2j)), ("|+- + h.c.", -1.0), ("n|n", 4.0)]


@pytest.mark.parametrize(
    ("terms", "sector", "length"),
    [
        (HOPS, {"particles": 2}, 6),
        (HOPS, {"particles": 3}, 6),
        ([*HOPS, ("++ + h.c.", 0.4j)], {"parity": 0}, 5),
        ([*HOPS, ("+- + h.c.", 0.3, [(i, (i + 2) % 4) for i in range(4)])], {}, 4),
        (HUBBARD, {"particles": (2, 1)}, 4),
        (HUBBARD, {"particles": (2, 2)}, 4),
        ([*HUBBARD, ("+|- + h.c.", 0.3)], {"particles": 3, "spinful": True}, 3),
        ([*HUBBARD, ("+|+ + h.c.", 0.3)], {"spinful": True}, 3),
    ],
)
def test_sectors_of_fermions_are_the_whole(terms, sector, length):
    """Signs of fermions that go round the ring are in spectra, starts and observables."""
    whole = lv.FermionSystem(length, terms, periodic=True, **sector)
    density = ("n|n" if whole.spinful else "nn", 1.0)
    local = np.random.default_rng(0).normal(size=(whole._basis.sites, 2))
    start, found, parts = whole.product_state(local), [], []
    for k in range(length):
        try:
            own = lv.FermionSystem(length, terms, periodic=True, momentum=k, **sector)
        except ValueError:  # no state has this momentum
            continue
        assert f"momentum={k}" in repr(own)
        h = matrix(own)
        assert np.abs(h - h.conj().T).max() < 1e-13
        found.append(np.linalg.eigvalsh(h))
        psi = own._basis.projected(start)
        parts.append([np.vdot(psi, a @ psi).real for a in (np.eye(own.size), h)])
        parts[-1].append((abs(psi) ** 2) @ np.real(own.operator(*density)))
    assert np.abs(np.sort(np.concatenate(found)) - np.linalg.eigvalsh(matrix(whole))).max() < 1e-12
    wanted = [1.0, np.vdot(start, matrix(whole) @ start).real]
    wanted.append((abs(start) ** 2) @ np.real(whole.operator(*density)))
    assert np.abs(np.sum(parts, axis=0) - wanted).max() < 1e-12


def test_a_run_in_its_sector_is_that_of_the_whole():
    terms = [("xx",), ("yy",), ("zz",)]
    whole = lv.SpinSystem(8, terms, periodic=True, up=4)
    local = np.array([[1.0, 0.0], [0.0, 1.0]] * 4)
    runs = []
    for momentum in (0, 4):
        own = lv.SpinSystem(8, terms, periodic=True, up=4, momentum=momentum)
        # in the state up, down, up and so on only momenta 0 and pi have a part, of one half each
        psi = own.product_state(local)
        bond = own.operator("zz")
        runs.append(lv.integrate(lv.Schrodinger(own), "auto", t=(0, 3.0), psi=psi,
                                 observe={"zz": bond}).observed["zz"][-1])  # fmt: skip
    found = lv.integrate(
        lv.Schrodinger(whole), "auto", t=(0, 3.0), psi=whole.product_state(local),
        observe={"zz": whole.operator("zz")},
    )  # fmt: skip
    assert abs(np.mean(runs) - found.observed["zz"][-1]) < 1e-7


def test_a_ground_state_has_a_momentum():
    terms = [("xx",), ("yy",), ("zz",)]
    least = [
        lv.analysis.ground_state(
            lv.Schrodinger(lv.SpinSystem(10, terms, periodic=True, up=5, momentum=k))
        ).energy
        for k in range(10)
    ]
    whole = lv.analysis.ground_state(lv.Schrodinger(lv.SpinSystem(10, terms, periodic=True, up=5)))
    assert int(np.argmin(least)) == 5
    assert abs(min(least) - whole.energy) < 1e-9
    np.testing.assert_allclose(least[1:5], least[:5:-1], atol=1e-9)


def test_what_has_no_momentum_is_refused():
    with pytest.raises(ValueError, match="an open chain has no momentum\nhint"):
        lv.SpinSystem(6, ["zz"], momentum=0)
    with pytest.raises(ValueError, match="momentum must be from 0 to 5 for 6 sites, not 6"):
        lv.SpinSystem(6, ["zz"], periodic=True, momentum=6)
    with pytest.raises(ValueError, match=r"(?s)term 1.*moved by one.*hint: leave momentum= out"):
        lv.SpinSystem(6, ["zz", ("x", 1.0, [0])], periodic=True, momentum=1)
    system = lv.SpinSystem(6, ["zz"], periodic=True, momentum=1)
    with pytest.raises(ValueError, match="moved by one"):
        system.operator("z", 1.0, [2])
    with pytest.raises(ValueError, match="not among"):
        system.index(0)
    assert system.index(0b000010) == system.index(0b000001) == 0
    with pytest.raises(ValueError, match="norm 0"):
        system.product_state([1.0, 0.0])
    assert repr(system) == "SpinSystem(6 spins, momentum=1)"
