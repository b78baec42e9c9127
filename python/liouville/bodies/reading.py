"""The assembly of a compiled model of MuJoCo's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from liouville._basics.errors import hinted
from liouville.bodies import rotations as rot
from liouville.bodies.actuation import Actuation, controls_of
from liouville.bodies.assembly import Assembly
from liouville.bodies.body import Body
from liouville.bodies.dry import Dry
from liouville.bodies.geoms import Pair, plane_of, restitution_of, shape_of
from liouville.bodies.joints import KINDS, Joint
from liouville.bodies.unmodelled import (
    EQUALITIES,
    JOINTS,
    active,
    has_friction_loss,
    has_limits,
    is_off,
    named,
    plain_actuators,
)

Array = NDArray[np.float64]

#: The code of a body among the kinds of objects that constraints join.
OF_BODY = 1


@dataclass(frozen=True)
class Link:
    """The axes of a link as drawn, and the body that it is part of."""

    body: Body
    place: Array
    quat: Any

    def placed(self, point: Array) -> Array:
        """Return a point in its axes, in the world."""
        return self.place + self.turned(point)

    def turned(self, direction: Array) -> Array:
        """Return a direction in its axes, in the world."""
        return np.array(rot.rotate(self.quat, direction))


class Reader:
    """A model and its state at the reference pose, made an assembly.

    Attributes
    ----------
    assembly : Assembly
        The assembly.
    """

    def __init__(self, model: Any, data: Any, controls: Any, without: Sequence[str] = ()) -> None:
        self.model, self.data, self.without = model, data, without
        gravity = np.zeros(3) if is_off(model, "gravity") else np.array(model.opt.gravity)
        self.assembly = Assembly(gravity=gravity)
        self.bodies: dict[int, Body] = {0: self.assembly.ground}
        #: the joint of the assembly and its coordinate, by the number of the file's joint
        self.places: dict[int, tuple[str, str]] = {}
        self.actuation = self._actuation(controls)
        self._taken = {"ground"}
        self._read_bodies()
        coupled = self._coupled()
        for body in self._moving():
            self._read_joints(int(body), coupled)
        for k in active(model):
            if model.eq_type[k] < len(EQUALITIES):
                getattr(self, f"_{EQUALITIES[model.eq_type[k]]}")(k, self._free_name(k))

    def _moving(self) -> Array:
        own = np.arange(self.model.nbody)
        found: Array = own[(self.model.body_weldid == own) & (self.model.body_dofnum > 0)]
        return found

    def _actuation(self, controls: Any) -> dict[int, Actuation]:
        """Return the actuation of each joint that has actuators."""
        plain = plain_actuators(self.model)
        signals, self.assembly.params = controls_of(self.model, plain, controls)
        found: dict[int, Actuation] = {}
        for k in plain:
            joint = int(self.model.actuator_trnid[k, 0])
            found.setdefault(joint, Actuation(self.model, joint)).add(k, signals[k])
        return found

    def _free_name(self, k: int) -> str:
        name = named(self.model, "eq", k)
        return self._unused(name, f"{name}.constraint")

    def _unused(self, *names: str) -> str:
        """Return the first of these names that nothing has yet, or the last with a number."""
        numbered = (f"{names[-1]}{k}" for k in count(2))
        found = next(name for name in chain(names, numbered) if name not in self._taken)
        self._taken.add(found)
        return found

    def placed(self, body: int, point: Array) -> Array:
        """Return a point in the axes of a file's body, in the world as drawn."""
        found: Array = self.data.xpos[body] + self.turned(body, point)
        return found

    def turned(self, body: int, direction: Array) -> Array:
        """Return a direction in the axes of a file's body, in the world as drawn."""
        return np.array(rot.rotate(self.data.xquat[body], direction))

    def body_of(self, body: int) -> Body:
        """Return the body of the assembly that a file's body is part of."""
        return self.bodies.get(int(self.model.body_weldid[body]), self.assembly.ground)

    def link(self, of: str, prefix: str, name: Any) -> Link:
        """Return a link by its name, which with the prefix is that of a site."""
        sites = [named(self.model, "site", k) for k in range(self.model.nsite)]
        known = [x.removeprefix(prefix) for x in sites if x.startswith(prefix)]
        if name not in known:
            raise ValueError(hinted(f"{of} has no link {name!r}", f"links are {', '.join(known)}"))
        k, data = sites.index(prefix + name), self.data
        body = int(self.model.site_bodyid[k])
        quat = rot.product(data.xquat[body], self.model.site_quat[k])
        return Link(self.body_of(body), data.site_xpos[k].copy(), quat)

    def _read_bodies(self) -> None:
        model, data = self.model, self.data
        for body in self._moving().tolist():
            parts = np.flatnonzero((model.body_weldid == body) & (model.body_mass > 0))
            name = named(model, "body", body)
            if not len(parts):
                raise ValueError(
                    hinted(
                        f"body '{name}' moves and has no mass",
                        "give it one in the file, or take its joints out",
                    )
                )
            mass = float(model.body_mass[parts].sum())
            centre = model.body_mass[parts] @ data.xipos[parts] / mass
            rotation, inertia = self._principal(parts.tolist(), centre)
            name = self._unused(name, f"{name}.body")
            self.bodies[body] = self.assembly.body(
                name, mass=mass, inertia=inertia, at=centre, rotation=rotation
            )

    def _principal(self, parts: list[int], centre: Array) -> tuple[Any, Array]:
        """Return the principal axes of bodies that move as one, and the moments."""
        model, data = self.model, self.data
        axes = [rot.product(data.xquat[k], model.body_iquat[k]) for k in parts]
        if len(parts) == 1:
            return axes[0], model.body_inertia[parts[0]].copy()
        total = np.zeros((3, 3))
        for k, own in zip(parts, axes, strict=True):
            turn, arm = np.array(rot.columns(own)).T, data.xipos[k] - centre
            total += turn @ np.diag(model.body_inertia[k]) @ turn.T
            total += model.body_mass[k] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        moments, frame = np.linalg.eigh(total)
        frame[:, 0] *= np.linalg.det(frame)
        return rot.of_frame(frame[:, 0], frame[:, 2]), moments

    def _coupled(self) -> set[int]:
        """Return the joints that others follow, whose turns are to be counted."""
        model = self.model
        rows = [k for k in active(model) if model.eq_type[k] == EQUALITIES.index("joint")]
        pairs = [(int(model.eq_obj1id[k]), int(model.eq_obj2id[k])) for k in rows]
        return {joint for pair in pairs for joint in pair if joint >= 0}

    def _read_joints(self, body: int, coupled: set[int]) -> None:
        model = self.model
        first = int(model.body_jntadr[body])
        joints = list(range(first, first + int(model.body_jntnum[body])))
        kinds = [JOINTS[model.jnt_type[k]] for k in joints]
        child, parent = self.bodies[body], self.body_of(int(model.body_parentid[body]))
        name = named(model, "body", body)
        if len(joints) > 1 and not set(kinds) <= {"slide", "hinge"}:
            raise ValueError(
                f"body '{name}' has a ball joint beside others, which no compound joint has"
            )
        if len(joints) == 1:
            own = model.jnt(first).name
            name = self._unused(own or f"{name}.{kinds[0]}", f"{own or name}.{kinds[0]}")
        else:
            name = self._unused(f"{name}.joints")
        if kinds[0] in ("free", "ball"):
            self._round(name, parent, child, first, kinds[0])
        elif len(joints) == 1 and first not in coupled and not self._armature(first):
            self._single(name, parent, child, first)
        else:
            self._several(name, parent, child, joints)

    def _acting(self, joint: int) -> dict[str, Any]:
        """Return damping, spring and effort of a hinge or slide."""
        model = self.model
        dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
        effort = self.actuation.get(joint)
        return {
            "damping": 0.0 if is_off(model, "damper") else float(model.dof_damping[dof]),
            "spring": 0.0 if is_off(model, "spring") else float(model.jnt_stiffness[joint]),
            "rest": float(model.qpos_spring[at] - model.qpos0[at]),
            "effort": effort,
            "limits": self._limits(joint),
            "friction": self._friction(dof),
        }

    def _friction(self, dof: int) -> Dry | None:
        """Return the friction loss of a hinge or slide."""
        loss = float(self.model.dof_frictionloss[dof])
        is_left_out = "friction loss" in self.without or not has_friction_loss(self.model)
        return None if is_left_out or not loss else Dry(loss)

    def _limits(self, joint: int) -> tuple[float, float] | None:
        """Return the limits of a hinge or slide, from where it is drawn."""
        model = self.model
        if "limits" in self.without or not has_limits(model, joint):
            return None
        low, high = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
        return float(low), float(high)

    def read_contacts(self, pairs: Sequence[Pair], restitution: Any) -> None:
        """Add the contacts of pairs of shapes."""
        model, data = self.model, self.data
        across, restitutions = plane_of(model, data), restitution_of(pairs, restitution)
        for pair in pairs:
            bodies = [self.body_of(int(model.geom_bodyid[k])) for k in pair.geoms]
            shapes = [
                shape_of(model, data, k, body) for k, body in zip(pair.geoms, bodies, strict=True)
            ]
            self.assembly.contact(
                self._unused(pair.name),
                *shapes,
                restitution=restitutions(pair.name),
                friction=pair.friction or 0.0,
                across=across,
            )

    def _armature(self, joint: int) -> float:
        own = float(self.model.dof_armature[self.model.jnt_dofadr[joint]])
        return own + (self.actuation[joint].armature if joint in self.actuation else 0.0)

    def _single(self, name: str, parent: Body, child: Body, joint: int) -> None:
        own, slides = self._acting(joint), JOINTS[self.model.jnt_type[joint]] == "slide"
        effort = own.pop("effort")
        own["force" if slides else "torque"] = effort
        at, axis = self.data.xanchor[joint], self.data.xaxis[joint]
        add = self.assembly.prismatic if slides else self.assembly.revolute
        made = add(name, parent, child, at=at.copy(), axis=axis.copy(), **own)
        self.places[joint] = name, made.coordinates[0]

    def _several(self, name: str, parent: Body, child: Body, joints: list[int]) -> None:
        """Add a compound joint."""
        axes: list[tuple[Any, ...]] = []
        for k in joints:
            axis, point = self.data.xaxis[k].copy(), self.data.xanchor[k].copy()
            slides = JOINTS[self.model.jnt_type[k]] == "slide"
            axes.append(("slide", axis) if slides else ("turn", axis, point))
        acting = [self._acting(k) for k in joints]
        names = [named(self.model, "jnt", k) for k in joints] if len(joints) > 1 else None
        made = self.assembly.compound(
            name,
            parent,
            child,
            axes,
            names=names,
            armature=[self._armature(k) for k in joints],
            **{key: [x[key] for x in acting] for key in acting[0]},
        )
        self.places |= {k: (name, own) for k, own in zip(joints, made.coordinates, strict=True)}

    def _round(self, name: str, parent: Body, child: Body, joint: int, kind: str) -> None:
        """Add a ball joint with its spring, or none; the others act on all of its rates."""
        model, data = self.model, self.data
        dof = int(model.jnt_dofadr[joint])
        kind = {"free": "free", "ball": "spherical"}[kind]
        rates = KINDS[kind].coordinates
        damping = 0.0 if is_off(model, "damper") else float(model.dof_damping[dof])
        armature = float(model.dof_armature[dof])
        stiffness = 0.0 if is_off(model, "spring") else float(model.jnt_stiffness[joint])
        at = data.xpos[model.jnt_bodyid[joint]] if kind == "free" else data.xanchor[joint]
        points = (np.zeros(3), at.copy()) if kind == "free" else (at.copy(), at.copy())
        self._add(
            kind,
            name,
            (parent, child),
            points,
            damping=dict.fromkeys(rates, damping) if damping else {},
            armature=dict.fromkeys(rates, armature) if armature else {},
            sizes={"stiffness": stiffness} if stiffness and kind == "spherical" else {},
        )

    def _add(self, kind: str, name: str, sides: Any, points: Any, **more: Any) -> Joint:
        return self.assembly._add(kind, name, sides, points, **more)

    def _ends(self, k: int) -> list[tuple[int, Array, Any]]:
        """Return body, place and attitude as drawn of the frames that constraint k joins."""
        model, found = self.model, []
        for which, part in ((model.eq_obj1id[k], slice(0, 3)), (model.eq_obj2id[k], slice(3, 6))):
            own = int(which)
            if int(model.eq_objtype[k]) != OF_BODY:  # sites
                body = int(model.site_bodyid[own])
                point = self.placed(body, model.site_pos[own])
                quat = rot.product(self.data.xquat[body], model.site_quat[own])
            else:
                body, quat = own, self.data.xquat[own]
                if EQUALITIES[model.eq_type[k]] == "weld":  # its data has the second body first
                    part = slice(3, 6) if part.start == 0 else slice(0, 3)
                point = self.placed(body, model.eq_data[k, part])
            found.append((body, point, quat))
        return found

    def _connect(self, k: int, name: str) -> None:
        (a, p, _), (b, r, _) = self._ends(k)
        self.assembly.spherical(name, self.body_of(a), self.body_of(b), at=(p, r))

    def _weld(self, k: int, name: str) -> None:
        (a, p, e), (b, r, f) = self._ends(k)
        if int(self.model.eq_objtype[k]) == OF_BODY:
            e = rot.product(e, self.model.eq_data[k, 6:10])
        first, second = self.body_of(a), self.body_of(b)
        frames = tuple(
            tuple(float(x) for x in rot.product(rot.conjugate(body.rotation), own))
            for body, own in ((first, e), (second, f))
        )
        self._add("fixed", name, (first, second), (p, r), frames=frames)

    def _joint(self, k: int, name: str) -> None:
        model = self.model
        joints = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
        places = [self.places[joint] for joint in joints if joint >= 0]
        by = model.eq_data[k, :5].copy()
        if len(places) == 1:
            by = by[:1]
        self.assembly.couple(name, *places, by=by)
