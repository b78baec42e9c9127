"""Ensembles of fields with parameters of their own, and states at equal times."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_field_gradients import made

import liouville as lv
from liouville import plot
from liouville.problems import load

V = lv.VolumeSplitting
RUN = {"t": (0.0, 2.0), "h": 0.05, "every": 10}


@pytest.mark.parametrize("name", ["abc", "stretched", "driven"])
def test_members_have_the_bits_of_runs_of_their_own(name):
    """Each with its parameters, by the plan of the first; observables and threads too."""
    system, _, x = made(name)
    rng = np.random.default_rng(1)
    starts = x + 0.1 * rng.standard_normal((7, x.size))
    which = next(iter(system.params))
    values = system.params[which] + 0.1 * rng.random(7)
    observe = {"size": lambda t, x, params: getattr(params, which) * x[0]}
    run = {**RUN, "observe": observe}
    plan = lv.plan(system, V(), h=0.05, x=starts, params={which: values[0]})
    many = lv.ensemble(system, plan, **run, x=starts, params={which: values}, threads=2)
    assert many.varied == (which,)
    for k in range(7):
        alone = lv.integrate(system, plan, **run, x=starts[k], params={which: values[k]})
        np.testing.assert_array_equal(many.x[:, k], alone.x)
        np.testing.assert_array_equal(many.observed["size"][:, k], alone.observed["size"])
        assert many.member(k).params[which] == values[k]
    same = lv.ensemble(system, plan, **RUN, x=starts)
    for k in range(7):
        np.testing.assert_array_equal(
            same.x[:, k], lv.integrate(system, plan, **RUN, x=starts[k]).x
        )
    by_itself = lv.ensemble(system, V(), **run, x=starts, params={which: values})
    np.testing.assert_allclose(by_itself.x[-1], many.x[-1], atol=1e-4)


def test_sections_and_tangents_of_such_members():
    """A section of each is that of its own field, and so are derivatives by starts."""
    system, _, _ = made("abc")
    starts, values = [[0.3, 0.2, 1.0], [2.0, 1.0, 0.1]], np.array([1.0, 0.8])
    run = {"t": (0.0, 20.0), "h": 0.1, "plane": "x2", "period": 0.5}
    plan = lv.plan(system, V(), h=0.1, x=starts)
    both = lv.section(system, plan, **run, x=starts, params={"A": values})
    for k in (0, 1):
        one = lv.section(system, plan, **run, x=starts[k : k + 1], params={"A": values[k]})
        assert len(one) > 1
        np.testing.assert_allclose(both.x[both.member == k], one.x, rtol=0, atol=1e-11)
    many = lv.ensemble(
        system, plan, **RUN, x=starts, params={"A": values}, tangents={"x": np.eye(3)}
    )
    one = lv.integrate(
        system, plan, **RUN, x=starts[1], params={"A": 0.8}, tangents={"x": np.eye(3)}
    )
    np.testing.assert_array_equal(many.tangents["x"].x[:, 1], one.tangents["x"].x)


def test_a_member_without_some_terms_is_split_by_the_same_method():
    """In any place and any chunk, with the bits of a run of its own; gradients too."""
    system, _, x = made("abc")
    method = V("exponentials", "natural", composition="BM4", linear="split")
    values = np.array([0.0, 1.0, 0.0, 0.5])
    run = {**RUN, "x": x, "params": {"A": values}}
    many, pullback = lv.vjp(system, method, wrt=["x", "params.B"], **run)
    found = pullback(x=np.ones_like(many.x))
    for k, value in enumerate(values):
        alone, own = lv.vjp(
            system, method, wrt=["x", "params.B"], **{**run, "params": {"A": value}}
        )
        np.testing.assert_array_equal(many.x[:, k], alone.x)
        for name, gradient in own(x=np.ones_like(alone.x)).items():
            np.testing.assert_array_equal(found[name][k], gradient)
    free = lv.ensemble(system, V(), **run)
    assert np.abs(free.x - many.x).max() < 1e-4
    with ThreadPoolExecutor(2) as executor:
        for chunk in (1, 3):
            cut = lv.ensemble(system, V(), **run, executor=executor, chunk=chunk)
            np.testing.assert_array_equal(cut.x, free.x)
    with pytest.raises(
        ValueError, match="plan must be for a field of 3 variables and 6 terms, not 3 and 4"
    ):
        lv.integrate(
            system, lv.plan(system, method, h=0.05, x=x[None]), **RUN, x=x, params={"A": 0}
        )
    still = lv.ensemble(system, V(), **RUN, x=x, params={name: [1.0, 0.0] for name in "ABC"})
    np.testing.assert_array_equal(still.x[-1, 1], x)


def test_a_member_that_fails_names_its_own_pieces():
    """Of the first member's pieces there is none of that number."""
    system = lv.PolynomialField(
        lambda t, x, p: [p.a * x[0] * x[1] + p.b * x[1], -p.a * x[1] ** 2 / 2], x=2,
        params={"a": 1.0, "b": 1.0},
    )  # fmt: skip
    method = V("exponentials", "natural", composition="S2", linear="split")
    found = lv.ensemble(
        system, method, t=(0, 6), h=0.5, x=[1.0, -0.5], params={"a": [0.0, 1.0], "b": [1.0, 1.0]}
    )
    alone = {"t": (0, 6), "h": 0.5, "x": [1.0, -0.5], "params": {"a": 1.0}}
    with pytest.raises(lv.IntegrationError) as error:
        lv.integrate(system, method, **alone)
    assert [*found.failures] == [1]
    assert found.failures[1].message == str(error.value)


def test_one_start_is_that_of_all_members():
    """Where parameters have rows; each member has the bits of a run of its own."""
    system, _, x = made("stretched")
    which = next(iter(system.params))
    values = system.params[which] * np.array([1.0, 1.1, 0.9])
    run = {**RUN, "params": {which: values}}
    one = lv.ensemble(system, V(), **run, x=x)
    np.testing.assert_array_equal(one.x, lv.ensemble(system, V(), **run, x=np.tile(x, (3, 1))).x)
    with pytest.raises(ValueError, match="parameter 'B' must have 3 members as parameter 'A'"):
        lv.ensemble(made("abc")[0], V(), **RUN, x=[0, 0, 0], params={"A": [1] * 3, "B": [1] * 2})
    with pytest.raises(ValueError, match=r"x must have shape \(P, 3\) for P members, not \(3,\)"):
        lv.ensemble(made("abc")[0], V(), **RUN, x=[0.0, 0.0, 0.0])


def test_tangents_by_parameters_of_members_are_refused():
    """By name."""
    system, _, _ = made("abc")
    with pytest.raises(ValueError, match="no tangents by parameters"):
        lv.ensemble(
            system, V(), **RUN, x=np.zeros((2, 3)), params={"A": [1.0, 0.5]},
            tangents={"params.B": 1.0},
        )  # fmt: skip


@pytest.mark.parametrize(
    ("t", "offset"), [((0.0, 7.0), 0.0), ((0.3, 7.0), 0.1), ((2.0, -1.5), 0.5)]
)
def test_strobe_maps_are_states_at_their_times(t, offset):
    """From any start, forwards and back; each point as of a run that ends there."""
    system, _, x = made("driven")
    starts = x + np.array([[0.0, 0.0], [0.1, -0.2]])
    found = lv.section(system, V(), t=t, h=0.02, plane="t", period=1.5, offset=offset, x=starts)
    times = offset + 1.5 * np.arange(-10, 10)
    low, high = sorted(t)
    wanted = times[(times >= low) & (times <= high) & (times != t[0])]
    wanted = wanted if t[1] > t[0] else wanted[::-1]
    np.testing.assert_allclose(found.t[found.member == 1], wanted, atol=1e-13)
    for k in (0, 1):
        for at, point in zip(wanted, found.x[found.member == k], strict=True):
            run = lv.integrate(system, V(composition="BM6"), t=(t[0], at), h=0.005, x=starts[k])
            np.testing.assert_allclose(point, run.x[-1], atol=1e-6)


def test_strobe_maps_of_members_that_fail():
    """Their points are those before, and they are listed; parameters of each are taken too."""
    system = lv.PolynomialField(
        lambda t, x, p: [p.a * x[0] * x[1], -p.a * x[1] ** 2 / 2], x=2, params={"a": 1.0}
    )
    found = lv.section(
        system, V("exponentials"), t=(0, 6), h=0.5, plane="t", period=1.0,
        x=[[1.0, 0.5], [1.0, -0.5]], params={"a": [1.0, 0.9]},
    )  # fmt: skip
    assert list(found.failures) == [1]
    assert (found.member == 0).sum() == 6
    assert 1 <= (found.member == 1).sum() < 6
    assert plot.section(found).get_title(loc="left").startswith("t = 0 mod 1: 10 crossings")


def test_many_members_of_a_problem():
    """As many as blocks do not fill."""
    problem = load("hill_vortex")
    starts = np.random.default_rng(2).uniform(-0.3, 0.3, (33, 3))
    names = [*problem.system.params]
    if names:
        values = {names[0]: np.linspace(0.9, 1.1, 33)}
        run = lv.ensemble(problem.system, V(), t=(0, 1), steps=5, x=starts, params=values)
        assert np.isfinite(run.x).all()
