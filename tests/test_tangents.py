"""Tangents are the derivatives of the discrete solution, of every method and system that has them.

They are compared with differences of the same runs from moved starts: central ones of order six.
Those are good to about 1e-11 of the derivatives, and see what a pairing does not: stages that were
not solved to the end, and a start that leaves its constraints.
"""

import pickle

import casadi as ca
import mpmath
import numpy as np
import pytest
from families import TOLERANT
from registry import ALL, GENERAL, NONHOLONOMIC

import liouville as lv
from liouville._systems.derivatives.sensitivity import moved_start, pulled_start
from liouville.problems import load

#: Every row of the registry, each on one of its problems in turn, nonholonomic ones apart.
COVERED = [
    (row, names[k % len(names)])
    for k, row in enumerate(GENERAL)
    for own in (True, False)
    if (names := [name for name in row.on if (name in NONHOLONOMIC) == own])
]

#: Steps of a difference, and the weights of the starts moved by one, two and three of them.
SIZE, WEIGHTS = 2e-3, {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}


def general():
    """Return a system whose every function is nonlinear and depends on time and parameters."""

    def velocity(t, y, z, params):
        return z * (1 + params.a * ca.dot(y, y) / 9) + params.b * ca.sin(t) * ca.vertcat(y[1:], 1)

    def momentum(t, y, z, params):
        return z * (1 + params.c * ca.dot(z, z) / 4 + ca.cos(t) / 5) + params.a * y * y / 5

    def force(t, y, z, params):
        wind = params.b[0] * ca.sin(2 * t) * ca.vertcat(1, 0, y[0])
        return ca.vertcat(z[1], -z[0], -params.c) - params.a * z / 5 + wind

    def reaction(t, y, lam, params):
        return -y * (lam + params.c * lam**3 / 10) + params.a * lam * ca.vertcat(y[1], 0, t / 9)

    return lv.Mechanical(
        velocity=velocity, momentum=momentum, force=force, reaction=reaction,
        constraint=lambda t, y, params: ca.dot(y, y) - (params.l + ca.sin(t) / 9) ** 2,
        y=3, params={"a": 0.4, "b": [0.3, 0.2, 0.5], "c": 0.7, "l": 1.1},
    )  # fmt: skip


def pendulum():
    """Return a pendulum whose length is in its constraint alone."""
    return lv.Lagrangian(
        lambda t, q, v, params: params.m * ca.dot(v, v) / 2 - params.m * params.g * q[1],
        lambda t, q, params: ca.dot(q, q) - params.l**2,
        q=("x", "y"), params={"m": 1.5, "g": 9.81, "l": 2.0},
    )  # fmt: skip


def moved(system, t, start, directions, size):
    """Return start and parameters moved by so much of each direction, on the constraints."""
    start = {name: np.asarray(x, float) + size * directions.get(name, 0)
             for name, x in start.items()}  # fmt: skip
    params = {
        name.removeprefix("params."): system.params[name.removeprefix("params.")] + size * x
        for name, x in directions.items()
        if name.startswith("params.")
    }
    return system.consistent(t=t, params=params, **start), params


def differences(system, method, t, start, directions, size=SIZE, **run):
    """Return differences of all states in the sum of some directions."""
    ends = [directions.get("t0", 0.0), directions.get("t1", 0.0)]
    total = {}
    for count, weight in WEIGHTS.items():
        for sign in (1, -1):
            step = sign * count * size
            at = t[0] + step * ends[0], t[1] + step * ends[1]
            own, params = moved(system, at[0], start, directions, step)
            found = lv.integrate(system, method, t=at, params=params, **run, **own)
            for name in {*system.states, "lam"} & {*found.states}:
                part = sign * weight / size * found.states[name]
                total[name] = total.get(name, 0.0) + part
    return total


def summed(solution, directions):
    """Return the sum of the tangents in some directions."""
    found = [solution.tangents[name].states for name in directions]
    return {name: sum(each[name] for each in found) for name in found[0]}


def farthest(found, wanted):
    """Return the largest difference in units of the largest value."""
    return max(np.abs(found[x] - wanted[x]).max() / max(1, np.abs(wanted[x]).max()) for x in wanted)


def directions_of(system, *more):
    """Return directions of everything there is, in which no two parts are alike."""
    rng, n = np.random.default_rng(1), len(system.coordinates)
    own = {name: rng.standard_normal(n) for name in system.states}
    own |= {f"params.{x}": 0.3 * rng.standard_normal(np.shape(v)) for x, v in system.params.items()}
    return own | dict.fromkeys(more, 0.2)


@pytest.mark.parametrize(("row", "name"), COVERED, ids=str)
def test_tangents_are_differences(row, name):
    problem = ALL[name]
    system, t = problem.system, (problem.t[0], problem.t[0] + 0.3)
    start = system.consistent(t=t[0], **problem.start)
    assert not isinstance(row.method, TOLERANT)
    run = {"steps": 3, "every": 3}
    directions = directions_of(system)
    found = lv.integrate(system, row.method, t=t, tangents=directions, **run, **start)
    wanted = differences(system, row.method, t, start, directions, **run)
    assert farthest(summed(found, directions), wanted) < 1e-9
    plain = lv.integrate(system, row.method, t=t, **run, **start)
    assert plain.stats.get("solver") == "rattle" or np.array_equal(found.lam, plain.lam)


@pytest.mark.parametrize("method", [lv.Spark(1), lv.Spark(3), lv.Spark(2, solver="newton"),
                                    lv.Spark(2, points="radau"), lv.LobattoPair(3, "C"),
                                    lv.Composition(lv.Spark(1), "Y4")], ids=str)  # fmt: skip
def test_every_parameter_of_every_function_and_both_ends(method):
    system, t, run = general(), (0.2, 0.8), {"steps": 4}
    start = system.consistent(t=t[0], y=[0.6, 0.1, -0.8], z=[0.1, 1.2, 0.4])
    directions = directions_of(system, "t0", "t1")
    found = lv.integrate(system, method, t=t, tangents=directions, **run, **start)
    for name in directions:
        wanted = differences(system, method, t, start, {name: directions[name]}, **run)
        assert farthest(found.tangents[name].states, wanted) < 1e-9, name


#: Methods by the kinds of polynomials between their steps, and how many of them reach how far.
DENSE = [(lv.Spark(1), 2), (lv.Spark(1), 6), (lv.Spark(2), 1), (lv.Spark(3), 2), (lv.Spark(4), 6),
         (lv.Composition(lv.Spark(1), "Y4"), 4)]  # fmt: skip


@pytest.mark.parametrize(("method", "steps"), DENSE, ids=str)
@pytest.mark.parametrize("make", [general, pendulum])
def test_states_at_given_times(make, method, steps):
    system, t = make(), (0.2, 0.8)
    values = [0.6, 0.1, -0.8], [0.1, 1.2, 0.4]
    if make is pendulum:
        values = [1.2, -1.6], [1.6, 1.2]
    start = system.consistent(t=t[0], **dict(zip(system.states, values, strict=True)))
    ends = np.linspace(*t, steps + 1)
    # beside the ends of steps, which move with those of the run: λ is no smooth function there
    within = {"t_eval": [0.23, 0.33, 0.71, 0.79], "steps": steps}
    directions = directions_of(system, "t0", "t1")
    found = lv.integrate(system, method, t=t, tangents=directions, **within, **start)
    assert np.array_equal(found.t, within["t_eval"])
    for name in ("t0", "t1", "params." + ("b" if make is general else "l")):
        wanted = differences(system, method, t, start, {name: directions[name]}, **within)
        assert farthest(found.tangents[name].states, wanted) < 1e-9, name
    at_ends = {"t_eval": ends, "steps": steps}
    held = {name: x for name, x in directions.items() if name not in ("t0", "t1")}
    found = lv.integrate(system, method, t=t, tangents=held, **at_ends, **start)
    wanted = lv.integrate(system, method, t=t, steps=steps, tangents=held, **start)
    assert farthest(summed(found, held), summed(wanted, held)) < 1e-12


def midpoint(q, v, length, stiffness, h, steps):
    """Make steps of Spark(1) for a pendulum on a nonlinear spring, in the digits of mpmath."""
    dot = mpmath.fdot

    def force(y):
        return [-stiffness * dot(y, y) * x - y0 for x, y0 in zip(y, (0, 1), strict=True)]

    for _ in range(steps):

        def residual(z0, z1, lam, q=q, v=v):
            z = z0, z1
            f = force([x + h / 2 * u for x, u in zip(q, z, strict=True)])
            end = [x + h * u for x, u in zip(q, z, strict=True)]
            moved = [z[i] - v[i] - h / 2 * (f[i] - 2 * q[i] * lam) for i in (0, 1)]
            return *moved, (dot(end, end) - length**2) / h

        found = mpmath.findroot(residual, (*v, 0), tol=1e-80)
        z, first = found[:2], found[2]
        f = force([x + h / 2 * u for x, u in zip(q, z, strict=True)])
        end = [x + h * u for x, u in zip(q, z, strict=True)]
        free = [v[i] + h * (f[i] - q[i] * first) for i in (0, 1)]
        last = dot(end, free) / dot(end, end)
        q, v = end, [free[i] - last * end[i] for i in (0, 1)]
    return [*q, *v]


def test_differences_in_many_digits_are_met_to_roundoff():
    system = lv.Lagrangian(
        lambda t, q, v, params: (ca.dot(v, v) - params.k * ca.dot(q, q) ** 2 / 2) / 2 - q[1],
        lambda t, q, params: ca.dot(q, q) - params.l**2,
        q=2, params={"k": 1.5, "l": 1.25},
    )  # fmt: skip
    start, h, steps = {"q": [0.75, -1.0], "v": [1.0, 0.75]}, 0.25, 3
    directions = {"params.k": 1.0, "params.l": 1.0, "q": [1.0, 2.0], "v": [1.0, -1.0]}
    found = lv.integrate(system, lv.Spark(1), t=(0, h * steps), steps=steps, tangents=directions,
                         **start)  # fmt: skip
    with mpmath.workdps(45):
        for name, tangent in found.tangents.items():
            own = [mpmath.mpf(x) for x in (*tangent.q[0], *tangent.v[0])]
            rates = [name == "params.l", name == "params.k"]
            ends = []
            for size in (mpmath.mpf(10) ** -20, -(mpmath.mpf(10) ** -20)):
                y, z = ([x + size * dx for x, dx in zip(start[s], own[k : k + 2], strict=True)]
                        for s, k in (("q", 0), ("v", 2)))  # fmt: skip
                values = [x + size * rate for x, rate in zip((1.25, 1.5), rates, strict=True)]
                ends.append(midpoint(y, z, *values, mpmath.mpf(h), steps))
            wanted = [float((a - b) / 2e-20) for a, b in zip(*ends, strict=True)]
            own = np.concatenate([tangent.q[-1], tangent.v[-1]])
            assert np.abs(own - wanted).max() < 1e-14 * np.abs(own).max(), name


def test_linear_systems_have_linear_tangents():
    matrices = [2.0, 1.0], [[5.0, -2.0], [-2.0, 3.0]], [[0.1, 0.0], [0.0, 0.3]]
    system, rows = lv.Structure(*matrices, force=[0.0, 1.0]), np.eye(2)
    run = {"method": lv.Spark(3), "t": (0, 8), "steps": 40, "every": 8}
    found = lv.integrate(system, **run, q=[1, 0], v=[0, 2], tangents={"q": rows, "v": rows})
    at_rest = lv.integrate(system, **run, q=[0, 0], v=[0, 0])
    for name in "qv":
        for k, row in enumerate(rows):
            own = lv.integrate(system, **run, **{"q": [0, 0], "v": [0, 0], name: row})
            for state in "qv":
                tangent = found.tangents[name].states[state][:, k]
                wanted = own.states[state] - at_rest.states[state]
                np.testing.assert_allclose(tangent, wanted, rtol=0, atol=4e-15)


def test_the_first_tangents_are_those_of_the_start_moved_onto_the_constraints():
    system = pendulum()
    start = system.consistent(q=[1.2, -1.6], v=[1.6, 1.2])
    outwards = {"params.l": 1.0, "q": [0.6, -0.8], "v": [0.6, -0.8]}
    found = lv.integrate(system, lv.Spark(2), t=(0, 1), steps=1, tangents=outwards, **start)
    q, v, away = start["q"], start["v"], found.tangents
    # of the length: outwards along the rod; v turns so that it stays across
    np.testing.assert_allclose(away["params.l"].q[0], q / 2, rtol=0, atol=2e-16)
    np.testing.assert_allclose(q @ away["params.l"].v[0], -v @ away["params.l"].q[0], atol=1e-15)
    # off the constraints: nothing is left
    assert max(np.abs(x[0]).max() for x in (away["q"].q, away["q"].v, away["v"].v)) < 3e-16
    end = away["params.l"]
    np.testing.assert_allclose(found.q[-1] @ end.q[-1], 2.0, rtol=1e-14)


@pytest.mark.parametrize("control", [
    {"rtol": 1e-6}, {"control": lv.Reversible(), "h": 0.02}, {"steps": 60}], ids=str)  # fmt: skip
@pytest.mark.parametrize("method", [lv.Spark(3), lv.LobattoPair(3)], ids=str)
def test_the_symplectic_form_of_tangents_is_kept_whatever_the_steps(method, control):
    problem = load("double_pendulum")
    rng = np.random.default_rng(3)
    given = {"q": rng.standard_normal((2, 4)), "v": rng.standard_normal((2, 4))}
    found = lv.integrate(problem.system, method, t=(0, 2), tangents=given, **control,
                         **problem.start)  # fmt: skip
    rows = np.concatenate([found.tangents[x].states["q"] for x in "qv"], axis=1)
    momenta = np.concatenate([found.tangents[x].states["v"] for x in "qv"], axis=1)  # masses are 1
    form = np.einsum("kin,kjn->kij", rows, momenta)
    form -= form.transpose(0, 2, 1)
    size = np.abs(rows).max() * np.abs(momenta).max()
    assert np.abs(form[0]).max() > 0.1
    assert np.abs(form - form[0]).max() < 1e-13 * size


@pytest.mark.slow
def test_the_symplectic_form_is_kept_over_many_steps():
    """1e5 of them, in which tangents grow to 3e5: roundoff of the product of their norms."""
    problem = load("spherical_pendulum")
    each = np.random.default_rng(0).standard_normal((2, 3))
    run = lv.integrate(
        problem.system, lv.Spark(3), t=(0, 2000), steps=100_000, every=1000,
        tangents={"q": each, "v": each}, **problem.start,
    )  # fmt: skip
    by_q, by_v = run.tangents["q"], run.tangents["v"]
    # its momenta are its velocities
    form = np.einsum("kin,kjn->kij", by_q.q, by_v.v) - np.einsum("kin,kjn->kij", by_q.v, by_v.q)
    norms = [np.sqrt((x.q**2 + x.v**2).sum(axis=2)) for x in (by_q, by_v)]
    size = np.einsum("ki,kj->kij", *norms)
    assert (np.abs(form - form[0]) / size).max() < 1e-13


@pytest.mark.parametrize("name", ["general", "heavy_top"])
def test_the_derivative_of_consistent_beside_the_constraints(name):
    """Metric and gradients turn on the way of a start onto its constraints."""
    system = general() if name == "general" else load(name).system
    given = {"y": [0.65, 0.15, -0.9], "z": [0.2, 1.3, 0.1]} if name == "general" else {
        x: 1.02 * np.asarray(value) + 0.01 for x, value in load(name).start.items()
    }  # fmt: skip
    rng = np.random.default_rng(0)
    y, z = system.start(given)
    values, (dy, dz, cy, cz) = system.values(None), rng.standard_normal((4, len(y)))
    dtau = np.append(1.0, values) * rng.standard_normal(1 + len(values)) / 10
    sizes = [np.size(x) for x in system.params.values()]

    def moved(size):
        parts = np.split(values + size * dtau[1:], np.cumsum(sizes)[:-1])
        shapes = [np.shape(x) for x in system.params.values()]
        params = [x.reshape(shape) for x, shape in zip(parts, shapes, strict=True)]
        start = dict(zip(system.states, (y + size * dy, z + size * dz), strict=True))
        params = dict(zip(system.params, params, strict=True))
        found = system.consistent(t=0.2 + size * dtau[0], params=params, **start)
        return np.concatenate([found[x] for x in system.states])

    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    slope = sum(w / 1e-3 * (moved(m * 1e-3) - moved(-m * 1e-3)) for m, w in weights.items())
    of_y, of_z = moved_start(system, 0.2, y, z, values, (dy[None], dz[None], dtau[None]))
    found = np.concatenate([of_y[0], of_z[0]])
    np.testing.assert_allclose(found, slope, rtol=0, atol=1e-10 * np.abs(slope).max())
    back = pulled_start(system, 0.2, y, z, values, (cy, cz, np.zeros(len(dtau))))
    paired = sum(a @ b for a, b in zip(back, (dy, dz, dtau), strict=True))
    assert abs(paired - found @ np.append(cy, cz)) < 1e-12 * np.abs(found).sum()


def test_redundant_and_sparse_mechanisms():
    for name, count in (("doubled_rod", 40), ("andrews", 5)):
        problem = load(name)
        system, t, run = problem.system, (0.0, 0.01 * count / 40), {"steps": 5, "every": 5}
        start = system.consistent(**problem.start)
        directions = directions_of(system)
        if name == "andrews":
            directions = {name: x for name, x in directions.items() if name in system.states}
        found = lv.integrate(system, lv.Spark(2), t=t, tangents=directions, **run, **start)
        wanted = differences(system, lv.Spark(2), t, start, directions, 1e-3, **run)
        own = summed(found, directions)
        assert own["lam"].shape[-1] == len(system.constraints)
        assert farthest(own, {x: wanted[x] for x in own}) < 1e-9


def test_members_pickles_and_parts_have_the_bits_of_a_run():
    system, run = pendulum(), {"t": (0, 1), "steps": 10, "every": 2}
    system = pickle.loads(pickle.dumps(system))
    given = {"params.l": 1.0, "q": np.eye(2)}
    starts = [system.consistent(q=[1, y], v=[1, 0], params={"g": g})
              for y, g in ((-1, 9), (-2, 10), (0.5, 11))]  # fmt: skip
    rows = {name: np.array([each[name] for each in starts]) for name in "qv"}
    many = lv.ensemble(
        system, lv.Spark(3), tangents=given, params={"g": [9, 10, 11]}, **run, **rows
    )
    for k, g in enumerate((9, 10, 11)):
        one = lv.integrate(system, lv.Spark(3), tangents=given, params={"g": g}, **run, **starts[k])
        for name, tangent in one.tangents.items():
            for state, x in tangent.states.items():
                np.testing.assert_array_equal(many.tangents[name].states[state][:, k], x)
                np.testing.assert_array_equal(many.member(k).tangents[name].states[state], x)
        assert one.tangents["q"].q.shape == (6, 2, 2)
        part = one.sel(time=slice(0.2, 0.6), coordinate=["y"])
        np.testing.assert_array_equal(part.tangents["q"].q, one.tangents["q"].q[1:4, :, 1:])
    assert repr(one.tangents["params.l"]) == "<Tangent q (6, 2), v (6, 2), lam (6, 1)>"
    assert not one.tangents["q"].q.flags.writeable


@pytest.mark.parametrize(("changes", "sentence"), [
    ({"tangents": {"params.length": 1.0}}, "there is no direction 'params.length'"),
    ({"tangents": {"l": 1.0}}, "a parameter's direction is called 'params.l'"),
    ({"tangents": {"h": 1.0}}, "steps are counted in whole numbers"),
    ({"tangents": {}}, "tangents must be a mapping of directions"),
    ({"tangents": {"q": [1.0]}}, r"must have shape \(2,\) for one direction.*, not \(1,\)"),
    ({"tangents": {"q": np.ones((0, 2))}}, r"must be one direction or more"),
    ({"tangents": {"params.l": []}}, r"must be one direction or more"),
    ({"tangents": {"params.l": [[1.0]]}}, r"shape \(\) for one direction or \(d,\)"),
    ({"tangents": {"q": [1.0, "x"]}}, "must be an array of real numbers"),
    ({"tangents": {"q": np.ma.masked_less([1.0, 0.0], 1)}}, "must be an array of real numbers"),
    ({"tangents": {"q": {"z": 1.0}}}, "which is no coordinate"),
    ({"tangents": {"q": [1.0, np.nan]}}, "must be finite"),
    ({"tangents": {"t1": 1.0}, "steps": None, "rtol": 1e-6}, "where steps are controlled"),
    ({"method": lv.Spark(2, newton_tol=1e-6)}, "leave newton_tol out"),
    ({"store": "nowhere.zarr"}, "tangents go without store=\nhint: derivatives are kept in memory"),
    ({"states": False}, "leave out states=False"),
])  # fmt: skip
def test_bad_input_is_refused_by_a_sentence(changes, sentence):
    system = pendulum()
    call = {"system": system, "method": lv.Spark(2), "t": (0, 1), "steps": 4,
            "tangents": {"params.l": 1.0}, "q": [1.2, -1.6], "v": [1.6, 1.2]} | changes  # fmt: skip
    with pytest.raises((TypeError, ValueError), match=sentence):
        lv.integrate(**call)


def test_other_systems_have_no_tangents_yet():
    with pytest.raises(TypeError, match="an ensemble on an executor has no tangents"):
        lv.ensemble(pendulum(), lv.Spark(1), t=(0, 1), steps=1, tangents={"params.l": 1.0},
                    executor=object(), q=[[0, -2]], v=[[1, 0]])  # fmt: skip
