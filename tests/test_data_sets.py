"""What data on grids mean: directions, turns, places and gaps."""

import numpy as np
import pytest
import xarray

import liouville as lv
from liouville._systems.fields.gridded.sphere import EARTH

V = lv.VolumeSplitting

pytestmark = pytest.mark.filterwarnings("ignore:the field was not divergence-free")


def overturning(positive="down", upward="upward_sea_water_velocity", name="depth", sign=-1, w="wo"):
    """Return a box of the ocean with a gyre and a weak overturning; w is `sign` times d depth."""
    length, height, eps = 1e5, 1e3, 0.01
    x, d = np.linspace(0, length, 17), np.linspace(0, height, 11)
    a, b, c = np.meshgrid(np.pi * x / length, np.pi * x / length, np.pi * d / height, indexing="ij")
    u = np.sin(a) * np.cos(b) + eps * np.sin(a) * np.cos(c)
    v = -np.cos(a) * np.sin(b)
    down = -eps * height / length * np.cos(a) * np.sin(c)

    def said(name):
        return {"units": "m s-1"} | ({"standard_name": name} if name else {})

    levels = {"units": "m"} | ({"positive": positive} if positive else {})
    dims = ("x", "y", name)
    return xarray.Dataset(
        {
            "uo": (dims, u, said("sea_water_x_velocity")),
            "vo": (dims, v, said("sea_water_y_velocity")),
            w: (dims, sign * down, said(upward)),
        },
        {"x": ("x", x, {"units": "m"}), "y": ("y", x, {"units": "m"}), name: (name, d, levels)},
    )


DEEPER = -5.590e-05
PLACE = [3e4, 4e4, 400]


@pytest.mark.parametrize("walls", [(), ("depth",), ("x", "y", "depth")])
@pytest.mark.parametrize(
    "said",
    [
        {},
        {"positive": None},
        {"upward": "downward_velocity", "sign": 1},
        {"positive": "up", "upward": "downward_velocity", "sign": -1},
    ],
)
def test_an_upward_velocity_goes_up_on_an_axis_of_depths(said, walls):
    field = lv.GriddedField.from_xarray(overturning(**said), walls=walls)
    assert field.velocity(PLACE)[2] == pytest.approx(DEEPER, rel=2e-3)


def test_levels_and_velocities_without_a_direction_are_refused_where_it_matters():
    walls = {"walls": ("x", "y", "depth")}
    with pytest.raises(ValueError, match="'depth' counts downwards, and 'wo' does not say"):
        lv.GriddedField.from_xarray(overturning(upward=""), **walls)
    with pytest.raises(ValueError, match="'wo' is upward, and 'lev' does not say which way"):
        lv.GriddedField.from_xarray(overturning(positive=None, name="lev"))
    plain = overturning(positive=None, upward="", name="z", sign=1)
    assert lv.GriddedField.from_xarray(plain).velocity(PLACE)[2] == pytest.approx(DEEPER, rel=2e-3)
    still = overturning(upward="").assign(wo=0 * overturning().wo)
    assert lv.GriddedField.from_xarray(still, most_divergence=1).coordinates[2] == "depth"


def test_fluxes_on_a_sphere_are_divided_by_its_area():
    lon, lat, radius = np.linspace(0, 40, 21), np.linspace(10, 40, 16), 2.0
    mu = np.sin(np.radians(lat))
    psi = np.outer(np.sin(np.pi * lon / 40), np.sin(np.pi * (mu - mu[0]) / (mu[-1] - mu[0])))
    sphere = {"coordinates": "spherical", "radius": radius, "walls": ("lon", "lat")}
    plain = lv.GriddedField(lon, lat, potential=psi, **sphere)
    through = np.diff(psi, axis=1), -np.diff(psi, axis=0)
    fluxes = lv.GriddedField(lon, lat, fluxes=through, **sphere)
    x = plain.states_of([[10.0, 20.0], [33.0, 12.0]])
    assert fluxes.velocity(x) == pytest.approx(plain.velocity(x), rel=1e-11)


@pytest.mark.parametrize("kind", ["f8", "f4"])
def test_closing_nodes_are_found_though_a_sine_is_not_quite_zero(kind):
    x = np.linspace(0, 2 * np.pi, 33).astype(kind)
    a, b, c = np.meshgrid(x, x, x, indexing="ij")
    abc = np.sin(c) + np.cos(b), np.sin(a) + np.cos(c), np.sin(b) + np.cos(a)
    with pytest.raises(ValueError, match="velocity at the last 'x' is that at the first"):
        lv.GriddedField(x, x, x, velocity=abc, periodic=("x", "y", "z"))
    cut = [part[:-1, :-1, :-1] for part in abc]
    field = lv.GriddedField(x[:-1], x[:-1], x[:-1], velocity=cut, periodic=("x", "y", "z"))
    assert field.velocity([7.0, 7.5, 8.0]) == pytest.approx(
        [np.sin(8) + np.cos(7.5), np.sin(7) + np.cos(8), np.sin(7.5) + np.cos(7)], abs=1e-3
    )
    # a single even wave between its nodes has equal ends, and none too many
    middle = ((np.arange(32) + 0.5) * np.pi / 16).astype(kind)
    a, b = np.meshgrid(middle, middle, indexing="ij")
    field = lv.GriddedField(middle, middle, velocity=(np.cos(b), np.cos(a)), periodic=("x", "y"))
    assert field.velocity([7.0, 7.5]) == pytest.approx(np.cos([7.5, 7.0]), abs=1e-3)
    a, b = np.meshgrid(x, x, indexing="ij")
    with pytest.raises(ValueError, match="at the last 'x' is that at the first"):
        lv.GriddedField(x, x, velocity=(np.cos(b), np.cos(a)), periodic=("x", "y"))


def turning(lon, lat):
    """Return a rigid rotation about a tilted axis, in m/s."""
    a, b = np.radians(np.meshgrid(lon, lat, indexing="ij"))
    tilt = np.pi / 6
    u = 40 * (np.cos(b) * np.cos(tilt) + np.sin(b) * np.cos(a) * np.sin(tilt))
    return u, -40 * np.sin(a) * np.sin(tilt)


def globe(lon, lat, **options):
    data = {"velocity": turning(lon, lat), "coordinates": "spherical", "radius": EARTH}
    return lv.GriddedField(lon, lat, **data, **options)


LAT = np.arange(-80, 81, 4.0)


@pytest.mark.parametrize(
    ("lon", "sentence"),
    [
        (
            np.arange(0, 361, 5.0),
            "period 360 degrees, and its nodes one of 365 degrees\nhint: leave",
        ),
        (np.arange(0, 101, 5.0), "period 360 degrees, and its nodes one of 105 degrees"),
        (
            np.linspace(0, 2 * np.pi, 72, endpoint=False),
            "of 6.28319 degrees\nhint: angles are in d",
        ),
    ],
)
def test_longitudes_that_go_round_have_360_degrees(lon, sentence):
    with pytest.raises(ValueError, match=sentence):
        globe(lon, LAT, periodic=("lon",))


def test_angles_have_a_turn_over_a_whole_number():
    r, z = np.linspace(0.5, 1.5, 9), np.linspace(-0.5, 0.5, 9)

    def torus(phi, periodic=("phi",)):
        a, _, c = np.meshgrid(r, phi, z, indexing="ij")
        velocity = -c / a, 2 / a, (a - 1) / a
        return lv.GriddedField(
            r, phi, z, velocity=velocity, periodic=periodic, coordinates="cylindrical",
            most_divergence=1,
        )  # fmt: skip

    with pytest.raises(
        ValueError, match=r"'phi' has period 6\.28319, .* 360\nhint: .* np\.radians"
    ):
        torus(np.arange(0, 360, 15.0))
    with pytest.raises(ValueError, match="leave out the last node"):
        torus(np.linspace(0, 2 * np.pi, 33))
    with pytest.raises(ValueError, match=r"of 6\.28319 over a whole number, not 2$"):
        torus(np.linspace(0, 2, 8, endpoint=False), {"phi": 2.0})
    fifth = np.linspace(0, 2 * np.pi / 5, 8, endpoint=False)
    assert torus(fifth).coordinates == torus(fifth, {"phi": 2 * np.pi / 5}).coordinates


def on_earth(lon, lat, **coordinates):
    u, v = turning(lon, lat)
    attributes = {"units": "m s-1"}
    return xarray.Dataset(
        {"uo": (("lon", "lat"), u, attributes), "vo": (("lon", "lat"), v, attributes)},
        {"lon": lon, "lat": lat, **coordinates},
    )


@pytest.mark.parametrize(
    "lon",
    [
        np.arange(0, 361, 4.0),
        np.arange(-180, 181, 4.0).astype("f4"),
        np.r_[np.arange(0, 180, 4.0), np.arange(-180, 0, 4.0)],
        np.arange(360, -1, -4.0),
    ],
)
def test_longitudes_go_round_in_any_numbering_with_both_ends_or_one(lon):
    plain = globe(np.arange(0, 360, 4.0), LAT, periodic=("lon",))
    read = lv.GriddedField.from_xarray(on_earth(lon, LAT), periodic=("lon",))
    for field in (read, lv.GriddedField.from_xarray(on_earth(lon, LAT))):
        x = plain.states_of([[358.0, 10.0], [2.0, -33.0], [178.5, 50.0]])
        assert field.velocity(x) == pytest.approx(plain.velocity(x), rel=1e-5, abs=1e-13)


@pytest.mark.parametrize("first", [350, 170])
def test_longitudes_across_greenwich_and_the_dateline_are_a_region(first):
    lon = np.arange(first, first + 21.0)
    own = np.where(lon >= first + 10, lon - 360, lon)
    lat = np.arange(-10, 11.0)
    plain = globe(lon, lat)
    read = lv.GriddedField.from_xarray(on_earth(own, lat))
    points = [[first + 2.5, 3.0], [first + 15.5 - 360, 3.0], [first + 15.5, 3.0]]
    assert read.velocity(read.states_of(points)) == pytest.approx(
        plain.velocity(plain.states_of([[first + 2.5, 3.0], *[[first + 15.5, 3.0]] * 2]))
    )
    start = read.states_of([first + 4.0, 0.0])
    found = lv.integrate(read, V(), t=(0, 3e4), h=3000, x=start)
    assert read.points_of(found.x[-1])[0] > first + 10


def test_ends_of_longitudes_that_are_one_have_one_velocity():
    data = on_earth(np.arange(0, 361, 4.0), LAT)
    data.uo[-1] += 1.0
    with pytest.raises(ValueError, match="longitudes 0 and 360 are one, and the velocities there"):
        lv.GriddedField.from_xarray(data)
    box = lv.GriddedField.from_xarray(
        on_earth(np.arange(0, 361, 4.0), LAT), walls=("lon",), most_divergence=1
    )
    assert not box._axes[0].is_periodic


def test_a_grid_with_the_poles_is_cut_before_them():
    lon, lat = np.arange(0, 360, 4.0), np.arange(-90, 91, 2.0)
    mask = np.zeros((90, 91), dtype=bool)
    mask[40:44, 60:64] = True
    with pytest.warns(UserWarning, match=r"latitudes were cut at -88 and 88"):
        field = lv.GriddedField.from_xarray(on_earth(lon, lat))
    found = lv.integrate(field, V(), t=(0, 691200), h=3600, x=field.states_of([170.0, 10.0]))
    assert field.points_of(found.x[-1]) == pytest.approx([444.834, 50.080], abs=2e-2)
    with pytest.warns(UserWarning, match=r"cut at|taken off"):
        masked = lv.GriddedField.from_xarray(on_earth(lon, lat), mask=mask, most_divergence=1)
    assert masked.islands == 1
    with pytest.raises(ValueError, match="without the poles\nhint: cut the data at 89 degrees"):
        globe(lon, lat)


@pytest.mark.parametrize("unit", ["m s-1", ""])
@pytest.mark.parametrize("degrees", [{}, {"units": "degrees"}])
def test_longitude_latitude_and_depth_are_no_metres(unit, degrees):
    lon, lat, d = np.linspace(0, 10, 9), np.linspace(30, 40, 9), np.linspace(0, 1000, 7)
    one = (("lon", "lat", "depth"), np.ones((9, 9, 7)), {"units": unit})
    axes = {"lon": ("lon", lon, degrees), "lat": ("lat", lat, degrees), "depth": d}
    data = xarray.Dataset({"u": one, "v": one, "w": one}, axes).assign(w=lambda x: 0 * x.w)
    deep = lv.GriddedField.from_xarray(data, most_divergence=1)
    assert deep.coordinates == ("lon", "mu", "depth")
    rates = deep.velocity(deep.states_of([5.0, 35.0, 500.0]))
    assert rates[0] == pytest.approx(1 / (EARTH * np.cos(np.radians(35))), rel=1e-2)
    pressures = data.rename(depth="level")
    with pytest.raises(
        ValueError, match=r"levels along 'level' without.*\nhint: .*isel\(level=0\)"
    ):
        lv.GriddedField.from_xarray(pressures)
    level = lv.GriddedField.from_xarray(data.isel(depth=0), most_divergence=1)
    assert level.coordinates == ("lon", "mu")
    mixed = data.isel(depth=0).rename(lat="y")
    mixed["y"].attrs.clear()
    with pytest.raises(ValueError, match="'lon' is an angle, and 'y' is none"):
        lv.GriddedField.from_xarray(mixed)


def test_angles_in_radians_are_angles():
    lon, lat = np.arange(0, 360, 4.0), LAT
    plain, data = globe(lon, lat, periodic=("lon",)), on_earth(lon, lat)
    for name in ("lon", "lat"):
        data[name] = np.radians(data[name]).assign_attrs(units="radians")
    field = lv.GriddedField.from_xarray(data)
    x = plain.states_of([[12.0, 34.0]])
    assert field.velocity(x) == pytest.approx(plain.velocity(x), rel=1e-12)
    named = lv.GriddedField.from_xarray(on_earth(lon, lat), coordinates="spherical")
    assert named.velocity(x) == pytest.approx(plain.velocity(x), rel=1e-12)


def test_coordinates_of_two_dimensions_may_depend_on_one_of_them():
    lat, lon = np.meshgrid(np.arange(30, 50.0), np.arange(-10, 10.0), indexing="ij")
    dims, attributes = ("y", "x"), {"units": "m s-1"}
    places = {"nav_lat": (dims, lat), "nav_lon": (dims, lon)}
    u = {"uo": (dims, np.cos(np.radians(lat)), attributes), "vo": (dims, 0 * lat, attributes)}
    plain = lv.GriddedField.from_xarray(
        xarray.Dataset(u, {"y": lat[:, 0], "x": lon[0]}).rename(x="lon", y="lat")
    )
    numbered = xarray.Dataset(u, places | {"y": np.arange(20), "x": np.arange(20)})
    for data in (numbered, numbered.drop_vars(["x", "y"])):
        field = lv.GriddedField.from_xarray(data)
        x = plain.states_of([[3.3, 40.2]])
        assert (field.velocity(x) == plain.velocity(x)).all()
        data["nav_lat"] = data.nav_lat + 0.05 * data.nav_lon
        with pytest.raises(
            ValueError, match="'nav_lat' depends on 'x' and 'y': the grid is curvilinear\nhint: cut"
        ):
            lv.GriddedField.from_xarray(data)
    # a map in metres may say where it is
    for name in dims:
        numbered[name] = (name, 1e4 * np.arange(20), {"units": "m"})
    assert lv.GriddedField.from_xarray(numbered, most_divergence=1).coordinates == ("x", "y")


def test_axes_of_an_unknown_name_are_told_what_helps():
    x = np.arange(30) * 1e4
    one = xarray.Dataset(
        {name: (("Yp", "x"), np.ones((30, 30))) for name in "uv"}, {"Yp": x, "x": x}
    )
    with pytest.raises(ValueError, match=r"'Yp' of 'u' is no axis.*\nhint: .*\['axis'\] = 'Y'"):
        lv.GriddedField.from_xarray(one)
    other = one.assign(v=one.v.rename(Yp="Yq"))
    with pytest.raises(ValueError, match=r"'Yp' of 'u' is no axis that is known"):
        lv.GriddedField.from_xarray(other)


def gyre(hole=None, **options):
    x, y = np.linspace(0, 4, 41), np.linspace(0, 3, 31)
    a, b = np.meshgrid(np.pi * x / 4, np.pi * y / 3, indexing="ij")
    u, v = np.sin(a) * np.cos(b) / 3, -np.cos(a) * np.sin(b) / 4
    u, v = (np.repeat(part[None], 5, 0) for part in (u, v))
    if hole is not None:
        u[hole] = np.nan
    t = 10.0 * np.arange(5)
    return lv.GriddedField(x, y, t=t, velocity=(u, v), walls=("x", "y"), **options)


def test_axes_without_nodes_or_with_one_are_named():
    sea = overturning().isel(depth=0, drop=True)
    with pytest.raises(ValueError, match=r"'y' of 'uo' is empty: no node is left\nhint: sel\(y="):
        lv.GriddedField.from_xarray(sea.sel(y=slice(9e4, 1e4)))
    for alone in (sea.isel(y=[3]), overturning().isel(y=[3])):
        with pytest.raises(ValueError, match="'uo' has one node along 'y', and a field is no line"):
            lv.GriddedField.from_xarray(alone)


def test_gaps_are_named_with_node_and_time():
    with pytest.raises(ValueError, match=r"1 node, first at t = 20 and \(x, y\) = \(1.2, 1.5\)"):
        gyre((2, 12, 15))
    with pytest.raises(ValueError, match="at all nodes of the sample at t = 20"):
        gyre(2)
    with pytest.raises(ValueError, match=r"velocity is NaN at all nodes$"):
        gyre(...)


def test_a_start_on_land_is_said():
    mask = np.zeros((41, 31), dtype=bool)
    mask[10:15, 13:18] = True
    field = gyre((2, 12, 15), mask=mask, most_divergence=1)
    assert field.islands == 1
    run = {"t": (0, 2), "h": 0.5}
    found = lv.integrate(field, V(), x=[1.2, 1.5], **run)
    assert found.message == "the start is on land, where nothing moves"
    assert (found.x == found.x[0]).all()
    assert not lv.integrate(field, V(), x=[2.2, 1.5], **run).message
    found = lv.ensemble(field, V(), x=[[2.2, 1.5], [1.2, 1.5], [1.25, 1.45]], **run)
    assert found.message == "2 of 3 members start on land, the first of them member 1"


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".npz"])
def test_exports_of_a_sphere_have_degrees(tmp_path, suffix):
    field = globe(np.arange(0, 360, 10.0), LAT, periodic=("lon",))
    points = np.array([[358.0, 20.0], [30.0, 40.0]])
    run = lv.ensemble(field, V(), t=(0, 86400), h=3600, x=field.states_of(points))
    data, exact = run.to_xarray(), field.points_of(run.x)
    assert (data.lon.values == exact[..., 0]).all()
    assert (data.lat.values == exact[..., 1]).all()
    assert data.lon[0].values == pytest.approx(points[:, 0])
    assert (data.lon.units, data.lat.units) == ("degrees_east", "degrees_north")
    path = tmp_path / f"run{suffix}"
    run.save(path)
    assert (lv.load(path).x == run.x).all()
    run.sel(time=slice(0, 7200)).save(tmp_path / "run.csv")
    head, first, *_ = (tmp_path / "run.csv").read_text().splitlines()
    assert head == "member,t,x[lon],x[mu],lon,lat"
    assert [float(x) for x in first.split(",")][-2:] == pytest.approx(points[0])
