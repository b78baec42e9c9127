"""Land in three dimensions: islands, sea floors, what flows between coasts, data sets with both."""

import casadi as ca
import numpy as np
import pytest
from test_ocean_depth import STARTS, data, read

import liouville as lv

V = lv.VolumeSplitting
N = 24

pytestmark = pytest.mark.filterwarnings("ignore:the field was not divergence-free")


def cells_of(land):
    """Return the cells all of whose corners are land."""
    ends = slice(None, -1), slice(1, None)
    return np.logical_and.reduce([land[a, b, c] for a in ends for b in ends for c in ends])


def inland(field, cells, edges, count=2000):
    """Return the largest velocity in cells of land, their rims included."""
    rng = np.random.default_rng(0)
    places = np.argwhere(cells)[rng.integers(cells.sum(), size=count)]
    parts = rng.choice([0, 1e-9, 0.3, 0.8, 1 - 1e-9], (count, 3))
    nodes = [np.asarray(edge) for edge in edges]
    x = [
        e[i] + part * (e[i + 1] - e[i]) for e, i, part in zip(nodes, places.T, parts.T, strict=True)
    ]
    return np.abs(field.velocity(np.stack(x, axis=-1))).max()


def basin(t=None):
    """Return a gyre over a sea floor with an island, its axes and the cells of land."""
    x, z = np.linspace(0, 1, N + 1), np.linspace(0, 1, N // 2 + 1)
    X, Y, Z = np.meshgrid(x, x, z, indexing="ij")
    land = np.zeros(X.shape, dtype=bool)
    land[6:11, 8:13] = land[16:, 15:21] = True  # an island, and a coast
    land[14:20, 5:12, -5:] = land[..., -2:] = True  # a seamount, and the floor
    swirl = 1 + 0.3 * np.cos(np.pi * Z)
    u = np.pi * np.sin(np.pi * X) ** 2 * np.sin(2 * np.pi * Y) * swirl
    v = -np.pi * np.sin(2 * np.pi * X) * np.sin(np.pi * Y) ** 2 * swirl
    velocity = [np.where(land, np.nan, part) for part in (u, v, 0 * u)]
    if t is not None:
        velocity = [np.multiply.outer(1 + 0.2 * np.cos(t), part) for part in velocity]
    field = lv.GriddedField(
        x, x, z, t=t, velocity=velocity, walls=("x", "y", "z"), most_divergence=1
    )
    return field, (x, x, z), cells_of(land)


def test_nothing_flows_on_land_or_into_it():
    field, axes, cells = basin()
    assert field.islands == 1
    assert inland(field, cells, axes) < 1e-13
    x = np.random.default_rng(1).uniform(0, 1, (400, 3))

    def on_land(x):
        i = np.floor(x * [N, N, N // 2]).astype(int).clip(0, [N - 1, N - 1, N // 2 - 1])
        return cells[tuple(np.moveaxis(i, -1, 0))]

    x = x[~on_land(x)]
    h = 0.3 / field.steepest
    run = lv.ensemble(field, V(), t=(0, 1500 * h), h=h, every=50, x=x)
    assert not run.failures
    assert not on_land(run.x).any()
    assert np.abs(run.x[-1] - x).max() > 0.5
    found = lv.analysis.determinant(field, V(), t=(0, 100 * h), h=h, x=[0.2, 0.3, 0.4]).observed
    assert found["defect"].max() < 1e-12
    on_island = lv.integrate(field, V(), t=(0, 100 * h), h=h, x=[0.35, 0.45, 0.5])
    assert np.array_equal(on_island.x[-1], on_island.x[0])
    assert on_island.message == "the start is on land, where nothing moves"


def test_land_is_land_at_all_times():
    t = np.linspace(0, 6, 9)
    field, axes, cells = basin(t)
    still = basin()[0]
    for time in (0.0, 2.3, 6.0):
        at = lv.GriddedField.velocity(field, [0.2, 0.3, 0.4], time)
        factor = 1 + 0.2 * np.cos(time)
        assert at == pytest.approx(factor * still.velocity([0.2, 0.3, 0.4]), rel=2e-3)
    x = [(axis[4] + axis[3]) / 2 for axis in axes[:2]] + [0.99]
    run = lv.integrate(field, V(), t=(0, 6), steps=4000, every=4000, x=x)
    assert np.array_equal(run.x[-1], run.x[0])
    assert inland(field, cells, axes, 200) < 1e-13


def hills():
    """Return rates without a divergence around an island and over a hill, and how deep both are."""
    x, y, z = (ca.SX.sym(name) for name in "xyz")
    island = ca.fmax((x - 0.5) ** 2 + (y - 0.45) ** 2 - 0.15**2, 0)
    water = ca.fmax(0.8 - 0.3 * ca.exp(-((x - 0.2) ** 2 + (y - 0.7) ** 2) / 0.02) - z, 0)
    near = (island / (island + 0.02)) ** 3 * (water / (water + 0.1)) ** 3
    a, b, c = (ca.sin(np.pi * each) ** 2 for each in (x, y, z))
    potential = near * ca.vertcat(
        0.2 * ca.sin(2 * np.pi * y) * ca.sin(np.pi * z) * b * z,
        0.3 * ca.cos(np.pi * x) * a * c,
        (1 + 0.5 * z) * a * b,
    )
    by = ca.jacobian(potential, ca.vertcat(x, y, z))
    rates = ca.vertcat(by[2, 1] - by[1, 2], by[0, 2] - by[2, 0], by[1, 0] - by[0, 1])
    given = [ca.vertcat(x, y, z)]
    return ca.Function("f", given, [rates]), ca.Function("g", given, [ca.fmin(island, water)])


def test_a_flow_that_keeps_away_from_land_is_met():
    """The error falls by 3 or more with half the cells, whose strip at coasts gets smaller."""
    rates, depth = hills()
    q = np.random.default_rng(1).uniform(0, 1, (3, 4000))
    wanted, errors = np.array(rates(q)).T, []
    for n in (24, 48):
        x, z = np.linspace(0, 1, n + 1), np.linspace(0, 1, n // 2 + 1)
        nodes = np.stack(np.meshgrid(x, x, z, indexing="ij"))
        flat = nodes.reshape(3, -1)
        land = np.array(depth(flat)).reshape(nodes.shape[1:]) <= 0
        velocity = np.where(land, np.nan, np.array(rates(flat)).reshape(nodes.shape))
        field = lv.GriddedField(
            x, x, z, velocity=tuple(velocity), walls=("x", "y", "z"), most_divergence=1
        )
        assert field.islands == 1
        assert inland(field, cells_of(land), (x, x, z)) < 1e-13
        errors.append(np.sqrt(np.mean((field.velocity(q.T) - wanted) ** 2) / np.mean(wanted**2)))
    assert errors[1] < 0.08
    assert errors[0] / errors[1] > 3


@pytest.mark.parametrize("where", [0.5, 0.02, 0.95])
def test_a_channel_flows_by_islands_and_over_hills(where):
    """A mean flow goes round: what passes is the same at each section, and 0 on the floor."""
    n = 32
    x, y, z = (
        np.arange(n) / n,
        np.linspace(0, 1, n + 1),
        np.linspace(0, 0.5, 17),
    )
    X, Y, Z = np.meshgrid(x, y, z, indexing="ij")
    away = np.abs((X - where + 0.5) % 1 - 0.5)
    land = ((away < 0.08) & (np.abs(Y - 0.4) < 0.1)) | (
        0.42 - 0.2 * np.exp(-(away**2 + (Y - 0.7) ** 2) / 0.02) < Z
    )
    u = np.where(land, np.nan, 1.0)
    field = lv.GriddedField(
        x, y, z, velocity=(u, 0 * u, 0 * u), periodic=("x",), walls=("y", "z"), most_divergence=1
    )
    assert field.islands == 1
    edges = np.append(x, 1.0), y, z
    assert inland(field, cells_of(np.concatenate([land, land[:1]])), edges) < 1e-12
    points, weights = np.polynomial.legendre.leggauss(3)  # exact in each cell

    def through(at):
        parts = [
            ((e[1:] + e[:-1])[:, None] / 2 + np.diff(e)[:, None] / 2 * points).ravel()
            for e in (y, z)
        ]
        own = [(np.diff(e)[:, None] / 2 * weights).ravel() for e in (y, z)]
        places = np.stack(np.meshgrid([at], *parts, indexing="ij"), axis=-1)
        return own[0] @ field.velocity(places)[0, ..., 0] @ own[1]

    passes = [through(at) for at in (0.1, 0.37, 0.7)]
    assert passes == pytest.approx([field.mean[0] / 2] * 3, rel=1e-8)
    assert 0.3 < passes[0] < 0.4  # of 0.42 without hill and island
    x = [[0.5, y, z] for y in (0.0, 0.2, 0.8, 1.0) for z in (0.0, 0.1)]
    h = 0.4 / field.steepest
    run = lv.ensemble(field, V(), t=(0, 500 * h), h=h, x=x)
    assert not run.failures
    assert run.x[-1, ::2, 2].max() == 0.0


@pytest.mark.parametrize("periodic", [(), ("x",)])
def test_starts_on_walls_beside_joined_land_stay_there(periodic):
    """No velocity through a wall, not even a rounding error that grows until a tracer is out."""
    n = 12
    x, y, z = (
        np.linspace(0, 1, n + 1)[: n + (not periodic)],
        np.linspace(-0.3, 0.7, n + 1),
        np.linspace(0, 1, 9),
    )
    X, Y, Z = np.meshgrid(2 * np.pi * x, np.pi * (y + 0.3), np.pi * z, indexing="ij")
    land = np.zeros(X.shape, dtype=bool)
    land[1:4, :4, :6] = land[5:8, 5:8] = land[9:, :3, :3] = True  # fewer than three cells between
    u, v = np.sin(X) * np.cos(Y) + len(periodic), -np.cos(X) * np.sin(Y)
    field = lv.GriddedField(
        x, y, z, velocity=(u, v, 0.1 * np.sin(Z) * np.cos(X + Y)), mask=land, periodic=periodic,
        walls=[name for name in "xyz" if name not in periodic], most_divergence=1,
    )  # fmt: skip
    assert (abs(field.mean[0]) > 0.01) == bool(periodic)
    part = np.random.default_rng(0).uniform(0, 0.7, 5)
    ends = [[a, b, c] for a in (*x, *part) for b in y[[0, -1]] for c in (0.0, 0.3, 1.0)]
    ends += [[a, b, c] for a in x[[0, -1]] for b in (*y, *part) for c in (0.0, 0.3, 1.0)]
    ends = np.array(ends + [[a, b, c] for a in part for b in part for c in (0.0, 1.0)])
    h = 1.0 / field.steepest
    run = lv.ensemble(field, V(), t=(0, 200 * h), steps=200, every=200, x=ends)
    assert not run.failures
    rates = field.velocity(ends)
    for k, axis in enumerate((x, y, z)):
        if "xyz"[k] not in periodic:
            on = np.isin(ends[:, k], axis[[0, -1]])
            assert on.sum() > 30
            assert not rates[on, k].any()
            assert np.array_equal(run.x[-1][on, k], ends[on, k])


def test_a_field_that_keeps_off_land_by_itself_is_kept():
    """There is nothing to solve then: right sides are rounding errors."""
    x, z = np.linspace(0, 1, N + 1), np.linspace(0, 1, N // 2 + 1)
    X, Y, _ = np.meshgrid(x, x, z, indexing="ij")
    land = np.zeros(X.shape, dtype=bool)
    land[:5, :5] = True
    inner = [np.clip(2 * part - 1, 0, None) for part in (X, Y)]
    psi = np.prod([np.sin(np.pi * part) ** 4 for part in inner], axis=0)
    given = {"potential": (0 * X, 0 * X, psi), "walls": ("x", "y", "z")}
    plain, cut = (lv.GriddedField(x, x, z, mask=mask, **given) for mask in (None, land))
    at = np.random.default_rng(0).uniform(0, 1, (50, 3))
    assert np.abs(cut.velocity(at) - plain.velocity(at)).max() < 1e-3
    assert inland(cut, cells_of(land), (x, x, z)) == 0


def test_a_data_set_has_land_where_it_has_no_numbers():
    given = data(48)
    hill = 2500 + 1500 * np.cos(np.radians(given.lon)) ** 2 - 0 * given.lat
    hill = hill.where(~((given.lon > 120) & (given.lon < 150) & (abs(given.lat) < 15)), -1)
    sea = given.where(given.depth <= hill)
    for dataset in (sea, sea.drop_vars("wo"), sea.isel(depth=slice(None, None, -1))):
        field = read(dataset, most_divergence=1)
        assert field.islands == 1
        assert np.abs(field.velocity_at([135.0, 0, 500])).max() < 1e-13
        assert np.abs(field.velocity_at([[90, 10, 3500], [270, -30, 3900]])).max() < 1e-13
        assert np.abs(field.velocity_at(STARTS)).max() > 0.01
    closed = read(sea, most_divergence=1)
    run = lv.ensemble(closed, V(), t=(0, 10 * 86400), h=3600, x=closed.states_of(STARTS))
    assert not run.failures


def test_land_that_cannot_be_is_refused():
    x, z = np.linspace(0, 1, 9), np.linspace(0, 1, 9)
    u = np.ones((9, 9, 9))
    land = np.zeros(u.shape, dtype=bool)
    land[3:6, 3:6, 4:] = True
    box = {"velocity": (u, 0 * u, 0 * u), "mask": land, "most_divergence": 1}
    with pytest.raises(ValueError, match=r"'z' has no walls, .*\nhint: give walls=\('x', 'z'\)"):
        lv.GriddedField(x, x, z, walls=("x",), **box)
    lv.GriddedField(x, x, z, walls=("x", "y", "z"), **box)
    lv.GriddedField(x, x, z, walls=("x", "y", "z"), **(box | {"mask": land[..., ::-1]}))
    floating = land.copy()
    floating[3:6, 3:6, 7:] = False
    floating[6:, 6:, 6:] = True
    sentence = (
        r"water between it and the floor at 'z' = 1, in 4 columns, first at \(x, y\) = \(0.375, 0.3"
    )
    with pytest.raises(ValueError, match=sentence):
        lv.GriddedField(x, x, z, walls=("x", "y", "z"), **(box | {"mask": floating}))
    with pytest.raises(ValueError, match=r"at 'z' = 0, .*\nhint: mask= this water too"):
        lv.GriddedField(x, x, z, walls=("z",), **(box | {"mask": floating[..., ::-1]}))
    ring = np.zeros((8, 9, 9), dtype=bool)
    ring[:, 3:6, 4:] = True
    v = np.ones(ring.shape)
    with pytest.raises(ValueError, match=r"all round 'x', and a mean flow along 'y'\nhint: give"):
        lv.GriddedField(
            x[:-1], x, z, velocity=(0 * v, v, 0 * v), mask=ring, periodic=("x",), walls=("z",),
            most_divergence=1,
        )  # fmt: skip
