"""Functions of expressions that look numbers up, which tapes do in a search and an entry."""

from __future__ import annotations

import hashlib
import weakref
from typing import Any

import numpy as np

from liouville._basics import casadi as ca
from liouville._core import Column

#: The name of functions that look a number up begins with it.
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
        digests = (
            hashlib.blake2b(x.data, digest_size=4).hexdigest()
            for x in numbers_of(function)
            if x is not None
        )
        found = cls("_".join((LOOKUP, *digests)))
        found.function = function
        return found


class LookedUp:
    """The numbers of a function as tapes hold them, and the function; it is called with x.

    CasADi has no forward derivative of a call that is not inlined. Its value goes through ``floor``
    therefore, whose derivative is zero: whole numbers are looked up, and divided by a power of two.

    Attributes
    ----------
    starts, column : Column
        Where pieces start, and the number of each; no starts where x is the number of the piece.
    """

    def __init__(
        self, name: str, piece: ca.MX, x: ca.MX, starts: Column | None, column: np.ndarray
    ):
        exponents = np.frexp(column[column != 0])[1]
        shift = np.clip(53 - exponents.min(initial=53), 0, 1022 - exponents.max(initial=0))
        self._shift, whole = int(shift), np.rint(np.ldexp(column, shift))
        value: Any = ca.MX(ca.DM(whole))[piece]
        constant: Any = {"never_inline": True, "is_diff_in": [False], "is_diff_out": [False]}
        self._function = ca.Function(name, [x], [value], constant)
        self.starts, self.column = starts, Column(whole)

    def __call__(self, x: ca.SX) -> ca.SX:
        """Look a number up."""
        whole = ca.floor(self._function.call([x], False, True)[0])
        found: ca.SX = float(np.ldexp(1.0, -self._shift)) * whole
        return found

    def other(self, column: np.ndarray) -> Column | None:
        """Return other numbers as tapes have them in place of these; None where they overflow."""
        scaled = np.ldexp(column, self._shift)
        return Column(scaled) if np.isfinite(scaled).all() else None


#: Those there are, by the names of their functions.
_KNOWN: weakref.WeakValueDictionary[str, LookedUp] = weakref.WeakValueDictionary()


def lookups(what: str, starts: np.ndarray, *columns: np.ndarray) -> list[LookedUp]:
    """Make functions that look numbers up: ``column[i]``, where i starts are not above x.

    Each is one call within an expression, and two operations of a tape, however many numbers there
    are. Functions of the same name and place have one column if their numbers are the same.

    Parameters
    ----------
    what : str
        A name, for which there are columns apart.
    starts : ndarray, shape (k,)
        Increasing.
    *columns : ndarray, shape (k + 1,)
        The numbers.
    """
    x = ca.MX.sym("x")
    piece = ca.low(ca.MX(ca.DM([-np.inf, *starts, np.inf])), x)
    found = []
    for k, column in enumerate(columns):
        digest = hashlib.blake2b(f"{what}[{k}]".encode(), digest_size=16)
        for numbers in (starts, column):
            digest.update(numbers.data)
        name = f"{LOOKUP}_{digest.hexdigest()}"
        own = _KNOWN.get(name)
        if own is None:
            own = _KNOWN[name] = LookedUp(name, piece, x, column_of(starts), column)
        found.append(own)
    return found


def gathered(column: np.ndarray) -> LookedUp:
    """Make a function that looks up the number at a place of a column, a whole number from 0."""
    x = ca.MX.sym("x")
    digest = hashlib.blake2b(column.data, digest_size=16).hexdigest()
    name = f"{LOOKUP}_{digest}"
    own = _KNOWN.get(name)
    if own is None:
        own = _KNOWN[name] = LookedUp(name, x, x, None, column)
    return own


def numbers_of(lookup: ca.Function) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the starts, if there are any, and the column of a function that looks numbers up."""
    each = range(lookup.n_instructions())
    constants = (k for k in each if lookup.instruction_id(k) == ca.OP_CONST)
    found = [lookup.instruction_MX(k).to_DM().full().ravel() for k in constants]
    column, starts = sorted(found, key=len)
    return starts[1:-1].copy(), column


def columns_of(lookup: ca.Function) -> tuple[Column | None, Column]:
    """Return the starts and the column of a function as the core holds them."""
    known = _KNOWN.get(lookup.name())
    if known is not None:
        return known.starts, known.column
    starts, column = numbers_of(lookup)
    return None if starts is None else column_of(starts), column_of(column)


def column_of(column: np.ndarray) -> Column:
    """Return the column as the core holds it, the same for the same numbers."""
    digest = hashlib.blake2b(column.data).digest()
    found = _COLUMNS.get(digest)
    if found is None:
        found = _COLUMNS[digest] = Column(column)
    return found
