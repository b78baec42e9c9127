"""Models of sites: a sum of products of local operators, in a sector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from liouville._basics.arguments import check_memory, count
from liouville._basics.errors import hinted, misshapen
from liouville._systems.waves.entries import COMPLEX, READING
from liouville._systems.waves.entries import numbers as array_of
from liouville._systems.waves.exchange import BUILDING, Exchange
from liouville._systems.waves.sites.basis import Basis, Charge
from liouville._systems.waves.sites.matrix import Matrix
from liouville._systems.waves.sites.momentum import ORBITS, MomentumBasis, moving
from liouville._systems.waves.sites.terms import (
    Expansion,
    Letters,
    Sum,
    Written,
    check_hermitian,
    conjugated,
    read,
    translated,
)

#: Bytes of a basis state: its integer, and a state vector.
STATE = 24.0

#: Bytes of an entry while the sparse matrix is made, beside what reading it takes.
MAKING = 24.0


class SiteSystem:
    """A sum of products of local operators on sites, in a sector: a base of the models.

    Attributes
    ----------
    sites : int
        Number of sites.
    terms : tuple
        The terms, as given.
    periodic : bool
        Whether the last site is a neighbour of the first.
    """

    #: The hint where there are too many states.
    _fewer = "fix what the sum conserves, or take fewer sites"

    _letters: Letters
    _basis: Basis

    #: The momentum of a periodic chain, None where it is not fixed.
    momentum: int | None = None

    def __init__(
        self, sites: int, terms: Sequence[Any], periodic: bool, momentum: int | None
    ) -> None:
        self.sites, self.periodic = sites, bool(periodic)
        if isinstance(terms, str) or not isinstance(terms, Sequence) or not len(terms):
            raise TypeError(
                f"terms must be a sequence of (letters, coefficient, sites), not {terms!r}"
            )
        self.terms = tuple(terms)
        self._check_basis()
        self._fix_momentum(momentum)
        if not self._basis.size:
            raise ValueError(f"{sites} sites have no state with {self._basis.asked}")
        self._check_memory(STATE * self.size)
        written = self._written([(f"term {k}", term) for k, term in enumerate(terms)])
        own, other = self._sums(written)
        check_hermitian(own, other)
        self._check_sector(own, written)
        self._products = own
        self.exchange = self._exchange()
        each = BUILDING
        if self.exchange is None:
            matrix = Matrix(self._basis, own)
            bytes_each = MAKING + (READING if matrix.is_real else COMPLEX)
            each = bytes_each * matrix.entries() / self.size
        self._check_memory((STATE + each) * self.size)

    @property
    def size(self) -> int:
        """Number of basis states."""
        return self._basis.size

    @property
    def basis(self) -> NDArray[np.int64]:
        """The basis states in order."""
        return self._basis.states

    def index(self, state: int | Sequence[int] | NDArray[np.integer[Any]]) -> int:
        """Return the place of a basis state, from 0.

        Parameters
        ----------
        state : int, or sequence of int of shape (sites,)
            Its digits as one number, or the digit of each site.

        Raises
        ------
        TypeError, ValueError
            It is of another form, or in another sector.
        """
        if isinstance(state, (int, np.integer)) and not isinstance(state, bool):
            packed = int(state)
        else:
            digits = array_of("a state", state)
            if digits.shape != (self._basis.sites,) or digits.dtype.kind not in "iu":
                wanted = f"an integer, or {self._basis.sites} of them, one for each digit"
                raise TypeError(f"a basis state must be {wanted}, not {state!r}")
            levels = self._basis.levels
            if digits.min() < 0 or digits.max() >= levels:
                raise ValueError(f"digits of a state must be 0 to {levels - 1}, not {state!r}")
            packed = sum(int(x) << (self._basis.width * i) for i, x in enumerate(digits))
        place = self._basis.place(packed)
        if place is None:
            raise ValueError(f"state {state} is not among the {self.size} of this sector")
        return place

    def product_state(self, local: ArrayLike) -> NDArray[Any]:
        r"""Return :math:`\psi_s = \prod_i \phi_{i, s_i}`, of norm 1 in the sector.

        Parameters
        ----------
        local : array_like
            The amplitudes of the states of a site, shape (d,), the same on all of them, or of each
            site, shape (L, d).

        Raises
        ------
        TypeError, ValueError
            It is of another shape, not finite, or leaves no amplitude in the sector.
        """
        phi = array_of("the states of sites", local)
        shape = (self._basis.sites, self._basis.levels)
        if phi.shape not in (shape, shape[1:]):
            raise misshapen("states of sites", phi.shape, f"{shape[1:]} or {shape}")
        phi = np.broadcast_to(phi, shape)
        whole = self._basis.whole
        psi = np.ones(whole.size, phi.dtype if phi.dtype.kind == "c" else float)
        for i in range(shape[0]):
            psi *= phi[i][whole.digits(whole.states, i)]
        psi = self._basis.projected(psi)
        norm = float(np.linalg.norm(psi))
        if not (np.isfinite(norm) and norm > 0):
            raise ValueError(f"this product of states has the norm {norm:g} in the sector")
        return psi / norm

    def operator(self, letters: Any, coefficient: ArrayLike = 1.0, sites: Any = None) -> Any:
        """Return the matrix of other terms in the basis, for `observe` and `drive`.

        Parameters
        ----------
        letters : str or sequence of tuple
            Letters of one term, or terms as the model takes them.
        coefficient, sites
            Of one term, as in a model: all sites or chains of neighbours by default.

        Returns
        -------
        ndarray or SciPy sparse array
            A diagonal, shape (N,), or a matrix; real where it can be. It need not be Hermitian.

        Raises
        ------
        TypeError, ValueError
            As for the model; a term that leaves the sector is named.
        MemoryError
            There are more entries than memory.
        """
        given = [(letters, coefficient, sites)] if isinstance(letters, str) else list(letters)
        names = [f"term {k}" if len(given) > 1 else "the term" for k in range(len(given))]
        written = self._written(list(zip(names, given, strict=True)))
        own, other = self._sums(written)
        self._check_sector(own, written)
        matrix = Matrix(self._basis, other)
        if matrix.is_diagonal:
            return matrix.diagonal().conj()
        self._check_memory(STATE * self.size + 2 * MAKING * matrix.entries())
        return matrix.csr()

    def matrix(self) -> Any:
        """Return H as a sparse array of SciPy's."""
        return Matrix(self._basis, self._products).csr()

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what can be computed again."""
        return self.__dict__ | {"_products": None, "exchange": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Compute it again."""
        self.__dict__.update(state)
        self._products = self._sums(self._written([("", term) for term in self.terms]))[0]
        self.exchange = self._exchange()

    def __copy__(self) -> Self:
        """Return the model itself, which never changes."""
        return self

    def _written(self, terms: Sequence[tuple[str, Any]]) -> list[Written]:
        """Read terms, each with its name in messages."""
        found: list[Written] = []
        for name, term in terms:
            found += read(term, name, self._letters, self.sites, self.periodic)
        return found

    def _sums(self, written: Sequence[Written]) -> tuple[Sum, Sum]:
        """Return a sum of terms, and its Hermitian conjugate."""
        expansion = Expansion(self._letters)
        adjoint = [conjugated(term, self._letters) for term in written]
        return expansion.add(written), expansion.add(adjoint)

    def _check_sector(self, products: Sum, written: Sequence[Written]) -> None:
        """Refuse a sum that leaves the sector, by the first term that does."""
        for key in products.amplitudes:
            for charge in self._basis.charges:
                if charge.change(key.steps):
                    what = f"changes {charge.name}, so that {charge.asked} is no sector"
                    hint = f"leave {charge.asked.split('=')[0]}= out, or the term"
                    raise ValueError(hinted(f"{products.origins[key]}, {what}", hint))
        if self.momentum is None:
            return
        moved = [translated(term, self.sites) for term in written]
        if (found := moving(products, Expansion(self._letters).add(moved))) is not None:
            sentence = f"{products.origins[found]}, changes when all sites are moved by one"
            hint = "leave momentum= out, or sum the term over all sites of the ring"
            raise ValueError(hinted(f"{sentence}, so that there is no momentum", hint))

    def _fix_momentum(self, momentum: int | None) -> None:
        """Take the states of a momentum alone, where one is given."""
        if momentum is None:
            return
        if not self.periodic:
            hint = "give periodic=True, or leave momentum= out"
            raise ValueError(hinted("an open chain has no momentum", hint))
        self.momentum = whole("momentum", momentum, 0, self.sites - 1, f" for {self.sites} sites")
        states = self._basis.size
        check_memory(f"the orbits of {states} states", ORBITS * states, self._fewer)
        basis, is_fermionic = self._basis, bool(self._letters.fermionic)
        self._basis = MomentumBasis(
            basis.sites, basis.levels, basis.charges, self.momentum, self.sites, is_fermionic
        )

    def _check_memory(self, needed: float) -> None:
        check_memory(f"{self!r} of {self.size} states, with a state,", needed, self._fewer)

    def _check_basis(self) -> None:
        """Refuse more sites, or more states of a site, than there is room for."""
        self._basis.check()

    def _exchange(self) -> Exchange | None:
        """Return the model as the core takes it without a matrix, where it does."""
        return None


def counted(name: str, sites: Any, periodic: bool) -> int:
    """Return the number of sites; a ring has three at least."""
    found = count(name, sites)
    if periodic and found < 3:
        sentence = f"{name} must be 3 or more of a periodic chain, not {found}"
        raise ValueError(hinted(sentence, "of fewer, both neighbours of a site would be the same"))
    return found


def whole(name: str, value: Any, least: int, most: int, what: str = "") -> int:
    """Return an integer between two others; the words say why these."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} must be an integer, not {value!r}")
    if not least <= value <= most:
        raise ValueError(f"{name} must be from {least} to {most}{what}, not {value}")
    return int(value)


def parity_of(parity: Any, what: str, last: int) -> Charge:
    """Return the parity of a sum of digits, that of the sites before the last, as a charge."""
    found = whole("parity", parity, 0, 1)
    return Charge(f"the parity of {what}", f"parity={found}", 0, last, found, 2)
