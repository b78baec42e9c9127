"""Volume-preserving splitting: printed steps and end states, determinants, and round trips."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from fields import random_exact

import liouville as lv
from liouville import _core
from liouville._basics.job import Job
from liouville._methods.splitting import split, to_core
from liouville.problems import load

DATA = Path(__file__).parent / "data"
REFERENCE = json.loads((DATA / "volume_reference.json").read_text())
FIELDS = {each["name"]: each for each in REFERENCE["fields"]}
TOLERANCES = REFERENCE["tolerances"]

PARTS = (
    ("exponentials", "natural"),
    ("exponentials", "triangular"),
    ("pairs", "natural"),
    ("regular", "natural"),
    ("regular", "triangular"),
    ("shears", "natural"),
    ("shears", "triangular"),
    ("n+d", "natural"),
)
COMPOSITIONS = tuple(_core.compositions())
PROBLEMS = (
    "bajer_moffatt",
    "hill_vortex",
    "euler_top",
    "volterra_lattice",
    "toda_lattice",
    "lorenz96",
    "euler2d",
    "sabra",
    "maxwell_bloch",
    "cubic_charge",
    "abc_flow",
)


def printed(name):
    """Return a printed field and its start."""
    each = FIELDS[name]
    field = lv.PolynomialField.from_terms(each["n"], each["terms"])
    return field, [float(Fraction(x)) for x in each["x0"]]


def dense(n, d, seed):
    """Return a random dense field of degrees 0 to d."""
    terms = random_exact(n, d, seed)
    factors = ([int(v) for v in row if v >= 0] for row in terms.variables)
    rows = zip(terms.component.tolist(), terms.coefficient.tolist(), factors, strict=True)
    return lv.PolynomialField.from_terms(n, list(rows))


def takes(field, diagonal, off_diagonal):
    """Say whether a field can be split so."""
    terms = field.terms
    if diagonal == "regular" and (terms.degree > 2 or terms.n < 3 or terms.functions):
        return False
    return not (terms.functions and (diagonal in ("n+d", "shears")))


@pytest.mark.parametrize(
    "case",
    REFERENCE["canonical_steps"],
    ids=lambda c: f"{c['field']}-{c['method']}-{c['composition']}",
)
def test_canonical_steps_have_their_printed_digits(case):
    field, x0 = printed(case["field"])
    n, d = field.terms.n, field.terms.degree
    diagonal = {"shear+nat": "shears", "exp+nat": "exponentials"}[case["method"]]
    directions = [[Fraction(i + 1) ** k for k in range(d)] for i in range(n)]
    parts = split(
        field.terms, diagonal, "natural", merged=False,
        directions=directions if diagonal == "shears" else None,
    )  # fmt: skip
    assert len(parts.pieces) == case["pieces"]
    scheme = {"Phi": "Lie"}.get(case["composition"], case["composition"])
    h, steps = float(Fraction(case["h"])), case["steps"]
    tape = _core.Tape([1, n, 0], 0, np.empty((0, 4), dtype=np.int64), np.empty(0))
    job = Job(
        start=(np.array([x0]),), span=(0.0, h * steps, steps, steps), observer=tape, seen=(n, None)
    )
    run = _core.run(to_core(parts), lv.VolumeSplitting(composition=scheme), job)
    assert run.advance(1e3) == "done"
    end = run.take()[1][-1]
    wanted = np.array([float(x) for x in case["x"]])
    # badly scaled directions on purpose: roundoff grows with the size of the pieces
    assert np.abs(end - wanted).max() <= 2e-12 * max(1.0, np.abs(wanted).max())


@pytest.mark.parametrize("name", [name for name, each in FIELDS.items() if each["divergence_free"]])
def test_end_states_are_the_printed_ones(name):
    field, x0 = printed(name)
    t = float(Fraction(FIELDS[name]["T"]))
    wanted = np.array([float(x) for x in FIELDS[name]["x_T"]])
    method = lv.VolumeSplitting(composition="SS10s35", compensated=True)
    found = lv.integrate(field, method, t=(0.0, t), steps=200, every=200, x=x0).x[-1]
    assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize(
    "name", [name for name, each in FIELDS.items() if not each["divergence_free"]]
)
def test_fields_with_a_divergence_are_refused(name):
    monomials = "|".join(f"x{v[0]}" for _, v in FIELDS[name]["divergence"])
    with pytest.raises(ValueError, match=rf"not divergence-free: div f contains .*({monomials})"):
        printed(name)


def defect(field, method, x, h):
    """Return the largest |det - 1| over some steps."""
    found = lv.analysis.determinant(field, method, t=(0.0, 3 * h), steps=3, x=x)
    assert abs(found.observed["log_determinant"][-1]) <= 3 * 2e-12
    return found.observed["defect"][-1]


@pytest.mark.parametrize(("diagonal", "off_diagonal"), PARTS)
@pytest.mark.parametrize(
    ("n", "d"),
    [
        *((3, 1), (4, 2), (6, 2), (3, 3), (10, 2), (3, 4)),
        pytest.param(5, 3, marks=pytest.mark.slow),
    ],
)
def test_every_method_and_composition_keeps_volume(n, d, diagonal, off_diagonal):
    field = dense(n, d, seed=10 * n + d)
    if not takes(field, diagonal, off_diagonal):
        pytest.skip("has no such splitting")
    x = np.random.default_rng(n).uniform(-0.5, 0.5, n)
    # pieces keep volume, so one composition tells as much of a field as all do
    for composition in COMPOSITIONS if (n, d) in ((4, 2), (5, 3)) else ("BM4",):
        for runge_kutta in ("euler", "rk4") if off_diagonal == "triangular" else ("euler",):
            method = lv.VolumeSplitting(
                diagonal, off_diagonal, composition, "split", runge_kutta=runge_kutta
            )
            assert defect(field, method, x, 0.01) <= TOLERANCES["det_minus_1"], composition


def problems_split():
    """Return what is split how; the dense directions of 24 variables are slow."""
    for name in PROBLEMS:
        for parts in PARTS:
            is_slow = (name, parts[0]) == ("euler2d", "n+d")
            yield pytest.param(name, *parts, marks=[pytest.mark.slow] if is_slow else [])


@pytest.mark.parametrize(("name", "diagonal", "off_diagonal"), [*problems_split()])
def test_every_problem_keeps_volume(name, diagonal, off_diagonal):
    problem = load(name)
    if not takes(problem.system, diagonal, off_diagonal):
        pytest.skip("has no such splitting")
    method = lv.VolumeSplitting(diagonal, off_diagonal, "BM4", "split")
    x = problem.start["x"]
    # directions that are dense are no choice for a sparse field: their steps have to be short
    assert defect(problem.system, method, x, problem.h / 10) <= TOLERANCES["det_minus_1"]


@pytest.mark.parametrize("compensated", [False, True])
def test_determinants_leave_the_run_as_it_is(compensated):
    problem = load("bajer_moffatt")
    method = lv.VolumeSplitting(composition="BM4", compensated=compensated)
    for every in (1, 7):
        call = {"t": (0, 1), "h": 0.02, "every": every, **problem.start}
        measured = lv.analysis.determinant(problem.system, method, **call)
        assert np.array_equal(measured.x, lv.integrate(problem.system, method, **call).x)
        assert (measured.observed["defect"][1:] > 0).all()


def test_a_spoiled_piece_is_found_out():
    # x0 += h x0^2 is no shear
    pieces = to_core(split(dense(3, 2, seed=1).terms, "shears", "natural"))
    one, square = np.array([0]), np.array([[0, 0]])
    shear = ("shear", one, np.ones(1), one, np.ones(1), square, [])
    spoiled = _core.Split(3, [shear])
    found = []
    for each in (pieces, spoiled):
        job = Job(
            start=(np.array([[0.5, 0.2, 0.1]]),), span=(0.0, 0.1, 1, 1), observer="determinants",
            seen=(3, None),
        )  # fmt: skip
        run = _core.run(each, lv.VolumeSplitting(composition="Lie"), job)
        assert run.advance(1e3) == "done"
        found.append(run.take()[1][-1, 3:])
    assert np.abs(found[0]).max() <= 1e-14
    assert found[1] == pytest.approx([np.log(1.1), 0.1], rel=1e-14)


def test_an_unknown_determinant_is_named():
    top = load("euler_top").system
    with pytest.raises(lv.IntegrationError, match="Jacobian of the step is singular to roundoff"):
        lv.analysis.determinant(
            top, lv.VolumeSplitting(composition="S2"), t=(0, 1), steps=1, x=[1e9, 1e9, 1e9]
        )


@pytest.mark.parametrize(("diagonal", "off_diagonal"), PARTS)
def test_a_step_back_undoes_a_step(diagonal, off_diagonal):
    field = dense(4, 2, seed=4)
    x = np.random.default_rng(1).uniform(-0.5, 0.5, 4)
    for composition in COMPOSITIONS[1:]:
        method = lv.VolumeSplitting(diagonal, off_diagonal, composition, "split", "heun")
        there = lv.integrate(field, method, t=(0.0, 0.08), steps=4, x=x).x[-1]
        back = lv.integrate(field, method, t=(0.08, 0.0), steps=4, x=there).x[-1]
        assert np.abs(back - x).max() <= TOLERANCES["adjoint_roundtrip"], composition


def test_an_ensemble_is_its_members_bit_for_bit():
    problem = load("bajer_moffatt")
    rng = np.random.default_rng(2)
    x = rng.uniform(-0.5, 0.5, (70, 3))
    for diagonal in ("exponentials", "shears", "n+d"):
        method = lv.VolumeSplitting(diagonal, "natural", "BM4", "split")
        runs = [
            lv.ensemble(problem.system, method, t=(0, 1), h=0.02, every=7, x=x, threads=threads)
            for threads in (1, 2, 3)
        ]
        assert runs[0].x.shape == (9, 70, 3)
        for other in runs[1:]:
            assert np.array_equal(runs[0].x, other.x)
            assert np.array_equal(runs[0].invariants["sphere"], other.invariants["sphere"])
        for k in (0, 31, 32, 69):
            single = lv.integrate(problem.system, method, t=(0, 1), h=0.02, every=7, x=x[k])
            assert np.array_equal(single.x, runs[0].x[:, k])


def test_a_huge_state_does_not_depend_on_threads():
    lorenz = load("lorenz96")
    field = lorenz.build(66_000)  # work for several threads begins at 65 536
    x = np.random.default_rng(3).normal(size=66_000)
    plan = lv.plan(field, lv.VolumeSplitting(composition="S2"), h=0.01, x=x)
    ends = [
        lv.integrate(field, plan, t=(0, 0.02), h=0.01, every=2, x=x, threads=threads).x[-1]
        for threads in (1, 3)
    ]
    assert np.array_equal(*ends)
