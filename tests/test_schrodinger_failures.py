"""Runs of wave functions that end otherwise than asked: none of them with a wrong state.

Spectra that are not what they were said to be, functions that raise, Ctrl-C; and the ways out of a
run, files and the command line.
"""

import csv
import math
import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.problems import load

PSI = np.eye(10)[0]
Splitting = lv.SchrodingerSplitting


def run(system=None, method="auto", *, function=lv.integrate, psi=PSI, t=(0.0, 1.0), **more):
    return function(system or lv.Schrodinger(lv.Lattice(10)), method, t=t, psi=psi, **more)


# --- spectra that reach out of their bounds ------------------------------------------------------

#: A band of energies, and beyond it an impurity that a state may be on or not.
SITES = 400
BAND = np.diag(np.full(SITES - 1, -1.0), 1)
BAND = BAND + BAND.T
BAND[200, 200] = 1.5
ENERGIES, VECTORS = np.linalg.eigh(BAND)


def exact(psi, t):
    return VECTORS @ (np.exp(-1j * ENERGIES * t) * (VECTORS.T @ psi))


@pytest.mark.parametrize("by_products", [False, True])
@pytest.mark.parametrize("method", ["auto", "fast", "stable", "Chebyshev", "Lanczos"])
@pytest.mark.parametrize("narrow", [1e-3, 0.01, 0.1, 0.5])
def test_bounds_that_are_too_narrow_never_give_a_wrong_state(narrow, method, by_products):
    rng = np.random.default_rng(4)
    h = (SITES, lambda x: BAND @ x) if by_products else BAND
    inside = np.where(np.abs(ENERGIES) < 0.5, rng.normal(size=SITES), 0.0)
    starts = np.eye(SITES)[200], np.eye(SITES)[0], rng.normal(size=SITES), VECTORS @ inside
    seen = set()
    middle, half = ENERGIES[[0, -1]].mean(), np.ptp(ENERGIES) / 2
    for bounds in (
        (ENERGIES[0] - 1e-3, middle + (1 - narrow) * half),
        (middle - (1 - narrow) * half, ENERGIES[-1] + 1e-3),
    ):
        for start in starts:
            psi = start / np.linalg.norm(start) * (0.6 + 0.8j)
            for tol in (1e-3, 1e-8):
                chosen = {
                    "Chebyshev": lv.Chebyshev(tol), "Lanczos": lv.Lanczos(tol),
                }.get(method) or Splitting(tol, method)  # fmt: skip
                system = lv.Schrodinger(h, bounds=bounds)
                try:
                    end = lv.integrate(system, chosen, t=(0.0, 40.0), psi=psi).psi[-1]
                except ValueError as error:
                    assert "bounds say that no energy is" in str(error)  # noqa: PT017
                    seen.add("refused")
                except lv.IntegrationError as error:
                    assert "eigenvalues outside the bounds" in str(error)  # noqa: PT017
                    seen.add("caught")
                else:
                    assert np.linalg.norm(end - exact(psi, 40.0)) <= tol
                    seen.add("fine")
    if narrow >= 0.01:
        assert "refused" in seen


def test_what_the_check_before_a_run_cannot_see_is_caught_in_it():
    seen = []  # a function that makes another matrix once the run has begun

    def product(x):
        y = -np.roll(x, 1) - np.roll(x, -1)
        if seen:
            y[7] += 40.0 * x[7]
        return y

    system = lv.Schrodinger((10**4, product), bounds=(-2.0, 2.0))
    psi = np.eye(10**4)[7]
    assert system.bounds == (-2.0, 2.0)
    seen.append("now")
    found = lv.integrate(system, lv.Chebyshev(1e-6), t=np.linspace(0, 40, 9), psi=psi)
    assert found.stats["widened"] >= 1
    assert found.invariant_drift("norm").max() < 1e-6
    for method in (Splitting(1e-6, "fast"), Splitting(1e-6, "stable")):
        with pytest.raises(lv.IntegrationError, match="failed: ") as caught:
            lv.integrate(system, method, t=np.linspace(0, 40, 9), psi=psi)
        error = caught.value
        assert "outside the bounds [-2, 2]" in str(error)
        assert np.isfinite(error.solution.psi).all()
        assert error.quantity == "norm"


def test_a_norm_that_is_off_is_shown_with_the_digits_that_differ():
    system, psi = lv.Schrodinger(lv.Lattice(50)), np.eye(50)[3]
    plan = lv.plan(system, Splitting(1e-9, "fast"), t=(0.0, 40.0), psi=psi)
    strict = replace(plan, core=replace(plan.core, norm_tol=1e-15))
    with pytest.raises(lv.IntegrationError, match="the norm is ") as caught:
        lv.integrate(system, strict, t=(0.0, 40.0), psi=psi)
    norm, before = re.search(r"the norm is (\S+) where it was (\S+)\n", str(caught.value)).groups()
    assert 1e-15 < abs(float(norm) - float(before)) < 1e-9


# --- functions that raise, and Ctrl-C ------------------------------------------------------------


class Broken(RuntimeError):
    pass


@pytest.mark.parametrize("method", ["stable", "Chebyshev", "Lanczos"])
def test_a_product_that_raises_ends_a_run_with_what_was_done(method):
    calls, last = [], [10**9]

    def product(x):
        calls.append(1)
        if len(calls) > last[0]:
            raise Broken("no more")
        return BAND @ x

    system = lv.Schrodinger((SITES, product), bounds=(-3.0, 3.0))
    chosen = {"Chebyshev": lv.Chebyshev(), "Lanczos": lv.Lanczos()}.get(method) or Splitting(
        mode=method
    )
    t, psi = np.linspace(0.0, 40.0, 21), np.eye(SITES)[0] * (1 + 0j)
    assert system.bounds == (-3.0, 3.0)
    calls.clear()
    whole = lv.integrate(system, chosen, t=t, psi=psi)
    used = len(calls)
    calls.clear()
    last[0] = used // 2
    with pytest.raises(lv.IntegrationError, match="no more") as caught:
        lv.integrate(system, chosen, t=t, psi=psi)
    error, solution = caught.value, caught.value.solution
    assert isinstance(error.__cause__, Broken)
    assert solution.status == "failed"
    # all outputs of a window of a series come at once
    assert (0 if method == "Chebyshev" else 5) < len(solution.t) < 16
    assert np.array_equal(solution.psi, whole.psi[: len(solution.t)])


@pytest.mark.parametrize("value", ["nan", "short", "none"])
def test_a_product_that_goes_wrong_in_a_run_gives_no_numbers(value):
    wrong, is_on = {"nan": np.full(SITES, math.nan), "short": np.ones(3), "none": None}[value], []
    system = lv.Schrodinger((SITES, lambda x: wrong if is_on else BAND @ x), bounds=(-3.0, 3.0))
    assert system.bounds == (-3.0, 3.0)
    is_on.append(True)
    for method in (Splitting(mode="stable"), lv.Chebyshev(), lv.Lanczos()):
        with pytest.raises((lv.IntegrationError, TypeError, ValueError)) as caught:
            lv.integrate(system, method, t=(0.0, 1.0), psi=np.eye(SITES)[0])
        if isinstance(caught.value, lv.IntegrationError):
            assert np.isfinite(caught.value.solution.psi).all()


@pytest.mark.parametrize("method", ["stable", "Chebyshev", "Lanczos", "Magnus", "SplitOperator"])
def test_ctrl_c_is_answered_in_the_middle_of_a_step(method, pressing):
    rng = np.random.default_rng(0)
    lattice = lv.Lattice((500, 500), potential=rng.normal(size=(500, 500)))
    system, more = lv.Schrodinger(lattice), {}
    chosen = {
        "stable": Splitting(1e-6, "stable"), "Chebyshev": lv.Chebyshev(1e-6),
        "Lanczos": lv.Lanczos(1e-6), "Magnus": lv.Magnus(), "SplitOperator": lv.SplitOperator(),
    }[method]  # fmt: skip
    if method == "SplitOperator":
        grid = lv.Grid((-5, -5), (5, 5), (1024, 1024), rng.normal(size=(1024, 1024)))
        system, more = lv.Schrodinger(grid), {"steps": 1000}
    if method == "Magnus":
        more = {"steps": 1000}
    psi = rng.normal(size=system.size) + 0j
    _ = system.bounds
    with pressing(0.4) as since:
        solution = run(system, chosen, psi=psi, t=(0.0, 2e4), states=False, **more)
    assert since() < 1.5
    assert solution.status == "interrupted"
    assert np.isfinite(solution.invariants["norm"]).all()


#: Methods whose members are in lock-step, or each alone, for H with a drive or without.
LONG = {
    "Chebyshev": (lv.Chebyshev(), False), "stable": (Splitting(mode="stable"), False),
    "Lanczos": (lv.Lanczos(), False), "windows": (lv.Chebyshev(), True),
    "Magnus": (lv.Magnus(), True),
}  # fmt: skip


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", LONG)
def test_ctrl_c_is_answered_in_the_middle_of_a_step_of_an_ensemble(name, threads, pressing):
    """The end of such a step is 40 s away, whichever thread makes it."""
    method, is_driven = LONG[name]
    drive = [(lambda t, params: ca.sin(t), np.arange(40_000) / 4e4)] if is_driven else []
    system = lv.Schrodinger(lv.Lattice((200, 200)), drive=drive)
    more = {"psi": np.eye(4, 40_000) + 0j, "states": False, "threads": threads}
    run(system, method, function=lv.ensemble, t=(0.0, 0.1), **more)
    plan = lv.plan(system, method, t=(0.0, 1e3))
    with pressing(0.5) as since:
        solution = run(system, plan, function=lv.ensemble, t=(0.0, 1e3), **more)
    assert since() < 0.5 * threads
    assert solution.status == "interrupted"
    assert not solution.failures
    assert solution.message == "interrupted when 0 of 4 members were over"


def interrupted(pressing, system, method, psi=(1.0, 0.0), **more):
    """Return a run in which Ctrl-C is pressed."""
    run(system, method, psi=psi, t=(0.0, 0.1), steps=2 if "h" in more else None)
    with pressing(0.5):
        return run(system, method, psi=psi, **more)


def test_a_run_of_short_steps_that_is_interrupted_has_its_last_good_step(pressing):
    drive = [(lambda t, _: ca.sin(t), np.ones((2, 2)))]
    system = lv.Schrodinger(np.diag([0.0, 1.0]), drive=drive)
    solution = interrupted(pressing, system, lv.Magnus(), t=(0.0, 1e5), h=0.01, every=10**7)
    assert solution.status == "interrupted"
    assert solution.t.size == 2
    assert solution.t[1] == pytest.approx(0.01 * solution.stats["steps"])
    assert np.isclose(np.linalg.norm(solution.psi[1]), 1.0)


def test_a_run_that_is_interrupted_before_its_first_state_says_between_which(pressing):
    psi = np.eye(1, 90_000)[0]
    system, times = lv.Schrodinger(lv.Lattice((300, 300))), (0.0, 1e5)
    solution = interrupted(pressing, system, lv.Chebyshev(), psi=psi, t=times)
    assert solution.status == "interrupted"
    assert solution.message.startswith("interrupted between t = 0 and 100000, where states are")
    assert ", t = 0, " in repr(solution)
    times = (0.0, 1e5, 2e5, 3e5)
    solution = interrupted(pressing, system, Splitting(mode="stable"), psi=psi, t=times)
    assert re.fullmatch(r"interrupted after \d+ of \d+ steps", solution.message)


# --- files and the command line ------------------------------------------------------------------


@pytest.fixture(scope="module")
def solution():
    psi = np.array([0.6 + 0j, 0.8j])[:, None] * np.eye(2, 10)
    return run(
        function=lv.ensemble, psi=psi, t=[0.0, 0.5, 1.0],
        observe={"x": np.arange(10.0), "phi": PSI * 1j},
    )  # fmt: skip


@pytest.mark.parametrize("name", ["run.nc", "run.zarr"])
def test_complex_states_come_back_bit_for_bit(solution, tmp_path, name):
    one = run(t=[0.0, 0.5, 1.0], observe={"phi": PSI * 1j})
    for each in (solution, one):
        each.save(tmp_path / name)
        loaded = lv.load(tmp_path / name)
        assert loaded.psi.dtype == complex
        assert np.array_equal(loaded.psi, each.psi)
        assert list(loaded.observed) == list(each.observed)
        for key, values in each.observed.items():
            assert loaded.observed[key].dtype == values.dtype
            assert np.array_equal(loaded.observed[key], values), key
        assert np.array_equal(loaded.invariants["norm"], each.invariants["norm"])
        assert (loaded.stats, loaded.members) == (each.stats, each.members)


def test_a_table_has_real_and_imaginary_parts(tmp_path):
    solution = run(t=[0.0, 0.5, 1.0])
    solution.save(tmp_path / "run.csv")
    with open(tmp_path / "run.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    values = [float(value) for value in rows[-1].values()]
    for part in (solution.psi[-1].real, solution.psi[-1].imag):
        assert all(x in values for x in part)
    assert solution.observed["autocorrelation"][-1].real in values


def test_the_command_line_runs_plans_and_lists_wave_functions(liouville, tmp_path):
    ran = liouville("run tight_binding --tol 1e-8 --keep 4 --out run.nc --plot run.png")
    assert ran.returncode == 0, ran.stderr
    loaded = lv.load(tmp_path / "run.nc")
    problem = load("tight_binding")
    same = lv.integrate(
        problem.system, Splitting(1e-8), t=np.linspace(*problem.interval, 5), **problem.start
    )
    assert np.array_equal(loaded.psi, same.psi)
    planned = liouville("plan tight_binding --tol 1e-8")
    assert planned.returncode == 0, planned.stderr
    assert "products H psi" in planned.stdout
    listed = liouville("problems")
    assert "walker_preston" in listed.stdout
    methods = liouville("methods")
    for name in ("schrodinger-splitting", "chebyshev", "lanczos", "split-operator", "magnus"):
        assert name in methods.stdout
    refused = liouville("run tight_binding --tol 1e-16")
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: tol must be from 1e-14")
