"""Derivatives of runs of Schrödinger equations are those of the discrete map, by everything."""

from concurrent.futures import ThreadPoolExecutor
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


def well(t, x, p):
    return p.k * (x - p.a * ca.sin(p.w[0] * t + p.w[1])) ** 2 / 2


def still(t, x, p):
    return p.k * x**2 / 2 + p.c[0] * ca.cos(p.c[1] * x)


def in_well(potential=well, more=None, **also):
    """Return a grid with a potential of parameters, and perhaps a drive."""
    params = {"a": 0.3, "k": 1.0, "w": [1.5, 0.2], "c": [0.3, 0.7]}
    drive = [] if more is None else [(lambda t, p: p.a * ca.cos(t), more)]
    grid = lv.Grid(-8, 8, 32, potential=potential)
    return lv.Schrodinger(grid, drive=drive, params=params, **also)


U = RNG.standard_normal(17)
STABLE = lv.SchrodingerSplitting(1e-6, mode="stable")
PARAMS = ("psi", "params.a", "params.w", "params.b")
WELL, STILL = ("psi", "params.a", "params.k", "params.w"), ("psi", "params.k", "params.c")
DIAGONAL, FULL = np.diag(RNG.standard_normal(32)), hermitian(is_complex=True, n=32) / 4

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
    "well": (in_well, "auto", WELL, {}),
    "well and hbar": (lambda: in_well(hbar=0.7), lv.Chebyshev(1e-3), WELL, {}),
    "well and drive": (lambda: in_well(more=DIAGONAL), "auto", WELL, {"t": (3.0, 0.5, -1.0)}),
    "well and complex": (lambda: in_well(more=FULL), "auto", WELL, {}),
    "still": (lambda: in_well(still), lv.Chebyshev(), STILL, {}),
    "still and drive": (lambda: in_well(still, DIAGONAL), "auto", ("params.a", *STILL), {}),
    "still by shears": (lambda: in_well(still), STABLE, STILL, {}),
    "still back": (
        lambda: in_well(still, hbar=0.8), lv.GrayManolopoulos(4), STILL,
        {"t": (3, 0), "h": 0.05, "every": 20},
    ),
    "well by Magnus 2": (in_well, lv.Magnus(2), WELL, {"t": (0, 3), "steps": 9, "every": 4}),
    "well by Magnus 6": (in_well, lv.Magnus(6), WELL, {"t": (3, 0), "steps": 5}),
    "complex well by Magnus 4": (
        lambda: in_well(more=FULL), lv.Magnus(4), WELL, {"t": (0, 2), "steps": 5},
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
    # potentials change energies that series take to high powers
    size = {"size": 1e-4} if system.grid is not None else {}
    found = lv.analysis.check_gradient(
        system, method, wrt=wrt, **{"t": TIMES, **run}, psi=state(system.size), **size
    )
    assert found.dot < 1e-12
    assert found.differences < 1e-10


@pytest.mark.parametrize(("potential", "more"), [(well, None), (still, None), (well, DIAGONAL)])
def test_gradients_by_a_potential_are_those_of_the_flow(potential, more):
    """Runs with other parameters choose other windows, and have other bounds."""
    params = {"k": 1.0, "a": 0.3, "w": np.array([1.5, 0.2]), "c": np.array([0.3, 0.7])}
    system, method = in_well(potential, more), lv.Chebyshev(1e-12)
    x = system.grid.points[:, 0]
    psi, target = np.exp(-((x - 1) ** 2) / 2 + 0j), np.exp(-(x**2) / 3 + 0.5j * x)
    names = ["k", "a", "w"] if potential is well else ["k", "c"]
    solution, pullback = lv.vjp(
        system, method, wrt=[f"params.{name}" for name in names], t=(0, 2), psi=psi
    )
    gradients = pullback(psi=fidelity(solution, target)[1])

    def value(name, moved):
        run = lv.integrate(system, method, t=(0, 2), psi=psi, params={**params, name: moved})
        return fidelity(run, target)[0]

    for name in names:
        units = np.eye(2) if np.ndim(params[name]) else [1.0]
        for unit, found in zip(units, np.atleast_1d(gradients[f"params.{name}"]), strict=True):
            sides = [
                value(name, params[name] + j * unit) - value(name, params[name] - j * unit)
                for j in (5e-3, 1e-2, 1.5e-2)
            ]
            wanted = (45 * sides[0] - 9 * sides[1] + sides[2]) / 0.3
            assert abs(found - wanted) < 1e-8


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
    found = lv.analysis.check_gradient(
        problem.system, row.method, wrt=["psi"], **run, **problem.start
    )
    assert found.dot < 1e-12
    assert found.differences < 1e-10


@pytest.mark.parametrize(
    "name", ["constant", "shears", "driven", "grid", "Magnus 4", "Magnus 2 by shears"]
)
def test_a_run_with_derivatives_is_what_they_are_of(name):
    """Its series are as long as derivatives need; where they need no more it has the same bits."""
    make, method, wrt, run = ROWS[name]
    system, run = make(), {"t": TIMES, **run}
    psi = state(system.size)
    plain = lv.integrate(system, method, **run, psi=psi).psi
    found = lv.integrate(system, method, **run, psi=psi, tangents={"psi": psi})
    np.testing.assert_allclose(found.tangents["psi"].psi, found.psi, atol=1e-13)  # H is linear
    if name in ("driven", "grid"):
        np.testing.assert_allclose(found.psi, plain, atol=1e-8)
    else:
        np.testing.assert_array_equal(found.psi, plain)
    solution, pullback = lv.vjp(system, method, wrt=wrt, **run, psi=psi)
    np.testing.assert_allclose(solution.psi, plain, atol=1e-8)
    again = pullback.adjoint.moved({name: np.zeros(()) for name in wrt}, 0.0)
    np.testing.assert_allclose(again["psi"], solution.psi, atol=1e-14)


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


def test_a_pullback_called_again_has_the_same_bits():
    """The first call uses up the terms that were kept."""
    psi = state()
    solution, pullback = lv.vjp(driven(), "auto", wrt=PARAMS, t=TIMES, psi=psi)
    first, again = (pullback(psi=solution.psi) for _ in range(2))
    for name in PARAMS:
        np.testing.assert_array_equal(first[name], again[name])


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
    (driven, {"t": (0, 1), "wrt": ["psi"]}, {"psi": np.zeros((3, N))}, ValueError, "must have"),
    (driven, {"wrt": ["psi"]}, {"q": np.zeros(3)}, TypeError, "no cotangent of 'q'"),
    (driven, {"wrt": ["psi"]}, {"psi": np.full((6, N), np.nan)}, ValueError, "must be finite"),
    (
        lambda: lv.Schrodinger(H, drive=[(jumping, B)], params={"a": 1.0, "b": 1.0}),
        {"wrt": ["params.b"]}, {}, ValueError, "not smooth in time",
    ),
    (
        lambda: in_well(lambda t, x, p: x**2 / 2 * ca.if_else(t > p.a, p.k, 0.0) + 0 * p.k),
        {"wrt": ["params.k"]}, {}, ValueError, "of the potential .* is not smooth in time",
    ),
    (
        lambda: in_well(lambda t, x, p: ca.sqrt(p.a - 0.3) * x**2),
        {"method": lv.Chebyshev(), "wrt": ["params.a"]}, {"psi": np.ones((6, 32))},
        ValueError, "of the potential by its parameters are not finite",
    ),
    (
        in_well, {"method": lv.SplitOperator(), "wrt": ["params.k"], "h": 0.1}, {},
        TypeError, "no tangents",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("make", "run", "given", "kind", "says"), BAD)
def test_what_cannot_be_differentiated_is_refused(make, run, given, kind, says):
    system = make()
    arguments = {"method": "auto", "wrt": ["psi"], "t": TIMES, "psi": state(system.size), **run}
    with pytest.raises(kind, match=says):
        lv.vjp(system, **arguments)[1](**given)


@pytest.mark.parametrize(("make", "method", "name", "used"), [
    (lambda: in_well(still), lv.Chebyshev(), "w", "k"),
    (lambda: in_well(still), lv.GrayManolopoulos(4), "w", "c"),
    (lambda: in_well(well), lv.Magnus(4), "c", "w"),
    (lambda: in_well(lambda t, x, p: x**2 / 2, more=FULL), "auto", "w", "a"),
    (lambda: lv.Schrodinger(H, params={"b": 0.4}), "auto", "b", None),
])  # fmt: skip
def test_a_derivative_by_what_nothing_depends_on_is_zero(make, method, name, used):
    """As for mechanisms, alone and beside what something depends on."""
    system = make()
    run = {"t": (0, 1), "psi": state(system.size)}
    run |= {} if method in ("auto", lv.Chebyshev()) else {"steps": 200}
    along, names = np.ones(np.shape(system.params[name])), [f"params.{name}"]
    tangents = lv.integrate(system, method, tangents={names[0]: along}, **run).tangents
    assert not tangents[names[0]].psi.any()
    for wrt in (names, [*names, "psi", *([f"params.{used}"] if used else [])]):
        solution, pullback = lv.vjp(system, method, wrt=wrt, **run)
        found = pullback(psi=solution.psi)
        assert np.shape(found[names[0]]) == np.shape(along)
        assert not np.any(found[names[0]])
        assert found.keys() == set(wrt)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", [
    "constant", "chain", "samples", "driven and complex", "well and drive", "still by shears",
    "shears", "stable", "Magnus 2 by shears", "Magnus 4",
])  # fmt: skip
def test_members_have_the_tangents_of_runs_alone(name, threads):
    make, method, wrt, run = ROWS[name]
    system, run = make(), {"t": TIMES, **run}
    rows = np.array([state(system.size) for _ in range(5)])
    params = {x: np.ones(np.shape(system.params[x[7:]])) for x in wrt if x.startswith("params")}
    moves = {"psi": rows[:2], **params, **({"drive[0]": U} if "drive[0]" in wrt else {})}
    many = lv.ensemble(system, method, **run, psi=rows, tangents=moves, threads=threads)
    plain = lv.ensemble(system, method, **run, psi=rows)
    tol = getattr(method, "tol", 1e-8)  # derivatives may ask for shorter windows and more terms
    np.testing.assert_allclose(many.psi, plain.psi, atol=tol)
    assert many.tangents["psi"].psi.shape == (len(many.t), 5, 2, system.size)
    for k in range(5):
        one = lv.integrate(system, method, **run, psi=rows[k], tangents=moves)
        np.testing.assert_array_equal(many.member(k).psi, one.psi)
        for x, tangent in one.tangents.items():
            np.testing.assert_array_equal(many.member(k).tangents[x].psi, tangent.psi)


@pytest.mark.parametrize("name", [
    "driven", "driven and complex", "well and drive", "still", "still by shears", "Magnus 4",
])  # fmt: skip
def test_members_with_parameters_of_their_own_have_the_bits_of_runs_alone(name):
    make, method, wrt, run = ROWS[name]
    system, run = make(), {"t": TIMES, **run}
    which = "k" if "still" in name else "a"
    moves = {f"params.{which}": 1.0, "psi": state(system.size)}
    call = {"method": method, **run, "tangents": moves, "observe": {"x": np.arange(system.size)}}
    for psi in (state(system.size), np.array([state(system.size) for _ in range(3)])):
        many = lv.ensemble(system, psi=psi, params={which: [0.5, 0.7, 1.1]}, threads=2, **call)
        assert many.varied == (which,)
        for k, value in enumerate([0.5, 0.7, 1.1]):
            start = psi[k] if psi.ndim > 1 else psi
            one, own = (
                lv.integrate(system, psi=start, params={which: value}, **call),
                many.member(k),
            )
            assert own.params == one.params
            np.testing.assert_array_equal(own.psi, one.psi)
            np.testing.assert_array_equal(own.observed["x"], one.observed["x"])
            for x, energy in one.invariants.items():
                np.testing.assert_array_equal(own.invariants[x], energy)
            for x, tangent in one.tangents.items():
                np.testing.assert_array_equal(own.tangents[x].psi, tangent.psi)
    found = lv.analysis.check_gradient(
        system, method, wrt=wrt, **run, psi=psi, params={which: [0.5, 0.7, 1.1]}, size=1e-4
    )
    assert found.dot < 1e-12
    assert found.differences < 1e-10


def test_workers_take_members_with_parameters_of_their_own():
    system, psi = driven(), state()
    run = {"t": TIMES, "psi": psi, "params": {"a": np.linspace(0.1, 1.0, 5)}}
    here = lv.ensemble(system, "auto", **run)
    with ThreadPoolExecutor(2) as pool:
        there = lv.ensemble(system, "auto", executor=pool, chunk=2, **run)
    np.testing.assert_array_equal(here.psi, there.psi)
    assert there.members == 5


@pytest.mark.parametrize("name", ["driven", "well", "still by shears", "Magnus 4"])
def test_tangents_pullbacks_and_differences_of_ensembles_agree(name):
    make, method, wrt, run = ROWS[name]
    system = make()
    rows = np.array([state(system.size) for _ in range(3)])
    found = lv.analysis.check_gradient(
        system, method, wrt=wrt, **{"t": TIMES, **run}, psi=rows, size=1e-4
    )
    assert found.dot < 1e-12
    assert found.differences < 1e-10


def test_a_member_that_fails_has_no_tangents():
    """One far beyond the bounds leaves its norm; the others have their tangents."""
    drive = [(lambda t, p: p.k * ca.sin(t), np.diag([0.0, 0.1, 0.0]))]
    levels, bounds = np.diag([-50.0, 0.0, 50.0]), (-5, 5)
    system = lv.Schrodinger(levels, drive=drive, params={"k": 1.0}, bounds=bounds)
    method, (far, low, _) = lv.Magnus(2, tol=1e-3), np.eye(3)
    run = {"t": (0, 3), "steps": 9, "tangents": {"psi": far, "params.k": 1.0}}
    found = lv.ensemble(system, method, psi=[low, far, 1j * low], **run)
    assert [*found.failures] == [1]
    for x, tangent in found.tangents.items():
        assert np.isnan(tangent.psi[:, 1]).all()
        for k, factor in ((0, 1), (2, 1j)):
            alone = lv.integrate(system, method, psi=factor * low, **run)
            np.testing.assert_array_equal(tangent.psi[:, k], alone.tangents[x].psi)


def test_what_does_not_fit_in_memory_is_refused_beforehand(monkeypatch):
    monkeypatch.setattr("liouville._basics.arguments.memory", lambda: 1e8)
    run = {"t": (0, 4), "steps": 10**6, "every": 10**6, "psi": state()}
    with pytest.raises(MemoryError, match="keeps 1000000 of its states"):
        lv.vjp(driven(C), lv.Magnus(2, tol=1e-7), wrt=["psi"], **run)


@pytest.mark.parametrize(("power", "end"), [(2, 1.0), (5, 1.9), (8, 1.5)])
def test_drives_that_grow_from_nothing_are_differentiated(power, end):
    flip = np.array([[0.0, 1.0], [1.0, 0.0]])
    drive = [(lambda t, params: params.a * t**power, flip)]
    system = lv.Schrodinger(0 * flip, drive=drive, params={"a": 1.0})
    solution, pullback = lv.vjp(system, "auto", t=(0, end), psi=[1, 0], wrt=("psi", "params.a"))
    slope = end ** (power + 1) / (power + 1)
    last = [np.cos(slope), -1j * np.sin(slope)]
    np.testing.assert_allclose(solution.psi[-1], last, rtol=0, atol=1e-8)
    cotangent = np.zeros_like(solution.psi)
    cotangent[-1, 0] = 1.0
    found = pullback(psi=cotangent)["params.a"]
    np.testing.assert_allclose(found, -np.sin(slope) * slope, rtol=0, atol=1e-7)
