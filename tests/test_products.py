"""Data sets as CMEMS, HYCOM and ERA5 write them: packed, in single precision, with their names."""

import numpy as np
import pytest
import xarray

import liouville as lv

V = lv.VolumeSplitting
START = np.datetime64("2021-01-01", "ns")


def currents(lon, lat):
    """Return u and v on (lat, lon), in m/s, and NaN on an island where it is asked for."""
    a, b = np.meshgrid(np.radians(lon), np.radians(lat))
    psi = 0.6 * np.cos(b) ** 2
    return 0.3 * (np.cos(b) - psi * np.sin(b) * np.sin(3 * a)), -0.3 * psi * np.cos(3 * a)


def exact(lon, lat):
    return np.stack([part[0, 0] for part in currents([lon], [lat])])


def packed(values, fill):
    """Return whole numbers of thousandths, as files have them, and the attributes that say so."""
    said = {"scale_factor": np.float32(1e-3), "add_offset": np.float32(0), "_FillValue": fill}
    return np.where(np.isnan(values), fill, np.round(values * 1e3)).astype("i2"), said


def of_cmems():
    """Return daily means with levels in single precision, and land."""
    lon, lat = np.linspace(-20, 20, 121, dtype="f4"), np.linspace(-10, 10, 61, dtype="f4")
    depth, days = np.array([0.494, 1.54, 2.65, 3.82, 5.08, 6.44], "f4"), 3
    land = (abs(lon + 12) < 2) & (abs(lat[:, None] + 5) < 2)
    dims = ("time", "depth", "latitude", "longitude")
    data = {}
    for name, way, part in zip(("uo", "vo"), ("east", "north"), currents(lon, lat), strict=True):
        values = np.tile(np.where(land, np.nan, part), (days, depth.size, 1, 1))
        said = {"standard_name": f"{way}ward_sea_water_velocity", "units": "m s-1"}
        data[name] = dims, values.astype("f4"), said
    return xarray.Dataset(data, {
        "time": ("time", START + np.arange(days) * np.timedelta64(1, "D"), {"axis": "T"}),
        "depth": ("depth", depth, {"units": "m", "positive": "down", "axis": "Z"}),
        "latitude": ("latitude", lat, {"units": "degrees_north", "axis": "Y"}),
        "longitude": ("longitude", lon, {"units": "degrees_east", "axis": "X"}),
    })  # fmt: skip


def of_hycom():
    """Return a global level that is not decoded: whole numbers, and hours since a date."""
    lon, lat = np.arange(0, 360, 2.0), np.linspace(-80, 80, 81)
    data = {}
    for name, way, part in zip("uv", ("east", "north"), currents(lon, lat), strict=True):
        values, said = packed(np.tile(part, (3, 1, 1, 1)), np.int16(-30000))
        said |= {"standard_name": f"{way}ward_sea_water_velocity", "units": "m/s"}
        data[f"water_{name}"] = ("time", "depth", "lat", "lon"), values, said
    hours = {"units": "hours since 2000-01-01 00:00:00", "calendar": "gregorian", "axis": "T"}
    return xarray.Dataset(data, {
        "time": ("time", np.array([184104.0, 184107.0, 184110.0]), hours),
        "depth": ("depth", [0.0], {"units": "m", "positive": "down", "axis": "Z"}),
        "lat": ("lat", lat, {"units": "degrees_north", "axis": "Y"}),
        "lon": ("lon", lon, {"units": "degrees_east", "modulo": "360 degrees", "axis": "X"}),
    })  # fmt: skip


def of_era5():
    """Return hourly winds from pole to pole, latitudes falling, all in single precision."""
    lon, lat = np.arange(0, 360, 2.0, dtype="f4"), np.linspace(90, -90, 91, dtype="f4")
    data = {}
    for name, part in zip(("u10", "v10"), currents(lon, lat), strict=True):
        said = {"units": "m s**-1", "standard_name": "unknown", "GRIB_paramId": 165}
        values = np.tile(part, (4, 1, 1)).astype("f4")
        data[name] = ("valid_time", "latitude", "longitude"), values, said
    return xarray.Dataset(data, {
        "valid_time": START + np.arange(4) * np.timedelta64(1, "h"),
        "number": 0, "expver": ("valid_time", np.array(["0001"] * 4)),
        "latitude": ("latitude", lat, {"units": "degrees_north", "stored_direction": "decreasing"}),
        "longitude": ("longitude", lon, {"units": "degrees_east"}),
    })  # fmt: skip


PRODUCTS = {
    "cmems": lambda: of_cmems().isel(depth=0),
    "hycom": of_hycom,
    "hycom decoded": lambda: xarray.decode_cf(of_hycom()),
    "era5": of_era5,
}


@pytest.mark.filterwarnings("ignore:latitudes were cut at")
@pytest.mark.filterwarnings("ignore:the field was not divergence-free")
@pytest.mark.parametrize("name", PRODUCTS)
def test_a_product_is_read_and_comes_back_with_dates_and_degrees(name):
    field = lv.GriddedField.from_xarray(PRODUCTS[name](), most_divergence=0.2)
    assert field.dates.first == START
    assert field.islands == (name == "cmems")
    x = field.states_of([[5.0, -3.0], [16.0, 6.0]])
    assert field.velocity_at([5.0, -3.0]) == pytest.approx(exact(5.0, -3.0), abs=2e-3)
    three = START + np.timedelta64(3, "h")
    run = lv.ensemble(field, V(), t=(START, three), h=np.timedelta64(30, "m"), x=x).trajectories()
    assert run.time[0, -1] == three
    east, north = exact(5.0, -3.0) * 10800 / 6.371e6
    went = np.array([run.lon[0, -1] - 5.0, run.lat[0, -1] + 3.0])
    assert went == pytest.approx(np.degrees([east / np.cos(np.radians(3)), north]), rel=5e-3)


def test_levels_and_land_of_a_product_have_sentences_that_help():
    data = of_cmems()
    with pytest.raises(ValueError, match=r"there is no component w\nhint: .*isel\(depth=0\); or"):
        lv.GriddedField.from_xarray(data)
    with pytest.raises(
        ValueError, match="most_divergence=, as is usual of velocities that are not"
    ):
        lv.GriddedField.from_xarray(data, walls=("depth",))
    with pytest.warns(UserWarning, match="taken off"):
        field = lv.GriddedField.from_xarray(data, walls=("depth",), most_divergence=0.2)
    assert field.islands == 1
    on_land = field.velocity(field.states_of([[-12.0, -5.0, 2.0]]))
    assert np.abs(on_land).max() < 1e-20  # radians a second


def test_grids_to_the_poles_are_cut_in_single_precision_too():
    with pytest.warns(UserWarning, match="latitudes were cut at -88 and 88"):
        field = lv.GriddedField.from_xarray(of_era5())
    assert field.points_of(field.states_of([359.0, 87.0])) == pytest.approx([359.0, 87.0])
    with pytest.raises(ValueError, match="without the poles"):
        lv.GriddedField(
            np.arange(0, 360, 10.0), np.linspace(-90, 90, 19, dtype="f4"),
            velocity=np.ones((2, 36, 19)), coordinates="spherical", periodic=("lon",),
        )  # fmt: skip


@pytest.mark.parametrize("calendar", ["noleap", "360_day", "julian"])
def test_days_of_other_calendars_are_counted(calendar):
    said = {"units": "days since 2000-02-28", "calendar": calendar}
    data = of_cmems().isel(depth=0, latitude=slice(40, None)).assign_coords(
        time=("time", [0.0, 1.0, 2.0], said)
    )  # fmt: skip
    field = lv.GriddedField.from_xarray(data)
    assert field.times == (0, 2 * 86400)
    assert field.dates is None
