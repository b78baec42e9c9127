"""Longitude, latitude and depth: rates on the sphere, volume, heights in divergence, data sets."""

import casadi as ca
import numpy as np
import pytest
import xarray
from ordinary import solved

import liouville as lv
from liouville._systems.fields.gridded.sphere import EARTH

V = lv.VolumeSplitting
HEIGHT, DAY = 4000.0, 86400.0
AROUND = {"coordinates": "spherical", "radius": EARTH, "periodic": ("lon",), "walls": ("lat", "z")}
STARTS = np.array([[10.0, 5, 500], [100, 30, 2000], [200, -40, 3000]])

pytestmark = pytest.mark.filterwarnings("ignore:the field was not divergence-free")


def flow():
    """Return the rates of longitude, mu and depth, of a jet with waves and an overturning."""
    lon, mu, z = (ca.SX.sym(name) for name in ("lon", "mu", "z"))
    s = mu / np.sin(np.radians(60))
    up = 2e-8 * (1 - s**2) ** 2 * (1 + 0.5 * ca.cos(2 * lon) * ca.cos(np.pi * z / HEIGHT))
    east = -1e-5 * (1 - s**2) ** 2 * s * ca.sin(np.pi * z / HEIGHT) * (1 + 0.3 * ca.cos(lon))
    rates = ca.vertcat(
        ca.jacobian(up, mu), ca.jacobian(east, z) - ca.jacobian(up, lon), -ca.jacobian(east, mu)
    )
    potential = ca.vertcat(east, 0, up)
    return [ca.Function("f", [ca.vertcat(lon, mu, z)], [each]) for each in (rates, potential)]


RATES, POTENTIAL = flow()


def nodes(n):
    """Return the axes of a grid of n x n/2 x n/4 cells, and the states of its nodes."""
    axes = (
        np.arange(n) * 360 / n,
        np.linspace(-60, 60, n // 2 + 1),
        np.linspace(0, HEIGHT, n // 4 + 1),
    )
    lon, lat, z = np.meshgrid(*axes, indexing="ij")
    return axes, np.stack([np.radians(lon), np.sin(np.radians(lat)), z])


def velocity(n):
    """Return axes and u, v and the velocity along the third one, in m/s."""
    axes, states = nodes(n)
    rates = np.array(RATES(states.reshape(3, -1))).reshape(states.shape)
    cosine = np.sqrt(1 - states[1] ** 2)
    return axes, [rates[0] * EARTH * cosine, rates[1] * EARTH / cosine, rates[2]]


def data(n=24, *, has_w=True, unit="m", per_metre=1.0, said="down"):
    """Return a data set as ocean models write them, w upward."""
    (lon, lat, depth), (u, v, down) = velocity(n)
    dims, m_s = ("lon", "lat", "depth"), {"units": "m s-1"}
    names = {"uo": (u, "eastward_sea_water_velocity"), "vo": (v, "northward_sea_water_velocity")}
    if has_w:
        names["wo"] = (-down if said == "down" else down, "upward_sea_water_velocity")
    axes = {
        "lon": ("lon", lon, {"units": "degrees_east"}),
        "lat": ("lat", lat, {"units": "degrees_north"}),
        "depth": ("depth", depth * per_metre, {"units": unit, "positive": said}),
    }
    found = {k: (dims, x, m_s | {"standard_name": name}) for k, (x, name) in names.items()}
    return xarray.Dataset(found, axes).transpose("depth", "lat", "lon")


def read(dataset, **more):
    return lv.GriddedField.from_xarray(dataset, **({"walls": ("lat", "depth")} | more))


def test_rates_are_those_of_the_sphere_with_the_order_of_the_splines():
    errors = []
    places = np.random.default_rng(0).uniform([0, -50, 300], [360, 50, 3700], (200, 3))
    for n in (24, 48):
        axes, parts = velocity(n)
        field = lv.GriddedField(*axes, velocity=parts, **AROUND)
        assert field.coordinates == ("lon", "mu", "z")
        x = field.states_of(places)
        assert np.abs(field.points_of(x) - places).max() < 1e-11
        exact = np.array(RATES(x.T)).T
        errors.append(np.abs(field.velocity(x) - exact).max(0) / np.abs(exact).max(0))
    assert (np.log2(errors[0] / errors[1]) > 2.5).all()
    assert errors[1].max() < 2e-3


def test_potentials_and_fluxes_are_those_of_the_shell():
    """A physical potential, and volumes per second through the faces of cells."""
    (lon, lat, z), states = nodes(24)
    a = np.array(POTENTIAL(states.reshape(3, -1))).reshape(states.shape)
    cosine = np.sqrt(1 - states[1] ** 2)
    physical = a[0] * EARTH / cosine, a[1] * EARTH * cosine, a[2] * EARTH**2
    by_potential = lv.GriddedField(lon, lat, z, potential=physical, gauge="coulomb", **AROUND)
    edges = np.append(lon, 360.0), lat, z

    def through(k):  # Gauss' rule of three points in each cell
        x, weight = np.polynomial.legendre.leggauss(3)
        ends = np.radians(edges[0]), np.sin(np.radians(lat)), z
        places, weights = [], []
        for j, end in enumerate(ends):
            half, middle = np.diff(end) / 2, (end[1:] + end[:-1]) / 2
            along = end[:-1] if k == j == 0 else end
            places.append(along if j == k else (middle[:, None] + half[:, None] * x).ravel())
            weights.append(np.ones(len(along)) if j == k else (half[:, None] * weight).ravel())
        grid = np.stack(np.meshgrid(*places, indexing="ij"))
        rate = np.array(RATES(grid.reshape(3, -1)))[k].reshape(grid.shape[1:])
        rate = rate * np.einsum("i,j,k->ijk", *weights)
        for j in {0, 1, 2} - {k}:
            shape = [*rate.shape[:j], -1, 3, *rate.shape[j + 1 :]]
            rate = rate.reshape(shape).sum(j + 1)
        return rate * EARTH**2

    by_fluxes = lv.GriddedField(lon, lat, z, fluxes=[through(k) for k in range(3)], **AROUND)
    assert by_fluxes.divergence < 1e-6
    x = by_potential.states_of(STARTS)
    exact = np.array(RATES(x.T)).T
    for field in (by_potential, by_fluxes):
        assert np.abs(field.velocity(x) - exact).max(0) / np.abs(exact).max(0) == pytest.approx(
            0, abs=2e-2
        )


def test_tracers_are_where_the_equations_on_the_sphere_take_them():
    """To a part of 1e-3 of the way on cells of 7.5 degrees; volume is kept."""
    field = read(data(48))
    x = field.states_of(STARTS)
    run = lv.ensemble(field, V(), t=(0, 60 * DAY), h=DAY / 2, x=x)
    for member, start in enumerate(x):
        exact = solved(lambda t, y: np.array(RATES(y)).ravel(), (0, 60 * DAY), start)[-1]
        apart = field.points_of(run.x[-1, member]) - field.points_of(exact)
        way = field.points_of(exact) - STARTS[member]
        assert np.abs(apart[:2]).max() < 1e-3 * np.abs(way[:2]).max()
        assert abs(apart[2]) < 1e-3 * abs(way[2])
    found = lv.analysis.determinant(field, V(), t=(0, 60 * DAY), h=DAY / 2, x=x[0]).observed
    assert found["defect"][-1] < 1e-12


def test_a_wrong_vertical_velocity_is_seen_though_it_is_small():
    axes, (u, v, w) = velocity(24)
    wrong = {"upside down": (u, v, -w), "exchanged": (v, u, w)}
    right = lv.GriddedField(*axes, velocity=(u, v, w), **AROUND)
    assert right.divergence < 1e-3
    for parts in wrong.values():
        with pytest.raises(ValueError, match="the field is not divergence-free"):
            lv.GriddedField(*axes, velocity=parts, **AROUND)


def test_without_a_vertical_velocity_it_follows_from_the_others():
    full, bare = read(data(48)), read(data(48, has_w=False))
    x = full.states_of(STARTS)
    assert bare.velocity(x) == pytest.approx(full.velocity(x), rel=2e-3)
    assert np.abs(full.velocity(x)[:, 2]).min() > 1e-7
    with pytest.raises(ValueError, match=r"no component w\nhint: choose one.* or give walls=\('d"):
        read(data(has_w=False), walls=("lat",))


def test_depths_are_as_the_data_set_says():
    plain = read(data())
    assert plain.coordinates == ("lon", "mu", "depth")
    x = plain.states_of(STARTS)
    rates = plain.velocity(x)
    assert rates == pytest.approx(np.array(RATES(x.T)).T, rel=0.1, abs=1e-8)
    for other in (data(unit="km", per_metre=1e-3), data(said="up")):
        assert read(other).velocity(x) == pytest.approx(rates, rel=1e-12)
        per_metre = np.array([1, 1, float(other.depth[-1] / data().depth[-1])])
        points = np.array(STARTS) * per_metre  # in the data set's unit, as are the results
        assert read(other).states_of(points) == pytest.approx(x, rel=1e-12)
        assert read(other).points_of(x) == pytest.approx(points, rel=1e-12)
        assert read(other).velocity_at(points) == pytest.approx(plain.velocity_at(STARTS))
    closed = xarray.concat([data(), data().isel(lon=[0]).assign_coords(lon=[360.0])], "lon")
    assert read(closed).velocity(x) == pytest.approx(rates, rel=1e-12)
    turned = data().assign_coords(lon=(data().lon + 180) % 360 - 180)
    assert read(turned).velocity(x) == pytest.approx(rates, rel=1e-12)
    region = read(data(48).sel(lon=slice(0, 90)), walls=("depth",))
    assert region.velocity(x[:1]) == pytest.approx(read(data(48)).velocity(x[:1]), rel=2e-2)


@pytest.mark.parametrize(("unit", "words"), [("dbar", "in 'dbar'"), ("1", "in '1'")])
def test_levels_that_are_no_lengths_are_refused(unit, words):
    levels = data(unit=unit).rename(depth="lev")
    levels["lev"].attrs["axis"] = "Z"
    with pytest.raises(ValueError, match=rf"levels along 'lev' {words}, which are no lengths"):
        read(levels, walls=("lat", "lev"))


def test_the_velocity_at_points_has_the_components_and_units_of_the_data():
    axes, parts = velocity(48)
    field = lv.GriddedField(*axes, velocity=parts, **AROUND)
    nodes_at = (2, 14, 6), (44, 4, 2)
    places = [[axis[k] for axis, k in zip(axes, node, strict=True)] for node in nodes_at]
    given = np.array([[part[node] for part in parts] for node in nodes_at])
    assert field.velocity_at(places) == pytest.approx(given, rel=5e-3, abs=1e-9)
    r, z = np.linspace(0.6, 1.4, 17), np.linspace(-0.4, 0.4, 17)
    phi = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    radius, _, height = np.meshgrid(r, phi, z, indexing="ij")
    swirl = 0 * radius, 1 / radius + height, 0 * radius
    torus = lv.GriddedField(
        r, phi, z, velocity=swirl, periodic=("phi",), coordinates="cylindrical"
    )  # fmt: skip
    assert torus.velocity_at([0.8, 1.0, 0.1]) == pytest.approx([0, 1.35, 0], abs=1e-3)
