"""Fits recover what made the data, say how well it is known, and refuse what cannot be known."""

import re

import casadi as ca
import numpy as np
import pytest
from scipy.stats import chi2, f
from test_index2_gradients import general

import liouville as lv


def springs():
    """Return a pendulum on a spring of a rod, with a vector of stiffnesses."""
    return lv.Lagrangian(
        lambda t, q, v, params: (
            params.m * ca.dot(v, v) / 2
            - params.m * params.g * q[1]
            - (params.k[0] * q[0] ** 2 + params.k[1] * q[0] ** 4) / 2
        ),
        lambda t, q, params: {"rod": ca.dot(q, q) - params.l**2},
        q=("x", "y"),
        params={"m": 1.0, "g": 9.81, "l": 2.0, "k": [3.0, 0.5]},
    )


SYSTEM = springs()
START = SYSTEM.consistent(q=[1.2, -1.6], v=[1.6, 1.2])
METHOD, RUN = lv.Spark(3), {"t": (0.0, 2.0), "h": 0.05, "every": 2}
TRUTH = lv.integrate(SYSTEM, METHOD, **RUN, **START)


def noisy(seed, sigma=0.01):
    """Return measured positions, with normal noise."""
    noise = np.random.default_rng(seed).standard_normal(TRUTH.q.shape)
    return {"t": TRUTH.t, "q": TRUTH.q + sigma * noise}


def test_exact_data_give_back_what_made_them():
    """A length in the constraint, a vector and the whole start, from a guess that is far off."""
    found = lv.fit(
        SYSTEM, METHOD, {"t": TRUTH.t, "q": TRUTH.q, "v": TRUTH.v}, h=0.05,
        params={"l": 1.8, "k": [2.0, 0.0]}, free=("q", "v"), q=[1.0, -1.5], v=[1.4, 1.0],
    )  # fmt: skip
    assert found.params["l"] == pytest.approx(2.0, abs=1e-11)
    np.testing.assert_allclose(found.params["k"], [3.0, 0.5], atol=1e-9)
    np.testing.assert_allclose(found.start["q"], START["q"], atol=1e-11)
    np.testing.assert_allclose(found.start["v"], START["v"], atol=1e-10)
    np.testing.assert_allclose(found.solution.q, TRUTH.q, atol=1e-10)
    assert found.names[:3] == ("params.l", "params.k[0]", "params.k[1]")
    assert found.names[3:] == ("q.x", "q.y", "v.x", "v.y")
    # the start varies along the constraint alone
    run = {"h": 0.05, "params": ("g",), "sigma": 0.01, **START}
    free = lv.fit(SYSTEM, METHOD, noisy(0), free=("q", "v"), **run)
    across, own = free.start["q"] / 2, free.covariance[1:3, 1:3]
    assert abs(across @ own @ across) < 1e-12 * np.trace(own)
    # at rest every place on the rod has this velocity, so that it may be held
    still = run | {"q": [1.2, -1.6], "v": [0.0, 0.0]}
    fall = lv.integrate(SYSTEM, METHOD, **RUN, q=still["q"], v=still["v"])
    place = lv.fit(SYSTEM, METHOD, {"t": fall.t, "q": fall.q}, free="q", **still)
    assert place.errors["q.x"] > 1e-4
    assert not place.start["v"].any()


@pytest.mark.parametrize("late", [0, 3])
def test_starts_vary_with_lengths_in_their_constraints(late):
    """The distance of the start from the pivot is the length, and as uncertain as that."""
    data = {name: x[late:] for name, x in noisy(4).items()}
    call = {"params": ("l", "g"), "free": ("q", "v"), "sigma": 0.01, "t0": 0.0}
    found = lv.fit(SYSTEM, METHOD, data, h=0.05, **call, **START)
    across = np.zeros(6)
    across[2:4] = found.start["q"] / found.params["l"]
    length = np.eye(6)[0]
    np.testing.assert_allclose(found.covariance @ across, found.covariance @ length, rtol=1e-9)


@pytest.mark.parametrize("sigma", [1e-3, None])
def test_covariance_holds_the_truth_as_often_as_it_says(sigma):
    """Of 400 data sets 380 are expected within the ellipse of 95 %, 366 to 394 with odds of 0.999.

    Of ten measurements the degrees of freedom matter: where the deviation comes from the residuals,
    the ellipse is that of F with 2 and 8, and that of chi square holds 357 on average.
    """
    limit = 2 * f.ppf(0.95, 2, 8) if sigma is None else chi2.ppf(0.95, 2)
    inside = 0
    for seed in range(400):
        data = {name: x[2::4][:5] for name, x in noisy(seed, 1e-3).items()}
        found = lv.fit(SYSTEM, METHOD, data, h=0.1, params=("l", "g"), sigma=sigma, t0=0.0, **START)
        off = np.array([found.params["l"] - 2.0, found.params["g"] - 9.81])
        inside += off @ np.linalg.solve(found.covariance, off) < limit
    assert 366 <= inside <= 394


def test_gaps_later_starts_and_single_coordinates():
    """NaN is no measurement, and the deviation of what there is comes from the residuals."""
    data = noisy(3)
    x = data["q"][5:, 0].copy()
    x[[2, 7]] = np.nan
    found = lv.fit(
        SYSTEM, METHOD, {"t": data["t"][5:], "x": x}, h=0.05, t0=0.0, params={"l": 1.9}, **START
    )
    assert found.residuals.size == x.size - 2
    masked = {"t": data["t"][5:], "x": np.ma.masked_invalid(x)}
    again = lv.fit(SYSTEM, METHOD, masked, h=0.05, t0=0.0, params={"l": 1.9}, **START)
    assert again.params["l"] == found.params["l"]
    assert found.sigma == pytest.approx(0.01, rel=0.5)
    assert abs(found.params["l"] - 2.0) < 4 * found.errors["params.l"]
    assert found.solution.t.size == TRUTH.t.size
    assert "params.l = " in repr(found)


def test_bounds_are_kept():
    """The nearest value allowed is taken."""
    found = lv.fit(
        SYSTEM, METHOD, noisy(1), h=0.05, params={"l": 1.8}, bounds={"l": (1.5, 1.9)}, **START
    )
    assert found.params["l"] == pytest.approx(1.9, abs=1e-6)


def test_a_guess_far_away_is_left_until_squares_fall_no_more():
    """Slopes grow by e^70 there, in units of which the rest of the way has none."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
        q=("x",),
        params={"k": -3.0},
    )
    t = np.linspace(0, 40, 11)
    found = lv.fit(system, METHOD, {"t": t, "x": np.cos(2 * t)}, h=2.0, params=("k",), q=[1], v=[0])
    nearby = found.params["k"] + np.array([-1, 0, 1]) * found.errors["params.k"] / 10
    squares = []
    for k in nearby:
        run = lv.integrate(
            system, METHOD, t=(0, 40), steps=20, every=2, params={"k": k}, q=[1], v=[0]
        )
        squares.append(np.sum((run.q[:, 0] - np.cos(2 * t)) ** 2))
    assert squares[1] == min(squares)
    assert squares[1] < 2 * t.size


def test_a_fit_that_ends_where_runs_fail_is_refused():
    """No trial gets past the edge, and squares still fall towards it."""
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - q[0] * ca.sqrt(1 - params.k), q=("x",),
        params={"k": 0.5},
    )  # fmt: skip
    t = np.linspace(0, 1, 11)
    with pytest.raises(ValueError, match="no fit is found in"):
        lv.fit(system, METHOD, {"t": t, "x": t**2}, h=0.1, params=("k",), q=[0], v=[0])


def test_a_position_that_is_held_is_the_one_given_whatever_the_first_guess():
    """A guess of the axis does not move it."""
    system = ellipse()
    given = {"q": [0.6, -0.8], "v": [0.8, 0.6]}
    start = system.consistent(params={"a": 1.6}, **given)
    true = lv.integrate(system, METHOD, t=(0, 2), h=0.05, params={"a": 1.6}, **start)
    noise = np.random.default_rng(0).standard_normal(true.q.shape)
    data, call = {"t": true.t, "q": true.q + 0.01 * noise}, {"free": ("v",), "sigma": 0.01}
    fits = [
        lv.fit(system, METHOD, data, h=0.05, params={"a": a}, **call, **given)
        for a in (1.0, 1.3, 2.2)
    ]
    for found in fits:
        assert found.params["a"] == pytest.approx(fits[0].params["a"], abs=1e-6)
        moved = system.consistent(params=found.params, **given)
        np.testing.assert_allclose(found.start["q"], moved["q"], rtol=0, atol=1e-7)
    assert abs(fits[0].params["a"] - 1.6) < 4 * fits[0].errors["params.a"]


def ellipse(*more):
    """Return a bead on an ellipse, with further constraints that the first implies."""
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
        lambda t, q, params: (
            {"ellipse": q[0] ** 2 / params.a**2 + q[1] ** 2 - 1}
            | {name: ca.exp(q[0] ** 2 / params.a**2 + q[1] ** 2 - 1) - 1 for name in more}
        ),
        q=("x", "y"),
        params={"a": 1.0},
    )


#: Systems, starts far off their constraints, what is fitted of them, and its truth.
HELD = {
    "bead": (ellipse(), {"q": [0.6, -0.8], "v": [0.8, 0.6]}, "a", 1.6, "q"),
    "redundant": (ellipse("again"), {"q": [0.6, -0.8], "v": [0.8, 0.6]}, "a", 1.6, "q"),
    "semi-explicit": (general(), {"y": [0.9, 0.4, -1.2, 0.3]}, "l", 1.1, "y"),
}


@pytest.mark.parametrize("name", HELD)
def test_a_start_that_is_held_is_moved_from_where_it_was_given(name):
    """Value and error are those of the run from there, by differences, however far it is moved.

    Derivatives from the constraints alone would leave 0.13 of the error.
    """
    system, given, what, truth, state = HELD[name]

    def run(value):
        params = {what: value}
        start = system.consistent(params=params, **given)
        return lv.integrate(system, METHOD, t=(0, 2), h=0.05, params=params, **start)

    true = run(truth)
    noise = np.random.default_rng(0).standard_normal(true.states[state].shape)
    data = {"t": true.t, state: true.states[state] + 0.01 * noise}
    found = lv.fit(
        system, METHOD, data, h=0.05, params={what: 0.9 * truth}, sigma=0.01, **given
    )  # fmt: skip
    value, error = found.params[what], found.errors[f"params.{what}"]
    ends = [run(value + side * 1e-3 * error).states[state] for side in (-1, 1)]
    slopes = (ends[1] - ends[0]) / (2e-3 * error) / 0.01
    residuals = (run(value).states[state] - data[state]) / 0.01
    assert error == pytest.approx(1 / np.linalg.norm(slopes), rel=1e-5)
    assert abs(np.sum(slopes * residuals)) * error < 1e-5


def test_one_measurement_after_the_start_determines_what_it_can():
    lever = {"t": [1.0], "x": [np.cos(2.2)]}
    system = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
        q=("x",),
        params={"k": 4.0},
    )
    found = lv.fit(system, METHOD, lever, h=0.05, params=("k",), sigma=0.01, t0=0, q=[1], v=[0])
    assert found.params["k"] == pytest.approx(2.2**2, rel=1e-9)
    slope = -np.sin(2.2) / (2 * 2.2)  # of cos(sqrt(k))
    assert found.errors["params.k"] == pytest.approx(abs(0.01 / slope), rel=1e-6)


@pytest.mark.parametrize("sigma", [1e-149, 1e-80, 1e80, 1e149])
def test_deviations_of_any_size_give_the_same_fit(sigma):
    """Squares of residuals in units of them have no place in the range of numbers."""
    call = {"h": 0.05, "params": ("l", "g"), **START}
    wanted = lv.fit(SYSTEM, METHOD, noisy(0), sigma=1.0, **call)
    found = lv.fit(SYSTEM, METHOD, noisy(0), sigma=sigma, **call)
    for name in ("l", "g"):
        assert found.params[name] == pytest.approx(wanted.params[name], rel=1e-10)
        size = sigma * wanted.errors[f"params.{name}"]
        assert found.errors[f"params.{name}"] == pytest.approx(size, rel=1e-9)
    # a fit that is poor in these units is made once more, and ends an iteration elsewhere
    np.testing.assert_allclose(found.residuals * sigma, wanted.residuals, rtol=1e-9, atol=1e-10)


GIVEN = {"h": 0.05, "params": ("l",)}


@pytest.mark.parametrize(
    ("data", "more", "says"),
    [
        ({"q": TRUTH.q}, GIVEN, "data has no 't', but 'q'\nhint: write"),
        ({"t": [0.0, 1.5, 1.5], "x": [0, 1, 2]}, GIVEN, "1.5 is followed by 1.5\nhint: sort"),
        ({"t": TRUTH.t, "w": TRUTH.q}, GIVEN, "'w', which is no state"),
        ({"t": TRUTH.t, "q": TRUTH.q[:3]}, GIVEN, "shape"),
        ({"t": TRUTH.t, "x": np.full(21, np.nan)}, GIVEN, "data have no measurement"),
        ({"t": TRUTH.t, "x": np.full(21, np.inf)}, GIVEN, "must be finite, or NaN"),
        ({"t": [0.0, np.nan], "x": [1, 2]}, GIVEN, "'t' must be finite, and its entry 1"),
        ({"t": [0.0], "x": [1]}, GIVEN, "only measurement is at the start, t0 = 0\nhint: give t0"),
        (
            {"t": [0.0, 1.0], "x": [np.nan, 1]},
            GIVEN,
            "how good a fit of . unknowns? to . measurements? is\nhint: give sig",
        ),
        (noisy(0), GIVEN | {"params": ("c",)}, "no parameter 'c'"),
        (
            noisy(0),
            GIVEN | {"params": None},
            "params must be a sequence of names, not None\nhint: give",
        ),
        (noisy(0), GIVEN | {"params": ()}, "nothing is to be fitted"),
        (noisy(0), GIVEN | {"params": ("m", "k")}, "do not determine 'params.m'"),
        (noisy(0), GIVEN | {"free": ("p",)}, "free must be q or v"),
        (noisy(0), GIVEN | {"bounds": {"g": (0, 1)}}, "'g', which is not fitted"),
        (noisy(0), GIVEN | {"bounds": {"l": (0, 1)}}, "'l' begins at 2.0, which is not between"),
        (noisy(0), GIVEN | {"bounds": {"l": 3}}, "'l' must be bounded by a pair"),
        (noisy(0), GIVEN | {"params": ("l", "l")}, "params names 'l' twice"),
        (noisy(0) | {"x": TRUTH.q[:, 0]}, GIVEN, "data 'x' gives again what"),
        (noisy(0), GIVEN | {"sigma": {"q": 1, "x": 1}}, "sigma has 'x', of which there are no"),
        (noisy(0), GIVEN | {"sigma": -1.0}, "sigma must be positive"),
        (
            noisy(0),
            GIVEN | {"sigma": 1e-300},
            "1e-300 of a measurement of .* is no number\nhint: giv",
        ),
        (
            noisy(0),
            GIVEN | {"sigma": 1e300},
            r"1e\+300 of a measurement of .* is no number\nhint: giv",
        ),
        (noisy(0), GIVEN | {"sigma": {"x": 0.1}}, "sigma has no value for 'q'"),
        (noisy(0), GIVEN | {"t0": 3.0}, "after the first measurement"),
        (noisy(0), GIVEN | {"h": -1.0}, "h must be positive"),
        (noisy(0), GIVEN | {"free": "q"}, "no freedom to 'q' while the other state is held"),
        (noisy(0), GIVEN | {"free": 1}, "free must be a sequence of states, not 1"),
        (noisy(0), GIVEN | {"sigma": "a"}, "sigma must be real numbers"),
        (noisy(0), GIVEN | {"sigma": [0.1] * 3}, r"sigma of 'q' must have shape .*, not \(3,\)"),
        ({"t": TRUTH.t, "q": TRUTH.q + 0j}, GIVEN, "data 'q' must be real numbers"),
        (
            {"t": TRUTH.t, "x": np.array([*map(str, TRUTH.q[:, 0])], dtype=object)},
            GIVEN,
            "data 'x' must be real numbers, not text such as '1.2'\nhint: pandas.to_numeric",
        ),
        ({"t": TRUTH.t, "x": [*map(str, TRUTH.q[:, 0])]}, GIVEN, "not text such as '1.2'"),
    ],
)
def test_bad_calls_are_refused(data, more, says):
    """By name, before or instead of a fit."""
    with pytest.raises((ValueError, TypeError), match=says):
        lv.fit(SYSTEM, METHOD, data, **more, **START)


@pytest.mark.parametrize(
    "method",
    [lv.Spark(3), lv.LobattoPair(3), lv.Composition(lv.Spark(1), "SU4"), lv.HHT()],
    ids=str,
)
def test_times_are_any_that_rise(method):
    """They lie within steps, the start before the first of them or at it."""
    times = np.array([0.13, 0.4, 0.41, 0.9, 1.37, 2.0])
    h = 0.004 if isinstance(method, lv.HHT) else 0.05
    run = lv.integrate(SYSTEM, method, t=(0, 2), h=h, t_eval=times, **START)
    found = lv.fit(
        SYSTEM, method, {"t": times, "q": run.q}, h=h, t0=0.0,
        params={"l": 1.8, "k": [2.0, 0.0]}, free=("q", "v"), q=[1.0, -1.5], v=[1.4, 1.0],
    )  # fmt: skip
    assert found.params["l"] == pytest.approx(2.0, abs=1e-10)
    np.testing.assert_allclose(found.params["k"], [3.0, 0.5], atol=1e-9)
    np.testing.assert_array_equal(found.solution.t, times)


def test_semi_explicit_systems():
    """By both states, with the start; and a start that is held is the one given, from any guess."""
    system, method = general(), lv.Spark(3)
    start = system.consistent(t=0.2, y=[0.6, 0.1, -0.8, 0.3])
    run = lv.integrate(system, method, t=(0.2, 1.2), h=0.05, every=2, **start)
    data = {"t": run.t, "y": run.y, "z": run.z}
    found = lv.fit(
        system, method, data, h=0.05, params={"l": 1.0, "b": [0.7], "a": 0.5}, free="y",
        y=[0.55, 0.1, -0.8, 0.3],
    )  # fmt: skip
    assert found.names == ("params.l", "params.b[0]", "params.a", "y.y0", "y.y1", "y.y2", "y.y3")
    np.testing.assert_allclose([found.params[x] for x in "la"], [1.1, 0.4], atol=1e-11)
    for name, value in start.items():
        np.testing.assert_allclose(found.start[name], value, atol=1e-11)
    assert "y.y3 = 0.320056" in repr(found)
    held = lv.fit(
        system, method, {"t": run.t, "z1": run.z[:, 1]}, h=0.05, params={"l": 1.0}, **start
    )
    assert held.params["l"] == pytest.approx(1.1, abs=1e-9)
    np.testing.assert_allclose(held.start["y"], start["y"], atol=1e-9)
    apart = [0, 2, 3, 7, 10]
    some = {"t": run.t[apart], "y": run.y[apart]}
    few = lv.fit(system, method, some, h=0.1, t0=0.2, params={"l": 1.0}, **start)
    assert few.params["l"] == pytest.approx(1.1, abs=1e-5)
    assert few.residuals.size == 20
    call = {"h": 0.05, "params": ("l",), **start}
    times = 0.2 + (run.t - 0.2) ** 2
    run = lv.integrate(system, method, t=(times[0], times[-1]), h=0.05, t_eval=times, **start)
    anywhere = lv.fit(system, method, {"t": times, "y": run.y}, **(call | {"params": {"l": 1.0}}))
    assert anywhere.params["l"] == pytest.approx(1.1, abs=1e-7)
    with pytest.raises(ValueError, match="free must be y, not 'z'"):
        lv.fit(system, method, data, free="z", **call)
    with pytest.raises(TypeError, match="does not step"):
        lv.fit(system, lv.HHT(), data, **call)
    with pytest.raises(TypeError, match=r"fit takes a mechanical or .*Schrodinger\nhint: lv.vjp"):
        lv.fit(lv.Schrodinger(np.eye(2)), "auto", {"t": [0, 1]}, h=0.1, params=(), psi=[1, 0])


def test_too_few_measurements():
    """There are as many as unknowns at least."""
    with pytest.raises(ValueError, match="2 measurements cannot determine 3 unknowns"):
        lv.fit(
            SYSTEM, METHOD, {"t": [0.0, 0.1], "x": [1.2, 1.3]}, h=0.05, params=("l", "k"), **START
        )
    with pytest.raises(
        ValueError, match="nothing says how good a fit of 1 unknown to 1 measurement is"
    ):
        lv.fit(SYSTEM, METHOD, {"t": [0.1], "x": [1.3]}, h=0.05, t0=0.0, params=("l",), **START)


@pytest.mark.parametrize(("length", "stiffness"), [(1e-9, 1.0), (1.0, 1e-12), (1e9, 1e12)])
def test_units_do_not_matter(length, stiffness):
    """Without sigma data are nanometres as well, and parameters of any size."""
    system = lv.Lagrangian(
        lambda t, q, v, params: v[0] ** 2 / 2 - params.k / stiffness * q[0] ** 2 / 2,
        q=("x",),
        params={"k": stiffness},
    )
    seen = lv.integrate(system, METHOD, t=(0, 10), steps=100, q=[length], v=[0])
    noise = 1e-3 * np.random.default_rng(2).standard_normal(seen.q.shape)
    data = {"t": seen.t, "q": seen.q + length * noise}
    start = {"q": [1.1 * length], "v": [0]}
    call = {"h": 0.1, "params": {"k": 1.1 * stiffness}, "bounds": {"k": (0, 2 * stiffness)}}
    found = lv.fit(system, METHOD, data, free="q", **call, **start)
    given = lv.fit(system, METHOD, data, free="q", sigma=found.sigma, **call, **start)
    assert found.params["k"] / stiffness == pytest.approx(1.0001, abs=2e-4)
    assert found.params["k"] == pytest.approx(given.params["k"], rel=1e-9)
    np.testing.assert_allclose(found.covariance, given.covariance, rtol=1e-6)
    assert found.sigma / length == pytest.approx(np.std(noise), rel=0.05)
    assert np.std(found.residuals) / length == pytest.approx(np.std(noise), rel=0.05)


@pytest.mark.parametrize("free", [("v",), ("q", "v")])
@pytest.mark.parametrize("units", [(1, 1e-9, 1), (1e-10, 1e-15, 1e-27), (1e11, 3e7, 1e30)])
def test_units_of_length_time_and_mass_change_nothing(units, free):
    """Velocities are not measured, begin at zero, and are far from positions in size."""

    def fitted(length, time, mass):
        def pendulum(g, c):
            return lv.Lagrangian(
                lambda t, q, v, params: mass * (ca.dot(v, v) / 2 - params.g * q[1]),
                lambda t, q, params: {"rod": ca.dot(q, q) - length**2},
                q=("x", "y"),
                force=lambda t, q, v, params: -params.c * mass / time * v,
                params={"g": g * length / time**2, "c": c},
            )

        run = {"t": (0, 2 * time), "h": 0.1 * time}
        start = {"q": [length, 0.0], "v": [0.0, 0.3 * length / time]}
        seen = lv.integrate(pendulum(9.7, 0.13), lv.Spark(3), **run, **start)
        noise = np.random.default_rng(0).normal(size=seen.q.shape) * 1e-3 * length
        found = lv.fit(
            pendulum(9.81, 0.1),
            lv.Spark(3),
            {"t": seen.t, "q": seen.q + noise},
            h=run["h"],
            params=["g", "c"],
            free=free,
            q=start["q"],
            v=[0.0, 0.0],
        )
        return [found.params["g"] * time**2 / length, found.params["c"]]

    assert fitted(*units) == pytest.approx(fitted(1, 1, 1), rel=1e-7)


def spring(noise):
    t, w, half = np.linspace(0, 10, 201), np.sqrt(100 - 1e-4), 0.01
    x = np.exp(-half * t) * (np.cos(w * t) + half / w * np.sin(w * t))
    return {"t": t, "x": x + noise * np.random.default_rng(0).standard_normal(t.size)}


SPRING = lv.Lagrangian(
    lambda t, q, v, params: (v[0] ** 2 - params.k * q[0] ** 2) / 2,
    force=lambda t, q, v, params: -params.c * v[0],
    q=("x",),
    params={"k": 99.0, "c": 0.03},
)
SOUGHT = {"h": 0.05, "params": ["k", "c"], "q": [1.0], "v": [0.0]}


@pytest.mark.parametrize(
    ("method", "moved"),
    [(lv.Spark(3), None), (lv.HHT(-0.1), -5.41 * 3 / 4), (lv.LobattoPair(2), 2.066 * 3 / 4)],
    ids=["Spark", "HHT", "LobattoPair"],
)
@pytest.mark.parametrize("sigma", [1e-3, None])
def test_a_fit_says_where_the_step_decides(method, moved, sigma):
    found = lv.fit(SPRING, method, spring(1e-3), sigma=sigma, **SOUGHT)
    assert found.dof == 199
    scale = 1.0 if sigma is None else sigma
    assert found.chi2 == pytest.approx(np.sum(found.residuals**2))
    mean = np.sqrt(found.chi2 / found.dof) * scale
    assert f"sigma = {mean:.3g}" in repr(found) or sigma is not None
    assert f"chi2/dof = {found.chi2 / found.dof:.3g}" in repr(found) or sigma is None
    if moved is None:
        assert found.message == ""
        assert abs(found.params["k"] - 100) < 3 * found.errors["params.k"]
        return
    words = r"half of it moves params.k by (\S+), and its deviation is (\S+);"
    said = re.search(words, found.message)
    # that of a method of order two leaves three quarters of its error behind
    assert float(said[1]) == pytest.approx(moved, rel=0.3)
    assert abs(float(said[1])) > 3000 * float(said[2])


def test_exact_data_have_a_word_where_the_step_moves_digits_alone():
    """Spark(2) meets cos(t) to roundoff, by a k that makes up for its step."""
    system = lv.Lagrangian(
        lambda t, q, v, p: (v[0] ** 2 - p.k * q[0] ** 2) / 2, q=("x",), params={"k": 1.0}
    )
    run = {"q": [1.0], "v": [0.0], "h": 0.1}
    own = lv.integrate(system, lv.Spark(3), t=(0, 1), **run)
    found = lv.fit(system, lv.Spark(3), {"t": own.t, "q": own.q}, params={"k": 1.2}, **run)
    assert found.params["k"] == pytest.approx(1, abs=1e-13)
    assert found.values == {"params.k": found.params["k"], "q.x": 1.0, "v.x": 0.0}
    assert found.message == ""
    closed = {"t": own.t, "q": np.cos(own.t)}
    found = lv.fit(system, lv.Spark(2), closed, params={"k": 1.2}, **run)
    assert "half of it moves params.k by -2.6e-07, and its deviation is " in found.message


def test_a_fit_says_where_residuals_are_not_of_the_size_of_sigma():
    right = lv.fit(SPRING, lv.Spark(3), spring(1e-3), sigma=1e-3, **SOUGHT)
    assert 0.7 < right.chi2 / right.dof < 1.3
    assert right.message == ""
    large = lv.fit(SPRING, lv.Spark(3), spring(1e-3), sigma=1e-2, **SOUGHT)
    assert "residuals are 0.096 times as large as sigma: sigma is too large" in large.message
    small = lv.fit(SPRING, lv.Spark(3), spring(1e-3), sigma=1e-4, **SOUGHT)
    assert "residuals are 9.6 times as large as sigma: the model, the minimum" in small.message
    data = {"t": spring(0)["t"], "x": np.cos(3 * spring(0)["t"])}  # far from the guess, k = 9
    far = lv.fit(SPRING, lv.Spark(3), data, sigma=0.05, **SOUGHT | {"params": {"k": 5.0}})
    assert far.params["k"] == pytest.approx(9.0, abs=0.01)
    assert "growing parts of the time led to a lower minimum than the guess" in far.message


def test_data_of_one_coordinate_are_a_column_or_a_frame():
    pandas = pytest.importorskip("pandas")
    data = spring(1e-3)
    wanted = lv.fit(SPRING, lv.Spark(3), data, sigma=1e-3, **SOUGHT)
    frame = pandas.DataFrame(data)
    for given, sigma in (
        ({"t": data["t"], "q": data["x"]}, 1e-3),
        ({"t": data["t"], "q": data["x"][:, None]}, {"q": np.full(201, 1e-3)}),
        (frame, 1e-3),
        (frame.set_index("t"), {"x": 1e-3}),
        (frame.rename(columns={"x": "q"}), 1e-3),
        (frame.rename(columns={"x": "q[x]"}), {"q[x]": 1e-3}),
        (frame.set_index("t").to_xarray(), 1e-3),
        (frame.rename(columns={"t": "time"}).set_index("time").to_xarray(), {"x": 1e-3}),
        (frame.rename(columns={"t": "time"}), 1e-3),
        (frame.astype({"x": "Float64"}), 1e-3),
        (frame.astype({"x": object}), 1e-3),
    ):
        found = lv.fit(SPRING, lv.Spark(3), given, sigma=sigma, **SOUGHT)
        assert found.params == wanted.params
    frame.loc[3, "x"], missing = np.nan, frame.astype({"x": "Float64"})
    missing.loc[3, "x"] = pandas.NA
    each = [lv.fit(SPRING, lv.Spark(3), x, sigma=1e-3, **SOUGHT) for x in (frame, missing)]
    assert each[0].params == each[1].params
    with pytest.raises(TypeError, match="data has no 't'"):
        lv.fit(SPRING, lv.Spark(3), frame[["x"]], **SOUGHT)
    dated = frame.assign(t=pandas.to_timedelta(frame["t"], unit="s"))
    with pytest.raises(TypeError, match=r"'t' must be real numbers, not .*\nhint: give seconds"):
        lv.fit(SPRING, lv.Spark(3), dated, **SOUGHT)


def test_values_at_a_bound_and_outliers_are_said():
    t = np.linspace(0, 5, 60)
    truth = lv.integrate(SPRING, lv.Spark(3), t=(0, 5), h=0.05, t_eval=t, q=[1.0], v=[0.0])
    data = {"t": t, "x": truth.q[:, 0] + 1e-3 * np.sin(40 * t)}
    data["x"][[5, 30]] += 0.1
    k = float(SPRING.params["k"])
    call = {"sigma": 1e-3, "h": 0.05, "loss": "huber", "q": [1.0], "v": [0.0]}
    found = lv.fit(SPRING, lv.Spark(3), data, params={"k": k}, **call)
    assert ", 2 beyond 5 sigma; 60 values" in repr(found)
    assert "bound" not in found.message
    found = lv.fit(
        SPRING, lv.Spark(3), data, params={"k": 1.1 * k}, bounds={"k": (1.05 * k, None)}, **call
    )
    assert found.params["k"] == pytest.approx(1.05 * k)
    assert f"at a bound, of which deviations know nothing: params.k = {1.05 * k:.6g}" in (
        found.message
    )


def test_a_measurement_at_the_time_of_a_hit_is_named_where_no_minimum_is_smooth():
    """The height there is least where the hit is: its slope by g changes its sign."""
    ball = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2 - p.g * q[0], q=("x",), params={"g": 1.0, "e": 0.5},
        contacts={"floor": lv.Contact(lambda t, q, p: q[0], restitution=lambda p: p.e)},
    )  # fmt: skip
    t = np.linspace(0.1, 1.5, 15)  # it hits at t = 1
    height = np.where(t < 1, 0.5 - t**2 / 2, 0.5 * (t - 1) - (t - 1) ** 2 / 2)
    data = {"t": t, "x": height - 1e-3 * (t == t[9])}
    call = {"params": {"e": 0.6, "g": 0.95}, "t0": 0.0, "q": [0.5], "v": [0.0], "sigma": 1e-3}
    with pytest.raises(ValueError, match="'floor' is met at t = 1, where a measurement lies"):
        lv.fit(ball, lv.Spark(2), data, h=0.05, **call)
    data["x"][9] = np.nan
    found = lv.fit(ball, lv.Spark(2), data, h=0.05, **call)
    assert found.params["g"] == pytest.approx(1.0, abs=1e-9)
    with pytest.raises(TypeError, match="fits of a system with contacts take h=, not rtol="):
        lv.fit(ball, lv.Spark(2), data, rtol=1e-6, **call)
