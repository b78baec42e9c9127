"""Functions of expressions that look numbers up, which tapes do in a search and an entry."""

from __future__ import annotations

import hashlib
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from liouville import _casadi as ca
from liouville._core import Column

#: The name of functions that look a number up.
LOOKUP = "lookup"
#: The columns of numbers that tapes hold, each once: by their digest.
_COLUMNS: weakref.WeakValueDictionary[bytes, Column] = weakref.WeakValueDictionary()


class Lookup(str):
    """The name of an operation that looks a number up, which has the numbers in it.

    Attributes
    ----------
    function : Function
        CasADi's function.
    """

    function: ca.Function

    @classmethod
    def of(cls, function: ca.Function) -> Lookup:
        """Name a function by its numbers."""
        digests = (hashlib.blake2b(x.data, digest_size=4).hexdigest() for x in numbers_of(function))
        found = cls("_".join((LOOKUP, *digests)))
        found.function = function
        return found


def lookups(starts: np.ndarray, *columns: np.ndarray) -> list[Callable[[ca.SX], ca.SX]]:
    """Make functions that look numbers up: ``column[i]``, where i starts are not above x.

    Each is one call within an expression, and two operations of a tape, however many numbers there
    are. CasADi has no forward derivative of such a call. Its value goes through ``floor``
    therefore, whose derivative is zero: whole numbers are looked up, and divided by a power of two.

    Parameters
    ----------
    starts : ndarray, shape (k,)
        Increasing.
    *columns : ndarray, shape (k + 1,)
        The numbers.
    """
    x = ca.MX.sym("x")
    piece = ca.low(ca.MX(ca.DM([-np.inf, *starts, np.inf])), x)
    constant: Any = {"never_inline": True, "is_diff_in": [False], "is_diff_out": [False]}
    found = list[Callable[[ca.SX], ca.SX]]()
    for column in columns:
        exponents = np.frexp(column[column != 0])[1]
        shift = np.clip(53 - exponents.min(initial=53), 0, 1022 - exponents.max(initial=0))
        whole = np.rint(np.ldexp(column, shift))
        value: Any = ca.MX(ca.DM(whole))[piece]
        function = ca.Function(LOOKUP, [x], [value], constant)
        found.append(partial(_looked_up, function, float(np.ldexp(1.0, -shift))))
    return found


def _looked_up(function: ca.Function, factor: float, x: ca.SX) -> ca.SX:
    found: ca.SX = factor * ca.floor(function.call([x], False, True)[0])
    return found


def numbers_of(lookup: ca.Function) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts and the column of a function that looks numbers up."""
    each = range(lookup.n_instructions())
    constants = (k for k in each if lookup.instruction_id(k) == ca.OP_CONST)
    found = [lookup.instruction_MX(k).to_DM().full().ravel() for k in constants]
    column, starts = sorted(found, key=len)
    return starts[1:-1].copy(), column


def column_of(column: np.ndarray) -> Column:
    """Return the column as the core holds it, the same for the same numbers."""
    digest = hashlib.blake2b(column.data).digest()
    found = _COLUMNS.get(digest)
    if found is None:
        found = _COLUMNS[digest] = Column(column)
    return found
