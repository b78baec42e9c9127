"""Propagators: the numbers by which the core steps wave functions.

`norm_tol` is how far the norm may be off, relative to the start, before a run is stopped.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from liouville import _core

#: An interval of energies.
Interval = tuple[float, float]

#: The parts of H(t), each with a weight: of how many operators the core makes each, bounds of each,
#: bounds of H if they were given, a grid of weights with bounds of H at its corners, and start and
#: end of the run with times at which the weights are looked at: those of samples and of outputs.
Parts = tuple[
    tuple[int, ...],
    tuple[Interval, ...],
    Interval | None,
    tuple[tuple[float, ...], ...],
    tuple[Interval, ...],
    tuple[float, float, tuple[float, ...], tuple[float, ...]],
]

#: Start and end of a run, times of samples and others, and densities, at which functions are looked
#: at.
Looks = tuple[float, float, tuple[float, ...], tuple[float, ...], tuple[float, ...]]


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
class Diagonal:
    """Products with the eigenvectors of H, which no plan holds: a run finds them."""

    norm_tol: float
    kind: str = field(default="diagonal", init=False)


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
    """A Magnus method, whose exponentials are shears of at most `theta` / beta.

    `scheme` has its order, and the exponentials of a step.
    """

    scheme: tuple[int, int]
    coefficients: np.ndarray
    theta: float
    norm_tol: float
    parts: Parts
    kind: str = field(default="magnus", init=False)


@dataclass(frozen=True, eq=False)
class SeriesExponentials:
    """The same with Chebyshev series, all together off by `rate` in a unit of time."""

    scheme: tuple[int, int]
    rate: float
    norm_tol: float
    parts: Parts
    kind: str = field(default="magnus series", init=False)


@dataclass(frozen=True, eq=False)
class MagnusSteps:
    """The same with steps that keep to the error `rate` in a unit of time, and `tol` in all.

    Steps end at `breaks` besides.
    """

    scheme: tuple[int, int]
    rate: float
    tol: float
    norm_tol: float
    parts: Parts
    breaks: tuple[float, ...] = ()
    kind: str = field(default="magnus steps", init=False)


@dataclass(frozen=True, eq=False)
class Driven:
    """Series in time for H(t), to the error `rate` in a unit of time.

    Windows end at `breaks` besides. `windows` is how many series the run takes, for the plan alone.
    Parts after the first may be `by_differences` from it.
    """

    parts: Parts
    rate: float
    norm_tol: float
    windows: int
    breaks: tuple[float, ...] = ()
    by_differences: bool = False
    kind: str = field(default="driven", init=False)


@dataclass(frozen=True, eq=False)
class Split:
    """A splitting of T + V on a grid."""

    scheme: str
    norm_tol: float
    kind: str = field(default="split", init=False)


@dataclass(frozen=True, eq=False)
class SplitSteps:
    """The same with steps that keep to the error `rate` in a unit of time, by its `order`.

    `beta` is half the width of the spectrum, `energy` how large energies of the state are,
    `first` the first step, `longest` the longest one. `bands` are parts of the wave numbers that a
    nonlinear equation is to make do with, and the longest step of each. Steps end at `breaks`
    besides. `looks` are
    start and end of the run, times of samples and others, and densities, at which functions of
    time are looked at before it. A run that was `begun` for its plan goes on.
    """

    scheme: str
    order: int
    rate: float
    beta: float
    energy: float
    first: float
    longest: float
    bands: tuple[tuple[float, float], ...]
    breaks: tuple[float, ...]
    looks: Looks
    norm_tol: float
    begun: _core.SplitBeginning | None = None
    kind: str = field(default="split steps", init=False)


Propagator = (
    Shears
    | Series
    | Krylov
    | Diagonal
    | Processed
    | Exponentials
    | SeriesExponentials
    | MagnusSteps
    | Driven
    | Split
    | SplitSteps
)

KINDS: dict[str, type[Propagator]] = {
    "shears": Shears,
    "chebyshev": Series,
    "lanczos": Krylov,
    "diagonal": Diagonal,
    "processed": Processed,
    "magnus": Exponentials,
    "magnus series": SeriesExponentials,
    "magnus steps": MagnusSteps,
    "driven": Driven,
    "split": Split,
    "split steps": SplitSteps,
}


def read_propagator(given: Any) -> Propagator:
    """Make a propagator of what a file holds: its kind and its numbers."""
    if not isinstance(given, dict):
        raise TypeError(f"core is {given!r}")
    numbers = dict(given)
    kind = numbers.pop("kind")
    numbers.pop("begun", None)  # a file has no run
    if kind not in KINDS:
        raise ValueError(f"there is no propagator {kind!r}")
    return KINDS[kind](**numbers)
