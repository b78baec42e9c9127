"""Magnus methods to a tolerance, their plans, and bounds of H(t) by corners of what drives it."""

import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from ordinary import propagated
from scipy.linalg import expm

import liouville as lv
from liouville._methods.planner.waves.driven import driving
from liouville.problems import walker_preston

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import driven_products

SCHEMES = [(2, 1), (4, 2), (4, 3), (6, 5), (8, 8)]


def cases():
    """Give systems, spans and starts."""
    for make in (driven_products.chain, driven_products.circular):
        h0, _, drive, span, psi = make(6)
        yield lv.Schrodinger(h0, drive=drive), span, psi
    h0, _, drive, span, psi = driven_products.landau_zener()
    yield lv.Schrodinger(h0, drive=drive), span, psi
    start = np.asarray(walker_preston.start["psi"], dtype=complex)
    yield walker_preston.system, walker_preston.interval, start


CASES = dict(zip(("chain", "circular", "crossing", "molecule"), cases(), strict=True))


@pytest.mark.parametrize("name", CASES)
def test_errors_are_below_the_tolerance_and_products_below_the_plan(name):
    system, span, psi = CASES[name]
    exact = lv.integrate(system, lv.Chebyshev(1e-12), t=span, psi=psi).psi[-1]
    for tol in (1e-3, 1e-6, 1e-9):
        # long ones are left out: loose tolerances by all, tight ones by high orders
        least = 2 if tol > 1e-4 else 4 if tol > 1e-7 and name != "molecule" else 6
        kept = [scheme for scheme in SCHEMES if scheme[0] >= least]
        for method in [lv.Chebyshev(tol), *(lv.Magnus(p, tol, j) for p, j in kept)]:
            solution = lv.integrate(system, method, t=span, psi=psi)
            assert np.linalg.norm(solution.psi[-1] - exact) < tol, method
            assert solution.stats["products"] <= lv.plan(system, method, t=span).products, method


def test_the_tolerance_holds_at_every_output_and_back_in_time():
    system, (t0, t1), psi = CASES["chain"]
    times = np.linspace(t0, t1, 8)
    exact = lv.integrate(system, lv.Chebyshev(1e-12), t=times, psi=psi).psi
    solution = lv.integrate(system, lv.Magnus(6, 1e-7), t=times, psi=psi)
    assert np.linalg.norm(solution.psi - exact, axis=1).max() < 1e-7
    back = lv.integrate(system, lv.Magnus(6, 1e-7), t=(t1, t0), psi=solution.psi[-1])
    assert np.linalg.norm(back.psi[-1] - psi) < 2e-7


def test_a_pulse_after_a_long_quiet_time_is_seen_and_a_jump_is_passed():
    h0, h1 = np.diag([0.0, 1.0, 2.5]), np.ones((3, 3))
    psi = np.array([1.0, 0, 0])

    def product(t, y):
        return (h0 + 3 * np.exp(-((t - 30) ** 2)) * h1) @ y

    for f, wanted in (
        (
            lambda t, _: 3 * ca.exp(-((t - 30) ** 2)),
            propagated(product, [0, 25, 28, 31, 33], psi)[-1],
        ),
        (
            lambda t, _: ca.if_else(t > 31, 1.0, 0.0),
            expm(-2j * (h0 + h1)) @ expm(-31j * h0) @ psi,
        ),
    ):
        system = lv.Schrodinger(h0, drive=[(f, h1)])
        solution = lv.integrate(system, lv.Magnus(4, 1e-6), t=(0.0, 33.0), psi=psi)
        assert np.linalg.norm(solution.psi[-1] - wanted) < 1e-6


def test_auto_takes_exponentials_where_there_are_many_drives():
    rng = np.random.default_rng(5)
    parts = [np.diag(rng.normal(size=12)) for _ in range(11)]
    drive = [(lambda t, _, k=k: 0.3 * ca.cos((1 + k / 10) * t), h) for k, h in enumerate(parts)]
    h0 = np.diag(np.ones(11), 1) + np.diag(np.ones(11), -1)
    psi = rng.normal(size=12)
    psi /= np.linalg.norm(psi)
    few, many = (lv.Schrodinger(h0, drive=drive[:k]) for k in (10, 11))
    assert "series in time" in lv.plan(few, "auto", t=(0, 3.0)).scheme
    plan = lv.plan(many, "auto", t=(0, 3.0))
    assert plan.scheme == "Magnus of order 6, 5 exponentials by Chebyshev series"
    solution = lv.integrate(many, plan, t=(0, 3.0), psi=psi)
    exact = lv.integrate(many, lv.Chebyshev(1e-12), t=(0, 3.0), psi=psi)
    assert "Magnus of order 8" in exact.method
    assert np.linalg.norm(solution.psi[-1] - exact.psi[-1]) < 1e-8
    assert lv.plan(many, lv.Chebyshev(1e-4), t=(0, 3.0)).scheme.startswith("Magnus of order 4, 3")


@pytest.mark.parametrize("order", [2, 4, 8])
def test_steps_at_kinks_share_the_tolerance(order):
    rng = np.random.default_rng(3)
    h0, h1 = (m := rng.standard_normal((2, 6, 6))) + m.transpose(0, 2, 1)
    system = lv.Schrodinger(h0, drive=[(lambda t, _: 2 * ca.fabs(ca.sin(3 * t)), h1)])
    psi = np.eye(6)[0]
    exact = lv.integrate(system, lv.Chebyshev(1e-11), t=(0, 5.0), psi=psi).psi[-1]
    for tol in (1e-3, 1e-5):
        found = lv.integrate(system, lv.Magnus(order, tol), t=(0, 5.0), psi=psi)
        assert np.linalg.norm(found.psi[-1] - exact) <= tol


def test_a_still_hamiltonian_is_one_series():
    system = lv.Schrodinger(lv.Lattice(30))
    psi = np.eye(30)[4]
    solution = lv.integrate(system, lv.Magnus(4, 1e-9), t=(0, 5.0), psi=psi)
    exact = lv.integrate(system, lv.Chebyshev(1e-12), t=(0, 5.0), psi=psi)
    assert np.linalg.norm(solution.psi[-1] - exact.psi[-1]) < 1e-9
    assert solution.stats["products"] < 150


def sweep(length, span=10.0):
    """Return an Ising chain whose field goes from one side to the other."""
    h0 = -sum(
        driven_products.spins(length, i, "z") @ driven_products.spins(length, i + 1, "z")
        for i in range(length - 1)
    ).real
    field = sum(driven_products.spins(length, i, "x").real for i in range(length))
    return h0, field, lv.Schrodinger(4 * h0, drive=[(lambda t, _: t / 2, field)]), (-span, span)


def test_corners_bound_h_where_its_parts_are_wide():
    h0, field, system, span = sweep(9)
    found = driving(system, span)
    _, _, _, (axis,), corners, _ = found.parts
    assert found.spectrum.guarantee == "probable"
    assert len(axis) == len(corners) > 2
    for f in np.linspace(-5, 5, 9):
        ends = np.linalg.eigvalsh((4 * h0 + f * field).toarray())[[0, -1]]
        low, high = (np.interp(f, axis, [corner[k] for corner in corners]) for k in (0, 1))
        assert low <= ends[0] < ends[1] <= high


def test_lanczos_at_corners_saves_a_third_of_the_products_where_discs_are_wide():
    rng = np.random.default_rng(4)
    values = sp.random_array((600, 600), density=8 / 600, rng=rng, data_sampler=rng.normal)
    h0, psi = sp.csr_array(values + values.T), rng.normal(size=600) + 0j
    drive = [(lambda t, _: 0.3 * ca.sin(t), np.arange(600.0) / 600)]
    runs = []
    for bounds, guarantee in (("auto", "probable"), ("gershgorin", "rigorous")):
        system = lv.Schrodinger(h0, drive=drive, bounds=bounds)
        plan = lv.plan(system, lv.Chebyshev(1e-7), t=(0, 20.0))
        assert plan.guarantee == guarantee
        runs.append(lv.integrate(system, plan, t=(0, 20.0), psi=psi / np.linalg.norm(psi)))
    assert np.linalg.norm(runs[0].psi[-1] - runs[1].psi[-1]) < 1e-7
    assert runs[0].stats["products"] < 0.7 * runs[1].stats["products"]


def test_a_bound_that_is_too_close_is_found_while_it_runs():
    h0, field, _, span = sweep(6, 3.0)
    system = lv.Schrodinger(4 * h0, drive=[(lambda t, _: t / 2, field)], bounds=(-3.0, 3.0))
    wide = lv.Schrodinger(4 * h0, drive=[(lambda t, _: t / 2, field)])
    psi = np.random.default_rng(0).normal(size=64)
    psi /= np.linalg.norm(psi)
    exact = lv.integrate(wide, lv.Chebyshev(1e-11), t=span, psi=psi).psi[-1]
    for method in (lv.Chebyshev(1e-7), lv.Magnus(6, 1e-7)):
        solution = lv.integrate(system, method, t=span, psi=psi)
        assert np.linalg.norm(solution.psi[-1] - exact) < 1e-7


@pytest.mark.parametrize("choice", [{"h": 0.1}, {"tol": 0.1}], ids=["steps", "tolerance"])
def test_an_exponential_whose_series_does_not_fit_in_memory_is_refused(choice):
    h0, drive = np.diag([0.0, 1e13]), [(lambda t, p: 1.0 + t, np.ones((2, 2)))]
    system, tol = lv.Schrodinger(h0, drive=drive), choice.pop("tol", 1e-8)
    with pytest.raises(MemoryError, match=r"the series of an exponential over .* / beta takes .*B"):
        lv.integrate(system, lv.Magnus(4, tol), t=(0, 1), psi=[1.0, 0.0], **choice)


@pytest.mark.parametrize("method", [lv.Magnus(4), lv.GrayManolopoulos(4)], ids=repr)
def test_more_states_than_fit_in_memory_are_refused_before_their_times_are_made(method):
    with pytest.raises(MemoryError, match=r"keeping 1000000000000001 states takes .* GiB"):
        lv.integrate(
            lv.Schrodinger(np.diag([0.0, 1.0])), method, steps=10**15, t=(0, 1), psi=[1, 0]
        )
