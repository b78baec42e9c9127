"""Mechanisms of bodies and joints, which become ordinary systems."""

from liouville.bodies.assembly import Assembly
from liouville.bodies.body import Body
from liouville.bodies.dry import Dry
from liouville.bodies.files import from_mjcf, from_urdf
from liouville.bodies.friction import Coulomb, Stribeck
from liouville.bodies.joints import Joint
from liouville.bodies.limits import Limits
from liouville.bodies.mechanism import Mechanism
from liouville.bodies.results import BodyMotion, JointMotion, body_of, joint_of
from liouville.bodies.shapes import Box, Capsule, Plane, Polygon, Sphere

__all__ = [
    "Assembly",
    "Body",
    "BodyMotion",
    "Box",
    "Capsule",
    "Coulomb",
    "Dry",
    "Joint",
    "JointMotion",
    "Limits",
    "Mechanism",
    "Plane",
    "Polygon",
    "Sphere",
    "Stribeck",
    "body_of",
    "from_mjcf",
    "from_urdf",
    "joint_of",
]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
