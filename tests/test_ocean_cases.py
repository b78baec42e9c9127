"""Cases of ocean-tracking codes with known solutions: errors within those that Parcels accepts."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import ocean_cases as cases

#: What errors are below here, as measured and rounded up.
REACHED = {
    "stationary eddy": 1e-11,
    "moving eddy": 1e-11,
    "decaying eddy": 1e-9,
    "peninsula, stream function": 0.2,
    "Stommel's gyre": 2e-3,
}


@pytest.mark.parametrize("name", REACHED)
def test_errors_are_below_those_accepted(name):
    """On the grids, with the steps and from the starts of the tests of Parcels."""
    case, accepted = cases.CASES[name]
    assert case() < REACHED[name] < accepted


def test_a_cut_off_coast_costs_accuracy_that_finer_cells_bring_back():
    """Velocities that end at steps of land are no longer those of the smooth coast."""
    coarse, fine = (cases.peninsula(k, given="velocity") for k in (1, 4))
    assert fine < 1 < coarse < 5


def test_tracers_in_moving_eddies_end_where_they_do_without_a_grid():
    """Within two kilometres of 300 after a week of daily data; and they come back."""
    end, exact, back = cases.two_eddies()
    assert np.abs(end - exact).max() < 2e3
    assert back < 1e-13
