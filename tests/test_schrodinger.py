"""Wave functions: references by every method, orders, forms of H, and what is kept exactly."""

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from ordinary import solved
from scipy.sparse.linalg import aslinearoperator

import liouville as lv
from liouville.problems import (
    harmonic_oscillator,
    heisenberg,
    lattice2d,
    poschl_teller,
    tight_binding,
    walker_preston,
)

TOLERANT = {
    "auto": lv.SchrodingerSplitting,
    "fast": lambda tol: lv.SchrodingerSplitting(tol, "fast"),
    "stable": lambda tol: lv.SchrodingerSplitting(tol, "stable"),
    "Chebyshev": lv.Chebyshev,
    "Lanczos": lv.Lanczos,
}

#: Methods with steps of a given size, for any real H: step times beta, and the error that is left.
STEPPED = {
    "Gray": (lv.GrayManolopoulos(6), 0.25, 1e-6),
    "stability": (lv.StabilitySplitting(8, 8), 0.5, 1e-6),
    "Magnus": (lv.Magnus(tol=1e-11), 5.0, 1e-11),
}


def random_state(n, seed=0):
    rng = np.random.default_rng(seed)
    psi = rng.normal(size=n) + 1j * rng.normal(size=n)
    return psi / np.linalg.norm(psi)


def symmetric(n, seed=0):
    matrix = np.random.default_rng(seed).normal(size=(n, n))
    return matrix + matrix.T


def propagated(matrix, t, psi):
    """Return a state at a time by eigenvectors."""
    energies, vectors = np.linalg.eigh(matrix)
    return vectors @ (np.exp(-1j * energies * t) * (vectors.conj().T @ psi))


def integrated(h, t, psi):
    """Return the state at the end of a span, H(t) an array."""
    return solved(lambda t, y: -1j * (h(t) @ y), t, psi.astype(complex))[-1]


def off(psi, wanted):
    """Return how far a state is from a reference: a whole state, or a dict of components."""
    if isinstance(wanted, dict):
        return max(abs(psi[place] - value) for place, value in wanted.items())
    return np.linalg.norm(psi - wanted)


# --- references ----------------------------------------------------------------------------------


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("method", TOLERANT)
@pytest.mark.parametrize("problem", [tight_binding, heisenberg, harmonic_oscillator, lattice2d])
def test_every_method_reaches_the_references_to_its_tolerance(problem, method, tol):
    (t, wanted), *_ = problem.reference.items()
    tol = max(tol, 1e-11) if t > 20 else tol
    solution = lv.integrate(
        problem.system, TOLERANT[method](tol), t=(problem.interval[0], t), **problem.start
    )
    assert off(solution.psi[-1], wanted["psi"]) <= tol
    assert solution.invariant_drift("norm").max() <= tol


@pytest.mark.parametrize("tol", [1e-4, 1e-8])
@pytest.mark.parametrize("method", TOLERANT)
def test_every_method_carries_the_packet_in_the_deep_well(method, tol):
    solution = lv.integrate(
        poschl_teller.system, TOLERANT[method](tol), t=[0.0, 0.1, 1.0], **poschl_teller.start
    )
    for k, t in ((1, 0.1), (2, 1.0)):
        assert off(solution.psi[k], poschl_teller.exact(t)) <= tol


@pytest.mark.parametrize("method", STEPPED)
@pytest.mark.parametrize("problem", [tight_binding, heisenberg])
def test_methods_with_steps_reach_the_references(problem, method):
    chosen, theta, error = STEPPED[method]
    (t, wanted), *_ = problem.reference.items()
    h = 2 * theta / np.ptp(problem.system.bounds)
    solution = lv.integrate(problem.system, chosen, t=(0.0, t), h=h, **problem.start)
    assert off(solution.psi[-1], wanted["psi"]) <= error


@pytest.mark.parametrize(("problem", "error"), [(harmonic_oscillator, 1e-9), (poschl_teller, 1e-7)])
def test_split_operators_reach_the_closed_forms(problem, error):
    t = max(problem.reference)
    for scheme, steps in (("RKN6s11", 400), ("BM6", 400)):
        solution = lv.integrate(
            problem.system, lv.SplitOperator(scheme), t=(0.0, t), steps=steps, **problem.start
        )
        assert off(solution.psi[-1], problem.exact(t)) <= error, scheme
        assert solution.invariant_drift("norm").max() <= 1e-12


# --- H(t) ----------------------------------------------------------------------------------------

DRIVE = symmetric(8, 5)
CHAIN = lv.Lattice(8, potential=np.cos(np.arange(8.0)))


def driven(source=CHAIN, **more):
    return lv.Schrodinger(
        source, drive=[(lambda t, params: params.a * t * (2 - t), DRIVE)], params={"a": 0.4}, **more
    )


def driven_array(t, a=0.4):
    return CHAIN.entries().dense() + a * t * (2 - t) * DRIVE


def test_a_driven_matrix_agrees_with_an_ordinary_solver():
    psi, t = random_state(8), (0.3, 2.3)
    wanted = integrated(driven_array, t, psi)
    found = lv.integrate(driven(), lv.Magnus(tol=1e-10), t=t, steps=800, psi=psi)
    assert off(found.psi[-1], wanted) < 1e-10
    other = lv.integrate(
        driven(), lv.Magnus(tol=1e-10), t=t, steps=800, psi=psi, params={"a": -0.2}
    )
    assert off(other.psi[-1], integrated(lambda t: driven_array(t, -0.2), t, psi)) < 1e-10
    slow = lv.Schrodinger(CHAIN, drive=[(lambda t, params: 0.4 * t * (2 - t), DRIVE)], hbar=2.0)
    halved = lv.integrate(slow, lv.Magnus(tol=1e-10), t=t, steps=800, psi=psi)
    assert off(halved.psi[-1], integrated(lambda t: driven_array(t) / 2, t, psi)) < 1e-10


def grid(potential):
    return lv.Grid(-8.0, 8.0, 64, potential=potential)


MOVED = lv.Schrodinger(
    grid(lambda t, x, params: x**2 / 2 + params.a * ca.sin(2 * t) * x + x**4 / 100),
    params={"a": 2.0},
)
SPAN = (0.4, 8.4)


def packet(x):
    psi = np.exp(-((x - 1.5) ** 2) / 2 + 1j * x)
    return psi / np.linalg.norm(psi)


def test_a_potential_in_time_is_the_same_as_a_drive():
    x = MOVED.grid.points[:, 0]
    still = grid(lambda t, x, params: x**2 / 2 + x**4 / 100)
    as_drive = lv.Schrodinger(still, drive=[(lambda t, params: 2 * ca.sin(2 * t), x)])
    ends = [
        lv.integrate(each, lv.Magnus(tol=1e-10), t=SPAN, steps=40, psi=packet(x)).psi[-1]
        for each in (MOVED, as_drive)
    ]
    assert off(ends[0], ends[1]) < 1e-9


@pytest.mark.parametrize("scheme", ["RKN6s11", "BM4"])
def test_the_molecule_is_the_same_by_two_ways(scheme):
    t, start = walker_preston.interval, walker_preston.start
    split = lv.integrate(walker_preston.system, lv.SplitOperator(scheme), t=t, steps=1600, **start)
    assert off(split.psi[-1], walker_preston.reference[t[1]]["psi"]) < 1e-10
    magnus = lv.integrate(walker_preston.system, lv.Magnus(tol=1e-9), t=t, steps=2000, **start)
    assert off(magnus.psi[-1], split.psi[-1]) < 2e-8


# --- one H in many forms -------------------------------------------------------------------------


@pytest.mark.parametrize("method", [*TOLERANT, *STEPPED])
def test_one_hamiltonian_in_any_form_gives_the_same_states(method):
    lattice = lv.Lattice((6, 5), potential=np.random.default_rng(1).normal(size=(6, 5)))
    matrix, psi = lattice.entries().dense(), random_state(30)
    forms = {
        "lattice": lattice, "dense": matrix, "csr": sp.csr_array(matrix),
        "coo": sp.coo_array(matrix), "operator": aslinearoperator(matrix),
        "function": (30, lambda x: matrix @ x),
    }  # fmt: skip
    more, tol = {}, 1e-10
    if method in STEPPED:
        chosen, theta, tol = STEPPED[method]
        more = {"h": theta / 5}
    else:
        chosen = TOLERANT[method](tol)
    wanted = propagated(matrix, 4.0, psi)
    for name, form in forms.items():
        found = lv.integrate(lv.Schrodinger(form), chosen, t=(0.0, 4.0), psi=psi, **more)
        assert off(found.psi[-1], wanted) <= tol, name


@pytest.mark.parametrize("hbar", [0.5, 1.0, 3.0])
def test_a_shifted_spectrum_and_another_planck_constant_are_only_a_phase_and_a_time(hbar):
    matrix, psi = symmetric(12), random_state(12)
    for shift in (0.0, 1e3):
        system = lv.Schrodinger(matrix + shift * np.eye(12), hbar=hbar)
        for method in TOLERANT.values():
            found = lv.integrate(system, method(1e-9), t=(0.0, 3.0), psi=psi)
            wanted = np.exp(-1j * shift * 3.0 / hbar) * propagated(matrix, 3.0 / hbar, psi)
            assert off(found.psi[-1], wanted) <= 1e-9


@pytest.mark.parametrize(
    ("flux", "method"),
    [*((flux, name) for flux in (0.0, np.pi) for name in TOLERANT), (0.7, "auto"),
     (0.7, "Chebyshev")],
)  # fmt: skip
def test_a_ring_with_flux_agrees_with_its_eigenvectors(flux, method):
    n = 9
    matrix = np.diag(np.linspace(-1, 1, n)).astype(complex)
    for i in range(n):
        matrix[i, (i + 1) % n] -= np.exp(1j * flux / n)
        matrix[(i + 1) % n, i] -= np.exp(-1j * flux / n)
    psi = random_state(n)
    system = lv.Schrodinger(sp.csr_array(matrix))
    assert system.is_real == (flux != 0.7)
    solution = lv.integrate(
        system, TOLERANT[method](1e-10), t=[0.0, 3.0, 8.0], psi=psi, observe={"H": matrix}
    )
    for t, found in zip(solution.t, solution.psi, strict=True):
        assert off(found, propagated(matrix, t, psi)) <= 1e-10
    assert np.ptp(solution.observed["H"]) < 1e-9
    assert np.allclose(solution.observed["autocorrelation"], solution.psi @ psi.conj(), atol=1e-13)


# --- what is the same, and what comes back -------------------------------------------------------


@pytest.mark.parametrize("method", TOLERANT)
def test_states_at_many_times_are_those_of_runs_that_end_there(method):
    system, psi = lv.Schrodinger(symmetric(20)), random_state(20)
    times = [0.0, 0.3, 0.5, 2.0, 2.2]
    chosen = TOLERANT[method](1e-9)
    many = lv.integrate(system, chosen, t=times, psi=psi)
    assert many.t.tolist() == times
    for k, t in enumerate(times[1:], 1):
        one = lv.integrate(system, chosen, t=(0.0, t), psi=psi)
        assert off(many.psi[k], one.psi[-1]) <= 2e-9
        assert many.observed["autocorrelation"][k] == pytest.approx(
            psi.conj() @ many.psi[k], abs=1e-13
        )


def test_kept_steps_change_nothing():
    psi = packet(MOVED.grid.points[:, 0])
    for method in (lv.SplitOperator("BM4"), lv.Magnus(tol=1e-10)):
        ends = [
            lv.integrate(MOVED, method, t=SPAN, steps=60, every=every, psi=psi).psi[-1]
            for every in (1, 7, 60)
        ]
        assert off(ends[0], ends[1]) < 1e-13
        assert off(ends[0], ends[2]) < 1e-13


WAYS = {
    **{name: (lv.Schrodinger(CHAIN), make(1e-9), {"t": [0.0, 1.0, 3.0]})
       for name, make in TOLERANT.items()},
    "Gray": (lv.Schrodinger(CHAIN), lv.GrayManolopoulos(5), {"t": (0, 3), "steps": 30}),
    "stability": (lv.Schrodinger(CHAIN), lv.StabilitySplitting(4, 4), {"t": (0, 3), "steps": 6}),
    "Magnus": (driven(), lv.Magnus(tol=1e-13), {"t": (0, 3), "steps": 30}),
    "split": (MOVED, lv.SplitOperator(), {"t": SPAN, "steps": 30}),
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_an_ensemble_is_its_members_bit_for_bit(way):
    system, method, call = WAYS[way]
    psi = np.array([random_state(system.size, k) for k in range(11)])
    if way != "auto":  # which may take another method from a real start
        psi[3] = psi[3].real  # whose series is a shorter one
    runs = [lv.ensemble(system, method, **call, psi=psi, threads=k) for k in (1, 2)]
    assert np.array_equal(runs[0].psi, runs[1].psi)
    for k in (0, 3, 7, 10):
        one = lv.integrate(system, method, **call, psi=psi[k])
        assert np.array_equal(one.psi, runs[0].psi[:, k])
        for name, values in one.observed.items():
            assert np.array_equal(values, runs[0].observed[name][:, k]), name


@pytest.mark.parametrize("method", TOLERANT)
def test_bits_do_not_depend_on_threads(method):
    rng = np.random.default_rng(3)
    lattice = lv.Lattice((300, 200), potential=rng.normal(size=(300, 200)))
    psi = random_state(lattice.size)
    systems = [lv.Schrodinger(lattice)]
    if method == "stable":
        systems += [
            lv.Schrodinger(lv.SpinChain(18, up=9)),
            lv.Schrodinger(lv.Grid((-5, -5), (5, 5), (128, 256), rng.normal(size=(128, 256)))),
        ]
    for system in systems:
        psi = random_state(system.size)
        t = 10.0 / np.ptp(system.bounds)
        ends = [
            lv.integrate(system, TOLERANT[method](1e-6), t=(0.0, t), psi=psi, threads=threads)
            for threads in (1, 2, 3)
        ]
        assert np.array_equal(ends[0].psi, ends[1].psi)
        assert np.array_equal(ends[0].psi, ends[2].psi)


RETURNING = {
    **{name: (CHAIN, TOLERANT[name](1e-6), {}) for name in ("fast", "stable")},
    "Gray": (CHAIN, lv.GrayManolopoulos(4), {"steps": 40}),
    "stability": (CHAIN, lv.StabilitySplitting(2, 6), {"steps": 10}),
    "split": ("moved", lv.SplitOperator("BM4"), {"steps": 40}),
    "RKN": ("moved", lv.SplitOperator("RKN6s11"), {"steps": 40}),
    "Magnus": ("driven", lv.Magnus(tol=1e-13), {"steps": 4}),
    "Magnus in shears": ("driven", lv.Magnus(2, tol=1e-6), {"steps": 10_001}),
}


@pytest.mark.parametrize("way", RETURNING)
def test_a_run_back_returns_to_the_start(way):
    source, method, more = RETURNING[way]
    system = {"moved": MOVED, "driven": driven()}.get(source) or lv.Schrodinger(source)
    psi = random_state(system.size)
    there = lv.integrate(system, method, t=(0.0, 2.0), psi=psi, **more)
    back = lv.integrate(system, method, t=(2.0, 0.0), psi=there.psi[-1], **more)
    assert off(back.psi[-1], psi) < 1e-12
    if way in ("fast", "stable"):  # coarse as they are, which another method shows
        assert off(there.psi[-1], propagated(CHAIN.entries().dense(), 2.0, psi)) > 1e-11


@pytest.mark.parametrize("way", WAYS)
def test_a_step_is_symplectic(way):
    system, method, call = WAYS[way]
    n, call = system.size, {**call, "t": (0.0, 0.4)}
    if "steps" in call:
        call["steps"] = 1
    unit = np.eye(n)
    ends = lv.ensemble(system, method, **call, psi=np.concatenate([unit, 1j * unit])).psi[-1]
    step = np.concatenate([ends.real, ends.imag], axis=1).T
    form = np.block([[np.zeros((n, n)), unit], [-unit, np.zeros((n, n))]])
    defect = np.abs(step.T @ form @ step - form).max()
    if way in ("Chebyshev", "Lanczos"):
        assert 1e-15 < defect < 1e-8  # it is a polynomial of H, and no more than that
    else:
        assert defect < 1e-12
        assert abs(np.linalg.det(step) - 1) < 1e-12
