"""Ordinary differential equations solved near roundoff: the one place that calls SciPy's solvers.

The tolerance of a test is ten times the error of its reference at least. The error is here some
1e-14 of the states, times what the motion itself makes of roundings.
"""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp


def solved(rates, times, start):
    """Return the states at times, of which the first is that of the start, shape (times, n).

    Each span between two times is integrated by itself: dense output is of a lower order, and
    no step passes over a kink at one of the times.
    """
    states = [np.asarray(start)]
    for span in pairwise(times):
        run = solve_ivp(rates, span, states[-1], method="DOP853", rtol=3e-14, atol=1e-15)
        states.append(run.y[:, -1])
    return np.array(states)


def propagated(product, times, psi):
    """Return wave functions at times, from H(t) psi over hbar."""
    return solved(lambda t, y: -1j * product(t, y), times, np.asarray(psi, dtype=complex))
