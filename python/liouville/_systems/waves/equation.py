"""The Schrödinger equation as a system."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any, Generic, Self, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import amount, read_only
from liouville._systems.tracing import trace as _trace
from liouville._systems.waves import components as of_components
from liouville._systems.waves import foreign, forms, graph, observed, time_functions
from liouville._systems.waves.bounds import check_symmetric, interval, positive, way
from liouville._systems.waves.entries import Entries
from liouville._systems.waves.exchange import Exchange
from liouville._systems.waves.frame import Frame
from liouville._systems.waves.grid import Grid
from liouville._systems.waves.lattice import Lattice
from liouville._systems.waves.moving import MovingProduct
from liouville._systems.waves.nonlinearity import Nonlinearity
from liouville._systems.waves.observed import Observable
from liouville._systems.waves.on_grid import OF_FUNCTIONS, OF_POTENTIAL, OnGrid
from liouville._systems.waves.products import Product
from liouville._systems.waves.sensitivity import DriveSensitivity, PotentialSensitivity
from liouville._systems.waves.sites.system import SiteSystem
from liouville._systems.waves.spins import SpinChain
from liouville._systems.waves.time_functions import TimeFunction
from liouville._systems.waves.typed import Density, Options


class Schrodinger(OnGrid, Generic[Density]):
    r"""The Schrödinger equation.

    .. math::

        i \hbar\, \psi' = H \psi, \qquad H = H_0 + \sum_k f_k(t) H_k

    Parameters
    ----------
    hamiltonian : sparse matrix, array_like, Qobj, model, LinearOperator, tuple or list
        :math:`H_0`, Hermitian: a sparse matrix of SciPy's, a square array, an operator of QuTiP's
        or QuSpin's, one of the library's models, or what makes products, a LinearOperator or
        ``(N, function)``. A list ``[H0, [H1, f1], [H2, f2]]``, as QuTiP has it, has drives too,
        whose functions may be ``f(t)``, ``f(t, args)`` or ``f(t, name, ...)``. An H(t) known by its
        products is ``(N, function)`` of t and psi, or a function of t that returns an operator.
    bounds : {"auto", "gershgorin", "lanczos"} or tuple of two floats
        How bounds of the eigenvalues are found, or numbers below and above all of them, at all
        times; see the notes.
    hbar : float, default 1.0
        Planck's constant in the units of the Hamiltonian.
    drive : sequence of tuple, optional
        Pairs :math:`(f_k, H_k)`: a function ``f(t, params)``, called once with CasADi symbols, and
        a Hermitian matrix, or the array of a diagonal one. Samples at `times` stand for a function.
        With a K that is not Hermitian, two functions (x, y), or one or samples with complex values,
        are z = x + iy of :math:`z K + \bar z K^\dagger`, whose second term may be given, too.
    times : array_like, optional
        When samples are taken: the function is the cubic spline through them. A run that leaves
        these times by more than half the distance of two is refused.
    order : {3, 0}
        Of order 0 a sample holds from its time up to the next one, as controls in slots do. There
        may be one fewer than times, and no run leaves these.
    points : array_like, optional
        Times at which H(t) is looked at and steps end, as in the middle of a short pulse.
    params : mapping of str to float or 1-D array_like, optional
        Parameters by name, with default values; functions see ``params.name``.
    nonlinearity : callable, optional
        On a grid a potential that depends on the density at its point, as of a condensate,
        :math:`i \hbar \psi' = (H + W(t, |\psi(x)|^2)) \psi`: ``W(t, rho, params)``, called once
        with CasADi symbols; rho is :math:`|\psi|^2`, a squared component over ``grid.cell``. Of
        several components rho has the density of each, and W a value for each, or one for all.
    components : int, default 1
        On a grid the number of components of the wave function, as of spins: a state has shape
        ``(components, *grid.shape)``, or flat.
    coupling : array_like, optional
        A Hermitian matrix between the components, the same at all points and times.
    absorber : array_like or callable, optional
        W >= 0 of :math:`H - i W`, a value for each component, which absorbs what comes to the ends
        of a grid or lattice, or decays: an array of its shape, or flat, or on a grid
        ``W(t, x, params)`` that does not depend on time.

    Attributes
    ----------
    states : tuple of str
        What a start and a solution call the state: ("psi",).
    size : int
        Number of components N of a state.
    source, hbar, points
        The Hamiltonian, Planck's constant and times as given.
    grid : Grid or None
        The grid, if there is one.
    components : int
        The number of wave functions on it.
    nonlinearity : Nonlinearity or None
        The potential of the density, if there is one; bounds are those of H without it.
    is_driven : bool
        Whether H has a drive, or depends on time.
    has_diagonal_drive : bool
        Whether the matrices of the drive are diagonal, or there are none.
    is_real : bool
        Whether H is real, after its phases are taken away where that can be done.
    is_foreign : bool
        Whether a function of the user's makes the products.
    moving_product : MovingProduct or None
        An H(t) known by its products.
    frame : Frame
        How the core has the components of a state.
    hamiltonian : _core.Hamiltonian
        :math:`H / \hbar` in the core.
    potential : ndarray or None
        Of a grid whose potential is constant, :math:`V / \hbar`.

    Raises
    ------
    TypeError
        An argument is of the wrong kind.
    ValueError
        H is not Hermitian, not finite or not square, or a drive does not fit it; the message names
        the entry, where :math:`H - H^\dagger` is largest.

    Notes
    -----
    Entries that mirror one another may differ by 1e-14 of the largest, of a matrix of single
    precision by 2e-6; their mean is taken.

    A complex H has a gauge if phases g make all :math:`\bar g_i H_{ij} g_j` real, which is so if
    the flux through every loop is 0 or :math:`\pi`. Then :math:`\bar g \psi` is propagated with a
    real matrix. Otherwise `is_real` is False, and H acts as a real matrix on real and imaginary
    parts. That is so, too, of an H known by its products if they, a drive or time make it complex.

    A drive with a complex weight is one of two Hermitian matrices with real ones,
    :math:`z K + \bar z K^\dagger = \Re z\, (K + K^\dagger) + \Im z\, i (K - K^\dagger)`.

    Bounds are those of Gershgorin for a matrix, the least and largest energies of a grid, closed
    formulas for a lattice, the energies of blocks for a chain of spins; up to N = 256 they are the
    eigenvalues at the ends. All are rigorous but those of what is known by products: there they
    are found by Lanczos' method.

    ``"gershgorin"`` takes these bounds alone. ``"lanczos"`` takes 40 to 80 steps of Lanczos' method
    from a random vector, whose bounds hold with probability 1 - 1e-6 :cite:p:`kuczynski1992`.
    ``"auto"`` takes the rigorous ones, and for products and long runs of more than 256 components
    40 steps, whose Ritz values with residuals, widened by 1 %, are probable bounds
    :cite:p:`zhou2011`. A plan says which it has. A Chebyshev series finds an energy outside its
    bounds, and begins again with wider ones.

    Examples
    --------
    >>> import numpy as np
    >>> import liouville as lv
    >>> lv.Schrodinger(np.array([[0.0, 1.0], [1.0, 0.0]]))
    Schrodinger(2 components)
    >>> lv.Schrodinger(np.array([[0.0, 1.0], [2.0, 0.0]]))
    Traceback (most recent call last):
    ...
    ValueError: H is not Hermitian: H[0, 1] = 1, but H[1, 0] = 2, where H - H^+ is largest: 1, ...
    hint: ...
    """

    states = ("psi",)
    coordinates: tuple[str, ...] = ()
    constraints: tuple[str, ...] = ()

    @overload
    def __init__(
        self: Schrodinger[None], hamiltonian: Any, *, nonlinearity: None = None,
        **options: Unpack[Options],
    ) -> None: ...  # fmt: skip
    @overload
    def __init__(
        self: Schrodinger[Nonlinearity], hamiltonian: Any, *, nonlinearity: Callable[..., Any],
        **options: Unpack[Options],
    ) -> None: ...  # fmt: skip
    def __init__(
        self,
        hamiltonian: Any,
        *,
        bounds: tuple[float, float] | str = "auto",
        hbar: float = 1.0,
        drive: Sequence[tuple[Callable[..., Any] | ArrayLike, Any]] = (),
        times: ArrayLike | None = None,
        order: int = 3,
        points: ArrayLike = (),
        params: Mapping[str, ArrayLike] | None = None,
        nonlinearity: Callable[..., Any] | None = None,
        components: int = 1,
        coupling: ArrayLike | None = None,
        absorber: Callable[..., Any] | ArrayLike | None = None,
    ) -> None:
        self.points = foreign.points_of(points)
        self._params = _trace.Parameters(params)
        parted = foreign.parted(hamiltonian, drive, times, order, self._params)
        self.source, self._drive = parted
        self.hbar = positive("hbar", hbar)
        self._given, self._way = interval(bounds, self.hbar), way(bounds)
        self._between = components, coupling
        self._drive = of_components.drives(self._drive, self.source, components)
        self._make(None, nonlinearity, absorber)
        if self.points and not self.is_driven:
            raise ValueError(
                "points must be times of an H that depends on time, and none does here"
            )

    def _make(self, frame: Frame | None, nonlinearity: Any, absorber: Any) -> None:
        """Make the core's form of H, in a frame if it is known."""
        hamiltonian, drive = self.source, self._drive
        self.grid = hamiltonian if isinstance(hamiltonian, Grid) else None
        source = forms.source_of(hamiltonian)
        self.size: int = source.size if isinstance(source, (Grid, Exchange)) else source.n
        self.components, self._coupling = of_components.read(*self._between, self.grid)
        self.size *= self.components
        self.moving_product = source if isinstance(source, MovingProduct) else None
        if self.moving_product is not None:
            self.moving_product.check_alone(drive)
        self._functions, driven = time_functions.read(drive, self._params, self.size)
        self.has_diagonal_drive = all(matrix.is_diagonal for matrix in driven)
        if isinstance(source, Exchange) and not all(matrix.is_real for matrix in driven):
            source = source.entries()
        self.nonlinearity = self._read_nonlinearity(nonlinearity)
        self._absorbing = self._read_absorber(absorber)
        self.frame = self._framed([source, *driven]) if frame is None else frame
        self._check_real()
        self._build(source, driven)

    def _state(self) -> dict[str, Any]:
        """Return the parts to pickle, with the bounds, which another processor might round."""
        source = self.source
        if self._potential is not None:
            source = source.with_potential(self._potential)
        pairs = zip(self._functions, self._drive, strict=True)
        names = ("hbar", "points", "_params", "_given", "_way", "frame", "_between")
        own = {name: getattr(self, name) for name in names}
        drive = [(x if isinstance(x, foreign.Samples) else f, matrix) for f, (x, matrix) in pairs]
        own |= {"source": source, "_drive": drive}
        cached = ("bounds", "_spectrum", "_closer")
        found = {name: x for name, x in self.__dict__.items() if name in cached}
        density = None if self.nonlinearity is None else self.nonlinearity.potential
        more = {"nonlinearity": density, "_absorbing": self._absorbing}
        return {**own, **found, **more, "term_bounds": self.term_bounds}

    def _restore(self, state: dict[str, Any]) -> None:
        super()._restore(state)
        self._make(state["frame"], state["nonlinearity"], state["_absorbing"])

    def _framed(self, parts: Sequence[Any]) -> Frame:
        matrices = [part for part in parts if isinstance(part, Entries)]
        phases, is_doubled = None, False
        coupling = self._coupling
        if coupling is not None and not coupling.is_real:
            if self.has_diagonal_drive and (phases := graph.gauge([coupling])) is not None:
                phases = np.repeat(phases, self.size // self.components)
            return Frame(self.size, None, phases, phases is None)
        if self.moving_product or not all(getattr(part, "is_real", True) for part in parts):
            phases = graph.gauge(matrices) if len(matrices) == len(parts) else None
            is_doubled = phases is None
        order = None
        if isinstance(self.source, Lattice):
            order = self.source.order()
        elif len(matrices) == len(parts):
            order = graph.narrow(matrices)
        return Frame(self.size, order, phases, is_doubled)

    def _build(self, source: Any, driven: list[Entries]) -> None:
        """Make the terms, and what the core calls them."""
        each = (forms.term_of_matrix(matrix, self.frame, 1 / self.hbar) for matrix in driven)
        self._terms = [self._first(source), *each]
        self.is_foreign = isinstance(source, (Product, MovingProduct))
        self._join()
        if isinstance(source, Product):
            check_symmetric("H", self._static)

    def __repr__(self) -> str:
        """Name the model, or the number of components."""
        is_model = isinstance(self.source, (Grid, Lattice, SpinChain, SiteSystem))
        what = repr(self.source) if is_model else amount(self.size, "component")
        what += f", {self.components} components" if self.components > 1 else ""
        return f"{type(self).__name__}({what}{', driven' if self.is_driven else ''})"

    @property
    def is_real(self) -> bool:
        """Whether H is real, after its phases are taken away where that can be done."""
        return not self.frame.is_doubled

    @property
    def parameters(self) -> _trace.Parameters:
        """The parameters with their symbols."""
        return self._params

    @property
    def functions(self) -> list[TimeFunction]:
        """The functions of the drive, as expressions."""
        return self._functions

    @property
    def drives(self) -> list[tuple[Any, Any]]:
        """Pairs of the functions of the drive and their matrices, as given."""
        return self._drive

    @cached_property
    def sensitivity(self) -> DriveSensitivity:
        """The derivatives of the functions of the drive."""
        return DriveSensitivity(self)

    @cached_property
    def potential_sensitivity(self) -> PotentialSensitivity | None:
        """The derivatives of the potential of a grid, None where it is no function of one value."""
        if self._potential is None or self.components > 1:
            return None
        return PotentialSensitivity(self, self._potential)

    @property
    def params(self) -> dict[str, Any]:
        """The parameters' default values, read-only; a run takes others by its ``params=``."""
        return read_only(self._params.defaults)

    def with_params(self, params: Mapping[str, ArrayLike] | None) -> Self:
        """Return the equation with other parameters; ValueError names an unknown one."""
        if not params:
            return self
        new = self._params.replaced(self._params.values(params))
        return self._of_other(self._drive, [f.with_params(new) for f in self._functions], new)

    def _of_other(
        self, drive: list[Any], functions: list[TimeFunction], params: _trace.Parameters
    ) -> Self:
        """Return the equation of the same matrices with other functions of time, or parameters."""
        other = copy(self)
        for name in (*OF_FUNCTIONS, *(OF_POTENTIAL if self._potential is not None else ())):
            other.__dict__.pop(name, None)
        other._drive, other._functions, other._params = drive, functions, params
        if drive is not self._drive:
            other.__dict__.pop("_weights", None)
        else:  # programs are those of all values
            other.__dict__["sensitivity"] = self.sensitivity.with_params(params)
            if self.potential_sensitivity is not None:
                own = self.potential_sensitivity.with_params(params)
                other.__dict__["potential_sensitivity"] = own
        if self.nonlinearity is not None:
            other.nonlinearity = self.nonlinearity.with_params(params)
        if isinstance(self._absorbing, TimeFunction):
            other._absorbing = self._absorbing.with_params(params)
            other.__dict__.pop("absorber", None)
        if self._potential is not None and self.grid is not None:
            first = other._of_grid(self.grid, self._potential.with_params(params))
            other._terms = [first, *self._terms[1:]]
        other._join()
        return other

    def with_samples(self, samples: Mapping[str, ArrayLike]) -> Self:
        """Return the equation with other samples at the same times, by names as ``drive[0]``."""
        drive, functions = foreign.resampled(self._drive, samples), [*self._functions]
        for k, (new, _) in enumerate(drive):
            if new is not self._drive[k][0]:
                functions[k] = functions[k].replaced(new, self._params)
        return self._of_other(drive, functions, self._params)

    def inward(self, psi: Any, is_ensemble: bool = False) -> np.ndarray:
        """Check a state and return it as the core has it, or P states as its rows.

        Raises
        ------
        TypeError
            It is no array of numbers.
        ValueError
            It has a wrong shape, is zero, or not finite; the message names the component.
        """
        given = foreign.state(psi, self.size, is_ensemble)
        return self.frame.inward(observed.checked(given, self.shapes, is_ensemble))

    def rate(self, t: float, states: np.ndarray) -> np.ndarray:
        r"""Return :math:`-i H(t) \psi / \hbar` of states of the core as rows."""
        found = forms.of_states(self.product_at(t), self.hamiltonian.size, states)
        return -1j * found

    def is_many(self, psi: Any) -> bool:
        """Return whether these are states of several members, and not one."""
        shape = np.shape(foreign.state(psi, self.size, False))
        return shape not in self.shapes and shape[1:] in self.shapes

    def outward(self, psi: np.ndarray) -> np.ndarray:
        """Return states of the core as the user has them; components are the last axis."""
        return self.frame.outward(psi)

    def observables(self, observe: Mapping[str, Any] | None) -> list[Observable]:
        r"""Return names, widths and the core's form of what a run keeps besides states.

        Parameters
        ----------
        observe : mapping of str to array_like or sparse matrix
            A real array of shape (N,) is a diagonal A, a matrix or an operator is A itself, for
            :math:`\langle \psi | A | \psi \rangle`, which is complex where A is not Hermitian; a
            complex array of shape (N,) is a state :math:`\phi`, for
            :math:`\langle \phi | \psi \rangle`. On a grid also a function of position,
            ``f(t, x, params)``, constant in time.

        Raises
        ------
        TypeError, ValueError
            One is of the wrong kind or shape, or known by its products and not Hermitian; the
            message has its name.
        """
        observe = self.portable(observe)
        return observed.observables(observe, self.frame, self.shapes, self._at_points)

    def portable(self, observe: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return observables in a form that can be pickled: functions by their values."""
        if self.grid is not None:
            observe = of_components.observed(observe, self.grid, self.components)
        return observed.portable(observe, self._at_points)
