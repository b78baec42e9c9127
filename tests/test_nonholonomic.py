"""Nonholonomic constraints, alone and beside holonomic ones: digits, orders, bad calls.

The systems are those of `families`, and a disk on a spring.
"""

import functools

import casadi as ca
import numpy as np
import pytest
from families import FAMILIES, rolling_disk
from registry import REFERENCE

import liouville as lv
from liouville.analysis.convergence import study


def sprung_disk():
    """Return the disk on a level plane, its centre held by a spring: its motion is bounded."""
    return lv.Lagrangian(
        lambda t, q, v, params: (
            (ca.sumsqr(v[:2]) - ca.sumsqr(q[:2])) / 2 + v[2] ** 2 / 4 + v[3] ** 2 / 8
        ),
        nonholonomic=lambda t, q, v, params: [
            v[0] - ca.cos(q[3]) * v[2],
            v[1] - ca.sin(q[3]) * v[2],
        ],
        q=("x", "y", "th", "ph"),
    )


# the problems of the registry with velocities constrained
NAMES = {"knife_edge": "knife edge", "rolling_disk": "rolling disk", "pace": "pace", "bowl": "bowl"}
SPRUNG = (sprung_disk(), {"q": [0.5, 0, 0, 0], "v": [1, 0, 1, 0.7]})
ALL = tuple(NAMES)
STATEMENT = REFERENCE["nonholonomic"]


def started(name):
    """Return a system and a consistent start."""
    problem = FAMILIES[NAMES[name]]
    return problem.system, problem.start


def run(name, method, t, steps, **more):
    system, start = started(name)
    return lv.integrate(system, method, t=t, steps=steps, **{**start, **more})


def numbers(values):
    return np.array(values, dtype=float)


@pytest.mark.parametrize("name", ["knife_edge", "rolling_disk"])
def test_one_step_has_the_digits_of_69_digit_arithmetic(name):
    for stages, expected in STATEMENT[name]["one_step_h=1/10"].items():
        found = run(name, lv.Spark(int(stages)), (0, 0.1), 1)
        np.testing.assert_allclose(found.q[-1], numbers(expected["y1"]), rtol=0, atol=5e-16)
        np.testing.assert_allclose(found.v[-1], numbers(expected["z1"]), rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["knife_edge", "rolling_disk"])
def test_high_order_reaches_the_exact_motion_and_its_multipliers(name):
    for end, exact in STATEMENT[name]["end_states"].items():
        found = run(name, lv.Spark(7), (0, float(end)), 20 * int(end))
        np.testing.assert_allclose(found.q[-1], numbers(exact["y"]), rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.v[-1], numbers(exact["z"]), rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.lam[-1], numbers(exact["psi"]), rtol=0, atol=2e-14)


def test_the_knife_edge_follows_its_closed_form():
    found, w = run("knife_edge", lv.Spark(6), (0, 10), 200), 1.5
    t = found.t
    exact = [np.sin(w * t) ** 2 / (2 * w**2), (w * t - np.sin(2 * w * t) / 2) / (2 * w**2), w * t]
    np.testing.assert_allclose(found.q, np.transpose(exact), rtol=0, atol=1e-12)


@functools.cache
def exact_end(name):
    found = run(name, lv.Spark(8), (0, 2), 64)
    return {state: found.states[state][-1] for state in ("q", "v", "lam")}


STEPS = (64, 128, 256), (16, 32, 64), (10, 16, 26), (8, 10, 12)
# how much finer the steps of a system have to be
FINER = {"pace": 1, "rolling_disk": 1.5, "bowl": 2}
GAUSS = [(lv.Spark(s), 2 * s, STEPS[s - 1]) for s in (1, 2, 3, 4)]
PAIRS = [(lv.LobattoPair(s), 2 * s - 2, STEPS[s - 2]) for s in (2, 3, 4)]
OTHERS = [
    (lv.LobattoPair(3, force="C"), 4, STEPS[1]),
    (lv.Spark(2, points="radau"), 3, STEPS[0]),
]


@pytest.mark.parametrize(("method", "order", "steps"), GAUSS + PAIRS + OTHERS, ids=str)
@pytest.mark.parametrize("name", FINER)
def test_order_is_as_claimed(name, method, order, steps):
    system, start = started(name)
    hs = [2 / int(k * FINER[name]) for k in steps]
    of = ("q", "v", "lam")
    found = study(system, method, (0, 2), hs, start, exact_end(name), of=of)
    for state in of:
        assert abs(found.order[state] - order) < 0.15, (state, found.errors[state])


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(3)], ids=str)
@pytest.mark.parametrize("name", ALL)
def test_all_constraints_hold_at_every_step_to_roundoff(name, method):
    found = run(name, method, (0, 20), 400)
    size = 1 + np.abs(found.q).max() + np.abs(found.v).max() ** 2
    for residual, values in found.residuals.items():
        assert values.size == 0 or np.abs(values).max() < 2e-15 * size, residual
    assert found.residuals["nonholonomic"].shape[1] == len(started(name)[0].nonholonomic)


@pytest.mark.parametrize("method", [lv.Spark(3), lv.LobattoPair(3)], ids=str)
@pytest.mark.parametrize("name", ALL)
def test_a_step_back_undoes_a_step(name, method):
    system, start = started(name)
    there = lv.integrate(system, method, t=(0, 0.4), steps=2, **start)
    back = lv.integrate(system, method, t=(0.4, 0), steps=2, q=there.q[-1], v=there.v[-1])
    for state in ("q", "v"):
        np.testing.assert_allclose(back.states[state][-1], start[state], rtol=0, atol=4e-15)


@pytest.mark.parametrize("method", [lv.Spark(1), lv.Spark(2), lv.LobattoPair(2)], ids=str)
@pytest.mark.parametrize("name", ["knife_edge", "disk on a spring"])
def test_energy_is_bounded_without_drift(name, method):
    system, start = SPRUNG if name == "disk on a spring" else started(name)
    found = lv.integrate(system, method, t=(0, 300), steps=3000, **start)
    error = np.abs(found.invariants["energy"] - found.invariants["energy"][0])
    assert 1e-12 < error[-1000:].max() < 1.05 * error[:1000].max()


def test_both_descriptions_of_a_system_make_the_same_step():
    def mass(q):
        return 1 + q[0] ** 2 / 4

    system, start = started("pace")
    momenta = lv.Hamiltonian(
        lambda t, q, p, params: (
            ca.sumsqr(p + ca.vertcat(ca.sin(q[1]) / 3, 0, 0)) / (2 * mass(q)) + q[2]
        ),
        nonholonomic=lambda t, q, v, params: (ca.dot(v, v) - (1 + ca.sin(t) / 5) ** 2) / 2,
        q=3,
    )
    velocities = lv.integrate(system, lv.Spark(2), t=(0, 1), steps=10, **start)
    found = lv.integrate(momenta, lv.Spark(2), t=(0, 1), steps=10, q=start["q"], p=velocities.p[0])
    np.testing.assert_allclose(found.q, velocities.q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.p, velocities.p, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.lam, velocities.lam, rtol=0, atol=1e-13)


def test_reactions_of_the_general_system_are_its_own():
    def scaled(reaction):
        return lv.Mechanical(
            velocity=lambda t, y, z, params: 2 * z,
            momentum=lambda t, y, z, params: 2 * z,
            force=lambda t, y, z, params: ca.vertcat(1, 0, 0),
            nonholonomic=lambda t, y, z, params: ca.sin(y[2]) * z[0] - ca.cos(y[2]) * z[1],
            nonholonomic_reaction=reaction,
            y=3,
        )

    def nonlinear(t, y, z, lam, params):
        return -ca.vertcat(ca.sin(y[2]), -ca.cos(y[2]), 0) * (lam + lam**3 / 10)

    start = {"y": [0, 0, 0], "z": [0, 0, 0.75]}
    edge = run("knife_edge", lv.Spark(3), (0, 1), 10)
    ideal = lv.integrate(scaled(None), lv.Spark(3), t=(0, 1), steps=10, **start)
    other = lv.integrate(scaled(nonlinear), lv.Spark(3), t=(0, 1), steps=10, **start)
    for found in (ideal, other):
        np.testing.assert_allclose(found.y, edge.q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(2 * found.z, edge.v, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.reaction(), edge.reaction(), rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", ["Lagrangian", "Hamiltonian"])
def test_many_blades_move_as_each_alone(kind):
    count, z = 50, {"Lagrangian": "v", "Hamiltonian": "p"}[kind]

    def blades(t, q, v, params):
        return ca.sin(q[2::3]) * v[::3] - ca.cos(q[2::3]) * v[1::3]

    sign = 1 if kind == "Lagrangian" else -1
    many = getattr(lv, kind)(
        lambda t, q, z, params: ca.dot(z, z) / 2 + sign * ca.sum1(q[::3]),
        nonholonomic=blades,
        q=3 * count,
    )
    start = {"q": np.zeros(3 * count), z: np.tile([0, 0, 1.5], count)}
    found = lv.integrate(many, lv.Spark(1), t=(0, 0.2), steps=2, **start)
    alone = run("knife_edge", lv.Spark(1), (0, 0.2), 2)
    np.testing.assert_allclose(found.q, np.tile(alone.q, count), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.lam, np.tile(alone.lam, count), rtol=0, atol=1e-14)


def test_names_residuals_and_reactions_tell_the_kinds_apart():
    system, start = started("bowl")
    assert repr(system) == "Lagrangian(x, y, z, th; 1 constraint, 1 nonholonomic)"
    assert repr(rolling_disk()) == "Lagrangian(x, y, th, ph; 2 nonholonomic)"
    found = lv.integrate(system, lv.Spark(2), t=(0, 1), steps=10, **start)
    assert found.names["constraints"] == ("bowl", "blade")
    assert {name: x.shape[1] for name, x in found.residuals.items()} == {
        "constraint": 1, "hidden": 1, "nonholonomic": 1
    }  # fmt: skip
    blade = found.reaction("blade")
    angle = found.q[:, 3] + found.t / 3
    across = np.stack([-np.sin(angle), np.cos(angle), 0 * angle, 0 * angle], axis=1)
    np.testing.assert_allclose(blade, found.lam[:, 1:] * across, atol=1e-14)
    np.testing.assert_allclose(blade + found.reaction("bowl"), found.reaction(), atol=1e-14)


def test_a_saved_solution_comes_back(tmp_path):
    found = run("bowl", lv.Spark(2), (0, 1), 5)
    found.save(tmp_path / "bowl.nc")
    back = lv.load(tmp_path / "bowl.nc")
    assert list(back.residuals) == ["constraint", "hidden", "nonholonomic"]
    for name, values in found.residuals.items():
        np.testing.assert_array_equal(back.residuals[name], values)
    found.save(tmp_path / "bowl.csv")
    head = (tmp_path / "bowl.csv").read_text().splitlines()[0]
    assert "nonholonomic[blade]" in head
    assert "nonholonomic[bowl]" not in head


@pytest.mark.parametrize("name", ALL)
def test_a_start_is_moved_by_the_least_change(name):
    system, near = started(name)
    start = system.consistent(t=0.3, q=near["q"] + 0.05, v=near["v"] + 0.05)
    found = lv.integrate(system, lv.Spark(1), t=(0.3, 0.3 + 1e-6), steps=1, **start)
    for residual, values in found.residuals.items():
        assert values.size == 0 or np.abs(values[0]).max() < 1e-15, residual


def test_a_start_off_its_constraints_is_refused():
    system, start = started("rolling_disk")
    with pytest.raises(ValueError, match="the nonholonomic constraint 'rolls along y'") as error:
        lv.integrate(system, lv.Spark(1), t=(0, 1), steps=1, q=start["q"], v=[1, 0.01, 1, 0.5])
    assert "consistent(q=" in str(error.value)


def plane(nonholonomic, constraint=None, q=("x", "y", "th")):
    return lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2, constraint, nonholonomic=nonholonomic, q=q
    )


def test_bad_constraints_are_refused():
    with pytest.raises(ValueError, match="'wall' does not depend on the velocity\nhint: it is hol"):
        plane(lambda t, q, v, params: {"blade": v[0], "wall": q[0] - 1})
    for number in (0, 1):
        words = f"'a' is the same for all velocities: it is the number {number}"
        with pytest.raises(ValueError, match=words):
            plane(lambda t, q, v, params, number=number: {"a": number})
    with pytest.raises(ValueError, match="'a' is the same for all velocities: none of them"):
        plane(lambda t, q, v, params: {"a": t})
    with pytest.raises(ValueError, match="'a' is the same for all velocities: it jumps"):
        plane(lambda t, q, v, params: {"a": v[0] == 1})
    with pytest.raises(ValueError, match="'a' names a holonomic and a nonholonomic"):
        plane(lambda t, q, v, params: {"a": v[0]}, lambda t, q, params: {"a": q[1]})
    with pytest.raises(TypeError, match="without nonholonomic constraints"):
        lv.Mechanical(
            velocity=lambda t, y, z, params: z,
            momentum=lambda t, y, z, params: z,
            force=lambda t, y, z, params: -y,
            nonholonomic_reaction=lambda t, y, z, lam, params: z,
            y=2,
        )


def test_constraints_that_leave_nothing_to_move_hold_it():
    for constraint in (None, lambda t, q, params: q[0]):
        fast = plane(lambda t, q, v, params: [v[0], v[1], v[2]], constraint)
        run = lv.integrate(fast, lv.Spark(2), t=(0, 1), steps=5, q=[0, 1, 2], v=[0, 0, 0])
        assert np.abs(run.q[-1] - [0, 1, 2]).max() < 1e-14


def test_a_gradient_that_vanishes_is_named():
    still = plane(lambda t, q, v, params: {"speed": ca.sumsqr(v) - t})
    with pytest.raises(lv.IntegrationError, match="gradient of constraint 'speed' vanishes"):
        lv.integrate(still, lv.Spark(2), t=(0, 1), steps=5, q=[0, 0, 0], v=[0, 0, 0])


def test_methods_without_them_refuse_and_name_one_that_has():
    system, start = started("knife_edge")
    for method in (lv.HHT(), lv.GeneralizedAlpha(0.8)):
        with pytest.raises(TypeError, match=r"nonholonomic constraints.*\nhint: take Spark"):
            lv.integrate(system, method, t=(0, 1), steps=5, **start)
    with pytest.raises(ValueError, match="solver='auto'"):
        lv.integrate(system, lv.Spark(2, "node-schur"), t=(0, 1), steps=5, **start)
