"""Bounds of energies as they are given, and what random vectors tell of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from liouville import _core
from liouville._arguments import number
from liouville.errors import hinted
from liouville.systems.schrodinger.entries import Bounds

#: Steps of Lanczos' method, and the seed of its start, where bounds are found or checked by it.
LANCZOS = (30, 1)

#: Its bounds are widened by this at each end.
WIDENED = 0.01

#: Products of a symmetric matrix may seem so asymmetric, by roundoff.
ASYMMETRY = 1e-10


def positive(name: str, value: Any) -> float:
    """Return a positive number."""
    found = number(f"{name} is a number", value)
    if not (np.isfinite(found) and found > 0):
        raise ValueError(f"{name} is positive and finite, not {found:g}")
    return found


def interval(bounds: Any, hbar: float) -> Bounds | None:
    r"""Return bounds of H, given as energies, as those of :math:`H / \hbar`."""
    if bounds is None:
        return None
    if not isinstance(bounds, (tuple, list, np.ndarray)) or len(bounds) != 2:
        raise TypeError(f"bounds is a pair (least energy, largest energy), not {bounds!r}")
    low, high = (number("bounds is a pair of numbers", x) for x in bounds)
    if not (np.isfinite(high - low) and low < high):
        raise ValueError(f"bounds = ({low:g}, {high:g}) is no interval")
    return low / hbar, high / hbar


def extent(hamiltonian: _core.Hamiltonian) -> Bounds:
    """Find the ends of a spectrum by Lanczos' method, with their residuals, and widen it by 1 %."""
    low, low_residual, high, high_residual = hamiltonian.ritz(*LANCZOS)
    low, high = low - low_residual, high + high_residual
    beyond = WIDENED * (high - low)
    return low - beyond, high + beyond


def check_inside(given: Bounds, hamiltonian: _core.Hamiltonian, hbar: float) -> None:
    """Refuse bounds with a Ritz value beyond: there is an eigenvalue farther out."""
    ritz_low, _, ritz_high, _ = hamiltonian.ritz(*LANCZOS)
    slack = 1e-12 * max(abs(ritz_low), abs(ritz_high))
    for word, bound, ritz, beyond in (
        ("below", given[0], ritz_low, given[0] - ritz_low),
        ("above", given[1], ritz_high, ritz_high - given[1]),
    ):
        if beyond > slack:
            raise ValueError(
                hinted(
                    f"bounds say that no energy is {word} {bound * hbar:.6g}, "
                    f"but there is one {word} {ritz * hbar:.6g} or there",
                    "leave bounds= out, and they are found",
                )
            )


def check_symmetric(hamiltonian: _core.Hamiltonian) -> None:
    """Refuse products that random vectors see to belong to no symmetric matrix."""
    found = hamiltonian.asymmetry(LANCZOS[1])
    if not found <= ASYMMETRY:
        raise ValueError(
            hinted(
                f"H is not symmetric: x . H y and y . H x differ by {found:.1e} of their size",
                "only a Hermitian operator keeps the norm; absorbing potentials are not taken",
            )
        )
