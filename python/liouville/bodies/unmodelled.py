"""Features of MuJoCo's models that an assembly has not, by names that can be left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted, quoted

#: Bits of ``opt.disableflags``.
OFF = {
    "constraint": 1,
    "equality": 2,
    "friction loss": 4,
    "limits": 8,
    "contact": 16,
    "spring": 32,
    "damper": 64,
    "gravity": 128,
    "clamp": 256,
    "filter parent": 1024,
    "actuation": 2048,
}
#: Codes of joints, of transmissions, and of gains, biases and activations.
JOINTS = ("free", "ball", "slide", "hinge")
OF_JOINT, OF_TENDON = (0, 1), 3
PLAIN = {"gain": (0, 1), "bias": (0, 1)}
MUSCLE = {"gain": 2, "bias": 2, "dyn": 4}
#: Codes of equality constraints.
EQUALITIES = ("connect", "weld", "joint")

#: The most names of where something is.
SHOWN = 6

#: Features that can be left out, with the elements that have them.
KNOWN: dict[str, str] = {
    "contact": "bodies",
    "contact shapes": "shapes",
    "friction of contacts": "shapes",
    "limits": "ball joints",
    "friction loss": "ball joints",
    "tendons": "tendons",
    "muscles": "actuators",
    "activation": "actuators",
    "transmissions": "actuators",
    "actuator models": "actuators",
    "nonlinear springs": "joints",
    "nonlinear damping": "joints",
    "springs of free bodies": "joints",
    "equality constraints": "constraints",
    "fluid": "",
    "gravity compensation": "bodies",
    "flex": "",
    "mocap": "bodies",
    "plugins": "",
}


def is_off(model: Any, what: str) -> bool:
    """Return whether the file switches a part of the physics off."""
    return bool(int(model.opt.disableflags) & OFF[what])


def named(model: Any, kind: str, index: int) -> str:
    """Return the name of a body, joint, actuator or constraint, or its kind with its number."""
    word = {"jnt": "joint", "eq": "constraint"}.get(kind, kind)
    return getattr(model, kind)(index).name or f"{word}{index}"


def check_names(without: Sequence[str]) -> None:
    """Refuse names of what could be left out that are none.

    Raises
    ------
    TypeError, ValueError
        There is an unknown name.
    """
    if isinstance(without, str) or not all(isinstance(x, str) for x in without):
        raise TypeError(f"without= must be a sequence of names, not {without!r}")
    for name in without:
        if name not in KNOWN:
            raise ValueError(
                hinted(
                    f"without= has {name!r}, which is no such thing",
                    f"there are {', '.join(KNOWN)}",
                )
            )


def check(model: Any, without: Sequence[str], touching: Mapping[str, list[str]]) -> None:
    """Refuse what a model has beyond an assembly, but for what is named in `without`.

    `touching` are the shapes whose contacts an assembly has not, by the reason.

    Raises
    ------
    ValueError
        The model has more.
    """
    own = {**_found(model), **touching}
    found = {name: own[name] for name in KNOWN if own.get(name) and name not in without}
    if not found:
        return
    parts = [
        f"{name} ({KNOWN[name]} {_some(items)})" if KNOWN[name] else name
        for name, items in found.items()
    ]
    sentence = f"the file has parts that an assembly does not support: {'; '.join(parts)}"
    left = [*without, *found]
    raise ValueError(hinted(sentence, f"leave it out: without={tuple(left)}"))


def plain_actuators(model: Any) -> list[int]:
    """Return the actuators that are modelled, but for those that the file switches off."""
    bad = {k for items in _actuators(model).values() for k in items}
    return [k for k in _switched_on(model) if k not in bad]


def _some(items: list[str]) -> str:
    if len(items) <= SHOWN:
        return quoted(items)
    return f"{', '.join(repr(x) for x in items[:SHOWN])} and {len(items) - SHOWN} more"


def _found(model: Any) -> dict[str, list[str]]:
    """Return contents of a model that an assembly does not support, with where they are."""
    joints, bodies = range(model.njnt), range(model.nbody)
    dofs = model.dof_jntid

    def somewhere(values: NDArray[Any]) -> NDArray[Any]:
        return np.flatnonzero(values.any(axis=tuple(range(1, values.ndim))))

    def at_joints(values: NDArray[Any]) -> list[str]:
        return [named(model, "jnt", int(k)) for k in somewhere(values)]

    def at_dofs(values: NDArray[Any]) -> list[str]:
        own = somewhere(values)
        return [named(model, "jnt", int(k)) for k in dict.fromkeys(dofs[own].tolist())]

    springs = not is_off(model, "spring")
    measured = [k for k in joints if JOINTS[model.jnt_type[k]] in ("slide", "hinge")]
    sliding = {named(model, "jnt", k) for k in measured}
    flying = [k for k in joints if model.jnt_type[k] == 0 and model.jnt_stiffness[k]]
    bent = np.column_stack([model.jnt_stiffnesspoly, model.jnt_springyield])
    all_found: dict[str, Callable[[], list[str]]] = {
        "limits": lambda: [
            named(model, "jnt", k) for k in joints if has_limits(model, k) and k not in measured
        ],
        "friction loss": lambda: (
            [x for x in at_dofs(model.dof_frictionloss) if x not in sliding]
            if has_friction_loss(model)
            else []
        ),
        "tendons": lambda: [named(model, "tendon", k) for k in range(model.ntendon)],
        "nonlinear springs": lambda: at_joints(bent) if springs else [],
        "nonlinear damping": lambda: (
            at_dofs(model.dof_dampingpoly) if not is_off(model, "damper") else []
        ),
        "springs of free bodies": lambda: (
            [named(model, "jnt", k) for k in flying] if springs else []
        ),
        "equality constraints": lambda: [
            named(model, "eq", k) for k in active(model) if model.eq_type[k] >= len(EQUALITIES)
        ],
        "fluid": lambda: ["all"] if model.opt.density > 0 or model.opt.viscosity > 0 else [],
        "gravity compensation": lambda: [
            named(model, "body", k) for k in bodies if model.body_gravcomp[k]
        ],
        "flex": lambda: ["all"] if model.nflex else [],
        "mocap": lambda: [named(model, "body", k) for k in bodies if model.body_mocapid[k] >= 0],
        "plugins": lambda: ["all"] if model.nplugin else [],
    }
    found = {name: items() for name, items in all_found.items()}
    for name, own in _actuators(model).items():
        found[name] = found.get(name, []) + [named(model, "actuator", k) for k in own]
    return found


def has_limits(model: Any, joint: int) -> bool:
    """Return whether a joint has stops."""
    is_on = not is_off(model, "constraint") and not is_off(model, "limits")
    return is_on and bool(model.jnt_limited[joint])


def has_friction_loss(model: Any) -> bool:
    """Return whether the file leaves friction loss on."""
    return not is_off(model, "constraint") and not is_off(model, "friction loss")


def active(model: Any) -> list[int]:
    """Return the equality constraints that hold from the start."""
    if is_off(model, "equality") or is_off(model, "constraint"):
        return []
    return [k for k in range(model.neq) if model.eq_active0[k]]


def _switched_on(model: Any) -> list[int]:
    if is_off(model, "actuation"):
        return []
    return [
        k
        for k in range(model.nactuator)
        if not int(model.opt.disableactuator) >> int(model.actuator_group[k]) & 1
    ]


def _actuators(model: Any) -> dict[str, list[int]]:
    """Return the actuators that are not modelled, by the reason."""
    found: dict[str, list[int]] = {}
    for k in _switched_on(model):
        reason = _reason(model, k)
        if reason:
            found.setdefault(reason, []).append(k)
    return found


def _reason(model: Any, k: int) -> str | None:
    codes = {x: int(getattr(model, f"actuator_{x}type")[k]) for x in ("gain", "bias", "dyn")}
    if any(codes[x] == code for x, code in MUSCLE.items()):
        return "muscles"
    if int(model.actuator_trntype[k]) == OF_TENDON:
        return "tendons"
    if any(codes[x] not in plain for x, plain in PLAIN.items()):
        return "actuator models"
    if codes["dyn"] or model.actuator_actnum[k]:
        return "activation"
    if int(model.actuator_trntype[k]) not in OF_JOINT:
        return "transmissions"
    if model.jnt_type[model.actuator_trnid[k, 0]] < 2:
        return "transmissions"
    delayed = model.actuator_delay[k] > 0 or model.actuator_damping[k]
    if delayed or model.actuator_dampingpoly[k].any() or model.actuator_ctrlnum[k] != 1:
        return "actuator models"
    return None
