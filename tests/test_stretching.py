"""Finite-time Lyapunov exponents and rotation numbers, against closed forms and differences."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv

V = lv.VolumeSplitting


def gyre(t, x, params):
    """Return the stream function of the double gyre."""
    a = 0.25 * ca.sin(0.2 * np.pi * t)
    return -0.1 * ca.sin(np.pi * (a * x[0] ** 2 + (1 - 2 * a) * x[0])) * ca.sin(np.pi * x[1])


def twisting(turns):
    """Return a field that goes round z at a rate that grows with the distance."""

    def rates(t, x, params):
        rate = 2 * np.pi * (turns + 0.1 * (x[0] ** 2 + x[1] ** 2))
        return [-rate * x[1], rate * x[0], 1]

    return lv.PolynomialField(rates, x=("x", "y", "z"))


@pytest.mark.parametrize("t", [(0.0, 3.0), (3.0, 0.0)])
def test_the_exponent_of_a_saddle_is_its_rate(t):
    saddle = lv.PolynomialField(lambda t, x, params: [2 * x[1], 2 * x[0]], x=2)
    starts = np.random.default_rng(0).normal(size=(3, 4, 2))
    found = lv.analysis.ftle(saddle, V(), t=t, h=0.1, x=starts)
    exact = np.log(np.cosh(6) + np.sinh(6)) / 3
    assert found.exponents.shape == (3, 4)
    assert np.abs(found.exponents - exact).max() < 1e-5
    along = found.directions @ np.array([1, np.sign(t[1] - t[0])]) / np.sqrt(2)
    assert np.abs(np.abs(along) - 1).max() < 1e-5


def test_exponents_are_those_of_differences_of_neighbours():
    field = lv.PotentialField(gyre, x=("x", "y"))
    starts, d = np.array([[[0.3, 0.4], [1.1, 0.6]], [[1.7, 0.2], [0.9, 0.9]]]), 1e-5
    run = {"t": (0, 10), "steps": 100}
    found = lv.analysis.ftle(field, V(), x=starts, **run)
    for place in np.ndindex(2, 2):
        ends = [
            lv.integrate(field, V(), x=starts[place] + sign * d * unit, **run).x[-1]
            for unit in np.eye(2)
            for sign in (1, -1)
        ]
        change = np.array([ends[0] - ends[1], ends[2] - ends[3]]).T / (2 * d)
        _, sizes, vectors = np.linalg.svd(change)
        assert found.exponents[place] == pytest.approx(np.log(sizes[0]) / 10, abs=1e-6)
        assert abs(found.directions[place] @ vectors[0]) == pytest.approx(1, abs=1e-6)
    assert found.x.shape == (2, 2, 2)


def test_lengths_on_a_sphere_and_a_cylinder_are_those_of_space():
    """A rigid rotation about an axis in the equator stretches nothing."""
    lon, lat = np.arange(0, 360, 4.0), np.linspace(-60, 60, 61)
    east, north = np.meshgrid(np.radians(lon), np.radians(lat), indexing="ij")
    radius = 6.371e6
    psi = 1e-6 * radius**2 * np.cos(north) * np.cos(east)
    globe = lv.GriddedField(
        lon, lat, potential=psi, coordinates="spherical", radius=radius, periodic=("lon",)
    )
    starts = globe.states_of([[0.0, 0.0], [10.0, 30.0]])
    found = lv.analysis.ftle(globe, V(), t=(0, 5e5), h=5e3, x=starts)
    assert np.abs(found.exponents * 5e5).max() < 1e-3
    turned = np.abs(globe.points_of(found.x) - globe.points_of(starts))
    assert turned.max() > 5


def test_starts_that_fail_have_no_exponent():
    x, y = np.linspace(0, 1, 9), np.linspace(0, 1, 9)
    u, v = np.ones((9, 9)), np.zeros((9, 9))
    field = lv.GriddedField(x, y, velocity=(u, v), walls=("y",))
    found = lv.analysis.ftle(field, V(), t=(0, 0.3), h=0.1, x=[[0.1, 0.5], [0.9, 0.5]])
    assert found.exponents[0] == pytest.approx(0, abs=1e-12)
    assert np.isnan(found.exponents[1])
    assert list(found.failures) == [1]
    none = lv.analysis.ftle(field, V(), t=(0, 0.3), h=0.1, x=[[0.9, 0.5], [0.95, 0.5]])
    assert np.isnan([none.exponents, *none.directions.T, *none.x.T]).all()
    assert list(none.failures) == [0, 1]
    with pytest.raises(ValueError, match=r"x must have shape \(P, 2\) or more axes .*, not \(2,\)"):
        lv.analysis.ftle(field, V(), t=(0, 0.3), h=0.1, x=[0.1, 0.5])
    with pytest.raises(TypeError, match="exponents must be those of a field"):
        lv.analysis.ftle(lv.problems.pendulum.system, V(), t=(0, 1), h=0.1, x=[[0.1, 0.5]])


@pytest.mark.parametrize("t", [(0, 200), (200, 0)])
def test_rotation_numbers_are_the_turns_from_crossing_to_crossing(t):
    radii = np.array([0.3, 0.7, 1.1])
    starts = np.column_stack([radii, 0 * radii, np.full(3, 0.5)])
    cuts = lv.section(
        twisting(0.05), V(composition="SS8s21"), t=t, h=0.1, plane="z", period=1.0, x=starts
    )
    found = lv.analysis.rotation_numbers(cuts, about=(0, 0))
    assert np.abs(found - np.sign(t[1] - t[0]) * (0.05 + 0.1 * radii**2)).max() < 1e-9
    other = lv.analysis.rotation_numbers(cuts, about=(0, 0), of=("y", "x"))
    assert np.abs(other + found).max() < 1e-13
    assert np.isfinite(lv.analysis.rotation_numbers(cuts, about=np.zeros((3, 2)))).all()


def test_a_centre_and_coordinates_that_are_none_are_refused():
    cuts = lv.section(twisting(0.1), V(), t=(0, 3), h=0.1, plane="z", period=1.0, x=[[1, 0, 0.5]])
    assert np.isnan(lv.analysis.rotation_numbers(cuts, about=(0, 0))).all()
    with pytest.raises(ValueError, match=r"about must have shape \(2,\) or \(1, 2\), not \(3,\)"):
        lv.analysis.rotation_numbers(cuts, about=(0, 0, 0))
    with pytest.raises(ValueError, match=r"about must be finite, not \(nan, 0\)"):
        lv.analysis.rotation_numbers(cuts, about=(np.nan, 0))
    with pytest.raises(ValueError, match=r"of= must name two of x, y, z, not \('x', 'r'\)"):
        lv.analysis.rotation_numbers(cuts, about=(0, 0), of=("x", "r"))
    with pytest.raises(TypeError, match="rotation numbers must be those of a section"):
        lv.analysis.rotation_numbers(cuts.x, about=(0, 0))


def test_a_centre_that_no_trajectory_goes_round_is_said():
    starts = [[0.3, 0, 0.5], [0.7, 0, 0.5]]
    cuts = lv.section(twisting(0.3), V(), t=(0, 20), h=0.1, plane="z", period=1.0, x=starts)
    with pytest.warns(UserWarning, match="no trajectory goes round about="):
        lv.analysis.rotation_numbers(cuts, about=(2, 0))
    assert np.abs(lv.analysis.rotation_numbers(cuts, about=(0.5, 0))[0]) < 0.1  # one does
