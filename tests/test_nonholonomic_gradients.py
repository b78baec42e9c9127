"""Tangents and pullbacks of nonholonomic motions, whose end is solved for with the stages.

Rows of the registry are in `test_tangents` and `test_adjoints`; here is what a row cannot see.
"""

import casadi as ca
import event_cases as of_events
import numpy as np
import pytest
from test_adjoints import paired
from test_tangents import differences, directions_of, farthest

import liouville as lv

METHODS = [lv.Spark(1), lv.Spark(3), lv.LobattoPair(3), lv.LobattoPair(3, "C")]
TIMES = [0.23, 0.33, 0.71, 0.79]


def general(holonomic=True):
    """Return a system whose every function is nonlinear and depends on time and parameters."""

    def velocity(t, y, z, params):
        return z * (1 + params.a * ca.dot(y, y) / 9) + params.a * ca.sin(t) * ca.vertcat(y[1:], 1)

    def momentum(t, y, z, params):
        return z * (1 + params.c * ca.dot(z, z) / 4 + ca.cos(t) / 5) + params.a * y * y / 5

    def force(t, y, z, params):
        return ca.vertcat(z[1], -z[0], -params.c, y[1]) - params.a * z / 5

    def reaction(t, y, lam, params):
        return -2 * y * lam + params.a * lam * ca.vertcat(y[1], 0, t / 9, 0)

    def blade(t, y, z, params):
        angle = params.b * y[3] + t / 3
        slip = ca.sin(angle) * z[0] - ca.cos(angle) * z[1]
        return slip + params.c * ca.dot(z, z) / 9 + ca.sin(t) / 5

    def pull(t, y, z, lam, params):
        angle = params.b * y[3] + t / 3
        row = ca.vertcat(ca.sin(angle), -ca.cos(angle), 0, params.a * y[0])
        return -(row + params.c * z / 4) * (lam + lam**3 / 9)

    sphere = {
        "reaction": reaction,
        "constraint": lambda t, y, params: ca.dot(y, y) - (params.l + ca.sin(t) / 9) ** 2,
    }
    return lv.Mechanical(
        velocity=velocity, momentum=momentum, force=force, nonholonomic=blade,
        nonholonomic_reaction=pull, y=4, params={"a": 0.4, "b": 0.8, "c": 0.7, "l": 1.1},
        **(sphere if holonomic else {}),
    )  # fmt: skip


def started(holonomic=True):
    system = general(holonomic)
    given = {"y": [0.6, 0.1, -0.8, 0.2], "z": [0.1, 1.2, 0.4, -0.3]}
    directions = directions_of(system, "t0", "t1")
    if not holonomic:
        directions.pop("params.l")
    return system, system.consistent(t=0.2, **given), directions


@pytest.mark.parametrize("holonomic", [True, False])
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_every_parameter_of_every_function_and_both_ends(method, holonomic):
    (system, start, directions), t, run = started(holonomic), (0.2, 0.8), {"steps": 4}
    found = lv.integrate(system, method, t=t, tangents=directions, **run, **start)
    plain = lv.integrate(system, method, t=t, **run, **start)
    assert np.array_equal(found.z, plain.z)
    for name, direction in directions.items():
        wanted = differences(system, method, t, start, {name: direction}, **run)
        assert farthest(found.tangents[name].states, wanted) < 1e-9, name
    assert paired(system, method, t, start, directions, steps=10, every=3) < 1e-12


@pytest.mark.parametrize("control", [
    {"rtol": 1e-7}, {"control": lv.Reversible(), "h": 0.05}, {"steps": 6, "t_eval": TIMES},
], ids=str)  # fmt: skip
def test_controlled_steps_and_given_times(control):
    system, start, directions = started()
    if "steps" in control:
        held = differences(system, lv.Spark(2), (0.2, 0.8), start, directions, **control)
        found = lv.integrate(system, lv.Spark(2), t=(0.2, 0.8), tangents=directions, **control,
                             **start)  # fmt: skip
        own = [found.tangents[name].states for name in directions]
        assert farthest({x: sum(each[x] for each in own) for x in held}, held) < 1e-9
    else:
        directions = {name: x for name, x in directions.items() if name not in ("t0", "t1")}
    run = {"least": 1.0, **control}
    assert paired(system, lv.Spark(2), (0.2, 0.8), start, directions, **run) < 1e-12


def sled(speed=False):
    """Return a sled in a bowl that hits a wall and is pushed, and what happens to it."""

    def blade(t, q, v, params):
        angle = q[3] + t / 3
        own = ca.sin(angle) * v[0] - ca.cos(angle) * v[1] + params.slip * ca.sin(t)
        return own + ca.dot(v, v) / 9 if speed else own

    system = lv.Lagrangian(
        lambda t, q, v, params: (
            ca.sumsqr(v[:3]) / 2 + (1 + q[0] ** 2 / 3) * v[3] ** 2 / 2 - q[2] - ca.cos(q[3]) / 2
        ),
        lambda t, q, params: q[2] - params.bend * (1 + ca.sin(t) / 5) * ca.sumsqr(q[:2]) / 2,
        nonholonomic=blade, q=("x", "y", "z", "th"),
        params={"slip": 0.2, "bend": 1.0, "e": 0.7, "wall": 0.7},
    )  # fmt: skip
    events = {
        "wall": lv.Event(lambda t, q, v, lam, params: q[0] - params.wall, "up",
                         reset=lv.Impact(lambda t, q, v, lam, params: params.e)),
        "push": lv.Event(lambda t, q, v, lam, params: q[3] - 0.7 - t / 9,
                         reset=lambda t, q, v, lam, params: v * (1 + params.slip)),
        "pull": lambda t, q, v, lam, params: lam[1] + lam[0] / 9 - 0.7,
    }  # fmt: skip
    start = system.consistent(q=[0.5, 0.2, 0.1, 0.3], v=[1, 0.1, 0, 0.7])
    return system, events, start


def test_impacts_resets_and_events_of_multipliers():
    system, events, start = sled()
    directions = directions_of(system, "t0", "t1")
    run = {"steps": 30, "events": events}
    found = of_events.check(system, lv.Spark(2), (0.0, 1.5), start, directions, **run)
    assert all(len(points) for points in found.events.values())
    run["t_eval"] = [0.0, 0.3, 0.71, 1.2, 1.5]
    found = of_events.paired(system, lv.Spark(2), (0.0, 1.5), start, directions, **run)
    assert found < 1e-12


def test_impulses_that_turn_with_the_velocity_are_refused():
    system, events, start = sled(speed=True)
    call = {"t": (0, 1), "steps": 20, "events": {"wall": events["wall"]}}
    with pytest.raises(TypeError, match=r"impulses of event 'wall'.*turn with the velocity"):
        lv.integrate(system, lv.Spark(2), tangents={"params.e": 1.0}, **call, **start)


def test_multipliers_of_a_rolling_constraint_that_a_rail_implies():
    system = lv.Lagrangian(
        lambda t, q, v, params: params.m * ca.sumsqr(v) / 2 - q[1] - q[0] * q[1] / 4,
        lambda t, q, params: {"rail": q[0] - params.m * q[1]},
        nonholonomic=lambda t, q, v, params: {
            "slip": v[0] - (1 + q[2] ** 2) * v[2], "again": 2 * (v[0] - params.m * v[1]),
        },
        q=("x", "y", "angle"), params={"m": 1.2},
    )  # fmt: skip
    start = system.consistent(q=[0.6, 0.5, 0.0], v=[0.36, 0.3, 0.36])
    directions, run = directions_of(system), {"steps": 5}
    found = lv.integrate(system, lv.Spark(3), t=(0, 1), tangents=directions, **run, **start)
    wanted = differences(system, lv.Spark(3), (0.0, 1.0), start, directions, **run)
    own = {x: sum(found.tangents[name].states[x] for name in directions) for x in wanted}
    assert own["lam"].shape[-1] == 3
    assert farthest(own, wanted) < 1e-9
    assert paired(system, lv.Spark(3), (0.0, 1.0), start, directions, **run) < 1e-12
