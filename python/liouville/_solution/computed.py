"""The part of solutions that computes with their systems: between steps, derivatives, reactions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from numpy.typing import ArrayLike, NDArray

from liouville._solution import parts
from liouville._solution.points import Points

if TYPE_CHECKING:
    from liouville._solution.solution import Solution

Array = NDArray[Any]


class Computed:
    """A base of :class:`Solution`, for what is not stored in it."""

    def tangent_of(self, what: Any, *, event: str | None = None) -> dict[str, Array]:
        r"""Differentiate an invariant, or a function of the states, along the run's tangents.

        .. math::

            g_t\, dt + g_y\, dy + g_z\, dz + g_\theta\, d\theta

        with the changes of the kept times, which are held by ``t_eval=`` and ``rtol=``, of the
        states, and of the parameters.

        Parameters
        ----------
        what : str or callable
            The name of an invariant, such as ``"energy"``, or a function as for ``observe=``, of
            (t, q, v, params), (t, x, params) or what the system calls these: a number or a vector.
            With an argument ``lam``, as an event's has, it may depend on multipliers: those of an
            assembly are behind ``system.joint_force("A")``.
        event : str, optional
            The event at whose hits to differentiate, where the time moves too, before a reset; by
            default it is done at the kept times.

        Returns
        -------
        dict of str to ndarray
            By the names of ``tangents=``, of shape (k,), or (k, j) of a vector; of d directions
            (k, d) and (k, d, j), and of an ensemble (k, P) and so on. At events the rows are those
            of ``solution.events``, of one member after another.

        Raises
        ------
        ValueError
            The run has no tangents or no such event, or the system no such invariant.
        TypeError
            The system is a Schrödinger equation, or the invariant of a field is a matrix.

        Examples
        --------
        >>> import casadi as ca
        >>> import liouville as lv
        >>> from liouville.problems import pendulum
        >>> run = lv.integrate(
        ...     pendulum.system, lv.Spark(3), t=(0, 1), h=0.1, tangents={"params.g": 1.0},
        ...     **pendulum.start,
        ... )
        >>> angle = run.tangent_of(lambda t, q, v, params: ca.atan2(q[0], -q[1]))
        >>> angle["params.g"].shape
        (11,)
        """
        # imported here: few runs have tangents
        from liouville._solution.chain_rule import tangent_of

        return tangent_of(cast("Solution", self), what, event)

    def __call__(self, t: ArrayLike) -> Points:
        r"""Give the states at any time within the run, as accurate as those at the ends of steps.

        Nothing is interpolated: from the end of the step before, the method makes a step of the
        length :math:`t - t_n`. Its order is therefore that of the run, and constraints hold to
        roundoff. It costs about a step for each time, and a call for each step with times in it;
        ``t_eval=`` gives many states for less. Where an event had a reset, the step begins behind
        it; at its time the state is the one after it.

        Parameters
        ----------
        t : float or array_like, shape (k,)
            Times, in any order.

        Returns
        -------
        Points
            The states, each of shape (k, n), or (n,) for a single time; at the end of a step those
            of the solution, bit for bit.

        Raises
        ------
        ValueError
            A time is outside the run; not all steps are kept; the solution was loaded and has no
            system and method, or is that of an ensemble.
        TypeError
            t is no array of numbers.
        IntegrationError
            The method cannot make a part of a step.
        """
        return parts.at_times(cast("Solution", self), t)

    def reaction(self, constraint: str | int | None = None) -> Array:
        r"""Give the generalised reaction forces :math:`r(t, q, \lambda)` of the constraints.

        For ``Lagrangian`` and ``Hamiltonian`` systems :math:`r = -g_q^T \lambda`, and
        :math:`-k_v^T \nu` of nonholonomic constraints.

        Parameters
        ----------
        constraint : str or int, optional
            The name or index of one constraint, whose share is wanted (the other multipliers are
            then set to zero); all of them by default.

        Returns
        -------
        ndarray, shape (k, n) or (k, P, n)
            The force on each coordinate.

        Raises
        ------
        ValueError
            There is no such constraint, or the solution has no system or not all coordinates.
        TypeError
            The constraint is neither a name nor an index.
        AttributeError
            The run stored no states, or the system has no reactions.
        """
        return parts.reaction(cast("Solution", self), constraint)
