"""Systems, methods and solutions pickle: small, and to the same bits where they arrive."""

import copy
import pickle
from contextlib import suppress

import casadi as ca
import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator

import liouville as lv
from liouville import problems
from liouville._systems import tape
from liouville.problems import chain, load, sabra

METHODS = {
    "Spark": lv.Spark(2),
    "RATTLE": lv.LobattoPair(2),
    "LobattoPair": lv.LobattoPair(3),
    "HHT": lv.HHT(),
    "composition": lv.Composition(lv.Spark(1), "SU4"),
}


def travelled(what):
    return pickle.loads(pickle.dumps(what))


def same(a, b):
    """Compare all arrays of two solutions bit by bit."""
    assert a.t.tobytes() == b.t.tobytes()
    for group in ("states", "invariants", "residuals", "observed", "balance"):
        left, right = getattr(a, group), getattr(b, group)
        assert list(left) == list(right)
        for name, x in left.items():
            assert x.shape == right[name].shape
            assert x.tobytes() == right[name].tobytes(), name
    assert a.names == b.names
    assert a.params == b.params
    assert a.method == b.method


def few_steps(problem, system, **options):
    """Integrate over a few steps, or to a near time, from the problem's start."""
    t0 = problem.interval[0]
    if isinstance(system, lv.Schrodinger):
        method = lv.SplitOperator() if system.is_driven else lv.SchrodingerSplitting(tol=1e-6)
        more = {"steps": 5} if system.is_driven else {}
        return lv.integrate(system, method, t=(t0, t0 + 0.1), **more, **problem.start, **options)
    h = problem.h
    if isinstance(system, lv.PolynomialField):
        method = lv.VolumeSplitting("shears", "natural", "S2", "split")
    else:
        method = lv.Spark(2)
    t = (t0, t0 + 5 * h)
    return lv.integrate(system, method, t=t, h=h, **problem.start, **options)


@pytest.mark.parametrize("name", [name for name in problems.NAMES if name != "lattice3d"])
def test_a_system_of_the_library_arrives_the_same(name):
    problem = load(name)
    system, found = problem.system, travelled(problem.system)
    assert repr(found) == repr(system)
    assert str(found.params) == str(system.params)
    if not isinstance(system, lv.Schrodinger):
        assert found.coordinates == system.coordinates
        assert found.invariants == system.invariants
    assert found.constraints == system.constraints
    same(few_steps(problem, found), few_steps(problem, system))


@pytest.mark.parametrize("name", ["pendulum", "lorenz96", "tight_binding", "chaplygin_sleigh"])
def test_nothing_is_traced_where_a_system_arrives(name, monkeypatch):
    problem = load(name)
    sent = pickle.dumps(problem.system)
    wanted = few_steps(problem, problem.system)

    def refused(*_, **__):
        raise AssertionError("traced")

    for what in ("Function", "jacobian", "jtimes", "gradient"):
        monkeypatch.setattr(ca, what, refused)
    same(few_steps(problem, pickle.loads(sent)), wanted)


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("made", [False, True])
def test_forms_of_a_system_are_pickled_or_made_where_it_is_loaded(method, made):
    system = lv.Lagrangian(
        lambda t, q, v, params: ca.dot(v, v) / 2 - params.g * q[1],
        lambda t, q, params: {"rod": (ca.dot(q, q) - 1) / 2},
        q=("x", "y"),
        params={"g": 9.81},
        force=lambda t, q, v, params: ca.vertcat(ca.sin(t), 0),
        invariants={"height": lambda t, q, v, params: q[1]},
    )
    if made:
        lv.integrate(system, method, t=(0, 1), h=0.1, q=[1, 0], v=[0, 0])
    found = travelled(system)
    options = {
        "observe": {"speed": lambda t, q, v, params: ca.norm_2(v) + params.g},
        "params": {"g": 5.0},
        "events": {"bottom": lambda t, q, v, lam, params: q[0] + lam[0] / 100},
    }
    a, b = (
        lv.integrate(each, method, t=(0, 1), h=0.02, q=[1, 0], v=[0, 0], **options)
        for each in (system, found)
    )
    same(a, b)
    assert a.events["bottom"].t.tobytes() == b.events["bottom"].t.tobytes()
    assert a.reaction("rod").tobytes() == b.reaction("rod").tobytes()
    near = {"q": [1.1, 0.1], "v": [0.3, 1.0]}
    moved = zip(system.consistent(**near).values(), found.consistent(**near).values(), strict=True)
    assert all(x.tobytes() == y.tobytes() for x, y in moved)
    same(travelled(travelled(b)), a)


def test_steps_that_follow_a_monitor_arrive_the_same():
    problem = load("kepler_on_sphere")
    options = {"control": lv.Reversible(lambda t, q, v, params: 1 / (1 + ca.dot(v, v)))}
    found = travelled(problem.system)
    runs = [
        lv.integrate(x, lv.Spark(2), t=(0, 1), h=0.01, **problem.start, **options)
        for x in (problem.system, found)
    ]
    same(*runs)


def test_a_structure_is_pickled_with_its_matrices():
    n = 200
    stiffness = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    system = lv.Structure(
        np.ones(n), stiffness, 0.1 * stiffness, force=lambda t, q, v, params: {"q3": ca.sin(t)}
    )
    start = {"q": np.linspace(0, 1, n), "v": np.zeros(n)}
    found = travelled(system)
    for method in (lv.HHT(), lv.Spark(2)):
        runs = [lv.integrate(x, method, t=(0, 1), h=0.1, **start) for x in (system, found)]
        same(*runs)


def test_a_semi_explicit_system_arrives_the_same():
    system = lv.SemiExplicit(
        field=lambda t, y, z, params: [y[1], -y[0] * z[0], params.a * z[0] + y[0]],
        constraint=lambda t, y, params: {"plane": y[0] + y[2] - 1},
        y=("a", "b", "c"),
        z=("u",),
        params={"a": 2.0},
        invariants={"sum": lambda t, y, z, params: ca.sum1(y)},
    )
    found = travelled(system)
    assert (found.unknowns, found.constraints) == (system.unknowns, system.constraints)
    observe = {"twice": lambda t, y, z, params: 2 * z}
    near = {"y": [0.5, 0.1, 0.4]}
    assert found.consistent(**near)["y"].tobytes() == system.consistent(**near)["y"].tobytes()
    runs = [
        lv.integrate(x, lv.Spark(2), t=(0, 1), h=0.1, y=[0.5, 0.1, 0.5], observe=observe)
        for x in (system, found)
    ]
    same(*runs)


def test_fields_are_pickled_with_what_their_parameters_change():
    fields = {
        "traced": (sabra.build(6), {"eps": 0.25}),
        "driven": (
            lv.PolynomialField(
                lambda t, x, params: [ca.sin(params.w * t) * x[1] ** 2, -0.1 * x[0]],
                x=("x", "y"),
                params={"w": 1.5},
                invariants={"size": lambda t, x, params: params.w * ca.dot(x, x)},
            ),
            {"w": 2.0},
        ),
    }
    method = lv.VolumeSplitting("shears", "natural", "S2", "split")
    for field, params in fields.values():
        x = np.linspace(0.1, 0.5, len(field.coordinates))
        observe = {"first": lambda t, x, params: x[0] ** 2}
        runs = [
            lv.integrate(each, method, t=(0, 1), h=0.1, x=x, params=params, observe=observe)
            for each in (field, travelled(field), copy.deepcopy(field.with_params(params)))
        ]
        same(runs[0], runs[1])
        same(runs[0], runs[2])


def test_a_sympy_field_is_pickled():
    sympy = pytest.importorskip("sympy")
    x, y, a = sympy.symbols("x y a")
    field = lv.PolynomialField.from_sympy([a * y**2, -x / 3], [x, y], params={a: 0.5})
    found = travelled(field).with_params({"a": 0.75})
    assert np.array_equal(found.terms.coefficient, field.with_params({"a": 0.75}).terms.coefficient)


def equations():
    """Yield Schrödinger equations of all kinds."""
    rng = np.random.default_rng(1)
    grid = lv.Grid(
        (-5, -4), (5, 4), (16, 12), potential=lambda t, x, params: params.k * ca.dot(x, x) / 2
    )
    yield "static grid", lv.Schrodinger(grid, params={"k": 1.5}, hbar=0.7)
    moving = lv.Grid(-5, 5, 32, potential=lambda t, x, params: (x - ca.sin(params.w * t)) ** 2 / 2)
    yield "moving grid", lv.Schrodinger(moving, params={"w": 2.0})
    yield "lattice", lv.Schrodinger(lv.Lattice((5, 4), periodic=(True, False)))
    yield "spins", lv.Schrodinger(lv.SpinChain(8, field=np.linspace(0, 1, 8), up=4))
    a = rng.normal(size=(20, 20)) + 1j * rng.normal(size=(20, 20))
    yield "complex", lv.Schrodinger(a + a.conj().T, hbar=2.0)
    phases = np.exp(1j * np.arange(20))
    yield "gauged", lv.Schrodinger(np.diag(phases[1:], 1) + np.diag(phases[1:].conj(), -1))
    drive = [(lambda t, params: ca.cos(params.w * t), np.arange(20.0))]
    real = a.real + a.real.T
    yield "driven", lv.Schrodinger(real, drive=drive, params={"w": 3.0}, bounds=(-200.0, 200.0))


EQUATIONS = dict(equations())


@pytest.mark.parametrize("kind", EQUATIONS)
def test_a_schrodinger_equation_arrives_the_same(kind):
    system = EQUATIONS[kind]
    found = travelled(system)
    again = travelled(found)
    assert repr(again) == repr(system)
    assert found.bounds == system.bounds
    psi = np.ones(system.size) / np.sqrt(system.size)
    method = lv.Magnus(4) if kind == "driven" else lv.Chebyshev()
    method = lv.SplitOperator() if kind == "moving grid" else method
    how = {"steps": 20} if system.is_driven else {}
    params = {name: 1.1 * value for name, value in system.params.items()}
    for options in (how, {**how, "params": params}):
        runs = [
            lv.integrate(x, method, t=(0, 1), psi=psi, **options) for x in (system, found, again)
        ]
        same(runs[0], runs[1])
        same(runs[0], runs[2])


def test_a_plan_fits_the_equation_that_was_pickled():
    system = lv.Schrodinger(lv.SpinChain(8, up=4))
    plan = travelled(lv.plan(system, lv.SchrodingerSplitting(1e-8), t=(0, 1)))
    psi = np.eye(system.size)[0]
    same(
        lv.integrate(travelled(system), plan, t=(0, 1), psi=psi),
        lv.integrate(system, plan, t=(0, 1), psi=psi),
    )


def doubled(x):
    return 2 * x


def test_products_are_pickled_if_their_function_is():
    system = lv.Schrodinger((5, doubled))
    psi = np.ones(5) / np.sqrt(5)
    runs = [
        lv.integrate(x, lv.SchrodingerSplitting(1e-8), t=(0, 1), psi=psi)
        for x in (system, travelled(system))
    ]
    same(*runs)
    for product in ((5, lambda x: 2 * x), LinearOperator((5, 5), lambda x: 2 * x, dtype=float)):
        with pytest.raises(TypeError, match=r"cannot be pickled(.|\n)*at its top level"):
            pickle.dumps(lv.Schrodinger(product))


def test_methods_and_plans_are_pickled():
    some = [*METHODS.values(), lv.GeneralizedAlpha(0.8), lv.ArnoldBruls(0.7), lv.VolumeSplitting()]
    some += [lv.Chebyshev(), lv.Lanczos(), lv.Magnus(4), lv.SplitOperator()]
    for method in some:
        assert travelled(method) == method
    euler = load("euler_top")
    plan = lv.plan(euler.system, h=0.1, x=euler.start["x"])
    assert travelled(plan) == plan


def test_a_solution_arrives_read_only_and_with_its_system():
    pendulum = load("pendulum")
    solution = travelled(few_steps(pendulum, pendulum.system))
    assert solution(0.01).q.shape == (2,)
    with pytest.raises(ValueError, match="read-only"):
        solution.q[0] = 1.0


def test_a_copy_is_the_same_system():
    pendulum = load("pendulum")
    same(few_steps(pendulum, copy.copy(pendulum.system)), few_steps(pendulum, pendulum.system))
    assert copy.copy(pendulum.system).problem is pendulum.system.problem
    assert copy.deepcopy(pendulum.system).problem is not pendulum.system.problem


def anew(name):
    """Trace a problem again: its own system has the tapes too that other tests have asked for."""
    given, system = load(name), load(name).system
    names, params = system.coordinates, system.params
    return lv.Lagrangian(given.lagrangian, given.constraint, q=names, params=params)


@pytest.mark.parametrize(
    ("system", "most"),
    [
        (lambda: anew("pendulum"), 5e3),
        (lambda: anew("andrews"), 60e3),
        (lambda: chain.build(100), 120e3),
        (lambda: load("lattice3d").system, 4e3),
    ],
    ids=["pendulum", "andrews", "chain of 100", "lattice of 3 dimensions"],
)
def test_pickles_are_small(system, most):
    assert len(pickle.dumps(system())) < most


def test_a_broken_tape_is_refused():
    t = ca.SX.sym("t")
    whole = tape.record("x", {"t": t, "params": ca.SX(0, 1)}, ca.sin(t) + 0.5)
    unpacked, (inputs, outputs, program, *_) = whole.__reduce__()
    assert unpacked(inputs, outputs, program).map(np.empty(0), [np.zeros((1, 1))])[0, 0] == 0.5
    for k in range(len(program)):
        with pytest.raises(ValueError, match=r"tape|output|slot"):
            unpacked(inputs, outputs, program[:k])
        for byte in (0, 0x7F, 0xFF):
            with suppress(ValueError):  # a constant may be any; what is no program is refused
                unpacked(inputs, outputs, program[:k] + bytes([byte]) + program[k + 1 :])
