"""The planes of a potential, as the core has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from liouville import _core
from liouville._systems.fields.gridded.axis import Array, Axis
from liouville._systems.fields.gridded.potential import kinds_of
from liouville._systems.fields.plane_field import Planes, planes_of


def made_of(
    axes: Sequence[Axis], time: Axis | None, potential: Sequence[Array], mean: Array
) -> Planes:
    """Return the planes of a potential and a mean flow, but those in which nothing moves."""
    made = (_made(number, axes, time, a, mean) for number, a in enumerate(potential))
    return [each for each in made if each is not None]


def _made(
    number: int, axes: Sequence[Axis], time: Axis | None, a: Array, flow: Array
) -> tuple[_core.Plane, tuple[int, ...]] | None:
    n, lead = len(axes), int(time is not None)
    k, plane = planes_of(n)[number]
    # each component of the mean flow is in one plane
    shares = (0, 1) if plane == (0, 1) else (2,) if plane == (1, 2) else ()
    mean = [flow[..., j] * (j in shares) for j in plane]
    if not a.any() and not np.any(mean):
        return None
    for j, (axis, kind) in enumerate(zip(axes, kinds_of(number, n, False), strict=True)):
        a = axis.padded(a, lead + j, kind)
    frozen, order = [], list(plane)
    if k is not None:
        frozen.append(axes[k].basis("D"))
        order.insert(0, k)
    if time is not None:
        frozen.append(time.basis("B"))
        order.insert(len(order) - 2, n)
    places = [0 if j == n else lead + j for j in order]
    coefficients = np.ascontiguousarray(np.transpose(a, places))
    means = [np.ascontiguousarray(np.atleast_1d(each)) for each in mean]
    bases = [axes[j].basis("B") for j in plane]
    return _core.Plane(frozen, bases, coefficients, means), tuple(order)
