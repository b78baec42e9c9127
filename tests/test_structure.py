"""A structure is the Lagrangian system of its matrices; what does not fit is refused."""

import sys

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg

import liouville as lv
from liouville._bridges import fem
from liouville._systems.mechanics import form as _form
from liouville._systems.tape import record
from liouville._systems.tracing.linear import Matrix

N = 6


def matrices(seed=1):
    """Return a full mass, a sparse stiffness and a damping, all symmetric."""
    rng = np.random.default_rng(seed)
    factor, spring = rng.normal(size=(2, N, N))
    stiffness = spring @ spring.T
    stiffness[np.abs(stiffness) < 1.0] = 0.0
    return factor @ factor.T + N * np.eye(N), stiffness, 0.05 * stiffness + 0.1 * np.eye(N)


MASS, STIFFNESS, DAMPING = matrices()


def joints(t, q, params):
    return {"moved": q[0] + q[2] ** 2 / 9 - params.a * ca.sin(t), "bent": q[4] - q[5] ** 2}


def spring(t, q, v, params):
    """Stiffen one coordinate, couple two dampers, and push."""
    return {"q1": -(q[1] ** 3) + ca.cos(t), "q3": -v[3] * v[2] ** 2}


def full(function):
    """Return the n values of a force that names some."""

    def force(t, q, v, params):
        found = function(t, q, v, params)
        return [found.get(f"q{k}", 0.0) for k in range(N)]

    return force


def structure(mass=MASS, stiffness=STIFFNESS, damping=DAMPING, **changes):
    call = {"force": spring, "constraint": joints, "params": {"a": 0.1}, **changes}
    return lv.Structure(mass, stiffness, damping, **call)


def lagrangian(stiffness=STIFFNESS, damping=DAMPING, constraint=joints):
    """Write the same system as a Lagrangian."""
    mass, own = ca.DM(MASS), full(spring)

    def energies(t, q, v, params):
        bent = ca.dot(q, ca.mtimes(ca.DM((stiffness + stiffness.T) / 2), q))
        return (ca.dot(v, ca.mtimes(mass, v)) - bent) / 2

    def force(t, q, v, params):
        return ca.vertcat(*own(t, q, v, params)) - ca.mtimes(ca.DM(damping), v)

    return lv.Lagrangian(energies, constraint, q=N, force=force, params={"a": 0.1})


def parts(system):
    """Return all tapes and patterns of a system but that of power, which knows the damping."""
    tapes, patterns, _ = _form.second_order(
        system.symbols, system.model, system.expressions.columns["power"]
    )
    tapes.pop("power", None)
    observer, _ = system.observer(None, True)
    return {**system.tapes, **tapes, "observer": observer}, {**system.patterns, **patterns}


@pytest.mark.parametrize("kind", [np.asarray, sp.csr_array, sp.csc_matrix, sp.coo_array])
def test_every_tape_is_the_lagrangians(kind):
    tapes, patterns = parts(structure(kind(MASS), kind(STIFFNESS), kind(DAMPING)))
    other_tapes, other_patterns = parts(lagrangian())
    assert patterns.keys() == other_patterns.keys()
    for name, pattern in patterns.items():
        for found, wanted in zip(pattern, other_patterns[name], strict=True):
            np.testing.assert_array_equal(found, wanted, err_msg=name)
    rng = np.random.default_rng(2)
    assert tapes.keys() == other_tapes.keys()
    for name, tape in tapes.items():
        args = [rng.normal(size=(9, size)) for size in tape.inputs[:-1]]
        found, wanted = (x.map(np.array([0.1]), args) for x in (tape, other_tapes[name]))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13, err_msg=name)


def test_a_run_is_the_lagrangians():
    near = {"q": np.full(N, 0.2), "v": np.zeros(N)}
    start, other = (system.consistent(**near) for system in (structure(), lagrangian()))
    np.testing.assert_allclose(start["q"], other["q"], rtol=0, atol=1e-13)
    np.testing.assert_allclose(start["v"], other["v"], rtol=0, atol=1e-13)
    runs = [
        lv.integrate(system, lv.Spark(3), t=(0.0, 2.0), h=0.02, **start)
        for system in (structure(), lagrangian())
    ]
    for what in ("q", "v", "p", "lam"):
        found, wanted = (getattr(run, what) for run in runs)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12, err_msg=what)
    np.testing.assert_allclose(*(run.invariants["energy"] for run in runs), rtol=0, atol=1e-12)


def test_energy_takes_the_symmetric_part_and_no_loads():
    skew = np.triu(np.ones((N, N)), 1)
    plain = structure(force=np.arange(N), constraint=None)
    bent = structure(stiffness=STIFFNESS + skew - skew.T, constraint=None, force=None)
    rng = np.random.default_rng(3)
    q, v = rng.normal(size=(2, 4, N))
    wanted = (np.sum(v * (v @ MASS), 1) + np.sum(q * (q @ STIFFNESS), 1)) / 2
    for system in (plain, bent):
        tape, widths = system.observer(None, False)
        first = sum(list(widths.values())[: list(widths).index("invariant energy")])
        values = tape.map(np.array([0.1]), [np.zeros((4, 1)), q, v])
        np.testing.assert_allclose(values[:, first], wanted, rtol=1e-13)


def test_the_skew_part_of_a_stiffness_is_a_force_whose_work_counts():
    turning = np.array([[0.0, 0.8, 0.0], [-0.8, 0.0, 0.0], [0.0, 0.0, 0.0]])
    mass = np.diag([2.0, 1.0, 3.0])
    stiffness = np.array([[5.0, -2, 0], [-2, 6, -3], [0, -3, 4]])
    own = lv.Structure(mass, stiffness + turning)
    forced = lv.Structure(
        mass, stiffness, force=lambda t, q, v, p: {"q0": -0.8 * q[1], "q1": 0.8 * q[0]}
    )
    assert not own.is_conservative
    call = {"t": (0, 20), "q": [1, 0, -0.5], "v": [0.2, 0.3, 0]}
    damped = [lv.integrate(x, lv.HHT(), rtol=1e-5, **call) for x in (own, forced)]
    assert [run.message for run in damped] == ["", ""]
    works = [run.work[-1] for run in damped]
    assert works[0] == pytest.approx(works[1], rel=1e-6)
    assert works[0] > 0.3
    balance = lv.analysis.power_balance(lv.integrate(own, lv.Spark(3), h=0.02, **call))
    assert np.max(balance.defect) < 1e-11
    flutter = lv.Structure(np.eye(2), [[1, 0.5], [-0.5, 1]], 0.01 * np.eye(2))
    run = lv.integrate(flutter, lv.Spark(3), t=(0, 30), h=0.1, q=[1, 0], v=[0, 0])
    assert np.ptp(run.invariants["energy"]) > 1
    assert run.message == ""


def test_a_mass_matrix_is_symmetric_to_roundoff():
    off = np.triu(MASS, 1) * 1e-15
    assert structure(mass=MASS + off).is_conservative is False
    with pytest.raises(ValueError, match=r"not symmetric: mass\[0, 1\] is 1 and mass\[1, 0\] is 0"):
        lv.Structure(np.array([[2.0, 1.0], [0.0, 2.0]]), np.eye(2))


def test_a_diagonal_is_an_array_and_a_load_may_be_constant():
    system = lv.Structure([2.0, 4.0], force=[2.0, -4.0], invariants={"x": lambda t, q, v, p: q[0]})
    assert repr(system) == "Structure(q0, q1; 0 constraints)"
    run = lv.integrate(system, lv.Spark(2), t=(0.0, 1.0), steps=4, q=[0, 0], v=[0, 0])
    np.testing.assert_allclose(run.q[-1], [0.5, -0.5], rtol=1e-14)
    np.testing.assert_allclose(run.invariants["x"], run.q[:, 0], rtol=0, atol=0)


def test_a_long_list_of_names_is_shortened():
    assert repr(lv.Structure(np.ones(100))) == "Structure(q0, q1, q2, ..., q99; 0 constraints)"


def test_power_is_that_of_forces_and_of_moving_constraints():
    system = structure()
    tapes, _, power_of_lam = _form.second_order(
        system.symbols, system.model, system.expressions.columns["power"]
    )
    t, (q, v), lam = 0.3, np.random.default_rng(4).normal(size=(2, N)), np.array([2.0, 3.0])
    args = [np.array([[t]]), q[None], v[None], lam[None]]
    found = tapes["power"].map(np.array([0.1]), args)[0, 0]
    forces = v[1] * (-(q[1] ** 3) + np.cos(t)) + v[3] * -v[3] * v[2] ** 2
    assert power_of_lam
    assert found == pytest.approx(forces - 2.0 * 0.1 * np.cos(t), rel=1e-14)
    still = structure(force=None, constraint=None)
    assert (
        "power"
        not in _form.second_order(still.symbols, still.model, still.expressions.columns["power"])[0]
    )


def test_terms_of_a_tape_are_matrix_products():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 3, 3))
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 1)
    tape = record("tape", {"x": x, "params": p}, ca.vertcat(p**2, 1, ca.sin(x)))
    constant = np.array([0.0, 2.0, 0.0, 3.0, 0.0])
    terms = tape.with_terms(
        constant,
        [(0, 0, -2.0, Matrix.read("a", a).rows)],
        [(1, 0, 0.5, Matrix.read("b", b).rows)],
    )
    points = rng.normal(size=(20, 3))
    wanted = np.hstack([np.full((20, 1), 9.0), np.ones((20, 1)), np.sin(points)]) + constant
    wanted[:, :3] -= 2 * points @ a.T
    wanted[:, 1] += np.sum(points * (points @ b.T), 1) / 2
    np.testing.assert_allclose(terms.map(np.array([3.0]), [points]), wanted, atol=1e-14)
    with pytest.raises(ValueError, match="there are 1 constants for 5 outputs"):
        tape.with_terms(np.ones(1), [], [])
    with pytest.raises(ValueError, match="term 0: 3 values from output 3 on do not fit 5 outputs"):
        tape.with_terms(np.empty(0), [(3, 0, 1.0, Matrix.read("a", a).rows)], [])


def test_entries_at_one_place_are_summed_and_zeros_dropped():
    row, col = [0, 1, 1, 0, 1], [0, 1, 0, 0, 0]
    matrix = Matrix.read("mass", sp.coo_array(([1.0, 2.0, 1.0, 3.0, -1.0], (row, col))))
    assert matrix.values.tolist() == [4.0, 2.0]
    assert matrix.row.tolist() == matrix.col.tolist() == [0, 1]


MASSLESS = MASS.copy()
MASSLESS[4] = MASSLESS[:, 4] = 0.0

BAD = {
    "rectangle": ({"mass": MASS[:5]}, ValueError, r"mass must have shape \(N, N\), not \(5, 6\)"),
    "tensor": (
        {"mass": MASS[None]},
        ValueError,
        r"mass must have shape \(n, n\).*, not \(1, 6, 6\)",
    ),
    "words": ({"mass": [["heavy"]]}, TypeError, "mass must be a matrix of real numbers"),
    "complex": ({"damping": 1j * DAMPING}, TypeError, "damping must be a matrix of real numbers"),
    "orders": ({"stiffness": np.eye(5)}, ValueError, "stiffness must have order 6"),
    "nan": (
        {"stiffness": np.diag([1, 2, np.nan, 4, 5, 6])},
        ValueError,
        r"s\[2, 2\] must be finite",
    ),
    "massless": ({"mass": MASSLESS}, ValueError, "coordinate 'q4' has no mass(.|\n)*hint: conden"),
    "names": ({"q": ("x", "y")}, ValueError, "q must name 6 coordinates"),
    "twice": ({"q": tuple("abcdea")}, ValueError, "q names 'a' twice"),
    "load": ({"force": [1.0]}, ValueError, r"force must have shape \(6,\), not \(1,\)"),
    "load nan": ({"force": [np.inf] * N}, ValueError, "force of 'q0' must be finite"),
    "word": ({"force": "gravity"}, TypeError, "force must be a function or an array of numbers"),
    "nobody": (
        {"force": lambda t, q, v, params: {"q9": 1.0}},
        ValueError,
        "force has a value for 'q9', which is no coordinate",
    ),
    "pair": (
        {"force": lambda t, q, v, params: {"q1": q}},
        ValueError,
        "force 'q1' must return a scalar, not 6 values",
    ),
    "short": (
        {"force": lambda t, q, v, params: q[:2]},
        ValueError,
        "force must return 6 values, not 2",
    ),
    "fixed": (
        {"constraint": lambda t, q, params: {"wall": ca.sin(t)}},
        ValueError,
        "constraint 'wall' is the same for all coordinates",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_structure_that_does_not_fit_is_refused(name):
    changes, error, message = BAD[name]
    with pytest.raises(error, match=message):
        structure(**changes)


skfem = pytest.importorskip("skfem")


def beam(cells=8, element=skfem.ElementQuad2, **changes):
    """Assemble a cantilever of length 2 and height 0.1, clamped on its left."""
    x, y = np.linspace(0, 2, cells + 1), np.linspace(0, 0.1, 2)
    sides = {"left": lambda x: x[0] == 0, "right": lambda x: x[0] == 2}
    mesh = skfem.MeshQuad.init_tensor(x, y).with_boundaries(sides)
    basis = skfem.Basis(mesh, skfem.ElementVector(element()))
    call = {"young": 1e4, "poisson": 0.0, "density": 2.0, "clamped": basis.get_dofs("left")}
    return fem.Body.elastic(basis, **{**call, **changes})


def test_a_clamped_body_bends_as_a_beam():
    body = beam()
    basis = body.basis
    tip = basis.get_dofs("right").all("u^2")
    at = body.at(tip)
    assert [body.names[k].split()[:2] for k in at[:2]] == [["u^2", "vertex"]] * 2
    assert at.size == 3
    assert body.names[at[2]].startswith("u^2 facet")
    load = np.zeros(basis.N)
    load[tip] = 1e-3 / 3
    system = body.structure(force=body.load(load))
    assert system.coordinates == body.names
    q = scipy.sparse.linalg.spsolve(sp.csc_array(body._matrices["stiffness"]), body.load(load))
    bending = 1e-3 * 2**3 / (3 * 1e4 * 0.1**3 / 12)
    assert q[at].mean() == pytest.approx(bending, rel=0.02)
    every = body.values(q)
    np.testing.assert_array_equal(every[basis.get_dofs("left").flatten()], 0.0)
    np.testing.assert_array_equal(every[tip], q[at])
    assert body.values(np.zeros((5, q.size))).shape == (5, basis.N)


def test_a_free_body_keeps_its_momentum_and_has_its_mass():
    body = beam(4, clamped=None)
    total = body._matrices["mass"].sum()
    assert total == pytest.approx(2 * 2.0 * 2 * 0.1)  # both directions
    start = {"q": np.zeros(body.basis.N), "v": np.linspace(0, 1e-2, body.basis.N)}
    run = lv.integrate(body.structure(), lv.Spark(2), t=(0.0, 0.2), steps=20, **start)
    for direction in ("u^1", "u^2"):
        along = [k for k, name in enumerate(body.names) if name.startswith(direction)]
        np.testing.assert_allclose(run.p[:, along].sum(1), run.p[0, along].sum(), rtol=1e-10)


def test_damping_is_rayleighs():
    body = beam(2, rayleigh=(0.5, 2e-3))
    wanted = 0.5 * body._matrices["mass"] + 2e-3 * body._matrices["stiffness"]
    assert abs(body._matrices["damping"] - wanted).max() < 1e-14


def test_all_kinds_of_degrees_of_freedom_have_names():
    mesh = skfem.MeshHex().refined(1)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()))
    body = fem.Body(basis, sp.eye_array(basis.N), sp.eye_array(basis.N))
    assert len(set(body.names)) == basis.N
    kinds = {name.split()[1] for name in body.names}
    assert kinds == {"vertex", "edge", "facet", "element"}
    assert "u^3 edge 53" in body.names


def test_a_body_that_does_not_fit_is_refused(monkeypatch):
    body = beam(2)
    basis, eye = body.basis, sp.eye_array(5)
    with pytest.raises(ValueError, match=r"'u\^1 vertex 0' is clamped and no coordinate"):
        body.at(basis.get_dofs("left"))
    with pytest.raises(
        ValueError, match=r"mass must have shape \(\d+, \d+\) as the basis has, not \(5, 5\)\nhint"
    ):
        fem.Body(basis, eye, eye)
    with pytest.raises(TypeError, match="mass must be a sparse matrix of SciPy's"):
        fem.Body(basis, np.eye(basis.N), eye)
    for wrong in ([-1], [basis.N], [0.5]):
        with pytest.raises(ValueError, match="degrees of freedom must be integers from 0 to"):
            body.at(wrong)
    with pytest.raises(ValueError, match="q must have shape"):
        body.values(np.zeros(3))
    with pytest.raises(ValueError, match="load must have shape"):
        body.load(np.zeros(3))
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(ImportError) as raised:
        fem.Body.elastic(basis, young=1.0, poisson=0.0, density=1.0)
    assert raised.value.__notes__ == ["hint: pip install liouville[fem]"]


@pytest.mark.parametrize("sparse", [False, True])
def test_a_stiffness_of_zeros_leaves_the_masses_free(sparse):
    zeros = sp.csc_array((2, 2)) if sparse else np.zeros((2, 2))
    system = lv.Structure([1.0, 2.0], zeros, np.zeros((2, 2)))
    run = lv.integrate(system, lv.Spark(2), t=(0, 2), h=0.5, q=[0.0, 1.0], v=[1.0, -1.0])
    np.testing.assert_allclose(run.q[-1], [2.0, -1.0], rtol=1e-14)
