from dataclasses import replace

import numpy as np
import pytest

import liouville as lv
from liouville import problems
from liouville.analysis.convergence import Study, distance, slope, study

H = 0.4 / 2.0 ** np.arange(9)


def test_the_slope_is_the_power_of_h_above_the_roundoff_plateau():
    roundoff = np.array([3, -4, 2, 5, 1, 4, 6, 3, 5]) * 1e-13
    errors = 3 * H**6 + roundoff
    assert slope(H, errors) == pytest.approx(6.0, abs=0.05)
    assert abs(np.polyfit(np.log(H), np.log(errors), 1)[0] - 6.0) > 0.5


def test_steps_too_coarse_for_the_power_to_show_are_left_out():
    errors = 1 / (1 + 1e-4 / H**4)
    errors[0] = 0.5
    assert slope(H, errors) == pytest.approx(4.0, abs=0.2)
    assert abs(np.polyfit(np.log(H), np.log(errors), 1)[0] - 4.0) > 0.5


def test_failed_steps_are_left_out_and_too_few_give_no_slope():
    errors = H**4
    errors[0] = np.nan
    assert slope(H, errors) == pytest.approx(4.0, abs=1e-12)
    assert np.isnan(slope(H, np.where(H > 0.15, H**4, 1e-16)))
    assert np.isnan(slope(H, np.full(len(H), np.nan)))


def test_distance_is_relative_to_the_largest_component():
    assert distance([1.0, -3.0], [1.0, -4.0]) == 0.25
    assert distance([0.0, 1e-3], [0.0, 0.0]) == 1e-3
    assert distance([], []) == 0.0
    assert np.isnan(distance([np.nan, 1.0], [1.0, 1.0]))


@pytest.mark.parametrize("known", [True, False], ids=["reference", "fine run"])
def test_a_study_finds_the_order_of_the_method(known):
    pendulum = problems.load("pendulum")
    result = study(
        pendulum.system,
        lv.Spark(stages=2),
        (0.0, 10.0),
        [0.05, 0.025, 0.1, 0.0125],
        pendulum.start,
        pendulum.reference[10.0] if known else None,
    )
    np.testing.assert_allclose(result.h, [0.1, 0.05, 0.025, 0.0125])
    assert result.order["q"] == pytest.approx(4.0, abs=0.15)
    assert result.order["v"] == pytest.approx(4.0, abs=0.15)
    slopes = result.slopes("q")
    assert np.isnan(slopes[0])
    np.testing.assert_allclose(slopes[1:], 4.0, atol=0.3)


@pytest.mark.parametrize("method", [lv.HHT(), lv.GeneralizedAlpha(), lv.ArnoldBruls()])
def test_a_study_finds_the_order_of_a_damping_method(method):
    wire = problems.load("moving_wire")
    hs = [0.02, 0.01, 0.005, 0.0025]
    result = study(wire.system, method, (0.0, 2.0), hs, wire.start, of=("q", "v", "a"))
    assert result.order["q"] == pytest.approx(2.0, abs=0.15)
    assert result.order["v"] == pytest.approx(2.0, abs=0.15)
    assert result.order["a"] == pytest.approx(1.0, abs=0.3)  # it stands for a time t + Delta h


@pytest.mark.parametrize(("composition", "order"), [("BM4", 4), ("BM6", 6)])
@pytest.mark.parametrize("name", ["euler_top", "abc_flow", "lorenz96"])
def test_a_study_of_a_field_is_that_of_one_plan(name, composition, order):
    problem = problems.load(name)
    t = min(problem.reference)
    hs = problem.h * 2.0 ** np.arange(2, -3, -1)
    method = lv.VolumeSplitting(composition=composition)
    result = study(problem.system, method, (0.0, t), hs, problem.start, problem.reference[t])
    assert result.order["x"] == pytest.approx(order, abs=0.15)
    plan = lv.plan(problem.system, method, t=(0.0, t), h=hs[2], **problem.start)
    assert result.method == repr(plan.method)
    forced = study(problem.system, plan, (0.0, t), hs, problem.start, problem.reference[t])
    np.testing.assert_array_equal(forced.errors["x"], result.errors["x"])


def test_a_run_that_fails_has_no_error_and_does_not_stop_the_study(monkeypatch):
    def integrate(system, method, *, t, h, **rest):
        if h > 0.3:
            raise lv.IntegrationError("too large a step")
        return lv.integrate(system, method, t=t, h=h, **rest)

    monkeypatch.setattr("liouville.analysis.convergence.integrate", integrate)
    pendulum = problems.load("pendulum")
    hs = [0.4, 0.1, 0.05, 0.025]
    result = study(pendulum.system, lv.Spark(stages=1), (0.0, 1.0), hs, pendulum.start)
    assert np.isnan(result.errors["q"][0])
    assert result.order["q"] == pytest.approx(2.0, abs=0.15)


def test_an_interrupted_run_ends_the_study(monkeypatch):
    def integrate(*args, **rest):
        return replace(lv.integrate(*args, **rest), status="interrupted")

    monkeypatch.setattr("liouville.analysis.convergence.integrate", integrate)
    pendulum = problems.load("pendulum")
    with pytest.raises(KeyboardInterrupt):
        study(pendulum.system, lv.Spark(), (0.0, 1.0), [0.1], pendulum.start)


def test_what_a_study_cannot_do_is_said():
    pendulum = problems.load("pendulum")
    with pytest.raises(ValueError, match="at least one step size"):
        study(pendulum.system, lv.Spark(), (0.0, 1.0), [], pendulum.start)
    with pytest.raises(ValueError, match=r"reference lacks v\nhint: of=\('q',\)"):
        study(pendulum.system, lv.Spark(), (0.0, 1.0), [0.1], pendulum.start, {"q": [0.0, 0.0]})


def test_a_study_prints_as_a_table_and_has_one_in_a_notebook():
    h = np.array([0.4, 0.2])
    study = Study(h, {"q": 3 * h**2}, {"q": np.nan}, "Spark(<1>)")
    assert repr(study).splitlines() == [
        "<Study of Spark(<1>)",
        "h       error of q  slope",
        "0.4     4.80e-01",
        "0.2     1.20e-01    2.00",
        "fitted              none>",
    ]
    page = study._repr_html_()
    assert "Spark(&lt;1&gt;)" in page
    assert page.count("<tr>") == 4
