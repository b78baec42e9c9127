"""Factors that are any function of some variables, as tapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from liouville._core import Tape


@dataclass(frozen=True)
class Function:
    """A function of the variables at some places.

    Attributes
    ----------
    places : tuple of int
        The variables, ascending.
    key : Any
        Equal for equal functions of a field.
    text : str
        The function in the user's names.
    value, slopes : Tape
        Its value, or several of which it is one, and the partial derivatives of all, by rows.
    guards : Tape
        Numbers that change their sign only where it is singular.
    output : int
        Which of the values it is.
    """

    places: tuple[int, ...]
    key: Any
    text: str = field(compare=False)
    value: Tape = field(compare=False, repr=False)
    slopes: Tape = field(compare=False, repr=False)
    guards: Tape = field(compare=False, repr=False)
    output: int = 0

    def evaluate(self, x: np.ndarray) -> np.ndarray:
        """Return the values at x of shape (..., n)."""
        return self._mapped(self.value, x[..., list(self.places)])[..., self.output]

    def written(self, names: Sequence[str]) -> str:
        """Write the function in the user's names."""
        return self.text

    def singular(self, x: np.ndarray) -> tuple[int, int] | None:
        """Return the first two of ascending x, of shape (P,), that have a singularity between them.

        They are the same where the function is not finite there. Of functions of one variable.
        """
        column = x[:, None]
        bad = np.flatnonzero(~np.isfinite(self._mapped(self.value, column)[:, self.output]))
        signs = np.sign(self._mapped(self.guards, column))
        turns = np.flatnonzero((signs[1:] * signs[:-1] < 0).any(axis=1))
        found = [(int(k), int(k)) for k in bad[:1]] + [(int(k), int(k) + 1) for k in turns[:1]]
        return min(found, default=None)

    @staticmethod
    def _mapped(tape: Tape, x: np.ndarray) -> np.ndarray:
        points = np.ascontiguousarray(x.reshape(-1, x.shape[-1]), dtype=float)
        found = tape.map(np.empty(0), [points])
        return np.asarray(found).reshape(*x.shape[:-1], tape.outputs)


class Written(Protocol):
    """A function that can be written."""

    def written(self, names: Sequence[str]) -> str:
        """Write it in the user's names."""


def written(monomial: Sequence[int], names: Sequence[str], functions: Sequence[Written]) -> str:
    """Write a monomial of variables, and functions numbered after them."""
    words = []
    for v in sorted(set(monomial)):
        word = names[v] if v < len(names) else functions[v - len(names)].written(names)
        power = monomial.count(v)
        words.append(word if power == 1 else f"{word}**{power}")
    return "*".join(words) or "1"
