r"""H(t) as a sum of operators with functions of time, found by products with random vectors.

.. math::

    H(t) = H(t_0) + \sum_k f_k(t)\, (H(t_k) - H(t_0))
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.tape import record
from liouville._systems.waves.bounds import PROBABLE, Spectrum
from liouville._systems.waves.entries import Bounds

Array = NDArray[Any]

#: How H is had at a time, and how eigenvalues are bounded of a sum with weights.
Ways = tuple[
    Callable[[float], tuple[_core.Operator, _core.Hamiltonian]],
    Callable[[_core.Hamiltonian, list[float] | None], Spectrum],
]

#: Fewest and most intervals between Chebyshev's nodes, and how many for a unit of 1/beta.
NODES, EACH = (32, 2048), 2.0

#: Most functions of time that are looked for.
MOST = 5

#: Numbers that stand for a vector, each a sum of a part of its components with random signs.
SKETCH = 64

#: The part left out of H(t), relative to the tolerance over the time and to H; bound of a check.
SHARE, ROUNDING, CHECKED = 0.02, 1e-13, 20.0

EPSILON = float(np.finfo(float).eps)

#: The seed of vectors, signs and times.
SEED = 3


@dataclass(frozen=True)
class Separated:
    """The sum over a run.

    Attributes
    ----------
    hamiltonian : _core.Hamiltonian
        Of products at the times :math:`t_0, t_1, ...`, with the weights 1 and :math:`f_k`.
    bounds : list of tuple
        Those of :math:`H(t_0)` and of the differences, over hbar.
    spectrum : Spectrum
        Of H(t) at any time.
    looks : int
        Products that found it.
    apart : float
        The largest distance of two times of these.
    """

    hamiltonian: _core.Hamiltonian
    bounds: list[Bounds]
    spectrum: Spectrum
    looks: int
    apart: float

    @property
    def reason(self) -> str:
        """A sentence for a plan."""
        count = len(self.bounds) - 1
        functions = f"{count} function{'' if count == 1 else 's'} of time"
        return (
            f"H(t) was found to be H(t0) and {functions} times operators, by {self.looks} products"
        )

    @property
    def unseen(self) -> str:
        """A sentence on what was not looked at."""
        return (
            f"products were made at times up to {self.apart:.2g} apart; a shorter pulse is seen by "
            "its time in points="
        )


class Looker:
    """Products of H(t) with a vector, less that at the start, by a few numbers for each."""

    def __init__(self, product: Callable[[float, np.ndarray], np.ndarray], n: int, t0: float):
        self._draw = np.random.default_rng(SEED)
        self._product, self.t0, self.looks = product, t0, 0
        self.vector, self.other = self._random(n), self._random(n)
        self._place = self._draw.integers(SKETCH, size=n)
        self._sign = self._draw.choice([-1.0, 1.0], size=n)
        self._known: dict[float, Array] = {}
        self.first = self.at(t0, self.vector)
        self.scale = float(np.linalg.norm(self.first))

    def _random(self, n: int) -> np.ndarray:
        found = self._draw.normal(size=(2, n)).T @ [1.0, 1j]
        return np.asarray(found / np.linalg.norm(found))

    def at(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the product with a vector at a time."""
        self.looks += 1
        return self._product(t, x)

    def changes(self, times: Array) -> Array:
        """Return sketches of the changes since the start, a row for each time."""
        rows = []
        for t in times.tolist():
            if t not in self._known:
                change = (self.at(t, self.vector) - self.first) * self._sign
                parts = [np.bincount(self._place, x, SKETCH) for x in (change.real, change.imag)]
                self._known[t] = np.concatenate(parts)
            rows.append(self._known[t])
        return np.array(rows)

    @property
    def apart(self) -> float:
        """The largest distance of two times at which it was looked."""
        return float(np.diff(sorted({self.t0, *self._known})).max(initial=0.0))

    def times(self, t1: float, count: int) -> Array:
        """Return random times of a run."""
        return self.t0 + (t1 - self.t0) * self._draw.random(count)


def separate(
    product: Callable[[float, np.ndarray], np.ndarray],
    ways: Ways,
    n: int,
    span: tuple[float, float],
    tol: float,
    points: Sequence[float] = (),
) -> Separated | None:
    """Look for the sum over a run, to a part of its tolerance; None if it has too many parts.

    `product` makes those of H over hbar with complex vectors; `ways` are to have it at a time, and
    to bound its eigenvalues; at `points` it is checked, too.
    """
    t0, t1 = span
    at, bounded = ways
    base = bounded(at(t0)[1], None).bounds
    theta = 0.5 * (base[1] - base[0]) * abs(t1 - t0)
    looker = Looker(product, n, t0)
    size = max(looker.scale, *map(abs, base))
    # functions change by roundings of the time, at most about as fast as states do
    late = EPSILON * 0.5 * (base[1] - base[0]) * max(abs(t0), abs(t1))
    least = max(SHARE * tol / abs(t1 - t0), (ROUNDING + late) * size)
    wanted = min(EACH * theta, NODES[1])
    count = NODES[0]
    while count < wanted:
        count *= 2
    while count <= NODES[1]:
        x = np.cos(np.pi * np.arange(count, -1, -1) / count)
        nodes = t0 + (t1 - t0) * 0.5 * (1 + x)
        rows = looker.changes(nodes)
        if not np.isfinite(rows).all():
            return None
        picked = _picked(rows, least)
        if picked is None:
            return None
        values = np.linalg.lstsq(rows[picked].T, rows.T, rcond=None)[0]
        series = _series(values)
        degree = _degree(np.linalg.norm(rows[picked], axis=1), series, least)
        if degree is not None:
            fit = _Fit(looker, [t0, *nodes[picked].tolist()], series[:, :degree], t1)
            is_right = fit.is_right(least, int(EACH * theta / 4) + 8, points)
            return fit.separated(ways, base, values) if is_right else None
        count *= 2
    return None


def _picked(rows: Array, least: float) -> list[int] | None:
    """Return rows of which all others are sums up to so much, the longest ones left first."""
    rest, picked = rows.copy(), list[int]()
    while True:
        lengths = np.linalg.norm(rest, axis=1)
        longest = int(lengths.argmax())
        if lengths[longest] <= least:
            return picked
        if len(picked) == MOST:
            return None
        picked.append(longest)
        unit = rest[longest] / lengths[longest]
        rest -= np.outer(rest @ unit, unit)


def _series(values: Array) -> Array:
    """Return Chebyshev's coefficients of rows of values at his nodes, from -1 to 1."""
    count = values.shape[1] - 1
    k = np.arange(count + 1)
    halved = np.where((k == 0) | (k == count), 0.5, 1.0)
    cosines = np.cos(np.pi * np.outer(k, k[::-1]) / count)
    found: Array = (2.0 / count) * (values * halved) @ (cosines * halved[:, None]).T
    return found


def _degree(sizes: Array, series: Array, least: float) -> int | None:
    """Return how many terms leave out no more than so much; None if seven eighths are too few."""
    if not sizes.size:
        return 0
    left = np.sqrt(np.cumsum((sizes @ np.abs(series))[::-1] ** 2)[::-1])
    return int(np.argmax(left <= least)) if left[-(left.size // 8)] <= least else None


@dataclass(frozen=True)
class _Fit:
    """Functions of time by their series over a run, and the times of the operators."""

    looker: Looker
    times: list[float]
    series: Array
    t1: float

    def weights(self, t: float) -> Array:
        """Return the functions of time."""
        x = 2 * (t - self.looker.t0) / (self.t1 - self.looker.t0) - 1
        degrees = np.arange(self.series.shape[1])
        found: Array = self.series @ np.cos(degrees * np.arccos(np.clip(x, -1.0, 1.0)))
        return found

    def is_right(self, least: float, count: int, points: Sequence[float]) -> bool:
        """Return whether products with another vector are those of the sum, at these and others."""
        looker, other = self.looker, self.looker.other
        first, *rest = (looker.at(t, other) for t in self.times)
        for t in [*points, *looker.times(self.t1, count).tolist()]:
            found = looker.at(t, other) - first
            for weight, one in zip(self.weights(t).tolist(), rest, strict=True):
                found = found - weight * (one - first)
            if not np.linalg.norm(found) <= CHECKED * least:
                return False
        return True

    def tape(self) -> _core.Tape:
        """Record 1 and the functions of time."""
        t, params = ca.SX.sym("t"), ca.SX.sym("params", 0)
        x = 2 * (t - self.looker.t0) / (self.t1 - self.looker.t0) - 1
        before, now, sums = ca.SX(1), x, ca.SX.zeros(len(self.series), 1)
        for k in range(self.series.shape[1]):
            sums += self.series[:, k] * (before if k == 0 else now)
            if k:
                before, now = now, 2 * x * now - before
        return record("drive", {"t": t, "params": params}, ca.vertcat(ca.SX(1), sums))

    def separated(self, ways: Ways, base: Bounds, values: Array) -> Separated:
        """Return the sum with its bounds, where its functions have these values."""
        at, bounded = ways
        operators = [at(t)[0] for t in self.times]
        bounds, (low, high), guarantee = [base], base, PROBABLE
        for operator, weights in zip(operators[1:], values, strict=True):
            found = bounded(_core.Hamiltonian([operator, operators[0]], True), [1.0, -1.0])
            bounds.append(found.bounds)
            sums = np.outer(weights, found.bounds)
            low, high, guarantee = low + sums.min(), high + sums.max(), found.guarantee
        drive = (self.tape(), np.zeros(0))
        hamiltonian = _core.Hamiltonian(operators, True, drive=drive)
        spectrum = Spectrum((float(low), float(high)), guarantee)
        return Separated(hamiltonian, bounds, spectrum, self.looker.looks, self.looker.apart)
