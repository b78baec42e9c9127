"""The part of solutions for assemblies: the motions of their bodies and joints."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from liouville._solution.solution import Solution
    from liouville.bodies import BodyMotion, JointMotion


class Motions:
    """A base of :class:`Solution`, for the systems of ``liouville.bodies``."""

    def joint(self, name: str, frame: str = "world") -> JointMotion:
        """Give the motion of a joint of an assembly, and the force and torque in it.

        Parameters
        ----------
        name : str
            The joint, by its name in :class:`liouville.bodies.Assembly`.
        frame : {"world", "joint"}
            What force and torque are in the axes of.

        Returns
        -------
        liouville.bodies.JointMotion

        Raises
        ------
        ValueError
            There is no such joint, or the solution is an ensemble or has no system.
        TypeError
            The system is not made of bodies.
        AttributeError
            The run stored no states.
        """
        from liouville import bodies

        return bodies.joint_of(cast("Solution", self), name, frame)

    def body(self, name: str) -> BodyMotion:
        """Give the motion of a body of an assembly: places, attitudes and velocities.

        Returns
        -------
        liouville.bodies.BodyMotion

        Raises
        ------
        ValueError, TypeError, AttributeError
            As for :meth:`joint`.
        """
        from liouville import bodies

        return bodies.body_of(cast("Solution", self), name)
