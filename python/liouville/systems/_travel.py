"""How systems travel: pickled small, without the functions that they were made of.

Their tapes go along as they are, and nothing is traced or differentiated where they arrive.
Expressions go along as one function of CasADi's, which is read when something new is wanted of
them.
"""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Sequence
from typing import Any, Self

import casadi as ca

from liouville.errors import hinted

PROTOCOL = 5


class Travels:
    """What pickles as the compressed pickle of its luggage."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how it is made again where it arrives."""
        try:
            luggage = pickle.dumps(self._luggage(), PROTOCOL)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise TypeError(
                hinted(
                    f"{self!r} cannot be pickled: {error}",
                    "what makes products, and what a class of your own adds, travels only if it "
                    "can be pickled itself; define it in a module, at its top level",
                )
            ) from error
        return arrived, (type(self), zlib.compress(luggage))

    def __copy__(self) -> Self:
        """Return another that shares everything."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def _luggage(self) -> dict[str, Any]:
        """Return what travels, by default all attributes."""
        return dict(self.__dict__)

    def _unpack(self, luggage: dict[str, Any]) -> None:
        """Take over what has travelled."""
        self.__dict__.update(luggage)


def arrived(kind: type[Travels], luggage: bytes) -> Travels:
    """Make what has travelled."""
    found = object.__new__(kind)
    found._unpack(pickle.loads(zlib.decompress(luggage)))
    return found


def packed(symbols: Sequence[ca.SX], expressions: Sequence[ca.SX]) -> str:
    """Write expressions of some symbols down."""
    function: str = ca.Function("travelling", [*symbols], [*expressions]).serialize()
    return function


def opened(text: str, symbols: Sequence[ca.SX]) -> list[ca.SX]:
    """Return expressions that :func:`packed` wrote, of other symbols."""
    found: list[ca.SX] = ca.Function.deserialize(text).call([*symbols])
    return found
