"""Pieces of a field: each is divergence-free, with an explicit volume-preserving map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from liouville._methods.splitting.basis import transformed
from liouville._methods.splitting.runge_kutta import Tableau
from liouville._systems.fields.terms import Function, Monomial, Terms, Wave, exact

#: The largest degree of roots that exponentials are computed by, and the largest power.
LARGEST_ROOT, LARGEST_POWER = 3, 12

#: Powers are multiples of 1 / q if they are so near to one, relatively.
NEAR = 4 * np.finfo(float).eps

#: The operations of a turn beside those of its axis.
TURNED = 90

#: The cost of a division, in multiplications.
DIVISION = 5


@dataclass(frozen=True, eq=False)
class Natural:
    """x_i += h R_i(x), where no R_i depends on a variable that the piece changes."""

    terms: Terms
    is_exact: ClassVar[bool] = True
    functions: ClassVar[int] = 0

    def field(self) -> Terms:
        """Return the piece as a vector field."""
        return self.terms

    @property
    def operations(self) -> int:
        """Return how many additions and multiplications a step takes."""
        return _operations(self.terms)


@dataclass(frozen=True, eq=False)
class Shear:
    """x += h g(x) a with a . grad g = 0; g has component 0 only."""

    direction: np.ndarray
    g: Terms
    is_exact: ClassVar[bool] = True
    functions: ClassVar[int] = 0

    def field(self) -> Terms:
        """Return the piece as a vector field."""
        places = np.flatnonzero(self.direction)
        component = np.repeat(places, len(self.g))
        coefficient = np.outer(self.direction[places], self.g.coefficient).ravel()
        variables = np.tile(self.g.variables, (places.size, 1))
        return Terms(self.g.n, component, coefficient, variables, self.g.functions)

    @property
    def operations(self) -> int:
        """Return how many additions and multiplications a step takes."""
        return _operations(self.g) + 2 * int(np.count_nonzero(self.direction))


@dataclass(frozen=True, eq=False)
class Scaling:
    """x_i *= exp(h p_i(x)), where no p_i depends on a variable that the piece changes."""

    rate: Terms
    is_exact: ClassVar[bool] = True

    def field(self) -> Terms:
        """Return the piece as a vector field."""
        variables = np.column_stack([self.rate.variables, self.rate.component])
        return replace(self.rate, variables=variables)

    @property
    def operations(self) -> int:
        """Return how many additions and multiplications a step takes."""
        return _operations(self.rate) + self.functions

    @property
    def functions(self) -> int:
        """Return how many exponentials a step takes."""
        return int(np.unique(self.rate.component).size)


@dataclass(frozen=True, eq=False)
class Exponential:
    """x_i' = c_i x_i m(x) for one m, x^j times functions that stand still: m' = alpha m^2.

    The flow blows up within h if alpha h m >= 1; it never does if alpha = sum c_i j_i is 0.
    """

    n: int
    places: np.ndarray
    rates: np.ndarray
    monomial: Monomial
    factors: tuple[Wave | Function, ...] = ()
    is_exact: ClassVar[bool] = True

    def field(self) -> Terms:
        """Return the piece as a vector field."""
        m = np.tile(np.array(self.monomial, dtype=np.int64), (self.places.size, 1))
        variables = np.column_stack([m, self.places])
        return Terms(self.n, self.places, self.rates, variables, self.factors)

    @property
    def operations(self) -> int:
        """Return how many additions and multiplications a step takes."""
        division = DIVISION if self.root == 1 else 0
        return 3 * self.places.size + len(self.monomial) + division

    @property
    def functions(self) -> int:
        """Return how many roots, exponentials and logarithms a step takes."""
        return int(self.root > 1) if self.root else int(self.places.size) + 1

    @property
    def root(self) -> int:
        """Return the degree of the root whose powers the flow is products of, 0 if there is none.

        The powers are -c_i / alpha, as the core computes them.
        """
        rates = self.rates.astype(float)
        parts = rates * [self.monomial.count(int(place)) for place in self.places]
        alpha = parts.sum()
        if abs(alpha) <= NEAR * np.abs(parts).sum():
            return 0
        for q in range(1, LARGEST_ROOT + 1):
            powers = -rates / alpha * q
            near = np.abs(powers - np.round(powers)) <= NEAR * np.abs(powers)
            if near.all() and np.abs(powers).max() <= LARGEST_POWER:
                return q
        return 0


@dataclass(frozen=True, eq=False)
class Triangular:
    """A step of an explicit Runge-Kutta method: f_i depends only on what is before i in `order`.

    `order` holds the variables that change; those that do not may occur anywhere.
    """

    order: np.ndarray
    terms: Terms
    tableau: Tableau
    is_exact: ClassVar[bool] = False
    functions: ClassVar[int] = 0

    def field(self) -> Terms:
        """Return the piece as a vector field."""
        return self.terms

    @property
    def operations(self) -> int:
        """Return how many additions and multiplications a step takes."""
        return self.tableau.stages * (_operations(self.terms) + self.order.size)


@dataclass(frozen=True, eq=False)
class Affine:
    """x' = A x + c with tr A = 0."""

    matrix: np.ndarray
    vector: np.ndarray
    is_exact: ClassVar[bool] = True
    functions: ClassVar[int] = 0

    def field(self) -> Terms:
        """Return the piece as a vector field."""
        row, column = np.nonzero(self.matrix)
        constant = np.flatnonzero(self.vector)
        return Terms(
            self.vector.size,
            np.concatenate([constant, row]),
            np.concatenate([self.vector[constant], self.matrix[row, column]]),
            np.concatenate([np.full(constant.size, -1), column])[:, None],
        )

    @property
    def operations(self) -> int:
        """Return how many additions and multiplications a step takes."""
        return 2 * self.matrix.size


@dataclass(frozen=True, eq=False)
class Turn:
    """v' = w x v + e of three variables v, with w and e that stand still.

    Attributes
    ----------
    places : ndarray
        The variables v.
    rates : Terms
        Components 0 to 2 are w, and 3 to 5 are e. Without e, a function in w may be one of |v|.
    is_cayley : bool
        Whether angles are those of Boris's turn, of the second order.
    """

    places: np.ndarray
    rates: Terms
    is_cayley: bool = False
    is_exact: ClassVar[bool] = True
    functions: ClassVar[int] = 0

    def field(self) -> Terms:
        """Return the piece as a vector field."""
        rates, found = self.rates, []
        for k, place in enumerate(self.places):
            for sign, row, factor in (
                (1, (k + 1) % 3, (k + 2) % 3),
                (-1, (k + 2) % 3, (k + 1) % 3),
            ):
                part = rates.selected(rates.component == row)
                by = np.full((len(part), 1), self.places[factor])
                variables = np.hstack([part.variables, by])
                own = np.full(len(part), place)
                found.append(replace(part, component=own, variables=variables).scaled(sign))
            push = rates.selected(rates.component == 3 + k)
            found.append(replace(push, component=np.full(len(push), place)))
        return found[0].joined(*found[1:])

    @property
    def operations(self) -> int:
        """Return about how many additions and multiplications a step takes."""
        return _operations(self.rates) + TURNED


Piece = Natural | Shear | Scaling | Exponential | Triangular | Affine | Turn


@dataclass(frozen=True, eq=False)
class Split:
    """A field as the sum of pieces, which follow one another in this order.

    Attributes
    ----------
    n : int
        How many variables there are.
    pieces : tuple
        Of y, if there is a basis.
    basis : ndarray, shape (n, n), or None
        The matrix A of x = A y.
    inverse : ndarray, shape (n, n), or None
        Its inverse.
    """

    n: int
    pieces: tuple[Piece, ...]
    basis: np.ndarray | None = None
    inverse: np.ndarray | None = field(default=None, repr=False)

    @property
    def outward(self) -> np.ndarray | None:
        """Return the matrix A of x = A y in floating point, None if y is x."""
        return None if self.basis is None else np.ascontiguousarray(self.basis, dtype=float)

    def inward(self, x: np.ndarray) -> np.ndarray:
        """Return y of states x, of shape (n,) or (P, n)."""
        if self.inverse is None:
            return x
        columns = np.asarray(self.inverse, dtype=float).T
        # column by column: a matrix product rounds a state differently alone and among others
        with np.errstate(over="ignore", invalid="ignore"):  # the run says what is not finite
            return np.asarray(sum(x[..., j, None] * column for j, column in enumerate(columns)))

    def fields(self) -> list[Terms]:
        """Return each piece as a vector field of x."""
        fields = [piece.field() for piece in self.pieces]
        if self.basis is None or self.inverse is None:
            return fields
        return [transformed(field, self.basis, self.inverse) for field in fields]

    def field(self) -> Terms:
        """Return the sum of the pieces as a vector field of x."""
        return self._sum().merged()

    def _sum(self) -> Terms:
        parts = [piece.field() for piece in self.pieces] or [Terms.none(self.n, is_exact=True)]
        total = parts[0].joined(*parts[1:])
        if self.basis is None or self.inverse is None:
            return total
        return transformed(total, self.basis, self.inverse)

    def mismatch(self, terms: Terms) -> float:
        """Return how far the sum of the pieces is from a field, relative to its coefficients.

        It is 0 for exact coefficients, and of the size of roundoff for others.
        """
        left = (self._sum() - terms.resolved()).coefficient
        largest = np.abs(terms.coefficient).max(initial=0)
        return float(np.abs(left).max() / largest) if left.size and largest else float(left.size)


def sequence(n: int, *parts: Sequence[Piece]) -> Split:
    """Put lists of pieces one after another."""
    return Split(n, tuple(piece for part in parts for piece in part))


def one_component(n: int, parts: Sequence[tuple[np.ndarray, np.ndarray]], is_exact: bool) -> Terms:
    """Return the scalar field with these coefficients and rows of variables."""
    field = Terms.none(n, is_exact)
    scalars = [Terms(n, np.zeros(len(c), dtype=np.int64), c, rows) for c, rows in parts]
    return field.joined(*scalars).merged()


def same_kind(numbers: np.ndarray, terms: Terms) -> np.ndarray:
    """Return numbers as the coefficients of a field are: exact ones are taken as they stand."""
    if not terms.is_exact:
        return numbers.astype(float)
    return exact(numbers.ravel()).reshape(numbers.shape)


def _operations(terms: Terms) -> int:
    return int((terms.degrees + 1).sum())
