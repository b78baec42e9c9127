"""States of rest of mechanical systems."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.arguments import amount
from liouville._basics.errors import Suggesting
from liouville._basics.options import started
from liouville._systems import Mechanics
from liouville.analysis.point import LARGE, Array, Point, mechanical
from liouville.analysis.searches import Dense, Sparse


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Suggesting):
    """A state of rest.

    Attributes
    ----------
    t : float
        The time.
    start : dict of str to ndarray, shape (n,)
        The state by the system's names, for ``integrate(..., **equilibrium.start)``.
    lam : ndarray, shape (m,)
        Multipliers of the constraints, of redundant ones those of least norm.
    reactions : ndarray, shape (n,)
        The generalised forces of the constraints.
    residual : float
        The largest generalised force left.
    is_stable : bool or None
        Whether stiffness pushes back in every free direction, or in none away; None of systems of
        more than 1000 coordinates. :func:`~liouville.analysis.modes` tells more, and of follower
        forces what is true.
    iterations : int
        Corrections that were made.
    """

    t: float
    start: dict[str, Any]
    lam: Array
    reactions: Array
    residual: float
    is_stable: bool | None
    iterations: int

    def __repr__(self) -> str:
        """Say how stable it is and what force is left."""
        words = {True: "stable", False: "unstable", None: "not looked at for stability"}
        return (
            f"<Equilibrium at t = {self.t:g}: {words[self.is_stable]}, "
            f"largest force left {self.residual:.1e}, {amount(self.iterations, 'iteration')}>"
        )


def equilibrium(
    system: Mechanics,
    *,
    stable: bool = True,
    t: float = 0.0,
    params: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, Any] | None = None,
    **values: Any,
) -> Equilibrium:
    r"""Find a state of rest: :math:`0 = f + r(\lambda)`, :math:`0 = g`, without velocity.

    Corrections of Newton's method are split into those onto the constraints and those along them.
    Where the stiffness is negative a step of ``stable=True`` goes the other way: down the potential
    and not up. Constraints may be redundant; where equilibria are a family, one nearby is found.

    Parameters
    ----------
    system : Mechanics
        A Lagrangian, Hamiltonian, Mechanical, Structure, or the system of an assembly.
    stable : bool, default True
        Whether a stable equilibrium is sought, the one that the mechanism would fall into; False
        takes the nearest of any kind. An equilibrium given is left as it is. Of more than 1000
        coordinates the nearest is taken.
    t : float, default 0
        Time, in the system's unit; what depends on it stands still.
    params : mapping, optional
        Parameters that differ from their defaults.
    start, **values : mapping, or array_like by name
        A guess of the coordinates by the system's name, ``q`` or ``y``, of shape (n,); it need not
        satisfy the constraints. Its partner may be given too; velocities may be given and are
        ignored: ``**m.start()`` of an assembly is a guess.

    Returns
    -------
    Equilibrium
        The state, its multipliers, and whether it is stable.

    Raises
    ------
    TypeError, ValueError
        An argument is wrong; a constraint moves; or none is found, with the force that is left.
    ImportError
        SciPy is not installed, which large systems need.

    References
    ----------
    :cite:t:`greenstadt1967` for the steps that turn where the stiffness is negative.

    Examples
    --------
    >>> from liouville.problems import pendulum
    >>> import liouville as lv
    >>> lv.analysis.equilibrium(pendulum.system, q=[0.6, -0.8])
    <Equilibrium at t = 0: stable, largest force left ...
    """
    point = Point.given(
        mechanical(system, "equilibrium"), started(start, values), t, params
    ).at_rest()
    if not isinstance(stable, bool):
        raise TypeError(f"stable must be True or False, not {stable!r}")
    search = Sparse(point) if point.n > LARGE else Dense(point, stable)
    left = search.run()
    point = search.point
    return Equilibrium(
        point.t,
        dict(zip(point.system.states, (point.y, point.z), strict=True)),
        search.lam,
        point.reaction(search.lam),
        float(np.abs(left).max()),
        search.is_stable(),
        search.done,
    )
