"""Bounds of energies as they are given, and estimates of them by random vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics.arguments import number
from liouville._basics.errors import hinted
from liouville._systems.waves.entries import OPEN, Bounds

#: Fewest and most steps of Lanczos' method, and the seed of its start.
STEPS, SEED = (40, 80), 1

#: Where the spectrum times the span is wider than this many units, closer bounds are worth them.
WORTH = 4.0 * STEPS[0]

#: Estimated bounds are widened by this part of the width at each end.
WIDENED = 0.01

#: The probability that bounds "with probability 1 - 1e-6" are wrong.
FAILING = 1e-6

#: How far these bounds may be out, in units of half the width, is below this with so many steps.
CLOSE = 0.02

#: The ways to find bounds.
WAYS = ("auto", "gershgorin", "lanczos")

#: Kinds of bounds: rigorous, and the others.
RIGOROUS, PROBABLE, GIVEN = "rigorous", "probable", "given"
LIKELY = "with probability 1 - 1e-6"

#: Products of a symmetric matrix may seem so asymmetric, by roundoff.
ASYMMETRY = 1e-10


def positive(name: str, value: Any) -> float:
    """Return a positive number."""
    found = number(f"{name} must be a number", value)
    if not (np.isfinite(found) and found > 0):
        raise ValueError(f"{name} must be positive and finite, not {found:g}")
    return found


@dataclass(frozen=True)
class Spectrum:
    """Bounds of a spectrum, what they are, and the products that it took to find them."""

    bounds: Bounds
    guarantee: str
    products: float = 0.0


def way(bounds: Any) -> str:
    """Return the way to find bounds that was asked for, empty where they are given."""
    if not isinstance(bounds, str):
        return ""
    if bounds not in WAYS:
        ways = ", ".join(map(repr, WAYS))
        raise ValueError(f"bounds must be one of {ways} or a pair of energies, not {bounds!r}")
    return bounds


def interval(bounds: Any, hbar: float) -> Bounds | None:
    r"""Return bounds of H, given as energies, as those of :math:`H / \hbar`."""
    if isinstance(bounds, str):
        return None
    if not isinstance(bounds, (tuple, list, np.ndarray)) or len(bounds) != 2:
        raise TypeError(
            "bounds must be a pair (least energy, largest energy) or a way to find them, "
            f"not {bounds!r}"
        )
    low, high = (number("bounds must be a pair of numbers", x) for x in bounds)
    if not (np.isfinite(high - low) and low < high):
        raise ValueError(f"bounds must be (least, largest) energy, not ({low:g}, {high:g})")
    return low / hbar, high / hbar


def probable(hamiltonian: _core.Hamiltonian, weights: Sequence[float] | None = None) -> Spectrum:
    """Find bounds by 40 steps of Lanczos' method: all Ritz values, their residuals, and 1 %."""
    steps = STEPS[0]
    _, _, low, high = hamiltonian.ritz(steps, SEED, weights)
    beyond = WIDENED * (high - low)
    return Spectrum((low - beyond, high + beyond), PROBABLE, steps / 2)


def likely(hamiltonian: _core.Hamiltonian, weights: Sequence[float] | None = None) -> Spectrum:
    r"""Find bounds that are right with probability 1 - 1e-6, by 40 to 80 steps of Lanczos' method.

    From a random start k steps leave out :math:`q` of the width at an end with a probability of at
    most :math:`1.648 \sqrt N e^{-\sqrt q (2k - 1)}` (Kuczynski and Wozniakowski).
    """
    n = hamiltonian.size
    log = np.log(3.296 * np.sqrt(n) / FAILING)
    steps = int(np.clip(np.ceil((log / np.sqrt(CLOSE) + 1) / 2), *STEPS))
    low, high, _, _ = hamiltonian.ritz(steps, SEED, weights)
    q = float((log / (2 * steps - 1)) ** 2) if steps < n else 0.0
    beyond = q * (high - low) / (1 - 2 * q) + 1e-12 * max(abs(low), abs(high))
    return Spectrum((low - beyond, high + beyond), LIKELY, min(steps, n) / 2)


def inside(found: Spectrum, rigorous: Bounds | None) -> Spectrum:
    """Return the closer ones of two kinds of bounds, at each end."""
    if rigorous is None:
        return found
    low, high = max(found.bounds[0], rigorous[0]), min(found.bounds[1], rigorous[1])
    return replace(found, bounds=(low, high))


def check_inside(given: Bounds, hamiltonian: _core.Hamiltonian, hbar: float) -> None:
    """Refuse bounds with a Ritz value beyond: there is an eigenvalue farther out."""
    ritz_low, ritz_high, _, _ = hamiltonian.ritz(STEPS[0], SEED)
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


def check_symmetric(
    name: str,
    hamiltonian: _core.Hamiltonian,
    hint: str = f"only a Hermitian operator keeps the norm; {OPEN}",
) -> None:
    """Refuse products that random vectors see to belong to no Hermitian matrix."""
    found = hamiltonian.asymmetry(SEED)
    if np.isnan(found):
        sentence = f"products with {name} are not finite, or their squares are not"
        raise ValueError(hinted(sentence, "choose units in which H / hbar is of order 1"))
    if not found <= ASYMMETRY:
        sentence = f"x . {name} y and y . {name} x differ by {found:.1e} of their size"
        raise ValueError(hinted(f"{name} is not Hermitian: {sentence}", hint))
