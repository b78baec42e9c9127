"""Friction of joints by their coordinates; that of a given size is a contact with a load."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville._systems.mechanics.contact import Coefficient, Contact, check_number
from liouville.bodies.body import Value, column, given
from liouville.bodies.friction import Coulomb
from liouville.bodies.joints import SPINS

if TYPE_CHECKING:
    from liouville.bodies.joints import Joint
    from liouville.bodies.model import Model


#: The coordinates that make up each slip, by kind of joint; those of compound joints slip alone.
SLIPS: dict[str, tuple[tuple[str, ...], ...]] = {
    "revolute": (("angle",),),
    "prismatic": (("slide",),),
    "cylindrical": (("angle", "slide"),),
    "screw": (("angle", "slide"),),
    "universal": (("angle",), ("second angle",)),
    "spherical": (SPINS,),
    "planar": (("slide_x", "slide_y"),),
    "guide": (("move_x", "move_y", "move_z"),),
}
#: Kinds of joints whose slip is a turn about a pin or a ball with a radius.
TURNING = ("revolute", "cylindrical", "screw", "universal", "spherical")

#: What a joint has of friction: by its own force, by the coordinates that make up its slip, and dry
#: friction of a given size by coordinate.
Frictions = dict[str, Any]


@dataclass(frozen=True)
class Dry:
    r"""Dry friction of a given size, which sticks: ``friction=`` of a joint.

    .. math:: |T| \le T_\text{static} \ (s = 0), \quad T = -T_0 \operatorname{sign} s \ (s \ne 0)

    It acts along the coordinate of a hinge or a slide, along both of a universal joint, and along
    an axis of a compound joint, as the :class:`~liouville.Contact` ``"joint.coordinate.friction"``
    with a load of 1: nothing is regularised. Its size does not depend on the force in the joint.

    Attributes
    ----------
    effort : float or callable
        :math:`T_0`: a torque where the coordinate is an angle, else a force, or a function of the
        parameters.
    static : float or callable, optional
        :math:`T_\text{static}`, at least `effort`; `effort` by default.

    Raises
    ------
    TypeError, ValueError
        A value is no number, or negative, or `static` is below `effort`.
    """

    effort: Value
    static: Value | None = None

    def __post_init__(self) -> None:
        """Refuse what is no friction."""
        for name, value in (("effort", self.effort), ("static", self.static)):
            if value is not None and not callable(value):
                what = f"{name} of dry friction"
                check_number(what, float(given(what, value, ())))
        if not self.functions() and self.static is not None and self.static < self.effort:
            sentence = f"static of dry friction must be at least effort = {self.effort:g}"
            raise ValueError(f"{sentence}, not {self.static:g}")

    def functions(self) -> dict[str, Callable[[Any], Any]]:
        """Return the values that are functions of the parameters, by name."""
        return {name: x for name, x in vars(self).items() if callable(x)}


def sticking(model: Model, joint: Joint) -> Iterator[tuple[str, Contact]]:
    """Yield the dry friction of a joint, of each of its coordinates that has any."""
    for name, own in joint.dry.items():
        static = own.effort if own.static is None else own.static
        if callable(static) or static > 0:
            yield f"{joint.name}.{name}.friction", _contact(model, joint, name, own)


def _contact(model: Model, joint: Joint, name: str, own: Dry) -> Contact:
    def slip(t: ca.SX, q: ca.SX, v: ca.SX, params: Any) -> ca.SX:
        del t, q, params
        return ca.substitute(model.coordinates[joint.name, name][1], model.v, v)

    static = None if own.static is None else _coefficient(own.static)
    return Contact(load=1.0, friction=_coefficient(own.effort), static_friction=static, slip=slip)


def _coefficient(value: Value) -> Coefficient:
    if callable(value):
        return lambda params: column(value, params, 1)
    return float(value)


HINT = (
    "write lv.bodies.Dry(effort), which sticks, or lv.bodies.Coulomb(mu=0.2, v_s=1e-3, radius=0.01)"
)


def frictions(of: str, kind: str, friction: Any) -> Frictions:
    """Return friction by slips, and refuse what a joint of this kind cannot have."""
    if friction is None:
        return {}
    _check(of, friction, kind in TURNING)
    if not isinstance(friction, Dry):
        return {"friction": dict.fromkeys(SLIPS[kind], friction)}
    if len(SLIPS[kind][0]) > 1:
        sentence = (
            f"friction= of {of}: a {kind} joint slips along {', '.join(SLIPS[kind][0])} at once"
        )
        hint = "Dry is along single coordinates, such as those of a compound joint"
        raise ValueError(hinted(sentence, hint))
    return {"dry": {name: friction for (name,) in SLIPS[kind]}}


def frictions_of_axes(of: str, turns: Mapping[str, bool], friction: Any) -> Frictions:
    """Return friction by slips of a compound joint, whose axes turn or do not."""
    if friction is None:
        return {}
    own = friction if isinstance(friction, Sequence) else [friction]
    if len(own) != len(turns):
        names = ", ".join(turns)
        sentence = f"friction= of {of} must be a friction or None for each of {names}"
        raise ValueError(f"{sentence}, not {friction!r}")
    found: Frictions = {"friction": {}, "dry": {}}
    for name, x in zip(turns, own, strict=True):
        if x is None:
            continue
        _check(f"'{name}' of {of}", x, turns[name])
        if isinstance(x, Dry):
            found["dry"][name] = x
        else:
            found["friction"][name,] = x
    return found


def _check(of: str, friction: Any, turns: bool) -> None:
    if isinstance(friction, Dry):
        return
    if not isinstance(friction, Coulomb):
        sentence = f"friction= of {of} must be a Dry, Coulomb or Stribeck, not {friction!r}"
        raise TypeError(hinted(sentence, HINT))
    if turns == (friction.radius is None):
        missing = "wants the radius of its pin" if turns else "slides, and has no radius"
        raise ValueError(f"friction= of {of}: the joint {missing}")
