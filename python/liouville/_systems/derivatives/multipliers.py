r"""Derivatives of multipliers of redundant constraints, of least norm in the metric of the mass.

With the reactions :math:`A` of constraints that a step keeps and :math:`D = A C` of those left out,
multipliers :math:`\ell` of the kept alone, and :math:`S` the squares of the sizes of reactions,

.. math::

    (S_D + C^T S_A C)\, x = C^T S_A \ell, \qquad \lambda_A = \ell - C x, \quad \lambda_D = x .
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from liouville import _core
from liouville._basics import casadi as ca
from liouville._systems.mechanics.motion import kept
from liouville._systems.tape import record
from liouville._systems.tracing.sparse import jacobian

if TYPE_CHECKING:
    from liouville._systems.mechanics.form import Redundant
    from liouville._systems.mechanics.general import Mechanics

#: A point of a motion: time, y and z.
At = tuple[float, np.ndarray, np.ndarray]


def are_shared(stepped: Mechanics) -> bool:
    """Say whether multipliers are shared, by a mass whose derivatives are traced."""
    model = stepped.model
    return model.redundant is not None and model.linear.mass is None


class SharedMultipliers:
    """All multipliers at a point, as functions of it and of those that a step has.

    Parameters
    ----------
    stepped : Mechanics
        The system without the constraints that others imply.
    at : tuple
        Time, y and z.
    lam : ndarray, shape (m,)
        All multipliers there.
    params : ndarray, shape (P,)
        Values of the parameters.
    """

    def __init__(self, stepped: Mechanics, at: At, lam: np.ndarray, params: np.ndarray) -> None:
        redundant = stepped.model.redundant
        assert redundant is not None
        self._system, self._params = stepped, params
        t, y, z = at
        self._rows = [np.array([[t]]), y[None].copy(), z[None].copy()]
        n, m = self._shape = redundant.reactions.shape
        self._left = np.array(redundant.left_out)
        self._kept = np.setdiff1d(np.arange(m), self._left)
        values = self._tape(_reactions).map(params, self._rows)[0]
        reactions, mass, velocity = (
            part.reshape(n, -1, order="F") for part in np.split(values, [n * m, n * (m + n)])
        )
        forces = np.linalg.solve(mass, reactions)
        back = np.linalg.solve(mass.T, velocity.T @ reactions)
        self._held = np.concatenate([forces.ravel(order="F"), back.ravel(order="F")])[None]
        squares = np.sum(reactions * (velocity @ forces), axis=0)
        self._is_sized = squares > 0
        squares[~self._is_sized] = 1.0
        self._inverse = np.linalg.pinv(reactions[:, self._kept])
        self._combined = self._inverse @ reactions[:, self._left]
        self._lam = lam[self._kept], lam[self._left]
        self._squares = squares[self._kept]
        matrix = self._combined.T @ (self._squares[:, None] * self._combined)
        self._matrix = matrix + np.diag(squares[self._left])

    def pushed(self, along: np.ndarray, d_own: np.ndarray) -> np.ndarray:
        """Return changes of all multipliers, a row for each direction.

        `along` has changes of time, y, z and parameters, `d_own` those of the step's multipliers.
        """
        (n, m), (of_kept, of_left) = self._shape, self._lam
        given = [np.repeat(part, len(along), axis=0) for part in (*self._rows, self._held)]
        rates = self._tape(_rates).map(self._params, [*given, np.ascontiguousarray(along)])
        found = np.empty((len(along), m))
        for out, row, own in zip(found, rates, d_own, strict=True):
            moved = row[: n * m].reshape(n, m, order="F")
            squares = np.where(self._is_sized, row[n * m :], 0.0)
            d_combined = moved[:, self._left] - moved[:, self._kept] @ self._combined
            d_combined = self._inverse @ d_combined
            less = self._squares * (own - d_combined @ of_left) + squares[self._kept] * of_kept
            right = d_combined.T @ (self._squares * of_kept) + self._combined.T @ less
            out[self._left] = np.linalg.solve(self._matrix, right - squares[self._left] * of_left)
            out[self._kept] = own - d_combined @ of_left - self._combined @ out[self._left]
        return found

    def pulled(self, of_lam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return cotangents of time, y, z and parameters, and of the multipliers of a step."""
        (n, m), (of_kept, of_left) = self._shape, self._lam
        kept_bar = of_lam[self._kept]
        mu = np.linalg.solve(self._matrix.T, of_lam[self._left] - self._combined.T @ kept_bar)
        less = self._combined @ mu
        own = kept_bar + self._squares * less
        combined = np.outer(self._squares * of_kept, mu) - np.outer(own, of_left)
        squares = np.zeros(m)
        squares[self._kept], squares[self._left] = less * of_kept, -mu * of_left
        squares[~self._is_sized] = 0.0
        moved, back = np.zeros((n, m)), self._inverse.T @ combined
        moved[:, self._left], moved[:, self._kept] = back, -back @ self._combined.T
        cotangents = np.concatenate([moved.ravel(order="F"), squares])[None]
        given = [*self._rows, self._held, cotangents]
        return self._tape(_transposed).map(self._params, given)[0], own

    def _tape(self, make: Callable[[Mechanics], _core.Tape]) -> _core.Tape:
        return kept(self._system, f"shared multipliers{make.__name__}", lambda: make(self._system))


def _reactions(system: Mechanics) -> _core.Tape:
    """Record reactions to multipliers of one, p_z and v_z at (t, y, z), column by column."""
    s, model = system.symbols, system.model
    parts = [_full(model.redundant), jacobian(model.p, s.z), jacobian(model.v, s.z)]
    return record("reactions", s.inputs(z=s.z), *(ca.vec(ca.densify(x)) for x in parts))


def _moving(system: Mechanics) -> tuple[dict[str, ca.SX], ca.SX, ca.SX]:
    """Return inputs, what moves, and reactions with their squares, of which forces are held."""
    s, model = system.symbols, system.model
    reactions = _full(model.redundant)
    n, m = reactions.shape
    held = ca.SX.sym("held", 2 * n * m)
    forces, back = (ca.reshape(x, n, m) for x in ca.vertsplit(held, n * m))
    mass, velocity = jacobian(model.p, s.z), jacobian(model.v, s.z)
    squares = reactions * ca.mtimes(velocity, forces)
    squares += back * (reactions - ca.mtimes(mass, forces))
    inputs = s.inputs(z=s.z)
    along = ca.vertcat(s.t, s.y, s.z, s.params.vector)
    return inputs | {"held": held}, along, ca.vertcat(ca.vec(reactions), ca.sum1(squares).T)


def _rates(system: Mechanics) -> _core.Tape:
    """Record the derivative of these along a direction."""
    inputs, along, moved = _moving(system)
    params, d = inputs.pop("params"), ca.SX.sym("d", along.numel())
    found = ca.densify(ca.jtimes(moved, along, d))
    return record("rates of reactions", {**inputs, "d": d, "params": params}, found)


def _transposed(system: Mechanics) -> _core.Tape:
    """Record its transpose."""
    inputs, along, moved = _moving(system)
    params, back = inputs.pop("params"), ca.SX.sym("back", moved.numel())
    found = ca.densify(ca.jtimes(moved, along, back, True))
    return record("transposed rates", {**inputs, "back": back, "params": params}, found)


def _full(redundant: Redundant | None) -> ca.SX:
    assert redundant is not None
    return ca.densify(redundant.reactions)
