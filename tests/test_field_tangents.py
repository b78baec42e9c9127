"""Tangents of fields are derivatives of the steps that are made, and change no trajectory."""

import numpy as np
import pytest

import liouville as lv
from liouville.problems import load

FIELDS = ("euler_top", "hill_vortex", "abc_flow", "cubic_charge", "lorenz96", "maxwell_bloch")
RUN = {"t": (0.0, 1.0), "h": 0.1}


def planned(name):
    """Return a system, its plan and its start."""
    problem = load(name)
    x = np.asarray(problem.start["x"], dtype=float)
    return problem.system, lv.plan(problem.system, lv.VolumeSplitting(), h=0.1, x=x), x


@pytest.mark.parametrize("name", FIELDS)
def test_tangents_are_differences_and_keep_volume(name):
    """Differences of order six of the same plan; det 1; the bits of a run without them."""
    system, plan, x = planned(name)
    n = len(x)
    run = lv.integrate(system, plan, **RUN, x=x, tangents={"x": np.eye(n)})
    found = run.tangents["x"].x[-1]
    np.testing.assert_array_equal(run.x, lv.integrate(system, plan, **RUN, x=x).x)
    assert abs(np.linalg.det(found) - 1) < 1e-12

    def end(start):
        return lv.integrate(system, plan, **RUN, every=1000, x=start).x[-1]

    for k in range(0, n, max(1, n // 3)):
        step = np.zeros(n)
        step[k] = 1e-3 * max(1.0, np.abs(x).max())
        sides = [end(x + j * step) - end(x - j * step) for j in (1, 2, 3)]
        wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * step[k])
        np.testing.assert_allclose(found[k], wanted, rtol=0, atol=1e-10)


def test_many_directions_members_and_observables():
    """Beyond the eight that go together; members as alone; quantities stay where they were."""
    system, plan, x = planned("lorenz96")
    directions = np.random.default_rng(0).standard_normal((11, len(x)))
    more = {"observe": {"first": lambda t, x, params: x[0] ** 2}, "tangents": {"x": directions}}
    run = lv.integrate(system, plan, **RUN, x=x, **more)
    plain = lv.integrate(system, plan, **RUN, x=x, tangents={"x": directions[9]})
    np.testing.assert_array_equal(run.tangents["x"].x[:, 9], plain.tangents["x"].x)
    np.testing.assert_array_equal(run.observed["first"], run.x[:, 0] ** 2)
    both = lv.ensemble(system, plan, **RUN, x=[x, 1.01 * x], **more)
    assert both.tangents["x"].x.shape == (11, 2, 11, len(x))
    np.testing.assert_array_equal(both.tangents["x"].x[:, 0], run.tangents["x"].x)


def test_determinants_are_those_of_the_tangents():
    """Of a field that depends on time, with compensated sums."""
    system = lv.PolynomialField(
        lambda t, x, params: [x[1], -x[0] + t * x[0] ** 3], x=("x", "y"), params={}
    )
    method = lv.VolumeSplitting(compensated=True)
    run = lv.integrate(system, method, **RUN, x=[1.0, 0.2], tangents={"x": np.eye(2)})
    assert abs(np.linalg.det(run.tangents["x"].x[-1]) - 1) < 1e-13
    small = 1e-6
    ends = [lv.integrate(system, method, **RUN, x=[1.0 + s, 0.2]).x[-1] for s in (small, -small)]
    wanted = (ends[0] - ends[1]) / (2 * small)
    np.testing.assert_allclose(run.tangents["x"].x[-1, 0], wanted, atol=1e-8)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"tangents": {"params.D": 1.0}}, "no direction 'params.D'"),
        (
            {"tangents": {"x": [1, 0]}},
            r"shape \(3,\) for one direction or \(d, 3\) for d of them, not",
        ),
        ({"tangents": {"v": [1, 0, 0]}}, "no direction 'v'"),
        ({"tangents": {"x": [1, 0, 0]}, "states": False}, "leave out states=False"),
        ({"tangents": {"x": [1, 0, 0]}, "store": "here.zarr"}, "without store="),
    ],
)
def test_bad_calls_are_refused(more, says):
    """By name."""
    system, plan, x = planned("abc_flow")
    with pytest.raises((TypeError, ValueError), match=says):
        lv.integrate(system, plan, **RUN, x=x, **more)


def test_tangents_beyond_all_numbers_end_a_run():
    """With a sentence, and all that was before."""
    system = lv.PolynomialField(lambda t, x, params: [x[0], -x[1]], x=("x", "y"))
    with pytest.raises(lv.IntegrationError, match="grown beyond the largest number") as failed:
        lv.integrate(
            system, lv.VolumeSplitting(), t=(0, 1000), h=1.0, x=[0.0, 1.0],
            tangents={"x": [1.0, 0.0]},
        )  # fmt: skip
    assert np.isfinite(failed.value.solution.tangents["x"].x).all()
    assert failed.value.solution.t[-1] > 700
