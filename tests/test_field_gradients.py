"""Gradients of runs of fields: by their start, by parameters, and by the ends of the time."""

import casadi as ca
import numpy as np
import pytest
import registry
import sympy

import liouville as lv
from liouville.problems import load

RUN = {"t": (0.0, 1.0), "h": 0.1}


def abc(t, x, params):
    """Return the ABC flow."""
    a, b, c = params.A, params.B, params.C
    return [
        a * ca.sin(x[2]) + c * ca.cos(x[1]),
        b * ca.sin(x[0]) + a * ca.cos(x[2]),
        c * ca.sin(x[1]) + b * ca.cos(x[0]),
    ]


def stretched(t, x, params):
    """Return a field with exponentials, one of them of its own monomial, and a linear part."""
    a, b = params.a, params.b
    return [
        a * x[0] * x[1] + b[0] * x[2] ** 2 + x[1],
        -a * x[1] ** 2 / 2 + b[1] * x[2] * x[0],
        b[0] * x[0] ** 2 * x[1] - a * x[0],
    ]


def folded(t, x, params):
    """Return a field with an exponential of three variables."""
    a, b = params.a, params.b
    return [x[2] - a * x[0] * x[1], (a - b) / 2 * x[1] ** 2 + x[0] * x[2], b * x[1] * x[2] - x[0]]


def driven(t, x, params):
    """Return a field with functions of time and of coordinates."""
    a = params.a
    return [
        a * ca.exp(-t) * x[0] + a**2 * ca.sqrt(1 + x[1] ** 2),
        -a * ca.exp(-t) * x[1] + ca.tanh(x[0]) + ca.cos(3 * t),
    ]


FIELDS = {
    "abc": (abc, 3, {"A": 1.0, "B": 0.7, "C": 0.4}),
    "stretched": (stretched, 3, {"a": 0.8, "b": [0.5, -0.3]}),
    "folded": (folded, 3, {"a": 0.9, "b": -0.4}),
    "driven": (driven, 2, {"a": 0.6}),
}

#: Of each a splitting with another kind of piece.
METHODS = [
    ("abc", {}),
    ("abc", {"composition": "SS8s21", "compensated": True}),
    ("stretched", {"diagonal": "exponentials", "linear": "exact"}),
    ("stretched", {"diagonal": "exponentials", "linear": "split", "off_diagonal": "natural"}),
    ("stretched", {"diagonal": "shears", "off_diagonal": "triangular", "runge_kutta": "rk4"}),
    ("stretched", {"diagonal": "shears", "off_diagonal": "triangular", "runge_kutta": "euler"}),
    ("stretched", {"diagonal": "n+d"}),
    ("folded", {"diagonal": "exponentials"}),
    ("folded", {"diagonal": "pairs"}),
    ("driven", {"composition": "BM6"}),
]


def made(name):
    """Return a field, all that it is differentiated by, and a start."""
    field, n, params = FIELDS[name]
    system = lv.PolynomialField(field, x=n, params=params)
    wrt = ["x", "t0", "t1", *(f"params.{p}" for p in params)]
    return system, wrt, np.random.default_rng(3).uniform(-0.6, 0.6, n)


@pytest.mark.parametrize(("name", "method"), METHODS)
def test_gradients_are_tangents_transposed_and_differences(name, method):
    """Of every kind of piece, by everything."""
    system, wrt, x = made(name)
    found = lv.analysis.check_gradient(
        system, lv.VolumeSplitting(**method), wrt=wrt, **RUN, every=3, x=x
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-8


@pytest.mark.parametrize("name", ["hill_vortex", "bajer_moffatt", "lorenz96", "toda_lattice"])
def test_gradients_of_the_problems(name):
    """By their starts and parameters, as planned."""
    problem = load(name)
    wrt = ["x", *(f"params.{p}" for p in problem.system.params)]
    found = lv.analysis.check_gradient(
        problem.system, lv.VolumeSplitting(), wrt=wrt, **RUN, x=problem.start["x"], size=2e-4
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-8


@pytest.mark.parametrize(("row", "name"), [(row, row.on[0]) for row in registry.FIELDS], ids=str)
def test_gradients_of_the_registry(row, name):
    """Of every composition, by the start and the end."""
    problem = registry.ALL[name]
    found = lv.analysis.check_gradient(
        problem.system, row.method, wrt=["x", "t1"], t=(0.0, 0.1), steps=5, size=2e-4,
        **problem.start,
    )  # fmt: skip
    assert found.dot < 1e-13
    assert found.differences < 1e-8


def test_tangents_by_parameters_are_differences():
    """Of the same plan, to order six; many at once have the bits of one."""
    system, _, x = made("stretched")
    plan = lv.plan(system, lv.VolumeSplitting(), h=0.1, x=x)
    directions = {"params.b": np.eye(2), "params.a": 1.0, "t1": 1.0, "x": [0.3, 0.0, 1.0]}
    run = lv.integrate(system, plan, **RUN, x=x, tangents=directions)
    np.testing.assert_array_equal(run.x, lv.integrate(system, plan, **RUN, x=x).x)

    def end(size):
        moved = {"a": 0.8 + size}
        return lv.integrate(system, plan, **RUN, params=moved, x=x).x[-1]

    d = 1e-2
    sides = [end(j * d) - end(-j * d) for j in (1, 2, 3)]
    wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * d)
    np.testing.assert_allclose(run.tangents["params.a"].x[-1], wanted, rtol=0, atol=1e-11)
    one = lv.integrate(system, plan, **RUN, x=x, tangents={"params.b": [0.0, 1.0]})
    np.testing.assert_array_equal(one.tangents["params.b"].x, run.tangents["params.b"].x[:, 1])


def test_pairings_are_constant_over_long_chaotic_runs():
    """The states between are made again, not undone: as exact as of one step."""
    system, wrt, x = made("abc")
    run = {"t": (0.0, 400.0), "steps": 4000, "every": 4000, "x": x}
    solution, pullback = lv.vjp(system, lv.VolumeSplitting(), wrt=wrt, **run)
    np.testing.assert_array_equal(solution.x, lv.integrate(system, lv.VolumeSplitting(), **run).x)
    rng = np.random.default_rng(0)
    cotangent, direction = rng.standard_normal((2, 3))
    gradient = pullback(x=[np.zeros(3), cotangent])["x"]
    tangent = lv.integrate(system, lv.VolumeSplitting(), **run, tangents={"x": direction}).tangents[
        "x"
    ]
    there, back = cotangent @ tangent.x[-1], gradient @ direction
    assert np.linalg.norm(gradient) > 1e3
    assert abs(there - back) < 5e-12 * np.linalg.norm(gradient) * np.linalg.norm(direction)


def test_gradients_on_a_grid():
    """By the start and the end, through a boundary between cells."""
    nodes = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    psi = np.sin(nodes)[:, None] * np.sin(nodes) + 0.3 * np.cos(nodes)[:, None]
    field = lv.GriddedField(nodes, nodes, potential=psi, periodic=("x", "y"), degree=5)
    found = lv.analysis.check_gradient(
        field, lv.VolumeSplitting(), wrt=["x", "t1"], t=(0, 2), steps=20, x=[0.9, 2.4], size=1e-3
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-8


def test_a_driven_field_is_differentiated_by_its_beginning():
    """A shift of both ends is not that of the phase."""
    system, _, x = made("driven")
    _, pullback = lv.vjp(system, lv.VolumeSplitting(), wrt=["t0", "t1"], **RUN, x=x)
    cotangent = np.zeros((11, 2))
    cotangent[-1] = 1.0, 2.0
    found = pullback(x=cotangent)

    def value(t0, t1):
        run = {"t": (t0, t1), "steps": 10, "x": x}
        return lv.integrate(system, lv.VolumeSplitting(), **run).x[-1] @ [1.0, 2.0]

    for name, by in (("t0", np.array([1.0, 0.0])), ("t1", np.array([0.0, 1.0]))):
        d = 1e-3
        sides = [value(*([0, 1] + j * d * by)) - value(*([0, 1] - j * d * by)) for j in (1, 2, 3)]
        wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * d)
        assert abs(found[name] - wanted) < 1e-10


def own_wave(t, x, params):
    """Return waves of the coordinates that they move, whose wave number is a parameter."""
    wave = ca.sin(params.k * (x[0] - x[1]))
    return [wave, wave]


@pytest.mark.parametrize(
    ("field", "wrt", "says"),
    [
        (own_wave, ["params.k"], "changes the form of the field's pieces"),
        (own_wave, ["x", "params.m"], "no direction 'params.m'"),
        (own_wave, "x", "sequence of names"),
    ],
)
def test_what_has_no_gradient_is_refused(field, wrt, says):
    """Before the run, with what may be the reason."""
    system = lv.PolynomialField(field, x=2, params={"k": 2.0})
    with pytest.raises((TypeError, ValueError), match=says):
        lv.vjp(system, lv.VolumeSplitting(), wrt=wrt, **RUN, x=[0.1, 0.2])


#: Fields with a parameter p in functions, or one that cancels a term, and c in coefficients.
WITHIN = {
    "wave number": lambda t, x, p: [p.c * ca.sin(p.p * x[1]), -0.3 * x[0]],
    "both": lambda t, x, p: [p.c * p.p * ca.tanh(p.p * x[1]), -0.3 * x[0]],
    "exponent": lambda t, x, p: [p.c * (1 + x[1] ** 2) ** p.p, -(x[0] ** 2)],
    "frequency": lambda t, x, p: [x[1] + p.c * ca.cos(p.p * t), -(x[0] ** 2)],
    "moving wave": lambda t, x, p: [p.c * ca.sin(x[1] - p.p * t), -(x[0] ** 2)],
    "canceled": lambda t, x, p: [p.c * x[1] ** 2, p.p * x[0] - 0.7 * x[0]],
    "by cases": lambda t, x, p: [p.p * x[1] * ca.fabs(x[1]), p.c - x[0]],
}


@pytest.mark.parametrize("value", [0.7, 0.0], ids=["on", "off"])
@pytest.mark.parametrize("name", WITHIN)
def test_parameters_within_functions_are_variables_at_rest(name, value):
    """The derivatives are those of the discrete map, whose states are those of the plain field."""
    system = lv.PolynomialField(WITHIN[name], x=2, params={"c": 1.3, "p": value})
    method = lv.VolumeSplitting(off_diagonal="natural", composition="BM6")
    run = {"t": (0.2, 1.2), "steps": 20, "x": [0.2, 1.0]}
    by = {"params.p": 1.0, "params.c": 1.0, "x": [1.0, 0.5], "t0": 1.0, "t1": 1.0}
    found = lv.integrate(system, method, tangents=by, **run)
    solution, pullback = lv.vjp(system, method, wrt=list(by), **run)
    for states in (found.x, solution.x):
        np.testing.assert_allclose(states, lv.integrate(system, method, **run).x, atol=1e-12)
    weights = np.zeros_like(solution.x)
    weights[-1] = [1.0, 2.0]
    gradient = pullback(x=weights)
    for what, direction in by.items():
        pushed = weights[-1] @ found.tangents[what].x[-1]
        assert np.sum(gradient[what] * direction) == pytest.approx(pushed, rel=1e-12, abs=1e-13)
    ends = [
        lv.integrate(system, method, params={"p": value + e}, **run).x[-1] for e in (1e-5, -1e-5)
    ]
    slope = (ends[0] - ends[1]) / 2e-5
    np.testing.assert_allclose(found.tangents["params.p"].x[-1], slope, rtol=1e-7, atol=1e-8)
    many = lv.vjp(system, method, wrt=["params.p"], **run | {"x": [[0.2, 1.0], [0.3, 0.5]]})[1]
    rows = np.zeros((len(weights), 2, 2))
    rows[-1, 0] = weights[-1]
    assert many(x=rows)["params.p"][0] == pytest.approx(gradient["params.p"], rel=1e-12)
    assert lv.analysis.check_gradient(system, method, wrt=["params.p", "x"], **run)


@pytest.mark.parametrize(
    "write",
    [
        lambda x, y, t, a, k: [a * sympy.sin(k * y) + y / 3, -a * x],
        lambda x, y, t, a, k: [a * (x - 2 * y) * x, a * y * (y - 2 * x)],
        lambda x, y, t, a, k: [a * y + sympy.cos(k * t), -(x**2)],
    ],
    ids=["function", "polynomial", "driven"],
)
def test_fields_from_sympy_have_the_derivatives_of_those_that_are_traced(write):
    x, y, t, a, k = sympy.symbols("x y t a k")
    system = lv.PolynomialField.from_sympy(
        write(x, y, t, a, k), [x, y], t=t, params={a: 0.7, k: 1.3}
    )
    as_casadi = [sympy.lambdify((x, y, t, a, k), e, ca) for e in write(x, y, t, a, k)]
    traced = lv.PolynomialField(
        lambda t, x, p: [e(x[0], x[1], t, p.a, p.k) for e in as_casadi],
        x=("x", "y"), params={"a": 0.7, "k": 1.3},
    )  # fmt: skip
    run = {"t": (0.1, 1.0), "steps": 10, "x": [0.2, 1.0]}
    method, by = lv.VolumeSplitting(composition="BM4"), {"params.a": 1.0, "params.k": 1.0}
    one, two = (lv.integrate(f, method, tangents=by, **run) for f in (system, traced))
    for name in by:
        a, b = (found.tangents[name].x for found in (one, two))
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-14)


def test_derivatives_that_are_kept_are_those_of_the_parameters_and_steps():
    """With x' = a^2 y and y' = 1 x is a t^2 by a, whatever was asked before."""
    field = lv.PolynomialField(lambda t, x, p: [p.a**2 * x[1], 1], x=("x", "y"), params={"a": 1.0})
    method = lv.VolumeSplitting()
    for a, t, steps in ((1.0, 1.0, 4), (2.0, 1.0, 4), (1.0, 3.0, 4), (1.0, 3.0, 6), (1.0, 1.0, 4)):
        run = {"t": (0, t), "steps": steps, "x": [0.0, 0.0], "params": {"a": a}}
        solution, pullback = lv.vjp(field, method, wrt=["params.a"], **run)
        cotangent = np.zeros_like(solution.x)
        cotangent[-1, 0] = 1
        assert pullback(x=cotangent)["params.a"] == pytest.approx(a * t**2)
        found = lv.integrate(field, method, tangents={"params.a": 1.0}, **run)
        assert found.tangents["params.a"].x[-1, 0] == pytest.approx(a * t**2)


def test_a_parameter_that_is_zero_has_a_derivative():
    """Of a force that is off: its term is in the split, as it is where the force is on."""
    duffing = lv.PolynomialField(
        lambda t, x, p: [x[1], x[0] - x[0] ** 3 + p.f * ca.cos(1.2 * t)], x=2, params={"f": 0.0}
    )
    method = lv.VolumeSplitting("exponentials", "natural", composition="BM4", linear="split")
    run = {"t": (0, 5), "h": 0.05, "x": [1.0, 0.2]}
    ends = [lv.integrate(duffing, method, params={"f": f}, **run).x[-1] for f in (1e-5, -1e-5)]
    slope = (ends[0] - ends[1]) / 2e-5
    found = lv.integrate(duffing, method, tangents={"params.f": 1.0}, **run)
    np.testing.assert_allclose(found.tangents["params.f"].x[-1], slope, rtol=1e-7)
    np.testing.assert_allclose(found.x, lv.integrate(duffing, method, **run).x, atol=1e-8)
    many = {**run, "x": [[1.0, 0.2], [0.3, 0.1]]}
    for system, more in ((duffing, run), (duffing, many)):
        solution, pullback = lv.vjp(system, method, wrt=["x", "params.f"], **more)
        weights = np.zeros_like(solution.x)
        weights[-1, ..., 1] = 1.0
        gradient = np.ravel(pullback(x=weights)["params.f"])[0]
        assert gradient == pytest.approx(slope[1], rel=1e-7)
