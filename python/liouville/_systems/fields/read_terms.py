"""Terms as a user gives them, one by one or as arrays, checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from liouville._basics.errors import hinted, misshapen
from liouville._systems.fields.terms import Terms

#: Larger powers are a slip of the pen.
MOST_FACTORS = 100

#: The name of the time, where no coordinate has it.
TIME = "t"

_FORM = hinted(
    "term {k} must be (component, coefficient, variables), not {row!r}",
    "the variables of x*y**2 are ('x', 'y', 'y'), or {{'x': 1, 'y': 2}}",
)


def read(names: Sequence[str], given: Any) -> tuple[Terms, bool]:
    """Read the terms of a field, and whether the time is among its variables, as the last."""
    is_triple = isinstance(given, tuple) and len(given) == 3
    if is_triple and all(isinstance(array, np.ndarray) for array in given):
        return _arrays(names, *given), False
    if isinstance(given, (str, Mapping)) or not isinstance(given, Iterable):
        raise TypeError(f"terms must be (component, coefficient, variables), not {given!r}")
    return _rows(names, given)


def _arrays(
    names: Sequence[str], component: np.ndarray, coefficient: np.ndarray, variables: np.ndarray
) -> Terms:
    n, count = len(names), component.size
    if component.ndim != 1 or coefficient.shape != (count,) or variables.shape[:1] != (count,):
        shapes = ", ".join(str(x.shape) for x in (component, coefficient, variables))
        raise ValueError(f"the arrays of terms must have shapes (N,), (N,), (N, d), not {shapes}")
    if variables.ndim != 2:
        raise misshapen("the variables of terms", variables.shape, "(N, d)")
    for what, array, least in (("component", component, 0), ("variable", variables, -1)):
        if array.dtype.kind not in "iu":
            raise TypeError(f"a {what} must be an index, and the array is of {array.dtype}")
        outside = np.argwhere((array < least) | (array >= n))
        if outside.size:
            place = tuple(outside[0])
            raise ValueError(_out_of_range(int(place[0]), what, int(array[place]), n))
    if coefficient.dtype == object:
        coefficient = np.array([_coefficient(k, c) for k, c in enumerate(coefficient)], object)
        return Terms(n, component, coefficient, variables).merged()
    if coefficient.dtype.kind not in "iuf":
        raise TypeError(f"coefficients must be real numbers, not of {coefficient.dtype}")
    bad = np.flatnonzero(~np.isfinite(coefficient))
    if bad.size:
        raise ValueError(
            f"the coefficient of term {bad[0]} must be finite, not {coefficient[bad[0]]}"
        )
    return Terms(n, component, coefficient, variables).merged()


def _rows(names: Sequence[str], given: Iterable[Any]) -> tuple[Terms, bool]:
    n, index = len(names), {name: k for k, name in enumerate(names)}
    index.setdefault(TIME, n)
    rows, has_time = [], False
    for k, row in enumerate(given):
        if isinstance(row, str) or not isinstance(row, Sequence) or len(row) != 3:
            raise TypeError(_FORM.format(k=k, row=row))
        component = _place(k, "component", row[0], index, n)
        if component == n:
            raise ValueError(f"term {k} has the component '{TIME}', which is no coordinate")
        factors = [
            place
            for variable, exponent in _powers(k, row)
            for place in [_place(k, "variable", variable, index, n)] * exponent
        ]
        has_time |= n in factors
        rows.append((component, _coefficient(k, row[1]), factors))
    if has_time:
        rows.append((n, Fraction(1), []))
    return Terms.of(n + has_time, rows), has_time


def _powers(k: int, row: Sequence[Any]) -> list[tuple[Any, int]]:
    """Return variables with their exponents."""
    variables = row[2]
    if isinstance(variables, str):
        return [(variables, 1)]
    if not isinstance(variables, Mapping):
        if not isinstance(variables, Iterable):
            raise TypeError(_FORM.format(k=k, row=row))
        return [(variable, 1) for variable in variables]
    for variable, exponent in variables.items():
        if isinstance(exponent, int) and exponent > MOST_FACTORS:
            raise ValueError(
                f"term {k} has {variable!r} to the power of {exponent}: no more than {MOST_FACTORS}"
            )
        is_natural = isinstance(exponent, (int, np.integer)) and exponent >= 0
        if not is_natural or isinstance(exponent, bool):
            raise ValueError(
                f"the power of {variable!r} in term {k} must be 0, 1, 2, ..., not {exponent}"
            )
    return [(variable, int(exponent)) for variable, exponent in variables.items()]


def _place(k: int, what: str, value: Any, index: Mapping[str, int], n: int) -> int:
    if isinstance(value, str):
        if value not in index:
            known = ", ".join([*index][: min(n, 8)]) + (", ..." if n > 8 else "")
            raise ValueError(
                hinted(
                    f"term {k} has the {what} '{value}', which is no coordinate",
                    f"they are {known}",
                )
            )
        return index[value]
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"the {what} of term {k} must be an index or a name, not {value!r}")
    if not 0 <= value < n:
        raise ValueError(_out_of_range(k, what, int(value), n))
    return int(value)


def _out_of_range(k: int, what: str, value: int, n: int) -> str:
    return f"term {k} has the {what} {value}: the {n} coordinates are numbered from 0"


def _coefficient(k: int, value: Any) -> Fraction | float:
    """Return a float as it is, and all else as a fraction."""
    try:
        if isinstance(value, (bool, np.bool_, complex)):
            raise TypeError
        if isinstance(value, (float, np.floating)):
            if not np.isfinite(value):
                raise ValueError
            return float(value)
        exact = Fraction(value.item() if isinstance(value, np.generic) else value)
        float(exact)  # must have one
        return exact
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        wanted = "a finite number, a fraction or a string such as '-3/8'"
        raise ValueError(f"the coefficient of term {k} must be {wanted}, not {value!r}") from None
