"""The core against splitting steps in many digits, and plans and terms that do not fit."""

import numpy as np
import plain_splitting as plain
import pytest
from fields import random_exact
from mpmath import mp, mpf

import liouville as lv
from liouville import _core
from liouville._basics.job import Job
from liouville._methods.splitting import split, to_core
from liouville._methods.splitting.border import packed


@pytest.mark.parametrize("scheme", ["S2", "BM4", "KL6"])
@pytest.mark.parametrize(
    ("diagonal", "off_diagonal", "linear"),
    [
        ("exponentials", "natural", "split"), ("exponentials", "triangular", "exact"),
        ("regular", "triangular", "split"), ("shears", "natural", "exact"),
    ],
)  # fmt: skip
def test_the_core_makes_the_steps_that_are_written_down(diagonal, off_diagonal, linear, scheme):
    terms = random_exact(3, 2, 5)
    parts = split(terms, diagonal, off_diagonal, linear=linear, runge_kutta="heun")
    x = [0.25, -0.375, 0.5]
    tape = _core.Tape([1, 3, 0], 0, np.empty((0, 4), dtype=np.int64), np.empty(0))
    job = Job(start=(np.array([x]),), span=(0.0, 0.125, 2, 2), observer=tape, seen=(3, None))
    run = _core.run(to_core(parts), lv.VolumeSplitting(composition=scheme), job)
    assert run.advance(1e3) == "done"
    end = run.take()[1][-1].ravel()
    with mp.workdps(30):
        pieces = [plain.in_digits(packed(piece)) for piece in parts.pieces]
        flows = [(a, mpf(c)) for a, c in flows_of(scheme)]
        wanted = plain.walk(pieces, flows, list(map(mpf, x)), mpf(1) / 16, 2)
    assert np.abs(end - np.array(wanted, dtype=float)).max() <= 1e-14


def flows_of(scheme):
    """Return a composition as pairs (is_adjoint, weight)."""
    each = _core.compositions()[scheme]
    return [(flow[0], str(flow[1])) for flow in each["flows"]]


def test_a_plan_for_other_pieces_is_refused():
    def chain(*pairs):
        return lv.PolynomialField.from_terms(3, [(i, 1.0, (j,)) for i, j in pairs])

    two, three = chain((0, 1), (1, 0), (2, 1)), chain((0, 1), (1, 2), (2, 0))
    method = lv.VolumeSplitting("exponentials", "natural", "S2", "split")
    plan = lv.plan(two, method, h=0.1, x=[0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="pieces"):
        lv.integrate(three, plan, t=(0.0, 1.0), h=0.1, x=[0.1, 0.2, 0.3])


def test_nothing_at_all_can_be_kept():
    field = lv.PolynomialField.from_terms(2, [(0, 1, (1,)), (1, -1, (0,))])
    x = [1.0, 2.0]
    assert lv.integrate(field, lv.VolumeSplitting(), t=(0.0, 1.0), h=0.1, states=False, x=x).t.size


def test_a_coefficient_beyond_all_floats_is_named():
    with pytest.raises(ValueError, match="coefficient of term 0"):
        lv.PolynomialField.from_terms(2, [(0, 10**400, (1,)), (1, 1, (0,))])


def test_a_step_that_leaves_no_digits_of_the_affine_part_is_refused():
    field = lv.PolynomialField.from_terms(2, [(0, 1, (1,)), (1, -1, (0,))])
    with pytest.raises(ValueError, match="few digits of its flow would be left"):
        lv.integrate(field, lv.VolumeSplitting(), t=(0, 1e17), steps=1, x=[1, 2])


def test_a_power_that_is_a_slip_of_the_pen_is_refused():
    with pytest.raises(ValueError, match="term 0 has 1 to the power of 1000000000: no more than"):
        lv.PolynomialField.from_terms(2, [(0, 1, {1: 10**9})])
