"""Wave functions: wrong calls are refused, failures say where and why, files give back what was put.

One table, one row a mistake; then spectra that are not what they were said to be, functions that
raise, Ctrl-C, and the ways out: files and the command line. No run ends with a wrong state.
"""

import csv
import math
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator

import liouville as lv
from liouville.problems import load

NAN, INF = math.nan, math.inf
CHAIN = lv.Schrodinger(lv.Lattice(10))
GRID = lv.Schrodinger(lv.Grid(-5.0, 5.0, 32, lambda t, x, params: params.a * x**2), params={"a": 1})
DRIVEN = lv.Schrodinger(lv.Lattice(10), drive=[(lambda t, params: t, np.arange(10.0))])
STILL = lv.Schrodinger(lv.Lattice(10), bounds=DRIVEN.bounds)
LARGE = lv.Schrodinger(lv.Lattice(10**5))
FLUX = np.array([[0, 1j, -1j], [-1j, 0, 1j], [1j, -1j, 0]])
RING = lv.Schrodinger(FLUX)
PSI = np.eye(10)[0]
TWO = np.eye(10)[:2]
WAVE = np.ones(32)
Splitting = lv.SchrodingerSplitting


def run(system=CHAIN, method="auto", *, function=lv.integrate, psi=PSI, t=(0.0, 1.0), **more):
    return function(system, method, t=t, psi=psi, **more)


def many(**changes):
    return run(function=lv.ensemble, **{"psi": TWO, **changes})


def plan(system=CHAIN, method="auto", t=(0.0, 1.0), **more):
    return lv.propagation(system, method, t=t, **more)


def entry(i, j, value):
    matrix = np.eye(4, dtype=type(value))
    matrix[i, j] = value
    return matrix


# id, the call, the exception, the message
ROWS = [
    # H
    ("lopsided", lambda: lv.Schrodinger(entry(0, 1, 0.5)), ValueError, r"H\[0, 1\] = 0.5, but H"),
    ("absorbing", lambda: lv.Schrodinger(entry(1, 1, 1 - 1j)), ValueError, "not real\nhint.*absor"),
    ("H NaN", lambda: lv.Schrodinger(entry(1, 1, NAN)), ValueError, r"H\[1, 1\] is nan"),
    ("sparse", lambda: lv.Schrodinger(sp.csr_array(entry(0, 3, INF))), ValueError, "is inf"),
    ("V NaN", lambda: lv.Lattice(3, potential=[0, NAN, 0]), ValueError, r"potential\[1\] is nan"),
    (
        "a function's V",
        lambda: lv.Schrodinger(lv.Grid(-1, 1, 4, lambda t, x, params: 1 / x)),
        ValueError,
        r"potential is inf at t = 0 at x = \[0.0\]",
    ),
    (
        "lopsided product",
        lambda: lv.Schrodinger((4, lambda x: entry(0, 1, 0.5) @ x)),
        ValueError,
        "H is not symmetric: x . H y and y . H x differ",
    ),
    (
        "lopsided operator",
        lambda: lv.Schrodinger(
            LinearOperator((4, 4), matvec=lambda x: entry(0, 1, 0.5) @ x, dtype=float)
        ),
        ValueError,
        "H is not symmetric",
    ),
    ("NaN product", lambda: lv.Schrodinger((2, lambda x: x * NAN)), ValueError, "returns nan"),
    ("drive", lambda: lv.Schrodinger(np.eye(2), drive=[np.eye(2)]), TypeError, r"drive\[0\] is a"),
    # a method for the system
    ("no method", lambda: run(method="best"), TypeError, "'best' does not step Schr"),
    ("Spark", lambda: run(method=lv.Spark()), TypeError, "does not step Schr"),
    (
        "a pendulum",
        lambda: lv.integrate(
            load("pendulum").system, Splitting(), t=(0, 1), **load("pendulum").start
        ),
        TypeError,
        "does not step mechanical systems",
    ),
    (
        "grid method",
        lambda: run(method=lv.SplitOperator(), steps=10),
        TypeError,
        "SplitOperator steps a Grid.*\nhint: take SchrodingerSplitting, or Magnus",
    ),
    ("driven", lambda: run(DRIVEN), TypeError, "SchrodingerSplitting is for an H without time\nhi"),
    ("driven series", lambda: run(DRIVEN, lv.Chebyshev()), TypeError, "without time\nhint: .*Magn"),
    ("driven Krylov", lambda: run(DRIVEN, lv.Lanczos()), TypeError, "without time\nhint: .*Magnus"),
    ("driven plan", lambda: plan(DRIVEN), TypeError, "without time"),
    ("plan, then driven", lambda: run(DRIVEN, plan(STILL)), ValueError, "for an H without time"),
    (
        "driven shears",
        lambda: run(DRIVEN, lv.GrayManolopoulos(), steps=9),
        TypeError,
        "is for a real H without time\nhint: .*Magnus",
    ),
    ("flux", lambda: run(RING, Splitting(mode="fast"), psi=[1, 0, 0]), ValueError, "no gauge"),
    ("flux Magnus", lambda: run(RING, lv.Magnus(), psi=[1, 0, 0], steps=1), TypeError, "no gauge"),
    # tolerances and steps
    ("tol zero", lambda: run(tol=0.0), ValueError, "tol is from 1e-14 to below 1, not 0\nhint"),
    ("tol NaN", lambda: run(tol=NAN), ValueError, "tol is from 1e-14 to below 1, not nan"),
    ("tol word", lambda: run(tol="1e-3"), TypeError, "tol is a number"),
    ("tol out of reach", lambda: run(t=(0, 1e6), tol=1e-10), ValueError, "out of reach.*\nhint"),
    (
        "stable out of reach",
        lambda: run(method=Splitting(1e-14, "stable")),
        ValueError,
        "no stable",
    ),
    (
        "h",
        lambda: run(h=0.1),
        TypeError,
        r"chooses its steps by tol and takes no h\nhint: give tol",
    ),
    ("steps", lambda: run(method=lv.Chebyshev(), steps=9), TypeError, "takes no steps\nhint"),
    ("rtol", lambda: run(rtol=1e-3), TypeError, "takes no rtol"),
    ("every", lambda: run(every=2), TypeError, "takes no every\nhint: .*linspace"),
    ("no h", lambda: run(GRID, lv.SplitOperator(), psi=WAVE), TypeError, "give either h or steps"),
    (
        "tol of steps",
        lambda: run(GRID, lv.SplitOperator(), psi=WAVE, steps=2, tol=1e-3),
        TypeError,
        "SplitOperator takes h or steps, and no tol",
    ),
    (
        "tol of a pendulum",
        lambda: lv.integrate(
            load("pendulum").system, lv.Spark(), t=(0, 1), h=0.1, tol=1e-3, **load("pendulum").start
        ),
        TypeError,
        "tol",
    ),
    (
        "unstable",
        lambda: run(method=lv.GrayManolopoulos(), h=9.0, t=(0, 9)),
        ValueError,
        "not stab",
    ),
    ("scheme", lambda: lv.SplitOperator("RKN5"), ValueError, "'RKN5'.*\nhint: did you mean"),
    ("mode", lambda: Splitting(mode="slow"), ValueError, "mode is one of auto, fast, stable"),
    ("dimension", lambda: lv.Lanczos(dimension=1), ValueError, "dimension is from 2 to 200, not 1"),
    ("order", lambda: lv.Magnus(order=6), ValueError, "order is 2 or 4, not 6"),
    ("stages", lambda: lv.StabilitySplitting(8, 2), ValueError, "no method of order 8 with 2"),
    # times
    ("no time", lambda: run(t=(1.0, 1.0)), ValueError, r"t = \(1, 1\) is no interval"),
    ("one time", lambda: run(t=[1.0]), TypeError, "a pair .* or a sequence of times, not"),
    ("unordered", lambda: run(t=[0.0, 2.0, 1.0]), ValueError, "rise or fall: t has 2 and then 1"),
    ("twice", lambda: run(t=[0.0, 1.0, 1.0, 2.0]), ValueError, "t has 1 and then 1"),
    ("NaN time", lambda: run(t=[0.0, NAN]), ValueError, "t is a finite interval"),
    ("word time", lambda: run(t="01"), TypeError, "or a sequence of times, not '01'"),
    # starts
    ("x", lambda: lv.integrate(CHAIN, "auto", t=(0, 1), x=PSI), TypeError, "starts with psi=, not"),
    ("no psi", lambda: lv.integrate(CHAIN, "auto", t=(0, 1)), TypeError, "starts with psi=, not"),
    ("psi long", lambda: run(psi=np.ones(11)), ValueError, r"shape \(11,\), wanted \(10,\)"),
    ("psi zero", lambda: run(psi=np.zeros(10)), ValueError, "psi is zero: there is no state"),
    ("psi NaN", lambda: run(psi=[NAN] * 10), ValueError, r"psi\[0\] is nan"),
    ("psi word", lambda: run(psi="up"), TypeError, "psi is an array of numbers"),
    ("psi many", lambda: run(psi=TWO), ValueError, "hint: lv.ensemble takes many"),
    ("psi one", lambda: many(psi=PSI), ValueError, "hint: lv.integrate takes one"),
    ("member zero", lambda: many(psi=[PSI, 0 * PSI]), ValueError, "psi of member 1 is zero"),
    # plans and what else a run takes
    ("other times", lambda: run(method=plan(t=(0, 2))), ValueError, "made for other times\nhint"),
    (
        "other spectrum",
        lambda: run(lv.Schrodinger(lv.Lattice(10, 2.0)), plan()),
        ValueError,
        "made for another spectrum",
    ),
    (
        "plan of another kind",
        lambda: run(lv.Schrodinger(np.eye(3), bounds=RING.bounds), plan(RING), psi=[1, 0, 0]),
        ValueError,
        "made for a complex H\nhint",
    ),
    ("plan and h", lambda: run(method=plan(), h=0.1), TypeError, "takes no h"),
    ("plan and tol", lambda: run(method=plan(), tol=1e-3), TypeError, "a Propagation has its tol"),
    ("params", lambda: run(GRID, psi=WAVE, params={"b": 1}), ValueError, "no parameter 'b'"),
    ("observe", lambda: run(observe={"x": np.ones(3)}), ValueError, "observable 'x' has shape"),
    ("threads", lambda: run(threads=0), ValueError, "threads is at least 1, not 0"),
    ("states", lambda: run(states=1), TypeError, "states is True or False, not 1"),
    (
        "too much",
        lambda: run(LARGE, psi=np.ones(10**5), t=np.arange(1e5)),
        MemoryError,
        "(?s)states takes .* GiB.*hint",
    ),
]


@pytest.mark.parametrize(
    ("call", "error", "message"), [pytest.param(*row, id=name) for name, *row in ROWS]
)
def test_a_bad_call_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_the_right_calls_are_taken():
    assert run().status == many().status == run(method=plan()).status == "done"
    assert run(DRIVEN, lv.Magnus(), steps=3).status == "done"
    assert run(RING, psi=[1, 0, 0]).status == "done"
    assert run(GRID, lv.SplitOperator(), psi=WAVE, h=0.1).status == "done"


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
    # an impurity that a random vector does not see: no product reaches it from outside
    hidden = np.zeros(10**4)
    hidden[7] = 1.3
    seen = []

    def product(x):
        y = -np.roll(x, 1) - np.roll(x, -1)
        if seen:
            y[7] += 40.0 * x[7]
        return y

    system = lv.Schrodinger((10**4, product), bounds=(-2.0, 2.0))
    psi = np.eye(10**4)[7]
    assert system.bounds == (-2.0, 2.0)
    seen.append("now")
    for method in (Splitting(1e-6, "fast"), Splitting(1e-6, "stable"), lv.Chebyshev(1e-6)):
        with pytest.raises(lv.IntegrationError, match=r"(?s)norm|bounds") as caught:
            lv.integrate(system, method, t=np.linspace(0, 40, 9), psi=psi)
        error = caught.value
        assert "outside the bounds [-2, 2]" in str(error)
        assert np.isfinite(error.solution.psi).all()
        assert error.quantity == "norm"


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
    assert 5 < len(solution.t) < 16
    assert np.array_equal(solution.psi, whole.psi[: len(solution.t)])


@pytest.mark.parametrize("value", ["nan", "short", "none"])
def test_a_product_that_goes_wrong_in_a_run_gives_no_numbers(value):
    wrong, is_on = {"nan": np.full(SITES, NAN), "short": np.ones(3), "none": None}[value], []
    system = lv.Schrodinger((SITES, lambda x: wrong if is_on else BAND @ x), bounds=(-3.0, 3.0))
    assert system.bounds == (-3.0, 3.0)
    is_on.append(True)
    for method in (Splitting(mode="stable"), lv.Chebyshev(), lv.Lanczos()):
        with pytest.raises((lv.IntegrationError, TypeError, ValueError)) as caught:
            lv.integrate(system, method, t=(0.0, 1.0), psi=np.eye(SITES)[0])
        if isinstance(caught.value, lv.IntegrationError):
            assert np.isfinite(caught.value.solution.psi).all()


@pytest.mark.parametrize("method", ["stable", "Chebyshev", "Lanczos", "Magnus", "SplitOperator"])
def test_ctrl_c_is_answered_in_the_middle_of_a_step(method):
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
    times = []

    def press():
        times.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(1.0, press)
    timer.start()
    try:
        solution = run(system, chosen, psi=psi, t=(0.0, 2e4), states=False, **more)
    finally:
        timer.cancel()
    assert time.perf_counter() - times[0] < 1.5
    assert solution.status == "interrupted"
    assert np.isfinite(solution.invariants["norm"]).all()


# --- files and the command line ------------------------------------------------------------------


@pytest.fixture(scope="module")
def solution():
    psi = np.array([0.6 + 0j, 0.8j])[:, None] * np.eye(2, 10)
    return many(psi=psi, t=[0.0, 0.5, 1.0], observe={"x": np.arange(10.0), "phi": PSI * 1j})


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


def liouville(words, cwd):
    command = [sys.executable, "-W", "error", "-c", "from liouville.cli import main; main()"]
    env = {name: value for name, value in os.environ.items() if name not in ("FORCE_COLOR", "TERM")}
    return subprocess.run(
        [*command, *words.split()], cwd=cwd, env=env, capture_output=True, text=True, check=False
    )


def test_the_command_line_runs_plans_and_lists_wave_functions(tmp_path):
    ran = liouville("run tight_binding --tol 1e-8 --keep 4 --out run.nc --plot run.png", tmp_path)
    assert ran.returncode == 0, ran.stderr
    loaded = lv.load(tmp_path / "run.nc")
    problem = load("tight_binding")
    same = lv.integrate(
        problem.system, Splitting(1e-8), t=np.linspace(*problem.interval, 5), **problem.start
    )
    assert np.array_equal(loaded.psi, same.psi)
    planned = liouville("plan tight_binding --tol 1e-8", tmp_path)
    assert planned.returncode == 0, planned.stderr
    assert "products H psi" in planned.stdout
    listed = liouville("problems", tmp_path)
    assert "walker_preston" in listed.stdout
    methods = liouville("methods", tmp_path)
    for name in ("SchrodingerSplitting", "Chebyshev", "Lanczos", "SplitOperator", "Magnus"):
        assert name in methods.stdout
    refused = liouville("run tight_binding --tol 1e-16", tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: tol is from 1e-14")
