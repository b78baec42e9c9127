"""Events of fields, and sections by surfaces: each is the end of a shorter step."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.problems import abc_flow

X = [-1.2, -0.46, -2.83]
PLAN = lv.plan(abc_flow.system, lv.VolumeSplitting(composition="BM6"), h=0.1, x=X)
TURNING = lv.PolynomialField(lambda t, x, params: [x[1], -x[0]], x=("x", "y"))
EXACT = lv.VolumeSplitting(linear="exact")


def flow(events, t=(0, 30), x=X, **more):
    steps = more.pop("steps", round(abs(t[1] - t[0]) / 0.1))
    return lv.integrate(abc_flow.system, PLAN, t=t, steps=steps, x=x, events=events, **more)


def turning(events, t=(0, 20), h=0.4, **more):
    return lv.integrate(TURNING, EXACT, t=t, h=h, x=[0.0, 1.0], events=events, **more)


def level(c, **more):
    return lv.Event(lambda t, x, params: x[0] - c, **more)


@pytest.mark.parametrize("direction", ["both", "up", "down"])
def test_a_plane_is_met_where_the_section_by_it_is(direction):
    run = flow({"plane": level(-1.5, direction=direction)})
    call = {"t": (0, 30), "steps": 300, "offset": -1.5, "direction": direction, "x": [X]}
    found = lv.section(abc_flow.system, PLAN, plane="x", **call)
    points = run.events["plane"]
    assert len(points) == len(found) > 1
    np.testing.assert_allclose(points.t, found.t, rtol=0, atol=1e-13)
    np.testing.assert_allclose(points.x, found.x, rtol=0, atol=1e-13)
    assert np.abs(points.x[:, 0] + 1.5).max() < 1e-14
    surface = lv.section(abc_flow.system, PLAN, plane=lambda t, x, params: x[0], **call)
    np.testing.assert_array_equal(surface.x, points.x)
    np.testing.assert_array_equal(surface.t, points.t)


def test_an_event_is_the_end_of_a_shorter_step():
    run = flow({"far": lambda t, x, params: ca.cos(x[0]) + 0.002 * t * params.A})
    points = run.events["far"]
    assert len(points)
    for t, x in zip(points.t, points.x, strict=True):
        n = int(t / 0.1)
        part = flow(None, (run.t[n], t), run.x[n], steps=1)
        np.testing.assert_allclose(part.x[-1], x, rtol=2e-15, atol=1e-14)
        assert abs(np.cos(x[0]) + 0.002 * t * abc_flow.system.params["A"]) < 1e-14


@pytest.mark.parametrize("c", [0.3, 0.95, 0.999, 0.99999, -0.999])
def test_two_crossings_within_a_step_are_seen(c):
    """Of x = sin t, in steps of an exact flow."""
    run = turning({"level": level(c)})
    first = np.arcsin(c)
    wanted = np.sort(np.add.outer([first, np.pi - first], 2 * np.pi * np.arange(-1, 4)).ravel())
    wanted = wanted[(wanted > 0) & (wanted < 20)]
    np.testing.assert_allclose(run.events["level"].t, wanted, rtol=0, atol=1e-11)
    above = turning({"level": level(1.0 + 1e-9)})
    assert not len(above.events["level"])


@pytest.mark.parametrize(("way", "first"), [(1, np.pi / 6), (-1, 7 * np.pi / 6)])
def test_an_event_ends_a_run_forwards_and_backwards(way, first):
    events = {"all": level(0.5), "third": level(0.5, direction="up", terminal=3)}
    run = turning(events, (0, 20 * way))
    points = run.events["third"]
    wanted = way * (first + 2 * np.pi * np.arange(3))
    np.testing.assert_allclose(points.t, wanted, rtol=0, atol=1e-11)
    assert run.status == "done"
    assert run.message == f"event 'third' at t = {points.t[-1]:.6g}"
    assert run.t[-1] == points.t[-1]
    np.testing.assert_array_equal(run.x[-1], points.x[-1])
    np.testing.assert_array_equal(run.events["all"].t[::2], points.t)


def test_a_start_on_an_event_is_none():
    run = turning({"axis": level(0.0)}, h=0.5)
    np.testing.assert_allclose(run.events["axis"].t, np.pi * np.arange(1, 7), rtol=0, atol=1e-11)


def test_members_meet_the_events_of_runs_of_their_own():
    starts = np.random.default_rng(3).uniform(-1, 1, (5, 3))
    amplitudes = np.linspace(0.8, 1.2, 5)
    events = {"end": level(1.5, terminal=True), "side": lambda t, x, params: x[1] - params.A}
    call = {"t": (0, 20), "steps": 200, "events": events}
    for params in ({}, {"A": amplitudes}):
        many = lv.ensemble(abc_flow.system, PLAN, x=starts, params=params, **call)
        for member, x in enumerate(starts):
            own = {name: values[member] for name, values in params.items()}
            one = lv.integrate(abc_flow.system, PLAN, x=x, params=own, **call)
            for name, points in one.events.items():
                of_member = many.events[name].of_member(member)
                np.testing.assert_array_equal(of_member.t, points.t)
                np.testing.assert_array_equal(of_member.x, points.x)
            assert many.endings.get(member, "") == one.message
            last = len(one.t) - bool(one.message)
            np.testing.assert_array_equal(many.x[:last, member], one.x[:last])
            assert np.isnan(many.x[last:, member]).all()


def test_given_times_end_with_the_run():
    times = np.arange(0.0, 20.0, 0.7)
    run = turning({"third": level(0.5, terminal=3)}, t_eval=times)
    end = run.events["third"].t[-1]
    np.testing.assert_array_equal(run.t, times[times <= end])
    np.testing.assert_allclose(run.x[:, 0], np.sin(run.t), rtol=0, atol=1e-12)


def test_a_stored_run_has_the_same_events_after_pauses(tmp_path):
    events = {"level": level(-1.5), "end": level(-1.6, terminal=5)}
    stored = flow(events, store=lv.Store(tmp_path / "run.zarr", 7))
    plain = flow(events)
    found = lv.load(stored.path)
    for name, points in plain.events.items():
        np.testing.assert_array_equal(found.events[name].t, points.t)
        np.testing.assert_array_equal(found.events[name].x, points.x)
    np.testing.assert_array_equal(found.x, plain.x)


def test_a_gridded_field_has_events_and_sections_by_surfaces():
    axis = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    period = {"x": 2 * np.pi, "y": 2 * np.pi}
    field = lv.GriddedField(axis, axis, potential=np.sin(x) * np.sin(y), periodic=period)
    radius = 1.01

    def circle(t, x, params):
        return (x[0] - np.pi / 2) ** 2 + (x[1] - np.pi / 2) ** 2 - radius**2

    call, x = {"t": (0, 30), "steps": 300}, [[1.0, 0.7], [0.8, 0.9]]
    method, rim = lv.VolumeSplitting(), {"rim": lv.Event(circle, "up")}
    found = lv.section(field, method, plane=circle, direction="up", x=x, **call)
    assert {*found.member.tolist()} == {0, 1}
    np.testing.assert_allclose(np.hypot(*(found.x.T - np.pi / 2)), radius, rtol=1e-14)
    run = lv.integrate(field, method, x=x[0], events=rim, **call)
    np.testing.assert_array_equal(run.events["rim"].t, found.t[found.member == 0])


@pytest.mark.parametrize(("event", "more", "sentence"), [
    (level(0.0, reset=lambda t, x, params: -x), {}, "has a reset, and the volume"),
    (lambda t, x, params: params.A, {}, "'e' is the same for all states"),
    (lambda t, x: x[0], {}, "takes \\(t, x\\)"),
])  # fmt: skip
def test_wrong_events_are_refused(event, more, sentence):
    with pytest.raises((TypeError, ValueError), match=sentence):
        flow({"e": event}, (0, 1), **more)


def test_a_surface_has_no_period():
    with pytest.raises(ValueError, match="period= is that of planes"):
        lv.section(abc_flow.system, PLAN, t=(0, 1), steps=10, x=[X], period=1.0,
                   plane=lambda t, x, params: x[0])  # fmt: skip


@pytest.mark.parametrize(("more", "sentence"), [
    ({"plane": lambda t, x: x[0]}, "takes \\(t, x\\)"),
    ({"plane": lambda t, x, params: None}, "'plane' returns None"),
    ({"plane": lambda t, x, params: [x[0], x[1]]}, "'plane' must return a scalar, not 2"),
    ({"plane": lambda t, x, params: ca.log(x[0] - 9)}, "'plane' is not finite at t = 0"),
    ({"plane": level(0.0)}, "hint: an Event's function"),
    ({"plane": "x", "x": X}, "hint: give a row for each member"),
    ({"plane": "t", "period": 1e-13}, "keeping 1e\\+13 points"),
])  # fmt: skip
def test_wrong_surfaces_are_refused(more, sentence):
    with pytest.raises(Exception, match=sentence) as info:
        lv.section(abc_flow.system, PLAN, **{"t": (0, 1), "steps": 10, "x": [X]} | more)
    assert isinstance(info.value, (TypeError, ValueError, MemoryError, lv.IntegrationError))


def test_an_event_that_is_not_finite_ends_the_run_by_name():
    with pytest.raises(lv.IntegrationError, match="event 'root' is not finite") as info:
        flow({"root": lambda t, x, params: ca.sqrt(0.8 - t)})
    assert info.value.quantity == "root"
    assert 0.5 < info.value.t <= 0.8


@pytest.mark.parametrize("h", [0.4, 1.4, 2.1])
def test_planes_crossed_within_a_step_are_all_found(h):
    """Eight of them, each on its curve; more than a section takes are refused."""
    wind = lv.PolynomialField(lambda t, x, p: [1.0, 0.25 * ca.cos(x[0])], x=2)
    run = {"t": (0, 8.5), "h": h, "plane": [1.0, 0.0], "x": [[0.1, 0.0]]}
    found = lv.section(wind, lv.VolumeSplitting(), period=1.0, **run)
    np.testing.assert_allclose(found.t, np.arange(8) + 0.9, rtol=1e-13)
    np.testing.assert_allclose(found.x[:, 0], np.arange(1, 9), rtol=1e-13)
    with pytest.raises(lv.IntegrationError, match=r"more planes are crossed(?s:.*)a longer period"):
        lv.section(wind, lv.VolumeSplitting(), period=1e-6, **run)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("direction", ["both", "up", "down"])
def test_an_event_where_a_run_is_split_is_met_once(way, direction):
    """A zero at the very end belongs to the run, also of members, and one at the start does not."""
    wind = lv.PolynomialField(lambda t, x, params: [1.0, ca.cos(x[0])], x=2)
    count = int(direction != {1: "down", -1: "up"}[way])
    for terminal in (False, True):
        events = {"one": level(way, direction=direction, terminal=terminal)}
        call = {"h": 0.25, "events": events}
        method = lv.VolumeSplitting()
        first = lv.integrate(wind, method, t=(0, way), x=[0.0, 0.0], **call)
        assert first.events["one"].t.tolist() == [way] * count
        assert first.message == f"event 'one' at t = {way}" * (count * terminal)
        second = lv.integrate(wind, method, t=(way, 2 * way), x=first.x[-1], **call)
        assert len(second.events["one"]) == 0
        many = lv.ensemble(wind, method, t=(0, way), x=[[0.0, 0.0], [-9.0, 0.0]], **call)
        assert many.events["one"].member.tolist() == [0] * count
        surface = {"plane": lambda t, x, params: x[0], "offset": way, "direction": direction}
        found = lv.section(wind, method, t=(0, way), h=0.25, x=[[0.0, 0.0]], **surface)
        assert found.t.tolist() == [way] * count


@pytest.mark.parametrize("names", [("ends", "seen"), ("seen", "ends")])
def test_all_events_of_the_time_at_which_one_ends_the_run_are_kept(names):
    events = {
        "ends": level(0.7, terminal=True),
        "seen": lambda t, x, params: 3 * (x[0] / 3 - 0.7 / 3),
        "later": level(0.7 + 1e-9),
    }
    wind = lv.PolynomialField(lambda t, x, params: [1.0, ca.cos(x[0])], x=2)
    for t0 in (0.0, 1 / 3, 0.1):
        call = {"events": {name: events[name] for name in [*names, "later"]}, "h": 0.25}
        run = lv.integrate(wind, lv.VolumeSplitting(), t=(t0, 3), x=[0.0, 0.0], **call)
        assert [len(points) for points in run.events.values()] == [1, 1, 0]
        np.testing.assert_allclose(run.events["seen"].t, run.t[-1:], rtol=1e-15)
