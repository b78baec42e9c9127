"""The linear equations of small deviations from a state, in the directions that are free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import amount
from liouville._basics.errors import Suggesting, check_name, hinted, quoted
from liouville._basics.options import started
from liouville._systems import Mechanics
from liouville.analysis.point import LARGE, Array, Point, Split, mechanical

#: Named coordinates tell the freedoms apart where the smallest singular value is above this.
APART = 1e-8


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(Suggesting):
    r"""Small deviations from a state, with f positions and r velocities left free.

    A deviation is :math:`\delta y = N s`, :math:`\delta z = Z_1 s + Z_2 \sigma`, and

    .. math::

        M \sigma' + C \sigma + K s = 0, \qquad (s, \sigma)' = A (s, \sigma)

    With holonomic constraints r = f, and of a Lagrangian at rest :math:`\sigma = s'`. All numbers
    are in the system's units.

    Attributes
    ----------
    t : float
        The time.
    coordinates : tuple of str
        Names of the n coordinates.
    independent : tuple of str
        The coordinates that are the s themselves, if they were asked for.
    mass : ndarray, shape (r, r)
        M, the mass in the free directions.
    damping : ndarray, shape (r, r)
        C, with gyroscopic forces.
    stiffness : ndarray, shape (r, f)
        K, with what the constraint forces add by their turning, and of a motion its inertia.
    state : ndarray, shape (f + r, f + r)
        A, the matrix of the state space.
    basis : ndarray, shape (n, f)
        N, the free directions, orthonormal unless independent coordinates were asked for; those of
        mechanisms of another size than a metre or so with lengths in a unit of that size.
    tangent : ndarray, shape (2 n, f + r)
        Deviations of y, then of z, by s and sigma.
    acceleration : ndarray, shape (n,)
        z' at the state, zero at an equilibrium.
    lam : ndarray, shape (m,)
        Multipliers at the state, of redundant constraints those of least norm.
    """

    t: float
    coordinates: tuple[str, ...]
    independent: tuple[str, ...]
    mass: Array
    damping: Array
    stiffness: Array
    state: Array
    basis: Array
    tangent: Array
    acceleration: Array
    lam: Array

    def __repr__(self) -> str:
        """Show the number of freedoms and the distance of the state from an equilibrium."""
        free, rates = self.stiffness.shape[1], len(self.mass)
        rates_too = "" if rates == free else f", {rates} of velocities"
        off = np.abs(self.acceleration).max()
        return (
            f"<Linearization at t = {self.t:g}: {amount(len(self.coordinates), 'coordinate')}, "
            f"{free} free"
            f"{rates_too}, largest acceleration {off:.1e}>"
        )


def linearize(
    system: Mechanics,
    *,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    independent: Sequence[str] | None = None,
    start: Mapping[str, Any] | None = None,
    **values: Any,
) -> Linearization:
    r"""Linearise the equations of motion about a state, on the tangent space of its constraints.

    Constraints may be redundant. Their forces turn with the mechanism, which is part of the
    stiffness: that of a pendulum in x and y is nothing else. About a motion the matrices are those
    of the moment: its velocities and accelerations are in them.

    Parameters
    ----------
    system : Mechanics
        A Lagrangian, Hamiltonian, Mechanical, Structure, or the system of an assembly.
    t : float, default 0
        Time, in the system's unit.
    params : mapping, optional
        Parameters that differ from their defaults.
    independent : sequence of str, optional
        As many coordinates as positions are free: they are then the variables s, and their rates
        those of the velocities. By default an orthonormal basis is taken.
    start, **values : mapping, or array_like by name
        The state by the system's names, each of shape (n,), such as ``q`` and ``v``, on its
        constraints; at rest where the second is left out.

    Returns
    -------
    Linearization
        The matrices, dense.

    Raises
    ------
    TypeError, ValueError
        The system is no mechanical one or too large, the state is off its constraints, nothing is
        free, or the coordinates named do not tell the freedoms apart.

    References
    ----------
    :cite:t:`jay2007` for the general form.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> import numpy as np
    >>> linear = lv.analysis.linearize(pendulum.system, q=[0, -1], v=[0, 0])
    >>> f"{abs(np.linalg.eigvals(linear.state)[0]):.6f}"  # the root of 9.81
    '3.132092'
    """
    point = Point.given(mechanical(system, "linearize"), started(start, values), t, params)
    if point.n > LARGE:
        sentence = f"a linearisation of {point.n} coordinates is not made: its matrices are dense"
        raise ValueError(hinted(sentence, "modes(system, count=...) takes sparse ones"))
    point.check()
    return linearized_at(point, independent)


def linearized_at(point: Point, independent: Sequence[str] | None = None) -> Linearization:
    """Return the linear equations at a point, with its derivatives by tapes."""
    system = point.system
    u, lam = point.motion()
    given = point.linearized(u, lam)
    units = point.units
    held = Split.of(point.held(), units)
    free = Split.of(point.blocks("node_blocks", lam[: point.m])["g_y"], units).null
    rates, back = held.null, held.inverse
    pick, pick_rates = free.T / units**2, rates.T / units**2
    if not free.size:
        _refuse_rigid(system)
    if independent is not None:
        pick = _picked(system, independent, free)
        free = free @ np.linalg.inv(pick @ free)
        if not system.nonholonomic:
            pick_rates = pick
            rates = rates @ np.linalg.inv(pick @ rates)
    back = back - rates @ (pick_rates @ back)
    test = _tested(point, lam, free)
    mass = point.blocks("stage_blocks")["p_z"]
    inner = test @ mass @ rates
    turned = -back @ (given["c_y"] @ free)
    of_y = given["r_y"] - mass @ back @ given["m_y"]
    of_z = given["r_z"] - mass @ back @ given["m_z"]
    damping = test @ of_z @ rates
    stiffness = test @ (of_y @ free + of_z @ turned)
    v_y = point.blocks("stage_jacobian")["v_y"] @ free
    v_z = point.blocks("stage_blocks").get("v_z", np.eye(point.n))
    state = np.block(
        [
            [pick @ (v_y + v_z @ turned), pick @ v_z @ rates],
            [-np.linalg.solve(inner, stiffness), -np.linalg.solve(inner, damping)],
        ]
    )
    tangent = np.block([[free, np.zeros((point.n, rates.shape[1]))], [turned, rates]])
    return Linearization(
        t=point.t,
        coordinates=system.coordinates,
        independent=() if independent is None else tuple(independent),
        mass=inner,
        damping=damping,
        stiffness=stiffness,
        state=state,
        basis=free,
        tangent=tangent,
        acceleration=u,
        lam=lam,
    )


def _tested(point: Point, lam: Array, free: Array) -> Array:
    """Return directions that no reaction acts along: the free ones where reactions are ideal."""
    if point.system.is_ideal and not point.system.nonholonomic:
        return free.T
    return Split.of(point.reactions(lam).T, point.units).null.T


def _picked(system: Mechanics, names: Sequence[str], free: Array) -> Array:
    """Return the rows that pick some coordinates, which tell the free directions apart."""
    if isinstance(names, str):
        hint = f"give a list, independent=[{names!r}]"
        raise TypeError(hinted(f"independent must be a sequence of names, not {names!r}", hint))
    for name in names:
        check_name(name, system.coordinates, "coordinate", "system")
    count = free.shape[1]
    if len(names) != count:
        raise ValueError(f"{len(names)} independent coordinates are named, and {count} are free")
    pick = np.eye(len(system.coordinates))[[system.coordinates.index(name) for name in names]]
    sizes = np.linalg.svd(pick @ free, compute_uv=False)
    if sizes[-1] <= APART:
        sentence = f"at this state {quoted(list(names))} do not tell the {count} freedoms apart"
        raise ValueError(hinted(sentence, "name others, or none"))
    return pick


def _refuse_rigid(system: Mechanics) -> None:
    count, n = len(system.constraints), len(system.coordinates)
    of = f"{amount(count, 'constraint')} on {amount(n, 'coordinate')}"
    sentence = f"{of} leave nothing to move"
    raise ValueError(hinted(sentence, "leave some out, or move from a singular position"))
