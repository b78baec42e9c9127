"""Assembled structures: constant matrices beside traced functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted, misshapen
from liouville._systems.mechanics.form import Model
from liouville._systems.mechanics.general import Mechanics
from liouville._systems.mechanics.mechanical import declared, extra_power, holonomic, ideal
from liouville._systems.mechanics.traced import Function, traced_invariants
from liouville._systems.tracing import trace as _trace
from liouville._systems.tracing.linear import Linear, Matrix


class Structure(Mechanics):
    r"""A structure with constant mass, damping and stiffness matrices, as finite elements give.

    .. math::

        M q'' + C q' + K q = Q(t, q, q') - g_q^T \lambda, \quad 0 = g(t, q)

    The matrices go to the core as they are; only the functions are traced. So a structure may have
    a hundred thousand coordinates, and contacts, followers and joints on a few of them.

    Parameters
    ----------
    mass, stiffness, damping : sparse matrix or array_like
        M, K and C: sparse matrices of SciPy's or square arrays, shape (n, n), or arrays of shape
        (n,) for diagonal ones. Stiffness and damping are zero unless given; every coordinate has
        mass, and M is symmetric to roundoff. The skew part of K, as of bearings, seals and brakes,
        is a force without a potential, whose work counts as that of forces.
    force : callable or array_like, optional
        ``force(t, q, v, params)``, the forces Q: n values, or a dict of those that are not zero by
        coordinate names. An array of n numbers is a constant load.
    constraint : callable, optional
        ``constraint(t, q, params)``: a scalar, a sequence of m, or a dict that names them.
    q : sequence of str, optional
        Names of the n coordinates; q0, q1, ... unless given.
    params : mapping of str to float or 1-D array_like, optional
        Parameters by name, with default values; the functions see ``params.name``.
    invariants : mapping of str to callable, optional
        Quantities ``f(t, q, v, params)`` to record besides "energy",
        :math:`\tfrac12 v^T M v + \tfrac12 q^T K q`, whose name is taken.

    Raises
    ------
    TypeError, ValueError
        The matrices do not fit each other, a coordinate has no mass, or a function is refused as
        for :class:`Lagrangian`.

    Examples
    --------
    >>> import liouville as lv
    >>> lv.Structure([1.0, 1.0], [[2.0, -1.0], [-1.0, 2.0]], force=[0.0, 1.0])
    Structure(q0, q1; 0 constraints)
    """

    def __init__(
        self,
        mass: Any,
        stiffness: Any = None,
        damping: Any = None,
        *,
        force: Function | ArrayLike | None = None,
        constraint: Function | None = None,
        q: Sequence[str] | None = None,
        params: Mapping[str, ArrayLike] | None = None,
        invariants: Mapping[str, Function] | None = None,
    ) -> None:
        given = {"mass": mass, "damping": damping, "stiffness": stiffness}
        matrices = {
            name: Matrix.read(name, value)
            for name, value in given.items()
            if value is not None or name == "mass"
        }
        n = matrices["mass"].n
        for name, matrix in matrices.items():
            if matrix.n != n:
                raise ValueError(
                    f"{name} must have order {n} as the mass matrix has, not {matrix.n}"
                )
        coordinates, s = declared(n if q is None else q, ("q", "v"), params)
        if len(coordinates) != n:
            raise ValueError(
                f"q must name {n} coordinates, as the mass matrix has, not {len(coordinates)}"
            )
        _check_mass(matrices["mass"], coordinates)
        turning = matrices["stiffness"].skew if "stiffness" in matrices else None
        args = s.args
        extra = _load(force, args, coordinates)
        names, g, lam, g_y = holonomic(constraint, s)
        zero = ca.SX(n, 1)
        super().__init__(
            s,
            Model(
                v=s.z,
                p=zero,
                f=extra,
                r=ideal(g, s, lam),
                g=g,
                lam=lam,
                linear=Linear(**matrices),
                is_ideal=True,
                g_y=g_y,
            ),
            states=("q", "v"),
            coordinates=coordinates,
            constraints=names,
            invariants=traced_invariants(invariants, args, ca.SX(0)),
            power=extra_power(_with(extra, turning, s.y), s.z, ca.SX(0), g, s, lam),
        )


def _with(extra: ca.SX, turning: Matrix | None, y: ca.SX) -> ca.SX:
    """Return forces with those of the skew part of a stiffness, which have no potential."""
    if turning is None:
        return extra
    n, row, col = turning.n, turning.row.tolist(), turning.col.tolist()
    matrix = ca.DM.triplet(row, col, ca.DM(turning.values), n, n)
    return extra - ca.mtimes(ca.SX(matrix), y)


def _check_mass(mass: Matrix, coordinates: tuple[str, ...]) -> None:
    massless = np.bincount(mass.row, minlength=mass.n) == 0
    if massless.any():
        name = coordinates[int(np.argmax(massless))]
        raise ValueError(
            hinted(
                f"coordinate '{name}' has no mass: its row of the mass matrix is empty",
                "condense it out of the matrices, or give it a mass",
            )
        )
    if mass.skew is not None:
        skew = mass.skew
        k = int(np.argmax(np.abs(skew.values)))
        i, j = sorted((int(skew.row[k]), int(skew.col[k])))
        ends = [mass.at(*place) for place in ((i, j), (j, i))]
        raise ValueError(
            hinted(
                f"the mass matrix is not symmetric: mass[{i}, {j}] is {ends[0]:g} and "
                f"mass[{j}, {i}] is {ends[1]:g}",
                "its energy is that of the symmetric part: give (M + M.T) / 2 if that is meant",
            )
        )


def _load(
    force: Function | ArrayLike | None, args: _trace.Args, coordinates: tuple[str, ...]
) -> ca.SX:
    """Trace a force, or take a constant one."""
    n = len(coordinates)
    if force is None:
        return ca.SX(n, 1)
    if callable(force):
        return _trace.placed("force", force, args, coordinates)
    array = _trace.numbers(force)
    if array is None:
        raise TypeError(f"force must be a function or an array of numbers, not {force!r}")
    if array.shape != (n,):
        raise misshapen("force", array.shape, f"({n},)")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise ValueError(f"force of '{coordinates[bad[0]]}' must be finite, not {array[bad[0]]}")
    return ca.SX(ca.sparsify(ca.DM(array)))
