"""Arguments of a gridded field: axes, arrays and words, checked and brought into order."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import amount
from liouville._basics.errors import hinted, misshapen
from liouville._systems.fields.gridded.axis import Array, Axis, Bounds
from liouville._systems.fields.gridded.coordinates import TURNS, Turn
from liouville._systems.tracing import trace as _trace

#: Degrees of the splines.
DEGREES = (3, 5)

#: Nodes are equidistant where their distances differ by no more than this part.
EQUAL = 1e-6

#: Nodes are rounded by so many units of the last digit of their type, and of a distance this part.
LAST_DIGITS, MOST_ROUNDED = 4, 1e-2

#: Nodes meet after a period where they are nearer than this part of their distance.
MEETS = 1e-3

#: Values differ by roundoff where they differ by this part of the largest difference.
CLOSE = 1e-6

#: Splines in time have this degree, or that of the polynomial through fewer samples.
IN_TIME = 3

#: A divergence above this part of the velocity is warned of, and refused above the larger one.
SILENT, MOST_DIVERGENCE = 1e-3, 5e-2


def axes_of(
    nodes: Mapping[str, Any],
    periodic: Any,
    walls: Any,
    degree: Any,
    is_of_faces: bool,
    kind: str,
) -> tuple[list[Axis], list[bool]]:
    """Return the axes, and whether the values of each are to be reversed."""
    if isinstance(degree, bool) or degree not in DEGREES:
        raise ValueError(f"degree must be {' or '.join(map(str, DEGREES))}, not {degree!r}")
    periods = _periods(periodic, nodes)
    walls = _named("walls", walls, nodes)
    if both := [name for name in walls if name in periods]:
        raise ValueError(f"'{both[0]}' is periodic and has walls; it is one of them or none")
    axes, reversed_ = [], []
    for place, (name, given) in enumerate(nodes.items()):
        points = _points(name, given)
        is_reversed = bool(points[0] > points[-1])
        points = points[::-1] if is_reversed else points
        bounds: Bounds = "open"
        if name in periods:
            turn = TURNS.get(kind)
            turn = turn if turn is not None and turn.place == place else None
            bounds, points = "periodic", _with_period(name, points, periods[name], turn)
        elif name in walls:
            bounds = "wall"
        least = degree + 2 if bounds == "periodic" else degree + 1
        if points.size - 1 < least:
            what = "edges" if is_of_faces else "nodes"
            few = f"{least + 1} {what} or more for splines of degree {degree}"
            sentence = f"'{name}' must have {few}, not {np.size(given)}"
            raise ValueError(
                hinted(sentence, "or take degree=3") if degree > DEGREES[0] else sentence
            )
        axes.append(Axis(name, points, degree, bounds))
        reversed_.append(is_reversed)
    return axes, reversed_


def time_axis(t: Any) -> Axis:
    """Return the axis of the times of samples."""
    times = _points("t", t)
    if times[0] > times[-1]:
        raise ValueError("t must grow from sample to sample")
    return Axis("t", times, min(IN_TIME, times.size - 1), "open")


def arrays_of(
    what: str, given: Any, names: Sequence[str], shapes: Sequence[tuple[int, ...]]
) -> list[Array]:
    """Return the arrays of components with these shapes."""
    if isinstance(given, np.ndarray) and len(shapes) == 1 and given.ndim == len(shapes[0]):
        given = (given,)
    if isinstance(given, str) or not isinstance(given, (Sequence, np.ndarray)):
        raise TypeError(f"{what} must be a tuple of arrays, not {type(given).__name__}")
    if len(given) != len(shapes):
        wanted = f"{len(shapes)} arrays" if len(shapes) > 1 else "one array"
        found = amount(len(given), "array")
        if isinstance(given, np.ndarray):
            found = f"an array of shape {given.shape}"
        raise ValueError(f"{what} must be {wanted}, for {', '.join(names)}, not {found}")
    arrays = []
    for name, values, shape in zip(names, given, shapes, strict=True):
        if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "iuf":
            values = np.ma.filled(values.astype(float), np.nan)
        is_plain = type(values) is np.ndarray and values.dtype.kind == "f"
        array = values if is_plain else _trace.numbers(values)  # which copies
        if array is None:
            raise TypeError(f"{what} of '{name}' must be an array of real numbers")
        if array.shape != shape:
            hint = "axes are in the order (t, x, y, z), the time only where t= is given"
            if array.shape == shape[::-1]:
                hint = f"{hint}: transpose it"
            raise misshapen(f"{what} of '{name}'", array.shape, shape, hint)
        arrays.append(array)
    return arrays


def check_ends(what: str, arrays: Sequence[Array], axes: Sequence[Axis], lead: int) -> None:
    """Refuse periodic data whose last values are the first ones."""
    for k, axis in enumerate(axes):
        if axis.is_periodic and _are_closed([np.moveaxis(x, lead + k, 0) for x in arrays]):
            sentence = f"{what} at the last '{axis.name}' is that at the first"
            raise ValueError(hinted(sentence, "leave out the last one, which is a period later"))


def _are_closed(arrays: Sequence[Array]) -> bool:
    """Return whether the last values along the first axis are the first ones, a period later."""

    def size(*values: Array) -> float:
        return max(float(np.abs(np.nan_to_num(each)).max(initial=0.0)) for each in values)

    if any((np.isnan(x[0]) != np.isnan(x[-1])).any() for x in arrays):
        return False
    gap, largest = size(*(x[-1] - x[0] for x in arrays)), size(*arrays)
    if gap > CLOSE * largest:
        return False
    varied = CLOSE * max(size(x - x[0]) for x in arrays)
    if gap > varied or not varied:
        return False
    if any(size(x[i] - x[-1 - i]) > varied for x in arrays for i in (1, 2)):
        return True
    # values alike on both sides of the seam: it is the reading that makes them smoother
    seams = [(-4, -3, -2, 0, 1, 2, 3), (-4, -3, -2, -1, 0, 1, 2, 3)]
    closed, given = (max(size(np.diff(x[list(seam)], 4, axis=0)) for x in arrays) for seam in seams)
    return closed <= given


def check_gaps(missing: Any, axes: Sequence[Axis], time: Axis) -> None:
    """Refuse data that are missing at some times only, which are no land."""
    hint = "fill the gap, or leave the sample out"
    times = time.edges
    if (empty := missing.reshape(len(missing), -1).all(1)).any() and not empty.all():
        first = int(np.argmax(empty))
        raise ValueError(
            hinted(f"velocity is NaN at all nodes of the sample at t = {times[first]:g}", hint)
        )
    gaps = missing & ~missing.all(0)
    if not gaps.any():
        return
    first, *place = np.argwhere(gaps)[0].tolist()
    names = ", ".join(axis.name for axis in axes)
    where = ", ".join(f"{axis.edges[k]:g}" for axis, k in zip(axes, place, strict=True))
    count = int(gaps.any(0).sum())
    nodes = "1 node" if count == 1 else f"{count} nodes"
    sentence = (
        f"velocity is NaN at some times only at {nodes}, first at t = {times[first]:g} and "
        f"({names}) = ({where})"
    )
    raise ValueError(hinted(sentence, "fill the gaps, or give mask=, which is land at all times"))


def check_floor(land: Any, axes: Sequence[Axis]) -> None:
    """Refuse land in three dimensions that does not go down to a wall everywhere."""
    *level, up = axes
    if up.bounds != "wall":
        sentence = f"there is land, and '{up.name}' has no walls, at which it may begin"
        walls = [axis.name for axis in axes if axis.bounds == "wall"]
        raise ValueError(hinted(sentence, f"give walls={(*walls, up.name)!r}"))
    over, under = land[..., :-1] & ~land[..., 1:], land[..., 1:] & ~land[..., :-1]
    wrong = over if over.sum() < under.sum() else under
    if wrong.any():
        place = np.argwhere(wrong)[0][:2].tolist()
        names = ", ".join(axis.name for axis in level)
        where = ", ".join(f"{axis.edges[k]:g}" for axis, k in zip(level, place, strict=True))
        floor = up.edges[0 if wrong is under else -1]
        sentence = (
            f"land has water between it and the floor at '{up.name}' = {floor:g}, in "
            f"{int(wrong.any(-1).sum())} columns, first at ({names}) = ({where})"
        )
        hint = "mask= this water too, as that below a shelf of ice"
        raise ValueError(hinted(sentence, hint))


def gauge_of(gauge: str | None, what: str, axes: Sequence[Axis]) -> str:
    """Return the gauge asked for, or the one that a field has without."""
    if gauge is None:
        is_open = any(axis.bounds == "open" for axis in axes)
        return "given" if what == "potential" and is_open else "coulomb"
    if gauge not in ("coulomb", "given"):
        raise ValueError(f"gauge must be 'coulomb' or 'given', not {gauge!r}")
    if gauge == "given" and what != "potential":
        raise ValueError(f"gauge='given' is for potential=, and {what} has none")
    return gauge


def check_divergence(part: float, most: float, has_land: bool) -> None:
    """Warn of a divergence that was taken off, or refuse it."""
    if part > most:
        sentence = (
            f"the field is not divergence-free: {part:.1%} of it would have to be taken off, more "
            f"than {most:.1%}"
        )
        hint = (
            "look at units, at the order of axes and at periodic= and walls=, through which "
            "nothing may flow; or allow more with most_divergence="
        )
        if has_land:
            hint += ", as is usual of velocities that are not small beside land"
        raise ValueError(hinted(sentence, hint))
    if part > SILENT:
        warnings.warn(
            f"the field was not divergence-free: {part:.1%} of it was taken off", stacklevel=5
        )


def _points(name: str, given: ArrayLike) -> Array:
    own, points = np.asarray(given).dtype, _trace.numbers(given)
    if points is None or points.ndim != 1 or points.size < 2:
        raise TypeError(f"{name} must be an array of the nodes along the axis, not {given!r}")
    points = np.array(points, dtype=float)
    if not np.isfinite(points).all():
        raise ValueError(f"the nodes of {name} must be finite")
    steps = np.diff(points)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError(f"the nodes of {name} must all rise or all fall")
    ideal: Array = np.linspace(points[0], points[-1], points.size)
    is_even = np.ptp(steps) <= EQUAL * np.abs(steps).max()
    if not is_even and own.kind == "f":  # the type of the axis may have fewer digits than that
        off = LAST_DIGITS * float(np.finfo(own).eps) * np.abs(points).max()
        off = min(off, MOST_ROUNDED * np.abs(ideal[1] - ideal[0]))
        is_even = bool(np.abs(points - ideal).max() <= off)
    return ideal if is_even else points


def _with_period(name: str, points: Array, period: float | None, turn: Turn | None) -> Array:
    steps = np.diff(points)
    if np.ptp(steps) > EQUAL * steps.max():
        sentence = f"'{name}' is periodic, and its nodes are not equidistant"
        raise ValueError(hinted(sentence, "interpolate the data to equidistant nodes"))
    whole = (points[-1] - points[0]) * points.size / (points.size - 1)
    wanted = _turned(name, whole, period, turn) if turn else period
    if wanted is not None and abs(wanted - whole) > MEETS * steps[0]:
        unit = turn.unit if turn else ""
        sentence = f"'{name}' has period {wanted:g}{unit}, and its nodes one of {whole:g}{unit}"
        hint = "the last node is not the first one a period later"
        if abs(whole - steps[0] - wanted) <= MEETS * steps[0]:
            hint = "leave out the last node, which is the first one a period later"
        elif turn and any(abs(whole - x.length) <= MEETS * steps[0] for x in TURNS.values()):
            hint = turn.advice
        raise ValueError(hinted(sentence, hint))
    found: Array = np.linspace(points[0], points[0] + (wanted or whole), points.size + 1)
    return found


def _turned(name: str, whole: float, period: float | None, turn: Turn) -> float:
    """Return the period of an angle, a turn over a whole number; of longitudes one that is said."""
    count = round(turn.length / (period or whole))
    if period is None and turn.unit:
        return turn.length
    found = turn.length / max(count, 1)
    if period is not None and abs(period - found) > MEETS * found:
        sentence = f"'{name}' has a period of {turn.length:g}{turn.unit} over a whole number"
        raise ValueError(f"{sentence}, not {period:g}")
    return found


def _periods(periodic: Any, names: Mapping[str, Any]) -> dict[str, float | None]:
    if isinstance(periodic, Mapping):
        _named("periodic", tuple(periodic), names)
        return {name: float(period) for name, period in periodic.items()}
    return dict.fromkeys(_named("periodic", periodic, names))


def _named(what: str, given: Any, names: Mapping[str, Any]) -> tuple[str, ...]:
    if not isinstance(given, Iterable):
        raise TypeError(f"{what} must be names of axes such as {(*names,)[:1]!r}, not {given!r}")
    found = (given,) if isinstance(given, str) else tuple(given)
    for name in found:
        if name not in names:
            raise ValueError(f"{what} must be names of the axes {', '.join(names)}, not {name!r}")
    return found
