"""Modes of large systems by ARPACK, with shift and invert on the matrices and their constraints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._basics.errors import hinted
from liouville._basics.scipy import scipy
from liouville.analysis.multiplicities import largest, nearest
from liouville.analysis.point import Array, Point

#: Parts of gradients of length one that are their own are larger than this.
INDEPENDENT = 1e-10
#: Squares of frequencies below this part of the largest of the matrices are zero.
ZERO = 1e-13
#: Growth below this part of a frequency is roundoff of a double zero, whose two are opposite up to
#: this part of them.
GROWTH, PAIRED = 1e-7, 1e-3
#: Stiffness is symmetric up to this part of its size.
SYMMETRIC = 1e-10
#: The shift below zero, in the ratio of stiffness and mass, where the stiffness is singular.
SHIFT = 1e-9
#: A shift beside zeros is this part of the lowest of the others.
BESIDE = 0.03
#: The zeros of a body that flies.
RIGID = 6

#: A function from a right side to the solution, on the constraints.
Solve = Callable[[NDArray[Any]], NDArray[Any]]


class Pencil:
    """Sparse mass, damping, stiffness and independent gradients of a large system at rest."""

    def __init__(self, point: Point) -> None:
        n = point.n
        point.check_plain("modes")
        if np.any(point.z):
            raise ValueError(f"modes of {n} coordinates are those about a state of rest")
        self.sparse, self.linalg = (scipy(x, "modes") for x in ("sparse", "sparse.linalg"))
        self.point = point
        self.mass = point.blocks("stage_blocks")["p_z"]
        self.gradients = point.blocks("node_blocks", np.zeros(point.m))["g_y"].tocsr()
        self.kept = independent(self.gradients)
        self.gradients = self.gradients[self.kept]
        lam = self._multipliers()
        given = point.linearized(np.zeros(n), lam)
        self.stiffness, self.damping = given["r_y"], given["r_z"]

    @property
    def freedoms(self) -> int:
        """The number of directions that the constraints leave."""
        return self.point.n - len(self.kept)

    @cached_property
    def highest(self) -> float:
        """The largest ratio of stiffness and mass on the diagonals."""
        return float(np.abs(self.stiffness.diagonal() / self.mass.diagonal()).max())

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether the stiffness is symmetric, up to roundoff."""
        if not self.stiffness.nnz:
            return True
        skew = abs(self.stiffness - self.stiffness.T).max()
        return bool(skew <= SYMMETRIC * abs(self.stiffness).max())

    def solver(self, matrix: Any) -> Solve:
        """Factorise a matrix bordered by the gradients; the solution keeps the constraints."""
        n, m = self.point.n, len(self.kept)
        rows = [[matrix, self.gradients.T], [self.gradients, None]] if m else [[matrix]]
        factors = self.linalg.splu(self.sparse.block_array(rows, format="csc"))
        pad = np.zeros(m)

        def solve(right: NDArray[Any]) -> NDArray[Any]:
            found: NDArray[Any] = factors.solve(np.append(right, pad))[:n]
            return found

        return solve

    def _multipliers(self) -> Array:
        """Return the multipliers of rest, by a mass of one for the directions left."""
        point, m = self.point, len(self.kept)
        force, _ = point.rates
        lam = np.zeros(point.m)
        left = force
        if m:
            squares = (self.gradients @ self.gradients.T).tocsc()
            lam[self.kept] = self.linalg.splu(squares).solve(self.gradients @ force)
            left = force - self.gradients.T @ lam[self.kept]
        slope = point.blocks("stage_jacobian")["f_y"]
        stiffness = float(np.abs(slope).max()) if slope.nnz else 0.0
        point.check_balance(left, stiffness, np.ones(point.n))
        return lam


def independent(gradients: Any) -> list[int]:
    """Return the rows of sparse gradients that do not depend on those before them."""
    if not gradients.shape[0]:
        return []
    touched = np.flatnonzero(np.diff(gradients.tocsc().indptr))
    rows = np.ascontiguousarray(gradients[:, touched].toarray())
    kept, _, _ = _core.independent_rows(rows, INDEPENDENT)
    return sorted(kept)


def sparse_modes(point: Point, count: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the lowest modes: eigenvalues, and shapes a column each."""
    pencil = Pencil(point)
    if count > pencil.freedoms - 2:
        sentence = f"{count} modes are wanted of {pencil.freedoms} freedoms"
        raise ValueError(hinted(sentence, "all of them are found by dense matrices: take fewer"))
    is_damped = pencil.damping.nnz and abs(pencil.damping).max() > 0
    try:
        if is_damped or not pencil.is_symmetric:
            return _damped(pencil, count)
        return _undamped(pencil, count)
    except pencil.linalg.ArpackError as error:
        sentence = f"ARPACK finds no {count} modes: {error}"
        raise ValueError(hinted(sentence, "take fewer, or more")) from None


def _random(size: int) -> Iterator[Array]:
    """Give random vectors."""
    rng = np.random.default_rng(0)
    while True:
        yield rng.standard_normal(size)


def _undamped(pencil: Pencil, count: int) -> tuple[NDArray[Any], NDArray[Any]]:
    squares, shapes = _shifted(pencil, count, 0.0)
    found = 1j * np.sqrt(squares.astype(complex))
    return np.where(squares < 0, -found, found), shapes


def _shifted(pencil: Pencil, count: int, shift: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return eigenvalues of stiffness and mass next to a shift; one on a zero is moved away."""
    highest = pencil.highest
    try:
        solve = pencil.solver(pencil.stiffness - shift * pencil.mass)
    except RuntimeError:  # exactly singular
        return _shifted(pencil, count, 10 * shift or -SHIFT * (highest or 1.0))
    # what ARPACK begins with has to keep the constraints
    starts = (solve(pencil.mass @ x) for x in _random(pencil.point.n))
    if pencil.is_symmetric:
        inverses, shapes = nearest(pencil.linalg, solve, pencil.mass, count, starts)
    else:
        inverses, shapes = largest(pencil.linalg, lambda x: solve(pencil.mass @ x), count, starts)
    squares = shift + 1 / inverses
    still = np.abs(squares) <= ZERO * highest
    squares[still] = 0.0
    if shift == 0 and still.any() and not still.all():
        return _shifted(pencil, count, -BESIDE * float(np.abs(squares[~still]).min()))
    return squares, shapes


def _damped(pencil: Pencil, count: int) -> tuple[NDArray[Any], NDArray[Any]]:
    r"""Return modes of M y'' + C y' + K y = 0 next to zero, by the pencil of first order.

    With (a, b) on the right, :math:`(K + \mu C + \mu^2 M) y = -b - (C + \mu M) a` and
    :math:`y' = a + \mu y` solve it at the shift :math:`\mu`. Those farther than the shift from the
    rim of the disc about it that is searched are the lowest; else the disc grows.
    """
    mass, damping, n = pencil.mass, pencil.damping, pencil.point.n
    shift, rate = _beside_zeros(pencil)
    solve = pencil.solver(pencil.stiffness + shift * damping + shift**2 * mass)

    def inverse(x: NDArray[Any]) -> NDArray[Any]:
        """Act on y and the velocity in units of the rate, so that no unit of time matters."""
        first, second = x[:n], rate * (mass @ x[n:])
        y = solve(-second - (damping @ first + shift * (mass @ first)))
        return np.concatenate([y, (first + shift * y) / rate])

    number, most = 2 * count + 2, 2 * pencil.freedoms - 2
    fastest = max(rate, np.sqrt(pencil.highest))
    while True:
        starts = (inverse(inverse(x)) for x in _random(2 * n))
        inverses, vectors = largest(pencil.linalg, inverse, number, starts)
        eigenvalues = with_double_zeros(shift + 1 / inverses, fastest)
        kept = eigenvalues.imag >= 0
        within = np.abs(eigenvalues[kept]) <= np.abs(1 / inverses).max() - shift
        if number == most or np.count_nonzero(within) >= count:
            return eigenvalues[kept], vectors[:n, kept]
        number = min(2 * number, most)


def _beside_zeros(pencil: Pencil) -> tuple[float, float]:
    """Return a shift that is no eigenvalue, zero where that is none, and the lowest rate."""
    number, most = min(RIGID + 1, pencil.freedoms - 2), pencil.freedoms - 2
    while True:
        squares, _ = _shifted(pencil, number, 0.0)
        rates = np.sqrt(np.abs(squares[squares != 0]))
        if len(rates) or number == most:
            break
        number = min(2 * number, most)
    damped = np.abs(pencil.damping.diagonal() / pencil.mass.diagonal())
    rate = float(rates.min() if len(rates) else damped.max())
    return (0.0 if len(rates) == len(squares) else BESIDE * rate), rate


def with_double_zeros(eigenvalues: NDArray[Any], largest: float) -> NDArray[Any]:
    r"""Return eigenvalues with zeros for those of roundoff, beside the largest rate.

    A zero that a matrix has twice, with one vector, is a pair :math:`\pm \lambda` of the root of
    roundoff.
    """
    found = np.where(np.abs(eigenvalues) <= ZERO * largest, 0.0, eigenvalues)
    low = found[np.abs(found) <= GROWTH * largest]
    for k in np.flatnonzero(np.abs(found) <= GROWTH * largest):
        if (np.abs(low + found[k]) <= PAIRED * np.abs(found[k])).any():
            found[k] = 0.0
    return found
