"""What is asked of every row of the registry beside its order and the constraints of mechanics."""

import pickle
from contextlib import suppress
from dataclasses import fields, replace

import numpy as np
import pytest
from families import TOLERANT
from registry import ALL, GENERAL, INDEX2, ROWS

import liouville as lv
from liouville import _methods as methods

CASES = [(row, name) for row in ROWS for name in row.on]
FIELDS = [case for case in CASES if ALL[case[1]].of == ("x",)]
WAVES = [case for case in CASES if ALL[case[1]].of == ("psi",)]

MECHANICS = [(row, row.on[0]) for row in GENERAL]

#: One problem of each row, for what does not depend on it.
ONCE = [(row, row.on[0]) for row in ROWS]

MEMBERS, STEPS, FIELD_STEPS = 5, 40, 400


def test_every_public_method_has_a_row():
    public = {
        each
        for each in vars(methods).values()
        if isinstance(each, type) and hasattr(each, "form") and each.__module__ != __name__
    }
    assert public == {type(row.method) for row in ROWS}
    assert set(methods.METHODS.values()) <= public


def test_rows_have_every_kind_of_each_method():
    rows = [row.method for row in ROWS]
    assert {m.points for m in rows if isinstance(m, lv.Spark)} == {"gauss", "radau"}
    assert {m.force for m in rows if isinstance(m, lv.LobattoPair)} == {"A", "B", "C", "C*", "D"}
    assert {m.mode for m in rows if isinstance(m, lv.SchrodingerSplitting)} == {"fast", "stable"}
    schemes = {m.composition for m in rows if isinstance(m, lv.VolumeSplitting)}
    assert schemes == set(methods.composition.SCHEMES)
    bases = {(type(m.base), row in INDEX2) for row in ROWS
             if isinstance(m := row.method, lv.Composition)}  # fmt: skip
    assert bases == {(lv.Spark, False), (lv.Spark, True), (lv.LobattoPair, False)}
    assert len(GENERAL) + len(INDEX2) > 30


# --- structure of fields and wave functions ------------------------------------------------------


@pytest.mark.parametrize(("row", "name"), FIELDS, ids=str)
def test_volume_is_kept(row, name):
    problem, h = ALL[name], 0.01
    found = lv.analysis.determinant(
        problem.system, row.method, t=(0.0, 3 * h), steps=3, **problem.start
    )
    assert "volume" in row.keeps
    assert 0 < found.observed["defect"][-1] < 1e-12


@pytest.mark.parametrize(("row", "name"), WAVES, ids=str)
def test_a_step_is_a_symplectic_matrix_where_that_is_claimed(row, name):
    problem = ALL[name]
    n, t0 = problem.system.size, problem.t[0]
    unit = np.eye(n)
    starts = {"psi": np.concatenate([unit, 1j * unit])}
    ends = ensemble(problem, row.method, 1, (t0, t0 + 0.4), starts).psi[-1]
    step = np.concatenate([ends.real, ends.imag], axis=1).T
    form = np.block([[np.zeros((n, n)), unit], [-unit, np.zeros((n, n))]])
    defect = np.abs(step.T @ form @ step - form).max()
    assert defect < 1e-12 if "symplectic form" in row.keeps else defect > 1e-11
    if "norm" in row.keeps:
        assert np.abs(step.T @ step - np.eye(2 * n)).max() < 1e-12


@pytest.mark.parametrize(
    ("row", "name"), [case for case in WAVES if "tolerance" in case[0].keeps], ids=str
)
def test_errors_are_below_the_tolerance_and_follow_it(row, name):
    problem = ALL[name]
    psi = problem.exact(problem.t[1])["psi"]
    errors = []
    for tol in (1e-3, 1e-6, 1e-9, 1e-12):
        found = problem.run(replace(row.method, tol=tol), 1)
        errors.append(np.linalg.norm(found.psi[-1] - psi))
        assert errors[-1] < tol
    assert errors[0] > 1e3 * errors[2]


# --- one run in other ways -----------------------------------------------------------------------


def ensemble(problem, method, steps, t, starts):
    """Integrate members as `problem.run` does one."""
    count = {} if isinstance(method, TOLERANT) else {"steps": steps}
    return lv.ensemble(problem.system, method, t=t, threads=2, **count, **starts)


def settled(problem, method):
    """Return the plan of a field, which members and single runs then share, or the method."""
    if not isinstance(method, lv.VolumeSplitting):
        return method
    h = (problem.t[1] - problem.t[0]) / FIELD_STEPS
    return lv.plan(problem.system, method, h=h, **problem.start)


def copied(system):
    """Return a system that has made no runs."""
    return pickle.loads(pickle.dumps(system))


def steps_of(problem):
    """Return the number of steps of a run that stays bounded."""
    return FIELD_STEPS if problem.of == ("x",) else STEPS


def nearby(problem):
    """Return members at other states, on the constraints: those that a motion goes through."""
    if problem.of in (("x",), ("psi",)):
        ((name, start),) = problem.start.items()
        turned = np.exp(0.3j * np.arange(MEMBERS)) if name == "psi" else np.ones(MEMBERS)
        scale = turned * (1 - np.arange(MEMBERS) / 16 * (name == "x"))
        return {name: scale[:, None] * np.asarray(start)}
    near = [problem.system.consistent(t=problem.t[0], **moved) for moved in moves(problem)]
    return {name: np.array([start[name] for start in near]) for name in near[0]}


def moves(problem):
    """Return starts slightly off."""
    rng = np.random.default_rng(7)
    for _ in range(MEMBERS):
        yield {
            name: np.asarray(start) + 0.02 * rng.normal(size=len(start))
            for name, start in problem.start.items()
        }


@pytest.mark.parametrize(("row", "name"), ONCE, ids=str)
def test_an_ensemble_is_its_members_bit_for_bit(row, name):
    problem = ALL[name]
    starts, method, steps = nearby(problem), settled(problem, row.method), steps_of(problem)
    together = ensemble(problem, method, steps, problem.t, starts)
    for member in (0, MEMBERS - 1):
        alone = problem.run(method, steps, start={k: x[member] for k, x in starts.items()})
        for state, values in alone.states.items():
            np.testing.assert_array_equal(together.states[state][:, member], values, state)


@pytest.mark.parametrize(("row", "name"), MECHANICS, ids=str)
def test_a_run_after_others_has_the_bits_of_the_first(row, name):
    problem = replace(ALL[name], system=copied(ALL[name].system))
    method, t = row.method, problem.t
    first = problem.run(method, STEPS)
    problem.run(method, 2 * STEPS, states=False)
    problem.run(method, STEPS, t_eval=[(t[0] + t[1]) / 2])
    with suppress(lv.IntegrationError):  # it may be too long
        problem.run(method, 1, t=(t[0], t[0] + 100 * (t[1] - t[0])))
    if isinstance(method, lv.Spark) and not problem.system.nonholonomic:
        lv.integrate(problem.system, method, t=t, rtol=1e-3, **problem.start)
    again = problem.run(method, STEPS)
    assert {**again.stats, "seconds": 0} == {**first.stats, "seconds": 0}
    for state, values in first.states.items():
        np.testing.assert_array_equal(again.states[state], values, state)


class CutError(BaseException):
    """Ends a run as nothing does that asks."""


def cut(done, total):
    """End a run at its first checkpoint."""
    raise CutError


def stored(problem, method, path, **more):
    """Store a run: the one place where that is spelled."""
    steps = steps_of(problem)
    return problem.run(method, steps, store=lv.Store(path, checkpoint=steps // 4), **more)


#: What methods of one kind may differ in without another checkpoint.
COEFFICIENTS = ("alpha", "b", "rho", "scheme", "composition", "stages", "force", "order")


def by_kind():
    """Return a row of each kind of method; the others are slow."""
    seen = set()
    for row, name in ONCE:
        kept = [(f.name, getattr(row.method, f.name)) for f in fields(row.method)]
        kind = type(row.method), name, str([x for x in kept if x[0] not in COEFFICIENTS])
        yield pytest.param(row, name, marks=[pytest.mark.slow] if kind in seen else [])
        seen.add(kind)


@pytest.mark.parametrize(("row", "name"), [*by_kind()], ids=str)
def test_a_stored_run_cut_off_and_resumed_is_the_straight_one(row, name, tmp_path):
    problem, path = ALL[name], tmp_path / "run.zarr"
    method = settled(problem, row.method)
    straight = problem.run(method, steps_of(problem))
    with pytest.raises(CutError):
        stored(problem, method, path, progress=cut)
    lv.resume(path)
    found = lv.load(path)
    np.testing.assert_array_equal(found.t, straight.t)
    for state, values in straight.states.items():
        np.testing.assert_array_equal(found.states[state], values, state)
