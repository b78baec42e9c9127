"""Drake on mechanisms with loops, which ball constraints close in its discrete mode.

Hinges and slides are joints of its tree; springs are force elements, damping is none.
"""

import time
from functools import partial

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, DiscreteContactApproximation
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    JacobianWrtVariable,
    LinearSpringDamper,
    PrismaticJoint,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
    UniversalJoint,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

STEPS = (1e-3, 1e-4)


def runs(model, begin, records):
    """Yield name, step and what runs it."""
    for h in STEPS:
        yield "Drake SAP", h, partial(Loop(model, begin, h).run, records)


class Loop:
    """A model with a step."""

    def __init__(self, model, begin, h):
        self.model = model
        builder = DiagramBuilder()
        self.plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=h)
        plant = self.plant
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        plant.mutable_gravity_field().set_gravity_vector(model.gravity)
        self.bodies = {"world": plant.world_body()}
        places = {"world": np.zeros(3), **{link.name: link.at for link in model.links}}
        for link in model.links:
            j = link.inertia
            moments = (j[0, 0], j[1, 1], j[2, 2], j[0, 1], j[0, 2], j[1, 2])
            inertia = SpatialInertia.MakeFromCentralInertia(
                link.mass, np.zeros(3), RotationalInertia(*moments)
            )
            self.bodies[link.name] = plant.AddRigidBody(link.name, inertia)
        for link in model.links:
            self.join(link, places)
        for a, b, point in model.closings:
            ends = point - places[a], point - places[b]
            plant.AddBallConstraint(self.bodies[b], ends[1], self.bodies[a], ends[0])
        plant.Finalize()
        self.builder, self.diagram = builder, builder.Build()
        self.begin = begin

    def join(self, link, places):
        """Add the joint of a link and its spring."""
        plant, parent, child = self.plant, self.bodies[link.parent], self.bodies[link.name]
        kinds = [kind for _, kind, _, _ in link.joints]
        name, _, axis, point = link.joints[0]
        if kinds == ["free"]:
            return
        if kinds == ["slide"]:
            point = link.at
        frame = np.eye(3)
        if kinds == ["hinge", "hinge"]:
            second = link.joints[1][2]
            frame = np.array([axis, second, np.cross(axis, second)]).T
        turn = RigidTransform(RotationMatrix(frame), np.zeros(3))
        frames = [
            plant.AddFrame(
                FixedOffsetFrame(
                    f"{name} of {key}", body, RigidTransform(turn.rotation(), point - places[key])
                )
            )
            for body, key in ((parent, link.parent), (child, link.name))
        ]
        if kinds == ["hinge"]:
            plant.AddJoint(RevoluteJoint(name, *frames, axis))
        elif kinds == ["hinge", "hinge"]:
            plant.AddJoint(UniversalJoint(name, *frames))
        else:
            plant.AddJoint(PrismaticJoint(name, *frames, axis))
            rest = float(np.linalg.norm(link.at - places[link.parent]))
            ends = parent, np.zeros(3), child, np.zeros(3)
            plant.AddForceElement(LinearSpringDamper(*ends, rest, link.stiffness, 0.0))

    def run(self, records):
        """Return seconds and the motion of all bodies."""
        plant, context = self.plant, self.diagram.CreateDefaultContext()
        own = plant.GetMyContextFromRoot(context)
        x, _, v, omega = self.begin
        for k, link in enumerate(self.model.links):
            if link.joints[0][1] == "free":
                plant.SetFreeBodyPose(own, self.bodies[link.name], RigidTransform(x[k]))
        rows, wanted = [], []
        for k, link in enumerate(self.model.links):
            jacobian = plant.CalcJacobianSpatialVelocity(
                own,
                JacobianWrtVariable.kV,
                self.bodies[link.name].body_frame(),
                np.zeros(3),
                plant.world_frame(),
                plant.world_frame(),
            )
            rows.append(jacobian)
            wanted += [omega[k], v[k]]
        speeds = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]
        plant.SetVelocities(own, speeds)
        simulator = Simulator(self.diagram, context)
        simulator.Initialize()
        found, seconds = [self.state(own)], 0.0
        for t in np.linspace(0, self.model.seconds, records + 1)[1:]:
            begin = time.perf_counter()
            simulator.AdvanceTo(t)
            seconds += time.perf_counter() - begin
            found.append(self.state(own))
        return seconds, [np.array(part) for part in zip(*found, strict=True)]

    def state(self, own):
        """Return places, turns, velocities and angular velocities of the bodies."""
        bodies = [self.bodies[link.name] for link in self.model.links]
        poses = [self.plant.EvalBodyPoseInWorld(own, body) for body in bodies]
        speeds = [self.plant.EvalBodySpatialVelocityInWorld(own, body) for body in bodies]
        return (
            np.array([pose.translation() for pose in poses]),
            np.array([pose.rotation().matrix() for pose in poses]),
            np.array([speed.translational() for speed in speeds]),
            np.array([speed.rotational() for speed in speeds]),
        )
