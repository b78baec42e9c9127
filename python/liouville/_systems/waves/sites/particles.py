"""Fermions and bosons on lattices of few sites."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from liouville._basics.arguments import amount
from liouville._systems.waves.sites.basis import Basis, Charge
from liouville._systems.waves.sites.system import SiteSystem, counted, parity_of, whole
from liouville._systems.waves.sites.terms import Letters


class FermionSystem(SiteSystem):
    r"""Fermions on sites, without spin or with spin one half, at most one a state.

    .. math::

        \{c_i, c_j^\dagger\} = \delta_{ij}, \qquad \{c_i, c_j\} = 0

    Parameters
    ----------
    sites : int
        Number of sites L.
    terms : sequence of tuple
        Terms ``(letters, coefficient, sites)``, see the notes.
    particles : int or tuple of int, optional
        Number of fermions, or of those with spin up and with spin down; any by default.
    parity : {0, 1}, optional
        Whether their number is even, which pairing keeps where it does not keep the number.
    spinful : bool, optional
        Whether they have spin one half; so if `particles` is a pair, else not.
    momentum : int, optional
        Fixes the momentum of a periodic chain, as that of :class:`SpinSystem`.
    periodic : bool, default False
        Whether the last site is a neighbour of the first; L is then at least 3.

    Attributes
    ----------
    sites, terms, particles, parity, spinful, momentum, periodic
        As given.
    basis : ndarray
        The basis states in order: bit i is set where site i is taken, with spin up, and bit L + i
        with spin down. They are made from the vacuum by :math:`c_i^\dagger` in this order.
    size : int
        Number of basis states N.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As :class:`SpinSystem` does.

    Notes
    -----
    Letters are ``+`` for :math:`c^\dagger`, ``-`` for :math:`c`, ``n`` for :math:`c^\dagger c`.
    With spin a bar parts the letters for up from those for down: ``"+-|"`` hops with spin up,
    ``"n|n"`` counts both. Without sites, letters on each side of the bar are on neighbours that
    begin at the same site, so that ``"n|n"`` is on each site. For the rest see
    :class:`SpinSystem`.

    Examples
    --------
    >>> import liouville as lv
    >>> hubbard = lv.FermionSystem(
    ...     6,
    ...     [("+-| + h.c.", -1.0), ("|+- + h.c.", -1.0), ("n|n", 4.0)],
    ...     particles=(3, 3),
    ... )
    >>> hubbard.size
    400
    """

    _fewer = (
        "fix particles=, parity= or momentum= where the sum conserves them, or take fewer sites"
    )

    def __init__(
        self,
        sites: int,
        terms: Sequence[Any],
        *,
        particles: int | tuple[int, int] | None = None,
        parity: int | None = None,
        spinful: bool | None = None,
        momentum: int | None = None,
        periodic: bool = False,
    ) -> None:
        length = counted("sites", sites, periodic)
        is_pair = isinstance(particles, (tuple, list, np.ndarray))
        self.spinful = is_pair if spinful is None else bool(spinful)
        modes = length * (1 + self.spinful)
        places = f" for {length} sites"
        charges: tuple[Charge, ...] = ()
        if isinstance(particles, (tuple, list, np.ndarray)):
            if len(particles) != 2 or not self.spinful:
                sentence = "particles must be a number, or with spin a pair (up, down)"
                raise ValueError(f"{sentence}, not {particles!r}")
            found = tuple(whole("particles", n, 0, length, places) for n in particles)
            asked = f"particles={found}"
            for k, name in enumerate(("up", "down")):
                what = f"the number of fermions with spin {name}"
                charges += (Charge(what, asked, k * length, (k + 1) * length, found[k]),)
            self.particles: int | tuple[int, ...] | None = found
        elif particles is not None:
            self.particles = whole("particles", particles, 0, modes, places)
            what = "the number of fermions"
            charges = (Charge(what, f"particles={particles}", 0, modes, self.particles),)
        else:
            self.particles = None
        self.parity = parity
        if parity is not None:
            charges += (parity_of(parity, "the number of fermions", modes),)
            self.parity = charges[-1].total
        self._basis = Basis(modes, 2, charges)
        lowering = np.diag([1.0 + 0j], 1)
        matrices = {"+": lowering.T, "-": lowering, "n": np.diag([0j, 1.0])}
        self._letters = Letters(matrices, fermionic="+-", has_species=self.spinful)
        super().__init__(length, terms, periodic, momentum)

    def __repr__(self) -> str:
        """Name the number of sites and of fermions."""
        kind = " with spin" if self.spinful else ""
        sector = "" if self.particles is None else f", particles={self.particles}"
        sector += "" if self.parity is None else f", parity={self.parity}"
        sector += "" if self.momentum is None else f", momentum={self.momentum}"
        return f"FermionSystem({amount(self.sites, 'site')}{kind}{sector})"


class BosonSystem(SiteSystem):
    r"""Bosons on sites, with at most so many on each.

    .. math::

        [b_i, b_j^\dagger] = \delta_{ij}

    Parameters
    ----------
    sites : int
        Number of sites L.
    terms : sequence of tuple
        Terms ``(letters, coefficient, sites)``, as those of :class:`SpinSystem`; the letters are
        ``+`` for :math:`b^\dagger`, ``-`` for :math:`b`, ``n`` for :math:`b^\dagger b`.
    cutoff : int, optional
        The most bosons on a site; `particles` by default, which leaves nothing out.
    particles : int, optional
        Number of bosons; any by default.
    parity : {0, 1}, optional
        Whether their number is even.
    momentum : int, optional
        Fixes the momentum of a periodic chain, as that of :class:`SpinSystem`.
    periodic : bool, default False
        Whether the last site is a neighbour of the first; L is then at least 3.

    Attributes
    ----------
    sites, terms, cutoff, particles, parity, momentum, periodic
        As given.
    basis : ndarray
        The basis states in order, as integers: the bosons of site i are in the bits from ``w * i``
        on, with ``w = cutoff.bit_length()`` bits each.
    size : int
        Number of basis states N.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As :class:`SpinSystem` does, or there is neither a cut-off nor a number of bosons.

    Notes
    -----
    :math:`b^\dagger` gives zero on a site that is full. With a cut-off below the number of bosons
    the commutator fails there, and results have an error that a larger cut-off shows.

    Examples
    --------
    >>> import liouville as lv
    >>> hop, repulsion = ("+- + h.c.", -1.0), [("nn", 2.0, [(i, i) for i in range(5)]), ("n", -2.0)]
    >>> lv.BosonSystem(5, [hop, *repulsion], particles=5).size
    126
    """

    _fewer = (
        "take a smaller cutoff=, fix particles=, parity= or momentum= where the sum conserves "
        "them, or take fewer sites"
    )

    def __init__(
        self,
        sites: int,
        terms: Sequence[Any],
        *,
        cutoff: int | None = None,
        particles: int | None = None,
        parity: int | None = None,
        momentum: int | None = None,
        periodic: bool = False,
    ) -> None:
        length = counted("sites", sites, periodic)
        if cutoff is None and particles is None:
            raise ValueError("give cutoff= or particles=: a site has room for any number of bosons")
        most = 2**15 if cutoff is None else whole("cutoff", cutoff, 1, 2**15)
        charges: tuple[Charge, ...] = ()
        self.particles = particles
        if particles is not None:
            self.particles = whole("particles", particles, 0, most * length)
            most = min(most, max(self.particles, 1))
            what, asked = "the number of bosons", f"particles={particles}"
            charges = (Charge(what, asked, 0, length, self.particles),)
        self.parity = parity
        if parity is not None:
            charges += (parity_of(parity, "the number of bosons", length),)
            self.parity = charges[-1].total
        self.cutoff = most
        self._basis = Basis(length, most + 1, charges)
        lowering = np.diag(np.sqrt(np.arange(1.0, most + 1)) + 0j, 1)
        counting = np.diag(np.arange(most + 1) + 0j)
        self._letters = Letters({"+": lowering.T, "-": lowering, "n": counting})
        super().__init__(length, terms, periodic, momentum)

    def __repr__(self) -> str:
        """Name the numbers of sites and of bosons."""
        sector = "".join(f", {charge.asked}" for charge in self._basis.charges)
        sector += "" if self.momentum is None else f", momentum={self.momentum}"
        return f"BosonSystem({amount(self.sites, 'site')} of at most {self.cutoff}{sector})"

    def _check_basis(self) -> None:
        most = self._basis.most_levels
        if most < 2:
            self._basis.check()
        self._basis.check(
            f"of {self._basis.sites} sites the most bosons on one are cutoff={most - 1}"
        )
