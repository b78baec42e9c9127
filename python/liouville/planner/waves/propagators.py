"""Propagators: the numbers by which the core steps wave functions.

`norm_tol` is how far the norm may be off, relative to the start, before a run is stopped.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Shears:
    """Shears of q and p in turn, by `coefficients`, of H - `shift`."""

    coefficients: np.ndarray
    shift: float
    norm_tol: float
    kind: str = field(default="shears", init=False)


@dataclass(frozen=True, eq=False)
class Series:
    """Chebyshev series, each for the outputs of a window, to the error `rate` in a unit of time.

    `windows` says how many outputs each series makes.
    """

    bounds: tuple[float, float]
    rate: float
    norm_tol: float
    windows: tuple[int, ...]
    kind: str = field(default="chebyshev", init=False)


@dataclass(frozen=True, eq=False)
class Krylov:
    """A Krylov space of this dimension for each step, to the error `rate` in a unit of time."""

    dimension: int
    rate: float
    norm_tol: float
    kind: str = field(default="lanczos", init=False)


@dataclass(frozen=True, eq=False)
class Processed:
    """The shears of the longest stable steps with a processor, for steps of `theta` / beta."""

    order: int
    stages: int
    shift: float
    theta: float
    norm_tol: float
    kind: str = field(default="processed", init=False)


@dataclass(frozen=True, eq=False)
class Exponentials:
    """A Magnus method of order 2 or 4, whose exponentials are shears of at most `theta` / beta."""

    order: int
    coefficients: np.ndarray
    theta: float
    norm_tol: float
    bounds: tuple[tuple[float, float], ...]
    kind: str = field(default="magnus", init=False)


@dataclass(frozen=True, eq=False)
class SeriesExponentials:
    """The same with Chebyshev series, all together off by `rate` in a unit of time."""

    order: int
    rate: float
    norm_tol: float
    bounds: tuple[tuple[float, float], ...]
    kind: str = field(default="magnus series", init=False)


@dataclass(frozen=True, eq=False)
class Driven:
    """Series in time for H(t), to the error `rate` in a unit of time.

    The core has H as parts with a weight each: `groups` says of how many operators, and
    `part_bounds` has bounds of their eigenvalues. `knots` are times with closer bounds of H.
    Windows end at `breaks` besides. `windows` is how many series the run takes, for the plan alone.
    """

    groups: tuple[int, ...]
    part_bounds: tuple[tuple[float, float], ...]
    knots: tuple[tuple[float, tuple[float, float]], ...]
    rate: float
    norm_tol: float
    windows: int
    breaks: tuple[float, ...] = ()
    kind: str = field(default="driven", init=False)


@dataclass(frozen=True, eq=False)
class Split:
    """A splitting of T + V on a grid."""

    scheme: str
    norm_tol: float
    kind: str = field(default="split", init=False)


Propagator = (
    Shears | Series | Krylov | Processed | Exponentials | SeriesExponentials | Driven | Split
)

KINDS: dict[str, type[Propagator]] = {
    "shears": Shears,
    "chebyshev": Series,
    "lanczos": Krylov,
    "processed": Processed,
    "magnus": Exponentials,
    "magnus series": SeriesExponentials,
    "driven": Driven,
    "split": Split,
}


def read_propagator(given: Any) -> Propagator:
    """Make a propagator of what a file holds: its kind and its numbers."""
    if not isinstance(given, dict):
        raise TypeError(f"core is {given!r}")
    numbers = dict(given)
    kind = numbers.pop("kind")
    if kind not in KINDS:
        raise ValueError(f"there is no propagator {kind!r}")
    return KINDS[kind](**numbers)
