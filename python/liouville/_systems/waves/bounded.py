"""Bounds of the energies of a Schrödinger equation, at the start and while it is driven."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from liouville import _core
from liouville._basics.errors import hinted
from liouville._systems.tracing.expressions import Pickled
from liouville._systems.tracing.trace import Parameters
from liouville._systems.waves import foreign, time_functions
from liouville._systems.waves.bounds import (
    GIVEN,
    PROBABLE,
    RIGOROUS,
    WORTH,
    Spectrum,
    check_inside,
    check_symmetric,
    inside,
    likely,
    probable,
)
from liouville._systems.waves.entries import SMALL, Bounds, Entries
from liouville._systems.waves.forms import Term, term_of_matrix
from liouville._systems.waves.frame import Frame
from liouville._systems.waves.grid import Grid
from liouville._systems.waves.moving import MovingProduct
from liouville._systems.waves.separated import Separated, separate
from liouville._systems.waves.time_functions import TimeFunction

#: What is kept of an H with a drive.
OF_DRIVE = (
    "_spectrum", "_known", "_static", "_closer", "_parts", "term_bounds", "settled", "_recorded",
    "_weights", "sensitivity", "potential_sensitivity",
)  # fmt: skip

#: Up to this order in the core the parts of H(t) are made as arrays, for their eigenvalues.
FEW = 128


class Bounded(Pickled):
    """A base of :class:`Schrodinger`: what is known of its eigenvalues."""

    hamiltonian: _core.Hamiltonian
    hbar: float
    grid: Grid | None
    places: np.ndarray  # where the potential of a grid is evaluated for each entry of a state
    frame: Frame
    size: int
    points: tuple[float, ...]
    _given: Bounds | None
    _way: str
    _terms: list[Term]
    _functions: list[TimeFunction]
    _drive: foreign.Drive
    _params: Parameters
    _moving: TimeFunction | None
    moving_product: MovingProduct | None

    @property
    def is_driven(self) -> bool:
        """Whether H has a drive, or depends on time."""
        return bool(self._functions or self._moving or self.moving_product)

    @cached_property
    def _static(self) -> _core.Hamiltonian:
        return _core.Hamiltonian(self._terms[0].operators)

    @cached_property
    def term_bounds(self) -> list[Bounds]:
        r"""Bounds of the eigenvalues of :math:`H_0 / \hbar` and of each :math:`H_k / \hbar`.

        A potential that depends on time is in none of them, and there are none of an H(t) that is
        known by its products.
        """
        if self.moving_product is not None:
            return []
        return [term.bounds or self._closer.bounds for term in self._terms]

    @property
    def given_bounds(self) -> Bounds | None:
        r"""The bounds of :math:`H / \hbar` that were given, if any."""
        return self._given

    @property
    def groups(self) -> list[int]:
        """How many operators of the core make up :math:`H_0` and each :math:`H_k`."""
        return [len(term.operators) for term in self._terms]

    def parts(self) -> np.ndarray | None:
        r"""Return :math:`H_0 / \hbar` and each :math:`H_k / \hbar` as arrays of the core.

        None where a potential depends on time, or H(t) is known by its products.
        """
        if self._moving is not None or self.moving_product is not None:
            return None
        unit = np.eye(self.hamiltonian.size)
        terms = [_core.Hamiltonian(term.operators) for term in self._terms]
        return np.array([[term.multiply(row) for row in unit] for term in terms])

    @cached_property
    def _recorded(self) -> tuple[_core.Tape, list[Any]]:
        """The program of the weights of all operators, and the functions it was recorded for."""
        tape = time_functions.weights(self._functions, self.groups, self._params)
        return tape, [function for function, _ in self._drive]

    @cached_property
    def _weights(self) -> _core.Tape:
        """The program of the weights of all operators, for all values of the parameters."""
        tape, recorded = self._recorded
        replaced: list[tuple[_core.Column, _core.Column]] = []
        for old, (new, _) in zip(recorded, self._drive, strict=True):
            if new is not old:  # other samples at the same times
                pairs = old.table.replaced(new.table)
                if pairs is None:
                    del self._recorded
                    return self._recorded[0]
                replaced += pairs
        return tape.with_columns(replaced) if replaced else tape

    def drive_values(self, times: np.ndarray, params: np.ndarray | None = None) -> np.ndarray:
        """Return each function of time at times, shape (k, count); they may be not finite.

        Values of all parameters may be given in place of the system's own.
        """
        if not self._functions:
            return np.zeros((times.size, 0))
        args = [np.ascontiguousarray(times, dtype=float)[:, None]]
        params = self._params.values(None) if params is None else params
        found: np.ndarray = self._weights.map(params, args)
        return found[:, np.cumsum(self.groups)[:-1]]

    def check_time(self, t: float) -> None:
        """Refuse a time at which the potential or a drive is not finite: ValueError names it."""
        self._finite_values(np.array([t]))
        if self._moving is not None and self.grid is not None:
            self._moving.at(t, self.places)

    def product_at(self, t: float) -> Callable[[np.ndarray], np.ndarray]:
        r"""Return the product of :math:`H / \hbar` at a time with a real vector of the core."""
        if self.moving_product is not None:
            return self.at(t).multiply
        terms = [_core.Hamiltonian(term.operators) for term in self._terms]
        weights = [1.0, *self._finite_values(np.array([t]))[0].tolist()]
        parts = [pair for pair in zip(weights, terms, strict=True) if pair[0]]
        potential: np.ndarray | None = None
        if self._moving is not None and self.grid is not None:
            values = self._moving.at(t, self.places) / self.hbar
            potential = np.tile(values, self.hamiltonian.size // self.size)

        def product(x: np.ndarray) -> np.ndarray:
            found = np.zeros_like(x) if potential is None else potential * x
            for weight, term in parts:
                found += weight * term.multiply(x)
            return found

        return product

    def drive_ranges(self, times: np.ndarray) -> list[Bounds] | None:
        """Return the least and the largest value of each function of time at these times.

        None where a potential depends on time, or a value is not finite.
        """
        if self._moving is not None:
            return None
        found = self.drive_values(times)
        if not np.isfinite(found).all():
            return None
        return [(float(values.min()), float(values.max())) for values in found.T]

    def _finite_values(self, times: np.ndarray) -> np.ndarray:
        """Return them, each seen to be finite: ValueError names one that is not."""
        found = self.drive_values(times)
        for function, values in zip(self._functions, found.T, strict=True):
            function.check(times, values)
        return found

    @cached_property
    def settled(self) -> Self:
        """The same H without time, where no function of its drive depends on it; else this one."""
        if self._moving is not None or not self._functions:
            return self
        if any(function.is_driven for function in self._functions):
            return self
        values = self._finite_values(np.zeros(1))[0].tolist()
        each = [self._terms[0]]
        for k, (value, (_, matrix)) in enumerate(zip(values, self._drive, strict=True)):
            entries = Entries.read(f"H{k + 1}", matrix)
            each.append(term_of_matrix(entries, self.frame, value / self.hbar))
        bounds = None
        if self.hamiltonian.size <= FEW:
            (bounds,) = self.corners([tuple(values)])
        else:
            known = [term.bounds for term in each if term.bounds is not None]
            if len(known) == len(each):
                bounds = sum(low for low, _ in known), sum(high for _, high in known)
        other = copy(self)
        for name in OF_DRIVE:
            other.__dict__.pop(name, None)
        operators = [operator for term in each for operator in term.operators]
        other._functions, other._drive, other._terms = [], [], [Term(operators, bounds)]
        other._join()
        return other

    def _join(self) -> None:
        """Make the core's H of the terms and of functions of time."""
        flat = [operator for term in self._terms for operator in term.operators]
        more = self._beside_the_terms()
        self.hamiltonian = _core.Hamiltonian(flat, self.frame.is_doubled, **more)

    def _beside_the_terms(self) -> dict[str, Any]:
        """Return the arguments of H beside its constant terms: a drive, a moving potential."""
        params = self._params.values(None)
        more: dict[str, Any] = {}
        if self._functions:
            more["drive"] = (self._weights, params)
        if self._moving is not None and self.grid is not None:
            own = self._moving.parted(1 / self.hbar)
            at = own.of_place.map(params, [np.ascontiguousarray(self.places)])
            points = np.tile(at, (1 + self.frame.is_doubled, 1))
            more["potential"] = (own.of_time, own.both, params, points.ravel())
        return more

    def points_between(self, t0: float, t1: float) -> tuple[float, ...]:
        """Return the times of a run at which H(t) is looked at besides and jumps, in its order."""
        low, high = min(t0, t1), max(t0, t1)
        jumps = foreign.times_of_samples(self._drive, 0)
        found = tuple(sorted({t for t in (*self.points, *jumps) if low <= t <= high}))
        return found if t1 > t0 else found[::-1]

    @property
    def takes_lanczos(self) -> bool:
        """Whether closer bounds than the rigorous ones may be found by Lanczos' method."""
        return self._way in ("auto", "lanczos")

    def corners(self, each: Sequence[tuple[float, ...]]) -> list[Bounds]:
        r"""Bound the eigenvalues of :math:`H / \hbar` for these values of the functions of time.

        They are those of the eigenvalues at the ends of a small H, and else of Lanczos' method.
        """
        new = [values for values in each if values not in self._known]
        if self._parts is None:
            find = likely if self._way == "lanczos" else probable
            for values in new:
                repeated = np.repeat((1.0, *values), self.groups).tolist()
                self._known[values] = find(self.hamiltonian, repeated).bounds
        elif new:
            factors = np.column_stack([np.ones(len(new)), new])
            ends = np.linalg.eigvalsh(np.tensordot(factors, self._parts, axes=1))[:, [0, -1]]
            ends += 1e-12 * np.abs(ends).max(axis=1, keepdims=True) * [-1.0, 1.0]
            self._known.update(zip(new, map(tuple, ends.tolist()), strict=True))
        return [self._known[values] for values in each]

    def at(self, t: float) -> _core.Hamiltonian:
        """Return an H(t) that is known by its products at a time.

        Raises
        ------
        TypeError, ValueError
            It makes no products there, or they belong to no Hermitian matrix.
        """
        assert self.moving_product is not None
        if t not in self._times:
            product = self.moving_product.at(t)
            found = _core.Hamiltonian([product.operator(1 / self.hbar, is_doubled=True)], True)
            check_symmetric(f"H({t:g})", found)
            self._times[t] = found
        return self._times[t]

    @cached_property
    def _times(self) -> dict[float, _core.Hamiltonian]:
        return {}

    def separated(self, t0: float, t1: float, tol: float) -> Separated | None:
        """Return an H(t) known by its products as a sum, if a run finds it to be one."""
        product, key = self.moving_product, (t0, t1, tol)
        if product is None:
            return None
        self._check_way()
        if key not in self._sums:

            def multiply(t: float, x: np.ndarray) -> np.ndarray:
                return product.multiply(t, x).astype(complex) / self.hbar

            def at(t: float) -> tuple[_core.Operator, _core.Hamiltonian]:
                known = self.at(t)
                return product.at(t).operator(1 / self.hbar, is_doubled=True), known

            ways = (at, likely if self._way == "lanczos" else probable)
            points = self.points_between(t0, t1)
            found = separate(multiply, ways, product.n, (t0, t1), tol, points)
            if found is not None and self._given is not None:
                found = replace(found, spectrum=Spectrum(self._given, GIVEN))
            self._sums[key] = found
        return self._sums[key]

    @cached_property
    def _sums(self) -> dict[tuple[float, float, float], Separated | None]:
        return {}

    def spectrum_at(self, t: float) -> Spectrum:
        """Bound the eigenvalues of an H(t) that is known by its products, by Lanczos' method."""
        known = self.at(t)
        if self._given is not None:
            return Spectrum(self._given, GIVEN)
        self._check_way()
        if t not in self._spectra:
            self._spectra[t] = (likely if self._way == "lanczos" else probable)(known)
        return self._spectra[t]

    @cached_property
    def _spectra(self) -> dict[float, Spectrum]:
        return {}

    @cached_property
    def _known(self) -> dict[tuple[float, ...], Bounds]:
        return {}

    @cached_property
    def _parts(self) -> np.ndarray | None:
        """The parts of a small H as arrays."""
        return self.parts() if self.hamiltonian.size <= FEW else None

    @property
    def bounds(self) -> Bounds:
        r"""Numbers below and above all eigenvalues of :math:`H / \hbar`; if driven, at t = 0.

        Raises
        ------
        ValueError
            The bounds that were given leave out an eigenvalue; the message has both.
        """
        return self._spectrum.bounds

    @property
    def guarantee(self) -> str:
        """Their kind: "rigorous", "probable", "with probability 1 - 1e-6" or "given"."""
        if self.is_driven and self._given is None and self.moving_product is None:
            is_known = all(term.bounds is not None for term in self._terms)
            return RIGOROUS if is_known else PROBABLE
        return self._spectrum.guarantee

    @cached_property
    def _spectrum(self) -> Spectrum:
        if self._given is not None:
            if not self.is_driven:
                check_inside(self._given, self._static, self.hbar)
            return Spectrum(self._given, GIVEN)
        if self.is_driven:
            if self.moving_product is not None:
                return self.spectrum_at(0.0)
            return Spectrum(self.bounds_at(0.0), self.guarantee)
        rigorous = self._terms[0].bounds
        if self._way == "lanczos":
            return inside(likely(self._static), rigorous)
        if rigorous is not None:
            return Spectrum(rigorous, RIGOROUS)
        self._check_way()
        return self._closer

    def _check_way(self) -> None:
        if self._way == "gershgorin":
            sentence = "H is known by its products, which have no discs of Gershgorin's"
            raise ValueError(hinted(sentence, "give bounds='lanczos', or leave bounds= out"))

    @cached_property
    def _closer(self) -> Spectrum:
        """Probable bounds, no wider than rigorous ones."""
        return inside(probable(self._static), self._terms[0].bounds)

    def spectrum(self, span: float) -> Spectrum:
        """Return bounds that are worth finding for a run over so much time, and what they are."""
        found = self._spectrum
        low, high = found.bounds
        is_wide = 0.5 * (high - low) * span > WORTH and self.size > SMALL
        is_free = self._way == "auto" and found.guarantee == RIGOROUS and not self.is_driven
        return self._closer if is_wide and is_free else found

    def bounds_at(self, t: float) -> Bounds:
        r"""Return (least, largest), bounds of the eigenvalues of :math:`H / \hbar` at a time.

        Raises
        ------
        ValueError
            A drive or a potential is not finite at this time.
        """
        low, high = self.bounds_over(np.array([t]))[0].tolist()
        return low, high

    def bounds_over(self, times: np.ndarray) -> np.ndarray:
        r"""Bound the eigenvalues of :math:`H / \hbar` at times, shape (k, 2)."""
        if self._given is not None:
            return np.tile(self._given, (times.size, 1))
        if self.moving_product is not None:
            return np.array([self.spectrum_at(t).bounds for t in times.tolist()])
        found = np.tile(self.term_bounds[0], (times.size, 1))
        for values, ends in zip(self._finite_values(times).T, self.term_bounds[1:], strict=True):
            found += np.sort(np.outer(values, ends), axis=1)
        if self._moving is not None and self.grid is not None:
            for own, t in zip(found, times.tolist(), strict=True):
                values = self._moving.at(t, self.places) / self.hbar
                own += values.min(), values.max()
        return found
