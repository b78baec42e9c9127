"""What stable splittings keep over a million steps, beside series and Krylov spaces that drift."""

from dataclasses import replace

import numpy as np
import pytest

import liouville as lv
from liouville._methods.planner.waves.ladder import ROUNDOFF, ladder
from liouville._methods.planner.waves.propagators import Shears

SITES = 24
CHAIN = lv.Schrodinger(lv.Lattice(SITES, potential=np.random.default_rng(0).normal(size=SITES)))
BETA = np.ptp(CHAIN.bounds) / 2


def start():
    rng = np.random.default_rng(1)
    psi = rng.normal(size=SITES) + 1j * rng.normal(size=SITES)
    return psi / np.linalg.norm(psi)


def rung_of(plan):
    return next(rung for rung in ladder() if plan.scheme.startswith(rung.name + " "))


def tenths(drift):
    """Return the largest drift of the first and of the last tenth, but for the start."""
    tenth = len(drift) // 10
    return drift[1 : tenth + 1].max(), drift[-tenth:].max()


@pytest.mark.parametrize(
    ("theta", "tol"), [(3.0, 1e-3), pytest.param(18.0, 1e-6, marks=pytest.mark.slow)]
)
def test_the_norm_is_bounded_over_a_million_steps(theta, tol):
    # the plan of a single step, a million times
    step = theta / BETA
    plan = lv.plan(CHAIN, lv.SchrodingerSplitting(tol, "stable"), t=(0.0, step))
    assert plan.steps == 1
    t = 1000 * step * np.arange(1001.0)
    plan = replace(plan, stops=tuple((end, 1000) for end in t[1:].tolist()))
    solution = lv.integrate(CHAIN, plan, t=t, psi=start(), states=False)
    assert solution.stats["steps"] == 1_000_000

    rung = rung_of(plan)
    kappa = rung.kappa[np.searchsorted(rung.fractions * rung.theta * (1 + 1e-12), theta)]
    roundings = ROUNDOFF * rung.gain * 1000
    drift = solution.invariant_drift("norm")
    first, last = tenths(drift)
    assert drift.max() <= kappa + kappa**2 + roundings
    assert last <= 1.5 * first + roundings
    assert 100 * roundings < kappa
    energy = solution.invariants["energy"]
    assert np.abs(energy - energy[0]).max() <= 2 * kappa * BETA


def test_the_norm_of_a_krylov_space_is_kept_to_roundoff():
    t = np.linspace(0.0, 2000 * 2.0 / BETA, 2001)
    method = lv.Lanczos(1e-6, 8)
    drift = lv.integrate(CHAIN, method, t=t, psi=start(), states=False).invariant_drift("norm")
    assert drift.max() < 5e-13


def test_a_series_drifts():
    # windows of one output each
    t = np.linspace(0.0, 400 * 60.0 / BETA, 401)
    method = lv.Chebyshev(1e-6)
    drift = lv.integrate(CHAIN, method, t=t, psi=start(), states=False).invariant_drift("norm")
    first, last = tenths(drift)
    assert last > 5 * first
    assert drift[-1] / drift[len(drift) // 2] == pytest.approx(2.0, rel=0.2)

    t = np.linspace(0.0, 2000 * 5.0 / BETA, 2001)
    splitting = lv.SchrodingerSplitting(method.tol, "stable")
    kept = lv.integrate(CHAIN, splitting, t=t, psi=start(), states=False).invariant_drift("norm")
    first, last = tenths(kept)
    assert last <= 1.2 * first + 1e-13


@pytest.mark.parametrize("stages", [6, 12])
def test_steps_near_the_limit_of_stability_stay_bounded(stages):
    for processed, part, most in ((True, 0.9, 1e-10), (False, 0.4, 0.5)):
        method = lv.StabilitySplitting(2, stages, processed)
        h = part * method.limit / BETA
        drift = lv.integrate(
            CHAIN, method, t=(0.0, 1e5 * h), steps=100_000, every=100, psi=start(), states=False
        ).invariant_drift("norm")
        first, last = tenths(drift)
        assert last <= 1.5 * first + 1e-10
        assert drift.max() < most


@pytest.mark.slow
@pytest.mark.parametrize("rung", [rung for rung in ladder() if rung.stable], ids=lambda r: r.name)
def test_every_stable_rung_is_bounded_at_any_step_it_is_made_for(rung):
    energies = np.linspace(-1.0, 1.0, 64)
    system = lv.Schrodinger(np.diag(energies), bounds=(-1.0, 1.0))
    steps = 100_000
    for fraction in rung.fractions[1::3]:
        theta = fraction * rung.theta
        t = np.linspace(0.0, steps * theta, 101)
        kappa = rung.kappa[np.searchsorted(rung.fractions, fraction)]
        roundings = ROUNDOFF * rung.gain * np.sqrt(steps)
        plan = lv.plan(system, lv.SchrodingerSplitting(0.1, "stable"), t=t)
        core = Shears(rung.coefficients, 0.0, 0.5)
        stops = tuple((float(end), steps // 100) for end in t[1:])
        forced = type(plan)(
            rung.name, None, 0.0, stops, theta, plan.bounds, steps * rung.n / 2, None, core=core
        )
        units = np.ones(64) * np.exp(1j * np.arange(64)) / 8.0
        drift = lv.integrate(system, forced, t=t, psi=units, states=False).invariant_drift("norm")
        assert drift.max() <= kappa + kappa**2 + roundings
