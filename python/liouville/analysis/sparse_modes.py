"""Modes of large systems by ARPACK, with shift and invert on the matrices and their constraints."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville import _core
from liouville._scipy import scipy
from liouville.analysis.point import Array, Point
from liouville.errors import hinted

#: Parts of gradients of length one that are their own are larger than this.
INDEPENDENT = 1e-10
#: Squares of frequencies below this part of the largest of the matrices are zero.
ZERO = 1e-13
#: Stiffness is symmetric up to this part of its size.
SYMMETRIC = 1e-10
#: The shift below zero, in the ratio of stiffness and mass, where the stiffness is singular.
SHIFT = 1e-9
#: Forces out of balance by this part of their size are those of no equilibrium.
BALANCED = 1e-6

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
        scale = np.abs(force).max()
        slope = point.blocks("stage_jacobian")["f_y"]
        scale += np.abs(slope).max() * np.abs(point.y).max() if slope.nnz else 0.0
        worst = int(np.argmax(np.abs(left)))
        if np.abs(left[worst]) > BALANCED * scale:
            name = point.system.coordinates[worst]
            sentence = (
                f"the state is no equilibrium: the force left on '{name}' is "
                f"{abs(left[worst]):.2g}, of forces up to {scale:.2g}"
            )
            raise ValueError(hinted(sentence, "equilibrium(system, ...) finds one: **found.start"))
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
    freedoms = point.n - len(pencil.kept)
    if count > freedoms - 2:
        sentence = f"{count} modes are wanted of {freedoms} freedoms"
        raise ValueError(hinted(sentence, "all of them are found by dense matrices: take fewer"))
    largest = abs(pencil.stiffness).max() if pencil.stiffness.nnz else 0.0
    skew = abs(pencil.stiffness - pencil.stiffness.T).max() if largest else 0.0
    is_damped = pencil.damping.nnz and abs(pencil.damping).max() > 0
    if skew > SYMMETRIC * largest or is_damped:
        return _damped(pencil, count)
    return _undamped(pencil, count)


def _undamped(pencil: Pencil, count: int) -> tuple[NDArray[Any], NDArray[Any]]:
    squares, shapes = _shifted(pencil, count, 0.0)
    found = 1j * np.sqrt(squares.astype(complex))
    return np.where(squares < 0, -found, found), shapes


def _shifted(pencil: Pencil, count: int, shift: float) -> tuple[Array, Array]:
    """Return the eigenvalues next to a shift; a shift on one of them is moved away."""
    highest = np.abs(pencil.stiffness.diagonal() / pencil.mass.diagonal()).max()
    try:
        solve = pencil.solver(pencil.stiffness - shift * pencil.mass)
    except RuntimeError:  # exactly singular
        return _shifted(pencil, count, 10 * shift or -SHIFT * float(highest or 1.0))
    n = pencil.point.n
    operator = pencil.linalg.LinearOperator((n, n), matvec=solve, dtype=float)
    # what ARPACK begins with has to keep the constraints
    begin = solve(pencil.mass @ np.random.default_rng(0).standard_normal(n))
    try:
        squares, shapes = pencil.linalg.eigsh(
            pencil.stiffness, count, pencil.mass, sigma=shift, OPinv=operator, v0=begin
        )
    except pencil.linalg.ArpackError as error:
        sentence = f"ARPACK finds no {count} modes: {error}"
        raise ValueError(hinted(sentence, "take fewer, or more")) from None
    still = np.abs(squares) <= ZERO * highest
    squares[still] = 0.0
    if shift == 0 and still.any() and not still.all():
        return _shifted(pencil, count, -float(np.abs(squares[~still]).min()))
    return squares, shapes


def _damped(pencil: Pencil, count: int) -> tuple[NDArray[Any], NDArray[Any]]:
    r"""Return modes of M y'' + C y' + K y = 0 next to zero, by the pencil of first order.

    With (a, b) on the right, :math:`(K + \mu C + \mu^2 M) y = -b - (C + \mu M) a` and
    :math:`y' = a + \mu y` solve it at the shift :math:`\mu`.
    """
    mass, damping, n = pencil.mass, pencil.damping, pencil.point.n
    around, _ = _shifted(pencil, min(count, 6), 0.0)
    shift = 0.0 if np.all(around) else float(np.sqrt(np.abs(around).max())) or 1.0
    solve = pencil.solver(pencil.stiffness + shift * damping + shift**2 * mass)

    def inverse(x: NDArray[Any]) -> NDArray[Any]:
        first, second = x[:n], mass @ x[n:]
        y = solve(-second - (damping @ first + shift * (mass @ first)))
        return np.concatenate([y, first + shift * y])

    operator = pencil.linalg.LinearOperator((2 * n, 2 * n), matvec=inverse, dtype=float)
    begin = inverse(inverse(np.random.default_rng(0).standard_normal(2 * n)))
    inverses, vectors = pencil.linalg.eigs(operator, 2 * count + 2, which="LM", v0=begin)
    eigenvalues = shift + 1 / inverses
    kept = eigenvalues.imag >= 0
    return eigenvalues[kept], vectors[:n, kept]
