"""Parts of H that are functions of the position or of the density, and of the component."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from liouville import _core
from liouville._basics.errors import hinted
from liouville._systems.waves import components as of_components
from liouville._systems.waves import observed
from liouville._systems.waves.bounded import Bounded
from liouville._systems.waves.entries import Entries, check_size
from liouville._systems.waves.forms import Term, repeated, source_of, term_of
from liouville._systems.waves.frame import Frame
from liouville._systems.waves.grid import Grid
from liouville._systems.waves.lattice import Lattice, on_sites
from liouville._systems.waves.nonlinearity import Nonlinearity
from liouville._systems.waves.time_functions import TimeFunction, point

#: The hint where an equation is not linear, or absorbs.
TAKEN = "take 'auto' or SplitOperator(tol=1e-8), or SplitOperator() with h= or steps="

#: Values computed once of functions of time and their parameters, ...
OF_FUNCTIONS = ("_spectrum", "_known", "settled", "sensitivity", "potential_sensitivity")

#: ... and of a potential.
OF_POTENTIAL = ("_static", "_closer", "_parts", "term_bounds")


class OnGrid(Bounded):
    """A base of :class:`Schrodinger`: what is a function of the position or of the density."""

    source: Any
    components: int
    has_diagonal_drive: bool
    _coupling: Entries | None
    potential: np.ndarray | None
    nonlinearity: Nonlinearity | None
    _potential: TimeFunction | None
    _absorbing: TimeFunction | np.ndarray | None

    def _first(self, source: Any) -> Term:
        """Make the term of the Hamiltonian without its drive."""
        self.potential, self._potential, self._moving = None, None, None
        if isinstance(source, Grid):
            own = of_components.potential(source, self._params, self.components)
            return self._of_grid(source, own)
        return term_of(source, self.source, self.frame, 1 / self.hbar)

    @property
    def is_driven(self) -> bool:
        """Whether H has a drive, or depends on time."""
        return super().is_driven or (self.nonlinearity is not None and self.nonlinearity.is_driven)

    def with_potential(self, potential: ArrayLike) -> Self:
        """Return the equation with another potential of its grid or lattice.

        Raises
        ------
        TypeError, ValueError
            It has neither, or the potential does not fit.
        """
        if not isinstance(self.source, (Grid, Lattice)):
            sentence = f"potential= is that of a Grid or a Lattice, not of {self!r}"
            raise TypeError(hinted(sentence, "give functions of a drive parameters"))
        other = copy(self)
        # the weights of a drive are those of as many operators, which a potential of zero has not
        for name in (*OF_FUNCTIONS, *OF_POTENTIAL, "_recorded", "_weights"):
            other.__dict__.pop(name, None)
        other.source = self.source.with_potential(potential)
        other.grid = other.source if isinstance(other.source, Grid) else None
        other._terms = [other._first(source_of(other.source)), *self._terms[1:]]
        other._join()
        return other

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """The shapes that a state may have."""
        shape = getattr(self.source, "shape", (self.size,))
        is_model = isinstance(self.source, (Grid, Lattice))
        if self.components > 1:
            shape = (self.components, *shape)
        return [(self.size,), *([shape] if is_model and len(shape) > 1 else [])]

    @property
    def potential_shapes(self) -> list[tuple[int, ...]]:
        """The shapes that the potential of a grid or lattice may have."""
        if self.components == 1 or self.grid is None:
            return self.shapes
        return [(self.grid.size,), self.grid.shape, self.shapes[-1]]

    @property
    def is_split(self) -> bool:
        """Whether it is T + V on a grid as :class:`SplitOperator` takes it."""
        return self.grid is not None and self.has_diagonal_drive and not self.frame.is_doubled

    def _read_nonlinearity(self, function: Callable[..., Any] | None) -> Nonlinearity | None:
        """Return a function of the density, on a grid alone."""
        if function is None:
            return None
        if self.grid is None:
            sentence = "a nonlinearity is a function of the density on a Grid, and H is none"
            raise TypeError(
                hinted(sentence, "write lv.Schrodinger(lv.Grid(...), nonlinearity=...)")
            )
        if not self.has_diagonal_drive:
            sentence = "a nonlinearity takes drives by diagonal matrices alone, which add to V"
            raise TypeError(hinted(sentence, "give the drive as a potential of t and x"))
        return Nonlinearity(function, self._params, self.components)

    def _check_real(self) -> None:
        """Refuse a nonlinearity beside a coupling that no phases make real."""
        if self.nonlinearity is not None and self.frame.is_doubled:
            sentence = "a nonlinearity takes a coupling that phases of the components make real, "
            hint = "a flux of 0 or pi goes through every loop of a real one"
            raise ValueError(hinted(f"{sentence}and none do here", hint))

    def _read_absorber(self, given: Any) -> TimeFunction | np.ndarray | None:
        """Return a part of the potential that absorbs, as a function or as values at all points."""
        if given is None:
            return None
        if self.nonlinearity is not None:
            sentence = "an absorber changes the density within the flow of a nonlinearity"
            raise TypeError(hinted(sentence, "leave one of them out"))
        if not callable(given):
            if self.grid is not None:
                given = of_components.on_all(given, self.grid, self.components)
            return on_sites("absorber", given, self.shapes[-1]).ravel()
        if self.grid is None:
            sentence = "the absorber is a function of the position on a Grid, and H is none"
            raise TypeError(hinted(sentence, "give an array of its values at all components"))
        found = self._of_place("absorber", given)
        if found.is_driven:
            raise ValueError("the absorber must not depend on time")
        return found

    @property
    def may_absorb(self) -> bool:
        """Whether there is an absorber, be it zero at these parameters."""
        return self._absorbing is not None

    @cached_property
    def absorber(self) -> np.ndarray | None:
        """W of an H - iW, one value for each component, None where nothing absorbs.

        Raises
        ------
        ValueError
            A value is negative, or not finite; the message has the place.
        """
        if self._absorbing is None:
            return None
        values = self._absorbing
        if isinstance(values, TimeFunction) and self.grid is not None:
            values = values.at(0.0, self.places)
        assert isinstance(values, np.ndarray), "a function is one on a grid"
        least = int(np.argmin(values))
        if values[least] < 0:
            place = f"component {least}"
            if self.grid is not None:
                which, k = divmod(least, self.grid.size)
                own = f" of component {which}" if self.components > 1 else ""
                place = f"x = {point(self.grid.points[k])}{own}"
            found = f"{values[least]:g} at {place}"
            sentence = f"absorber must not be negative, where psi grows, as {found}"
            raise ValueError(hinted(sentence, "H - iW absorbs where W is positive"))
        return values if values.any() else None

    @property
    def is_plain(self) -> bool:
        """Whether the equation is linear and nothing absorbs."""
        return self.nonlinearity is None and self.absorber is None

    def check_linear(self, what: str, hint: str = TAKEN) -> None:
        """Refuse a potential of the density for what takes none."""
        if self.nonlinearity is not None:
            sentence = f"{what} is for a linear equation, and this one has a nonlinearity"
            raise TypeError(hinted(sentence, hint))

    def check_plain(self, what: str, hint: str = "") -> None:
        """Refuse a potential of the density, or one that absorbs, for what takes none."""
        self.check_linear(what, hint or TAKEN)
        if self.absorber is not None:
            sentence = f"{what} is for a Hermitian H, and this one has an absorber"
            by_products = "take 'auto' or Lanczos()"
            raise TypeError(hinted(sentence, hint or (TAKEN if self.grid else by_products)))

    def _beside_the_terms(self) -> dict[str, Any]:
        """Return the arguments of H beside its constant terms, with those of a grid alone."""
        more = super()._beside_the_terms()
        if self.nonlinearity is not None and self.grid is not None:
            tapes = self.nonlinearity.tapes(1 / self.hbar)
            more["nonlinearity"] = (*tapes, self._params.values(None), self.grid.cell)
        if self.absorber is not None:
            more["absorber"] = self.frame.diagonal(self.absorber / self.hbar)
        return more

    def _of_grid(self, grid: Grid, found: TimeFunction | np.ndarray) -> Term:
        kinetic = [energies / self.hbar for energies in grid.kinetic(self.hbar)]
        check_size("T / hbar", np.concatenate(kinetic))
        self.places = of_components.places(grid, self.components)
        is_doubled = self.frame.is_doubled
        copies = self.components * (1 + is_doubled)
        terms = [repeated(_core.Operator.kinetic(kinetic), copies)]
        low, high = 0.0, float(sum(energies.max() for energies in kinetic))
        if self.between is not None:
            matrix = self.between / self.hbar
            own, levels = of_components.operator(matrix, grid.size, is_doubled)
            terms.append(own)
            low, high = low + float(levels[0]), high + float(levels[-1])
        if isinstance(found, TimeFunction):
            self._potential = found
            if found.is_driven:
                self._moving = found
                return Term(terms, (low, high))
            found = found.at(0.0, self.places)
        self.potential = found / self.hbar
        low, high = low + float(self.potential.min()), high + float(self.potential.max())
        if self.potential.any():
            diagonal = _core.Operator.diagonals(self.size, [0], [self.potential])
            terms.append(repeated(diagonal, 1 + is_doubled))
        return Term(terms, (low, high))

    def potential_at(self, t: float) -> np.ndarray:
        r"""Return :math:`V / \hbar` on a grid at a time, one value for each point."""
        assert self.grid is not None, "an equation on a grid"
        if self._moving is not None:
            return self._moving.at(t, self.places) / self.hbar
        assert self.potential is not None, "a potential that does not depend on time"
        return self.potential

    def density(self, psi: np.ndarray) -> np.ndarray:
        r"""Return :math:`|\psi_a|^2` at all points of states, a row a point, over the volume."""
        assert self.grid is not None, "an equation on a grid"
        found = (psi.real**2 + psi.imag**2) / self.grid.cell
        parts = found.reshape(-1, self.components, self.grid.size)
        rows: np.ndarray = np.swapaxes(parts, 1, 2).reshape(-1, self.components)
        return rows

    @property
    def mixes(self) -> bool:
        """Whether norm may go from one component to another."""
        coupling = self._coupling
        is_diagonal = coupling is None or coupling.is_diagonal
        return not (is_diagonal and self.has_diagonal_drive)

    @property
    def coupled(self) -> float:
        """The largest difference of energies of the coupling."""
        return 0.0 if self.between is None else float(np.ptp(np.linalg.eigvalsh(self.between)))

    @property
    def between(self) -> np.ndarray | None:
        """The coupling of components as the core has them, None where there is none."""
        if self._coupling is None:
            return None
        gauge = self.frame.gauge
        own = Frame(
            self.components, None, None if gauge is None else gauge[:: self.size // self.components]
        )
        return own.entries(self._coupling).dense()

    @property
    def populations(self) -> np.ndarray:
        """The diagonals whose means are the populations of components, none of a single one."""
        if self.components == 1:
            return np.empty((0, self.size))
        return np.repeat(np.eye(self.components), self.size // self.components, axis=1)

    def _of_place(self, what: str, function: Callable[..., Any]) -> TimeFunction:
        assert self.grid is not None, "an equation on a grid"
        return of_components.of_place(what, function, self._params, self.grid, self.components)

    def _at_points(self, name: str, function: Callable[..., Any]) -> np.ndarray:
        if self.grid is None:
            raise TypeError(observed.without_grid(name))
        traced = self._of_place(f"observable '{name}'", function)
        if traced.is_driven:
            raise ValueError(f"observable '{name}' must not depend on time")
        return traced.at(0.0, self.places)
