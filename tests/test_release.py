"""Members of ensembles of fields that are released at times of their own."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray

import liouville as lv
from liouville.problems import euler_top, pendulum

V = lv.VolumeSplitting
STARTS = np.random.default_rng(0).uniform(0.1, 0.9, (6, 2)) * [2, 1]
RELEASE = np.array([0, 2.5, 2.5, 3.33, 10, 0])


@pytest.fixture(scope="module")
def gyre():
    """Return the double gyre, with an observed corner of land."""
    t, x, y = np.linspace(0, 20, 41), np.linspace(0, 2, 65), np.linspace(0, 1, 33)
    T, X, Y = np.meshgrid(t, x, y, indexing="ij")
    a = 0.25 * np.sin(np.pi * T / 5)
    psi = -0.1 * np.sin(np.pi * (a * X**2 + (1 - 2 * a) * X)) * np.sin(np.pi * Y)
    return lv.GriddedField(x, y, t=t, potential=psi, walls=("x", "y"))


@pytest.mark.parametrize("back", [False, True])
def test_members_begin_at_their_own_times_forward_and_backward(gyre, back):
    span = (20.0, 0.0) if back else (0.0, 20.0)
    release = 20 - RELEASE if back else RELEASE
    found = lv.ensemble(gyre, V(), t=span, h=0.1, every=5, x=STARTS, release=release)
    together = lv.ensemble(gyre, V(), t=span, h=0.1, every=5, x=STARTS)
    assert found.t == pytest.approx(together.t, abs=1e-13)
    assert (found.status, found.members, found.failures) == ("done", 6, {})
    for member, r in enumerate(release):
        own = lv.integrate(gyre, V(), t=(r, span[1]), h=0.1, x=STARTS[member])
        assert found.x[-1, member] == pytest.approx(own.x[-1], abs=1e-11)
        before = (found.t - r) * (-1 if back else 1) < -1e-12
        assert np.isnan(found.x[before, member]).all()
        assert np.isfinite(found.x[~before, member]).all()
        if r in found.t:
            assert (found.x[found.t == r, member] == STARTS[member]).all()
    at = lv.ensemble(gyre, V(), t=span, h=0.1, t_eval=found.t[[10, 30]], x=STARTS, release=release)
    later = np.isfinite(at.x)
    assert (later == np.isfinite(found.x[[10, 30]])).all()
    assert at.x[later] == pytest.approx(found.x[[10, 30]][later], abs=1e-6)


def test_a_released_trajectory_begins_with_its_first_record(gyre, tmp_path):
    found = lv.ensemble(gyre, V(), t=(0, 20), h=0.1, every=25, x=STARTS, release=RELEASE)
    rows = found.trajectories()
    assert rows.time[:, 0].values == pytest.approx([0, 2.5, 2.5, 5.0, 10.0, 0])
    assert rows.x[[0, 1, 2, 4, 5], 0].values == pytest.approx(STARTS[[0, 1, 2, 4, 5], 0])
    assert np.isnan(rows.time[4]).sum() == 4
    found.save(tmp_path / "run.npz")
    assert np.array_equal(lv.load(tmp_path / "run.npz").x, found.x, equal_nan=True)


def test_members_of_one_time_are_the_ensemble(gyre):
    plain = lv.ensemble(gyre, V(), t=(0, 5), h=0.1, x=STARTS)
    for release in (0.0, np.zeros(6)):
        found = lv.ensemble(gyre, V(), t=(0, 5), h=0.1, x=STARTS, release=release)
        assert (found.x == plain.x).all()
        assert found.t == pytest.approx(plain.t, abs=1e-14)


def test_failures_ends_events_and_invariants_are_those_of_the_member():
    """A member that leaves is put down by its own number."""
    x = np.linspace(0, 1, 17)
    X, Y = np.meshgrid(x, x, indexing="ij")
    stream = lv.GriddedField(
        x, x, potential=Y + 0 * X, invariants={"psi": lambda t, x, params: x[1]}
    )
    events = {"half": lambda t, x, params: x[0] - 0.5}
    starts = [[0.1, 0.3], [0.2, 0.5], [0.1, 0.7]]
    found = lv.ensemble(
        stream, V(), t=(0, 1.2), h=0.05, x=starts, release=[0.6, 0.0, 0.4], events=events
    )
    assert (found.status, list(found.failures)) == ("partly failed", [1])
    assert "member 1" in found.message
    assert found.failures[1].t == pytest.approx(0.8)
    assert found.events["half"].member.tolist() == [0, 1, 2]
    assert found.events["half"].t == pytest.approx([1.0, 0.3, 0.8])
    assert found.x[-1, 2] == pytest.approx([0.9, 0.7])
    assert found.initial["psi"] == pytest.approx([0.3, 0.5, 0.7])
    assert np.nanmax(found.invariant_drift("psi")) < 1e-14


def test_fields_by_formula_parameters_and_dates_have_releases():
    top = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.1]]
    found = lv.ensemble(euler_top.system, V(), t=(0, 1), h=0.1, x=top, release=[0.0, 0.35])
    own = lv.integrate(euler_top.system, V(), t=(0.35, 1), h=0.1, x=top[1])
    assert found.x[-1, 1] == pytest.approx(own.x[-1], abs=1e-4)
    turn = lv.PolynomialField(
        lambda t, x, params: [-params.a * x[1], params.a * x[0]], x=("x", "y"), params={"a": 1.0}
    )
    found = lv.ensemble(
        turn, V(), t=(0, 2), h=0.02, x=[1.0, 0.0], params={"a": [1.0, 2.0]}, release=[0.5, 1.0]
    )
    assert found.x[-1, 0] == pytest.approx([np.cos(1.5), np.sin(1.5)], abs=1e-6)
    assert found.x[-1, 1] == pytest.approx([np.cos(2), np.sin(2)], abs=1e-6)
    days = np.arange("2021-03-01", "2021-03-08", dtype="M8[D]").astype("M8[ns]")
    lon, lat = np.arange(0, 360, 10.0), np.linspace(-60, 60, 25)
    u = 0.5 * np.cos(1.5 * np.radians(lat)) ** 2 * np.ones((7, lon.size, 1))
    sea = xarray.Dataset(
        {name: (("time", "lon", "lat"), k * u, {"units": "m s-1"})
         for name, k in (("uo", 1), ("vo", 0))},
        {"time": days, "lon": lon, "lat": lat},
    )  # fmt: skip
    field = lv.GriddedField.from_xarray(sea, walls=("lat",))
    start = field.states_of([[10.0, 20.0]] * 3)
    hours = np.timedelta64(6, "h")
    run = lv.ensemble(
        field, V(), t=(days[0], days[4]), h=hours, x=start, release=days[[0, 1, 2]]
    ).trajectories()
    assert (run.time[:, 0] == days[[0, 1, 2]]).all()
    went = run.lon.values[[0, 1, 2], [8, 8, 8]] - 10
    assert went == pytest.approx(np.full(3, went[0]), rel=1e-9)


@pytest.mark.parametrize(
    ("release", "error", "sentence"),
    [
        ([0, 1, 2, 3, 4, 25], ValueError, "member 5 is released at t = 25, .* to before 20"),
        ([0, 1, 2, 3, 4, 20], ValueError, "member 5 is released at t = 20"),
        ([0, 1, 2, 3, 4, np.nan], ValueError, "member 5 is released at t = nan"),
        ([0, 1], ValueError, r"release must have shape \(6,\), not \(2,\)"),
        ("noon", TypeError, "release must be a time for each member, not 'noon'"),
        (np.array(["2020-01-01"] * 6, dtype="M8[D]"), TypeError, "times of .* must be numbers"),
    ],
)
def test_times_that_are_no_releases_are_refused(gyre, release, error, sentence):
    with pytest.raises(error, match=sentence):
        lv.ensemble(gyre, V(), t=(0, 20), h=0.1, x=STARTS, release=release)


@pytest.mark.parametrize("back", [False, True])
def test_tangents_begin_at_the_release_of_their_member(gyre, back):
    span = (20.0, 0.0) if back else (0.0, 20.0)
    release = 20 - RELEASE if back else RELEASE
    directions = {"x": [[1.0, 0.0], [0.3, -2.0]], "t0": 1.0}
    given = {"h": 0.1, "every": 5, "tangents": directions}
    found = lv.ensemble(gyre, V(), t=span, x=STARTS, release=release, **given)
    for member, r in enumerate(release):
        own = lv.integrate(gyre, V(), t=(r, span[1]), h=0.1, x=STARTS[member], tangents=directions)
        for name, shape in (("x", (2, 2)), ("t0", (2,))):
            x = found.tangents[name].x
            assert x.shape == (len(found.t), 6, *shape)
            assert x[-1, member] == pytest.approx(own.tangents[name].x[-1], rel=1e-9, abs=1e-9)
            before = (found.t - r) * (-1 if back else 1) < -1e-12
            assert np.isnan(x[before, member]).all()
            assert np.isfinite(x[~before, member]).all()


def test_tangents_of_events_have_the_numbers_of_their_members(gyre):
    event = lv.Event(lambda t, x, params: x[0] - 1.0)
    given = {"t": (0, 20), "h": 0.1, "events": {"middle": event}, "tangents": {"x": [1.0, 0.0]}}
    found = lv.ensemble(gyre, V(), x=STARTS, release=RELEASE, **given)
    moved, hits = found.tangents["x"].events["middle"], found.events["middle"]
    assert len(hits.t)
    assert np.array_equal(moved.member, hits.member)
    member = int(hits.member[0])
    own = lv.integrate(gyre, V(), **{**given, "t": (RELEASE[member], 20)}, x=STARTS[member])
    assert moved.t[0] == pytest.approx(own.tangents["x"].events["middle"].t[0], rel=1e-8)


def test_workers_of_an_executor_take_releases_to_the_same_bits(gyre):
    given = {"t": (0, 20), "h": 0.1, "every": 5, "x": STARTS, "release": RELEASE}
    plain = lv.ensemble(gyre, V(), **given)
    with ThreadPoolExecutor(2) as pool:
        found = lv.ensemble(gyre, V(), executor=pool, chunk=4, **given)
    assert np.array_equal(found.x, plain.x, equal_nan=True)
    assert np.array_equal(found.t, plain.t)
    assert (found.status, found.members, found.failures) == ("done", 6, {})
    starts = np.random.default_rng(1).normal(size=(5, 3))
    top = {"t": (0, 2), "h": 0.1, "x": starts, "release": [0, 0.35, 1, 1, 0.5]}
    plain = lv.ensemble(euler_top.system, V(), **top)
    with ThreadPoolExecutor(2) as pool:
        found = lv.ensemble(euler_top.system, V(), executor=pool, chunk=2, **top)
    assert plain.invariants
    for name in plain.invariants:
        assert np.array_equal(found.initial[name], plain.initial[name])
        assert found.drift_words(name) == plain.drift_words(name)


def test_releases_are_for_fields_alone(gyre):
    many = {"q": [pendulum.start["q"]] * 2, "v": [pendulum.start["v"]] * 2}
    with pytest.raises(TypeError, match="must begin together, and release= is for fields"):
        lv.ensemble(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, release=[0, 0.5], **many)
    given = {"t": (0, 5), "h": 0.1, "x": STARTS, "release": [0.0]}
    with (
        ThreadPoolExecutor(1) as pool,
        pytest.raises(ValueError, match=r"release must have shape \(6,\), not \(1,\)"),
    ):
        lv.ensemble(gyre, V(), executor=pool, **given)
