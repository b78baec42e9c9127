"""Wave functions: a wrong call is refused before it runs. One table, one row a mistake."""

import math

import casadi as ca
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
    return lv.plan(system, method, t=t, **more)


def entry(i, j, value):
    matrix = np.eye(4, dtype=type(value))
    matrix[i, j] = value
    return matrix


# id, the call, the exception, the message
ROWS = [
    # H
    ("lopsided", lambda: lv.Schrodinger(entry(0, 1, 0.5)), ValueError, r"H\[0, 1\] = 0.5, but H"),
    (
        "absorbing",
        lambda: lv.Schrodinger(entry(1, 1, 1 - 1j)),
        ValueError,
        "not real, where.*\nhint.*absor",
    ),
    (
        "a state too wide for all members",
        lambda: lv.ensemble(
            GRID, lv.Chebyshev(), t=(0, 1), psi=np.ones(33), params={"a": [1.0, 2.0]}
        ),
        ValueError,
        r"^psi must have shape \(32,\), not \(33,\)",
    ),
    ("H NaN", lambda: lv.Schrodinger(entry(1, 1, NAN)), ValueError, r"H\[1, 1\] must be finite"),
    (
        "sparse",
        lambda: lv.Schrodinger(sp.csr_array(entry(0, 3, INF))),
        ValueError,
        "finite, not inf",
    ),
    ("V NaN", lambda: lv.Lattice(3, potential=[0, NAN, 0]), ValueError, r"\[1\] must be finite"),
    (
        "a function's V",
        lambda: lv.Schrodinger(lv.Grid(-1, 1, 4, lambda t, x, params: 1 / x)),
        ValueError,
        r"potential is inf at t = 0 and x = 0",
    ),
    (
        "lopsided product",
        lambda: lv.Schrodinger((4, lambda x: entry(0, 1, 0.5) @ x)),
        ValueError,
        "H is not Hermitian: x . H y and y . H x differ",
    ),
    (
        "lopsided operator",
        lambda: lv.Schrodinger(
            LinearOperator((4, 4), matvec=lambda x: entry(0, 1, 0.5) @ x, dtype=float)
        ),
        ValueError,
        "H is not Hermitian",
    ),
    ("NaN product", lambda: lv.Schrodinger((2, lambda x: x * NAN)), ValueError, "returns nan"),
    (
        "drive",
        lambda: lv.Schrodinger(np.eye(2), drive=[np.eye(2)]),
        TypeError,
        r"drive\[0\] must be a",
    ),
    (
        "drive, QuTiP's order",
        lambda: lv.Schrodinger(np.eye(2), drive=[(np.eye(2), lambda t, params: t)]),
        TypeError,
        r"drive\[0\] must be a pair .*, not \(matrix, function\)\nhint: turn it round",
    ),
    (
        "complex drive",
        lambda: lv.Schrodinger(np.eye(2), drive=[(lambda t, params: ca.exp(1j * t), np.eye(2))]),
        TypeError,
        r"drive\[0\], line \d+ of .*, has complex values.*\nhint: write real and imaginary parts",
    ),
    (
        "collapse operators",
        lambda: run(c_ops=[np.eye(10, k=1)]),
        TypeError,
        "integrate takes no c_ops=\nhint: collapse operators are not taken: QuTiP's mesolve",
    ),
    (
        "a collapse operator in H",
        lambda: lv.Schrodinger(np.eye(4, k=1)),
        ValueError,
        "collapse operators are not taken: QuTiP's mesolve takes",
    ),
    (
        "a density matrix",
        lambda: run(psi=np.eye(10) / 10),
        ValueError,
        r"psi must have shape .*, not \(10, 10\)\nhint: density matrices are not stepped: QuTiP",
    ),
    ("e_ops", lambda: run(e_ops=[PSI]), TypeError, "takes no e_ops=\nhint: give observe="),
    ("single", lambda: run(dtype="f4"), TypeError, "no dtype=\nhint: states are of double"),
    # a method for the system
    ("no method", lambda: run(method="best"), TypeError, "method must be .*, not 'best'"),
    ("Spark", lambda: run(method=lv.Spark()), TypeError, "does not step Schr"),
    (
        "a class",
        lambda: run(method=lv.Chebyshev),
        TypeError,
        r"Chebyshev is a class: write lv\.Chebyshev\(\)$",
    ),
    (
        "events",
        lambda: run(events={"a": lambda t, psi, params: t}),
        TypeError,
        "events is not for .*\nhint: observe= records expectations",
    ),
    (
        "a function observed",
        lambda: run(observe={"a": lambda t, psi, params: t}),
        TypeError,
        "'a' is a function, and there is no grid .*\nhint: give a matrix A for",
    ),
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
    ("driven with h", lambda: run(DRIVEN, h=0.1), TypeError, "'auto' chooses its steps by its tol"),
    ("driven shears", lambda: run(DRIVEN, Splitting(mode="fast")), TypeError, "take 'auto'"),
    (
        "too many exponentials",
        lambda: run(DRIVEN, lv.Magnus(tol=1e-13), steps=10**4),
        ValueError,
        "30000 exponentials have roundoff above a tol of 1e-13\nhint: give a tol of 1e-11 or more",
    ),
    (
        "times and steps",
        lambda: run(GRID, lv.SplitOperator(), psi=WAVE, t=[0, 1, 2], h=0.1, steps=9),
        TypeError,
        "takes h=\nhint: leave steps out, and give h",
    ),
    (
        "parameter of each",
        lambda: lv.ensemble(
            GRID, lv.SplitOperator(), t=(0, 1), h=0.1, psi=[WAVE] * 3, params={"a": [1.0, 2.0]}
        ),
        ValueError,
        "parameter 'a' must have 3 members as psi has, not 2",
    ),
    (
        "parameter of one",
        lambda: lv.ensemble(
            GRID, lv.SplitOperator(), t=(0, 1), h=0.1, psi=WAVE, params={"a": [1.0, np.nan]}
        ),
        ValueError,
        "parameter 'a'",
    ),
    (
        "plan of each",
        lambda: lv.ensemble(
            GRID, lv.plan(GRID, "auto", t=(0, 1)), t=(0, 1), psi=WAVE, params={"a": [1.0, 2.0]}
        ),
        TypeError,
        "a plan is that of one H.*\nhint: give the method",
    ),
    ("driven Krylov", lambda: run(DRIVEN, lv.Lanczos()), TypeError, "without time\nhint: .*Magnus"),
    ("plan, then driven", lambda: run(DRIVEN, plan(STILL)), ValueError, "for an H without time"),
    (
        "driven, with an order",
        lambda: run(DRIVEN, lv.GrayManolopoulos(), steps=9),
        TypeError,
        "is for an H without time\nhint: .*Magnus",
    ),
    # tolerances and steps
    (
        "tol zero",
        lambda: Splitting(0.0),
        ValueError,
        "tol must be from 1e-14 to below 1, not 0\nhint",
    ),
    ("tol NaN", lambda: Splitting(NAN), ValueError, "tol must be from 1e-14 to below 1, not nan"),
    ("tol word", lambda: Splitting("1e-3"), TypeError, "tol must be a number"),
    (
        "tol out of reach",
        lambda: run(CHAIN, Splitting(1e-10), t=(0, 1e6)),
        ValueError,
        "out of reach.*\nhint",
    ),
    (
        "stable out of reach",
        lambda: run(t=(0, 4), method=Splitting(1e-14, "stable")),
        ValueError,
        "no stable",
    ),
    (
        "h",
        lambda: run(h=0.1),
        TypeError,
        r"chooses its steps by its tol and takes no h\nhint: the tolerance",
    ),
    ("steps", lambda: run(method=lv.Chebyshev(), steps=9), TypeError, "takes no steps\nhint"),
    ("rtol", lambda: run(rtol=1e-3), TypeError, "takes no rtol"),
    ("every", lambda: run(every=2), TypeError, "takes no every\nhint: .*linspace"),
    ("class", lambda: run(method=lv.Magnus), TypeError, r"write lv\.Magnus\(\)$"),
    (
        "times between",
        lambda: run()(0.1),
        ValueError,
        "dense output .*\nhint: of a wave give the times of all states to keep in t=$",
    ),
    ("no h", lambda: run(GRID, lv.SplitOperator(), psi=WAVE), TypeError, "give either h or steps"),
    (
        "tol",
        lambda: run(tol=1e-3),
        TypeError,
        r"integrate takes no tol=\nhint: .* give method=lv.SchrodingerSplitting\(tol=",
    ),
    (
        "tol of a pendulum",
        lambda: lv.integrate(
            load("pendulum").system, lv.Spark(), t=(0, 1), h=0.1, tol=1e-3, **load("pendulum").start
        ),
        TypeError,
        "integrate takes no tol=",
    ),
    (
        "unstable",
        lambda: run(method=lv.GrayManolopoulos(), h=9.0, t=(0, 9)),
        ValueError,
        "not stab",
    ),
    ("scheme", lambda: lv.SplitOperator("RKN5"), ValueError, "'RKN5'.*\nhint: did you mean"),
    ("mode", lambda: Splitting(mode="slow"), ValueError, "mode must be one of auto, fast, stable"),
    (
        "dimension",
        lambda: lv.Lanczos(dimension=1),
        ValueError,
        "dimension must be from 2 to 200, not 1",
    ),
    ("order", lambda: lv.Magnus(order=3), ValueError, "order must be 2, 4, 6 or 8, not 3"),
    (
        "exponentials",
        lambda: lv.Magnus(6, exponentials=4),
        ValueError,
        "exponentials must be 5 for order 6, not 4",
    ),
    ("stages", lambda: lv.StabilitySplitting(8, 2), ValueError, "no method of order 8 with 2"),
    # times
    ("no time", lambda: run(t=(1.0, 1.0)), ValueError, r"t must end at another time"),
    ("one time", lambda: run(t=[1.0]), TypeError, "a pair .* or a sequence of times, not"),
    ("unordered", lambda: run(t=[0.0, 2.0, 1.0]), ValueError, "or all fall: 2 is followed by 1"),
    ("twice", lambda: run(t=[0.0, 1.0, 1.0, 2.0]), ValueError, "or all fall: 1 is followed by 1"),
    ("NaN time", lambda: run(t=[0.0, NAN]), ValueError, "t must be a finite interval"),
    ("word time", lambda: run(t="01"), TypeError, "or a sequence of times, not '01'"),
    # starts
    ("x", lambda: lv.integrate(CHAIN, "auto", t=(0, 1), x=PSI), TypeError, "starts with psi=, not"),
    ("no psi", lambda: lv.integrate(CHAIN, "auto", t=(0, 1)), TypeError, "'psi' is missing"),
    ("psi long", lambda: run(psi=np.ones(11)), ValueError, r"shape \(10,\), not \(11,\)"),
    ("psi zero", lambda: run(psi=np.zeros(10)), ValueError, "psi is zero: there is no state"),
    ("psi NaN", lambda: run(psi=[NAN] * 10), ValueError, r"psi\[0\] must be finite"),
    ("psi word", lambda: run(psi="up"), TypeError, "psi must be an array of numbers"),
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
    ("plan and tol", lambda: many(method=plan(), tol=1e-3), TypeError, "ensemble takes no tol="),
    ("plan with h", lambda: plan(h=0.1), TypeError, r"a plan for .* takes no h="),
    ("plan with x", lambda: plan(x=PSI), TypeError, r"a plan for .* takes no x="),
    ("plan of a psi", lambda: plan(psi=np.ones(3)), ValueError, r"shape \(10,\), not \(3,\)"),
    (
        "plan of steps",
        lambda: plan(method=lv.SplitOperator()),
        TypeError,
        "leaves nothing to plan",
    ),
    ("params", lambda: run(GRID, psi=WAVE, params={"b": 1}), ValueError, "no parameter 'b'"),
    ("observe", lambda: run(observe={"x": np.ones(3)}), ValueError, "'x' must have shape"),
    ("threads", lambda: run(threads=0), ValueError, "threads must be at least 1, not 0"),
    ("states", lambda: run(states=1), TypeError, "states must be True or False, not 1"),
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


EXTREME = {
    "dense": lambda x: lv.Schrodinger(x * np.array([[0.0, 1.0], [1.0, 0.0]])),
    "complex": lambda x: lv.Schrodinger(x * np.array([[0.0, 1.0j], [-1.0j, 0.0]])),
    "diagonal": lambda x: lv.Schrodinger(np.full(300, x)),
    "chain": lambda x: lv.Schrodinger(lv.SpinChain(4, xy=x)),
    "hopping": lambda x: lv.Schrodinger(lv.Lattice(4, hopping=x)),
    "sites": lambda x: lv.Schrodinger(lv.Lattice(4, potential=[x] * 4)),
    "grid": lambda x: lv.Schrodinger(lv.Grid(-1, 1, 8, np.full(8, x))),
    "mass": lambda x: lv.Schrodinger(lv.Grid(-1, 1, 8, mass=1 / x)),
    "hbar": lambda x: lv.Schrodinger(np.eye(2), hbar=1 / x),
    "drive": lambda x: lv.Schrodinger(np.eye(2), drive=[(lambda t, params: t, np.full(2, x))]),
}


@pytest.mark.parametrize("size", [1e160, 1e307])
@pytest.mark.parametrize("make", EXTREME.values(), ids=EXTREME)
def test_energies_whose_products_overflow_are_refused(make, size):
    with pytest.raises(ValueError, match=r"of size \S+, and their .*\nhint: choose units"):
        make(size)


@pytest.mark.parametrize("size", [1e160, 1e-160])
def test_states_whose_squares_are_out_of_range_are_refused(size):
    system, t = lv.Schrodinger(np.array([[0.0, 1.0], [1.0, 0.0]])), (0.0, 1.0)
    with pytest.raises(ValueError, match=r"psi is of size 1\.0e.160, and the square"):
        lv.integrate(system, "auto", t=t, psi=[size, 0])
    with pytest.raises(ValueError, match=r"psi of member 1 is of size 1\.0e.160"):
        lv.ensemble(system, "auto", t=t, psi=[[1, 0], [0, size]])
    unit = lv.integrate(system, "auto", t=t, psi=[1, 0]).psi[-1]
    near = size ** (90 / 160)
    np.testing.assert_allclose(
        lv.integrate(system, "auto", t=t, psi=[near, 0]).psi[-1], near * unit, rtol=1e-12
    )


LONG = np.longdouble(10) ** 400 if np.finfo(np.longdouble).maxexp > 1024 else None


@pytest.mark.skipif(LONG is None, reason="the longest floats are doubles")
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: lv.Schrodinger((np.eye(4) * LONG).astype(np.clongdouble)),
            "H has numbers of size",
        ),
        (lambda: lv.Schrodinger((4, lambda x: LONG * x)), "H returns inf in place 0"),
        (lambda: lv.Schrodinger((4, lambda x: 1j * LONG * x)), r"H returns .*inf.* in place 0"),
        (lambda: run(psi=PSI * LONG), "psi is of size"),
    ],
)
def test_numbers_beyond_doubles_are_refused_by_their_size(make, words):
    with pytest.raises(ValueError, match=words) as caught:
        make()
    assert "returns" in words or f"{words} 1.0e+400, and " in str(caught.value)


def test_products_that_overflow_are_not_said_to_be_of_no_hermitian_matrix():
    def product(x):
        with np.errstate(over="ignore"):
            return 1e308 * ((x[0] - x[1]) * np.array([1.5, -1.5]) * 4)

    with pytest.raises(ValueError, match="products with H are not finite"):
        lv.Schrodinger((2, product))


def test_a_wave_that_keeps_too_much_is_told_of_what_it_takes(monkeypatch):
    monkeypatch.setattr("liouville._basics.arguments.memory", lambda: 2**24)
    system = lv.Schrodinger(lv.Lattice(10**4))
    with pytest.raises(MemoryError, match=r"fewer times in t="):
        lv.integrate(system, "auto", t=np.linspace(0, 1, 1001), psi=np.ones(10**4))


def test_a_complex_potential_is_told_without_its_numbers():
    with pytest.raises(TypeError, match="potential must be real numbers, not complex") as caught:
        lv.Grid(-1, 1, 300, potential=-1j * np.ones(300))
    assert "absorber= takes W" in str(caught.value)
    assert len(str(caught.value)) < 300
    with pytest.raises(TypeError, match="not one of str") as caught:
        lv.Grid(-1, 1, 300, potential=["a"] * 300)
    assert len(str(caught.value)) < 100
