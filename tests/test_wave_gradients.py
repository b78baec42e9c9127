"""Derivatives of runs of Schrödinger equations are those of the discrete map, by everything."""

from functools import reduce

import casadi as ca
import numpy as np
import pytest
from registry import ALL, WAVES
from scipy.linalg import expm
from scipy.sparse.linalg import LinearOperator

import liouville as lv

RNG = np.random.default_rng(5)
N = 10
TIMES = tuple(np.linspace(0.0, 4.0, 6))


def hermitian(is_complex=False, n=N):
    """Return a random Hermitian matrix."""
    a = RNG.standard_normal((n, n))
    if is_complex:
        a = a + 1j * RNG.standard_normal((n, n))
    return (a + a.conj().T) / 2


def state(n=N):
    """Return a random state of norm 1."""
    psi = RNG.standard_normal(n) + 1j * RNG.standard_normal(n)
    return psi / np.linalg.norm(psi)


H, B, C = hermitian(), hermitian(), hermitian(is_complex=True)


def wave(t, p):
    return p.a * ca.sin(p.w[0] * t + p.w[1])


def pulse(t, p):
    return p.b * ca.exp(-((t - 2) ** 2))


def driven(more=B, start=H):
    """Return a driven system with parameters, one of them a vector."""
    params = {"a": 0.7, "w": [2.0, 0.3], "b": 0.4}
    return lv.Schrodinger(start, drive=[(wave, B), (pulse, more)], params=params)


def sampled(u):
    """Return a system with samples as a drive."""
    times = np.linspace(-0.1, 4.1, u.size)
    return lv.Schrodinger(H, drive=[(u, B), (pulse, C)], times=times, params={"b": 0.4})


def on_grid():
    """Return a grid with a potential that moves."""
    grid = lv.Grid(-8, 8, 32, potential=lambda t, x, p: x**2 / 2 - 0.3 * ca.sin(t) * x)
    return lv.Schrodinger(grid)


U = RNG.standard_normal(17)
STABLE = lv.SchrodingerSplitting(1e-6, mode="stable")
PARAMS = ("psi", "params.a", "params.w", "params.b")

#: System, method, what derivatives are by, and the rest of the run.
ROWS = {
    "constant": (lambda: lv.Schrodinger(H), lv.Chebyshev(1e-4), ("psi",), {}),
    "complex": (lambda: lv.Schrodinger(C), "auto", ("psi",), {}),
    "chain": (lambda: lv.Schrodinger(lv.SpinChain(5)), lv.Chebyshev(), ("psi",), {}),
    "products": (
        lambda: lv.Schrodinger(LinearOperator((N, N), matvec=lambda x: H @ x, dtype=float)),
        lv.Chebyshev(), ("psi",), {},
    ),
    "driven": (driven, "auto", PARAMS, {}),
    "crude": (driven, lv.Chebyshev(1e-2), PARAMS, {}),
    "fine": (driven, lv.Chebyshev(1e-12), PARAMS, {}),
    "back": (driven, "auto", PARAMS, {"t": (4.0, 0.5, -1.0)}),
    "driven and complex": (lambda: driven(C), "auto", PARAMS, {}),
    "samples": (lambda: sampled(U), "auto", ("psi", "drive[0]", "params.b"), {}),
    "grid": (on_grid, "auto", ("psi",), {}),
    "shears": (lambda: lv.Schrodinger(H), STABLE, ("psi",), {}),
    "stable": (
        lambda: lv.Schrodinger(H), lv.StabilitySplitting(processed=False), ("psi",),
        {"t": (4.0, 0.3), "h": 0.3, "every": 5},
    ),
    "Magnus 2 by shears": (driven, lv.Magnus(2, tol=1e-4), PARAMS, {"t": (0, 4), "steps": 7}),
    "Magnus 4 by shears": (driven, lv.Magnus(4), PARAMS, {"t": (4, 0), "steps": 7, "every": 3}),
    "Magnus 6": (driven, lv.Magnus(6), PARAMS, {"t": (0, 4), "steps": 5}),
    "Magnus 8": (lambda: driven(C), lv.Magnus(8), PARAMS, {"t": (0, 4), "steps": 3}),
    "Magnus 2": (lambda: driven(C), lv.Magnus(2), PARAMS, {"t": (0, 4), "steps": 9, "every": 2}),
    "Magnus 4": (lambda: driven(C), lv.Magnus(4), PARAMS, {"t": (0, 4), "steps": 9, "every": 4}),
}  # fmt: skip


@pytest.mark.parametrize("name", ROWS)
def test_pullbacks_tangents_and_differences_are_of_one_discrete_map(name):
    make, method, wrt, run = ROWS[name]
    system = make()
    found = lv.check_gradient(
        system, method, wrt=wrt, **{"t": TIMES, **run}, psi=state(system.size)
    )
    assert found.dot < 1e-12
    assert found.differences < 1e-10


#: Methods and problems of the registry that have derivatives.
WITHOUT = (lv.Lanczos, lv.SplitOperator)
REGISTERED = [
    (row, name)
    for row in WAVES
    for name in row.on
    if not isinstance(row.method, WITHOUT)
    and not getattr(row.method, "processed", False)
    and not (isinstance(row.method, lv.SchrodingerSplitting) and name == "flux")
]


@pytest.mark.parametrize(("row", "name"), REGISTERED, ids=str)
def test_methods_of_the_registry_have_pullbacks(row, name):
    problem = ALL[name]
    run = {"t": (problem.t[0], problem.t[0] + 1.0)}
    if isinstance(row.method, lv.Magnus | lv.GrayManolopoulos | lv.StabilitySplitting):
        run["steps"] = row.steps[-1]
    found = lv.check_gradient(problem.system, row.method, wrt=["psi"], **run, **problem.start)
    assert found.dot < 1e-12
    assert found.differences < 1e-10


@pytest.mark.parametrize(
    "name", ["constant", "shears", "driven", "grid", "Magnus 4", "Magnus 2 by shears"]
)
def test_a_run_with_derivatives_has_the_bits_of_one_without(name):
    make, method, wrt, run = ROWS[name]
    system, run = make(), {"t": TIMES, **run}
    wrt = wrt if "Magnus" in name else ["psi"]  # parameters may ask for shorter windows
    psi = state(system.size)
    plain = lv.integrate(system, method, **run, psi=psi).psi
    solution, _ = lv.vjp(system, method, wrt=wrt, **run, psi=psi)
    np.testing.assert_array_equal(solution.psi, plain)
    found = lv.integrate(system, method, **run, psi=psi, tangents={"psi": psi})
    np.testing.assert_array_equal(found.psi, plain)
    np.testing.assert_allclose(found.tangents["psi"].psi, plain, atol=1e-12)  # H is linear


def fidelity(solution, target):
    """Return |<target|psi>|^2 at the end, and the cotangent of it."""
    overlap = np.vdot(target, solution.psi[-1])
    cotangent = np.zeros_like(solution.psi)
    cotangent[-1] = 2 * overlap * target
    return abs(overlap) ** 2, cotangent


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_gradients_by_samples_are_those_of_the_flow(scale):
    """Also where the pulse is zero, so that the run itself needs no polynomial of time."""
    u, psi, target = scale * U, state(), state()
    solution, pullback = lv.vjp(
        sampled(u), lv.Chebyshev(1e-12), wrt=["drive[0]"], t=(0, 4), psi=psi
    )
    gradient = pullback(psi=fidelity(solution, target)[1])["drive[0]"]

    def value(u):
        run = lv.integrate(sampled(u), lv.Chebyshev(1e-12), t=(0, 4), psi=psi)
        return fidelity(run, target)[0]

    for k in (0, 5, 16):
        step = np.zeros(U.size)
        step[k] = 1e-2
        sides = [value(u + j * step) - value(u - j * step) for j in (1, 2, 3)]
        wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / 0.6
        assert abs(gradient[k] - wanted) < 2e-8


def test_slices_have_the_gradient_of_their_exponentials():
    """Piecewise constant control by the exponential midpoint rule, against dense matrices."""
    steps, h = 12, 0.25
    u = RNG.standard_normal(steps + 1)
    times = h * (np.arange(steps + 1) + 0.5)  # samples in the middle of slices
    system = lv.Schrodinger(H, drive=[(u, C)], times=times)
    psi, target = state(), state()
    solution, pullback = lv.vjp(
        system, lv.Magnus(2, tol=1e-13), wrt=["drive[0]", "psi"], t=(0, 3), steps=steps, psi=psi
    )
    found = pullback(psi=fidelity(solution, target)[1])
    slices = [expm(-1j * h * (H + x * C)) for x in u[:-1]]
    for k in (0, 7, 11):
        a, zero = -1j * h * (H + u[k] * C), np.zeros((N, N))
        slope = expm(np.block([[a, -1j * h * C], [zero, a]]))[:N, N:]
        changed = [*slices[:k], slope, *slices[k + 1 :]]
        overlap = np.vdot(target, solution.psi[-1])
        amount = np.vdot(target, reduce(np.matmul, changed[::-1]) @ psi)
        assert abs(found["drive[0]"][k] - 2 * (np.conj(overlap) * amount).real) < 1e-11
    whole = reduce(np.matmul, slices[::-1])
    overlap = np.vdot(target, whole @ psi)
    np.testing.assert_allclose(found["psi"], whole.conj().T @ (2 * overlap * target), atol=1e-11)


def test_directions_come_one_by_one_or_together():
    system, psi = driven(), state()
    moves = np.array([state(), state(), 1j * psi])
    found = lv.integrate(
        system, "auto", t=TIMES, psi=psi, tangents={"psi": moves, "params.w": [1.0, -1.0]}
    ).tangents
    assert found["psi"].psi.shape == (len(TIMES), 3, N)
    assert found["params.w"].psi.shape == (len(TIMES), N)
    alone = lv.integrate(system, "auto", t=TIMES, psi=psi, tangents={"psi": moves[1]}).tangents
    np.testing.assert_allclose(alone["psi"].psi, found["psi"].psi[:, 1], atol=1e-14)
    np.testing.assert_array_equal(found["psi"].psi[0], moves)


def test_the_pairing_is_kept_over_ten_thousand_products():
    system, psi, target = lv.Schrodinger(lv.SpinChain(6)), state(64), state(64)
    run = {"t": (0, 6000), "psi": psi}
    solution, pullback = lv.vjp(system, lv.Chebyshev(1e-10), wrt=["psi"], **run)
    assert solution.stats["products"] > 1e4
    cotangent = np.zeros_like(solution.psi)
    cotangent[-1] = target
    gradient = pullback(psi=cotangent)["psi"]
    wanted = np.vdot(target, solution.psi[-1]).real  # the run is linear in psi
    assert abs(np.vdot(gradient, psi).real - wanted) < 1e-12


def jumping(t, p):
    return ca.if_else(t > p.a, 1.0, 0.0) * p.b


BAD = [
    (driven, {"method": lv.Lanczos()}, {}, TypeError, "H without time"),
    (lambda: lv.Schrodinger(H), {"method": lv.Lanczos()}, {}, TypeError, "that have: 'auto'"),
    (driven, {"wrt": ["params.c"]}, {}, ValueError, "there is no direction 'params.c'"),
    (driven, {"wrt": ["drive[0]"]}, {}, ValueError, "there is no direction"),
    (driven, {"wrt": "psi"}, {}, TypeError, "a sequence of names"),
    (driven, {"t": (0, 1), "wrt": ["psi"]}, {"psi": np.zeros((3, N))}, ValueError, "has shape"),
    (driven, {"wrt": ["psi"]}, {"q": np.zeros(3)}, TypeError, "no cotangent of 'q'"),
    (driven, {"wrt": ["psi"]}, {"psi": np.full((6, N), np.nan)}, ValueError, "not finite"),
    (
        lambda: lv.Schrodinger(H, drive=[(jumping, B)], params={"a": 1.0, "b": 1.0}),
        {"wrt": ["params.b"]}, {}, ValueError, "not smooth in time",
    ),
    (
        lambda: lv.Schrodinger(
            lv.Grid(-8, 8, 16, potential=lambda t, x, p: p.k * x**2), params={"k": 1.0}
        ),
        {"method": lv.Chebyshev(), "wrt": ["params.k"]}, {}, ValueError, "which the potential",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("make", "run", "given", "kind", "says"), BAD)
def test_what_cannot_be_differentiated_is_refused(make, run, given, kind, says):
    system = make()
    arguments = {"method": "auto", "wrt": ["psi"], "t": TIMES, "psi": state(system.size), **run}
    with pytest.raises(kind, match=says):
        lv.vjp(system, **arguments)[1](**given)


def test_tangents_of_ensembles_are_refused():
    rows = np.array([state(), state()])
    with pytest.raises(TypeError, match="one by one"):
        lv.ensemble(driven(), "auto", t=TIMES, psi=rows, tangents={"psi": rows[0]})


def test_what_does_not_fit_in_memory_is_refused_beforehand(monkeypatch):
    monkeypatch.setattr("liouville._arguments.memory", lambda: 1e8)
    run = {"t": (0, 4), "steps": 10**6, "every": 10**6, "psi": state()}
    with pytest.raises(MemoryError, match="keeps 1000000 of its states"):
        lv.vjp(driven(C), lv.Magnus(2, tol=1e-7), wrt=["psi"], **run)
