"""Systems of spins with any couplings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.arguments import amount, number
from liouville._systems.waves.exchange import MOST, Exchange, states_of
from liouville._systems.waves.sites.basis import Basis, Charge
from liouville._systems.waves.sites.system import SiteSystem, counted, parity_of, whole
from liouville._systems.waves.sites.terms import Letters, Sum


class SpinSystem(SiteSystem):
    r"""Spins with any couplings: a sum of products of spin operators.

    .. math::

        H = \sum_k c_k\, S^{a_{k1}}_{i_{k1}} S^{a_{k2}}_{i_{k2}} \cdots

    Parameters
    ----------
    sites : int
        Number of spins L.
    terms : sequence of tuple
        Terms ``(letters, coefficient, sites)``, see the notes.
    spin : float, default 0.5
        S, a multiple of 1/2, the same for all.
    pauli : bool, default False
        Whether letters are Pauli matrices :math:`\sigma = 2 S` instead, of spins one half.
    periodic : bool, default False
        Whether the last site is a neighbour of the first; L is then at least 3.
    up : int, optional
        Fixes the total :math:`S^z` at ``up - L * S``: of spins one half the number that are up.
    parity : {0, 1}, optional
        Fixes whether the number of steps down, :math:`\sum_i (S - S^z_i)`, is even, 0, or odd, 1.
    momentum : int, optional
        Fixes the momentum :math:`2 \pi k / L` by k, from 0 to L - 1, of a periodic chain whose
        terms do not change when all sites are moved by one.

    Attributes
    ----------
    sites, terms, spin, pauli, periodic, up, parity, momentum
        As given.
    basis : ndarray
        The basis states in order, as integers. Of spins one half bit i is set where spin i is
        down, so that state 0 is all up. Of others the steps down of spin i are in the bits from
        ``w * i`` on, with ``w = (2 * S).bit_length()`` bits each. Of a momentum the least state of
        each orbit under translations.
    size : int
        Number of basis states N.

    Raises
    ------
    TypeError, ValueError
        A term is of another form, H is not Hermitian, or a sector is not conserved; the message
        names the term.
    MemoryError
        There is not enough memory for H and a state; the message has the numbers.

    Notes
    -----
    A letter is ``x``, ``y``, ``z``, ``+`` or ``-``, for :math:`S^\pm = S^x \pm i S^y`, or the same
    of Pauli matrices, :math:`\sigma^\pm = (\sigma^x \pm i \sigma^y) / 2`. Several letters are a
    product, read from left to right. ``" + h.c."`` behind them adds the Hermitian conjugate.

    The sites of k letters are k integers, or an array of shape (m, k) for a sum of m products.
    Without sites it is the sum over all chains of k neighbours. The coefficient is one number or m
    of them, 1 by default, and may be complex.

    Exchange between any spins one half that is alike along x and y, with a field along z, is
    multiplied in the core without a matrix; everything else is a sparse matrix.

    Examples
    --------
    >>> import liouville as lv
    >>> ising = lv.SpinSystem(10, [("zz", -1.0), ("x", -0.5)], pauli=True)
    >>> ising.size
    1024
    >>> lv.SpinSystem(10, [("zz", -1.0), ("x", -0.5)], up=5)
    Traceback (most recent call last):
    ...
    ValueError: term 1, 'x', on site 0, changes the number of spins up, so that up=5 is no sector
    hint: ...
    """

    _fewer = "fix what the sum conserves by up=, parity= or momentum=, or take fewer sites"

    def __init__(
        self,
        sites: int,
        terms: Sequence[Any],
        *,
        spin: float = 0.5,
        pauli: bool = False,
        periodic: bool = False,
        up: int | None = None,
        parity: int | None = None,
        momentum: int | None = None,
    ) -> None:
        length = counted("sites", sites, periodic)
        twice = 2 * number("spin must be a number", spin)
        if twice != round(twice) or not 1 <= twice <= 30:
            raise ValueError(f"spin must be a multiple of 1/2 from 1/2 to 15, not {spin:g}")
        if pauli and twice != 1:
            raise ValueError(f"pauli=True is for spins one half, and spin = {spin:g}")
        steps = int(twice)
        self.spin, self.pauli = twice / 2, bool(pauli)
        self.up, self.parity = up, parity
        if up is not None:
            self.up = whole("up", up, 0, steps * length, f" for {length} spins")
        charges = () if up is None else states_of(steps * length, self.up).charges
        charges = tuple(Charge(c.name, c.asked, 0, length, c.total) for c in charges)
        if parity is not None:
            charges += (parity_of(parity, "the number of steps down", length),)
            self.parity = charges[-1].total
        self._basis = Basis(length, steps + 1, charges)
        self._letters = Letters(_matrices(steps, 2.0 if pauli else 1.0))
        super().__init__(length, terms, periodic, momentum)

    def __repr__(self) -> str:
        """Name the number of spins and the sector."""
        kind = "" if self.spin == 0.5 else f" of {self.spin:g}"
        sector = "".join(f", {charge.asked}" for charge in self._basis.charges)
        sector += "" if self.momentum is None else f", momentum={self.momentum}"
        return f"SpinSystem({amount(self.sites, 'spin')}{kind}{sector})"

    def _exchange(self) -> Exchange | None:
        is_whole = self.parity is None and self.momentum is None
        is_half = self.spin == 0.5 and is_whole and self.sites <= MOST
        return _exchange(self._products, self.sites, self.up) if is_half else None


def _matrices(steps: int, factor: float) -> dict[str, NDArray[np.complex128]]:
    """Return the matrices of a spin, whose state 0 is all up, times a number."""
    spin = steps / 2
    m = spin - np.arange(steps + 1)
    raising = np.diag(np.sqrt(spin * (spin + 1) - m[1:] * (m[1:] + 1)), 1).astype(complex)
    lowering = raising.T
    return {
        "x": factor * (raising + lowering) / 2,
        "y": factor * (raising - lowering) / 2j,
        "z": factor * np.diag(m).astype(complex),
        "+": raising,
        "-": lowering,
    }


def _exchange(products: Sum, length: int, up: int | None) -> Exchange | None:
    """Return spins one half as the core multiplies them; None if there are other terms."""
    field = np.zeros(length)
    xy: dict[tuple[int, ...], set[float]] = defaultdict(set)
    z: dict[tuple[int, ...], float] = {}
    for key, amplitude in products.amplitudes.items():
        value = complex(amplitude)
        sites = tuple(factor.site for factor in key.factors)
        if value.imag or not 1 <= len(sites) <= 2:
            return None
        if not key.steps:
            if any(factor.values != (1.0, -1.0) for factor in key.factors):
                return None
            if len(sites) == 1:
                field[sites[0]] = 2 * value.real
            else:
                z[sites] = 4 * value.real
        elif tuple(i for i, _ in key.steps) == sites and sum(x for _, x in key.steps) == 0:
            xy[sites].add(2 * value.real)
        else:
            return None
    if any(len(both) > 1 for both in xy.values()):  # mirrored products differ by roundoff
        return None
    bonds = [(pair[0], pair[1]) for pair in sorted({*xy, *z})]
    across = np.array([min(xy.get(pair, {0.0})) for pair in bonds])
    return Exchange(bonds, across, np.array([z.get(pair, 0.0) for pair in bonds]), field, up)
