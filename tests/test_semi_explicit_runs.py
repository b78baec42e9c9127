"""Runs of semi-explicit systems that are more than equal steps of one, beside what is exact."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from index2_systems import SPINNING, nonlinear, nonlinear_at, pendulum, spinning, track, track_at

import liouville as lv

SWING = {"y": [1.0, 0.0, 0.0, 0.0]}

#: A system, times, start, and a method of high order from it.
CASES = {
    "nonlinear": (nonlinear(), (0.0, 2.0), {"y": [1.0, 1.0], "z": [1.0]}),
    "pendulum": (pendulum(), (0.0, 3.0), SWING),
    "spinning": (spinning(), (0.0, 5.0), {"y": SPINNING}),
    "track": (track(True), (1.0, 4.0), {"y": track_at(1.0)[0]}),
}


# --- ensembles -----------------------------------------------------------------------------------


def members():
    """Return pendulums at other places and rates, on their constraints."""
    near = [[1, 0.2 * k, 0.3, 0.2 * k] for k in range(5)]
    return np.array([pendulum().consistent(y=y)["y"] for y in near]), np.linspace(5, 9, 5)


@pytest.mark.parametrize(
    "method",
    [lv.Spark(3), lv.Spark(2, points="radau"), lv.Composition(lv.Spark(1), "SU4")],
    ids=str,
)
def test_members_with_parameters_of_their_own_are_single_runs(method):
    y, gravity = members()
    observe = {"pull": lambda t, y, z, params: z[0] / params.g}
    how = {"t": (0, 1), "h": 0.05, "every": 3, "observe": observe}
    found = lv.ensemble(pendulum(), method, y=y, params={"g": gravity}, threads=2, **how)
    assert found.y.shape == (8, 5, 4)
    assert found.z.shape == (8, 5, 2)
    assert found.residuals["hidden"].shape == (8, 5, 2)
    for k in range(5):
        one = lv.integrate(pendulum(), method, y=y[k], params={"g": gravity[k]}, **how)
        np.testing.assert_array_equal(found.y[:, k], one.y)
        np.testing.assert_array_equal(found.z[:, k], one.z)
        np.testing.assert_array_equal(found.observed["pull"][:, k], one.observed["pull"])


def test_many_starts_are_moved_as_each_alone():
    y, gravity = members()
    system, near = pendulum(), y + 0.01
    found = system.consistent(y=near, params={"g": gravity})
    for k in range(5):
        alone = system.consistent(y=near[k], params={"g": gravity[k]})
        assert all(found[name][k].tobytes() == alone[name].tobytes() for name in ("y", "z"))
    with pytest.raises(ValueError, match="member 3: no consistent start is near"):
        system.consistent(y=near * (np.arange(5) != 3)[:, None])


def test_workers_of_an_executor_give_the_same_bits():
    y, gravity = members()
    how = {"t": (0, 1), "h": 0.05, "y": y, "params": {"g": gravity}}
    here = lv.ensemble(pendulum(), lv.Spark(2), **how)
    with ThreadPoolExecutor(2) as executor:
        there = lv.ensemble(pendulum(), lv.Spark(2), **how, executor=executor, chunk=2)
    np.testing.assert_array_equal(there.y, here.y)
    np.testing.assert_array_equal(there.z, here.z)


def test_each_member_may_have_a_guess_of_its_own():
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: [z[0] ** 2, y[0]],
        constraint=lambda t, y, params: y[0] - 4 * t,
        y=2,
        z=1,
    )
    found = lv.ensemble(
        system, lv.Spark(2), t=(0, 1), h=0.1, y=[0, 0], z=[[1.5], [-3.0], [0.0], [2.5]]
    )
    for member, root in ((0, 2.0), (1, -2.0), (3, 2.0)):
        np.testing.assert_allclose(found.z[:, member, 0], root, rtol=1e-14)
    # the start of the third is singular
    assert [*found.failures] == [2]
    assert "do not determine unknown 'z0'" in found.failures[2].message
    assert np.isnan(found.z[:, 2]).all()


BAD_MEMBERS = {
    r"y has shape \(4,\), z has shape \(2,\)\nhint: give arrays": {"y": [1, 0, 0, 0], "z": [0, 0]},
    r"no parameter has a row for each member: y has shape \(4,\)\n": {"y": [1, 0, 0, 0]},
    r"(?s)z must have shape \(P, 2\) .*, not \(2, 3\).* a number for each of tension, shift": {
        "z": np.zeros((2, 3))
    },
    "z must have 2 members as y has, not 3": {"z": np.zeros((3, 2))},
    "member 1: start violates the constraint 'rod'": {"y": [[1, 0, 0, 0], [1.1, 0, 0, 0]]},
    "'q' is no start value of this system, which takes y= and, as a guess": {"q": [1, 0]},
    "ensemble takes no rtol=": {"rtol": 1e-6},
}


@pytest.mark.parametrize("message", BAD_MEMBERS)
def test_wrong_members_are_refused(message):
    call = {"t": (0, 1), "h": 0.1, "y": [[1, 0, 0, 0], [-1, 0, 0, 0]], **BAD_MEMBERS[message]}
    with pytest.raises((TypeError, ValueError), match=message):
        lv.ensemble(pendulum(), lv.Spark(2), **call)


# --- between steps -------------------------------------------------------------------------------


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_a_single_step_has_the_local_order_of_the_method(stages):
    places, errors = np.array([0.35, 0.6]), []
    for h in (0.2, 0.1):
        y, z = nonlinear_at(0.3)
        run = lv.integrate(nonlinear(), lv.Spark(stages), t=(0.3, 0.3 + h), steps=1, y=y, z=z)
        points = run(0.3 + h * places)
        exact = [nonlinear_at(t) for t in points.t]
        errors.append([
            max(abs(points.y[k] - exact[k][0]).max() for k in range(2)),
            max(abs(points.z[k] - exact[k][1]).max() for k in range(2)),
        ])  # fmt: skip
    assert min(np.log2(np.divide(*errors))) > 2 * stages + 1 - 0.5


@pytest.mark.parametrize("method", [lv.Spark(1), lv.Spark(4), lv.Spark(2, points="radau")], ids=str)
@pytest.mark.parametrize("backwards", [False, True], ids=["forwards", "backwards"])
def test_given_times_are_ends_of_steps(method, backwards):
    span = (0.0, -2.0) if backwards else (0.0, 2.0)
    whole = lv.integrate(spinning(), method, t=span, h=0.1, y=SPINNING)
    times = np.unique(np.concatenate([whole.t[:5], np.linspace(*span, 31)]))
    times = times[:: -1 if backwards else 1]
    some = lv.integrate(spinning(), method, t=span, h=0.1, t_eval=times, y=SPINNING)
    points = whole(times)
    np.testing.assert_array_equal(some.t, times)
    for name in ("y", "z"):
        np.testing.assert_allclose(some.states[name], points.states[name], atol=1e-12)
        ends = whole(whole.t).states[name]
        np.testing.assert_array_equal(ends, whole.states[name], err_msg=name)
    assert np.abs(some.residuals["hidden"]).max() < 5e-14


def test_the_invariants_at_the_start_are_known_where_it_is_not_kept():
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: [y[1] + y[0] * z[0], -y[0] + y[1] * z[0]],
        constraint=lambda t, y, params: ca.dot(y, y) - (1 + t) ** 2,
        y=2,
        z=1,
        invariants={"push": lambda t, y, z, params: z[0] * (1 + t)},
    )
    found = lv.integrate(system, lv.Spark(3), t=(0, 1), h=0.1, y=[1, 0], t_eval=[0.7])
    assert found.initial["push"] == pytest.approx(1.0, abs=1e-15)
    assert found.invariant_drift("push").max() < 1e-6


# --- events --------------------------------------------------------------------------------------


def test_events_are_where_the_closed_form_has_them():
    events = {
        "grown": lambda t, y, z, params: y[0] - 2,
        "pushed": lambda t, y, z, params: z[0] - 3,
        "falls": lv.Event(lambda t, y, z, params: y[1] - 1, direction="down"),
        "rises": lv.Event(lambda t, y, z, params: y[0] - 3, direction="down"),
    }
    for method, h, accuracy in (
        (lv.Spark(5), 0.1, 1e-12),
        (lv.Spark(3, points="radau"), 0.02, 1e-10),
        (lv.Spark(1), 0.01, 1e-3),
    ):
        found = lv.integrate(nonlinear(), method, t=(0, 2), h=h, y=[1, 1], z=[1], events=events)
        assert found.events["grown"].t == pytest.approx([np.log(2)], abs=accuracy)
        assert found.events["pushed"].t == pytest.approx([np.log(3) / 2], abs=accuracy)
        assert found.events["pushed"].z[0, 0] == pytest.approx(3, abs=1e-14)
        assert found.events["grown"].y[0, 0] == pytest.approx(2, abs=1e-14)
        y, t = found.events["grown"].y[0], found.events["grown"].t[0]
        # a state of the method itself: on the constraint
        assert abs(y[0] ** 2 * y[1] - 1 - np.sin(t)) < 1e-14
        assert len(found.events["rises"]) == 0


def test_events_and_the_steps_of_a_stored_run_are_those_of_a_straight_one(tmp_path):
    how = {
        "t": (0, 3), "rtol": 1e-7, **SWING,
        "events": {"taut": lambda t, y, z, params: z[0] - 20},
    }  # fmt: skip
    straight = lv.integrate(pendulum(), lv.Spark(3), **how)
    lv.integrate(pendulum(), lv.Spark(3), **how, store=tmp_path / "run.zarr")
    straight.save(tmp_path / "run.nc")
    for name in ("run.zarr", "run.nc"):
        found = lv.load(tmp_path / name)
        np.testing.assert_array_equal(found.t, straight.t)
        for state in ("y", "z"):
            np.testing.assert_array_equal(found.states[state], straight.states[state])
            met = found.events["taut"].states[state]
            np.testing.assert_array_equal(met, straight.events["taut"].states[state])
    assert len(straight.events["taut"]) == 5


def test_events_end_a_run_and_change_no_bit_of_it():
    low = lv.Event(lambda t, y, z, params: y[0], direction="down", terminal=2)
    whole = lv.integrate(pendulum(), lv.Spark(3), t=(0, 9), h=0.05, **SWING)
    found = lv.integrate(
        pendulum(), lv.Spark(3), t=(0, 9), h=0.05, **SWING,
        events={"low": low, "taut": lambda t, y, z, params: z[0] - 20},
    )  # fmt: skip
    assert len(found.events["low"]) == 2
    assert found.message == f"event 'low' at t = {found.t[-1]:.6g}"
    assert abs(found.y[-1, 0]) < 1e-15
    assert abs(found.residuals["constraint"]).max() < 1e-14
    # twice a half swing, by the formula for the period of a pendulum released level
    quarter = 1.8540746773013719 / np.sqrt(9.81)
    np.testing.assert_allclose(found.events["low"].t, [quarter, 5 * quarter], rtol=1e-6)
    np.testing.assert_allclose(found.events["taut"].z[:, 0], 20, rtol=1e-14)
    np.testing.assert_array_equal(found.y[:-1], whole.y[: len(found.t) - 1])
    np.testing.assert_array_equal(found(found.t[-1]).z, found.z[-1])


# --- steps by an estimate ------------------------------------------------------------------------


@pytest.mark.parametrize("points", ["gauss", "radau"])
@pytest.mark.parametrize("stages", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("name", CASES)
def test_a_step_adds_at_most_about_the_tolerance(name, stages, points):
    """Measured by a method of order 12 from each of some states on; in the tolerance's own norm."""
    system, t, start = CASES[name]
    rtol = 1e-8 if stages > 2 else 1e-5 if stages > 1 else 1e-3
    method = lv.Spark(stages, points=points)
    found = lv.integrate(system, method, t=t, rtol=rtol, **start)
    assert abs(found.residuals["constraint"]).max() < 1e-13
    ratios = []
    for k in np.linspace(len(found.t) // 4, len(found.t) - 2, 12).astype(int):
        ends = found.t[k], found.t[k + 1]
        one = {"y": found.y[k], "z": found.z[k]}
        exact = lv.integrate(system, lv.Spark(6), t=ends, steps=4, **one)
        unit = rtol * (np.maximum(np.abs(found.y[k]), np.abs(found.y[k + 1])) + 1e-3)
        ratios.append(np.sqrt(np.mean(((found.y[k + 1] - exact.y[-1]) / unit) ** 2)))
    assert max(ratios) < 5


@pytest.mark.parametrize("points", ["gauss", "radau"])
@pytest.mark.parametrize("stages", [2, 3, 4])
def test_the_error_falls_with_the_tolerance(stages, points):
    """A local error of order p + 1 at the tolerance leaves a global one of its power p/(p + 1)."""
    tolerances = 10.0 ** -np.arange(4, 10)
    y, _ = track_at(3.0)
    errors = []
    for rtol in tolerances:
        method = lv.Spark(stages, points=points)
        found = lv.integrate(track(True), method, t=(1, 3), rtol=rtol, y=track_at(1.0)[0])
        errors.append(abs(found.y[-1] - y).max())
        assert {"rejected", "h_smallest", "h_largest", "h_next"} <= found.stats.keys()
        assert found.tolerances == {"rtol": rtol, "atol": pytest.approx(rtol / 1000)}
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.55 < slope < 1.25, errors
    assert errors[-1] < 1e-6


@pytest.mark.parametrize("points", ["gauss", "radau"])
def test_a_rejected_step_is_undone(points):
    """A kick that comes from nowhere costs rejections and leaves the error where it was."""
    kicked = lv.SemiExplicit(
        field=lambda t, y, z, params: [
            -y[1] + y[0] * z[0],
            y[0] / 2 + y[1] * z[0] + 10 * ca.exp(-(((t - 5) / 0.02) ** 2)),
        ],
        constraint=lambda t, y, params: (ca.dot(y, y) - 1) / 2,
        y=2,
        z=1,
    )
    start = {"y": [1.0, 0.0]}
    method = lv.Spark(3, points=points)
    found = lv.integrate(kicked, method, t=(0, 10), rtol=1e-8, **start)
    exact = lv.integrate(kicked, lv.Spark(4), t=(0, 10), h=1e-3, **start)
    assert found.stats["rejected"] >= 1
    assert found.stats["h_smallest"] == pytest.approx(np.diff(found.t).min(), rel=1e-9)
    assert abs(found.y[-1] - exact.y[-1]).max() < 3e-6


def test_where_no_step_will_do_the_run_ends():
    blowing = lv.SemiExplicit(
        field=lambda t, y, z, params: [z[0], y[1] ** 2],
        constraint=lambda t, y, params: y[0] - t,
        y=2,
        z=1,
    )
    with pytest.raises(lv.IntegrationError, match="smaller") as caught:
        lv.integrate(blowing, lv.Spark(3), t=(0, 2), rtol=1e-6, y=[0, 1])
    assert caught.value.t == pytest.approx(1, abs=1e-3)
    assert np.isfinite(caught.value.solution.y).all()


# --- reversible steps ----------------------------------------------------------------------------


def pulled(t, y, z, params):
    return (2 + ca.sin(t)) / (1 + z[0] ** 2 / 100)


def test_steps_follow_a_monitor_of_time_and_the_unknown():
    """Its rate along the motion has parts of t, of y' and of z'."""
    control = lv.Reversible(pulled)
    found = lv.integrate(pendulum(), lv.Spark(3), t=(0, 5), h=0.002, control=control, **SWING)
    wanted = 0.002 * (2 + np.sin(found.t)) / (1 + found.z[:, 0] ** 2 / 100) / 2
    middle = (wanted[1:-1] + wanted[:-2]) / 2
    np.testing.assert_allclose(np.diff(found.t)[:-1], middle, rtol=2e-3)


@pytest.mark.parametrize("method", [lv.Spark(2), lv.Composition(lv.Spark(1), "SU4")], ids=str)
def test_turned_round_they_go_back(method):
    how = {"control": lv.Reversible(pulled), "h": 0.01}
    there = lv.integrate(pendulum(), method, t=(0, 3), **how, **SWING)
    end = there.t[-2]  # the last step was made to fit
    there = lv.integrate(pendulum(), method, t=(0, end), **how, **SWING)
    how["h"] = there.stats["h_next"]
    back = lv.integrate(pendulum(), method, t=(end, 0), y=there.y[-1], **how)
    assert len(back.t) == len(there.t)
    np.testing.assert_allclose(back.t[::-1], there.t, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.y[-1], SWING["y"], rtol=0, atol=1e-12)


REFUSED = {
    "has no accelerations, .*\nhint: give control=lv.Reversible\\(monitor=lambda t, y, z, params": (
        lv.Spark(2), {"control": lv.Reversible(), "h": 0.1}
    ),
    "Spark is not symmetric, .*\nhint: take Spark on Gauss points": (
        lv.Spark(2, points="radau"), {"control": lv.Reversible(pulled), "h": 0.1}
    ),
    "Composition does not estimate its errors\nhint: give h or steps, or take Spark$": (
        lv.Composition(lv.Spark(1), "SU4"), {"rtol": 1e-6}
    ),
}  # fmt: skip


@pytest.mark.parametrize("message", REFUSED)
def test_a_control_that_a_method_has_not_is_refused_with_what_does(message):
    method, how = REFUSED[message]
    with pytest.raises(TypeError, match=message):
        lv.integrate(pendulum(), method, t=(0, 1), **how, **SWING)


# --- Radau points --------------------------------------------------------------------------------


def test_radau_points_damp_what_gauss_points_leave_oscillating():
    """A stiff component in the direction that the constraint leaves free."""
    stiff = lv.SemiExplicit(
        field=lambda t, y, z, params: [
            -y[1] + y[0] * z[0],
            y[0] + y[1] * z[0],
            -1e6 * (y[2] - ca.sin(t)) + ca.cos(t),
        ],
        constraint=lambda t, y, params: (y[0] ** 2 + y[1] ** 2 - 1) / 2,
        y=3,
        z=1,
    )
    left = {}
    for points in ("gauss", "radau"):
        method = lv.Spark(3, points=points)
        found = lv.integrate(stiff, method, t=(0, 1), h=0.1, y=[1, 0, 0.1])
        left[points] = abs(found.y[-1, 2] - np.sin(1.0))
        assert abs(found.y[-1, :2] - [np.cos(1.0), np.sin(1.0)]).max() < 1e-6
        assert abs(found.residuals["constraint"]).max() < 1e-14
    assert left["radau"] < 1e-10
    assert left["gauss"] > 0.09


# --- events at the end ---------------------------------------------------------------------------


def test_an_event_at_the_end_of_a_run_is_of_that_run():
    """It ends it or resets it there; the run that goes on does not meet it."""
    turn = lambda t, y, z, params: {"y": ca.vertcat(y[:2], -y[2:])}  # noqa: E731
    for more in ({}, {"terminal": True}, {"reset": turn}):
        now = lv.Event(lambda t, y, z, params: t - 0.6 + 0 * y[0], **more)
        call = {"h": 0.05, "events": {"now": now, "seen": lambda t, y, z, params: (t - 0.6) * y[1]}}
        run = lv.integrate(pendulum(), lv.Spark(3), t=(0, 0.6), **call, **SWING)
        assert [points.t.tolist() for points in run.events.values()] == [[0.6], [0.6]]
        assert run.message == "event 'now' at t = 0.6" * ("terminal" in more)
        assert (run.y[-1, 3] < 0) == ("reset" in more)
        end = {"y": run.y[-1], "z": run.z[-1]}
        again = lv.integrate(pendulum(), lv.Spark(3), t=(0.6, 0.8), **call, **end)
        assert [len(points) for points in again.events.values()] == [0, 0]


GROWING = lv.SemiExplicit(
    field=lambda t, y, z, p: [z[0] * y[0] - y[0], 1e307 + 0 * t],
    constraint=lambda t, y, p: {"c": y[0] - ca.cos(t)},
    y=2,
    z=1,
)


def test_a_state_that_overflows_is_no_result():
    call = {"t": (0.0, 100.0), "steps": 100}
    for kept in ({}, {"every": 50}, {"states": False}, {"t_eval": [5.0, 100.0]}):
        with pytest.raises(lv.IntegrationError, match="'y1' is not finite") as caught:
            lv.integrate(GROWING, lv.Spark(2), y=[1.0, 0.0], **call, **kept)
        assert caught.value.step == 17
    both = lv.ensemble(GROWING, lv.Spark(2), y=[[1.0, 0.0], [1.0, -1.7e308]], **call)
    assert {k: x.step for k, x in both.failures.items()} == {0: 17, 1: 34}


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(), lv.HHT()], ids=repr)
def test_coordinates_that_overflow_are_no_result(method):
    free = lv.Lagrangian(lambda t, q, v, p: ca.dot(v, v) / 2, q=("x", "y"))
    call = {"t": (0.0, 1e170), "steps": 10}
    start = {"q": [0.0, 1.7e308], "v": [0.0, 1e150]}
    for states in (True, False):
        with pytest.raises(lv.IntegrationError):
            lv.integrate(free, method, **call, **start, states=states)
    many = lv.ensemble(free, method, **call, q=[start["q"], [0, 0]], v=[start["v"], [0, 0]])
    assert 0 in many.failures
