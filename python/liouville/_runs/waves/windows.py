"""Windows in which derivatives of H by parameters are polynomials of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics.errors import hinted
from liouville._methods import Chebyshev, SchrodingerSplitting
from liouville._methods.planner import WavePlan
from liouville._methods.planner.waves.propagators import Driven
from liouville._runs.tangents import PARAMS
from liouville._systems import Schrodinger

Array = NDArray[Any]

#: The highest degree in time of changes of H within a window, which the core has nodes for.
DEGREE = 14

#: The part that a polynomial may leave out of a derivative of H, relative to the largest.
LEFT_OUT = 1e-11

#: Most intervals on which derivatives of a drive are polynomials.
INTERVALS = 4096

#: Times at which derivatives are looked at where steps are given.
LOOKS = 257

#: The longest window of a series of Bessel functions, and one that powers take, in units of 1/beta.
LONGEST, SHORT = 32.0, 8.0

#: Terms of a series, in units of its sum: as large as roundings may be below a tolerance of 1, and
#: at least.
LARGEST, LEAST = 1e14, 1e3


def of_drive(system: Schrodinger, names: Sequence[str]) -> list[str]:
    """Return the names on which a drive depends."""
    drive = system.sensitivity
    return [
        name
        for name in names
        if name in drive.samples
        or (name.startswith(PARAMS) and drive.depends_on(name.removeprefix(PARAMS)))
    ]


def of_potential(system: Schrodinger, names: Sequence[str]) -> list[str]:
    """Return the names on which the potential of a grid depends."""
    potential = system.potential_sensitivity
    params = [name for name in names if name.startswith(PARAMS)]
    if potential is None:
        return []
    return [name for name in params if potential.depends_on(name.removeprefix(PARAMS))]


def slopes_of(system: Schrodinger, names: Sequence[str]) -> dict[str, Callable[[Array], Array]]:
    """Return derivatives of H by parameters and samples at times, shape (k, P, columns).

    Columns are those of the functions of a drive, in energies, or of points of a potential.
    """
    drive, potential = system.sensitivity, system.potential_sensitivity

    def places(own: Sequence[str]) -> list[int]:
        cuts = [drive.params[x.removeprefix(PARAMS)][0] for x in own if x.startswith(PARAMS)]
        return [k for cut in cuts for k in range(cut.start, cut.stop)]

    found: dict[str, Callable[[Array], Array]] = {}
    if of := places(of_drive(system, names)):
        sizes = np.array([max(map(abs, bounds)) for bounds in system.term_bounds[1:]])
        found["drive"] = lambda t: drive.slopes(t)[:, of] * sizes
    if own := places(of_potential(system, names)):
        assert potential is not None, "what depends on parameters"
        shape = (-1, len(own))
        found["potential"] = lambda t: np.swapaxes(
            potential.slopes(t, own).reshape(t.size, *shape), 1, 2
        )
    for name in names:
        if name in drive.samples:
            found[name] = partial(_of_samples, system, name)
    return found


def _of_samples(system: Schrodinger, name: str, t: Array) -> Array:
    if system.sensitivity.degree(name) == 0:  # one sample holds in each window
        return np.ones((t.size, 1, 1))
    return system.sensitivity.basis(name, t)[..., None]


def at_times(what: str, slopes: Callable[[Array], Array], t: Array) -> Array:
    """Return derivatives at times; ValueError where one is not finite."""
    rows = slopes(t)
    is_fine = np.isfinite(rows).all(axis=(1, 2))
    if not is_fine.all():
        sentence = f"derivatives of the {what} by its parameters are not finite near t = "
        sentence += f"{t[~is_fine].min():g}"
        raise ValueError(hinted(sentence, "look for a root or a division by zero there"))
    return rows


def with_breaks(plan: WavePlan, system: Schrodinger, names: Sequence[str]) -> WavePlan:
    """Return a plan of the same series whose windows resolve derivatives by all these names."""
    by = [name for name in names if name != "psi"]
    drive, (t0, t1) = system.sensitivity, (plan.t0, plan.stops[-1][0])
    each = slopes_of(system, by)
    if not isinstance(plan.core, Driven):
        for what, slopes in each.items():
            if what not in drive.samples:  # splines are finite
                at_times(what, slopes, np.linspace(t0, t1, LOOKS))
        return plan
    if not by:
        return plan
    breaks = {t for name in by if name in drive.samples for t in drive.times(name).tolist()}
    breaks |= set(plan.core.breaks)
    for what, slopes in each.items():
        if what not in drive.samples:  # polynomials between their times
            breaks |= set(_resolved(what, slopes, plan))
    inside = sorted(t for t in breaks if min(t0, t1) <= t <= max(t0, t1))
    assert isinstance(plan.method, SchrodingerSplitting | Chebyshev), "methods by series in time"
    core = replace(plan.core, breaks=tuple(inside if t1 > t0 else inside[::-1]))
    powers, bessel, products, theta, beyond = _core.driven_cost(system.hamiltonian, core, t0, t1)
    return replace(
        plan,
        core=replace(core, windows=powers + bessel),
        scheme=f"series in time ({powers + bessel} windows)",
        theta=theta,
        products=float(products),
        bound=None if bessel else plan.method.tol + beyond,
    )


def _resolved(what: str, slopes: Callable[[Array], Array], plan: WavePlan) -> list[float]:
    """Return times between which derivatives by parameters are polynomials of time.

    Series in Bessel functions take these without large terms.
    """
    todo, found, largest = [(plan.t0, plan.stops[-1][0])], [], 0.0
    count = 0
    while todo:
        a, b = todo.pop()
        nodes = a + (b - a) * _nodes()
        rows = at_times(what, slopes, nodes).reshape(nodes.size, -1)
        series = series_of(rows)
        sizes = np.abs(series).max(axis=1, initial=0.0)
        largest = max(largest, float(np.abs(rows).max(initial=0.0)))
        if sizes[DEGREE + 1 :].sum() <= LEFT_OUT * largest:
            rest = np.cumsum(sizes[::-1])[::-1, None]
            parts = _parts(series * (rest > LEFT_OUT * largest), b - a, plan)
            found += np.linspace(a, b, parts, endpoint=False).tolist()
            count += 1
        else:
            middle = 0.5 * (a + b)
            todo += [(middle, b), (a, middle)]
        if count + len(todo) > INTERVALS:
            sentence = f"the derivative of the {what} by its parameters is not smooth in time"
            hint = "take Magnus with steps between its jumps, or samples= at times="
            raise ValueError(hinted(sentence, hint))
    return found


def _parts(series: Array, length: float, plan: WavePlan) -> int:
    """Return into how many parts an interval is to go for the terms of series to be small.

    Bessel functions have terms up to about (beta h)^l / l! for (s/h)^l psi, which add up to those
    of derivatives by functions with such Chebyshev's coefficients.
    """
    beta, tol = 0.5 * (plan.bounds[1] - plan.bounds[0]), getattr(plan.method, "tol", 1e-8)
    sizes = np.abs(_powers() @ series[: DEGREE + 1]).max(axis=1, initial=0.0)
    count = 1
    while True:
        h = min(abs(length) / count, LONGEST / max(beta, 1e-300))
        theta, part = beta * h, h / max(abs(length), 1e-300)
        terms = np.cumprod(np.r_[1.0, part * theta / np.arange(1.0, DEGREE + 1)])
        if theta <= SHORT or sizes @ terms <= max(LARGEST * tol, LEAST) * sizes.max():
            return count
        count *= 2


@cache
def _powers() -> Array:
    """Return coefficients of powers on [0, 1] by those of Chebyshev's polynomials."""
    found = np.zeros((DEGREE + 1, DEGREE + 1))
    for j in range(DEGREE + 1):
        own = np.polynomial.Chebyshev.basis(j, domain=[0.0, 1.0])
        found[: j + 1, j] = own.convert(kind=np.polynomial.Polynomial).coef
    return found


def _nodes() -> Array:
    """Return Chebyshev's nodes in the order of the core, as parts of a window."""
    return 0.5 * (1 + np.cos(np.pi * np.arange(DEGREE + 7) / (DEGREE + 6)))


def series_of(rows: Array) -> Array:
    """Return Chebyshev's coefficients of each degree, of functions at the nodes as rows."""
    last = rows.shape[-2] - 1
    k = np.arange(last + 1)
    half = np.where((k == 0) | (k == last), 0.5, 1.0)
    matrix = 2 / last * np.outer(half, half) * np.cos(np.pi * np.outer(k, k) / last)
    found: Array = matrix @ rows
    return found
