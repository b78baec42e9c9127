"""Mechanisms that meet events, and comparisons of the derivatives of their runs.

Tangents are compared with differences of order six, of runs that meet the same events, and
pullbacks with tangents.
"""

import casadi as ca
import numpy as np
from test_tangents import WEIGHTS, farthest, moved

import liouville as lv

ENDS = {"t0": 0.3, "t1": 0.2}

CONTROLS = [{"steps": 26}, {"rtol": 1e-7}, {"control": lv.Reversible(), "h": 0.01}]


def ball():
    """Return a ball above a bent ground, with its law of impact."""
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
        q=("x", "y"), params={"g": 1.0, "e": 0.8, "bend": 0.1},
    )  # fmt: skip
    ground = lv.Event(
        lambda t, q, v, lam, params: q[1] - params.bend * q[0] ** 2,
        "down",
        reset=lv.Impact(lambda t, q, v, lam, params: params.e),
    )
    start = {"q": np.array([0.1, 0.5]), "v": np.array([0.3, 0.1])}
    directions = {"q": np.array([0.3, 0.7]), "v": np.array([0.2, -0.4])}
    directions |= {"params.g": 1.0, "params.e": 1.0, "params.bend": 0.5}
    return system, {"ground": ground}, start, directions


def walled(law):
    """Return the events of a pendulum at a wall with some law of reset, and its run."""
    resets = {
        "impact": lv.Impact(lambda t, q, v, lam, params: params.e),
        "velocities": lambda t, q, v, lam, params: -params.e * (1 + t / 9) * v,
        "none": None,
    }
    events = {
        "wall": lv.Event(lambda t, q, v, lam, params: q[0] + params.wall, reset=resets[law]),
        "low": lv.Event(lambda t, q, v, lam, params: q[1] + 1.9 + t / 50, terminal=4),
        "pull": lambda t, q, v, lam, params: lam[0] - 3.5 * params.m,
    }
    return {"steps": 31, "events": events, "every": 4}


def pendulum():
    """Return a driven pendulum, its length in its constraint alone, at a wall."""
    system = lv.Lagrangian(
        lambda t, q, v, params: (
            params.m * ca.dot(v, v) / 2 - params.m * params.g * q[1] - ca.sin(t) * q[0] / 5
        ),
        lambda t, q, params: ca.dot(q, q) - (params.l + ca.sin(t) / 20) ** 2,
        q=("x", "y"), params={"m": 1.5, "g": 9.81, "l": 2.0, "e": 0.7, "wall": 0.3},
    )  # fmt: skip
    directions = {"q": np.array([0.3, 0.7]), "v": np.array([0.2, -0.4])}
    directions |= {"params.l": 1.0, "params.e": 1.0, "params.wall": 0.5}
    return system, system.consistent(t=0.1, q=[1.2, -1.6], v=[1.6, 1.2]), directions


def general():
    """Return a system whose velocities and momenta are nonlinear, with its start and its events."""
    system = lv.Mechanical(
        velocity=lambda t, y, z, params: (
            z * (1 + params.a * ca.dot(y, y) / 9) + params.a * ca.sin(t) * ca.vertcat(y[1:], 1)
        ),
        momentum=lambda t, y, z, params: (
            z * (1 + ca.dot(z, z) / 4 + ca.cos(t) / 5) + params.a * y * y / 5
        ),
        force=lambda t, y, z, params: ca.vertcat(z[1], -z[0], -params.c),
        reaction=lambda t, y, lam, params: (
            -y * lam + params.a * lam * ca.vertcat(y[1], 0, t / 9)
        ),
        constraint=lambda t, y, params: ca.dot(y, y) - (params.l + ca.sin(t) / 9) ** 2,
        y=3, params={"a": 0.4, "c": 0.7, "l": 1.1},
    )  # fmt: skip
    events = {
        "turn": lv.Event(
            lambda t, y, z, lam, params: y[1] - params.c - t / 9 + 0.2,
            reset=lv.Impact(lambda t, y, z, lam, params: params.c + y[0] / 9),
        ),
        "side": lv.Event(
            lambda t, y, z, lam, params: z[1] + y[0] / 2 + lam[0] / 9,
            reset=lambda t, y, z, lam, params: z * params.c * (1 + t / 9),
        ),
    }
    return system, events, system.consistent(t=0.2, y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])


def outputs(states, events):
    """Return states and what events have, under one name each."""
    found = dict(states)
    for event, points in events.items():
        found[event, "t"] = points.t
        found |= {(event, name): x for name, x in points.states.items()}
    return {name: x for name, x in found.items() if x.size}


def differences(system, method, t, start, directions, size=2e-4, **run):
    """Return differences of all outputs in the sum of some directions."""
    total = {}
    for count, weight in WEIGHTS.items():
        for sign in (1, -1):
            step = sign * count * size
            at = t[0] + step * directions.get("t0", 0.0), t[1] + step * directions.get("t1", 0.0)
            own, params = moved(system, at[0], start, directions, step)
            found = lv.integrate(system, method, t=at, params=params, **run, **own)
            names = {*system.states, "lam"} & {*found.states}
            for name, x in outputs({x: found.states[x] for x in names}, found.events).items():
                total[name] = total.get(name, 0.0) + sign * weight / size * x
    return total


def check(system, method, t, start, directions, bound=None, size=2e-4, **run):
    """Check tangents by differences, direction by direction; return the run.

    Steps that are controlled are chosen anew by differences, which are then as much worse.
    """
    bound = bound or (1e-10 if "steps" in run else 1e-8)
    found = lv.integrate(system, method, t=t, tangents=directions, **run, **start)
    plain = lv.integrate(system, method, t=t, **run, **start)
    # without tangents controlled steps are solved to a part of rtol only
    off = np.abs(found.states[system.states[1]] - plain.states[system.states[1]])
    assert off.max(initial=0.0) <= run.get("rtol", 0.0)
    for name, direction in directions.items():
        wanted = differences(system, method, t, start, {name: direction}, size, **run)
        tangent = found.tangents[name]
        own = outputs(tangent.states, tangent.events)
        assert farthest(own, {x: wanted[x] for x in own}) < bound, name
    return found


def paired(system, method, t, start, directions, **run):
    """Return how far the pairings of tangent and pullback are apart, in units of their parts.

    Where these are errors of the method alone, or zero, the unit is one.
    """
    rng = np.random.default_rng(2)
    pullback = lv.vjp(system, method, wrt=[*directions], t=t, **run, **start)[1]
    found = lv.integrate(system, method, t=t, tangents=directions, **run, **start)
    own = next(iter(found.tangents.values()))
    weights = {x: rng.standard_normal(y.shape) for x, y in own.states.items()}
    of_events = {
        event: {"t": rng.standard_normal(points.t.shape)}
        | {x: rng.standard_normal(y.shape) for x, y in points.states.items()}
        for event, points in own.events.items()
    }
    gradients = pullback(**weights, events=of_events)
    sizes = []
    for name, direction in directions.items():
        tangent = found.tangents[name]
        parts = [weights[x] * y for x, y in tangent.states.items()]
        for event, points in tangent.events.items():
            each = {"t": points.t, **points.states}
            parts += [of_events[event][x] * y for x, y in each.items()]
        forward, unit = sum(x.sum() for x in parts), sum(np.abs(x).sum() for x in parts)
        sizes.append(abs(np.sum(gradients[name] * direction) - forward) / max(unit, 1))
    return max(sizes)
