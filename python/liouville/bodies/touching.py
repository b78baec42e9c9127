"""Contacts of an assembly: stops of joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from liouville._basics import casadi as ca
from liouville._systems.mechanics.contact import Contact
from liouville.bodies.body import Value, column
from liouville.bodies.joints import Joint

if TYPE_CHECKING:
    from liouville.bodies.model import Model


def contacts_of(model: Model, joints: Sequence[Joint]) -> dict[str, Contact]:
    """Return contacts whose functions are expressions of a model, which the Lagrangian makes."""
    return {name: own for joint in joints for name, own in _stops(model, joint)}


def _stops(model: Model, joint: Joint) -> Iterator[tuple[str, Contact]]:
    """Yield the stops of a joint, whose gaps are those of its coordinates."""

    def gap(coordinate: str, side: str, stop: Value) -> Callable[..., ca.SX]:
        def left(t: ca.SX, q: ca.SX, params: Any) -> ca.SX:
            del t, q
            off: ca.SX = model.coordinates[joint.name, coordinate][0] - column(stop, params, 1)
            return off if side == "low" else -off

        return left

    for name, limits in joint.limits.items():
        for side, stop in limits.stops():
            own = gap(name, side, stop)
            yield f"{joint.name}.{name}.{side}", Contact(own, limits.restitution)
