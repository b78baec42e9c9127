"""The divergence of a field: refused, or repaired where rounding made it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from liouville._basics.errors import hinted
from liouville._systems.fields.terms import Terms

#: Rounding changes a divergence by at most this part of what it is made of.
REPAIRED = 1e-3

#: How many monomials a message names.
NAMED = 5


def check_divergence(terms: Terms, names: Sequence[str]) -> None:
    """Refuse terms whose divergence does not vanish.

    Raises
    ------
    ValueError
        The message has the monomials of the divergence.
    """
    left = terms.excess()
    if not len(left):
        return
    words = [_written(value, left.written(m, names)) for m, value in left.monomials()]
    more = f" and {len(words) - NAMED} more" if len(words) > NAMED else ""
    sentence = f"the field is not divergence-free: div f contains {', '.join(words[:NAMED])}{more}"
    hint = "look for a sign or a missing term"
    if terms.imbalance()[0] <= REPAIRED:
        hint = "if the coefficients were rounded, from_terms(..., repair=True) mends them"
    raise ValueError(hinted(sentence, hint))


def check_rounding(terms: Terms, names: Sequence[str]) -> None:
    """Refuse to repair a divergence that rounding cannot have made; ValueError names its size."""
    part, monomial, value = terms.imbalance()
    if part > REPAIRED:
        raise ValueError(
            hinted(
                f"repair=True mends rounding, up to {REPAIRED:g} of the terms, and div f contains "
                f"{_written(value, terms.written(monomial, names))}, {part:.3g} of its terms",
                "look for a sign or a missing term, or give the coefficients more digits",
            )
        )


def _written(value: Any, monomial: str) -> str:
    number = f"{value:.6g}" if isinstance(value, float) else str(value)
    return number if monomial == "1" else f"{number} * {monomial}"
