"""Drake on scenes of discs, by point contacts.

Without restitution they are those of its discrete mode, as stiff as the step allows. Its elastic
contacts are springs, and an integrator with error control finds their hits.
"""

import time
from functools import partial

import numpy as np
from pydrake.geometry import AddContactMaterial, HalfSpace, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    DiscreteContactApproximation,
)
from pydrake.multibody.tree import PlanarJoint, RotationalInertia, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

STEPS, STIFF = (1e-3, 1e-4), 1e12
STIFFNESSES, ACCURACY = (1e8, 1e10), 1e-6


def runs(scene, records):
    """Yield name, step and what runs it."""
    if scene.restitution:
        for stiffness in STIFFNESSES:
            name = f"Drake, springs of {stiffness:.0e}"
            yield name, None, partial(run, scene, 0.0, stiffness, records)
    else:
        for h in STEPS:
            yield "Drake, SAP", h, partial(run, scene, h, STIFF, records)


def build(scene, h, stiffness):
    """Return the diagram and its plant."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=h)
    if h:
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    plant.mutable_gravity_field().set_gravity_vector([0.0, -scene.gravity, 0.0])
    properties = ProximityProperties()
    law = CoulombFriction(scene.friction, scene.friction)
    AddContactMaterial(0.0, stiffness, law, properties)
    world = plant.world_body()
    for k, (point, normal) in enumerate(scene.planes):
        pose = HalfSpace.MakePose([*normal, 0.0], [*point, 0.0])
        plant.RegisterCollisionGeometry(world, pose, HalfSpace(), f"plane {k}", properties)
    for k, body in enumerate(scene.bodies):
        inertia = SpatialInertia.MakeFromCentralInertia(
            body.mass, np.zeros(3), RotationalInertia(*3 * [body.inertia])
        )
        here = plant.AddRigidBody(f"{k}", inertia)
        joint = PlanarJoint(f"joint {k}", world.body_frame(), here.body_frame())
        plant.AddJoint(joint)
        for n, (x, y, radius) in enumerate(body.discs):
            place = RigidTransform([x, y, 0.0])
            plant.RegisterCollisionGeometry(here, place, Sphere(radius), f"{n}", properties)
    plant.Finalize()
    return builder.Build(), plant


def run(scene, h, stiffness, records):
    """Return seconds, and places and angles at the records."""
    diagram, plant = build(scene, h, stiffness)
    context = diagram.CreateDefaultContext()
    own = plant.GetMyContextFromRoot(context)
    plant.SetPositions(own, np.concatenate([body.at for body in scene.bodies]))
    plant.SetVelocities(own, np.concatenate([body.velocity for body in scene.bodies]))
    simulator = Simulator(diagram, context)
    if not h:
        simulator.get_mutable_integrator().set_target_accuracy(ACCURACY)
    simulator.Initialize()
    found, seconds = [plant.GetPositions(own)], 0.0
    for t in np.linspace(0, scene.seconds, records + 1)[1:]:
        begin = time.perf_counter()
        simulator.AdvanceTo(t)
        seconds += time.perf_counter() - begin
        found.append(plant.GetPositions(own))
    return seconds, np.reshape(found, (records + 1, -1, 3))
