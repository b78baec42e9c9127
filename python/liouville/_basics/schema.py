"""Kinds of values that entries of a file must have, and a reader that checks them.

A file may come from anybody. Each entry is read by :func:`entry`, so that one of another kind ends
in a sentence with the file, the entry and what it must be.
"""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np

#: No whole number of a file is larger.
LARGEST = 2**63 - 1


@dataclass(frozen=True)
class Kind:
    """A kind of value: what it is called, and whether a value is one."""

    words: str
    fits: Callable[[Any], bool]


def integers(least: int) -> Kind:
    """Return the kind of whole numbers from `least` on."""
    return Kind(
        f"a whole number of at least {least}",
        lambda x: (
            isinstance(x, Integral) and not isinstance(x, bool) and least <= int(x) <= LARGEST
        ),
    )


def one_of(*values: Any) -> Kind:
    """Return the kind of a few values."""
    *most, last = map(repr, values)
    return Kind(
        f"{', '.join(most)} or {last}" if most else last,
        lambda x: type(x) is type(values[0]) and x in values,
    )


def some_of(*values: str) -> Kind:
    """Return the kind of lists of some of a few words, each at most once."""
    words = ", ".join(map(repr, values))
    return Kind(
        f"a list of some of {words}",
        lambda x: NAMES.fits(x) and set(x) <= set(values),
    )


def either(*kinds: Kind) -> Kind:
    """Return the kind of values of one of several kinds."""
    words = " or ".join(kind.words for kind in kinds)
    return Kind(words, lambda x: any(kind.fits(x) for kind in kinds))


def lists(of: Kind) -> Kind:
    """Return the kind of lists of a kind."""
    return Kind(
        f"a list whose entries are each {of.words}",
        lambda x: isinstance(x, list | tuple) and all(map(of.fits, x)),
    )


def rows(*kinds: Kind) -> Kind:
    """Return the kind of lists with one entry of each of several kinds."""
    return Kind(
        f"a list of {', '.join(kind.words for kind in kinds)}",
        lambda x: (
            isinstance(x, list | tuple)
            and len(x) == len(kinds)
            and all(kind.fits(each) for kind, each in zip(kinds, x, strict=True))
        ),
    )


def mappings(of: Kind, *, by_number: bool = False) -> Kind:
    """Return the kind of mappings from names, or numbers in digits, to a kind."""
    keys = "numbers" if by_number else "names"
    return Kind(
        f"a mapping of {keys} whose values are each {of.words}",
        lambda x: (
            isinstance(x, Mapping)
            and all(
                isinstance(key, str) and (not by_number or (key.isascii() and key.isdigit()))
                for key in x
            )
            and all(map(of.fits, x.values()))
        ),
    )


TEXT = Kind("text", lambda x: isinstance(x, str))
NUMBER = Kind(
    "a number",
    lambda x: isinstance(x, float | np.floating) or integers(-LARGEST).fits(x),
)
BOUNDS = Kind(
    "two finite numbers in order",
    lambda x: rows(NUMBER, NUMBER).fits(x) and -math.inf < x[0] <= x[1] < math.inf,
)
NAMES = Kind(
    "a list of different names",
    lambda x: lists(TEXT).fits(x) and len(set(x)) == len(x),
)


def _are_numbers(x: Any) -> bool:
    return NUMBER.fits(x) or (isinstance(x, list) and all(map(_are_numbers, x)))


#: Numbers, and lists of them within lists to any depth that JSON has.
NUMBERS = Kind("a number or a list of numbers", _are_numbers)
MAPPING = Kind("a mapping", lambda x: isinstance(x, Mapping))


def checked(value: Any, kind: Kind, what: str) -> Any:
    """Return a value of a kind; ValueError says what must be what, not what."""
    try:
        is_one = kind.fits(value)
    except RecursionError:
        is_one = False
    if not is_one:
        raise ValueError(f"{what} must be {kind.words}, not {reprlib.repr(value)}")
    return value


def entry(holder: Mapping[str, Any], key: str, kind: Kind, where: str) -> Any:
    """Return an entry of a mapping; ValueError where it is missing or of another kind."""
    if key not in holder:
        raise ValueError(f"{where} has no {key!r}")
    return checked(holder[key], kind, f"{key!r} of {where}")


def parsed(text: Any, what: str) -> Any:
    """Return the value of a JSON text; ValueError where the text is no JSON."""
    checked(text, TEXT, what)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{what} holds no JSON ({error})") from error
