"""Redundant constraints: left out of the steps, known to multipliers, never silently wrong."""

import pickle
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville._systems.mechanics.redundant import redundant
from liouville.problems import bricard, hinged_fourbar, load

METHODS = {
    "spark": (lv.Spark(3), 1),
    "spark newton": (lv.Spark(2, solver="newton"), 1),
    "pair": (lv.LobattoPair(3), 1),
    "rattle": (lv.LobattoPair(), 8),
    "composition": (lv.Composition(lv.LobattoPair(), "Y4"), 4),
    "hht": (lv.HHT(), 8),
    "generalized alpha": (lv.GeneralizedAlpha(0.8), 8),
    "arnold-bruls": (lv.ArnoldBruls(0.9), 8),
}


def kinetic(t, q, v, params):
    return ca.sumsqr(v) / 2 - 9.81 * q[1]


def doubled(names=("rod", "twice"), scale=3.0):
    """Return a pendulum whose rod is there twice."""
    return lv.Lagrangian(
        kinetic,
        lambda t, q, params: {
            names[0]: (ca.sumsqr(q) - 1) / 2,
            names[1]: scale * (ca.sqrt(ca.sumsqr(q)) - 1),
        },
        q=("x", "y"),
    )


SINGLE = lv.Lagrangian(kinetic, lambda t, q, params: (ca.sumsqr(q) - 1) / 2, q=("x", "y"))
START = {"q": (1.0, 0.0), "v": (0.0, 0.0)}


def gradients(system, t, q, params=None):
    """Return the gradients of all constraints by their values alone: central differences."""
    m, n = len(system.constraints), len(q)
    found = np.empty((m, n))
    for k in range(n):
        ahead, behind = (
            system.at_point("node", system.values(params), t, q + d * np.eye(n)[k], np.zeros(m))[:m]
            for d in (1e-6, -1e-6)
        )
        found[:, k] = (ahead - behind) / 2e-6
    return found


@pytest.mark.parametrize("name", METHODS)
def test_a_rod_there_twice_changes_nothing_but_multipliers(name):
    method, finer = METHODS[name]
    steps = 50 * finer
    one, two = (
        lv.integrate(system, method, t=(0, 1), steps=steps, **START)
        for system in (SINGLE, doubled())
    )
    np.testing.assert_allclose(two.q, one.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(two.v, one.v, rtol=0, atol=1e-12)
    assert abs(two.residuals["constraint"]).max() < 1e-14
    # the same force, half of it from each constraint: their gradients are q and 3 q / |q|
    half = one.lam / 2
    np.testing.assert_allclose(two.lam, half / [1, 3], rtol=0, atol=1e-12 * abs(half).max())


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("problem", [hinged_fourbar, bricard], ids=["fourbar", "bricard"])
def test_spatial_loops_are_stepped_by_all_methods(problem, name):
    method, finer = METHODS[name]
    steps = 40 * finer
    found = lv.integrate(
        problem.system, method, t=(0, 40 * problem.h), steps=steps, every=steps, **problem.start
    )
    assert abs(found.residuals["constraint"]).max() < 1e-14
    if name != "arnold-bruls":  # keeps positions only
        assert abs(found.residuals["hidden"]).max() < 1e-8
    assert abs(np.diff(found.invariants["energy"])[0]) < 1e-3 * abs(found.invariants["energy"][0])


def masses(problem):
    """Return the diagonal of the mass matrix, which is constant."""
    n, params = len(problem.system.coordinates), SimpleNamespace(**problem.system.params)
    v = ca.SX.sym("v", n)
    kinetic_energy = problem.lagrangian(0.0, ca.SX.zeros(n), v, params)
    return np.diag(ca.evalf(ca.hessian(kinetic_energy, v)[0]).full())


@pytest.mark.parametrize("name", ["hinged_fourbar", "bricard"])
def test_multipliers_are_those_of_least_norm_and_give_the_motion(name):
    problem = load(name)
    found = lv.integrate(problem.system, lv.Spark(3), t=(0, 0.2), h=problem.h, **problem.start)
    mass = masses(problem)
    for k in (0, len(found.t) - 1):
        rows = gradients(problem.system, found.t[k], found.q[k]) / np.sqrt(mass)
        length = np.linalg.norm(rows, axis=1)
        wanted = np.linalg.pinv((rows / length[:, None]).T, rcond=1e-6)
        scaled = found.lam[k] * length
        best = wanted @ ((rows / length[:, None]).T @ scaled)
        np.testing.assert_allclose(scaled, best, rtol=0, atol=1e-7 * abs(scaled).max())
        assert np.linalg.matrix_rank(rows / length[:, None], tol=1e-6) < len(length)


def test_gradients_by_starts_are_checked_along_the_constraints():
    """Beside them redundant constraints contradict each other, which is said in few names."""
    system, start = hinged_fourbar.system, hinged_fourbar.start
    found = lv.analysis.check_gradient(
        system, lv.Spark(2), wrt=["q", "v", "params.g"], t=(0, 0.1), steps=2, **start
    )
    assert found.dot < 1e-13
    assert found.differences < 1e-9
    beside = system.consistent(**start)
    beside["q"] = beside["q"] + 0.3 * np.random.default_rng(2).standard_normal(36)
    few = r"constraints 'A_x', 'A_y', 'A_z', 'A_0', 'A_1', 'B_x', 'B_y' and 24 more are redundant"
    with pytest.raises(ValueError, match=few):
        system.consistent(**beside)
    # a tenth of the bars beside them there is a way back
    near = start | {"q": start["q"] + np.random.default_rng(0).standard_normal(36) / 10}
    found = lv.integrate(system, lv.Spark(2), t=(0, 0.1), steps=2, **system.consistent(**near))
    assert np.abs(found.residuals["constraint"]).max() < 1e-13


@pytest.mark.parametrize(("s", "order"), [(1, 2), (2, 4), (3, 6)])
def test_orders_are_those_of_independent_constraints(s, order):
    def end(steps):
        found = lv.integrate(
            hinged_fourbar.system, lv.Spark(s), t=(0, 0.2), steps=steps, every=steps,
            **hinged_fourbar.start,
        )  # fmt: skip
        return np.concatenate([found.q[-1], found.v[-1]]), found.lam[-1]

    exact = end(160 // s)
    states, multipliers = zip(*(end(steps) for steps in (10, 20)), strict=True)
    finest = lv.integrate(
        hinged_fourbar.system, lv.Spark(5), t=(0, 0.2), steps=80, every=80, **hinged_fourbar.start
    )
    exact = np.concatenate([finest.q[-1], finest.v[-1]]), finest.lam[-1]
    for values, reference in zip((states, multipliers), exact, strict=True):
        errors = [abs(x - reference).max() for x in values]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.5)


def test_bricards_start_is_that_of_a_cube_to_the_bit():
    """Roundings of it, which differ by processor, would differ in runs."""
    for values in bricard.start.values():
        assert set(np.abs(values)) <= {0.0, 0.5, 1.0, 1.5, 3.0}
    moved = bricard.system.consistent(**bricard.start)
    for name, values in bricard.start.items():
        np.testing.assert_allclose(moved[name], values, rtol=0, atol=1e-15)


def test_starts_are_moved_onto_redundant_constraints():
    rng = np.random.default_rng(3)
    q, v = (np.array(hinged_fourbar.start[key]) for key in "qv")
    for size in (1e-2, 1e-5, 1e-9):
        near = {"q": q + size * rng.standard_normal(q.size), "v": v}
        moved = hinged_fourbar.system.consistent(**near)
        g = hinged_fourbar.system.at_point("node", np.array([9.81]), 0.0, moved["q"], np.zeros(38))[
            :38
        ]
        assert abs(g).max() < 1e-14
        assert abs(moved["q"] - near["q"]).max() < 10 * size
        assert abs(gradients(hinged_fourbar.system, 0.0, moved["q"]) @ moved["v"]).max() < 1e-7


def test_constraints_that_contradict_one_another_are_refused():
    apart = lv.Lagrangian(
        kinetic, lambda t, q, params: {"once": q[0] - 1, "twice": 2 * q[0] - 2.1}, q=2
    )
    with pytest.raises(ValueError, match=r"no consistent start.*'once' and 'twice' are redundant"):
        apart.consistent(q=[2, 0], v=[0, 0])


def test_a_singular_position_is_no_redundancy():
    free = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2,
        lambda t, q, params: {
            "crank": (ca.sumsqr(q[:2]) - 1) / 2,
            "rod": ((q[2] - q[0]) ** 2 + q[1] ** 2 - 1) / 2,
        },
        q=("x", "y", "slider"),
    )
    with pytest.raises(lv.IntegrationError, match="'crank' and 'rod' are redundant there alone"):
        lv.integrate(free, lv.Spark(4), t=(0, 4), h=0.1, q=[0, 1, 0], v=[-1, 0, -2])


def test_a_constraint_that_others_imply_only_for_a_while_ends_the_run():
    # on the plane z = 0 both agree while x < 1; the run finds that they do not behind it
    bent = lv.Lagrangian(
        lambda t, q, v, params: ca.sumsqr(v) / 2,
        lambda t, q, params: {"flat": q[1], "bent": q[1] + ca.fmax(q[0] - 1, 0) ** 3},
        q=("x", "y"),
    )
    with pytest.raises(lv.IntegrationError, match="no longer follows from the others") as caught:
        lv.integrate(bent, lv.Spark(2), t=(0, 2), h=0.01, q=[0, 0], v=[1, 0])
    assert caught.value.quantity in ("flat", "bent")
    solution = caught.value.solution
    assert 0.99 < solution.t[-1] < 1.02
    assert solution.status == "failed"


#: A pendulum whose second constraint is the first one until it swings beyond x = -0.5.
STOPPED = lv.Lagrangian(
    kinetic,
    lambda t, q, p: {
        "rod": ca.sumsqr(q) - 1,
        "stop": ca.sumsqr(q) - 1 + ca.fmax(0, -q[0] - 0.5) ** 3,
    },
    q=("x", "y"),
)
KEPT = [{}, {"every": 60}, {"every": 120}, {"t_eval": [0.3, 0.69, 2.0]}, {"states": False}]


@pytest.mark.parametrize("method", [lv.Spark(3), lv.HHT()], ids=repr)
def test_a_constraint_left_out_is_watched_in_every_step_whatever_is_kept(method):
    for kept in KEPT:
        with pytest.raises(lv.IntegrationError, match="'stop' no longer follows") as caught:
            lv.integrate(STOPPED, method, t=(0, 2.4), h=0.02, **kept, **START)
        assert (caught.value.step, caught.value.t) == (35, pytest.approx(0.7)), kept
        assert (np.abs(caught.value.solution.residuals["constraint"]) < 1e-12).all()


@pytest.mark.parametrize("method", [lv.Spark(3), lv.LobattoPair(), lv.HHT()], ids=repr)
@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_a_member_whose_constraint_no_longer_follows_fails_alone(method, order):
    q = np.array([[0.1, -np.sqrt(0.99)], [1.0, 0.0]])[order]
    call = {"t": (0, 1.2), "h": 0.01, "v": [0, 0]}
    for kept in ({}, {"every": 60}):
        both = lv.ensemble(STOPPED, method, q=q, **call, **kept)
        (failed,) = both.failures
        assert failed == order.index(1)
        assert both.failures[failed].step in (70, 71)
        assert "'stop' no longer follows" in both.failures[failed].message
        alone = lv.integrate(STOPPED, method, q=q[1 - failed], **call, **kept)
        np.testing.assert_array_equal(both.member(1 - failed).q, alone.q)


def test_members_and_stored_runs_have_the_same_bits(tmp_path):
    problem = hinged_fourbar
    starts = [problem.start_for(1 + 0.1 * k, 6) for k in range(5)]
    q, v = (np.array([start[key] for start in starts]) for key in "qv")
    many = lv.ensemble(problem.system, lv.Spark(2), t=(0, 0.2), steps=20, q=q, v=v)
    assert not many.failures
    for k, start in enumerate(starts):
        one = lv.integrate(problem.system, lv.Spark(2), t=(0, 0.2), steps=20, **start)
        np.testing.assert_array_equal(many.q[:, k], one.q)
        np.testing.assert_array_equal(many.lam[:, k], one.lam)
    lv.integrate(
        pickle.loads(pickle.dumps(problem.system)), lv.Spark(2), t=(0, 0.2), steps=20,
        store=tmp_path / "run.zarr", **starts[-1],
    )  # fmt: skip
    stored = lv.load(tmp_path / "run.zarr")
    np.testing.assert_array_equal(stored.q, one.q)
    np.testing.assert_array_equal(stored.lam, one.lam)


def test_events_and_dense_output_know_all_multipliers():
    events = {
        "half": lv.Event(lambda t, q, v, lam, params: lam[0] - 8.0),
        "low": lambda t, q, v, lam, params: q[0],
    }
    single = {
        "half": lv.Event(lambda t, q, v, lam, params: lam[0] / 2 - 8.0),
        "low": lambda t, q, v, lam, params: q[0],
    }
    one = lv.integrate(SINGLE, lv.Spark(3), t=(0, 2), h=0.02, events=single, **START)
    two = lv.integrate(doubled(), lv.Spark(3), t=(0, 2), h=0.02, events=events, **START)
    assert one.events["half"].t.size
    for name in events:
        np.testing.assert_allclose(two.events[name].t, one.events[name].t, rtol=0, atol=1e-9)
    times = [0.013, 0.71]
    np.testing.assert_allclose(two(times).lam[:, 0], one(times).lam[:, 0] / 2, rtol=1e-9)
    np.testing.assert_allclose(two.reaction(), one.reaction(), rtol=0, atol=1e-11)


def test_a_rolling_constraint_that_a_rail_implies_is_left_out():
    def cart(rolling, rail):
        return lv.Lagrangian(
            lambda t, q, v, params: ca.sumsqr(v) / 2 - q[1] - q[0] * q[1] / 4,
            rail,
            nonholonomic=rolling,
            q=("x", "y", "angle"),
        )

    def along(t, q, params):
        return {"rail": q[0] - q[1]}

    both = cart(lambda t, q, v, params: {"slip": v[0] - v[2], "again": 2 * (v[0] - v[1])}, along)
    alone = cart(lambda t, q, v, params: {"slip": v[0] - v[2]}, along)
    start = {"q": (0.5, 0.5, 0.0), "v": (0.3, 0.3, 0.3)}
    two, one = (
        lv.integrate(system, lv.Spark(3), t=(0, 2), h=0.05, **start) for system in (both, alone)
    )
    np.testing.assert_allclose(two.q, one.q, rtol=0, atol=1e-13)
    assert two.lam.shape[1] == 3
    np.testing.assert_allclose(two.lam[:, 2] * 2, one.lam[:, 0] / 2, rtol=0, atol=1e-12)


def test_members_whose_redundant_constraints_differ_are_refused():
    """Constraints that the first member implies are not left out of another that needs them."""
    leaning = lv.Lagrangian(
        kinetic,
        lambda t, q, p: {
            "rod": (ca.sumsqr(q) - 1) / 2,
            "other": (ca.sumsqr(q) - 1) / 2 + p.slope * q[2],
        },
        q=("x", "y", "z"),
        params={"slope": 0.0},
    )
    run = {"t": (0, 0.1), "h": 0.01, "q": [1, 0, 0], "v": [0, 0, 0]}
    said = "imply 'other' of member 0, but not just that of member 2"
    with pytest.raises(ValueError, match=said):
        lv.ensemble(leaning, lv.Spark(2), params={"slope": [0.0, 0.0, 1.0]}, **run)
    alike = lv.ensemble(leaning, lv.Spark(2), params={"slope": [0.0, 0.0]}, **run)
    assert alike.status == "done"
    said = "imply 'other' of member 1, but not just that of member 0"
    with pytest.raises(ValueError, match=said):
        lv.ensemble(leaning, lv.Spark(2), params={"slope": [1.0, 0.0, 2.0]}, **run)


def test_what_is_redundant_in_a_large_system_is_found():
    links = 360  # dense gradients of 260,000 entries

    def lengths(q):
        ends = ca.reshape(q, 2, -1)
        return ca.sum1((ends - ca.horzcat(ca.SX(2, 1), ends[:, :-1])) ** 2).T

    def constraint(t, q, params):
        return ca.vertcat((lengths(q) - 1) / 2, (lengths(q)[7] - 1) / 3)

    system = lv.Lagrangian(kinetic, constraint, q=2 * links)
    q = np.stack([np.arange(links) + 1.0, np.zeros(links)], 1).ravel()
    assert redundant(system, 0.0, q, np.zeros(2 * links), np.empty(0)) == (links,)


@pytest.mark.parametrize(("size", "away"), [(1.0, 3e3), (1e6, 0.0), (1e8, 0.0), (1e-8, 0.0)])
def test_neither_units_nor_the_origin_make_constraints_redundant(size, away):
    """A four-bar of 1 m, 3 km from the origin or in other units: the same motion."""

    def swung(size, away):
        m, origin = lv.bodies.Assembly(gravity=(0, -9.81 * size, 0)), np.array([away, away, 0.0])
        corners = np.array([(0, 0), (0, 0.5), (0.9, 0.9), (1.1, 0)])
        corners = size * (np.column_stack([corners, np.zeros(4)]) + origin)
        bars = (("crank", 0, 1, 1.0), ("coupler", 1, 2, 2.0), ("rocker", 3, 2, 1.8))
        for name, start, end, mass in bars:
            along = corners[end] - corners[start]
            length, turn = np.linalg.norm(along), np.arctan2(along[1], along[0])
            m.body(
                name,
                mass=mass,
                inertia=mass * np.array([0.01 * size**2, length**2 / 12, length**2 / 12]),
                at=(corners[start] + corners[end]) / 2,
                rotation=(np.cos(turn / 2), 0, 0, np.sin(turn / 2)),
            )
        pairs = ((m.ground, "crank"), ("crank", "coupler"), ("coupler", "rocker"))
        for name, pair, at in zip("ABCD", (*pairs, (m.ground, "rocker")), corners, strict=True):
            m.revolute(name, *pair, at=at, axis=(0, 0, 1))
        run = lv.integrate(m.system(), lv.Spark(3), t=(0, 0.1), h=0.01, **m.start(rates={"A": 6.0}))
        return run.q[-1][:2] / size - away

    assert np.allclose(swung(size, away), swung(1.0, 0.0), atol=1e-9)


def test_a_double_pendulum_in_micrometres():
    """The gradients of its joints are 1e6 times as long by angles as by positions."""
    size, axis = 1e6, (0, 0, 1)
    m = lv.bodies.Assembly(gravity=(0, -9.81 * size, 0))
    inertia = size**2 * np.array([0.01, 1 / 12, 1 / 12])
    m.body("a", mass=1, inertia=inertia, at=(0.5 * size, 0, 0))
    m.body("b", mass=1, inertia=inertia, at=(1.5 * size, 0, 0))
    m.revolute("A", m.ground, "a", at=(0, 0, 0), axis=axis)
    m.revolute("B", "a", "b", at=(size, 0, 0), axis=axis)
    start = m.start(values={"A": 0.3}, rates={"B": 1.0})
    run = lv.integrate(m.system(), lv.Spark(3), t=(0, 0.1), h=0.01, **start)
    assert run.status == "done"


@pytest.mark.parametrize("gap", [1e-12, 1e-6, 1e-4])
def test_constraints_that_contradict_each_other_have_no_start(gap):
    def twice(t, q, params):
        return {"a": ca.sumsqr(q) - 1, "b": 2 * (ca.sumsqr(q) - 1 - gap)}

    system = lv.Lagrangian(lambda t, q, v, params: ca.sumsqr(v) / 2 - q[1], twice, q=2)
    if gap < 1e-9:  # a rounding
        moved = system.consistent(q=[1.3, 0.2], v=[0.0, 1.0])
        assert abs(moved["q"] @ moved["q"] - 1) < 1e-11
        return
    with pytest.raises(ValueError, match="'a' and 'b' are redundant"):
        system.consistent(q=[1.3, 0.2], v=[0.0, 1.0])


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(2), lv.HHT()], ids=repr)
def test_multipliers_at_an_event_that_ends_the_run_move_with_its_time(method):
    """Of two constraints one grows with time, and so does its share of the force."""
    system = lv.Lagrangian(
        lambda t, q, v, p: (1 + q[1] ** 2 / 3) * ca.sumsqr(v) / 2 - p.g * q[1] - q[0] * q[1],
        lambda t, q, p: [q[0] - ca.sin(t), (1 + 3 * t) * (q[0] - ca.sin(t))],
        q=2,
        params={"g": 9.81},
    )
    top = lv.Event(lambda t, q, v, lam, p: v[1] - p.g / 10, terminal=True)
    run = {"t": (0, 1), "h": 0.05, "q": [0, 0], "v": [1, 3], "events": {"top": top}}

    def last(g):
        return lv.integrate(system, method, params={"g": g}, **run).lam[-1]

    step = 1e-5
    slope = (last(9.81 + step) - last(9.81 - step)) / (2 * step)
    tangents = lv.integrate(system, method, tangents={"params.g": 1.0}, **run).tangents
    assert tangents["params.g"].lam[-1] == pytest.approx(slope, abs=1e-7)
    solution, pullback = lv.vjp(system, method, wrt=["params.g"], **run)
    weights = np.zeros_like(solution.lam)
    weights[-1] = 0.3, 1.0
    gradient = pullback(lam=weights)["params.g"]
    assert gradient == pytest.approx(weights[-1] @ slope, abs=1e-7)
