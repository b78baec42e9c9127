"""Propagations with steps of a given size: split operator, and Magnus methods for H(t)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from liouville import _core
from liouville.errors import hinted
from liouville.methods import Magnus, SplitOperator
from liouville.propagation.ladder import cheapest
from liouville.propagation.plan import Propagation
from liouville.systems import Schrodinger

#: So many times are looked at for the largest width of the spectrum of H(t).
LOOKS = 33

#: The norm may be off by so much.
NORM = 1e-6

Stops = Sequence[tuple[float, int]]


def stepped(
    system: Schrodinger, method: SplitOperator | Magnus, t0: float, stops: Stops
) -> Propagation:
    """Plan a run from t0 with steps between `stops`: times with the steps to each."""
    if isinstance(method, SplitOperator):
        return _split_operator(system, method, t0, stops)
    return _magnus(system, method, t0, stops)


def _split_operator(
    system: Schrodinger, method: SplitOperator, t0: float, stops: Stops
) -> Propagation:
    if system.grid is None:
        raise TypeError(
            hinted(
                f"SplitOperator steps a Grid, whose energy is T + V, not {system!r}",
                "take SchrodingerSplitting, or Magnus for H(t)",
            )
        )
    steps = sum(n for _, n in stops)
    drifts = sum(not is_kick for is_kick, _, _ in _core.split_program(method.scheme))
    low, high = system.bounds_at(t0)
    h = max(abs(b - a) / n for a, (b, n) in zip([t0, *(t for t, _ in stops)], stops, strict=False))
    return Propagation(
        method=f"split operator {method.scheme}",
        tol=None,
        t0=t0,
        stops=tuple(stops),
        theta=0.5 * (high - low) * h,
        bounds=(low, high),
        products=steps * drifts,
        bound=None,
        reasons=("asked for, with steps of this size; a product is a pair of FFTs",),
        core=("phases", method.scheme, NORM),
    )


def _magnus(system: Schrodinger, method: Magnus, t0: float, stops: Stops) -> Propagation:
    if not system.is_real:
        raise TypeError("H is complex and no gauge makes it real, which Magnus methods need here")
    steps = sum(n for _, n in stops)
    times = np.array([t0, *(t for t, _ in stops)])
    sizes = np.abs(np.diff(times)) / [n for _, n in stops]
    looks = np.linspace(times[0], times[-1], LOOKS)
    widths = [np.ptp(system.bounds_at(t)) for t in looks]
    low, high = system.bounds_at(float(looks[int(np.argmax(widths))]))
    exponentials = 2 if method.order == 4 else 1
    theta = 0.5 * (high - low) * float(sizes.max()) / exponentials
    found = cheapest(np.array([theta]), method.tol / (exponentials * steps), stable=False)
    if found is None:
        sentence = f"no splitting reaches {method.tol:g} in {exponentials * steps} exponentials"
        raise ValueError(hinted(sentence, "give a larger tol, or a larger h"))
    shears = exponentials * steps * found.shears
    core = ("magnus", method.order, found.rung.coefficients, found.x, NORM, system.operator_bounds)
    return Propagation(
        method=f"Magnus of order {method.order}, exponentials by {found.rung.name}",
        tol=None,
        t0=t0,
        stops=tuple(stops),
        theta=theta,
        bounds=(low, high),
        products=shears / 2,
        bound=None,
        reasons=(
            "asked for, with steps of this size; the products are those of the widest spectrum",
        ),
        core=core,
    )
