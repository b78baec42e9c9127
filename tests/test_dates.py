"""Dates of data sets: runs take them, and what is written has them."""

import datetime
import pickle

import numpy as np
import pytest
import xarray

import liouville as lv
from liouville.problems import euler_top

V = lv.VolumeSplitting
DAYS = np.arange("2021-03-01", "2021-03-08", dtype="datetime64[D]").astype("datetime64[ns]")
LON, LAT = np.arange(0, 360, 6.0), np.linspace(-60, 60, 31)


def sea(time=None, **said):
    """Return a zonal jet on the earth that grows from day to day."""
    jet = 0.5 * np.cos(1.5 * np.radians(LAT)) ** 2
    u = np.tile(jet[None, :, None], (7, 1, LON.size)) * (1 + 0.1 * np.arange(7))[:, None, None]
    dims, units = ("time", "lat", "lon"), {"units": "m s-1"}
    axes = {
        "time": DAYS if time is None else ("time", time, said),
        "lat": ("lat", LAT, {"units": "degrees_north"}),
        "lon": ("lon", LON, {"units": "degrees_east"}),
    }
    return xarray.Dataset({"uo": (dims, u, units), "vo": (dims, 0 * u, units)}, axes)


@pytest.fixture(scope="module")
def field():
    return lv.GriddedField.from_xarray(sea(), walls=("lat",))


START, END = np.datetime64("2021-03-02"), np.datetime64("2021-03-05T12:00")


def test_a_run_between_dates_is_that_between_their_times(field):
    assert field.dates.first == DAYS[0]
    x = field.states_of([10.0, 20.0])
    dated = lv.integrate(field, V(), t=(START, END), h=np.timedelta64(3, "h"), x=x)
    plain = lv.integrate(field, V(), t=(86400.0, 4.5 * 86400), h=10800.0, x=x)
    assert (dated.x == plain.x).all()
    assert (dated.t == plain.t).all()
    ends = datetime.datetime(2021, 3, 5, 12), datetime.datetime(2021, 3, 2, tzinfo=datetime.UTC)
    back = lv.integrate(field, V(), t=ends, h=datetime.timedelta(hours=3), x=dated.x[-1])
    assert np.abs(back.x[-1] - x).max() < 1e-14
    at = lv.ensemble(field, V(), t=(START, END), h=10800, t_eval=DAYS[[2, 3]], x=[x])
    assert (at.t == [2 * 86400, 3 * 86400]).all()
    assert (field.velocity(x, DAYS[2]) == field.velocity(x, 2 * 86400.0)).all()
    plan = lv.plan(field, t=(START, END), h=np.timedelta64(3, "h"), x=x)
    assert plan.h == 10800
    cuts = lv.section(field, V(), t=(START, END), h=10800, plane="lon", offset=0.19, x=[x])
    assert len(cuts) == 1
    again = pickle.loads(pickle.dumps(field))
    assert again.dates == field.dates


def test_samples_with_dates_make_a_field_with_dates(field):
    u, v = (sea()[name].values.transpose(0, 2, 1) for name in ("uo", "vo"))
    own = lv.GriddedField(
        LON, LAT, t=DAYS, velocity=(u, v), coordinates="spherical", radius=6.371e6,
        periodic=("lon",), walls=("lat",),
    )  # fmt: skip
    assert own.dates == field.dates
    x = field.states_of([10.0, 20.0])
    assert own.velocity(x, START) == pytest.approx(field.velocity(x, START), rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "seconds"),
    [
        ("days since 2021-03-01", 86400),
        ("hours since 2021-02-28 00:00:00", 3600),
        ("seconds since 2021-03-01T00:00:00Z", 1),
    ],
)
def test_times_since_a_date_are_dates(field, unit, seconds):
    offset = 24 if "hours" in unit else 0
    times = np.arange(7) * 86400 / seconds + offset
    found = lv.GriddedField.from_xarray(sea(times, units=unit), walls=("lat",))
    assert found.dates == field.dates
    assert found.times == field.times


def test_what_is_written_has_dates_and_is_read_again(field, tmp_path):
    x = field.states_of([[10.0, 20.0], [30.0, -5.0]])
    run = lv.ensemble(field, V(), t=(START, END), h=10800, every=4, x=x)
    assert (run.to_xarray().time.values[[0, -1]] == np.array([START, END], "M8[ns]")).all()
    assert (run.member(0).to_xarray().time.values[0]) == START
    for suffix, opened in ((".nc", xarray.open_dataset), (".zarr", xarray.open_zarr)):
        path = tmp_path / f"run{suffix}"
        run.save(path)
        with opened(path) as dataset:
            assert (dataset.time.values[[0, -1]] == np.array([START, END], "M8[ns]")).all()
            assert dataset.time.encoding["calendar"] == "proleptic_gregorian"
            assert dataset.lon.attrs["units"] == "degrees_east"
        again = lv.load(path)
        assert (again.t == run.t).all()
        assert (again.x == run.x).all()


def test_dates_are_refused_where_there_are_none_and_beyond_the_samples(field):
    x = field.states_of([10.0, 20.0])
    late = np.datetime64("2021-04-05T12:00")
    with pytest.raises(ValueError, match=r"t = 2021-04-05T12:00:00 is outside.* 2021-03-07T00:00"):
        lv.integrate(field, V(), t=(START, late), h=10800, x=x)
    with pytest.raises(TypeError, match=r"times of PolynomialField.* must be numbers, not"):
        lv.integrate(euler_top.system, V(), t=(START, END), h=0.1, x=[1, 2, 3])


def test_a_calendar_without_leap_years_is_kept():
    cftime = pytest.importorskip("cftime")
    days = np.array([cftime.DatetimeNoLeap(2020, 2, 26 + k) for k in range(3)]
                    + [cftime.DatetimeNoLeap(2020, 3, 1 + k) for k in range(4)])  # fmt: skip
    found = lv.GriddedField.from_xarray(sea(days), walls=("lat",))
    assert found.dates.calendar == "noleap"
    x = found.states_of([10.0, 20.0])
    run = lv.integrate(found, V(), t=(days[1], days[4]), h=21600, x=x)
    assert run.t[-1] == 4 * 86400
    assert run.to_xarray().time.values[-1] == days[4]
