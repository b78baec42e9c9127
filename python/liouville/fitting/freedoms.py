"""The quantities that may be fitted, by name, and the directions in which a start may move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from liouville.analysis.linearization import linearized_at
from liouville.analysis.point import Array, Point, Split
from liouville.errors import hinted, quoted
from liouville.fitting.measurements import System
from liouville.systems import SemiExplicit
from liouville.systems._semi_explicit_sensitivity import gradients

#: A singular value below this part of the largest is zero.
RANK = 1e-10


def movable(system: System) -> tuple[str, ...]:
    """Return the states of a start that are free: z of a semi-explicit system follows from y."""
    return ("y",) if isinstance(system, SemiExplicit) else system.states


def free_directions(
    system: System, t: float, start: Mapping[str, Array], params: Array, free: Sequence[str]
) -> Array:
    """Return directions of both states in which those named move on the constraints, as columns.

    Raises
    ------
    ValueError
        Constraints leave them no freedom.
    """
    first, second = start.values()
    if not free:
        return np.zeros((first.size + second.size, 0))
    if isinstance(system, SemiExplicit):
        null = Split.of(gradients(system, t, first, params)).null
        basis: Array = np.vstack([null, np.zeros((second.size, null.shape[1]))])
        held: list[int] = []
    else:
        basis = linearized_at(Point(system, t, first, second, params)).tangent
        held = [k for k, name in enumerate(system.states) if name not in free]
    if held:  # of what is tangent, that which leaves the other state where it is
        rows = basis[first.size * held[0] : first.size * (held[0] + 1)]
        _, sizes, right = np.linalg.svd(rows)
        rank = int((sizes > RANK * sizes.max(initial=0.0)).sum())
        basis = basis @ right[rank:].T
        moved = basis[first.size * (1 - held[0]) : first.size * (2 - held[0])]
        basis = basis @ np.linalg.inv(np.linalg.qr(moved)[1])  # orthonormal in the unit of its own
    if not basis.shape[1]:
        sentence = f"constraints leave no freedom to {quoted(free)}"
        if not held:
            raise ValueError(hinted(sentence, "fit parameters alone"))
        hint = f"write free={tuple(system.states)!r}"
        raise ValueError(hinted(f"{sentence} while the other state is held", hint))
    return basis


def values_of(
    params: Mapping[str, Any], start: Mapping[str, Array], names: Mapping[str, Sequence[str]]
) -> dict[str, float]:
    """Return all that may be fitted, by name."""
    found = {}
    for name, value in params.items():
        for k, x in enumerate(np.ravel(value)):
            found[f"params.{name}" + f"[{k}]" * np.ndim(value)] = float(x)
    for name, value in start.items():
        places = names["unknowns" if name == "z" and "unknowns" in names else "coordinates"]
        found |= {f"{name}.{x}": float(v) for x, v in zip(places, value, strict=True)}
    return found
