"""Every wrong call is refused with a sentence that names the thing, its value, and what was wanted.

One table, one row a mistake. None of them returns numbers.
"""

import copy
import math
import pickle

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville import problems

NAN, INF = math.nan, math.inf


def kinetic(t, q, v, params):
    return ca.dot(v, v) / 2


def weighted(t, q, v, params):
    return params.m * ca.dot(v, v) / 2 - params.m * params.g * q[1]


def rod(t, q, params):
    return {"rod": (ca.dot(q, q) - 1) / 2}


def system(lagrangian=weighted, constraint=rod, **changes):
    """Build a planar pendulum, with something changed."""
    return lv.Lagrangian(
        lagrangian, constraint, **{"q": ("x", "y"), "params": {"m": 1.0, "g": 9.81}, **changes}
    )


def general(**changes):
    """Build the same as a general system, with something changed."""
    functions = {
        "velocity": lambda t, y, z, params: z,
        "momentum": lambda t, y, z, params: z,
        "force": lambda t, y, z, params: [0, -9.81],
        "constraint": lambda t, y, params: {"rod": (ca.dot(y, y) - 1) / 2},
    }
    return lv.Mechanical(y=("x", "y"), **{**functions, **changes})


PENDULUM = system()
OSCILLATOR = lv.Hamiltonian(lambda t, q, p, params: p[0] ** 2 + q[0] ** 2, q=1)
MOVING_WALL = system(constraint=lambda t, q, params: {"wall": q[0] - ca.sin(t)})


def run(model=PENDULUM, method=lv.Spark(3), **changes):  # noqa: B008
    """Swing the pendulum from rest for one second, with something changed."""
    call = {"t": (0.0, 1.0), "h": 0.01, "q": [1.0, 0.0], "v": [0.0, 0.0], **changes}
    return lv.integrate(model, method, **call)


def many(method=lv.Spark(3), **changes):  # noqa: B008
    """Swing it as two members of an ensemble, with something changed."""
    call = {"t": (0.0, 1.0), "h": 0.1, "q": [[1.0, 0.0]] * 2, "v": [0.0, 0.0], **changes}
    return lv.ensemble(PENDULUM, method, **call)


def damped(model=PENDULUM, **changes):
    """Swing it with controlled steps of a damping method, with something changed."""
    return run(model, lv.HHT(), **{"h": None, "rtol": 1e-3, **changes})


def reversible(monitor=None, **changes):
    """Swing it with reversible steps, with something changed."""
    return run(**{"control": lv.Reversible(monitor), **changes})


def composed(**changes):
    return run(method=lv.Composition(lv.Spark(1), "SU4"), **{"h": None, **changes})


def second(t, q, v, params):
    return q


def project(model=PENDULUM, **changes):
    return model.consistent(**{"q": [1.0, 0.1], "v": [0.0, 0.0], **changes})


def returns(value):
    return lambda *args: value


def observe(function):
    return run(observe={"speed": function})


STRANGER = ca.SX.sym("stranger")
TABLE = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [1.0, 3.0, 2.0])

# id, the call, the exception, the message
ROWS = [
    # coordinates and parameters
    ("no coordinates", lambda: system(q=()), ValueError, r"q needs at least one name.*\(\)"),
    ("zero coordinates", lambda: system(q=0), ValueError, "at least one coordinate, not q=0"),
    ("fewer than zero", lambda: system(q=-2), ValueError, "at least one coordinate, not q=-2"),
    ("half a coordinate", lambda: system(q=2.5), TypeError, "sequence of names or a number.*2.5"),
    ("one string", lambda: system(q="xy"), TypeError, "q must be a sequence of names.*not 'xy'"),
    ("a set of names", lambda: system(q={"x"}), TypeError, "q must be a sequence of names.*{'x'}"),
    ("a number as name", lambda: system(q=("x", 1)), ValueError, r"each a string: \('x', 1\)"),
    ("a name twice", lambda: system(q=("x", "x")), ValueError, "q names 'x' twice"),
    (
        "params a list",
        lambda: system(params=[1]),
        TypeError,
        r"params must be a mapping.*not \[1\]",
    ),
    ("param not a name", lambda: system(params={"2m": 1}), ValueError, "identifier.*not '2m'"),
    ("param a keyword", lambda: system(params={"lambda": 1}), ValueError, "no keyword.*'lambda'"),
    ("param numbered", lambda: system(params={0: 1}), TypeError, "nonempty strings, not 0"),
    (
        "param NaN",
        lambda: system(params={"m": NAN}),
        ValueError,
        "parameter 'm' must be finite, not nan",
    ),
    ("param NaN of NumPy", lambda: system(params={"m": np.float64(NAN)}), ValueError, "not nan$"),
    (
        "params NaN",
        lambda: system(params={"m": np.array([1, NAN])}),
        ValueError,
        r"^parameter 'm\[1\]' must be finite, not nan$",
    ),
    (
        "param too large",
        lambda: system(params={"m": 10**400}),
        ValueError,
        "must be finite, not inf$",
    ),
    ("param a string", lambda: system(params={"m": "1"}), ValueError, "'m' must be a number.*'1'"),
    ("param empty", lambda: system(params={"m": []}), ValueError, r"'m' must be a number.*\[\]"),
    ("param 2-D", lambda: system(params={"m": [[1]]}), ValueError, r"'m'.*1-D array.*\[\[1\]\]"),
    ("param ragged", lambda: system(params={"m": [[1], 2]}), ValueError, r"'m'.*\[\[1\], 2\]"),
    ("param unknown", lambda: system(params={"m": 1}), AttributeError, "no parameter 'g'.*: m"),
    # the Lagrangian and its forces
    ("L no function", lambda: system(3.0), TypeError, "lagrangian must be a function, not 3.0"),
    ("L None", lambda: system(returns(None)), TypeError, "lagrangian returns None.*`return`"),
    ("L a vector", lambda: system(lambda t, q, v, params: v), ValueError, "a scalar, not 2 values"),
    ("L a list", lambda: system(returns([1, 2])), ValueError, "must return a scalar, not 2 values"),
    ("L empty", lambda: system(returns([])), ValueError, "must return a scalar, not 0 values"),
    ("L a string", lambda: system(returns("v")), TypeError, "lagrangian must return .* not a str"),
    ("L a NumPy string", lambda: system(returns(np.str_("v"))), TypeError, "numbers, not a str_"),
    (
        "L complex",
        lambda: system(returns(1j)),
        TypeError,
        "lagrangian must return .*, not a complex",
    ),
    (
        "L a dict",
        lambda: system(returns({"T": 1})),
        TypeError,
        "lagrangian must return .*, not a dict",
    ),
    ("L a set", lambda: system(returns({1})), TypeError, "lagrangian must return .*, not a set"),
    (
        "L an MX",
        lambda: system(returns(ca.MX.sym("x"))),
        TypeError,
        "return CasADi's SX or numbers, not a MX",
    ),
    ("L a stranger", lambda: system(returns(STRANGER)), ValueError, "not its arguments: stranger"),
    ("L through math", lambda: system(lambda t, q, v, params: math.sin(q[0])), ValueError, "nan"),
    (
        "L off the tape",
        lambda: system(lambda t, q, v, params: ca.erf(q[0]) + ca.dot(v, v)),
        ValueError,
        "lagrangian uses the operation 'erf'.*no place on a tape\nhint: a tape takes .* if_else",
    ),
    (
        "L of a table of CasADi's",
        lambda: system(lambda t, q, v, params: TABLE(q[0])),
        ValueError,
        r"'call', which has no place on a tape\nhint: .*ca\.pw_lin.*np\.interp",
    ),
    (
        "L branches",
        lambda: system(lambda t, q, v, params: 1 if q[0] > 0 else 2),
        TypeError,
        r"lagrangian, line \d+ of test_bad_calls\.py, asks whether.* is true.*\n.*ca\.if_else",
    ),
    (
        "L by a name",
        lambda: system(lambda t, q, v, params: v.x**2),
        AttributeError,
        r"lagrangian, line \d+ of .*, asks for v\.x, and .*no names\nhint: .*v\[0\]",
    ),
    (
        "L by a method",
        lambda: system(lambda t, q, v, params: (v[0] ** 2).sum()),
        AttributeError,
        r"lagrangian, line \d+ of .*, asks for \.sum of an expression\nhint: .*ca\.",
    ),
    (
        "L of two arguments",
        lambda: system(lambda q, v: 0),
        TypeError,
        r"lagrangian is called with \(t, q, v, params\), and the function .* takes \(q, v\)\nhint",
    ),
    (
        "L beyond q",
        lambda: system(lambda t, q, v, params: q[7]),
        ValueError,
        r"lagrangian, line \d+ of test_bad_calls.py, reads q\[7\], and q has 2 comp.*\nhint: .* 1$",
    ),
    (
        "L beyond a slice",
        lambda: system(lambda t, q, v, params: ca.sum1((2 * v)[0:3])),
        ValueError,
        r"reads \[0:3\] of a vector, and it has 2 components",
    ),
    (
        "force beyond a parameter",
        lambda: system(force=lambda t, q, v, params: [params.m[1], 0]),
        ValueError,
        r"force, .* reads params\.m\[1\], and params\.m has 1 component\nhint: params\.m\[0\] is",
    ),
    (
        "observed beyond v",
        lambda: observe(lambda t, q, v, params: v[-3]),
        ValueError,
        r"observed 'speed', .* reads v\[-3\], and v has 2 components",
    ),
    (
        "field beyond x",
        lambda: lv.PolynomialField(lambda t, x, params: [x[1], x[2]], x=2),
        ValueError,
        r"field, .* reads x\[2\], and x has 2 components",
    ),
    (
        "q by name",
        lambda: system(force=lambda t, q, v, params: q["x"]),
        TypeError,
        r"q\['x'\].* 2 c",
    ),
    (
        "q one by one",
        lambda: system(force=lambda t, q, v, params: [2 * x for x in q]),
        TypeError,
        r"force, .* iterates over q of CasADi's\nhint: write `for k in range\(2\)`, and q\[k\]",
    ),
    (
        "sizes that do not fit",
        lambda: system(force=lambda t, q, v, params: q + ca.vertcat(1, 2, 3)),
        ValueError,
        "force, .* do not match: Dimension mismatch.*2x1.*3x1\nhint: there are t of 1x1, q",
    ),
    (
        "force too long",
        lambda: system(force=returns([0] * 3)),
        ValueError,
        "must return 2 val.*not 3",
    ),
    ("force None", lambda: system(force=returns(None)), TypeError, "force returns None"),
    (
        "H no function",
        lambda: lv.Hamiltonian(None, q=1),
        TypeError,
        "hamiltonian must be a function, not None",
    ),
    (
        "invariants a list",
        lambda: system(invariants=[kinetic]),
        TypeError,
        "invariants must be a map",
    ),
    (
        "invariant unnamed",
        lambda: system(invariants={1: kinetic}),
        TypeError,
        "nonempty strings, not 1",
    ),
    (
        "invariant the energy",
        lambda: system(invariants={"energy": kinetic}),
        ValueError,
        "invariant 'energy' is the system's own, .*\nhint: .* another name",
    ),
    (
        "invariant H",
        lambda: lv.Hamiltonian(lambda t, q, p, params: p[0] ** 2, q=1, invariants={"energy": abs}),
        ValueError,
        "invariant 'energy' is the system's own",
    ),
    (
        "invariant a vector",
        lambda: system(invariants={"L": lambda t, q, v, params: q}),
        ValueError,
        "invariant 'L' must return a scalar, not 2 values",
    ),
    # constraints
    (
        "g no function",
        lambda: system(constraint="q"),
        TypeError,
        "constraint must be a function.*'q'",
    ),
    ("g None", lambda: system(constraint=returns(None)), TypeError, "constraint returns None"),
    (
        "g of velocities",
        lambda: system(constraint=kinetic),
        TypeError,
        r"constraint is called with \(t, q, params\), and .* takes \(t, q, v, params\)",
    ),
    (
        "g a vector by name",
        lambda: system(constraint=lambda t, q, params: {"rod": q}),
        ValueError,
        "constraint 'rod' must return a scalar, not 2 values",
    ),
    (
        "g numbered",
        lambda: system(constraint=lambda t, q, params: {1: q[0]}),
        TypeError,
        "nonempty strings, not 1",
    ),
    (
        "g a comparison",
        lambda: system(constraint=lambda t, q, params: {"rod": q[0] == 1}),
        ValueError,
        "'rod' is the same for all coordinates: it jumps, as a comparison does",
    ),
    (
        "g of time alone",
        lambda: system(constraint=lambda t, q, params: {"clock": t}),
        ValueError,
        "'clock' is the same for all coordinates: none of them is in it",
    ),
    (
        "g a number",
        lambda: system(constraint=lambda t, q, params: [q[0], 0]),
        ValueError,
        "'constraint1' is the same for all coordinates: it is the number 0",
    ),
    # the general system
    (
        "p missing",
        lambda: lv.Mechanical(velocity=kinetic, force=kinetic, y=2),
        TypeError,
        "missing.*'momentum'",
    ),
    (
        "v too short",
        lambda: general(velocity=returns([0])),
        ValueError,
        "velocity must return 2 values, not 1",
    ),
    (
        "r too short",
        lambda: general(reaction=returns([0])),
        ValueError,
        "reaction must return 2 values, not 1",
    ),
    (
        "r without lam",
        lambda: general(reaction=lambda t, y, lam, params: y),
        ValueError,
        "reaction does not depend on the multiplier of 'rod'",
    ),
    # the method
    ("s zero", lambda: lv.Spark(0), ValueError, "stages must be from 1 to 64, not 0"),
    (
        "s a million",
        lambda: lv.Spark(10**6),
        ValueError,
        "stages must be from 1 to 64, not 1000000",
    ),
    ("s fractional", lambda: lv.Spark(2.0), TypeError, "stages must be an integer, not 2.0"),
    ("s a bool", lambda: lv.Spark(True), TypeError, "stages must be an integer, not True"),
    ("solver", lambda: lv.Spark(2, "fast"), ValueError, "node-schur, newton, not 'fast'"),
    ("newton_tol 0", lambda: lv.Spark(2, newton_tol=0.0), ValueError, "above 0 and at most 0.01"),
    ("newton_tol nan", lambda: lv.Spark(2, newton_tol=float("nan")), ValueError, "not nan"),
    ("newton_tol text", lambda: lv.LobattoPair(2, newton_tol="1e-8"), TypeError, "float or None"),
    ("a method's name", lambda: run(method="sparc"), TypeError, "method must be .*not 'sparc'"),
    ("another's", lambda: run(method="magnus"), TypeError, "Magnus.* does not step.*: Spark"),
    (
        "t by its place",
        lambda: lv.integrate(system(), lv.Spark(), (0, 1), h=0.1),
        TypeError,
        r"takes system and method by their places, not \(0, 1\)\nhint: write t=\(0, 1\)",
    ),
    ("start twice", lambda: run(start={"q": [0, -1]}), TypeError, "'q' is given twice"),
    ("start no mapping", lambda: run(start=[0, -1]), TypeError, "start must be a mapping of names"),
    ("system a function", lambda: run(kinetic), TypeError, "system must be a Lagrangian.*kinetic"),
    ("system None", lambda: run(None), TypeError, "system must be a Lagrangian.*not None"),
    ("alpha above 0", lambda: lv.HHT(0.1), ValueError, "-1/3 to 0, not 0.1: above 0.*unstable"),
    ("alpha below", lambda: lv.HHT(-0.4), ValueError, "not -0.4:.*damps fast oscillations less"),
    ("alpha NaN", lambda: lv.HHT(NAN), ValueError, "alpha must be from -1/3 to 0, not nan"),
    ("alpha a string", lambda: lv.HHT("-0.1"), TypeError, "alpha must be a number, not '-0.1'"),
    ("b one half", lambda: lv.HHT(b=0.5), ValueError, "from 1/2, not 0.5:.*dependent"),
    ("b near it", lambda: lv.GeneralizedAlpha(b=0.497), ValueError, "from 1/2, not 0.497"),
    ("b infinite", lambda: lv.HHT(b=INF), ValueError, "b must be finite, not inf"),
    ("less a number", lambda: lv.HHT(less_implicit=1), TypeError, "True or False, not 1"),
    (
        "rho above 1",
        lambda: lv.GeneralizedAlpha(1.1),
        ValueError,
        "rho must be from 0 to 1, not 1.1",
    ),
    ("rho below 0", lambda: lv.ArnoldBruls(-0.1), ValueError, "rho must be from 0 to 1, not -0.1"),
    (
        "momentum not linear",
        lambda: damped(system(lambda t, q, v, params: ca.dot(v, v) ** 2 + ca.dot(v, v), None)),
        TypeError,
        "not linear in its velocity.*\nhint: take Spark",
    ),
    (
        "velocity not z",
        lambda: lv.integrate(OSCILLATOR, lv.HHT(), t=(0, 1), h=0.1, q=[1], p=[0]),
        TypeError,
        "velocity of this system is not its z.*\nhint: write the system as a Lagrangian",
    ),
    # controlled steps
    ("rtol of steps", lambda: composed(rtol=1e-3), TypeError, "does not estimate.*\nhint: give h"),
    (
        "h_min alone",
        lambda: run(h_min=1e-3),
        TypeError,
        r"takes no h_min=\nhint: give control=lv.Adaptive\(h_min=",
    ),
    (
        "control alone",
        lambda: damped(rtol=None, control=lv.Adaptive()),
        TypeError,
        r"Adaptive\(...\) takes rtol",
    ),
    (
        "no such control",
        lambda: run(control="pid"),
        TypeError,
        "control must be an Adaptive or a Reversible, not 'pid'\nhint: give control=",
    ),
    (
        "control by its old name",
        lambda: run(control="reversible"),
        TypeError,
        r"'reversible'\nhint: give control=lv.Reversible\(",
    ),
    ("control, no instance", lambda: run(control=lv.Adaptive), TypeError, "not <class"),
    ("not symmetric", lambda: reversible(method=lv.HHT()), TypeError, "HHT is not symm.*\nhint"),
    (
        "reversible rtol",
        lambda: reversible(rtol=1e-3),
        TypeError,
        r"Reversible\(...\) takes no rtol",
    ),
    (
        "reversible atol",
        lambda: reversible(atol=1e-3),
        TypeError,
        r"Reversible\(...\) takes no atol",
    ),
    ("reversible steps", lambda: reversible(steps=9), TypeError, "either steps, .*=Reversible"),
    ("reversible, no h", lambda: reversible(h=None), TypeError, "takes h, the step at the start"),
    ("monitor", lambda: run(monitor=abs), TypeError, r"hint: give control=lv.Reversible\(monit"),
    ("checkpoint", lambda: run(checkpoint=9), TypeError, r"hint: give lv.Store\(path, checkpoint="),
    ("many rtol", lambda: many(rtol=1e-3), TypeError, "ensemble takes no rtol=\nhint: its memb"),
    (
        "many t_eval",
        lambda: many(t_eval=[9e9]),
        ValueError,
        "t_eval must be within .*, not 9000000000$",
    ),
    (
        "many events",
        lambda: many(events=[abs]),
        TypeError,
        "events must be a mapping of names, not ",
    ),
    (
        "times",
        lambda: run(t=np.linspace(0, 1, 5)),
        TypeError,
        r"not 5 times\nhint: .*t_eval= takes the times",
    ),
    ("many times", lambda: many(t=[0, 1, 2]), TypeError, r"not 3 times\nhint: .*t_eval="),
    ("many, no h", lambda: many(h=None), TypeError, "give either h or steps$"),
    ("dt", lambda: run(h=None, dt=0.1), TypeError, "takes no dt=\nhint: give h=, the step size"),
    (
        "monitor of 2",
        lambda: reversible(monitor=second),
        ValueError,
        "monitor must return a scalar",
    ),
    (
        "monitor no function",
        lambda: reversible(monitor=1.0),
        TypeError,
        "monitor must be a function",
    ),
    ("no h nor rtol", lambda: damped(rtol=None), TypeError, "either h or steps, or rtol"),
    ("rtol and steps", lambda: damped(steps=10), TypeError, "either steps, which are equal, or"),
    ("atol alone", lambda: damped(rtol=None, h=0.1, atol=1), TypeError, "atol is for.*\nhint"),
    ("rtol zero", lambda: damped(rtol=0), ValueError, "rtol must be from 1e-12 to below 1, not 0"),
    ("rtol too small", lambda: damped(rtol=1e-13), ValueError, "to below 1, not 1e-13"),
    ("rtol one", lambda: damped(rtol=1), ValueError, "rtol must be from 1e-12 to below 1, not 1"),
    ("rtol NaN", lambda: damped(rtol=NAN), ValueError, "to below 1, not nan"),
    ("rtol a string", lambda: damped(rtol="1e-3"), TypeError, "rtol must be a number, not '1e-3'"),
    (
        "atol zero",
        lambda: damped(atol=[1, 0]),
        ValueError,
        "atol must be positive.*0 for 'y'\nhint",
    ),
    ("atol NaN", lambda: damped(atol=NAN), ValueError, "positive and finite, not nan for 'x'"),
    (
        "atol too long",
        lambda: damped(atol=[1] * 3),
        ValueError,
        r"shape \(\) or \(2,\), not \(3,\)",
    ),
    ("atol ragged", lambda: damped(atol=[[1], 2]), TypeError, "atol must be a number or an array"),
    ("atol a bool", lambda: damped(atol=True), TypeError, "atol must be a number.*not True"),
    (
        "h_min",
        lambda: damped(control=lv.Adaptive(2.0)),
        ValueError,
        "h_min = 2 is larger than the interval, 1",
    ),
    (
        "h_min zero",
        lambda: damped(control=lv.Adaptive(0)),
        ValueError,
        "h_min must be positive and finite, not 0",
    ),
    (
        "h_min above h",
        lambda: damped(h=0.1, control=lv.Adaptive(0.2)),
        ValueError,
        "h_min = 0.2 is larger than",
    ),
    (
        "h_min lost in t",
        lambda: damped(t=(0, 1e9), control=lv.Adaptive(1e-9)),
        ValueError,
        r"a step of 1e-09 does not move t = 1e\+09",
    ),
    # time and steps
    ("h negative", lambda: run(h=-0.1), ValueError, r"(?s)positive.*not -0\.1.*t=\(end, start\)"),
    ("h zero", lambda: run(h=0), ValueError, "h must be positive and finite, not 0"),
    ("h NaN", lambda: run(h=NAN), ValueError, "h must be positive and finite, not nan"),
    ("h infinite", lambda: run(h=INF), ValueError, "h must be positive and finite, not inf"),
    ("h a string", lambda: run(h="0.1"), TypeError, "h must be a number, not '0.1'"),
    ("h an array", lambda: run(h=np.array([0.1])), TypeError, r"h must be a number, not array"),
    ("h a bool", lambda: run(h=True), TypeError, "h must be a number, not True"),
    ("h tiny", lambda: run(h=1e-300), ValueError, "h = 1e-300: more than 9e.15 steps"),
    ("h below an ulp", lambda: run(t=(1e17, 2e17), h=1.0), ValueError, "h = 1: more than"),
    (
        "h lost in t",
        lambda: run(t=(1e9, 1e9 + 1e-6), h=1e-8),
        ValueError,
        r"a step of .*e-09 does not move t = 1e\+09",
    ),
    ("class", lambda: run(method=lv.Spark), TypeError, r"Spark is a class: write lv\.Spark\(\)$"),
    ("word", lambda: run(method="Spark"), TypeError, r"'Spark' is a word: write lv\.Spark\(\)$"),
    ("Composition", lambda: run(method=lv.Composition), TypeError, r"lv\.Composition\(\.\.\.\)$"),
    ("many, class", lambda: many(method=lv.HHT), TypeError, r"HHT is a class: write lv\.HHT\(\)$"),
    ("h missing", lambda: run(h=None), TypeError, "give either h or steps"),
    ("h and steps", lambda: run(steps=10), TypeError, "give either h or steps"),
    ("steps zero", lambda: run(h=None, steps=0), ValueError, "steps must be at least 1, not 0"),
    (
        "steps a float",
        lambda: run(h=None, steps=9.0),
        TypeError,
        "steps must be an integer, not 9.0",
    ),
    (
        "steps a bool",
        lambda: run(h=None, steps=True),
        TypeError,
        "steps must be an integer, not True",
    ),
    ("steps too many", lambda: run(h=None, steps=10**400), ValueError, "steps: more than 9e"),
    (
        "steps beyond memory",
        lambda: run(h=None, steps=10**13),
        MemoryError,
        r"(?s)keeping 10000000000001 states takes \d+ GiB.*every=.*states=False",
    ),
    ("every zero", lambda: run(every=0), ValueError, "every must be at least 1, not 0"),
    ("every a float", lambda: run(every=2.0), TypeError, "every must be an integer, not 2.0"),
    ("t a number", lambda: run(t=1.0), TypeError, r"t must be a pair \(start, end\), not 1.0"),
    ("t a set", lambda: run(t={0, 1}), TypeError, r"a pair.*not \{0, 1\}"),
    ("t times", lambda: run(t=[0, 1, 2]), TypeError, r"\(start, end\), not .*\nhint: .*t_eval="),
    ("t strings", lambda: run(t=("0", "1")), TypeError, "the start of t must be a number, not '0'"),
    (
        "t of two members",
        lambda: run(t=(0, (0, 1))),
        TypeError,
        r"the end of t must be a number, not \(0, 1\)",
    ),
    (
        "t empty",
        lambda: run(t=(1, 1)),
        ValueError,
        r"t must end at another time than it starts, not \(1, 1\)",
    ),
    ("t endless", lambda: run(t=(0, INF)), ValueError, r"finite interval, not \(0, inf\)"),
    ("t NaN", lambda: run(t=(NAN, 1)), ValueError, r"finite interval, not \(nan, 1\)"),
    (
        "t too short",
        lambda: run(t=(0, 1e-300), h=None, steps=1),
        ValueError,
        r"t = \(0, 1e-300\) is too short: .* 1e-130 long at least\nhint: take another unit",
    ),
    ("t too long", lambda: run(t=(-1.7e308, 1.7e308)), ValueError, "finite interval"),
    ("t missing", lambda: lv.integrate(PENDULUM, lv.Spark(3), h=0.1), TypeError, "argument: 't'"),
    # start values
    (
        "v missing",
        lambda: lv.integrate(PENDULUM, lv.Spark(3), t=(0, 1), h=0.1, q=[1, 0]),
        TypeError,
        "'v' is missing: this system takes q= and v=",
    ),
    ("p for v", lambda: run(p=[0, 0]), TypeError, "'p' is no start value.* q= and v="),
    ("an unknown option", lambda: run(accuracy=1e-3), TypeError, "'accuracy' is no start value"),
    ("a for Spark", lambda: run(a=[0, 0]), TypeError, "'a' is no start value"),
    ("a too long", lambda: damped(a=[0]), ValueError, r"a must have shape \(2,\), not \(1,\)"),
    ("q too long", lambda: run(q=[1, 0, 0]), ValueError, r"q must have shape \(2,\), not \(3,\)"),
    ("q a row", lambda: run(q=[[1.0, 0.0]]), ValueError, r"q must have shape \(2,\), not \(1, 2\)"),
    ("q ragged", lambda: run(q=[[1.0], 0.0]), TypeError, r"real numbers, not \[\[1\.0\], 0\.0\]"),
    ("q NaN", lambda: run(q=[NAN, 0]), ValueError, "q of 'x' must be finite, not nan"),
    ("v infinite", lambda: run(v=[0, INF]), ValueError, "v of 'y' must be finite, not inf"),
    (
        "q complex",
        lambda: run(q=[1j, 0]),
        TypeError,
        r"q must be an array of real numbers, not \[1j",
    ),
    ("q of strings", lambda: run(q=["1", "0"]), TypeError, "real numbers, not.*'1'"),
    ("q symbolic", lambda: run(q=ca.SX.sym("q", 2)), TypeError, "real numbers, not SX"),
    ("q None", lambda: run(q=None), TypeError, "q must be an array of real numbers, not None"),
    (
        "q masked",
        lambda: run(q=np.ma.masked_equal([1.0, 0.0], 0.0)),
        TypeError,
        "q must be an array of real numbers, not masked_array",
    ),
    (
        "q by wrong names",
        lambda: run(q={"x": 1, "z": 0}),
        ValueError,
        r"q must name x, y, not x, z",
    ),
    (
        "q by name, NaN",
        lambda: run(q={"x": 1, "y": NAN}),
        ValueError,
        "q of 'y' must be finite, not nan",
    ),
    (
        "g violated",
        lambda: run(q=[1.1, 0]),
        ValueError,
        r"(?s)the constraint 'rod': \|g\(q\)\| = 1\.\de-01 at t = 0, and at most.*\.consistent\(q=",
    ),
    (
        "hidden constraint violated",
        lambda: run(v=[1, 0]),
        ValueError,
        r"(?s)hidden constraint 'rod': \|g_t \+ g_q v\| = 1\.0e\+00.*\.consistent\(q=..., v=",
    ),
    (
        "a moving wall left behind",
        lambda: run(MOVING_WALL, t=(3, 4), q=[0, 0]),
        ValueError,
        "the constraint 'wall'.*1.4e-01 at t = 3",
    ),
    (
        "g of the start NaN",
        lambda: run(system(constraint=lambda t, q, params: {"log": ca.log(q[0])}), q=[-1, 0]),
        ValueError,
        "constraint 'log' is nan at the start, t = 0",
    ),
    (
        "gradient of the start NaN",
        lambda: run(system(constraint=lambda t, q, params: {"rod": ca.norm_2(q)}), q=[0, 0]),
        ValueError,
        "constraint 'rod' has no finite derivative at the start, t = 0",
    ),
    (
        "massless",
        lambda: run(system(lambda t, q, v, params: v[0] ** 2, None)),
        lv.IntegrationError,
        "(?s)start at t = 0.*mass matrix is singular.*'y' has no inertia.*give 'y' a mass",
    ),
    (
        "contradicting",
        lambda: run(system(constraint=lambda t, q, params: {"a": q[1], "b": 2 * q[1] - 1e-3})),
        ValueError,
        "start violates the constraint 'b'",
    ),
    (
        "without gradient",
        lambda: run(system(constraint=lambda t, q, params: {"double": q[1] ** 2})),
        lv.IntegrationError,
        "start at t = 0.*gradient of constraint 'double' vanishes",
    ),
    (
        "velocity without z",
        lambda: lv.integrate(
            general(velocity=returns([0, 0])), lv.Spark(1), t=(0, 1), h=1, y=[1, 0], z=[0, 0]
        ),
        lv.IntegrationError,
        "(?s)start at t = 0.*singular.*velocity",
    ),
    (
        "energy NaN",
        lambda: run(system(lambda t, q, v, params: ca.dot(v, v) + ca.log(q[1] - 1))),
        lv.IntegrationError,
        "start at t = 0.*invariant 'energy' is not finite",
    ),
    # parameters, observables and options of a run
    ("run params a list", lambda: run(params=[1]), TypeError, r"params must be a mapping.*\[1\]"),
    ("run param unknown", lambda: run(params={"M": 1}), ValueError, "no parameter 'M'.*: m, g"),
    (
        "run param NaN",
        lambda: run(params={"g": NAN}),
        ValueError,
        "parameter 'g' must be finite, not nan",
    ),
    ("run param a bool", lambda: run(params={"g": True}), ValueError, "'g' must be a number.*True"),
    (
        "run param longer",
        lambda: run(params={"g": [9, 8]}),
        ValueError,
        r"'g' must have shape \(\), not \(2,\)",
    ),
    (
        "observe a function",
        lambda: run(observe=kinetic),
        TypeError,
        "observe must be a mapping of names",
    ),
    ("observe unnamed", lambda: run(observe={1: kinetic}), TypeError, "nonempty strings, not 1"),
    ("observe nameless", lambda: run(observe={"": kinetic}), TypeError, "nonempty strings, not ''"),
    ("observe a value", lambda: observe(3.0), TypeError, "'speed' must be a function, not 3.0"),
    ("observe None", lambda: observe(returns(None)), TypeError, "'speed' returns None"),
    ("observe nothing", lambda: observe(returns([])), ValueError, "must return at least one value"),
    ("observe a stranger", lambda: observe(returns(STRANGER)), ValueError, "'speed'.*: stranger"),
    ("observe too much", lambda: observe(lambda t, q, v, params: params.l), AttributeError, "'l'"),
    (
        "observe off the tape",
        lambda: observe(lambda t, q, v, params: ca.erf(q[0])),
        ValueError,
        "'speed' uses the operation 'erf'",
    ),
    (
        "progress a number",
        lambda: run(progress=10),
        TypeError,
        "progress must be a function, not 10",
    ),
    (
        "states a word",
        lambda: run(states="none"),
        TypeError,
        "states must be True or False.*'none'",
    ),
    # consistent starts
    ("hold the wrong one", lambda: project(hold="p"), ValueError, "'q', 'v' or None, not 'p'"),
    ("hold a list", lambda: project(hold=["q"]), ValueError, r"'q', 'v' or None, not \['q'\]"),
    ("hold a bad q", lambda: project(hold="q"), ValueError, "(?s)g.q.*5.0e-03.*without hold='q'"),
    (
        "project at no time",
        lambda: project(t=NAN),
        ValueError,
        "t must be a finite number, not nan",
    ),
    ("project over times", lambda: project(t=(0, 1)), ValueError, r"finite number, not \(0, 1\)"),
    ("project half", lambda: PENDULUM.consistent(q=[1, 0]), TypeError, "'v' is missing"),
    ("project NaN", lambda: project(q=[NAN, 0]), ValueError, "q of 'x' must be finite, not nan"),
    (
        "project from nowhere",
        lambda: project(q=[0, 0]),
        ValueError,
        "no consistent start is near.*gradient of constraint 'rod' vanishes",
    ),
    (
        "project onto nothing",
        lambda: project(system(constraint=lambda t, q, params: {"none": ca.cosh(q[0])})),
        ValueError,
        "no consistent start is near",
    ),
]


@pytest.mark.parametrize(
    ("call", "error", "message"), [pytest.param(*row, id=name) for name, *row in ROWS]
)
def test_a_bad_call_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_the_table_has_no_row_twice():
    assert len({name for name, *_ in ROWS}) == len(ROWS) >= 45


def test_the_right_call_is_taken():
    assert run().status == damped().status == "done"
    assert set(project()) == {"q", "v"}


def test_arrays_without_axes_are_numbers():
    found = run(t=np.array([0.0, 1.0]), h=np.array(0.1), every=np.array(2))
    assert found.t.size == 6
    assert lv.HHT(np.array(-0.1)) == lv.HHT(-0.1)
    assert lv.Chebyshev(np.array(1e-6)) == lv.Chebyshev(1e-6)
    with pytest.raises(TypeError, match=r"h must be a number, not np\.True_"):
        run(h=np.array(True))


def test_a_slice_longer_than_the_run_keeps_start_and_end():
    np.testing.assert_array_equal(run(every=10**30).t, [0, 1])


def test_a_whole_number_beyond_64_bits_is_a_parameter():
    found = system(params={"m": 10**30, "g": 9.81})
    assert found.params["m"] == 1e30


def turned(torque):
    m = lv.bodies.Assembly()
    m.planar_body("wheel", mass=1.0, inertia=1.0, at=(0, 0))
    m.revolute("A", m.ground, "wheel", at=(0, 0, 0), axis=(0, 0, 1), torque=torque)
    return m.system()


def still(**more):
    free = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2, q=1)
    return lv.integrate(free, lv.Spark(2), t=(0, 1), h=0.1, q=[1.0], v=[0.5], **more)


def slow(t, q, p, params):
    return ca.dot(p, p) / 4


#: What would be traced with one argument for another, and how the function is called.
ELSEWHERE = {
    "a velocity for a momentum": (
        lambda: lv.Hamiltonian(slow, q=1, force=lambda t, q, v, params: -v),
        r"force is called with \(t, q, p, params\), .* takes \(t, q, v, params\)",
    ),
    "a momentum for a velocity": (
        lambda: lv.Lagrangian(lambda t, q, p, params: ca.dot(p, p) / 4, q=1),
        r"lagrangian is called with \(t, q, v, params\)",
    ),
    "a rate for an angle": (
        lambda: turned(lambda angle, rate, t, params: -rate),
        r"torque of joint 'A' is called with \(t, angle, rate, params\)",
    ),
    "a velocity for a coordinate": (
        lambda: still(observe={"x": lambda t, v, q, params: q[0]}),
        r"observed 'x' is called with \(t, q, v, params\)",
    ),
    "an event's": (
        lambda: still(events={"x": lambda q, t, v, lam, params: q - 1}),
        r"event 'x' is called with \(t, q, v, lam, params\)",
    ),
    "a time for a state": (
        lambda: lv.PolynomialField(lambda x, t, params: [t + 0 * x, x], x=1),
        r"field is called with \(t, x, params\)",
    ),
}


@pytest.mark.parametrize("name", ELSEWHERE)
def test_arguments_by_the_name_of_another_are_refused(name):
    """Taken by their places, damping of a Hamiltonian by v would be damping by p."""
    call, sentence = ELSEWHERE[name]
    with pytest.raises(TypeError, match=sentence):
        call()


def test_arguments_have_any_other_names():
    turned(lambda time, turn, speed, p: -speed)
    still(observe={"x": lambda *args: args[1][0]}, events={"e": lambda t, y, z, _, p: y[0] - 1.2})
    lv.Hamiltonian(slow, q=1, force=lambda t, x, y, own, c=0.1: -c * y)
    lv.Hamiltonian(slow, q=1, nonholonomic=lambda t, q, v, params: v[0])
    # one that is not used is nothing else's
    still(observe={"x": lambda t, q, p, params: q[0]}, events={"e": lambda t, q, p, *_: q[0] - 1.2})
    with pytest.raises(TypeError, match=r"observed 'x' is called with \(t, q, v, params\)"):
        still(observe={"x": lambda t, q, p, params: [q[0], np.array([1, p[0]])]})


@pytest.mark.parametrize(
    "made",
    [
        lambda: system(
            params={"m": 1.0, "g": [9.81, 1.0]}, lagrangian=lambda t, q, v, p: p.m * v[0]
        ),
        lambda: lv.PolynomialField(
            lambda t, x, p: [p.m * p.g[0] * x[1], 0], x=2, params={"m": 1.0, "g": [1.0, 1.0]}
        ),
        lambda: lv.Schrodinger(
            np.eye(2),
            drive=[(lambda t, p: p.m * p.g[0] * t, np.eye(2))],
            params={"m": 1.0, "g": [1.0, 1.0]},
        ),
    ],
    ids=["mechanics", "field", "wave"],
)
def test_parameters_of_a_system_cannot_be_changed_in_place(made):
    params = made().params
    for change in (
        lambda: params.__setitem__("m", 2.0),
        lambda: params.__delitem__("m"),
        lambda: params.update(m=2.0),
        lambda: params.pop("m"),
        lambda: params.__ior__({"m": 2.0}),
    ):
        with pytest.raises(TypeError, match=r"cannot be changed\nhint: .* params=\{"):
            change()
    with pytest.raises(ValueError, match="read-only"):
        params["g"][0] = 1.0
    for own in (copy.deepcopy(params), pickle.loads(pickle.dumps(params)), params | {"m": 1.0}):
        assert own["m"] == 1.0
        own["m"] = 2.0  # a copy is the user's


@pytest.mark.parametrize("call", [lv.integrate, lv.ensemble])
def test_parameters_of_a_field_that_are_a_number_are_refused(call):
    top = problems.load("euler_top")
    for params in (np.array(1.0), np.array("x"), np.ones(2)):
        with pytest.raises(TypeError, match="params must be a mapping of names, not array"):
            call(top.system, lv.VolumeSplitting(), t=(0, 1.0), steps=2, params=params, **top.start)
