"""Optimal control with constraints along the path and with free starts: published optima."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv

RAYLEIGH = lv.Lagrangian(
    lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2,
    force=lambda t, q, v, params: v[0] * (1.4 - 0.14 * v[0] ** 2) + 4 * params.u,
    q=("x",),
    params={"u": 0.0},
)
MASS = lv.Lagrangian(
    lambda t, q, v, params: v[0] ** 2 / 2, force=lambda t, q, v, params: [params.u], q=("x",),
    params={"u": 0.0},
)  # fmt: skip
PENDULUM = lv.Lagrangian(
    lambda t, q, v, params: ca.dot(v, v) / 2 - 9.81 * q[1],
    lambda t, q, params: ca.dot(q, q) - 1,
    force=lambda t, q, v, params: [params.u * q[1], -params.u * q[0]],
    q=("x", "y"),
    params={"u": 0.0},
)


def effort(t, q, v, params):
    return params.u**2 / 2


def rayleigh(steps, **more):
    """Return the optimum of Rayleigh's problem."""
    return lv.optimal_control(
        RAYLEIGH, lv.Spark(3), controls=("u",), steps=steps, q=[-5.0], v=[-5.0],
        cost=lambda t, q, v, params: params.u**2 + q[0] ** 2, **{"t": (0, 4.5), **more},
    )  # fmt: skip


def moved(steps=40, **more):
    call = {"t": (0, 1), "q": [0.0], "v": [1.0], "final": {"q": [0.0], "v": [-1.0]}, **more}
    return lv.optimal_control(MASS, lv.Spark(2), controls=("u",), cost=effort, steps=steps, **call)


def test_a_published_optimum_with_a_constraint_of_state_and_control():
    """Maurer and Augustin have 44.80444 for u + x/6 <= 0 until 4.5, and 29.37608 is until 2.5."""
    shorter = rayleigh(80, t=(0, 2.5))
    assert shorter.cost == pytest.approx(29.376078, rel=1e-6)
    found = rayleigh(80, path={"mixed": (lambda t, q, v, params: params.u + q[0] / 6, None, 0.0)})
    assert found.cost == pytest.approx(44.80444, abs=1e-5)
    run = found.driven
    dense = lv.integrate(run, lv.Spark(3), t=(0, 4.5), steps=80, t_eval=found.stage_t.ravel(),
                         params=found.params, q=[-5.0], v=[-5.0])  # fmt: skip
    at_stages = found.stage_controls["u"].ravel() + dense.q[:, 0] / 6
    assert at_stages.max() < 1e-5
    assert (at_stages > -1e-4).mean() > 0.2
    assert found.message.endswith("interpolated between stages, where the path bounds them")
    assert repr(found).endswith(f"\n {found.message}>")


def test_a_published_optimum_with_bounds_of_speeds():
    """Augustin and Maurer's container crane: 0.0375194596 in Betts' collection."""
    crane = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2 + v[2] ** 2) / 2,
        force=lambda t, q, v, params: [
            params.u[0] + 17.2656 * q[2], params.u[1],
            -(params.u[0] + 27.0756 * q[2] + 2 * v[1] * v[2]) / q[1],
        ],
        q=("trolley", "rope", "sway"), params={"u": [0.0, 0.0]},
    )  # fmt: skip
    bounds = {
        "u": ([-2.83374, -0.80865], [2.83374, 0.71265]),
        "v": {"trolley": (-2.5, 2.5), "rope": (-1, 1)},
    }
    found = lv.optimal_control(
        crane, lv.Spark(2), controls=("u",), t=(0, 9), steps=60, bounds=bounds,
        cost=lambda t, q, v, params: (
            (q[2] ** 2 + v[2] ** 2 + 0.01 * ca.dot(params.u, params.u)) / 2
        ),
        q=[0, 22, 0], v=[0, -1, 0], final={"q": [10, 14, 0], "v": [2.5, 0, 0]},
    )  # fmt: skip
    assert found.cost == pytest.approx(0.0375194596, rel=1e-6)
    assert np.abs(found.v[:, :2]).max(axis=0) == pytest.approx([2.5, 1], abs=1e-9)


@pytest.mark.parametrize("path", [True, False], ids=["path", "bounds"])
def test_bryson_and_denham_s_optimum(path):
    """4 / (9 l) is the least effort under x <= l for l below 1/6, as a bound and along the path."""
    limit = {"path": {"wall": (lambda t, q, v, params: q[0], None, 1 / 9)}} if path else {}
    found = moved(60, **(limit or {"bounds": {"q": (None, 1 / 9)}}))
    assert found.cost == pytest.approx(4.0, abs=2e-3)
    assert found.q.max() < 1 / 9 + 1e-9


def test_a_bound_that_changes_in_time():
    """Under x <= (1 + t) / 15 the motion touches the wall, and lies below the one without it."""
    free = moved()
    found = moved(path={"wall": (lambda t, q, v, params: q[0] - (1 + t) / 15, None, 0.0)})
    beyond = found.q[:, 0] - (1 + found.t) / 15
    assert (free.q[:, 0] - (1 + free.t) / 15).max() > 0.1
    assert -1e-6 < beyond.max() < 1e-9
    assert found.cost > free.cost + 0.5


def test_a_free_start_is_chosen_at_no_cost():
    """From x = 0 to rest at 1 the best start is at 1.5, and u = -3 t costs 1.5."""
    call = {"t": (0, 1), "q": [0.0], "v": [0.3], "final": {"q": [1.0], "v": [0.0]}}
    found = moved(free=("v",), **call)
    assert found.cost == pytest.approx(1.5, abs=1e-10)
    assert found.v[0, 0] == pytest.approx(1.5, abs=1e-9)
    np.testing.assert_allclose(found.controls["u"], -3 * found.t, atol=1e-8)
    held = moved(free=("v",), bounds={"v": (None, 1.3)}, **call)
    assert held.v.max() < 1.3 + 1e-9
    assert held.cost > 1.5


def test_a_free_start_is_on_its_constraints():
    """A pendulum that shall be at the side at rest swings there by itself from where it begins."""
    found = lv.optimal_control(
        PENDULUM, lv.Spark(3), controls=("u",), cost=effort, t=(0, 1), steps=20, free=("q", "v"),
        q=[0.0, -1.0], v=[1.0, 0.0], final={"q": {"x": 0.8}, "v": {"x": 0.0}},
    )  # fmt: skip
    assert found.cost == pytest.approx(0.0, abs=1e-12)
    q, v = found.q[0], found.v[0]
    assert q @ q == pytest.approx(1.0, abs=1e-12)
    assert q @ v == pytest.approx(0.0, abs=1e-12)
    assert np.abs(found.solution.q - found.q).max() < 1e-11


def test_a_free_start_is_within_the_limits_of_the_path():
    """The nearest start to the end is at the limit, from where it costs 6 (1 - 1/4)^2."""
    path = {"behind": (lambda t, q, v, params: q[0] - t, None, 0.25)}
    call = {"q": [0.0], "v": [0.0], "final": {"q": [1.0], "v": [0.0]}, "free": ("q",)}
    found = moved(path=path, **call)
    assert found.q[0, 0] == pytest.approx(0.25, abs=1e-9)
    assert found.cost == pytest.approx(6 * 0.75**2, rel=1e-8)


HEAVY = lv.Lagrangian(
    lambda t, q, v, params: (params.m * v[0] ** 2 - params.k * q[0] ** 2) / 2,
    force=lambda t, q, v, params: [params.u - params.c[0] * v[0] - params.c[1]], q=("x",),
    params={"u": 0.0, "m": 2.0, "k": 0.0, "c": [0.0, 0.0], "idle": 1.0},
)  # fmt: skip
SWING = lv.Lagrangian(
    lambda t, q, v, params: params.m * (ca.dot(v, v) / 2 - 9.81 * q[1]),
    lambda t, q, params: {"rod": ca.dot(q, q) - 1},
    force=lambda t, q, v, params: [-params.u * q[1], params.u * q[0]],
    q=("x", "y"), params={"u": 0.0, "m": 1.0},
)  # fmt: skip
CARRY = {
    "method": lv.Spark(2), "controls": ("u",), "cost": effort, "t": (0, 1), "steps": 10,
    "q": [0.0], "v": [0.0], "final": {"q": [1.0], "v": [0.0]},
}  # fmt: skip


def light(t, q, v, params):
    """Return the price of lightness: a mass m costs 3 / m^2 and takes an effort of 6 m^2."""
    return 3 / params.m**2


def test_free_parameters_are_chosen_with_the_controls():
    found = lv.optimal_control(HEAVY, free=("params.m",), final_cost=light, **CARRY)
    assert found.params["m"] == pytest.approx(0.5**0.25, rel=1e-9)
    assert found.cost == pytest.approx(2 * np.sqrt(18), rel=1e-12)
    np.testing.assert_allclose(found.controls["u"], -found.costates["p"][:, 0], rtol=1e-9)
    np.testing.assert_allclose(found.solution.q, found.q, atol=1e-12)
    again = lv.optimal_control(HEAVY, free=("params.m",), final_cost=light, guess=found, **CARRY)
    assert again.iterations < found.iterations
    run = lv.optimal_control(HEAVY, free=("params.m",), guess=found.solution, **CARRY | {
        "final_cost": light, "options": {"max_iter": 20},
    })  # fmt: skip
    assert run.params["m"] == pytest.approx(found.params["m"], rel=1e-9)
    other = lv.optimal_control(MASS, **CARRY)  # of a system without masses
    mixed = lv.optimal_control(HEAVY, free=("params.m",), final_cost=light, guess=other, **CARRY)
    assert mixed.cost == pytest.approx(found.cost, rel=1e-12)
    bounds = {"m": (1.0, None)}
    held = lv.optimal_control(HEAVY, free=("params.m",), final_cost=light, bounds=bounds, **CARRY)
    assert (held.params["m"], held.cost) == pytest.approx((1.0, 9.0), rel=1e-9)


def test_free_parameters_are_in_forces_paths_ends_and_constrained_systems():
    """A spring that swings by itself needs no effort; an array is several numbers."""
    call = {**CARRY, "method": lv.Spark(3), "q": [1.0], "params": {"m": 1.0}, "steps": 20}
    found = lv.optimal_control(HEAVY, free=("params.k",), **{**call, "final": {"q": [0.0]}})
    assert found.params["k"] == pytest.approx(np.pi**2 / 4, rel=1e-9)
    assert found.cost < 1e-20
    sum_of = {"sum": lambda t, q, v, params: params.c[0] + params.c[1] - 3}
    path = {"least": (lambda t, q, v, params: params.c[1] - q[0], 1.0, None)}
    pushed = lv.optimal_control(
        HEAVY, free=("params.c",), path=path, **{**call, "final": sum_of | {"q": [0.5]}}
    )
    assert np.sum(pushed.params["c"]) == pytest.approx(3, abs=1e-12)
    assert pushed.params["c"][1] >= 2 - 1e-9
    quarter = {"q": [1.0, 0.0], "v": [0.0, 0.0]}
    swung = lv.optimal_control(
        SWING, free=("params.m",), final_cost=light,
        **{**CARRY, "q": [0.0, -1.0], "v": [0.0, 0.0], "final": quarter},
    )  # fmt: skip
    at = {m: lv.optimal_control(
        SWING, final_cost=light, params={"m": m},
        **{**CARRY, "q": [0.0, -1.0], "v": [0.0, 0.0], "final": quarter},
    ).cost for m in swung.params["m"] * np.array([0.999, 1.0, 1.001])}  # fmt: skip
    below, least, above = at.values()
    assert swung.cost == pytest.approx(least, rel=1e-10)
    assert min(below, above) > least


@pytest.mark.parametrize(("system", "more", "says"), [
    (HEAVY, {"free": ("params.u",)}, r"free must be of q, v, params\.m, .*, not 'params\.u'"),
    (HEAVY, {"free": ("params.m", "params.m")}, r"free names 'params\.m' twice"),
    (HEAVY, {"free": ("params.idle",)}, "nothing depends on the free parameter 'idle'"),
    (HEAVY, {"free": ("params.m",), "bounds": {"k": (0, 1)}}, "hint: it takes u, m, q, v"),
    (HEAVY, {"free": ("params.m",), "bounds": {"m": 1}}, "parameter 'm' must be bounded by a pair"),
])  # fmt: skip
def test_free_parameters_are_checked(system, more, says):
    with pytest.raises((TypeError, ValueError), match=says):
        lv.optimal_control(system, **CARRY, **more)


def test_a_free_parameter_in_a_constraint_is_refused():
    rod = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2, lambda t, q, params: ca.dot(q, q) - params.l**2,
        force=lambda t, q, v, params: [params.u, 0], q=("x", "y"), params={"u": 0.0, "l": 1.0},
    )  # fmt: skip
    with pytest.raises(ValueError, match="'l' is in a constraint, which the start is on"):
        lv.optimal_control(
            rod, free=("params.l",), **{**CARRY, "q": [1, 0], "v": [0, 0], "final": None}
        )


def test_the_error_of_a_motion_is_estimated():
    coarse, fine = rayleigh(40), rayleigh(80)
    for found, sixfold in ((coarse, False), (fine, True)):
        run = lv.integrate(found.driven, lv.Spark(6), t=(0, 4.5), steps=8 * (len(found.t) - 1),
                           every=8, params=found.params, q=[-5.0], v=[-5.0])  # fmt: skip
        true = np.abs(run.q - found.q).max()
        assert found.error["q"] == pytest.approx(true, rel=0.05 if sixfold else 0.3)
    assert coarse.error["q"] > 30 * fine.error["q"]


def test_a_path_that_no_motion_keeps_is_named():
    """To come to rest at 1 in one unit of time takes a speed of 1 at least."""
    call = {"t": (0, 1), "q": [0.0], "v": [0.0], "final": {"q": [1.0], "v": [0.0]}}
    path = {"slow": (lambda t, q, v, params: v[0], None, 0.5)}
    with pytest.raises(lv.OptimizationError, match=r"without limits path 'slow' goes to .*of 0\.5"):
        moved(path=path, **call)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"path": {"a": 1}}, "path 'a' must be a function and two limits, not 1\nhint: write"),
        ({"path": {"a": (1, 0, 1)}}, "path 'a' must be a function and two limits"),
        ({"path": {"a": (lambda t, q, v, params: q[0], 1, 0)}}, "bounds of path 'a' leave nothing"),
        ({"path": {"a": (lambda t, q: q[0], 0, 1)}}, "path 'a' is called with"),
        (
            {"path": {"a": (lambda t, q, v, params: q[0], 0.1, None)}},
            "path 'a' is 0 at the start, and its limits are from 0.1 to inf",
        ),
        (
            {
                "path": {"a": (lambda t, q, v, params: ca.vertcat(q[0], v[0]), None, [1, 0.5])},
                "free": ("q",),
            },
            r"path 'a\[1\]' is 1 at the start, and its limits are from -inf to 0.5",
        ),
        (
            {"path": {"a": (lambda t, q, v, params: q[0] - v[0], 0, 0)}},
            "path 'a' has equal limits, and no control in it that could keep them\nhint: make",
        ),
        ({"free": "v"}, "free must be a sequence of states, not 'v'"),
        ({"free": ("u",)}, "free must be of q, v, not 'u'"),
    ],
)
def test_bad_arguments_are_refused(more, says):
    with pytest.raises((TypeError, ValueError), match=says):
        moved(**more)
