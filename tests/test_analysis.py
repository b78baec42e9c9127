"""Equilibria, linearisations, modes, inverse dynamics and balances of power, by closed forms.

One file, since they are asked of the same few mechanisms.
"""

import pickle
import subprocess
import sys
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from numpy.polynomial.laguerre import lagroots
from scipy.linalg import expm

import liouville as lv
from liouville import problems
from liouville._systems import Mechanics
from liouville.analysis.point import Point

G = 9.81


def quadratic(t, q, v, params):
    return ca.dot(v, v) / 2


def hanging(count, ends=None, length=1.0):
    """Build beads on a string from the origin, hanging or with its far end at a place."""

    def lagrangian(t, q, v, params):
        return ca.dot(v, v) / 2 - G * ca.sum1(q[1::2])

    def constraint(t, q, params):
        beads = [ca.SX([0, 0]), *(q[2 * k : 2 * k + 2] for k in range(count))]
        beads += [] if ends is None else [ca.SX(ends)]
        return [(ca.sumsqr(b - a) - length**2) / 2 for a, b in pairwise(beads)]

    return lv.Lagrangian(lagrangian, constraint, q=2 * count)


PENDULUM = hanging(1)
DOWN, UP = [0.0, -1.0], [0.0, 1.0]


def four_bar(kind="planar", **motor):
    """Draw a four-bar linkage of planar or spatial bodies, with a motor at the crank."""
    points = {"A": (0.0, 0.0), "B": (0.0, 0.5), "C": (0.9, 0.9), "D": (1.1, 0.0)}
    m = lv.bodies.Assembly(gravity=(0, -G, 0))
    for name, (a, b) in {"crank": "AB", "coupler": "BC", "rocker": "DC"}.items():
        along, middle = np.subtract(points[b], points[a]), np.add(points[a], points[b]) / 2
        length, angle = np.hypot(*along), np.arctan2(along[1], along[0])
        inertia = length**3 / 6
        if kind == "planar":
            m.planar_body(name, mass=2 * length, inertia=inertia, at=middle, angle=angle)
        else:
            turn = (np.cos(angle / 2), 0, 0, np.sin(angle / 2))
            inertia = (1e-3, inertia, inertia)
            m.body(name, mass=2 * length, inertia=inertia, at=(*middle, 0), rotation=turn)
    pairs = {"A": "ground crank", "B": "crank coupler", "C": "coupler rocker", "D": "ground rocker"}
    for name, pair in pairs.items():
        own = motor if name == "A" else {"damping": 0.5} if name == "C" else {}
        m.revolute(name, *pair.split(), at=(*points[name], 0), axis=(0, 0, 1), **own)
    return m


@pytest.fixture(scope="module")
def linkages():
    """Give the four-bar without a motor, planar and spatial, with starts."""
    drawn = {kind: four_bar(kind) for kind in ("planar", "spatial")}
    return {kind: (m.system(), m.start(rates={"A": 2.0})) for kind, m in drawn.items()}


# Linearisations


def test_the_stiffness_of_a_pendulum_is_in_its_multiplier():
    linear = lv.analysis.linearize(PENDULUM, q=DOWN)
    assert linear.mass == pytest.approx(1)
    assert linear.damping == pytest.approx(0, abs=1e-15)
    assert linear.stiffness == pytest.approx(G, rel=1e-14)
    assert linear.lam == pytest.approx(G)
    assert not np.abs(linear.acceleration).max() > 1e-14
    assert "1 free" in repr(linear)


def test_a_moving_pendulum_in_its_own_coordinate():
    angle, rate = 0.7, 1.3
    sin, cos = np.sin(angle), np.cos(angle)
    start = {"q": [sin, -cos], "v": [rate * cos, rate * sin]}
    state = lv.analysis.linearize(PENDULUM, independent=["q0"], **start).state
    # x'' = -x (g c + x'^2 / c^2) with c^2 = 1 - x^2
    x, speed = sin, rate * cos
    of_x = -(G * cos + speed**2 / cos**2) - x * (-G * x / cos + 2 * x * speed**2 / cos**4)
    wanted = [[0, 1], [of_x, -2 * x * speed / cos**2]]
    assert state == pytest.approx(np.array(wanted), abs=1e-13)


MOVING = (
    "hinged_fourbar",
    "relativistic_particle",
    "moving_wire",
    "rolling_disk",
    "kepler_on_sphere",
    "rolling_ball",
)


def test_a_cyclic_coordinate_of_a_steady_motion_has_zeros_without_damping():
    """A conical pendulum seen from a frame that turns with it, at 5 rad/s."""
    height = G / 25
    turning = lv.Lagrangian(
        lambda t, q, v, params: (
            (v[0] ** 2 + ca.sin(q[0]) ** 2 * (v[1] + 5) ** 2) / 2 + G * ca.cos(q[0])
        ),
        q=("from the vertical", "about it"),
    )
    found = lv.analysis.modes(turning, q=[np.arccos(height), 0], v=[0, 0])
    wanted = 5 * np.sqrt(1 + 3 * height**2)
    np.testing.assert_allclose(found.angular_frequencies, [0, 0, wanted], rtol=1e-12)
    np.testing.assert_array_equal(found.eigenvalues[:2], 0)
    assert np.abs(found.damping_ratios).max() < 1e-12
    assert not found.unstable


@pytest.mark.parametrize("length", [1.0, 1e-9, 1e11])
def test_equilibria_hold_their_constraints_in_any_unit(length):
    system, rough = hanging(2, length=length), length * np.array([0.5, -0.8, 0.3, -1.5])
    rest = lv.analysis.equilibrium(system, q=rough)
    np.testing.assert_allclose(rest.start["q"] / length, [0, -1, 0, -2], rtol=0, atol=1e-12)
    over = lv.analysis.equilibrium(
        system, q=length * np.array([0.05, 0.99, 0.1, 1.9]), stable=False
    )
    np.testing.assert_allclose(over.start["q"] / length, [0, 1, 0, 2], rtol=0, atol=1e-12)


@pytest.mark.parametrize("length", [1.0, 1e-9])
def test_equilibria_hold_lengths_far_below_angles(length):
    rod = lv.Lagrangian(
        lambda t, q, v, params: (
            ca.sumsqr(v[:2]) / 2
            + (length * v[2]) ** 2 / 2
            - G * q[1]
            - G * length / 4 * (q[2] - 1) ** 2
        ),
        lambda t, q, params: [q[0] - length * ca.sin(q[2]), q[1] + length * ca.cos(q[2])],
        q=("x", "y", "angle"),
    )
    x, y, angle = lv.analysis.equilibrium(rod, q=[0.3 * length, -0.7 * length, 0.5]).start["q"]
    assert np.sin(angle) + (angle - 1) / 2 == pytest.approx(0, abs=1e-12)
    assert [x / length, y / length] == pytest.approx([np.sin(angle), -np.cos(angle)], abs=1e-15)


@pytest.mark.parametrize("name", MOVING)
def test_a_linearisation_is_the_difference_of_motions_nearby(name):
    problem = problems.load(name)
    system, t = problem.system, problem.interval[0] + 0.3
    assert isinstance(system, Mechanics)
    start = system.consistent(t=t, **problem.start)
    linear = lv.analysis.linearize(system, t=t, **start)
    y, z = (start[state] for state in system.states)
    n, (_, free) = len(y), linear.stiffness.shape

    def rates(step):
        # states a step away along the tangent miss the constraints by its square, which is the same
        # on both sides
        there = Point(system, t, y + step[:n], z + step[n:], system.values(None))
        return np.append(there.velocity, there.motion()[0])

    h, tangent = 1e-5, linear.tangent
    slopes = np.array([(rates(h * x) - rates(-h * x)) / (2 * h) for x in tangent.T]).T
    wanted = np.vstack([linear.basis.T @ slopes[:n], tangent[n:, free:].T @ slopes[n:]])
    assert linear.state == pytest.approx(wanted, abs=1e-7 * max(1, np.abs(wanted).max()))


def test_independent_coordinates_have_to_tell_the_freedoms_apart():
    with pytest.raises(ValueError, match="2 independent coordinates are named, and 1 are free"):
        lv.analysis.linearize(PENDULUM, independent=["q0", "q1"], q=DOWN)
    with pytest.raises(ValueError, match="'q1' do not tell the 1 freedoms apart"):
        lv.analysis.linearize(PENDULUM, independent=["q1"], q=DOWN)
    with pytest.raises(TypeError, match=r"independent=\['q0'\]"):
        lv.analysis.linearize(PENDULUM, independent="q0", q=DOWN)
    with pytest.raises(ValueError, match="the system has no coordinate 'x'"):
        lv.analysis.linearize(PENDULUM, independent=["x"], q=DOWN)


def test_bad_states_and_systems_are_refused():
    with pytest.raises(ValueError, match=r"violates the constraint(.|\n)*consistent"):
        lv.analysis.linearize(PENDULUM, q=[0.5, 0.5])
    with pytest.raises(ValueError, match="leave nothing to move"):
        lv.analysis.linearize(lv.Lagrangian(quadratic, lambda t, q, p: q[0], q=1), q=[0.0])
    with pytest.raises(TypeError, match="modes takes a mechanical system, not a PolynomialField"):
        lv.analysis.modes(problems.load("euler_top").system, q=[0.0])
    with pytest.raises(ValueError, match="shape"):
        lv.analysis.equilibrium(PENDULUM, q=[0.0])
    with pytest.raises(TypeError, match="'x' is no start value"):
        lv.analysis.modes(PENDULUM, x=[0.0])
    with pytest.raises(ValueError, match="no parameter 'h'"):
        lv.analysis.modes(PENDULUM, q=DOWN, params={"h": 1.0})


# Modes


def test_a_hanging_string_of_beads_has_the_roots_of_laguerre():
    count = 8
    chain = hanging(count)
    straight = np.array([[0.0, -k - 1.0] for k in range(count)])
    modes = lv.analysis.modes(chain, q=straight.ravel())
    wanted = np.sqrt(G * lagroots([0] * count + [1]))
    assert modes.angular_frequencies == pytest.approx(wanted, rel=1e-12)
    assert modes.hertz == pytest.approx(wanted / (2 * np.pi), rel=1e-12)
    assert not modes.damping_ratios.any()
    assert not modes.unstable
    sideways = modes.shapes.reshape(count, 2, -1)
    assert not np.abs(sideways[:, 1]).max() > 1e-12
    assert sideways[:, 0].T @ sideways[:, 0] == pytest.approx(np.eye(count), abs=1e-12)
    assert (np.max(modes.shapes, axis=0) == np.abs(modes.shapes).max(axis=0)).all()


def test_constraints_given_twice_change_nothing():
    def twice(t, q, params):
        return [ca.dot(q, q) - 1, 3 * ca.dot(q, q) - 3]

    same = lv.Lagrangian(lambda t, q, v, p: ca.dot(v, v) / 2 - G * q[1], twice, q=2)
    found = lv.analysis.equilibrium(same, q=[0.5, 0.1])
    assert found.start["q"] == pytest.approx(DOWN, abs=1e-12)
    assert lv.analysis.modes(same, **found.start).angular_frequencies == pytest.approx(np.sqrt(G))


def test_damping_and_unstable_modes_are_told():
    oscillator = lv.Structure([1.0, 1.0, 1.0], [4.0, 4.0, -4.0], [0.4, 5.0, 0.0])
    modes = lv.analysis.modes(oscillator, q=[0, 0, 0])
    order = np.lexsort((modes.damping_ratios, modes.angular_frequencies.round(9)))
    wanted = [-2, -0.2 + 2j * np.sqrt(0.99), 2, -1, -4]
    assert sorted(modes.eigenvalues, key=str) == pytest.approx(sorted(wanted, key=str))
    assert len(order) == 5
    (k,) = modes.unstable
    assert modes.eigenvalues[k] == pytest.approx(2)
    under = int(np.argmax(modes.eigenvalues.imag))
    assert modes.damping_ratios[under] == pytest.approx(0.1)
    assert modes.damped_hertz[under] == pytest.approx(np.sqrt(0.99) / np.pi)
    assert "1 of them unstable" in repr(modes)
    assert "unstable" in modes._repr_html_()
    up = lv.analysis.modes(PENDULUM, q=UP)
    assert up.eigenvalues == pytest.approx(np.sqrt(G))
    assert up.unstable == (0,)


def test_a_hamiltonian_in_a_magnetic_field_has_the_frequencies_of_fock():
    field, well = 1.3, 2.0

    def hamiltonian(t, q, p, params):
        kinetic = p - field / 2 * ca.vertcat(-q[1], q[0])
        return ca.dot(kinetic, kinetic) / 2 + well**2 * ca.dot(q, q) / 2

    system = lv.Hamiltonian(hamiltonian, q=2)
    rest = lv.analysis.equilibrium(system, q=[0.1, 0.2], p=[0.3, -0.2])
    assert rest.start["p"] == pytest.approx([0, 0], abs=1e-12)
    heavy = lv.Hamiltonian(
        lambda t, q, p, params: ca.dot(p, p) / 6 + 3 * G * q[1],
        lambda t, q, params: ca.dot(q, q) - 1,
        q=2,
    )
    swing = lv.analysis.modes(heavy, q=DOWN)
    assert swing.angular_frequencies == pytest.approx(np.sqrt(G))
    assert swing.shapes[:, 0] == pytest.approx([1 / np.sqrt(3), 0])
    held = lv.Hamiltonian(hamiltonian, lambda t, q, p: {"line": q[1] - 1}, q=2)
    rest_of_it = lv.analysis.equilibrium(held, q=[0.1, 0.2], p=[0.3, -0.2]).start
    # without velocity the momentum is that of the field
    assert rest_of_it["p"] == pytest.approx([-field / 2, 0], abs=1e-12)
    assert lv.analysis.modes(held, **rest_of_it).angular_frequencies == pytest.approx(well)
    found = lv.analysis.modes(system, **rest.start)
    middle = np.hypot(well, field / 2)
    assert found.angular_frequencies == pytest.approx([middle - field / 2, middle + field / 2])


def test_a_sleigh_in_straight_motion():
    mass, inertia, ahead, speed = 1.5, 0.4, 0.6, 2.0

    def lagrangian(t, q, v, params):
        x, y = v[0] - ahead * v[2] * ca.sin(q[2]), v[1] + ahead * v[2] * ca.cos(q[2])
        return mass * (x**2 + y**2) / 2 + inertia * v[2] ** 2 / 2

    def blade(t, q, v, params):
        return ca.sin(q[2]) * v[0] - ca.cos(q[2]) * v[1]

    sleigh = lv.Lagrangian(lagrangian, nonholonomic=blade, q=("x", "y", "heading"))
    turn = mass * ahead * speed / (inertia + mass * ahead**2)
    linear = lv.analysis.linearize(sleigh, q=[0, 0, 0], v=[speed, 0, 0])
    assert linear.mass.shape == (2, 2)
    assert linear.stiffness.shape == (2, 3)
    wanted = [-turn, 0, 0, 0, 0]
    assert np.sort(np.linalg.eigvals(linear.state).real) == pytest.approx(wanted, abs=1e-7)
    back = lv.analysis.modes(sleigh, q=[0, 0, 0], v=[-speed, 0, 0])
    assert back.eigenvalues[list(back.unstable)] == pytest.approx(turn)


def test_a_cantilever_of_hermite_elements():
    count = 12
    length = 1 / count
    own = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]], float)
    heavy = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    scale = np.diag([1, length] * 2)
    stiffness, mass = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for k in range(count):
        at = slice(2 * k, 2 * k + 4)
        stiffness[at, at] += scale @ own @ scale / length**3
        mass[at, at] += scale @ np.array(heavy) @ scale * length / 420
    load = np.zeros(2 * count)
    load[-2] = -0.1
    beam = lv.Structure(mass[2:, 2:], stiffness[2:, 2:], force=load)
    rest = lv.analysis.equilibrium(beam, q=np.zeros(2 * count))
    assert rest.is_stable
    assert rest.start["q"][-2] == pytest.approx(-0.1 / 3, rel=1e-10)
    found = lv.analysis.modes(beam, count=2, **rest.start)
    assert found.angular_frequencies == pytest.approx([1.8751040687**2, 4.6940911330**2], rel=2e-5)


LARGE = 1200


def springs(free=False, **more):
    """Build a long row of masses between springs, with walls at its ends or free."""
    ends = np.full(LARGE, 2.0)
    ends[[0, -1]] -= free
    row = np.full(LARGE - 1, -1.0)
    return lv.Structure(np.ones(LARGE), sp.diags([row, ends, row], [-1, 0, 1]), **more)


def test_a_structure_that_rests_undeformed_needs_no_start():
    frame = lv.Structure([2.0, 1.0], [[30.0, -10.0], [-10.0, 10.0]])
    found = lv.analysis.modes(frame)
    assert np.allclose(
        found.angular_frequencies**2, sorted(np.linalg.eigvals([[15, -5], [-10, 10]]))
    )
    assert np.array_equal(lv.analysis.equilibrium(frame).start["q"], [0, 0])
    assert lv.analysis.linearize(frame).stiffness.shape == (2, 2)
    loaded = lv.Structure([2.0, 1.0], [[30.0, -10.0], [-10.0, 10.0]], force=np.array([1.0, 0.0]))
    with pytest.raises(ValueError, match="no equilibrium"):
        lv.analysis.modes(loaded)


def test_large_structures_take_sparse_matrices():
    rest, k = np.zeros(LARGE), np.arange(1, 5)
    wanted = 2 * np.sin(k * np.pi / (2 * LARGE + 2))
    modes = lv.analysis.modes(springs(), count=4, q=rest)
    assert modes.angular_frequencies == pytest.approx(wanted, rel=1e-9)
    assert modes.shapes.T @ modes.shapes == pytest.approx(np.eye(4), abs=1e-9)
    # both masses at the ends held, one of them twice
    held = lambda t, q, p: [q[0], q[LARGE - 1], 2 * q[0]]  # noqa: E731
    modes = lv.analysis.modes(springs(free=True, constraint=held), count=4, q=rest)
    wanted = 2 * np.sin(k * np.pi / (2 * LARGE - 2))
    assert modes.angular_frequencies == pytest.approx(wanted, rel=1e-9)
    free = lv.analysis.modes(springs(free=True), count=3, q=rest)
    wanted = 2 * np.sin(np.arange(3) * np.pi / (2 * LARGE))
    assert free.angular_frequencies == pytest.approx(wanted, rel=1e-9, abs=1e-9)
    damped = lv.analysis.modes(springs(damping=np.full(LARGE, 1e-3)), count=2, q=rest)
    sizes = 2 * np.sin(k[:2] * np.pi / (2 * LARGE + 2))
    assert damped.damping_ratios == pytest.approx(0.5e-3 / sizes, rel=1e-6)
    assert damped.angular_frequencies == pytest.approx(sizes, rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_modes_of_a_large_structure_have_their_multiplicities(damping):
    """Forty equal springs in parallel for each frequency: one Krylov space sees few of them."""
    stiffness = np.repeat(1.0 + np.arange(LARGE // 40), 40) ** 2
    system = lv.Structure(np.ones(LARGE), stiffness, damping=np.full(LARGE, damping))
    found = lv.analysis.modes(system, count=45, q=np.zeros(LARGE))
    wanted = np.sqrt(stiffness[:45])
    assert found.angular_frequencies == pytest.approx(wanted, rel=1e-11)
    assert np.linalg.matrix_rank(found.shapes, tol=1e-6) == 45


@pytest.mark.parametrize("unit", [1.0, 1e6, 1e-6])
def test_large_free_structures_miss_no_slow_decay_in_any_unit_of_time(unit):
    """Overdamped modes are farther from a shift than faster vibrations are."""
    stiffness = unit**2 * np.concatenate([[0], np.full(3, 40.0), np.linspace(1.03, 5, 1196) ** 2])
    damping = unit * np.concatenate([[0], np.full(3, 40.0), np.zeros(1196)])
    system = lv.Structure(np.ones(LARGE), stiffness, damping=damping)
    found = lv.analysis.modes(system, count=6, q=np.zeros(LARGE)).eigenvalues / unit
    slow = np.sqrt(360.0) - 20
    np.testing.assert_allclose(found, [0, 0, slow, slow, slow, 1.03j], rtol=0, atol=1e-12)


def test_a_large_free_ring_with_forces_that_follow_has_its_modes():
    """Its stiffness is singular, and not symmetric: a circulant matrix."""
    ahead, behind = [*range(1, LARGE), 0], [LARGE - 1, *range(LARGE - 1)]
    ring = lv.Lagrangian(
        lambda t, q, v, p: ca.sumsqr(v) / 2 - ca.sumsqr(q[ahead] - q) / 2,
        q=LARGE,
        force=lambda t, q, v, p: 0.02 * q[ahead] - 0.01 * q[behind] - 0.01 * q,
    )
    found = lv.analysis.modes(ring, count=10, q=np.zeros(LARGE)).eigenvalues
    turn = np.exp(2j * np.pi * np.arange(LARGE) / LARGE)
    roots = np.sqrt(turn + 1 / turn - 2 + 0.02 * turn - 0.01 / turn - 0.01)
    roots[0] = 0
    wanted = np.sort(np.abs(np.concatenate([roots, -roots])))[:19]  # of pairs one of two
    np.testing.assert_allclose(np.abs(found), [0, *wanted[1::2]], rtol=1e-9, atol=0)
    off = np.abs(found[:, None] - np.concatenate([roots, -roots])).min(axis=1)
    assert off.max() < 1e-11


@pytest.mark.parametrize("count", [60, LARGE])
def test_a_free_row_damped_between_its_masses_does_not_grow(count):
    """That it flies away is a zero twice, and no growth and decay of the root of roundoff."""
    row = np.full(count - 1, -1.0)
    ends = np.full(count, 2.0)
    ends[[0, -1]] = 1.0
    matrix = sp.diags([row, ends, row], [-1, 0, 1])
    free = lv.Structure(np.ones(count), matrix, damping=3.0 * matrix)
    found = lv.analysis.modes(free, count=4, q=np.zeros(count))
    np.testing.assert_array_equal(found.eigenvalues[:2], 0)
    squares = (2 * np.sin(np.arange(1, 3) * np.pi / (2 * count))) ** 2
    wanted = np.sqrt((1.5 * squares) ** 2 - squares + 0j) - 1.5 * squares
    np.testing.assert_allclose(found.eigenvalues[2:], wanted, rtol=1e-7, atol=0)
    assert not found.unstable


def test_large_structures_find_their_equilibrium():
    loaded = springs(force=np.full(LARGE, 1e-3), constraint=lambda t, q, p: [q[0] - 1.0])
    found = lv.analysis.equilibrium(loaded, q=np.zeros(LARGE))
    x = np.arange(LARGE)
    wanted = 1e-3 * x * (LARGE - x) / 2 + (LARGE - x) / LARGE
    assert found.start["q"] == pytest.approx(wanted, rel=1e-9)
    assert found.is_stable is None
    with pytest.raises(ValueError, match=r"the stiffness is singular|no equilibrium is found"):
        lv.analysis.equilibrium(springs(free=True, force=np.ones(LARGE)), q=np.zeros(LARGE))
    with pytest.raises(TypeError, match="count=20"):
        lv.analysis.modes(springs(), q=np.zeros(LARGE))
    with pytest.raises(ValueError, match="no equilibrium: the force left on"):
        lv.analysis.modes(loaded, count=2, q=np.eye(LARGE)[0])
    with pytest.raises(ValueError, match="a linearisation of 1200 coordinates is not made"):
        lv.analysis.linearize(springs(), q=np.zeros(LARGE))


@pytest.mark.parametrize("width", [None, 500.0])
def test_long_chains_that_hang_are_held_by_their_tension(width):
    """At multipliers of zero nothing would hold them."""
    count = LARGE // 2
    turn = 0.05 * np.random.default_rng(0).standard_normal(count) - np.pi / 2
    if width is not None:
        turn = np.linspace(-0.9, 0.9, count + 1)[:-1]
    rough = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)
    ends = None if width is None else (width, 0.0)
    rest = (
        lv.analysis.equilibrium(hanging(count, ends=ends), q=rough.ravel())
        .start["q"]
        .reshape(-1, 2)
    )
    if width is None:
        down = np.column_stack([np.zeros(count), -1.0 - np.arange(count)])
        np.testing.assert_allclose(rest, down, rtol=0, atol=1e-10)
        return
    links = np.diff(np.vstack([[0, 0], rest, [width, 0]]), axis=0)
    np.testing.assert_allclose(np.hypot(*links.T), 1, rtol=1e-12)
    rises = np.diff(links[:, 1] / links[:, 0])  # weight over horizontal tension, at each bead
    np.testing.assert_allclose(rises, rises.mean(), rtol=1e-8)
    assert rises.mean() > 0


# Equilibria


def test_a_hanging_chain_is_the_discrete_catenary():
    count, width, length = 19, 0.6, 0.05
    chain = hanging(count, ends=(width, 0.0), length=length)
    rough = np.zeros((count, 2))
    rough[:, 0] = np.linspace(0, width, count + 2)[1:-1]
    rough += 0.05 * np.random.default_rng(1).standard_normal(rough.shape)
    found = lv.analysis.equilibrium(chain, q=rough.ravel())
    assert found.is_stable
    assert found.residual < 1e-10
    beads = np.vstack([[0, 0], found.start["q"].reshape(-1, 2), [width, 0]])
    links = np.diff(beads, axis=0)
    assert np.hypot(*links.T) == pytest.approx(length, rel=1e-11)
    slopes = np.diff(links[:, 1] / links[:, 0])  # weight over horizontal tension, at each bead
    assert slopes == pytest.approx(slopes.mean(), rel=1e-9)
    assert slopes.mean() > 0
    assert (
        np.abs(lv.integrate(chain, lv.Spark(2), t=(0, 0.01), h=0.01, **found.start).v).max() < 1e-9
    )


def test_equilibria_are_stable_unless_any_is_asked_for():
    near_top = [0.02, 1.0]
    assert lv.analysis.equilibrium(PENDULUM, q=near_top).start["q"] == pytest.approx(
        DOWN, abs=1e-12
    )
    top = lv.analysis.equilibrium(PENDULUM, q=near_top, stable=False)
    assert top.start["q"] == pytest.approx(UP, abs=1e-12)
    assert top.is_stable is False
    assert "unstable" in repr(top)
    assert top.reactions == pytest.approx([0, G], abs=1e-12)
    assert lv.analysis.equilibrium(PENDULUM, q=UP).start["q"] == pytest.approx(UP)


def test_what_has_no_equilibrium_is_refused_with_the_force_left():
    falling = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - q[0], q=("height",))
    with pytest.raises(ValueError, match="a force of 1 is left on 'height', of forces up to"):
        lv.analysis.equilibrium(falling, q=[0.0])
    apart = lv.Lagrangian(quadratic, lambda t, q, p: {"never": ca.dot(q, q) + 1}, q=2)
    with pytest.raises(
        ValueError, match=r"no state on the constraints is found.*'never' is off by"
    ):
        lv.analysis.equilibrium(apart, q=[1.0, 1.0])
    broken = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - ca.sqrt(q[0]), q=1)
    with pytest.raises(ValueError, match="the force on 'q0' is not finite at this state"):
        lv.analysis.equilibrium(broken, q=[-1.0])
    driven = four_bar(motion=lambda t, params: 4 * t)
    system = driven.system()
    with pytest.raises(
        ValueError, match=r"'A.motion' moves by -?4 per unit of time: nothing rests"
    ):
        lv.analysis.equilibrium(system, **driven.start())
    with pytest.raises(ValueError, match=r"no equilibrium: the force left on 'q1' is 9\.8"):
        lv.analysis.modes(PENDULUM, q=[1.0, 0.0])
    with pytest.raises(TypeError, match="stable must be True or False"):
        lv.analysis.equilibrium(PENDULUM, q=DOWN, stable="yes")


#: Potentials whose force falls off beside a spring across.
FALLS = {
    "exponential": lambda r: ca.exp(-r),
    "hump": lambda r: ca.exp(-(r**2) / 2),
    "repulsion": lambda r: r**-12,
}


@pytest.mark.parametrize("stable", [True, False])
@pytest.mark.parametrize("name", FALLS)
def test_where_forces_fall_off_with_the_distance_nothing_rests(name, stable):
    """The force on x becomes 1e-11 of that of the spring, at a place that means nothing."""

    def pair(potential):
        return lv.Lagrangian(
            lambda t, q, v, p: ca.dot(v, v) / 2 - potential(q[0]) - q[1] ** 2, q=("x", "y")
        )

    with pytest.raises(ValueError, match=r"'x' is at .* still moves by .* forces have fallen to"):
        lv.analysis.equilibrium(pair(FALLS[name]), q=[3.0, 0.3], stable=stable)
    alone = lv.Lagrangian(lambda t, q, v, p: v[0] ** 2 / 2 - FALLS[name](q[0]), q=("x",))
    with pytest.raises(ValueError, match=r"'x' is at .* still moves by .* forces have fallen to"):
        lv.analysis.equilibrium(alone, q=[3.0], stable=stable)
    # a minimum that is as flat is one
    flat = lv.analysis.equilibrium(pair(lambda r: (r - 0.5) ** 8), q=[3.0, 0.3], stable=stable)
    assert flat.start["q"] == pytest.approx([0.5, 0], abs=0.01)
    well = lv.analysis.equilibrium(pair(lambda r: 4 * (r**-12 - r**-6)), q=[3.0, 0.3])
    assert well.start["q"] == pytest.approx([2 ** (1 / 6), 0], abs=1e-12)


# Assemblies


def test_linkages_in_space_and_in_the_plane_vibrate_alike(linkages):
    found = {}
    for kind, (system, start) in linkages.items():
        rest = lv.analysis.equilibrium(system, **start)
        assert rest.is_stable
        modes = lv.analysis.modes(system, **rest.start)
        found[kind] = modes.eigenvalues
        shift, turn = modes.body("crank")
        # the centre of the crank goes around its hinge
        arm = rest.start["q"][:2]
        wanted = turn[2] * np.array([-arm[1], arm[0]])[:, None]
        assert shift[:2] == pytest.approx(wanted, rel=1e-9)
        linear = lv.analysis.linearize(system, **rest.start)
        assert linear.mass.shape == (1, 1)
    assert found["planar"] == pytest.approx(found["spatial"], rel=1e-10)
    with pytest.raises(ValueError, match="no body 'x'"):
        modes.body("x")
    with pytest.raises(TypeError, match="a Lagrangian knows no bodies"):
        lv.analysis.modes(PENDULUM, q=DOWN).body("crank")


def test_a_run_near_the_equilibrium_follows_the_state_matrix(linkages):
    system, start = linkages["planar"]
    rest = lv.analysis.equilibrium(system, **start).start
    linear = lv.analysis.linearize(system, independent=["crank.angle"], **rest)
    size = 1e-5
    near = system.consistent(q=rest["q"] + size * linear.basis[:, 0], v=rest["v"], hold=None)
    run = lv.integrate(system, lv.Spark(3), t=(0, 1), h=0.02, **near)
    angle = system.coordinates.index("crank.angle")
    begin = [near["q"][angle] - rest["q"][angle], near["v"][angle]]
    end = [run.q[-1, angle] - rest["q"][angle], run.v[-1, angle]]
    assert end == pytest.approx(expm(linear.state) @ begin, abs=1e-3 * size)


def torque(t, angle, rate, params):
    return 3 * ca.sin(2 * t) - 0.2 * rate


def test_inverse_dynamics_gives_the_torque_of_a_run_back(linkages):
    free, _ = linkages["spatial"]
    driven = four_bar("spatial", torque=torque)
    system, start = driven.system(), driven.start(rates={"A": 2.0})
    run = lv.integrate(system, lv.Spark(3), t=(0, 0.2), h=0.02, **start)
    found = lv.analysis.inverse_dynamics(free, run, ["A"])
    joint = run.joint("A")
    assert found.efforts["A"] == pytest.approx(joint.effort, abs=1e-12)
    assert found.rates["A"] == pytest.approx(joint.rate, abs=1e-13)
    assert found.residual.max() < 1e-12
    assert found.lam.shape == run.lam.shape
    again = lv.analysis.inverse_dynamics(system, run, ["A.angle"])
    assert np.abs(again.efforts["A.angle"]).max() < 1e-11


def test_inverse_dynamics_gives_the_multiplier_of_a_prescribed_motion(linkages):
    free, _ = linkages["planar"]
    driven = four_bar(motion=lambda t, params: 4 * t)
    run = lv.integrate(driven.system(), lv.Spark(4), t=(0, 0.2), h=0.02, **driven.start())
    wanted = run.joint("A").torque[:, 2]
    rate = {"motor": lambda t, q, v, params: v[2]}
    assert lv.analysis.inverse_dynamics(free, run, rate).efforts["motor"] == pytest.approx(
        wanted, abs=1e-10
    )
    two = lv.analysis.inverse_dynamics(free, run, ["A", "D"], least_squares=True)
    power = sum(two.efforts[name] * two.rates[name] for name in "AD")
    assert power == pytest.approx(4 * wanted, abs=1e-9)
    with pytest.raises(ValueError, match="efforts of 'A' and 'D' cannot be told apart"):
        lv.analysis.inverse_dynamics(free, run, ["A", "D"])


def test_motions_by_arrays_and_actuators_that_do_not_fit():
    system = lv.Lagrangian(
        lambda t, q, v, p: (v[0] ** 2 + 2 * v[1] ** 2) / 2 - G * q[1], q=["x", "y"]
    )
    t = np.linspace(0, 1, 5)
    q = np.stack([t**2, np.sin(t)], axis=1)
    v, a = np.stack([2 * t, np.cos(t)], axis=1), np.stack([2 + 0 * t, -np.sin(t)], axis=1)
    motion = {"t": t, "q": q, "v": v, "acceleration": a}
    both = lv.analysis.inverse_dynamics(system, motion, ["x", "y"])
    assert both.efforts["x"] == pytest.approx(a[:, 0])
    assert both.efforts["y"] == pytest.approx(2 * a[:, 1] + G)
    with pytest.raises(ValueError, match=r"'x' cannot make this motion.* 1 actuators for 2 freed"):
        lv.analysis.inverse_dynamics(system, motion, ["x"])
    some = lv.analysis.inverse_dynamics(system, motion, ["x"], least_squares=True)
    assert some.residual == pytest.approx(np.abs(2 * a[:, 1] + G))
    for actuators, error, words in (
        ("x", TypeError, r"give a list, \['x'\]"),
        ([], ValueError, "no actuators"),
        (["z"], ValueError, "no joint or coordinate 'z'"),
        ({"m": lambda t, q, v, p: q[0]}, ValueError, "actuator 'm' is no rate"),
        ({"m": lambda t, q, v, p: v[0] ** 2}, ValueError, "not linear in v"),
    ):
        with pytest.raises(error, match=words):
            lv.analysis.inverse_dynamics(system, motion, actuators)
    for change, error, words in (
        ({"v": v[1:]}, ValueError, r"v of the motion must have shape \(5, 2\), not \(4, 2\)"),
        ({"v": v * np.nan}, ValueError, "v of the motion is not finite"),
        ({"p": v}, TypeError, r"must have t, q, v, acceleration, not"),
    ):
        with pytest.raises(error, match=words):
            lv.analysis.inverse_dynamics(system, motion | change, ["x", "y"])
    off = {"t": [0.0], "q": [DOWN], "v": [[1.0, 0.0]], "acceleration": [[0.0, 0.0]]}
    with pytest.raises(ValueError, match="accelerations of the motion violate constraint"):
        lv.analysis.inverse_dynamics(PENDULUM, off, ["q0"])
    with pytest.raises(ValueError, match="motion violates the hidden constraint"):
        lv.analysis.inverse_dynamics(PENDULUM, off | {"v": [[0.0, 1.0]]}, ["q0"])


WITHOUT = """
import pickle, sys
sys.modules["casadi"] = None
import liouville as lv
plain, kept = pickle.loads(sys.stdin.buffer.read())
rest = lv.analysis.equilibrium(plain, q=[0.6, -0.8])
motion = {"t": [0.0], "q": [rest.start["q"]], "v": [[0, 0]], "acceleration": [[1.0, 0]]}
print(lv.analysis.inverse_dynamics(plain, motion, ["q0"]).efforts["q0"][0])
print(lv.analysis.modes(kept, **rest.start).eigenvalues[0].imag)
try:
    lv.analysis.modes(plain, **rest.start)
except ImportError as error:
    print(str(error).splitlines()[1])
"""


def test_pickled_systems_without_casadi():
    plain, kept = hanging(1), hanging(1)
    lv.analysis.linearize(kept, q=DOWN)
    given = pickle.dumps((plain, kept))
    ran = subprocess.run([sys.executable, "-c", WITHOUT], input=given, capture_output=True)
    assert not ran.returncode, ran.stderr.decode()[-2000:]
    effort, frequency, hint = ran.stdout.decode().splitlines()
    assert float(effort) == pytest.approx(1.0)
    assert float(frequency) == pytest.approx(np.sqrt(G))
    assert hint == "hint: pip install casadi"


# Balances of power


def test_the_power_of_forces_and_damping_accounts_for_the_energy():
    oscillator = lv.Structure([1.0], [4.0], [0.3], force=lambda t, q, v, p: [ca.cos(t) - v[0] ** 3])
    run = lv.integrate(oscillator, lv.Spark(3), t=(0, 3), h=0.05, q=[1.0], v=[0.0])
    found = lv.analysis.power_balance(run)
    assert set(found.work) == {"forces", "damping"}
    assert np.abs(found.defect).max() < 1e-9
    wanted = run.v[:, 0] * (np.cos(run.t) - run.v[:, 0] ** 3)
    assert found.power["forces"] == pytest.approx(wanted)
    assert found.power["damping"] == pytest.approx(-0.3 * run.v[:, 0] ** 2)
    hht = lv.integrate(oscillator, lv.HHT(alpha=-0.2), t=(0, 3), h=0.05, q=[1.0], v=[0.0])
    found = lv.analysis.power_balance(hht)
    assert found.work["forces"] == pytest.approx(hht.work, abs=2e-3)
    assert found.work["damping"] + found.defect == pytest.approx(-hht.dissipated, abs=2e-3)


@pytest.mark.parametrize("name", ["moving_wire", "rolling_ball"])
def test_the_power_of_moving_constraints_accounts_for_the_energy(name):
    problem = problems.load(name)
    start, h = problem.system.consistent(**problem.start), problem.h / 2
    run = lv.integrate(problem.system, lv.Spark(4), t=(0, 40 * h), h=h, **start)
    found = lv.analysis.power_balance(run)
    assert np.ptp(run.energy if hasattr(run, "energy") else found.energy) > 1e-3
    assert "constraints" in found.work
    assert np.abs(found.defect).max() < 1e-7 * np.abs(found.energy).max()


def test_balances_that_cannot_be_made_are_refused():
    run = lv.integrate(PENDULUM, lv.Spark(2), t=(0, 1), h=0.1, every=2, q=DOWN, v=[1.0, 0.0])
    with pytest.raises(ValueError, match="states of all steps"):
        lv.analysis.power_balance(run)
    parts = {"velocity": lambda t, y, z, p: z, "momentum": lambda t, y, z, p: 2 * z}
    general = lv.Mechanical(**parts, force=lambda t, y, z, p: [-1], y=1)
    run = lv.integrate(general, lv.Spark(2), t=(0, 0.1), h=0.1, y=[0.0], z=[0.0])
    with pytest.raises(TypeError, match="energy of a Mechanical system is not known"):
        lv.analysis.power_balance(run)
    with pytest.raises(TypeError, match="takes a solution"):
        lv.analysis.power_balance(PENDULUM)


def test_without_scipy_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.linalg", None)
    monkeypatch.setitem(sys.modules, "scipy.interpolate", None)
    assert lv.analysis.equilibrium(PENDULUM, q=[0.1, -0.9]).is_stable
    for needs in (lambda: lv.analysis.modes(PENDULUM, q=DOWN), lambda: lv.table([0, 1], [0, 1])):
        with pytest.raises(ImportError, match=r"need.* SciPy(.|\n)*liouville\[analysis\]"):
            needs()


@pytest.mark.parametrize("size", [1e160, 1e200, 1e300])
def test_an_equilibrium_is_sought_from_as_far_as_numbers_go(size):
    """The work of forces over the way overflowed, with warnings."""
    spring = lv.Lagrangian(lambda t, q, v, params: (v[0] ** 2 - q[0] ** 2) / 2, q=("x",))
    assert abs(lv.analysis.equilibrium(spring, q=[size]).start["q"][0]) <= 1e-12 * size
    bead = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - q[1], lambda t, q, params: ca.dot(q, q) - 1, q=2
    )
    with pytest.raises(ValueError, match="is not finite at this state"):
        lv.analysis.equilibrium(bead, q=[size, size])


def test_modes_about_zero_are_those_of_the_equilibrium_found_there():
    """Coordinates of 1e-31 are roundoff of zero, and no force is small beside theirs."""
    for scale in (1.0, 1e-9, 1e6):  # lengths in any unit

        def anharmonic(t, q, v, p, scale=scale):
            potential = 0.7 * q[0] ** 2 + 1.3 * q[1] ** 2 + 0.2 * q[0] * q[1]
            return ca.dot(v, v) / 2 - potential - q[0] ** 4 / scale**2

        system = lv.Lagrangian(anharmonic, q=2)
        rests = [
            lv.analysis.equilibrium(system, q=scale * np.array(q)).start
            for q in ([0.3, -0.7], [1.1, 0.2], [-0.4, 0.9])
        ]
        for rest in rests:
            found = lv.analysis.modes(system, **rest).angular_frequencies
            assert found == pytest.approx(np.sqrt(np.linalg.eigvalsh([[1.4, 0.2], [0.2, 2.6]])))
        assert any(rest["q"].any() for rest in rests)
        with pytest.raises(ValueError, match="no equilibrium: the force left on 'q1'"):
            lv.analysis.modes(system, q=[0.0, 1e-3 * scale])
    # stiff springs at zero under a load
    row = lv.Structure(np.ones(LARGE), 1e8 * np.ones(LARGE), force=np.ones(LARGE))
    for system, more in ((row, {"count": 2}), (lv.Structure([1.0], [1e8], force=[1.0]), {})):
        with pytest.raises(ValueError, match="no equilibrium: the force left on 'q0'"):
            lv.analysis.modes(system, q=np.zeros(len(system.coordinates)), **more)


@pytest.mark.parametrize("far", [1.0, 1e3, 1e6])
def test_roundoff_of_springs_that_pull_from_afar_is_no_force_left(far):
    """Two pairs of springs hold a mass at zero, where the forces of each pair cancel."""
    rng = np.random.default_rng(0)
    for _ in range(40):
        a, b, c = rng.uniform(0.5, 2, 3) * far
        near, across = rng.uniform(1, 3, 2)

        def lagrangian(t, q, v, p, a=a, b=b, c=c, near=near, across=across):
            longer = (ca.sqrt((q[0] + side * a) ** 2 + c**2) - b for side in (1, -1))
            pair = (q[1] - a) ** 2 + (q[1] + a) ** 2
            return ca.dot(v, v) / 2 - near / 2 * sum(x**2 for x in longer) - across / 2 * pair

        mass = lv.Lagrangian(lagrangian, q=2)
        rest = lv.analysis.equilibrium(mass, q=1e-3 * rng.normal(size=2), stable=False).start
        assert np.abs(rest["q"]).max() < 1e-14 * far
        found = lv.analysis.modes(mass, **rest).eigenvalues
        assert np.abs(found - 1j * np.sqrt(2 * across)).min() < 1e-9
        still = {"t": [0.0], "q": [rest["q"]], "v": np.zeros((1, 2))}
        still["acceleration"] = np.zeros((1, 2))
        for name in ("q0", "q1"):
            lv.analysis.inverse_dynamics(mass, still, [name])


def test_a_search_under_follower_forces_says_what_finds_the_equilibrium():
    def column(t, q, v, params):  # Ziegler's, stable below a load of 2.086
        kinetic = (3 * v[0] ** 2 + 2 * ca.cos(q[0] - q[1]) * v[0] * v[1] + v[1] ** 2) / 2
        return kinetic - (q[0] ** 2 + (q[1] - q[0]) ** 2) / 2

    def load(t, q, v, params):
        return [2.0 * ca.sin(q[0] - q[1]), 0]

    system = lv.Lagrangian(column, q=2, force=load)
    hint = "hint: the stiffness is not symmetric, as under follower forces: stable=False finds"
    with pytest.raises(ValueError, match=hint):
        lv.analysis.equilibrium(system, q=[0.05, 0.05])
    rest = lv.analysis.equilibrium(system, q=[0.05, 0.05], stable=False)
    assert not lv.analysis.modes(system, **rest.start).unstable


def test_inverse_dynamics_takes_a_joint_for_all_of_its_coordinates():
    m = lv.bodies.Assembly(gravity=(0, 0, -G))
    m.body("b", mass=2.0, inertia=(0.1, 0.2, 0.25), at=(0, 0, 0))
    m.free("f", "b")
    motion = lv.integrate(m.system(), lv.Spark(3), t=(0, 0.1), h=0.05, **m.start())
    hover = motion.states | {"t": motion.t, "acceleration": np.zeros((3, 7))}
    given = {name: hover[name] * (name != "v") for name in ("t", "q", "v", "acceleration")}
    given["q"] = np.tile(motion.q[0], (3, 1))
    found = lv.analysis.inverse_dynamics(m.system(), given, ["f"])
    assert [*found.efforts] == [f"f.{x}_{axis}" for x in ("move", "spin") for axis in "xyz"]
    np.testing.assert_allclose(found.efforts["f.move_z"], 2 * G, rtol=1e-14)
