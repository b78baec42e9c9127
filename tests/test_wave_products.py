"""H(t) known by its products: as a sum that is found, by Magnus methods, and what is refused."""

import pickle
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from ordinary import propagated
from scipy.sparse.linalg import aslinearoperator

import liouville as lv

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import driven_products

SCHEMES = [(2, 1), (4, 2), (4, 3), (6, 5), (8, 8)]
PROBLEMS = {
    "chain": lambda: driven_products.chain(6),
    "circular": lambda: driven_products.circular(4),
    "crossing": driven_products.landau_zener,
}
H0, H1 = np.diag([0.0, 1.0, 2.5]), np.ones((3, 3))
FIRST = np.array([1.0, 0.0, 0.0])


class Counted:
    """H(t) psi of a sum of functions of time times matrices, with the number of calls."""

    def __init__(self, h0, functions):
        self.h0, self.functions, self.calls = h0, functions, 0

    def __call__(self, t, psi):
        self.calls += 1
        return self.h0 @ psi + sum(f(t) * (h @ psi) for f, h in self.functions)


def turned(t):
    """Return a real matrix that depends on time."""
    return H0 + np.cos(t) * H1


@pytest.mark.parametrize("name", PROBLEMS)
def test_runs_keep_to_their_tolerance_and_every_call_is_counted(name):
    h0, functions, drive, span, psi = PROBLEMS[name]()
    exact = lv.integrate(lv.Schrodinger(h0, drive=drive), lv.Chebyshev(1e-12), t=span, psi=psi)
    product = Counted(h0, functions)
    system = lv.Schrodinger((psi.size, product))
    for tol in (1e-3, 1e-7):
        least = 2 if tol > 1e-4 else 4
        methods = [lv.Magnus(p, tol, j) for p, j in SCHEMES if p >= least]
        for method in [lv.SchrodingerSplitting(tol), *methods]:
            plan = lv.plan(system, method, t=span)
            product.calls = 0
            solution = lv.integrate(system, plan, t=span, psi=psi)
            # and the energies at both ends
            assert solution.stats["products"] == product.calls - 2
            is_magnus = isinstance(method, lv.Magnus)
            assert is_magnus == (plan.products <= solution.stats["products"])
            assert np.linalg.norm(solution.psi[-1] - exact.psi[-1]) < tol, method
    energies = solution.observed["energy"] - exact.observed["energy"]
    assert np.abs(energies).max() < 1e-4


@pytest.mark.parametrize(
    ("x", "z", "end"), [(0.5, 1, 5), (0.5, 1, 8), (0.5, 2, 5), (1, 2, 5), (2, 1, 8), (2, 2, 5)]
)
def test_a_product_whose_weight_is_zero_is_not_counted(x, z, end):
    """It is not made: in the middle of a crossing, where rounding errors cancel."""
    h0, h1 = np.array([[0.0, x], [x, 0.0]]), np.diag([z, -z])
    product = Counted(h0, [(lambda t: t, h1)])
    system, run = lv.Schrodinger((2, product)), {"t": (-end, end)}
    plan = lv.plan(system, lv.Chebyshev(1e-6), **run)
    product.calls = 0
    solution = lv.integrate(system, plan, **run, psi=[1.0, 0.0])
    assert solution.stats["products"] == product.calls - 2  # the energies at both ends


def test_steps_of_a_size_are_those_of_the_same_drive():
    psi = FIRST + 0.5j
    driven = lv.Schrodinger(H0, drive=[(lambda t, _: ca.cos(t), H1)])
    by_products = lv.Schrodinger((3, lambda t, x: turned(t) @ x))
    for p, j in SCHEMES:
        method = lv.Magnus(p, 1e-12, j)
        ends = [
            lv.integrate(system, method, t=(0, 2), steps=20, psi=psi).psi[-1]
            for system in (driven, by_products)
        ]
        assert np.linalg.norm(ends[0] - ends[1]) < 4e-12, method


def test_operators_by_time_are_made_once_for_each_time_and_pickled_without_them():
    times = []

    def sparse(t):
        times.append(t)
        return sp.csr_array(turned(t))

    ends = []
    for made in (sparse, lambda t: aslinearoperator(turned(t)), turned):
        system = lv.Schrodinger(made, bounds=(-10.0, 10.0))
        assert system.size == 3
        ends.append(lv.integrate(system, lv.Magnus(6), t=(0, 1), steps=5, psi=FIRST).psi[-1])
    assert np.ptp(ends, axis=0).max() < 1e-13
    # one for the size, five looked at, one for each of six energies, and three nodes a step
    assert len(times) == 1 + 5 + 6 + 3 * 5
    again = pickle.loads(pickle.dumps(lv.Schrodinger(turned)))
    found = lv.integrate(again, lv.Magnus(6), t=(0, 1), steps=5, psi=FIRST).psi[-1]
    assert np.linalg.norm(found - ends[2]) < 1e-7


@pytest.mark.parametrize(
    ("values", "function"),
    [
        (lambda t: 3 * np.exp(-((t - 30) ** 2)), lambda t, _: 3 * ca.exp(-((t - 30) ** 2))),
        (lambda t: float(t > 31), lambda t, _: ca.if_else(t > 31, 1.0, 0.0)),
        (lambda t: 5 * np.exp(-(((t - 21) / 0.2) ** 2)), None),
    ],
)
def test_a_pulse_after_a_long_quiet_time_is_seen_and_a_jump_is_passed(values, function):
    function = function or (lambda t, _: 5 * ca.exp(-(((t - 21) / 0.2) ** 2)))
    driven = lv.Schrodinger(H0, drive=[(function, H1)])
    times = np.append(np.linspace(0, 33, 34), 33.5)
    exact = lv.integrate(driven, lv.Chebyshev(1e-11), t=times, psi=FIRST).psi[-1]
    system = lv.Schrodinger((3, lambda t, x: H0 @ x + values(t) * (H1 @ x)))
    for method in (lv.Magnus(4, 1e-5), lv.Magnus(6), lv.SchrodingerSplitting()):
        found = lv.integrate(system, method, t=(0.0, 33.5), psi=FIRST)
        assert np.linalg.norm(found.psi[-1] - exact) < method.tol, method


@pytest.mark.parametrize("is_back", [False, True])
@pytest.mark.parametrize("middle", [2.5, 2.501])
def test_a_pulse_too_short_to_be_found_is_seen_by_its_time(middle, is_back):
    """It lasts for a thousandth of the run, and points need not be its middle."""
    z, x = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])

    def product(t, psi):
        return z @ psi + 50 * np.exp(-(((t - 2.5) / 0.002) ** 2)) * (x @ psi)

    span, start = (5.0, 0.0) if is_back else (0.0, 5.0), np.array([1.0, 0.0])
    parts = [*span, 2.49, 2.51]
    exact = lv.integrate(
        lv.Schrodinger((2, product)),
        lv.Magnus(8, 1e-10),
        t=sorted(parts, reverse=is_back),
        psi=start,
    ).psi[-1]
    blind, seeing = lv.Schrodinger((2, product)), lv.Schrodinger((2, product), points=[middle])
    for method in ("auto", lv.Magnus(4, 1e-6), lv.SchrodingerSplitting(1e-4)):
        found = lv.integrate(seeing, method, t=span, psi=start)
        tol = getattr(method, "tol", 1e-8)
        assert np.linalg.norm(found.psi[-1] - exact) < tol
        missed = lv.integrate(blind, method, t=span, psi=start)
        assert np.linalg.norm(missed.psi[-1] - exact) > 0.1
    assert any("by its time in points=" in why for why in lv.plan(blind, t=span).reasons)
    assert any("may be 2.5 long" in why for why in lv.plan(seeing, t=span).reasons)
    again = pickle.loads(pickle.dumps(lv.Schrodinger(turned, points=[2.0, 1.0, 2.0])))
    assert again.points == again.with_params({}).points == (1.0, 2.0)


def test_points_are_times_of_an_h_that_depends_on_time():
    with pytest.raises(ValueError, match="points must be times of an H that depends on time"):
        lv.Schrodinger(H0, points=[1.0])
    for wrong in (np.nan, [[1.0]], [np.inf], [1j]):
        with pytest.raises(ValueError, match="points must be a list of times"):
            lv.Schrodinger(turned, points=wrong)


def test_bounds_that_leave_out_energies_are_moved_out_and_back_in_time_is_back():
    system = lv.Schrodinger((3, lambda t, x: turned(t) @ x), bounds=(-0.5, 0.5))
    assert lv.plan(system, t=(0, 3)).guarantee == "given"
    there = lv.integrate(system, "auto", t=(0, 3), psi=FIRST)
    exact = lv.integrate(
        lv.Schrodinger(H0, drive=[(lambda t, _: ca.cos(t), H1)]), "auto", t=(0, 3), psi=FIRST
    )
    assert np.linalg.norm(there.psi[-1] - exact.psi[-1]) < 1e-8
    back = lv.integrate(system, "auto", t=(3, 0), psi=there.psi[-1])
    assert np.linalg.norm(back.psi[-1] - FIRST) < 2e-8


@pytest.mark.parametrize(
    ("system", "method", "error", "words"),
    [
        ((3, lambda t, x: H0 @ x + 1j * t * x), "auto", ValueError, r"H\(0.5\) is not Hermitian"),
        ((3, lambda t, x: np.real(turned(t) @ x)), "auto", ValueError, r"H\(0\) is not linear"),
        ((3, lambda t, x: np.nan * x if t > 1 else x), "auto", ValueError, r"H\(1.5\) returns nan"),
        (
            (3, lambda t, x: x[:2]),
            "auto",
            ValueError,
            r"H\(0\) returns must have shape \(3,\), not \(2,\)",
        ),
        (
            lambda t: turned(t)[:2],
            "auto",
            ValueError,
            r"H\(0\) must have shape \(N, N\), not \(2, 3\)",
        ),
        (lambda t: t, "auto", TypeError, r"H\(0\) must be an operator, not float"),
        (lambda t, psi: psi, "auto", TypeError, "unknown size"),
        (
            lambda t: np.diag(np.cos(t * np.arange(8))),
            lv.Chebyshev(),
            TypeError,
            "no sum of few operators .*\nhint: take 'auto' or Magnus",
        ),
        (turned, lv.Lanczos(), TypeError, "for an H without time"),
    ],
)
def test_what_is_no_hermitian_operator_or_fits_no_method_is_refused(system, method, error, words):
    with pytest.raises(error, match=words):
        lv.integrate(system := lv.Schrodinger(system), method, t=(0, 2), psi=np.eye(system.size)[0])


def test_products_that_are_a_sum_are_found_to_be_and_their_states_are_free():
    h0, functions, drive, span, psi = driven_products.circular(4)
    system = lv.Schrodinger((psi.size, Counted(h0, functions)))
    plan = lv.plan(system, t=span)
    assert "H(t) was found to be H(t0) and 2 functions of time" in plan.reasons[0]
    assert plan.bound is None
    assert (
        plan.products < 0.2 * lv.integrate(system, lv.Magnus(6), t=span, psi=psi).stats["products"]
    )
    times = np.linspace(*span, 40)
    exact = lv.integrate(lv.Schrodinger(h0, drive=drive), lv.Chebyshev(1e-11), t=times, psi=psi)
    for tol in (1e-4, 1e-8):
        found = lv.integrate(system, lv.Chebyshev(tol), t=times, psi=psi)
        assert np.linalg.norm(found.psi - exact.psi, axis=1).max() < tol
        end = lv.integrate(system, lv.Chebyshev(tol), t=span, psi=psi)
        assert found.stats["products"] == end.stats["products"]


def test_a_long_run_is_a_sum_and_a_constant_h_is_one_product():
    driven = lv.Schrodinger(H0, drive=[(lambda t, _: ca.cos(t), H1)])
    system = lv.Schrodinger((3, lambda t, x: turned(t) @ x))
    exact = lv.integrate(driven, lv.Chebyshev(1e-11), t=(50, 200), psi=FIRST)
    found = lv.integrate(system, "auto", t=(50, 200), psi=FIRST)
    assert "1 function of time" in lv.plan(system, t=(50, 200)).reasons[0]
    assert np.linalg.norm(found.psi[-1] - exact.psi[-1]) < 1e-8
    still = lv.Schrodinger((3, lambda t, x: H1 @ x))
    found = lv.integrate(still, "auto", t=(0, 2), psi=FIRST)
    exact = lv.integrate(lv.Schrodinger(H1), "auto", t=(0, 2), psi=FIRST)
    assert np.linalg.norm(found.psi[-1] - exact.psi[-1]) < 1e-8
    assert found.stats["products"] < 30


def test_more_functions_of_time_than_are_looked_for_take_exponentials():
    rates = np.arange(8) / 2
    system = lv.Schrodinger((8, lambda t, x: np.cos(t * rates) * x))
    solution = lv.integrate(system, "auto", t=(0, 2), psi=np.ones(8))
    assert "no sum of few operators" in lv.plan(system, t=(0, 2)).reasons[0]
    phases = np.append(2.0, np.sin(2 * rates[1:]) / rates[1:])
    assert np.linalg.norm(solution.psi[-1] - np.exp(-1j * phases)) < 1e-8 * np.sqrt(8)


def test_drives_and_derivatives_beside_products_are_refused_and_an_exception_ends_a_run():
    with pytest.raises(TypeError, match="takes no drive"):
        lv.Schrodinger(turned, drive=[(lambda t, _: t, H1)])
    with pytest.raises(TypeError, match="no derivative of an H"):
        lv.vjp(lv.Schrodinger(turned), lv.Magnus(), wrt=["psi"], t=(0, 2), h=0.1, psi=FIRST)

    for late, error, words in (
        (lambda x: x[:2], ValueError, r"returns must have shape \(3,\), not \(2,\)"),
        (lambda x: 1.0, ValueError, r"returns must have shape \(3,\), not \(\)"),
        (lambda x: np.nan * x, ValueError, r"returns \(?nan"),
        (lambda x: "x", TypeError, "must return numbers for a vector, not <U1"),
    ):
        system = lv.Schrodinger((3, lambda t, x: turned(t) @ x if t != 0.7 else late(x)))  # noqa: B023
        with pytest.raises(error, match=r"H\(0.7\) " + words):
            lv.integrate(system, lv.Magnus(order=2), t=(0, 1.4), steps=1, psi=FIRST)
    other = lv.Schrodinger(lambda t: turned(t) if t != 0.7 else np.eye(2))
    with pytest.raises(ValueError, match=r"H\(0.7\) must have shape \(3, 3\).*, not \(2, 2\)"):
        lv.integrate(other, lv.Magnus(order=2), t=(0, 1.4), steps=1, psi=FIRST)

    calls = []

    def changing(x):
        calls.append(x)
        return 1j * x if len(calls) > 50 else H0 @ x

    with pytest.raises(lv.IntegrationError, match="is complex, and of another real vector was not"):
        lv.integrate(lv.Schrodinger((3, changing)), "auto", t=(0, 50), psi=FIRST)

    def product(t, x):
        if 0.6 < t < 0.9:
            raise RuntimeError("out of range")
        return turned(t) @ x

    with pytest.raises(lv.IntegrationError, match="RuntimeError: out of range"):
        lv.integrate(lv.Schrodinger((3, product)), lv.Magnus(), t=(0, 2), psi=FIRST)


@pytest.mark.parametrize("seed", [4, 28, 53])
def test_bessel_functions_that_underflow_are_no_part_of_a_series(seed):
    rng = np.random.default_rng(seed)
    h0, *parts = (m := rng.standard_normal((4, 5, 5))) + m.transpose(0, 2, 1)
    speeds, phases = rng.uniform(0.5, 12.0 if seed % 3 else 4.0, 3), rng.uniform(0.0, 6.0, 3)
    h0, parts, psi = h0 / 2, [part / (4 if seed % 2 else 2) for part in parts], np.eye(5)[0]
    waves = list(zip(speeds, phases, parts, strict=True))
    drive = [(lambda t, _, a=a, b=b: ca.cos(a * t + b), part) for a, b, part in waves]
    sum_of_parts = lv.Schrodinger(h0, drive=drive)
    exact = lv.integrate(sum_of_parts, lv.Chebyshev(1e-11), t=(0.0, 3.0), psi=psi).psi[-1]
    system = lv.Schrodinger(lambda t: h0 + sum(np.cos(a * t + b) * part for a, b, part in waves))
    for tol in (1e-6, 1e-7, 1e-8):
        found = lv.integrate(system, lv.Chebyshev(tol), t=(0.0, 3.0), psi=psi)
        assert np.linalg.norm(found.psi[-1] - exact) <= tol


@pytest.mark.parametrize("tol", [1e-3, 1e-5])
def test_kinks_of_products_are_within_the_tolerance(tol):
    """The difference of one step and its halves vanishes at some kinks by chance."""
    rng = np.random.default_rng(0)
    still, moved = ((x + x.T) / 4 for x in (rng.normal(size=(4, 4)), rng.normal(size=(4, 4))))
    psi = rng.normal(size=4) + 0j
    psi /= np.linalg.norm(psi)
    rate, end = 14.28, 3.0

    def multiply(t, x):
        return still @ x + 3.0 * abs(np.sin(rate * t)) * (moved @ x)

    wanted, before = psi, 0.0
    for time in [*np.arange(np.pi / rate, end, np.pi / rate), end]:
        wanted, before = propagated(multiply, (before, time), wanted)[-1], time
    for method in (lv.SchrodingerSplitting(tol), lv.Magnus(4, tol), lv.Magnus(6, tol)):
        run = lv.integrate(lv.Schrodinger((4, multiply)), method, t=(0, end), psi=psi)
        assert np.linalg.norm(run.psi[-1] - wanted) < tol
