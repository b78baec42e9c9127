"""Fields with any functions of time and of other coordinates: exact volume, full order."""

import pickle

import casadi as ca
import numpy as np
import pytest
import sympy
from ordinary import solved

import liouville as lv
from liouville._methods.splitting import Exponential, Natural, Scaling, split

TABLE = lv.table(np.linspace(0, 3, 13), 2 + np.sin(np.linspace(0, 6, 13)))


def rows(*functions):
    """Return a field of these components, and how many coordinates it has."""
    return lambda t, x, p: [f(t, *(x[i] for i in range(len(functions)))) for f in functions]


KNOTS = lv.table(np.linspace(0, 2, 9), np.cos(np.linspace(0, 4, 9)), ends="not-a-knot")
FIELDS = {
    "cosine": rows(lambda t, x, y: ca.cos(t) * x, lambda t, x, y: x - ca.cos(t) * y),
    "decay": rows(
        lambda t, x, y: ca.exp(-t) * x * y + ca.tanh(t),
        lambda t, x, y: -ca.exp(-t) * y**2 / 2 + x * ca.sin(t),
    ),
    "table": rows(  # whose pieces begin where steps do
        lambda t, x, y: KNOTS(t) * x + y, lambda t, x, y: ca.sin(x) - KNOTS(t) * y
    ),
    "rational": rows(lambda t, x, y: y / (1 + t), lambda t, x, y: -x * t**2 * ca.exp(-t)),
    "shears": rows(
        lambda t, x, y, z: ca.sqrt(1 + y**2 + ca.sin(t) ** 2),
        lambda t, x, y, z: -ca.exp(-((x - z) ** 2)),
        lambda t, x, y, z: ca.tanh(x * y) * ca.log(2 + t),
    ),
    "separable": rows(
        lambda t, x, y, z: x * y / (1 + z**2) * ca.exp(-t) + y,
        lambda t, x, y, z: -(y**2) / 2 / (1 + z**2) * ca.exp(-t) - x * ca.cos(2 * t),
        lambda t, x, y, z: ca.sin(x + ca.cos(t)) * y,
    ),
}
ORDERS = {"S2": 2, "SU4": 4, "BM4": 4, "BM6": 6}


def made(name):
    """Return a field, its start, its method for a composition, and its end after 2."""
    function = FIELDS[name]
    n = 2 if name in ("cosine", "decay", "table", "rational") else 3
    t, x = ca.SX.sym("t"), ca.SX.sym("x", n)
    velocity = ca.Function("f", [t, x], [ca.vertcat(*function(t, x, None))])
    start = np.linspace(0.3, 0.8, n)
    times = KNOTS.x if name == "table" else (0, 2)
    end = solved(lambda t, x: velocity(t, x).full()[:, 0], times, start)[-1]
    return lv.PolynomialField(function, x=n), start, end


def method(composition="BM4", **more):
    return lv.VolumeSplitting(
        "exponentials", "natural", linear="split", composition=composition, **more
    )


@pytest.mark.parametrize("name", FIELDS)
def test_orders_there_and_back_and_volume(name):
    field, start, wanted = made(name)
    for composition, order in ORDERS.items():
        run = {"t": (0.0, 2.0), "every": 10**6}
        coarse, fine = (
            np.abs(lv.integrate(field, method(composition), steps=n, x=start, **run).x[-1] - wanted)
            for n in (8, 16)
        )
        assert np.log2(coarse.max() / fine.max()) == pytest.approx(order, abs=0.5)
        there = lv.integrate(field, method(composition), steps=20, x=start, **run).x[-1]
        back = lv.integrate(field, method(composition), t=(2.0, 0.0), steps=20, x=there)
        np.testing.assert_allclose(back.x[-1], start, rtol=0, atol=1e-13)
        run = lv.analysis.determinant(field, method(composition), t=(0.0, 2.0), steps=10, x=start)
        assert run.observed["defect"][-1] < 1e-12


def test_volume_over_a_hundred_thousand_steps():
    field = lv.PolynomialField(
        lambda t, x, p: [
            (1 + 0.5 * ca.cos(t)) * x[1] / ca.sqrt(1 + x[1] ** 2) + ca.exp(-t) * x[0],
            -ca.sin(x[0]) - ca.exp(-t) * x[1],
        ],
        x=2,
    )
    run = {"t": (0.0, 5000.0), "steps": 100_000, "every": 100_000, "x": [0.5, 0.3]}
    found = lv.analysis.determinant(field, method(), **run).observed
    assert abs(found["log_determinant"][-1]) < 1e-11
    assert found["defect"][-1] < 1e-14


@pytest.mark.parametrize("name", FIELDS)
def test_members_have_the_bits_of_single_runs(name):
    field, start, _ = made(name)
    run = {"t": (0.0, 2.0), "steps": 10}
    for compensated in (False, True):
        how = method(compensated=compensated)
        starts = start + np.linspace(0, 0.1, 5)[:, None]
        many = lv.ensemble(field, how, x=starts, **run)
        alone = lv.integrate(field, how, x=starts[3], **run)
        np.testing.assert_array_equal(many.x[:, 3], alone.x)
    tangents = lv.integrate(field, how, x=start, tangents={"x": np.eye(len(start))}, **run)
    found = tangents.tangents["x"].x[-1]
    assert abs(np.linalg.det(found) - 1) < 1e-12
    ends = [lv.integrate(field, how, x=start + e, **run).x[-1] for e in (1e-5, -1e-5)]
    np.testing.assert_allclose(found.sum(axis=0), (ends[0] - ends[1]) / 2e-5, rtol=1e-8)


def test_a_table_is_one_function():
    """With all its cases, and with what its argument is multiplied by."""
    field = lv.PolynomialField(
        lambda t, x, p: [-2 * TABLE(t) * x[0] + x[1], 2 * TABLE(t) * x[1] - t * TABLE(t)], x=2
    )
    assert sorted(f.text for f in field.terms.functions) == ["f(t)", "f(t)"]
    assert len(field.terms) == 5
    for t in (-1.0, 0.3, 1.7, 4.0):
        np.testing.assert_allclose(
            field.terms.evaluate([2.0, 3.0, t]),
            [-4 * TABLE(t) + 3, 6 * TABLE(t) - t * TABLE(t), 1],
            rtol=1e-14,
        )


def test_which_pieces_there_are():
    """Functions stand still in each piece; other terms are split as they are without them."""
    field, _, _ = made("separable")
    kinds = [type(piece) for piece in split(field.terms, "shears", "triangular").pieces]
    assert kinds.count(Exponential) == 1
    assert kinds.count(Natural) >= 2
    parts = split(made("cosine")[0].terms)
    assert [type(piece) for piece in parts.pieces] == [Scaling, Natural]
    assert parts.mismatch(made("cosine")[0].terms) == 0
    with pytest.raises(ValueError, match="n \\+ d shears are for polynomials"):
        split(field.terms, "n+d")


def test_a_divergence_with_functions_is_refused_by_name():
    with pytest.raises(ValueError, match=r"div f contains 2 \* exp\(\(?-t\)?\)"):
        lv.PolynomialField(lambda t, x, p: [ca.exp(-t) * x[0], ca.exp(-t) * x[1]], x=2)
    with pytest.raises(ValueError, match=r"div f contains 1 \* sqrt\(z\)"):
        lv.PolynomialField(lambda t, x, p: [ca.sqrt(x[2]) * x[0], 0, x[0]], x=("x", "y", "z"))


@pytest.mark.parametrize(
    ("coefficient", "start", "where"),
    [
        (lambda t: 1 / t, 0.0, r"contains \(1/t\), singular at t = 0\n"),
        (lambda t: 1 / (t - 0.3) ** 2, -1.0, r"singular between t = 0.299 and 0.3005\n"),
        (lambda t: ca.log(1 - t), 0.0, r"contains log\(-t \+ 1\), singular at t = 1\n"),
        (lambda t: ca.tan(2 * t), 0.0, r"contains tan\(2\*t\), singular between t = 0.785"),
        (lambda t: t**-1.5, -1.0, r"singular at t = -1\n"),
    ],
)
def test_functions_of_time_that_are_singular_are_refused_before_a_run(coefficient, start, where):
    field = lv.PolynomialField(lambda t, x, p: [coefficient(t) * x[1], -x[0]], x=2)
    for function in (lv.integrate, lv.analysis.determinant):
        with pytest.raises(ValueError, match=where):
            function(field, method(), t=(start, 2.0), steps=10, x=[1.0, 0.5])


def test_functions_that_are_singular_in_a_step_are_named():
    field = lv.PolynomialField(lambda t, x, p: [1, ca.sqrt(2 - x[0])], x=("x", "y"))
    with pytest.raises(
        lv.IntegrationError, match=r"sqrt\(-x \+ 2\) is not finite in the"
    ) as caught:
        lv.integrate(field, method("S2"), t=(0.0, 4.0), h=0.25, x=[0.0, 0.0])
    assert caught.value.step == 8
    found = lv.ensemble(field, method("S2"), t=(0, 1), h=0.25, x=[[0, 0], [1.9, 0], [0.5, 0]])
    assert [*found.failures] == [1]
    assert np.isfinite(found.x[:, [0, 2]]).all()


def test_sympy_pickles_parameters_and_starts():
    x, y, t, k = sympy.symbols("x y t k")
    of_sympy = lv.PolynomialField.from_sympy(
        [k * sympy.exp(-t) * x + 1 / (1 + y**2), -k * sympy.exp(-t) * y],
        [x, y],
        t=t,
        params={"k": 2},
    )
    traced = lv.PolynomialField(
        lambda t, x, p: [p.k * ca.exp(-t) * x[0] + 1 / (1 + x[1] ** 2), -p.k * ca.exp(-t) * x[1]],
        x=("x", "y"), params={"k": 2.0},
    )  # fmt: skip
    run = {"t": (0.5, 2.0), "steps": 30, "x": [0.5, 0.7]}
    one = lv.integrate(traced, method(), **run)
    np.testing.assert_allclose(lv.integrate(of_sympy, method(), **run).x, one.x, rtol=1e-14)
    again = pickle.loads(pickle.dumps(traced))
    np.testing.assert_array_equal(lv.integrate(again, method(), **run).x, one.x)
    other = lv.integrate(again, method(), params={"k": 1.0}, **run).x[-1]
    assert abs(other[0] - one.x[-1, 0]) > 0.1
    found = lv.integrate(traced, lv.VolumeSplitting(), t=(0.5, 2.0), rtol=1e-9, x=[0.5, 0.7])
    np.testing.assert_allclose(found.x[-1], one.x[-1], rtol=1e-6)
