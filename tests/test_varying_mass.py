"""Small systems whose mass varies: their steps are those that larger systems make."""

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville.problems import heavy_top


def rods(t, q, v, p):
    """Return L of two rods in absolute angles, and a mass that slides on the second and grows."""
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    slide = (1 + t / 4) * (v[2] ** 2 + (q[2] * v[1]) ** 2) / 2
    return kinetic + slide + 6 * ca.cos(q[0]) + (3 + q[2]) * ca.cos(q[1]) - q[2] ** 2


def arm(t, q, v, p):
    """Return L of a point whose mass varies from place to place, and a rotor that it drives."""
    mass = 2 + ca.sin(q[0]) * q[1]
    return mass * ca.dot(v[:3], v[:3]) / 2 + v[3] ** 2 / 2 + v[2] * v[3] * q[0] / 4 - q[2] - q[3]


def held(t, q, p):
    """Keep the point on a sphere, and the rotor turned by it."""
    return ca.vertcat((ca.dot(q[:3], q[:3]) - 1) / 2, q[3] - q[0] * q[1])


def saddle(t, q, v, p):
    """Return L with a kinetic energy of both signs: no mass stands on the diagonal."""
    return (1 + q[0] ** 2) * v[0] * v[1] - (q[0] ** 2 + q[1] ** 2) / 2


TOP = {"m": 15.0, "J": (0.234375, 0.46875, 0.234375), "X": (0.0, 1.0, 0.0), "g": 9.81, "mu": 60.0}
CASES = {
    "top": (
        heavy_top.lagrangian,
        lambda t, q, p: (ca.dot(q, q) - 1) / 2,
        4,
        heavy_top.start,
        TOP,
    ),
    "rods": (rods, None, 3, {"q": (1.0, 1.4, 0.3), "v": (0.2, -0.1, 0.5)}, None),
    "arm": (
        arm,
        held,
        4,
        {"q": (0.6, 0.0, 0.8, 0.0), "v": (0.0, 0.5, 0.0, 0.3)},
        None,
    ),
    "saddle": (saddle, None, 2, {"q": (0.5, 0.1), "v": (0.2, 0.3)}, None),
}


def built(name, is_large):
    """Return a case and its start; a large one has coordinates that rest, and take no part."""
    lagrangian, constraint, n, start, params = CASES[name]
    more = 5 - n if is_large else 0

    def energy(t, q, v, p):
        return lagrangian(t, q[:n], v[:n], p) + ca.dot(v[n:], v[n:]) / 2

    system = lv.Lagrangian(
        energy,
        constraint and (lambda t, q, p: constraint(t, q[:n], p)),
        q=tuple(f"x{i}" for i in range(n + more)),
        params=params or {},
    )
    return system, {key: (*x, *[0.0] * more) for key, x in start.items()}


METHODS = {
    "Spark(1)": lv.Spark(1),
    "Spark(4)": lv.Spark(4),
    "Spark(7)": lv.Spark(7),
    "Spark(3), solver newton": lv.Spark(3, solver="newton"),
    "Spark(3), radau": lv.Spark(3, points="radau"),
    "LobattoPair(4)": lv.LobattoPair(4),
    "LobattoPair(4, C)": lv.LobattoPair(4, "C"),
}
STEPS = {"top": 0.004, "rods": 0.1, "arm": 0.1, "saddle": 0.1}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", METHODS)
def test_a_small_system_goes_the_way_of_a_large_one(case, method):
    found = []
    for is_large in (False, True):
        system, start = built(case, is_large)
        span = {"t": (0, 30 * STEPS[case]), "steps": 30}
        found.append(lv.integrate(system, METHODS[method], **span, **start))
    small, large = found
    for name in ("q", "v", "p"):
        x, n = small.states[name], small.states[name].shape[1]
        size = np.abs(x).max()
        np.testing.assert_allclose(large.states[name][:, :n], x, rtol=0, atol=2e-13 * size)
    assert small.stats["iterations"] <= large.stats["iterations"] + 30


def test_loose_steps_keep_both_kinds_of_constraints():
    system, start = built("arm", False)
    method = lv.Spark(4, newton_tol=1e-4)
    solution = lv.integrate(system, method, t=(0, 5), steps=20, **start)
    strict = lv.integrate(system, lv.Spark(4), t=(0, 5), steps=20, **start)
    assert solution.stats["iterations"] < strict.stats["iterations"]
    for residual in solution.residuals.values():
        assert np.abs(residual).max() < 1e-14
    assert 1e-12 < np.abs(solution.q - strict.q).max() < 1e-3


@pytest.mark.parametrize("case", CASES)
def test_members_have_the_bits_they_have_alone(case):
    """The fastest are too fast for the step, and leave the others."""
    system, start = built(case, False)
    speeds = np.geomspace(0.1, 4.0, 19)[:, None]
    given = {"q": np.tile(start["q"], (19, 1)), "v": speeds * np.array(start["v"])}
    span = {"t": (0, 20 * STEPS[case]), "steps": 20}
    whole = lv.ensemble(system, lv.Spark(5), **span, **given)
    for member in range(0, 19, 3):
        if member in whole.failures:
            continue
        own = {name: x[member] for name, x in given.items()}
        alone = lv.integrate(system, lv.Spark(5), **span, **own)
        for name, values in alone.states.items():
            np.testing.assert_array_equal(whole.states[name][:, member], values, err_msg=name)


def test_a_long_first_step_goes_by_way_of_its_half():
    h = 2 / 136
    first, two, parts = (
        lv.integrate(heavy_top.system, lv.Spark(7), t=(0, t), steps=steps, **heavy_top.start)
        for t, steps in ((h, 1), (2 * h, 2), (h, 16))
    )
    # that of the half, and one for each step: no other solution had to be confirmed
    assert first.stats["newton_steps"] == 2
    assert two.stats["newton_steps"] == 3
    for name in ("q", "v"):
        np.testing.assert_allclose(first.states[name][-1], parts.states[name][-1], atol=1e-11)
        np.testing.assert_array_equal(first.states[name][-1], two.states[name][1])
