"""Gridded fields that depend on time, with islands, from data sets, and around a torus."""

import tracemalloc
from datetime import timedelta

import numpy as np
import pytest
import xarray
from scipy.io import netcdf_file

import liouville as lv
from liouville._systems.fields.gridded import conventions, names, potential, reading

V = lv.VolumeSplitting


def psi_of(t, x, y, eps=0.25, omega=np.pi / 5):
    a = eps * np.sin(omega * t)
    return -0.1 * np.sin(np.pi * (a * x**2 + (1 - 2 * a) * x)) * np.sin(np.pi * y)


def velocity_of(t, x, y, eps=0.25, omega=np.pi / 5):
    a = eps * np.sin(omega * t)
    f, slope = a * x**2 + (1 - 2 * a) * x, 2 * a * x + 1 - 2 * a
    u = -0.1 * np.pi * np.sin(np.pi * f) * np.cos(np.pi * y)
    return u, 0.1 * np.pi * np.cos(np.pi * f) * slope * np.sin(np.pi * y)


def sea(samples=81, n=32, t1=20.0):
    """Return times, axes and velocities of the double gyre."""
    t, x, y = np.linspace(0, t1, samples), np.linspace(0, 2, 2 * n + 1), np.linspace(0, 1, n + 1)
    u, v = velocity_of(*np.meshgrid(t, x, y, indexing="ij"))
    return t, x, y, u, v


def driven(degree=3, **more):
    t, x, y, u, v = sea(**more)
    return lv.GriddedField(x, y, t=t, velocity=(u, v), walls=("x", "y"), degree=degree)


def test_a_field_in_time_is_the_double_gyre():
    field, rng = driven(), np.random.default_rng(0)
    assert field.is_driven
    assert field.times == (0, 20)
    points = rng.uniform(0, 1, (100, 2)) * [2, 1]
    for t in (0.0, 3.3, 20.0):
        exact = np.stack(velocity_of(t, *points.T), axis=-1)
        assert abs(field.velocity(points, t) - exact).max() < 2e-4
    x = [[0.3, 0.4], [1.2, 0.7], [0.0, 0.2], [1.0, 1.0]]
    found = lv.ensemble(field, V(), t=(0, 20), h=0.1, x=x)
    assert (found.x[:, 2, 0] == 0).all()
    assert (found.x[:, 3, 1] == 1).all()
    found = lv.analysis.determinant(field, V(), t=(0, 20), h=0.1, x=x[0])
    assert found.observed["defect"][-1] < 1e-12


def test_time_keeps_the_order_of_steps_that_end_at_samples():
    field, x = driven(5, samples=41), [[0.3, 0.4], [1.2, 0.7]]
    for scheme, order in (("BM4", 4), ("BM6", 5.5)):
        ends = [
            lv.ensemble(field, V(composition=scheme), t=(0, 10), steps=n, every=n, x=x).x[-1]
            for n in (20, 40, 320)
        ]
        errors = [abs(end - ends[-1]).max() for end in ends[:-1]]
        assert np.log2(errors[0] / errors[1]) > order - 0.6


def test_a_field_in_time_keeps_volume_over_a_hundred_thousand_steps():
    field, steps = driven(), 10**5
    found = lv.analysis.determinant(
        field, V(), t=(0, 20), steps=steps, every=steps, x=[0.3, 0.4]
    ).observed
    assert found["defect"][-1] < 1e-12
    assert abs(found["log_determinant"][-1]) < 1e-11


def test_runs_beyond_the_samples_are_refused():
    with pytest.raises(ValueError, match="t = 21 is outside the samples, which are from 0 to 20"):
        lv.integrate(driven(), V(), t=(0, 21), h=0.1, x=[0.3, 0.4])
    with pytest.raises(lv.IntegrationError, match="a stage of the composition is at a time outsid"):
        lv.integrate(driven(), V(composition="Y4"), t=(0, 2), h=0.1, x=[0.3, 0.4])


@pytest.fixture(scope="module")
def archipelago():
    """Return a gyre with two islands, one of them at a wall, and its land."""
    _, x, y, u, v = sea(2, 24)
    a, b = np.meshgrid(x, y, indexing="ij")
    land = (np.hypot(a - 0.6, b - 0.5) < 0.16) | (np.hypot(a - 2, b - 0.4) < 0.2)
    # a flow around the islands: the stream function is damped where they are
    near = np.exp(-((np.hypot(a - 0.6, b - 0.5) / 0.3) ** 8))
    psi = psi_of(0, a, b) * (1 - near) + near * psi_of(0, 0.6, 0.5)
    del u, v
    field = lv.GriddedField(x, y, potential=psi, walls=("x", "y"), degree=3)
    nodes = field.velocity(np.stack([a, b], axis=-1))
    u, v = (np.where(land, np.nan, nodes[..., k]) for k in (0, 1))
    return lv.GriddedField(x, y, velocity=(u, v), walls=("x", "y"), most_divergence=1), land, (a, b)


@pytest.mark.filterwarnings("ignore:the field was not divergence-free")
@pytest.mark.parametrize(("degree", "cells"), [(3, 1), (3, 2), (3, 3), (5, 4), (5, 5)])
def test_nothing_flows_on_islands_with_a_strait_between_them(degree, cells):
    """One of fewer than p cells is closed: a function meets both its shores."""
    x = np.linspace(0, 1, 41)
    X, Y = np.meshgrid(np.pi * x, np.pi * x, indexing="ij")
    land = np.zeros((41, 41), bool)
    land[10:15, 10:20] = land[14 + cells : 20 + cells, 10:20] = True
    velocity = np.sin(X) * np.cos(Y), -np.cos(X) * np.sin(Y)
    field = lv.GriddedField(
        x, x, velocity=velocity, mask=land, walls=("x", "y"), degree=degree, most_divergence=1
    )
    assert field.islands == 1 + (cells >= degree)
    for first, last in ((10, 14), (14 + cells, 19 + cells)):
        inner = np.meshgrid(
            *(np.linspace(x[a], x[b], 19)[1:-1] for a, b in ((first, last), (10, 19)))
        )
        assert np.abs(field.velocity(np.stack(inner, axis=-1))).max() < 1e-13


@pytest.mark.filterwarnings("ignore:the field was not divergence-free")
def test_islands_may_be_on_the_seam_of_an_axis_with_a_mean_flow_by():
    """A row of islands in a flow along y, moved along x: the same field, moved."""
    n, y = 40, np.linspace(0, 2, 81)
    x = np.arange(n) / n
    given = {"periodic": ("x",), "most_divergence": 1}
    still, flow = np.zeros((n, 81)), np.ones((n, 81))
    land = np.zeros((n, 81), bool)
    land[:5, 30:36] = True
    own = [np.linspace(0, 0.1, 17)[1:-1], np.linspace(y[30], y[35], 17)[1:-1]]
    shifts = (0, 34, 36, 38)
    fields = [
        lv.GriddedField(x, y, velocity=(still, flow), mask=np.roll(land, moved, 0), **given)
        for moved in shifts
    ]
    places = np.stack(np.meshgrid(x, y[1:-1]), axis=-1)
    for field, moved in zip(fields, shifts, strict=True):
        at = np.stack(np.meshgrid(own[0] + moved / n, own[1]), axis=-1)
        assert np.abs(field.velocity(at)).max() < 1e-13
        assert field.velocity(places + np.array([moved / n, 0])) == pytest.approx(
            fields[0].velocity(places)
        )
    land[:, 30:36] = True
    with pytest.raises(ValueError, match="land goes all round 'x', and a mean flow along 'y'"):
        lv.GriddedField(x, y, velocity=(still, flow), mask=land, **given)


@pytest.mark.filterwarnings("ignore:the field was not divergence-free")
def test_nothing_flows_on_islands_or_through_their_shores(archipelago):
    field, land, (a, b) = archipelago
    assert field.islands == 2
    inland = land[:-1, :-1] & land[1:, :-1] & land[:-1, 1:] & land[1:, 1:]
    centres = np.stack([a, b], -1)[:-1, :-1][inland] + 1 / 48
    assert abs(field.velocity(centres)).max() < 1e-13
    rng = np.random.default_rng(0)
    x = rng.uniform(0, 1, (40, 2)) * [2, 1]

    def is_inland(points):
        i = np.floor(points * 24).astype(int)
        return inland[i[..., 0].clip(0, 47), i[..., 1].clip(0, 23)]

    x = x[~is_inland(x)]
    h = 0.9 * 0.9 / (0.367 * field.steepest)
    found = lv.ensemble(field, V(), t=(0, 400 * h), h=h, every=10, x=x)
    assert not found.failures
    assert not is_inland(found.x).any()


def dataset(**more):
    t, x, y, u, v = sea(21)
    standard = "sea_water_{}_velocity"
    attributes = {"standard_name": standard.format("x"), "units": "m s-1"}
    other = attributes | {"standard_name": standard.format("y")}
    dims = ("time", "north", "east")
    return xarray.Dataset(
        {"speed_u": (dims, u.transpose(0, 2, 1), attributes),
         "speed_v": (dims, v.transpose(0, 2, 1), other)},
        {"time": ("time", t, {"units": "s"}), "east": ("east", x, {"axis": "X", "units": "m"}),
         "north": ("north", y, {"axis": "Y", "units": "m"} | more)},
    )  # fmt: skip


def test_a_data_set_is_read_by_its_attributes():
    t, x, y, u, v = sea(21)
    plain = lv.GriddedField(x, y, t=t, velocity=(u, v), walls=("x", "y"))
    read = lv.GriddedField.from_xarray(dataset(), walls=("east", "north"))
    assert read.coordinates == ("east", "north")
    assert (read.velocity([0.3, 0.4], 3.3) == plain.velocity([0.3, 0.4], 3.3)).all()
    level = dataset().expand_dims("depth")
    assert lv.GriddedField.from_xarray(level, walls=("east", "north")).times == (0, 20)


def write(path, **attributes):
    t, x, y, u, v = sea(21)
    with netcdf_file(path, "w") as file:
        for name, values in (("time", t), ("lat", y), ("lon", x)):
            file.createDimension(name, len(values))
            file.createVariable(name, "d", (name,))[:] = values
        file.variables["time"].units = "hours since 2026-01-01"
        file.variables["lon"].units, file.variables["lat"].units = "degrees_east", "degrees_north"
        for name, values in (("uo", u), ("vo", v)):
            values = np.where(
                np.hypot(x - 1, y[:, None] - 0.5) < 0.1, np.nan, values.swapaxes(1, 2)
            )
            one = file.createVariable(name, "d", ("time", "lat", "lon"))
            one._FillValue, one.units = 1e20, "m s-1"
            for key, value in attributes.items():
                setattr(one, key, value)
            one[:] = np.nan_to_num(values, nan=1e20)


@pytest.mark.filterwarnings("ignore:the field was not divergence-free")
def test_a_classic_file_is_read_with_its_units_and_its_land(tmp_path):
    write(tmp_path / "sea.nc")
    field = lv.GriddedField.from_netcdf(
        tmp_path / "sea.nc", walls=("lon", "lat"), most_divergence=1
    )
    assert field.coordinates == ("lon", "mu")
    assert field.islands == 1
    assert field.times == (0, 20 * 3600)
    start = field.states_of([0.3, 0.3])
    assert np.allclose(field.points_of(start), [0.3, 0.3])
    metres = field.velocity(start) * 6.371e6
    assert np.allclose(metres, np.ravel(velocity_of(0, 0.3, 0.3)), rtol=0.1, atol=0.02)


def test_axes_are_called_as_the_data_set_has_them(tmp_path):
    sea = dataset().rename(east="longitude", north="latitude")
    for name, unit in (("longitude", "degrees_east"), ("latitude", "degrees_north")):
        sea[name].attrs["units"] = unit
    fields = [
        lv.GriddedField.from_xarray(sea, walls=names, most_divergence=1)
        for names in (("longitude", "latitude"), ("lon", "lat"))
    ]
    start = fields[0].states_of([0.3, 0.3])
    assert np.array_equal(*(field.velocity(start, 3.3) for field in fields))
    (tmp_path / "sea.nc").write_text("time,u,v")
    with pytest.raises(ValueError, match=r"'.*sea.nc' is no NetCDF file: it begins with b'time'"):
        lv.GriddedField.from_netcdf(tmp_path / "sea.nc")


@pytest.mark.filterwarnings("ignore:the field was not divergence-free")
def test_times_are_taken_a_few_together_and_the_field_is_the_same(monkeypatch):
    t, x, y, u, v = sea(60, 16)
    u[:, 10:13, 4:7] = np.nan
    given = {"t": t, "velocity": (u, v), "walls": ("x", "y"), "most_divergence": 1}
    fields, peaks = [], []
    for size in (2**27, 2**12):
        monkeypatch.setattr(potential, "TOGETHER", size)
        tracemalloc.start()
        fields.append(lv.GriddedField(x, y, **given))
        peaks.append(tracemalloc.get_traced_memory()[1] / (2 * u.nbytes))
        tracemalloc.stop()
    assert peaks[1] < 2.5 < 5 < peaks[0]
    points = np.random.default_rng(0).uniform(0, 1, (50, 2)) * [2, 1]
    there, here = (field.velocity(points, 3.3) for field in fields)
    assert abs(there - here).max() < 1e-14
    assert fields[0].divergence == pytest.approx(fields[1].divergence, rel=1e-12)
    assert fields[0].steepest == pytest.approx(fields[1].steepest, rel=1e-12)


@pytest.mark.parametrize("samples", [2, 3])
def test_a_field_of_few_times_is_the_polynomial_through_them(samples):
    """A line through two times, a parabola through three."""
    x = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    t, where = np.array([0.0, 0.7, 2.0])[:samples], np.meshgrid(x, x, indexing="ij")
    growth = np.polynomial.Polynomial([1.0, 0.5, -0.2][:samples])
    u, v = np.sin(where[1]), np.cos(where[0])
    velocity = [np.multiply.outer(growth(t), part) for part in (u, v)]
    common = {"periodic": ("x", "y"), "degree": 5}
    moving = lv.GriddedField(x, x, t=t, velocity=velocity, **common)
    still = lv.GriddedField(x, x, velocity=(u, v), **common)
    point = [0.3, 0.4]
    for now in np.linspace(0, t[-1], 5):
        wanted = growth(now) * still.velocity(point)
        assert abs(moving.velocity(point, now) - wanted).max() < 1e-13
    # time is s, of which the growth is the derivative
    run = lv.integrate(moving, V(composition="BM6"), t=(0, t[-1]), steps=40, x=point)
    s = growth.integ()(t[-1])
    wanted = lv.integrate(still, V(composition="BM6"), t=(0, s), steps=40, x=point)
    assert abs(run.x[-1] - wanted.x[-1]).max() < 1e-8


def with_units(data, velocity, time):
    for name, unit in (("speed_u", velocity), ("speed_v", velocity), ("time", time)):
        data[name].attrs["units"] = unit
    return data


DATES = "days since 2000-01-01"


@pytest.mark.parametrize(
    ("unit", "metres", "seconds", "time", "day"),
    [
        ("m s-1", 1.0, 1.0, DATES, 1.0),
        ("cm/s", 1e-2, 1.0, DATES, 1.0),
        ("centimeter/s", 1e-2, 1.0, DATES, 1.0),
        ("mm s-1", 1e-3, 1.0, DATES, 1.0),
        ("meters per second", 1.0, 1.0, DATES, 1.0),
        ("Meter second-1", 1.0, 1.0, DATES, 1.0),
        ("", 1.0, 1.0, DATES, 1.0),
        ("km/day", 1e3, 86400.0, DATES, 1.0),
        ("m.s**-1", 1.0, 1.0, "Day", 1.0),
        ("m h^-1", 1.0, 3600.0, "hours since 2000-01-01", 1 / 24),
        ("m/s", 1.0, 1.0, "weeks since 2000-01-01", 7.0),
        ("m/s", 1.0, 1.0, "msec since 2000-01-01", 1e-3 / 86400),
    ],
)
def test_units_of_velocities_and_times_are_those_that_are_said(unit, metres, seconds, time, day):
    data = with_units(dataset(), unit, time).rename(east="lon", north="lat")
    for name in ("lon", "lat"):
        data[name].attrs["units"] = "degrees"
    field = lv.GriddedField.from_xarray(data, most_divergence=1)
    assert field.times == pytest.approx((0, 20 * day * 86400 / seconds))
    # the same numbers on a sphere of as many units of length
    t, x, y, u, v = sea(21)
    plain = lv.GriddedField(
        x, y, t=t, velocity=(u, v), coordinates="spherical", radius=6.371e6 / metres,
        names=("lon", "lat"), most_divergence=1,
    )  # fmt: skip
    start = field.states_of([0.3, 0.4])
    assert field.velocity(start, 0.0) == pytest.approx(plain.velocity(start, 0.0), rel=1e-12)


def test_values_that_are_packed_or_masked_or_never_written_are_what_they_mean(tmp_path):
    data = dataset()
    plain = lv.GriddedField.from_xarray(data, walls=("east", "north"))
    for name in ("speed_u", "speed_v"):
        packed = np.round(data[name] * 1e4).astype(np.int16)
        data[name] = packed.assign_attrs(data[name].attrs, scale_factor=1e-4, _FillValue=-32768)
    read = lv.GriddedField.from_xarray(data, walls=("east", "north"), most_divergence=1)
    at = [0.3, 0.4], 3.0
    assert read.velocity(*at) == pytest.approx(plain.velocity(*at), abs=2e-4)

    x, y, (u, v) = *sea(1)[1:3], (part[0] for part in sea(1)[3:])
    land = np.hypot(x[:, None] - 1, y - 0.5) < 0.1
    options = {"walls": ("x", "y"), "most_divergence": 1}
    masked = [np.ma.array(np.where(land, 7.0, part), mask=land) for part in (u, v)]
    missing = [np.where(land, np.nan, part) for part in (u, v)]
    with pytest.warns(UserWarning, match="was not divergence-free"):
        found = [lv.GriddedField(x, y, velocity=part, **options) for part in (masked, missing)]
    assert found[0].islands == found[1].islands == 1
    assert (found[0].velocity([0.3, 0.4]) == found[1].velocity([0.3, 0.4])).all()
    with pytest.raises(ValueError, match="velocity is infinite at"):
        lv.GriddedField(x, y, velocity=[np.where(land, np.inf, u), v], **options)
    with pytest.raises(ValueError, match=r"not int64 of shape .*\nhint: True is land"):
        lv.GriddedField(x, y, velocity=[u, v], mask=land.astype(np.int64), **options)
    write(tmp_path / "sea.nc")
    with netcdf_file(tmp_path / "sea.nc", "a", mmap=False) as file:
        for name in ("uo", "vo"):
            values = file.variables[name][:].copy()
            values[values == 1e20] = 9.969209968386869e36
            file.variables[name][:] = values
    with pytest.warns(UserWarning, match="was not divergence-free"):
        field = lv.GriddedField.from_netcdf(
            tmp_path / "sea.nc", walls=("lon", "lat"), most_divergence=1
        )
    assert field.islands == 1


class Date:
    """A date of a calendar of 360 days."""

    def __init__(self, days):
        self.days = days

    def __sub__(self, other):
        """Count the days between."""
        return timedelta(days=self.days - other.days)


def test_dates_of_other_calendars_are_times():
    data = dataset()
    dates = np.array([Date(days) for days in data.time.values], dtype=object)
    sea = {name: reading.Variable(name, data[name].dims, data[name].values, data[name].attrs)
           for name in data.variables}  # fmt: skip
    sea["time"] = reading.Variable("time", ("time",), dates)
    components = names.components(sea, {"u": None, "v": None})
    assert conventions.arguments(sea, components, {})["t"][-1] == 20 * 86400


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda d: d.drop_vars("speed_v"), "has no component v of a velocity; it has speed_u"),
        (lambda d: d.assign_coords(north=d.north.assign_attrs(units="km")), "'north' is in km and"),
        (lambda d: d.expand_dims(member=[1, 2]), "'member' of 'speed_u' is no axis that is known"),
        (
            lambda d: d.expand_dims(depth=[1.0, 2]),
            "levels along 'depth', and there is no component",
        ),
        (lambda d: d.assign(more=d.speed_u), "u may be one of speed_u, more"),
        (
            lambda d: d.assign_coords(north=d.north.assign_attrs(units="kilometers")),
            "kilometers and",
        ),
        (
            lambda d: d.assign_coords(north=d.north.assign_attrs(units="feet")),
            "in feet and 'speed_u'",
        ),
        (lambda d: d.assign(speed_v=d.speed_v.assign_attrs(units="cm/s")), "'speed_v' in 'cm/s'"),
        (lambda d: with_units(d, "m s-1", "months since 2000-01-01"), "no unit of time of a fixed"),
        (lambda d: with_units(d, "knots", "days since 2000-01-01"), "'knots', which is no unit of"),
        (lambda d: with_units(d, "km/yr", "days"), "'km/yr', which is no unit of velocity"),
    ],
)
def test_a_data_set_that_does_not_fit_is_refused(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        lv.GriddedField.from_xarray(change(dataset()), walls=("east", "north"))


def test_axes_of_single_precision_are_as_even_as_their_digits_say(tmp_path):
    """Longitudes of 1/12 degree go round; uneven nodes are refused still, and moved by nothing."""
    n = 4320
    lon, lat = -180 + np.arange(n) / 12, np.arange(-60.0, 60.1, 10)
    u = np.cos(np.radians(lat))[:, None] * np.ones(n)
    fields = []
    for kind in ("f8", "f4"):
        with netcdf_file(tmp_path / f"{kind}.nc", "w") as file:
            for name, values in (("longitude", lon), ("latitude", lat)):
                file.createDimension(name, values.size)
                file.createVariable(name, kind, (name,))[:] = values
            for name, values in (("uo", u), ("vo", 0 * u)):
                file.createVariable(name, "f4", ("latitude", "longitude"))[:] = values
        fields.append(lv.GriddedField.from_netcdf(tmp_path / f"{kind}.nc"))
    x = fields[0].states_of([[12.3, 4.5]])
    assert np.allclose(fields[0].velocity(x), fields[1].velocity(x), rtol=1e-6, atol=1e-13)
    around = {"coordinates": "spherical", "periodic": ("lon",)}
    for uneven in (lon + 1e-3 * np.sin(lon), lon.astype("f4") + 1e-3 * np.sin(lon)):
        with pytest.raises(ValueError, match="'lon' is periodic, and its nodes are not equidist"):
            lv.GriddedField(uneven.astype("f4"), lat, velocity=(u.T, 0 * u.T), **around)
    x = np.linspace(0, 2 * np.pi, 24, endpoint=False, dtype="f4")
    a, b = np.meshgrid(x, x, indexing="ij")
    cells = lv.GriddedField(x, x, potential=np.sin(a) * np.sin(b), periodic=("x", "y"))
    assert abs(cells.velocity([1.0, 0.5])[0]) > 0.1


def torus(n=24, eps=0.0):
    """Return a field of nested surfaces around R = 1, with F / R along phi, by its potential."""
    r, z = np.linspace(0.6, 1.4, n + 1), np.linspace(-0.4, 0.4, n + 1)
    phi = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    a, b, c = np.meshgrid(r, phi, z, indexing="ij")
    s = (a - 1) ** 2 + c**2
    psi = s / 2 + 2 * s**2
    psi = psi + eps * (((a - 1) ** 2 - c**2) * np.cos(b) + 2 * (a - 1) * c * np.sin(b))
    return lv.GriddedField(
        r, phi, z, potential=(0 * a, psi / a, -2.2 * np.log(a)), periodic=("phi",),
        coordinates="cylindrical",
    )  # fmt: skip


def test_field_lines_of_a_torus_stay_on_their_surfaces():
    field = torus()
    assert field.gauge == "given"
    start = field.states_of([[1.1, 0, 0], [1.25, 0, 0], [1, 0, 0.2]])
    rate = field.velocity(start)
    assert np.allclose(rate[:, 1], 2.2 / (2 * start[:, 0]), rtol=1e-4)
    found = lv.ensemble(field, V(), t=(0, 400), h=0.2, every=20, x=start)
    psi = field.potential(found.x)[..., 1]
    assert abs(psi[-20:] - psi[0]).max() < 3e-4 * psi[0].max()
    assert (
        lv.analysis.determinant(field, V(), t=(0, 20), h=0.2, x=start[1]).observed["defect"][-1]
        < 1e-12
    )


def test_a_section_of_a_torus_is_where_it_closes():
    field = torus(eps=1e-2)
    start = field.states_of([[1.15, 0.1, 0], [1.3, 0.1, 0]])
    found = lv.section(field, V(), t=(0, 300), h=0.2, plane="phi", period=2 * np.pi, x=start)
    assert len(found) > 80
    points = field.points_of(found.x)
    assert np.hypot(points[:, 0] - 1, points[:, 2]).max() < 0.39
