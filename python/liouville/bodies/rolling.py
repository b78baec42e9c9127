"""Constraints of a ball or a wheel on a plane: the height of its lowest point, and rolling."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from liouville._basics import casadi as ca
from liouville.bodies import rotations as rot

if TYPE_CHECKING:
    from liouville.bodies.joints import Group, Joint


def height(group: Group) -> Any:
    """Return the height of the lowest point of a ball or a wheel over its plane."""
    normal, radius = group.axis(0, 2), group.size("radius")
    return group.along(normal) - radius * _slope(group)


def _slope(group: Group) -> Any:
    """Return the sine of the angle between the plane's normal and a wheel's axis; 1 of a ball."""
    if group.items[0].kind == "rolling ball":
        return 1.0
    along = rot.dot(group.axis(0, 2), group.axis(1, 2))
    return ca.sqrt(1 - along**2)


def is_across(joint: Joint, axis: int) -> bool:
    """Return whether an axis of the plane is along z, where planar bodies do not move."""
    return bool(abs(rot.columns(joint.frames[0])[axis][2]) > 1 - 1e-12)


def rolled(group: Group) -> tuple[Any, Any]:
    """Return the velocity of the point of contact against the plane, along its x and y."""
    normal, axis, radius = group.axis(0, 2), group.axis(1, 2), group.size("radius")
    down = normal
    if group.items[0].kind == "rolling wheel":
        down = rot.minus(normal, rot.times(rot.dot(normal, axis), axis))
    arm = rot.times(-radius / _slope(group), down)
    velocity = rot.plus(group.d_rate, rot.cross(group.of(group.poses.omega, 1), arm))
    # the plane's own motion at the point of contact
    carried = rot.cross(group.of(group.poses.omega, 0), rot.plus(group.d, arm))
    slip = rot.minus(velocity, carried)
    return rot.dot(slip, group.axis(0, 0)), rot.dot(slip, group.axis(0, 1))
