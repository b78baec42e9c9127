"""Gridded fields: what they interpolate, what their steps keep, and what is refused."""

import pickle
import warnings

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import liouville as lv
from liouville._systems.fields.gridded.interpolation import Interpolation

V = lv.VolumeSplitting
PERIOD = 2 * np.pi


def abc(x, y, z):
    return np.sin(z) + np.cos(y), np.sin(x) + np.cos(z), np.sin(y) + np.cos(x)


def waves(seed, points):
    """Return three sums of waves that belong to no plane alone."""
    rng = np.random.default_rng(seed)
    total = [0.0] * 3
    for _ in range(12):
        k, phase = rng.integers(-2, 3, 3), rng.uniform(0, PERIOD, 3)
        for j in range(3):
            total[j] = total[j] + rng.normal() * np.cos(np.tensordot(k, points, 1) + phase[j]) / 8
    return total


def mesh(*axes):
    return np.array(np.meshgrid(*axes, indexing="ij"))


def torus(n=16, degree=3, field=None):
    x = np.linspace(0, PERIOD, n, endpoint=False)
    given = (
        {"velocity": abc(*mesh(x, x, x))} if field is None else {"potential": field(mesh(x, x, x))}
    )
    return lv.GriddedField(x, x, x, periodic=("x", "y", "z"), degree=degree, **given)


@pytest.fixture(scope="module")
def mixed():
    """Return a field whose planes are not separable: their equations are not explicit."""
    return torus(16, 3, lambda points: waves(1, points))


@pytest.fixture(scope="module")
def box():
    """Return a box whose potential is not that of the gauge used."""
    x = np.linspace(0, 1, 13)
    s, (a, b, c) = lambda u: np.sin(np.pi * u), mesh(x, x, x)
    potential = s(b) * s(c) * np.cos(2 * a), s(a) * s(c) * np.cos(3 * b + 1), s(a) * s(b) * (1 + c)
    return lv.GriddedField(x, x, x, potential=potential, walls=("x", "y", "z"))


def gyre(degree=3, n=32, **given):
    x, y = np.linspace(0, 2, 2 * n + 1), np.linspace(0, 1, n + 1)
    a, b = mesh(x, y)
    u = -0.1 * np.pi * np.sin(np.pi * a) * np.cos(np.pi * b)
    v = 0.1 * np.pi * np.cos(np.pi * a) * np.sin(np.pi * b)
    return lv.GriddedField(x, y, velocity=(u, v), walls=("x", "y"), degree=degree, **given)


@pytest.mark.parametrize(("degree", "finest"), [(3, 1.3e-4), (5, 1.3e-7)])
def test_the_interpolated_velocity_has_the_order_of_its_splines(degree, finest):
    points = np.random.default_rng(0).uniform(-9, 9, (300, 3))
    exact = np.stack(abc(*points.T), axis=-1)
    errors = [abs(torus(n, degree).velocity(points) - exact).max() for n in (16, 32)]
    assert errors[1] < finest
    assert errors[0] / errors[1] > 0.8 * 2**degree


@pytest.mark.parametrize("name", ["mixed", "box"])
def test_the_divergence_vanishes_between_the_nodes(name, request):
    field = request.getfixturevalue(name)
    x, h = np.random.default_rng(0).uniform(0.1, 0.9, (50, 3)), 1e-3
    # a central difference of order 6 of a field that is a polynomial on each cell
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    total = sum(
        w * (field.velocity(x + k * h * e) - field.velocity(x - k * h * e))[:, i] / h
        for i, e in enumerate(np.eye(3))
        for k, w in weights.items()
    )
    size = abs(field.velocity(x)).max()
    assert np.median(abs(total)) < 1e-10 * size  # where no cell ends nearby


def test_the_velocity_is_the_curl_of_its_potential(mixed):
    x, h = np.random.default_rng(0).uniform(0, 6, (20, 3)), 1e-5
    d = [(mixed.potential(x + h * e) - mixed.potential(x - h * e)) / (2 * h) for e in np.eye(3)]
    curl = np.stack([d[1][:, 2] - d[2][:, 1], d[2][:, 0] - d[0][:, 2], d[0][:, 1] - d[1][:, 0]], 1)
    assert abs(curl - mixed.velocity(x)).max() < 1e-8


@pytest.mark.parametrize("scheme", ["S2", "BM4", "BM6"])
def test_a_step_has_determinant_one(scheme, mixed, box):
    for field, h, x in ((mixed, 0.2, [0.1, 0.2, 0.3]), (box, 0.05, [0.3, 0.6, 0.45])):
        found = lv.analysis.determinant(field, V(composition=scheme), t=(0, 50 * h), h=h, x=x)
        assert found.observed["defect"][-1] < 1e-12
        assert abs(found.observed["log_determinant"][-1]) < 1e-12


@pytest.mark.slow
def test_the_determinant_of_a_long_run_is_one(mixed, box):
    """In the plane, in space, and between walls."""
    for field, h, x in (
        (gyre(), 0.5, [0.3, 0.4]),
        (mixed, 0.2, [0.1, 0.2, 0.3]),
        (box, 0.02, [0.3, 0.6, 0.45]),
    ):
        found = lv.analysis.determinant(field, V(), t=(0, 10**5 * h), h=h, every=10**5, x=x)
        assert found.observed["defect"][-1] < 1e-12
        assert abs(found.observed["log_determinant"][-1]) < 1e-11


def test_orders_are_those_of_the_composition_up_to_the_degree():
    x, field = np.random.default_rng(0).uniform(0, 6, (8, 3)), torus(16, 5, lambda p: waves(1, p))
    for scheme, wanted in (("S2", 2), ("BM4", 4), ("BM6", 5.3)):
        ends = [
            lv.ensemble(field, V(composition=scheme), t=(0, 2), steps=n, every=n, x=x).x[-1]
            for n in (12, 24, 192)
        ]
        errors = [np.sqrt(np.mean((end - ends[-1]) ** 2)) for end in ends[:-1]]
        assert np.log2(errors[0] / errors[1]) > wanted - 0.4


@pytest.mark.parametrize("method", [V(), V(compensated=True), V(composition="Y4")])
def test_a_run_and_its_way_back(method, mixed):
    there = lv.integrate(mixed, method, t=(0, 4), h=0.1, x=[0.1, 0.2, 0.3]).x[-1]
    back = lv.integrate(mixed, method, t=(4, 0), h=0.1, x=there).x[-1]
    assert abs(back - [0.1, 0.2, 0.3]).max() < 1e-12


def test_walls_are_kept_exactly(box):
    x = np.random.default_rng(0).uniform(0, 1, (12, 3))
    x[0, 0], x[1, 1], x[2, 2], x[3] = 0, 1, 0, (0, 1, 0.4)
    found = lv.ensemble(box, V(), t=(0, 40), h=0.04, every=20, x=x)
    assert not found.failures
    assert found.x.min() >= 0
    assert found.x.max() <= 1
    on_walls = [found.x[:, 0, 0], found.x[:, 1, 1], found.x[:, 3, 0], found.x[:, 3, 1]]
    assert np.ptp(on_walls, axis=1).max() == 0
    assert np.ptp(found.x[:, 5:]) > 0.5


def test_a_steady_stream_function_does_not_drift():
    field, x = gyre(), np.array([[0.3, 0.4], [1.2, 0.7], [0.9, 0.05]])
    found = lv.ensemble(field, V(), t=(0, 2000), h=0.5, every=50, x=x)
    psi = field.potential(found.x)
    early, late = abs(psi[:20] - psi[0]).max(), abs(psi[-20:] - psi[0]).max()
    assert late < 1e-5
    assert late < 3 * early


def test_members_and_threads_change_no_bit(mixed):
    x = np.random.default_rng(0).uniform(0, 6, (37, 3))
    many = lv.ensemble(mixed, V(), t=(0, 2), h=0.1, every=5, x=x, threads=2)
    one = lv.integrate(mixed, V(), t=(0, 2), h=0.1, every=5, x=x[36])
    assert (many.x[:, 36] == one.x).all()
    assert (lv.ensemble(mixed, V(), t=(0, 2), h=0.1, every=5, x=x, threads=1).x == many.x).all()


def test_a_plan_is_the_run_and_comes_back_from_its_file(mixed, tmp_path):
    plan = lv.plan(mixed, h=0.1, x=[0.1, 0.2, 0.3])
    assert "plane of y and z with x frozen" in str(plan)
    plan.save(tmp_path / "plan.json")
    again = lv.FieldPlan.load(tmp_path / "plan.json")
    runs = [lv.integrate(mixed, m, t=(0, 1), h=0.1, x=[0.1, 0.2, 0.3]) for m in (V(), plan, again)]
    assert (runs[0].x == runs[1].x).all()
    assert (runs[0].x == runs[2].x).all()
    with pytest.raises(ValueError, match="the plan is not for a gridded field of 2 variables"):
        lv.integrate(gyre(), plan, t=(0, 1), h=0.1, x=[0.1, 0.2])


def test_a_tolerance_is_met(mixed):
    x = [0.1, 0.2, 0.3]
    found = lv.integrate(mixed, V(), t=(0, 2), rtol=1e-5, x=x)
    exact = lv.integrate(mixed, V(), t=(0, 2), steps=400, every=400, x=x).x[-1]
    assert abs(found.x[-1] - exact).max() < 1e-4


def test_a_tolerance_finds_no_step_that_is_too_long_for_the_grid():
    """At rest, or with a tolerance that would do with fewer steps than the equations of planes."""
    x, y = np.linspace(0, 2, 33), np.linspace(0, 1, 17)
    a, b = np.meshgrid(x, y, indexing="ij")
    psi = -0.1 * np.sin(np.pi * a) * np.sin(np.pi * b)
    field = lv.GriddedField(x, y, potential=psi, walls=("x", "y"))
    plan = lv.plan(field, V(), h=0.1, x=[0.5, 0.4])
    most = float(str(plan).partition("h up to ")[2].split()[0].rstrip(";,"))
    for start, rtol in (([0.0, 0.0], 1e-6), ([0.5, 0.4], 0.5)):
        found = lv.integrate(field, V(), t=(0, 40), rtol=rtol, x=start)
        assert 0.7 * most < 40 / found.stats["steps"] < most
    assert abs(field.potential(found.x[-1]) / field.potential(found.x[0]) - 1) < 0.5


def test_tangents_sections_and_pickles_go_with_grids(mixed, tmp_path):
    x, d, h = np.array([0.1, 0.2, 0.3]), np.array([1.0, -0.5, 0.2]), 1e-6
    run = lv.integrate(mixed, V(), t=(0, 2), h=0.1, x=x, tangents={"x": d})
    ends = [lv.integrate(mixed, V(), t=(0, 2), h=0.1, x=x + s * h * d).x[-1] for s in (1, -1)]
    assert abs(run.tangents["x"].x[-1] - (ends[0] - ends[1]) / (2 * h)).max() < 1e-7
    cut = lv.section(mixed, V(), t=(0, 60), h=0.1, plane="z", period=PERIOD, x=[x])
    turns = cut.x[:, 2] / PERIOD
    assert abs(turns - np.round(turns)).max() < 1e-12
    assert (pickle.loads(pickle.dumps(mixed)).velocity(x) == mixed.velocity(x)).all()
    stored = lv.integrate(mixed, V(), t=(0, 2), h=0.1, x=x, store=tmp_path / "run.zarr")
    assert (stored.x[-1] == run.x[-1]).all()


def test_fluxes_through_faces_are_kept_exactly():
    edges, s = np.linspace(0, 1, 13), np.sin
    psi = s(np.pi * edges)[:, None] * s(np.pi * edges) * (1 + edges[:, None])
    field = lv.GriddedField(
        edges, edges, fluxes=(np.diff(psi, axis=1), -np.diff(psi, axis=0)), walls=("x", "y")
    )
    assert field.divergence < 1e-13
    nodes = np.stack(mesh(edges, edges), axis=-1)
    assert abs(field.potential(nodes) - psi).max() < 1e-13


def test_a_mean_flow_goes_round():
    x = np.linspace(0, 1, 16, endpoint=False)
    u = np.full((16, 16), 0.3), 0.1 * np.sin(PERIOD * x)[:, None] * np.ones(16)
    field = lv.GriddedField(x, x, velocity=u, periodic=("x", "y"))
    assert np.allclose(field.mean, [0.3, 0], atol=1e-15)
    end = lv.integrate(field, V(), t=(0, 10), h=0.1, x=[0.2, 0.5]).x[-1]
    assert abs(end - [3.2, 0.5]).max() < 1e-6


def test_an_axis_may_fall_and_be_uneven():
    x = np.linspace(0, 1, 25) ** 1.5
    y = np.linspace(0, 1, 25)
    a, b = mesh(x, y)
    psi = np.sin(np.pi * a) * np.sin(np.pi * b)
    straight = lv.GriddedField(x, y, potential=psi, walls=("x", "y"))
    turned = lv.GriddedField(x, y[::-1], potential=psi[:, ::-1], walls=("x", "y"))
    points = np.random.default_rng(0).uniform(0, 1, (50, 2))
    assert abs(straight.velocity(points) - turned.velocity(points)).max() < 1e-11
    exact = np.pi * np.sin(np.pi * points[:, 0]) * np.cos(np.pi * points[:, 1])
    assert abs(straight.velocity(points)[:, 0] - exact).max() < 2e-3


def noisy(size):
    x = np.linspace(0, PERIOD, 16, endpoint=False)
    rng = np.random.default_rng(0)
    return x, [v + size * rng.normal(size=v.shape) for v in abc(*mesh(x, x, x))]


def test_a_small_divergence_is_taken_off_and_a_large_one_refused():
    x, velocity = noisy(1e-5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        quiet = lv.GriddedField(x, x, x, velocity=velocity, periodic=("x", "y", "z"))
    assert 1e-6 < quiet.divergence < 1e-3
    x, velocity = noisy(1e-2)
    with pytest.warns(UserWarning, match=r"the field was not divergence-free: \d\.\d% of it"):
        lv.GriddedField(x, x, x, velocity=velocity, periodic=("x", "y", "z"))
    x, velocity = noisy(0.3)
    with pytest.raises(ValueError, match=r"not divergence-free: .* more than 5\.0%"):
        lv.GriddedField(x, x, x, velocity=velocity, periodic=("x", "y", "z"))
    with pytest.warns(UserWarning, match="taken off"):
        lv.GriddedField(x, x, x, velocity=velocity, periodic=("x", "y", "z"), most_divergence=0.9)


def test_a_member_that_leaves_an_open_end_fails_by_name():
    x = np.linspace(0, 1, 9)
    a, _ = mesh(x, x)
    field = lv.GriddedField(x, x, velocity=(1 + 0 * a, 0.1 * np.sin(a)))
    starts = [[0.1, 0.5], [0.6, 0.5], [0.2, 0.4]]
    found = lv.ensemble(field, V(), t=(0, 0.6), h=0.05, x=starts)
    assert list(found.failures) == [1]
    assert "'x' has left the grid" in str(found.failures[1])


X = np.linspace(0, 1, 9)
ONE = np.ones((9, 9))


def small(**more):
    return lv.GriddedField(X, X, **{"velocity": (ONE, ONE), **more})


@pytest.mark.parametrize(
    ("call", "error", "sentence"),
    [
        (lambda: small(potential=ONE), TypeError, "by velocity=, potential= or fluxes=, by one"),
        (lambda: small(degree=4), ValueError, "degree must be 3 or 5, not 4"),
        (
            lambda: small(periodic="w"),
            ValueError,
            "periodic must be names of the axes x, y, not 'w'",
        ),
        (lambda: small(walls=True), TypeError, r"walls must be names of axes .*, not True"),
        (lambda: small(periodic="x", walls="x"), ValueError, "'x' is periodic and has walls"),
        (lambda: small(periodic={"x": 1.0}), ValueError, "'x' has period 1, and its nodes one of"),
        (
            lambda: small(velocity=(ONE,)),
            ValueError,
            "velocity must be 2 arrays, for x, y, not 1 array$",
        ),
        (
            lambda: small(velocity=ONE),
            ValueError,
            r"velocity must be 2 arrays, for x, y, not an array of shape \(9, 9\)",
        ),
        (
            lambda: small(velocity=(ONE, ONE[1:])),
            ValueError,
            r"'y' must have shape .*, not \(8, 9\)",
        ),
        (
            lambda: small(velocity=(np.round(np.sin(PERIOD * X), 9) * ONE, ONE), periodic="y"),
            ValueError,
            "leave out the last",
        ),
        (lambda: small(coordinates="polar"), ValueError, "coordinates must be one of cartesian"),
        (lambda: small(gauge="given"), ValueError, "gauge='given' is for potential="),
        (
            lambda: lv.GriddedField(X[:3], X, velocity=(ONE[:3],) * 2),
            ValueError,
            "'x' must have 5 nodes",
        ),
        (
            lambda: lv.integrate(gyre(), V(), t=(0, 9), h=3.0, x=[0.1, 0.2]),
            ValueError,
            r"a step of 3 is too long for this grid: .*\nhint: give h up to 2\.",
        ),
        (
            lambda: lv.integrate(gyre(), V(), t=(0, 1), h=0.1, x=[0.1, 1.2]),
            ValueError,
            "x of 'y' must be in the grid, 0 to 1, not 1.2",
        ),
        (
            lambda: lv.integrate(small(), V(diagonal="shears"), t=(0, 1), h=0.1, x=[0.1, 0.2]),
            TypeError,
            "diagonal= is for polynomial fields",
        ),
        (
            lambda: lv.integrate(small(), lv.Spark(), t=(0, 1), h=0.1, x=[0.1, 0.2]),
            TypeError,
            "Spark.*does not step gridded fields; methods that do: VolumeSplitting, a plan",
        ),
        (
            lambda: lv.integrate(small(), V(), t=(0, 1), h=0.1, x=[0.1, 0.2], params={"a": 1}),
            ValueError,
            "there is no parameter 'a'",
        ),
    ],
)
def test_what_makes_no_field_or_run_is_refused(call, error, sentence):
    with pytest.raises(error, match=sentence):
        call()


@pytest.mark.parametrize("p", [1, 2, 3, 4, 5])
def test_splines_are_those_of_scipy(p):
    """Through uneven nodes, few and many, along with other data; knots included."""
    rng = np.random.default_rng(p)
    for n in (p + 1, p + 2, 40, 3000):
        nodes, values = np.cumsum(rng.uniform(0.5, 1.5, n)), rng.standard_normal((n, 2, 3))
        found = Interpolation(nodes, p).spline(values)
        wanted = make_interp_spline(nodes, values, k=p)
        np.testing.assert_array_equal(found.t, wanted.t)
        np.testing.assert_allclose(found.c, wanted.c, rtol=0, atol=1e-13 * abs(wanted.c).max())
