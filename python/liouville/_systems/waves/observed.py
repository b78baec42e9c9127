"""States as they are given, and what is observed of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted, misshapen
from liouville._systems.tracing import trace as _trace
from liouville._systems.waves.bounds import check_symmetric
from liouville._systems.waves.entries import LARGEST, MESOLVE, Entries, numbers, of_size
from liouville._systems.waves.foreign import plain
from liouville._systems.waves.forms import operators
from liouville._systems.waves.frame import Frame, doubled
from liouville._systems.waves.products import Product

#: The name of an observable, how many numbers it has, and what the core makes of each.
Observable = tuple[str, int, list[tuple[Any, ...]]]


def without_grid(name: str) -> str:
    """Return the sentence on a function of positions where there are none."""
    sentence = f"observable '{name}' is a function, and there is no grid to take it on"
    hint = "give a matrix A for <psi|A|psi>, its diagonal, or a state phi for <phi|psi>"
    return hinted(sentence, hint)


def checked(psi: Any, shapes: Sequence[tuple[int, ...]], is_ensemble: bool) -> np.ndarray:
    """Return a state as a flat complex array, or states as its rows."""
    array = numbers("psi", psi)
    extra = 1 if is_ensemble else 0
    if array.ndim < extra or array.shape[extra:] not in shapes or not array.size:
        wanted = " or ".join(f"(P, {', '.join(map(str, s))})" if extra else str(s) for s in shapes)
        hint = ""
        size = math.prod(shapes[0])
        if array.shape == (size, size) and not extra:
            hint = f"density matrices are not stepped: {MESOLVE}"
        elif array.shape[1 - extra :] in shapes:
            hint = f"lv.{'integrate takes one state' if extra else 'ensemble takes many'}"
        raise misshapen("psi", array.shape, wanted, hint)
    flat = array.reshape(*array.shape[:extra], -1)
    bad = np.argwhere(~np.isfinite(flat))
    if bad.size:
        place = tuple(bad[0].tolist())
        raise ValueError(f"psi[{', '.join(map(str, place))}] must be finite, not {flat[place]}")
    zero = np.flatnonzero(~flat.any(axis=-1))
    if zero.size:
        member = f" of member {zero[0]}" if is_ensemble else ""
        raise ValueError(f"psi{member} is zero: there is no state")
    with np.errstate(over="ignore"):
        sizes = np.atleast_1d(np.abs(flat).max(axis=-1)).astype(np.longdouble)
    far = np.flatnonzero((sizes > LARGEST) | (sizes < 1 / LARGEST))
    if far.size:
        member = f" of member {far[0]}" if is_ensemble else ""
        sentence = (
            f"psi{member} is of size {of_size(sizes[far[0]])}, and the square of that is out of "
            "range"
        )
        raise ValueError(hinted(sentence, "start with psi / abs(psi).max()"))
    return flat


def portable(
    observe: Mapping[str, Any] | None, at_points: Callable[[str, Callable[..., Any]], np.ndarray]
) -> dict[str, Any]:
    """Return observables that can be pickled: functions of position by their values."""
    found = _trace.mapping("observe", observe)
    for name, given in found.items():
        found[name] = given = plain(f"observable '{name}'", given)
        is_operator = hasattr(given, "matvec") or isinstance(given, tuple)
        if callable(given) and not is_operator:
            found[name] = at_points(name, given)
    return found


def observables(
    observe: Mapping[str, Any] | None,
    frame: Frame,
    shapes: Sequence[tuple[int, ...]],
    at_points: Callable[[str, Callable[..., Any]], np.ndarray],
) -> list[Observable]:
    """Return the observables in the form of the core."""
    found = []
    for name, given in portable(observe, at_points).items():
        what = f"observable '{name}'"
        is_operator = hasattr(given, "matvec") or isinstance(given, tuple)
        if is_operator or hasattr(given, "tocsr"):
            found.append((name, *_expectation(what, given, frame)))
            continue
        array = numbers(what, given)
        if array.shape in shapes:
            found.append((name, *_of_array(what, array.ravel(), frame)))
        elif array.shape == (frame.size, frame.size):
            found.append((name, *_expectation(what, array, frame)))
        else:
            wanted = " or ".join(map(str, [*shapes, (frame.size, frame.size)]))
            raise misshapen(what, array.shape, wanted)
    return found


def _of_array(what: str, array: np.ndarray, frame: Frame) -> tuple[int, list[tuple[Any, ...]]]:
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise ValueError(f"{what} must be finite, not {array[bad[0]]} in place {bad[0]}")
    if array.dtype.kind != "c":
        return 1, [("diagonal", frame.diagonal(array.astype(float)))]
    phi = frame.inward(array)
    return 2, [("overlap", phi.real.copy(), phi.imag.copy())]


def _expectation(what: str, given: Any, frame: Frame) -> tuple[int, list[tuple[Any, ...]]]:
    """Return an expectation value: two real ones where A = B + iC is not Hermitian."""
    product = Product.read(what, given)
    if product is not None:
        if frame.order is not None or frame.gauge is not None:
            sentence = f"{what} is known by its products only, and H has been transformed"
            raise TypeError(hinted(sentence, "give it as a matrix"))
        known = _core.Hamiltonian([product.operator(1.0)], not product.is_real)
        check_symmetric(what, known, "give it as a matrix, whose value is complex")
        return 1, [("symmetric", known)]
    matrix = Entries.read_any(what, given)
    if matrix.n != frame.size:
        raise ValueError(f"{what} must have order {frame.size} as H has, not {matrix.n}")
    halves = matrix.halves()
    return len(halves), [_symmetric(half, frame) for half in halves]


def _symmetric(matrix: Entries, frame: Frame) -> tuple[Any, ...]:
    inside = frame.entries(matrix)
    if inside.is_real:
        return ("symmetric", _core.Hamiltonian(operators(inside)))
    return ("symmetric", _core.Hamiltonian(operators(doubled(inside)), True))
