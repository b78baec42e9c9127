"""Tables as functions of a model."""

import math
import pickle
import warnings

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, interp1d
from scipy.linalg import expm

import liouville as lv

X = np.array([0.0, 0.4, 0.5, 1.1, 1.6, 2.0])


def derivatives(spline, at):
    """Return value, slope and curvature of an expression at some places, a column each."""
    x = ca.SX.sym("x")
    curvature, slope = ca.hessian(spline(x), x)
    function = ca.Function("f", [x], [spline(x), slope, curvature])
    return np.array([[float(y) for y in function(place)] for place in at])


@pytest.mark.parametrize("ends", ["natural", "not-a-knot"])
def test_a_table_is_the_cubic_spline_and_goes_on_straight(ends):
    spline, wanted = lv.table(X, np.sin(X), ends), CubicSpline(X, np.sin(X), bc_type=ends)
    inside = np.linspace(0, 2, 41)[:-1]
    found = derivatives(spline, inside)
    for k in range(3):
        assert found[:, k] == pytest.approx(wanted(inside, k), abs=1e-14)
    assert spline(inside) == pytest.approx(found[:, 0], abs=1e-15)
    for end, place in ((0.0, -3.0), (2.0, 5.0)):
        slope = float(wanted(end, 1))
        line = float(wanted(end)) + slope * (place - end)
        assert derivatives(spline, [place])[0] == pytest.approx([line, slope, 0], abs=1e-13)
        assert spline(place) == pytest.approx(line)
    assert np.array_equal(pickle.loads(pickle.dumps(spline))(X), spline(X))
    assert np.isnan(spline(np.nan))


def test_a_periodic_table_repeats_itself_smoothly():
    x = np.linspace(0, 1, 17)
    y = np.sin(2 * np.pi * x)
    assert y[-1] != y[0]  # roundoff
    spline = lv.table(x, y, "periodic")
    assert spline.y[-1] == spline.y[0]
    with pytest.raises(ValueError, match="must end as it begins, with 0, not 1e-12"):
        lv.table(x, np.append(y[:-1], 1e-12), "periodic")
    at = np.array([-2.3, 0.0, 0.7, 5.7])
    assert spline(at) == pytest.approx(np.sin(2 * np.pi * at), abs=1e-4)
    left, right = derivatives(spline, [1 - 1e-9, 1 + 1e-9])
    assert left == pytest.approx(right, abs=1e-5)


def test_a_motion_under_a_tabulated_force_keeps_its_order():
    stiffness = lv.table(np.linspace(-2, 2, 9), np.linspace(-8, 8, 9))  # a straight line
    oscillator = lv.Lagrangian(
        lambda t, q, v, p: v[0] ** 2 / 2, force=lambda t, q, v, p: [-stiffness(q[0])], q=1
    )
    run = lv.integrate(oscillator, lv.Spark(4), t=(0, 3), h=0.05, q=[3.0], v=[0.0])
    assert run.q[:, 0] == pytest.approx(3 * np.cos(2 * run.t), abs=1e-12)


ROUGH = lv.table(
    np.linspace(0, 20, 4001), np.cumsum(np.random.default_rng(4).normal(0, 0.01, 4001))
)


def road(spline):
    """Return a wheel on a spring that follows a road, beside a load on it."""
    return lv.Lagrangian(
        lambda t, q, v, p: (
            (3 * v[0] ** 2 + v[1] ** 2) / 2
            - p.k * (q[0] - q[1]) ** 2 / 2
            - 200 * (q[1] - spline(p.speed * t)) ** 2
        ),
        force=lambda t, q, v, p: [-(v[0] - v[1]), v[0] - v[1]],
        params={"k": 50.0, "speed": 2.0},
        q=2,
    )


def test_a_table_takes_as_many_operations_whatever_its_points():
    few = lv.table(ROUGH.x[::400], ROUGH.y[::400])
    systems = [road(few), road(ROUGH)]
    lengths = [[len(tape) for tape in system.tapes.values()] for system in systems]
    assert lengths[0] == lengths[1]
    assert len(systems[1].tape("force")) < 40
    assert "search" in str(systems[1].tape("force"))
    # the numbers are in a pickle once, as they are and as CasADi's expressions have them
    small, large = (len(pickle.dumps(system)) for system in systems)
    assert large - small < 6 * ROUGH.x.nbytes * 4


def test_runs_on_a_table_are_those_of_its_polynomials():
    """By lanes, alone and from a pickle, with its derivatives by the parameters."""
    system, start = road(ROUGH), {"q": [0.0, 0.0], "v": [0.0, 0.0]}
    method, steps = lv.Spark(3), {"t": (0, 9), "h": 0.0025}  # a step a piece
    alone = lv.integrate(system, method, **steps, **start)
    again = lv.integrate(pickle.loads(pickle.dumps(system)), method, **steps, **start)
    members = lv.ensemble(system, method, **steps, q=np.zeros((20, 2)), v=[0.0, 0.0])
    assert again.q.tobytes() == alone.q.tobytes()
    assert all(members.q[:, k].tobytes() == alone.q.tobytes() for k in range(20))
    # by exponentials: position, velocity, and the road with its derivatives, piece by piece
    rates, motion = np.zeros((8, 8)), np.zeros(4)
    rates[:2, 2:4], rates[4:7, 5:] = np.eye(2), np.eye(3)
    pull = np.array([50, -50, 1, -1])
    rates[2:4, :4] = [-pull / 3, pull - [0, 400, 0, 0]]
    rates[3, 4] = 400
    spline, piece = CubicSpline(ROUGH.x, ROUGH.y, bc_type="natural"), expm(0.0025 * rates)
    for k in range(3600):
        height = [2**order * spline(ROUGH.x[k], order) for order in range(4)]
        motion = (piece @ [*motion, *height])[:4]
    assert alone.q[-1] == pytest.approx(motion[:2], abs=1e-11)
    tangent = lv.integrate(system, method, **steps, **start, tangents={"params.speed": 1.0})
    moved = [
        lv.integrate(system, method, **steps, **start, params={"speed": 2.0 + d}).q[-1]
        for d in (1e-6, -1e-6)
    ]
    slope = (moved[0] - moved[1]) / 2e-6
    assert tangent.tangents["params.speed"].states["q"][-1] == pytest.approx(slope, rel=1e-5)


def test_a_joint_follows_a_table_as_well_as_roundoff_allows():
    """Constraints with tables are compensated near their roots, as those of arithmetic are."""
    ends = np.sin(2 * np.pi * np.linspace(0, 1, 41))
    motion = lv.table(np.linspace(0, 1, 41), ends, "periodic")
    m = lv.bodies.Assembly(gravity=(0, 0, -9.81))
    m.body("cart", mass=2.0, inertia=(0.1, 0.2, 0.1), at=(0, 0, 0))
    m.prismatic("J", m.ground, "cart", axis=(0, 0, 1), motion=lambda t, params: motion(t))
    solution = lv.integrate(m.system(), lv.Spark(3), t=(0, 3), h=0.01, **m.start())
    inside = np.arange(0, 3, 0.01) + 0.0
    lift = solution.body("cart").position[:300, 2]
    assert lift == pytest.approx(motion(inside), abs=1e-14)
    pieces = CubicSpline(motion.x, motion.y, bc_type="periodic")
    force = 2.0 * (9.81 + pieces(solution.t % 1, 2))
    assert solution.joint("J").force[:-1, 2] == pytest.approx(force[:-1], abs=1e-6)


def test_the_third_derivative_of_a_table_is_of_its_argument():
    x = ca.SX.sym("x")
    third = ca.jacobian(ca.hessian(ROUGH(x), x)[0], x)
    assert ca.depends_on(third, x)
    spline = CubicSpline(ROUGH.x, ROUGH.y, bc_type="natural")
    values = ca.Function("f", [x], [third])
    for at in (0.3, 7.01, 19.9):
        assert float(values(at)) == pytest.approx(float(spline(at, 3)))
    assert float(ca.Function("f", [x], [ca.jacobian(third, x)])(0.3)) == 0.0


def test_numbers_of_all_sizes_are_in_a_table():
    x = np.array([0.0, 1e-3, 1.0, 2.0, 1e5, 2e5])
    for scale in (1e-200, 1.0, 1e200):
        spline = lv.table(x, scale * np.array([0.0, 1e-9, 1.0, -3.0, 5.0, 2.0]))
        t = ca.SX.sym("t")
        made = ca.Function("f", [t], [spline(t)])
        at = [-3.0, 5e-4, 0.7, 1.5, 777.0, 3e5]
        assert [float(made(y)) for y in at] == list(spline(at))


@pytest.mark.parametrize(
    ("x", "y", "ends", "error", "words"),
    [
        ([0, 1, 1], [0, 1, 2], "natural", ValueError, r"x\[1\] = 1 is followed by 1"),
        ([0, 1], [0, np.inf], "natural", ValueError, r"y\[1\] of a table must be finite"),
        (
            [0, 1],
            [0, 1, 2],
            "natural",
            ValueError,
            "x and y of a table must be as many, not 2 and 3",
        ),
        ([0], [1], "natural", ValueError, "a natural table must have 2 points or more, not 1"),
        ([0, 1, 2], [0, 1, 2], "not-a-knot", ValueError, "must have 4 points or more, not 3"),
        ([0, 1, 2], [0, 1, 2], "periodic", ValueError, "must end as it begins, with 0, not 2"),
        ([[0, 1]], [0, 1], "natural", ValueError, r"shape \(k,\), not \(1, 2\)"),
        ("ab", [0, 1], "natural", TypeError, "x of a table must be a 1-D array of numbers"),
        ([0, 1], [0, 1], "clamped", ValueError, "ends must be one of 'natural', 'not-a-knot'"),
    ],
)
def test_bad_tables_are_refused(x, y, ends, error, words):
    with pytest.raises(error, match=words):
        lv.table(x, y, ends)


def test_black_boxes_are_refused_with_a_table_in_mind():
    box = interp1d([0, 1], [0, 1])
    for function in (lambda x: math.exp(float(x)), CubicSpline([0, 1], [0, 1]), math.sin, box):
        with pytest.raises(ValueError, match=r"force|object arrays") as refused:
            lv.Lagrangian(
                lambda t, q, v, p: v[0] ** 2 / 2,
                force=lambda t, q, v, p, f=function: [f(q[0])],
                q=1,
            )
        told = str(refused.value) + "".join(getattr(refused.value, "__notes__", ()))
        assert "lv.table(x, y) stands in for it by its values" in told
    with pytest.raises(TypeError, match="numbers or CasADi's SX, not a MX"):
        lv.table([0, 1], [0, 1])(ca.MX.sym("x"))


def test_functions_of_numpy_are_taken_without_a_word():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        system = lv.Lagrangian(
            lambda t, q, v, p: v[0] ** 2 / 2 - np.interp(q[0], X, X**2) + np.sin(q[0]), q=1
        )
    assert system.coordinates == ("q0",)


@pytest.mark.parametrize("points", [([0, 1e300], [0, 1e300]), ([0, 1], [0, 1e308])])
def test_a_table_whose_slopes_overflow_is_refused(points):
    with pytest.raises(ValueError, match=r"a table with x from 0 to .* are not finite\nhint: take"):
        lv.table(*points)


GRID = np.array([0.0, 0.3, 0.5, 1.1, 1.6, 2.0]), np.linspace(-1, 1, 7), np.linspace(0, 3, 8)


def of_spline(axes, values, x, ends):
    """Evaluate by splines along one axis after another."""
    for nodes, each, end in zip(axes, x, ends, strict=True):
        values = CubicSpline(nodes, values, bc_type=end)(each)
    return values


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("ends", ["natural", "not-a-knot"])
def test_a_table_of_several_variables_is_the_product_of_splines(count, ends):
    axes, rng = GRID[:count], np.random.default_rng(0)
    values = rng.normal(size=[x.size for x in axes])
    table = lv.table(axes, values, ends)
    nodes = np.meshgrid(*axes, indexing="ij")
    assert table(*nodes) == pytest.approx(values, abs=1e-13)
    x = ca.SX.sym("x", count)
    made = table(*ca.vertsplit(x))
    function = ca.Function("f", [x], [made, ca.gradient(made, x)])
    for at in rng.uniform([0, -1, 0][:count], [2, 1, 3][:count], (10, count)):
        wanted = of_spline(axes, values, at, [ends] * count)
        assert table(*at) == pytest.approx(wanted, abs=1e-12)
        own, slopes = function(at)
        assert float(own) == pytest.approx(table(*at), abs=1e-14)
        for k in range(count):
            h = 1e-6 * np.eye(count)[k]
            slope = (table(*(at + h)) - table(*(at - h))) / 2e-6
            assert float(slopes[k]) == pytest.approx(slope, abs=1e-6 * np.abs(values).max() * 40)
    again = pickle.loads(pickle.dumps(table))
    assert np.array_equal(again(*nodes), table(*nodes))
    assert np.isnan(table(*[9.0] * count))


def test_a_table_may_be_periodic_along_one_of_its_axes():
    x, y = np.linspace(0, 2 * np.pi, 33), np.linspace(0, 1, 9)
    values = np.sin(x)[:, None] * (1 + y)
    table = lv.table((x, y), values, ends=("periodic", "natural"))
    at = np.array([-7.0, 0.3, 20.0])
    assert table(at, 0.5) == pytest.approx(1.5 * np.sin(at), abs=2e-5)
    assert np.isnan(table(at, 1.1)).all()
    assert repr(table) == "<Table of 33 x 9 points, periodic, natural>"


def test_a_table_of_several_variables_stands_in_models():
    """A potential of a mass point in the plane, of which the spline is exact."""
    x = np.linspace(-2, 2, 9)
    well = lv.table((x, x), (x[:, None] ** 2 + 2 * x**2) / 2, "not-a-knot")
    point = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + v[1] ** 2) / 2 - well(q[0], q[1]), q=("x", "y")
    )
    run = lv.integrate(point, lv.Spark(4), t=(0, 3), h=0.1, q=[1.0, 0.5], v=[0.0, 0.0])
    wanted = np.cos(3), 0.5 * np.cos(np.sqrt(2) * 3)
    assert run.q[-1] == pytest.approx(wanted, abs=1e-11)
    with pytest.raises(lv.IntegrationError):
        lv.integrate(point, lv.Spark(4), t=(0, 3), h=0.1, q=[1.0, 0.5], v=[9.0, 0.0])


@pytest.mark.parametrize(
    ("x", "y", "ends", "error", "words"),
    [
        ((GRID[0], GRID[1]), np.ones((7, 6)), "natural", ValueError, r"shape \(6, 7\), not of"),
        ((GRID[0], [0, 1, 2]), np.ones((6, 3)), "natural", ValueError, "four nodes at least"),
        ((GRID[0], [0, 2, 1, 3]), np.ones((6, 4)), "natural", ValueError, "which increase"),
        ((GRID[0], GRID[1]), np.full((6, 7), np.nan), "natural", ValueError, "some that are not"),
        ((GRID[0], GRID[1]), np.ones((6, 7)), "open", ValueError, "ends must be of 'natural'"),
        ((GRID[0], GRID[1]), np.ones((6, 7)), ["natural"], ValueError, "ends must be 2 words"),
        ((GRID[0], "ab"), np.ones((6, 7)), "natural", TypeError, "x of a table must be a 1-D"),
        (GRID[:2], GRID[0][:, None] + GRID[1], "periodic", ValueError, r"along x\[0\] it does not"),
    ],
)
def test_bad_tables_of_several_variables_are_refused(x, y, ends, error, words):
    with pytest.raises(error, match=words):
        lv.table(x, y, ends)
    with pytest.raises(TypeError, match="a table of 2 variables takes as many, not 1"):
        lv.table(GRID[:2], np.ones((6, 7)))(0.5)
