"""Large mechanisms: sparse solvers step what the formulas say, whatever is coupled to what."""

import casadi as ca
import numpy as np
import pytest
from plain_spark import Plain, gauss, lobatto

import liouville as lv
from liouville.problems import chain, rigid_chain


def tree(branching, bodies, loops=()):
    """Build particles on rods in space, each on the one that `branching` says, and a start."""
    parents = [branching(k) for k in range(bodies)]
    rng = np.random.default_rng(3)
    places = np.zeros((bodies + 1, 3))  # the last is the hook
    for k, parent in enumerate(parents):
        arm = rng.normal(size=3) - (0, 0, 1)
        places[k] = places[parent] + arm / np.linalg.norm(arm)
    rods = [*enumerate(parents), *loops]
    lengths = [np.linalg.norm(places[a] - places[b]) for a, b in rods]

    def constraint(t, q, params):
        at = ca.horzcat(ca.reshape(q, 3, bodies), ca.SX(3, 1))
        arms = [at[:, a] - at[:, b % (bodies + 1)] for a, b in rods]
        pairs = zip(arms, lengths, strict=True)
        return {f"rod{i}": (ca.dot(x, x) - size**2) / 2 for i, (x, size) in enumerate(pairs)}

    def lagrangian(t, q, v, params):
        return ca.dot(v, v) / 2 - ca.sum1(q[2::3])

    names = tuple(f"{axis}{k}" for k in range(bodies) for axis in "xyz")
    start = {"q": places[:-1].ravel(), "v": np.zeros(3 * bodies)}
    return lv.Lagrangian(lagrangian, constraint, q=names), start


MECHANISMS = {
    "rods with spherical joints": lambda: (rigid_chain.build(9), rigid_chain.start_for(9)),
    "rods with hinges": lambda: (rigid_chain.build(9, True), rigid_chain.start_for(9, True)),
    "tree": lambda: tree(lambda k: (k - 1) // 3 if k else -1, 40),
    "closed loops": lambda: tree(lambda k: k - 1, 40, [(30, 4), (39, 20)]),
}


@pytest.mark.parametrize(("method", "count"), [(lv.Spark(3), 8), (lv.LobattoPair(4), 8)])
def test_step_is_that_of_the_equations_solved_at_once(method, count):
    system, start = chain.build(count), chain.start_for(count)
    h = 0.3 / count
    pair = isinstance(method, lv.LobattoPair)
    tableau = lobatto(method.stages) if pair else gauss(method.stages)

    def links(t, q):
        ends = ca.horzcat(ca.SX(2, 1), ca.reshape(q, 2, count))
        arms = ends[:, 1:] - ends[:, :-1]
        return ca.horzsplit((ca.sum1(arms**2) - count**-2) / (2 / count))

    plain = Plain.lagrangian(
        2 * count, lambda t, q, v: (ca.dot(v, v) / 2 - ca.sum1(q[1::2])) / count, links
    )
    q, v = start["q"], start["v"]
    solution = lv.integrate(system, method, t=(0, 2 * h), steps=2, **start)
    for k in range(2):
        q, v, *_ = plain.step("chain", tableau, 0.0, q, v, h)
        np.testing.assert_allclose(solution.q[k + 1], q, rtol=0, atol=1e-13)
        np.testing.assert_allclose(solution.v[k + 1], v, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", MECHANISMS)
def test_solvers_agree_and_keep_what_is_constant(kind):
    system, start = MECHANISMS[kind]()
    runs = [
        lv.integrate(system, lv.Spark(3, solver=solver), t=(0, 0.2), h=0.01, **start)
        for solver in ("node-schur", "newton", "auto")
    ]
    schur, newton, auto = runs
    assert schur.stats["newton_steps"] == auto.stats["newton_steps"] == 0
    assert newton.stats["newton_steps"] == newton.stats["steps"]
    for other in (newton, auto):
        np.testing.assert_allclose(other.q, schur.q, rtol=0, atol=1e-12)
        np.testing.assert_allclose(other.lam, schur.lam, rtol=0, atol=1e-9)
    for solution in runs:
        assert abs(solution.residuals["constraint"]).max() < 1e-13
        assert abs(solution.residuals["hidden"]).max() < 1e-12
        energy = solution.invariants["energy"]
        assert np.ptp(energy) < 1e-6 * np.ptp(start["q"]) * len(start["q"])


def test_order_of_many_rigid_bodies():
    system, start = rigid_chain.build(8), rigid_chain.start_for(8)

    def end(steps, stages=2):
        method = lv.Spark(stages)
        return lv.integrate(system, method, t=(0, 0.2), steps=steps, every=steps, **start).q[-1]

    exact = end(40, 6)
    errors = [abs(end(steps) - exact).max() for steps in (10, 20)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)


def test_a_thousand_links_meet_their_constraints():
    system, start = chain.build(1000), chain.start_for(1000)
    solution = lv.integrate(system, lv.Spark(2), t=(0, 0.02), steps=100, every=100, **start)
    arms = np.diff(solution.q.reshape(-1, 1000, 2), axis=1)
    np.testing.assert_allclose(np.hypot(*arms.T), 1e-3, rtol=1e-12)
    assert abs(solution.residuals["hidden"]).max() < 1e-12
    assert solution.stats["solver"] == "node-schur"


@pytest.mark.parametrize("method", [lv.Spark(2), lv.LobattoPair(), lv.HHT()], ids=repr)
@pytest.mark.parametrize("bodies", [60, 120])
def test_a_rod_there_twice_is_left_out(bodies, method):
    (twice, start), (once, _) = (tree(lambda k: k - 1, bodies, loops) for loops in ([(30, 29)], []))
    call = {"t": (0, 0.1), "h": 0.01, **start}
    doubled, single = (lv.integrate(system, method, **call) for system in (twice, once))
    np.testing.assert_allclose(doubled.q, single.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(doubled.reaction(), single.reaction(), rtol=0, atol=1e-9)
    np.testing.assert_allclose(doubled.lam[:, 30], doubled.lam[:, bodies], rtol=1e-12)
    assert lv.integrate(twice, method, states=False, **call).status == "done"


def test_long_steps_of_a_chain_under_tension_take_few_corrections():
    system, start = chain.build(10), lv.problems.load("chain").start
    own = lv.integrate(system, lv.Spark(2), t=(0.0, 1.0), steps=13, **start)
    assert own.stats["iterations"] < 8 * 13  # 14 a step without what the reactions change
    newton = lv.integrate(system, lv.Spark(2, solver="newton"), t=(0.0, 1.0), steps=13, **start)
    np.testing.assert_allclose(own.q, newton.q, rtol=0, atol=2e-15)
    np.testing.assert_allclose(own.lam, newton.lam, rtol=0, atol=2e-14 * np.abs(newton.lam).max())


def test_members_differ_in_when_corrections_take_what_the_reactions_change():
    system, start = chain.build(10), lv.problems.load("chain").start
    run = {"t": (0.0, 0.5), "steps": 7}
    q, v = [start["q"]] * 3, np.outer([1e-4, 0.1, 1.0], start["v"])
    several = lv.ensemble(system, lv.Spark(2), q=q, v=v, **run)
    taken = set()
    for k in range(3):
        alone = lv.integrate(system, lv.Spark(2), q=q[k], v=v[k], **run)
        taken.add(alone.stats["iterations"])
        np.testing.assert_array_equal(several.q[:, k], alone.q)
    assert len(taken) == 3
