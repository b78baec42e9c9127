"""Derivatives by a drive converge where the run itself needs no terms for it."""

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

import liouville as lv

X, Y = np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([[0.0, -1.0j], [1.0j, 0.0]])
LEVELS = np.diag([0.0, 1.0])


def first_order(f, t1, omega=1.0):
    """Return -i times the integral of e^{-i omega (T - t)} f(t): the other level's amplitude."""
    nodes, weights = leggauss(20)
    ends = np.linspace(0.0, t1, 2001)
    t = (ends[:-1, None] + np.diff(ends)[:, None] * (1 + nodes) / 2).ravel()
    w = (np.diff(ends)[:, None] * weights / 2).ravel()
    return -1j * np.sum(w * np.exp(-1j * omega * (t1 - t)) * f(t))


def both(system, method, name, **run):
    """Return the tangent at the end, which the pullback is seen to agree with."""
    move = np.ones(np.shape(system.params[name[7:]])) if name.startswith("params") else run["move"]
    run = {key: value for key, value in run.items() if key != "move"}
    found = lv.integrate(system, method, tangents={name: move}, **run)
    tangent = found.tangents[name].psi[-1]
    solution, pullback = lv.vjp(system, method, wrt=[name], **run)
    cotangents = np.zeros_like(solution.psi)
    cotangents[-1] = np.exp(1j * np.arange(tangent.size))
    wanted = np.vdot(cotangents[-1], tangent).real
    size = np.linalg.norm(tangent)
    assert abs(np.vdot(pullback(psi=cotangents)[name], move) - wanted) < 1e-11 * size
    return tangent


def moved(run, name, h):
    """Return the derivative of psi at the end by differences of the sixth order."""
    values = [run({name: j * h}) - run({name: -j * h}) for j in (1, 2, 3)]
    return (45 * values[0] - 9 * values[1] + values[2]) / (60 * h)


def bump(t):
    return np.exp(-(((t - 1) / 0.3) ** 2))


FUNCTIONS = {
    "slow": (lambda t, p: p.k * ca.sin(3 * t), lambda t: np.sin(3 * t), LEVELS, 2.0),
    "long": (lambda t, p: p.k * ca.sin(3 * t), lambda t: np.sin(3 * t), LEVELS, 200.0),
    "fast": (lambda t, p: p.k * ca.sin(30 * t), lambda t: np.sin(30 * t), LEVELS, 2.0),
    "wide": (lambda t, p: p.k * ca.sin(30 * t), lambda t: np.sin(30 * t), 100 * LEVELS, 2.0),
    "pulse": (lambda t, p: p.k * ca.exp(-(((t - 1) / 0.3) ** 2)), bump, LEVELS, 2.0),
    "constant": (lambda t, p: p.k + 0 * t, np.ones_like, LEVELS, 2.0),
    "no H": (lambda t, p: p.k * t, lambda t: t, 0 * LEVELS, 2.0),
    "little H": (lambda t, p: p.k * t, lambda t: t, 1e-30 * LEVELS, 2.0),
}


@pytest.mark.parametrize("tol", [1e-4, 1e-8, 1e-11])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_drive_that_is_zero_has_its_first_order(name, tol):
    drive, f, levels, t1 = FUNCTIONS[name]
    system = lv.Schrodinger(levels, drive=[(drive, X)], params={"k": 0.0})
    tangent = both(system, lv.Chebyshev(tol), "params.k", t=(0, t1), psi=[1, 0])
    wanted = first_order(f, t1, levels[1, 1])
    assert tangent[0] == 0
    assert abs(tangent[1] - wanted) < max(tol, 1e-9) * (abs(wanted) + 1e-4)


@pytest.mark.parametrize("method", [lv.Magnus(4), lv.Magnus(6, tol=1e-12)])
@pytest.mark.parametrize("matrix", [X, Y])
def test_exponentials_of_nothing_have_derivatives(matrix, method):
    drive = [(lambda t, p: p.k * t, matrix)]
    system = lv.Schrodinger(0 * LEVELS, drive=drive, params={"k": 0.0})
    tangent = both(system, method, "params.k", t=(0, 2), steps=3, psi=[1, 0])
    np.testing.assert_allclose(tangent, [0, -2j * matrix[1, 0]], atol=1e-12)


@pytest.mark.parametrize("levels", [LEVELS, 0 * LEVELS])
def test_samples_that_are_zero_have_their_first_order(levels):
    times, t1 = np.linspace(0.0, 40.0, 21), 40.0
    system = lv.Schrodinger(levels, drive=[(np.zeros(21), X)], times=times)
    unit = np.eye(21)[7]
    tangent = both(system, "auto", "drive[0]", t=(0, t1), psi=[1, 0], move=unit)

    def run(u):
        own = lv.Schrodinger(levels, drive=[(u["drive"] * unit, X)], times=times)
        return lv.integrate(own, lv.Chebyshev(1e-12), t=(0, t1), psi=[1, 0]).psi[-1]

    wanted = moved(run, "drive", 1e-3)
    assert np.linalg.norm(tangent - wanted) < 1e-8 * np.linalg.norm(wanted)


def tones(t, p):
    return sum(p.c[j] * ca.sin((j + 1) * ca.pi * t / 5) for j in range(12))


@pytest.mark.parametrize("first", [0.0, 1e-4, 0.5])
def test_the_last_of_many_tones_has_its_derivative(first):
    c = np.r_[first, np.zeros(11)]
    system = lv.Schrodinger(LEVELS, drive=[(tones, X)], params={"c": c})
    unit = np.eye(12)[11]
    run = {"t": (0, 5), "psi": [1, 0]}
    tangent = lv.integrate(system, "auto", tangents={"params.c": unit}, **run)
    tangent = tangent.tangents["params.c"].psi[-1]

    def at(u):
        params = {"c": c + u["c"] * unit}
        return lv.integrate(system, lv.Chebyshev(1e-12), params=params, **run).psi[-1]

    wanted = moved(at, "c", 1e-3)
    assert np.linalg.norm(tangent - wanted) < 1e-8 * np.linalg.norm(wanted)


@pytest.mark.parametrize("k", [0.0, 1e-4])
def test_a_potential_that_hardly_moves_has_its_derivative(k):
    grid = lv.Grid(-8, 8, 64, potential=lambda t, x, p: x**2 / 2 + p.k * ca.sin(3 * t) * x)
    system = lv.Schrodinger(grid, params={"k": k})
    psi = np.exp(-((system.grid.points[:, 0] - 1) ** 2) / 2 + 0j)
    run = {"t": (0, 3), "psi": psi / np.linalg.norm(psi)}
    tangent = both(system, "auto", "params.k", **run)

    def at(u):
        params = {"k": k + u["k"]}
        return lv.integrate(system, lv.Chebyshev(1e-12), params=params, **run).psi[-1]

    wanted = moved(at, "k", 1e-2)
    assert np.linalg.norm(tangent - wanted) < 1e-8 * np.linalg.norm(wanted)


def test_directions_need_terms_that_the_state_does_not():
    """A state in the middle of all energies stays there, and one beside it does not."""
    drive = [(lambda t, p: 1e-12 * ca.sin(t), np.ones((3, 3)))]
    system = lv.Schrodinger(np.diag([-50.0, 0.0, 50.0]), drive=drive)
    run = {"t": (0, 0.1), "psi": [0, 1, 0], "tangents": {"psi": [1, 0, 0]}}
    found = lv.integrate(system, "auto", **run).tangents["psi"].psi[-1]
    np.testing.assert_allclose(found, [np.exp(5j), 0, 0], atol=1e-8)


def root(t, p):
    return ca.sqrt(p.k) * ca.sin(t)


def late(t, p):
    return ca.sqrt((t - 0.5) ** 2 + p.k)


@pytest.mark.parametrize(("drive", "where"), [(root, "0"), (late, "0.5")])
@pytest.mark.parametrize(
    ("method", "steps"), [("auto", {}), (lv.Chebyshev(), {}), (lv.Magnus(4), {"steps": 5})]
)
def test_a_drive_with_no_finite_derivative_is_refused(drive, where, method, steps):
    system = lv.Schrodinger(LEVELS, drive=[(drive, X)], params={"k": 0.0})
    run = {"t": (0, 1), "psi": [1, 0], **steps}
    says = f"not finite near t = {where}\n"
    with pytest.raises(ValueError, match=says):
        lv.integrate(system, method, tangents={"params.k": 1.0}, **run)
    with pytest.raises(ValueError, match=says):
        lv.vjp(system, method, wrt=["params.k"], **run)


def test_auto_of_many_drives_names_the_methods_that_have_tangents():
    matrices = [np.roll(np.eye(16), k, 1) + np.roll(np.eye(16), k, 1).T for k in range(11)]
    drive = [(lambda t, p, k=k: p.a * ca.sin(k * t), each) for k, each in enumerate(matrices, 1)]
    system = lv.Schrodinger(np.diag(np.arange(16.0)), drive=drive, params={"a": 0.2})
    with pytest.raises(TypeError, match=r"up to ten drives, Magnus\(...\) with h= or steps="):
        lv.vjp(system, "auto", wrt=["params.a"], t=(0, 1), psi=np.eye(16)[0])


@pytest.mark.parametrize("tol", [1e-2, 1e-3, 1e-5])
def test_a_crude_magnus_method_is_crude_by_its_tolerance(tol):
    n, hopping = 24, (np.eye(24, k=1) + np.eye(24, k=-1)) / 2
    drive = [(lambda t, p: ca.cos(t), hopping)]
    system = lv.Schrodinger(np.diag(np.linspace(0, 10, n)), bounds=(-5, 15), drive=drive)
    run = {"t": (0, 2), "steps": 20, "psi": np.ones(n) / np.sqrt(n)}
    found = lv.integrate(system, lv.Magnus(4, tol=tol), **run).psi[-1]
    wanted = lv.integrate(system, lv.Magnus(4, tol=1e-12), **run).psi[-1]
    assert np.linalg.norm(found - wanted) < tol
