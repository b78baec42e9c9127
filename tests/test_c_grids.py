"""C-grids as MITgcm, NEMO and ROMS write them: transports, paths, land, and the way back."""

from functools import cached_property

import numpy as np
import pytest
import xarray
from ordinary import solved

import liouville as lv

V = lv.VolumeSplitting
R, DAY = 6.371e6, 86400.0
M_S = {"units": "m s-1"}


class Sea:
    """Currents of a vector potential on the sphere with depth, and what flows through cells.

    With A_z = S(lon) M(mu) P(z) and A_lon = L(lon) N(mu) Q(z), in heights z below 0, rates are
    lon' = S M' P, mu' = L N Q' - S' M P, z' = -L N' Q.
    """

    def __init__(self, nx=36, ny=24, nz=12, lon=(0.0, 360.0), lat=(-60.0, 60.0), deep=4000.0):
        self.lon, self.lat = np.linspace(*lon, nx + 1), np.linspace(*lat, ny + 1)
        self.z = -deep * np.linspace(0, 1, nz + 1) ** 1.5
        self.deep, self.ends = deep, np.sin(np.radians(lat))
        self.turns = 2 * np.pi / np.radians(lon[1] - lon[0])

    def functions(self, lon, mu, z):
        """Return S, M, P, L, N, Q, each with its derivative, and those of P and L integrated."""
        k, (low, high) = self.turns, self.ends
        q, d = np.pi / (high - low), np.pi / self.deep
        a, b, c = k * (lon - np.radians(self.lon[0])), q * (mu - low), d * z
        speed = 2e-8
        one = speed * (1 + 0.4 * np.cos(a)), -speed * 0.4 * k * np.sin(a)
        return {
            "S": one,
            "M": (np.sin(b) / q, np.cos(b)),
            "P": (1 + 0.5 * np.cos(c), None, z + 0.5 * np.sin(c) / d),
            "L": (np.sin(a + 0.3), None, -np.cos(a + 0.3) / k),
            "N": (np.sin(b), q * np.cos(b)),
            "Q": (2e-9 / d * np.sin(c), 2e-9 * np.cos(c)),
        }

    def rates(self, _, x):
        """Return d lon, d lat and dz of degrees and heights."""
        lon, lat = np.radians(x[:2])
        f = self.functions(lon, np.sin(lat), x[2])
        east = f["S"][0] * f["M"][1] * f["P"][0]
        north = f["L"][0] * f["N"][0] * f["Q"][1] - f["S"][1] * f["M"][0] * f["P"][0]
        return [
            np.degrees(east), np.degrees(north / np.cos(lat)),
            -f["L"][0] * f["N"][1] * f["Q"][0],
        ]  # fmt: skip

    @cached_property
    def transports(self):
        """Return m^3/s through all faces, axes in the order z, y, x."""
        edges = np.meshgrid(
            self.z, np.sin(np.radians(self.lat)), np.radians(self.lon), indexing="ij"
        )
        f = self.functions(*edges[::-1])
        up, along = -1, 1  # z falls along its axis
        flux_x = f["S"][0] * np.diff(f["M"][0], axis=1, append=0) * up
        flux_x = flux_x * np.diff(f["P"][2], axis=0, append=0)
        flux_y = np.diff(f["L"][2], axis=2, append=0) * f["N"][0] * up
        flux_y = flux_y * np.diff(f["Q"][0], axis=0, append=0)
        flux_y -= (
            up
            * np.diff(f["S"][0], axis=2, append=0)
            * f["M"][0]
            * np.diff(f["P"][2], axis=0, append=0)
        )
        flux_z = -along * np.diff(f["L"][2], axis=2, append=0) * f["Q"][0]
        flux_z = flux_z * np.diff(f["N"][0], axis=1, append=0)
        return (R**2 * flux_x[:-1, :-1], R**2 * flux_y[:-1, :, :-1], R**2 * flux_z[:, :-1, :-1])

    @cached_property
    def sizes(self):
        """Return dy of faces to the east, dx of those to the north, dz, and areas."""
        dlon, dz = np.radians(np.diff(self.lon)), -np.diff(self.z)
        dy = R * np.radians(np.diff(self.lat))[:, None] * np.ones(self.lon.size)
        dx = R * np.cos(np.radians(self.lat))[:, None] * dlon
        area = R**2 * np.diff(np.sin(np.radians(self.lat)))[:, None] * dlon
        return dy, dx, dz, area

    @cached_property
    def velocities(self):
        """Return u, v and w on all faces."""
        (x, y, z), (dy, dx, dz, area) = self.transports, self.sizes
        deep = dz[:, None, None]
        return x / (dy * deep), y / (dx * deep), z / area

    @property
    def centres(self):
        """Return the centres of cells: longitudes, latitudes and heights."""
        return [(x[1:] + x[:-1]) / 2 for x in (self.lon, self.lat, self.z)]

    def path(self, start, days):
        """Return degrees and heights of a start after some days."""
        return solved(self.rates, (0, days * DAY), start)[-1]


def of_mitgcm(sea, numbering=lambda lon: lon, outer=False):
    """Return a data set as xmitgcm makes it, or with all faces, as MITgcm's own files have them."""
    u, v, w = sea.velocities
    dy, dx, dz, area = sea.sizes
    lon, lat, z = sea.centres
    cut = slice(None) if outer else slice(-1)
    x, y, level = ("Xp1", "Yp1", "Zl") if outer else ("XG", "YG", "Zl")
    cx, cy = ("X", "Y") if outer else ("XC", "YC")
    east, north = {"units": "degrees_east"}, {"units": "degrees_north"}
    down = {"units": "m", "positive": "down", "axis": "Z"}
    shift = {"c_grid_axis_shift": -0.5}
    return xarray.Dataset(
        {
            "U": (("Z", cy, x), u[..., cut], M_S | {"standard_name": "sea_water_x_velocity"}),
            "V": (("Z", y, cx), v[:, cut], M_S | {"standard_name": "sea_water_y_velocity"}),
            "W": ((level, cy, cx), w[:-1], M_S | {"standard_name": "sea_water_z_velocity"}),
            "dyG": ((cy, x), dy[:, cut], {"units": "m"}),
            "dxG": ((y, cx), dx[cut], {"units": "m"}),
            "rA": ((cy, cx), area, {"units": "m2"}),
            "drF": ("Z", dz, {"units": "m"}),
            "hFacC": (("Z", cy, cx), np.ones((*u.shape[:2], lon.size))),
            "hFacW": (("Z", cy, x), np.ones_like(u[..., cut])),
            "hFacS": (("Z", y, cx), np.ones_like(v[:, cut])),
        },
        {
            cx: (cx, numbering(lon), east | {"standard_name": "longitude", "axis": "X"}),
            x: (x, numbering(sea.lon[cut]),
                east | {"standard_name": "longitude_at_f_location", "axis": "X"} | shift),
            cy: (cy, lat, north | {"standard_name": "latitude", "axis": "Y"}),
            y: (y, sea.lat[cut],
                north | {"standard_name": "latitude_at_f_location", "axis": "Y"} | shift),
            "Z": ("Z", z, down | {"standard_name": "depth"}),
            level: (level, sea.z[:-1], down | {"standard_name": "depth_at_lower_w_location"}),
        },
    )  # fmt: skip


def of_nemo(sea, numbering=lambda lon: lon):
    """Return a data set of NEMO's files for U, V and W, with its mesh mask."""
    u, v, w = sea.velocities
    dy, dx, dz, area = sea.sizes
    lon, lat, z = sea.centres
    shape = np.broadcast_shapes((lat.size, 1), (1, lon.size))

    def plane(values):
        return ("t", "y", "x"), np.broadcast_to(values, shape)[None]

    faces, north = numbering(sea.lon[1:])[None], sea.lat[1:, None]
    return xarray.Dataset(
        {
            "vozocrtx": (("time_counter", "depthu", "y", "x"), u[None, ..., 1:], M_S),
            "vomecrty": (("time_counter", "depthv", "y", "x"), v[None, :, 1:], M_S),
            "vovecrtz": (("time_counter", "depthw", "y", "x"), w[None, :-1],
                         M_S | {"long_name": "Vertical velocity", "standard_name":
                                "upward_sea_water_velocity"}),
            "glamt": plane(numbering(lon)[None]), "gphit": plane(lat[:, None]),
            "glamu": plane(faces), "gphiu": plane(lat[:, None]),
            "glamv": plane(numbering(lon)[None]), "gphiv": plane(north),
            "glamf": plane(faces), "gphif": plane(north),
            "e1t": plane(area / dy[:, 1:]), "e2t": plane(dy[:, 1:]),
            "e2u": plane(dy[:, 1:]), "e1v": plane(dx[1:]),
            "e3u_0": (("t", "nav_lev", "y", "x"),
                      np.broadcast_to(dz[:, None, None], (dz.size, *shape))[None]),
            "e3v_0": (("t", "nav_lev", "y", "x"),
                      np.broadcast_to(dz[:, None, None], (dz.size, *shape))[None]),
        },
        {
            "time_counter": np.array(["2020-01-01"], dtype="M8[ns]"),
            "nav_lon": (("y", "x"), np.broadcast_to(numbering(lon)[None], shape)),
            "nav_lat": (("y", "x"), np.broadcast_to(lat[:, None], shape)),
            "depthu": ("depthu", -z, {"units": "m", "positive": "down"}),
            "depthv": ("depthv", -z, {"units": "m", "positive": "down"}),
            "depthw": ("depthw", -sea.z[:-1], {"units": "m", "positive": "down"}),
        },
    )  # fmt: skip


def around(lon):
    return (lon + 180) % 360 - 180


def of_xnemogcm(sea):
    """Return the same with dimensions of their own, which are indices, as xnemogcm has them."""
    data = of_nemo(sea).squeeze("t").drop_vars(["nav_lon", "nav_lat", "gphiu", "glamv"])
    places = {"u": ("y_c", "x_f"), "v": ("y_f", "x_c"), "f": ("y_f", "x_f"), "t": ("y_c", "x_c")}
    levels = {"depthu": "z_c", "depthv": "z_c", "nav_lev": "z_c", "depthw": "z_f"}
    ends = {"vozocrtx": "u", "vomecrty": "v", "vovecrtz": "t", "e3u_0": "u", "e3v_0": "v"}
    found = xarray.Dataset()
    for name, x in data.data_vars.items():
        end = ends.get(name, name[-1])
        new = levels | dict(zip(("y", "x"), places[end], strict=True))
        x = x.drop_vars(x.coords)
        found[name] = x.rename({dim: new[dim] for dim in x.dims if dim in new})
    found["gdept_1d"], found["gdepw_1d"] = ("z_c", data.depthu.values), ("z_f", data.depthw.values)
    for name in ("x_c", "y_c", "z_c", "x_f", "y_f", "z_f"):
        shift = {"x_f": 0.5, "y_f": 0.5, "z_f": -0.5}.get(name, 0.0)
        attributes = {"axis": name[0].upper()} | ({"c_grid_axis_shift": shift} if shift else {})
        found[name] = (name, np.arange(found.sizes[name]) + shift, attributes)
    return found.drop_vars(["e1t", "e2t", "e2u", "e1v", "e3u_0", "e3v_0"])


def heights(points, field):
    """Return points with heights for depths."""
    return points * ([1, 1, -1] if field._level["positive"] == "down" else [1, 1, 1])


LEVELS = {of_mitgcm: "Z", of_nemo: "depthu", of_xnemogcm: "z_c"}
STARTS = np.array([[175.0, 3.0, -400.0], [178.0, -20.0, -1500.0], [172.0, 31.0, -2500.0]])


@pytest.mark.parametrize(("model", "where"), [(of_mitgcm, (0.0, 360.0)), (of_nemo, (140.0, 210.0))])
def test_paths_are_those_of_the_currents(model, where):
    """Round the globe and across the date line, to 1e-6 of what a tracer moves."""
    sea = Sea(48, 40, 16, lon=where)
    field = lv.GriddedField.from_xarray(model(sea, around), walls=(LEVELS[model],), degree=5)
    assert field._axes[0].is_periodic == (where == (0.0, 360.0))
    assert field.divergence < 1e-12
    start = field.states_of(heights(STARTS, field))
    run = lv.ensemble(field, V(composition="BM6"), t=(0, 60 * DAY), h=DAY, x=start)
    ends = heights(field.points_of(run.x[-1]), field)
    exact = np.array([sea.path(each, 60) for each in STARTS])
    moved = np.abs(exact - STARTS)
    assert moved.min(0) == pytest.approx([0.5, 0.05, 0.2], rel=0.35)
    assert (np.abs(ends - exact) < 1e-6 * moved.max(0)).all()


def through(field, plane, at, ends):
    """Return what flows through a piece of a coordinate plane, by quadrature in each cell."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    mids = [(a + b) / 2 + (b - a) / 2 * nodes for a, b in ends]
    grid = list(np.meshgrid(*mids, indexing="ij"))
    grid.insert(plane, np.full(grid[0].shape, at))
    half = [(b - a) / 2 for a, b in ends]
    rates = field.velocity(np.stack(grid, axis=-1))[..., plane]
    return half[0] * half[1] * np.einsum("ij,i,j", rates, weights, weights)


@pytest.mark.parametrize("model", [of_mitgcm, of_nemo, of_xnemogcm])
def test_transports_through_faces_are_those_of_the_model(model):
    """To roundoff, those of each face in m^3/s."""
    sea = Sea(16, 12, 8)
    field = lv.GriddedField.from_xarray(model(sea), walls=(LEVELS[model],))
    sign = -1 if field._level["positive"] == "down" else 1
    lon, mu, z = np.radians(sea.lon), np.sin(np.radians(sea.lat)), sign * sea.z
    for i, j, k in ((3, 4, 2), (9, 7, 5), (15, 3, 1)):
        cell = [sorted(ends) for ends in ((lon[i], lon[i + 1]), (mu[j], mu[j + 1]), z[[k, k + 1]])]
        found = [
            through(field, plane, at, [ends for m, ends in enumerate(cell) if m != plane])
            for plane, at in enumerate((lon[i], mu[j], z[k]))
        ]
        x, y, w = sea.transports
        wanted = np.array([x[k, j, i], y[k, j, i], sign * w[k, j, i]]) / R**2
        assert found == pytest.approx(wanted, rel=1e-9, abs=1e-12 * np.abs(wanted).max())


def test_what_flows_upward_follows_from_the_rest_where_it_is_not_given():
    sea = Sea(16, 12, 8)
    for model in (of_mitgcm, of_nemo):
        data, name = model(sea), "W" if model is of_mitgcm else "vovecrtz"
        given = {"walls": (LEVELS[model],)}
        with_w, without = (
            lv.GriddedField.from_xarray(each, **given) for each in (data, data.drop_vars(name))
        )
        x = with_w.states_of(heights(STARTS, with_w))
        assert without.velocity(x) == pytest.approx(with_w.velocity(x), rel=1e-8)
        bare = data.drop_vars([name, "Zl" if model is of_mitgcm else "depthw"])
        with pytest.raises(ValueError, match=r"the levels between which .* is are not in the data"):
            lv.GriddedField.from_xarray(bare, **given)


def basin(lon, lat):
    """Return a stream function in m^2/s, constant on an island, and velocities on faces."""
    a, b = np.meshgrid((lon - lon[0]) / (lon[-1] - lon[0]), lat / 20, indexing="ij")
    psi = 1e5 * np.sin(np.pi * a) ** 2 * np.cos(np.pi * b / 2) ** 2
    psi[20:27, 10:17] = psi[23, 13]
    dy = R * np.radians(np.diff(lat))
    dx = R * np.cos(np.radians(lat)) * np.radians(np.diff(lon))[:, None]
    return psi, np.diff(psi, axis=1) / dy, -np.diff(psi, axis=0) / dx


def of_basin(outer=True, **axes):
    """Return a level of MITgcm, its last faces included or not."""
    lon, lat = np.linspace(160, 200, 41), np.linspace(-20, 20, 37)
    _, u, v = basin(lon, lat)
    cut = slice(None) if outer else slice(-1)
    places = {"XC": (lon[1:] + lon[:-1]) / 2, "XG": lon[cut], "YC": (lat[1:] + lat[:-1]) / 2,
              "YG": lat[cut]}  # fmt: skip
    data = xarray.Dataset(
        {"U": (("YC", "XG"), u.T[:, cut], M_S), "V": (("YG", "XC"), v.T[cut], M_S)}, places
    )
    for name in ("XC", "XG"):
        data[name] = around(data[name]).assign_attrs(units="degrees_east")
        data["Y" + name[1]].attrs["units"] = "degrees_north"
    return data


def masked(data):
    wet = np.ones((36, 40))
    wet[10:16, 20:26] = 0
    return data.assign(hFacC=(("YC", "XC"), wet))


def with_gaps(data):
    lon, lat = np.meshgrid(data.XG % 360, data.YC, indexing="xy")
    inside = (lon > 179.5) & (lon < 186.5) & (abs(lat + 5.5) < 3.4)
    data["U"] = data.U.where(~xarray.DataArray(inside, dims=("YC", "XG")))
    lon, lat = np.meshgrid(data.XC % 360, data.YG, indexing="xy")
    inside = (lon > 180) & (lon < 186) & (lat > -9) & (lat < -2)
    data["V"] = data.V.where(~xarray.DataArray(inside, dims=("YG", "XC")))
    return data


@pytest.mark.parametrize("land", [masked, with_gaps])
@pytest.mark.parametrize("outer", [False, True])
def test_an_island_is_known_by_a_mask_or_by_faces_without_numbers(outer, land):
    data = land(of_basin(outer))
    field = lv.GriddedField.from_xarray(data, walls=("XC", "YC") if outer else ())
    assert field.islands == 1
    assert (field._axes[0].n, field._axes[1].n) == ((40, 36) if outer else (39, 35))
    inner = field.states_of([[-178.0, -7.5], [183.0, -5.5]])
    assert np.abs(field.velocity(inner)).max() < 1e-20
    assert field.is_land(inner).all()
    lon, lat = np.linspace(160, 200, 41), np.linspace(-20, 20, 37)
    plain = lv.GriddedField(
        lon, lat, potential=basin(lon, lat)[0], coordinates="spherical", radius=R,
        walls=("lon", "lat"),
    )  # fmt: skip
    far = plain.states_of([[193.0, 12.0], [166.0, -13.0]])
    assert field.velocity(far) == pytest.approx(plain.velocity(far), rel=1e-3)


def test_runs_come_back_with_dates_and_degrees():
    sea = Sea(16, 12, 8)
    days = np.arange("2020-01-01", "2020-01-06", dtype="M8[D]").astype("M8[ns]")
    data = of_nemo(sea).isel(time_counter=0, drop=True)
    growth = xarray.DataArray(1 + 0.1 * np.arange(5), {"time_counter": days}, "time_counter")
    for name in ("vozocrtx", "vomecrty", "vovecrtz"):
        data[name] = (growth * data[name]).assign_attrs(data[name].attrs)
    field = lv.GriddedField.from_xarray(data, walls=("depthu",))
    start = field.states_of(heights(STARTS, field))
    run = lv.ensemble(field, V(), t=(days[1], days[4]), h=np.timedelta64(6, "h"), x=start)
    found = run.trajectories()
    assert found.lon.attrs["units"] == "degrees_east"
    assert (found.lat.attrs["standard_name"], found.depth.attrs["positive"]) == ("latitude", "down")
    assert found.time.values[0, [0, -1]].tolist() == days[[1, 4]].tolist()
    assert np.stack([found[k].values[:, 0] for k in ("lon", "lat", "depth")], -1) == pytest.approx(
        heights(STARTS, field)
    )
    gone = field.points_of(run.x[-1])
    assert found.depth.values[:, -1] == pytest.approx(gone[:, 2])


def test_points_of_roms_are_between_those_that_it_has():
    """Faces are between centres at both ends, and coordinates have two dimensions."""
    lon, lat = np.linspace(160, 200, 41), np.linspace(-20, 20, 37)
    _, u, v = basin(lon, lat)
    x, y = (lon[1:] + lon[:-1]) / 2, (lat[1:] + lat[:-1]) / 2
    dims = {"u": ("eta_u", "xi_u"), "v": ("eta_v", "xi_v"), "rho": ("eta_rho", "xi_rho")}
    places = {"u": (lon[1:-1], y), "v": (x, lat[1:-1]), "rho": (x, y)}
    data = xarray.Dataset(
        {"u": (("eta_u", "xi_u"), u.T[:, 1:-1], {"units": "meter second-1"}),
         "v": (("eta_v", "xi_v"), v.T[1:-1], {"units": "meter second-1"})}
    )  # fmt: skip
    for end, (a, b) in places.items():
        grids = np.meshgrid(a, b)
        data[f"lon_{end}"] = dims[end], grids[0], {"units": "degree_east"}
        data[f"lat_{end}"] = dims[end], grids[1], {"units": "degree_north"}
    roms = lv.GriddedField.from_xarray(data)
    assert roms.divergence < 1e-12
    assert (roms._axes[0].n, roms._axes[1].n) == (38, 34)
    mitgcm = lv.GriddedField.from_xarray(of_basin(), walls=("XC", "YC"))
    at = roms.states_of([[193.0, 12.0], [166.0, -13.0]])
    assert roms.velocity(at) == pytest.approx(mitgcm.velocity(at), rel=2e-4)


def test_a_plane_in_metres_may_be_periodic():
    """Of MITgcm without a sphere: the last face is the first."""
    n, length = 32, 8e5
    x = length * np.arange(n + 1) / n
    a, b = np.meshgrid(x, x, indexing="ij")
    psi = 1e4 * np.sin(2 * np.pi * a / length) * np.cos(2 * np.pi * b / length)
    u, v = np.diff(psi, axis=1) * n / length, -np.diff(psi, axis=0) * n / length
    c = x[:-1] + length / n / 2
    data = xarray.Dataset(
        {"U": (("YC", "XG"), u.T[:, :-1], M_S), "V": (("YG", "XC"), v.T[:-1], M_S)},
        {name: (name, x[:-1] if name.endswith("G") else c, {"units": "m"})
         for name in ("XC", "XG", "YC", "YG")},
    )  # fmt: skip
    plain = lv.GriddedField(x[:-1], x[:-1], potential=psi[:-1, :-1], periodic=("x", "y"))
    field = lv.GriddedField.from_xarray(data, periodic=("XC", "YC"))
    at = np.random.default_rng(0).uniform(0, 2 * length, (20, 2))
    assert field.velocity(at) == pytest.approx(plain.velocity(at), rel=1e-9, abs=1e-12)
    assert field.coordinates == ("XC", "YC")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda d: d.assign(glamf=d.glamf + 0.3 * d.y, glamu=d.glamu + 0.3 * d.y),
            r"'glamu' depends on 'y' and 'x': the grid is curvilinear\nhint: cut the data to where",
        ),
        (
            lambda d: d.drop_vars([name for name in d.variables if name[:4] in ("glam", "gphi")]),
            r"'nav_lon' and 'nav_lon' are the same, .*\nhint: .*glamu and gphiv",
        ),
        (
            lambda d: d.drop_vars([n for n in d if n[:4] in ("glam", "gphi")] + ["nav_lon"]),
            r"dimension 'x' has no coordinate that says where its points are\nhint: add longitudes",
        ),
        (
            lambda d: d.assign(vomecrty=d.vomecrty.isel(y=0, drop=True)),
            "'vomecrty' must have an X and a Y axis, .* not time_counter, depthv, x",
        ),
        (
            lambda d: d.assign(vozocrtx=d.vozocrtx.where(d.x != 3).expand_dims(
                member=[1, 2])),
            "'member' of 'vozocrtx' is no axis that is known",
        ),
    ],
)  # fmt: skip
def test_a_c_grid_that_is_not_understood_is_refused(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        lv.GriddedField.from_xarray(change(of_nemo(Sea(16, 12, 8))), walls=("depthu",))


def test_gaps_at_some_times_and_poles_are_said():
    data = of_basin().expand_dims(time=[0.0, 1.0, 2.0]).copy(deep=True)
    data["U"][1, 3, 4] = np.nan
    with pytest.raises(ValueError, match="'U' is NaN at some times only, at 1 of its points"):
        lv.GriddedField.from_xarray(data)
    sea = Sea(24, 18, 6, lat=(-90, 90))
    with pytest.warns(UserWarning, match="latitudes were cut at -80 and 80"):
        lv.GriddedField.from_xarray(of_mitgcm(sea, outer=True), walls=("Z",))


def test_masks_without_land_are_none_and_others_fit():
    data = of_mitgcm(Sea(16, 12, 8))
    assert lv.GriddedField.from_xarray(data).islands == 0  # with open levels
    flat = data.isel(Z=0, Zl=0).assign(hFacC=data.hFacC)
    with pytest.raises(ValueError, match=r"'hFacC' has an axis 'Z', and the velocity has none"):
        lv.GriddedField.from_xarray(flat, most_divergence=1)
    x = np.linspace(0, 1, 9)
    abc = np.meshgrid(np.sin(x), np.sin(x), np.sin(x), indexing="ij")
    velocity = abc[1], abc[2], abc[0]
    none = np.zeros(abc[0].shape, dtype=bool)
    assert lv.GriddedField(x, x, x, velocity=velocity, mask=none).islands == 0
