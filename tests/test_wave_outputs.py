"""Outputs of a Chebyshev series: their errors, their products, windows and memory."""

import numpy as np
import pytest
import scipy.sparse as sp
from test_wave_plans import eigen, random_state

import liouville as lv
from liouville._methods.planner.waves import settled, windows

#: A chain whose spectrum times the span is 200 wide.
CHAIN = lv.Schrodinger(lv.Lattice(200))
SPAN = 100.0 / (np.ptp(CHAIN.bounds) / 2)
ENERGIES, VECTORS = eigen(CHAIN)


def errors(solution, psi):
    phases = np.exp(-1j * np.outer(solution.t, ENERGIES))
    return np.linalg.norm(solution.psi - (phases * (VECTORS.T @ psi)) @ VECTORS.T, axis=1)


@pytest.mark.parametrize("is_real", [False, True])
@pytest.mark.parametrize("count", [1, 10, 100, 1000])
def test_any_number_of_outputs_takes_at_most_a_fifth_more_products(count, is_real):
    psi = random_state(np.random.default_rng(2), 200)
    psi = psi.real / np.linalg.norm(psi.real) if is_real else psi
    t = np.linspace(0.0, SPAN, count + 1)
    alone = lv.plan(CHAIN, lv.Chebyshev(), t=(0.0, SPAN), psi=psi)
    solution = lv.integrate(CHAIN, lv.Chebyshev(), t=t, psi=psi)
    assert alone.products == (65.5 if is_real else 131)
    assert solution.stats["products"] <= 1.2 * alone.products
    assert errors(solution, psi).max() <= 1e-8
    assert solution.stats["products"] == lv.plan(CHAIN, lv.Chebyshev(), t=t, psi=psi).products


def test_uneven_outputs_back_in_time_keep_to_the_tolerance_too():
    rng = np.random.default_rng(4)
    psi = random_state(rng, 200)
    t = np.append(0.0, -np.sort(rng.uniform(0.0, SPAN, 40)))
    t[7] = t[6] * (1 + 1e-14)
    solution = lv.integrate(CHAIN, lv.Chebyshev(1e-6), t=np.unique(t)[::-1], psi=psi)
    assert errors(solution, psi).max() <= 1e-6


def test_a_plan_says_windows_products_and_outputs():
    t = np.linspace(0.0, SPAN, 101)
    plan = lv.plan(CHAIN, lv.Chebyshev(), t=t)
    assert plan.windows == len(plan.core.windows)
    assert sum(plan.core.windows) == 100
    words = f"in {plan.windows} windows, 100 states kept; {plan.products:g} products H psi"
    assert words in str(plan)
    assert "outputs within a window take no products of their own" in str(plan)
    assert lv.plan(CHAIN, lv.SchrodingerSplitting(mode="fast"), t=t).windows == 0


def test_windows_are_shorter_where_memory_is(monkeypatch):
    psi, t = random_state(np.random.default_rng(5), 200), np.linspace(0.0, SPAN, 201)
    many = lv.integrate(CHAIN, lv.Chebyshev(), t=t, psi=psi)
    monkeypatch.setattr(windows, "memory", lambda: 4 * 25 * 3200.0)
    monkeypatch.setattr(windows, "LITTLE", 0.0)
    plan = lv.plan(CHAIN, lv.Chebyshev(), t=t)
    assert max(plan.core.windows) < 25
    assert plan.products > many.stats["products"]
    few = lv.integrate(CHAIN, plan, t=t, psi=psi)
    assert errors(few, psi).max() <= 1e-8


def test_auto_takes_the_series_where_products_are_dear_and_need_keep_no_states(monkeypatch):
    # what a clock would say on a quiet machine
    monkeypatch.setattr(settled, "series_cost", lambda system, products: (1.0, 0.02))
    n = 400
    matrix = sp.random_array((n, n), density=0.1, rng=np.random.default_rng(1))
    system = lv.Schrodinger(matrix + matrix.T)
    psi, t = random_state(np.random.default_rng(6), n), np.linspace(0.0, 40.0, 101)
    place = {"place": np.arange(n, dtype=float)}
    plan = lv.plan(system, t=t)
    assert "Chebyshev" in plan.scheme
    assert plan.products <= 1.2 * lv.plan(system, lv.Chebyshev(), t=(0.0, 40.0)).products
    kept, observed = (
        lv.integrate(system, plan, t=t, psi=psi, observe=place, states=states)
        for states in (True, False)
    )
    assert "psi" not in observed.states
    assert np.array_equal(kept.observed["place"], observed.observed["place"])
    weighed = (np.abs(kept.psi) ** 2) @ place["place"]
    assert np.allclose(kept.observed["place"], weighed, rtol=1e-12)


def test_states_are_kept_once():
    """They share their memory with the norms, which are columns of the same records."""
    system = lv.Schrodinger(lv.SpinChain(4))
    solution = lv.integrate(system, lv.Chebyshev(), t=(0, 1, 2), psi=np.eye(16)[5])
    assert np.shares_memory(solution.psi, solution.invariants["norm"].base)
