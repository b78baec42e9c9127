"""Polynomial vector fields, term by term: x_i' = sum of c x_v1 x_v2 ... x_vk.

A field is three arrays, one entry for each term, so that fields of millions of terms are merged,
told apart and checked in seconds. The same code serves floating-point coefficients and exact ones,
which are :class:`fractions.Fraction` in arrays of objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from liouville._basics.errors import misshapen
from liouville._systems.fields.terms.arrays import exact, grouped, widened
from liouville._systems.fields.terms.functions import Function, written
from liouville._systems.fields.terms.waves import Wave, expanded

#: A sum of floating-point numbers is zero if it is below this times the sum of their sizes.
ROUNDOFF = 64 * np.finfo(float).eps

#: One monomial: its variables, sorted, each as often as its exponent.
Monomial = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Terms:
    """A vector field, or a scalar one whose terms all have component 0.

    Attributes
    ----------
    n : int
        How many variables there are.
    component : ndarray of int, shape (N,)
        The component that each term belongs to.
    coefficient : ndarray of float or of Fraction, shape (N,)
        Its coefficient.
    variables : ndarray of int, shape (N, d)
        Its factors in ascending order, each as often as it occurs. Absent factors are -1 and
        stand first; ``n + q`` is the function q.
    functions : tuple of Wave or Function
        Factors that are no variables.
    """

    n: int
    component: np.ndarray
    coefficient: np.ndarray
    variables: np.ndarray
    functions: tuple[Wave | Function, ...] = ()

    def __post_init__(self) -> None:
        """Bring the arrays to their types, and the factors of each term into order."""
        component = np.asarray(self.component, dtype=np.int64)
        coefficient = np.asarray(self.coefficient)
        if coefficient.dtype != object:
            coefficient = coefficient.astype(float, copy=False)
        variables = np.asarray(self.variables, dtype=np.int64)
        if variables.ndim != 2:
            variables = variables.reshape(component.size, -1 if component.size else 0)
        if (np.diff(variables, axis=1) < 0).any():
            variables = np.sort(variables, axis=1)
        object.__setattr__(self, "component", component)
        object.__setattr__(self, "coefficient", coefficient)
        object.__setattr__(self, "variables", variables)

    @classmethod
    def of(
        cls,
        n: int,
        terms: Iterable[tuple[int, Any, Sequence[int]]],
        functions: tuple[Wave | Function, ...] = (),
    ) -> Terms:
        """Collect terms (component, coefficient, variables), and merge them.

        They are exact unless a coefficient is a floating-point number: integers, fractions, and
        strings such as ``"-3/8"`` are.
        """
        return cls._listed(n, list(terms), functions).merged()

    @classmethod
    def _listed(
        cls,
        n: int,
        rows: Sequence[tuple[int, Any, Sequence[int]]],
        functions: tuple[Wave | Function, ...],
    ) -> Terms:
        component = np.array([row[0] for row in rows], dtype=np.int64)
        width = max((len(row[2]) for row in rows), default=0)
        variables = np.full((len(rows), width), -1, dtype=np.int64)
        for k, (_, _, factors) in enumerate(rows):
            variables[k, width - len(factors) :] = sorted(factors)
        given = [row[1] for row in rows]
        is_exact = not any(isinstance(c, (float, np.floating)) for c in given)
        coefficient = exact(given) if is_exact else np.array([float(Fraction(c)) for c in given])
        return cls(n, component, coefficient, variables, functions)

    @classmethod
    def none(cls, n: int, is_exact: bool = False) -> Terms:
        """Return the field that is zero."""
        coefficient = np.empty(0, dtype=object if is_exact else float)
        return cls(n, np.empty(0, np.int64), coefficient, np.empty((0, 0), np.int64))

    def __len__(self) -> int:
        """Return how many terms there are."""
        return self.component.size

    def __add__(self, other: Terms) -> Terms:
        """Return the sum of two fields, merged."""
        return self.joined(other).merged()

    def __sub__(self, other: Terms) -> Terms:
        """Return the difference of two fields, merged."""
        return self.joined(other.scaled(-1)).merged()

    @property
    def is_exact(self) -> bool:
        """Return whether the coefficients are fractions."""
        return bool(self.coefficient.dtype == object)

    @property
    def has_function(self) -> np.ndarray:
        """Mark the factors that are functions."""
        return np.asarray(self.variables >= self.n)

    @property
    def degrees(self) -> np.ndarray:
        """Return the number of factors of each term."""
        return np.asarray((self.variables >= 0).sum(axis=1))

    @property
    def degree(self) -> int:
        """Return the largest number of factors of a term."""
        return int(self.degrees.max(initial=0))

    def to_float(self) -> Terms:
        """Return the field with floating-point coefficients."""
        return replace(self, coefficient=self.coefficient.astype(float))

    def scaled(self, factor: Any) -> Terms:
        """Return the field times a number, or times one for each term."""
        return replace(self, coefficient=self.coefficient * factor)

    def sized(self) -> Terms:
        """Return the field with the sizes of its coefficients."""
        return replace(self, coefficient=np.abs(self.coefficient))

    def selected(self, chosen: Any) -> Terms:
        """Return some of the terms, by a mask or by their numbers."""
        return replace(
            self,
            component=self.component[chosen],
            coefficient=self.coefficient[chosen],
            variables=self.variables[chosen],
        )

    def joined(self, *others: Terms) -> Terms:
        """Return the terms of several fields one after another, exact if all are."""
        fields: tuple[Terms, ...] = (self, *others)
        functions: dict[Wave | Function, int] = {}
        for function in (function for field in fields for function in field.functions):
            functions.setdefault(function, len(functions))
        width = max(field.variables.shape[1] for field in fields)
        is_exact = all(field.is_exact for field in fields)
        return replace(
            self,
            component=np.concatenate([field.component for field in fields]),
            coefficient=np.concatenate(
                [f.coefficient if is_exact else f.coefficient.astype(float) for f in fields]
            ),
            variables=np.concatenate(
                [widened(field._renumbered(functions), width) for field in fields]
            ),
            functions=tuple(functions),
        )

    def compact(self) -> Terms:
        """Return the field without functions that no term has."""
        if not self.functions:
            return self
        used = np.unique(self.variables[self.has_function]) - self.n
        if used.size == len(self.functions):
            return self
        functions = tuple(self.functions[q] for q in used)
        number = {self.functions[q]: k for k, q in enumerate(used.tolist())}
        rest = {f: 0 for f in self.functions if f not in number}
        variables = self._renumbered(number | rest)
        return replace(self, variables=variables, functions=functions)

    def _renumbered(self, functions: dict[Wave | Function, int]) -> np.ndarray:
        if not self.functions:
            return self.variables
        number = np.array([self.n + functions[function] for function in self.functions])
        is_function = self.has_function
        places = np.where(is_function, self.variables - self.n, 0)
        return np.sort(np.where(is_function, number[places], self.variables), axis=1)

    def merged(self, noise: float = 0.0) -> Terms:
        """Add up terms of equal component and factors; sort them by these, lower degrees first.

        A sum is dropped if it is zero, or in floating point at most `noise` times the sum of sizes.
        """
        order, starts = grouped(self._keys(component=True), self.n + len(self.functions))
        total = self._sums(order, starts)
        if noise and not self.is_exact:
            size = self.sized()._sums(order, starts)
            kept = np.abs(total) > noise * size
        else:
            kept = total != 0
        first = order[starts[kept]]
        variables = self.variables[first]
        used = (variables >= 0).any(axis=0)
        return replace(
            self,
            component=self.component[first],
            coefficient=total[kept],
            variables=variables[:, used],
        )

    def _keys(self, component: bool) -> list[np.ndarray]:
        return ([self.component] if component else []) + list(self.variables.T)

    def _sums(self, order: np.ndarray, starts: np.ndarray) -> np.ndarray:
        if not starts.size:
            return self.coefficient
        return np.asarray(np.add.reduceat(self.coefficient[order], starts))

    def _is_diagonal(self) -> np.ndarray:
        """Mark the terms whose component is among their variables, or those of their functions."""
        found: np.ndarray = (self.variables == self.component[:, None]).any(axis=1)
        for q, function in enumerate(self.functions):
            has = (self.variables == self.n + q).any(axis=1)
            found |= has & np.isin(self.component, function.places)
        return found

    def diagonal(self) -> Terms:
        """Return the terms that contain the variable whose velocity they are."""
        return self.selected(self._is_diagonal())

    def off_diagonal(self) -> Terms:
        """Return the terms that do not contain the variable whose velocity they are."""
        return self.selected(~self._is_diagonal())

    def dependencies(self) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs of a term and a variable that it depends on, also through a function."""
        term, column = np.nonzero((self.variables >= 0) & (self.variables < self.n))
        pairs = [(term, self.variables[term, column])]
        for q, function in enumerate(self.functions):
            has = np.flatnonzero((self.variables == self.n + q).any(axis=1))
            pairs.append((np.repeat(has, len(function.places)), np.tile(function.places, has.size)))
        terms, variables = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        return terms, variables

    def derivative(self, variable: int) -> Terms:
        """Return the derivative of all components with respect to a variable."""
        return self._derived(np.full(len(self), variable)).merged()

    def _derived(self, by: np.ndarray) -> Terms:
        """Return the derivative of each term with respect to a variable of its own."""
        parts = [self._derived_factor(self.variables == by[:, None], -1)]
        for q, wave in enumerate(self.functions):
            if isinstance(wave, Function):
                if ((self.variables == self.n + q).any(axis=1) & np.isin(by, wave.places)).any():
                    raise ValueError(f"{wave.text} has no derivative in closed form")
                continue
            slope = np.zeros(self.n)
            slope[list(wave.places)] = wave.k
            slopes = slope[by]
            turned = replace(wave, phase=wave.phase + np.pi / 2)
            hits = (self.variables == self.n + q) & (slopes != 0)[:, None]
            new = replace(self, functions=(*self.functions, turned)).scaled(
                exact(slopes) if self.is_exact else slopes
            )
            parts.append(new._derived_factor(hits, self.n + len(self.functions)))
        return parts[0].joined(*parts[1:])

    def _derived_factor(self, hits: np.ndarray, derivative: int) -> Terms:
        """Put a factor's derivative in the place of one that is hit, as often as there are."""
        there = hits.any(axis=1)
        part = self.selected(there).scaled(hits.sum(axis=1)[there])
        if not len(part):
            return part
        variables = part.variables.copy()
        variables[np.arange(len(part)), hits[there].argmax(axis=1)] = derivative
        return replace(part, variables=np.sort(variables, axis=1))

    def divergence(self) -> Terms:
        """Return sum_i df_i/dx_i, a scalar field, whatever its roundoff."""
        return self._own_derivatives().merged()

    def _own_derivatives(self) -> Terms:
        derived = self._derived(self.component)
        return replace(derived, component=np.zeros_like(derived.component)).resolved()

    def resolved(self) -> Terms:
        """Return the field with at most one wave in a term, which is a cosine or a sine.

        Products of waves become sums, and phases become cosines and sines: waves of equal k are
        then the same, or independent. Other functions stay.
        """
        has_function = self.has_function.any(axis=1)
        if not has_function.any():
            return replace(self, functions=())
        numbers: dict[Wave | Function, int] = {}
        rows = []
        part = self.selected(has_function)
        for i, c, row in zip(part.component, part.coefficient, part.variables, strict=True):
            places = row[(row >= 0) & (row < self.n)].tolist()
            functions = [self.functions[v - self.n] for v in row[row >= self.n]]
            others = [f for f in functions if isinstance(f, Function)]
            places += [self.n + numbers.setdefault(f, len(numbers)) for f in others]
            waves = [f for f in functions if isinstance(f, Wave)]
            for factor, wave in expanded(waves) if waves else [(1, None)]:
                known = [] if wave is None else [self.n + numbers.setdefault(wave, len(numbers))]
                rows.append((int(i), c * factor, places + known))
        plain = replace(self.selected(~has_function), functions=())
        return plain.joined(Terms._listed(self.n, rows, tuple(numbers)))

    def excess(self) -> Terms:
        """Return the divergence without terms that vanish, a scalar field.

        For every monomial x^j must sum_i (j_i + 1) c_i vanish, where c_i is the coefficient of
        x_i x^j in component i: exactly if the coefficients are exact, else up to ``ROUNDOFF``.
        """
        terms = self.to_float() if self.functions else self
        return terms._own_derivatives().merged(ROUNDOFF)

    def imbalance(self) -> tuple[float, Monomial, float]:
        """Return the worst monomial of the divergence, as a part of the sizes that make it.

        The part is |sum_i (j_i + 1) c_i| / sum_i (j_i + 1) |c_i|, from 0 to 1; then come the
        monomial and its sum. Without any monomial they are 0, () and 0.
        """
        own = self.to_float()._own_derivatives()
        order, starts = grouped(own._keys(component=False), own.n + len(own.functions))
        if not starts.size:
            return 0.0, (), 0.0
        sums = own._sums(order, starts)
        parts = np.abs(sums) / own.sized()._sums(order, starts)
        k = int(np.argmax(parts))
        row = own.variables[order[starts[k]]]
        return float(parts[k]), tuple(row[row >= 0].tolist()), float(sums[k])

    def offending(self) -> list[tuple[Monomial, Any]]:
        """List the monomials of ``excess()``, whose waves they mean, and their sums."""
        return self.excess().monomials()

    def monomials(self) -> list[tuple[Monomial, Any]]:
        """List the monomials and coefficients of a scalar field."""
        factors = (tuple(row[row >= 0].tolist()) for row in self.variables)
        return list(zip(factors, self.coefficient.tolist(), strict=True))

    def repaired(self) -> Terms:
        """Return the nearest field of the same terms without divergence.

        From c_i is taken w_i (sum_l w_l c_l) / (sum_l w_l^2) for each monomial of the divergence,
        where w are the factors of the derivative.
        """
        merged = self.merged()
        hits = merged.variables == merged.component[:, None]
        rows = np.flatnonzero(hits.any(axis=1))
        if not rows.size:
            return merged
        w = hits.sum(axis=1)[rows]
        variables = merged.variables[rows]
        variables[np.arange(rows.size), hits[rows].argmax(axis=1)] = -1
        monomials = replace(merged.selected(rows), variables=np.sort(variables, axis=1))
        order, starts = grouped(monomials._keys(component=False), self.n + len(self.functions))
        group = np.empty(rows.size, dtype=np.int64)
        group[order] = np.repeat(np.arange(starts.size), np.diff([*starts, rows.size]))
        excess = np.add.reduceat((monomials.coefficient * w)[order], starts)
        weight = np.add.reduceat((w * w)[order], starts)
        coefficient = merged.coefficient.copy()
        coefficient[rows] -= excess[group] * w / weight[group]
        return replace(merged, coefficient=coefficient).merged()

    def evaluate(self, x: Any) -> np.ndarray:
        """Return the field at x, of shape (n,) or (P, n); entries may be any numbers."""
        x = np.asarray(x)
        if x.shape[-1] != self.n:
            raise misshapen("x", x.shape, f"({self.n},) or (P, {self.n})")
        functions = [function.evaluate(x)[..., None] for function in self.functions]
        factors = np.concatenate([x, *functions, np.ones_like(x[..., :1])], axis=-1)
        values = self.coefficient * factors[..., self.variables].prod(axis=-1)
        result = np.zeros(x.shape, dtype=np.result_type(values, x))
        np.add.at(result.T, self.component, values.T)
        return result

    def written(self, monomial: Monomial, names: Sequence[str]) -> str:
        """Write a monomial in the user's names: ``x*y**2``."""
        return written(monomial, names, self.functions)
