"""Semi-explicit systems of index 2: order, constraints, symmetry, invariants and failures."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from index2_systems import SPINNING, nonlinear, nonlinear_at, pendulum, spinning, track, track_at

import liouville as lv
from liouville import plot
from liouville.analysis.convergence import slope
from liouville.problems import load

PENDULUM_STEPS = (4000, 6000, 8000), (400, 600, 800), (200, 300, 400), (160, 200, 240)


@pytest.mark.parametrize("s", [1, 2, 3, 4])
def test_order_is_twice_the_stages_for_a_stabilised_mechanism(s):
    problem = load("pendulum")
    end = problem.reference[10.0]
    start = np.concatenate([problem.start["q"], problem.start["v"]])
    errors = []
    for steps in PENDULUM_STEPS[s - 1]:
        found = lv.integrate(pendulum(), lv.Spark(s), t=(0, 10), steps=steps, y=start)
        errors.append(
            (
                abs(found.y[-1] - np.concatenate([end["q"], end["v"]])).max(),
                abs(found.z[-1] - [end["lam"][0], 0.0]).max(),
            )
        )
    for state in range(2):
        sizes = [10 / steps for steps in PENDULUM_STEPS[s - 1]]
        order = slope(sizes, [error[state] for error in errors])
        assert abs(order - 2 * s) < 0.15, (state, order, errors)


@pytest.mark.parametrize("is_stabilised", [False, True])
def test_circular_track_follows_its_closed_form(is_stabilised):
    y, lam = track_at(5.0)
    start, _ = track_at(1.0)
    found = lv.integrate(track(is_stabilised), lv.Spark(6), t=(1, 5), h=0.02, y=start)
    assert abs(found.y[-1] - y)[:2].max() < 1e-12
    assert abs(found.y[-1] - y)[2:].max() < 1e-11
    assert abs(found.z[-1, 0] - lam) < 1e-12 * lam
    assert abs(found.residuals["constraint"]).max() < 1e-13


def test_the_mean_of_the_constraint_vanishes_so_that_its_integral_is_kept():
    start, _ = track_at(1.0)
    for s in (2, 3):
        found = lv.integrate(track(False), lv.Spark(s), t=(1, 5), h=0.05, y=start)
        assert abs(np.sum(found.y[:, :2] ** 2, axis=1) - 1).max() < 1e-13


@pytest.mark.parametrize("s", [1, 2, 3, 5])
def test_constraints_hold_and_a_quadratic_invariant_is_kept(s):
    found = lv.integrate(spinning(), lv.Spark(s), t=(0, 20), h=0.05, y=SPINNING)
    # the last time, t = 20, is rounded otherwise than the step's own end
    assert abs(found.residuals["constraint"]).max() < 5e-15
    assert abs(found.residuals["hidden"]).max() < 5e-14
    assert found.invariant_drift("length").max() < 3e-15


@pytest.mark.parametrize("s", [1, 2, 3, 4])
def test_a_step_back_undoes_a_step(s):
    cases = (nonlinear(), *nonlinear_at(0.3), 0.3), (spinning(), SPINNING, [0.0], 0.0)
    for system, y, z, t in cases:
        there = lv.integrate(system, lv.Spark(s), t=(t, t + 0.2), steps=2, y=y, z=z)
        back = lv.integrate(
            system, lv.Spark(s), t=(t + 0.2, t), steps=2, y=there.y[-1], z=there.z[-1]
        )
        assert abs(back.y[-1] - y).max() < 2e-15
        assert abs(there.y[-1] - y).max() > 0.01


def test_small_steps_are_as_well_conditioned_as_large_ones():
    _, z = nonlinear_at(0.0)
    for h in (1e-2, 1e-5, 1e-8):
        found = lv.integrate(nonlinear(), lv.Spark(3), t=(0, 20 * h), steps=20, y=[1, 1], z=z)
        y, z_end = nonlinear_at(20 * h)
        assert abs(found.y[-1] - y).max() < 1e-14
        assert abs(found.z[-1] - z_end).max() < 1e-14
        assert found.stats["iterations"] < 8 * 20
        assert found.stats["cold_starts"] == 0


def test_factors_serve_as_long_as_that_pays():
    linear = lv.SemiExplicit(
        field=lambda t, y, z, params: [-y[1] + z[0], y[0] + z[0] + ca.sin(t)],
        constraint=lambda t, y, params: y[0] + 2 * y[1] - t,
        y=2,
        z=1,
    )
    found = lv.integrate(linear, lv.Spark(2), t=(0, 10), h=0.1, y=[0, 0])
    assert found.stats["factorizations"] <= 3  # a start has one for each correction
    turning = lv.integrate(spinning(), lv.Spark(2), t=(0, 10), h=0.05, y=SPINNING)
    assert 1 < turning.stats["factorizations"] < turning.stats["steps"]


def test_what_is_observed_saved_and_named(tmp_path):
    observe = {"both": lambda t, y, z, params: [z[0] * t, y[0]]}
    found = lv.integrate(
        pendulum(), lv.Spark(2), t=(0, 1), h=0.1, every=3, y=[1, 0, 0, 0], observe=observe
    )
    assert found.y.shape == (5, 4)
    assert found.z.shape == (5, 2)
    np.testing.assert_array_equal(found.observed["both"][:, 0], found.z[:, 0] * found.t)
    assert found.names["unknowns"] == ("tension", "shift")
    found.save(tmp_path / "run.nc")
    loaded = lv.load(tmp_path / "run.nc")
    np.testing.assert_array_equal(loaded.z, found.z)
    assert loaded.names == found.names
    found.save(tmp_path / "run.csv")
    head = (tmp_path / "run.csv").read_text().split("\n")[0]
    assert "z[shift]" in head
    assert "constraint[rod]" in head
    small = lv.integrate(
        pendulum(), lv.Spark(2), t=(0, 1), h=0.1, y=[1, 0, 0, 0], observe=observe, states=False
    )
    assert not small.states
    assert set(small.residuals) == {"constraint", "hidden"}


def test_it_is_drawn_and_run_from_the_command_line(liouville):
    found = lv.integrate(pendulum(), lv.Spark(2), t=(0, 1), h=0.1, y=[1, 0, 0, 0])
    titles = [axes.get_title() for axes in plot.overview(found).axes]
    assert len(titles) == 3
    assert plot.trajectories(found, "z", names=["shift"]).get_ylabel()
    Path("model.py").write_text(
        "import liouville as lv\n"
        "system = lv.SemiExplicit(field=lambda t, y, z, params: [z[0], y[0]],\n"
        "    constraint=lambda t, y, params: y[0] - 2 * t, y=('a', 'b'), z=('push',))\n"
        "start = {'y': (0.0, 0.0)}\n"
        "interval = (0.0, 1.0)\n"
        "h = 0.1\n"
        "reference = {1.0: {'y': (2.0, 1.0), 'z': (2.0,)}}\n"
    )
    ran = liouville("run model.py --stages 2")
    assert ran.returncode == 0, ran.stderr
    assert "push" in ran.stdout
    assert "z from reference" in ran.stdout


def test_a_start_is_moved_onto_the_constraints_and_z_is_found():
    system = pendulum()
    near = system.consistent(y={"x": 1.01, "y": 0.1, "u": 0.1, "v": 1.0})
    x, y, u, v = near["y"]
    assert abs(x**2 + y**2 - 1) < 1e-15
    assert abs(x * u + y * v) < 1e-15
    assert abs(near["z"][0] - (u**2 + v**2 - 9.81 * y)) < 1e-13
    found = lv.integrate(system, lv.Spark(2), t=(0, 0.1), h=0.1, **near)
    np.testing.assert_allclose(found.z[0], near["z"], rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", [lv.Spark(1), lv.Spark(3), lv.Spark(2, points="radau")], ids=str)
def test_z_is_found_where_corrections_grow_at_first(method):
    """At rest at zero z + z**3 = 2, where Newton's corrections from zero are 2 and then larger."""
    system = lv.SemiExplicit(
        field=lambda t, y, z, p: [y[1] - y[0] ** 3, z[0] + z[0] ** 3 - 2],
        constraint=lambda t, y, p: y[1] - ca.sin(y[0]), y=2, z=1,
    )  # fmt: skip
    found = lv.integrate(system, method, t=(0, 1), h=0.1, y=[0.0, 0.0])
    assert np.abs(found.y).max() < 1e-14
    assert found.z == pytest.approx(1.0, abs=1e-12)


def test_the_guess_chooses_among_solutions_for_z():
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: [z[0] ** 2, y[0]],
        constraint=lambda t, y, params: y[0] - 4 * t,
        y=2,
        z=1,
    )
    for guess, root in ((1.5, 2.0), (-3.0, -2.0)):
        found = lv.integrate(system, lv.Spark(2), t=(0, 1), h=0.1, y=[0, 0], z=[guess])
        np.testing.assert_allclose(found.z[:, 0], root, rtol=1e-14)
    with pytest.raises(lv.IntegrationError, match="do not determine unknown 'z0'"):
        lv.integrate(system, lv.Spark(2), t=(0, 1), h=0.1, y=[0, 0])


BAD_SYSTEMS = {
    "as many as the 2 unknowns z, not 1": ({"z": 2}, None),
    "index is higher than 2": ({}, lambda t, y, params: y[1]),
    "the same for all coordinates": ({}, lambda t, y, params: t),
    "constraint must return": ({}, lambda t, y, params: "circle"),
    "z names 'a' twice": ({"z": ("a", "a")}, None),
    "params must be a mapping": ({"params": 3}, None),
}


@pytest.mark.parametrize("message", BAD_SYSTEMS)
def test_a_system_that_is_not_of_index_2_is_refused(message):
    more, constraint = BAD_SYSTEMS[message]
    with pytest.raises((TypeError, ValueError), match=message):
        lv.SemiExplicit(
            field=lambda t, y, z, params: [z[0], y[0]],
            constraint=constraint or (lambda t, y, params: y[0]),
            **{"y": 2, "z": 1, **more},
        )


def test_an_unknown_without_effect_is_named():
    with pytest.raises(ValueError, match="'idle' enters the rate of change of no constraint"):
        lv.SemiExplicit(
            field=lambda t, y, z, params: [z[0], y[0], z[1]],
            constraint=lambda t, y, params: [y[0], y[0] * y[1]],
            y=3,
            z=("push", "idle"),
        )


BAD_CALLS = {
    "start value 'y' is missing": {"y": None},
    "y must have shape": {"y": [1, 0]},
    "z must have shape": {"z": [1]},
    "y of 'u' must be finite, not nan": {"y": [1, 0, float("nan"), 0]},
    "'q' is no start value": {"q": [1, 0]},
    "violates the constraint 'rod'": {"y": [1, 0.1, 0, 0]},
    "violates the constraint 'speed'": {"y": [1, 0, 0.1, 0]},
    "rtol must be from 1e-14": {"rtol": 1e-15, "h": None},
    "atol must have shape": {"rtol": 1e-6, "h": None, "atol": [1, 1]},
    "t_eval must be within .*, not 1.1": {"t_eval": [0.1, 1.1]},
    r"event 'none' is the same for all states\nhint: .* such as y\[1\]": {
        "events": {"none": lambda t, y, z, params: params.g}
    },
    r"called with \(t, y, z, params\), and the function given takes": {
        "events": {"none": lambda t, y, z, lam, params: y[0]}
    },
    "no parameter 'm'": {"params": {"m": 1}},
}


@pytest.mark.parametrize("message", BAD_CALLS)
def test_a_wrong_call_is_refused(message):
    call = {"t": (0, 1), "h": 0.1, "y": [1, 0, 0, 0], **BAD_CALLS[message]}
    call = {name: value for name, value in call.items() if value is not None}
    with pytest.raises((TypeError, ValueError), match=message):
        lv.integrate(pendulum(), lv.Spark(2), **call)


@pytest.mark.parametrize(
    "method",
    [
        lv.HHT(),
        lv.LobattoPair(2),
        lv.Spark(2, newton_tol=1e-8),
        lv.Composition(lv.LobattoPair(2), "SU4"),
        lv.VolumeSplitting(),
    ],
    ids=str,
)
def test_other_methods_say_which_do(method):
    with pytest.raises(TypeError, match="does not step semi-explicit systems; methods that do: Sp"):
        lv.integrate(pendulum(), method, t=(0, 1), h=0.1, y=[1, 0, 0, 0])


def test_a_singular_start_is_named():
    degenerate = lv.SemiExplicit(
        field=lambda t, y, z, params: [y[1] * z[0], 1.0],
        constraint=lambda t, y, params: {"flat": y[0]},
        y=2,
        z=("push",),
    )
    with pytest.raises(lv.IntegrationError, match="k_y f_z is singular") as caught:
        lv.integrate(degenerate, lv.Spark(2), t=(0, 1), h=0.1, y=[0, 0])
    assert caught.value.quantity == "push"


def test_a_failed_step_keeps_the_good_ones_and_names_the_coordinate():
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: {"a": z[0] - y[1], "b": ca.log(1.05 - t)},
        constraint=lambda t, y, params: y[0],
        y=("a", "b"),
        z=1,
    )
    with pytest.raises(lv.IntegrationError, match="field of coordinate 'b' is not finite") as found:
        lv.integrate(system, lv.Spark(2), t=(0, 2), h=0.1, y=[0, 0])
    assert found.value.step == 10
    assert found.value.quantity == "b"
    assert len(found.value.solution.t) == 11
    assert np.isfinite(found.value.solution.z).all()
