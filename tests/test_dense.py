"""States at given times: as accurate as those at ends of steps, and what is asked for wrongly."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from registry import ALL

import liouville as lv
from liouville import problems
from liouville._cli.models import times_at
from liouville._runs import between
from liouville._runs.execute import execute

wire = problems.load("moving_wire")

# the same bead by its momenta, so that v is no z, depends on time, and has a z that is no velocity
momenta = lv.Hamiltonian(
    lambda t, q, p, params: ca.dot(p, p) / (2 * (1 + 0.2 * ca.sin(t))) + q[1] + q[0] ** 4 / 8,
    lambda t, q, params: q[1] - q[0] ** 2 / 2 - ca.sin(2 * t) / 2,
    q=("x", "y"),
)
FORMS = {"velocities": (wire.system, wire.start), "momenta": (momenta, None)}


def started(form):
    system, start = FORMS[form]
    return system, start or momenta.consistent(q=(1.0, 0.5), p=(0.3, 1.0))


def far_off(form, method, h, places):
    """Return the largest errors of both halves of the state within the first step."""
    system, start = started(form)
    run = lv.integrate(system, method, t=(0, h), steps=1, **start)
    points = run(h * places)
    exact = [
        lv.integrate(system, lv.Spark(8), t=(0, h * x), steps=4, every=4, **start) for x in places
    ]
    return [
        max(
            np.abs(found - other.states[name][-1]).max()
            for found, other in zip(rows, exact, strict=True)
        )
        for name, rows in ((name, points.states[name]) for name in (*system.states, "lam"))
    ]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("stages", [1, 2, 3])
def test_a_single_step_has_the_local_order_of_the_method(form, stages):
    places, h = np.array([0.35, 0.6]), 0.2
    coarse, fine = (far_off(form, lv.Spark(stages), x, places) for x in (h, h / 2))
    orders = np.log2(np.divide(coarse, fine))
    assert min(orders) > 2 * stages + 1 - 0.5


def swing():
    """Return a pendulum that swings by 2.5 to both sides, and its start."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
        lambda t, q, params: ca.dot(q, q) - 1,
        q=("x", "y"),
    )
    return system, {"q": [np.sin(2.5), -np.cos(2.5)], "v": [0.0, 0.0]}


@pytest.fixture(scope="module")
def exact():
    system, start = swing()
    times = np.linspace(0.0125, 9.9875, 80)
    return lv.integrate(system, lv.Spark(8), t=(0, 10), h=0.01, t_eval=times, **start)


@pytest.mark.parametrize("stages", [2, 3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("steps", ["equal", "controlled"])
def test_states_between_long_steps_are_as_accurate_as_those_at_their_ends(stages, steps, exact):
    system, start = swing()
    run = {"t": (0, 10), **start}
    run |= {"rtol": 1e-8} if steps == "controlled" else {"h": 0.02 + 0.03 * (stages - 1)}
    method = lv.Spark(stages)
    whole = lv.integrate(system, method, **run)
    at_ends = lv.integrate(system, lv.Spark(8), t=(0, 10), h=0.01, t_eval=whole.t, **start)
    found = lv.integrate(system, method, t_eval=exact.t, **run)
    assert found.stats["steps"] == whole.stats["steps"]
    for name in ("q", "v", "lam"):
        bound = 1.5 * np.abs(whole.states[name] - at_ends.states[name]).max() + 1e-12
        between = whole(exact.t).states[name]
        assert np.abs(found.states[name] - exact.states[name]).max() < bound
        assert np.abs(between - exact.states[name]).max() < bound
    for name in ("constraint", "hidden"):
        assert np.abs(found.residuals[name]).max() < 1e-14


METHODS = [
    lv.Spark(2),
    lv.Spark(3, points="radau"),
    lv.LobattoPair(2),
    lv.LobattoPair(3),
    lv.Composition(lv.Spark(1), "SS6s11"),
    lv.HHT(-0.1),
    lv.GeneralizedAlpha(0.8),
    lv.ArnoldBruls(0.8),
]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: type(method).__name__)
@pytest.mark.parametrize("backwards", [False, True], ids=["forwards", "backwards"])
def test_given_times_are_those_of_a_run_that_ends_there(method, backwards):
    span = (0.0, -2.0) if backwards else (0.0, 2.0)
    whole = lv.integrate(wire.system, method, t=span, h=0.1, **wire.start)
    times = np.concatenate([whole.t[:5], np.linspace(*span, 31)])
    times = np.unique(times)[:: -1 if backwards else 1]
    some = lv.integrate(wire.system, method, t=span, h=0.1, t_eval=times, **wire.start)
    np.testing.assert_array_equal(some.t, times)
    assert some.stats["steps"] == whole.stats["steps"]
    # at the ends of steps are the states of these
    for name, values in whole(whole.t).states.items():
        np.testing.assert_array_equal(values, whole.states[name], err_msg=name)
        ends = np.isin(times, whole.t)
        np.testing.assert_array_equal(
            some.states[name][ends], whole.states[name][np.isin(whole.t, times)], err_msg=name
        )
    assert np.abs(some.residuals["constraint"]).max() < 1e-14
    assert repr(method) == whole.method
    exact = lv.integrate(wire.system, lv.Spark(6), t=span, h=0.02, t_eval=times, **wire.start)
    on_ends = lv.integrate(wire.system, lv.Spark(6), t=span, h=0.02, t_eval=whole.t, **wire.start)
    points = whole(times)
    for name in ("q", "v"):
        bound = 1.5 * np.abs(whole.states[name] - on_ends.states[name]).max() + 1e-13
        assert np.abs(some.states[name] - exact.states[name]).max() < bound
        assert np.abs(points.states[name] - exact.states[name]).max() < bound


def test_times_may_come_in_any_order_and_alone():
    run = lv.integrate(wire.system, lv.Spark(3), t=(0, 1), h=0.1, **wire.start)
    three = run([0.31, 0.05, 0.77])
    np.testing.assert_array_equal(three.t, [0.31, 0.05, 0.77])
    for k, t in enumerate(three.t):
        one = run(t)
        assert one.t == t
        assert len(one) == 1
        assert {name: x.shape for name, x in one.states.items()} == {
            "q": (2,), "v": (2,), "lam": (1,), "p": (2,)
        }  # fmt: skip
        np.testing.assert_array_equal(one.q, three.q[k])
        np.testing.assert_array_equal(one.lam, three.lam[k])
    assert repr(three) == "<3 Points, t = 0.31 to 0.77: q, v, lam, p>"
    none = run([])
    assert (len(none), none.q.shape, none.lam.shape) == (0, (0, 2), (0, 1))
    assert repr(none).startswith("<0 Points")
    with pytest.raises(AttributeError, match=r"no 'z'\nhint: their states are q, v, lam, p"):
        _ = three.z
    with pytest.raises(ValueError, match="read-only"):
        three.q[0] = 0.0


def test_a_composed_method_and_controlled_steps_have_dense_output():
    exact = lv.integrate(wire.system, lv.Spark(6), t=(0, 2), h=0.05, **wire.start)(0.777)
    composed = lv.Composition(lv.Spark(1), "SS6s11")
    found = lv.integrate(wire.system, composed, t=(0, 2), h=0.05, **wire.start)(0.777)
    np.testing.assert_allclose(found.q, exact.q, atol=1e-8)
    damped = lv.integrate(
        wire.system, lv.HHT(0.0), t=(0, 2), rtol=1e-6, t_eval=[0.777], **wire.start
    )
    np.testing.assert_allclose(damped.q[0], exact.q, atol=1e-4)
    np.testing.assert_allclose(damped.acceleration[0, 1], damped.a[0, 1], atol=20)


def test_given_times_keep_what_is_observed_without_the_states():
    times = [0.123, 0.5, 0.9]
    run = lv.integrate(
        wire.system, lv.Spark(3), t=(0, 1), h=0.05, t_eval=times, states=False,
        observe={"height": lambda t, q, v, params: q[1]}, **wire.start,
    )  # fmt: skip
    whole = lv.integrate(wire.system, lv.Spark(3), t=(0, 1), h=0.05, **wire.start)
    np.testing.assert_allclose(run.observed["height"], whole(times).q[:, 1], atol=1e-14)


@pytest.mark.parametrize("form", FORMS)
def test_a_member_of_an_ensemble_has_the_dense_output_of_a_run_of_its_own(form):
    system, start = started(form)
    params = {"params": {"d": [0.1, 0.2, 0.3]}} if form == "velocities" else {}
    rows = {name: np.tile(x, (3, 1)) for name, x in start.items()}
    many = lv.ensemble(system, lv.Spark(3), t=(0, 1), h=0.1, **params, **rows)
    for k, times in ((0, 0.55), (2, [0.05, 0.98, 1.0])):
        of_one = {"params": {"d": params["params"]["d"][k]}} if params else {}
        one = lv.integrate(system, lv.Spark(3), t=(0, 1), h=0.1, **of_one, **start)(times)
        found = many.member(k)(times)
        for name, values in one.states.items():
            np.testing.assert_array_equal(found.states[name], values)
    with pytest.raises(ValueError, match=r"of one member of an ensemble\nhint: solution\.member"):
        many(0.5)
    thin = lv.ensemble(system, lv.Spark(3), t=(0, 1), h=0.1, every=2, **params, **rows)
    with pytest.raises(ValueError, match="states of all steps"):
        thin.member(0)(0.5)


@pytest.mark.parametrize("kind", ["mechanism", "semi-explicit", "field", "ended", "redundant"])
def test_members_at_given_times_have_the_bits_of_runs_alone(kind, tmp_path):
    times, events = [0.11, 0.4, 0.97], None
    params = {}
    if kind == "field":
        system, method = problems.abc_flow.system, lv.VolumeSplitting()
        rows = {"x": np.random.default_rng(1).uniform(0, 6, (40, 3))}
        method = lv.plan(system, method, h=0.1, **rows)
    elif kind == "semi-explicit":
        problem, method = ALL["index 2"], lv.Spark(2)
        system, both = problem.system, [problem.exact(0.0)] * 2
        rows = {x: np.stack([one[x] for one in both]) for x in system.states}
    else:
        name = "doubled_rod" if kind == "redundant" else "pendulum"
        system, method = problems.load(name).system, lv.Spark(3)
        rows = {x: np.stack([value, value]) for x, value in problems.load(name).start.items()}
        params = {"params": {"g": np.array([9.0, 3.0])}}
    if kind == "ended":
        first = rows["q"][0, 0]
        events = {"low": lv.Event(lambda t, q, v, lam, params: q[0] - 0.9 * first, terminal=True)}
    run = {"t": (0, 1), "steps": 10, "t_eval": times, "events": events}
    many = lv.ensemble(system, method, **run, **params, **rows)
    for k in range(many.members):
        of_one = {"params": {"g": params["params"]["g"][k]}} if params else {}
        start = {name: x[k] for name, x in rows.items()}
        one, found = lv.integrate(system, method, **run, **of_one, **start), many.member(k)
        np.testing.assert_array_equal(found.t, one.t)
        for name, values in one.states.items():
            np.testing.assert_array_equal(found.states[name], values)
        for name, value in one.initial.items():
            assert found.initial[name] == value
            drift = one.invariant_drift(name)
            np.testing.assert_array_equal(found.invariant_drift(name), drift)
    assert bool(many.endings) == (kind == "ended")
    many.save(tmp_path / "many.nc")
    again = lv.load(tmp_path / "many.nc")
    for name, value in many.initial.items():
        np.testing.assert_array_equal(again.initial[name], value)


def test_what_has_no_dense_output_says_why():
    keep = {"t": (0, 1), "h": 0.1, **wire.start}
    run = lv.integrate(wire.system, lv.Spark(3), **keep)
    with pytest.raises(ValueError, match=r"t = 1\.5 is outside the run, which goes from 0 to 1"):
        run([0.5, 1.5])
    with pytest.raises(ValueError, match="t = nan is outside"):
        run(np.nan)
    with pytest.raises(TypeError, match="t must be a number or an array of numbers, not 'now'"):
        run("now")
    with pytest.raises(ValueError, match=r"does not carry\nhint: .*load"):
        replace(run, system=None)(0.5)
    for less in ({"every": 2}, {"states": False}, {"t_eval": [0.5]}):
        other = lv.integrate(wire.system, lv.Spark(3), **keep, **less)
        with pytest.raises(ValueError, match=r"all steps .*\nhint: integrate with every=1"):
            other(0.5)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([], "t_eval must have one time at least"),
        ([0.5, 0.2], r"in the order of the run\nhint: np.unique"),
        ([0.5, np.nan], "t_eval must be finite"),
        ([0.5, 1.2], r"t_eval must be within t = \(0, 1\), not 1\.2"),
        ("often", "t_eval must be a sequence of numbers, not 'often'"),
        (0.5, "t_eval must be a sequence of numbers, not 0.5"),
        ([0.5], "give either every= or t_eval="),
    ],
)
def test_wrong_times_are_refused(times, message):
    every = 2 if "every" in message else 1
    with pytest.raises((TypeError, ValueError), match=message):
        lv.integrate(
            wire.system, lv.Spark(3), t=(0, 1), h=0.1, t_eval=times, every=every, **wire.start
        )


@pytest.mark.parametrize("name", ["moving_wire", "abc_flow"])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_time_a_rounding_beyond_the_end_is_the_end(name, sign):
    """As multiples of a step are."""
    problem = problems.load(name)
    method = lv.VolumeSplitting() if name == "abc_flow" else lv.Spark(3)
    times = sign * 0.1 * np.arange(4)
    end = sign * 0.3
    assert abs(times[-1]) > 0.3
    run = {"t": (0, end), "steps": 6, **problem.start}
    whole = lv.integrate(problem.system, method, **run)
    found = lv.integrate(problem.system, method, t_eval=times, **run)
    assert found.t[-1] == end
    for state, values in found.states.items():
        np.testing.assert_allclose(values[[0, -1]], whole.states[state][[0, -1]], atol=1e-13)
    if name == "moving_wire":
        assert whole(times).t[-1] == end
    with pytest.raises(ValueError, match=r"t_eval must be within t = .*, not -?0\.3000"):
        lv.integrate(problem.system, method, t_eval=times * (1 + 1e-14), **run)
    back = run | {"t": (end, 0.0)}
    if name == "abc_flow":  # which begins anywhere
        assert lv.integrate(problem.system, method, t_eval=times[::-1], **back).t[0] == end
    assert times_at((0.0, end), times[1:].tolist()) == [*times[1:-1], end]


def test_members_on_an_executor_have_no_given_times():
    rows = {name: np.stack([x, x]) for name, x in wire.start.items()}
    call = {"t": (0, 1), "h": 0.1, "t_eval": [0.5], **rows}
    sentence = r"on an executor has no states at given times\nhint: leave executor= out"
    with ThreadPoolExecutor(1) as executor, pytest.raises(TypeError, match=sentence):
        lv.ensemble(wire.system, lv.Spark(3), executor=executor, **call)


def test_events_and_times_of_waves_are_refused_with_what_helps():
    wave = lv.Schrodinger(lv.Lattice(4))
    with pytest.raises(TypeError, match=r"events is not for .*\nhint: observe= records"):
        lv.integrate(wave, "auto", t=(0, 1), events={"e": sum}, psi=[1, 0, 0, 0])
    with pytest.raises(TypeError, match=r"t_eval is not for .*\nhint: t= takes the times"):
        lv.integrate(wave, "auto", t=(0, 1), t_eval=[0.5], psi=[1, 0, 0, 0])


def test_all_parts_of_steps_are_made_in_one_run(monkeypatch):
    runs, pendulum = [], problems.load("pendulum")

    def counted(runner):
        runs.append(runner)
        return execute(runner)

    monkeypatch.setattr(between, "execute", counted)
    for method in (lv.Spark(3), lv.HHT()):
        run = lv.integrate(pendulum.system, method, t=(0, 5), h=0.1, **pendulum.start)
        times = np.linspace(0, 5, 333)
        found = run(times)
        assert len(runs) == 1
        runs.clear()
        one = [run(t) for t in times[::37]]
        np.testing.assert_array_equal(found.q[::37], [x.q for x in one])
        np.testing.assert_array_equal(found.lam[::37], [x.lam for x in one])
        runs.clear()
