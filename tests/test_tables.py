"""Tables as functions of a model."""

import math
import pickle
import warnings

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, interp1d

import liouville as lv

X = np.array([0.0, 0.4, 0.5, 1.1, 1.6, 2.0])


def derivatives(spline, at):
    """Return value, slope and curvature of an expression at some places, a column each."""
    x = ca.SX.sym("x")
    curvature, slope = ca.hessian(spline(x), x)
    function = ca.Function("f", [x], [spline(x), slope, curvature])
    return np.array([[float(y) for y in function(place)] for place in at])


@pytest.mark.parametrize("ends", ["natural", "not-a-knot"])
def test_a_table_is_the_cubic_spline_and_goes_on_straight(ends):
    spline, wanted = lv.table(X, np.sin(X), ends), CubicSpline(X, np.sin(X), bc_type=ends)
    inside = np.linspace(0, 2, 41)[:-1]
    found = derivatives(spline, inside)
    for k in range(3):
        assert found[:, k] == pytest.approx(wanted(inside, k), abs=1e-14)
    assert spline(inside) == pytest.approx(found[:, 0], abs=1e-15)
    for end, place in ((0.0, -3.0), (2.0, 5.0)):
        slope = float(wanted(end, 1))
        line = float(wanted(end)) + slope * (place - end)
        assert derivatives(spline, [place])[0] == pytest.approx([line, slope, 0], abs=1e-13)
        assert spline(place) == pytest.approx(line)
    assert np.array_equal(pickle.loads(pickle.dumps(spline))(X), spline(X))
    assert np.isnan(spline(np.nan))


def test_a_periodic_table_repeats_itself_smoothly():
    x = np.linspace(0, 1, 17)
    y = np.sin(2 * np.pi * x)
    assert y[-1] != y[0]  # roundoff
    spline = lv.table(x, y, "periodic")
    assert spline.y[-1] == spline.y[0]
    with pytest.raises(ValueError, match="begins with 0 and ends with 1e-12"):
        lv.table(x, np.append(y[:-1], 1e-12), "periodic")
    at = np.array([-2.3, 0.0, 0.7, 5.7])
    assert spline(at) == pytest.approx(np.sin(2 * np.pi * at), abs=1e-4)
    left, right = derivatives(spline, [1 - 1e-9, 1 + 1e-9])
    assert left == pytest.approx(right, abs=1e-5)


def test_a_motion_under_a_tabulated_force_keeps_its_order():
    stiffness = lv.table(np.linspace(-2, 2, 9), np.linspace(-8, 8, 9))  # a straight line
    oscillator = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2, force=lambda t, q, v, p: [-stiffness(q[0])], q=1
    )
    run = lv.integrate(oscillator, lv.Spark(4), t=(0, 3), h=0.05, q=[3.0], v=[0.0])
    assert run.q[:, 0] == pytest.approx(3 * np.cos(2 * run.t), abs=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "ends", "error", "words"),
    [
        ([0, 1, 1], [0, 1, 2], "natural", ValueError, r"x\[1\] = 1 is followed by 1"),
        ([0, 1], [0, np.inf], "natural", ValueError, r"y\[1\] of a table is inf"),
        ([0, 1], [0, 1, 2], "natural", ValueError, "x of a table has 2 numbers, and y has 3"),
        ([0], [1], "natural", ValueError, "a natural table has 2 points at least, not 1"),
        ([0, 1, 2], [0, 1, 2], "not-a-knot", ValueError, "has 4 points at least, not 3"),
        ([0, 1, 2], [0, 1, 2], "periodic", ValueError, "begins with 0 and ends with 2"),
        ([[0, 1]], [0, 1], "natural", ValueError, r"shape \(1, 2\), wanted \(k,\)"),
        ("ab", [0, 1], "natural", TypeError, "x of a table is a 1-D array of numbers"),
        ([0, 1], [0, 1], "clamped", ValueError, "ends is one of 'natural', 'not-a-knot'"),
    ],
)
def test_bad_tables_are_refused(x, y, ends, error, words):
    with pytest.raises(error, match=words):
        lv.table(x, y, ends)


def test_black_boxes_are_refused_with_a_table_in_mind():
    box = interp1d([0, 1], [0, 1])
    for function in (lambda x: math.exp(float(x)), CubicSpline([0, 1], [0, 1]), math.sin, box):
        with pytest.raises(ValueError, match=r"force|object arrays") as refused:
            lv.Lagrangian(
                lambda t, q, v, p: v[0] ** 2 / 2,
                force=lambda t, q, v, p, f=function: [f(q[0])],
                q=1,
            )
        told = str(refused.value) + "".join(getattr(refused.value, "__notes__", ()))
        assert "lv.table(x, y) stands in for it by its values" in told
    with pytest.raises(TypeError, match="numbers or CasADi's SX, not a MX"):
        lv.table([0, 1], [0, 1])(ca.MX.sym("x"))


def test_functions_of_numpy_are_taken_without_a_word():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        system = lv.Lagrangian(
            lambda t, q, v, p: v[0] ** 2 / 2 - np.interp(q[0], X, X**2) + np.sin(q[0]), q=1
        )
    assert system.coordinates == ("q0",)
