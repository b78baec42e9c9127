"""Trajectories by CF: dimensions, units, dates, levels, and what is missing."""

import numpy as np
import pytest
import xarray
from test_data_sets import globe
from test_ocean_depth import STARTS, data, read

import liouville as lv

V = lv.VolumeSplitting

pytestmark = pytest.mark.filterwarnings("ignore:the field was not divergence-free")


def drift():
    """Return a field on the sphere with dates, and a run of two members that observes mu^2."""
    lon, lat = np.arange(0, 360, 10.0), np.linspace(-60, 60, 25)
    month = np.arange("2021-03-01", "2021-03-08", dtype="datetime64[D]").astype("datetime64[ns]")
    jet = 0.3 * np.cos(1.5 * np.radians(lat)) ** 2 * np.ones((7, 36, 1))
    said, dims = {"units": "m s-1"}, ("time", "lon", "lat")
    sea = xarray.Dataset(
        {"uo": (dims, jet, said), "vo": (dims, 0 * jet, said)},
        {"lon": lon, "lat": lat, "time": month},
    )
    field = lv.GriddedField.from_xarray(sea, walls=("lat",))
    span = np.datetime64("2021-03-02"), np.datetime64("2021-03-04T12:00")
    run = lv.ensemble(
        field, V(), t=span, h=np.timedelta64(6, "h"), x=field.states_of([[10.0, 20], [200, -30]]),
        observe={"square": lambda t, x, params: x[1] ** 2, "lat": lambda t, x, params: x[1]},
    )  # fmt: skip
    return field, run


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_trajectories_come_back_with_dates_and_degrees(tmp_path, suffix):
    field, run = drift()
    made = run.trajectories()
    path = tmp_path / f"drift{suffix}"
    made.to_netcdf(path) if suffix == ".nc" else made.to_zarr(path, consolidated=False)
    more = {} if suffix == ".nc" else {"consolidated": False, "engine": "zarr"}
    with xarray.open_dataset(path, **more) as found:
        assert dict(found.sizes) == {"trajectory": 2, "obs": 11}
        assert found.attrs["featureType"] == "trajectory"
        assert found.trajectory.attrs["cf_role"] == "trajectory_id"
        assert (found.time[1] == found.time[0]).all()
        assert found.time.values[0, 0] == np.datetime64("2021-03-02")
        assert found.time.values[0, -1] == np.datetime64("2021-03-04T12:00")
        exact = field.points_of(run.x)
        assert (found.lon.values == exact[..., 0].T).all()
        assert (found.lat.values == exact[..., 1].T).all()
        assert found.lon.attrs == {"units": "degrees_east", "standard_name": "longitude"}
        assert found.lat.attrs == {"units": "degrees_north", "standard_name": "latitude"}
        assert (found.square.values == run.observed["square"].T).all()
        assert (found.observed_lat.values == run.x[..., 1].T).all()
        assert {"time", "lon", "lat"} <= {*found.square.coords}


def test_one_run_is_one_trajectory_and_joins_others_that_were_released_later():
    field, run = drift()
    later = lv.integrate(
        field, V(), t=(np.datetime64("2021-03-03"), np.datetime64("2021-03-04T12:00")),
        h=np.timedelta64(6, "h"), x=field.states_of([50.0, 10.0]),
    )  # fmt: skip
    alone = later.trajectories()
    assert dict(alone.sizes) == {"trajectory": 1, "obs": 7}
    whole = xarray.concat([run.trajectories(), alone], "trajectory", join="outer")
    assert whole.time.values[2, 0] == np.datetime64("2021-03-03")
    assert np.isnat(whole.time.values[2, 7:]).all()
    assert np.isnan(whole.lon.values[2, 7:]).all()


def test_levels_have_their_unit_and_say_which_way_they_count():
    for given, unit, way in (
        (data(), "m", "down"),
        (data(unit="km", per_metre=1e-3), "km", "down"),
        (data(said="up"), "m", "up"),
    ):
        field = read(given)
        points = np.array(STARTS) * [1, 1, float(given.depth[-1] / data().depth[-1])]
        run = lv.ensemble(field, V(), t=(0, 86400), h=43200, x=field.states_of(points))
        for found in (run.trajectories(), run.to_xarray()):
            assert found.depth.attrs["units"] == unit
            assert found.depth.attrs["positive"] == way
        assert run.trajectories().depth.values[:, 0] == pytest.approx(points[:, 2], rel=1e-12)
        assert run.to_xarray().depth.values[0] == pytest.approx(points[:, 2], rel=1e-12)


def test_what_a_failed_member_did_not_record_is_missing():
    x = np.linspace(0, 1, 9)
    flow = lv.GriddedField(x, x, velocity=(np.ones((9, 9)), np.zeros((9, 9))), walls=("y",))
    run = lv.ensemble(flow, V(), t=(0, 0.4), h=0.1, x=[[0.1, 0.5], [0.75, 0.5]])
    found = run.trajectories()
    assert list(run.failures) == [1]
    missing = np.isnan(run.x[:, 1, 0])
    assert missing.any()
    assert (np.isnan(found.time.values[1]) == missing).all()
    assert (np.isnan(found.x.values[1]) == missing).all()
    assert not np.isnan(found.time.values[0]).any()


def test_coordinates_are_those_of_points_or_else_of_states(tmp_path):
    particles = lv.ChargedParticles(B=(0, 0, 1))
    run = lv.ensemble(
        particles, V(), t=(0, 1), h=0.1, x=[0, 0, 0, 1, 0, 0], params={"mass": [1.0, 2.0]}
    )
    found = run.trajectories()
    assert [*found.coords] == ["trajectory", "obs", "time", *particles.coordinates]
    assert found.mass.values.tolist() == [1.0, 2.0]
    assert (found.vy.values == run.x[..., 4].T).all()
    ball = globe(np.arange(0, 360, 10.0), np.linspace(-60, 60, 31), periodic=("lon",))
    plain = lv.integrate(ball, V(), t=(0, 3600), h=3600, x=ball.states_of([10.0, 20.0]))
    assert plain.trajectories().lat.values[0, 0] == pytest.approx(20)
    plain.save(tmp_path / "run.nc")
    with pytest.raises(TypeError, match=r"must be those of a field\nhint: .* system=field"):
        lv.load(tmp_path / "run.nc").trajectories()
    again = lv.load(tmp_path / "run.nc", system=ball).trajectories()
    assert again.equals(plain.trajectories())
    pendulum = lv.problems.pendulum
    swing = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), h=0.1, **pendulum.start)
    with pytest.raises(TypeError, match="trajectories must be those of a field, not of"):
        swing.trajectories()
    bare = lv.integrate(
        ball, V(), t=(0, 3600), h=3600, states=False, x=ball.states_of([10.0, 20.0]),
        observe={"mu": lambda t, x, params: x[1]},
    )  # fmt: skip
    with pytest.raises(ValueError, match="the run stored no states"):
        bare.trajectories()
