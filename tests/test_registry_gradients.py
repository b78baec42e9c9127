"""Gradients of every method on every problem of the registry, and of steps in many digits.

Gradients are tangents transposed, number by number; tangents are differences of the same steps,
written down in the digits of mpmath. `test_wave_gradients` has the rows of wave functions.
"""

import casadi as ca
import mpmath
import numpy as np
import plain_splitting as plain
import pytest
from registry import ALL, ALPHA, FIELDS, GENERAL, INDEX2
from test_volume_oracle import flows_of

import liouville as lv
from liouville._methods.splitting.border import packed

ROWS = [(row, name) for row in (*GENERAL, *ALPHA, *INDEX2, *FIELDS) for name in row.on]

#: A difference in many digits.
TINY = "1e-20"


def apart(system, method, t, start, names, **run):
    """Return how far gradients and tangents are apart: each number, and a random sum of all."""
    rng = np.random.default_rng(4)
    solution, pullback = lv.vjp(system, method, wrt=names, t=t, **run, **start)
    cotangents = {x: rng.standard_normal(solution.states[x].shape) for x in pullback.states}
    gradients = pullback(**cotangents)
    shapes = {name: np.shape(gradients[name]) for name in names}
    units = {
        name: np.eye(int(np.prod(shape))).reshape(-1, *shape) for name, shape in shapes.items()
    }
    found = lv.integrate(system, method, t=t, tangents=units, **run, **start)
    assert all(np.array_equal(solution.states[x], found.states[x]) for x in pullback.states)
    each, whole = 0.0, np.zeros(3)
    for name in names:
        tangents = found.tangents[name].states
        parts = [cotangents[x][:, None] * tangents[x] for x in cotangents]
        forward = sum(part.sum(axis=(0, 2)) for part in parts)
        sizes = sum(np.abs(part).sum(axis=(0, 2)) for part in parts)
        back, along = np.ravel(gradients[name]), rng.standard_normal(forward.size)
        each = max(each, np.max(np.abs(back - forward) / np.maximum(sizes, 1)))
        whole += np.dot(back, along), np.dot(forward, along), np.dot(sizes, np.abs(along))
    return each, abs(whole[0] - whole[1]) / whole[2]


@pytest.mark.parametrize(("row", "name"), ROWS, ids=str)
def test_gradients_are_tangents_transposed(row, name):
    """By starts, parameters and ends of the time."""
    problem = ALL[name]
    system, t0 = problem.system, problem.t[0]
    names = [*system.states, *(f"params.{x}" for x in system.params), "t1"]
    if row in INDEX2:
        exact, names = problem.exact(0.2), ["y", "t0", "t1"]
        t0, start = 0.2, system.consistent(t=0.2, y=exact["y"], z=exact["z"])
    elif row in FIELDS:
        start = {"x": np.array(problem.start["x"])}
    else:
        names.append("t0")
        start = system.consistent(t=t0, **problem.start)
    run = {"steps": 4, "every": 2}
    each, whole = apart(system, row.method, (t0, t0 + 0.3), start, names, **run)
    assert each < 1e-11
    assert whole < 1e-12


def force(y, stiffness):
    """Return the force of a nonlinear spring to a wall, and of gravity."""
    return [-stiffness * y[0] ** 3, mpmath.mpf(-1)]


def rattle(q, v, length, stiffness, h, steps):
    """Make steps of RATTLE for a pendulum on that spring."""
    for _ in range(steps):
        half = [u + h / 2 * f for u, f in zip(v, force(q, stiffness), strict=True)]

        def missed(lam, q=q, half=half):
            end = [x + h * (u - h * x * lam) for x, u in zip(q, half, strict=True)]
            return mpmath.fdot(end, end) - length**2

        lam = mpmath.findroot(missed, 0, tol=1e-80)
        half = [u - h * x * lam for x, u in zip(q, half, strict=True)]
        q = [x + h * u for x, u in zip(q, half, strict=True)]
        free = [u + h / 2 * f for u, f in zip(half, force(q, stiffness), strict=True)]
        along = mpmath.fdot(q, free) / mpmath.fdot(q, q)
        v = [u - along * x for x, u in zip(q, free, strict=True)]
    return [*q, *v]


def test_steps_of_rattle_in_many_digits():
    system = lv.Lagrangian(
        lambda t, q, v, params: (ca.dot(v, v) - params.k * q[0] ** 4 / 2) / 2 - q[1],
        lambda t, q, params: ca.dot(q, q) - params.l**2,
        q=2, params={"k": 1.5, "l": 1.25},
    )  # fmt: skip
    start, h, steps = {"q": [0.75, -1.0], "v": [1.0, 0.75]}, 0.25, 3
    directions = {"params.k": 1.0, "params.l": 1.0, "q": [1.0, 2.0], "v": [1.0, -1.0]}
    found = lv.integrate(system, lv.LobattoPair(2), t=(0, h * steps), steps=steps,
                         tangents=directions, **start)  # fmt: skip
    with mpmath.workdps(60):
        for name, tangent in found.tangents.items():
            moves = [mpmath.mpf(x) for x in (*tangent.q[0], *tangent.v[0])]
            rates = [name == "params.l", name == "params.k"]
            ends = []
            for size in (mpmath.mpf(TINY), -mpmath.mpf(TINY)):
                own = [
                    x + size * dx for x, dx in zip([*start["q"], *start["v"]], moves, strict=True)
                ]
                values = [x + size * rate for x, rate in zip((1.25, 1.5), rates, strict=True)]
                ends.append(rattle(own[:2], own[2:], *values, mpmath.mpf(h), steps))
            wanted = [float((a - b) / (2 * mpmath.mpf(TINY))) for a, b in zip(*ends, strict=True)]
            own = np.concatenate([tangent.q[-1], tangent.v[-1]])
            assert np.abs(own - wanted).max() < 1e-14 * np.abs(own).max(), name


@pytest.mark.parametrize("scheme", ["S2", "BM4"])
def test_steps_of_a_splitting_in_many_digits(scheme):
    """Of shears and exponentials, by the start and the end of the time."""
    system = lv.PolynomialField(
        lambda t, x, params: [
            x[0] * x[1] + x[2] ** 2 / 2 + x[1], -x[1] ** 2 / 2 + x[2] * x[0] / 4,
            x[0] ** 2 * x[1] / 2 - x[0],
        ],
        x=3,
    )  # fmt: skip
    x, h, steps = [0.25, -0.375, 0.5], 0.125, 4
    method = lv.VolumeSplitting("exponentials", "natural", scheme, "split")
    plan = lv.plan(system, method, h=h, x=x)
    run = {"t": (0.0, h * steps), "steps": steps, "x": x}
    found = lv.integrate(system, plan, tangents={"x": np.eye(3), "t1": 1.0}, **run)
    parts = plan.split(system.terms, system.variables)
    with mpmath.workdps(60):
        pieces = [plain.in_digits(packed(piece)) for piece in parts.pieces]
        flows = [(a, mpmath.mpf(c)) for a, c in flows_of(scheme)]

        def end(direction, rate, size):
            own = [mpmath.mpf(a) + size * b for a, b in zip(x, direction, strict=True)]
            return plain.walk(pieces, flows, own, (h * steps + size * rate) / steps, steps)

        for direction, rate in [*zip(np.eye(3), [0, 0, 0], strict=True), (np.zeros(3), 1)]:
            tiny = mpmath.mpf(TINY)
            both = zip(end(direction, rate, tiny), end(direction, rate, -tiny), strict=True)
            wanted = np.array([float((a - b) / (2 * tiny)) for a, b in both])
            own = found.tangents["t1"].x[-1] if rate else direction @ found.tangents["x"].x[-1]
            assert np.abs(own - wanted).max() < 1e-14 * np.abs(wanted).max()
