"""Fits of functions of states, of multipliers, through impacts, of several trials, and robust."""

import re

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2, f

import liouville as lv

PENDULUM = lv.Lagrangian(
    lambda t, q, v, params: params.m * (ca.dot(v, v) / 2 - params.g * q[1]),
    lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
    q=("x", "y"),
    params={"m": 1.0, "g": 9.81, "l": 2.0},
)
RUN = {"t": (0.0, 2.0), "h": 0.05, "every": 2}
METHOD = lv.Spark(3)
START = {"q": [1.2, -1.6], "v": [0.0, 0.0]}
TRUTH = lv.integrate(PENDULUM, METHOD, **RUN, **START)
ANGLE = {"angle": lambda t, q, v, params: ca.atan2(q[0], -q[1])}

FALL = lv.Lagrangian(
    lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=("x",),
    params={"g": 9.81, "e": 0.8},
)  # fmt: skip
BOUNCE = lv.Impact(lambda t, q, v, lam, params: params.e)
FLOOR = {"floor": lv.Event(lambda t, q, v, lam, params: q[0], direction="down", reset=BOUNCE)}
SPRING = lv.Lagrangian(
    lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
    force=lambda t, q, v, params: -params.c * v[0] + params.u,
    q=("x",),
    params={"k": 9.0, "c": 0.2, "u": 0.0},
)


def noise(size, seed=0):
    return np.random.default_rng(seed).standard_normal(size)


def test_functions_of_states_are_data():
    """An angle of a pendulum in Cartesian coordinates, from a start that is free, is exact."""
    data = {"t": TRUTH.t, "angle": np.arctan2(TRUTH.q[:, 0], -TRUTH.q[:, 1])}
    found = lv.fit(
        PENDULUM, METHOD, data, h=0.05, params={"g": 9.0}, free=("q", "v"), observe=ANGLE,
        q=[1.1, -1.7], v=[0.1, 0.0],
    )  # fmt: skip
    assert found.params["g"] == pytest.approx(9.81, abs=1e-9)
    np.testing.assert_allclose(found.start["q"], START["q"], atol=1e-10)
    np.testing.assert_allclose(found.start["v"], 0, atol=1e-9)


def test_functions_of_parameters_and_of_several_values():
    """A quantity may see parameters that nothing else does, and be a column."""
    observe = {"seen": lambda t, q, v, params: ca.vertcat(params.u * q[0], v[0] + t)}
    true = lv.integrate(SPRING, METHOD, **RUN, q=[1.0], v=[0.0])
    seen = np.column_stack([2.0 * true.q[:, 0], true.v[:, 0] + true.t])
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
        force=lambda t, q, v, params: -0.2 * v[0], q=("x",), params={"k": 8.0, "u": 1.0},
    )  # fmt: skip
    call = {"h": 0.05, "params": ["k", "u"], "observe": observe, "q": [1.0], "v": [0.0]}
    found = lv.fit(system, METHOD, {"t": true.t, "seen": seen}, **call)
    assert [found.params["k"], found.params["u"]] == pytest.approx([9.0, 2.0], abs=1e-9)
    one = lv.fit(system, METHOD, {"t": true.t, "seen[0]": seen[:, 0]}, **call)
    assert [one.params["k"], one.params["u"]] == pytest.approx([9.0, 2.0], abs=1e-9)


def test_multipliers_are_data():
    """The tension of a rod, by the name of its constraint, gives the mass, which no motion does."""
    data = {"t": TRUTH.t, "rod": TRUTH.lam[:, 0]}
    found = lv.fit(PENDULUM, METHOD, data, h=0.05, params={"m": 1.3, "g": 9.0}, **START)
    assert [found.params["m"], found.params["g"]] == pytest.approx([1.0, 9.81], abs=1e-9)
    with pytest.raises(ValueError, match=r"do not determine 'params\.m'"):
        lv.fit(PENDULUM, METHOD, {"t": TRUTH.t, "q": TRUTH.q}, h=0.05, params=["m"], **START)


@pytest.mark.parametrize("steps", [{"h": 0.02}, {"rtol": 1e-9}], ids=["h", "rtol"])
def test_restitution_from_bounces(steps):
    """Heights of a ball between three bounces give its restitution and gravity."""
    times = np.linspace(0.05, 2.0, 40)
    true = lv.integrate(
        FALL, METHOD, t=(0, 2), h=0.02, t_eval=times, events=FLOOR, q=[1.0], v=[0.0]
    )
    assert len(true.events["floor"].t) >= 3
    found = lv.fit(
        FALL, METHOD, {"t": times, "x": true.q[:, 0]}, params={"e": 0.75, "g": 9.6}, events=FLOOR,
        t0=0.0, q=[1.0], v=[0.0], **steps,
    )  # fmt: skip
    assert [found.params["e"], found.params["g"]] == pytest.approx([0.8, 9.81], abs=1e-8)


def test_rates_of_a_flow_are_fitted_to_tracks_and_to_functions_of_them():
    """Where squares are least the pullbacks of all runs together are nothing."""
    flow = lv.PotentialField(
        lambda t, x, params: (
            params.a * ca.sin(x[0]) * ca.sin(x[1]) + params.b[0] * ca.cos(x[0] - t)
        ),
        x=("x", "y"),
        params={"a": 1.3, "b": [0.35]},
    )
    rng, sigma, call = np.random.default_rng(2), 0.01, {"t": (0, 3), "steps": 60, "every": 5}
    starts, trials = [[1.7, 0.9], [0.4, 0.3]], []
    for x in starts:
        run = lv.integrate(flow, **call, x=x)
        seen = run.x + sigma * rng.standard_normal(run.x.shape)
        trials.append(lv.Trial({"t": run.t, "x": seen[:, 0], "far": np.hypot(*seen.T)}, {"x": x}))
    found = lv.fit(
        flow, data=trials, h=0.05, params={"a": 1.0, "b": [0.2]}, free="x", sigma=sigma,
        observe={"far": lambda t, x, params: ca.norm_2(x)},
    )  # fmt: skip
    assert found.names[:3] == ("params.a", "params.b[0]", "trials[0].x.x")
    assert 0.5 < found.chi2 / found.dof < 1.5
    truth = {"params.a": 1.3, "params.b[0]": 0.35}
    assert all(abs(found.values[k] - x) < 4 * found.errors[k] for k, x in truth.items())
    total = np.zeros(2)
    for trial, fitted in zip(trials, found.trials, strict=True):
        own = {"params": found.params, **fitted.start}
        run, pullback = lv.vjp(flow, "auto", wrt=["params.a", "params.b", "x"], **call, **own)
        size = np.hypot(*run.x.T)
        away = (size - trial.data["far"]) / sigma**2
        along = away[:, None] * run.x / size[:, None]
        along[:, 0] += (run.x[:, 0] - trial.data["x"]) / sigma**2
        by = pullback(x=along)
        total += [by["params.a"], by["params.b"][0]]
        assert np.abs(by["x"] * sigma).max() < 1e-4
    assert np.abs(total * [found.errors[k] for k in truth]).max() < 1e-4


def test_trials_have_parameters_in_common():
    """Two oscillations under known forces from unknown starts have one stiffness."""
    trials, truths = [], ({"u": 0.0}, {"u": 1.5})
    for k, own in enumerate(truths):
        run = lv.integrate(SPRING, METHOD, t=(0, 3 + k), steps=60 + 20 * k, params=own,
                           q=[1.0 - k], v=[0.5 * k])  # fmt: skip
        data = {"t": run.t, "x": run.q[:, 0] + 1e-3 * noise(run.t.size, k)}
        trials.append(lv.Trial(data, {"q": [0.8 - k], "v": [0.0]}, own))
    call = {"h": 0.05, "params": {"k": 8.0, "c": 0.1}, "free": ("q", "v")}
    found = lv.fit(SPRING, METHOD, trials, sigma=1e-3, **call)
    assert found.names == (
        "params.k", "params.c", "trials[0].q.x", "trials[0].v.x", "trials[1].q.x", "trials[1].v.x",
    )  # fmt: skip
    truth = np.array([9.0, 0.2, 1.0, 0.0, 0.0, 0.5])
    values = [found.params["k"], found.params["c"]]
    values += [x[0] for trial in found.trials for x in trial.start.values()]
    off = np.array(values) - truth
    assert off @ np.linalg.solve(found.covariance, off) < chi2.ppf(0.999, 6)
    assert abs(np.diagonal(found.correlation) - 1).max() < 1e-12
    # a start has no part in the other trial's, but through what they share
    alone = [lv.fit(SPRING, METHOD, [trial], sigma=1e-3, **call) for trial in trials]
    for name in ("params.k", "params.c"):
        joined = sum(each.errors[name] ** -2 for each in alone) ** -0.5
        assert found.errors[name] <= 1.001 * joined
    assert found.residuals.size == sum(trial.residuals.size for trial in found.trials)
    with pytest.raises(
        AttributeError, match=r"2 trials, each with a start .*\nhint: write fit\.tri"
    ):
        _ = found.solution
    assert "trials[1].v.x = " in repr(found)


def test_a_prior_is_a_measurement():
    """Of one measurement of a value and a prior the mean is weighed by both deviations."""
    data = {"t": [1.0], "x": [-9.81 / 2 + 0.1]}
    call = {"h": 0.1, "t0": 0.0, "params": ["g"], "sigma": 0.05, "q": [0.0], "v": [0.0]}
    found = lv.fit(FALL, METHOD, data, priors={"g": (9.9, 0.2)}, **call)
    weights, values = np.array([0.1, 0.2]) ** -2, np.array([9.61, 9.9])
    assert found.params["g"] == pytest.approx(weights @ values / weights.sum(), rel=1e-12)
    assert found.errors["params.g"] == pytest.approx(weights.sum() ** -0.5, rel=1e-12)
    assert (found.residuals.size, found.dof) == (2, 1)


@pytest.mark.parametrize("loss", ["huber", "soft_l1", "cauchy"])
def test_outliers_move_a_robust_fit_little(loss):
    """Ten of 201 are off by fifty deviations, as by a weaker damping."""
    t = np.linspace(0, 5, 201)
    run = lv.integrate(SPRING, METHOD, t=(0, 5), steps=200, q=[1.0], v=[0.0])
    seen = run.q[:, 0] + 1e-3 * noise(t.size)
    late = slice(100, None, 10)
    seen[late] += 0.05 * np.sign(run.q[late, 0])
    call = {"h": 0.05, "params": {"k": 8.9, "c": 0.21}, "sigma": 1e-3, "q": [1.0], "v": [0.0]}
    plain = lv.fit(SPRING, METHOD, {"t": t, "x": seen}, **call)
    found = lv.fit(SPRING, METHOD, {"t": t, "x": seen}, loss=loss, **call)
    off = [abs(each.params["c"] - 0.2) / found.errors["params.c"] for each in (plain, found)]
    assert off[0] > 8
    assert off[1] < 4
    assert found.message == ""
    clean = lv.fit(SPRING, METHOD, {"t": t, "x": run.q[:, 0] + 1e-3 * noise(t.size)}, **call)
    assert found.errors["params.c"] < 1.6 * clean.errors["params.c"]


def test_robust_errors_hold_the_truth_as_often_as_they_say():
    """Of 200 data sets without outliers 190 are expected within 95 %, 181 to 197 with 0.995."""
    run = lv.integrate(SPRING, METHOD, t=(0, 3), steps=30, q=[1.0], v=[0.0])
    call = {"h": 0.1, "params": ["k", "c"], "sigma": 1e-3, "q": [1.0], "v": [0.0]}
    inside = 0
    for seed in range(200):
        data = {"t": run.t, "x": run.q[:, 0] + 1e-3 * noise(run.t.size, seed)}
        found = lv.fit(SPRING, METHOD, data, loss="soft_l1", **call)
        off = np.array([found.params["k"] - 9.0, found.params["c"] - 0.2])
        inside += off @ np.linalg.solve(found.covariance, off) < chi2.ppf(0.95, 2)
    assert 181 <= inside <= 199


def test_a_prior_keeps_its_deviation_beside_a_robust_loss():
    """Nothing measured depends on u; its deviation is the prior's, and k's that of the loss."""
    t = np.linspace(0, 2, 41)
    data = {"t": t, "x": np.cos(3 * t) + 0.01 * noise(t.size, 3)}
    still = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=("x",),
        params={"k": 9.0, "u": 1.0},
    )  # fmt: skip
    call = {"h": 0.05, "sigma": 0.01, "q": [1.0], "v": [0.0], "loss": "huber"}
    alone = lv.fit(still, METHOD, data, params=["k"], **call)
    both = lv.fit(still, METHOD, data, params=["k", "u"], priors={"u": (2.0, 0.5)}, **call)
    assert both.params["u"] == pytest.approx(2.0, abs=1e-6)
    assert both.errors["params.u"] == pytest.approx(0.5, rel=1e-6)
    assert both.errors["params.k"] == pytest.approx(alone.errors["params.k"], rel=1e-6)


def test_a_robust_fit_of_as_many_measurements_as_unknowns_trusts_sigma():
    """One height of a fall: g = 2 x / t^2, twice as uncertain."""
    call = {"h": 0.1, "t0": 0.0, "params": ["g"], "sigma": 0.05, "q": [0.0], "v": [0.0]}
    found = lv.fit(FALL, METHOD, {"t": [1.0], "x": [-4.9]}, loss="huber", **call)
    assert found.params["g"] == pytest.approx(9.8, rel=1e-9)
    assert found.errors["params.g"] == pytest.approx(0.1, rel=1e-9)


def test_a_robust_loss_without_curvature_has_no_errors():
    """Twelve early ones are so far off that Cauchy's loss bends down there."""
    t = np.append(np.linspace(0.1, 0.2, 12), 2.0)
    data = {"t": t, "x": -4.9 * t**2 + np.append(np.full(12, 1.7), 0.0)}
    call = {"h": 0.1, "t0": 0.0, "params": ["g"], "sigma": 1.0, "q": [0.0], "v": [0.0]}
    with pytest.raises(ValueError, match="residuals are beyond sigma that nothing is known of"):
        lv.fit(FALL, METHOD, data, loss="cauchy", **call)


COSINE = lv.Lagrangian(
    lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2, q=("x",), params={"k": 5.0}
)


@pytest.mark.parametrize("call", [{"sigma": 0.05}, {}, {"sigma": 0.05, "loss": "cauchy"}])
def test_a_poor_fit_is_tried_again_from_shorter_times(call):
    """From k = 5 the sum over 16 periods has a minimum near 5; nine is right."""
    t = np.linspace(0, 10, 201)
    data = {"t": t, "x": np.cos(3 * t) + 0.05 * noise(t.size)}
    found = lv.fit(COSINE, METHOD, data, h=0.05, params=["k"], q=[1.0], v=[0.0], **call)
    assert found.params["k"] == pytest.approx(9.0, abs=0.02)
    assert "growing parts of the time led to a lower minimum" in found.message


def test_a_guess_that_leads_to_no_minimum_is_tried_again_from_shorter_times():
    """From k = 20 no trust region ends over 20 s, and an eighth of them leads to nine."""
    t = np.linspace(0, 20, 201)
    data = {"t": t, "x": np.cos(3 * t) + 0.05 * noise(t.size, 1)}
    call = {"h": 0.1, "params": {"k": 20.0}, "q": [1.0], "v": [0.0]}
    found = lv.fit(COSINE, METHOD, data, sigma=0.05, **call)
    assert found.params["k"] == pytest.approx(9.0, abs=0.02)
    assert "led to a minimum, and the guess to none" in found.message


@pytest.mark.parametrize(("call", "says"), [
    ({"sigma": 0.05}, r"residuals are \d+ times as large as sigma: the model, the minimum"),
    ({}, r"residuals spread by 1\.\d of what measurements do: where that is no noise, the model"),
    ({"sigma": 0.05, "loss": "huber"}, r"half of the residuals are beyond 1\d sigma: the model"),
])  # fmt: skip
def test_a_wrong_minimum_is_said(call, says):
    """From k = 1 even shorter times lead to a minimum far from nine."""
    t = np.linspace(0, 20, 201)
    data = {"t": t, "x": np.cos(3 * t) + 0.05 * noise(t.size, 1)}
    found = lv.fit(COSINE, METHOD, data, h=0.1, params={"k": 1.0}, q=[1.0], v=[0.0], **call)
    assert abs(found.params["k"] - 9.0) > 5
    assert re.search(says, found.message)


def test_a_parameter_that_sticks_is_not_determined():
    """Friction holds the block whatever so small a slope is."""
    block = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2 - 9.81 * q[1] + params.a * q[0], q=("x", "y"),
        params={"a": 1.0},
        contacts={"floor": lv.Contact(
            lambda t, q, params: q[1], friction=0.5, slip=lambda t, q, v, params: v[0]
        )},
    )  # fmt: skip
    data, start = {"t": [0.5, 1.0], "x": [0.0, 0.0]}, {"q": [0.0, 0.0], "v": [0.0, 0.0]}
    with pytest.raises(ValueError, match=r"do not determine 'params\.a'"):
        lv.fit(block, METHOD, data, h=0.1, t0=0.0, params=["a"], sigma=1e-3, **start)


def bounces(t, g, e=0.5, height=0.5):
    """Return heights of a ball that is let go, through two hits."""
    first = np.sqrt(2 * height / g)
    up = g * first * e
    second = first + 2 * up / g
    after, last = t - first, t - second
    return np.where(
        t < first, height - g * t**2 / 2,
        np.where(t < second, up * after - g * after**2 / 2, up * e * last - g * last**2 / 2),
    )  # fmt: skip


def test_measurements_through_contacts():
    """Hits lie between the measurements, at other times in each run; closed form and SciPy's."""
    ball = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - params.g * q[0], q=("x",), params={"g": 1.05},
        contacts={"floor": lv.Contact(lambda t, q, params: q[0], restitution=0.5)},
    )  # fmt: skip
    t = np.linspace(0, 2.2, 23)
    x = bounces(t, 1.0) + 0.01 * noise(t.size, 3)
    found = lv.fit(ball, METHOD, {"t": t, "x": x}, h=0.05, params=["g"], sigma=0.01, q=0.5, v=0)
    own = least_squares(lambda g: (bounces(t, g[0]) - x) / 0.01, [1.05], xtol=1e-14, ftol=1e-14)
    assert found.params["g"] == pytest.approx(own.x[0], abs=1e-7)
    assert found.errors["params.g"] == pytest.approx(1 / np.linalg.norm(own.jac), rel=1e-5)


def test_an_interval_of_a_linear_model_is_that_of_its_deviation():
    """The place of a falling mass is linear in gravity, whatever else is fitted."""
    t = np.linspace(0.1, 1, 10)
    data = {"t": t, "x": -9.81 * t**2 / 2 + 0.01 * noise(10)}
    call = {"h": 0.1, "t0": 0.0, "params": ["g"], "q": [0.0], "v": [0.0]}
    for free, factor in (((), chi2.ppf(0.95, 1)), (("q", "v"), chi2.ppf(0.95, 1))):
        found = lv.fit(FALL, METHOD, data, sigma=0.01, free=free, **call)
        width = np.sqrt(factor) * found.errors["params.g"]
        low, high = found.interval("params.g")
        assert (low, high) == pytest.approx(
            (found.params["g"] - width, found.params["g"] + width), rel=1e-3
        )
    own = lv.fit(FALL, METHOD, data, **call)
    width = np.sqrt(f.ppf(0.9, 1, 9)) * own.errors["params.g"]
    assert own.interval("params.g", 0.9)[1] == pytest.approx(own.params["g"] + width, rel=1e-3)
    prior = lv.fit(FALL, METHOD, data, sigma=0.01, priors={"g": (9.9, 0.02)}, **call)
    width = np.sqrt(factor) * prior.errors["params.g"]
    assert prior.interval("params.g")[0] == pytest.approx(prior.params["g"] - width, rel=1e-3)


def test_an_interval_of_a_bent_model_is_not_symmetric():
    """At its ends the sum of squares is above the best by chi square of the level."""
    t = np.array([0.4, 0.8])
    data = {"t": t, "x": np.exp(-3 * t) + np.array([0.05, -0.03])}
    system = lv.Mechanical(
        velocity=lambda t, y, z, params: -params.k * y, momentum=lambda t, y, z, params: z,
        force=lambda t, y, z, params: 0 * z, y=("x",), params={"k": 3.0},
    )  # fmt: skip
    call = {"h": 0.1, "t0": 0.0, "params": ["k"], "sigma": 0.05, "y": [1.0], "z": [0.0]}
    found = lv.fit(system, METHOD, data, **call)
    low, high = found.interval("params.k", 0.9)
    for k in (low, high):
        squares = np.sum((np.exp(-k * t) - data["x"]) ** 2) / 0.05**2
        assert squares - found.chi2 == pytest.approx(chi2.ppf(0.9, 1), rel=2e-2)
    assert high - found.params["k"] > 1.2 * (found.params["k"] - low)
    for name, level, says in (
        ("k", 0.9, "'k' is no number that was fitted"),
        ("params.k", 2.0, "level must be between 0 and 1, not 2"),
    ):
        with pytest.raises(ValueError, match=says):
            found.interval(name, level)


DATA = {"t": [0.0, 1.0], "x": [1.0, 0.5]}
CALL = {"h": 0.1, "params": ["k"], "q": [1.0], "v": [0.0]}
BARE = {"h": 0.1, "params": ["k"]}


@pytest.mark.parametrize(
    ("data", "call", "says"),
    [
        (DATA, CALL | {"rtol": 1e-6}, "steps must be given by h= or by rtol=, not both"),
        (DATA, CALL | {"h": None}, "steps must be given by h= or by rtol=, one of both"),
        (DATA, CALL | {"loss": "l1"}, "loss must be one of 'linear', 'huber', .*, not 'l1'"),
        (DATA, CALL | {"loss": "huber"}, "count less beyond their deviation\nhint: give sigma="),
        (DATA, CALL | {"priors": {"k": (9, 1)}}, "by their deviations\nhint: give sigma="),
        (DATA, CALL | {"sigma": 1, "priors": {"c": (9, 1)}}, "priors has 'c', which is not fitted"),
        (DATA, CALL | {"sigma": 1, "priors": {"k": 9}}, "must be a value and its deviation, not 9"),
        (DATA, CALL | {"sigma": 1, "priors": {"k": (9, 0)}}, "must have a positive deviation"),
        (DATA, CALL | {"observe": {"a": 1}}, "observed 'a' must be a function, not 1"),
        ([], BARE, "data has no trial"),
        ([DATA], BARE, "a sequence of lv.Trial, not of {'t'"),
        ([lv.Trial(DATA)], CALL, "'q' and 'v' must be given by trials"),
        ([lv.Trial(DATA, params={"k": 1.0})], BARE, "a trial gives 'k', which is fitted"),
        ([lv.Trial(DATA, params={"b": 1.0})], BARE, "there is no parameter 'b'"),
        ([lv.Trial(DATA, sigma=1.0), lv.Trial(DATA)], BARE, "some trials have sigma, and others"),
        ([lv.Trial({"x": [1.0]})], BARE, "data has no 't'"),
    ],
)
def test_bad_calls_are_refused(data, call, says):
    with pytest.raises((ValueError, TypeError), match=says):
        lv.fit(SPRING, METHOD, data, **call)


def test_a_pendulum_that_hangs_at_rest_has_a_start_that_is_free():
    """Its velocity is roundoff, beside which any change is large; noise has the plain mean."""
    seen = np.tile([0.0, -2.0], (21, 1)) + 1e-3 * noise((21, 2))
    data = {"t": np.linspace(0, 2, 21), "q": seen}
    found = lv.fit(
        PENDULUM, METHOD, data, h=0.1, free=("q", "v"), sigma=1e-3, q=[0.0, -2.0], v=[0.0, 0.0]
    )
    w, t = np.sqrt(9.81 / 2), data["t"]
    columns = np.column_stack([np.cos(w * t), np.sin(w * t) / w])
    wanted = np.linalg.lstsq(columns, seen[:, 0])[0]
    assert [found.start["q"][0], found.start["v"][0]] == pytest.approx(wanted, abs=2e-6)
    assert found.errors["v.x"] == pytest.approx(
        1e-3 * np.sqrt(np.linalg.inv(columns.T @ columns)[1, 1]), rel=1e-3
    )


def test_a_fit_begins_at_a_bound_and_its_interval_ends_there():
    """Damping is not negative, and by default there is none."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
        force=lambda t, q, v, params: -params.c * v[0], q=("x",), params={"k": 9.0, "c": 0.0},
    )  # fmt: skip
    call = {"h": 0.05, "params": ["k", "c"], "bounds": {"c": (0, None)}, "sigma": 0.01}
    t = np.linspace(0, 4, 81)
    ends = []
    for c in (0.3, 0.0):
        w = np.sqrt(9 - c**2 / 4)
        x = np.exp(-c * t / 2) * (np.cos(w * t) + c / (2 * w) * np.sin(w * t))
        data = {"t": t, "x": x + 0.01 * noise(81, seed=1)}
        found = lv.fit(system, METHOD, data, **call, q=[1.0], v=[0.0])
        free = lv.fit(system, METHOD, data, **{**call, "bounds": None}, q=[1.0], v=[0.0])
        assert found.params["c"] == pytest.approx(max(free.params["c"], 0), abs=1e-7)
        ends.append(found.interval("params.c"))
        assert ends[-1][0] == pytest.approx(max(free.interval("params.c")[0], 0), abs=1e-5)
    assert ends[0][0] > 0
    assert ends[1][0] == 0 < ends[1][1]
    with pytest.raises(ValueError, match="the bounds of 'c' leave nothing"):
        lv.fit(system, METHOD, data, **{**call, "bounds": {"c": (0, 0)}}, q=[1.0], v=[0.0])


@pytest.mark.parametrize("ends", ["an event", "hits that accumulate"])
def test_a_motion_that_ends_before_the_last_measurement_is_refused(ends):
    terminal = lv.Event(lambda t, q, v, lam, params: q[0], terminal=True)
    events, e = ({"floor": terminal}, 0.8) if ends == "an event" else (FLOOR, 0.0)
    data = {"t": np.linspace(0, 2, 21), "x": np.zeros(21)}
    with pytest.raises(lv.IntegrationError, match=r"the motion ends before t = 2, .*'floor'"):
        lv.fit(
            FALL, METHOD, data, h=0.02, params={"g": 9.0, "e": e}, events=events, q=[1.0], v=[0.0]
        )


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"observe": {"x": lambda t, q, v, params: q[0] ** 2}}, "'x' has the name of a state"),
    ({"observe": {"t": lambda t, q, v, params: q[0] ** 2}}, "'t' has the name of the time"),
    ({"observe": {"root": lambda t, q, v, params: ca.sqrt(v[0])}, "name": "root"},
     "'root' has no derivative at t = 0 to fit by"),
    ({"loss": ["huber"]}, r"loss must be one of .*, not \['huber'\]"),
    ({"sigma": 0}, "sigma must be positive and finite, not 0"),
    ({"t": np.where(np.arange(9) == 7, np.nan, np.arange(9))}, "its entry 7 is nan"),
    ({"t": np.arange("2026-01-01", "2026-01-10", dtype="M8[D]")}, r"not of type datetime64\[D\]"),
])  # fmt: skip
def test_what_is_wrong_is_named(changes, sentence):
    given = dict(changes)
    data = {"t": given.pop("t", np.arange(9.0)), given.pop("name", "x"): np.cos(np.arange(9))}
    call = {"h": 0.5, "params": ["k"], "sigma": 0.1, "q": [1.0], "v": [0.0]}
    with pytest.raises((TypeError, ValueError), match=sentence):
        lv.fit(SPRING, METHOD, data, **{**call, **given})


def test_an_interval_of_an_element_says_what_it_is_of():
    springs = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - ca.dot(params.k, q**2) / 2, q=("x", "y"),
        params={"k": [1.0, 2.0]},
    )  # fmt: skip
    t = np.linspace(0, 2, 21)
    data = {"t": t, "x": np.cos(1.1 * t), "y": np.cos(1.3 * t)}
    call = {"h": 0.1, "params": ["k"], "sigma": 0.01, "q": [1.0, 1.0], "v": [0.0, 0.0]}
    found = lv.fit(springs, METHOD, data, **call)
    with pytest.raises(ValueError, match=r"'params\.k\[0\]' is in an array, .*\nhint: declare it"):
        found.interval("params.k[0]")


def test_one_trial_needs_no_list():
    t = np.linspace(0, 2, 21)
    data, start = {"t": t, "x": np.cos(2 * t)}, {"q": [1.0], "v": [0.0]}
    call = {"h": 0.1, "params": ["k", "c"]}
    one = lv.fit(SPRING, METHOD, lv.Trial(data, start), **call)
    assert one.params == lv.fit(SPRING, METHOD, [lv.Trial(data, start)], **call).params


def test_roundoff_is_not_said_to_be_decided_by_the_step():
    """Parabolas are exact for any step."""
    t = np.linspace(0, 1, 11)
    data = {"t": t, "x": 2 - 4.9 * t**2}
    found = lv.fit(FALL, METHOD, data, h=0.1, params={"g": 9.0}, q=[2.0], v=[0.0])
    assert found.params["g"] == pytest.approx(9.8, abs=1e-13)
    assert not found.message
