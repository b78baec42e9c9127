"""Sums of products of local operators, as they are written, and as what moves digits of states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted
from liouville._systems.waves.entries import check_size
from liouville._systems.waves.entries import numbers as array_of

#: The suffix of the letters of a term whose Hermitian conjugate is added.
CONJUGATE = " + h.c."

#: A coefficient that is so much smaller than the largest is what roundoff leaves of a zero.
ROUNDOFF = 1e-14

#: Steps of digits, pairs of site and step.
Steps = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Letters:
    """The local operators of a model by their letters.

    Attributes
    ----------
    matrices : mapping of str to ndarray
        The matrix of each letter: the new digit is the row, the old one the column.
    swaps : mapping of str to str
        The letters whose Hermitian conjugate is another one.
    fermionic : str
        The letters that anticommute at different sites.
    has_species : bool
        Whether a bar parts letters of particles with spin up from those with spin down.
    """

    matrices: Mapping[str, NDArray[np.complex128]]
    swaps: Mapping[str, str] = field(default_factory=lambda: {"+": "-", "-": "+"})
    fermionic: str = ""
    has_species: bool = False

    def conjugate(self, letters: str) -> str:
        """Return the letters of the Hermitian conjugate, which act in the opposite order."""
        return "".join(self.swaps.get(letter, letter) for letter in reversed(letters))


@dataclass(frozen=True)
class Written:
    """A term as it is written: coefficients times the same letters on some places each.

    Attributes
    ----------
    name : str
        Its name in messages.
    letters : str
        One letter a factor.
    coefficients : ndarray, shape (m,)
        Real or complex.
    sites : ndarray, shape (m, k)
        The sites on which the k letters act, for messages.
    digits : ndarray, shape (m, k)
        The digits of a basis state that they change.
    """

    name: str
    letters: str
    coefficients: NDArray[Any]
    sites: NDArray[np.int64]
    digits: NDArray[np.int64]


@dataclass(frozen=True)
class Factor:
    """A number for each digit of a site, before it moves."""

    site: int
    values: tuple[float, ...]


@dataclass(frozen=True)
class Moved:
    """A move of digits: an amplitude times factors, times a sign for the particles in a mask."""

    steps: Steps
    factors: tuple[Factor, ...]
    mask: int


@dataclass
class Sum:
    """A sum of products, each of which takes a basis state to one other.

    Attributes
    ----------
    amplitudes : dict of Moved to complex
        The products and their coefficients.
    origins : dict of Moved to str
        The first term, as it is written, that each of them is in.
    """

    amplitudes: dict[Moved, complex] = field(default_factory=dict)
    origins: dict[Moved, str] = field(default_factory=dict)

    def cleaned(self) -> Sum:
        """Return the sum without what cancels."""
        largest = max(map(abs, self.amplitudes.values()), default=0.0)
        kept = {key: z for key, z in self.amplitudes.items() if abs(z) > ROUNDOFF * largest}
        return Sum(kept, {key: self.origins[key] for key in kept})


def read(term: Any, name: str, letters: Letters, sites: int, periodic: bool) -> list[Written]:
    """Read a term ``(letters, coefficient, sites)``, and its Hermitian conjugate if it is asked.

    Raises
    ------
    TypeError, ValueError
        It is of another form, or a letter, a coefficient or a site is none.
    """
    if isinstance(term, str):
        term = (term,)
    if not isinstance(term, (tuple, list)) or not 1 <= len(term) <= 3:
        raise TypeError(f"{name} must be (letters, coefficient, sites), not {term!r}")
    given: list[Any] = [*term]
    word, coefficient, places = given + [1.0, None][len(given) - 1 :]
    if not isinstance(word, str):
        raise TypeError(f"{name} begins with letters such as 'zz', not {word!r}")
    bare = word.removesuffix(CONJUGATE)
    parts = bare.split("|") if letters.has_species else [bare]
    acting = "".join(parts)
    unknown = [x for x in acting if x not in letters.matrices]
    if unknown or not acting or len(parts) != 1 + letters.has_species:
        bar = " and one bar, as in 'n|n'" if letters.has_species else ""
        if "|" in unknown and letters.fermionic:
            bar = "; a bar parts spin up from spin down, for which give spinful=True"
        known = f"letters are {', '.join(letters.matrices)}{bar}"
        what = f"the letter {unknown[0]!r}" if unknown else "no bar" if acting else "no letters"
        raise ValueError(hinted(f"{name}, {word!r}, has {what}", known))
    beside = np.concatenate([np.arange(len(part)) for part in parts])
    at = _sites(name, word, places, beside, sites, periodic)
    values = array_of(f"the coefficient of {name}, {word!r},", coefficient)
    if values.shape not in ((), (len(at),)):
        raise ValueError(
            f"the coefficient of {name}, {word!r}, must be a number, or one for each of its "
            f"{len(at)} places, not of shape {values.shape}"
        )
    if not np.isfinite(values).all():
        raise ValueError(
            f"the coefficient of {name}, {word!r}, must be finite, not {coefficient!r}"
        )
    check_size(f"the coefficient of {name}, {word!r},", values)
    shifts = np.repeat(sites * np.arange(len(parts)), [len(part) for part in parts])
    values = np.broadcast_to(values, len(at))
    own = Written(f"{name}, {bare!r},", acting, values, at, at + shifts)
    return [own, conjugated(own, letters)] if word != bare else [own]


def conjugated(term: Written, letters: Letters) -> Written:
    """Return the Hermitian conjugate."""
    word, values = letters.conjugate(term.letters), term.coefficients.conj()
    return Written(term.name, word, values, term.sites[:, ::-1], term.digits[:, ::-1])


def translated(term: Written, sites: int) -> Written:
    """Return a term that acts on the next site of a ring each."""
    digits = term.digits - term.digits % sites + (term.digits + 1) % sites
    return replace(term, sites=(term.sites + 1) % sites, digits=digits)


def _sites(
    name: str, word: str, places: Any, beside: NDArray[np.int64], sites: int, periodic: bool
) -> NDArray[np.int64]:
    """Return the sites of each factor: those given, or all chains of neighbours."""
    factors = beside.size
    if places is None:
        many = int(beside.max()) + 1
        if many > sites:
            there = f"there {'is' if sites == 1 else 'are'} {sites}"
            sentence = f"{name}, {word!r}, acts on {many} neighbouring sites, and {there}"
            hint = "leave it out, take more sites, or give the sites that it acts on"
            raise ValueError(hinted(sentence, hint))
        whole = sites if periodic else sites + 1 - many
        found: NDArray[np.int64] = (np.arange(whole)[:, None] + beside) % sites
        return found
    try:
        found = np.asarray(places)
    except ValueError:  # rows of different lengths
        found = np.array(None)
    if found.dtype.kind not in "iu" and found.size:
        raise TypeError(f"the sites of {name}, {word!r}, must be integers, not {places!r}")
    if not found.size:
        raise ValueError(hinted(f"{name}, {word!r}, has no sites", "leave the term out"))
    if found.ndim < 2:
        found = found.reshape((-1, 1) if factors == 1 else (1, -1))
    if found.ndim != 2 or found.shape[1] != factors:
        raise ValueError(
            f"the sites of {name}, {word!r}, must be {factors} for its {factors} letters, or rows "
            f"of them, not of shape {np.shape(places)}"
        )
    outside = found[(found < 0) | (found >= sites)]
    if outside.size:
        raise ValueError(f"{name}, {word!r}, is on site {outside[0]}: there are 0 to {sites - 1}")
    return found.astype(np.int64)


class Expansion:
    """Products of letters, as sums of what moves digits."""

    def __init__(self, letters: Letters) -> None:
        self.letters = letters
        self._known: dict[str, list[tuple[int, complex, tuple[float, ...] | None]]] = {}
        self._lines: dict[tuple[float, ...], tuple[float, ...]] = {}

    def add(self, terms: Sequence[Written]) -> Sum:
        """Return the sum of terms."""
        found = Sum()
        for term in terms:
            values, sites = term.coefficients.tolist(), term.sites.tolist()
            for z, at, digits in zip(values, sites, term.digits.tolist(), strict=True):
                if z:
                    self._add_one(found, term, z, at, digits)
        return found.cleaned()

    def _add_one(
        self, found: Sum, term: Written, z: complex, sites: list[int], digits: list[int]
    ) -> None:
        sign, mask = self._signs(term.letters, digits)
        words: dict[int, str] = {}
        for letter, digit in zip(term.letters, digits, strict=True):
            words[digit] = words.get(digit, "") + letter
        parts: list[tuple[complex, Steps, tuple[Factor, ...]]] = [(sign * z, (), ())]
        for digit in sorted(words):
            parts = [
                (
                    amplitude * scale,
                    (*steps, (digit, step)) if step else steps,
                    factors if values is None else (*factors, Factor(digit, values)),
                )
                for amplitude, steps, factors in parts
                for step, scale, values in self._shifts(words[digit])
            ]
        for amplitude, steps, factors in parts:
            key = Moved(steps, factors, mask)
            found.amplitudes[key] = found.amplitudes.get(key, 0.0) + amplitude
            found.origins.setdefault(key, f"{term.name} on {_said(sites)}")

    def _signs(self, letters: str, digits: list[int]) -> tuple[int, int]:
        r"""Return the sign and the mask of a product by Jordan and Wigner.

        The letter of digit i carries :math:`\prod_{j < i} (-1)^{n_j}`. All of these act first;
        each passes the letters to the right of its own, which change the sign of what they move.
        """
        sign, mask = 1, 0
        for k, (letter, digit) in enumerate(zip(letters, digits, strict=True)):
            if letter in self.letters.fermionic:
                for other, place in zip(letters[k + 1 :], digits[k + 1 :], strict=True):
                    if other in self.letters.fermionic and place < digit:
                        sign = -sign
                mask ^= (1 << digit) - 1
        return sign, mask

    def _shifts(self, word: str) -> list[tuple[int, complex, tuple[float, ...] | None]]:
        """Return the diagonals of the product of letters at a site: step, scale and values."""
        if word not in self._known:
            matrix = self.letters.matrices[word[0]]
            size = np.abs(matrix).max()
            for letter in word[1:]:
                matrix = matrix @ self.letters.matrices[letter]
                size *= np.abs(self.letters.matrices[letter]).max()
            d, found = len(matrix), []
            for step in range(1 - d, d):
                line = np.zeros(d, complex)
                old = np.arange(max(0, -step), min(d, d - step))
                line[old] = matrix[old + step, old]
                if np.abs(line).max() <= ROUNDOFF * size:  # some products are zero but for roundoff
                    continue
                scale = complex(
                    line[np.flatnonzero(np.abs(line) > ROUNDOFF * np.abs(line).max())[0]]
                )
                values = (line / scale).real
                key = tuple((np.round(values, 12) + 0.0).tolist())
                same = self._lines.setdefault(key, tuple(values.tolist()))
                is_one = step == 0 and set(key) == {1.0}
                found.append((step, scale, None if is_one else same))
            self._known[word] = found
        return self._known[word]


def check_hermitian(own: Sum, other: Sum) -> None:
    """Refuse a sum that is not its Hermitian conjugate, by the term that has no partner."""
    largest = max(map(abs, own.amplitudes.values()), default=0.0)
    for key in [*own.amplitudes, *other.amplitudes]:
        far = abs(own.amplitudes.get(key, 0.0) - other.amplitudes.get(key, 0.0))
        if far > 4 * ROUNDOFF * largest:
            origin = own.origins.get(key) or other.origins[key]
            sentence = f"{origin}, has no Hermitian conjugate in the sum"
            hint = f"write its letters as in '+-{CONJUGATE}', which adds it"
            if key in own.amplitudes and key in other.amplitudes:
                sentence = f"{origin}, has a Hermitian conjugate with another coefficient"
                hint = (
                    "make its coefficient real, or of two terms that are conjugate the second "
                    "coefficient the conjugate of the first"
                )
            raise ValueError(hinted(sentence, hint))


def _said(sites: list[int]) -> str:
    return f"site{'s' if len(sites) > 1 else ''} {', '.join(map(str, sites))}"
