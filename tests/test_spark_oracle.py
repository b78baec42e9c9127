"""SPARK steps beside the same equations solved all at once, and both beside 69-digit arithmetic."""

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
