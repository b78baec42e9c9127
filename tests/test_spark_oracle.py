"""SPARK steps beside the same equations solved all at once, and both beside 69-digit arithmetic."""

from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from plain_spark import Plain, gauss, lobatto
from registry import (
    PROBLEMS,
    REFERENCE,
    SYSTEMS,
    breathing_constraint,
    breathing_force,
    printed,
    top_lagrangian,
    wire_lagrangian,
)

import liouville as lv
from liouville.problems import NONHOLONOMIC, load

PLAIN = {
    "spherical": Plain.lagrangian(
        3, lambda t, q, v: ca.dot(v, v) / 2 - q[2], lambda t, q: (ca.dot(q, q) - 1) / 2
    ),
    "double_pendulum": Plain.lagrangian(
        4,
        lambda t, q, v: ca.dot(v, v) / 2 - q[1] - q[3],
        lambda t, q: [(ca.dot(x, x) - 1) / 2 for x in (q[:2], q[2:] - q[:2])],
    ),
    "heavy_top_quaternion": Plain.lagrangian(
        4, top_lagrangian, lambda t, q: (ca.dot(q, q) - 1) / 2
    ),
    "moving_wire": Plain.lagrangian(
        2,
        wire_lagrangian,
        lambda t, q: q[1] - q[0] ** 2 / 2 - ca.sin(2 * t) / 2,
        force=lambda t, q, v: -v / 10,
    ),
    "knife_edge": Plain(
        3,
        lambda t, y, z: z,
        lambda t, y, z: ca.vertcat(1, 0, 0),
        k=lambda t, y, z: ca.sin(y[2]) * z[0] - ca.cos(y[2]) * z[1],
    ),
    "rolling_disk": Plain(
        4,
        lambda t, y, z: ca.vertcat(z[0], z[1], z[2] / 2, z[3] / 4),
        lambda t, y, z: ca.vertcat(-0.5, 0, 0, ca.sin(y[3]) / 3),
        k=lambda t, y, z: [z[0] - ca.cos(y[3]) * z[2], z[1] - ca.sin(y[3]) * z[2]],
    ),
}
STARTS = {name: printed(name, "y0", "z0") for name in SYSTEMS} | {
    "knife_edge": (np.zeros(3), np.array([0, 0, 1.5])),
    "rolling_disk": (np.zeros(4), np.array([1, 0, 1, 0.5])),
}


def one_step_cases():
    """Return the printed steps: problem, key, tableau and the state after h = 1/10."""
    for name in SYSTEMS:
        for s, end in REFERENCE["problems"][name]["spark_one_step_h=1/10"].items():
            yield name, f"gauss {s}", gauss(int(s)), end
    for name, ends in REFERENCE["lobatto_IIIA_IIIB_one_step_h=1/10"].items():
        for s, end in ends.items():
            yield name, f"lobatto {s}", lobatto(int(s)), end
    for name, problem in REFERENCE["nonholonomic"].items():
        for s, end in problem["one_step_h=1/10"].items():
            yield name, f"gauss {s}", gauss(int(s)), end


@pytest.mark.parametrize(
    ("name", "key", "tableau", "end"),
    [pytest.param(*case, id=f"{case[0]}-{case[1]}") for case in one_step_cases()],
)
def test_the_plain_steps_have_the_digits_of_69_digit_arithmetic(name, key, tableau, end):
    y1, z1, _, nu = PLAIN[name].step(key, tableau, 0.0, *STARTS[name], 0.1)
    np.testing.assert_allclose(y1, np.array(end["y1"], dtype=float), rtol=0, atol=4e-16)
    np.testing.assert_allclose(z1, np.array(end["z1"], dtype=float), rtol=0, atol=1e-15)
    if "Psi_stages" in end:
        exact = np.array(end["Psi_stages"], dtype=float)
        np.testing.assert_allclose(nu, exact, rtol=0, atol=1e-14)


METHODS = {
    **{f"gauss {s}": (lv.Spark(s), gauss(s)) for s in (1, 2, 3)},
    **{f"lobatto {s}": (lv.LobattoPair(s), lobatto(s)) for s in (2, 3, 4)},
}


def plain_of(problem):
    """Return the plain equations of a library problem."""
    params = SimpleNamespace(**problem.system.params)

    def values(function, *args):
        return list(function(*args, params).values())

    constraint = getattr(problem, "constraint", None)
    return Plain.lagrangian(
        len(problem.system.coordinates),
        lambda t, q, v: problem.lagrangian(t, q, v, params),
        constraint and (lambda t, q: values(constraint, t, q)),
        lambda t, q, v: values(problem.nonholonomic, t, q, v),
    )


def assert_same_step(system, plain, key, method, tableau, start, t=0.0, h=0.1):
    found = lv.integrate(system, method, t=(t, t + h), steps=1, **start)
    q, v = (np.array(start[state], dtype=float) for state in "qv")
    q1, v1, *_ = plain.step(key, tableau, t, q, v, h)
    np.testing.assert_allclose(found.q[-1], q1, rtol=0, atol=2e-15)
    np.testing.assert_allclose(found.v[-1], v1, rtol=0, atol=1e-14)


@pytest.mark.parametrize("key", METHODS)
@pytest.mark.parametrize("name", NONHOLONOMIC)
def test_nonholonomic_steps_are_the_plain_ones(name, key):
    problem = load(name)
    assert_same_step(problem.system, plain_of(problem), key, *METHODS[key], problem.start)


@pytest.mark.parametrize("points", [2, 3, 4])
@pytest.mark.parametrize("force", ["A", "B", "C", "C*", "D"])
def test_a_pair_with_any_forces_makes_the_plain_step(force, points):
    problem = PROBLEMS["breathing sphere"]
    plain = Plain.lagrangian(
        3, lambda t, q, v: ca.dot(v, v) / 2, breathing_constraint, force=breathing_force
    )
    start = problem.system.consistent(t=0.3, **problem.start)
    method, tableau = lv.LobattoPair(points, force), lobatto(points, force)
    assert_same_step(problem.system, plain, force, method, tableau, start, t=0.3)


@pytest.mark.parametrize(
    "method",
    [lv.Spark(20), lv.Spark(28), lv.Spark(64), lv.Spark(40, points="radau"), lv.LobattoPair(32)],
    ids=repr,
)
@pytest.mark.parametrize("members", [1, 5])
def test_many_stages_keep_velocities_to_roundoff(method, members):
    spring = lv.Lagrangian(lambda t, q, v, params: v[0] ** 2 / 2 - q[0] ** 2 / 2, q=("x",))
    start = {"q": np.ones((members, 1)), "v": np.zeros((members, 1))}
    solution = lv.ensemble(spring, method, t=(0, 2), h=0.1, **start)
    assert abs(solution.v[..., 0] + np.sin(solution.t)[:, None]).max() < 2e-15
    assert abs(solution.invariants["energy"] - 0.5).max() < 2e-15


def flywheels_on_links(links, wheels):
    """Return T - V and the rods of links of length 1 whose last end drives the wheels."""

    def energies(t, q, v):
        heights = q[1 : 2 * links : 2]
        return ca.dot(v, v) / 2 - ca.sum1(heights) + ca.sum1(q[2 * links :]) * heights[-1]

    def rods(t, q):
        places = [ca.DM.zeros(2), *(q[2 * k : 2 * k + 2] for k in range(links))]
        return [ca.sumsqr(b - a) / 2 - 0.5 for a, b in pairwise(places)]

    return energies, rods if links else None


@pytest.mark.parametrize("key", ["gauss 2", "gauss 3", "lobatto 3"])
@pytest.mark.parametrize(("links", "wheels"), [(2, 1), (2, 2), (2, 3), (3, 0), (3, 1), (4, 0)])
def test_steps_of_five_to_eight_coordinates_are_the_plain_ones_and_the_same_in_lanes(
    links, wheels, key
):
    energies, rods = flywheels_on_links(links, wheels)
    n = 2 * links + wheels
    system = lv.Lagrangian(
        lambda t, q, v, params: energies(t, q, v), lambda t, q, params: rods(t, q), q=n
    )
    q = np.concatenate([np.arange(1, links + 1), np.zeros(links)]).reshape(2, links).T.ravel()
    start = {"q": np.append(q, np.full(wheels, 0.3)), "v": np.append(np.zeros(n - 1), 0.2)}
    start = system.consistent(**start)
    method, tableau = METHODS[key]
    plain = Plain.lagrangian(n, energies, rods)
    assert_same_step(system, plain, key, method, tableau, start)
    alone = lv.integrate(system, method, t=(0, 1), h=0.1, **start)
    rows = {state: np.tile(start[state], (3, 1)) for state in "qv"}
    members = lv.ensemble(system, method, t=(0, 1), h=0.1, **rows)
    for state in "qv":
        assert (getattr(members, state) == getattr(alone, state)[:, None]).all()


def test_reactions_that_are_not_ideal_are_those_of_full_newton_in_seven_coordinates():
    """Rods push along other directions than those they hold, so that G M⁻¹ r_λ is not symmetric."""
    _, rods = flywheels_on_links(3, 1)

    def reaction(t, y, lam, params):
        ideal = ca.jtimes(ca.vertcat(*rods(t, y)), y, lam, True)
        return ideal + ca.vertcat(3 * lam[2], lam[0], 0, 2 * lam[1], 0, lam[0] - lam[2], 0)

    system = lv.Mechanical(
        velocity=lambda t, y, z, params: z,
        momentum=lambda t, y, z, params: z,
        force=lambda t, y, z, params: ca.vertcat(0, -1, 0, -1, 0, -1 + y[6], y[5]),
        reaction=reaction,
        constraint=lambda t, y, params: rods(t, y),
        y=7,
    )
    start = system.consistent(y=[1, 0, 2, 0, 3, 0, 0.3], z=[0, 0, 0, 0, 0, 0, 0.2])
    runs = [
        lv.integrate(system, lv.Spark(3, solver=solver), t=(0, 0.5), h=0.05, **start)
        for solver in ("auto", "newton")
    ]
    np.testing.assert_allclose(runs[0].z, runs[1].z, rtol=0, atol=1e-13)
    assert max(abs(x).max() for x in runs[0].residuals.values()) < 1e-14
