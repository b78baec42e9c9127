"""Equal steps for a tolerance: the error is below it and not far below, whatever the field."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._runs.fields import trial_steps
from liouville.problems import load


@pytest.mark.parametrize("rtol", [1e-4, 1e-9])
@pytest.mark.parametrize("name", ["euler_top", "abc_flow", "lorenz96", "hill_vortex"])
def test_errors_are_below_the_tolerance(name, rtol):
    """Against steps of order eight, in the norm of the tolerance."""
    problem = load(name)
    run = {"t": (0.0, 5.0), "every": 10**6, "x": problem.start["x"]}
    found = lv.integrate(problem.system, lv.VolumeSplitting(), rtol=rtol, **run)
    finest = lv.VolumeSplitting(composition="SS8s21")
    wanted = lv.integrate(problem.system, finest, h=0.005, **run).x[-1]
    off = (found.x[-1] - wanted) / (rtol / 1000 + rtol * np.abs(wanted))
    assert 0.003 < np.sqrt(np.mean(off**2)) < 1.0
    assert found.tolerances == pytest.approx({"rtol": rtol, "atol": rtol / 1000})
    assert "equal steps of" in found.message
    again = lv.integrate(problem.system, lv.VolumeSplitting(), rtol=rtol, **run)
    np.testing.assert_array_equal(again.x, found.x)


def test_backwards_a_first_step_and_absolute_tolerances():
    """The start comes back; a coordinate that may be off by much does not ask for more steps."""
    problem = load("abc_flow")
    there = lv.integrate(
        problem.system, lv.VolumeSplitting(), t=(0, 3), rtol=1e-8, h=0.01, **problem.start
    )
    back = lv.integrate(problem.system, lv.VolumeSplitting(), t=(3, 0), rtol=1e-8, x=there.x[-1])
    np.testing.assert_allclose(back.x[-1], problem.start["x"], atol=1e-6)
    loose = lv.integrate(
        problem.system, lv.VolumeSplitting(), t=(0, 3), rtol=1e-8, atol=1e-2, **problem.start
    )
    assert loose.stats["steps"] < there.stats["steps"] / 4


def test_a_flow_that_is_exact_takes_the_fewest_steps():
    """A shear has no error at all."""
    shear = lv.PolynomialField(lambda t, x, params: [x[1] ** 2, 0], x=2)
    found = lv.integrate(shear, lv.VolumeSplitting(), t=(0, 1), rtol=1e-12, x=[1.0, 2.0])
    assert found.stats["steps"] == 4
    np.testing.assert_allclose(found.x[-1], [5.0, 2.0], rtol=1e-15)


def test_what_no_steps_meet_is_refused(monkeypatch):
    """A chaotic flow over a long time; the sentence says what helps."""
    monkeypatch.setattr(trial_steps, "MOST", 20_000)
    problem = load("lorenz96")
    with pytest.raises(ValueError, match=r"no equal steps(?s:.*)neighbouring trajectories part"):
        lv.integrate(problem.system, lv.VolumeSplitting(), t=(0, 200), rtol=1e-10, **problem.start)


@pytest.mark.parametrize("rtol", [1e-3, 1e-8])
@pytest.mark.parametrize("width", [0.1, 0.02])
def test_a_short_pulse_is_not_stepped_over(width, rtol):
    """Steps of which a trial has seen no error are no reason for ten times longer ones."""

    def forced(t, x, params):
        pulse = 0.4 / width * ca.exp(-(((t - 11.234) / width) ** 2))
        return [x[1], -x[0] + pulse]

    field = lv.PolynomialField(forced, x=2)
    run = {"t": (0, 20), "x": [0.5, 0.2], "every": 10**6}
    found = lv.integrate(field, lv.VolumeSplitting(), rtol=rtol, **run)
    wanted = lv.integrate(field, lv.VolumeSplitting(composition="BM6"), steps=20_000, **run)
    np.testing.assert_allclose(found.x[-1], wanted.x[-1], rtol=rtol, atol=rtol)


@pytest.mark.parametrize("kind", [lv.PolynomialField, lv.PotentialField])
def test_an_absolute_tolerance_that_outweighs_all_coordinates_gets_a_word(kind):
    unit = 1e-9

    def cells(t, x, params):
        return unit**2 * ca.sin(x[0] / unit) * ca.sin(x[1] / unit)

    def velocity(t, x, params):
        return [
            unit * ca.sin(x[0] / unit) * ca.cos(x[1] / unit),
            -unit * ca.cos(x[0] / unit) * ca.sin(x[1] / unit),
        ]

    field = kind(cells if kind is lv.PotentialField else velocity, x=2)
    call = {"t": (0, 2), "rtol": 1e-6, "x": [0.3 * unit, 0.4 * unit]}
    told = "judged by atol = rtol / 1000 = 1e-09, which is more than rtol times"
    assert told in lv.integrate(field, lv.VolumeSplitting(), **call).message
    fine = lv.integrate(field, lv.VolumeSplitting(), atol=1e-9 * unit, **call)
    assert "judged" not in fine.message
    finer = lv.integrate(field, lv.VolumeSplitting(), t=(0, 2), h=1e-3, x=call["x"])
    np.testing.assert_allclose(fine.x[-1], finer.x[-1], rtol=2e-6)
