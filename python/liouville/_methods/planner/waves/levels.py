"""Few levels over long times, by all energies and eigenvectors of H."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from liouville._methods import SchrodingerSplitting
from liouville._methods.planner.waves.ladder import ROUNDOFF
from liouville._methods.planner.waves.plan import LEAST_NORM, NORM_TIMES, WavePlan, planned
from liouville._methods.planner.waves.propagators import Diagonal
from liouville._methods.planner.waves.span import Span
from liouville._systems import Schrodinger

#: No more levels than these are found.
MOST = 512

#: Nanoseconds of the smallest eigenvalue problem, and by N^3 of a real and of a complex H; of an
#: entry of a product with eigenvectors, and of a product with H at least and for each component.
SMALLEST, SOLVED = 2e5, {True: 0.5, False: 1.2}
ENTRY, PRODUCT, COMPONENT = 1.0, 500.0, 3.0

#: The eigenvalue problem is to be worth so many times its time.
WORTH = 2.0


@dataclass(frozen=True, eq=False)
class Levels:
    """Energies, over hbar, and eigenvectors as rows, flat, by real and imaginary parts.

    A run that is h long is off by `rate` h and `each` times the number of its steps.
    """

    energies: np.ndarray
    real: np.ndarray
    imaginary: np.ndarray
    rate: float
    each: float
    norm_tol: float


_found: WeakKeyDictionary[Schrodinger, Levels] = WeakKeyDictionary()


def levels_of(system: Schrodinger) -> Levels:
    r"""Find the levels of an H without time, once.

    With :math:`R = H U - U \Lambda` and :math:`E = U^+ U - 1` of what was found, the propagator by
    it is off by at most :math:`|t| |R| / (1 - |E|) + 2 |E|`.
    """
    if system not in _found:
        n, h = system.size, _matrix(system)
        energies, vectors = np.linalg.eigh(h)
        residual = np.linalg.norm(h @ vectors - vectors * energies)
        apart = np.linalg.norm(vectors.conj().T @ vectors - np.eye(n))
        rows = np.ascontiguousarray(vectors.T)
        real, imaginary = (np.array(x, dtype=float).ravel() for x in (rows.real, rows.imag))
        rate, each = residual / (1.0 - apart), 2.0 * apart + 4.0 * ROUNDOFF * np.sqrt(n)
        _found[system] = Levels(energies, real, imaginary, float(rate), float(each), LEAST_NORM)
    return _found[system]


def _matrix(system: Schrodinger) -> np.ndarray:
    """Return the matrix of H as the core has it, real or complex, by products."""
    core, n = system.hamiltonian, system.size
    unit = np.eye(core.size)[:n]
    columns = np.stack([core.multiply(row) for row in unit], axis=1)
    return columns if core.size == n else columns[:n] + 1j * columns[n:]


def products_of_levels(system: Schrodinger, outputs: int) -> float:
    """Return with how many products levels are worth finding; infinitely many where none are."""
    n = system.size
    if system.is_driven or n > MOST:
        return math.inf
    once = SMALLEST + SOLVED[system.is_real] * n**3 + PRODUCT * n
    taken = WORTH * once + 2 * ENTRY * n**2 * outputs
    return taken / max(PRODUCT, COMPONENT * n)


def cheaper_by_levels(
    system: Schrodinger, plan: WavePlan, method: SchrodingerSplitting, times: Sequence[float]
) -> WavePlan:
    """Return the plan of a run by all levels for the same tolerance, or this one if cheaper."""
    system, outputs = system.settled, len(times) - 1
    if plan.products < products_of_levels(system, outputs):
        return plan
    n = system.size
    span = Span(times[0], tuple(times[1:]), system.spectrum(float(np.abs(np.diff(times)).sum())))
    own = levels_of(system)
    whole = float(span.intervals.sum())
    bound = own.rate * whole + own.each * outputs + span.roundoff
    if bound > method.tol:
        return plan
    why = (
        f"all {n} energies and eigenvectors are found once, and steps are products with these",
        f"{plan.scheme} would take {plan.products:.4g} products with H",
    )
    return planned(
        system, method, span,
        scheme=f"eigenvectors of {n} levels",
        theta=float(span.thetas.max()),
        products=2.0 * outputs,
        bound=bound,
        reasons=why,
        core=Diagonal(max(NORM_TIMES * bound, LEAST_NORM)),
    )  # fmt: skip
