"""Every problem by every method comes to the end states that were written down before."""

import golden
import pytest
from golden_cases import NAMES, Case, cases

import liouville as lv

STATES = golden.load()


@pytest.mark.parametrize("problem", NAMES)
def test_end_states_are_the_golden_ones(problem):
    verdicts = {str(case): golden.verdict(case, STATES) for case in cases(problem)}
    broken = [f"{case}: {told}" for case, (holds, told) in verdicts.items() if not holds]
    assert not broken, "\n".join([f"{len(broken)} of {len(verdicts)}", *broken])


def test_the_file_has_the_cases_there_are_and_no_others():
    listed = {str(case) for problem in NAMES for case in cases(problem)}
    assert listed == set(STATES["cases"]) | set(STATES["refused"])


def test_an_end_state_off_by_one_rounding_is_seen():
    case = Case("pendulum", lv.Spark(2), "single")
    _, states = STATES["cases"][str(case)]
    first, *others = states["q"].split()
    moved = (float.fromhex(first) * (1 + 2.0**-52)).hex()
    entry = ["another hash", {**states, "q": " ".join([moved, *others])}]
    changed = {**STATES, "cases": {str(case): entry}}
    holds, told = golden.verdict(case, changed)
    assert not holds
    assert told.startswith("differs by ")
    resolved = {"cases": ["pendulum / *"], "states": 1e-14, "multipliers": 1e-12}
    assert golden.verdict(case, {**changed, "resolved": [resolved]})[0]
    resolved["states"] = 1e-17
    assert not golden.verdict(case, {**changed, "resolved": [resolved]})[0]


def test_a_gradient_off_by_more_than_roundoff_is_seen():
    case = Case("pendulum", lv.Spark(2), "gradient")
    _, states = STATES["cases"][str(case)]
    for part, holds in ((1e-12, False), (1e-15, True)):
        moved = (float.fromhex(states["by q"]) * (1 + part)).hex()
        entry = ["another hash", {**states, "by q": moved}]
        assert golden.verdict(case, {**STATES, "cases": {str(case): entry}})[0] == holds
