"""Fields at given times: each state is the end of a shorter step, as exact as the others."""

import numpy as np
import pytest

import liouville as lv
from liouville.problems import abc_flow, euler_top

X = [0.1, 0.2, 0.3]
TIMES = [0.0, 0.05, 0.1, 0.37, 0.38, 1.0]
METHOD = lv.VolumeSplitting(composition="BM4")
PLAN = lv.plan(abc_flow.system, METHOD, h=0.1, x=X)


def run(times=None, t=(0, 1), **more):
    return lv.integrate(abc_flow.system, PLAN, t=t, steps=10, x=X, t_eval=times, **more)


@pytest.mark.parametrize("t", [(0, 1), (1, 0)])
def test_a_state_is_the_end_of_a_shorter_step(t):
    times = TIMES if t[1] else TIMES[::-1]
    found, whole = run(times, t), run(None, t)
    np.testing.assert_array_equal(found.t, times)
    assert found.stats["steps"] == 10
    for at, x in zip(times, found.x, strict=True):
        n = int(np.floor(abs(at - t[0]) / 0.1 * (1 + 1e-12)))
        wanted = whole.x[n]
        if abs(at - whole.t[n]) > 1e-12:
            span = (whole.t[n], at)
            part = lv.integrate(abc_flow.system, PLAN, t=span, steps=1, x=wanted)
            wanted = part.x[-1]
        np.testing.assert_allclose(x, wanted, rtol=0, atol=1e-14)


def test_drift_is_measured_from_the_start():
    start = dict(euler_top.start)
    call = {"t": (0, 5), "h": 0.1, **start}
    some = lv.integrate(euler_top.system, METHOD, t_eval=[4.9, 5.0], **call)
    whole = lv.integrate(euler_top.system, METHOD, **call)
    for name in whole.invariants:
        assert some.initial[name] == pytest.approx(whole.invariants[name][0], rel=1e-14)
        np.testing.assert_allclose(
            some.invariant_drift(name)[-1], whole.invariant_drift(name)[-1], atol=1e-14
        )


def test_a_stored_run_has_the_same_rows_after_a_pause(tmp_path):
    times = np.linspace(0.01, 0.99, 23)
    stored = run(times, store=tmp_path / "run.zarr")
    found = lv.load(stored.path)
    np.testing.assert_array_equal(found.t, times)
    np.testing.assert_array_equal(found.x, run(times).x)


def test_a_gridded_field_has_given_times():
    axis = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    period = {"x": 2 * np.pi, "y": 2 * np.pi}
    field = lv.GriddedField(axis, axis, potential=np.sin(x) * np.sin(y), periodic=period)
    call = {"t": (0, 1), "steps": 20, "x": [1.0, 0.7]}
    some = lv.integrate(field, METHOD, t_eval=[0.25, 0.33], **call)
    whole = lv.integrate(field, METHOD, **call)
    np.testing.assert_allclose(some.x[0], whole.x[5], rtol=0, atol=1e-14)
    more = lv.integrate(field, METHOD, t=(0, 0.33), steps=200, x=[1.0, 0.7])
    np.testing.assert_allclose(some.x[1], more.x[-1], rtol=0, atol=1e-6)


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"times": [0.5], "every": 2}, "either every= or t_eval="),
    ({"times": [0.5, 0.4]}, "in the order of the run"),
    ({"times": [1.5]}, "t_eval must be within .*, not 1.5"),
])  # fmt: skip
def test_wrong_times_are_refused(changes, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        run(**changes)
