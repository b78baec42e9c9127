"""Two ways to the same map."""

import casadi as ca
import numpy as np
import pytest
from registry import PROBLEMS, double_pendulum, printed, spherical_pendulum, top, top_lagrangian

import liouville as lv
from liouville.problems import load


def end(system, method=None, *, h=0.1, steps=10, **start):
    solution = lv.integrate(system, method or lv.Spark(3), t=(0.0, steps * h), steps=steps, **start)
    return {name: value[-1] for name, value in solution.states.items()}


def midpoint_residuals(y0, z0, y1, z1, psi0, psi1, h):
    """Return what is left of the modified midpoint equations for the spherical pendulum."""
    gravity = np.array([0.0, 0.0, -1.0])
    Y, Z = (y0 + y1) / 2, (y1 - y0) / h
    return np.concatenate(
        [
            y0 + h / 2 * Z - Y,
            z0 + h / 2 * gravity - h / 2 * y0 * psi0 - Z,
            z0 + h * gravity - h / 2 * y0 * psi0 - h / 2 * y1 * psi1 - z1,
            [(y1 @ y1 - 1) / 2, y1 @ z1],
        ]
    )


def test_one_stage_is_the_modified_midpoint_rule():
    y0, z0 = printed("spherical", "y0", "z0")
    h = 0.1
    found = end(spherical_pendulum(), lv.Spark(1), h=h, steps=1, q=y0, v=z0)
    y1, z1 = found["q"], found["v"]
    gravity = np.array([0.0, 0.0, -1.0])
    # the two multipliers are whatever makes the momentum equations hold along y0 and y1
    psi0 = 2 / h * y0 @ (z0 + h / 2 * gravity - (y1 - y0) / h)
    psi1 = 2 / h * y1 @ (z0 + h * gravity - h / 2 * y0 * psi0 - z1)
    assert np.abs(midpoint_residuals(y0, z0, y1, z1, psi0, psi1, h)).max() < 1e-14
    assert np.abs(midpoint_residuals(y0, z0, y1, z1 + 1e-12, psi0, psi1, h)).max() > 1e-13


@pytest.mark.parametrize("stages", [1, 2, 3, 5])
def test_lagrangian_and_hamiltonian_forms_agree(stages):
    def hamiltonian(t, q, p, params):
        v = ca.SX.sym("v", 4)
        momentum = ca.gradient(top_lagrangian(t, q, v, params), v)
        v_of_p = ca.solve(ca.jacobian(momentum, v), p)
        return ca.dot(p, v_of_p) - ca.substitute(top_lagrangian(t, q, v, params), v, v_of_p)

    conjugate = lv.Hamiltonian(
        hamiltonian, lambda t, q, params: (ca.dot(q, q) - 1) / 2, q=("q0", "q1", "q2", "q3")
    )
    y0, z0 = printed("heavy_top_quaternion", "y0", "z0")
    one = lv.integrate(top(), lv.Spark(stages), t=(0.0, 0.5), steps=10, q=y0, v=z0)
    two = lv.integrate(conjugate, lv.Spark(stages), t=(0.0, 0.5), steps=10, q=y0, p=one.p[0])
    for name in ("q", "v", "p", "lam"):
        np.testing.assert_allclose(two.states[name], one.states[name], rtol=0, atol=2e-13)


def test_the_solvers_agree():
    for problem in PROBLEMS.values():
        one, two = (
            end(problem.system, lv.Spark(3, solver), steps=5, **problem.start)
            for solver in ("node-schur", "newton")
        )
        for name, value in one.items():
            np.testing.assert_allclose(two[name], value, rtol=2e-14, atol=2e-14)


def test_any_function_with_the_same_zeros_is_the_same_constraint():
    def mixed(t, q, params):
        first = ca.norm_2(q[:2]) - 1
        second = ((q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2 - 1) / 2
        return [first + 3 * second, 2 * first - second]

    other = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2 - q[1] - q[3], mixed, q=4)
    start = {"q": [1, 0, 1, -1], "v": [0, 0, 0, 0]}
    one, two = end(double_pendulum(), **start), end(other, **start)
    np.testing.assert_allclose(two["q"], one["q"], rtol=0, atol=5e-15)
    np.testing.assert_allclose(two["v"], one["v"], rtol=0, atol=5e-15)
    assert np.abs(two["lam"] - one["lam"]).max() > 0.1


def test_without_constraints_it_is_gauss_collocation():
    system = lv.Lagrangian(lambda t, q, v, params: ca.dot(v, v) / 2 + ca.cos(q[0]), q=("angle",))
    y, z, h = 1.0, 0.0, 0.3
    found = end(system, lv.Spark(1), h=h, steps=1, q=[y], v=[z])
    middle = y
    for _ in range(100):
        middle = y + h / 2 * (z - h / 2 * np.sin(middle))
    assert abs(found["q"][0] - (2 * middle - y)) < 1e-15
    assert abs(found["v"][0] - (z - h * np.sin(middle))) < 1e-15


def test_a_parameter_changed_is_a_system_rebuilt():
    chain = load("pendulum").system
    start = {"q": [0.0, -2.0], "v": [1.5, 0.0]}
    changed = lv.integrate(
        chain, lv.Spark(2), t=(0.0, 1.0), h=0.1, params={"l": 2.0, "g": 1.62}, **start
    )
    rebuilt = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - 1.62 * q[1],
        lambda t, q, params: (ca.dot(q, q) - 4) / 2,
        q=("x", "y"),
    )
    again = lv.integrate(rebuilt, lv.Spark(2), t=(0.0, 1.0), h=0.1, **start)
    np.testing.assert_allclose(changed.q, again.q, rtol=0, atol=1e-14)


def test_thinned_output_is_the_full_output_thinned():
    problem = PROBLEMS["top"]
    full = lv.integrate(problem.system, lv.Spark(2), t=problem.t, steps=50, **problem.start)
    thin = lv.integrate(
        problem.system, lv.Spark(2), t=problem.t, steps=50, every=7, **problem.start
    )
    kept = [0, 7, 14, 21, 28, 35, 42, 49, 50]
    for name, value in thin.states.items():
        np.testing.assert_array_equal(value, full.states[name][kept])
    np.testing.assert_array_equal(thin.t, full.t[kept])


def test_observables_without_states_are_those_with_states():
    problem = PROBLEMS["top"]
    observe = {"speed": lambda t, q, v, params: ca.dot(v, v), "both": lambda t, q, v, params: q[:2]}
    with_states, without = (
        lv.integrate(
            problem.system,
            lv.Spark(2),
            t=problem.t,
            steps=20,
            observe=observe,
            states=states,
            **problem.start,
        )
        for states in (True, False)
    )
    assert without.states == {}
    np.testing.assert_array_equal(without.observed["speed"], with_states.observed["speed"])
    np.testing.assert_array_equal(without.observed["both"], with_states.q[:, :2])
    np.testing.assert_allclose(
        without.observed["speed"], np.sum(with_states.v**2, axis=1), rtol=1e-15
    )


def test_reactions_are_what_the_multipliers_do():
    problem = PROBLEMS["moving wire"]
    found = lv.integrate(problem.system, lv.Spark(3), t=problem.t, steps=10, **problem.start)
    gradient = np.stack([-found.q[:, 0], np.ones(len(found.t))], axis=1)
    np.testing.assert_allclose(found.reaction(), -gradient * found.lam, rtol=1e-15, atol=1e-16)


def test_a_composition_keeps_the_constraints_and_comes_back():
    problem = PROBLEMS["top"]
    method = lv.Composition(lv.Spark(1), "SU4")
    there = lv.integrate(problem.system, method, t=(0.0, 1.0), steps=20, **problem.start)
    assert np.abs(there.residuals["constraint"]).max() < 1e-14
    assert np.abs(there.residuals["hidden"]).max() < 1e-13
    end = {state: there.states[state][-1] for state in problem.start}
    back = lv.integrate(problem.system, method, t=(1.0, 0.0), steps=20, **end)
    for state, start in problem.start.items():
        assert np.abs(back.states[state][-1] - start).max() < 1e-13


def test_a_composition_by_one_stage_is_its_base():
    problem = PROBLEMS["top"]
    one, base = (
        lv.integrate(problem.system, method, t=(0.0, 1.0), steps=20, **problem.start)
        for method in (lv.Composition(lv.Spark(2), "S2"), lv.Spark(2))
    )
    assert np.array_equal(one.q, base.q)


@pytest.mark.parametrize("mass", [2.0**-86, 2.0**-50, 2.0**82])
@pytest.mark.parametrize("kind", ["tangents", "skate", "generalized alpha", "controlled"])
def test_the_unit_of_mass_changes_nothing(kind, mass):
    """Masses beside reactions in the same equations, from those of atoms to those of planets."""

    def moved(mass):
        system = lv.Lagrangian(
            lambda t, q, v, params: mass * (ca.sumsqr(v) / 2 - 9.81 * q[1]),
            None if kind == "skate" else lambda t, q, p: {"rod": (ca.sumsqr(q[:2]) - p.l**2) / 2},
            q=3,
            params={"l": 1.0},
            force=lambda t, q, v, params: -0.1 * mass * v,
            nonholonomic=(lambda t, q, v, p: {"edge": v[0] * ca.sin(q[2]) - v[1] * ca.cos(q[2])})
            if kind == "skate"
            else None,
        )
        start = {"q": [1.0, 0.0, 0.0], "v": [0.0, 0.0, 1.0]}
        if kind == "controlled":
            run = lv.integrate(system, lv.GeneralizedAlpha(), t=(0, 0.5), rtol=1e-5, **start)
            return run.q[-1]
        more = {"tangents": {"params.l": 1.0}} if kind == "tangents" else {}
        method = lv.GeneralizedAlpha() if kind == "generalized alpha" else lv.Spark(3)
        run = lv.integrate(system, method, t=(0, 0.5), h=0.02, **start, **more)
        return run.tangents["params.l"].q[-1] if more else run.q[-1]

    np.testing.assert_allclose(moved(mass), moved(1.0), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("method", [lv.Spark(3), lv.GeneralizedAlpha()])
def test_gradients_are_taken_in_any_unit_of_mass(method):
    mass = 2.0**-66
    rod = lv.Lagrangian(
        lambda t, q, v, params: mass * (ca.sumsqr(v) / 2 - 9.81 * q[1]),
        lambda t, q, params: {"rod": (ca.sumsqr(q) - params.l**2) / 2},
        q=2,
        params={"l": 1.0},
    )
    call = {"t": (0, 0.2), "h": 0.02, "q": [1.0, 0.0], "v": [0.0, 0.0]}
    assert lv.analysis.check_gradient(rod, method, wrt=["params.l"], **call).differences < 1e-10
