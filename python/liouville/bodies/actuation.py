"""Actuators of a file as torques and forces of joints, their signals parameters or functions."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from liouville._basics import casadi as ca
from liouville._basics.errors import hinted
from liouville.bodies.body import numbers
from liouville.bodies.unmodelled import is_off, named

#: A signal: a function of time, angle, rate and parameters.
Signal = Callable[..., Any]


class Actuation:
    """The force of all actuators of a hinge or slide along it.

    An actuator makes gain times signal plus bias of its length, which is the joint's by the gear;
    both may be affine in length and rate. Signals, and forces, are kept to their ranges.

    Attributes
    ----------
    armature : float
        Inertia of their rotors, seen from the joint.
    """

    def __init__(self, model: Any, joint: int) -> None:
        self.model, self._joint = model, joint
        self._zero = float(model.qpos0[model.jnt_qposadr[joint]])
        self._actuators: list[tuple[int, Signal]] = []
        self.armature = 0.0

    def add(self, actuator: int, signal: Signal) -> None:
        """Add an actuator."""
        self._actuators.append((actuator, signal))
        gear = float(self.model.actuator_gear[actuator, 0])
        self.armature += gear**2 * float(self.model.actuator_armature[actuator])

    def __call__(self, t: Any, value: Any, rate: Any, params: Any) -> Any:
        """Return the torque or force."""
        model, total = self.model, 0
        for k, signal in self._actuators:
            control = signal(t, value, rate, params)
            if model.actuator_ctrllimited[k] and not is_off(model, "clamp"):
                control = _kept(control, model.actuator_ctrlrange[k])
            gear = float(model.actuator_gear[k, 0])
            motion = 1.0, gear * (value + self._zero), gear * rate
            force = self._affine(k, "gain", motion) * control + self._affine(k, "bias", motion)
            if model.actuator_forcelimited[k]:
                force = _kept(force, model.actuator_forcerange[k])
            total = total + gear * force
        if model.jnt_actfrclimited[self._joint]:
            total = _kept(total, model.jnt_actfrcrange[self._joint])
        return total

    def _affine(self, k: int, which: str, motion: tuple[Any, ...]) -> Any:
        """Return the gain or the bias."""
        numbers = getattr(self.model, f"actuator_{which}prm")[k, :3].tolist()
        kind = int(getattr(self.model, f"actuator_{which}type")[k])
        if kind == 0:  # a constant gain, or no bias
            return numbers[0] if which == "gain" else 0.0
        return sum(x * y for x, y in zip(numbers, motion, strict=True) if x)


def _kept(value: Any, limits: Any) -> Any:
    return ca.fmax(ca.fmin(value, float(limits[1])), float(limits[0]))


def controls_of(
    model: Any, actuators: list[int], controls: Mapping[str, Any] | None
) -> tuple[dict[int, Signal], dict[str, Any]]:
    """Return the signals of actuators, and the parameters that some of them are."""
    given = dict(controls or {})
    known = [named(model, "actuator", k) for k in actuators]
    for name in given:
        if name not in known:
            sentence = f"controls= has {name!r}, which is no actuator"
            raise ValueError(hinted(sentence, f"actuators are {', '.join(known) or 'none'}"))
    signals: dict[int, Signal] = {}
    params: dict[str, Any] = {}
    for k, name in zip(actuators, known, strict=True):
        if name not in given:
            own = _identifier(name, params)
            params[own] = 0.0
            signals[k] = _parameter(own)
        elif callable(given[name]):
            signals[k] = given[name]
        else:
            signals[k] = _constant(float(numbers(f"control of '{name}'", given[name], ())))
    return signals, params


def _identifier(name: str, taken: Mapping[str, Any]) -> str:
    """Return a parameter's name for an actuator's."""
    own = re.sub(r"\W", "_", name)
    own = own if own.isidentifier() else f"_{own}"
    while own in taken:
        own += "_"
    return own


def _parameter(name: str) -> Signal:
    return lambda t, value, rate, params: getattr(params, name)


def _constant(number: float) -> Signal:
    return lambda t, value, rate, params: number
