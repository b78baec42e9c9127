"""Operators, states and drives as QuTiP and QuSpin have them, read without importing these."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import hinted
from liouville._systems.tracing.trace import Parameters, numbers
from liouville._systems.waves import envelopes
from liouville._systems.waves.entries import MESOLVE
from liouville._systems.waves.entries import numbers as array_of

#: Pairs of a function of time and a matrix.
Drive = list[tuple[Any, Any]]

#: The fewest samples of a function.
FEWEST = 2

#: Orders of what stands for samples, the default first.
ORDERS = (3, 0)

#: A run may leave the times of samples by so much of their distance: these may be midpoints.
ROOM = 0.5 + 1e-9


def points_of(given: Any) -> tuple[float, ...]:
    """Read times in any order; TypeError or ValueError where they are none."""
    found = array_of("points", given) if np.size(given) else np.zeros(0)
    if found.ndim != 1 or found.dtype.kind not in "iuf" or not np.isfinite(found).all():
        raise ValueError(f"points must be a list of times, not {given!r:.60}")
    return tuple(np.unique(found).astype(float).tolist())


def plain(name: str, given: Any) -> Any:
    """Return SciPy's or NumPy's form of an operator or state of QuTiP's or QuSpin's.

    Raises
    ------
    TypeError
        It is of another kind of theirs: a superoperator, or depends on time.
    """
    if _is_qobj(given):
        if given.type not in ("oper", "ket"):
            hint = f"density matrices are not stepped: {MESOLVE}"
            raise TypeError(hinted(f"{name} is a Qobj of type {given.type!r}", hint))
        if given.type == "ket":
            return np.asarray(given.full()).ravel()
        sparse = getattr(given.data, "as_scipy", None)  # of QuTiP 5; a dense one has none
        return given.full() if sparse is None else sparse()
    if hasattr(given, "to_list") and hasattr(given, "isconstant"):
        hint = "give the list it was made of, [H0, [H1, f], [H2, samples]], or lambda t: H(t)"
        raise TypeError(hinted(f"{name} is a QobjEvo, whose functions are compiled", hint))
    if hasattr(given, "static") and hasattr(given, "dynamic"):
        if given.dynamic:
            hint = f"give {name}.static, and the others with functions of time as drive="
            sentence = f"{name} has {len(given.dynamic)} parts that depend on time"
            raise TypeError(hinted(sentence, hint))
        return given.static
    return given


def _is_qobj(given: Any) -> bool:
    return all(hasattr(given, name) for name in ("dims", "full", "data", "isket"))


def state(psi: Any, size: int, is_ensemble: bool) -> Any:
    """Return a state of QuTiP's, or a list of them, or a column, as NumPy has it."""
    if isinstance(psi, (list, tuple)) and psi and all(map(_is_qobj, psi)):
        return np.array([plain("psi", one) for one in psi])
    if _is_qobj(psi) and not psi.isket:
        hint = f"density matrices are not stepped: {MESOLVE}"
        raise TypeError(hinted(f"psi must be a ket, not a Qobj of type {psi.type!r}", hint))
    found = plain("psi", psi)
    if not is_ensemble and getattr(found, "shape", None) == (size, 1):
        return np.asarray(found).ravel()
    return found


def parted(
    hamiltonian: Any,
    drive: Sequence[Any],
    times: ArrayLike | None,
    order: int,
    params: Parameters,
) -> tuple[Any, list[Any]]:
    """Return H without time, and pairs of a function and a matrix.

    ``[H0, [H1, f], [H2, samples]]`` is a Hamiltonian as QuTiP has it. A sequence of samples at
    `times` stands for its spline, or of order 0 for values between times.
    """
    if isinstance(order, bool) or order not in ORDERS:
        hint = "3 is the cubic spline through samples, 0 values that hold to the next time"
        raise ValueError(hinted(f"order must be 0 or 3, not {order!r}", hint))
    pairs: list[Any] = list(drive)
    if _is_listed(hamiltonian):
        still = [part for part in hamiltonian if not _is_pair(part)]
        moved = [part for part in hamiltonian if _is_pair(part)]
        for part in still:
            if isinstance(part, (list, tuple)) and any(map(callable, part)):
                sentence = f"the list H must have operators and pairs [H1, f], not {part!r}"
                raise TypeError(hinted(sentence, "the operator is the first of two"))
        pairs = [(_of_list(f), matrix) for matrix, f in moved] + pairs
        matrices = [plain("H", part) for part in still]
        if matrices:
            hamiltonian = sum(matrices[1:], start=matrices[0])
        elif moved:
            hamiltonian = 0 * plain("H1", moved[0][0])
    at = None if times is None else _times(times)
    read = []
    for k, pair in enumerate(pairs):
        if not (isinstance(pair, (tuple, list)) and len(pair) == 2):
            raise TypeError(f"drive[{k}] must be a pair of a function and a matrix, not {pair!r}")
        function, matrix = pair
        if _is_operator(function):
            sentence = f"drive[{k}] must be a pair (function, matrix), not (matrix, function)"
            hint = "turn it round; a list [H0, [H1, f]] as the Hamiltonian has QuTiP's order"
            raise TypeError(hinted(sentence, hint))
        if isinstance(function, str):
            hint = "write it as a function of t and params, with ca.cos and ca.exp"
            raise TypeError(hinted(f"drive[{k}] is the text {function!r}", hint))
        read.append((function, plain(f"H{k + 1}", matrix)))
    found = []
    for k, (function, matrix) in enumerate(envelopes.taken_apart(read, params)):
        if isinstance(function, (np.ndarray, list, tuple)):
            function = Samples(f"drive[{k}]", function, at, order)
        found.append((function, matrix))
    if at is not None and not any(isinstance(function, Samples) for function, _ in found):
        raise TypeError("times are those of samples, and no drive has any")
    if order != ORDERS[0] and at is None:
        raise TypeError("order is that of samples, and no drive has any")
    return plain("H", hamiltonian), found


def resampled(drive: Drive, samples: Mapping[str, ArrayLike]) -> Drive:
    """Return pairs with other samples at the same times, by names such as ``drive[0]``."""
    return [
        (Samples(name, samples[name], function.table.x, function.order), matrix)
        if (name := f"drive[{k}]") in samples
        else (function, matrix)
        for k, (function, matrix) in enumerate(drive)
    ]


def _is_listed(given: Any) -> bool:
    """Return whether this is a list of operators and of pairs, and no matrix as nested lists."""
    if not isinstance(given, list) or not given:
        return False
    return any(_is_pair(part) or _is_operator(part) for part in given)


def _is_operator(given: Any) -> bool:
    if isinstance(given, np.ndarray):
        return given.ndim == 2
    return _is_qobj(given) or hasattr(given, "tocsr") or hasattr(given, "static")


def _is_pair(given: Any) -> bool:
    return isinstance(given, (list, tuple)) and len(given) == 2 and _is_operator(given[0])


def _of_list(function: Any) -> Any:
    """Return a function of t and params from one of t alone, of t and a dict, or of t and names."""
    if not callable(function):
        return function
    try:
        _, *known = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # of some functions that are not written in Python
        return function
    known = [one for one in known if one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD)]
    names = tuple(one.name for one in known)
    if names == ("params",):
        return function
    return Named(function, names, tuple(one.name for one in known if one.default is not one.empty))


class Named:
    """A function of t and of some parameters by name, or of t and a dict ``args`` of all.

    A name with a default that no parameter has keeps it.
    """

    def __init__(
        self, function: Callable[..., Any], names: tuple[str, ...], optional: tuple[str, ...]
    ) -> None:
        self.function, self.names, self.optional = function, names, optional

    def __call__(self, t: Any, params: Any) -> Any:
        """Call it with these parameters."""
        given = vars(params)
        if self.names == ("args",):
            return self.function(t, dict(given))
        needed = [getattr(params, name) for name in self.names if name not in self.optional]
        more = {name: given[name] for name in self.optional if name in given}
        return self.function(t, *needed, **more)


class Samples:
    """The spline through samples, which has an error of the fourth order in their distance.

    Of order 0 a sample holds up to the next time; there may be one fewer than times.

    Raises
    ------
    TypeError, ValueError
        There are no times, or not as many, or the samples are complex.
    """

    def __init__(self, name: str, samples: Any, times: np.ndarray | None, order: int = 3) -> None:
        self.order = order
        values = array_of(f"the function of {name}", samples)
        if times is None:
            hint = "give times=, or a function of t and params"
            raise TypeError(
                hinted(f"{name} is made of samples, and their times are not given", hint)
            )
        if values.dtype.kind == "c":
            if values.imag.any():
                hint = "z K + h.c. has complex samples z with a K that is not Hermitian"
                raise ValueError(hinted(f"the samples of {name} are complex", hint))
            values = values.real
        fewest = times.size - (order == 0)
        if values.shape not in (times.shape, (fewest,)):
            sentence = f"{name} has samples of shape {values.shape}"
            slots = f", with {fewest} slots between them" * (order == 0)
            raise ValueError(f"{sentence}, and there are {times.size} times{slots}")
        with np.errstate(over="ignore"):  # of longer types, which are infinite then
            values = values.astype(float)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            which = f"sample {bad[0]} of {name}, at t = {times[bad[0]]:g},"
            raise ValueError(f"{which} must be a finite number, not {values[bad[0]]}")
        from liouville._systems.tracing.table import steps, table

        if order == 0:
            self.table = replace(steps(times, values), name=name)
            return
        ends = "not-a-knot" if times.size > 3 else "natural"
        self.table = replace(table(times, values, ends=ends), name=name)

    def __call__(self, t: Any, params: Any) -> Any:
        """Return the spline's value."""
        return self.table(t)


def check_sampled(drive: Drive, start: float, end: float) -> None:
    """Refuse a run outside the times of samples, where splines go on straight."""
    t0, t1 = sorted((start, end))
    for k, (function, _) in enumerate(drive):
        if not isinstance(function, Samples):
            continue
        first, second, before, last = function.table.x[[0, 1, -2, -1]]
        room = ROOM if function.order else ROOM - 0.5
        if t0 < first - room * (second - first) or t1 > last + room * (last - before):
            run = f"{start:g}" if start == end else f"({start:g}, {end:g})"
            sentence = f"t = {run} leaves the samples of drive[{k}]"
            hint = "integrate within them, or give samples beyond, such as zeros after a pulse"
            raise ValueError(hinted(f"{sentence}, which are from {first:g} to {last:g}", hint))


def times_of_samples(drive: Drive, order: int) -> tuple[float, ...]:
    """Return the times of all samples of an order, in order."""
    given = (function for function, _ in drive if isinstance(function, Samples))
    found = [function.table.x for function in given if function.order == order]
    return tuple(np.unique(np.concatenate(found)).tolist()) if found else ()


def _times(times: ArrayLike) -> np.ndarray:
    found = numbers(times)
    if found is None or found.ndim != 1:
        raise TypeError(f"times must be an array of the times of samples, not {times!r}")
    if found.size < FEWEST:
        raise ValueError(f"times must be {FEWEST} at least, not {found.size}")
    if not np.isfinite(found).all():
        k = int(np.argmin(np.isfinite(found)))
        raise ValueError(f"times[{k}] must be a finite number, not {found[k]}")
    if not (np.diff(found) > 0).all():
        k = int(np.argmin(np.diff(found) > 0))
        sentence = f"times must increase: times[{k}] = {found[k]:g} is followed by {found[k + 1]:g}"
        raise ValueError(hinted(sentence, "sort times and samples together, each time once"))
    return found
