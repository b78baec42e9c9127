"""Starts off their constraints are refused; `consistent` moves them there by the least change."""

import casadi as ca
import numpy as np
import pytest
from registry import nonlinear_reaction, printed, top, top_lagrangian

import liouville as lv
from liouville.problems import load

NAMES = ("ax", "ay", "bx", "by")


def rod(t, q, params):
    return {"rod": (ca.sumsqr(q[2:] - q[:2]) - params.l**2) / 2}


def two_masses(length=1.0):
    """Return two masses in the plane, one heavy and one light, at the ends of a rod."""
    return lv.Lagrangian(
        lambda t, q, v, params: params.a / 2 * ca.sumsqr(v[:2]) + params.b / 2 * ca.sumsqr(v[2:]),
        rod,
        q=NAMES,
        params={"a": 1e4, "b": 1.0, "l": length},
    )


def two_masses_by_momentum():
    return lv.Hamiltonian(
        lambda t, q, p, params: (
            ca.sumsqr(p[:2]) / (2 * params.a) + ca.sumsqr(p[2:]) / (2 * params.b)
        ),
        rod,
        q=NAMES,
        params={"a": 1e4, "b": 1.0, "l": 1.0},
    )


MASSES = np.diag([1e4, 1e4, 1.0, 1.0])
APART = {"q": [0.0, 0.0, 1.2, 0.1], "v": [0.0, 0.0, 1.0, 1.0]}
_RELATIVISTIC, _WIRE = load("relativistic_particle"), load("moving_wire")
_Y0, _Z0 = printed("heavy_top_quaternion", "y0", "z0")

# a system, a time, and a start off both constraints
STARTS = {
    "two masses": (two_masses(), 0.0, APART),
    "by momentum": (two_masses_by_momentum(), 0.0, {"q": APART["q"], "p": APART["v"]}),
    "top": (top(), 0.0, {"q": 1.1 * _Y0, "v": _Z0 + 0.1}),
    "moving wire": (_WIRE.system, 0.7, {"q": [0.3, -0.1], "v": [0.4, 0.2]}),
    "relativistic": (
        _RELATIVISTIC.system,
        0.0,
        {name: np.asarray(x) + 0.05 for name, x in _RELATIVISTIC.start.items()},
    ),
    "nonlinear in lam": (nonlinear_reaction(), 0.3, {"y": [0.6, 0.1, -0.9], "z": [0.1, 1, 0.2]}),
}


def residuals(system, t, start):
    """Return the residuals of both constraints at a start, by a run of one minute step."""
    run = lv.integrate(system, lv.Spark(1), t=(t, t + 1e-6), steps=1, **start)
    return run.residuals["constraint"][0], run.residuals["hidden"][0]


@pytest.mark.parametrize("name", STARTS)
def test_a_start_moved_onto_its_constraints_is_taken(name):
    system, t, start = STARTS[name]
    with pytest.raises(ValueError, match="start violates the constraint"):
        lv.integrate(system, lv.Spark(1), t=(t, t + 1), h=0.1, **start)
    moved = system.consistent(t=t, **start)
    assert list(moved) == list(start)
    for residual in residuals(system, t, moved):
        assert np.abs(residual).max() < 1e-15


@pytest.mark.parametrize("name", STARTS)
def test_moving_twice_is_moving_once(name):
    system, t, start = STARTS[name]
    once = system.consistent(t=t, **start)
    for key, value in system.consistent(t=t, **once).items():
        np.testing.assert_allclose(value, once[key], rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", STARTS)
def test_positions_held_do_not_move(name):
    system, t, start = STARTS[name]
    first, second = system.states
    on = {**start, first: system.consistent(t=t, **start)[first]}
    moved = system.consistent(t=t, hold=first, **on)
    np.testing.assert_array_equal(moved[first], on[first])
    assert np.abs(moved[second] - start[second]).max() > 1e-3
    assert np.abs(residuals(system, t, moved)[1]).max() < 1e-15
    with pytest.raises(ValueError, match=f"without hold='{first}'"):
        system.consistent(t=t, hold=first, **start)


@pytest.mark.parametrize("name", STARTS)
def test_velocities_or_momenta_held_do_not_move(name):
    system, t, start = STARTS[name]
    first, second = system.states
    moved = system.consistent(t=t, hold=second, **start)
    np.testing.assert_array_equal(moved[second], start[second])
    assert np.abs(moved[first] - start[first]).max() > 1e-3
    for residual in residuals(system, t, moved):
        assert np.abs(residual).max() < 2e-14


def test_with_velocities_held_linear_constraints_move_positions_only():
    tilted = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: {"plane": q[2] - q[0] / 10},
        q=3,
    )
    moved = tilted.consistent(hold="v", q=[0, 1, 1.01], v=[1, 2, 0.1])
    np.testing.assert_allclose(moved["q"], [0.1, 1, 0.01], rtol=0, atol=1e-15)
    with pytest.raises(ValueError, match=r"(?s)hidden constraint 'plane'.*without hold='v'"):
        tilted.consistent(hold="v", q=[0, 1, 1.01], v=[1, 2, 3])


@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_a_start_at_rest_is_held_at_rest(unit):
    rods = two_masses(unit)
    moved = rods.consistent(hold="v", q=unit * np.array(APART["q"]), v=np.zeros(4))
    np.testing.assert_array_equal(moved["v"], 0)
    np.testing.assert_allclose(
        moved["q"], rods.consistent(q=unit * np.array(APART["q"]), v=np.zeros(4))["q"], rtol=1e-14
    )
    grows = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: {"rod": ca.dot(q, q) - (1 + t) ** 2},
        q=2,
    )
    with pytest.raises(ValueError, match=r"no consistent start.*'hidden rod' vanishes"):
        grows.consistent(hold="v", q=[0.8, -0.5], v=[0, 0])


def test_the_heavy_mass_hardly_moves():
    moved = two_masses().consistent(**APART)
    shift, push = moved["q"] - APART["q"], moved["v"] - APART["v"]
    for change in (shift, push):
        np.testing.assert_allclose(1e4 * change[:2], -change[2:], rtol=1e-9, atol=1e-12)
        assert np.abs(change[:2]).max() < 3e-4 < 0.1 < np.abs(change[2:]).max()


def test_velocities_change_orthogonally_to_what_the_constraint_admits():
    def lagrangian(t, q, v, params):
        return (
            (2 + q[1] ** 2) * v[0] ** 2 + v[0] * v[1] / 2 + v[1] ** 2 + 3 * v[2] ** 2 + v[1] * v[2]
        )

    system = lv.Lagrangian(lagrangian, lambda t, q, params: ca.dot(q, q) - 1, q=3)
    q, v = np.array([0.6, 0.0, 0.8]), np.array([1.0, 2.0, 3.0])
    mass = np.array([[4.0, 0.5, 0.0], [0.5, 2.0, 1.0], [0.0, 1.0, 6.0]])
    change = system.consistent(hold="q", q=q, v=v)["v"] - v
    tangents = np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0]])
    assert np.abs(tangents @ mass @ change).max() < 1e-14
    assert np.abs(tangents @ change).max() > 0.5  # the plain metric would be another


def test_positions_change_orthogonally_to_second_order():
    weights = np.array([1.0, 100.0])
    ellipse = lv.Lagrangian(
        lambda t, q, v, params: (v[0] ** 2 + 100 * v[1] ** 2) / 2,
        lambda t, q, params: q[0] ** 2 + 4 * q[1] ** 2 - 1,
        q=2,
    )
    on = np.array([0.6, 0.4])
    gradient = np.array([2 * on[0], 8 * on[1]])
    tilt = []
    for size in (1e-2, 1e-3):
        off = on + size * gradient / weights
        q = ellipse.consistent(q=off, v=[0, 0])["q"]
        tilt.append(np.abs(q - on).max() / np.abs(off - on).max())
    assert tilt[0] < 0.05
    assert tilt[1] < 0.15 * tilt[0]


def test_momenta_move_as_velocities_do():
    q, v = _Y0, _Z0 + 0.1
    by_velocity = top().consistent(hold="q", q=q, v=v)["v"]
    symbols = ca.SX.sym("q", 4), ca.SX.sym("v", 4)
    momentum = ca.gradient(top_lagrangian(0, *symbols, None), symbols[1])
    momentum = ca.Function("momentum", symbols, [momentum])

    def hamiltonian(t, q, p, params):
        mass = ca.substitute(ca.jacobian(momentum(q, symbols[1]), symbols[1]), symbols[1], 0)
        v = ca.solve(mass, p)
        return ca.dot(p, v) - top_lagrangian(t, q, v, None)

    conjugate = lv.Hamiltonian(hamiltonian, lambda t, q, params: (ca.dot(q, q) - 1) / 2, q=4)
    p = conjugate.consistent(hold="q", q=q, p=momentum(q, v).full().ravel())["p"]
    np.testing.assert_allclose(p, momentum(q, by_velocity).full().ravel(), rtol=0, atol=1e-14)


def test_a_moving_constraint_takes_the_start_along():
    wall = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: {"wall": q[0] - params.speed * t},
        q=("x", "y"),
        params={"speed": 2.0},
    )
    rest = {"q": [0, 5], "v": [0, 1]}
    for t, speed in ((0.0, 2.0), (3.0, 2.0), (3.0, -1.0)):
        moved = wall.consistent(t=t, params={"speed": speed}, **rest)
        np.testing.assert_array_equal(moved["q"], [speed * t, 5])
        np.testing.assert_array_equal(moved["v"], [speed, 1])


def test_parameters_of_a_run_are_parameters_of_its_start():
    system = two_masses()
    long = system.consistent(params={"l": 2.0}, **APART)
    assert np.hypot(*(long["q"][2:] - long["q"][:2])) == pytest.approx(2, abs=1e-15)
    with pytest.raises(ValueError, match="start violates the constraint 'rod'"):
        lv.integrate(system, lv.Spark(1), t=(0, 1), h=0.1, **long)
    lv.integrate(system, lv.Spark(1), t=(0, 1), h=0.1, params={"l": 2.0}, **long)


def test_a_refusal_carries_the_size_and_a_hint_that_helps():
    system = two_masses()
    with pytest.raises(ValueError, match="start violates") as caught:
        lv.integrate(system, lv.Spark(1), t=(0, 1), h=0.1, **APART)
    sentence, hint = str(caught.value).splitlines()
    assert "constraint 'rod': |g(q)| = 2.2e-01 at t = 0, and at most 3." in sentence
    assert hint == "hint: system.consistent(q=..., v=...) moves a start onto its constraints"
    on = {**APART, "q": system.consistent(**APART)["q"]}
    with pytest.raises(ValueError, match=r"hidden constraint 'rod': \|g_t \+ g_q v\| = 1.1e\+00"):
        lv.integrate(system, lv.Spark(1), t=(0, 1), h=0.1, **on)


@pytest.mark.parametrize(("error", "is_taken"), [(1e-14, True), (1e-12, True), (1e-8, False)])
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e6])
def test_how_exact_a_start_must_be_does_not_depend_on_units(unit, error, is_taken):
    circle = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: ca.dot(q, q) - params.l**2,
        q=2,
        params={"l": unit},
    )
    start = {"q": [unit * (1 + error), 0], "v": [0, unit]}
    if is_taken:
        lv.integrate(circle, lv.Spark(2), t=(0, 1), h=0.1, **start)
    else:
        with pytest.raises(ValueError, match="start violates the constraint"):
            lv.integrate(circle, lv.Spark(2), t=(0, 1), h=0.1, **start)


def test_a_start_may_be_given_by_name_and_is_left_alone():
    system, q, v = two_masses(), np.array(APART["q"]), np.array(APART["v"])
    plain = system.consistent(q=q, v=v)
    named = system.consistent(
        q=dict(zip(NAMES, q, strict=True)), v=dict(zip(NAMES, v, strict=True))
    )
    for key, value in plain.items():
        np.testing.assert_array_equal(named[key], value)
    np.testing.assert_array_equal(q, APART["q"])
    np.testing.assert_array_equal(v, APART["v"])


def test_without_constraints_every_start_is_consistent():
    free = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2, q=2)
    for hold in (None, "q", "v"):
        moved = free.consistent(hold=hold, q=[1, 2], v=[3, 4])
        np.testing.assert_array_equal([moved["q"], moved["v"]], [[1, 2], [3, 4]])


def test_a_start_may_be_moved_to_zero():
    rod = lv.Structure([1.0, 2.0], constraint=lambda t, q, params: q[1] ** 2 / 2 + q[1])
    found = rod.consistent(q=[0.0, 0.01], v=[1.0, 0.01])
    assert np.abs(found["q"]).max() < 1e-15
    np.testing.assert_allclose(found["v"], [1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("at", [(0.73, 0.18), (0.67, 0.65), (0.88, 0.07)])
def test_a_start_of_zeros_is_taken_where_roundings_of_lengths_are_all_that_is_missing(at):
    """They are larger than any rounding of the coordinates, which have no size of their own."""
    length = np.hypot(*at)
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2,
        q=2,
        constraint=lambda t, q, params: ca.norm_2(q + ca.vertcat(*at)) - length,
    )
    found = system.consistent(q=[0.0, 0.0], v=[0.0, 0.0])
    np.testing.assert_allclose(found["q"], 0, atol=1e-15)


def circle(unit):
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: ca.dot(q, q) - params.l**2,
        q=2,
        params={"l": unit},
    )


@pytest.mark.parametrize("unit", [1e-18, 1e-9, 1.0, 1e9])
@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 2])
def test_a_start_in_any_unit_of_length_is_judged_alike(unit, turn):
    """On its constraints but for roundoff it is taken, a millionth of itself off it is not."""
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    call = {"t": (0, 1), "h": 0.1}
    if unit > 1e-14:
        for off in (1e-6, 1e-8):
            far, fast = unit * (1 + off) * along, unit * (across + off * along)
            with pytest.raises(ValueError, match="start violates the constraint"):
                lv.integrate(circle(unit), lv.Spark(2), **call, q=far, v=unit * across)
            with pytest.raises(ValueError, match="start violates the hidden constraint"):
                lv.integrate(circle(unit), lv.Spark(2), **call, q=unit * along, v=fast)
    for v in (unit * across, np.zeros(2), 1e-17 * unit * along):
        lv.integrate(circle(unit), lv.Spark(2), **call, q=unit * along * (1 + 1e-15), v=v)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_roundings_of_large_terms_are_no_violation(unit):
    """A circle through the origin: near it g is the difference of squares of its radius."""
    wheel = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: (q[0] - params.l) ** 2 + q[1] ** 2 - params.l**2,
        q=2,
        params={"l": unit},
    )
    for y in (0.0, 1e-9, 3e-7, 1e-3):
        x = 1 - np.sqrt(1 - y**2)
        start = {"q": unit * np.array([x, y]), "v": unit * np.array([y, 1 - x])}
        lv.integrate(wheel, lv.Spark(2), t=(0, 1), h=0.1, **start)
    off = {"q": unit * np.array([1e-4, 1e-3]), "v": unit * np.array([0, 1])}
    with pytest.raises(ValueError, match="start violates the constraint"):
        lv.integrate(wheel, lv.Spark(2), t=(0, 1), h=0.1, **off)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_lengths_of_bodies_are_judged_beside_angles_in_their_own_unit(unit):
    m = lv.bodies.Assembly(gravity=(0, 0, -unit))
    m.body("bar", mass=1.0, inertia=unit**2 * np.ones(3), at=(unit, 0, 0))
    m.spherical("A", m.ground, "bar", at=(0, 0, 0))
    system, start = m.system(), m.start()
    lv.integrate(system, lv.Spark(2), t=(0, 0.1), h=0.1, **start)
    off = np.array(start["q"])
    off[0] *= 1 + 1e-6
    with pytest.raises(ValueError, match="start violates the constraint 'A"):
        lv.integrate(system, lv.Spark(2), t=(0, 0.1), h=0.1, q=off, v=start["v"])


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_starts_of_semi_explicit_systems_are_judged_in_their_own_unit(unit):
    wheel = lv.SemiExplicit(
        field=lambda t, y, z, params: ca.vertcat(-y[1], y[0]) + y * z[0],
        constraint=lambda t, y, params: ca.dot(y, y) - params.l**2,
        y=2,
        z=1,
        params={"l": unit},
    )
    call = {"t": (0, 1), "h": 0.1, "z": [0.0]}
    lv.integrate(wheel, lv.Spark(2), y=[unit * (1 + 1e-15), 1e-16 * unit], **call)
    with pytest.raises(ValueError, match="start violates the constraint"):
        lv.integrate(wheel, lv.Spark(2), y=[unit * (1 + 1e-6), 0.0], **call)


@pytest.mark.parametrize(
    ("q", "v"),
    [([0.8, -0.5], [1, 0]), ([0.1, 0.25], [0.5, 1]), ([3, -0.02], [1, 2]), ([1e-3, -1e-3], [2, 1])],
)
def test_positions_are_found_from_afar_where_velocities_are_held(q, v):
    system = load("pendulum").system
    found = system.consistent(hold="v", q=q, v=v)
    np.testing.assert_array_equal(found["v"], v)
    assert abs(np.hypot(*found["q"]) - 1) < 1e-15
    assert abs(found["q"] @ found["v"]) < 1e-15
    lv.integrate(system, lv.Spark(2), t=(0, 0.1), h=0.1, **found)


@pytest.mark.parametrize("q", [[1e-3, 2e-3], [40.0, 30.0], [1e4, 0.0]])
def test_positions_are_found_from_afar(q):
    found = load("pendulum").system.consistent(q=q, v=[0.3, 0.2])
    np.testing.assert_allclose(found["q"], np.array(q) / np.hypot(*q), rtol=1e-14)


def test_a_start_without_a_solution_nearby_is_refused_still():
    ring = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2,
        lambda t, q, params: ca.dot(q, q) + params.c,
        q=2,
        params={"c": 1.0},
    )
    with pytest.raises(ValueError, match="no consistent start is near the one given"):
        ring.consistent(q=[0.3, 0.4], v=[0, 0])
    with pytest.raises(ValueError, match="no consistent start is near the one given"):
        load("pendulum").system.consistent(q=[0, 0], v=[1, 0])


def test_large_numbers_of_a_start_are_taken_without_a_warning():
    free = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2, q=("x",))
    assert lv.integrate(free, lv.Spark(2), t=(0, 1), steps=1, q=[1e300], v=[0.0]).q[-1] == 1e300


SPRING = lv.Lagrangian(lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2, q=("x",))


def test_a_start_is_one_mapping_keywords_or_both():
    run = {"t": (0, 1), "h": 0.1}
    wanted = lv.integrate(SPRING, lv.Spark(3), q=[1.0], v=[0.0], **run)
    for given in (
        {"start": {"q": [1.0], "v": [0.0]}},
        {"start": {"q": [1.0]}, "v": [0.0]},
        {"q": 1.0, "v": 0.0},
        {"start": {"q": np.float64(1.0), "v": 0}},
    ):
        found = lv.integrate(SPRING, lv.Spark(3), **run, **given)
        assert np.array_equal(found.q, wanted.q)
    many = lv.ensemble(SPRING, lv.Spark(3), start={"q": [1.0, 2.0], "v": 0.0}, **run)
    assert np.array_equal(many.q[:, 0], wanted.q)
    assert many.members == 2
    moved = lv.integrate(SPRING, lv.Spark(3), q=1, v=0, tangents={"q": 1.0}, **run)
    _, pullback = lv.vjp(SPRING, lv.Spark(3), wrt=["q"], start={"q": 1.0, "v": 0.0}, **run)
    cotangent = np.zeros((11, 1))
    cotangent[-1] = 1.0
    assert pullback(q=cotangent)["q"] == pytest.approx(moved.tangents["q"].q[-1], rel=1e-13)


@pytest.mark.parametrize(
    ("given", "stages"),
    [({"h": 0.1}, 3), ({"rtol": 1e-2}, 3), ({"rtol": 1e-6}, 5), ({"rtol": 1e-11}, 8)],
)
def test_the_method_by_default_is_spark_of_mechanics(given, stages):
    found = lv.integrate(SPRING, t=(0, 1), q=1.0, v=0.0, **given)
    wanted = lv.integrate(SPRING, lv.Spark(stages), t=(0, 1), q=1.0, v=0.0, **given)
    assert np.array_equal(found.q, wanted.q)
    assert found.message == f"the method taken is {lv.Spark(stages)!r}"
    named = lv.integrate(SPRING, "spark", t=(0, 1), q=1.0, v=0.0, **given)
    assert named.message == ""


def test_the_method_by_default_is_volume_splitting_of_fields():
    from liouville.problems import euler_top

    run = {"t": (0, 1), "h": 0.1, **euler_top.start}
    found = lv.integrate(euler_top.system, **run)
    assert np.array_equal(found.x, lv.integrate(euler_top.system, lv.VolumeSplitting(), **run).x)
    assert found.message == "the method taken is VolumeSplitting()"
    many = lv.ensemble(euler_top.system, "auto", t=(0, 1), h=0.1, x=[found.x[0]])
    assert many.message == found.message
