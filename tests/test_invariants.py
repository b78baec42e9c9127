"""What each row of the registry keeps, each claim beside a case that must fail the same test."""

import casadi as ca
import numpy as np
import pytest
from registry import PROBLEMS, ROWS, spherical_pendulum

import liouville as lv
from liouville.problems import MECHANICAL, load

#: Weights of the central difference of order 8, for offsets 1 to 4.
STENCIL = (4 / 5, -1 / 5, 4 / 105, -1 / 280)


#: Compositions and pairs have the same claims in files of their own.
METHODS = (lv.Spark, lv.HHT, lv.GeneralizedAlpha)


def rows(claim):
    """Return the cases of holonomic mechanics in which a claim is to hold."""
    kept = ((row, name) for row in ROWS if claim in row.keeps for name in row.on)
    return [
        (row, name)
        for row, name in kept
        if name in PROBLEMS and isinstance(row.method, METHODS) and claim not in PROBLEMS[name].lost
    ]


def ids(value):
    return str(value)


# --- constraints -------------------------------------------------------------------------------


# Twenty particles take a while, and have a file of their own.
SMALL = [name for name in MECHANICAL if name != "fekete"]


@pytest.mark.parametrize("steps", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", SMALL)
def test_both_constraints_hold_to_roundoff_over_many_steps(name, steps):
    problem = load(name)
    h = problem.h if problem.interval[1] / problem.h > 1e4 else problem.interval[1] / 1e5
    found = lv.integrate(
        problem.system, lv.Spark(2), t=(0.0, steps * h), steps=steps, every=100, **problem.start
    )
    q, v = found.q, found.v
    assert np.abs(found.residuals["constraint"]).max() < 1e-13 * max(1, np.abs(q).max())
    assert np.abs(found.residuals["hidden"]).max() < 1e-13 * max(1, np.abs(v).max())


@pytest.mark.parametrize(("row", "name"), rows("hidden"), ids=ids)
def test_the_stages_do_not_spoil_the_constraints(row, name):
    problem = PROBLEMS[name]
    found = lv.integrate(problem.system, row.method, t=problem.t, steps=100, **problem.start)
    assert np.abs(found.residuals["constraint"]).max() < 5e-15
    assert np.abs(found.residuals["hidden"]).max() < 5e-15


SECOND_ORDER = [name for name in SMALL if name != "relativistic_particle"]


def worst(found):
    """Return the largest residuals of both constraints, relative to coordinates and velocities."""
    g, w = np.abs(found.residuals["constraint"]), np.abs(found.residuals["hidden"])
    length, speed = max(1, np.abs(found.q).max()), max(1, np.abs(found.v).max())
    return g.max() / length, w.max() / speed


@pytest.mark.parametrize("name", SECOND_ORDER)
@pytest.mark.parametrize(
    "method",
    [lv.HHT(-0.1), lv.HHT(-1 / 3, b=-1), lv.GeneralizedAlpha(0.8)],
    ids=ids,
)
def test_the_alpha_methods_keep_both_constraints_over_1e3_steps(method, name):
    problem = load(name)
    found = lv.integrate(
        problem.system, method, t=(0.0, 5e2 * problem.h), steps=1_000, **problem.start
    )
    assert max(worst(found)) < 1e-12


@pytest.mark.parametrize("name", SECOND_ORDER)
@pytest.mark.parametrize("method", [lv.HHT(-0.1), lv.GeneralizedAlpha(0.8)], ids=ids)
def test_the_alpha_methods_keep_both_constraints_with_controlled_steps(method, name):
    problem = load(name)
    found = lv.integrate(
        problem.system, method, t=problem.interval, rtol=1e-4, atol=1e-6, **problem.start
    )
    assert max(worst(found)) < 1e-12


def test_the_alpha_methods_keep_both_constraints_over_1e5_steps():
    problem = load("moving_wire")
    h = problem.h / 2
    found = lv.integrate(
        problem.system, lv.HHT(-0.1), t=(0.0, 1e5 * h), steps=100_000, **problem.start
    )
    assert max(worst(found)) < 1e-12


@pytest.mark.parametrize("name", ["pendulum", "slider_crank", "moving_wire"])
def test_arnold_and_bruls_leave_the_hidden_constraint_by_order_2(name):
    problem = load(name)
    t = 0.0, 500 * problem.h
    coarse, fine = (
        worst(lv.integrate(problem.system, lv.ArnoldBruls(), t=t, steps=steps, **problem.start))
        for steps in (2_000, 4_000)
    )
    assert max(coarse[0], fine[0]) < 1e-13
    assert fine[1] > 1e-7
    assert np.log2(coarse[1] / fine[1]) == pytest.approx(2, abs=0.2)


# --- symmetry ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("row", "name"), rows("reversibility"), ids=ids)
def test_a_step_back_undoes_a_step(row, name):
    problem, t, h = PROBLEMS[name], 0.3, 0.05
    start = consistent(problem, t)
    first, second = start
    there = lv.integrate(problem.system, row.method, t=(t, t + h), steps=1, **start)
    back = lv.integrate(
        problem.system,
        row.method,
        t=(t + h, t),
        steps=1,
        **{first: there.states[first][-1], second: there.states[second][-1]},
    )
    for state in (first, second):
        scale = max(1, np.abs(start[state]).max())
        assert np.abs(back.states[state][-1] - start[state]).max() < 1e-13 * scale
        assert np.abs(there.states[state][-1] - start[state]).max() > 1e-3


def consistent(problem, t):
    return problem.system.consistent(t=t, **problem.start)


# --- the symplectic form -----------------------------------------------------------------------


def derivative(curve, step=0.005):
    """Differentiate a curve of points at 0, to order 8."""
    return (
        sum(
            weight * (curve((k + 1) * step) - curve(-(k + 1) * step))
            for k, weight in enumerate(STENCIL)
        )
        / step
    )


def symplectic_defect(system, start, t, flow):
    """Return the change of dp ^ dq along `flow`, on curves of consistent starts."""
    first, second = start

    def curve(a, b, through):
        def point(epsilon):
            moved = system.consistent(
                t=t, **{first: start[first] + epsilon * a, second: start[second] + epsilon * b}
            )
            return np.concatenate(through(moved))

        return derivative(point)

    n = len(system.coordinates)
    form = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    rng = np.random.default_rng(3)
    pairs = [rng.normal(size=(2, n)) / np.sqrt(2 * n) for _ in range(3)]

    def here(moved):
        found = lv.integrate(system, lv.Spark(1), t=(t, t + 1e-6), steps=1, **moved)
        return found.q[0], found.p[0]

    before, after = (np.stack([curve(a, b, through) for a, b in pairs]) for through in (here, flow))
    return np.abs(after @ form @ after.T - before @ form @ before.T).max()


@pytest.mark.parametrize(("row", "name"), rows("symplectic form"), ids=ids)
def test_the_symplectic_form_is_kept(row, name):
    problem, t, h = PROBLEMS[name], 0.2, 0.1
    start = consistent(problem, t)

    def flow(moved):
        found = lv.integrate(problem.system, row.method, t=(t, t + h), steps=1, **moved)
        return found.q[-1], found.p[-1]

    assert symplectic_defect(problem.system, start, t, flow) < 1e-11


def test_a_rheonomic_constraint_keeps_the_form_too():
    wire = lv.Lagrangian(
        lambda t, q, v, params: (1 + ca.sin(t) / 5) * (ca.dot(v, v) / 2 - q[1]),
        lambda t, q, params: q[1] - q[0] ** 2 / 2 - ca.sin(2 * t) / 2,
        q=("x", "y"),
    )
    start = wire.consistent(t=0.2, q=[1, 0.5], v=[0, 1])

    def flow(moved):
        found = lv.integrate(wire, lv.Spark(2), t=(0.2, 0.3), steps=1, **moved)
        return found.q[-1], found.p[-1]

    assert symplectic_defect(wire, start, 0.2, flow) < 1e-11


@pytest.mark.parametrize("control", ["damping", "projected Runge-Kutta"])
def test_what_is_not_symplectic_fails_the_same_test(control):
    if control == "damping":
        system, t = PROBLEMS["moving wire"].system, 0.2
        start = consistent(PROBLEMS["moving wire"], t)

        def flow(moved):
            found = lv.integrate(system, lv.Spark(3), t=(t, t + 0.1), steps=1, **moved)
            return found.q[-1], found.p[-1]
    else:
        system, t = spherical_pendulum(), 0.0
        start = system.consistent(q=[0.6, 0, -0.8], v=[0, 1.25, 0])

        def flow(moved):
            return projected_runge_kutta(moved["q"], moved["v"], 0.1)

    assert symplectic_defect(system, start, t, flow) > 1e-9


def projected_runge_kutta(q, v, h):
    """Take a step of the classical RK4 on the spherical pendulum, and project it back."""

    def slope(q, v):
        lam = (v @ v - q[2]) / (q @ q)
        return v, np.array([0.0, 0.0, -1.0]) - lam * q

    k1 = slope(q, v)
    k2 = slope(q + h / 2 * k1[0], v + h / 2 * k1[1])
    k3 = slope(q + h / 2 * k2[0], v + h / 2 * k2[1])
    k4 = slope(q + h * k3[0], v + h * k3[1])
    q, v = (
        x + h / 6 * (a + 2 * b + 2 * c + d)
        for x, a, b, c, d in zip((q, v), k1, k2, k3, k4, strict=True)
    )
    q = q / np.linalg.norm(q)
    return q, v - (q @ v) * q


# --- energy ------------------------------------------------------------------------------------


def energy_errors(method, h, steps, every):
    start = {"q": [0.6, 0, -0.8], "v": [0, 1.25, 0]}
    found = lv.integrate(
        spherical_pendulum(),
        method,
        t=(0.0, h * steps),
        steps=steps,
        every=every,
        states=False,
        **start,
    )
    return found.invariants["energy"] - found.invariants["energy"][0]


@pytest.mark.parametrize("stages", [1, 2])
def test_the_energy_error_does_not_grow(stages):
    errors = np.abs(energy_errors(lv.Spark(stages), 0.05, 100_000, 1))
    assert errors.max() == pytest.approx(errors[:10_000].max(), rel=1e-3)
    assert errors.max() > 1e-9


def test_the_energy_error_of_a_method_without_structure_grows():
    q, v = np.array([0.6, 0, -0.8]), np.array([0, 1.25, 0])
    energies = []
    for _ in range(10_000):
        energies.append(v @ v / 2 + q[2])
        q, v = projected_runge_kutta(q, v, 0.05)
    errors = np.abs(np.array(energies) - energies[0])
    assert errors.max() > 5 * errors[:1_000].max()


@pytest.mark.parametrize("steps", [200_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_energy_is_lost_to_nothing_but_random_roundoff(steps):
    every = 1_000
    errors = energy_errors(lv.Spark(5), 0.05, steps, every)
    increments = np.diff(errors)
    walk = increments.std() * np.sqrt(len(increments))
    assert np.abs(errors).max() < 4 * walk
    # and the walk itself is far shorter than that of plain summation, one rounding a step
    assert np.abs(errors).max() < 0.5 * np.finfo(float).eps * np.sqrt(steps)
