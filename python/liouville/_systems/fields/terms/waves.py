"""Factors cos(k . x + phase), and their products as sums."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import product

import numpy as np

#: A cosine or sine is 0 or 1 if it is within this.
NEAR = 4e-16

#: A number, a wave number for each variable with one, and a phase: number * cos(k . x + phase).
_Cosine = tuple[Fraction, dict[int, float], float]


@dataclass(frozen=True)
class Wave:
    """The factor cos(k . x[places] + phase)."""

    places: tuple[int, ...]
    k: tuple[float, ...]
    phase: float = 0.0

    def evaluate(self, x: np.ndarray) -> np.ndarray:
        """Return the values at x of shape (..., n)."""
        return np.asarray(np.cos(x[..., list(self.places)] @ np.array(self.k) + self.phase))

    def written(self, names: Sequence[str]) -> str:
        """Write the factor in the user's names: ``sin(2*x - y)``."""
        angle = ""
        for v, k in zip(self.places, self.k, strict=True):
            word = names[v] if abs(k) == 1 else f"{abs(k):g}*{names[v]}"
            angle += (" - " if k < 0 else " + ") + word
        angle = angle.removeprefix(" + ")
        if self.phase == -math.pi / 2:
            return f"sin({angle})"
        return f"cos({angle} + {self.phase:g})" if self.phase else f"cos({angle})"


def expanded(waves: Sequence[Wave]) -> Iterator[tuple[Fraction | float, Wave | None]]:
    """Write a product of waves as a sum: numbers, and cosines or sines of no phase.

    By cos a cos b = cos(a + b) / 2 + cos(a - b) / 2. The first k of a wave is positive, its phase
    is 0 or -pi/2, and a constant has no wave.
    """
    first = [_cosine(wave) for wave in waves]
    for number, k, phase in reduce(_times, [[one] for one in first]):
        yield from _parts(number, {v: k[v] for v in sorted(k) if k[v] != 0}, phase)


def _cosine(wave: Wave) -> _Cosine:
    return Fraction(1), dict(zip(wave.places, wave.k, strict=True)), wave.phase


def _times(left: list[_Cosine], right: list[_Cosine]) -> list[_Cosine]:
    return [
        (a * b / 2, {v: k.get(v, 0.0) + sign * m.get(v, 0.0) for v in {*k, *m}}, p + sign * q)
        for (a, k, p), (b, m, q) in product(left, right)
        for sign in (1, -1)
    ]


def _parts(
    number: Fraction, k: dict[int, float], phase: float
) -> Iterator[tuple[Fraction | float, Wave | None]]:
    """Write cos(a + phase) as cos(phase) cos(a) - sin(phase) cos(a - pi/2)."""
    if next(iter(k.values()), 1.0) < 0:
        k, phase = {v: -slope for v, slope in k.items()}, -phase
    even, odd = _rounded(math.cos(phase)), _rounded(math.sin(phase))
    if even:
        yield number * even, Wave(tuple(k), tuple(k.values())) if k else None
    if odd and k:
        yield -number * odd, Wave(tuple(k), tuple(k.values()), -math.pi / 2)


def _rounded(value: float) -> Fraction | float:
    nearest = round(value)
    return Fraction(nearest) if abs(value - nearest) <= NEAR else value
