"""In which forms the core has a Hamiltonian, and multiplies with a matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._systems.waves.entries import Bounds, Entries, check_size
from liouville._systems.waves.exchange import Exchange
from liouville._systems.waves.frame import Frame, doubled
from liouville._systems.waves.grid import Grid
from liouville._systems.waves.lattice import Lattice
from liouville._systems.waves.moving import MovingProduct
from liouville._systems.waves.products import Product
from liouville._systems.waves.sites.system import SiteSystem
from liouville._systems.waves.spins import SpinChain

#: A matrix with more than this part of its places taken is a dense one.
FULL = 0.25

#: The bounds of a lattice with more sites are not worth the time of its eigenvalues.
FEW_SITES = 64

#: Diagonals are stored whole if there are no more of them than this, ...
MOST_DIAGONALS = 24

#: ... and more than this part of the places of all is taken.
FILLED = 0.25


@dataclass(frozen=True)
class Term:
    """A constant part of H: its operators in the core, and bounds of its eigenvalues if known."""

    operators: list[_core.Operator]
    bounds: Bounds | None

    def __post_init__(self) -> None:
        """Refuse energies that are too large."""
        check_size("H / hbar", self.bounds or ())


def operators(matrix: Entries) -> list[_core.Operator]:
    """Return a real symmetric matrix as terms: dense, by diagonals, and the rest by rows."""
    n = matrix.n
    if matrix.values.size > FULL * n * n and n > 1:
        return [_core.Operator.dense(matrix.dense())]
    offset = matrix.col - matrix.row
    offsets, counts = np.unique(offset[offset >= 0], return_counts=True)
    whole = offsets
    if whole.size > MOST_DIAGONALS or counts.sum() <= FILLED * (n - offsets).sum():
        whole = offsets[counts > FILLED * (n - offsets)]
    if not 0 < whole.size <= MOST_DIAGONALS:
        return [by_rows(matrix)]
    values = []
    for k in whole.tolist():
        at = offset == k
        diagonal = np.zeros(n - k)
        diagonal[matrix.row[at]] = matrix.values[at]
        values.append(diagonal)
    terms = [_core.Operator.diagonals(n, whole.tolist(), values)]
    left = ~np.isin(np.abs(offset), whole)
    if left.any():
        rest = Entries(n, matrix.row[left], matrix.col[left], matrix.values[left])
        terms.append(by_rows(rest))
    return terms


def term_of_matrix(matrix: Entries, frame: Frame, scale: float) -> Term:
    """Make the term of a matrix times a number, in a frame."""
    matrix = matrix.times(scale)
    return Term(_operators_in(frame, matrix), matrix.bounds)


def _operators_in(frame: Frame, matrix: Entries) -> list[_core.Operator]:
    """Return a matrix as terms in a frame."""
    inside = frame.entries(matrix)
    return operators(doubled(inside) if frame.is_doubled else inside)


def term_of(
    source: Entries | Product | MovingProduct | Exchange, given: Any, frame: Frame, scale: float
) -> Term:
    """Make the term of H times a number, in a frame; its own object may have bounds."""
    if isinstance(source, Product):
        return Term([source.operator(scale, frame.is_doubled)], None)
    if isinstance(source, MovingProduct):
        return Term([source.operator(scale)], None)
    if isinstance(source, Exchange):
        low, high = source.bounds()
        return Term([source.operator(scale)], (scale * low, scale * high))
    if not isinstance(given, Lattice):
        return term_of_matrix(source, frame, scale)
    matrix, (low, high) = source.times(scale), given.bounds()
    found = matrix.bounds if matrix.n <= FEW_SITES else matrix.discs
    closer = (max(found[0], scale * low), min(found[1], scale * high))
    return Term(_operators_in(frame, matrix), closer)


def repeated(operator: _core.Operator, times: int) -> _core.Operator:
    """Return a real operator that acts on each of so many parts of a state."""
    return operator if times == 1 else operator.repeated(times)


def of_states(
    product: Callable[[np.ndarray], np.ndarray], size: int, states: np.ndarray
) -> np.ndarray:
    """Return products with states as rows, by one with a real vector of the core's size.

    That of a complex operator is one of real and imaginary parts together.
    """
    found = np.empty_like(states)
    for out, state in zip(found, states, strict=True):
        if size == state.size:
            re, im = (product(np.ascontiguousarray(part)) for part in (state.real, state.imag))
        else:
            re, im = np.split(product(np.concatenate([state.real, state.imag])), 2)
        out[:] = re + 1j * im
    return found


def by_rows(matrix: Entries) -> _core.Operator:
    """Return a matrix by its rows."""
    n = matrix.n
    return _core.Operator.rows(_core.Rows(n, n, matrix.row, matrix.col, matrix.values))


def source_of(given: Any) -> Grid | Product | MovingProduct | Exchange | Entries:
    """Return a Hamiltonian in one of the forms that the core has."""
    if isinstance(given, Grid):
        return given
    if isinstance(given, SpinChain):
        return given.exchange
    if isinstance(given, SiteSystem):
        return given.exchange or Entries.read("H", given.matrix())
    if isinstance(given, Lattice):
        return given.entries()
    found = MovingProduct.read("H", given) or Product.read("H", given)
    if found is None and callable(given):
        hint = "give (N, function of psi), (N, function of t and psi), or an operator by t alone"
        raise TypeError(hinted("H is a function of unknown size", hint))
    return found or Entries.read("H", given)
