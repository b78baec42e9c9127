"""Building a system takes work in proportion to its size, whatever pattern its derivatives have."""

import subprocess
import sys
import time

import casadi as ca
import numpy as np
import pytest

import liouville as lv
from liouville import problems
from liouville._systems.tape import record
from liouville._systems.tracing.sparse import jacobian, solve

LINKS = (60, 600)
FEWER = (20, 200)


def built(links):
    """Build a chain with what its starts and records need; return the system and the tapes."""
    chain = problems.load("chain")
    system, start = chain.build(links), chain.start_for(links)
    system.consistent(**start)
    projections = [tape for tapes, *_ in system._recorded.values() for tape in tapes]
    return system, [*system.tapes.values(), system.observer(None, True)[0], *projections]


def built_for_all(links):
    """Build a chain for every method."""
    system, _ = built(links)
    return system.second_order, system.separable


def calls(function, *args):
    """Count what a function calls, in Python and out of it."""
    count = 0

    def seen(frame, event, arg):
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(seen)
    try:
        function(*args)
    finally:
        sys.setprofile(None)
    return count


def test_the_instructions_of_a_chain_grow_as_its_links():
    few, many = (sum(map(len, built(links)[1])) for links in LINKS)
    assert np.log10(many / few) == pytest.approx(1, abs=0.01)
    assert many < 150 * LINKS[1]


def test_the_calls_that_build_a_chain_grow_no_faster_than_its_links():
    few, many = (calls(built_for_all, links) for links in FEWER)
    assert np.log10(many / few) < 1.01


def carts(pendula):
    """Return q and the energy's gradient of pendula on a cart: all meet in one coordinate."""
    q = ca.SX.sym("q", pendula + 1)
    energy = q[0] ** 2 + ca.sum1(q[0] * q[1:] * ca.cos(q[1:]))
    return q, ca.gradient(energy, q)


def test_a_derivative_with_a_full_row_and_column_is_that_of_casadi():
    q, gradient = carts(200)
    own, all_at_once = jacobian(gradient, q), ca.jacobian(gradient, q)
    assert own.sparsity() == all_at_once.sparsity()
    at = np.linspace(0.1, 2, 201)
    values = ca.Function("both", [q], [own, all_at_once])(at)
    np.testing.assert_allclose(*(x.full() for x in values), rtol=1e-14, atol=1e-14)


def test_a_full_row_and_column_take_no_sweep_for_each_coordinate():
    q, gradient = carts(2000)
    begin = time.process_time()
    jacobian(gradient, q)
    assert time.process_time() - begin < 2  # a sweep for each takes ten seconds, and these 0.03


def blocks(count, rng):
    """Return q and a matrix of blocks of 4, its rows and columns shuffled alike."""
    q = ca.SX.sym("q", 4 * count)
    each = [q[4 * k : 4 * k + 4] for k in range(count)]
    places = rng.permutation(4 * count).tolist()
    return q, ca.diagcat(*(x @ x.T + ca.SX.eye(4) for x in each))[places, places]


def test_blocks_are_solved_one_by_one():
    q, matrix = blocks(10, np.random.default_rng(0))
    right = ca.SX.sym("right", 40)
    inverse, alone = solve(matrix, ca.SX.eye(40)), solve(matrix, right)
    assert inverse.nnz() == 160
    f = ca.Function("f", [q, right], [matrix, inverse, alone])
    b = np.linspace(-1, 1, 40)
    A, X, x = (part.full() for part in f(np.linspace(0.1, 2, 40), b))
    np.testing.assert_allclose(A @ X, np.eye(40), atol=1e-13)
    np.testing.assert_allclose(A @ x, b[:, None], atol=1e-13)


def test_blocks_are_solved_without_a_search_over_all_of_them():
    _, matrix = blocks(400, np.random.default_rng(1))
    begin = time.process_time()
    solve(matrix, ca.SX.eye(1600))
    assert time.process_time() - begin < 4  # as a whole half a minute, and these 0.2


def test_the_derivatives_of_forty_beads_are_those_of_differences():
    polymer = problems.load("polymer")
    system, start = polymer.build(40), polymer.start_for(40)
    n, params = len(system.coordinates), system.values(None)
    y, z, lam = start["q"], start["v"], np.linspace(-1, 1, len(system.constraints))

    def slope(tape, outputs, moved, *others):
        """Differences of order 4, of which the first argument moves."""
        h = 1e-3
        steps = h * np.array([1, -1, 2, -2])[:, None, None] * np.eye(n)
        points = (moved + steps).reshape(4 * n, n)
        fixed = [np.tile(x, (4 * n, 1)) for x in others]
        order = [points, *fixed] if moved is y else [fixed[0], points, *fixed[1:]]
        values = system.tapes[tape].map(params, [np.zeros((4 * n, 1)), *order])[:, outputs]
        near, far = np.diff(values.reshape(2, 2, n, -1), axis=1)[:, 0]
        return -(8 * near - far).T / (12 * h)

    def given(tape, names, *args):
        values = system.tapes[tape].map(params, [np.zeros((1, 1)), *(x[None] for x in args)])[0]
        for name in names:
            rows, cols, row, col = system.patterns[name]
            dense = np.zeros((rows, cols))
            dense[row, col], values = values[: row.size], values[row.size :]
            yield dense

    p, f, g = slice(n), slice(n, 2 * n), slice(len(lam))
    r = slice(len(lam), None)
    p_z = next(given("stage_blocks", ["p_z"], y, z))
    p_y, f_y, f_z = given("stage_jacobian", ["p_y", "f_y", "f_z"], y, z)
    g_y = next(given("node_blocks", ["g_y"], y, lam))
    r_y = next(given("node_jacobian", ["r_y"], y, lam))
    pairs = [
        (p_z, slope("stage", p, z, y)),
        (p_y, slope("stage", p, y, z)),
        (f_y, slope("stage", f, y, z)),
        (f_z, slope("stage", f, z, y)),
        (g_y, slope("node", g, y, lam)),
        (r_y, slope("node", r, y, lam)),
    ]
    for exact, difference in pairs:
        np.testing.assert_allclose(exact, difference, atol=1e-8 * max(1, abs(exact).max()))


def test_what_is_written_twice_is_computed_once():
    x = ca.SX.sym("x", 2)
    written = [ca.sin(x[0]) * x[1], x[1] * ca.sin(x[0]) + 3, ca.sin(x[0])]
    tape = record("twice", {"x": x, "params": ca.SX(0, 1)}, ca.vertcat(*written))
    assert len(tape) == 3
    values = tape.map(np.empty(0), [np.array([[0.3, -2.0]])])[0]
    np.testing.assert_array_equal(values, [np.sin(0.3) * -2, np.sin(0.3) * -2 + 3, np.sin(0.3)])


def test_a_hamiltonian_of_bodies_starts_on_its_constraints_at_once():
    bodies = 200
    weights = ca.DM(np.diag([1.0, 2, 3, 4]) + 0.5)
    system = lv.Hamiltonian(
        lambda t, q, p, params: ca.sum2(
            ca.sum1(ca.reshape(p, 4, bodies) * (weights @ ca.reshape(p, 4, bodies)))
        ),
        lambda t, q, params: ca.sum1(ca.reshape(q, 4, bodies) ** 2).T - 1,
        q=4 * bodies,
    )
    rng = np.random.default_rng(2)
    begin = time.process_time()
    start = system.consistent(q=rng.normal(size=4 * bodies), p=rng.normal(size=4 * bodies))
    assert time.process_time() - begin < 5
    np.testing.assert_allclose((start["q"].reshape(bodies, 4) ** 2).sum(axis=1), 1, rtol=1e-12)


EXTRAS = (
    "google_crc32c",
    "h5netcdf",
    "h5py",
    "jax",
    "matplotlib",
    "rich",
    "skfem",
    "torch",
    "typer",
    "xarray",
    "zarr",
)


def test_a_plain_install_imports_and_integrates_without_any_extra():
    program = f"""
import sys
sys.modules.update(dict.fromkeys({EXTRAS}))
import liouville as lv
from liouville.problems import pendulum
found = lv.integrate(pendulum.system, lv.Spark(2), t=(0, 1), steps=10, **pendulum.start)
assert found.status == "done"
"""
    subprocess.run([sys.executable, "-c", program], check=True)
