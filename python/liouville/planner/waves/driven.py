"""Plans for a Hamiltonian that depends on time: series in time, to a tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville.errors import hinted
from liouville.planner.waves.propagators import Driven
from liouville.systems import Schrodinger
from liouville.systems.schrodinger.bounds import RIGOROUS, Spectrum

#: Times at which bounds are taken for the roundoff, and at which those of a small H are computed.
LOOKS, KNOTS = 9, 17

#: Up to this order in the core the eigenvalues at the ends are computed at these times.
SMALL = 128


def widest(system: Schrodinger, t0: float, t1: float) -> Spectrum:
    """Return bounds of H(t) over a run, as far as they are seen at some of its times."""
    ends = np.array([system.bounds_at(t) for t in np.linspace(t0, t1, LOOKS)])
    if not np.isfinite(ends).all():
        raise ValueError(hinted("H(t) is not finite", "look for a division by zero in a drive"))
    guarantee = RIGOROUS if system.guarantee == RIGOROUS else system.guarantee
    return Spectrum((float(ends[:, 0].min()), float(ends[:, 1].max())), guarantee)


def series_in_time(
    system: Schrodinger, times: tuple[float, ...], rate: float, norm_tol: float
) -> tuple[Driven, tuple[int, int, int, float]]:
    """Return the series of a run, and its windows of both kinds, products and longest window."""
    core = Driven(
        tuple(system.groups), tuple(system.term_bounds), _knots(system, times[0], times[-1]),
        rate, norm_tol, 0,
    )  # fmt: skip
    cost = _core.driven_cost(system.hamiltonian, core, times[0], times[-1])
    return replace(core, windows=cost[0] + cost[1]), cost


def _knots(
    system: Schrodinger, t0: float, t1: float
) -> tuple[tuple[float, tuple[float, float]], ...]:
    """Return closer bounds at some times: those given, or of a small H its own eigenvalues."""
    if system.given_bounds is not None:
        return tuple((t, system.given_bounds) for t in sorted((t0, t1)))
    parts = system.parts() if system.hamiltonian.size <= SMALL else None
    if parts is None:
        return ()
    found = []
    for t in np.linspace(min(t0, t1), max(t0, t1), KNOTS).tolist():
        matrix: NDArray[np.float64] = np.tensordot(system.weights_at(t), parts, axes=1)
        ends = np.linalg.eigvalsh(matrix)[[0, -1]]
        slack = 1e-12 * float(np.abs(ends).max())
        found.append((t, (float(ends[0]) - slack, float(ends[1]) + slack)))
    return tuple(found)
